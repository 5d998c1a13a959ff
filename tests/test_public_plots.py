"""`zs.plots`: what is drawn is what the plan has, on any base and ground, as vectors with text."""

from __future__ import annotations

import subprocess
import sys
import xml.etree.ElementTree as ET
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zmp_sqp as zs
from tests.test_inspect import BARE
from zmp_sqp.charts import Swing
from zmp_sqp.planning.proof.certificate import certify_for
from zmp_sqp.plots.loci import MOST_TICKS, tick_labels, tick_step
from zmp_sqp.plots.outlines import hull, machine_outlines
from zmp_sqp.scenario import load_scenario
from zmp_sqp.sqp.solver import SQPSettings

pytest.importorskip("matplotlib")

SVG = "{http://www.w3.org/2000/svg}"
OF_A_MOTION = ("locus", "profiles", "margins", "film_strip")
KINDS = ("paper_1", "torque", "retreat", "terrain", "blocked")


@pytest.fixture(scope="module")
def blocked(tmp_path_factory: pytest.TempPathFactory) -> zs.Plan:
    """Plan of a swing of an arm that stays stretched, which tips the machine over at any speed."""
    problem = load_scenario("paper_1").problem
    hold = {"boom": -0.5236, "stick": -2.0944, "tilt": 0.5236, "head": -1.5708}
    with pytest.warns(zs.MachineWarning, match="not planned"):
        machine = zs.load_machine("feller_buncher", hold=hold)
    load = zs.Payload(mass=6000.0, com=(0.0, 0.0, 3.323), frame="head")
    found = zs.plan(
        zs.Problem(machine.with_payload(load), [0.0], [np.pi], ground=problem.ground, intervals=20)
    )
    assert not found.success
    assert found.attempt is not None
    return found


@pytest.fixture(scope="module")
def plans(blocked: zs.Plan) -> dict[str, zs.Plan]:
    names = [name for name in KINDS if name != "blocked"]
    found = {name: zs.plan(load_scenario(name).problem) for name in names}
    assert all(one.success for one in found.values())
    return found | {"blocked": blocked}


def svg_of(figure: Any) -> ET.Element:
    file = BytesIO()
    figure.savefig(file, format="svg")
    return ET.fromstring(file.getvalue())


def texts_of(figure: Any) -> list[str]:
    """Texts of the SVG of a figure, in order."""
    return ["".join(element.itertext()) for element in svg_of(figure).iter(f"{SVG}text")]


def lines_of(axes: Any) -> dict[str, Any]:
    return {line.get_label(): line for line in axes.get_lines()}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", [*OF_A_MOTION, "convergence"])
def test_every_figure_of_every_plan_is_vectors_with_text_as_text(
    plans: dict[str, zs.Plan], name: str, kind: str
) -> None:
    figure = getattr(zs.plots, name)(plans[kind])
    root = svg_of(figure)
    assert root.tag == f"{SVG}svg"
    assert not list(root.iter(f"{SVG}image"))
    texts = {"".join(element.itertext()) for element in root.iter(f"{SVG}text")}
    labels = {
        label
        for axes in figure.findobj(match=lambda artist: hasattr(artist, "get_xlabel"))
        for label in (axes.get_xlabel(), axes.get_ylabel())
        if label
    }
    assert labels
    assert labels <= texts  # as they are, no outlines of letters
    unitless = {"iteration", "measure (no unit)"}
    assert all("[" in label and "]" in label for label in labels - unitless), labels


def test_pdf_files_have_no_images_and_are_the_same_each_time(plans: dict[str, zs.Plan]) -> None:
    contents = []
    for _ in range(2):
        file = BytesIO()
        zs.plots.locus(plans["paper_1"]).savefig(file, format="pdf")
        contents.append(file.getvalue())
    assert contents[0] == contents[1]
    assert contents[0].startswith(b"%PDF")
    assert b"/Subtype /Image" not in contents[0]
    assert b"/Subtype /Type0" in contents[0] or b"/FontType 42" in contents[0]


def test_a_tick_at_each_whole_second_is_where_the_zmp_is_then(plans: dict[str, zs.Plan]) -> None:
    plan = plans["paper_1"]
    problem = plan.problem
    [axes] = zs.plots.locus(plan).axes
    ticks = lines_of(axes)["each 1 s"].get_xydata()
    expected = zs.trajectory_zmp(
        problem.machine, plan.trajectory, np.arange(1.0, 4.6, 1.0), problem.ground
    )
    np.testing.assert_allclose(ticks, expected, rtol=0.0, atol=1e-12)
    labels = {
        text.get_text(): np.array(text.xy) for text in axes.texts if text.get_text().endswith(" s")
    }
    assert set(labels) == {"1 s", "2 s", "3 s", "4 s"}
    for second, point in enumerate(expected, 1):
        np.testing.assert_allclose(labels[f"{second} s"], point, atol=1e-12)


def test_start_end_and_worst_point_are_marked(plans: dict[str, zs.Plan]) -> None:
    plan = plans["torque"]
    problem, found = plan.problem, plan.certificate
    [axes] = zs.plots.locus(plan).axes
    lines = lines_of(axes)
    at = [0.0, np.nextafter(plan.duration, 0.0), found.margin_at]
    first, last, worst = zs.trajectory_zmp(
        problem.machine, plan.trajectory, np.array(at), problem.ground
    )
    label = f"least margin: 0.590 m guaranteed,\n{found.tip_over.label}, at {found.margin_at:.2f} s"
    np.testing.assert_allclose(lines[label].get_xydata()[0], worst, atol=1e-12)
    marked = [line.get_xydata() for line in axes.get_lines() if line.get_markersize() == 7]
    for point in (first, last, worst):
        assert min(np.linalg.norm(point - other[0]) for other in marked if len(other)) < 1e-9
    assert {"o", "s", "D"} <= {line.get_marker() for line in axes.get_lines()}
    np.testing.assert_allclose(
        np.abs(lines["margin asked for: 0.1 m"].get_xydata()), np.tile([2.4, 1.515], (5, 1))
    )


def test_ticks_are_few_and_whole_seconds_where_a_motion_has_them() -> None:
    for duration in np.geomspace(0.05, 1e6, 200):
        step = tick_step(float(duration))
        assert duration / step <= MOST_TICKS * (1.0 + 1e-12)
        assert step in (0.1, 0.2, 0.5) or step == round(step)
        assert duration < 3.0 or step >= 1.0
    points = np.array([[0.0, 0.0], [0.01, 0.0], [0.02, 0.0], [5.0, 0.0]])
    labels = tick_labels(np.array([1.0, 2.0, 3.0, 4.0]), points, 0.1)
    assert [text for _, text in labels] == ["1 to 3 s", "4 s"]


def test_a_locus_outside_the_polygon_is_called_not_safe_and_has_a_halo(blocked: zs.Plan) -> None:
    [axes] = zs.plots.locus(blocked).axes
    assert "ZMP locus: full model, not safe" in lines_of(axes)
    [halo] = [line for line in axes.get_lines() if line.get_linewidth() == 5.0]
    outside = halo.get_xydata()[np.isfinite(halo.get_xydata()).all(axis=1)]
    assert len(outside) > 50
    assert (blocked.problem.machine.support.signed_distance(outside) < 0.0).all()


@pytest.mark.parametrize("kind", KINDS)
def test_profiles_are_the_motion_of_the_plan(plans: dict[str, zs.Plan], kind: str) -> None:
    plan = plans[kind]
    figure = zs.plots.profiles(plan)
    part = figure.subfigs[0] if figure.subfigs else figure
    for axes, quantity in zip(part.axes, (2, 1, 0), strict=True):
        for joint, name in enumerate(plan.problem.machine.joint_names):
            times, values = lines_of(axes)[name].get_xydata().T
            expected = plan.attempt(times)[quantity][:, joint]
            np.testing.assert_allclose(values, expected, rtol=0.0, atol=1e-9)


def test_joints_that_turn_and_joints_that_slide_have_axes_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "crane.urdf"
    path.write_text(BARE, encoding="utf-8")
    machine = zs.load_machine(path, limits={"acceleration": 0.4})
    assert set(machine.joint_units) == {"rad", "m"}
    start, goal = np.array([0.0, 0.3]), np.array([0.5, 0.4])
    motion = zs.phase_plane(machine, start, goal)
    turning, sliding = zs.plots.profiles(zs.Problem(machine, start, goal), motion).subfigs
    assert [axes.get_ylabel() for axes in turning.axes] == [
        "acceleration [rad/s²]",
        "rate [rad/s]",
        "angle [rad]",
    ]
    assert [axes.get_ylabel() for axes in sliding.axes] == [
        "acceleration [m/s²]",
        "rate [m/s]",
        "position [m]",
    ]
    for part, unit in ((turning, "rad"), (sliding, "m")):
        drawn = [name for name in machine.joint_names if name in lines_of(part.axes[0])]
        assert drawn == [
            name
            for name, own in zip(machine.joint_names, machine.joint_units, strict=True)
            if own == unit
        ]


@pytest.mark.parametrize("kind", KINDS)
def test_margins_are_those_of_every_edge_with_the_guaranteed_one_as_a_line(
    plans: dict[str, zs.Plan], kind: str
) -> None:
    plan = plans[kind]
    problem, found = plan.problem, plan.certificate.tip_over
    axes = zs.plots.margins(plan).axes[0]
    support, lines = problem.machine.support, lines_of(axes)
    for edge in (0, 2):
        times, room = lines[f"{support.edge_name(edge)} edge"].get_xydata().T
        # the left limits at nodes are the sample before
        inside = ~np.isin(times, plan.attempt.times)
        at = zs.trajectory_zmp(problem.machine, plan.attempt, times[inside], problem.ground)
        expected = support.offsets[edge] - at @ support.normals[edge]
        np.testing.assert_allclose(room[inside], expected, rtol=0.0, atol=1e-6)
    [level] = [line for label, line in lines.items() if label.startswith("guaranteed: ")]
    assert level.get_ydata()[0] == found.value
    least = np.nanmin([lines[f"{support.edge_name(i)} edge"].get_ydata() for i in range(4)])
    assert found.value <= least < found.value + 2e-3
    [diamond] = [line for line in axes.get_lines() if line.get_marker() == "D"]
    np.testing.assert_allclose(diamond.get_xydata()[0], [found.time, found.value])


def test_torques_have_room_in_their_unit(plans: dict[str, zs.Plan]) -> None:
    plan = plans["torque"]
    tip_over, contact, axes = zs.plots.margins(plan).axes
    assert tip_over.get_ylabel() == "room [m]"
    assert contact.get_ylabel() == "room [kN]"
    assert axes.get_title("left") == "torque limits"
    assert axes.get_ylabel() == "room [kN m]"
    times, room = lines_of(axes)["boom torque"].get_xydata().T
    limit = plan.problem.machine.limits.effort[1]
    assert 0.0 < 1e3 * np.nanmin(room) < 1e-3 * limit
    assert 1e3 * np.nanmax(room) <= limit
    [level] = [line for label, line in lines_of(axes).items() if label.startswith("guaranteed")]
    found = next(one for one in plan.certificate.guarantees if one.name == "torque_limits")
    assert level.get_ydata()[0] == pytest.approx(1e-3 * found.value, rel=1e-12)
    assert times[-1] == pytest.approx(plan.duration)


def test_a_users_own_rows_have_a_panel_with_their_unit() -> None:
    def tip_speed(machine: zs.Machine, q: Any, v: Any, a: Any) -> tuple[Any, Any]:
        jacobian = np.zeros((len(q), 1, 3 * machine.size))
        jacobian[:, 0, machine.size + 1] = 2.0 * v[:, 1]
        return (v[:, 1] ** 2 - 0.25)[:, None], jacobian

    slow = zs.PathRows("slow_boom", tip_speed, labels=["boom rate"], units=["rad^2/s^2"])
    problem = replace(load_scenario("paper_1").problem, constraints=[slow], intervals=20)
    plan = zs.plan(problem)
    axes = zs.plots.margins(plan).axes[-1]
    assert axes.get_ylabel() == "room [rad^2/s^2]"
    times, room = lines_of(axes)["boom rate"].get_xydata().T
    np.testing.assert_allclose(room, 0.25 - plan.attempt(times)[1][:, 1] ** 2, atol=1e-9)
    assert any(label.startswith("sampled only") for label in lines_of(axes))


@pytest.mark.parametrize("kind", KINDS)
def test_the_iterations_are_those_of_the_plan(plans: dict[str, zs.Plan], kind: str) -> None:
    plan = plans[kind]
    above, below = zs.plots.convergence(plan).axes
    assert below.get_yscale() == "log"
    assert (above.get_ylabel(), below.get_xlabel()) == ("duration [s]", "iteration")
    curves = [line for line in above.get_lines() if line.get_label() == "duration"]
    runs = [run for run in plan.runs if run.iterations]
    assert len(curves) == len(runs)
    assert sum(len(line.get_xdata()) for line in curves) == len(plan.history)
    ended = [run for run in runs if run.status in ("optimal", "coarse", "bound_reached", "refused")]
    for run in ended:  # the last point of a run has its duration
        line = curves[runs.index(run)]
        assert line.get_ydata()[-1] == pytest.approx(run.duration, rel=1e-9)
    violations = np.concatenate(
        [line.get_ydata() for line in below.get_lines() if line.get_label() == "largest violation"]
    )
    np.testing.assert_allclose(
        violations, [max(record.violation, 1e-12) for record in plan.history]
    )
    if plan.success:
        assert violations[-1] < 1e-3 or any(run.purpose.startswith("glance") for run in runs)


def test_predicted_decreases_fall_to_the_stopping_criterion(plans: dict[str, zs.Plan]) -> None:
    plan = plans["torque"]
    ends = np.cumsum([run.iterations for run in plan.runs])
    last = max(i for i, run in enumerate(plan.runs) if not run.purpose.startswith("glance"))
    records = plan.history[ends[last] - plan.runs[last].iterations : ends[last]]
    decreases = [record.decrease for record in records]
    assert np.isfinite(decreases).all()
    assert decreases[0] > 1e-3
    # of the objective, the squared duration: twice the change of the duration that ends a run
    assert abs(decreases[-1]) < 2.0 * SQPSettings().converged * records[-1].objective


@pytest.mark.parametrize("kind", KINDS)
def test_a_film_strip_has_the_machine_where_kinematics_has_it(
    plans: dict[str, zs.Plan], kind: str
) -> None:
    import pinocchio as pin

    plan = plans[kind]
    figure = zs.plots.film_strip(plan, count=3)
    assert len(figure.axes) == 6
    machine, motion, side = plan.problem.machine, plan.attempt, figure.axes[1]
    t = 0.5 * motion.duration
    assert side.get_title().startswith(f"{t:.2f} s")
    model, data = machine.model, machine.model.createData()
    pin.forwardKinematics(model, data, machine.configuration(motion(t)[0][None])[0])
    root = pin.SE3.Identity()
    if motion.base is not None:
        pose = motion.base(np.array([t]))[0]
        ground = plan.problem.ground
        if isinstance(ground, zs.Heightmap):
            at, turn = ground.base_pose(pose)
            root = pin.SE3(turn[0], at[0])
        else:
            x, y, yaw = pose[0]
            root = pin.SE3(pin.utils.rotate("z", yaw), np.array([x, y, 0.0]))
    drawn = machine_outlines(machine)
    assert len(drawn) > 5
    filled = [patch.get_path().vertices[:-1] for patch in side.patches][::2]
    assert len(filled) == len(drawn)
    for outline, vertices in zip(drawn, filled, strict=True):
        placed = root * data.oMi[outline.joint]
        points = outline.points @ placed.rotation.T + placed.translation
        np.testing.assert_allclose(
            sorted(vertices.tolist()), sorted(hull(points[:, [0, 2]]).tolist()), atol=1e-9
        )


def test_an_overlaid_strip_fades_and_a_rear_view_has_left_on_the_left(
    plans: dict[str, zs.Plan],
) -> None:
    figure = zs.plots.film_strip(plans["paper_1"], count=4, views=["rear", "top"], overlaid=True)
    rear, top = figure.axes
    assert rear.get_xlabel() == "y left [m]"
    assert rear.get_xlim()[0] > rear.get_xlim()[1]
    opacities = [patch.get_alpha() for patch in rear.patches]
    assert len(set(opacities)) == 8  # faces and edges of four instants
    assert opacities[-1] == 1.0 > opacities[1]
    assert "downhill" in {text.get_text() for text in top.texts}


def test_a_problem_with_a_trajectory_is_drawn_as_its_plan_is(plans: dict[str, zs.Plan]) -> None:
    plan = plans["paper_1"]
    for name in OF_A_MOTION:
        draw = getattr(zs.plots, name)
        assert texts_of(draw(plan)) == texts_of(draw(plan.problem, plan.trajectory))
    assert certify_for(plan.problem, plan.trajectory).margin == plan.margin


def test_a_machine_without_shapes_is_drawn_as_bars() -> None:
    shipped = zs.load_machine("feller_buncher")
    unknown = replace(shipped, name="unknown")
    bars, shapes = machine_outlines(unknown), machine_outlines(shipped)
    assert 5 < len(bars) != len(shapes)
    assert len(machine_outlines(unknown, "feller_buncher")) == len(shapes)


def test_a_study_is_drawn_without_images() -> None:
    rows = [
        {
            "ground.roll_deg": x,
            "ground.pitch_deg": y,
            "success": x + y < 20.0,
            "status": "refused" if x + y > 25.0 else "infeasible",
            "duration": 4.0 + 0.1 * x,
            "margin": 1.0 - 0.01 * y,
        }
        for x in (-10.0, 0.0, 10.0, 20.0)
        for y in (0.0, 10.0)
    ]
    figure = zs.plots.envelope(rows, "ground.roll_deg", "ground.pitch_deg")
    assert not list(svg_of(figure).iter(f"{SVG}image"))
    duration = figure.axes[0]
    assert duration.get_xlabel() == "ground.roll_deg [degrees]"
    cells = np.ma.getdata(duration.collections[0].get_array()).reshape(2, 4)
    assert cells[0, 1] == 4.0
    assert np.isnan(cells[1, 3])
    rows = [
        {"plan.margin": m, "success": m < 0.3, "duration": 4.0 + m, "lower_bound": 3.9}
        for m in (0.0, 0.2, 0.4)
    ]
    [axes] = zs.plots.tradeoff(rows).axes
    np.testing.assert_allclose(lines_of(axes)["planned"].get_xydata(), [[0.0, 4.0], [0.2, 4.2]])
    assert axes.get_xlabel() == "margin asked for [m]"


def test_charts_and_machines_are_drawn_without_images() -> None:
    machine = zs.load_machine("feller_buncher")
    chart = zs.load_chart(machine, frame="head", radii=[4.0, 6.0], heights=[0.0, 2.0])
    swing = Swing.of(chart, np.pi / 2.0).arranged([])
    for figure, words in (
        (zs.plots.load_chart(chart), "radius [m]"),
        (zs.plots.swing_chart(swing), "radius [m]"),
        (zs.plots.machine(zs.inspect(machine)), "z up [m]"),
    ):
        root = svg_of(figure)
        assert not list(root.iter(f"{SVG}image"))
        assert words in {"".join(element.itertext()) for element in root.iter(f"{SVG}text")}


def test_threads_draw_at_the_same_time_and_text_stays_text(plans: dict[str, zs.Plan]) -> None:
    def draw(name: str) -> list[str]:
        return texts_of(getattr(zs.plots, name)(plans["paper_1"]))

    names = [*OF_A_MOTION, "convergence"] * 2
    alone = [draw(name) for name in names]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(draw, names))
    assert together == alone
    assert all(len(texts) > 10 for texts in alone)


def test_settings_of_matplotlib_are_left_as_they_were(plans: dict[str, zs.Plan]) -> None:
    import matplotlib as mpl

    before = dict(mpl.rcParams)
    svg_of(zs.plots.locus(plans["paper_1"]))
    assert dict(mpl.rcParams) == before


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda plan: zs.plots.locus("paper_1"), "give a Plan, or a Problem and a Trajectory"),
        (lambda plan: zs.plots.margins(plan.problem), "give a Trajectory"),
        (lambda plan: zs.plots.profiles(plan, plan.trajectory), "leave out the trajectory"),
        (lambda plan: zs.plots.film_strip(plan, count=0), "count must be from 1 to 24"),
        (lambda plan: zs.plots.film_strip(plan, views=["front"]), "views are side, top, rear"),
        (lambda plan: zs.plots.convergence(plan.problem), "give a Plan"),
        (lambda plan: zs.plots.envelope([], "a", "b"), "no results to draw"),
        (lambda plan: zs.plots.tradeoff([{"success": True}]), "row 0 lacks 'plan.margin'"),
        (
            lambda plan: zs.plots.locus(
                replace(plan.problem, machine=replace(plan.problem.machine, support=None)),
                plan.trajectory,
            ),
            "support polygon",
        ),
    ],
)
def test_bad_arguments_are_refused_in_a_sentence(
    plans: dict[str, zs.Plan], call: Any, words: str
) -> None:
    with pytest.raises(zs.ZmpSqpError, match=words):
        call(plans["paper_1"])


def test_without_matplotlib_the_message_says_what_to_install() -> None:
    code = (
        "import sys; sys.modules['matplotlib'] = None\n"
        "import zmp_sqp as zs\n"
        "try:\n    zs.plots.tradeoff([{'plan.margin': 0, 'success': True, 'duration': 1,"
        " 'lower_bound': 1}])\n"
        "except zs.MissingExtra as missing:\n    print(missing)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == (
        "figures need matplotlib: `pip install zmp-sqp[plots]`, or `pip install matplotlib`"
    )

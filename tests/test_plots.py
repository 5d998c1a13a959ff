"""Figures: drawn without a display, for any machine, in the root frame and the paper's colours."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from zmp_sqp.mechanics import SupportPolygon, zmp
from zmp_sqp.paper.figures import FIGURES, draw_figures
from zmp_sqp.paper.runs import Motions
from zmp_sqp.planning import Plan, Trajectory, phase_plane, plan
from zmp_sqp.planning.closed_forms.base_motion import asymmetric_profile
from zmp_sqp.plots import locus, profiles, save
from zmp_sqp.plots.canvas import PLANNER_COLOURS, sample_times
from zmp_sqp.plots.loci import loci_figure
from zmp_sqp.scenario import load_scenario

pytest.importorskip("matplotlib")

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def planned() -> Plan:
    return plan(load_scenario("paper_1").problem)


@pytest.fixture(scope="module")
def baseline(planned: Plan) -> Trajectory:
    return phase_plane(planned.problem.machine, planned.problem.start, planned.problem.goal)


def curves(monkeypatch: pytest.MonkeyPatch) -> list:
    """The figures that are saved from now on, as matplotlib objects."""
    from matplotlib.figure import Figure

    saved: list = []
    monkeypatch.setattr(Figure, "savefig", lambda self, path, **_: saved.append(self))
    return saved


def test_figures_are_small_png_files(planned: Plan, baseline: Trajectory, tmp_path: Path) -> None:
    save(locus(planned, beside={"phase plane": baseline}), tmp_path / "zmp.png")
    save(profiles(planned), str(tmp_path / "joints.png"))
    for name in ("zmp.png", "joints.png"):
        content = (tmp_path / name).read_bytes()
        assert content.startswith(PNG)
        assert 10_000 < len(content) < 120_000


def test_the_ending_of_the_path_chooses_the_format(planned: Plan, tmp_path: Path) -> None:
    save(profiles(planned), tmp_path / "joints.svg")
    assert b"<svg" in (tmp_path / "joints.svg").read_bytes()


def test_the_locus_is_drawn_in_the_root_frame_of_messages_and_in_the_papers_colours(
    planned: Plan, baseline: Trajectory
) -> None:
    [axes] = locus(planned, beside={"phase plane": baseline}).axes
    lines = {line.get_label(): line for line in axes.get_lines()}
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x forward [m]", "y left [m]")
    polygon = lines["support polygon"].get_xydata()
    # 5 m long, 3.23 m wide
    np.testing.assert_allclose(np.abs(polygon), np.tile([2.5, 1.615], (5, 1)))
    blind, ours = (
        lines[f"ZMP locus: {name}"].get_xydata() for name in ("phase plane", "full model")
    )
    assert np.nanmax(blind[:, 1]) > 1.615 + 0.3  # leaves to the left, where the ground leans
    assert np.nanmax(ours[:, 1]) < 1.615 + 1e-3
    for path in (blind, ours):
        assert path[0, 0] > 0.5 > -0.5 > path[-2, 0]  # from ahead of the machine to behind it
    problem, times = planned.problem, sample_times(baseline)[0]
    q, v, a = baseline(times)
    np.testing.assert_allclose(
        blind[: len(times)], zmp(problem.machine, q, v, a, problem.ground), rtol=0.0, atol=1e-9
    )
    assert lines["ZMP locus: phase plane"].get_color() == PLANNER_COLOURS["phase plane"]
    assert axes.get_aspect() == 1.0


@pytest.mark.parametrize("margin", [0.0, 0.1, 0.5])
def test_the_margin_that_was_asked_for_is_drawn(
    planned: Plan, baseline: Trajectory, margin: float
) -> None:
    [axes] = locus(replace(planned.problem, margin=margin), baseline).axes
    lines = {line.get_label(): line for line in axes.get_lines()}
    asked = [line for label, line in lines.items() if label.startswith("margin asked for")]
    assert len(asked) == (margin > 0.0)
    for line in asked:
        np.testing.assert_allclose(
            np.abs(line.get_xydata()), np.tile([2.5 - margin, 1.615 - margin], (5, 1))
        )


def test_every_joint_has_a_name_and_its_limits_are_dashed(planned: Plan) -> None:
    acceleration, rate, angle = profiles(planned).axes
    for axes in (acceleration, rate, angle):
        assert [line.get_label() for line in axes.get_lines()[:5]] == list(
            planned.trajectory.joint_names
        )
    dashed = {
        round(line.get_ydata()[0], 6) for line in rate.get_lines() if line.get_linestyle() == "--"
    }
    assert dashed == {round(-np.pi / 4, 6), round(np.pi / 4, 6)}


def test_samples_stay_on_their_side_of_a_jump(planned: Plan) -> None:
    trajectory = planned.trajectory
    pieces = sample_times(trajectory)
    assert len(pieces) == len(trajectory.times) - 1
    for k, times in enumerate(pieces):
        assert times[0] == trajectory.times[k]
        assert trajectory.times[k] < times[-1] < trajectory.times[k + 1]
        _, _, a = trajectory(times)
        since = (times - trajectory.times[k])[:, None]
        own = trajectory.accelerations[k] + since * trajectory.jerks[k]
        np.testing.assert_allclose(a, own, rtol=0.0, atol=1e-12)


def test_other_planners_get_colours_of_their_own_and_any_polygon_is_drawn(
    planned: Plan, baseline: Trajectory, tmp_path: Path
) -> None:
    hexagon = [[np.cos(t), np.sin(t)] for t in np.arange(6) * np.pi / 3]
    machine = planned.problem.machine.with_support(SupportPolygon(4.0 * np.array(hexagon)))
    problem = replace(planned.problem, machine=machine)
    save(locus(problem, planned.trajectory, beside={"yours": baseline}), tmp_path / "zmp.png")
    assert (tmp_path / "zmp.png").read_bytes().startswith(PNG)


def test_no_figure_leaves_a_trace_in_pyplot(planned: Plan, tmp_path: Path) -> None:
    save(profiles(planned), tmp_path / "joints.png")
    assert (
        "matplotlib.pyplot" not in sys.modules or not sys.modules["matplotlib.pyplot"].get_fignums()
    )


def test_matplotlib_and_rich_are_not_imported_before_they_are_needed() -> None:
    loaded = "[m for m in ('matplotlib', 'rich') if m in sys.modules]"
    code = f"import sys, zmp_sqp.cli, zmp_sqp.plots; print({loaded})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_window_fixes_both_axes_as_the_papers_are(planned: Plan, baseline: Trajectory) -> None:
    [axes] = loci_figure(planned.problem, {"phase plane": baseline}, window=3.0).axes
    assert (axes.get_xlim(), axes.get_ylim()) == ((-3.0, 3.0), (-3.0, 3.0))


def test_figures_4_to_6_show_every_planner_on_every_joint_with_dashed_limits(
    planned: Plan, baseline: Trajectory, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    saved = curves(monkeypatch)
    arms = {
        "phase plane": baseline,
        "full model": planned.trajectory,
        "simplified": planned.trajectory,
    }
    base = asymmetric_profile(-2.0, forward=2.0, backward=2.0, max_speed=10.0, least_duration=0.0)
    moving = Motions(planned.problem, arms, {"phase plane": base, "simplified": base})
    assert [
        path.name for path in draw_figures(Motions(planned.problem, arms, {}), moving, tmp_path)
    ] == list(FIGURES)
    loci, joints, locus, accelerations = saved
    assert {"$d_u$", "$d_l$"} <= {text.get_text() for text in loci.axes[0].texts}
    for figure in (joints, accelerations):
        assert "constraints" in {text.get_text() for text in figure.legends[0].get_texts()}
    assert len(joints.axes) == 3 * 5
    assert len(accelerations.axes) == 1 + 5
    for axes in joints.axes:
        drawn = {line.get_label(): line.get_color() for line in axes.get_lines()}
        assert {name: drawn[name] for name in arms} == {
            name: PLANNER_COLOURS[name] for name in arms
        }
    for axes in [*joints.axes[::3], *accelerations.axes]:
        dashed = [line.get_ydata()[0] for line in axes.get_lines() if line.get_linestyle() == "--"]
        assert len(dashed) == 2
        assert axes.get_ylim()[0] < min(dashed) < max(dashed) < axes.get_ylim()[1]
    assert locus.axes[0].get_xlim() == (-3.0, 3.0)


def test_a_base_that_drives_is_drawn_with_its_limits_its_path_and_its_footprints() -> None:
    found = plan(load_scenario("retreat").problem)
    motion = found.trajectory.base
    joints, drive, above = profiles(found).subfigs
    assert len(joints.axes) == 3
    way, speed, yaw, yaw_rate = drive.axes
    assert [axes.get_ylabel() for axes in drive.axes] == [
        "distance [m]",
        "speed [m/s]",
        "yaw [rad]",
        "yaw rate [rad/s]",
    ]
    assert -7.0 < way.get_lines()[0].get_ydata()[-1] < -6.0  # a little longer than the chord of 6 m
    assert "limit 10" in {text.get_text() for text in speed.texts}
    assert yaw.get_lines()[0].get_ydata()[-1] == pytest.approx(1.0, abs=1e-6)
    dashed = [line.get_ydata()[0] for line in yaw_rate.get_lines() if line.get_linestyle() == "--"]
    assert dashed == [-0.5, 0.5]
    [axes] = above.axes
    lines = {line.get_label(): line for line in axes.get_lines()}
    np.testing.assert_allclose(
        lines["path"].get_xydata()[[0, -1]], motion.poses[[0, -1], :2], atol=1e-6
    )
    closed = [line.get_xydata() for line in axes.get_lines() if len(line.get_xydata()) == 5]
    assert len(closed) >= 4  # start, goal, and between
    for corners in closed:
        np.testing.assert_allclose(
            np.linalg.norm(np.diff(corners, axis=0), axis=1), [5.0, 3.23] * 2, atol=1e-9
        )
    assert "downhill" in {text.get_text() for text in axes.texts}


def test_a_drive_over_a_map_is_drawn_on_contour_lines_with_their_heights() -> None:
    found = plan(load_scenario("terrain").problem)
    ground = found.problem.ground
    figure = profiles(found)
    figure.canvas.draw()
    [axes] = figure.subfigs[2].axes
    labels = [text.get_text() for text in axes.texts if text.get_text().endswith(" m")]
    assert len(labels) >= 3
    assert "downhill" not in {text.get_text() for text in axes.texts}
    [lines] = [part for part in axes.collections if len(part.get_paths()) > 3]
    for path, level in zip(lines.get_paths(), lines.levels, strict=True):
        for x, y in path.vertices[::50]:
            assert ground.base_pose(np.array([[x, y, 0.0]]))[0][0, 2] == pytest.approx(
                level, abs=5e-3
            )


def test_a_base_without_known_limits_is_drawn_without_them() -> None:
    found = plan(load_scenario("paper_2_joint").problem)
    _, drive, _ = profiles(replace(found.problem, base=None), found.trajectory).subfigs
    assert not [
        line for axes in drive.axes for line in axes.get_lines() if line.get_linestyle() == "--"
    ]

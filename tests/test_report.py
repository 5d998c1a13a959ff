"""The report of a plan: what is recorded is what the plan does, and the page has no links."""

import json
import shutil
import subprocess
import xml.etree.ElementTree as ET
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import zmp_sqp as zs
import zmp_sqp.cli as cli
from zmp_sqp.report import make_page, make_record
from zmp_sqp.report.blind_drive import blind_drive
from zmp_sqp.report.parts import machine_parts
from zmp_sqp.report.surface import coarsened
from zmp_sqp.scenario import load_scenario

ASSETS = Path(zs.__file__).parent / "report" / "assets"
BLOCKED = """\
hold = {boom = -0.5236, stick = -2.0944, tilt = 0.5236, head = -1.5708}
"""


def result_of(folder: Path, scenario: str, *options: str) -> dict:
    """Content of the plan.json that `zmp-sqp plan` writes."""
    arguments = ["plan", scenario, "--out", str(folder), "--no-figures", "--no-diagnosis", *options]
    assert cli.main(arguments) in (0, 1)
    return json.loads((folder / "plan.json").read_text())


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> dict:
    return result_of(tmp_path_factory.mktemp("plan"), "paper_1", "--margin", "0.1")


@pytest.fixture(scope="module")
def blocked(tmp_path_factory: pytest.TempPathFactory) -> dict:
    """Plan of a slew that tips the machine over however slow it is."""
    folder = tmp_path_factory.mktemp("blocked")
    text = load_scenario("paper_1").path.read_text(encoding="utf-8")
    text = text.replace("point_masses = true", BLOCKED + "point_masses = true", 1)
    text = text.replace("start_deg = [0.0, -30.0, -120.0, 30.0, -90.0]", "start_deg = [0.0]")
    text = text.replace("goal_deg = [180.0, -30.0, -120.0, 30.0, -90.0]", "goal_deg = [180.0]")
    (folder / "blocked.toml").write_text(text.replace("mass = 4000.0", "mass = 6000.0"))
    return result_of(folder, str(folder / "blocked.toml"))


class Elements(HTMLParser):
    """Elements of a page with their attributes, and texts by element."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict]] = []
        self.open: list[str] = []
        self.texts: dict[str, list[str]] = {}
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))
        self.open.append(tag)

    def handle_endtag(self, tag):
        while self.open and self.open.pop() != tag:
            pass

    def handle_data(self, data):
        self.texts.setdefault(self.open[-1] if self.open else "", []).append(data)


def read_motion(result: dict, tmp_path: Path) -> zs.Trajectory:
    (tmp_path / "motion.json").write_text(json.dumps(result["trajectory"]))
    machine = load_scenario("paper_1").problem.machine
    return zs.Trajectory.from_json(tmp_path / "motion.json", machine)


def test_the_recorded_zmp_is_that_of_the_motion(planned: dict, tmp_path: Path) -> None:
    problem = load_scenario("paper_1").problem
    motion, shown = read_motion(planned, tmp_path), planned["record"]["plan"]
    times = np.array(shown["times"])
    inside = np.flatnonzero((np.diff(times, prepend=-1.0) > 1e-6) & (times < times[-1]))
    expected = zs.trajectory_zmp(problem.machine, motion, times[inside], problem.ground)
    recorded = np.array(shown["zmp"])[inside]
    assert len(inside) > 200
    # a time that is rounded to 1e-9 s may lie before a node, where accelerations jump
    off = np.abs(recorded - expected).max(axis=1)
    assert np.quantile(off, 0.8) < 1e-5
    assert shown["duration"] == pytest.approx(planned["duration"], abs=1e-12)


def test_recorded_margins_are_not_below_what_is_guaranteed(planned: dict) -> None:
    least = min(planned["record"]["plan"]["margin"])
    assert planned["margin"] - 1e-6 <= least < planned["margin"] + 1e-3
    assert min(planned["record"]["blind"]["margin"]) == pytest.approx(-0.804, abs=2e-3)


def test_margins_are_those_of_the_worst_payload_and_slope() -> None:
    scenario = load_scenario("paper_1")
    uncertain = replace(scenario.problem, payload_uncertainty=0.1, slope_uncertainty=0.03)
    motion = zs.phase_plane(uncertain.machine, uncertain.start, uncertain.goal)
    found = replace(zs.plan(scenario.problem), problem=uncertain, attempt=motion)
    shown = make_record(scenario, found, None)["record"]["plan"]
    corners = [
        zs.certify(corner.machine, motion, corner.ground).margin
        for corner in uncertain.corners(every=True)
    ]
    assert min(shown["margin"]) == pytest.approx(min(corners), abs=2e-3)
    assert min(corners) < zs.certify(uncertain.machine, motion, uncertain.ground).margin - 0.1


def in_link(link: str, robot: ET.Element, q: dict[str, float]) -> np.ndarray:
    """Placement of a link in the root, (4, 4), from the text of a URDF alone."""
    placed = np.eye(4)
    while (joint := robot.find(f"joint/child[@link='{link}']/..")) is not None:
        origin, axis = joint.find("origin"), joint.find("axis")
        step, turn = np.eye(4), np.eye(4)
        if origin is not None:
            step[:3, 3] = [float(x) for x in origin.get("xyz", "0 0 0").split()]
            rpy = [float(x) for x in origin.get("rpy", "0 0 0").split()]
            step[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()
        if axis is not None and joint.get("type") != "fixed":
            along = np.array([float(x) for x in axis.get("xyz").split()])
            turn[:3, :3] = Rotation.from_rotvec(q[joint.get("name")] * along).as_matrix()
        placed = step @ turn @ placed
        link = joint.find("parent").get("link")
    return placed


def test_bodies_are_where_the_urdf_has_them(planned: dict, tmp_path: Path) -> None:
    """Composed from origins and axes in the URDF, without Pinocchio."""
    machine = load_scenario("paper_1").problem.machine
    motion, record = read_motion(planned, tmp_path), planned["record"]
    robot = ET.parse(Path(zs.__file__).parents[1] / "urdf" / "feller_buncher.urdf").getroot()
    frame = machine.model.frames[machine.model.getFrameId("head", pin.FrameType.BODY)]
    bodies = record["plan"]["bodies"][str(frame.parentJoint)]
    for k in (0, 100, 250):
        q = dict(zip(machine.joint_names, motion(record["plan"]["times"][k])[0], strict=True))
        shown = pin.XYZQUATToSE3(np.array(bodies[k])) * frame.placement
        np.testing.assert_allclose(shown.homogeneous, in_link("head", robot, q), atol=1e-4)


def test_the_ground_leans_as_gravity_does(planned: dict) -> None:
    turn = pin.Quaternion(np.array(planned["record"]["ground"]["rotation"])).matrix()
    down = turn @ zs.Slope(roll=np.radians(-20.0)).gravity()
    np.testing.assert_allclose(down, [0.0, 0.0, -9.81], atol=0.01)
    assert (turn @ [0.0, 1.0, 0.0])[2] == pytest.approx(-np.sin(np.radians(20.0)), abs=1e-5)


def test_the_stability_blind_motion_falls_over_to_the_left(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    page = tmp_path / "report.html"
    result = result_of(tmp_path, "paper_1", "--html", str(page))
    fall = result["record"]["blind"]["fall"]
    poses = [pin.XYZQUATToSE3(np.array(pose)) for pose in fall["root"]]
    up = np.array([(poses[0].inverse() * pose).rotation[:, 2] for pose in poses])
    assert fall["over"]
    assert 1.0 < fall["times"][np.flatnonzero(up[:, 2] < np.cos(0.01))[0]] < 2.0  # [s]
    assert up[-1, 1] == pytest.approx(np.sin(np.pi / 4), abs=0.02)  # leans by 45 degrees
    assert "fall" in page.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("opinion", "words"),
    [
        (None, ""),
        ({"confirmed": True, "guarantees": []}, "ball arithmetic confirms every guarantee"),
        (
            {"confirmed": False, "guarantees": [{"name": "tip_over", "verdict": "refuted"}]},
            "does not confirm: tip_over (refuted)",
        ),
    ],
)
def test_a_second_opinion_is_in_the_verdict(
    planned: dict, opinion: dict | None, words: str
) -> None:
    page = make_page([planned | {"rigorous": opinion}])
    assert words in page
    assert ("second opinion" in page.replace("scenario", "").lower()) == bool(opinion)


def test_charts_hold_the_limits_of_every_joint(planned: dict) -> None:
    machine = load_scenario("paper_1").problem.machine
    charts = {
        (chart["group"], chart["title"]): chart for chart in planned["record"]["plan"]["charts"]
    }
    assert set(charts) == {("constraint", "tip_over"), ("constraint", "contact")} | {
        (group, name)
        for group in ("position", "rate", "acceleration")
        for name in machine.joint_names
    }
    for i, name in enumerate(machine.joint_names):
        rate = charts["rate", name]
        assert rate["upper"] == machine.limits.velocity[i] == -rate["lower"]
        peak = planned["joints"][name]["peak_rate"]
        assert max(map(abs, rate["values"])) == pytest.approx(peak, abs=2e-3)


def test_a_drive_over_terrain_is_recorded(tmp_path: Path) -> None:
    record = result_of(tmp_path, "terrain")["record"]
    scenario = load_scenario("terrain").problem
    goal = scenario.base.goal
    position, turn = scenario.ground.base_pose(np.array([goal]))
    end = pin.XYZQUATToSE3(np.array(record["plan"]["root"][-1]))
    height = scenario.machine.support.height
    np.testing.assert_allclose(end.translation + height * turn[0, :, 2], position[0], atol=5e-5)
    np.testing.assert_allclose(end.rotation, turn[0], atol=5e-5)
    assert np.shape(record["ground"]["heights"])[0] > 5
    assert ("rate", "base speed") in {
        (chart["group"], chart["title"]) for chart in record["plan"]["charts"]
    }
    blind = record["blind"]
    assert len(blind["root"]) == len(blind["times"]) > 100
    assert min(margin for margin in blind["margin"] if margin is not None) < -0.5
    assert blind["fall"] is None  # replays are of machines that stand


@pytest.mark.parametrize("name", ["retreat", "terrain"])
def test_the_stability_blind_drive_is_as_fast_and_tips_the_machine_over(name: str) -> None:
    problem = load_scenario(name).problem
    blind = blind_drive(problem)
    assert blind is not None
    found = zs.plan(problem)
    assert blind.duration <= found.duration * (1.0 + 1e-6)
    assert blind.duration >= found.lower_bound
    certificate = zs.certify(problem.machine, blind, problem.ground, base=problem.base)
    assert certificate.margin < -0.5
    peaks = {one.name: one for one in certificate.guarantees}
    assert peaks["joint_limits"].kept
    np.testing.assert_allclose(blind.base.poses[0], problem.base.start, atol=1e-9)
    off = np.abs(blind.base.poses[-1] - problem.base.goal)
    assert off.max() < (1e-5 if name == "retreat" else 0.3)  # over hills the way is longer


def test_a_room_has_the_unit_of_its_row(tmp_path: Path) -> None:
    """The forwarder's joints turn and slide: torques and forces are limited by one constraint."""
    record = result_of(tmp_path, "forwarder_downhill")["record"]
    chart = next(c for c in record["plan"]["charts"] if c["title"] == "torque_limits")
    units = dict(zip(chart["rows"], chart["units"], strict=True))
    assert set(units.values()) == {"N m", "N"}
    assert units["slew torque"] == "N m"
    assert min(chart["values"]) >= 0.0


def cube_stl() -> bytes:
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype="<f4")
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [(a, b, c) for a, b, c, _ in quads] + [(a, c, d) for a, _, c, d in quads]
    body = b"".join(
        np.zeros(3, "<f4").tobytes() + corners[list(face)].tobytes() + b"\0\0" for face in faces
    )
    return bytes(80) + np.uint32(len(faces)).tobytes() + body


def volume(points: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = points[faces].transpose(1, 0, 2)
    return abs(float(np.einsum("ij,ij->", a, np.cross(b, c)))) / 6.0


def test_meshes_are_drawn_with_their_triangles(tmp_path: Path) -> None:
    (tmp_path / "cube.stl").write_bytes(cube_stl())
    shape = '<mesh filename="cube.stl" scale="0.5 1 2"/>'
    text = (Path(zs.__file__).parents[1] / "urdf" / "slider.urdf").read_text()
    first = text.index("<visual>")
    name = text[:first].rpartition('<link name="')[2].partition('"')[0]
    visual = f'<visual><origin xyz="0 0 3"/><geometry>{shape}</geometry></visual>'
    (tmp_path / "with_mesh.urdf").write_text(text[:first] + visual + text[first:])
    limits = {"acceleration": 1.0, "velocity": 1.0}
    machine = zs.load_machine(tmp_path / "with_mesh.urdf", limits=limits)
    parts = machine_parts(machine, tmp_path / "with_mesh.urdf")
    (mesh,) = [part for part in parts if part["kind"] == "mesh"]
    points = np.array(mesh["vertices"]).reshape(-1, 3)
    assert volume(points, np.array(mesh["faces"]).reshape(-1, 3)) == pytest.approx(1.0)
    frame = machine.model.frames[machine.model.getFrameId(name, pin.FrameType.BODY)]
    assert mesh["pose"][2] == pytest.approx(frame.placement.translation[2] + 3.0, abs=1e-5)
    (tmp_path / "cube.stl").unlink()
    kinds = [part["kind"] for part in machine_parts(machine, tmp_path / "with_mesh.urdf")]
    assert "mesh" not in kinds
    assert len(kinds) == len(parts) - 1  # everything else is still drawn


def test_a_machine_without_shapes_is_drawn_as_bars() -> None:
    machine = zs.load_machine("feller_buncher")
    kinds = {part["kind"] for part in machine_parts(machine, None)}
    assert "capsule" in kinds


@pytest.mark.parametrize("most", [20000, 2000, 200])
def test_a_coarser_surface_keeps_its_volume(most: int) -> None:
    around, along = np.meshgrid(np.linspace(0, 2 * np.pi, 121), np.linspace(0, np.pi, 61))
    sphere = np.stack(
        [np.sin(along) * np.cos(around), np.sin(along) * np.sin(around), np.cos(along)], axis=-1
    )
    number = np.arange(sphere[..., 0].size).reshape(sphere.shape[:2])
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    points, left = coarsened(sphere.reshape(-1, 3), faces, most)
    assert 50 < len(left) <= most
    assert volume(points, left) == pytest.approx(
        4.0 / 3.0 * np.pi, rel={20000: 0.01, 2000: 0.03, 200: 0.2}[most]
    )


def test_the_page_has_the_data_and_no_links(planned: dict) -> None:
    page = make_page([planned])
    elements = Elements(page)
    for tag, attributes in elements.found:
        assert not {"src", "href", "srcset", "action", "data"} & set(attributes), tag
        assert tag not in ("link", "base", "iframe", "img", "object")
    (style,) = elements.texts["style"]
    assert "url(" not in style
    assert "@import" not in style
    (policy,) = [
        attributes["content"] for tag, attributes in elements.found if "http-equiv" in attributes
    ]
    assert "default-src 'none'" in policy  # the browser loads nothing
    (data,) = [text for text in elements.texts["script"] if text.startswith("[{")]
    assert json.loads(data) == [planned]
    assert len(page.encode()) < 5e6


def test_the_verdict_has_the_numbers_of_the_plan(planned: dict) -> None:
    elements = Elements(make_page([planned]))
    values = [float(a["value"]) for tag, a in elements.found if tag == "data"]
    tip_over = next(g for g in planned["guarantees"] if g["name"] == "tip_over")
    assert values == [
        planned["duration"],
        planned["lower_bound"],
        planned["margin"],
        tip_over["time"],
    ]
    words = " ".join(elements.texts["data"])
    assert f"{planned['duration']:.4f} s" in words
    assert "Safe, proven for all times." in elements.texts["strong"]


def test_a_plan_without_a_motion_shows_what_violates_least(blocked: dict) -> None:
    assert not blocked["success"]
    assert min(blocked["record"]["plan"]["margin"]) < -0.1
    page = make_page([blocked])
    elements = Elements(page)
    assert "No safe motion." in elements.texts["strong"]
    assert "Safe" not in " ".join(elements.texts["strong"])
    assert 'class="broken"' in page
    assert "violates its constraints least" in page


def test_text_of_a_scenario_cannot_leave_its_place(planned: dict) -> None:
    attack = '</script><script>alert(1)</script><!-- data --><img src="x">'
    evil = planned | {"title": attack, "scenario_text": attack, "message": attack}
    elements = Elements(make_page([evil, evil]))
    assert "img" not in {tag for tag, _ in elements.found}
    (data,) = [text for text in elements.texts["script"] if text.startswith("[{")]
    assert json.loads(data) == [evil, evil]


def test_two_plans_stand_side_by_side(planned: dict, blocked: dict, tmp_path: Path) -> None:
    names = []
    for name, result in (("one", planned), ("two", blocked)):
        (tmp_path / f"{name}.json").write_text(json.dumps(result))
        names.append(str(tmp_path / f"{name}.json"))
    target = tmp_path / "folder" / "both.html"
    assert cli.main(["report", *names, "--html", str(target)]) == 0
    found = Elements(target.read_text(encoding="utf-8")).found
    assert [a["data-plan"] for _, a in found if "data-plan" in a] == ["0", "1"]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("{", "not a JSON file"),
        ("[]", "not a plan.json"),
        ('{"points": []}', "not a plan.json"),
        ('{"scenario": "paper_1", "success": true}', "earlier version, it lacks record"),
        ('{"scenario": 1, "success": true}', "not a plan.json"),
        ("[" * 100_000, "not a JSON file"),
    ],
)
def test_files_that_are_no_plan_are_refused_in_a_sentence(
    content: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "plan.json").write_text(content)
    target = tmp_path / "report.html"
    assert cli.main(["report", str(tmp_path / "plan.json"), "--html", str(target)]) == 2
    assert words in capsys.readouterr().err
    assert not target.exists()


def test_damaged_plans_are_refused_in_a_sentence(
    planned: dict, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every entry of a plan is replaced by something else in turn."""
    target = tmp_path / "report.html"
    for key in planned:
        for wrong in (17, "x", [1], {"a": 1}, None):
            (tmp_path / "plan.json").write_text(json.dumps(planned | {key: wrong}))
            code = cli.main(["report", str(tmp_path / "plan.json"), "--html", str(target)])
            said = capsys.readouterr().err
            assert code in (0, 2), (key, wrong)
            assert (code == 2) == bool(said), (key, wrong, said)


def test_functions_of_time_agree_with_numpy() -> None:
    """`locate` and `valueAt` are linear interpolation, continuous from the right at jumps."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("no node to run the page's functions")
    rng = np.random.default_rng(3)
    times = np.sort(rng.uniform(0.0, 5.0, 40))
    times[0], times[20] = 0.0, times[19]
    values = rng.normal(size=40)
    asked = np.concatenate([rng.uniform(-1.0, 6.0, 200), times])
    script = (
        f"const f = require({json.dumps(str(ASSETS / 'time.js'))});"
        f"const t = {times.tolist()}, v = {values.tolist()};"
        f"console.log(JSON.stringify({asked.tolist()}.map((x) => f.valueAt(v, f.locate(t, x)))))"
    )
    run = subprocess.run([node, "-e", script], capture_output=True, text=True, timeout=60)
    assert run.returncode == 0, run.stderr
    nudged = times.copy()
    nudged[19] -= 1e-12  # the later one of two samples counts at a jump
    expected = np.interp(asked, nudged, values)
    np.testing.assert_allclose(json.loads(run.stdout), expected, atol=1e-9)

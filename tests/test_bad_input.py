"""Bad input gets one clear sentence that names the offender, and never a plan."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.paper import PAPER_GOAL, PAPER_START, paper_scene
from benchmarks.problems.scene import FOOTPRINT
from tests.problems import slider_time
from zmp_sqp.scenario import load_scenario

MACHINE = zs.load_machine("feller_buncher")
SLOPE = zs.Slope(roll=-0.2)
POSE = np.array(PAPER_START)
RECTANGLE = np.array(FOOTPRINT)


def problem(**changes: Any) -> zs.Problem:
    """A good problem but for what is changed."""
    return zs.Problem(
        **({"machine": MACHINE, "start": POSE, "goal": PAPER_GOAL, "ground": SLOPE} | changes)
    )


def with_entry(index: int, value: float) -> np.ndarray:
    pose = POSE.copy()
    pose[index] = value
    return pose


def refuses(
    error: type[Exception], message: str, call: Callable[..., Any], *given: Any, **named: Any
) -> str:
    """The complaint, which is one line."""
    with pytest.raises(error, match=message) as caught:
        call(*given, **named)
    text = str(caught.value)
    assert text
    assert "\n" not in text
    return text


def test_the_good_problem_is_good() -> None:
    assert problem().intervals == 50


def test_every_error_is_the_librarys_own() -> None:
    for error in (
        zs.ContactLost,
        zs.MachineError,
        zs.NotSolved,
        zs.ProblemError,
        zs.ScenarioError,
        zs.TrajectoryError,
    ):
        assert issubclass(error, zs.ZmpSqpError)


# --- NaN, infinity, shapes, types ---------------------------------------------------------------


def label(value: Any) -> str:
    """Name of a case without addresses, which differ between workers."""
    return re.sub(r" at 0x[0-9a-f]+", "", str(value))[:60]


STATES = ("start", "goal", "start_velocity", "goal_velocity")


@pytest.mark.parametrize("name", STATES)
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_states_that_are_not_finite(name: str, value: float) -> None:
    text = refuses(zs.ProblemError, name.replace("_", "."), problem, **{name: with_entry(2, value)})
    assert "finite" in text
    assert str(value) in text
    assert "2" in text or "stick" in text


@pytest.mark.parametrize("name", STATES)
@pytest.mark.parametrize(
    "value",
    [
        np.zeros(4),
        np.zeros(6),
        np.zeros((5, 1)),
        np.zeros((1, 5)),
        np.zeros((0,)),
        0.0,
        [],
        [[0.0] * 5],
        "pose",
        b"pose",
        ["a", "b", "c", "d", "e"],
        [None] * 5,
        {"slew": 0.0},
        object(),
        [1.0 + 2.0j] * 5,
        [[1.0], 2.0],
        np.array([object()] * 5),
        (x for x in range(5)),
        set(range(5)),
        np.zeros(5, dtype="datetime64[s]"),
        np.ma.masked_all(5),
        range(10**6),
    ],
    ids=lambda value: type(value).__name__,  # addresses would differ between workers
)
def test_states_of_the_wrong_shape_or_type(name: str, value: Any) -> None:
    refuses(zs.ProblemError, name.replace("_", "."), problem, **{name: value})


@pytest.mark.parametrize("name", ["start", "goal"])
def test_states_that_are_missing(name: str) -> None:
    refuses(zs.ProblemError, name, problem, **{name: None})


@pytest.mark.parametrize(
    "angle",
    [np.nan, np.inf, "steep", None, [0.1], 1j, 2.0, -np.pi / 2, 1e308, True, np.array([0.1])],
)
@pytest.mark.parametrize("name", ["roll", "pitch"])
def test_slopes(name: str, angle: Any) -> None:
    refuses(zs.MachineError, name, zs.Slope, **{name: angle})


@pytest.mark.parametrize("ground", [None, 0.1, "slope", (0.1, 0.2), zs.Slope, object()])
def test_grounds(ground: Any) -> None:
    refuses(zs.ProblemError, "ground", problem, ground=ground)


@pytest.mark.parametrize("gravity", [[0.0, 0.0, -9.81], np.zeros(2), None, np.full(3, np.nan)])
def test_gravity_of_grounds(gravity: Any) -> None:
    class Own:
        def gravity(self, yaw: float = 0.0) -> Any:
            return gravity

    refuses(zs.ProblemError, "gravity", problem, ground=Own())
    refuses(zs.MachineError, "gravity", zs.zmp, MACHINE, POSE, POSE, POSE, Own())


def test_grounds_that_fail_or_need_a_heading() -> None:
    class NeedsYaw:
        def gravity(self, yaw: float) -> np.ndarray:
            return np.array([0.0, 0.0, -9.81])

    class Odd(zs.Slope):
        def gravity(self, yaw: float = 0.0) -> np.ndarray:
            return np.zeros(5)

    refuses(zs.ProblemError, r"define it as gravity\(self, yaw=0.0\)", problem, ground=NeedsYaw())
    refuses(zs.ProblemError, "gravity", problem, ground=Odd())


def test_constraints_of_certificates() -> None:
    motion = zs.phase_plane(MACHINE, POSE, PAPER_GOAL)
    for given in (5, [5], [zs.TorqueLimits, 5]):
        refuses(
            zs.ProblemError, "constraints", zs.certify, MACHINE, motion, SLOPE, constraints=given
        )


@pytest.mark.parametrize("machine", [None, "feller_buncher", 3, zs.Machine, object()])
def test_machines(machine: Any) -> None:
    refuses(zs.ProblemError, "machine", problem, machine=machine)
    refuses(zs.ZmpSqpError, "machine", zs.phase_plane, machine, POSE, PAPER_GOAL)
    refuses(zs.MachineError, "machine", zs.zmp, machine, POSE, POSE, POSE, SLOPE)


@pytest.mark.parametrize(
    "margin", [np.nan, np.inf, -0.1, "wide", None, [0.1], 1.615, 2.0, 1e308, 1j, True]
)
def test_margins(margin: Any) -> None:
    refuses(zs.ProblemError, "margin", problem, margin=margin)


@pytest.mark.parametrize(
    "intervals", [1, 0, -1, 50.0, 2.5, np.nan, "50", None, True, [50], 1j, 10**9, 10**400]
)
def test_intervals(intervals: Any) -> None:
    """Fewer than two, no whole number, or so many that no computer could hold them."""
    refuses(zs.ProblemError, "intervals", problem, intervals=intervals)


@pytest.mark.parametrize("model", ["Full", "", None, 3, "lumped", ["full"], True])
def test_models(model: Any) -> None:
    refuses(zs.ProblemError, "model", problem, model=model)


# --- names --------------------------------------------------------------------------------------


@pytest.mark.parametrize("key", ["velocity", "acceleration"])
def test_unknown_joint_names(key: str) -> None:
    text = refuses(zs.MachineError, "'bucket'", MACHINE.with_limits, **{key: {"bucket": 1.0}})
    for joint in MACHINE.joint_names:
        assert joint in text
    refuses(
        zs.MachineError,
        "'bucket'",
        zs.load_machine,
        "feller_buncher",
        limits={key: {"bucket": 1.0}},
    )


def test_unknown_frame_names() -> None:
    payload = zs.Payload(mass=100.0, com=(0.0, 0.0, 1.0), frame="grapple")
    text = refuses(zs.MachineError, "'grapple'", MACHINE.with_payload, payload)
    assert "head" in text


def test_unknown_contact_links() -> None:
    text = refuses(
        zs.MachineError, "'left_foot'", zs.load_machine, "feller_buncher", support=("left_foot",)
    )
    assert "left_track" in text


def test_unknown_limits() -> None:
    text = refuses(
        zs.MachineError, "'jerk'", zs.load_machine, "feller_buncher", limits={"jerk": 1.0}
    )
    assert "acceleration" in text


def test_unknown_machines() -> None:
    text = refuses(zs.MachineError, "'feler_buncher'", zs.load_machine, "feler_buncher")
    assert "slewing_crane" in text


def test_unknown_qp_solvers() -> None:
    for name in ("osqp", "", "qpsolvers:", "qpsolvers:nothing", "ProxQP", None, 3, ["proxqp"]):
        refuses(zs.ProblemError, "solver", zs.plan, problem(), qp_solver=name)


# --- limits -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["start", "goal"])
@pytest.mark.parametrize(
    ("joint", "value"),
    [("slew", 6.5), ("boom", 0.7), ("stick", 0.0), ("tilt", -1.7), ("head", 1e308)],
)
def test_poses_outside_the_joint_limits(name: str, joint: str, value: float) -> None:
    i = MACHINE.joint_names.index(joint)
    text = refuses(
        zs.ProblemError, f"{name} of joint '{joint}'", problem, **{name: with_entry(i, value)}
    )
    assert f"{value:.6g}" in text
    assert f"{MACHINE.limits.position_lower[i]:.6g}" in text
    assert f"{MACHINE.limits.position_upper[i]:.6g}" in text
    poses = (with_entry(i, value), POSE)
    refuses(
        zs.ProblemError,
        f"'{joint}'",
        zs.phase_plane,
        MACHINE,
        *(poses if name == "start" else poses[::-1]),
    )


def test_numbers_that_a_message_compares_look_different() -> None:
    upper = float(MACHINE.limits.position_upper[1])  # 0.6 rad
    text = refuses(zs.ProblemError, "boom", problem, goal=with_entry(1, upper + 1e-8))
    assert "is 0.60000001, outside its limits [-1.4, 0.6] rad" in text
    text = refuses(zs.ProblemError, "slope_uncertainty", problem, slope_uncertainty=0.5 + 1e-9)
    assert "[0, 0.5] rad, not 0.500000001 rad" in text


@pytest.mark.parametrize("name", ["start_velocity", "goal_velocity"])
@pytest.mark.parametrize("value", [0.8, -0.8, 1e308])
def test_rates_outside_the_velocity_limits(name: str, value: float) -> None:
    rates = np.array([0.0, 0.0, 0.0, value, 0.0])
    text = refuses(
        zs.ProblemError, f"{name.split('_')[0]} velocity of joint 'tilt'", problem, **{name: rates}
    )
    assert f"{value:.6g}" in text
    assert "0.785398" in text


def test_rates_that_leave_no_room_to_stop() -> None:
    upper = MACHINE.limits.position_upper[1]
    text = refuses(
        zs.ProblemError,
        "'boom'",
        problem,
        start=with_entry(1, upper - 0.01),
        start_velocity=[0.0, 0.7, 0.0, 0.0, 0.0],
        ground=zs.Slope(),
    )
    assert "needed" in text
    assert "0.6" in text


@pytest.mark.parametrize(
    "limits",
    [
        {"position_lower": {"boom": 0.7}},
        {"position_upper": {"boom": -1.5}},
        {"velocity": {"boom": 0.0}},
        {"velocity": {"boom": -1.0}},
        {"acceleration": {"boom": np.inf}},
        {"acceleration": {"boom": np.nan}},
        {"velocity": {"boom": "fast"}},
        {"velocity": {"boom": None}},
        {"velocity": {"boom": True}},
        {"acceleration": {"boom": [1.0]}},
        {"velocity": {"boom": 1j}},
        {"acceleration": {"boom": 0}},
    ],
    ids=label,
)
def test_contradictory_or_impossible_limits(limits: Any) -> None:
    refuses(zs.MachineError, "'boom'", zs.load_machine, "feller_buncher", limits=limits)


@pytest.mark.parametrize(
    "limits",
    [
        {"velocity": [1.0, 1.0]},
        {"velocity": np.ones((5, 1))},
        {"velocity": "fast"},
        {"velocity": -1.0},
        {"acceleration": np.nan},
        {"velocity": []},
        {"velocity": None},
        {"acceleration": True},
        {"velocity": {3: 1.0}},
        {"velocity": {None: 1.0}},
        {3: 1.0},
        {None: None},
        3,
        [("velocity", 1.0)],
        b"x.yaml",
        "nothing.yaml",
        object(),
    ],
    ids=label,
)
def test_limits_of_the_wrong_shape_or_type(limits: Any) -> None:
    refuses(zs.MachineError, "limit", zs.load_machine, "feller_buncher", limits=limits)


def test_limits_that_are_missing_are_named_when_a_problem_is_posed(tmp_path: Path) -> None:
    source = (Path(__file__).resolve().parents[1] / "urdf" / "feller_buncher.urdf").read_text()
    (tmp_path / "machine.urdf").write_text(source)  # without its joint_limits.yaml
    machine = zs.load_machine(
        tmp_path / "machine.urdf", limits={"acceleration": {"slew": 1.0, "boom": 1.0}}
    )
    text = refuses(zs.ProblemError, "acceleration", problem, machine=machine)
    for joint in ("stick", "tilt", "head"):
        assert f"'{joint}'" in text
    assert "'slew'" not in text
    refuses(zs.ProblemError, "'stick'", zs.phase_plane, machine, POSE, PAPER_GOAL)


# --- tipping over at rest -----------------------------------------------------------------------


@pytest.mark.parametrize("name", ["start", "goal"])
def test_poses_that_tip_over_at_rest(name: str) -> None:
    """The paper's own: arm over the left side, roll 20 degrees.

    The ZMP is at 2.056 m, the edge at 1.615 m.
    """
    scene = paper_scene()
    over_left = with_entry(0, np.pi / 2)
    poses = {"start": POSE, "goal": PAPER_GOAL} | {name: over_left}
    text = refuses(zs.ProblemError, f"rest at the {name}", scene.problem, **poses)
    for part in ("2.056", "left edge", "0.441"):
        assert part in text


def test_poses_that_tip_over_with_the_margin_asked_for() -> None:
    scene = paper_scene()
    text = refuses(
        zs.ProblemError, "rest at the start", scene.problem, POSE, PAPER_GOAL, margin=0.9
    )
    assert "left edge" in text
    assert "0.9" in text
    assert "0.071" in text  # 0.786 of 1.615 m, less 0.9 m


def test_a_ground_so_steep_that_it_would_have_to_hold_the_machine() -> None:
    refuses(zs.ProblemError, "rest at the start", problem, ground=zs.Slope(pitch=1.5))


def test_a_margin_that_is_only_missed_is_not_called_tipping_over() -> None:
    """The ZMP is inside the support polygon, but closer to an edge than asked for."""
    scene = paper_scene()
    for margin, fault in ((0.9, "misses the margin of 0.9 m"), (2.0, None)):
        text = refuses(zs.ProblemError, "margin", scene.problem, POSE, PAPER_GOAL, margin=margin)
        if fault is not None:
            assert fault in text
            assert "inside the support polygon, but only 0.829 m from the left edge" in text
        assert "tips over" not in text
    over_left = with_entry(0, np.pi / 2)
    text = refuses(zs.ProblemError, "tips over", scene.problem, POSE, over_left, margin=0.1)
    assert "0.441 m outside the left edge of the support polygon (required margin: 0.1 m)" in text


def test_an_edge_of_a_triangle_has_a_number_and_no_double_name() -> None:
    narrow = MACHINE.with_support(zs.SupportPolygon([(-2.0, -0.2), (2.0, -0.2), (0.0, 0.2)]))
    text = refuses(
        zs.ProblemError,
        "tips over",
        zs.Problem,
        narrow,
        with_entry(0, np.pi / 2),
        PAPER_GOAL,
        zs.Slope(),
    )
    assert re.search(r"outside edge \d of the support polygon", text)


# --- support polygons ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("vertices", "message"),
    [
        (RECTANGLE[::-1], "counter-clockwise"),
        ([(-1, -1), (1, -1), (0, -0.5), (0, 1)], "vertex 2"),  # a dent
        ([(0, 0), (1, 0), (2, 0), (1, 1)], "vertex 1"),  # a corner on a straight line
        ([(0, 0), (1, 0), (1, 0), (0, 1)], "vertex 2"),  # twice the same
        ([(0, 0), (1, 0)], "3 vertices"),
        ([(0, 0), (1, 0), (2, 0)], "vertex"),
        ([(0, 0), (1, 1), (1, 0), (0, 1)], "vertex"),  # crosses itself
        # a star
        (np.array([(np.cos(t), np.sin(t)) for t in 4 * np.pi * np.arange(5) / 5]), "itself"),
        ([], "shape"),
        (np.zeros((4, 3)), "shape"),
        ([(0, 0), (1, np.nan), (0, 1)], "nan"),
        ([(0, 0), (1, np.inf), (0, 1)], "inf"),
        ("square", "numbers"),
        (None, "support vertices"),
        ([(0, 0), (1, 0), None], "support vertices"),
        ([(0, 0), (1, 0), (0, 1j)], "support vertices"),
    ],
    ids=label,
)
def test_support_polygons(vertices: Any, message: str) -> None:
    refuses(zs.MachineError, message, zs.SupportPolygon, vertices)


@pytest.mark.parametrize("height", [np.nan, np.inf, "low", None, [0.0], 1j])
def test_support_heights(height: Any) -> None:
    refuses(zs.MachineError, "height", zs.SupportPolygon, FOOTPRINT, height)


@pytest.mark.parametrize(
    "support", [3, RECTANGLE, ("left_track", 3), (), object(), [None], b"left_track", 1.0]
)
def test_supports(support: Any) -> None:
    refuses(zs.MachineError, "support", zs.load_machine, "feller_buncher", support=support)


def test_a_contact_link_that_moves() -> None:
    refuses(zs.MachineError, "'head'", zs.load_machine, "feller_buncher", support="head")


# --- masses and inertias ------------------------------------------------------------------------


@pytest.mark.parametrize("mass", [0.0, -0.0, -1.0, np.nan, np.inf, "heavy", None, [1.0], 1j, True])
def test_payload_masses(mass: Any) -> None:
    refuses(
        zs.MachineError, "payload mass", zs.Payload, mass=mass, com=(0.0, 0.0, 1.0), frame="head"
    )


@pytest.mark.parametrize(
    ("inertia", "message"),
    [
        (np.diag([1.0, 1.0, -1.0]), "-1"),
        (np.diag([1.0, 1.0, 3.0]), "triangle"),
        ([[1.0, 0.5, 0.0], [0.4, 1.0, 0.0], [0.0, 0.0, 1.0]], "symmetric"),
        (np.ones(3), "shape"),
        (np.full((3, 3), np.nan), "finite"),
        ("round", "payload inertia"),
        (1.0, "payload inertia"),
    ],
    ids=label,
)
def test_payload_inertias(inertia: Any, message: str) -> None:
    text = refuses(
        zs.MachineError,
        message,
        zs.Payload,
        mass=10.0,
        com=(0.0, 0.0, 1.0),
        frame="head",
        inertia=inertia,
    )
    assert "inertia" in text


@pytest.mark.parametrize(
    "com", [np.zeros(2), [np.nan, 0.0, 0.0], "middle", None, 0.0, np.zeros((3, 1))]
)
def test_payload_places(com: Any) -> None:
    refuses(zs.MachineError, "payload com", zs.Payload, mass=10.0, com=com, frame="head")


@pytest.mark.parametrize("frame", [None, 3, ["head"], b"head"])
def test_payload_frames(frame: Any) -> None:
    refuses(zs.MachineError, "payload frame", zs.Payload, mass=10.0, com=np.zeros(3), frame=frame)


@pytest.mark.parametrize("payload", [None, 3, "tree", {"mass": 10.0}])
def test_payloads(payload: Any) -> None:
    refuses(zs.MachineError, "payload", MACHINE.with_payload, payload)


@pytest.mark.parametrize("support", [None, 3, FOOTPRINT, "head"])
def test_supports_in_place(support: Any) -> None:
    refuses(zs.MachineError, "support", MACHINE.with_support, support)


# --- URDFs --------------------------------------------------------------------------------------

INERTIAL = (
    '<inertial><mass value="{mass}"/>'
    '<inertia ixx="{ixx}" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
)
URDF = """<robot name="box">
  <link name="base">{base}<collision><geometry><box size="1 1 0.2"/></geometry></collision></link>
  <joint name="turn" type="{kind}"><parent link="{parent}"/><child link="arm"/><axis
  xyz="{axis}"/>{limit}</joint> <link name="arm">{arm}</link>
</robot>"""
GOOD = {
    "base": INERTIAL.format(mass=100, ixx=1),
    "arm": INERTIAL.format(mass=10, ixx=1),
    "kind": "revolute",
    "parent": "base",
    "axis": "0 0 1",
    "limit": '<limit lower="-1" upper="1" velocity="1" effort="1"/>',
}


def write_urdf(folder: Path, **changes: str) -> Path:
    path = folder / "box.urdf"
    path.write_text(URDF.format(**(GOOD | changes)))
    return path


def test_the_good_urdf_is_good(tmp_path: Path) -> None:
    machine = zs.load_machine(write_urdf(tmp_path), limits={"acceleration": 1.0})
    assert zs.plan(zs.Problem(machine, [0.0], [0.5])).success


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"arm": INERTIAL.format(mass=-5, ixx=1)}, "link 'arm'.*-5"),
        ({"arm": INERTIAL.format(mass="nan", ixx=1)}, "link 'arm'.*nan"),
        ({"arm": INERTIAL.format(mass="heavy", ixx=1)}, "link 'arm'.*heavy"),
        ({"arm": INERTIAL.format(mass=10, ixx="inf")}, "link 'arm'.*inf"),
        ({"kind": "planar"}, "joint 'turn'.*'planar'.*revolute"),
        ({"kind": "floating"}, "joint 'turn'.*'floating'"),
        ({"kind": "spherical"}, "joint 'turn'.*'spherical'"),
        ({"kind": ""}, "joint 'turn'"),
        ({"parent": "nothing"}, "'nothing'"),
        ({"parent": "arm"}, "'arm'|root"),
        ({"axis": "0 0 0"}, "joint 'turn'.*axis"),
        ({"axis": "0 0"}, "joint 'turn'.*3 numbers"),
        ({"limit": '<limit lower="1" upper="-1" velocity="1" effort="1"/>'}, "joint 'turn'.*lower"),
        (
            {"limit": '<limit lower="-1" upper="1" velocity="-1" effort="1"/>'},
            "joint 'turn'.*velocity.*-1",
        ),
        ({"limit": '<limit lower="-1" upper="nan" velocity="1" effort="1"/>'}, "joint 'turn'.*nan"),
        ({"limit": '<mimic joint="turn"/>'}, "joint 'turn'.*mimic"),
    ],
)
def test_urdfs_that_cannot_be_a_machine(
    tmp_path: Path, changes: dict[str, str], message: str
) -> None:
    text = refuses(zs.MachineError, message, zs.load_machine, write_urdf(tmp_path, **changes))
    assert "box.urdf" in text


@pytest.mark.parametrize("ixx", [-1, 5])
def test_inertias_that_no_body_can_have_are_refused_where_asked(tmp_path: Path, ixx: float) -> None:
    path = write_urdf(tmp_path, arm=INERTIAL.format(mass=10, ixx=ixx))
    refuses(zs.MachineError, "box.urdf.*link 'arm'.*moments", zs.load_machine, path, strict=True)


def test_a_machine_without_joints_is_refused_by_the_problem(tmp_path: Path) -> None:
    machine = zs.load_machine(write_urdf(tmp_path, kind="fixed"))
    refuses(zs.ProblemError, "no movable joint", zs.Problem, machine, [], [])


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"   ",
        b"<robot",
        b"<robot name='x'>",
        b"<robot/>",
        b"<robot name='x'></robot>",
        b"hello",
        b"\xff\xfe\x00\x01",
        b"<sdf/>",
        b"\x00" * 100,
        b"<!DOCTYPE a [<!ENTITY b 'c'>]><robot name='x'><link name='a'/></robot>",
        b"<robot name='x' xmlns:xacro='http://wiki.ros.org/xacro'>"
        b"<xacro:include filename='y'/></robot>",
    ],
    ids=lambda content: content[:30].decode(errors="replace"),
)
def test_files_that_are_no_urdf(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "broken.urdf"
    path.write_bytes(content)
    refuses(zs.MachineError, r"broken\.urdf", zs.load_machine, path)


def test_urdfs_that_are_not_there(tmp_path: Path) -> None:
    refuses(zs.MachineError, r"missing\.urdf", zs.load_machine, tmp_path / "missing.urdf")
    refuses(zs.MachineError, "folder", zs.load_machine, tmp_path)


@pytest.mark.parametrize(
    "source", ["", None, 3, b"feller_buncher", ["feller_buncher"], "a\x00b", "x" * 10_000, object()]
)
def test_sources_that_are_no_path(source: Any) -> None:
    refuses(zs.MachineError, "source|path|no machine", zs.load_machine, source)


@pytest.mark.parametrize(
    "content", ["joint_limits: {turn: {has_velocity_limits: true}}", "[1, 2]", "{", "a: b", "\x00"]
)
def test_joint_limits_files(tmp_path: Path, content: str) -> None:
    path = write_urdf(tmp_path)
    (tmp_path / "box.joint_limits.yaml").write_text(content)
    refuses(zs.MachineError, r"box\.joint_limits\.yaml", zs.load_machine, path)


# --- states of the quantities -------------------------------------------------------------------


@pytest.mark.parametrize("call", [zs.zmp, zs.stability_margin])
@pytest.mark.parametrize("which", range(3))
@pytest.mark.parametrize(
    "value",
    [
        None,
        "here",
        np.zeros(4),
        np.zeros((2, 4)),
        np.zeros((2, 2, 5)),
        0.0,
        [],
        [np.nan] * 5,
        [1j] * 5,
        object(),
    ],
    ids=lambda value: type(value).__name__,  # addresses would differ between workers
)
def test_states_of_the_zmp(call: Callable[..., Any], which: int, value: Any) -> None:
    states: list[Any] = [POSE, 0.0 * POSE, 0.0 * POSE]
    states[which] = value
    refuses(zs.MachineError, "^[qva] ", call, MACHINE, *states, SLOPE)


def test_lift_off_is_no_zmp() -> None:
    refuses(
        zs.ContactLost,
        "index 1",
        zs.zmp,
        MACHINE,
        [POSE] * 2,
        np.zeros((2, 5)),
        [0 * POSE, [0, -90, 0, 0, 0]],
        SLOPE,
    )


@pytest.mark.parametrize("huge", [1e100, 1e200, 1e308, -1e308])
def test_numbers_so_large_that_they_overflow_are_no_zmp(huge: float) -> None:
    """Either refused, or finite: never a quiet NaN."""
    for states in itertools.permutations((POSE, 0.0 * POSE, np.full(5, huge))):
        try:
            with np.errstate(all="ignore"):
                found = zs.zmp(MACHINE, *states, SLOPE)
        except zs.ZmpSqpError:
            continue
        assert np.isfinite(found).all()


@pytest.mark.parametrize("other", ["problem", None, 3, zs.Problem, MACHINE])
def test_plans_of_no_problem(other: Any) -> None:
    refuses(zs.ProblemError, "problem", zs.plan, other)


@pytest.mark.parametrize("budget", [0.0, -1.0, np.nan, np.inf, "long", [1.0], 1j, True])
def test_time_budgets(budget: Any) -> None:
    refuses(zs.ProblemError, "time.budget", zs.plan, problem(), time_budget=budget)


@pytest.mark.parametrize("value", [None, "here", np.zeros(4), np.full(5, np.nan), 0.0])
def test_poses_of_the_phase_plane(value: Any) -> None:
    refuses(zs.ProblemError, "start", zs.phase_plane, MACHINE, value, POSE)
    refuses(zs.ProblemError, "goal", zs.phase_plane, MACHINE, POSE, value)


# --- extremes that are no misuse ----------------------------------------------------------------


@pytest.mark.parametrize("value", [-0.0, 0, np.float32(0.0), np.int8(0)])
def test_zeros_of_any_kind_are_zeros(value: Any) -> None:
    assert problem(start_velocity=[value] * 5).start_velocity.tolist() == [0.0] * 5


def test_whole_numbers_are_numbers() -> None:
    machine = zs.load_machine("slider", limits={"velocity": 1, "acceleration": 2})
    plan = zs.plan(zs.Problem(machine, [0], [0], margin=0, intervals=np.int64(5)))
    assert plan.success


@pytest.mark.parametrize("size", [1e-300, 1e-13, 1e13, 1e300])
def test_limits_of_absurd_size(size: float) -> None:
    for key in ("velocity", "acceleration"):
        machine = zs.load_machine("slider").with_limits(**{key: size})
        text = refuses(
            zs.ProblemError, f"{key} limit of joint 'slider'", zs.Problem, machine, [-0.1], [0.1]
        )
        assert f"{size:g}" in text


@pytest.mark.parametrize("size", [1e-12, 1e-6, 1e6, 1e12])
def test_limits_of_extreme_size_are_planned_with(size: float) -> None:
    machine = zs.load_machine("slider").with_limits(velocity=size, acceleration=size)
    plan = zs.plan(zs.Problem(machine, [-0.1], [0.1], intervals=20))
    assert plan.success, plan.message
    if size > 1.0:  # the ZMP alone decides
        assert plan.duration == pytest.approx(slider_time(0.5, 0.1), rel=5e-3)
    else:
        assert plan.duration == pytest.approx(0.2 / size, rel=0.1)


@pytest.mark.filterwarnings("ignore::zmp_sqp.MachineWarning")
@pytest.mark.parametrize("mass", [1e-300, 1e-9, 1e9, 1e300])
def test_payloads_of_extreme_mass_end_in_a_plan_or_an_error(mass: float) -> None:
    try:
        machine = MACHINE.with_payload(zs.Payload(mass=mass, com=(0.0, 0.0, 1.0), frame="head"))
        plan = zs.plan(problem(machine=machine, intervals=10), time_budget=2.0)
    except zs.ZmpSqpError:
        return
    assert not plan.success or plan.margin >= 0.0


# --- scenarios ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("[motion]\nstart = [0]\ngoal = [0]", "machine"),
        ("[machine]\nname = 'feller_buncher'\nspeed = 3\n[motion]\nstart=[0]\ngoal=[0]", "speed"),
        ("[machine]\nname = 'feller_buncher'\n[motion]\nstart=[0]\ngoal=[0]", "start"),
        ("[machine]\nname = 'bulldozer'\n[motion]\nstart=[0]\ngoal=[0]", "bulldozer"),
        ("title = 3", "title"),
        ("title = ", "TOML"),
        ("colour = 'red'", "colour"),
    ],
)
def test_scenarios(tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "scenario.toml"
    path.write_text(content)
    text = refuses(zs.ScenarioError, message, load_scenario, path)
    assert "scenario.toml" in text

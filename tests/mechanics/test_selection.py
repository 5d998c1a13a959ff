"""Joints chosen by name, by SRDF group or by holding others; held joints keep their mass."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import zmp_sqp as zs
from tests.mechanics.conftest import PERMUTED, random_motion
from tests.mechanics.test_urdf import BASE, INERTIA, write
from zmp_sqp.mechanics.wrench import efforts

SQUARE = zs.SupportPolygon([[-1, -1], [1, -1], [1, 1], [-1, 1]])
VALUES = {"z_slide": 0.3, "a_turn": -2.2, "wrist": 0.9}


def link(name: str, parent: str, kind: str = "revolute", extra: str = "") -> str:
    """A link of 2 kg that hangs on a joint j_<name>."""
    body = f'<inertial><origin xyz="0.3 0 0.2"/><mass value="2"/>{INERTIA}</inertial>'
    limit = '<limit lower="-1" upper="2" velocity="1" effort="9"/>'
    return (
        f'<link name="{name}">{body}</link><joint name="j_{name}" type="{kind}">'
        f'<parent link="{parent}"/><child link="{name}"/><origin xyz="0.2 0.1 0.4"/>'
        f'<axis xyz="0 1 0"/>{limit}{extra}</joint>'
    )


TREE = (
    f'<robot name="tree">{BASE}{link("mast", "base")}{link("left", "mast")}{link("hand", "left")}'
    f"{link('right', 'mast')}{link('grip', 'right')}"
    + link("thumb", "right", extra='<mimic joint="j_grip" multiplier="-2" offset="0.1"/>')
    + "</robot>"
)
SRDF = """<robot name="tree">
  <group name="left_arm"><chain base_link="mast" tip_link="hand"/></group>
  <group name="right_arm"><joint name="j_right"/><group name="gripper"/></group>
  <group name="gripper"><link name="grip"/></group>
  <group name="all"><group name="left_arm"/><group name="right_arm"/><joint name="j_mast"/></group>
  <group name="loop"><group name="loop"/></group>
  <group name="nothing"/>
  <group name="lost"><joint name="j_tail"/></group>
  <group name="gone"><group name="tail"/></group>
  <group name="detached"><chain base_link="hand" tip_link="grip"/></group>
  <virtual_joint name="world" type="floating" parent_frame="odom" child_link="base"/>
  <group_state name="folded" group="all"><joint name="j_mast" value="0.7"/>
    <joint name="j_left" value="0.1"/><joint name="world" value="0 0 0 0 0 0 1"/></group_state>
  <group_state name="home" group="left_arm"><joint name="j_left" value="0.2"/>
    <joint name="j_hand" value="0.3"/></group_state>
  <group_state name="home" group="right_arm"><joint name="j_right" value="0.4"/>
    <joint name="j_grip" value="5"/></group_state>
</robot>"""


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    write(tmp_path, SRDF, "tree.srdf")
    return write(tmp_path, TREE, "tree.urdf")


@pytest.mark.parametrize("held", [("z_slide",), ("a_turn",), ("wrist",), ("a_turn", "z_slide")])
def test_a_held_joint_is_the_joint_at_a_constant_coordinate(
    tmp_path: Path, held: tuple[str, ...]
) -> None:
    path = write(tmp_path, PERMUTED)
    whole = zs.load_machine(path)
    part = zs.load_machine(path, hold={name: VALUES[name] for name in held})
    free = [name for name in whole.joint_names if name not in held]
    assert part.joint_names == tuple(free)
    assert part.held == {name: VALUES[name] for name in whole.joint_names if name in held}
    assert part.mass == pytest.approx(whole.mass, rel=1e-15)
    columns = [whole.joint_names.index(name) for name in free]
    q, v, a = np.zeros((3, 7, whole.size))
    for name in held:
        q[:, whole.joint_names.index(name)] = VALUES[name]
    reduced = random_motion(part, 7, seed=3)
    for full, values in zip((q, v, a), reduced, strict=True):
        full[:, columns] = values
    root = np.array([0.4, -0.3, 9.7, 0.1, -0.2, 0.3])
    rows = [*range(6), *(6 + i for i in columns)]
    frames = whole.model.frames
    above = {(frame.name, frame.type): frames[frame.parentFrame].name for frame in frames}
    for frame in part.model.frames:
        kind = pin.FrameType.JOINT if frame.name in held else frame.type
        assert part.model.frames[frame.parentFrame].name == above[frame.name, kind]
    payload = zs.Payload(5.0, (0.1, 0.2, 0.3), "tool", np.diag([1.0, 2.0, 2.5]))
    for change in (
        lambda machine: machine,
        lambda machine: machine.with_payload(payload),
        lambda machine: machine.with_payload(payload).with_point_masses(),
        lambda machine: machine.with_point_masses(),
    ):
        expected = efforts(change(whole), q, v, a, root_acceleration=root)[:, rows]
        found = efforts(change(part), *reduced, root_acceleration=root)
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-9)


def test_joints_and_links_of_one_name_are_held_too() -> None:
    whole = zs.load_machine("feller_buncher")  # every link has the name of its joint
    with pytest.warns(zs.MachineWarning, match="limits of joints 'boom', 'stick', 'head' are ign"):
        part = zs.load_machine("feller_buncher", joints=["slew", "tilt"], hold={"boom": -0.5})
    assert part.held == {"boom": -0.5, "stick": pytest.approx(-0.3), "head": 0.0}
    tree = zs.Payload(4000.0, (0.0, 0.0, 3.3), "head")
    q, v, a = (np.array([values]) for values in ([0.3, -0.2], [0.1, 0.4], [-0.2, 0.5]))
    full = [np.zeros((1, 5)) for _ in range(3)]
    for values, both in zip((q, v, a), full, strict=True):
        both[0, [0, 3]] = values
    full[0][0, 1:3] = -0.5, -0.3
    slope = zs.Slope(roll=0.2)
    np.testing.assert_allclose(
        zs.zmp(part.with_payload(tree), q, v, a, slope),
        zs.zmp(whole.with_payload(tree), *full, slope),
        rtol=1e-11,
    )


def test_without_a_choice_the_model_is_the_same_to_the_bit(tmp_path: Path) -> None:
    path = write(tmp_path, PERMUTED)
    whole = zs.load_machine(path)
    again = zs.load_machine(path, joints=list(reversed(whole.joint_names)))
    assert again.joint_names == whole.joint_names, "the order is that of the file"
    read = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    for model in (whole.model, again.model):
        for one, other in zip(model.inertias, read.inertias, strict=True):
            np.testing.assert_array_equal(one.toDynamicParameters(), other.toDynamicParameters())


@pytest.mark.parametrize(
    ("chosen", "planned"),
    [
        ({"joints": ["j_hand", "j_mast"]}, ("j_mast", "j_hand")),
        ({"joints": "j_mast"}, ("j_mast",)),
        ({"joints": ("j_grip", "j_thumb")}, ("j_grip",)),
        ({"group": "left_arm"}, ("j_left", "j_hand")),
        ({"group": "right_arm"}, ("j_right", "j_grip")),
        ({"group": "all"}, ("j_mast", "j_left", "j_hand", "j_right", "j_grip")),
        ({"hold": {"j_mast": 0.5}}, ("j_left", "j_hand", "j_right", "j_grip")),
        ({}, ("j_mast", "j_left", "j_hand", "j_right", "j_grip")),
    ],
)
def test_joints_are_chosen_by_name_group_or_holding(
    tree: Path, chosen: dict[str, object], planned: tuple[str, ...]
) -> None:
    machine = zs.load_machine(tree, **chosen)
    assert machine.joint_names == planned
    moving = {*planned, *(["j_thumb"] if "j_grip" in planned else [])}
    everything = {"j_mast", "j_left", "j_hand", "j_right", "j_grip", "j_thumb"}
    assert set(machine.held) == everything - moving
    assert machine.mass == pytest.approx(22.0)


def test_held_joints_stay_where_they_are_told_or_the_srdf_has_them(tree: Path) -> None:
    held = zs.load_machine(tree, joints=["j_left"], hold={"j_right": -0.5}).held
    assert held == {
        "j_mast": 0.7,  # the only pose that names it
        "j_hand": 0.3,
        "j_right": -0.5,
        "j_grip": 2.0,  # 'home' has 5, beyond its limit
        "j_thumb": pytest.approx(-2.0 * 2.0 + 0.1),
    }
    tree.with_suffix(".srdf").unlink()
    held = zs.load_machine(tree, joints=["j_left"]).held
    assert held == {"j_mast": 0, "j_hand": 0, "j_right": 0, "j_grip": 0, "j_thumb": 0.1}
    low = write(tree.parent, TREE.replace('lower="-1"', 'lower="0.5"'), "low.urdf")
    assert zs.load_machine(low, joints=["j_left"]).held["j_mast"] == 0.5


def test_poses_are_named(tree: Path) -> None:
    machine = zs.load_machine(tree, group="left_arm")
    np.testing.assert_array_equal(machine.pose("home"), [0.2, 0.3])
    assert set(machine.poses) == {"folded", "home"}
    for name, message in (
        ("rest", "no pose 'rest'.*folded, home"),
        ("folded", "'folded'.*'j_hand'"),
    ):
        with pytest.raises(zs.MachineError, match=message):
            machine.pose(name)


def test_starts_and_goals_are_given_by_joint_or_pose(tree: Path) -> None:
    limits = {"acceleration": 1.0}
    machine = zs.load_machine(tree, group="left_arm", support=SQUARE, limits=limits)
    goal = {"j_hand": -0.3, "j_left": 0.6}
    problem = zs.Problem(machine, "home", goal, start_velocity={"j_left": 0.1, "j_hand": 0.0})
    np.testing.assert_array_equal(problem.start, [0.2, 0.3])
    np.testing.assert_array_equal(problem.goal, [0.6, -0.3])
    np.testing.assert_array_equal(problem.start_velocity, [0.1, 0.0])
    for bad, message in (
        ({"j_left": 0.0}, "goal: joint 'j_hand' is missing"),
        ({}, "goal: joint 'j_left', 'j_hand' is missing"),
        (goal | {"j_mast": 0.0}, "goal: joint 'j_mast' is held at 0.7"),
        (goal | {"tail": 0.0}, "goal: there is no joint 'tail'; joints are j_left, j_hand"),
        (goal | {"j_hand": "x"}, "goal of joint 'j_hand' must be a number"),
        ("folded", "'folded'.*'j_hand'"),
    ):
        with pytest.raises(zs.ProblemError, match=message):
            zs.Problem(machine, "home", bad)
    with pytest.raises(zs.ProblemError, match="start_velocity"):
        zs.Problem(machine, "home", goal, start_velocity="home")


@pytest.mark.parametrize(
    ("chosen", "message"),
    [
        ({"joints": ["j_tail"]}, "no joint 'j_tail'; joints are j_mast, j_left"),
        ({"joints": []}, "nothing to plan"),
        ({"joints": 3}, "must be names of joints, not 3"),
        ({"joints": ["j_mast", 3]}, "must be names of joints"),
        ({"joints": ["j_left"], "group": "left_arm"}, "exclude each other"),
        ({"joints": ["j_thumb"]}, "'j_thumb' mimics 'j_grip', which is held"),
        ({"joints": ["j_left"], "hold": {"j_left": 0.0}}, "'j_left' is to be planned and to be"),
        ({"group": "legs"}, "no group 'legs'; groups are left_arm, right_arm"),
        ({"group": 3}, "group must be the name"),
        ({"group": "loop"}, "group 'loop' contains itself"),
        ({"group": "nothing"}, "group 'nothing' has no joint"),
        ({"group": "gone"}, "no group 'tail', which group 'gone' names"),
        ({"group": "detached"}, "from 'hand' to 'grip', but link 'grip' does not hang on 'hand'"),
        ({"hold": {"j_tail": 0.0}}, "hold: there is no joint 'j_tail'"),
        ({"hold": {"j_mast": 2.5}}, r"'j_mast' is to be held at 2.5, outside its limits \[-1, 2\]"),
        ({"hold": {"j_mast": float("nan")}}, "hold: joint 'j_mast' must be finite"),
        ({"hold": {"j_mast": "up"}}, "hold: joint 'j_mast' must be a number"),
        ({"hold": {"j_thumb": 0.0}}, "'j_thumb' mimics 'j_grip': hold that one"),
        ({"hold": ["j_mast"]}, "hold must be a mapping"),
        ({"srdf": "none.srdf"}, "cannot read none.srdf"),
        ({"srdf": 3}, "srdf must be the path"),
    ],
)
def test_choices_that_cannot_be_made_are_named(
    tree: Path, chosen: dict[str, object], message: str
) -> None:
    with pytest.raises(zs.MachineError, match=message) as refusal:
        zs.load_machine(tree, **chosen)
    assert "\n" not in str(refusal.value)


def test_a_group_that_names_what_the_urdf_lacks_is_refused_only_where_asked(tree: Path) -> None:
    assert zs.load_machine(tree, group="left_arm").size == 2
    with pytest.raises(zs.MachineError, match="'lost' names joint 'j_tail', which the URDF does"):
        zs.load_machine(tree, group="lost")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (SRDF.replace('name="tree"', 'name="crane"'), "for robot 'crane', not for 'tree'"),
        (SRDF.replace("j_", "k_").replace("_link", "_knil"), "base_link|no joint 'k_"),
        (
            '<robot name="tree"><group name="a"><joint name="x"/></group></robot>',
            "for robot 'tree', not for 'tree', which has no joint 'x'",
        ),
        ("", "the file is empty"),
        ("<robot", "not well-formed"),
        (TREE, "this is a URDF, not an SRDF"),
        ("<srdf/>", "not an SRDF: its root element is <srdf>"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><robot name="tree"/>', "DOCTYPE and ENTITY"),
        (SRDF.replace('value="0.7"', 'value="nan"'), "'folded', joint 'j_mast'.*finite, not 'nan'"),
        (SRDF.replace('value="0.7"', 'value="up"'), "'folded', joint 'j_mast'.*not 'up'"),
        (SRDF.replace('<group name="nothing"/>', "<group/>"), "<group name> is missing"),
        (SRDF.replace('name="nothing"', 'name="all"'), "group 'all' is there twice"),
    ],
)
def test_srdfs_of_others_and_broken_ones_are_named(tree: Path, text: str, message: str) -> None:
    srdf = write(tree.parent, text, "other.srdf")
    with pytest.raises(zs.MachineError, match=message) as refusal:
        zs.load_machine(tree, srdf=srdf)
    assert "other.srdf" in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_group_needs_an_srdf(tmp_path: Path) -> None:
    with pytest.raises(zs.MachineError, match="group 'arm' needs an SRDF"):
        zs.load_machine(write(tmp_path, TREE), group="arm")


@pytest.mark.parametrize("kind", ["planar", "floating"])
def test_planar_and_floating_joints_are_held_at_zero_or_refused(tmp_path: Path, kind: str) -> None:
    text = TREE.replace("</robot>", link("cart", "base", kind) + link("pole", "cart") + "</robot>")
    path = write(tmp_path, text)
    with pytest.raises(zs.MachineError, match=f"'j_cart' has type '{kind}'.*hold=.*fixed"):
        zs.load_machine(path)
    with pytest.raises(zs.MachineError, match=f"'j_cart' has type '{kind}'"):
        zs.load_machine(path, joints=["j_cart"])
    with pytest.raises(zs.MachineError, match=r"'j_cart'.*only be held at 0.0, not at 1"):
        zs.load_machine(path, hold={"j_cart": 1.0})
    fixed = zs.load_machine(write(tmp_path, text.replace(kind, "fixed"), "fixed.urdf"))
    for chosen in ({"hold": {"j_cart": 0.0}}, {"joints": list(fixed.joint_names)}):
        machine = zs.load_machine(path, **chosen)
        assert machine.held["j_cart"] == 0.0
        assert machine.joint_names == fixed.joint_names
        q, v, a = random_motion(machine, 5, seed=1)
        root = np.array([0, 0, 9.81, 0, 0, 0])
        np.testing.assert_allclose(
            efforts(machine, q, v, a, root_acceleration=root),
            efforts(fixed, q, v, a, root_acceleration=root),
            rtol=1e-12,
        )


def test_limits_of_joints_that_are_not_planned_are_ignored_with_a_word(tree: Path) -> None:
    limit = "has_velocity_limits: true, max_velocity"
    write(
        tree.parent, f"joint_limits: {{j_mast: {{{limit}: 7}}, j_left: {{{limit}: 0.4}}}}",
        "joint_limits.yaml",
    )  # fmt: skip
    with pytest.warns(zs.MachineWarning, match=r"limits of joint 'j_mast' are ignored") as said:
        machine = zs.load_machine(tree, group="left_arm")
    assert len(said) == 1
    assert machine.limits.velocity[0] == 0.4
    (tree.parent / "joint_limits.yaml").unlink()
    changes = {"velocity": {"j_mast": 7.0, "j_left": 0.5}, "acceleration": 2.0}
    with pytest.warns(zs.MachineWarning, match=r"limits of joint 'j_mast' are ignored"):
        machine = zs.load_machine(tree, group="left_arm", limits=changes)
    assert machine.limits.velocity[0] == 0.5
    with pytest.raises(zs.MachineError, match="unknown joint 'tail'"):
        zs.load_machine(tree, group="left_arm", limits={"velocity": {"tail": 1.0}})


def test_all_missing_limits_are_one_error(tree: Path) -> None:
    text = TREE.replace('<limit lower="-1" upper="2" velocity="1" effort="9"/>', "")
    machine = zs.load_machine(write(tree.parent, text), joints=["j_left", "j_mast"])
    with pytest.raises(zs.ProblemError) as refusal:
        zs.Problem(machine.with_support(SQUARE), [0, 0], [0.1, 0.1])
    for part in ("position lower", "position upper", "velocity", "acceleration"):
        assert re.search(rf"no {part} limit for joint 'j_mast', 'j_left'", str(refusal.value))

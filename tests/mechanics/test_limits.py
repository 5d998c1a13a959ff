from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from tests.mechanics.test_urdf import TOY, write
from zmp_sqp.errors import MachineError, MachineWarning
from zmp_sqp.mechanics.limits import JointLimits
from zmp_sqp.mechanics.urdf.limits_yaml import read_joint_limits, template
from zmp_sqp.mechanics.urdf.loader import load_machine

NAMES = ("slew", "boom")
NAN = np.nan


def limits() -> JointLimits:
    return JointLimits([-1.0, -np.inf], [1.0, np.inf], [0.5, 0.6], [NAN, 2.0], [NAN, NAN])


def test_missing_names_the_joints_without_a_limit_that_planning_needs() -> None:
    assert limits().missing(NAMES) == {"acceleration": ("slew",)}
    assert limits().updated({"acceleration": 1.0}, NAMES).missing(NAMES) == {}


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (0.4, [0.4, 0.4]),
        ([0.1, 0.2], [0.1, 0.2]),
        ({"boom": 3}, [0.5, 3.0]),
        ({}, [0.5, 0.6]),
        (np.array(2), [2.0, 2.0]),
    ],
    ids=["scalar", "array", "mapping", "nothing", "0-d"],
)
def test_limits_can_be_given_for_all_each_or_some(change: object, expected: list[float]) -> None:
    changed = limits().updated({"velocity": change}, NAMES)
    np.testing.assert_array_equal(changed.velocity, expected)
    np.testing.assert_array_equal(changed.acceleration, [NAN, 2.0])


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"speed": 1.0}, "unknown limit 'speed'; limits are position_lower"),
        (
            {"slew": {"velocity": 0.8}},
            "'slew' is a joint: the limit comes first, as in {'velocity': {'slew': 0.8}}",
        ),
        ({"velocity": {"bom": 1.0}}, "unknown joint 'bom'; joints are slew, boom"),
        ({"velocity": 0.0}, "velocity limit of joint 'slew' must be positive and finite, not 0.0"),
        (
            {"velocity": [1.0, -1.0]},
            "velocity limit of joint 'boom' must be positive and finite, not -1.0",
        ),
        ({"acceleration": {"boom": np.inf}}, "acceleration limit of joint 'boom' must be finite"),
        (
            {"acceleration": [1.0, NAN]},
            "acceleration limit of joint 'boom' must be a number, not nan",
        ),
        (
            {"effort": {"slew": "strong"}},
            "effort limit of joint 'slew' must be a number, not 'strong'",
        ),
        ({"velocity": [1.0, 2.0, 3.0]}, "velocity limits must have shape (2,)"),
        ({"velocity": [[1.0], [2.0, 3.0]]}, "velocity limits must be numbers"),
        ({"velocity": True}, "velocity limit must be a number, not True"),
        (
            {"position_lower": {"slew": 2.0}},
            "joint 'slew': no position lies between its lower limit, 2.0, and its upper limit, 1.0",
        ),
        ({"position_upper": {"boom": -np.inf}}, "joint 'boom'"),
        (3.0, "must be a mapping"),
    ],
)
def test_bad_changes_are_refused_by_joint(changes: dict[str, object], named: str) -> None:
    with pytest.raises(MachineError, match=re.escape(named)):
        limits().updated(changes, NAMES)


def test_limits_of_different_lengths_are_refused() -> None:
    with pytest.raises(MachineError, match="same number of joints"):
        JointLimits([0.0], [1.0], [1.0, 2.0], [1.0], [1.0])


def read(folder: Path, text: str) -> JointLimits:
    path = folder / "joint_limits.yaml"
    path.write_text(text)
    return read_joint_limits(path, limits(), NAMES)


def test_a_value_in_the_file_holds_only_where_its_switch_is_true(tmp_path: Path) -> None:
    text = """
joint_limits:
  slew: {has_velocity_limits: true, max_velocity: 0.3, has_acceleration_limits: false,
      max_acceleration: 7.0}
  boom: {max_velocity: 0.1, has_position_limits: true, min_position: -2, max_position: 2.5,
      has_jerk_limits: false, max_jerk: 3.0}
"""
    # a word only where a limit is missing without the value, and not about a zero
    with pytest.warns(MachineWarning, match=r"true: max_acc\w+ of joint 'slew' \(has_acc\w+\)$"):
        found = read(tmp_path, text)
    read(tmp_path, text.replace("7.0", "0.0"))
    np.testing.assert_array_equal(found.velocity, [0.3, 0.6])
    np.testing.assert_array_equal(found.acceleration, [NAN, 2.0])
    np.testing.assert_array_equal(found.position_lower, [-1.0, -2.0])
    np.testing.assert_array_equal(found.position_upper, [1.0, 2.5])


def test_default_scaling_factors_scale_the_limits_of_all_joints(tmp_path: Path) -> None:
    found = read(
        tmp_path,
        """
default_velocity_scaling_factor: 0.1
default_acceleration_scaling_factor: 0.5
joint_limits:
  slew: {has_velocity_limits: true, max_velocity: 2.0, has_acceleration_limits: true,
      max_acceleration: 3}
""",
    )
    np.testing.assert_allclose(found.velocity, [0.2, 0.06])
    np.testing.assert_allclose(found.acceleration, [1.5, 1.0])


def test_an_empty_file_changes_nothing(tmp_path: Path) -> None:
    np.testing.assert_array_equal(read(tmp_path, "").velocity, [0.5, 0.6])


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("joint_limits: {slew: ", "not YAML"),
        ("joint_limits: !!python/object:os.system {}", "not YAML"),
        ("- slew", "must be a mapping"),
        ("limits: {}", "unknown key 'limits'"),
        ("joint_limits: [slew]", "joint_limits must be a mapping"),
        ("joint_limits: {slew: 3}", "joint_limits.slew must be a mapping"),
        ("joint_limits: {arm: {}}", "joint_limits.arm: unknown joint 'arm'; joints are slew, boom"),
        ("joint_limits: {slew: {max_speed: 3}}", "joint_limits.slew: unknown key 'max_speed'"),
        (
            "joint_limits: {slew: {has_velocity_limits: 1}}",
            "joint_limits.slew.has_velocity_limits must be true or false",
        ),
        ("joint_limits: {slew: {has_velocity_limits: true}}", "max_velocity is missing"),
        (
            "joint_limits: {slew: {has_velocity_limits: true, max_velocity: fast}}",
            "slew.max_velocity must be a number",
        ),
        ("joint_limits: {slew: {has_velocity_limits: true, max_velocity: 1e-1}}", "write 1.0e-3"),
        (
            "joint_limits: {slew: {has_velocity_limits: true, max_velocity: .nan}}",
            "slew.max_velocity must be finite",
        ),
        (
            "joint_limits: {slew: {has_velocity_limits: true, max_velocity: -1}}",
            "velocity limit of joint 'slew'",
        ),
        (
            "joint_limits: {slew: {has_position_limits: true, min_position: 3, max_position: 2}}",
            "its lower limit, 3.0, and its upper limit, 2.0",
        ),
        (
            "default_velocity_scaling_factor: 2.0",
            "default_velocity_scaling_factor must be above 0 and at most 1",
        ),
        (
            "default_velocity_scaling_factor: full",
            "default_velocity_scaling_factor must be a number",
        ),
    ],
)
def test_bad_files_are_refused_by_file_and_key(tmp_path: Path, text: str, named: str) -> None:
    with pytest.raises(MachineError, match=re.escape(named)) as refusal:
        read(tmp_path, text)
    assert "joint_limits.yaml" in str(refusal.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(MachineError, match=r"cannot read joint limits .*none\.yaml: No such file"):
        read_joint_limits(tmp_path / "none.yaml", limits(), NAMES)


@pytest.mark.parametrize("entries", ["{has_jerk_limits: true, max_jerk: 5.0}", "{max_jerk: 5.0}"])
def test_jerk_limits_are_warned_of(tmp_path: Path, entries: str) -> None:
    with pytest.warns(MachineWarning, match=r"joint_limits\.yaml: jerk limits .*'boom'") as said:
        read(tmp_path, f"joint_limits: {{slew: {{has_jerk_limits: false}}, boom: {entries}}}")
    assert said[0].filename == __file__


def test_limits_of_joints_that_are_not_planned_are_warned_of(tmp_path: Path) -> None:
    path = tmp_path / "joint_limits.yaml"
    path.write_text("joint_limits: {mast: {max_velocity: fast}, slew: {}}")
    with pytest.warns(MachineWarning, match="limits of joint 'mast' are ignored"):
        read_joint_limits(path, limits(), NAMES, ("mast", "boom"))


def test_a_drafted_file_gives_the_limits_that_it_was_made_of(tmp_path: Path) -> None:
    text = TOY.replace('velocity="2"', 'velocity="1e-5"').replace('"turn"', '"on: off"')
    urdf = write(tmp_path, text)
    machine = load_machine(urdf, limits={"acceleration": 1e20})
    known = template(machine)
    assert "MISSING [" not in known
    write(tmp_path, known, "joint_limits.yaml")
    again = load_machine(urdf).limits
    for key in ("position_lower", "position_upper", "velocity", "acceleration", "effort"):
        np.testing.assert_array_equal(getattr(again, key), getattr(machine.limits, key))


def test_a_drafted_file_marks_what_planning_lacks(tmp_path: Path) -> None:
    urdf = write(tmp_path, TOY.replace('<limit lower="-1" upper="1" velocity="2" effort="3"/>', ""))
    machine = load_machine(urdf)
    missing = machine.limits.missing(machine.joint_names)
    text = template(machine)
    assert text.count("MISSING [") == len(missing) == 4
    write(tmp_path, text, "joint_limits.yaml")
    assert load_machine(urdf).limits.missing(machine.joint_names) == missing
    for key in ("min_position", "max_position", "max_velocity", "max_acceleration"):
        text = text.replace(f"    {key}:", f"    {key}: {-1.5 if key == 'min_position' else 1.5}")
    for switch in ("position", "velocity", "acceleration"):
        text = text.replace(f"has_{switch}_limits: false", f"has_{switch}_limits: true")
    write(tmp_path, text, "joint_limits.yaml")
    found = load_machine(urdf).limits
    assert found.missing(machine.joint_names) == {}
    assert (found.position_lower[0], found.acceleration[0]) == (-1.5, 1.5)

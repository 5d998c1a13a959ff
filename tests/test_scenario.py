"""Scenario files: what they mean, and one clear sentence about each mistake in one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from zmp_sqp.errors import ScenarioError
from zmp_sqp.mechanics import zmp
from zmp_sqp.scenario import load_scenario, shipped_scenarios, sliding_joints

PAPER_1 = """
[machine]
name = "feller_buncher"

[ground]
roll_deg = -20.0

[motion]
start_deg = [0.0, -30.0, -120.0, 30.0, -90.0]
goal_deg = [180.0, -30.0, -120.0, 30.0, -90.0]
"""
SLIDER = """<robot name="slider">
  <link name="base"><inertial><mass value="1"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="block"><inertial><mass value="1"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="rail" type="prismatic"><parent link="base"/><child link="block"/><axis xyz="1 0 0"/>
    <origin xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
</robot>"""
SLIDER_SCENARIO = """
title = "a slider"
[machine]
urdf = "slider.urdf"
support = { vertices = [[-1, -1], [1, -1], [1, 1], [-1, 1]], height = 0.1 }
limits = { acceleration = { rail = 2 } }
[motion]
start = [-0.3]
goal = [0.3]
goal_velocity = [0.1]
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "my.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture
def slider(tmp_path: Path) -> Path:
    (tmp_path / "slider.urdf").write_text(SLIDER, encoding="utf-8")
    return tmp_path


# --- what a file means --------------------------------------------------------------------------


def test_shipped_scenarios_are_listed_and_all_of_them_load() -> None:
    assert {"paper_1", "paper_1_rigid"} <= set(shipped_scenarios())
    for name in shipped_scenarios():
        scenario = load_scenario(name)
        assert scenario.name == name
        assert scenario.title


def test_paper_1_is_test_1_of_the_paper() -> None:
    scenario = load_scenario("paper_1")
    problem, machine = scenario.problem, scenario.problem.machine
    pi = np.pi
    # eq. (22)
    np.testing.assert_allclose(
        problem.start, [0.0, -pi / 6, -2 * pi / 3, pi / 6, -pi / 2], rtol=1e-15
    )
    # eq. (23)
    np.testing.assert_allclose(
        problem.goal, [pi, -pi / 6, -2 * pi / 3, pi / 6, -pi / 2], rtol=1e-15
    )
    assert machine.mass == pytest.approx(27650.0)  # Table I
    assert (problem.intervals, problem.margin, problem.model, scenario.qp_solver) == (
        50,
        0.0,
        "full",
        "auto",
    )
    at_rest = zmp(machine, problem.start, np.zeros(5), np.zeros(5), problem.ground)
    np.testing.assert_allclose(at_rest, [1.270, 0.786], atol=1e-3)  # paper.md


def test_paper_1_has_point_masses_and_paper_1_rigid_has_not() -> None:
    points, bodies = (load_scenario(name).problem for name in ("paper_1", "paper_1_rigid"))
    np.testing.assert_array_equal(points.start, bodies.start)
    pitching = np.array([0.0, np.pi / 2, 0.0, 0.0, 0.0])
    rigid, lumped = (
        zmp(p.machine, p.start, np.zeros(5), pitching, p.ground)[0] for p in (bodies, points)
    )
    assert 0.10 < rigid - lumped < 0.16  # [m]; of the stem alone, on level ground: 0.124


def test_degrees_and_radians_mean_the_same(tmp_path: Path) -> None:
    in_radians = PAPER_1.replace(
        "start_deg = [0.0, -30.0, -120.0, 30.0, -90.0]",
        f"start = [0.0, {-np.pi / 6}, {-2 * np.pi / 3}, {np.pi / 6}, {-np.pi / 2}]",
    )
    problem = load_scenario(written(tmp_path, in_radians)).problem
    np.testing.assert_allclose(problem.start, load_scenario("paper_1").problem.start, rtol=1e-15)


def test_a_file_without_title_is_called_by_its_name_and_defaults_are_the_librarys(
    tmp_path: Path,
) -> None:
    scenario = load_scenario(str(written(tmp_path, PAPER_1)))
    assert (scenario.name, scenario.title, scenario.qp_solver) == ("my", "my", "auto")
    assert scenario.problem.machine.mass == pytest.approx(23650.0)  # no payload


def test_files_are_found_beside_the_scenario_and_all_machine_keys_count(slider: Path) -> None:
    problem = load_scenario(written(slider, SLIDER_SCENARIO)).problem
    assert problem.machine.joint_names == ("rail",)
    assert problem.machine.support.height == 0.1
    assert problem.machine.limits.acceleration.tolist() == [2.0]
    assert problem.goal_velocity.tolist() == [0.1]


def test_a_joint_limits_file_and_contact_links_can_be_named(slider: Path) -> None:
    limits = "joint_limits:\n  rail: {has_acceleration_limits: true, max_acceleration: 3.0}\n"
    (slider / "my_limits.yaml").write_text(limits, encoding="utf-8")
    text = SLIDER_SCENARIO.replace(
        "limits = { acceleration = { rail = 2 } }", 'joint_limits = "my_limits.yaml"'
    )
    assert load_scenario(written(slider, text)).problem.machine.limits.acceleration.tolist() == [
        3.0
    ]
    tracks = PAPER_1.replace("[ground]", 'contact_links = ["left_track", "right_track"]\n[ground]')
    support = load_scenario(written(slider, tracks)).problem.machine.support
    # [m], the paper's polygon
    np.testing.assert_allclose(np.ptp(support.vertices, axis=0), [5.0, 3.23])


def test_starts_and_goals_are_given_by_joint_in_the_keys_unit(tmp_path: Path) -> None:
    by_joint = PAPER_1.replace(
        "[0.0, -30.0, -120.0, 30.0, -90.0]",
        "{ boom = -30.0, slew = 0.0, tilt = 30.0, stick = -120.0, head = -90.0 }",
    )
    expected, found = (
        load_scenario(written(tmp_path, text)).problem.start for text in (PAPER_1, by_joint)
    )
    np.testing.assert_array_equal(found, expected)
    lacking = by_joint.replace("stick = -120.0, ", "").replace("slew = 0.0, ", "")
    with pytest.raises(ScenarioError, match=r"start_deg: joint 'slew', 'stick' is missing"):
        load_scenario(written(tmp_path, lacking))
    with pytest.raises(ScenarioError, match=r"start_deg: there is no joint 'bom'"):
        load_scenario(written(tmp_path, by_joint.replace("boom =", "bom =")))


def test_starts_and_goals_are_poses_of_the_srdf(slider: Path) -> None:
    (slider / "poses.srdf").write_text(
        '<robot name="slider"><group_state name="out"><joint name="rail" value="0.25"/>'
        "</group_state></robot>"
    )
    text = SLIDER_SCENARIO.replace("[-0.3]", '"out"').replace("[0.3]", "{ rail = 0.5 }")
    text = text.replace('urdf = "slider.urdf"', 'urdf = "slider.urdf"\nsrdf = "poses.srdf"')
    problem = load_scenario(written(slider, text)).problem
    assert (problem.start[0], problem.goal[0]) == (0.25, 0.5)
    with pytest.raises(ScenarioError, match=r"start: machine 'slider' has no pose 'in'"):
        load_scenario(written(slider, text.replace('"out"', '"in"')))
    with pytest.raises(ScenarioError, match=r"start_deg: must be a list"):
        load_scenario(written(slider, text.replace('start = "out"', 'start_deg = "out"')))


def test_sliding_joints_are_told_from_turning_ones(slider: Path) -> None:
    assert sliding_joints(load_scenario(written(slider, SLIDER_SCENARIO)).problem.machine) == (
        "rail",
    )
    assert sliding_joints(load_scenario("paper_1").problem.machine) == ()


# --- what is wrong with a file ------------------------------------------------------------------

MISTAKES = {
    "unknown key": (
        "[ground]\nroll_deg",
        "[ground]\nrol_deg",
        r"\[ground\] rol_deg: unknown key \(did you mean roll_deg\?\)",
    ),
    "unknown table": (
        "[ground]",
        "[grund]",
        r"grund: unknown key \(did you mean ground\?\); allowed are title, machine",
    ),
    "key without a likeness": (
        "roll_deg",
        "xyzzy",
        r"\[ground\] xyzzy: unknown key; allowed are roll_deg, pitch_deg",
    ),
    "unknown nested key": (
        "[ground]",
        "[machine.payload]\nweight = 1\n[ground]",
        r"\[machine.payload\] weight: unknown key",
    ),
    "missing table": ('[machine]\nname = "feller_buncher"', "", "machine: missing"),
    "missing key": (
        "[ground]",
        "[machine.payload]\nmass = 1\n[ground]",
        r"\[machine.payload\] com: missing; .* 3 finite",
    ),
    "missing start": (
        "start_deg = [0.0, -30.0, -120.0, 30.0, -90.0]",
        "",
        r"\[motion\] start or start_deg: missing",
    ),
    "both units": (
        "start_deg",
        "start = [0, 0, 0, 0, 0]\nstart_deg",
        r"\[motion\] start and start_deg exclude each other",
    ),
    "no machine": ('name = "feller_buncher"', "", r"\[machine\] name or urdf: missing"),
    "two supports": (
        "[ground]",
        "support = {vertices = [[0, 0]]}\ncontact_links = []\n[ground]",
        "support and contact_links",
    ),
    "string for number": (
        "-20.0",
        '"-20"',
        r"\[ground\] roll_deg: must be a finite number, not '-20'",
    ),
    "true for number": ("-20.0", "true", r"\[ground\] roll_deg: must be a finite number, not True"),
    "not finite": ("-20.0", "nan", r"\[ground\] roll_deg: must be a finite number, not nan"),
    "infinite entry": (
        "[0.0, -30.0",
        "[inf, -30.0",
        r"\[motion\] start_deg: must be a list of finite numbers.*\[inf",
    ),
    "float for integer": (
        "[ground]",
        "[plan]\nintervals = 50.0\n[ground]",
        r'\[plan\] intervals: must be a whole number or "auto", not 50.0',
    ),
    "value for table": (
        "[ground]\nroll_deg = -20.0",
        "[[ground]]",
        r"ground: must be a table, not \[\{\}\]",
    ),
    "wrong length": (
        "-90.0]\ngoal",
        "]\ngoal",
        r"start_deg: needs 5 numbers \(slew, boom, stick, tilt, head\), not 4",
    ),
    "short point": (
        "[ground]",
        '[machine.payload]\nmass = 1\ncom = [0, 1]\nframe = "head"\n[ground]',
        r"\[machine.payload\] com: must be 3 finite numbers \[x, y, z\], not \[0, 1\]",
    ),
    "unknown frame": (
        "[ground]",
        '[machine.payload]\nmass = 1\ncom = [0, 0, 1]\nframe = "hed"\n[ground]',
        r"\[machine\]: .*'hed'.*head",
    ),
    "negative mass": (
        "[ground]",
        '[machine.payload]\nmass = -1\ncom = [0, 0, 1]\nframe = "head"\n[ground]',
        r"\[machine\]: payload mass must be positive, not -1.0",
    ),
    "unknown machine": (
        "feller_buncher",
        "feller_bunch",
        r"\[machine\]: .*'feller_bunch' \(did you mean feller_buncher\?\)",
    ),
    "missing URDF": ('name = "feller_buncher"', 'urdf = "no.urdf"', r"\[machine\]: .*no\.urdf"),
    "unknown joint": (
        "[ground]",
        "[machine.limits]\nvelocity = {slw = 1}\n[ground]",
        r"\[machine\]: velocity limit of unknown joint 'slw'; joints are slew",
    ),
    "slope like a wall": ("-20.0", "-90.0", r"\[ground\]: slope roll must lie within"),
    "too few intervals": ("[ground]", "[plan]\nintervals = 1\n[ground]", "intervals"),
    "slope beyond all doubt": (
        "[ground]",
        "[plan]\nslope_uncertainty_deg = 40\n[ground]",
        r"\[plan\]: slope_uncertainty_deg must lie within \[0, 28.65\] degrees, not 40",
    ),
    "unknown model": ("[ground]", '[plan]\nmodel = "half"\n[ground]', "model.*half"),
    "goal outside its limits": ("goal_deg = [180.0", "goal_deg = [1800.0", "slew"),
    "not TOML": ("[ground]", "[ground", "not a TOML file"),
}


@pytest.mark.parametrize(("before", "after", "message"), MISTAKES.values(), ids=MISTAKES.keys())
def test_a_mistake_is_named_with_file_table_key_and_value(
    tmp_path: Path, before: str, after: str, message: str
) -> None:
    assert PAPER_1.count(before) == 1 or before in ("roll_deg", "start_deg")
    path = written(tmp_path, PAPER_1.replace(before, after, 1))
    with pytest.raises(ScenarioError, match=message) as caught:
        load_scenario(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_degrees_of_a_sliding_joint_are_refused(slider: Path) -> None:
    with pytest.raises(ScenarioError, match="joint 'rail' slides"):
        load_scenario(written(slider, SLIDER_SCENARIO.replace("start =", "start_deg =")))


def test_a_scenario_that_does_not_exist_brings_the_list_and_the_nearest_name(
    tmp_path: Path,
) -> None:
    with pytest.raises(
        ScenarioError,
        match=r"papr_1: no such scenario \(did you mean paper_1\?\).* paper_1, paper_1_rigid",
    ):
        load_scenario("papr_1")
    with pytest.raises(ScenarioError, match="cannot be read"):
        load_scenario(tmp_path)  # a folder


def test_a_file_that_is_not_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "binary.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ScenarioError, match="not a TOML file"):
        load_scenario(path)

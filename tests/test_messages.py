"""Messages: true, with digits enough, and in the words of their reader."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import zmp_sqp as zs
import zmp_sqp.cli as cli
from benchmarks.problems.arm import HARD, random_problem
from benchmarks.problems.terrain import random_drive_problem
from tests.test_cli import STRETCHED, TIPPING
from zmp_sqp.errors import GIVE_EFFORT, GIVE_LIMITS, GIVE_SUPPORT, HOLD, in_keys
from zmp_sqp.planning.proof.certificate import certify_at
from zmp_sqp.scenario import load_scenario

MARGIN_MISSED = STRETCHED.replace("roll_deg = -20", "roll_deg = -8").replace(
    "[plan]", "[plan]\nmargin = 0.3"
)
PYTHON = re.compile(r"load_machine|with_support|Slope\(|\w=(?!\.\.\.>)[\w{]|\w\(\)")


@pytest.fixture
def scenario(tmp_path: Path):
    def write(text: str) -> Path:
        path = tmp_path / "scenario.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


# --- what is said of the bound


@pytest.mark.parametrize("seed", range(6))
def test_no_motion_is_faster_by_more_than_a_plan_says(seed: int) -> None:
    plan = zs.plan(random_problem(seed, HARD).problem)
    gain = 1.0 - plan.lower_bound / plan.duration  # that no motion can exceed
    if plan.message.startswith("Solved: no motion within the joint limits is faster."):
        assert gain <= 1e-8
    elif plan.status is zs.Status.FASTEST_POSSIBLE:
        found = re.search(r"is faster by more than (0\.03\d*) %\.", plan.message)
        assert found is not None
        assert gain <= 0.01 * float(found[1]) <= gain + 1.1e-5


def test_the_blind_motion_is_called_the_fastest_without_a_reserve() -> None:
    machine = zs.load_machine("feller_buncher").with_limits(acceleration=0.3)
    pose = [-0.8, -2.0, 0.7, 0.0]
    plan = zs.plan(zs.Problem(machine, [0.0, *pose], [0.3, *pose]))
    assert plan.duration <= plan.lower_bound * (1.0 + 1e-8)
    assert plan.message == "Solved: no motion within the joint limits is faster."


# --- what is said of a motion that was not found


def test_times_of_a_failure_are_those_of_the_table(scenario) -> None:
    plan = zs.plan(load_scenario(scenario(STRETCHED)).problem)
    assert plan.status is zs.Status.INFEASIBLE
    at = f"{plan.certificate.tip_over.time:.2f}"
    words = f"At {at} s of the last motion looked at, which takes {plan.duration:.2f} s, the ZMP"
    assert words in plan.message
    assert "still tips the machine over;" in plan.message
    assert "a smaller margin" not in plan.message  # none was asked for
    assert "more intervals" not in plan.message


def test_too_few_intervals_are_named_before_the_load_is_blamed() -> None:
    problem = random_problem(4, HARD).problem
    few = zs.plan(replace(problem, intervals=2))
    assert few.status is zs.Status.INFEASIBLE
    assert "over; try more intervals, a lighter payload," in few.message
    assert zs.plan(replace(problem, intervals=12)).success


def test_a_constraint_without_value_on_the_way_is_what_the_search_failed_for() -> None:
    def only_slow(machine, q, v, a):
        values = np.full((len(q), 1), -1.0)
        values[np.abs(v[:, 0]) > 0.2] = np.nan
        return values, np.zeros((len(q), 1, 3 * machine.size))

    problem = random_problem(4, HARD).problem
    plan = zs.plan(replace(problem, constraints=[zs.PathRows("mine", only_slow, ["speed"])]))
    assert plan.status is zs.Status.FAILED
    assert "the search ended where mine has no value; let its function give finite" in plan.message
    assert "QP solver" not in plan.message
    safe = zs.plan(problem).trajectory
    rows = plan.problem.constraints
    checked = zs.certify(problem.machine, safe, problem.ground, constraints=rows)
    assert not checked.safe
    assert checked.fault.startswith("comes to states where mine (speed) has no value, near ")


def test_a_motion_that_only_misses_the_margin_does_not_tip(scenario) -> None:
    plan = zs.plan(load_scenario(scenario(MARGIN_MISSED)).problem)
    assert plan.status is zs.Status.INFEASIBLE
    assert 0.0 < plan.certificate.sampled < 0.3
    assert "still misses the margin of 0.3 m" in plan.message
    assert "a smaller margin" in plan.message
    assert "tips" not in plan.message


def test_a_pose_that_tips_over_is_named_by_the_axes_of_the_figures(scenario) -> None:
    with pytest.raises(zs.ScenarioError, match="tips over at rest at the goal") as caught:
        load_scenario(scenario(TIPPING))
    assert re.search(r"x forward -?\d\.\d{3} m and y left 2\.\d{3} m", str(caught.value))


# --- digits


def test_a_start_just_outside_its_limits_shows_the_difference() -> None:
    machine = zs.load_machine("feller_buncher")
    upper = float(machine.limits.position_upper[1])
    start = np.array([0.0, upper + 1e-7, -2.0, 0.7, 0.0])
    goal = np.array([1.0, 0.0, -2.0, 0.7, 0.0])
    for refused in (
        lambda: zs.phase_plane(machine, start, goal),
        lambda: zs.Problem(machine, start, goal),
    ):
        with pytest.raises(zs.ProblemError, match="start of joint 'boom'") as caught:
            refused()
        found = re.search(r"is (\S+), outside its limits \[(\S+), (\S+)\] rad", str(caught.value))
        assert found is not None
        assert float(found[1]) > float(found[3])


def test_rounding_outside_a_limit_is_refused_nowhere() -> None:
    machine = zs.load_machine("feller_buncher")
    start = np.array([0.0, float(machine.limits.position_upper[1]) + 1e-10, -2.0, 0.7, 0.0])
    goal = np.array([0.5, 0.3, -2.0, 0.7, 0.0])
    assert zs.Problem(machine, start, goal).start[1] == start[1]
    assert zs.phase_plane(machine, start, goal).duration > 0.0


def test_an_angle_that_was_meant_in_degrees_is_asked_about() -> None:
    machine = zs.load_machine("feller_buncher")
    start = np.array([0.0, -30.0, -2.0, 0.7, 0.0])
    with pytest.raises(zs.ProblemError, match=r"in degrees, it is -0\.5236 rad"):
        zs.Problem(machine, start, start)


# --- arguments for callers, keys for users of files


def test_advice_speaks_of_arguments_to_callers_and_of_keys_to_users_of_files(
    scenario,
    capsys: pytest.CaptureFixture[str],
) -> None:
    limits = '[[constraints]]\ntype = "torque_limits"\n'
    text = STRETCHED.replace('name = "feller_buncher"', 'urdf = "no_effort.urdf"') + limits
    path = scenario(text)
    urdf = Path(zs.shipped_machines()["feller_buncher"]).read_text(encoding="utf-8")
    (path.parent / "no_effort.urdf").write_text(re.sub(r' effort="[^"]*"', "", urdf), "utf-8")
    machine = zs.load_machine(path.parent / "no_effort.urdf")
    with pytest.raises(zs.ProblemError, match="load_machine"):
        zs.TorqueLimits().rows(machine, None)
    (path.parent / "joint_limits.yaml").write_text(
        "joint_limits:\n"
        + "".join(
            f"  {name}: {{has_acceleration_limits: true, max_acceleration: 1.5}}\n"
            for name in machine.joint_names
        )
    )
    assert cli.main(["plan", str(path)]) == 2
    complaint = capsys.readouterr().err
    assert "effort in [machine.limits]" in complaint
    assert not PYTHON.search(complaint)


@pytest.mark.parametrize("advice", [GIVE_SUPPORT, GIVE_LIMITS, GIVE_EFFORT, HOLD])
def test_every_advice_has_words_for_both(advice) -> None:
    assert in_keys(f"so: {advice.arguments}.") == f"so: {advice.keys}."
    assert not PYTHON.search(advice.keys)


def test_a_rate_limit_of_zero_points_to_holding_the_joint() -> None:
    with pytest.raises(zs.MachineError, match=r"'boom' must be positive.*hold="):
        zs.load_machine("feller_buncher", limits={"velocity": {"boom": 0.0}})


# --- margins whatever is asked


@pytest.mark.parametrize("seed", [0, 5, 13, 14, 22])
def test_a_certified_margin_hardly_depends_on_the_margin_that_is_asked_for(seed: int) -> None:
    problem = random_problem(seed, HARD).problem
    plan = zs.plan(problem)
    machine, motion = problem.machine, plan.trajectory
    sampled = plan.certificate.sampled
    asked = (0.0, sampled - 0.01, sampled - 1e-4, sampled - 1e-6, sampled, sampled + 0.1)
    margins = [zs.certify(machine, motion, problem.ground, margin).margin for margin in asked]
    assert max(margins) - min(margins) < 6e-6  # [m]
    assert sampled - min(margins) < 6e-6


def test_nor_does_one_over_terrain() -> None:
    problem = random_drive_problem(1, over_terrain=True)
    plan = zs.plan(problem)
    sampled = plan.certificate.sampled
    margins = [
        certify_at(problem.corners(every=True), plan.trajectory, asked).margin
        for asked in (0.0, sampled - 1e-4, sampled - 3e-5, sampled + 0.1)
    ]
    assert max(margins) - min(margins) < 2.5e-5  # [m]
    assert sampled - min(margins) < 2.5e-5


def test_a_margin_that_is_too_large_says_which_would_do() -> None:
    machine = zs.load_machine("feller_buncher")
    pose = [0.0, -0.8, -2.0, 0.7, 0.0]
    with pytest.raises(zs.ProblemError, match=r"leaves something is (\S+) m") as caught:
        zs.Problem(machine, pose, pose, margin=2.0)
    found = re.search(r"leaves something is (\S+) m", str(caught.value))
    assert found is not None
    assert 1.61 <= float(found[1]) <= 1.615  # [m] half the width of the tracks


def test_angles_outside_their_limits_are_given_in_degrees_too() -> None:
    machine = zs.load_machine("feller_buncher")
    pose = [0.0, np.radians(-130.0), -2.0, 0.7, 0.0]
    with pytest.raises(zs.ProblemError, match=r"in degrees: -130, outside \[-80\.\d+, 34\.\d+\]"):
        zs.Problem(machine, pose, pose)


@pytest.mark.parametrize("angle", ["-95.0", "90.0", "1e300"])
def test_a_slope_of_a_file_is_refused_in_its_own_unit(scenario, angle: str) -> None:
    path = scenario(TIPPING.replace("roll_deg = -20", f"roll_deg = {angle}"))
    with pytest.raises(zs.ScenarioError, match=r"slope roll must lie within \+-90 degrees, not "):
        load_scenario(path)


# --- what is said of constraints of the user's own


def test_a_wrong_jacobian_is_named_where_the_search_fails_and_a_right_one_is_not() -> None:
    problem = random_problem(4, HARD).problem

    def slow(sign: float):
        def rows(machine, q, v, a):
            jacobian = np.zeros((len(q), 1, 3 * machine.size))
            jacobian[:, 0, machine.size] = sign * 2.0 * v[:, 0]
            return (v[:, 0] ** 2 - 0.01)[:, None], jacobian

        return rows

    said = []
    for sign in (-1.0, 1.0):
        rows = zs.PathRows("slow", slow(sign))
        asked = replace(problem, constraints=[rows], intervals=10)
        said.append(zs.plan(asked, time_budget=5.0))
    wrong, right = said
    assert not wrong.success
    assert "The Jacobian of 'slow' is not that of the values" in wrong.message
    assert right.success
    assert "Jacobian" not in right.message


def test_a_base_that_turns_many_times_may_be_meant_in_degrees() -> None:
    limits = {"max_speed": 1.0, "max_acceleration": 0.5}
    limits |= {"max_yaw_rate": 0.3, "max_yaw_acceleration": 0.3}
    with pytest.warns(zs.ProblemWarning, match=r"14.3 full turns.*90 is 1.571 rad"):
        zs.UnicycleBase(start=[0.0, 0.0, 0.0], goal=[1.0, 0.0, 90.0], **limits)
    zs.UnicycleBase(start=[0.0, 0.0, 0.0], goal=[1.0, 0.0, 4.0 * np.pi], **limits)

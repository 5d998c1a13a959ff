"""Where straight guesses fail: paths of poses that stand, and joint values at which none stands.

The turntable carries a slide of half of the machine's mass, so that the centre of mass is at half
of the slide's radius r in the direction of the slew angle: at rest it is r |sin| / 2 - 0.5 outside.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.arm import ORDINARY, random_problem
from benchmarks.problems.blocked import blocked_problem
from benchmarks.problems.robots import blocked_at, load_robot, random_problems, robots_folder
from zmp_sqp.planning.search.still_poses import StillPoses
from zmp_sqp.planning.search.task import task_of

TURNTABLE = """<robot name="turntable">
  <link name="base"><inertial><mass value="500"/>
    <inertia ixx="50" ixy="0" ixz="0" iyy="50" iyz="0" izz="50"/></inertial></link>
  <joint name="slew" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit lower="-4" upper="4" velocity="1" effort="1"/></joint>
  <link name="arm"/>
  <joint name="slide" type="prismatic"><parent link="arm"/><child link="load"/><axis xyz="1 0 0"/>
    <limit lower="{shortest}" upper="3" velocity="1" effort="1"/></joint>
  <link name="load"><inertial><mass value="500"/>
    <inertia ixx="5" ixy="0" ixz="0" iyy="5" iyz="0" izz="5"/></inertial></link>
</robot>"""
SUPPORT = zs.SupportPolygon([[-2.0, -0.5], [2.0, -0.5], [2.0, 0.5], [-2.0, 0.5]])
HALF_TURN = (0.0, 1.8), (np.pi, 1.9)  # slew [rad], slide [m]


def turntable(folder: Path, shortest: float, **options: float) -> zs.Problem:
    path = folder / "turntable.urdf"
    path.write_text(TURNTABLE.format(shortest=shortest))
    machine = zs.load_machine(path, support=SUPPORT, limits={"acceleration": 1.0})
    return zs.Problem(machine, *HALF_TURN, **options)


def never() -> bool:
    return False


def margins_of(problem: zs.Problem, q: np.ndarray) -> np.ndarray:
    still = np.zeros_like(q)
    return np.asarray(zs.stability_margin(problem.machine, q, still, still, problem.ground))


def test_a_joint_value_at_which_no_pose_stands_is_found(tmp_path: Path) -> None:
    found = StillPoses(task_of(turntable(tmp_path, 1.4))).barrier()
    assert found is not None
    assert found.joint == 0
    assert abs(found.value - 0.5 * np.pi) < np.pi / 13
    assert found.outside == pytest.approx(0.7 * np.sin(found.value) - 0.5, abs=1e-3)


def test_the_margin_counts(tmp_path: Path) -> None:
    """With r = 0.9 m the half turn is 0.05 m inside."""
    assert StillPoses(task_of(turntable(tmp_path, 0.9, margin=0.04))).barrier() is None
    found = StillPoses(task_of(turntable(tmp_path, 0.9, margin=0.07))).barrier()
    assert found is not None
    assert found.outside == pytest.approx(0.45 * np.sin(found.value) - 0.43, abs=1e-3)


def test_every_payload_counts(tmp_path: Path) -> None:
    """At r = 0.94 m a load of 60 kg is inside, one of 114 kg is not."""
    machine = turntable(tmp_path, 0.94).machine
    machine = machine.with_payload(zs.Payload(60.0, (0.0, 0.0, 0.0), "load"))
    assert StillPoses(task_of(zs.Problem(machine, *HALF_TURN))).barrier() is None
    uncertain = zs.Problem(machine, *HALF_TURN, payload_uncertainty=0.9)
    found = StillPoses(task_of(uncertain)).barrier()
    assert found is not None
    radius = 0.94 * 614.0 / 1114.0
    assert found.outside == pytest.approx(radius * np.sin(found.value) - 0.5, abs=1e-3)


def test_a_path_leads_around_through_poses_that_stand(tmp_path: Path) -> None:
    problem = turntable(tmp_path, 0.6)
    poses = StillPoses(task_of(problem))
    assert poses.barrier() is None
    path = poses.path(20_000, never)
    assert path is not None
    np.testing.assert_array_equal(path[[0, -1]], [problem.start, problem.goal])
    share = np.linspace(0.0, 1.0, 200)[:, None]
    q = np.vstack([a + share * (b - a) for a, b in pairwise(path)])
    # between two poses that stand, FINE of 8 rad and 2.4 m apart, the ZMP moves by a fraction
    assert margins_of(problem, q).min() > -0.01
    assert margins_of(problem, np.linspace(problem.start, problem.goal, 50)).min() < -0.3
    again = StillPoses(task_of(problem))
    again.barrier()
    np.testing.assert_array_equal(again.path(20_000, never), path)
    assert zs.plan(problem).success


def test_no_path_is_looked_for_beyond_what_was_asked(tmp_path: Path) -> None:
    blocked = StillPoses(task_of(turntable(tmp_path, 1.4)))
    assert blocked.path(5000, never) is None
    assert 5000 <= blocked.evaluated < 7000
    late = StillPoses(task_of(turntable(tmp_path, 0.6)))
    assert late.path(5000, lambda: True) is None
    assert late.evaluated == 2


def test_a_joint_that_cannot_move_does_no_harm(tmp_path: Path) -> None:
    """Its range from 0.0 to -0.0 is what the limits of mimic joints can leave."""
    path = tmp_path / "turntable.urdf"
    path.write_text(TURNTABLE.format(shortest=-1))
    limits = {
        "acceleration": 1.0,
        "position_upper": {"slide": -0.0},
        "position_lower": {"slide": 0.0},
    }
    machine = zs.load_machine(path, support=SUPPORT, limits=limits)
    poses = StillPoses(task_of(zs.Problem(machine, (0.0, -0.0), (np.pi, -0.0))))
    assert poses.barrier() is None
    path_found = poses.path(5000, never)
    assert path_found is not None
    assert len(path_found) == 2


def test_the_message_says_which_joint_value_is_in_the_way(tmp_path: Path) -> None:
    plan = zs.plan(turntable(tmp_path, 1.4))
    assert plan.status is zs.Status.INFEASIBLE
    assert "joint 'slew' has to pass 1.4" in plan.message or "pass 1.6" in plan.message
    assert "no pose was found that stands at rest: at best, the ZMP is 0.19" in plan.message


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_blocked_slew_is_told(seed: int) -> None:
    problem = blocked_problem(seed)
    plan = zs.plan(problem)
    assert not plan.success
    assert "joint 'slew' has to pass" in plan.message
    found = blocked_at(problem)  # by other random poses and `zs.stability_margin`
    assert found is not None
    assert found[0] == "slew"


@pytest.mark.parametrize("seed", range(6))
def test_what_has_a_slow_motion_has_no_barrier(seed: int) -> None:
    problem = random_problem(seed, ORDINARY).problem
    plan = zs.plan(problem)
    q = np.asarray(plan.trajectory(np.linspace(0.0, plan.duration, 50))[0])
    assert margins_of(problem, q).min() > 0.0
    assert StillPoses(task_of(problem)).barrier() is None


@pytest.mark.skipif(robots_folder() is None, reason="example-robot-data is not installed")
@pytest.mark.parametrize("seed", [2, 5])
def test_an_arm_on_a_tiny_base_finds_its_way_around(seed: int) -> None:
    """UR3 on its own base: the searches from straight guesses end 2.5 cm outside and more."""
    folder = robots_folder()
    assert folder is not None
    robot = load_robot(folder / "ur_description/urdf/ur3_robot.urdf", folder)
    problem = dict(random_problems(robot, seed + 1))[seed]
    plan = zs.plan(problem)
    assert plan.success, plan.message
    assert "along poses that stand" in [run.purpose for run in plan.runs]
    assert plan.certificate.safe
    t = np.linspace(0.0, plan.duration, 500)
    assert zs.stability_margin(robot.machine, *plan.trajectory(t), problem.ground).min() >= 0.0

"""What a ROS joint_trajectory_controller plays, by its own formulas, against what is certified."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import zmp_sqp as zs
from zmp_sqp.motion.interpolation import cubic_motion, linear_motion, quintic_motion
from zmp_sqp.motion.joint_trajectory import message_of
from zmp_sqp.scenario import load_scenario

MACHINE = zs.load_machine("feller_buncher")


def controller(
    times: np.ndarray,
    q: np.ndarray,
    v: np.ndarray | None,
    a: np.ndarray | None,
    t: float,
) -> tuple[np.ndarray, ...]:
    """Positions, velocities, accelerations at t, by the coefficients of ros2_controllers.

    Trajectory::interpolate_between_points of joint_trajectory_controller/src/trajectory.cpp: linear
    from positions alone, cubic with velocities, quintic with accelerations.
    """
    k = min(int(np.searchsorted(times, t, side="right")) - 1, len(times) - 2)
    T, x = times[k + 1] - times[k], t - times[k]
    p0, p1, c = q[k], q[k + 1], np.zeros((6, q.shape[1]))
    c[0] = p0
    if v is None:
        c[1] = (p1 - p0) / T
    elif a is None:
        v0, v1 = v[k], v[k + 1]
        c[1] = v0
        c[2] = (-3.0 * p0 + 3.0 * p1 - 2.0 * v0 * T - v1 * T) / T**2
        c[3] = (2.0 * p0 - 2.0 * p1 + v0 * T + v1 * T) / T**3
    else:
        v0, v1, a0, a1 = v[k], v[k + 1], a[k], a[k + 1]
        c[1], c[2] = v0, 0.5 * a0
        c[3] = (
            -20.0 * p0 + 20.0 * p1 - 3.0 * a0 * T**2 + a1 * T**2 - 12.0 * v0 * T - 8.0 * v1 * T
        ) / (2.0 * T**3)
        c[4] = (
            30.0 * p0
            - 30.0 * p1
            + 3.0 * a0 * T**2
            - 2.0 * a1 * T**2
            + 16.0 * v0 * T
            + 14.0 * v1 * T
        ) / (2.0 * T**4)
        c[5] = (-12.0 * p0 + 12.0 * p1 - a0 * T**2 + a1 * T**2 - 6.0 * v0 * T - 6.0 * v1 * T) / (
            2.0 * T**5
        )
    powers = np.arange(6)
    first = [0.0, *(i * x ** (i - 1) for i in range(1, 6))]
    second = [0.0, 0.0, *(i * (i - 1) * x ** (i - 2) for i in range(2, 6))]
    return x**powers @ c, np.array(first) @ c, np.array(second) @ c


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("rule", ["cubic", "quintic"])
def test_interpolation_is_what_the_controller_plays(rule: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.2, 0.8, 8))
    times -= times[0]
    q, v, a = (rng.normal(size=(8, 5)) for _ in range(3))
    if rule == "cubic":
        motion, given = cubic_motion(MACHINE.joint_names, times, q, v), (q, v, None)
    else:
        motion, given = quintic_motion(MACHINE.joint_names, times, q, v, a), (q, v, a)
    for t in rng.uniform(0.0, times[-1], 40):
        found, expected = motion(t), controller(times, *given, t)
        for order, (one, other) in enumerate(zip(found, expected, strict=True)):
            # terms of derivatives are up to (1 / 0.2)^order times as large
            np.testing.assert_allclose(one, other, atol=1e-12 * 30.0**order)


def test_straight_lines_are_what_the_controller_plays_from_positions_alone() -> None:
    times, rates = np.array([0.0, 0.4, 1.0]), np.array([0.1, -0.2, 0.3, 0.0, 0.05])
    q = times[:, None] * rates
    motion = linear_motion(MACHINE.joint_names, times, q)
    assert motion is not None
    for t in (0.0, 0.3, 0.7, 1.0):
        np.testing.assert_allclose(motion(t)[0], controller(times, q, None, None, t)[0], atol=1e-15)
    assert linear_motion(MACHINE.joint_names, times, q**2) is None


@pytest.fixture(scope="module")
def plan() -> zs.Plan:
    found = zs.plan(replace(load_scenario("paper_1").problem, margin=0.1))
    assert found.success
    return found


def test_an_exported_plan_that_is_played_as_cubics_is_the_certified_motion(plan: zs.Plan) -> None:
    motion = plan.trajectory
    message, rule = message_of(motion)
    points = message["points"]
    assert rule == "cubic"
    assert all(set(point) == {"positions", "velocities", "time_from_start"} for point in points)
    stamps = [point["time_from_start"] for point in points]
    times = np.array([stamp["sec"] + 1e-9 * stamp["nanosec"] for stamp in stamps])
    q, v = (np.array([point[key] for point in points]) for key in ("positions", "velocities"))
    np.testing.assert_allclose(times, motion.times, atol=5.1e-10)
    # where a node and its stamp, a nanosecond apart, disagree on which piece is played, rates
    # differ by the jump of the acceleration times a nanosecond
    for t in np.linspace(0.0, min(times[-1], motion.duration), 997):
        played, planned = controller(times, q, v, None, t), motion(t)
        np.testing.assert_allclose(played[0], planned[0], atol=1e-11)
        np.testing.assert_allclose(played[1], planned[1], atol=4e-9)


def test_with_accelerations_a_controller_plays_another_motion(plan: zs.Plan) -> None:
    """Why the export leaves them out: the quintic exceeds limits that the plan keeps."""
    motion, problem = plan.trajectory, plan.problem
    q, v, a, *_ = motion.node_rows()
    played = quintic_motion(motion.joint_names, motion.times, q, v, a)
    found = zs.certify(problem.machine, played, problem.ground, 0.1)
    assert plan.certificate.safe
    assert found.limit_excess > 0.1
    t = 0.5 * (motion.times[:-1] + motion.times[1:])
    largest = max(np.abs(controller(motion.times, q, v, a, x)[2]).max() for x in t)
    assert largest > problem.machine.limits.acceleration.min() * 1.1


@pytest.mark.parametrize("suffix", ["yaml", "json", "mcap"])
def test_exports_are_certified_as_the_plan_is(plan: zs.Plan, suffix: str, tmp_path: Path) -> None:
    if suffix == "mcap":
        pytest.importorskip("rosbags")
    path = tmp_path / f"motion.{suffix}"
    assert zs.export_motion(plan.trajectory, path) == "cubic"
    read = zs.read_motion(path, plan.problem.machine)
    assert read.rule == "cubic"
    found = zs.certify(plan.problem.machine, read.trajectory, plan.problem.ground, 0.1)
    assert found.margin == pytest.approx(plan.certificate.margin, abs=1e-6)
    assert found.margin >= 0.1
    assert found.limit_excess < 1e-6


@pytest.mark.parametrize("rate", [50.0, 100.0, 1000.0])
def test_cubics_exceed_an_acceleration_by_a_third_of_its_jump_at_any_rate(rate: float) -> None:
    """An acceleration that jumps by J at the share s of a sampling interval, docs/notes.md."""
    h, before, jump = 1.0 / rate, 0.7, -1.3
    least = most = 0.0
    for share in np.linspace(0.0, 1.0, 61):
        rest = 1.0 - share
        t = np.array([0.0, h])
        q = 0.5 * before * t**2 + np.array([0.0, 0.5 * jump * (rest * h) ** 2])
        v = before * t + np.array([0.0, jump * rest * h])
        cubic = cubic_motion(("slew",), t, q[:, None], v[:, None])
        first, last = cubic.accelerations[0, 0], cubic.end_accelerations[0, 0]
        assert first - before == pytest.approx(jump * (3.0 * rest**2 - 2.0 * rest), abs=1e-9)
        assert last - before == pytest.approx(jump * (4.0 * rest - 3.0 * rest**2), abs=1e-9)
        least = min(least, (first - before) / jump)
        most = max(most, (last - before - jump) / jump)
    assert least == pytest.approx(-1.0 / 3.0, abs=1e-9)  # at s = 2/3
    assert most == pytest.approx(1.0 / 3.0, abs=1e-9)  # at s = 1/3

"""Durations against closed forms in which the ZMP costs time (tests/problems.py)."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.checks import check_feasibility
from benchmarks.problems.scene import NamedProblem
from tests.problems import double_integrator, slew, slider, slider_time
from zmp_sqp.planning.constraints.tip_over import GUARD, GUARD_SHARE

INSIDE = 1e-6


def error(named: NamedProblem) -> float:
    """Relative to the optimum, of a plan that an independent check finds safe."""
    plan = zs.plan(named.problem)
    assert plan.success, plan.message
    assert check_feasibility(named.scene, named.problem, plan.trajectory).violation <= INSIDE
    assert plan.lower_bound <= plan.duration
    assert named.optimum is not None
    return plan.duration / named.optimum - 1.0


# --- slider -------------------------------------------------------------------------------------


def test_slider_is_within_0_2_percent_of_its_closed_form_at_100_intervals() -> None:
    assert 0.0 <= error(slider(intervals=100)) <= 2e-3


def test_slider_with_the_papers_half_length_is_within_0_2_percent() -> None:
    """a = 0.5 m as in paper.md: T* = 1.414894 s."""
    named = slider(intervals=100, half_length=0.5 * 1000.0 / 1100.0)
    assert named.optimum == pytest.approx(1.414894, abs=1e-6)
    assert 0.0 <= error(named) <= 2e-3


def test_the_sliders_error_falls_as_the_grid_grows_finer() -> None:
    """Against the optimum of a polygon smaller by the guard, which costs 0.02 % of the time."""
    support = slider().problem.machine.support
    assert support is not None
    guard = GUARD_SHARE * support.reach
    assert guard < GUARD
    least = slider_time(0.5 - guard, 0.3)
    errors = []
    for N in (25, 50, 100, 200):
        named = slider(intervals=N)
        assert named.optimum is not None
        errors.append((1.0 + error(named)) * named.optimum / least - 1.0)
    assert all(0.0 < finer < 0.6 * coarser for coarser, finer in pairwise(errors)), errors


def test_slider_follows_the_rear_edge_and_then_the_front_edge() -> None:
    named = slider(intervals=100)
    trajectory = zs.plan(named.problem).trajectory
    h = np.diff(trajectory.times)[:, None]
    q = trajectory.positions[:-1] + 0.5 * h * trajectory.velocities[:-1]
    x = zs.zmp(
        named.problem.machine,
        q,
        0.0 * q,
        trajectory.accelerations + 0.5 * h * trajectory.jerks,
        zs.Slope(),
    )
    np.testing.assert_allclose(x[:49, 0], -0.5, atol=2e-3)
    np.testing.assert_allclose(x[51:, 0], 0.5, atol=2e-3)


# --- slew on a round foot -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("radius", "limited", "optimum"),
    [(1.1, False, 5.92736), (1.3, False, 3.58273), (1.1, True, 5.92736), (1.3, True, 4.5)],
)
def test_slew_on_a_round_foot_is_within_half_a_percent_of_the_quadrature(
    radius: float, limited: bool, optimum: float
) -> None:
    named = slew(radius=radius, limited=limited, intervals=50)
    assert named.optimum == pytest.approx(optimum, abs=1e-5)  # the printed value of paper.md
    assert 0.0 <= error(named) <= 5e-3


# --- double integrator --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("distance", "max_velocity", "max_acceleration", "intervals"),
    [
        (2.0, 1.0, 2.0, 50),  # ramps of 0.5 s, 1.5 s of coasting: 10, 30, 10 intervals
        (2.0, 1.0, 2.0, 5),  # the coarsest grid that has both switching times
        (1.0, 10.0, 4.0, 50),  # bang-bang: 1 s
        (1.0, 10.0, 4.0, 2),
        (3.0, 1.0, 1.0, 100),  # ramps of 1 s in 4 s
    ],
)
def test_double_integrator_is_exact_when_its_switching_times_fall_on_the_grid(
    distance: float, max_velocity: float, max_acceleration: float, intervals: int
) -> None:
    named = double_integrator(
        distance=distance,
        max_velocity=max_velocity,
        max_acceleration=max_acceleration,
        intervals=intervals,
    )
    assert 0.0 <= error(named) <= 1e-6


def test_double_integrator_off_the_grid_is_late_by_less_than_an_interval() -> None:
    named = double_integrator(distance=2.0, max_velocity=1.0, max_acceleration=2.0, intervals=47)
    assert 0.0 <= error(named) <= 1.0 / 47.0

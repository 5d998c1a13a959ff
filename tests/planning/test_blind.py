"""The bang-coast-bang motion that ignores stability, at any time."""

from __future__ import annotations

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.paper import paper_scene
from zmp_sqp.planning.search.blind import blind_motion
from zmp_sqp.planning.search.task import task_of

TIMES = 40


@pytest.mark.parametrize("moving", [False, True])
def test_states_are_integrals_of_the_accelerations(moving: bool) -> None:
    scene = paper_scene()
    machine = scene.load()
    rng = np.random.default_rng(5)
    rates = 0.5 * moving * rng.uniform(-1.0, 1.0, (2, machine.size)) * machine.limits.velocity
    middle = 0.5 * (machine.limits.position_lower + machine.limits.position_upper)
    problem = zs.Problem(
        machine, middle, middle + 0.2, scene.ground, start_velocity=rates[0], goal_velocity=rates[1]
    )
    motion = blind_motion(task_of(problem), stretch=0.3)
    assert motion is not None
    times = motion.nodes(TIMES)
    rate, moved = motion.gained(times)
    h = np.diff(times)[:, None]
    a = motion.acceleration_at(0.5 * (times[1:] + times[:-1]))
    np.testing.assert_allclose(np.diff(rate, axis=0), h * a, atol=1e-12)
    np.testing.assert_allclose(motion.mean_accelerations(times), a, atol=1e-9)
    exact = h * rate[:-1] + 0.5 * h**2 * a
    np.testing.assert_allclose(np.diff(moved, axis=0), exact, atol=1e-12)
    way = problem.goal - problem.start
    np.testing.assert_allclose(rates[0] + rate[-1], rates[1], atol=1e-9)
    np.testing.assert_allclose(rates[0] * motion.duration + moved[-1], way, atol=1e-9)

"""Motion of one joint that takes a given time: it arrives, within the limits."""

from __future__ import annotations

import numpy as np
import pytest

from zmp_sqp.motion.double_integrator import minimum_time, timed_motion


@pytest.mark.parametrize("seed", range(300))
def test_it_takes_the_time_and_arrives_with_the_rate_that_are_asked_for(seed: int) -> None:
    rng = np.random.default_rng([73, seed])
    limits = {
        "max_velocity": float(rng.uniform(0.1, 2.0)),
        "max_acceleration": float(rng.uniform(0.05, 3.0)),
    }
    ends = rng.uniform(-1.0, 1.0, 2) * limits["max_velocity"] * rng.integers(0, 2, 2)
    rates = {"start_velocity": float(ends[0]), "goal_velocity": float(ends[1])}
    distance = float(rng.choice([-5.0, -1e-6, 0.0, 1e-6, 1.0]) * rng.uniform())
    least = minimum_time(distance, **limits, **rates).duration
    duration = least * float(rng.choice([1.0, 1.0003, 1.2, 3.0]))
    found = timed_motion(distance, duration, **limits, **rates)
    if found is None:  # with rates at the ends, not every duration above the least one is possible
        assert ends.any()
        assert duration > least
        return
    phases, accelerations = found
    assert (phases >= 0.0).all()
    assert phases.sum() == pytest.approx(duration, abs=1e-12 * duration)
    assert set(np.abs(accelerations)) <= {0.0, limits["max_acceleration"]}
    rate, covered = ends[0], 0.0
    for time, acceleration in zip(phases, accelerations, strict=True):
        covered += rate * time + 0.5 * acceleration * time**2
        rate += acceleration * time
        assert abs(rate) <= limits["max_velocity"] * (1.0 + 1e-12)
    assert covered == pytest.approx(distance, abs=1e-9)
    assert rate == pytest.approx(ends[1], abs=1e-12)

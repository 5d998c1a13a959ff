"""A search that finds nothing says what even a slow motion would violate, and comes to an end."""

from __future__ import annotations

import time

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.paper import PAPER_GOAL, PAPER_START

ROOM = 0.02  # [rad] that the arm may move either way: no more than a few centimetres of ZMP
PATIENCE = 60.0  # [s] for what takes one or three


@pytest.mark.parametrize(("mass", "roll"), [(4000.0, -20.0), (7000.0, -26.0)])
def test_the_motion_told_of_is_the_least_violating_not_the_fastest(
    mass: float, roll: float
) -> None:
    """The paper's slew with a locked arm: at any pace the tree passes over the lower track."""
    arm = zs.load_machine("feller_buncher").joint_names[1:]
    limits = {
        "position_lower": dict(zip(arm, PAPER_START[1:] - ROOM, strict=True)),
        "position_upper": dict(zip(arm, PAPER_START[1:] + ROOM, strict=True)),
    }
    tree = zs.Payload(mass=mass, com=(0.0, 0.0, 3.323), frame="head")
    machine, slope = (
        zs.load_machine("feller_buncher", limits=limits).with_payload(tree),
        zs.Slope(np.radians(roll)),
    )
    ways = PAPER_START + np.linspace(0.0, 1.0, 101)[:, None] * (PAPER_GOAL - PAPER_START)
    still = np.zeros_like(ways)
    least = -float(zs.stability_margin(machine, ways, still, still, slope).min())
    started = time.perf_counter()
    plan = zs.plan(zs.Problem(machine, PAPER_START, PAPER_GOAL, slope, intervals=10))
    # it went round in circles at a point where no step helps
    assert time.perf_counter() - started < PATIENCE
    assert plan.status is zs.Status.INFEASIBLE
    # 0.67 and 1.71 m at the fastest pace
    assert -plan.certificate.sampled == pytest.approx(least, abs=0.05)
    assert plan.attempt is not None
    assert plan.attempt.duration > 3.0 * plan.lower_bound
    outside = f"{-plan.certificate.margin:.3f} m outside the left edge"
    assert f"the ZMP would lie {outside} of the support polygon" in plan.message

"""A path by poses that tip over at rest is found, and is not slowed down without end."""

from __future__ import annotations

import numpy as np

import zmp_sqp as zs
from benchmarks.problems.checks import check_feasibility
from benchmarks.problems.scene import FOOTPRINT, Scene, Tree

# between these two any pace of the straight way in the joints tips the machine over
STEEP = Scene("feller_buncher", FOOTPRINT, Tree(5920.946), roll=-0.443663, pitch=0.126428)
HERE, THERE = (
    np.array([2.951, -1.238, -0.374, -1.332, -3.194]),
    np.array([-6.178, 0.58, -1.064, 0.732, -2.319]),
)


def test_a_way_by_poses_that_do_not_stand_is_not_slowed_down_without_end() -> None:
    """Its guess once took 57 hours; the answer's rows were too small beside that to be met."""
    problem = STEEP.problem(HERE, THERE)
    plan = zs.plan(problem)
    assert plan.success, plan.message
    assert check_feasibility(STEEP, problem, plan.trajectory).violation < 1e-6
    assert plan.duration < 1.05 * plan.lower_bound

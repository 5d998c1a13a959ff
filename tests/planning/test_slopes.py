"""Slopes set free shorten a motion about as much as all would; paths by poses that tip over."""

from __future__ import annotations

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.checks import check_feasibility
from benchmarks.problems.scene import FOOTPRINT, Scene, Tree
from zmp_sqp.planning.search import refine, slopes

SCENE = Scene("feller_buncher", FOOTPRINT, Tree(1976.87), roll=0.22477, pitch=0.28513)
START, GOAL = (
    np.array([-6.15, -1.324, -2.507, 1.678, 1.687]),
    np.array([5.635, -1.329, -0.455, -0.78, -1.592]),
)
PEERS = 15.555  # [s] of IPOPT, with constant accelerations
GAIN = 3e-3  # relative, from slopes that are set free
LEFT = 1e-3  # relative, from the others
SHARE = 0.4  # of all slopes

# between these two any pace of the straight way in the joints tips the machine over
STEEP = Scene("feller_buncher", FOOTPRINT, Tree(5920.946), roll=-0.443663, pitch=0.126428)
HERE, THERE = (
    np.array([2.951, -1.238, -0.374, -1.332, -3.194]),
    np.array([-6.178, 0.58, -1.064, 0.732, -2.319]),
)


def safely_planned() -> zs.Plan:
    problem = SCENE.problem(START, GOAL)
    plan = zs.plan(problem)
    assert plan.success
    assert check_feasibility(SCENE, problem, plan.trajectory).violation < 1e-6
    return plan


def test_slopes_set_free_shorten_the_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    widths = []

    def recorded(ties, *others):
        freed = slopes.free_slopes(ties, *others)
        widths.append((ties.shape[1], freed.shape[1] - ties.shape[1]))
        return freed

    monkeypatch.setattr(refine, "free_slopes", recorded)
    plan = safely_planned()
    ((count, freed),) = widths
    assert 0 < freed < SHARE * count
    assert plan.duration < PEERS
    with monkeypatch.context() as patch:
        patch.setattr(refine, "free_slopes", lambda ties, *others: ties)
        tied = safely_planned()
    assert plan.duration < (1.0 - GAIN) * tied.duration
    with monkeypatch.context() as patch:
        patch.setattr(slopes, "FEW_CONTROLS", 10 * count)
        free = safely_planned()
    assert len(widths) == 1
    assert (1.0 - LEFT) * plan.duration < free.duration < (1.0 + 1e-6) * plan.duration


def test_a_way_by_poses_that_do_not_stand_is_not_slowed_down_without_end() -> None:
    """Its guess once took 57 hours; the answer's rows were too small beside that to be met."""
    problem = STEEP.problem(HERE, THERE)
    plan = zs.plan(problem)
    assert plan.success, plan.message
    assert check_feasibility(STEEP, problem, plan.trajectory).violation < 1e-6
    assert plan.duration < 1.05 * plan.lower_bound

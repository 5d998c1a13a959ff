"""Models that are changed in place: nothing that was computed before may be used."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.arm import HARD, random_problem
from zmp_sqp.mechanics.bounds.effort_norms import body_norms
from zmp_sqp.mechanics.workspace import workspace_of

POSE = np.array([0.3, -0.5, -2.0, 0.5, -1.5])
RATES, ACCELERATIONS = np.full(5, 0.2), np.full(5, 0.3)


def loaded() -> zs.Machine:
    tree = zs.Payload(mass=4000.0, com=(0.0, 0.0, 3.323), frame="head")
    machine = zs.load_machine("feller_buncher").with_payload(tree)
    return replace(machine, model=machine.model.copy())


def make_heavier(machine: zs.Machine, factor: float) -> None:
    heavy = machine.with_payload_scaled(factor).model
    for joint in range(machine.model.njoints):
        machine.model.inertias[joint] = heavy.inertias[joint]


def test_a_workspace_is_kept_while_its_model_is_unchanged():
    machine = loaded()
    first = workspace_of(machine.model)
    assert workspace_of(machine.model) is first
    make_heavier(machine, 1.5)
    second = workspace_of(machine.model)
    assert second.version != first.version
    assert workspace_of(machine.model) is second
    machine.model.jointPlacements[3].translation = np.array([0.1, 0.2, 0.3])
    assert workspace_of(machine.model).version not in (first.version, second.version)


@pytest.mark.parametrize("what", ["inertia", "placement"])
def test_values_and_bounds_follow_a_model_that_is_changed_in_place(what: str):
    machine = loaded()
    state = POSE, RATES, ACCELERATIONS, zs.Slope(0.1, 0.0)
    before, norms = zs.zmp(machine, *state), body_norms([machine])
    if what == "inertia":
        make_heavier(machine, 1.5)
    else:
        machine.model.jointPlacements[3].translation = np.array([5.0, 0.2, 0.3])
    fresh = replace(machine, model=machine.model.copy())
    np.testing.assert_allclose(zs.zmp(machine, *state), zs.zmp(fresh, *state), atol=1e-12)
    assert np.abs(zs.zmp(machine, *state) - before).max() > 0.01
    assert body_norms([machine]) == body_norms([fresh]) != norms


@pytest.mark.parametrize("seed", range(300, 306))
def test_a_certificate_is_of_the_model_as_it_is(seed: int):
    problem = random_problem(seed, HARD).problem
    machine = replace(problem.machine, model=problem.machine.model.copy())
    plan = zs.plan(replace(problem, machine=machine))
    make_heavier(machine, 1.4)
    now, fresh = (
        zs.certify(one, plan.trajectory, problem.ground)
        for one in (machine, replace(machine, model=machine.model.copy()))
    )
    assert now.margin == fresh.margin
    assert now.margin < plan.certificate.margin - 1e-3

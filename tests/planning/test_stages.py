"""Columns and maps of the staged program's variables, and the clipping of curvature."""

from __future__ import annotations

import numpy as np
import pytest

from tests.planning.programs import GRIDS, ROUNDING, arm_case, driving_case, somewhere
from zmp_sqp.planning.program.grid import Grid
from zmp_sqp.planning.program.staged import Motion, StagedProgram
from zmp_sqp.planning.program.stages import STATE


@pytest.fixture(params=[(base, grid) for base in ("stands", "drives") for grid in GRIDS])
def program(request: pytest.FixtureRequest) -> StagedProgram:
    base, grid = request.param
    if base == "drives":
        return driving_case(moving=True, grid=GRIDS[grid])
    return arm_case("feller_buncher", moving=True, grid=GRIDS[grid]).program


def mapped_variables(program: StagedProgram, point: Motion) -> np.ndarray:
    """(x_k, next coordinates and rates, sigma) of all stages, in the programs' scale, (N, m)."""
    scaled = point.states / STATE
    sigma = np.full((program.grid.size, 1), point.sigma)
    return np.hstack([scaled[:-1], scaled[1:, : 2 * program.n], sigma])


def test_maps_by_mapped_variables_are_products_of_the_two_maps(program: StagedProgram) -> None:
    """The cubics of Hermite's data against integrals of the accelerations."""
    stages = program.stages
    for found, by_stage in zip(
        stages.mapped, (stages.at_start, stages.at_end, stages.at_middle), strict=True
    ):
        expected = by_stage @ stages.hermite
        np.testing.assert_allclose(found, expected, atol=1e-13 * np.abs(expected).max())


def test_accelerations_follow_from_the_states_at_both_ends(program: StagedProgram) -> None:
    """The cubic of Hermite's data."""
    stages, point = program.stages, somewhere(program)
    variables = mapped_variables(program, point)
    found = np.einsum(
        "kij,kj->ki",
        np.broadcast_to(stages.hermite, (program.grid.size, stages.m, stages.m)),
        variables,
    )
    expected = np.hstack([point.states[:-1], point.controls, variables[:, -1:]])
    np.testing.assert_allclose(found, expected, atol=1e-11)


@pytest.mark.parametrize("s", [0.0, 0.3, 0.5, 1.0])
def test_the_state_map_is_the_motion_at_a_share_of_the_intervals(
    program: StagedProgram, s: float
) -> None:
    stages, point = program.stages, somewhere(program)
    q, w, controls, S = program.unpack(point)
    N = program.grid.size
    stage = np.hstack([point.states[:-1], point.controls, np.full((N, 1), point.sigma)])
    found = np.einsum(
        "kij,kj->ki", np.broadcast_to(stages.state_map(s), (N, 3 * program.n + 1, stages.m)), stage
    )
    expected = np.hstack([*program.grid.within(s, q[:-1], w[:-1], controls), np.full((N, 1), S)])
    np.testing.assert_allclose(found, expected, atol=1e-11)


def test_mapped_state_maps_take_the_programs_variables(program: StagedProgram) -> None:
    stages, point = program.stages, somewhere(program)
    q, w, controls, S = program.unpack(point)
    variables, N = mapped_variables(program, point), program.grid.size
    for part, s in zip(stages.mapped, (0.0, 1.0, 0.5), strict=True):
        found = np.einsum("kij,kj->ki", np.broadcast_to(part, (N, *part.shape[1:])), variables)
        states = program.grid.within(s, q[:-1], w[:-1], controls)
        expected = np.hstack([*states, np.full((N, 1), S)])
        np.testing.assert_allclose(found, expected, atol=1e-10)


def test_accelerations_by_the_states_of_their_joint(program: StagedProgram) -> None:
    stages, point, n = program.stages, somewhere(program), program.n
    x = point.states / STATE
    data = np.stack([x[:-1, :n], x[:-1, n : 2 * n], x[1:, :n], x[1:, n : 2 * n]], axis=-1)
    found = np.einsum("kijc,kjc->kij", stages.control_entries, data)
    np.testing.assert_allclose(found.reshape(program.grid.size, -1), point.controls, atol=1e-11)


def test_every_variable_is_one_entry_of_a_state_or_sigma(program: StagedProgram) -> None:
    stages = program.stages
    used = stages.columns[stages.columns >= 0]
    assert len(used) == len(set(used.tolist())) == stages.size - 1
    assert set(used.tolist()) == set(range(stages.size - 1))
    assert (stages.columns[0] == -1).all()  # the start is given
    last = stages.columns[-1]
    free = np.flatnonzero(last >= 0)  # the goal, too, but for the length of a base's path
    assert free.tolist() == ([program.n - 2] if stages.positions else [])
    assert (stages.stage_columns[:, -1] == stages.size - 1).all()


def test_the_middle_map_is_a_basis_times_a_triangle(program: StagedProgram) -> None:
    Q, R = program.stages.middle_factors
    eye = np.eye(Q.shape[2])
    np.testing.assert_allclose(
        Q.transpose(0, 2, 1) @ Q, np.broadcast_to(eye, (len(Q), *eye.shape)), atol=ROUNDING
    )
    expected = program.stages.at_middle.transpose(0, 2, 1)
    np.testing.assert_allclose(Q @ R, expected, atol=ROUNDING * float(np.abs(expected).max()))


def test_the_number_of_variables_is_what_the_docstring_says() -> None:
    arm = arm_case("feller_buncher", moving=False, grid=Grid.of(7)).program
    assert arm.size == 6 * 10 + 1
    driving = driving_case(moving=False, grid=Grid.of(7))
    assert driving.size == 6 * (14 + 2) + 1 + 1

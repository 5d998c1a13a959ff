"""Rows of the limits hold everywhere: their Bernstein points bound rates and positions."""

from __future__ import annotations

import numpy as np
import pytest

from tests.planning.programs import GRIDS, ROUNDING, arm_case, driving_case, somewhere
from zmp_sqp.planning.program.limits import FAR
from zmp_sqp.planning.program.staged import LINEAR_TOLERANCE, StagedProgram

SHARES = np.linspace(0.0, 1.0, 201)


@pytest.fixture(params=[(base, grid) for base in ("stands", "drives") for grid in GRIDS])
def program(request: pytest.FixtureRequest) -> StagedProgram:
    base, grid = request.param
    if base == "drives":
        return driving_case(moving=True, grid=GRIDS[grid])
    return arm_case("feller_buncher", moving=True, grid=GRIDS[grid]).program


def by_group(program: StagedProgram, seed: int) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Values of the rows by group of the docstring's order, and dense samples (q, w, alpha)."""
    limits, point = program.limits, somewhere(program, seed)
    values = limits.values(point.states, point.controls, point.sigma)
    sizes = np.cumsum([len(group) for group in limits.columns])[:-1]
    q, w, controls, _ = program.unpack(point)
    dense = [program.grid.within(s, q[:-1], w[:-1], controls) for s in SHARES]
    return np.split(values, sizes), [np.stack(parts) for parts in zip(*dense, strict=True)]


@pytest.mark.parametrize("seed", range(5))
def test_no_rate_between_the_nodes_exceeds_its_limit_by_more_than_the_rows_say(
    program: StagedProgram, seed: int
) -> None:
    groups, (_, w, _) = by_group(program, seed)
    sigma, stages, n = somewhere(program, seed).sigma, program.stages, program.n
    limit = program.limits.rate * np.sqrt(sigma)
    given = np.abs(np.vstack([program.first, program.last])) * np.sqrt(sigma) - limit
    for sign, nodes, middle in ((1.0, groups[2], groups[4]), (-1.0, groups[3], groups[5])):
        over = (sign * w / stages.rate_scale - limit).max(axis=(0, 1))
        bound = np.vstack([nodes.reshape(-1, n), middle.reshape(-1, n), given]).max(axis=0)
        assert (over <= bound + ROUNDING).all()


@pytest.mark.parametrize("seed", range(5))
def test_no_position_between_the_nodes_exceeds_its_limit_by_more_than_the_rows_say(
    program: StagedProgram, seed: int
) -> None:
    """The rows are inner Bernstein points; nodes lie between those of their neighbours."""
    groups, (q, _, _) = by_group(program, seed)
    bounds, limits = program.bounds, program.limits
    ends = np.vstack([program.start.q, program.goal.q])
    sides = (
        (limits.upper, lambda at: at - bounds.position_upper, (groups[6], groups[8])),
        (limits.lower, lambda at: bounds.position_lower - at, (groups[7], groups[9])),
    )
    for which, excess, rows in sides:
        at_ends = excess(ends)[:, which]
        if program.drive is not None:  # the path's length at the goal is not given
            at_ends = at_ends[:, which < program.n - 2]
            which = which[which < program.n - 2]
        over = excess(q)[:, :, which].max(axis=(0, 1))
        bound = [part.reshape(program.grid.size, -1)[:, : len(which)].max(axis=0) for part in rows]
        assert (over <= np.vstack([*bound, at_ends]).max(axis=0) + ROUNDING).all()


def test_acceleration_rows_are_the_accelerations_at_both_ends_less_their_limits(
    program: StagedProgram,
) -> None:
    groups, (_, _, alpha) = by_group(program, 0)
    sigma, n = somewhere(program, 0).sigma, program.n
    limit = program.bounds.acceleration * sigma * program.reference**2
    for sign, rows in ((1.0, groups[0]), (-1.0, groups[1])):
        found = rows.reshape(-1, 2, n) * program.control_scale
        ends = np.stack([alpha[0], alpha[-1]], axis=1)
        np.testing.assert_allclose(found, sign * ends - limit, atol=1e-10)


def test_limits_that_are_far_away_have_no_rows() -> None:
    program = driving_case(moving=False, grid=GRIDS["uniform"])
    far = np.abs(program.bounds.position_upper) >= FAR
    assert far.tolist() == [False] * 5 + [True] * 2
    assert set(program.limits.upper.tolist()) == set(range(5))


def test_position_bounds_of_a_base_are_imposed_at_the_inner_nodes() -> None:
    program = driving_case(moving=False, grid=GRIDS["uneven"])
    groups, _ = by_group(program, 1)
    p = somewhere(program, 1).states[1:-1, program.stages.places]
    for bound, found in zip(program.limits.position_bounds, groups[10:-1], strict=True):
        np.testing.assert_allclose(
            found, bound.sign * p[:, bound.axis] - bound.bound, atol=ROUNDING
        )


def test_the_tolerances_are_those_of_the_rows(program: StagedProgram) -> None:
    tolerance = program.tolerance
    per_stage = tolerance[: program.nonlinear].reshape(-1, program.rows.count)
    np.testing.assert_array_equal(per_stage, np.tile(program.rows.tolerance, (len(per_stage), 1)))
    assert (tolerance[program.nonlinear :] == LINEAR_TOLERANCE).all()

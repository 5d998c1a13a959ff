"""Grids of normalised time, and motions whose accelerations run linearly within intervals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from zmp_sqp.planning.program.grid import Grid, hermite_shapes, shapes

ROUNDING = 1e-12
UNEVEN = np.array([0.0, 0.07, 0.3, 0.5, 0.55, 1.0])


@pytest.fixture(params=[5, UNEVEN], ids=["uniform", "uneven"])
def grid(request: pytest.FixtureRequest) -> Grid:
    return Grid.of(request.param)


def random_controls(grid: Grid, n: int = 3) -> np.ndarray:
    return np.random.default_rng(0).normal(size=(grid.size, 2, n))


def acceleration(grid: Grid, controls: np.ndarray, s: float) -> np.ndarray:
    """By interpolation, with no other code of the grid than its nodes."""
    k = min(int(np.searchsorted(grid.nodes, s, side="right")) - 1, grid.size - 1)
    share = (s - grid.nodes[k]) / (grid.nodes[k + 1] - grid.nodes[k])
    return np.asarray((1.0 - share) * controls[k, 0] + share * controls[k, 1])


def test_shapes_are_a_line_and_its_first_and_second_integrals() -> None:
    for s in (0.0, 0.3, 1.0):
        level, once, twice = shapes(s)
        for i in range(2):
            rate = quad(lambda t, i=i: shapes(t)[0][i], 0.0, s)[0]
            moved = quad(lambda t, i=i: shapes(t)[1][i], 0.0, s)[0]
            assert once[i] == pytest.approx(rate, abs=ROUNDING)
            assert twice[i] == pytest.approx(moved, abs=ROUNDING)
        assert level.sum() == pytest.approx(1.0, rel=ROUNDING)


def test_hermite_shapes_interpolate_every_cubic() -> None:
    for coefficients in np.eye(4):
        cubic = np.polynomial.Polynomial(coefficients)
        derivatives = [cubic, cubic.deriv(), cubic.deriv(2)]
        ends = [derivatives[i](end) for end in (0.0, 1.0) for i in range(2)]
        for s in (0.0, 0.3, 0.5, 1.0):
            expected = [one(s) for one in derivatives]
            np.testing.assert_allclose(hermite_shapes(s) @ ends, expected, atol=ROUNDING)


def test_rolled_states_are_integrals_of_the_accelerations(grid: Grid) -> None:
    controls, q, w = random_controls(grid), np.array([0.3, -1.0, 2.0]), np.array([1.0, 0.0, -2.0])
    positions, rates = grid.rolled(q, w, controls)
    for j in range(3):
        of_joint = [
            quad(lambda s, j=j: acceleration(grid, controls, s)[j], a, b)[0]
            for a, b in zip(grid.nodes[:-1], grid.nodes[1:], strict=True)
        ]
        np.testing.assert_allclose(rates[1:, j], w[j] + np.cumsum(of_joint), atol=1e-10)

        def rate(s: float, k: int, j: int = j) -> float:
            return float(
                rates[k, j]
                + quad(lambda t: acceleration(grid, controls, t)[j], grid.nodes[k], s)[0]
            )

        moved = [
            quad(rate, grid.nodes[k], grid.nodes[k + 1], args=(k,))[0] for k in range(grid.size)
        ]
        np.testing.assert_allclose(positions[1:, j], q[j] + np.cumsum(moved), atol=1e-10)


def test_states_within_intervals_join_the_nodes(grid: Grid) -> None:
    controls = random_controls(grid)
    q, w = grid.rolled(np.zeros(3), np.ones(3), controls)
    at_start = grid.within(0.0, q[:-1], w[:-1], controls)
    at_end = grid.within(1.0, q[:-1], w[:-1], controls)
    for found, expected in zip(at_start, (q[:-1], w[:-1], controls[:, 0]), strict=True):
        np.testing.assert_allclose(found, expected, atol=ROUNDING)
    for found, expected in zip(at_end, (q[1:], w[1:], controls[:, 1]), strict=True):
        np.testing.assert_allclose(found, expected, atol=ROUNDING)
    step = 1e-5
    behind, here, ahead = (
        grid.within(s, q[:-1], w[:-1], controls) for s in (0.4 - step, 0.4, 0.4 + step)
    )
    h = 2.0 * step * grid.steps[:, None]
    np.testing.assert_allclose((ahead[0] - behind[0]) / h, here[1], atol=1e-8)
    np.testing.assert_allclose((ahead[1] - behind[1]) / h, here[2], atol=1e-8)


def test_sums_are_what_unit_accelerations_add_at_the_end(grid: Grid) -> None:
    controls = random_controls(grid, 1)
    q, w = grid.rolled(np.zeros(1), np.zeros(1), controls)
    np.testing.assert_allclose(grid.sums @ controls.ravel(), [q[-1, 0], w[-1, 0]], atol=ROUNDING)


def test_least_changes_add_what_is_wanted_and_no_smaller_change_does(grid: Grid) -> None:
    wanted = np.array([[0.4, -1.0], [2.0, 0.3]])
    change = grid.least_changes @ wanted
    np.testing.assert_allclose(grid.sums @ change, wanted, atol=ROUNDING)
    smallest = np.linalg.lstsq(grid.sums, wanted, rcond=None)[0]
    np.testing.assert_allclose(change, smallest, atol=ROUNDING)


@pytest.mark.parametrize("factor", [1, 2, 3])
def test_a_motion_is_the_same_on_a_nested_grid(grid: Grid, factor: int) -> None:
    shares = np.linspace(0.0, 1.0, factor + 1)[:-1]
    nodes = (grid.nodes[:-1, None] + shares * grid.steps[:, None]).ravel()
    fine = Grid.of(np.append(nodes, 1.0))
    controls = random_controls(grid)
    moved = grid.on(fine, controls)
    for at, found in zip((fine.nodes[:-1], fine.nodes[1:]), moved.transpose(1, 0, 2), strict=True):
        inside = at + 1e-9 * (0.5 - (at > fine.nodes[:-1])) * fine.steps  # at a jump: its own side
        expected = [acceleration(grid, controls, s) for s in inside]
        np.testing.assert_allclose(found, expected, atol=1e-7)
    q, w = grid.rolled(np.zeros(3), np.ones(3), controls)
    fine_q, fine_w = fine.rolled(np.zeros(3), np.ones(3), moved)
    np.testing.assert_allclose(fine_q[::factor], q, atol=ROUNDING)
    np.testing.assert_allclose(fine_w[::factor], w, atol=ROUNDING)


def test_a_line_stays_a_line_on_any_grid() -> None:
    """Projection of accelerations on a grid that does not nest keeps what it can represent."""
    grid, other = Grid.of(5), Grid.of(UNEVEN)
    line = np.stack([2.0 - 3.0 * grid.nodes[:-1], 2.0 - 3.0 * grid.nodes[1:]], axis=1)[:, :, None]
    expected = np.stack([2.0 - 3.0 * other.nodes[:-1], 2.0 - 3.0 * other.nodes[1:]], axis=1)
    np.testing.assert_allclose(grid.on(other, line)[:, :, 0], expected, atol=ROUNDING)


def test_a_motion_on_a_grid_that_does_not_nest_nearly_arrives() -> None:
    """What it misses is the error of eight samples per interval, second order in their distance."""
    grid, other = Grid.of(50), Grid.of(70)
    s = grid.nodes
    controls = np.stack([np.sin(5.0 * s[:-1]), np.sin(5.0 * s[1:])], axis=1)[:, :, None]
    before = grid.sums @ controls.ravel()
    after = other.sums @ grid.on(other, controls).ravel()
    np.testing.assert_allclose(after, before, atol=1e-3 * float(np.abs(before).max()) + 1e-4)


def test_parents_hold_the_middles_of_finer_intervals(grid: Grid) -> None:
    fine = Grid.of(23)
    parents = grid.parents(fine)
    middles = fine.nodes[:-1] + 0.5 * fine.steps
    assert (grid.nodes[parents] <= middles).all()
    assert (middles <= grid.nodes[parents + 1]).all()

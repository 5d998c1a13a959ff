"""Sparse matrices of a fixed pattern, against scipy's."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from zmp_sqp.sqp.rows import Pattern, Rows

SHAPE = (7, 5)


def random_entries(seed: int, *, repeated: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    count = 30 if repeated else 12
    place = rng.choice(SHAPE[0] * SHAPE[1], count, replace=repeated)
    return place // SHAPE[1], place % SHAPE[1], rng.normal(size=count)


@pytest.mark.parametrize("repeated", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_a_pattern_makes_the_matrix_that_scipy_makes(seed: int, repeated: bool) -> None:
    rows, columns, entries = random_entries(seed, repeated=repeated)
    pattern = Pattern(rows, columns, SHAPE)
    expected = sp.coo_matrix((entries, (rows, columns)), shape=SHAPE).toarray()
    found = pattern.matrix(pattern.data(entries))
    assert found.has_sorted_indices
    np.testing.assert_allclose(found.toarray(), expected, rtol=0.0, atol=1e-15)
    again = pattern.matrix(pattern.data(2.0 * entries))
    np.testing.assert_allclose(again.toarray(), 2.0 * expected, rtol=0.0, atol=1e-15)


def test_entries_of_variables_that_are_given_are_left_out() -> None:
    rows, columns, entries = random_entries(0, repeated=True)
    given = columns == 2
    pattern = Pattern(rows, np.where(given, -1, columns), SHAPE)
    kept = sp.coo_matrix((entries[~given], (rows[~given], columns[~given])), shape=SHAPE)
    found = pattern.matrix(pattern.data(entries)).toarray()
    np.testing.assert_allclose(found, kept.toarray(), rtol=0.0, atol=1e-15)
    assert not found[:, 2].any()
    assert found.any()


def test_an_upper_pattern_keeps_the_upper_triangle() -> None:
    index = np.arange(5)
    rows, columns = np.repeat(index, 5), np.tile(index, 5)
    entries = np.random.default_rng(1).normal(size=25)
    pattern = Pattern(rows, columns, (5, 5), upper=True)
    full = entries.reshape(5, 5)
    np.testing.assert_array_equal(pattern.matrix(pattern.data(entries)).toarray(), np.triu(full))


@pytest.mark.parametrize("seed", range(5))
def test_selected_rows_are_those_that_scipy_selects(seed: int) -> None:
    rng = np.random.default_rng(seed)
    matrix = sp.random(40, 12, density=0.3, format="csc", random_state=rng)
    rows, step = Rows(matrix), rng.normal(size=12)
    np.testing.assert_allclose(rows @ step, matrix.toarray() @ step)
    for mask in (rng.random(40) < 0.4, np.ones(40, dtype=bool), np.zeros(40, dtype=bool)):
        found = rows.selected(mask)
        assert found.shape == (int(mask.sum()), 12)
        np.testing.assert_array_equal(found.toarray(), matrix.toarray()[mask])

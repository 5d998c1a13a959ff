"""Rigorous bounds on the derivatives of a spline surface over boxes of (x, y)."""

from __future__ import annotations

from math import comb, factorial

import numpy as np

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.mechanics.terrain.spline_surface import DEGREE, WIDTH, SplineSurface

__all__ = ["BOUND_ORDERS", "derivative_bounds"]

# derivatives 1..5 of the height are bounded: the third derivative of the base's angular velocity
# contains the fifth
BOUND_ORDERS = 5
# pairs of a box and a cell, above which a single box around all boxes is bounded instead, to limit
# time and memory
MOST_PAIRS = 500_000

_CHOOSE = np.array([[comb(m, k) for k in range(WIDTH)] for m in range(WIDTH)], dtype=np.float64)


def derivative_bounds(surface: SplineSurface, low: Array, high: Array, *, rim: float) -> Array:
    r"""Bounds on the norms of the first five derivatives of a surface h over K boxes.

    .. math::
        \Big(\sum_i \binom{k}{i} \max |\partial_x^i \partial_y^{k-i} h|^2\Big)^{1/2}, \quad
        k = 1, \dots, 5

    bounds the norm of the k-th derivative as a multilinear form. Within a cell between the knots
    each partial derivative is a polynomial, whose values lie between the least and the largest of
    its Bernstein coefficients.

    Args:
        surface: Spline surface.
        low, high: Lowest and highest (x, y) of the boxes, shape (K, 2) [m]; parts of a box off the
            surface do not count.
        rim: Distance by which the outermost cells extend beyond the surface [m].

    Returns:
        Bound on the k-th derivative in row k - 1, shape (5, K) [m^(1 - k)].
    """
    first, last = (surface.cells(corner) for corner in (low, high))  # (K, 2)
    size = last - first + 1
    if not len(first):
        return np.zeros((BOUND_ORDERS, 0))
    if len(low) > 1 and size.prod(axis=1).sum() > MOST_PAIRS:
        one = derivative_bounds(surface, low.min(axis=0)[None], high.max(axis=0)[None], rim=rim)
        return np.repeat(one, len(low), axis=1)
    counts = size.prod(axis=1)
    ends = np.cumsum(counts)
    number = np.arange(ends[-1]) - np.repeat(ends - counts, counts)  # of each cell within its box
    width = np.repeat(size[:, 1], counts)
    column = np.repeat(first[:, 0], counts) + number // width
    row = np.repeat(first[:, 1], counts) + number % width
    rows = surface.patches.shape[1]
    cells, index = np.unique(column * rows + row, return_inverse=True)  # boxes may overlap
    found = _cell_bounds(surface, cells // rows, cells % rows, rim)
    return np.maximum.reduceat(found[:, index.ravel()], ends - counts, axis=1)


def _cell_bounds(surface: SplineSurface, column: Indices, row: Indices, rim: float) -> Array:
    """Bounds on the norms of the first five derivatives over C cells, shape (5, C)."""
    # each column and each row is computed once
    (x, of_x), (y, of_y) = (np.unique(index, return_inverse=True) for index in (column, row))
    to_x, to_y = (_bernstein(*surface.pieces(axis, span, rim)) for axis, span in enumerate((x, y)))
    squares = np.zeros((BOUND_ORDERS, len(column)))
    patches = surface.patches[column, row]
    for i in range(DEGREE + 1):
        half = to_x[i][of_x] @ patches  # (C, 6 - i, 6)
        for j in range(max(0, 1 - i), DEGREE + 1 - i):
            coefficients = half @ to_y[j][of_y].transpose(0, 2, 1)
            squares[i + j - 1] += comb(i + j, i) * np.abs(coefficients).max(axis=(1, 2)) ** 2
    return np.asarray(np.sqrt(squares))


def _bernstein(basis: Array, start: Array, end: Array) -> list[Array]:
    """Matrices from spline coefficients to Bernstein coefficients of derivatives, over s spans.

    Args:
        basis: Polynomials of the basis functions: coefficient by power of (x - left knot) and by
            basis function, shape (s, 6, 6).
        start, end: Start and end of the spans, measured from their left knots, shape (s,) [m].

    Returns:
        One array for each derivative i = 0..5, shape (s, 6 - i, 6).
    """
    length = end - start
    powers = np.arange(WIDTH)
    shift = _CHOOSE.T * start[:, None, None] ** np.maximum(powers[None, :] - powers[:, None], 0)
    # coefficients by power of (x - start) / length
    scaled = (shift * length[:, None, None] ** powers[:, None]) @ basis
    maps = []
    for i in range(DEGREE + 1):
        degree = DEGREE - i
        fall = np.array([factorial(m + i) / factorial(m) for m in range(degree + 1)])
        to_bernstein = _CHOOSE[: degree + 1, : degree + 1] / np.array(
            [comb(degree, m) for m in range(degree + 1)]
        )
        maps.append((to_bernstein * fall) @ scaled[:, i:] / length[:, None, None] ** i)
    return maps

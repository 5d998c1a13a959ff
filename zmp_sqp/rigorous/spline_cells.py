"""The surface of a heightmap as exact polynomials on its cells, in balls."""

from __future__ import annotations

from typing import Any

import numpy as np

from zmp_sqp.mechanics.terrain.heightmap import Heightmap
from zmp_sqp.rigorous.balls import above, below

__all__ = ["Cell", "SplineCells"]

DEGREE = 5
Cell = tuple[int, int]  # index of the span along x and y


class SplineCells:
    """Spline of degree five whose coefficients count as exact; its basis is computed in balls."""

    def __init__(self, flint: Any, ground: Heightmap) -> None:
        """Read knots and coefficients of a heightmap."""
        self._flint, self._surface = flint, ground._surface
        self._breaks = (ground._surface._x.breaks, ground._surface._y.breaks)
        self._bases: dict[tuple[int, int], Any] = {}
        self._cells: dict[Cell, tuple[Any, Any, list[list[Any]]]] = {}

    def over(self, x: Any, y: Any) -> list[Cell]:
        """Cells that a box touches, beyond the map the outermost ones."""
        spans = []
        for breaks, ball in zip(self._breaks, (x, y), strict=True):
            ends = [below(ball), above(ball)]
            if not np.isfinite(ends).all():
                return []
            first, last = np.searchsorted(breaks[1:-1], ends, side="right").tolist()
            spans.append(range(first, last + 1))
        return [(i, j) for i in spans[0] for j in spans[1]]

    def gradient(self, cell: Cell, x: Any, y: Any) -> tuple[Any, Any]:
        """Derivatives of the height by x and y at series x and y, by the polynomial of a cell."""
        left_x, left_y, P = self._polynomial(cell)
        X, Y = _powers(x - left_x), _powers(y - left_y)
        by_x: Any = None
        by_y: Any = None
        for a in range(DEGREE + 1):
            inner = P[a][0]
            slope = P[a][1]
            for b in range(1, DEGREE + 1):
                inner = inner + P[a][b] * Y[b]
                if b > 1:
                    slope = slope + b * P[a][b] * Y[b - 1]
            term = slope if a == 0 else slope * X[a]
            by_y = term if by_y is None else by_y + term
            if a > 0:
                term = inner if a == 1 else a * inner * X[a - 1]
                by_x = term if by_x is None else by_x + term
        return by_x, by_y

    def _polynomial(self, cell: Cell) -> tuple[Any, Any, list[list[Any]]]:
        """Left knots of a cell, and the coefficients of its polynomial by powers of x and y."""
        if cell not in self._cells:
            flint, size = self._flint, DEGREE + 1
            patch = self._surface.patches[cell]
            values = flint.arb_mat([[float(v) for v in row] for row in patch.tolist()])
            found = self._basis(0, cell[0]) * values * self._basis(1, cell[1]).transpose()
            table = [[found[a, b] for b in range(size)] for a in range(size)]
            left = (flint.arb(float(self._breaks[axis][cell[axis]])) for axis in (0, 1))
            self._cells[cell] = (*left, table)
        return self._cells[cell]

    def _basis(self, axis: int, span: int) -> Any:
        r"""Six basis functions of a span by powers of the distance from its left knot.

        .. math:: N_{j,d} = u_{j,d} N_{j,d-1} + (1 - u_{j+1,d}) N_{j+1,d-1}, \quad
            u_{j,d}(x) = \frac{x - t_j}{t_{j+d} - t_j}

        (Cox-de Boor). Returns an `arb_mat`: powers in rows, basis functions in columns.
        """
        key = axis, span
        if key in self._bases:
            return self._bases[key]
        flint, breaks = self._flint, self._breaks[axis].tolist()
        knots = [flint.arb(t) for t in [breaks[0]] * DEGREE + breaks + [breaks[-1]] * DEGREE]
        at = DEGREE + span
        columns = [flint.arb_poly([1])]
        for degree in range(1, DEGREE + 1):
            raised = [flint.arb_poly([0]) for _ in range(degree + 1)]
            for b in range(degree):
                start, end = knots[at - degree + 1 + b], knots[at + 1 + b]
                width = end - start
                share = flint.arb_poly([(knots[at] - start) / width, 1 / width])
                raised[b + 1] = raised[b + 1] + share * columns[b]
                raised[b] = raised[b] + (1 - share) * columns[b]
            columns = raised
        rows = [[column[m] for column in columns] for m in range(DEGREE + 1)]
        self._bases[key] = flint.arb_mat(rows)
        return self._bases[key]


def _powers(x: Any) -> list[Any]:
    """Powers 0 to `DEGREE` of a series; the first is not used."""
    found = [1, x]
    for _ in range(DEGREE - 1):
        found.append(found[-1] * x)
    return found

"""Quintic spline through samples on a regular grid, with all its derivatives at once."""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial

import numpy as np

from zmp_sqp.arrays import Array, Indices

__all__ = ["DEGREE", "ORDERS", "SplineSurface"]

# four continuous derivatives: the fourth enters the derivatives of the base's acceleration
DEGREE = 5
ORDERS = 5  # derivatives 0..4 in each direction
WIDTH = DEGREE + 1  # basis functions that differ from zero within a span

_POWERS = np.arange(WIDTH)
# (orders, powers) exponent after differentiation
_DROP = np.maximum(_POWERS[None, :] - np.arange(ORDERS)[:, None], 0)
_FALL = np.array(  # (orders, powers) factor m! / (m - d)! that differentiation leaves
    [
        [factorial(m) / factorial(m - d) if m >= d else 0.0 for m in range(WIDTH)]
        for d in range(ORDERS)
    ]
)


@dataclass(frozen=True, slots=True, eq=False)
class _Axis:
    """One direction: spans between the knots, and the basis functions within each as polynomials.

    Attributes:
        breaks: Distinct knots, shape (spans + 1,) [m].
        basis: Coefficients by power of (x - left knot) and by basis function, shape (spans, 6, 6).
    """

    breaks: Array
    basis: Array

    @classmethod
    def of_knots(cls, knots: Array) -> _Axis:
        r"""Polynomials of the B-spline basis, by the recursion of Cox and de Boor on their coefficients.

        .. math:: N_{j,d} = u_{j,d} N_{j,d-1} + (1 - u_{j+1,d}) N_{j+1,d-1}, \quad
            u_{j,d}(x) = \frac{x - t_j}{t_{j+d} - t_j}
        """
        breaks = knots[DEGREE:-DEGREE]
        left = np.arange(DEGREE, DEGREE + len(breaks) - 1)  # knot at the left end of each span
        basis = np.zeros((len(left), WIDTH, WIDTH))
        basis[:, 0, 0] = 1.0
        for degree in range(1, DEGREE + 1):
            raised = np.zeros_like(basis)
            for b in range(degree):  # basis function j = left - degree + 1 + b of the degree below
                start, end = knots[left - degree + 1 + b], knots[left + 1 + b]
                share = ((knots[left] - start) / (end - start))[:, None] * basis[:, :, b]
                share[:, 1:] += basis[:, :-1, b] / (end - start)[:, None]  # times (x - left knot)
                raised[:, :, b + 1] += share
                raised[:, :, b] += basis[:, :, b] - share
            basis = raised
        return cls(breaks, basis)

    def spans(self, x: Array) -> Indices:
        """Which span each point lies in, shape (K,); beyond the outermost knots the outermost spans."""
        return np.searchsorted(self.breaks[1:-1], x, side="right")

    def pieces(self, span: Indices, rim: float) -> tuple[Array, Array, Array]:
        """Polynomials of some spans, shape (s, 6, 6), and where they begin and end from their left knots, (s,) each.

        The first span begins, and the last one ends, `rim` further out [m].
        """
        last = len(self.breaks) - 2
        end = self.breaks[span + 1] - self.breaks[span] + np.where(span == last, rim, 0.0)
        return self.basis[span], np.where(span == 0, -rim, 0.0), end

    def derivatives(self, x: Array) -> tuple[Indices, Array]:
        """First basis function of each point, shape (K,), and derivatives 0..4 of six of them, shape (K, 5, 6)."""
        span = self.spans(x)
        powers = (x - self.breaks[span])[:, None] ** _POWERS  # (K, powers)
        return span, (_FALL * powers[:, _DROP]) @ self.basis[span]


@dataclass(frozen=True, slots=True, eq=False)
class SplineSurface:
    """Tensor-product spline of degree five: four continuous derivatives, the fifth jumps at the knots.

    The knots are the samples, but for the two next to either end ("not a knot"). Outside the
    samples the outermost polynomials go on.

    Attributes:
        patches: The coefficients of the six by six basis functions that matter from span to span, a
            view of shape (spans along x, spans along y, 6, 6) [m].
    """

    patches: Array
    _x: _Axis
    _y: _Axis

    @classmethod
    def through(cls, values: Array, x: Array, y: Array) -> SplineSurface:
        """Interpolate.

        Args:
            values: At (x[column], y[row]), shape (ny, nx), at least six of either [m].
            x, y: Increasing, shape (nx,) and (ny,) [m].
        """
        from scipy.interpolate import make_interp_spline  # slow to import, and only needed here

        along_y = make_interp_spline(y, values, k=DEGREE, axis=0)
        along_x = make_interp_spline(x, along_y.c, k=DEGREE, axis=1)
        # (nx, ny): SciPy leaves the interpolated axis in front
        coefficients = np.ascontiguousarray(along_x.c)
        patches = np.lib.stride_tricks.sliding_window_view(coefficients, (WIDTH, WIDTH))
        return cls(patches, _Axis.of_knots(along_x.t), _Axis.of_knots(along_y.t))

    def derivatives(self, x: Array, y: Array) -> Array:
        """All derivatives up to the fourth in either direction; [:, i, j] is i times by x and j times by y.

        Args:
            x, y: Shape (K,) [m].

        Returns:
            Shape (K, 5, 5).
        """
        column, by_x = self._x.derivatives(x)
        row, by_y = self._y.derivatives(y)
        along_x = by_x @ self.patches[column, row]  # (K, 5, 6)
        return np.asarray(along_x @ np.ascontiguousarray(by_y.transpose(0, 2, 1)))

    def cells(self, places: Array) -> Indices:
        """Spans along x and y of the nearest places on the surface, shape (K, 2)."""
        return np.column_stack([self._x.spans(places[:, 0]), self._y.spans(places[:, 1])])

    def pieces(self, axis: int, span: Indices, rim: float) -> tuple[Array, Array, Array]:
        """Of some spans along x (axis 0) or y (axis 1), as `_Axis.pieces`."""
        return (self._x, self._y)[axis].pieces(span, rim)

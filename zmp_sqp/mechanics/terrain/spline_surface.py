"""Quintic spline surface through samples on a grid, evaluated together with its derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial

import numpy as np

from zmp_sqp.arrays import Array, Indices

__all__ = ["DEGREE", "ORDERS", "SplineSurface"]

# degree of the spline: its fourth derivative is continuous, and the derivatives of the base's
# acceleration contain it
DEGREE = 5
ORDERS = 5  # number of derivatives 0..4 that are evaluated in each direction
WIDTH = DEGREE + 1  # number of basis functions that are not zero within a span

_POWERS = np.arange(WIDTH)
# exponent m - d of x^m after d differentiations, shape (orders, powers)
_DROP = np.maximum(_POWERS[None, :] - np.arange(ORDERS)[:, None], 0)
_FALL = np.array(  # factor m! / (m - d)! of x^m after d differentiations, shape (orders, powers)
    [
        [factorial(m) / factorial(m - d) if m >= d else 0.0 for m in range(WIDTH)]
        for d in range(ORDERS)
    ]
)


@dataclass(frozen=True, slots=True, eq=False)
class _Axis:
    """B-spline basis of one direction, as polynomials on the spans between the knots.

    Attributes:
        breaks: Distinct knots, shape (spans + 1,) [m].
        basis: Coefficients of the six basis functions of each span: by span, by power of
            (x - left knot), by basis function; shape (spans, 6, 6).
    """

    breaks: Array
    basis: Array

    @classmethod
    def of_knots(cls, knots: Array) -> _Axis:
        r"""Basis for given knots, by the Cox-de Boor recursion on polynomial coefficients.

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
        """Index of the span that contains each point x (K,), or of the nearest span, shape (K,)."""
        return np.searchsorted(self.breaks[1:-1], x, side="right")

    def pieces(self, span: Indices, rim: float) -> tuple[Array, Array, Array]:
        """Basis polynomials of s spans, and the ends of these spans.

        Args:
            span: Indices of the spans, shape (s,).
            rim: Distance by which the first and the last span extend beyond the outermost knots
                [m].

        Returns:
            Coefficients as in `basis`, shape (s, 6, 6); start and end of each span, measured from
            its left knot, shape (s,) each [m].
        """
        last = len(self.breaks) - 2
        end = self.breaks[span + 1] - self.breaks[span] + np.where(span == last, rim, 0.0)
        return self.basis[span], np.where(span == 0, -rim, 0.0), end

    def derivatives(self, x: Array) -> tuple[Indices, Array]:
        """Basis functions that are not zero at points x (K,), with derivatives 0..4.

        Returns:
            Index of the first of the six basis functions, shape (K,), and their derivatives, shape
            (K, 5, 6).
        """
        span = self.spans(x)
        powers = (x - self.breaks[span])[:, None] ** _POWERS  # (K, powers)
        return span, (_FALL * powers[:, _DROP]) @ self.basis[span]


@dataclass(frozen=True, slots=True, eq=False)
class SplineSurface:
    """Tensor-product spline of degree five: the fourth derivative is continuous, the fifth jumps.

    The knots are the samples except for the two next to either end ("not-a-knot" end condition).
    Beyond the outermost samples the outermost polynomials continue.

    Attributes:
        patches: Coefficients of the 6 x 6 basis functions that are not zero on each cell, a view of
            shape (spans along x, spans along y, 6, 6) [m].
    """

    patches: Array
    _x: _Axis
    _y: _Axis

    @classmethod
    def through(cls, values: Array, x: Array, y: Array) -> SplineSurface:
        """Interpolating surface through samples on a grid.

        Args:
            values: Sample at (x[column], y[row]), shape (ny, nx), at least six in either direction
                [m].
            x, y: Increasing coordinates of the samples, shapes (nx,) and (ny,) [m].
        """
        from scipy.interpolate import make_interp_spline  # slow to import, and only needed here

        along_y = make_interp_spline(y, values, k=DEGREE, axis=0)
        along_x = make_interp_spline(x, along_y.c, k=DEGREE, axis=1)
        # (nx, ny): SciPy moves the interpolated axis to the front
        coefficients = np.ascontiguousarray(along_x.c)
        patches = np.lib.stride_tricks.sliding_window_view(coefficients, (WIDTH, WIDTH))
        return cls(patches, _Axis.of_knots(along_x.t), _Axis.of_knots(along_y.t))

    def derivatives(self, x: Array, y: Array) -> Array:
        """Derivatives up to the fourth in each direction at K points.

        Args:
            x, y: Coordinates of the points, shape (K,) [m].

        Returns:
            Entry [:, i, j] is the derivative i times by x and j times by y, shape (K, 5, 5)
            [m^(1 - i - j)].
        """
        column, by_x = self._x.derivatives(x)
        row, by_y = self._y.derivatives(y)
        along_x = by_x @ self.patches[column, row]  # (K, 5, 6)
        return np.asarray(along_x @ np.ascontiguousarray(by_y.transpose(0, 2, 1)))

    def cells(self, points: Array) -> Indices:
        """Span along x and span along y that contain, or are nearest to, each point, shape (K, 2).

        Args:
            points: (x, y), shape (K, 2) [m].
        """
        return np.column_stack([self._x.spans(points[:, 0]), self._y.spans(points[:, 1])])

    def pieces(self, axis: int, span: Indices, rim: float) -> tuple[Array, Array, Array]:
        """Basis polynomials and ends of spans along x (axis 0) or y (1); see `_Axis.pieces`."""
        return (self._x, self._y)[axis].pieces(span, rim)

"""Ball arithmetic by FLINT: its modules, directed rounding, Bernstein control points."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from math import comb, inf, nextafter
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.errors import MissingExtra

__all__ = ["ORDER", "above", "below", "bernstein", "flint_module", "least_of", "working"]

PRECISION = 64  # bits of the midpoints of balls: one machine word
# Number of Taylor coefficients of a stretch; one more bounds the remainder. Lower orders need more
# stretches, higher ones longer series
ORDER = 8


def flint_module() -> Any:
    """Module `flint`.

    Raises:
        MissingExtra: python-flint is not installed.
    """
    try:
        import flint
    except ImportError:
        raise MissingExtra(
            "ball arithmetic needs python-flint: `pip install zmp-sqp[proof]`, or "
            "`pip install python-flint`"
        ) from None
    return flint


@contextmanager
def working(length: int) -> Iterator[Any]:
    """FLINT with `PRECISION` bits and series of at most `length` coefficients.

    FLINT's context is global; it is as before afterwards.

    Args:
        length: Number of coefficients of every series.
    """
    flint = flint_module()
    before = flint.ctx.prec, flint.ctx.cap
    flint.ctx.prec, flint.ctx.cap = PRECISION, length
    try:
        yield flint
    finally:
        flint.ctx.prec, flint.ctx.cap = before


def below(ball: Any) -> float:
    """Largest float that is certainly below a ball; -inf for one that is not finite."""
    return nextafter(float(ball.lower()), -inf) if ball.is_finite() else -inf


def above(ball: Any) -> float:
    """Least float that is certainly above a ball; inf for one that is not finite."""
    return nextafter(float(ball.upper()), inf) if ball.is_finite() else inf


@lru_cache(maxsize=8)
def bernstein(length: int) -> Any:
    r"""Matrix from the powers of u on [-1, 1] to Bernstein control points, of FLINT's balls.

    With :math:`u = 2 s - 1`, a polynomial :math:`\sum_k c_k u^k` of the degree n has the control
    points :math:`b = B c` on [0, 1], and lies within their range there.

    Args:
        length: Number n + 1 of coefficients.

    Returns:
        `arb_mat` of the shape (n + 1, n + 1).
    """
    flint, n = flint_module(), length - 1
    # rows: control points; columns: powers of u, exact integers over binomials
    entries = []
    for i in range(length):
        row = []
        for k in range(length):
            # u^k = sum_j comb(k, j) 2^j (-1)^(k - j) s^j, and s^j has comb(i, j) / comb(n, j)
            total = flint.fmpq(0)
            for j in range(min(i, k) + 1):
                whole = comb(k, j) * 2**j * (-1) ** (k - j) * comb(i, j)
                total += flint.fmpq(whole, comb(n, j))
            row.append(flint.arb(total))
        entries.append(row)
    return flint.arb_mat(entries)


def least_of(flint: Any, rows: Sequence[Sequence[Any]], radius: Any) -> Array:
    r"""Lower bounds of polynomials in s on |s| <= radius, shape (R,).

    Args:
        flint: Module.
        rows: Balls of the coefficients of 1, s, s^2, ... of each polynomial; the same number each.
        radius: Ball of the radius.
    """
    length = len(rows[0])
    powers = [flint.arb(1)]
    for _ in range(length - 1):
        powers.append(powers[-1] * radius)
    scaled = [[row[k] * powers[k] for row in rows] for k in range(length)]
    control = (bernstein(length) * flint.arb_mat(scaled)).table()
    return np.array([min(below(points[r]) for points in control) for r in range(len(rows))])

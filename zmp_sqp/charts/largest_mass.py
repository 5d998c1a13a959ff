"""The largest mass with which rows that are affine in it hold over an arc of slew angles."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from zmp_sqp.arrays import Array

__all__ = ["harmonics", "largest_mass"]

ROUNDING = 1e-12  # share of a row's size that counts as zero
FULL_CIRCLE = 2.0 * np.pi * (1.0 - 1e-9)  # [rad]


def harmonics(samples: Array) -> Array:
    r"""Coefficients of a + b cos(t) + c sin(t) from values at t = 0, 2 pi / 3, -2 pi / 3.

    At rest, ground reaction and joint torques are such functions of the angle by which an arm slews
    about the vertical: the arm's weight turns in the machine, and gravity in the arm.

    Args:
        samples: Values at the three angles, shape (3, ...).

    Returns:
        Coefficients, shape (..., 3).
    """
    angles = np.array([0.0, 2.0 * np.pi / 3.0, -2.0 * np.pi / 3.0])
    weights = np.array([np.ones(3), 2.0 * np.cos(angles), 2.0 * np.sin(angles)]) / 3.0
    return np.asarray(np.moveaxis(np.tensordot(weights, samples, axes=1), 0, -1))


def largest_mass(base: Array, load: Array, lower: Array, upper: Array) -> tuple[Array, Array]:
    r"""Largest mass m for which a row holds at all slew angles of an arc, in closed form.

    .. math:: (base + m\, load) \cdot (1, \cos t, \sin t) \le 0, \quad lower \le t \le upper

    At a fixed angle the row is affine in m. The worst angle of a full circle has the value
    :math:`a_0 + m a_1 + \lVert b_0 + m b_1 \rVert`, which is convex in m and zero where a quadratic
    is. The worst angle of an arc is that one, or an end of the arc.

    Args:
        base: Coefficients without the mass, shape (..., 3).
        load: Coefficients per mass, shape (..., 3).
        lower: First angle of the arc, broadcast to shape (...) [rad]; NaN if there is no arc.
        upper: Last angle, equal to the first for a fixed angle [rad].

    Returns:
        Largest mass at least 0, shape (...) [unit of 1 / load]: inf where every mass keeps the row,
        0 where the row is broken without mass, NaN without an arc. And the value of the row
        without mass at the worst angle, shape (...).
    """
    shape = np.broadcast_shapes(base.shape[:-1], np.shape(lower))
    base, load = (np.broadcast_to(row, (*shape, 3)) for row in (base, load))
    lower, upper = (np.broadcast_to(end, shape) for end in (lower, upper))
    mass, worst = np.full(shape, np.inf), np.full(shape, -np.inf)
    for angle in (lower, upper):
        direction = np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=-1)
        at_rest, growth = (base * direction).sum(axis=-1), (load * direction).sum(axis=-1)
        small = ROUNDING * np.abs(load).sum(axis=-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            mass = np.where(growth > small, np.minimum(mass, -at_rest / growth), mass)
        worst = np.maximum(worst, at_rest)
    inner, inner_worst = _inside(base, load, lower, upper)
    mass, worst = np.minimum(mass, inner), np.maximum(worst, inner_worst)
    broken = worst > ROUNDING * np.abs(base).sum(axis=-1)
    mass = np.where(broken, 0.0, np.maximum(mass, 0.0))
    return np.where(np.isnan(lower), np.nan, mass), np.where(np.isnan(lower), np.nan, worst)


def _inside(base: Array, load: Array, lower: Array, upper: Array) -> tuple[Array, Array]:
    """Largest mass and worst value where the worst angle lies within an arc; inf, -inf elsewhere.

    Arguments as in `largest_mass`.
    """
    a, b = base[..., 0], base[..., 1:]
    da, db = load[..., 0], load[..., 1:]
    mass = np.full(a.shape, np.inf)
    for root in _roots(da**2 - (db**2).sum(-1), a * da - (b * db).sum(-1), a**2 - (b**2).sum(-1)):
        with np.errstate(invalid="ignore"):
            amplitude = b + root[..., None] * db
            size = np.abs(a) + np.abs(root * da)
            # the quadratic is also zero where the least value of the row is
            true = (root >= 0.0) & (a + root * da <= 1e-9 * size)
        true &= _within(amplitude, lower, upper)
        larger = ~np.isfinite(mass) | (root > mass)
        mass = np.where(true & larger, root, mass)
    growth = da + np.linalg.norm(db, axis=-1)  # per mass, of the worst angle of a huge mass
    mass = np.where(growth > ROUNDING * np.abs(load).sum(axis=-1), mass, np.inf)
    peak = np.where(_within(b, lower, upper), a + np.linalg.norm(b, axis=-1), -np.inf)
    return mass, peak


def _within(amplitude: Array, lower: Array, upper: Array) -> npt.NDArray[np.bool_]:
    """Whether b cos t + c sin t is greatest within the arc."""
    angle = np.arctan2(amplitude[..., 1], amplitude[..., 0])
    around = upper - lower >= FULL_CIRCLE
    return np.asarray(around | ((angle - lower) % (2.0 * np.pi) <= upper - lower))


def _roots(square: Array, half: Array, constant: Array) -> tuple[Array, Array]:
    """Roots of square m^2 + 2 half m + constant, without cancellation; NaN where there is none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        discriminant = half**2 - square * constant
        size = half**2 + np.abs(square * constant)
        discriminant = np.where(np.abs(discriminant) <= ROUNDING * size, 0.0, discriminant)
        stable = -(half + np.where(half < 0.0, -1.0, 1.0) * np.sqrt(discriminant))
        return stable / square, constant / stable

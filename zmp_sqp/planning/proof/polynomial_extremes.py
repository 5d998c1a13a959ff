"""Largest values of piecewise polynomials, by their control points: nothing is missed."""

from __future__ import annotations

from math import comb

import numpy as np

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.motion.trajectory import Trajectory

__all__ = ["joint_extremes", "largest_values"]

# [relative to one plus the largest value] by which the bound may exceed a value that is attained
TIGHTNESS = 1e-12
MOST_HALVINGS = 50  # of an interval; its length is 1e-15 of the interval's then
EPSILON = float(np.finfo(float).eps)
OPERATIONS = 64.0  # rounding errors that add up in a control point, with room to spare


def joint_extremes(trajectory: Trajectory) -> tuple[Array, Array]:
    """Bounds on the largest q, -q, |v| and |a| of every joint, and when they are nearly attained.

    Args:
        trajectory: The motion, whose accelerations may be cubics in the intervals.

    Returns:
        Bounds and times, shape (4, n) each.
    """
    h = np.diff(trajectory.times)[:, None]
    zero = np.zeros_like(trajectory.jerks)
    snaps, crackles = (
        zero if part is None else part for part in (trajectory.snaps, trajectory.crackles)
    )
    terms = [
        trajectory.positions[:-1],
        trajectory.velocities[:-1],
        trajectory.accelerations,
        trajectory.jerks,
        snaps,
        crackles,
    ]
    found = []
    for order in range(3):  # coefficients of powers of (t - t_k) / h: derivatives h^i / i!
        scaled, factor = [], np.ones_like(h)
        for i, term in enumerate(terms[order:]):
            scaled.append(term * factor)
            factor = factor * h / (i + 1.0)
        coefficients = np.stack(scaled)  # (degree + 1, N, n)
        found.append([largest_values(sign * coefficients) for sign in (1.0, -1.0)])
    values, intervals, shares = (
        np.stack([found[order][side][part] for order in range(3) for side in (0, 1)])
        for part in range(3)
    )  # (6, n) each
    times = trajectory.times[intervals] + shares * h[intervals, 0]
    rows = [0, 1]
    for first in (2, 4):
        larger = values[first] >= values[first + 1]
        for part in (values, times):
            part[first] = np.where(larger, part[first], part[first + 1])
        rows.append(first)
    return np.asarray(values[rows]), np.asarray(times[rows])


def largest_values(coefficients: Array) -> tuple[Array, Indices, Array]:
    """Bounds on the largest values of n piecewise polynomials over N intervals.

    A polynomial is at most as large as the largest of its control points (Bernstein coefficients).
    Intervals in which this is more than an attained value are halved by de Casteljau's algorithm,
    until it is not.

    Args:
        coefficients: Of powers of x, 0 <= x <= 1 in each interval, shape (degree + 1, N, n).

    Returns:
        Bounds, shape (n,), at most `TIGHTNESS` (1 + |bound|) and rounding above a value that is
        attained; index of the interval of this value, shape (n,); and its x, shape (n,).
    """
    degree, (count, n) = len(coefficients) - 1, coefficients.shape[1:]
    control = np.tensordot(_to_bernstein(degree), coefficients, axes=1).reshape(degree + 1, -1)
    rounding = OPERATIONS * EPSILON * np.abs(coefficients).sum(axis=0).max(axis=0)
    interval, owner = (part.ravel() for part in np.indices((count, n)))
    start, length = np.zeros(len(owner)), np.ones(len(owner))
    best, bound = np.full(n, -np.inf), np.full(n, -np.inf)
    at, share = np.zeros(n, dtype=int), np.zeros(n)
    for halvings in range(MOST_HALVINGS + 1):
        for end, value in ((0.0, control[0]), (1.0, control[-1])):
            for piece in _largest_of_each(value, owner, best):
                joint = owner[piece]
                best[joint], at[joint] = value[piece], interval[piece]
                share[joint] = start[piece] + end * length[piece]
        upper = control.max(axis=0)
        loose = upper > best[owner] + TIGHTNESS * (1.0 + np.abs(best[owner]))
        if halvings == MOST_HALVINGS:
            loose[:] = False
        np.maximum.at(bound, owner[~loose], upper[~loose])
        if not loose.any():
            break
        control = np.hstack(_halves(control[:, loose]))
        interval, owner = np.tile(interval[loose], 2), np.tile(owner[loose], 2)
        length = np.tile(0.5 * length[loose], 2)
        start = np.tile(start[loose], 2)
        start[len(start) // 2 :] += length[len(start) // 2 :]
    return np.maximum(bound, best) + rounding, at, share


def _largest_of_each(values: Array, owner: Indices, best: Array) -> list[int]:
    """For each owner that has a value above its best one, the index of the largest."""
    above = np.flatnonzero(values > best[owner])
    if not len(above):
        return []
    order = above[np.lexsort((values[above], owner[above]))]
    last = np.append(np.diff(owner[order]) != 0, True)
    return [int(piece) for piece in order[last]]


def _halves(control: Array) -> tuple[Array, Array]:
    """Control points of the left and the right halves, by de Casteljau's algorithm."""
    left, right, row = [control[0]], [control[-1]], control
    while len(row) > 1:
        row = 0.5 * (row[:-1] + row[1:])
        left.append(row[0])
        right.append(row[-1])
    return np.stack(left), np.stack(right[::-1])


def _to_bernstein(degree: int) -> Array:
    """Matrix from coefficients of powers of x, with x in [0, 1], to control points."""
    return np.array(
        [
            [comb(i, k) / comb(degree, k) if k <= i else 0.0 for k in range(degree + 1)]
            for i in range(degree + 1)
        ]
    )

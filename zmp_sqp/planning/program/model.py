"""What a stage of the transcription sees of the machine: coordinates, wrench, derivatives, curvature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.wrench import ground_reaction, ground_reaction_derivatives
from zmp_sqp.planning.problem.simplified import DistanceLimits, LumpedMass

__all__ = ["ArmModel", "StageModel", "extra_curvature", "wrench_curvature"]

DIFFERENCE = 1e-6  # [rad, m] forward step on analytic derivatives; error of second order in it


@dataclass(frozen=True, slots=True, eq=False)
class ArmModel:
    r"""The arm on a standing base, in coordinates y that drive its joints.

    Everything is in normalised time s = t/T: w = T v, alpha = T^2 a, S = T^2, so that the wrench
    times S is

    .. math:: M(q) \alpha + h(q, w) - S M_{root}(q) g

    inverse dynamics with gravity scaled by S: affine in (alpha, S), quadratic in w. Arguments and
        derivatives below are
    those of the coordinates: q, w, alpha stand for y, y' and y''.

    Attributes:
        machine: The machine.
        gravity: In the root frame, shape (3,) [m/s^2].
        coordinates: From y to the joints.
        distance: Lumped mass and the bounds on its distance (the paper's way with the simplified
            model), or None.
    """

    machine: Machine
    gravity: Array
    coordinates: Coordinates
    distance: tuple[LumpedMass, DistanceLimits] | None = None

    @property
    def size(self) -> int:
        """Number n of coordinates."""
        return self.coordinates.size

    def wrench(
        self, q: Array, w: Array, alpha: Array, S: float, places: Array | None = None
    ) -> Array:
        """S times the ground reaction wrench, shape (K, 6) [N s^2, N m s^2]; the base stands, so places are ignored."""
        return ground_reaction(
            self.machine, *self._joints(q, w, alpha), root_acceleration=self._root(S)
        )

    def wrench_derivatives(
        self, q: Array, w: Array, alpha: Array, S: float, places: Array | None = None
    ) -> tuple[Array, Array]:
        """The same with its derivatives by (q, w, alpha, S), shapes (K, 6) and (K, 6, 3n + 1)."""
        joints, G = self._joints(q, w, alpha), self.coordinates.G
        found = ground_reaction_derivatives(self.machine, *joints, root_acceleration=self._root(S))
        by_root = found.wrt_acceleration[:, :, :3] @ -self.gravity
        by_joints = (
            found.wrt_position,
            found.wrt_velocity[:, :, 6:],
            found.wrt_acceleration[:, :, 6:],
        )
        return found.wrench, np.concatenate(
            [*(part @ G for part in by_joints), by_root[:, :, None]], axis=2
        )

    @property
    def parts(self) -> tuple[StageModel, ...]:
        """Itself: it has one wrench."""
        return (self,)

    @property
    def extra_rows(self) -> int:
        """Number of rows of `extra`."""
        return 0 if self.distance is None else 4

    def extra(self, q: Array, w: Array, alpha: Array, S: float) -> tuple[Array, Array]:
        """Other rows than the wrench's, not positive where they hold, with slopes, (K, R) and (K, R, 3n + 1).

        With distance bounds: |d'| <= v sqrt(S) and |d''| <= a S of the lumped mass, each divided by
            its bound.
        """
        count, n = q.shape
        if self.distance is None:
            return np.zeros((count, 0)), np.zeros((count, 0, 3 * n + 1))
        lumped, limits = self.distance
        boom, rate, push, root = q[:, 1], w[:, 1], alpha[:, 1], np.sqrt(S)
        first, second, third = lumped.derivatives(boom)
        slopes = np.zeros((count, 2, 3 * n + 1))
        slopes[:, 0, 1], slopes[:, 0, n + 1] = second * rate, first
        slopes[:, 1, 1], slopes[:, 1, n + 1] = second * push + third * rate**2, 2.0 * second * rate
        slopes[:, 1, 2 * n + 1] = first
        values = np.column_stack([first * rate, first * push + second * rate**2])
        bounds, by_S = (
            np.array([limits.velocity * root, limits.acceleration * S]),
            np.zeros((2, 3 * n + 1)),
        )
        by_S[:, -1] = 0.5 * limits.velocity / root, limits.acceleration
        scale = np.tile([limits.velocity, limits.acceleration], 2)
        rows = np.hstack([values - bounds, -values - bounds]) / scale
        return rows, np.concatenate([slopes - by_S, -slopes - by_S], axis=1) / scale[:, None]

    def extra_curvature(self, q: Array, w: Array, alpha: Array, S: float, weights: Array) -> Array:
        r"""Second derivatives of `weights . extra` by (q, w, alpha, S), weights (K, R), shape (K, 3n + 1, 3n + 1).

        .. math:: \nabla^2 (d_1 w): \; d_3 w, d_2; \quad
                  \nabla^2 (d_1 \alpha + d_2 w^2): \; d_3 \alpha + d_4 w^2, 2 d_3 w, d_2, 2 d_2

        with d_i the i-th derivative of d by the boom angle: entries by (q, q), (q, w), then (q,
        alpha), (w, w).
        """
        count, n = q.shape
        H = np.zeros((count, 3 * n + 1, 3 * n + 1))
        if self.distance is None:
            return H
        lumped, limits = self.distance
        boom, rate, push = q[:, 1], w[:, 1], alpha[:, 1]
        _, second, third = lumped.derivatives(boom)
        fourth = -second  # d is a sine of the boom angle
        of_rate, of_push = (
            (weights[:, :2] - weights[:, 2:]) / [limits.velocity, limits.acceleration]
        ).T
        by_boom, by_rate, by_push = 1, n + 1, 2 * n + 1
        H[:, by_boom, by_boom] = of_rate * third * rate + of_push * (
            third * push + fourth * rate**2
        )
        H[:, by_boom, by_rate] = H[:, by_rate, by_boom] = (
            of_rate * second + 2.0 * of_push * third * rate
        )
        H[:, by_boom, by_push] = H[:, by_push, by_boom] = of_push * second
        H[:, by_rate, by_rate] = 2.0 * of_push * second
        H[:, -1, -1] = 0.25 * (weights[:, 0] + weights[:, 2]) / S**1.5  # of -sqrt(S)
        return H

    def _joints(self, q: Array, w: Array, alpha: Array) -> tuple[Array, Array, Array]:
        return self.coordinates.joints(q), self.coordinates.rates(w), self.coordinates.rates(alpha)

    def _root(self, S: float) -> Array:
        return np.concatenate([-S * self.gravity, np.zeros(3)])


class StageModel(Protocol):
    """What the transcription asks of a stage, in normalised time, at K states of n coordinates."""

    @property
    def size(self) -> int:
        """Number n of coordinates."""

    @property
    def parts(self) -> tuple[StageModel, ...]:
        """V models of one wrench each: their wrenches stand one below the other where a shape below says 6."""

    @property
    def extra_rows(self) -> int:
        """Number of rows of `extra`."""

    def wrench(
        self, q: Array, w: Array, alpha: Array, S: float, places: Array | None = None
    ) -> Array:
        """S times the ground reaction wrench, shape (K, 6) [N s^2, N m s^2]; a base that drives is at places (K, 2)."""

    def wrench_derivatives(
        self, q: Array, w: Array, alpha: Array, S: float, places: Array | None = None
    ) -> tuple[Array, Array]:
        """The same with its derivatives by (q, w, alpha, S, and places if there are), (K, 6) and (K, 6, 3n + 1 + m)."""

    def extra(self, q: Array, w: Array, alpha: Array, S: float) -> tuple[Array, Array]:
        """Other rows, not positive where they hold, with slopes, (K, R) and (K, R, 3n + 1)."""


def extra_curvature(
    model: StageModel, q: Array, w: Array, alpha: Array, S: float, weights: Array
) -> Array:
    """Second derivatives of `weights . extra` by (q, w, alpha, S), shape (K, 3n + 1, 3n + 1): those of the arm's model.

    Other models have no such rows, or none that are curved. The rows know no payload: those of the
    first part count.
    """
    arm = model.parts[0]
    if isinstance(arm, ArmModel):
        return arm.extra_curvature(q, w, alpha, S, weights)
    return np.zeros((len(q), 3 * q.shape[1] + 1, 3 * q.shape[1] + 1))


def wrench_curvature(
    model: StageModel,
    q: Array,
    w: Array,
    alpha: Array,
    S: float,
    weights: Array,
    places: Array | None = None,
) -> Array:
    """Second derivatives of `weights . wrench` by (q, w, alpha, S), from differences of the analytic first ones.

    Args:
        model: Stage model.
        q, w, alpha: Shape (K, n) each.
        S: Squared duration [s^2].
        weights: Shape (K, 6 V).
        places: Of the base, shape (K, 2); None where they do not matter.

    Returns:
        Symmetric, shape (K, 3n + 1, 3n + 1); the block of (alpha, S) is zero because the wrench is
        affine in them.
    """
    count, n = q.shape
    if len(model.parts) > 1:
        H = np.zeros((count, 3 * n + 1, 3 * n + 1))
        for part, share in zip(
            model.parts, np.split(weights, len(model.parts), axis=1), strict=True
        ):
            held = np.flatnonzero(share.any(axis=1))
            if len(held):
                H[held] += wrench_curvature(part, q[held], w[held], alpha[held], S, share[held])
        return H
    steps = np.vstack([np.zeros((1, n)), DIFFERENCE * np.eye(n), np.zeros((n, n))])
    rates = np.vstack([np.zeros((1 + n, n)), np.eye(n)])  # quadratic in w: any step is exact
    shifted_q = (q[:, None] + steps).reshape(-1, n)
    shifted_w = (w[:, None] + rates).reshape(-1, n)
    repeated = np.repeat(alpha, len(steps), axis=0)
    where = None if places is None else np.repeat(places, len(steps), axis=0)
    slopes = model.wrench_derivatives(shifted_q, shifted_w, repeated, S, where)[1][
        :, :, : 3 * n + 1
    ]
    slopes = np.einsum("kr,kprj->kpj", weights, slopes.reshape(count, len(steps), 6, 3 * n + 1))
    change = slopes[:, 1:] - slopes[:, :1]
    H = np.zeros((count, 3 * n + 1, 3 * n + 1))
    H[:, :n] = change[:, :n] / DIFFERENCE
    H[:, :n, :n] = 0.5 * (H[:, :n, :n] + H[:, :n, :n].transpose(0, 2, 1))
    H[:, n:, :n] = H[:, :n, n:].transpose(0, 2, 1)
    ww = change[:, n:, n : 2 * n]
    H[:, n : 2 * n, n : 2 * n] = 0.5 * (ww + ww.transpose(0, 2, 1))
    return H

"""Rated loads of an arm in given poses: tipping and joint torques are affine in the load's mass."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.charts.arm import Arm
from zmp_sqp.charts.largest_mass import harmonics, largest_mass
from zmp_sqp.mechanics import Ground, Machine, Payload
from zmp_sqp.mechanics.wrench import WRENCH, efforts

__all__ = ["ALL_ROUND", "NOTHING", "SECTORS", "TIPPING", "StaticLoads", "StaticRows"]

# azimuths of the lift point over which a load holds; of several arcs, the worst one counts
SECTORS = ("front", "side", "all round")
ALL_ROUND = 2  # index of the last sector
AZIMUTHS = (0.0, 0.5 * np.pi, -0.5 * np.pi)  # [rad] arcs of one angle; one all round follows
ARCS_OF_SECTORS = (slice(0, 1), slice(1, 3), slice(3, 4))
TIPPING, NOTHING = -1, -2  # limits of a load that are no joint
SLEW_ANGLES = (0.0, 2.0 * np.pi / 3.0, -2.0 * np.pi / 3.0)  # of `harmonics` [rad]


@dataclass(frozen=True, slots=True, eq=False)
class StaticLoads:
    """Loads in P poses and S sectors, shape (P, S) each; NaN where the slew joint cannot turn to.

    Attributes:
        rated: Lesser share of `tipping` and `torque`, see `StaticRows.loads` [kg].
        tipping: Load at which the machine tips over; 0 if it does so without a load [kg].
        torque: Load at which a joint reaches its effort limit [kg].
        limit: What limits `rated`: index of a planned joint, `TIPPING`, or `NOTHING`.
        violation: Largest relative violation without a load, negative where there is none.
    """

    rated: Array
    tipping: Array
    torque: Array
    limit: Indices
    violation: Array


@dataclass(frozen=True, slots=True, eq=False)
class StaticRows:
    r"""Edges of the support polygon and effort limits as rows base + attachment + m load <= 0.

    The base is the machine without its attachment. Each row is a function a + b cos t + c sin t of
    the slew coordinate t.

    Attributes:
        arm: The arm.
        ground: Ground on which the machine stands.
        payload: A load of 1 kg.
        attachment: Links that are part of the load.
        bare: The machine without attachment and load.
        loaded: The machine with attachment and a load of its own mass.
        efforts: Indices of the joints whose effort limits count, shape (E,).
        tipping_fraction: Share of the load that tips the machine over that may be lifted.
        torque_fraction: Share of the load that the joints can hold that may be lifted.
    """

    arm: Arm
    ground: Ground
    payload: Payload
    attachment: tuple[str, ...]
    bare: Machine
    loaded: Machine
    efforts: Indices
    tipping_fraction: float
    torque_fraction: float

    @classmethod
    def of(
        cls,
        arm: Arm,
        ground: Ground,
        payload: Payload,
        attachment: tuple[str, ...],
        *,
        tipping_fraction: float,
        torque_fraction: float,
    ) -> StaticRows:
        """Rows of an arm.

        Args:
            arm: The arm.
            ground: Ground on which the machine stands.
            payload: A load of 1 kg.
            attachment: Links that are part of the load.
            tipping_fraction: Share of the load that tips the machine over that may be lifted.
            torque_fraction: Share of the load that the joints can hold that may be lifted.
        """
        machine = arm.machine
        heavy = replace(payload, mass=machine.mass, inertia=None)
        carrying = np.array(sorted([arm.slew, *arm.joints]), dtype=np.intp)
        return cls(
            arm,
            ground,
            payload,
            attachment,
            machine.with_massless(attachment) if attachment else machine,
            replace(machine, model=heavy.attached_to(machine.model)),
            carrying[~np.isnan(machine.limits.effort[carrying])],
            tipping_fraction,
            torque_fraction,
        )

    def loads(self, q: Array) -> StaticLoads:
        r"""Rated, tipping and torque loads.

        With the share phi of a limit, the load m is the largest with

        .. math:: \varphi\, base + attachment + m\, load \le 0

        that is, the machine without its attachment stands up to 1 / phi times attachment and load.
        For an attachment whose weight acts at the lift point this is the rule of ISO 10567: phi
        times the load at the lift point without attachment, less the attachment's weight.

        Args:
            q: Joint coordinates, shape (P, n) [rad or m]; the slew's do not matter.
        """
        bare, attachment, load = self._rows(q)
        edges = len(self.arm.support.normals)
        shares = np.full(bare.shape[1], self.torque_fraction)
        shares[:edges] = self.tipping_fraction
        reasons = np.concatenate([np.full(edges, TIPPING), np.tile(self.efforts, 2)])
        scale = np.abs(bare).sum(axis=-1) + np.abs(attachment).sum(axis=-1)  # (P, R)
        less = shares[:, None] * bare + attachment
        lower, upper = self._arcs(q)  # (arcs, P)
        rated, worst = largest_mass(less, load, lower[..., None], upper[..., None])  # (arcs, P, R)
        whole, _ = largest_mass(bare + attachment, load, lower[..., None], upper[..., None])
        violation = (worst / scale).max(axis=2)
        found = [
            _sector(rated[arcs], whole[arcs], violation[arcs], reasons) for arcs in ARCS_OF_SECTORS
        ]
        return StaticLoads(*(np.stack(part, axis=1) for part in zip(*found, strict=True)))

    def loads_at(self, q: Array) -> Array:
        """Largest loads that can be held where the slew joint is, shape (P,) [kg].

        Neither fraction is applied.

        Args:
            q: Joint coordinates, shape (P, n) [rad or m].
        """
        bare, attachment, load = self._rows(q)
        slew = q[:, self.arm.slew, None]
        masses, _ = largest_mass(bare + attachment, load, slew, slew)
        return np.asarray(masses.min(axis=1))

    def _rows(self, q: Array) -> tuple[Array, Array, Array]:
        """Coefficients of base, attachment and load, shape (P, R, 3) each [N m or N, per kg]."""
        complete = self._coefficients(self.arm.machine, q)
        bare = self._coefficients(self.bare, q) if self.bare is not self.arm.machine else complete
        load = (self._coefficients(self.loaded, q) - complete) / self.arm.machine.mass
        attachment = complete - bare
        limits = self.arm.machine.limits.effort[self.efforts]
        bare = bare.copy()
        bare[:, len(self.arm.support.normals) :, 0] -= np.tile(limits, 2)
        return bare, attachment, load

    def _coefficients(self, machine: Machine, q: Array) -> Array:
        """Coefficients of edges, torques and negative torques, shape (P, R, 3)."""
        root = np.concatenate([-self.ground.gravity(), np.zeros(3)])
        rows, still = self.arm.support.wrench_rows(), np.zeros_like(q)
        samples = []
        for angle in SLEW_ANGLES:
            turned = q.copy()
            turned[:, self.arm.slew] = angle
            found = efforts(machine, turned, still, still, root_acceleration=root)
            torques = found[:, WRENCH + self.efforts]
            samples.append(np.hstack([found[:, :WRENCH] @ rows.T, torques, -torques]))
        return harmonics(np.array(samples))

    def _arcs(self, q: Array) -> tuple[Array, Array]:
        """First and last slew coordinate of every arc, shape (arcs, P) each [rad]."""
        fixed = self.arm.slew_at(q, np.array(AZIMUTHS)[:, None])
        lower, upper = (np.full((1, len(q)), end) for end in self.arm.slew_range)
        return np.concatenate([fixed, lower]), np.concatenate([fixed, upper])


def _sector(
    rated: Array, whole: Array, violation: Array, reasons: Indices
) -> tuple[Array, Array, Array, Indices, Array]:
    """Fields of `StaticLoads` for one sector, shape (P,) each, from its arcs: worst of all.

    Args:
        rated: Rated load by row, shape (arcs, P, R) [kg].
        whole: Load at the limit itself by row, shape (arcs, P, R) [kg].
        violation: Relative violation without a load, shape (arcs, P).
        reasons: Joint of each row or `TIPPING`, shape (R,).
    """
    missing = np.isnan(rated).all(axis=(0, 2))
    rated, whole = (np.where(np.isnan(part), np.inf, part).min(axis=0) for part in (rated, whole))
    tips = reasons == TIPPING
    least = np.where(missing, np.nan, rated.min(axis=1))
    tipping = np.where(missing, np.nan, whole[:, tips].min(axis=1))
    torque = np.where(missing, np.nan, whole[:, ~tips].min(axis=1, initial=np.inf))
    worst = np.where(np.isnan(violation), -np.inf, violation).max(axis=0)
    limit = np.where(np.isinf(least), NOTHING, reasons[rated.argmin(axis=1)])
    return least, tipping, torque, limit, worst

"""The machine neither tips over nor leaves the ground."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.errors import ProblemError
from zmp_sqp.mechanics.bounds.effort_bounds import EffortBound
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.ground import GRAVITY
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.support import SupportPolygon
from zmp_sqp.mechanics.wrench import WRENCH
from zmp_sqp.planning.constraints.effort_rows import EffortRows
from zmp_sqp.planning.constraints.protocol import Stretch

__all__ = ["GUARD", "LEAST_NORMAL_FORCE", "Contact", "TipOver", "TipOverRows", "supported"]

GUARD = 5e-5  # [m] kept beyond the margin that is asked for, so that its proof needs few samples
LEAST_NORMAL_FORCE = 0.05  # of the weight: with less the tracks are as good as in the air
RESOLUTION = 2e-4  # [m] by which a guaranteed margin may fall short of the sampled one


@dataclass(frozen=True, slots=True)
class TipOver:
    r"""The zero moment point keeps a margin from every edge of the support polygon.

    .. math:: (e_i \cdot p - b_i + margin)\, f_z \le 0

    which is linear in the ground reaction wrench, see `SupportPolygon.wrench_rows`.

    Attributes:
        margin: Least distance from every edge [m].
    """

    margin: float = 0.0
    name = "tip_over"

    def rows(self, machine: Machine, coordinates: Coordinates) -> TipOverRows:
        """One row per edge."""
        return TipOverRows.of(machine, self.margin + GUARD)


@dataclass(frozen=True, slots=True, eq=False)
class TipOverRows(EffortRows):
    """Rows of the support polygon's edges; their room is the distance of the zero moment point.

    Attributes:
        support: The polygon.
        weight: Mass times gravity, which scales the rows [N].
        margin: Distance that the rows keep in the program [m].
        distance: -1 times the normal force times the distance from every edge is this times the
            wrench, shape (V, 6).
    """

    support: SupportPolygon
    weight: float
    margin: float
    distance: Array

    @classmethod
    def of(cls, machine: Machine, margin: float) -> TipOverRows:
        """Rows of a machine's polygon.

        Raises:
            ProblemError: The machine has no support polygon.
        """
        support = supported(machine)
        count, weight = len(support.vertices), machine.mass * GRAVITY
        return cls(
            C=support.wrench_rows(margin),
            c=np.zeros(count),
            divisor=np.full(count, weight),
            labels=_edge_labels(support),
            units=("m",) * count,
            resolution=np.full(count, RESOLUTION),
            support=support,
            weight=weight,
            margin=margin,
            distance=support.wrench_rows(),
        )

    def tightened(self, amount: float) -> TipOverRows:
        """The rows with a margin that is larger by an amount [m]."""
        margin = self.margin + amount
        return replace(self, C=self.support.wrench_rows(margin), margin=margin)

    def least_of(self, stretch: Stretch, room: Array) -> tuple[Array, Array]:
        r"""Least distance inside a stretch.

        Let m be the least distance at the control points of the wrench. With
        :math:`r = (e \cdot p - b) f_z` of an edge, which is linear in the wrench,
        :math:`r + m f_z` is not positive at any control point and therefore nowhere along the
        polynomial. If it may be off by :math:`\epsilon`,

        .. math:: \text{distance}(t) \ge m - \frac{\epsilon}{\min f_z}
        """
        normal = stretch.control[:, :, 2:3]  # (n + 1, K, 1)
        rounding, every = stretch.rounding, stretch.rounding.plus(stretch.interpolation)
        bound = self._less(room.min(axis=0), normal.min(axis=0), every)
        ends = np.minimum(room[0], room[-1])
        return bound, self._less(ends, np.minimum(normal[0], normal[-1]), rounding)

    def room_of(self, efforts: Array) -> Array:
        """Distance of the zero moment point to each edge, -inf where the ground must pull [m].

        Args:
            efforts: Shape (..., R).

        Returns:
            Shape (..., V).
        """
        normal = efforts[..., 2:3]
        with np.errstate(all="ignore"):
            distance = (efforts[..., :WRENCH] @ self.distance.T) / -normal
        distance[~((normal > 0.0) & np.isfinite(distance))] = -np.inf
        return distance

    def _less(self, distance: Array, normal: Array, off: EffortBound) -> Array:
        """Distances (K, V) less what a wrench within `off` can change.

        Args:
            distance: Shape (K, V) [m].
            normal: Least normal force, shape (K, 1) [N].
            off: Error of the wrench, shape (K,).
        """
        force, moment = off.force[:, None], off.moment[:, None]
        with np.errstate(all="ignore"):
            error = np.linalg.norm(self.distance[:, :3], axis=1) * force
            error = error + np.linalg.norm(self.distance[:, 3:], axis=1) * moment
            inside = distance - (error + np.abs(distance) * force) / (normal - force)
        return np.where((normal > force) & ~np.isnan(inside), inside, -np.inf)

    def outside(self, wrench: Array) -> Array:
        """Largest distance of the zero moment point beyond the rows' margin, shape (K,) [m]."""
        return np.asarray((wrench @ self.C.T / wrench[:, 2:3]).max(axis=1))


@dataclass(frozen=True, slots=True)
class Contact:
    r"""The ground presses on the machine, so that there is a zero moment point: f_z > 0.

    .. math:: f_z \ge least \cdot m g

    in the program; the certificate proves f_z > 0.

    Attributes:
        least: Normal force that the program keeps, as a share of the weight.
    """

    least: float = LEAST_NORMAL_FORCE
    name = "contact"

    def rows(self, machine: Machine, coordinates: Coordinates) -> ContactRows:
        """One row."""
        weight = machine.mass * GRAVITY
        C = np.zeros((1, WRENCH))
        C[0, 2] = -1.0
        return ContactRows(
            C=C,
            c=np.array([self.least]),
            divisor=np.array([weight]),
            labels=("normal force",),
            units=("N",),
            resolution=np.array([np.inf]),
        )


@dataclass(frozen=True, slots=True, eq=False)
class ContactRows(EffortRows):
    """Row of the normal force; its room is the force itself."""

    def room_of(self, efforts: Array) -> Array:
        """Normal force of efforts of shape (..., R), shape (..., 1) [N]."""
        normal = efforts[..., 2:3]
        return np.where(np.isfinite(normal), normal, -np.inf)


@lru_cache(maxsize=32)
def _edge_labels(support: SupportPolygon) -> tuple[str, ...]:
    """What the rows of a polygon's edges limit, in words."""
    return tuple(f"{support.edge_name(i)} edge" for i in range(len(support.vertices)))


def supported(machine: Machine) -> SupportPolygon:
    """The machine's support polygon.

    Raises:
        ProblemError: It has none.
    """
    if machine.support is None:
        raise ProblemError(
            f"machine {machine.name!r} has no support polygon: give support= to load_machine, "
            "a SupportPolygon or the names of its contact links"
        )
    return machine.support

"""Constraints that keep the machine from tipping over and from lifting off the ground."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.errors import GIVE_SUPPORT, ProblemError
from zmp_sqp.mechanics.bounds.effort_bounds import EffortBound
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.ground import GRAVITY
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.support import SupportPolygon
from zmp_sqp.mechanics.wrench import WRENCH
from zmp_sqp.planning.constraints.effort_rows import EffortRows
from zmp_sqp.planning.constraints.protocol import MotionSample, Stretch

__all__ = [
    "GUARD",
    "LEAST_NORMAL_FORCE",
    "Contact",
    "TipOver",
    "TipOverRows",
    "edge_label",
    "supported",
]

# [m] kept beyond the margin that is asked for: the search need not end exactly on its rows, and the
# proof needs few samples. Costs less than 0.01 % of the duration
GUARD = 2e-4
TOLERANCE_SHARE = 0.15  # of the guard, that rows may be violated by at a solution
GUARD_SHARE = 6e-5  # of the polygon's reach: on small machines the guard is no larger than this
LEAST_NORMAL_FORCE = 0.05  # of the weight: with less the tracks are as good as in the air
RESOLUTION = 2e-4  # [m] by which a guaranteed margin may fall short of the sampled one


@dataclass(frozen=True, slots=True)
class TipOver:
    r"""Constraint that the zero moment point p keeps a margin from every support polygon edge.

    .. math:: (e_i \cdot p - b_i + margin)\, f_z \le 0

    with the outward unit normal e_i and the offset b_i of edge i and the normal force f_z. It is
    linear in the ground reaction wrench, see `SupportPolygon.wrench_rows`.

    Attributes:
        margin: Required distance from the zero moment point to every edge [m].
    """

    margin: float = 0.0
    name = "tip_over"

    def rows(self, machine: Machine, coordinates: Coordinates) -> TipOverRows:
        """One row per edge, with `GUARD` added to the margin."""
        guard = min(GUARD, GUARD_SHARE * supported(machine).reach)
        return TipOverRows.of(machine, self.margin + guard)


@dataclass(frozen=True, slots=True, eq=False)
class TipOverRows(EffortRows):
    """Rows of `TipOver`, one per edge; their room is the distance from the zero moment point [m].

    Attributes:
        support: The support polygon.
        weight: Mass times gravity, which scales the rows to order one [N].
        margin: Distance from every edge that the rows enforce in the program [m].
        distance: Matrix that gives -f_z times the distance from every edge, from the wrench, shape
            (R, 6).
    """

    support: SupportPolygon
    weight: float
    margin: float
    distance: Array

    @property
    def tolerance(self) -> float:
        """Violation of a row at a solution: a share of what the guard keeps [m]."""
        return TOLERANCE_SHARE * min(GUARD, GUARD_SHARE * self.support.reach)

    @classmethod
    def of(cls, machine: Machine, margin: float) -> TipOverRows:
        """Rows of a machine's support polygon.

        Args:
            machine: Machine with a corner's payload.
            margin: Distance from every edge that the rows enforce [m].

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
        """Rows whose margin is larger by an amount [m]."""
        margin = self.margin + amount
        return replace(self, C=self.support.wrench_rows(margin), margin=margin)

    def room(self, sample: MotionSample) -> Array:
        """Signed distance from the zero moment point to each edge, shape (K, R) [m].

        It is -inf where the ground would have to pull, f_z <= 0.
        """
        wrench = sample.efforts[:, :WRENCH]
        normal = wrench[:, 2:3]
        with np.errstate(all="ignore"):
            distance = (wrench @ self.distance.T) / -normal
        distance[~((normal > 0.0) & np.isfinite(distance))] = -np.inf
        return distance

    def least_of(self, stretch: Stretch, room: Array) -> tuple[Array, Array]:
        r"""Lower bound on the distance from each edge inside each stretch.

        Let r = (e . p - b) f_z, which is linear in the wrench, and let m be the least distance at
        the control points of the wrench. Then r + m f_z is not positive at any control point, hence
        nowhere on the polynomial. If the wrench is not the polynomial's, r + m f_z exceeds that of
        the polynomial by at most :math:`\epsilon`, so that

        .. math:: b - e \cdot p(t) \ge m - \frac{\epsilon}{\min f_z}

        Args:
            stretch: K stretches.
            room: Distances at their control points, shape (n + 1, K, R) [m].

        Returns:
            The bound, and the bound that a stretch of no length would give, shape (K, R) each [m].
        """
        normal = stretch.control[:, :, 2:3]  # (n + 1, K, 1)
        every = stretch.rounding.plus(stretch.interpolation)
        bound = self._less(room.min(axis=0), normal.min(axis=0), every)
        # an end with little room may be the one with much normal force
        ends = (self._less(room[i], normal[i], stretch.rounding) for i in (0, -1))
        return bound, np.minimum(*ends)

    def _less(self, distance: Array, normal: Array, off: EffortBound) -> Array:
        """Distances (K, R) less what an error of the wrench can change, -inf without contact.

        Args:
            distance: Shape (K, R) [m].
            normal: Least normal force, shape (K, 1) [N].
            off: Bound on the error of the wrench, shape (K,).
        """
        force, moment = off.force[:, None], off.moment[:, None]
        with np.errstate(all="ignore"):
            error = np.linalg.norm(self.distance[:, :3], axis=1) * force
            error = error + np.linalg.norm(self.distance[:, 3:], axis=1) * moment
            inside = distance - (error + np.abs(distance) * force) / (normal - force)
        return np.where((normal > force) & ~np.isnan(inside), inside, -np.inf)

    def outside(self, wrench: Array) -> Array:
        """Distance by which the zero moment point violates the margin of the rows, (K,) [m].

        Args:
            wrench: Ground reaction about the root origin, root axes, shape (K, 6) [N, N m].
        """
        return np.asarray((wrench @ self.C.T / wrench[:, 2:3]).max(axis=1))


@dataclass(frozen=True, slots=True)
class Contact:
    r"""Constraint that the ground presses on the machine, without which there is no ZMP.

    The certificate proves f_z > 0. The program enforces a little more,

    .. math:: f_z \ge least \cdot m g

    Attributes:
        least: Least normal force in the program, as a share of the weight m g.
    """

    least: float = LEAST_NORMAL_FORCE
    name = "contact"

    def rows(self, machine: Machine, coordinates: Coordinates) -> ContactRows:
        """One row: the normal force."""
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
    """Row of `Contact`; its room is the normal force [N]."""

    tolerance = 3e-5  # of the weight

    def room(self, sample: MotionSample) -> Array:
        """Normal force, shape (K, 1) [N]; -inf where it has no value."""
        normal = sample.efforts[:, 2:3]
        return np.where(np.isfinite(normal), normal, -np.inf)


@lru_cache(maxsize=32)
def _edge_labels(support: SupportPolygon) -> tuple[str, ...]:
    """Labels of all edges."""
    return tuple(edge_label(support, i) for i in range(len(support.vertices)))


def supported(machine: Machine) -> SupportPolygon:
    """Support polygon of a machine.

    Raises:
        ProblemError: The machine has no support polygon.
    """
    if machine.support is None:
        hint = f" ({machine.support_hint})" if machine.support_hint else ""
        raise ProblemError(
            f"machine {machine.name!r} has no support polygon: {GIVE_SUPPORT.arguments}{hint}"
        )
    return machine.support


def edge_label(support: SupportPolygon, index: int) -> str:
    """Edge in words: "left edge" on a rectangle, "edge 3" on any other polygon."""
    name = support.edge_name(index)
    return name if name.startswith("edge") else f"{name} edge"

"""What a physics engine says of a motion: how far the machine tilted, which track lifted, what the tracks carried."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics.ground import Ground
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.support import SupportPolygon
from zmp_sqp.motion.trajectory import Trajectory

__all__ = ["LIFTED", "Replay"]

LIFTED = 5e-3  # [m] above the ground at which a corner of the tracks counts as lifted


@dataclass(frozen=True, slots=True, eq=False)
class Replay:
    """A motion replayed on a machine that stands free on its ground.

    Poses, heights and loads have one row per step of the simulation, K in all, from the start of
    the motion to the end of the hold after it, or to where the machine had fallen over.

    Attributes:
        machine: The machine.
        trajectory: The motion.
        ground: What it stood on.
        times: Since the start of the motion, shape (K,) [s].
        poses: Of the root in the root frame at rest: position, and quaternion (w, x, y, z), shape
            (K, 7) [m].
        loads: Normal force on the foot at each corner of the support polygon, shape (K, V) [N].
        tracking_error: Largest distance of a joint from the trajectory [rad or m].
        fell: Whether the machine tilted by more than 45 degrees; the replay ends there.
    """

    machine: Machine = field(repr=False)
    trajectory: Trajectory = field(repr=False)
    ground: Ground
    times: Array = field(repr=False)
    poses: Array = field(repr=False)
    loads: Array = field(repr=False)
    tracking_error: float
    fell: bool

    @property
    def support(self) -> SupportPolygon:
        """The machine's support polygon."""
        if self.machine.support is None:
            raise MachineError(f"machine {self.machine.name!r} has no support polygon")
        return self.machine.support

    @property
    def tilts(self) -> Array:
        """Angle between the root's z axis and what it was at rest, shape (K,) [rad]."""
        w, x, y, z = self.poses[:, 3:].T
        w0, x0, y0, z0 = self.poses[0, 3:]
        # x and y of the turn since: the conjugate of the first quaternion times each
        turn = np.hypot(w0 * x - x0 * w - y0 * z + z0 * y, w0 * y + x0 * z - y0 * w - z0 * x)
        return np.asarray(2.0 * np.arcsin(np.minimum(turn, 1.0)))

    @property
    def corners(self) -> Array:
        """The support polygon's corners, root frame at rest, shape (K, V, 3) [m]."""
        support = self.support
        points = np.column_stack([support.vertices, np.full(len(support.vertices), support.height)])
        w, u = self.poses[:, None, 3:4], self.poses[:, None, 4:]
        once = np.cross(u, points[None])  # (K, V, 3)
        return np.asarray(self.poses[:, None, :3] + points + 2.0 * (w * once + np.cross(u, once)))

    @property
    def lifts(self) -> Array:
        """Height of the support polygon's corners above the ground, negative where it yields, shape (K, V) [m]."""
        return np.asarray(self.corners[:, :, 2] - self.support.height)

    @property
    def edge_loads(self) -> Array:
        """Normal force on both feet of each edge of the support polygon, shape (K, V) [N].

        The feet at the ends of a rectangle's left edge carry the left track.
        """
        return np.asarray(self.loads + np.roll(self.loads, -1, axis=1))

    @property
    def zmp(self) -> Array:
        """Centre of pressure of the feet, root frame, shape (K, 2) [m]; NaN in the air."""
        total = self.loads.sum(axis=1, keepdims=True)
        carried = np.where(total > 0.0, total, np.nan)
        return np.asarray(self.loads @ self.support.vertices / carried)

    @property
    def max_tilt(self) -> float:
        """Largest angle [rad]."""
        return float(self.tilts.max())

    @property
    def lift(self) -> float:
        """Largest height of a corner above the ground [m]."""
        return float(self.lifts.max())

    @property
    def lift_at(self) -> float:
        """When the largest lift is reached [s]."""
        return float(self.times[self.lifts.max(axis=1).argmax()])

    @property
    def lifted_at(self) -> float:
        """When a corner is first higher than 5 mm; NaN if none ever is [s]."""
        high = self.lifts.max(axis=1) > LIFTED
        return float(self.times[high.argmax()]) if high.any() else float("nan")

    @property
    def tipped(self) -> bool:
        """Whether a corner lifts by more than 5 mm."""
        return self.lift > LIFTED

    @property
    def pivot(self) -> int:
        """Edge on which the machine stands at its largest lift: the one that it tips over, if it does."""
        heights = self.lifts[self.lifts.max(axis=1).argmax()]
        return int(np.argmin(heights + np.roll(heights, -1)))

    @property
    def least_edge_load(self) -> float:
        """Least normal force that the feet of an edge carry [N]."""
        return float(self.edge_loads.min())

    @property
    def least_loaded_edge(self) -> int:
        """The edge whose feet carry the least."""
        return int(self.edge_loads.min(axis=0).argmin())

    @property
    def least_loads(self) -> Array:
        """Least normal force on the foot at each corner, shape (V,) [N]."""
        return np.asarray(self.loads.min(axis=0))

    @property
    def slide(self) -> float:
        """Largest displacement along the ground of a corner that carries load [m]."""
        places = self.corners[:, :, :2]
        along = np.linalg.norm(places - places[0], axis=2)  # (K, V)
        return float(np.where(self.loads > 0.0, along, 0.0).max())

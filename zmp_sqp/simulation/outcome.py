"""Result of a physics replay: tilt of the machine, lift of the tracks and loads on the tracks."""

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

LIFTED = 5e-3  # [m] height above the ground beyond which a corner of the support counts as lifted


@dataclass(frozen=True, slots=True, eq=False)
class Replay:
    """Physics simulation of a motion on a machine that stands freely on its ground.

    Arrays over time have one row for each of the K steps of the simulation, from the start of the
    motion to the end of the hold after it, or until the machine has fallen over. The support
    polygon has V corners and V edges; edge i connects corners i and i + 1.

    Attributes:
        machine: Simulated machine.
        trajectory: Motion of the joints.
        ground: Ground on which the machine stood.
        times: Times since the start of the motion, shape (K,) [s].
        poses: Position [m] and quaternion (w, x, y, z) of the root, in the root frame at rest,
            shape (K, 7).
        loads: Normal force on the foot at each corner of the support polygon, shape (K, V) [N].
        tracking_error: Largest deviation of a joint from the trajectory [rad or m].
        fell: Whether the machine tilted by more than 45 degrees, at which the simulation stops.
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
        """Support polygon of the machine."""
        if self.machine.support is None:
            raise MachineError(f"machine {self.machine.name!r} has no support polygon")
        return self.machine.support

    @property
    def tilts(self) -> Array:
        """Angle between the root's z axis and its initial direction, shape (K,) [rad]."""
        w, x, y, z = self.poses[:, 3:].T
        w0, x0, y0, z0 = self.poses[0, 3:]
        # length of (x, y) of the relative rotation: conjugate of the first quaternion times each
        turn = np.hypot(w0 * x - x0 * w - y0 * z + z0 * y, w0 * y + x0 * z - y0 * w - z0 * x)
        return np.asarray(2.0 * np.arcsin(np.minimum(turn, 1.0)))

    @property
    def corners(self) -> Array:
        """Positions of the support polygon's corners, root frame at rest, shape (K, V, 3) [m]."""
        support = self.support
        points = np.column_stack([support.vertices, np.full(len(support.vertices), support.height)])
        w, u = self.poses[:, None, 3:4], self.poses[:, None, 4:]
        once = np.cross(u, points[None])  # (K, V, 3)
        return np.asarray(self.poses[:, None, :3] + points + 2.0 * (w * once + np.cross(u, once)))

    @property
    def lifts(self) -> Array:
        """Height of the corners above the ground, shape (K, V) [m]; negative where it yields."""
        return np.asarray(self.corners[:, :, 2] - self.support.height)

    @property
    def edge_loads(self) -> Array:
        """Normal force on the two feet at the ends of each edge together, shape (K, V) [N].

        On a rectangle, the load of the left edge is that of the left track.
        """
        return np.asarray(self.loads + np.roll(self.loads, -1, axis=1))

    @property
    def zmp(self) -> Array:
        """Centre of pressure of the feet, root frame, shape (K, 2) [m]; NaN without contact."""
        total = self.loads.sum(axis=1, keepdims=True)
        carried = np.where(total > 0.0, total, np.nan)
        return np.asarray(self.loads @ self.support.vertices / carried)

    @property
    def max_tilt(self) -> float:
        """Largest tilt of the machine [rad]."""
        return float(self.tilts.max())

    @property
    def lift(self) -> float:
        """Largest height of a corner above the ground [m]."""
        return float(self.lifts.max())

    @property
    def lift_at(self) -> float:
        """Time of the largest lift [s]."""
        return float(self.times[self.lifts.max(axis=1).argmax()])

    @property
    def lifted_at(self) -> float:
        """Time at which a corner is first higher than 5 mm above the ground [s]; NaN if never."""
        high = self.lifts.max(axis=1) > LIFTED
        return float(self.times[high.argmax()]) if high.any() else float("nan")

    @property
    def tipped(self) -> bool:
        """Whether a corner lifts by more than 5 mm above the ground."""
        return self.lift > LIFTED

    @property
    def pivot(self) -> int:
        """Index of the edge on which the machine stands at its largest lift.

        This is the edge that it tips over, if it does.
        """
        heights = self.lifts[self.lifts.max(axis=1).argmax()]
        return int(np.argmin(heights + np.roll(heights, -1)))

    @property
    def least_edge_load(self) -> float:
        """Least normal force on the feet of any edge at any time [N]."""
        return float(self.edge_loads.min())

    @property
    def least_loaded_edge(self) -> int:
        """Index of the edge whose feet carry the least normal force at any time."""
        return int(self.edge_loads.min(axis=0).argmin())

    @property
    def least_loads(self) -> Array:
        """Least normal force over time on the foot at each corner, shape (V,) [N]."""
        return np.asarray(self.loads.min(axis=0))

    @property
    def slide(self) -> float:
        """Largest displacement along the ground of a corner that carries load [m]."""
        positions = self.corners[:, :, :2]
        distance = np.linalg.norm(positions - positions[0], axis=2)  # (K, V)
        return float(np.where(self.loads > 0.0, distance, 0.0).max())

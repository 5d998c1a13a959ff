"""Arm of a machine: a slew joint, and joints that set radius and height of a lift point."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array, Indices
from zmp_sqp.errors import GIVE_SUPPORT, MachineError
from zmp_sqp.mechanics import Machine, Payload
from zmp_sqp.mechanics.support import SupportPolygon

__all__ = ["Arm"]

PROBES = 8  # random poses at which it is looked what a joint moves
PROBE_STEP = 0.1  # [rad or m] by which a joint is moved there
MOVES = 1e-9  # [m, or sine of an angle] displacement of the lift point that counts as none
SAME_AXIS = 1e-6  # [m, or share of the step] by which slew axes of different poses may differ
UNLIMITED = np.pi  # [rad] continuous joints are sampled within plus and minus this


@dataclass(frozen=True, slots=True, eq=False)
class Arm:
    """Arm that slews about a vertical axis, with a lift point at its end.

    "Vertical" is the normal of the support plane, which is the z axis of the root frame; on a slope
    radius and height are those of the machine, not of the horizon.

    Attributes:
        machine: The machine without payload.
        frame: Name of the frame to which the lift point is fixed.
        offset: Position of the lift point in that frame, shape (3,) [m].
        slew: Index of the planned joint that turns the arm about the vertical.
        joints: Indices of the other planned joints that move the lift point, shape (A,).
        axis: x and y of the slew axis in the root frame, shape (2,) [m].
        sense: +1 if the slew joint turns to the left where its coordinate grows, else -1.
        neutral: Joint coordinates of the machine where the chart asks nothing else: zero, clipped
            to the limits, shape (n,) [rad or m].
    """

    machine: Machine
    frame: str
    offset: Array
    slew: int
    joints: Indices
    axis: Array
    sense: float
    neutral: Array
    _index: int = field(repr=False)

    @classmethod
    def of(cls, machine: Machine, frame: str, offset: Array) -> Arm:
        """Arm of a machine that lifts at a point fixed to a frame.

        Args:
            machine: The machine without payload.
            frame: Name of the frame.
            offset: Position of the lift point in that frame, shape (3,) [m].

        Raises:
            MachineError: There is no such frame, no joint moves it, position limits are missing, or
                no joint turns it about a fixed vertical axis.
        """
        loaded = Payload(1.0, np.zeros(3), frame).attached_to(machine.model)
        index = int(loaded.frames[-1].parentFrame)
        lower, upper = _sampled_range(machine)
        neutral = np.clip(np.zeros(machine.size), lower, upper)
        at, every = (machine, frame, offset), np.arange(machine.size)
        found = cls(*at, 0, every, np.zeros(2), 1.0, neutral, index)
        # not `uniform`, which refuses limits of 0 and -0
        shares = np.random.default_rng(0).random((PROBES, machine.size))
        probes = lower + shares * (upper - lower)
        moving = [joint for joint in range(machine.size) if found._moves(joint, probes)]
        if not moving:
            raise MachineError(
                f"no joint moves frame {frame!r}: a load chart needs a frame at the end of an arm"
            )
        for joint in moving:
            turn = found._vertical_turn(joint, probes)
            if turn is not None:
                others = np.array([other for other in moving if other != joint], dtype=np.intp)
                return cls(*at, joint, others, *turn, neutral, index)
        names = ", ".join(machine.joint_names[joint] for joint in moving)
        raise MachineError(
            f"none of the joints that move frame {frame!r} ({names}) turns it about a fixed "
            "vertical axis: a load chart needs an arm that slews"
        )

    @property
    def support(self) -> SupportPolygon:
        """Support polygon of the machine.

        Raises:
            MachineError: There is none.
        """
        if self.machine.support is None:
            raise MachineError(
                f"machine {self.machine.name!r} has no support polygon: {GIVE_SUPPORT.arguments}"
            )
        return self.machine.support

    def placements(self, q: Array) -> tuple[Array, Array]:
        """Lift point and vertical as seen from it.

        Args:
            q: Joint coordinates, shape (P, n) [rad or m].

        Returns:
            Lift point in the root frame, shape (P, 3) [m], and the root's z axis in the axes of its
            frame, shape (P, 3).
        """
        model = self.machine.model
        data, frame = model.createData(), model.frames[self._index]
        points, verticals = np.empty((2, len(q), 3))
        for row, configuration in enumerate(self.machine.configuration(q)):
            pin.forwardKinematics(model, data, configuration)
            placement = data.oMi[frame.parentJoint] * frame.placement
            points[row], verticals[row] = placement.act(self.offset), placement.rotation[2]
        return points, verticals

    def radius_and_height(self, points: Array) -> Array:
        """Distance from the slew axis and height above the support plane, shape (P, 2) [m].

        Args:
            points: Points in the root frame, shape (P, 3) [m].
        """
        radius = np.linalg.norm(points[:, :2] - self.axis, axis=1)
        return np.column_stack([radius, points[:, 2] - self.support.height])

    def azimuth(self, points: Array) -> Array:
        """Direction from the slew axis to points, 0 ahead, pi/2 to the left, shape (P,) [rad].

        Args:
            points: Points in the root frame, shape (P, 3) [m].
        """
        return np.asarray(np.arctan2(*(points[:, :2] - self.axis).T[::-1]))

    @property
    def box(self) -> tuple[Array, Array]:
        """Position limits, shape (n,) each; one turn about zero for joints without limits."""
        return _sampled_range(self.machine)

    @property
    def slew_range(self) -> tuple[float, float]:
        """Least and greatest slew coordinate; one turn about zero for a joint without limits."""
        lower, upper = _sampled_range(self.machine)
        return float(lower[self.slew]), float(upper[self.slew])

    @property
    def endless(self) -> bool:
        """Whether the slew joint turns without limits."""
        limits = self.machine.limits
        ends = np.array([limits.position_lower[self.slew], limits.position_upper[self.slew]])
        return bool(np.isinf(ends).all())

    @property
    def full_circle(self) -> bool:
        """Whether the slew joint can turn once around."""
        lower, upper = self.slew_range
        return upper - lower >= 2.0 * np.pi * (1.0 - 1e-9)

    def slew_at(self, q: Array, azimuth: float | Array) -> Array:
        """Slew coordinates that bring the lift point to an azimuth, shape (P,) [rad].

        The nearest to the middle of the slew range; NaN where its limits leave none.

        Args:
            q: Joint coordinates, shape (P, n) [rad or m].
            azimuth: 0 is ahead, pi/2 to the left [rad]; several of shape (A, 1) give (A, P).
        """
        points, _ = self.placements(q)
        turned = q[:, self.slew] + self.sense * (azimuth - self.azimuth(points))
        lower, upper = self.slew_range
        middle = 0.5 * (lower + upper)
        nearest = middle + (turned - middle + np.pi) % (2.0 * np.pi) - np.pi
        inside = (nearest >= lower - 1e-9) & (nearest <= upper + 1e-9)
        return np.where(inside, np.clip(nearest, lower, upper), np.nan)

    def _moves(self, joint: int, probes: Array) -> bool:
        """Whether a joint displaces or turns the frame at any of these poses."""
        before, after = self.placements(probes), self.placements(_moved(probes, joint))
        change = [np.abs(a - b).max() for a, b in zip(before, after, strict=True)]
        return bool(max(change) > MOVES)

    def _vertical_turn(self, joint: int, probes: Array) -> tuple[Array, float] | None:
        """Axis (2,) [m] and sense of a joint that turns the frame about a fixed vertical axis."""
        before, vertical = self.placements(probes)
        after, vertical_after = self.placements(_moved(probes, joint))
        if np.abs(vertical - vertical_after).max() > MOVES:
            return None
        for sense in (1.0, -1.0):
            cos, sin = np.cos(PROBE_STEP), sense * np.sin(PROBE_STEP)
            rotation = np.array([[cos, -sin], [sin, cos]])
            # after = axis + R (before - axis) holds for the axis of this turn
            axes = np.linalg.solve(
                np.eye(2) - rotation, (after[:, :2] - before[:, :2] @ rotation.T).T
            ).T
            level = np.abs(after[:, 2] - before[:, 2]).max() <= MOVES
            if level and np.abs(axes - axes[0]).max() <= SAME_AXIS:
                return axes.mean(axis=0), sense
        return None


def _moved(probes: Array, joint: int) -> Array:
    moved = probes.copy()
    moved[:, joint] += PROBE_STEP
    return moved


def _sampled_range(machine: Machine) -> tuple[Array, Array]:
    """Position limits, shape (n,) each; finite ones where a joint turns without end.

    Raises:
        MachineError: Position limits are missing; the message names the joints.
    """
    lower, upper = machine.limits.position_lower, machine.limits.position_upper
    if (missing := np.isnan(lower) | np.isnan(upper)).any():
        names = ", ".join(repr(machine.joint_names[i]) for i in np.flatnonzero(missing))
        raise MachineError(
            f"no position limits for joint {names}: a load chart needs them; give limits with the "
            "machine, or put a joint_limits.yaml beside its URDF"
        )
    # about the limit there is, if there is one
    least = np.where(np.isfinite(upper), upper - 2.0 * UNLIMITED, -UNLIMITED)
    most = np.where(np.isfinite(lower), lower + 2.0 * UNLIMITED, UNLIMITED)
    return (
        np.where(np.isfinite(lower), lower, least),
        np.where(np.isfinite(upper), upper, most),
    )

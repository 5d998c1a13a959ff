"""Torques and forces of the joints stay within their effort limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array, finite_number
from zmp_sqp.errors import GIVE_EFFORT, ProblemError
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.wrench import WRENCH
from zmp_sqp.planning.constraints.effort_rows import EffortRows
from zmp_sqp.planning.constraints.protocol import MotionSample

__all__ = ["TorqueLimits"]

GUARD = 1e-5  # of the limit, kept inside it by the planner so that its proof needs few samples
RESOLUTION = 1e-3  # of the limit, by which a guarantee may fall short of the samples


@dataclass(frozen=True, slots=True)
class TorqueLimits:
    r"""Torques of revolute and forces of prismatic joints stay within their effort limits.

    .. math:: |\tau_i| \le share \cdot \tau_{i, max}, \quad
              \tau = M(q) \ddot q + h(q, \dot q, g)

    Static load and inertia of links and payload count, and the motion of a base that drives; what
    drives the joints (friction, rotor inertia, hydraulics) is not modelled. The limits are
    `machine.limits.effort`: those of the URDF, of joint_limits.yaml, or of `load_machine(limits=)`.

    Attributes:
        share: Share of the effort limits that may be used.

    Raises:
        ProblemError: The share is not a positive number.
    """

    share: float = 1.0
    name = "torque_limits"

    def __post_init__(self) -> None:
        share = finite_number(self.share, name="share of torque_limits", error=ProblemError)
        if share <= 0.0:
            raise ProblemError(f"share of torque_limits must be positive, not {share}")
        object.__setattr__(self, "share", share)

    def rows(self, machine: Machine, coordinates: Coordinates) -> TorqueRows:
        """Two rows per joint, one for either sign.

        Raises:
            ProblemError: Joints have no effort limit; the message lists them.
        """
        given = machine.limits.effort
        if lacking := [machine.joint_names[i] for i in np.flatnonzero(np.isnan(given)).tolist()]:
            raise ProblemError(
                f"torque_limits: no effort limit for joint {', '.join(map(repr, lacking))}: "
                f"{GIVE_EFFORT.arguments}"
            )
        return TorqueRows.of(machine, np.array(self.share * given))


@dataclass(frozen=True, slots=True, eq=False)
class TorqueRows(EffortRows):
    r"""Rows :math:`\pm \tau_i / \tau_{i, max} - 1 + guard \le 0`; their room has no guard.

    Attributes:
        limit: Largest torques and forces, shape (n,) [N m or N].
    """

    limit: Array

    @classmethod
    def of(cls, machine: Machine, limit: Array) -> TorqueRows:
        """Rows of a machine whose joints have these limits, shape (n,)."""
        signs = np.vstack([np.eye(machine.size), -np.eye(machine.size)])
        both = np.tile(limit, 2)
        turning = [unit == "rad" for unit in machine.joint_units]
        kinds = ["torque" if turns else "force" for turns in turning]
        labels = [f"{joint} {kind}" for joint, kind in zip(machine.joint_names, kinds, strict=True)]
        return cls(
            C=np.hstack([np.zeros((len(both), WRENCH)), signs]),
            c=np.full(len(both), GUARD - 1.0),
            divisor=both,
            labels=tuple(labels * 2),
            units=tuple("N m" if turns else "N" for turns in turning) * 2,
            resolution=RESOLUTION * both,
            limit=limit,
        )

    def room(self, sample: MotionSample) -> Array:
        """Limits less torques of either sign, shape (K, 2n) [N m or N]."""
        torque = sample.efforts[:, WRENCH:]
        room = np.hstack([self.limit - torque, self.limit + torque])
        return np.where(np.isfinite(room), room, -np.inf)

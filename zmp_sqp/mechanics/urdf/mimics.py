"""Resolves <mimic> joints: which joint leads each of them, and what they ask of its limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics.joint_coupling import JointCoupling
from zmp_sqp.mechanics.limits import JointLimits
from zmp_sqp.mechanics.urdf.elements import Joint, Mimic
from zmp_sqp.mechanics.urdf.plausibility import first

__all__ = ["Mimics"]

# share of the limits by which those of two joints may miss each other by rounding in a URDF
ROUNDING = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Mimics:
    """Movable joints of a URDF by what moves them.

    Attributes:
        joints: Names of all movable joints, in the order of the file.
        leaders: Names of those that mimic no other, in the order of the file.
        follows: For each of the others the leader at the end of its chain of mimics, with the
            multiplier and the offset of the whole chain.
        remarks: Sentence about joints that mimic one that is not there; empty if there are none.
    """

    joints: tuple[str, ...]
    leaders: tuple[str, ...]
    follows: Mapping[str, Mimic]
    remarks: str

    @classmethod
    def of(cls, movable: Sequence[Joint]) -> Mimics:
        """Resolve the mimics of the movable joints.

        A joint that mimics one that is not there moves on its own, as for Pinocchio.

        Raises:
            MachineError: A joint mimics itself, directly or through others.
        """
        given = {joint.name: joint.mimic for joint in movable}
        leaderless = [
            f"{name!r} ({mimic.joint!r})"
            for name, mimic in given.items()
            if mimic is not None and mimic.joint not in given
        ]
        remarks = (
            f"these joints mimic joints that are not there or do not move: {first(leaderless)}. "
            "They are taken as joints of their own"
        )
        known = {
            name: mimic
            for name, mimic in given.items()
            if mimic is not None and mimic.joint in given
        }
        return cls(
            tuple(given),
            tuple(name for name in given if name not in known),
            {name: _end_of_chain(name, known) for name in known},
            remarks if leaderless else "",
        )

    def coupling(self, model: Any) -> JointCoupling:
        """Map from the leaders to all joints of the Pinocchio model of the file."""
        follows = {
            name: (mimic.joint, mimic.multiplier, mimic.offset)
            for name, mimic in self.follows.items()
        }
        return JointCoupling.of(model, self.leaders, follows)

    def leading(self, limits: JointLimits) -> JointLimits:
        r"""Limits of the leaders, (n,), within which all movable joints keep theirs, (m,).

        A joint q = m y + c within [a, b] keeps its leader's y within (a - c) / m and (b - c) / m,
        and |y'| below its rate limit over |m|; accelerations likewise. The effort of a leader is
        that of one drive for all joints that follow it. Its limit is the leader's own; if that
        is not given, the least |m| times the limit of a follower, wherever the drive sits.

        Raises:
            MachineError: The position limits of a follower are out of its leader's reach.
        """
        row = {name: i for i, name in enumerate(self.joints)}
        own = [row[name] for name in self.leaders]
        lower, upper, velocity, acceleration, effort = (
            np.array(part[own])
            for part in (
                limits.position_lower,
                limits.position_upper,
                limits.velocity,
                limits.acceleration,
                limits.effort,
            )
        )
        led = np.full(len(own), np.nan)
        for name, mimic in self.follows.items():
            at, i, size = self.leaders.index(mimic.joint), row[name], abs(mimic.multiplier)
            if size == 0.0:  # it stands still
                continue
            ends = limits.position_lower[i], limits.position_upper[i]
            asked = [(end - mimic.offset) / mimic.multiplier for end in ends]
            # a joint without limits asks for nothing
            low, high = np.where(np.isinf(asked), np.nan, asked)[:: int(np.sign(mimic.multiplier))]
            lower[at], upper[at] = np.fmax(lower[at], low), np.fmin(upper[at], high)
            if lower[at] > upper[at]:
                if lower[at] > upper[at] + ROUNDING * max(abs(lower[at]), abs(upper[at])):
                    raise MachineError(
                        f"joint {name!r} mimics {mimic.joint!r}: its position limits {ends[0]:g} "
                        f"and {ends[1]:g} ask for {low:g} to {high:g} there, which the other "
                        "limits do not allow"
                    )
                lower[at] = upper[at]
            velocity[at] = np.fmin(velocity[at], limits.velocity[i] / size)
            acceleration[at] = np.fmin(acceleration[at], limits.acceleration[i] / size)
            led[at] = np.fmin(led[at], limits.effort[i] * size)
        effort = np.where(np.isnan(effort), led, effort)
        return JointLimits(lower, upper, velocity, acceleration, effort)

    def passed(self, known: JointLimits, given: JointLimits) -> str:
        """Sentence about joints that pass limits of their own within given limits of the leaders.

        Args:
            known: Limits of all movable joints, (m,).
            given: Limits of the leaders, (n,), some of which a user has set.
        """
        found = []
        for name, mimic in self.follows.items():
            at, i, m = self.leaders.index(mimic.joint), self.joints.index(name), mimic.multiplier
            reach = given.position_lower[at], given.position_upper[at]
            ends = sorted(m * end + mimic.offset for end in reach)
            for words, value, limit in (
                ("lower position", -ends[0], -known.position_lower[i]),
                ("upper position", ends[1], known.position_upper[i]),
                ("velocity", abs(m) * given.velocity[at], known.velocity[i]),
                ("acceleration", abs(m) * given.acceleration[at], known.acceleration[i]),
            ):
                if value > limit + ROUNDING * max(1.0, abs(limit)):  # never where NaN is no limit
                    found.append(f"the {words} limit of {name!r}, which mimics {mimic.joint!r}")
        return f"the limits that are given pass {', '.join(found)}" if found else ""


def _end_of_chain(name: str, known: Mapping[str, Mimic]) -> Mimic:
    """Leader of a joint, with the multiplier and the offset of the whole chain of mimics."""
    mimic, passed = known[name], [name]
    while mimic.joint in known:
        if mimic.joint in passed:
            loop = " mimics ".join(repr(one) for one in [*passed, mimic.joint])
            raise MachineError(f"joint {name!r} mimics itself: {loop}")
        passed.append(mimic.joint)
        ahead = known[mimic.joint]  # q = m (m' y + c') + c
        mimic = Mimic(
            ahead.joint,
            mimic.multiplier * ahead.multiplier,
            mimic.multiplier * ahead.offset + mimic.offset,
        )
    if not np.isfinite([mimic.multiplier, mimic.offset]).all():
        raise MachineError(f"joint {name!r} mimics {mimic.joint!r} with factors that overflow")
    return mimic

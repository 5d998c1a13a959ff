"""Guarantee: the least room that a motion leaves to one constraint."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Guarantee"]


@dataclass(frozen=True, slots=True)
class Guarantee:
    """Least room that a motion leaves to one constraint, at all times and for every corner.

    Room is the distance to the limit in the constraint's own unit, negative where the constraint is
    violated.

    Attributes:
        name: Name of the constraint: "tip_over", "contact", "joint_limits", "base", or that of a
            constraint of the problem.
        label: Row with the least room, in words, such as "left edge".
        value: Guaranteed room; -inf where no bound is known.
        unit: Unit of the value, such as "m" or "N m".
        time: Sampled time at which the room is least [s].
        corner: Payload and slope for which the room is least, in words; empty if neither is
            uncertain.
        proven: Whether the value is proven for all times; otherwise it is the least of 2000 samples
            per second.
        required: Required room: the margin for "tip_over", zero for all others.
    """

    name: str
    label: str
    value: float
    unit: str
    time: float
    corner: str
    proven: bool
    required: float = 0.0

    @property
    def kept(self) -> bool:
        """Whether the guaranteed room is at least the required one."""
        return self.value >= max(self.required, 0.0)

    @property
    def shortfall(self) -> float:
        """Required less guaranteed room, in the unit of the value; not positive where kept."""
        return max(self.required, 0.0) - self.value

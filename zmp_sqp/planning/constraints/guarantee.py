"""Guarantee: the least room that a motion leaves to one constraint; amounts in words."""

from __future__ import annotations

from dataclasses import dataclass

from zmp_sqp.arrays import length_text

__all__ = ["Guarantee", "amount_in_words"]

LEAST_IN_KILO = 1e4  # [N, N m] forces and torques from here on are given in kN and kN m


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


def amount_in_words(value: float, unit: str) -> str:
    """A value with its unit: lengths in m or mm, forces and torques in N, kN, N m or kN m.

    Args:
        value: A finite number.
        unit: SI unit of the value; empty where it is not known.
    """
    if value == 0.0:
        return f"0 {unit}".strip()
    if unit == "m":
        return f"{'-' if value < 0.0 else ''}{length_text(abs(value))}"
    if unit in ("N", "N m") and abs(value) >= LEAST_IN_KILO:
        return f"{1e-3 * value:,.1f} k{unit}"
    return f"{value:.3g} {unit}".strip()

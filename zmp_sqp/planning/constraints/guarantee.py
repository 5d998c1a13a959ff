"""What is guaranteed of one constraint along a whole motion, and amounts of it in words."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Guarantee", "amount_in_words"]

LEAST_IN_METRES = 5e-3  # [m] lengths below are given in millimetres, where metres show only zeros
LEAST_IN_KILO = 1e4  # [N, N m] forces and torques from here on are given in kN and kN m


@dataclass(frozen=True, slots=True)
class Guarantee:
    """Least room that a motion leaves to one constraint, at any time and for every corner.

    Attributes:
        name: Which constraint: "tip_over", "contact", "joint_limits", "base", or the name of a
            constraint of the problem.
        label: Which of its rows has the least room, in words, such as "left edge".
        value: The room that is guaranteed, in the constraint's own unit: at least zero where the
            constraint holds, -inf where nothing can be said.
        unit: Of the value, such as "m" or "N m".
        time: When the room is least among the sampled times [s].
        corner: The payload and slope for which it is least, in words; empty where nothing is
            uncertain.
        proven: Whether the value holds for all times. Otherwise it was only looked at 2000 times a
            second.
        required: Least value that was asked for: the margin for "tip_over", zero for all others.
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
        """Whether the constraint holds with what was asked for."""
        return self.value >= max(self.required, 0.0)

    @property
    def shortfall(self) -> float:
        """By how much the value misses what was asked for; not positive where it is kept."""
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
        small = abs(value) < LEAST_IN_METRES
        return f"{1e3 * value:.2g} mm" if small else f"{value:.3f} m"
    if unit in ("N", "N m") and abs(value) >= LEAST_IN_KILO:
        return f"{1e-3 * value:,.1f} k{unit}"
    return f"{value:.3g} {unit}".strip()

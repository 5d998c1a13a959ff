"""What is guaranteed of one constraint along a whole motion."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Guarantee"]


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

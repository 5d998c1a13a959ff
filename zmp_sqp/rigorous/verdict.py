"""What a second opinion found: one verdict per guarantee."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

__all__ = ["RigorousCheck", "RigorousGuarantee", "Verdict"]


class Verdict(StrEnum):
    """Verdict on one guarantee."""

    CONFIRMED = "confirmed"
    REFUTED = "refuted"
    UNDECIDED = "undecided"
    NOT_CHECKED = "not looked at"


@dataclass(frozen=True, slots=True)
class RigorousGuarantee:
    """Enclosure of the least room that a motion leaves to one constraint at any time.

    Both bounds hold with certainty: all arithmetic is on balls that contain the exact numbers.

    Attributes:
        name: Name of the guarantee, as in `Certificate.guarantees`; or "continuity".
        label: Row with the least room, in words, such as "left edge".
        verdict: Whether the room is at least the required one at all times.
        required: Room that was asked for.
        lower: Lower bound on the room at all times and corners; -inf if there is none.
        upper: Room at `time`, rounded up: no lower bound can be above it; inf if not found.
        unit: Unit of the numbers.
        time: Time of `upper` [s]; where the verdict is "refuted", the room is too small there.
        corner: Payload and slope of `upper`, in words; empty if nothing is uncertain.
        reason: Why nothing was decided, or was not looked at; empty otherwise.
    """

    name: str
    label: str
    verdict: Verdict
    required: float
    lower: float
    upper: float
    unit: str
    time: float
    corner: str = ""
    reason: str = ""

    @property
    def missing(self) -> float:
        """Required room less the lower bound; not positive where it is confirmed."""
        return self.required - self.lower


@dataclass(frozen=True, slots=True)
class RigorousCheck:
    """Verdicts of `check_rigorously`.

    Attributes:
        guarantees: One per guarantee.
        stretches: Number of stretches of time that were evaluated.
    """

    guarantees: tuple[RigorousGuarantee, ...]
    stretches: int

    @property
    def confirmed(self) -> bool:
        """Whether every guarantee that was looked at is confirmed."""
        return all(
            found.verdict in (Verdict.CONFIRMED, Verdict.NOT_CHECKED) for found in self.guarantees
        )

    @property
    def refuted(self) -> bool:
        """Whether any guarantee is refuted."""
        return any(found.verdict is Verdict.REFUTED for found in self.guarantees)

    def __getitem__(self, name: str) -> RigorousGuarantee:
        """First guarantee of a name.

        Raises:
            KeyError: There is none.
        """
        for found in self.guarantees:
            if found.name == name:
                return found
        raise KeyError(name)

"""Samples of a joint motion: times with positions, and what else a logger or planner gives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.errors import TrajectoryError

__all__ = ["QUANTITIES", "Samples"]

# derivatives of a joint coordinate, by their order
QUANTITIES = ("position", "velocity", "acceleration", "jerk", "snap", "crackle")
# share of third differences that count, and their mean square per variance of normal ones
KEPT_SHARE, KEPT_VARIANCE = 0.9, 0.623


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Samples of n joints at K times, as they stand in a file.

    Attributes:
        source: Path of the file, for messages.
        joint_names: Names of the n joints.
        rows: Name of every sample in messages, such as "row 7" or "point 3".
        times: Shape (K,) [s].
        values: Quantities that the file gives, by the names of `QUANTITIES`, shape (K, n) each.
        base: Base motion in the format of `UnicycleMotion.table`, shape (K, 9); None if there is
            none.
        ignored: Names of columns or joints that were left out.
        rounding: Largest error of times and of each quantity, in its unit, by the digits of the
            file, or by the noise of each joint, shape (n,); None is zero.
        converted: Whether units that the file gives beside its columns were converted.

    Raises:
        TrajectoryError: Fewer than two samples, no positions, an entry that is not finite, or times
            that do not increase; the message names file, row and column.
    """

    source: str
    joint_names: tuple[str, ...]
    rows: tuple[str, ...]
    times: Array
    values: dict[str, Array]
    base: Array | None = None
    ignored: tuple[str, ...] = ()
    rounding: Mapping[str, Any] | None = None
    converted: bool = False

    def __post_init__(self) -> None:
        if len(self.times) < 2:
            raise TrajectoryError(
                f"{self.source}: a motion needs at least 2 samples, not {len(self.times)}"
            )
        if "position" not in self.values:
            raise TrajectoryError(
                f"{self.source}: a motion needs the position of every joint: "
                f"{', '.join(self.joint_names)}"
            )
        self._check_finite("time", self.times[:, None], ("",))
        for quantity, values in self.values.items():
            self._check_finite(quantity, values, self.joint_names)
        for late in np.flatnonzero(np.diff(self.times) <= 0.0).tolist():
            before, after = self.times[late], self.times[late + 1]
            fault = "is that of" if after == before else "is before that of"
            raise TrajectoryError(
                f"{self.source}: {self.rows[late + 1]}: time {after:.9g} s {fault} "
                f"{self.rows[late]} ({before:.9g} s); times must increase"
            )

    def _check_finite(self, quantity: str, values: Array, joints: tuple[str, ...]) -> None:
        """Raise TrajectoryError for the first entry that is not finite."""
        for row, column in np.argwhere(~np.isfinite(values)).tolist():
            of = f" of joint {joints[column]!r}" if joints[column] else ""
            raise TrajectoryError(
                f"{self.source}: {self.rows[row]}: {quantity}{of} must be a finite number, not "
                f"{values[row, column]}"
            )

    @property
    def given(self) -> tuple[str, ...]:
        """Quantities that the file gives, by their order."""
        return tuple(quantity for quantity in QUANTITIES if quantity in self.values)

    def apparent_noise(self) -> Array:
        """Standard deviation of the noise that neighbouring positions show, (n,) [rad or m].

        It is estimated from third differences, which leave little of a smooth motion and have 20
        times the variance of independent noise. The tenth that are largest, as where accelerations
        jump, are left out.
        """
        third = np.sort(np.abs(np.diff(self.values["position"], n=3, axis=0)), axis=0)
        kept = third[: max(1, int(KEPT_SHARE * len(third)))]
        return np.asarray(np.sqrt((kept**2).mean(axis=0) / (20.0 * KEPT_VARIANCE)))

    def error_of(self, quantity: str) -> Any:
        """Largest rounding error of a quantity or of "time": a number, or one per joint (n,)."""
        return (self.rounding or {}).get(quantity, 0.0)

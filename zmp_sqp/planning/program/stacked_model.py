"""Several wrenches at one state: those of all the payloads and slopes that a motion must be safe for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.planning.program.model import StageModel

__all__ = ["StackedModel"]


@dataclass(frozen=True, slots=True, eq=False)
class StackedModel:
    """Stage models of the same coordinates, one per corner of what is uncertain; V wrenches, one below the other.

    Attributes:
        parts: V models, of one wrench each.
    """

    parts: tuple[StageModel, ...]

    @property
    def size(self) -> int:
        """Number n of coordinates."""
        return self.parts[0].size

    @property
    def extra_rows(self) -> int:
        """Number of rows of `extra`, which knows no payload."""
        return self.parts[0].extra_rows

    def wrench(
        self, q: Array, w: Array, alpha: Array, S: float, places: Array | None = None
    ) -> Array:
        """S times the ground reaction wrenches, shape (K, 6 V) [N s^2, N m s^2]."""
        return np.hstack([model.wrench(q, w, alpha, S, places) for model in self.parts])

    def wrench_derivatives(
        self, q: Array, w: Array, alpha: Array, S: float, places: Array | None = None
    ) -> tuple[Array, Array]:
        """The same with their derivatives by (q, w, alpha, S, places), shapes (K, 6 V) and (K, 6 V, 3n + 1 + m)."""
        wrenches, slopes = zip(
            *(model.wrench_derivatives(q, w, alpha, S, places) for model in self.parts), strict=True
        )
        return np.hstack(wrenches), np.concatenate(slopes, axis=1)

    def extra(self, q: Array, w: Array, alpha: Array, S: float) -> tuple[Array, Array]:
        """Other rows than the wrenches'."""
        return self.parts[0].extra(q, w, alpha, S)

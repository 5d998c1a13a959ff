"""Sparsity patterns of the staged program, shared by all programs of the same shape."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from zmp_sqp.arrays import Indices
from zmp_sqp.planning.program.limits import LimitKinds, limit_columns
from zmp_sqp.planning.program.stages import CACHED, Shape, stage_columns, state_columns
from zmp_sqp.sqp.rows import Pattern

__all__ = ["Patterns", "patterns_of"]


@dataclass(frozen=True, slots=True, eq=False)
class Patterns:
    """Sparsity patterns of Hessian H, inequality Jacobian C and equality Jacobian A.

    A is None for a base that stands.
    """

    H: Pattern
    C: Pattern
    A: Pattern | None


@lru_cache(maxsize=CACHED)
def patterns_of(shape: Shape, gaps: int, rows: int, kinds: LimitKinds) -> Patterns:
    """Patterns of a program.

    Args:
        shape: Of its stages.
        gaps: Number of intervals at whose ends the position of a driving base has a gap.
        rows: Number of nonlinear rows per interval in C.
        kinds: Limits that have rows.
    """
    columns, size, positions = stage_columns(shape), shape.size, shape.positions
    m = columns.shape[1]
    H = Pattern(
        np.repeat(columns, m, axis=1).ravel(),
        np.tile(columns, (1, m)).ravel(),
        (size, size),
        upper=True,
    )
    groups = [np.repeat(columns, rows, axis=0), *limit_columns(shape, kinds)]
    C = Pattern(*_entry_indices(groups), (sum(len(group) for group in groups), size))
    if not positions:
        return Patterns(H, C, None)
    row = np.arange(positions * gaps).reshape(gaps, positions)
    after = state_columns(shape)[1 : gaps + 1, -positions:]
    A = Pattern(
        np.concatenate([np.repeat(row, m, axis=1).ravel(), row.ravel()]),
        np.concatenate([np.repeat(columns[:gaps], positions, axis=0).ravel(), after.ravel()]),
        (positions * gaps, size),
    )
    return Patterns(H, C, A)


def _entry_indices(groups: list[Indices]) -> tuple[Indices, Indices]:
    """Row and column indices of the entries, from the columns of each row, group by group."""
    widths = np.concatenate([np.full(len(group), group.shape[1]) for group in groups])
    rows = np.repeat(np.arange(len(widths)), widths)
    return rows, np.concatenate([group.ravel() for group in groups])

"""Path constraints for tests, written as a user would write them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

import zmp_sqp as zs


def rate_rows(
    limit: float, *, joint: int = 0, proven: bool = True, name: str = "rate"
) -> zs.PathRows:
    """|rate| of one joint at most `limit`; its second derivative in time is the jerk."""

    def rows(machine: zs.Machine, q: Any, v: Any, a: Any) -> tuple[np.ndarray, np.ndarray]:
        jacobian = np.zeros((len(q), 2, 3 * machine.size))
        jacobian[:, 0, machine.size + joint], jacobian[:, 1, machine.size + joint] = 1.0, -1.0
        rate = v[:, joint]
        return np.column_stack([rate, -rate]) - limit, jacobian

    def jerk(machine: zs.Machine, v: Any, a: Any, j: Any) -> np.ndarray:
        return np.column_stack([j[:, joint]] * 2)

    return zs.PathRows(
        name,
        rows,
        labels=["forwards", "backwards"],
        units=["rad/s"] * 2,
        curvature_bound=jerk if proven else None,
    )


@dataclass(frozen=True, slots=True)
class RateLimit:
    """The rate of one joint stays below a limit.

    Attributes:
        limit: [rad/s].
        joint: Its index.
        proven: Whether there is a bound on curvature.
    """

    limit: float
    joint: int = 0
    proven: bool = True
    name = "rate_limit"

    def __post_init__(self) -> None:
        if self.limit <= 0.0:
            raise zs.ProblemError(f"limit must be positive, not {self.limit}")

    def rows(self, machine: zs.Machine, coordinates: Any) -> Any:
        rows = rate_rows(self.limit, joint=self.joint, proven=self.proven)
        return rows.rows(machine, coordinates)

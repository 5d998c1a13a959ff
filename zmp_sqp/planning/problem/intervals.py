"""Number of intervals that suits a number of joints."""

from __future__ import annotations

__all__ = ["MANY_JOINTS", "suggested_intervals"]

MANY_JOINTS = 12  # the most for which a plan with `USUAL` intervals takes milliseconds
USUAL = 50
# Upper bodies with 15 to 46 joints (benchmarks/robots.py): 24 intervals take half as long as 50
# and lose at most 0.1 % of the duration, or up to 3 % where tip-over costs much; 16 lose up to
# 0.25 % elsewhere. 25 take nearly as long as 50: they have no grid half as fine for the first step
FEW = 24


def suggested_intervals(joints: int) -> int:
    """Number N of intervals: 50 for at most 12 planned joints, 24 for more."""
    return USUAL if joints <= MANY_JOINTS else FEW

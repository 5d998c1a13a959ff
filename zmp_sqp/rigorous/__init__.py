"""A second opinion on a motion: its guarantees decided anew in ball arithmetic."""

from zmp_sqp.rigorous.check import check_rigorously
from zmp_sqp.rigorous.verdict import RigorousCheck, RigorousGuarantee, Verdict

__all__ = ["RigorousCheck", "RigorousGuarantee", "Verdict", "check_rigorously"]

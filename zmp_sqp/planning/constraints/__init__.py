"""Path constraints: conditions on a motion at all times, beside the limits of joints and base."""

from zmp_sqp.planning.constraints.distance import DistanceLimits
from zmp_sqp.planning.constraints.guarantee import Guarantee
from zmp_sqp.planning.constraints.protocol import ConstraintRows, PathConstraint
from zmp_sqp.planning.constraints.tip_over import Contact, TipOver

__all__ = [
    "ConstraintRows",
    "Contact",
    "DistanceLimits",
    "Guarantee",
    "PathConstraint",
    "TipOver",
]

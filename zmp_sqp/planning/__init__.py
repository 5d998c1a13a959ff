"""Minimum-time motion planning: problem, nonlinear program, search, proof, closed forms."""

from typing import TYPE_CHECKING

from zmp_sqp.lazy import at_first_use
from zmp_sqp.mechanics.lumped_mass import LumpedMass, simplified_coordinates
from zmp_sqp.motion.root_motion import trajectory_zmp
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.motion.unicycle_motion import UnicycleMotion
from zmp_sqp.planning.constraints import DistanceLimits, Guarantee, PathConstraint
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.problem.unicycle_base import UnicycleBase
from zmp_sqp.planning.proof.certificate import Certificate, certify

if TYPE_CHECKING:
    from zmp_sqp.planning.closed_forms.base_bound import (
        base_acceleration_bound,
        moving_base_zmp,
        plan_base,
    )
    from zmp_sqp.planning.closed_forms.base_motion import BaseMotion
    from zmp_sqp.planning.closed_forms.phase_plane import phase_plane
    from zmp_sqp.planning.closed_forms.slew import analytic_slew, analytic_slew_duration
    from zmp_sqp.planning.closed_forms.slew_circle import SlewInsight, slew_insight
    from zmp_sqp.planning.search.answer import Plan, Status
    from zmp_sqp.planning.search.diagnosis import Diagnosis, diagnose
    from zmp_sqp.planning.search.plan_table import table
    from zmp_sqp.planning.search.planner import plan
else:
    __getattr__, __dir__ = at_first_use(
        __name__,
        {
            "zmp_sqp.planning.closed_forms.base_bound": (
                "base_acceleration_bound moving_base_zmp plan_base"
            ),
            "zmp_sqp.planning.closed_forms.base_motion": "BaseMotion",
            "zmp_sqp.planning.closed_forms.phase_plane": "phase_plane",
            "zmp_sqp.planning.closed_forms.slew": "analytic_slew analytic_slew_duration",
            "zmp_sqp.planning.closed_forms.slew_circle": "SlewInsight slew_insight",
            "zmp_sqp.planning.search.answer": "Plan Status",
            "zmp_sqp.planning.search.diagnosis": "Diagnosis diagnose",
            "zmp_sqp.planning.search.plan_table": "table",
            "zmp_sqp.planning.search.planner": "plan",
        },
    )

__all__ = [
    "BaseMotion",
    "Certificate",
    "Diagnosis",
    "DistanceLimits",
    "Guarantee",
    "LumpedMass",
    "PathConstraint",
    "Plan",
    "Problem",
    "SlewInsight",
    "Status",
    "Trajectory",
    "UnicycleBase",
    "UnicycleMotion",
    "analytic_slew",
    "analytic_slew_duration",
    "base_acceleration_bound",
    "certify",
    "diagnose",
    "moving_base_zmp",
    "phase_plane",
    "plan",
    "plan_base",
    "simplified_coordinates",
    "slew_insight",
    "table",
    "trajectory_zmp",
]

"""From a problem to a plan: transcription in normalised time, SQP, trajectory, baseline."""

from zmp_sqp.planning.answer import Plan, Status
from zmp_sqp.planning.base_bound import base_acceleration_bound, moving_base_zmp, plan_base
from zmp_sqp.planning.base_motion import BaseMotion
from zmp_sqp.planning.baseline import phase_plane
from zmp_sqp.planning.certificate import Certificate, certify
from zmp_sqp.planning.diagnosis import Diagnosis, diagnose
from zmp_sqp.planning.planner import plan
from zmp_sqp.planning.problem import Problem
from zmp_sqp.planning.root_motion import trajectory_zmp
from zmp_sqp.planning.simplified import DistanceLimits, LumpedMass, simplified_coordinates
from zmp_sqp.planning.slew import analytic_slew, analytic_slew_duration
from zmp_sqp.planning.slew_circle import SlewInsight, slew_insight
from zmp_sqp.planning.trajectory import Trajectory
from zmp_sqp.planning.unicycle import UnicycleBase
from zmp_sqp.planning.unicycle_motion import UnicycleMotion

__all__ = [
    "BaseMotion",
    "Certificate",
    "Diagnosis",
    "DistanceLimits",
    "LumpedMass",
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
    "trajectory_zmp",
]

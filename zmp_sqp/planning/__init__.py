"""From a problem to a plan: transcription in normalised time, SQP, trajectory, baseline."""

from zmp_sqp.planning.answer import Plan, Status
from zmp_sqp.planning.baseline import phase_plane
from zmp_sqp.planning.certificate import Certificate, certify
from zmp_sqp.planning.planner import plan
from zmp_sqp.planning.problem import Problem
from zmp_sqp.planning.simplified import DistanceLimits, LumpedMass, simplified_coordinates
from zmp_sqp.planning.trajectory import Trajectory

__all__ = [
    "Certificate",
    "DistanceLimits",
    "LumpedMass",
    "Plan",
    "Problem",
    "Status",
    "Trajectory",
    "certify",
    "phase_plane",
    "plan",
    "simplified_coordinates",
]

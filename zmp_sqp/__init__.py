"""Minimum-time motions of heavy mobile manipulators that provably do not tip over.

The road of the data runs one way: URDF -> Machine -> Problem -> QPs -> Trajectory -> Plan.
"""

from zmp_sqp.errors import (
    ContactLost,
    MachineError,
    NotSolved,
    ProblemError,
    ScenarioError,
    TrajectoryError,
    ZmpSqpError,
)
from zmp_sqp.mechanics import (
    Ground,
    JointLimits,
    Machine,
    Payload,
    Slope,
    SupportPolygon,
    load_machine,
    shipped_machines,
    stability_margin,
    zmp,
)
from zmp_sqp.planning import Certificate, DistanceLimits, Plan, Problem, Status, Trajectory, certify, phase_plane, plan

__version__ = "0.1.0"

__all__ = [
    "Certificate",
    "ContactLost",
    "DistanceLimits",
    "Ground",
    "JointLimits",
    "Machine",
    "MachineError",
    "NotSolved",
    "Payload",
    "Plan",
    "Problem",
    "ProblemError",
    "ScenarioError",
    "Slope",
    "Status",
    "SupportPolygon",
    "Trajectory",
    "TrajectoryError",
    "ZmpSqpError",
    "certify",
    "load_machine",
    "phase_plane",
    "plan",
    "shipped_machines",
    "stability_margin",
    "zmp",
]

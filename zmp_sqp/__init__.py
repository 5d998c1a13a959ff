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
from zmp_sqp.planning import (
    BaseMotion,
    Certificate,
    DistanceLimits,
    Plan,
    Problem,
    SlewInsight,
    Status,
    Trajectory,
    analytic_slew,
    analytic_slew_duration,
    base_acceleration_bound,
    certify,
    moving_base_zmp,
    phase_plane,
    plan,
    plan_base,
    slew_insight,
)

__version__ = "0.1.0"

__all__ = [
    "BaseMotion",
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
    "SlewInsight",
    "Slope",
    "Status",
    "SupportPolygon",
    "Trajectory",
    "TrajectoryError",
    "ZmpSqpError",
    "analytic_slew",
    "analytic_slew_duration",
    "base_acceleration_bound",
    "certify",
    "load_machine",
    "moving_base_zmp",
    "phase_plane",
    "plan",
    "plan_base",
    "shipped_machines",
    "slew_insight",
    "stability_margin",
    "zmp",
]

"""Minimum-time motions of heavy mobile manipulators that provably do not tip over.

The road of the data runs one way: URDF -> Machine -> Problem -> QPs -> Trajectory -> Plan.
"""

from typing import TYPE_CHECKING

from zmp_sqp.errors import (
    ContactLost,
    Interrupted,
    MachineError,
    MachineWarning,
    MissingExtra,
    NotSolved,
    ProblemError,
    ProblemWarning,
    ScenarioError,
    TrajectoryError,
    UnboundedAcceleration,
    ZmpSqpError,
)
from zmp_sqp.lazy import at_first_use
from zmp_sqp.mechanics import (
    Ground,
    JointLimits,
    Machine,
    Payload,
    Slope,
    StabilityMeasures,
    SupportPolygon,
    load_machine,
    shipped_machines,
    stability_margin,
    stability_measures,
    zmp,
)
from zmp_sqp.planning import (
    Certificate,
    DistanceLimits,
    Guarantee,
    PathConstraint,
    Problem,
    Trajectory,
    UnicycleBase,
    certify,
    trajectory_zmp,
)
from zmp_sqp.planning.constraints import registry as _registry
from zmp_sqp.planning.constraints.registry import *  # noqa: F403 - what is known by name
from zmp_sqp.versions import __version__ as __version__

if TYPE_CHECKING:
    from zmp_sqp import plots
    from zmp_sqp.charts import LoadChart, SwingChart, load_chart, swing_chart
    from zmp_sqp.control import Planner, plan_stop
    from zmp_sqp.mechanics import Heightmap, Inspection, inspect
    from zmp_sqp.motion import RecordedMotion, export_motion, read_motion
    from zmp_sqp.planning import (
        BaseMotion,
        Diagnosis,
        Plan,
        SlewInsight,
        Status,
        analytic_slew,
        analytic_slew_duration,
        base_acceleration_bound,
        diagnose,
        moving_base_zmp,
        phase_plane,
        plan,
        plan_base,
        slew_insight,
        table,
    )
    from zmp_sqp.rigorous import RigorousCheck, RigorousGuarantee, check_rigorously
    from zmp_sqp.simulation import Replay, replay
    from zmp_sqp.studies import plan_many
else:
    __getattr__, __dir__ = at_first_use(
        __name__,
        {
            "zmp_sqp.charts": "LoadChart SwingChart load_chart swing_chart",
            "zmp_sqp.control": "Planner plan_stop",
            "zmp_sqp.mechanics": "Heightmap Inspection inspect",
            "zmp_sqp.motion": "RecordedMotion export_motion read_motion",
            "zmp_sqp.planning": (
                "BaseMotion Diagnosis Plan SlewInsight Status analytic_slew "
                "analytic_slew_duration base_acceleration_bound diagnose moving_base_zmp "
                "phase_plane plan plan_base slew_insight table"
            ),
            "zmp_sqp.plots": "",
            "zmp_sqp.rigorous": "RigorousCheck RigorousGuarantee check_rigorously",
            "zmp_sqp.simulation": "Replay replay",
            "zmp_sqp.studies": "plan_many",
        },
    )

__all__ = [
    "BaseMotion",
    "Certificate",
    "ContactLost",
    "Diagnosis",
    "DistanceLimits",
    "Ground",
    "Guarantee",
    "Heightmap",
    "Inspection",
    "Interrupted",
    "JointLimits",
    "LoadChart",
    "Machine",
    "MachineError",
    "MachineWarning",
    "MissingExtra",
    "NotSolved",
    "PathConstraint",
    "Payload",
    "Plan",
    "Planner",
    "Problem",
    "ProblemError",
    "ProblemWarning",
    "RecordedMotion",
    "Replay",
    "RigorousCheck",
    "RigorousGuarantee",
    "ScenarioError",
    "SlewInsight",
    "Slope",
    "StabilityMeasures",
    "Status",
    "SupportPolygon",
    "SwingChart",
    "Trajectory",
    "TrajectoryError",
    "UnboundedAcceleration",
    "UnicycleBase",
    "ZmpSqpError",
    "analytic_slew",
    "analytic_slew_duration",
    "base_acceleration_bound",
    "certify",
    "check_rigorously",
    "diagnose",
    "export_motion",
    "inspect",
    "load_chart",
    "load_machine",
    "moving_base_zmp",
    "phase_plane",
    "plan",
    "plan_base",
    "plan_many",
    "plan_stop",
    "plots",
    "read_motion",
    "replay",
    "shipped_machines",
    "slew_insight",
    "stability_margin",
    "stability_measures",
    "swing_chart",
    "table",
    "trajectory_zmp",
    "zmp",
]
__all__ += _registry.names()

"""Mechanics: from a URDF to the ground reaction wrench and the zero moment point (ZMP).

Machine, payload, ground and support polygon, with all derivatives that planning needs. Nothing in
here depends on optimisation.
"""

from typing import TYPE_CHECKING

from zmp_sqp.lazy import at_first_use
from zmp_sqp.mechanics.ground import GRAVITY, Ground, Slope, Terrain
from zmp_sqp.mechanics.ground_motion import GroundMotion, GroundRates
from zmp_sqp.mechanics.limits import JointLimits
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.payload import Payload
from zmp_sqp.mechanics.stability_measures import StabilityMeasures, stability_measures
from zmp_sqp.mechanics.support import SupportPolygon
from zmp_sqp.mechanics.urdf.loader import load_machine, shipped_machines
from zmp_sqp.mechanics.wrench import WrenchDerivatives, ground_reaction, ground_reaction_derivatives
from zmp_sqp.mechanics.zero_moment_point import stability_margin, zmp, zmp_of_wrench

if TYPE_CHECKING:
    from zmp_sqp.mechanics.inspection import Inspection, inspect
    from zmp_sqp.mechanics.terrain.heightmap import Heightmap
else:
    __getattr__, __dir__ = at_first_use(
        __name__,
        {
            "zmp_sqp.mechanics.inspection": "Inspection inspect",
            "zmp_sqp.mechanics.terrain.heightmap": "Heightmap",
        },
    )

__all__ = [
    "GRAVITY",
    "Ground",
    "GroundMotion",
    "GroundRates",
    "Heightmap",
    "Inspection",
    "JointLimits",
    "Machine",
    "Payload",
    "Slope",
    "StabilityMeasures",
    "SupportPolygon",
    "Terrain",
    "WrenchDerivatives",
    "ground_reaction",
    "ground_reaction_derivatives",
    "inspect",
    "load_machine",
    "shipped_machines",
    "stability_margin",
    "stability_measures",
    "zmp",
    "zmp_of_wrench",
]

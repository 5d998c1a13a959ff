"""Physics simulation of planned motions in MuJoCo.

MuJoCo is an optional dependency and is imported only when it is used.
"""

from zmp_sqp.simulation.outcome import Replay
from zmp_sqp.simulation.physics import replay
from zmp_sqp.simulation.servo import ServoMachine

__all__ = ["Replay", "ServoMachine", "replay"]

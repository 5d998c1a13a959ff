"""Physics replay of motions in MuJoCo, which is an extra: nothing here imports it before it is used."""

from zmp_sqp.simulation.outcome import Replay
from zmp_sqp.simulation.physics import replay

__all__ = ["Replay", "replay"]

"""Reading a URDF file: links, joints, limits, contact shapes."""

from zmp_sqp.mechanics.urdf.loader import load_machine, shipped_machines

__all__ = ["load_machine", "shipped_machines"]

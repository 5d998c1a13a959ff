"""Reading of URDF files: links, joints, joint limits and contact shapes."""

from zmp_sqp.mechanics.urdf.loader import load_machine, shipped_machines

__all__ = ["load_machine", "shipped_machines"]

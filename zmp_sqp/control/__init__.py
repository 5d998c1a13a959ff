"""Planning in the control loop: warm starts, time budgets, certified stops."""

from zmp_sqp.control.planner import Planner
from zmp_sqp.control.stop import plan_stop
from zmp_sqp.sqp.backends import loaded as _loaded  # noqa: F401 - not within a time budget

__all__ = ["Planner", "plan_stop"]

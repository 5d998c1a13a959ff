"""Planning in the control loop: warm starts, time budgets, certified stops."""

from zmp_sqp.control.planner import Planner
from zmp_sqp.control.stop import plan_stop

__all__ = ["Planner", "plan_stop"]

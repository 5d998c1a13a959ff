"""Planning in the control loop: warm starts, time budgets, certified stops."""

# what is otherwise imported by the first plan that needs it: not within a time budget
import threadpoolctl as _threadpoolctl  # noqa: F401

from zmp_sqp.control.planner import Planner
from zmp_sqp.control.stop import plan_stop
from zmp_sqp.planning.proof import effort_chords as _effort_chords  # noqa: F401
from zmp_sqp.sqp.backends import loaded as _loaded  # noqa: F401

__all__ = ["Planner", "plan_stop"]

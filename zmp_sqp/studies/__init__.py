"""Studies of many plans: parallel planning, and what is made of the results."""

from zmp_sqp.studies.many import plan_many

__all__ = ["plan_many"]

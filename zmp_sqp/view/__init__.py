"""Live view: a page on loopback that plans again while start, goal and settings are dragged."""

from zmp_sqp.view.server import ViewServer
from zmp_sqp.view.session import Session
from zmp_sqp.view.subject import Subject, subject_of_machine, subject_of_plan, subject_of_scenario

__all__ = [
    "Session",
    "Subject",
    "ViewServer",
    "subject_of_machine",
    "subject_of_plan",
    "subject_of_scenario",
]

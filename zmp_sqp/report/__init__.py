"""Report of a plan: one offline page with the machine in 3-D, its margins and what it rests on."""

from zmp_sqp.report.page import make_page
from zmp_sqp.report.record import RECORD_KEYS, make_record

__all__ = ["RECORD_KEYS", "make_page", "make_record"]

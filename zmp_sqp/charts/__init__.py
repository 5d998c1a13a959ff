"""Load charts: what a machine may lift where, at rest and while it swings."""

from zmp_sqp.charts.chart import NOT_A_SUBSTITUTE, ChartPoints, LoadChart
from zmp_sqp.charts.load_chart import load_chart
from zmp_sqp.charts.swing import Swing, SwingChart, SwingLoad, swing_chart

__all__ = [
    "NOT_A_SUBSTITUTE",
    "ChartPoints",
    "LoadChart",
    "Swing",
    "SwingChart",
    "SwingLoad",
    "load_chart",
    "swing_chart",
]

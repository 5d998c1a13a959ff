"""Figures of plans, motions, studies, load charts and machines, as matplotlib figures.

Every function takes values of this library and returns a `matplotlib.figure.Figure`, made without
pyplot: no display is needed, nothing is left open, and threads may draw at the same time. `save`,
or the figure's own `savefig`, writes SVG, PDF or PNG; text stays text in vector files. matplotlib
is imported with the first figure (extra `plots`).
"""

from zmp_sqp.plots.canvas import save
from zmp_sqp.plots.chart_pictures import load_chart, swing_chart
from zmp_sqp.plots.constraint_rooms import margins
from zmp_sqp.plots.loci import locus
from zmp_sqp.plots.machine_picture import machine
from zmp_sqp.plots.motion_profiles import profiles
from zmp_sqp.plots.search_history import convergence
from zmp_sqp.plots.strips import film_strip
from zmp_sqp.plots.study_maps import envelope, tradeoff

__all__ = [
    "convergence",
    "envelope",
    "film_strip",
    "load_chart",
    "locus",
    "machine",
    "margins",
    "profiles",
    "save",
    "swing_chart",
    "tradeoff",
]

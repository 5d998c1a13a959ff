"""Figure of matplotlib that is saved with its text as text, which importing this module needs."""

from __future__ import annotations

from threading import RLock
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

__all__ = ["VectorFigure"]

# text stays text in vector files (matplotlib draws outlines of letters otherwise), and what is
# named by a random number there has the same name in each run
SETTINGS: Any = {"svg.fonttype": "none", "pdf.fonttype": 42, "svg.hashsalt": "zmp_sqp"}
UNDATED: dict[str, dict[str, None]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
SAVING = RLock()  # settings of matplotlib are global


class VectorFigure(Figure):
    """Figure whose vector files have text as text and no date, so that they can be compared."""

    def savefig(self, fname: Any, **options: Any) -> None:
        """Save as `matplotlib.figure.Figure.savefig` does, under the settings of this class.

        Args:
            fname: Path or file.
            **options: Those of matplotlib.
        """
        ending = str(options.get("format") or fname).rpartition(".")[2].lower()
        if ending in UNDATED:
            options = {"metadata": UNDATED[ending], **options}
        with SAVING, mpl.rc_context(SETTINGS):
            super().savefig(fname, **options)

"""What the benchmarks share: the unit F, versions, distributions, tables, JSON."""

from __future__ import annotations

import json
import os
import platform
import time
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from rich.console import Console
from rich.table import Table

import zmp_sqp as zs

__all__ = ["console", "distribution", "measure_F", "print_table", "save_json", "versions"]

PACKAGES = (
    "numpy",
    "scipy",
    "pin",
    "proxsuite",
    "piqp",
    "qpsolvers",
    "clarabel",
    "daqp",
    "casadi",
    "mujoco",
)
EVALUATIONS = 100  # one F: both ends of 50 intervals
QUANTILES = (
    ("min", 0),
    ("25 %", 25),
    ("50 %", 50),
    ("75 %", 75),
    ("90 %", 90),
    ("99 %", 99),
    ("max", 100),
)

console = Console(width=140, highlight=False)


def measure_F(machine: zs.Machine, *, repeats: int = 51) -> float:
    """F [s]: processor time of 100 `pin.computeRNEADerivatives` calls on this machine's model, median of many."""
    model, data, rng = machine.model, machine.model.createData(), np.random.default_rng(0)
    q = machine.configuration(rng.uniform(-1.0, 1.0, (EVALUATIONS, machine.size)))
    v, a = rng.uniform(-1.0, 1.0, (2, EVALUATIONS, model.nv))
    rows, evaluate, times = list(zip(q, v, a, strict=True)), pin.computeRNEADerivatives, []
    for _ in range(repeats):
        started = time.process_time()
        for one_q, one_v, one_a in rows:
            evaluate(model, data, one_q, one_v, one_a)
        times.append(time.process_time() - started)
    return float(np.median(times))


def distribution(values: Sequence[float]) -> dict[str, float]:
    """Quantiles, from the least to the largest."""
    return {name: float(np.percentile(values, share)) for name, share in QUANTILES}


def versions() -> dict[str, str]:
    """What was measured with what."""
    found = {
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}",
    }
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found | {"zmp_sqp": zs.__version__}


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    """One table on the terminal; the first column is left-aligned."""
    table = Table(title=title, title_justify="left")
    for i, column in enumerate(columns):
        table.add_column(column, justify="left" if i == 0 else "right")
    for row in rows:
        table.add_row(*(entry if isinstance(entry, str) else f"{entry:.4g}" for entry in row))
    console.print(table)


def save_json(
    path: Path, content: Mapping[str, Any], *, rows: Sequence[Sequence[Any]] = ()
) -> None:
    """Content with versions and date; `rows` follow one a line, so that differences between runs can be read."""
    path.parent.mkdir(parents=True, exist_ok=True)
    # above the number of processors: others were at work
    load = [round(share, 2) for share in os.getloadavg()]
    stamped = {"date": time.strftime("%Y-%m-%d"), "load": load, "versions": versions(), **content}
    head = json.dumps(stamped, indent=1).removesuffix("\n}")
    body = ",\n".join(f"  {json.dumps(row)}" for row in rows)
    path.write_text(f'{head},\n "rows": [\n{body}\n ]\n}}\n', encoding="utf-8")
    console.print(f"written to {path}")

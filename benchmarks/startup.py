"""How long the package takes to import, and a new process to its first certified plan.

Every measurement is a new Python process, which tells its own processor time, start of Python
included, once its code has run; what processes do at their exit is left out. Kinds of processes
take turns, so that other programs on the computer disturb all of them alike. Bytecode is written
beforehand, to a folder of its own.

The unit is the import of numpy and pinocchio, on which everything here stands. A limit that is
exceeded ends the benchmark with exit code 1.

    python -m benchmarks.startup --json benchmarks/results/startup.json
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from benchmarks.harness import benchmark_parser, console, exit_code, print_table, save_json

__all__ = ["CASES", "LIMITS", "main", "measured"]

PLAN = """
import zmp_sqp as zs
from zmp_sqp.scenario import load_scenario
if not zs.plan(load_scenario("paper_1").problem).success:
    raise SystemExit("paper_1 is not certified")
"""
UNIT = "import numpy, pinocchio"
CASES = {  # code by the words of the table
    "start of Python": "",
    UNIT: UNIT,
    "import zmp_sqp": "import zmp_sqp",
    "zs.Planner, with all solvers": "import zmp_sqp as zs; zs.Planner",
    "import numpy, pinocchio, scipy.sparse": "import numpy, pinocchio, scipy.sparse",
    "certified plan of paper_1": PLAN,
}
LIMITS = {"import zmp_sqp": 1.7, "certified plan of paper_1": 3.3}  # in units
TELL = "\nimport time; print(time.process_time())"
ROOT = Path(__file__).resolve().parents[1]


def measured(code: str, environment: Mapping[str, str]) -> float:
    """Processor time of a new process after some code [s]."""
    command = [sys.executable, "-c", code + TELL]
    run = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True)
    if run.returncode:
        raise RuntimeError(f"{code!r} failed: {run.stderr}")
    return float(run.stdout)


def main() -> int:
    """Run the benchmark; exit code 0 if no limit is exceeded."""
    parser = benchmark_parser(__doc__)
    parser.add_argument("--repeats", type=int, default=21, help="processes of a kind (default 21)")
    options = parser.parse_args()
    seconds: dict[str, list[float]] = {name: [] for name in CASES}
    with tempfile.TemporaryDirectory() as bytecode:
        environment = {**os.environ, "PYTHONPYCACHEPREFIX": bytecode}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)
        for code in CASES.values():
            measured(code, environment)
        for _ in range(options.repeats):
            for name, code in CASES.items():
                seconds[name].append(measured(code, environment))
    medians = {name: float(np.median(found)) for name, found in seconds.items()}
    rows = [
        {
            "case": name,
            "seconds": medians[name],
            "least": min(seconds[name]),
            "units": medians[name] / medians[UNIT],
            "limit": LIMITS.get(name),
        }
        for name in CASES
    ]
    columns = ("case", "seconds", "least", "units", "limit")
    print_table(
        f"processor time of new processes, median of {options.repeats}; "
        "unit: import of numpy and pinocchio",
        ("", "median [s]", "least [s]", "units", "limit"),
        [["-" if row[key] is None else row[key] for key in columns] for row in rows],
    )
    kept = all(row["limit"] is None or row["units"] <= row["limit"] for row in rows)
    if not kept:
        console.print("a limit is exceeded", style="bold")
    if options.json:
        save_json(
            options.json,
            {"repeats": options.repeats, "unit": UNIT},
            rows=rows,
            columns=columns,
            digits=4,
        )
    return exit_code(success=kept)


if __name__ == "__main__":
    sys.exit(main())

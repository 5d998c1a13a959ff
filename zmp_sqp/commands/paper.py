"""`zmp-sqp paper`: run everything, show progress, print the tables, write the files."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from zmp_sqp.paper.driving import driving_failures, run_driving
from zmp_sqp.paper.figures import FIGURES, draw_figures
from zmp_sqp.paper.ladder import RUNGS, ladder
from zmp_sqp.paper.runs import TESTS, Motions, failures, run_slews, run_test
from zmp_sqp.paper.tables import markdown, sheets, terminal
from zmp_sqp.show.report import versions

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["PAPER_FILES", "PAPER_KEYS", "paper_result", "run_paper"]

PAPER_FILES = ("paper.md", "paper.json", *FIGURES)  # what `--out` writes
WIDE = 170  # columns of tables that go into a file or a pipe
PAPER_KEYS = """\
--json writes one object; SI units, null where there is no value:
  tests     of each test: name, title, planners (by name: duration, margin and, for ours, success,
            status, message, lower_bound, iterations, qp_solver, time, time_in_F, F) and base (of
            each way: distance, duration, margin; under eq. (21) lower, upper, factor,
            peak_acceleration)
  driving   test 2 with the base, of each distance and planner: success, status, message, duration,
            lower_bound, margin (proven), sampled, iterations, qp_solver, time
  slews     analytic and sqp duration for each radius, with their times
  ladder    a planner's numbers for each payload, boom_deg, reach and model; status "refused" where
  the
            problem is none
  failures  sentences: what should be safe, or as fast as the paper, and is not
  versions  of Python, of this package and of what it stands on
  time_in_F is in units of 100 calls of Pinocchio's computeRNEADerivatives, CPU time against
  CPU time, measured beside each plan; time is the wall's.
"""


def paper_result(
    *,
    qp_solver: str = "proxqp",
    repeats: int = 5,
    rungs: tuple[tuple[float, float], ...] = RUNGS,
    step: Callable[[str], None] = lambda _: None,
) -> tuple[dict[str, Any], dict[str, Motions]]:
    """Everything that the command computes.

    Args:
        qp_solver: Of the tests; ladder and slews have theirs.
        repeats: How often each plan of the tests is timed.
        rungs: (payload [kg], boom angle [deg]) of the ladder; none leaves it out.
        step: Called with what comes next.

    Returns:
        What `--json` writes (`PAPER_KEYS`), and the motions of each test.
    """
    tests, motions = [], {}
    for name, (_, title) in TESTS.items():
        step(title)
        numbers, motions[name] = run_test(name, qp_solver=qp_solver, repeats=repeats)
        tests.append(numbers)
    step("test 2, base and arm together")
    driving = run_driving(qp_solver=qp_solver)
    step("analytic slew")
    result: dict[str, Any] = {
        "tests": tests,
        "driving": driving,
        "slews": run_slews(),
        "ladder": [],
    }
    for payload, boom in rungs:
        step(f"ladder, {payload / 1e3:g} t at {boom:g} degrees")
        result["ladder"] += ladder(((payload, boom),))
    broken = failures(result) + driving_failures(driving)
    return result | {"failures": broken, "versions": versions()}, motions


def run_paper(
    *,
    out: Path | None,
    json_file: str | None,
    with_ladder: bool,
    figures: bool,
    qp_solver: str,
    repeats: int,
) -> bool:
    """Run, print and write everything; whether all that should be safe is."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    if out is not None:
        out.mkdir(parents=True, exist_ok=True)  # fails before the work, not after it
        for name in PAPER_FILES:
            (out / name).unlink(missing_ok=True)
    rungs = RUNGS if with_ladder else ()
    screen = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(
        *columns, console=screen, transient=True, disable=not screen.is_terminal
    ) as progress:
        task = progress.add_task("", total=len(TESTS) + 2 + len(rungs), completed=-1)

        def step(what: str) -> None:
            progress.update(task, advance=1, description=what)

        result, motions = paper_result(qp_solver=qp_solver, repeats=repeats, rungs=rungs, step=step)

    console = _console(stderr=json_file == "-")
    tables = sheets(result)
    for sheet in tables:
        console.print(terminal(sheet))
    for failure in result["failures"]:
        console.print(failure, style="bold red", soft_wrap=True)
    text = json.dumps(result, indent=1, allow_nan=False) + "\n"
    if out is not None:
        for line in _write(out, "\n".join(map(markdown, tables)), text, motions if figures else {}):
            console.print(line, soft_wrap=True)
    if json_file == "-":
        print(text, end="")
    elif json_file is not None:
        Path(json_file).write_text(text, encoding="utf-8")
        console.print(f"wrote {json_file}", soft_wrap=True)
    return not result["failures"]


def _console(*, stderr: bool) -> Console:
    from rich.console import Console

    console = Console(stderr=stderr, highlight=False, markup=False)  # [m] is a unit, no markup
    return (
        console
        if console.is_terminal
        else Console(stderr=stderr, highlight=False, markup=False, width=WIDE)
    )


def _write(folder: Path, tables: str, text: str, motions: Mapping[str, Motions]) -> Iterator[str]:
    """Write the files of `--out` one by one; yields a line about each."""
    for name, content in (("paper.md", tables), ("paper.json", text)):
        (folder / name).write_text(content, encoding="utf-8")
        yield f"wrote {folder / name}"
    if not motions:
        return
    try:
        for path in draw_figures(motions["test_1"], motions["test_2"], folder):
            yield f"wrote {path}"
    except ModuleNotFoundError as missing:
        if missing.name is None or missing.name.partition(".")[0] != "matplotlib":
            raise
        yield "no figures: they need matplotlib, which `pip install zmp-sqp[plots]` brings"

"""`zmp-sqp paper`: results of Song & Sharf 2020 beside those of zmp_sqp, as tables and figures."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from zmp_sqp.commands.console import (
    add_command,
    add_json_option,
    add_out_option,
    make_console,
    prepare_folder,
    print_lines,
    to_json,
    without_matplotlib,
    write_json,
)
from zmp_sqp.commands.exit_codes import DONE, INTERRUPTED, UNSAFE, Meanings
from zmp_sqp.commands.live import live_line
from zmp_sqp.paper.driving import driving_failures, run_driving
from zmp_sqp.paper.figures import FIGURES, draw_figures
from zmp_sqp.paper.ladder import RUNGS, ladder
from zmp_sqp.paper.runs import TESTS, Motions, failures, run_slews, run_test
from zmp_sqp.paper.tables import markdown, sheets, terminal
from zmp_sqp.versions import installed_versions

__all__ = ["PAPER_FILES", "PAPER_KEYS", "add_paper", "paper_result", "run_paper"]

PAPER_FILES = ("paper.md", "paper.json", *FIGURES)  # files of `--out`
PIPE_WIDTH = 170  # columns of the widest table
STEPS = len(TESTS) + 2  # of the progress bar without the ladder: tests, driving base, slews
DESCRIPTION = """\
Plan both tests of Song & Sharf 2020 with every planner and with variants that correct misprints,
the base's motion under eq. (21), the analytic slew, and a "ladder": slews with ever heavier
payloads at three reaches. Print tables; with --out write tables and figures.
"""
EXAMPLES = """\
examples:
  zmp-sqp paper --out out/paper         tables and figures 3, 4, 5, 6; a minute or two
  zmp-sqp paper --no-ladder --json -    results for another program
"""
PAPER_KEYS = """\
--json writes one object; SI units, null where there is no value:
  tests     per test: name, title, planners (by name: duration, margin and, for zmp_sqp's, success,
            status, message, lower_bound, iterations, qp_solver, time, time_in_F, F) and base (per
            distance: distance, duration, margin; for motions under eq. (21) also lower, upper,
            factor, peak_acceleration)
  driving   test 2 with the base, per distance and planner: success, status, message, duration,
            lower_bound, margin (proven), sampled, iterations, qp_solver, time
  slews     per radius: duration of the analytic slew and of the SQP, and computation times
  ladder    per payload, boom_deg, reach and model: numbers of the planner; status "refused" if
            the problem is invalid, as for a machine that tips over at rest
  failures  sentences about motions that are unsafe or slower than the paper's
  interrupted  whether Ctrl-C has ended the ladder early
  versions  of zmp-sqp, Python and the packages that the result depends on
  time      [s] wall time
  time_in_F CPU time in units of 100 calls of Pinocchio's computeRNEADerivatives; F is the CPU
            time of these calls, measured beside each plan
"""


def add_paper(commands: Any) -> None:
    """Add the command `paper`.

    Args:
        commands: Subcommands of an argparse parser.
    """
    command = add_command(
        commands,
        "paper",
        run_paper,
        summary="set the results of Song & Sharf 2020 beside those of zmp_sqp: tables and figures",
        description=DESCRIPTION,
        codes=Meanings(
            "done, and no motion is unsafe or slower than the paper says",
            "some motion is; `failures` says which",
        ),
        notes=(EXAMPLES, PAPER_KEYS),
    )
    add_out_option(command, PAPER_FILES)
    add_json_option(command)
    command.add_argument(
        "--qp-solver",
        default="auto",
        metavar="NAME",
        help="QP solver of the tests (default: auto)",
    )
    command.add_argument(
        "--repeats",
        type=_count,
        default=5,
        metavar="K",
        help="plans of each test; times are their median (default: 5)",
    )
    command.add_argument(
        "--no-ladder", dest="ladder", action="store_false", help="leave out the ladder"
    )
    command.add_argument(
        "--no-figures", dest="figures", action="store_false", help="write no figures"
    )


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number of at least 1, not {text!r}")
    return int(text)


def paper_result(
    *,
    qp_solver: str = "auto",
    repeats: int = 5,
    rungs: tuple[tuple[float, float], ...] = RUNGS,
    step: Callable[[str], None] = lambda _: None,
) -> tuple[dict[str, Any], dict[str, Motions]]:
    """Plan everything that the command shows.

    Args:
        qp_solver: QP solver of the tests; ladder and slews have their own.
        repeats: Number of times that each plan of the tests is timed.
        rungs: (payload [kg], boom angle [deg]) of the ladder; empty leaves out the ladder.
        step: Called with the name of each step before it begins.

    Returns:
        The object that `--json` writes (`PAPER_KEYS`), and the motions of each test by name.
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
    interrupted = False
    try:
        for payload, boom in rungs:
            step(f"ladder, {payload / 1e3:g} t at {boom:g} degrees")
            result["ladder"] += ladder(((payload, boom),))
    except KeyboardInterrupt:  # the rest is done
        interrupted = True
    broken = failures(result) + driving_failures(driving)
    result |= {"failures": broken, "versions": installed_versions(), "interrupted": interrupted}
    return result, motions


def run_paper(arguments: argparse.Namespace) -> int:
    """Plan, print and write; returns the exit code."""
    out = arguments.out
    prepare_folder(out, PAPER_FILES)
    rungs = RUNGS if arguments.ladder else ()
    with live_line(total=STEPS + len(rungs)) as line:
        result, motions = paper_result(
            qp_solver=arguments.qp_solver, repeats=arguments.repeats, rungs=rungs, step=line.say
        )

    console = make_console(arguments.json, pipe_width=PIPE_WIDTH)
    tables = sheets(result)
    for sheet in tables:
        console.print(terminal(sheet))
    for failure in result["failures"]:
        console.print(failure, style="bold red", soft_wrap=True)
    text = to_json(result, indent=1)
    if out is not None:
        drawn = motions if arguments.figures else {}
        print_lines(console, _write(out, "\n".join(map(markdown, tables)), text, drawn))
    write_json(text, arguments.json, console)
    if result["interrupted"]:
        console.print("interrupted: the rest of the ladder is missing")
        return INTERRUPTED
    return UNSAFE if result["failures"] else DONE


def _write(folder: Path, tables: str, text: str, motions: Mapping[str, Motions]) -> Iterator[str]:
    """Write the files of `--out` one by one; yields a line about each.

    Args:
        folder: The folder.
        tables: Content of paper.md.
        text: Content of paper.json.
        motions: Motions of each test for the figures; empty writes none.
    """
    for name, content in (("paper.md", tables), ("paper.json", text)):
        (folder / name).write_text(content, encoding="utf-8")
        yield f"wrote {folder / name}"
    if motions:
        paths = draw_figures(motions["test_1"], motions["test_2"], folder)
        yield from without_matplotlib(f"wrote {path}" for path in paths)

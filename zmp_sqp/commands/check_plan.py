"""What `zmp-sqp check PLAN.json` says of the plan, and adds to its file."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator, Mapping
from typing import Any

from zmp_sqp.arrays import length_text
from zmp_sqp.commands.console import to_json
from zmp_sqp.scenario.plan_file import PlanFile

__all__ = ["add_opinion", "plan_hint"]

SAME = 1e-6  # [m] difference between margins that versions of packages explain


def plan_hint(
    plan: PlanFile | None, margin: float | None, arguments: argparse.Namespace
) -> list[str]:
    """Says that the margin is not that of the plan, where nothing but the plan was asked for.

    Args:
        plan: The plan.json; None without one.
        margin: Margin that was found now [m]; None for none.
        arguments: Options of the command.
    """
    if plan is None or not _plain(arguments):
        return []
    said = plan.content.get("margin")
    if isinstance(said, bool) or not isinstance(said, int | float):
        return []
    if margin is not None and abs(margin - said) <= SAME:
        return []
    found = "none" if margin is None else length_text(margin)
    return [
        f"{plan.path} says that the guaranteed margin is {length_text(said)}, but it is {found}: "
        "file, scenario or machine have changed since"
    ]


def add_opinion(
    plan: PlanFile | None, opinion: Mapping[str, Any] | None, arguments: argparse.Namespace
) -> Iterator[str]:
    """Add a second opinion to the plan.json under `rigorous`; yields a line about it.

    The file is replaced at once, so that it is whole at any time.

    Args:
        plan: The plan.json; None without one.
        opinion: Its entry for JSON.
        arguments: Options of the command: a plan that was asked about with options keeps its file.

    Raises:
        OSError: The file cannot be written.
    """
    if plan is None or opinion is None:
        return
    if not _plain(arguments):
        yield f"{plan.path} is left as it is: options ask another question than its own"
        return
    text = to_json(plan.content | {"rigorous": dict(opinion)})
    path = plan.path.resolve()  # a link stays a link
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        beside.write_text(text, encoding="utf-8")
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)
    yield f"added the second opinion to {plan.path}"


def _plain(arguments: argparse.Namespace) -> bool:
    """Whether no option changes what is asked of a plan or how its motion is read."""
    options = ("margin", "interpolation", "limit_tolerance", "noise")
    unset = all(getattr(arguments, name) is None for name in options)
    return unset and not (arguments.degrees or arguments.constraints)

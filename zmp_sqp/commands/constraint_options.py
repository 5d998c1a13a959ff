"""Options of a command that describe path constraints."""

from __future__ import annotations

import argparse

from zmp_sqp.errors import ProblemError, ScenarioError
from zmp_sqp.planning import PathConstraint
from zmp_sqp.scenario.path_constraints import build_constraints, constraint_table

__all__ = ["add_constraint_option", "constraints_of"]

OPTION = "--constraint"


def add_constraint_option(command: argparse.ArgumentParser) -> None:
    """Add `--constraint`, which may be given several times."""
    command.add_argument(
        OPTION,
        dest="constraints",
        action="append",
        default=[],
        metavar="NAME[:KEY=VALUE,...]",
        help="a constraint that the motion has to keep beside margin and limits; known ones are "
        "listed below; may be given several times",
    )


def constraints_of(arguments: argparse.Namespace) -> tuple[PathConstraint, ...]:
    """Path constraints that the options describe.

    Raises:
        ScenarioError: A constraint or a key of it is unknown, or a value is refused.
    """
    try:
        return build_constraints([constraint_table(text) for text in arguments.constraints])
    except (ProblemError, ScenarioError) as cause:
        raise ScenarioError(f"{OPTION}: {str(cause).removeprefix('[[constraints]] ')}") from None

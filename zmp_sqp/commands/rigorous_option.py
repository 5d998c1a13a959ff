"""Option of a command that asks for a second opinion on its motion."""

from __future__ import annotations

import argparse

from zmp_sqp.rigorous.balls import flint_module

__all__ = ["add_rigorous_option", "check_rigorous_option", "margin_to_confirm"]


def add_rigorous_option(command: argparse.ArgumentParser) -> None:
    """Add `--rigorous`."""
    command.add_argument(
        "--rigorous",
        action="store_true",
        help="decide every guarantee anew in ball arithmetic, independently of the certificate "
        "(needs python-flint); exit code 1 if one is refuted or cannot be decided",
    )


def check_rigorous_option(arguments: argparse.Namespace) -> None:
    """Refuse the option before anything is computed where it cannot work.

    Raises:
        MissingExtra: python-flint is not installed.
    """
    if arguments.rigorous:
        flint_module()


def margin_to_confirm(guaranteed: float, required: float) -> float:
    """Margin to confirm [m]: the guaranteed one, or the required one where that is not kept."""
    return max(guaranteed, required, 0.0)

"""What `zmp-sqp check` is asked: machine, ground, margin, constraints; by options or scenario."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from zmp_sqp.commands.constraint_options import constraints_of
from zmp_sqp.commands.machine_options import ground_of, machine_of, uncertainties_of
from zmp_sqp.errors import ProblemError, ScenarioError
from zmp_sqp.mechanics import Machine
from zmp_sqp.mechanics.coordinates import Coordinates
from zmp_sqp.mechanics.ground import Ground
from zmp_sqp.mechanics.uncertainty import Corner, corners
from zmp_sqp.planning import PathConstraint, Problem, Trajectory, UnicycleBase
from zmp_sqp.planning.problem.unicycle_base import LIMITS
from zmp_sqp.scenario import load_scenario
from zmp_sqp.scenario.plan_file import PlanFile
from zmp_sqp.show.basis import Basis, uncertainties_of_problem

__all__ = ["Question", "question_of"]

# options that a scenario answers, by their attribute, with their defaults
ANSWERED: Mapping[str, Any] = {
    "roll": 0.0,
    "pitch": 0.0,
    "heightmap": None,
    "resolution": None,
    "limits": None,
    "srdf": None,
    "joints": None,
    "group": None,
    "hold": None,
    "package_dirs": None,
    "strict": False,
    "contact_links": None,
    "point_masses": False,
    "payload": None,
    "payload_frame": None,
    "payload_com": None,
    "payload_inertia": None,
    "tipping_fraction": 1.0,
    "payload_uncertainty": 0.0,
    "payload_com_uncertainty": [0.0],
    "slope_uncertainty": 0.0,
    "base_limits": None,
}


@dataclass(frozen=True, slots=True, eq=False)
class Question:
    """What a motion is checked for.

    Attributes:
        machine: Machine without uncertainties.
        ground: Ground without uncertainties.
        margin: Distance asked for between ZMP and every edge [m].
        corners: Extremes of payload and ground.
        constraints: Constraints beside tip-over and the joint limits.
        base: Limits, start and goal of the base; None checks none.
        uncertainties: Keyword arguments of `Problem`.
        problem: Problem of the scenario; None without one.
        plan: The plan.json that gives scenario and motion; None without one.
    """

    machine: Machine
    ground: Any
    margin: float
    corners: tuple[Corner, ...]
    constraints: tuple[PathConstraint, ...]
    base: UnicycleBase | None
    uncertainties: Mapping[str, Any]
    problem: Problem | None
    plan: PlanFile | None = None

    @property
    def coordinates(self) -> Coordinates | None:
        """Planning coordinates of the scenario; None without one."""
        return None if self.problem is None else self.problem.coordinates

    def with_base_of(
        self, trajectory: Trajectory, limits: list[float] | None
    ) -> UnicycleBase | None:
        """Base to check: the scenario's, or one with the limits of `--base-limits`.

        The latter has the motion's own start and goal. Its start and goal velocities are clipped to
        the limits, because a base that starts too fast cannot be made; the certificate finds the
        excess.

        Raises:
            ProblemError: The motion has no base.
        """
        motion = trajectory.base
        if limits is None:
            if self.base is not None and motion is None:
                raise ProblemError("the scenario's base drives, but this motion has none")
            return self.base
        if motion is None:
            raise ProblemError("--base-limits are for a base that drives, but this motion has none")
        ends = {
            f"{end}_velocity": np.clip(motion.velocities[k], *np.outer([-1.0, 1.0], limits[::2]))
            for end, k in (("start", 0), ("goal", -1))
        }
        named = dict(zip(LIMITS, limits, strict=True))
        return UnicycleBase(start=motion.poses[0], goal=motion.poses[-1], **named, **ends)

    def basis(self, *, base: bool, motion: Sequence[str]) -> Basis:
        """What the verdict rests on.

        Args:
            base: Whether the base's limits are looked at.
            motion: How the motion follows from its file, in words.
        """
        return Basis.of(
            self.machine,
            self.ground,
            self.margin,
            constraints=self.constraints,
            base=base,
            uncertainties=self.uncertainties,
            motion=motion,
        )


def question_of(arguments: argparse.Namespace) -> Question:
    """Question that the options ask.

    Raises:
        MachineError, ProblemError, ScenarioError: An option or the scenario is refused.
    """
    extra = constraints_of(arguments)
    if arguments.scenario is not None:
        if arguments.urdf is not None:
            raise ProblemError("--scenario names the machine: leave out URDF")
        problem = load_scenario(arguments.scenario).problem
        return _of_scenario("--scenario", problem, arguments, extra)
    if arguments.urdf is None:
        plan = _plan_of(arguments.trajectory)
        problem = plan.scenario().problem
        return replace(_of_scenario(str(plan.path), problem, arguments, extra), plan=plan)
    machine, ground = machine_of(arguments), ground_of(arguments)
    uncertain = uncertainties_of(arguments)
    extremes = corners(machine, ground, **uncertain, every=True)
    margin = 0.0 if arguments.margin is None else arguments.margin
    return Question(machine, ground, margin, extremes, extra, None, uncertain, None)


def _plan_of(given: str) -> PlanFile:
    """The plan.json that stands alone on the command line.

    Raises:
        ScenarioError: It is none, so that machine or motion are missing.
    """
    if Path(given).suffix.lower() != ".json":
        raise ScenarioError(
            f"{given} alone says no machine or no motion: give `zmp-sqp check URDF TRAJECTORY`, "
            "`zmp-sqp check TRAJECTORY --scenario SCENARIO`, or a plan.json"
        )
    return PlanFile.read(given)


def _of_scenario(
    source: str,
    problem: Problem,
    arguments: argparse.Namespace,
    extra: tuple[PathConstraint, ...],
) -> Question:
    """Question of a scenario; `--margin` replaces its margin, `--constraint` adds to it.

    Args:
        source: Where the scenario comes from, in words.
        problem: Its problem.
        arguments: Options of the command.
        extra: Constraints of `--constraint`.
    """
    for name, default in ANSWERED.items():
        if getattr(arguments, name) != default:
            option = f"--{name.replace('_', '-')}"
            raise ProblemError(f"{source} answers what {option} says: leave out {option}")
    ground: Ground = problem.ground
    return Question(
        problem.machine,
        ground,
        problem.margin if arguments.margin is None else arguments.margin,
        problem.corners(every=True),
        (*problem.own_constraints, *extra),
        problem.base,
        uncertainties_of_problem(problem),
        problem,
    )

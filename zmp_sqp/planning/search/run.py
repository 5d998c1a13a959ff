"""SQP runs of one planning call, with their QP solver, time budget and records."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.errors import ProblemError
from zmp_sqp.planning.program.grid import Grid
from zmp_sqp.planning.program.staged import Motion, StagedProgram
from zmp_sqp.sqp.backends import QPBackend, make_backend
from zmp_sqp.sqp.backends.deadline import Punctual
from zmp_sqp.sqp.result import IterationRecord, SQPResult
from zmp_sqp.sqp.solver import SQP, SQPSettings

__all__ = ["Candidate", "Runs", "SearchRun"]


@dataclass(frozen=True, slots=True)
class SearchRun:
    """Record of one SQP run of the search, as listed in a plan.

    Attributes:
        purpose: Purpose of the run in words, such as the guess it started from.
        intervals: Number of intervals of the grid.
        backend: Names of the QP solvers that solved its QPs, separated by commas.
        iterations: Number of iterations.
        status: Name of the `SQPStatus` it ended with, in lower case.
        duration: Duration of its last point [s].
        reference: Duration that scales time [s]: the objective is (T / reference)^2.
    """

    purpose: str
    intervals: int
    backend: str
    iterations: int
    status: str
    duration: float
    reference: float


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """Last point of an SQP run, with the program that was solved.

    Attributes:
        program: Nonlinear program.
        result: Result of the run.
        coarser: Shortest duration on half as many intervals [s]; None if unknown.
        fine: Grid of the trajectory, with all nodes of the program's; None for the program's own.
    """

    program: StagedProgram
    result: SQPResult
    coarser: float | None = None
    fine: Grid | None = None

    @property
    def is_feasible(self) -> bool:
        """Whether the point satisfies the program's constraints."""
        return self.result.status.is_feasible

    @property
    def motion(self) -> Motion:
        """Last point of the run."""
        motion: Motion = self.result.point
        return motion

    @property
    def controls(self) -> Array:
        """Accelerations T^2 a at both ends of the intervals, shape (N, 2, n)."""
        return self.program.unpack(self.motion)[2]

    @property
    def S(self) -> float:
        """Squared duration of the motion [s^2]."""
        return self.motion.sigma * self.program.reference**2

    @property
    def duration(self) -> float:
        """Duration of the motion [s]."""
        return float(np.sqrt(self.S))


@dataclass(slots=True)
class Runs:
    """Runner of SQPs with a common deadline, which keeps the records of all iterations.

    Attributes:
        backend: QP solver that the user chose.
        started: Start of planning, a value of `clock` [s].
        deadline: Value of `clock` after which no new QP starts [s]; None for no limit.
        progress: Called after every iteration with its record; None for no calls.
        announce: Called with words about what begins; None for no calls.
        stage: What the planner is about: "explore", "refine" or "prove".
        history: Records of all iterations so far.
        runs: One record per run so far.
        proof_time: Time of the last certificate [s]; 0 before the first.
        reason: Sentence that says why nothing was found; empty if that is not known.
        clock: Clock of deadline and records [s].
        ends: Value of `clock` at which the answer is due although a certificate is under way,
            because there is another certified motion [s]; None if there is none.
    """

    backend: QPBackend
    started: float
    deadline: float | None
    progress: Callable[[IterationRecord], None] | None = None
    announce: Callable[[str], None] | None = None
    stage: str = ""
    history: list[IterationRecord] = field(default_factory=list)
    runs: list[SearchRun] = field(default_factory=list)
    proof_time: float = 0.0
    reason: str = ""
    clock: Callable[[], float] = time.perf_counter
    ends: float | None = None

    @classmethod
    def start(
        cls,
        qp_solver: str,
        time_budget: float | None,
        progress: Callable[[IterationRecord], None] | None,
        announce: Callable[[str], None] | None = None,
        *,
        clock: Callable[[], float] = time.perf_counter,
    ) -> Runs:
        """Start the time budget, with a QP solver by name.

        Raises:
            ProblemError: Unknown QP solver, or a `progress` that is no function.
        """
        if progress is not None and not callable(progress):
            raise ProblemError(f"progress must be a function of a record, not {progress!r}")
        if time_budget is not None:
            from zmp_sqp.sqp.backends import loaded  # noqa: F401 - not within the budget
        started = clock()
        deadline = None if time_budget is None else started + time_budget
        backend = make_backend(qp_solver)
        if deadline is not None:
            backend = Punctual(backend, deadline, clock)
        return cls(backend, started, deadline, progress, announce, clock=clock)

    def load(self) -> None:
        """Import what a search needs and a blind motion does not; `elapsed` leaves that out."""
        began = self.clock()
        import scipy.sparse  # noqa: F401 - slow to import

        self.started += self.clock() - began

    @property
    def is_late(self) -> bool:
        """Whether the deadline has passed."""
        return self.deadline is not None and self.clock() > self.deadline

    @property
    def elapsed(self) -> float:
        """Time since planning began [s]."""
        return self.clock() - self.started

    def enter(self, stage: str) -> None:
        """Begin a stage of planning and announce it."""
        self.stage = stage
        self.say("")

    def say(self, words: str) -> None:
        """Announce what begins in the current stage."""
        if self.announce is not None:
            self.announce(f"{self.stage}: {words}" if words else self.stage)

    def minimize(
        self,
        program: StagedProgram,
        point: Motion,
        settings: SQPSettings,
        *,
        y: Array | None = None,
        z: Array | None = None,
        excess: Array | None = None,
        purpose: str = "",
    ) -> Candidate:
        """Run the SQP from a motion and record the run.

        Args:
            program: Nonlinear program.
            point: Initial guess.
            settings: Settings of the SQP; the deadline is set here.
            y, z, excess: Multipliers and excess of a nearby solution, see `SQP.minimize`.
            purpose: Purpose of the run in words, for its record.
        """
        self.say(f"{purpose}, {program.grid.size} intervals")
        settings = replace(settings, deadline=self.deadline, clock=self.clock)
        sqp = SQP(self.backend, settings, self.progress)
        result = sqp.minimize(program, point, y=y, z=z, excess=excess)
        self.history.extend(result.history)
        found = Candidate(program, result)
        self.record(purpose, found)
        return found

    def note(self, record: IterationRecord) -> None:
        """Add the record of an iteration that was no SQP step."""
        self.history.append(record)
        if self.progress is not None:
            self.progress(record)

    def record(self, purpose: str, found: Candidate) -> None:
        """Add the record of a run that has ended."""
        steps = found.result.history
        names = (step.backend.partition(",")[0] for step in steps)
        backends = ", ".join(dict.fromkeys(names))
        size, status = found.program.grid.size, found.result.status.name.lower()
        T, reference = found.duration, found.program.reference
        self.runs.append(SearchRun(purpose, size, backends, len(steps), status, T, reference))

"""SQP runs of one planning call: QP solvers, time budget, history."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from zmp_sqp.arrays import Array
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.program.solution import MotionProgram
from zmp_sqp.sqp.backends import QPBackend, make_backend
from zmp_sqp.sqp.backends.deadline import Punctual
from zmp_sqp.sqp.result import IterationRecord, SQPResult
from zmp_sqp.sqp.solver import SQP, SQPSettings

__all__ = ["MAX_ITERATIONS", "Candidate", "Runs"]

FALLBACK = "piqp"
# accelerations (intervals times coordinates) up to which ProxQP is asked first: the time of its dense
# QPs grows with their cube
MOST_DENSE = 800
MAX_ITERATIONS = 100


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A point that an SQP run ended at.

    Attributes:
        program: The nonlinear program.
        result: How the run ended.
    """

    program: MotionProgram
    result: SQPResult

    @property
    def is_feasible(self) -> bool:
        """Whether the point satisfies the program's constraints."""
        return self.result.status.is_feasible

    @property
    def controls(self) -> Array:
        """Accelerations times the squared duration, shape (N, c, n)."""
        return self.program.unpack(self.result.x)[2]

    @property
    def S(self) -> float:
        """Squared duration [s^2]."""
        return self.program.unpack(self.result.x)[3]


@dataclass(slots=True)
class Runs:
    """Solves nonlinear programs until a deadline, and keeps the records of all iterations.

    Attributes:
        backend: The QP solver that was asked for.
        fallback: The one for QPs that it does not solve.
        started: When planning began, a `time.perf_counter()` value [s].
        deadline: When it must end; None for as long as it takes.
        progress: Called after every iteration with its record.
        history: Records of all iterations so far.
    """

    backend: QPBackend
    fallback: QPBackend | None
    started: float
    deadline: float | None
    progress: Callable[[IterationRecord], None] | None = None
    history: list[IterationRecord] = field(default_factory=list)

    @classmethod
    def start(
        cls,
        problem: Problem,
        qp_solver: str,
        time_budget: float | None,
        progress: Callable[[IterationRecord], None] | None,
    ) -> Runs:
        """Start the clock, with the QP solvers for a problem of this size.

        Dense ProxQP gives way to sparse PIQP where it would be too slow.
        """
        started = time.perf_counter()
        deadline = None if time_budget is None else started + time_budget
        backend = make_backend(qp_solver)
        size = problem.intervals * (
            problem.coordinates.size + len(problem.undercarriage.limits.velocity)
        )
        if qp_solver == "proxqp" and size > MOST_DENSE:
            backend = make_backend(FALLBACK)
        fallback = make_backend(FALLBACK) if backend.name != FALLBACK else None
        if deadline is not None:
            backend = Punctual(backend, deadline)
            fallback = None if fallback is None else Punctual(fallback, deadline)
        return cls(backend, fallback, started, deadline, progress)

    @property
    def is_late(self) -> bool:
        """Whether the deadline has passed."""
        return self.deadline is not None and time.perf_counter() > self.deadline

    @property
    def elapsed(self) -> float:
        """Wall time since planning began [s]."""
        return time.perf_counter() - self.started

    def minimize(
        self, program: MotionProgram, controls: Array, S: float, iterations: int = MAX_ITERATIONS
    ) -> Candidate:
        """Run the SQP from controls (N, c, n) [T^2 a] and squared duration S [s^2]."""
        settings = SQPSettings(deadline=self.deadline, max_iterations=iterations)
        sqp = SQP(self.backend, self.fallback, settings, self.progress)
        result = sqp.minimize(program, program.pack(controls, S))
        self.history.extend(result.history)
        return Candidate(program, result)

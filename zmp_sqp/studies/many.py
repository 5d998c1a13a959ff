"""Many problems planned at once, by local processes or by any executor."""

from __future__ import annotations

import multiprocessing
import os
import pickle
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from dataclasses import dataclass, field, replace
from typing import Any, Literal, overload

import numpy as np

from zmp_sqp.arrays import shortened
from zmp_sqp.errors import Interrupted, ProblemError
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.proof.certificate import Certificate
from zmp_sqp.planning.search.answer import Plan, Status
from zmp_sqp.studies.parcel import Outcome, begin_work, pack, work
from zmp_sqp.studies.progress import progress_bar

__all__ = ["plan_many"]

AHEAD = 3  # parcels per worker that are handed out at a time
LARGEST_PARCEL = 8  # problems
PARCELS_PER_WORKER = 4  # at least, so that all workers end at about the same time
STRIKES = 2  # deaths of a worker process after which its problem is given up


@overload
def plan_many(
    problems: Iterable[Problem],
    executor: Executor | None = None,
    progress: bool | Callable[[int, int], None] = True,
    *,
    as_completed: Literal[False] = False,
    workers: int | None = None,
    qp_solver: str = "auto",
    time_budget: float | None = None,
) -> list[Plan]: ...


@overload
def plan_many(
    problems: Iterable[Problem],
    executor: Executor | None = None,
    progress: bool | Callable[[int, int], None] = True,
    *,
    as_completed: Literal[True],
    workers: int | None = None,
    qp_solver: str = "auto",
    time_budget: float | None = None,
) -> Iterator[tuple[int, Plan]]: ...


def plan_many(
    problems: Iterable[Problem],
    executor: Executor | None = None,
    progress: bool | Callable[[int, int], None] = True,
    *,
    as_completed: bool = False,
    workers: int | None = None,
    qp_solver: str = "auto",
    time_budget: float | None = None,
) -> list[Plan] | Iterator[tuple[int, Plan]]:
    """Plan many problems in parallel; without a time budget, with the bits that `plan` gives.

    By default local processes plan, one BLAS thread each. A script that calls this must have its
    own code under `if __name__ == "__main__":`, because worker processes import it. Every problem
    gets a plan: one whose planning ends with an error, or ends its process twice, gets one with
    status ERROR that says so.

    Args:
        problems: Problems.
        executor: Executor that plans, such as Dask's `Client.get_executor()`; None starts local
            processes and ends them.
        progress: Whether to show progress on standard error, a bar on a terminal and elsewhere a
            line every 30 s; or a function that is called with the numbers of problems done and in
            all.
        as_completed: Whether to return an iterator over pairs of number and plan, in the order in
            which they are done, instead of a list in the order of the problems.
        workers: Number of local processes; None for one per processor.
        qp_solver, time_budget: As for `plan`, for each problem.

    Returns:
        The plans.

    Raises:
        ProblemError: An entry is no Problem, the executor has no `submit`, `workers` is no positive
            whole number, or a worker process imports a script that calls this without a guard.
        Interrupted: Ctrl-C, which the processes do not outlive; `plans` has one
            entry per problem, None where the plan was not done.
    """
    given = _checked(problems, executor, workers)
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise ProblemError(
            "plan_many was called while a worker process imports your script: put the call under "
            "if __name__ == '__main__':"
        )
    job = _Job(given, qp_solver, time_budget)
    found = _planned(job, executor, workers, progress)
    if as_completed:
        return found
    plans: list[Plan | None] = [None] * len(given)
    try:
        for index, one in found:
            plans[index] = one
    except KeyboardInterrupt:
        raise Interrupted(plans) from None
    return [one for one in plans if one is not None]


def _checked(
    problems: Iterable[Problem], executor: Executor | None, workers: int | None
) -> list[Problem]:
    """The problems of `plan_many` as a list.

    Raises:
        ProblemError: A wrong argument.
    """
    try:
        given = list(problems)
    except TypeError:
        raise ProblemError(f"problems must be Problems, not {shortened(problems)}") from None
    for i, problem in enumerate(given):
        if not isinstance(problem, Problem):
            raise ProblemError(f"problems[{i}] must be a Problem, not {shortened(problem)}")
    if executor is not None and not callable(getattr(executor, "submit", None)):
        raise ProblemError(
            "executor must be a concurrent.futures.Executor or have its method submit(), not "
            f"{shortened(executor)}"
        )
    if workers is not None and (isinstance(workers, bool) or not isinstance(workers, int)):
        raise ProblemError(f"workers must be a whole number, not {shortened(workers)}")
    if workers is not None and workers < 1:
        raise ProblemError(f"workers must be at least 1, not {workers}")
    return given


@dataclass(slots=True)
class _Job:
    """Problems, and how many deaths of a process each has seen.

    Attributes:
        problems: All problems.
        qp_solver, time_budget: Arguments of `plan`.
        strikes: Deaths of worker processes by number of the problem that was with them.
    """

    problems: Sequence[Problem]
    qp_solver: str
    time_budget: float | None
    strikes: dict[int, int] = field(default_factory=dict)

    def plan_of(self, outcome: Outcome) -> Plan:
        """Plan of an outcome, with its problem."""
        problem = self.problems[outcome.index]
        if outcome.plan is None:
            return self.failed(outcome.index, f"Planning ended with an error: {outcome.error}")
        return replace(outcome.plan, problem=problem)

    def failed(self, index: int, why: str) -> Plan:
        """Plan without a motion, for a problem that could not be planned."""
        problem = self.problems[index]
        return Plan(
            problem=problem,
            status=Status.ERROR,
            message=f"{Status.ERROR} {why}",
            duration=float("nan"),
            lower_bound=0.0,
            certificate=Certificate.of_nothing(problem.margin),
            iterations=0,
            solve_time=0.0,
            history=(),
            qp_solver=self.qp_solver,
            attempt=None,
        )


class _LocalPool:
    """Local worker processes, which are started again where one of them dies."""

    def __init__(self, machines: Sequence[Machine], workers: int) -> None:
        self.machines, self.workers = machines, workers
        self._pool = self._started()

    def _started(self) -> ProcessPoolExecutor:
        # fork would copy the threads' locks of BLAS, of Pinocchio and of the caller
        context = multiprocessing.get_context("spawn")
        shared = pickle.dumps(tuple(self.machines), protocol=pickle.HIGHEST_PROTOCOL)
        return ProcessPoolExecutor(self.workers, context, begin_work, (shared,))

    def submit(self, *call: Any) -> Future[Any]:
        """Hand a call to a process."""
        return self._pool.submit(*call)

    def restart(self) -> bool:
        """Start new processes after one has died; returns that this is possible."""
        self._pool.shutdown(wait=False, cancel_futures=True)
        self._pool = self._started()
        return True

    def end(self) -> None:
        """End the processes, after the problems that they are at."""
        self._pool.shutdown(wait=True, cancel_futures=True)


class _GivenExecutor:
    """An executor of the caller, who ends it; it cannot be started again."""

    machines: Sequence[Machine] = ()

    def __init__(self, executor: Executor, workers: int) -> None:
        self._executor, self.workers = executor, workers

    def submit(self, *call: Any) -> Future[Any]:
        """Hand a call to the executor."""
        return self._executor.submit(*call)

    def restart(self) -> bool:
        """Say that it cannot be started again."""
        return False

    def end(self) -> None:
        """Leave it running."""


def _planned(
    job: _Job,
    executor: Executor | None,
    workers: int | None,
    progress: bool | Callable[[int, int], None],
) -> Iterator[tuple[int, Plan]]:
    """Pairs of number and plan, as they are done."""
    total = len(job.problems)
    if not total:
        return
    count = min(workers or os.cpu_count() or 1, total)
    crew: _LocalPool | _GivenExecutor
    if executor is None:
        crew = _LocalPool(_shared_machines(job.problems), count)
    else:
        crew = _GivenExecutor(executor, count)
    try:
        with progress_bar(progress, total) as advance:
            for index, one in _deliveries(job, crew):
                advance(success=one.success)
                yield index, one
    finally:
        crew.end()


def _shared_machines(problems: Sequence[Problem]) -> list[Machine]:
    """Machines that several problems have: sent to every process, once."""
    uses = Counter(id(one.machine) for one in problems)
    return list(
        {id(one.machine): one.machine for one in problems if uses[id(one.machine)] > 1}.values()
    )


def _deliveries(job: _Job, crew: _LocalPool | _GivenExecutor) -> Iterator[tuple[int, Plan]]:
    """Hand out parcels and take in what becomes of them, with few parcels under way.

    Where a process dies, it is unknown which problem was to blame. All that were under way are
    planned again one at a time; one that ends its process alone, and does so twice, is given up.
    """
    total = len(job.problems)
    size = int(np.clip(total // (PARCELS_PER_WORKER * crew.workers), 1, LARGEST_PARCEL))
    table = _Table(deque(range(i, min(i + size, total)) for i in range(0, total, size)))
    while table.waiting or table.suspects or table.under_way:
        try:
            while (numbers := table.next(AHEAD * crew.workers)) is not None:
                yield from _handed_out(job, crew, table, numbers)
        except (BrokenExecutor, RuntimeError) as cause:  # the executor has ended
            if crew.restart():
                table.suspect(*table.under_way.values())
                table.under_way.clear()
            else:
                for i in table.given_up():
                    yield i, job.failed(i, f"the executor has ended ({_in_words(cause)})")
        if table.under_way:
            yield from _taken_in(job, crew, table)


@dataclass(slots=True)
class _Table:
    """Parcels of problems, as tuples or ranges of their numbers.

    Attributes:
        waiting: Parcels that wait for a worker.
        suspects: Problems that were under way when a process died; each is planned alone.
        under_way: Parcels with the workers.
    """

    waiting: deque[Sequence[int]]
    suspects: deque[Sequence[int]] = field(default_factory=deque)
    under_way: dict[Future[Any], Sequence[int]] = field(default_factory=dict)

    def next(self, most: int) -> Sequence[int] | None:
        """Take the next parcel to hand out; None while `most` or a suspect are under way."""
        if self.suspects:
            return None if self.under_way else self.suspects.popleft()
        if self.waiting and len(self.under_way) < most and not self._alone():
            return self.waiting.popleft()
        return None

    def _alone(self) -> bool:
        """Whether a suspect is under way."""
        return any(isinstance(numbers, tuple) for numbers in self.under_way.values())

    def suspect(self, *parcels: Sequence[int]) -> None:
        """Plan the problems of parcels one at a time."""
        self.suspects.extend((i,) for numbers in parcels for i in numbers)

    def given_up(self) -> list[int]:
        """Take all problems that are not under way."""
        numbers = [i for parcel in (*self.suspects, *self.waiting) for i in parcel]
        self.suspects.clear()
        self.waiting.clear()
        return numbers


def _handed_out(
    job: _Job, crew: _LocalPool | _GivenExecutor, table: _Table, numbers: Sequence[int]
) -> Iterator[tuple[int, Plan]]:
    """Hand a parcel to a worker; the plan of a problem that cannot be sent."""
    numbered = [(i, job.problems[i]) for i in numbers]
    try:
        parcel = pack(numbered, crew.machines, job.qp_solver, job.time_budget)
    except (pickle.PicklingError, AttributeError, TypeError) as cause:
        if len(numbers) > 1:
            table.waiting.extendleft(range(i, i + 1) for i in reversed(numbers))
        else:
            why = "it cannot be sent to a worker process (functions must be defined in a module)"
            yield numbers[0], job.failed(numbers[0], f"{why}: {_in_words(cause)}")
        return
    try:
        table.under_way[crew.submit(work, parcel)] = numbers
    except BaseException:
        (table.suspects if isinstance(numbers, tuple) else table.waiting).appendleft(numbers)
        raise


def _taken_in(
    job: _Job, crew: _LocalPool | _GivenExecutor, table: _Table
) -> Iterator[tuple[int, Plan]]:
    """Wait for a parcel, and take in all that are done."""
    done, _ = wait(table.under_way, return_when=FIRST_COMPLETED)
    died = False
    for future in done:
        numbers = table.under_way.pop(future)
        fault = future.exception()
        if fault is None:
            for outcome in future.result():
                yield outcome.index, job.plan_of(outcome)
            continue
        died = True
        if isinstance(numbers, tuple):
            i = numbers[0]
            job.strikes[i] = job.strikes.get(i, 0) + 1
            if job.strikes[i] >= STRIKES:
                why = f"its worker process ended {STRIKES} times ({_in_words(fault)})"
                yield i, job.failed(i, why)
                continue
        table.suspect(numbers)
    if died and crew.restart():
        table.suspect(*table.under_way.values())
        table.under_way.clear()


def _in_words(cause: BaseException) -> str:
    return f"{type(cause).__name__}: {cause}" if str(cause) else type(cause).__name__

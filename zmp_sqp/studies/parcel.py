"""Problems and plans on their way between processes."""

from __future__ import annotations

import io
import pickle
import signal
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

from threadpoolctl import threadpool_limits

from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.search.answer import Plan
from zmp_sqp.planning.search.planner import plan

__all__ = ["Outcome", "Parcel", "begin_work", "pack", "work"]

_machines: tuple[Machine, ...] = ()  # of a local worker process, which gets them when it starts


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one problem.

    Attributes:
        index: Number of the problem.
        plan: Its plan, without the problem; None if planning ended with an error.
        error: The error in words; empty if there was none.
    """

    index: int
    plan: Plan | None
    error: str = ""


@dataclass(frozen=True, slots=True)
class Parcel:
    """Problems for a worker process.

    Attributes:
        content: Pickled list of pairs (number, problem).
        qp_solver: As for `plan`.
        time_budget: As for `plan`, per problem [s].
    """

    content: bytes
    qp_solver: str
    time_budget: float | None


class _Packer(pickle.Pickler):
    """Pickler that writes the numbers of known machines instead of the machines."""

    def __init__(self, file: io.BytesIO, known: Sequence[Machine]) -> None:
        super().__init__(file, protocol=pickle.HIGHEST_PROTOCOL)
        self._numbers = {id(machine): i for i, machine in enumerate(known)}

    def persistent_id(self, value: Any) -> int | None:
        """Number of a known machine; None for anything else."""
        return self._numbers.get(id(value)) if isinstance(value, Machine) else None


class _Unpacker(pickle.Unpickler):
    """Inverse of `_Packer` in a process that has the machines."""

    def persistent_load(self, pid: Any) -> Machine:
        """Machine of a number."""
        machine: Machine = _machines[pid]
        return machine


def pack(
    numbered: Sequence[tuple[int, Problem]],
    known: Sequence[Machine],
    qp_solver: str,
    time_budget: float | None,
) -> Parcel:
    """Parcel of problems.

    Args:
        numbered: Pairs of number and problem.
        known: Machines that the worker has; others travel with the parcel, each once.
        qp_solver, time_budget: Arguments of `plan`.
    """
    file = io.BytesIO()
    _Packer(file, known).dump(list(numbered))
    return Parcel(file.getvalue(), qp_solver, time_budget)


def begin_work(machines: bytes) -> None:
    """Prepare a local worker process.

    One BLAS thread, so that processes do not compete and bits do not depend on their number. The
    parent decides what an interrupt from the keyboard means.

    Args:
        machines: Pickled tuple of the machines that parcels refer to by number.
    """
    global _machines
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threadpool_limits(limits=1, user_api="blas")
    _machines = pickle.loads(machines)


def work(parcel: Parcel) -> list[Outcome]:
    """Plan all problems of a parcel, in a worker process."""
    outcomes = []
    for index, problem in _Unpacker(io.BytesIO(parcel.content)).load():
        try:
            found = plan(problem, parcel.qp_solver, parcel.time_budget)
        except Exception as error:  # one problem must not take others with it
            outcomes.append(Outcome(index, None, f"{type(error).__name__}: {error}"))
        else:
            # the caller has the problem already
            outcomes.append(Outcome(index, replace(found, problem=cast(Any, None))))
    return outcomes

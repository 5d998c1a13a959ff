"""The SQP: clipped exact curvature, screened sparse programs, line search, practical stop."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.sqp.backends import QPBackend
from zmp_sqp.sqp.direction import Direction, Subproblem
from zmp_sqp.sqp.iterate import CurvatureModel, Iterate, Relaxation, is_feasible
from zmp_sqp.sqp.nlp import Evaluation, Linearization, NonlinearProgram
from zmp_sqp.sqp.result import IterationRecord, SQPResult, SQPStatus

__all__ = ["SQP", "SQPSettings"]

ARMIJO_SLOPE = 1e-4  # Nocedal & Wright 2006, eq. (3.4)
SHORTEST_STEP = 1e-3
MOST_CORRECTIONS = 2  # of a refused step, while each halves the violation
ROUNDING = 1e-11  # of the merit function, relative: differences below are noise
WRONG_WAY = 1e-6  # predicted increase of the merit function that a step of a clipped model may have
CURVED = 1e-4  # least sum of multipliers for which curvature counts
# clipping of negative curvature: whole for the first iterations and far from feasibility, then less
# and less while steps are full; all curvature is kept where steps creep
WHOLLY_CLIPPED = 2  # iterations
CLIPPED_ABOVE = 0.2  # violation
LEAST_CLIPPED = 0.3
LEAST_CLIPPED_LATER = 0.1  # after a step that was refused or hard to find
CREEPING = 3e-3  # change of the objective below which a step that halves no change creeps
# after a program that was not convex enough: first this share, then all
CLIPPED_AGAIN = 0.5
HELD = 1  # steps for which the share stays then
INNER, INNER_CONVEX = 30, 60  # iterations of an interior-point method: more mean indefiniteness
HARD = 28  # inner iterations of a program that was hard to solve
# screening: rows nearer to their bound than this, and what the last step moved them by, take part
NEAR = 0.08
FIRST_NEAR = 0.2
RELAXED_NEAR = 0.5
DECISIVE_ABOVE = 3e-3  # violation from which on the program's decisive rows take part
# tolerance of quadratic programs: a share of the violation within bounds
QP_SHARE, LEAST_TOLERANCE, LARGEST_TOLERANCE = 1e-2, 1e-8, 1e-4
LARGEST_DAMPING, LARGEST_QP_DAMPING = 1e2, 10.0
LARGEST_PRICE = 1e5
UNDAMPED = 1e-4  # a step that was damped by more says nothing about convergence
# infeasible: over so many relaxed steps the violation has not fallen below this share of itself
PATIENCE, PATIENCE_SHARE, PATIENCE_VIOLATION = 3, 0.9, 1e-3
DEAR = 300.0  # price at which even a far slower motion would be found if it were less violated
SLOWEST = 0.9  # ratio of changes that is believed, where steps creep
LEFT = 1e-3  # of the violation: a smaller slack counts as none
LEAST_OBJECTIVE = 1e-8
EXCESS_FACTOR, EXCESS_GUARD = 1.05, 2e-6  # by which lagged excess is exaggerated


@dataclass(frozen=True, slots=True)
class SQPSettings:
    """When to stop and what to spend.

    Attributes:
        optimality: Largest predicted decrease of the objective at a solution.
        converged: Relative change of the objective's square root that ends the run: by a full step,
            and by those that would follow it if changes fell on as they did.
        closable: Largest violation that one finishing step closes.
        coarse: Violation with which the run may end as COARSE; 0 asks for a solution.
        excess_from: Change below which what rows exceed between their places is added to them; 0
            never.
        equality: Largest violation of an equality at a solution.
        max_iterations: Steps at most.
        resumed: Whether the start is near a solution, so that no curvature is clipped at first and
            rows are screened at once.
        deadline: `time.perf_counter()` value after which no new step starts; None for none.
    """

    optimality: float = 1e-6
    converged: float = 5e-5
    closable: float = 3e-3
    coarse: float = 0.0
    excess_from: float = 5e-4
    equality: float = 2e-7
    max_iterations: int = 60
    resumed: bool = False
    deadline: float | None = None


@dataclass(slots=True)
class SQP:
    r"""Sequential quadratic programming with a line search.

    Each step solves the quadratic program of the linearised constraints and of a model of the
    Lagrangian, then backtracks on an exact penalty function (`Penalty`) until Armijo's condition
    holds (Han 1977; Nocedal & Wright 2006, chapter 18).

    * Curvature is exact but for a share of the negative part, which is taken away block by block
      (`CurvatureModel`). The share falls while steps are full. Where the program proves not to be
      convex enough, all of the negative part goes.
    * A full step that is refused while it raises the violation is corrected with the constraints'
      values at its end, which undoes the Maratos effect.
    * A program without solution is solved with a slack on its nonlinear rows. If relaxed steps no
      longer lower the violation, at a price at which even a far slower point would be found, the
      run ends: INFEASIBLE.
    * What nonlinear rows exceed their values by between the places they are imposed at is added to
      them late in the run, with a lag of one step.
    * Near the optimum the run ends when a full step changes the objective's square root by less
      than `converged`. What is still violated is closed by one finishing step without curvature.
      At once it ends where the objective stands at its proven bound, or where no decrease is
      predicted.

    Attributes:
        backend: Solves quadratic programs.
        fallback: Asked where the backend does not solve one; None for nobody.
        settings: When to stop.
        report: Called after every iteration with its record.
    """

    backend: QPBackend
    fallback: QPBackend | None = None
    settings: SQPSettings = field(default_factory=SQPSettings)
    report: Callable[[IterationRecord], None] | None = None
    _history: list[IterationRecord] = field(default_factory=list)
    _started: float = 0.0

    def minimize(
        self,
        program: NonlinearProgram,
        point: Any,
        *,
        y: Array | None = None,
        z: Array | None = None,
        excess: Array | None = None,
    ) -> SQPResult:
        """Local minimiser from a point that need not be feasible.

        Args:
            program: The program.
            point: Initial guess.
            y, z: Multipliers of equalities and inequalities, from a nearby solution; None for none.
            excess: What was added to the nonlinear rows there; None for nothing.

        Returns:
            The solution, or the last iterate; `status.is_feasible` says whether it satisfies the
            constraints.
        """
        iterate = self.init(program, point, y=y, z=z, excess=excess)
        best: Iterate | None = None
        while (status := self.terminate(iterate)) is None:
            iterate = self.step(program, iterate)
            if iterate.is_feasible(program.tolerance, self.settings.equality):
                best = iterate
        if best is not None and not status.is_feasible and status is not SQPStatus.COARSE:
            status = SQPStatus.FEASIBLE
            if not iterate.is_feasible(program.tolerance, self.settings.equality):
                iterate = best
        at = _without(iterate.lin.at, iterate.excess)
        history = tuple(self._history)
        return SQPResult(iterate.point, iterate.y, iterate.z, iterate.excess, status, at, history)

    def init(
        self,
        program: NonlinearProgram,
        point: Any,
        *,
        y: Array | None = None,
        z: Array | None = None,
        excess: Array | None = None,
    ) -> Iterate:
        """First iterate; arguments as in `minimize`."""
        self._history, self._started = [], time.perf_counter()
        lin = _with(program.linearize(point), excess)
        y = np.zeros(program.equalities) if y is None else y
        z = np.zeros(program.inequalities) if z is None else z
        verdict = None if lin.at.is_finite() else SQPStatus.NOT_FINITE
        return Iterate(point, lin, y, z, excess, verdict=verdict)

    def terminate(self, iterate: Iterate) -> SQPStatus | None:
        """Why the run ends at an iterate; None if it goes on."""
        if iterate.verdict is not None:
            return iterate.verdict
        deadline = self.settings.deadline
        if deadline is not None and time.perf_counter() > deadline:
            return SQPStatus.TIME_LIMIT
        if iterate.number >= self.settings.max_iterations:
            return SQPStatus.ITERATION_LIMIT
        return None

    def step(self, program: NonlinearProgram, iterate: Iterate) -> Iterate:
        """Next iterate: a new point, or the same one with another model of the program."""
        clipped = self._clipped(iterate)
        subproblem = self._subproblem(program, iterate, clipped)
        relaxed, direction = iterate.relaxation.active, None
        if not relaxed:
            inner = INNER if clipped < 1.0 else INNER_CONVEX
            direction = subproblem.solve(iterations=inner, y=iterate.y, z=iterate.z)
            if direction is not None and direction.z[: program.nonlinear].sum() > LARGEST_PRICE:
                direction = None  # feasible by a step far beyond where it is true
            if clipped < 1.0 and (
                direction is None or self._decrease(program, iterate, direction) < -WRONG_WAY
            ):
                again = CLIPPED_AGAIN if clipped < CLIPPED_AGAIN else 1.0
                model = replace(iterate.model, clipped=again, held=HELD)
                return self._stay(iterate, subproblem, replace(iterate, model=model))
        if direction is None:
            relaxed = True
            price = min(max(iterate.relaxation.price, iterate.penalty.nonlinear), LARGEST_PRICE)
            values = iterate.lin.at.inequalities
            subproblem.keep |= (values > -RELAXED_NEAR) & iterate.lin.C.leading(values)
            subproblem.keep[-1:] = True  # the objective's own bound
            direction = subproblem.solve_relaxed(program.nonlinear, price)
        if direction is None:
            failed = iterate.model.damping > LARGEST_QP_DAMPING
            verdict = SQPStatus.QP_FAILED if failed else None
            damped = replace(iterate, model=iterate.model.damped(), verdict=verdict)
            return self._stay(iterate, subproblem, damped)
        penalty = iterate.penalty.raised(direction.y, direction.z, program.nonlinear)
        iterate = replace(iterate, penalty=penalty)
        if self._is_stationary(program, iterate, direction):
            done = replace(iterate, y=direction.y, z=direction.z, verdict=SQPStatus.OPTIMAL)
            return self._stay(iterate, subproblem, done, direction)
        found = self._search(program, iterate, direction, subproblem, relaxed=relaxed)
        if found is None:
            return self._refused(program, iterate, subproblem, direction)
        return self._advance(program, iterate, direction, found, subproblem, relaxed=relaxed)

    # --- the model --------------------------------------------------------------------------

    def _is_early(self, iterate: Iterate) -> bool:
        first = 0 if self.settings.resumed else WHOLLY_CLIPPED
        return iterate.number < first or iterate.violation > CLIPPED_ABOVE

    def _clipped(self, iterate: Iterate) -> float:
        wholly = self.backend.needs_convex or iterate.relaxation.active or self._is_early(iterate)
        return 1.0 if wholly else iterate.model.clipped

    def _subproblem(
        self, program: NonlinearProgram, iterate: Iterate, clipped: float
    ) -> Subproblem:
        lin, settings, count = iterate.lin, self.settings, program.nonlinear
        y, z, damping = iterate.y, iterate.z, iterate.model.damping
        curved = z[:count].sum() > CURVED
        if not (curved or np.abs(y).max(initial=0.0) > CURVED):
            y = np.zeros_like(y)
        if not curved:
            z = np.append(np.zeros(count), z[count:])
        if iterate.finishing:
            y, z, damping = np.zeros_like(y), np.zeros_like(z), max(damping, 1.0)
        H = program.hessian(lin, y, z, clipped=clipped, damping=damping)
        values, number = lin.at.inequalities, iterate.number
        keep = lin.C.leading(values)
        if number > 0 or settings.resumed:
            moved = FIRST_NEAR if iterate.step is None else iterate.step
            keep = (keep & (values > -(NEAR + moved))) | (iterate.z > 0.0)
        early = number < WHOLLY_CLIPPED
        if iterate.violation > DECISIVE_ABOVE or early:
            keep = keep | program.decisive(iterate.point, early=early)
        share = np.clip(QP_SHARE * iterate.violation, LEAST_TOLERANCE, LARGEST_TOLERANCE)
        tolerance = LEAST_TOLERANCE if iterate.finishing else float(share)
        backends = (self.backend,) if self.fallback is None else (self.backend, self.fallback)
        return Subproblem(lin, H, keep, backends, tolerance)

    def _decrease(self, program: NonlinearProgram, iterate: Iterate, direction: Direction) -> float:
        """Decrease of the merit function that a step promises to first order."""
        at, penalty, count = iterate.lin.at, iterate.penalty, program.nonlinear
        after = penalty.of(direction.predicted, np.zeros(0), count)
        before = penalty.of(at.inequalities, at.equalities, count)
        return before - after - float(iterate.lin.gradient @ direction.step)

    def _is_stationary(
        self, program: NonlinearProgram, iterate: Iterate, direction: Direction
    ) -> bool:
        feasible = iterate.is_feasible(program.tolerance, self.settings.equality)
        return feasible and self._decrease(program, iterate, direction) <= self.settings.optimality

    # --- the step ---------------------------------------------------------------------------

    def _search(
        self,
        program: NonlinearProgram,
        iterate: Iterate,
        direction: Direction,
        subproblem: Subproblem,
        *,
        relaxed: bool,
    ) -> _Found | None:
        """Point that lowers the merit function enough, with its expansion."""
        count, penalty, lin = program.nonlinear, iterate.penalty, iterate.lin
        start = penalty.merit(lin.at, count)
        promised = ARMIJO_SLOPE * max(self._decrease(program, iterate, direction), 0.0)
        noise = ROUNDING * max(1.0, abs(start))

        def is_enough(at: Evaluation, length: float) -> bool:
            return penalty.merit(at, count) <= start - length * promised + noise

        def linearized(point: Any, length: float, corrections: int = 0) -> _Found:
            found = _with(program.linearize(point), iterate.excess)
            return _Found(point, found, length, corrections)

        point = program.moved(lin, iterate.point, direction.step)
        full = None  # derivatives are computed at once where the step is likely to be taken
        if iterate.change is not None or iterate.number == 0:
            full = linearized(point, 1.0)
        end = _added(program.evaluate(point), iterate.excess) if full is None else full.lin.at
        closes = iterate.finishing and is_feasible(end, program.tolerance, self.settings.equality)
        if is_enough(end, 1.0) or closes:
            return full or linearized(point, 1.0)
        step = direction.step
        corrections = MOST_CORRECTIONS if end.violation > iterate.violation and not relaxed else 0
        for count_of in range(1, corrections + 1):
            if not end.is_finite():
                break
            before = end.violation
            corrected = subproblem.corrected(step, end.inequalities, end.equalities)
            if corrected is None:
                break
            step = corrected
            point = program.moved(lin, iterate.point, step)
            end = _added(program.evaluate(point), iterate.excess)
            if is_enough(end, 1.0):
                return linearized(point, 1.0, count_of)
            if not end.violation <= 0.5 * before:
                break
        length = 0.5
        while length >= SHORTEST_STEP:
            point = program.moved(lin, iterate.point, length * direction.step)
            if is_enough(_added(program.evaluate(point), iterate.excess), length):
                return linearized(point, length)
            length *= 0.5
        return None

    def _refused(
        self,
        program: NonlinearProgram,
        iterate: Iterate,
        subproblem: Subproblem,
        direction: Direction,
    ) -> Iterate:
        """No step lowers the merit function: damp the model, or end the run."""
        feasible = iterate.is_feasible(program.tolerance, self.settings.equality)
        violation, relaxation = iterate.violation, iterate.relaxation
        if violation > PATIENCE_VIOLATION and direction.slack > PATIENCE_SHARE * violation:
            # not even to first order does a step lower the violation at this price
            is_dear = max(relaxation.price, iterate.penalty.nonlinear) >= DEAR
            dear = replace(relaxation, price=DEAR, violations=())
            given_up = SQPStatus.INFEASIBLE if is_dear else None
            stuck = replace(iterate, relaxation=dear, verdict=given_up)
            return self._stay(iterate, subproblem, stuck, direction)
        ends = feasible or iterate.model.damping > LARGEST_DAMPING
        verdict = None
        if ends:
            verdict = SQPStatus.FEASIBLE if feasible else SQPStatus.STALLED
        damped = replace(iterate, model=iterate.model.damped(), verdict=verdict)
        return self._stay(iterate, subproblem, damped, direction)

    def _advance(
        self,
        program: NonlinearProgram,
        iterate: Iterate,
        direction: Direction,
        found: _Found,
        subproblem: Subproblem,
        *,
        relaxed: bool,
    ) -> Iterate:
        """The iterate at an accepted point."""
        full = found.length == 1.0
        change = _relative_change(iterate.lin.at.objective, found.lin.at.objective)
        model = iterate.model
        if not self._is_early(iterate):
            model = self._lowered(iterate, direction, found, change)
        model = model.after_step(found.length)
        moved = found.length * np.abs(direction.predicted - iterate.lin.at.inequalities)
        was_violated = iterate.violation
        ahead = replace(
            iterate,
            point=found.point,
            lin=found.lin,
            y=direction.y,
            z=direction.z,
            model=model,
            number=iterate.number + 1,
            step=moved,
            change=change if full else None,
        )
        ahead = self._with_excess(program, ahead, change)
        slack = relaxed and direction.slack > LEFT * max(was_violated, LEFT)
        ahead = self._with_relaxation(ahead, relaxed=relaxed, slack=slack)
        to_come = _still_to_come(change, iterate.change)
        ahead = self._judged(program, ahead, to_come, iterate.model.damping, full=full)
        self._record(ahead, direction, subproblem, found, relaxed=relaxed)
        return ahead

    def _lowered(
        self, iterate: Iterate, direction: Direction, found: _Found, change: float
    ) -> CurvatureModel:
        """Model with less of the negative curvature clipped after a step that went well."""
        model = iterate.model
        if found.corrections > 1 or found.length < 1.0 or direction.inner > HARD:
            clipped = min(1.0, max(LEAST_CLIPPED_LATER, 2.0 * model.clipped))
            return replace(model, clipped=clipped)
        if model.held:
            return replace(model, held=model.held - 1)
        creeps = (
            iterate.number >= 3
            and iterate.change is not None
            and 0.5 * iterate.change < change < CREEPING
        )
        least = 0.0 if creeps else min(model.clipped, LEAST_CLIPPED)
        return replace(model, clipped=max(least, 0.5 * model.clipped))

    def _with_excess(self, program: NonlinearProgram, iterate: Iterate, change: float) -> Iterate:
        """With what nonlinear rows exceed between their places, late in the run."""
        settings = self.settings
        late = settings.excess_from > 0.0 and change < settings.excess_from
        if not late and iterate.excess is None:
            return iterate
        fine = iterate.finishing or change < settings.converged
        raw = program.excess(iterate.point, iterate.lin.at, fine=fine)
        if raw is None:
            return iterate
        old = iterate.excess
        if old is not None and iterate.finishing and bool((raw <= old).all()):
            return iterate
        excess = EXCESS_FACTOR * raw + EXCESS_GUARD
        bare = replace(iterate.lin, at=_without(iterate.lin.at, old))
        return replace(iterate, lin=_with(bare, excess), excess=excess)

    def _with_relaxation(self, iterate: Iterate, *, relaxed: bool, slack: bool) -> Iterate:
        """With the series of relaxed steps, and what it says of feasibility."""
        relaxation = iterate.relaxation
        if not relaxed:
            return replace(iterate, relaxation=Relaxation(price=relaxation.price))
        violation = iterate.violation
        series = (*relaxation.violations, violation / iterate.lin.at.objective)
        price, verdict = relaxation.price, None
        stuck = (
            len(series) > PATIENCE
            and violation > PATIENCE_VIOLATION
            and series[-1] > PATIENCE_SHARE * series[-1 - PATIENCE]
        )
        if stuck:
            # a slower point might be less violated: at a higher price it would be found
            dear = max(price, iterate.penalty.nonlinear) >= DEAR
            verdict = SQPStatus.INFEASIBLE if dear else None
            price, series = DEAR, series[-1:]
        return replace(iterate, relaxation=Relaxation(slack, price, series), verdict=verdict)

    def _judged(
        self,
        program: NonlinearProgram,
        iterate: Iterate,
        to_come: float,
        damping: float,
        *,
        full: bool,
    ) -> Iterate:
        """With the verdict on an accepted point, and whether the next step is to finish the run."""
        if iterate.verdict is not None:
            return iterate
        settings = self.settings
        feasible = iterate.is_feasible(program.tolerance, settings.equality)
        if feasible and program.optimality_gap(iterate.point) <= 2.0 * settings.equality:
            return replace(iterate, verdict=SQPStatus.BOUND_REACHED)
        damped = damping > UNDAMPED and not iterate.finishing
        if not full or to_come >= settings.converged or damped:
            return replace(iterate, finishing=False)
        if feasible:
            return replace(iterate, verdict=SQPStatus.OPTIMAL)
        if iterate.violation < settings.coarse:
            return replace(iterate, verdict=SQPStatus.COARSE)
        return replace(iterate, finishing=iterate.violation < settings.closable)

    # --- records ----------------------------------------------------------------------------

    def _stay(
        self,
        iterate: Iterate,
        subproblem: Subproblem,
        changed: Iterate,
        direction: Direction | None = None,
    ) -> Iterate:
        """The same point with another model, which counts as an iteration."""
        stays = _Found(iterate.point, iterate.lin, 0.0, 0)
        counted = replace(changed, number=iterate.number + 1)
        self._record(counted, direction, subproblem, stays, relaxed=False)
        return counted

    def _record(
        self,
        iterate: Iterate,
        direction: Direction | None,
        subproblem: Subproblem,
        found: _Found,
        *,
        relaxed: bool,
    ) -> None:
        record = IterationRecord(
            iteration=iterate.number,
            backend=self.backend.name if direction is None else direction.backend,
            inner_iterations=subproblem.inner,
            rows=int(subproblem.keep.sum()),
            relaxed=relaxed,
            curvature=bool(iterate.z.any()),
            corrected=found.corrections > 0,
            objective=iterate.lin.at.objective,
            violation=iterate.violation,
            step=found.length,
            time=time.perf_counter() - self._started,
        )
        self._history.append(record)
        if self.report is not None:
            self.report(record)


@dataclass(frozen=True, slots=True, eq=False)
class _Found:
    """An accepted point, its expansion, the length of the step, and how often it was corrected."""

    point: Any
    lin: Linearization
    length: float
    corrections: int


def _still_to_come(change: float, before: float | None) -> float:
    """The last change, or the sum of all that would follow by its ratio to the one before."""
    if before is None or before <= 0.0:
        return change
    ratio = min(change / before, SLOWEST)
    return change * max(1.0, ratio / (1.0 - ratio))


def _relative_change(before: float, after: float) -> float:
    """Of the square root of the objective, to first order: of a duration, if it is the square."""
    return 0.5 * abs(after - before) / max(abs(before), LEAST_OBJECTIVE)


def _added(at: Evaluation, excess: Array | None, sign: float = 1.0) -> Evaluation:
    if excess is None:
        return at
    inequalities = at.inequalities.copy()
    inequalities[: len(excess)] += sign * excess
    return replace(at, inequalities=inequalities)


def _without(at: Evaluation, excess: Array | None) -> Evaluation:
    return _added(at, excess, -1.0)


def _with(lin: Linearization, excess: Array | None) -> Linearization:
    return lin if excess is None else replace(lin, at=_added(lin.at, excess))

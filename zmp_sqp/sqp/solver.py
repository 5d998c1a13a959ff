"""Sequential quadratic programming with exact Hessians, a line search and relaxation."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import nan
from typing import Any

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.sqp.backends import QPBackend
from zmp_sqp.sqp.direction import Direction, Subproblem
from zmp_sqp.sqp.iterate import CurvatureModel, Iterate, Relaxation, is_feasible
from zmp_sqp.sqp.nlp import Evaluation, NonlinearProgram
from zmp_sqp.sqp.result import IterationRecord, SQPResult, SQPStatus
from zmp_sqp.sqp.steps import (
    Accepted,
    Closing,
    added,
    padded,
    relative_change,
    remaining_change,
    with_excess,
    without,
)

__all__ = ["SQP", "SQPSettings"]

ARMIJO_SLOPE = 1e-4  # Nocedal & Wright 2006, eq. (3.4)
SHORTEST_STEP = 1e-3  # of the line search, relative to the full step
MOST_CORRECTIONS = 2  # second-order corrections of a refused step, while each halves the violation
ROUNDING = 1e-11  # relative rounding error of the merit function
# largest predicted increase of the merit function by a step of a partly clipped model
ALLOWED_INCREASE = 1e-6
CURVED = 1e-4  # least sum of multipliers for which their curvature is in the Hessian
# share of negative curvature that is clipped: all of it in the first iterations and far from
# feasibility, then half as much after each full step, down to zero where convergence is slow
WHOLLY_CLIPPED = 2  # first iterations with full clipping
CLIPPED_ABOVE = 0.2  # violation above which clipping is full
LEAST_CLIPPED = 0.3  # smallest share while convergence is fast
LEAST_CLIPPED_LATER = 0.1  # smallest share after a shortened, twice corrected or costly step
CREEPING = 3e-3  # convergence is slow if the change is below this and above half of the last change
CLIPPED_AGAIN = 0.5  # share after a QP that was not convex enough; if that fails, all is clipped
KEPT_STEPS = 1  # number of following steps for which that share is not lowered
# iterations of an interior-point method at most: indefinite QPs do not converge, convex ones need
# fewer
INNER, INNER_CONVEX = 30, 60
MANY_INNER = 28  # iterations of the QP solver that count as costly
# screening: a row is in the QP if its distance from its bound is below this value plus the row's
# change in the last step; in the first step of a resumed run, and in relaxed QPs, it is larger
NEAR = 0.08
FIRST_NEAR = 0.2
RELAXED_NEAR = 0.5
WHOLLY_DECISIVE = 3  # first iterations with all `decisive` rows, unless the run is resumed
DECISIVE_ABOVE = 3e-3  # violation above which the QP contains the program's `decisive` rows
# tolerance of QPs: a share of the violation, within bounds; 1.5e-2 to 5e-2 take the same time
QP_SHARE, LEAST_TOLERANCE, LARGEST_TOLERANCE = 2e-2, 1e-8, 1e-4
# damping at which the run gives up: after refused steps, and after QPs that no backend solved
LARGEST_DAMPING, LARGEST_QP_DAMPING = 1e2, 10.0
LARGEST_PRICE = 1e5  # of the slack; a QP with a larger sum of multipliers counts as infeasible
UNDAMPED = 1e-4  # damping above which a small change is no sign of convergence
# relaxed steps are stuck if over this many of them the violation stays above this share of itself
# and above this value
PATIENCE, PATIENCE_SHARE, PATIENCE_VIOLATION = 3, 0.9, 1e-3
# price at which being stuck means infeasible: it outweighs any increase of the objective, so that a
# less violated point with a far larger objective would have been found
INFEASIBLE_PRICE = 300.0
NEGLIGIBLE_SLACK = 1e-3  # relative to the violation: a smaller slack counts as none


@dataclass(frozen=True, slots=True)
class SQPSettings:
    """Stopping criteria and limits of an SQP run.

    Attributes:
        optimality: Largest predicted decrease of the merit function at a solution.
        converged: Relative change of the objective's square root that ends the run. It is the
            change by a full step plus the extrapolated changes by all steps that would follow.
        closable: Largest violation for which one finishing step is tried.
        coarse: Violation below which the run may end as COARSE; 0 asks for a solution.
        excess_from: Change below which `NonlinearProgram.excess` is added to the rows; 0 for never.
        equality: Largest violation of an equality at a solution.
        max_iterations: Largest number of iterations.
        resumed: Whether the initial guess is near a solution with known multipliers: clipping is
            then not full at first, and rows are screened from the first QP on.
        all_decisive: Whether the first QP of a resumed run has all `decisive` rows.
        chords: Largest number of chord steps that close the violation after the last step
            (`Closing`); 0 leaves that to finishing steps.
        loosest: Largest tolerance of QPs; chord steps need a small one.
        worthwhile: Relative decrease of the objective's square root that the first step must
            promise; the run ends as NO_GAIN if it does not. 0 for no such test.
        relaxes: Whether infeasible QPs are relaxed; else the run ends as STALLED.
        deadline: Value of `clock` after which no iteration starts [s]; None for none.
        clock: Clock of the deadline and of the records [s].
    """

    optimality: float = 1e-6
    converged: float = 5e-5
    closable: float = 3e-3
    coarse: float = 0.0
    excess_from: float = 5e-4
    equality: float = 2e-7
    max_iterations: int = 60
    resumed: bool = False
    all_decisive: bool = False
    chords: int = 0
    loosest: float = LARGEST_TOLERANCE
    worthwhile: float = 0.0
    relaxes: bool = True
    deadline: float | None = None
    clock: Callable[[], float] = time.perf_counter


@dataclass(slots=True)
class SQP:
    r"""Sequential quadratic programming with a line search.

    Each iteration solves a quadratic program with linearised constraints and a model of the
    Lagrangian's Hessian, then backtracks on an exact penalty function (`Penalty`) until Armijo's
    condition holds (Han 1977; Nocedal & Wright 2006, chapter 18).

    * The Hessian is exact, but for a share of its negative curvature, which is clipped block by
      block (`CurvatureModel`). The share falls while steps are full. Where the QP is not convex
      enough to be solved, the share is raised, at last to all of the negative curvature.
    * A full step that raises the violation and is refused gets a second-order correction:
      the QP is solved again with the constraint values at its end, against the Maratos effect.
    * An infeasible QP is relaxed by a slack on its nonlinear rows. If relaxed steps no longer lower
      the violation, at a price that outweighs any increase of the objective, the run ends with
      INFEASIBLE.
    * The excess of nonlinear rows between the points where they are imposed is added to them late
      in the run, with a lag of one step.
    * The run ends when full steps change the objective's square root by less than `converged`. A
      remaining violation is closed by one finishing step without curvature of the constraints. The
      run also ends at a feasible point where the objective is at its proven bound, or where no
      decrease of the merit function is predicted.

    Attributes:
        backend: Solver of the QPs.
        settings: Stopping criteria and limits.
        report: Called after every iteration with its record; None for no calls.
    """

    backend: QPBackend
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
        """Find a local minimiser from a point that need not be feasible.

        Args:
            program: Nonlinear program.
            point: Initial guess.
            y, z: Multipliers of equalities and inequalities, from a nearby solution; None for none.
            excess: Amounts added to the nonlinear rows at that solution; None for none.

        Returns:
            The solution, or the last iterate; `status.is_feasible` tells whether it satisfies the
            constraints.
        """
        iterate = self.init(program, point, y=y, z=z, excess=excess)
        best: Iterate | None = None
        while (status := self.terminate(iterate)) is None:
            iterate = self.step(program, iterate)
            if iterate.is_feasible(program.tolerance, self.settings.equality):
                best = iterate
        meant = (SQPStatus.COARSE, SQPStatus.NO_GAIN)
        if best is not None and not status.is_feasible and status not in meant:
            status = SQPStatus.FEASIBLE
            if not iterate.is_feasible(program.tolerance, self.settings.equality):
                iterate = best
        at = without(iterate.lin.at, iterate.excess)
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
        """First iterate at an initial guess.

        Args:
            program, point, y, z, excess: Arguments of `minimize`.
        """
        self._history, self._started = [], self.settings.clock()
        lin = with_excess(program.linearize(point), excess)
        y = np.zeros(program.equalities) if y is None else y
        z = np.zeros(program.inequalities) if z is None else z
        verdict = None if lin.at.is_finite() else SQPStatus.NOT_FINITE
        return Iterate(point, lin, y, z, excess, verdict=verdict)

    def terminate(self, iterate: Iterate) -> SQPStatus | None:
        """Why the run ends at an iterate; None if it goes on."""
        deadline = self.settings.deadline
        late = deadline is not None and self.settings.clock() > deadline
        if iterate.verdict is not None:  # when time is up, backends give up QPs
            failed = iterate.verdict is SQPStatus.QP_FAILED
            return SQPStatus.TIME_LIMIT if late and failed else iterate.verdict
        if late:
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
                direction = None  # feasible only by a step far too long for the linearisation
            if clipped < 1.0 and (
                direction is None
                or self._predicted_decrease(program, iterate, direction) < -ALLOWED_INCREASE
            ):
                again = CLIPPED_AGAIN if clipped < CLIPPED_AGAIN else 1.0
                model = replace(iterate.model, clipped=again, kept_steps=KEPT_STEPS)
                return self._same_point(iterate, subproblem, replace(iterate, model=model))
        if direction is None and not self.settings.relaxes:
            return self._same_point(
                iterate, subproblem, replace(iterate, verdict=SQPStatus.STALLED)
            )
        if direction is None:
            relaxed = True
            price = min(max(iterate.relaxation.price, iterate.penalty.nonlinear), LARGEST_PRICE)
            values = iterate.lin.at.inequalities
            subproblem.keep |= (values > -RELAXED_NEAR) & iterate.lin.C.leading(values)
            subproblem.keep[-1:] = True  # the lower bound of the objective
            direction = subproblem.solve_relaxed(program.nonlinear, price)
        if direction is None:
            failed = iterate.model.damping > LARGEST_QP_DAMPING
            verdict = SQPStatus.QP_FAILED if failed else None
            damped = replace(iterate, model=iterate.model.damped(), verdict=verdict)
            return self._same_point(iterate, subproblem, damped)
        if iterate.number == 0 and not relaxed and not self._is_worthwhile(iterate, direction):
            vain = replace(iterate, verdict=SQPStatus.NO_GAIN)
            return self._same_point(iterate, subproblem, vain, direction)
        penalty = iterate.penalty.raised(direction.y, direction.z, program.nonlinear)
        iterate = replace(iterate, penalty=penalty)
        decrease = self._predicted_decrease(program, iterate, direction)
        direction = replace(direction, decrease=decrease)
        if self._is_stationary(program, iterate, direction):
            done = replace(iterate, y=direction.y, z=direction.z, verdict=SQPStatus.OPTIMAL)
            return self._same_point(iterate, subproblem, done, direction)
        found = self._search(program, iterate, direction, subproblem, relaxed=relaxed)
        if found is None:
            return self._after_refusal(program, iterate, subproblem, direction)
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
        first = 1 if settings.all_decisive else 0
        early = number < (first if settings.resumed else WHOLLY_DECISIVE)
        if iterate.violation > DECISIVE_ABOVE or early:
            keep = keep | program.decisive(iterate.point, early=early)
        share = np.clip(QP_SHARE * iterate.violation, LEAST_TOLERANCE, settings.loosest)
        tolerance = LEAST_TOLERANCE if iterate.finishing else float(share)
        return Subproblem(lin, H, keep, self.backend, tolerance)

    def _predicted_decrease(
        self, program: NonlinearProgram, iterate: Iterate, direction: Direction
    ) -> float:
        """First-order predicted decrease of the merit function by a full step."""
        at, penalty, count = iterate.lin.at, iterate.penalty, program.nonlinear
        after = penalty.of(direction.predicted, np.zeros(0), count)
        before = penalty.of(at.inequalities, at.equalities, count)
        return before - after - float(iterate.lin.gradient @ direction.step)

    def _is_worthwhile(self, iterate: Iterate, direction: Direction) -> bool:
        least, lin = self.settings.worthwhile, iterate.lin
        gain = -0.5 * float(lin.gradient @ direction.step)
        return least == 0.0 or gain >= least * lin.at.objective

    def _is_stationary(
        self, program: NonlinearProgram, iterate: Iterate, direction: Direction
    ) -> bool:
        if not iterate.is_feasible(program.tolerance, self.settings.equality):
            return False
        # a large increase says nothing: the step misses rows outside of the QP
        return -ALLOWED_INCREASE <= direction.decrease <= self.settings.optimality

    # --- the step ---------------------------------------------------------------------------

    def _search(
        self,
        program: NonlinearProgram,
        iterate: Iterate,
        direction: Direction,
        subproblem: Subproblem,
        *,
        relaxed: bool,
    ) -> Accepted | None:
        """Line search: point that meets Armijo's condition, with its expansion, or None."""
        count, penalty, lin = program.nonlinear, iterate.penalty, iterate.lin
        start = penalty.merit(lin.at, count)
        promised = ARMIJO_SLOPE * max(direction.decrease, 0.0)
        noise = ROUNDING * max(1.0, abs(start))

        def is_enough(at: Evaluation, length: float) -> bool:
            return penalty.merit(at, count) <= start - length * promised + noise

        def linearized(point: Any, length: float, corrections: int = 0) -> Accepted:
            found = with_excess(program.linearize(point), iterate.excess)
            return Accepted(point, found, length, corrections)

        damped = iterate.model.damping > UNDAMPED and not iterate.finishing
        if self.settings.chords and not relaxed and not damped:
            closed = self._closing(program).of(iterate, direction, subproblem, is_enough)
            if closed is not None:
                return closed
        point = program.moved(lin, iterate.point, direction.step)
        full: Accepted | None = None
        # where the full step is likely to be accepted, derivatives are computed at once
        if iterate.number == 0 or (iterate.change is not None and not iterate.corrected):
            full = linearized(point, 1.0)
        end = added(program.evaluate(point), iterate.excess) if full is None else full.lin.at
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
            end = added(program.evaluate(point), iterate.excess)
            if is_enough(end, 1.0):
                return linearized(point, 1.0, count_of)
            if not end.violation <= 0.5 * before:
                break
        length = 0.5
        while length >= SHORTEST_STEP:
            point = program.moved(lin, iterate.point, length * direction.step)
            if is_enough(added(program.evaluate(point), iterate.excess), length):
                return linearized(point, length)
            length *= 0.5
        return None

    def _closing(self, program: NonlinearProgram) -> Closing:
        settings = self.settings
        limits = settings.converged, settings.closable, settings.equality
        return Closing(program, settings.chords, *limits)

    def _after_refusal(
        self,
        program: NonlinearProgram,
        iterate: Iterate,
        subproblem: Subproblem,
        direction: Direction,
    ) -> Iterate:
        """Iterate after a failed line search: damp the model, raise the price, or end the run."""
        feasible = iterate.is_feasible(program.tolerance, self.settings.equality)
        violation, relaxation = iterate.violation, iterate.relaxation
        if violation > PATIENCE_VIOLATION and direction.slack > PATIENCE_SHARE * violation:
            # even the linearised constraints stay violated at this price
            is_final = max(relaxation.price, iterate.penalty.nonlinear) >= INFEASIBLE_PRICE
            dear = replace(relaxation, price=INFEASIBLE_PRICE, violations=())
            given_up = SQPStatus.INFEASIBLE if is_final else None
            stuck = replace(iterate, relaxation=dear, verdict=given_up)
            return self._same_point(iterate, subproblem, stuck, direction)
        ends = feasible or iterate.model.damping > LARGEST_DAMPING
        verdict = None
        if ends:
            verdict = SQPStatus.FEASIBLE if feasible else SQPStatus.STALLED
        damped = replace(iterate, model=iterate.model.damped(), verdict=verdict)
        return self._same_point(iterate, subproblem, damped, direction)

    def _advance(
        self,
        program: NonlinearProgram,
        iterate: Iterate,
        direction: Direction,
        found: Accepted,
        subproblem: Subproblem,
        *,
        relaxed: bool,
    ) -> Iterate:
        """Next iterate, at an accepted point."""
        if found.final:
            return self._last(program, iterate, direction, found, subproblem)
        full = found.length == 1.0
        change = relative_change(iterate.lin.at.objective, found.lin.at.objective)
        model = iterate.model
        if not self._is_early(iterate):
            model = self._less_clipped(iterate, direction, found, change)
        model = model.after_step(found.length)
        moved = found.length * np.abs(direction.predicted - iterate.lin.at.inequalities)
        old_violation = iterate.violation
        successor = replace(
            iterate,
            point=found.point,
            lin=found.lin,
            y=direction.y,
            z=direction.z,
            model=model,
            number=iterate.number + 1,
            step=moved,
            change=change if full else None,
            corrected=found.corrections > 0,
        )
        successor = self._with_excess(program, successor, change)
        slack = relaxed and direction.slack > NEGLIGIBLE_SLACK * max(
            old_violation, NEGLIGIBLE_SLACK
        )
        successor = self._with_relaxation(successor, relaxed=relaxed, slack=slack)
        remaining = remaining_change(change, iterate.change)
        successor = self._with_verdict(
            program, successor, remaining, iterate.model.damping, full=full
        )
        self._record(successor, direction, subproblem, found, relaxed=relaxed)
        return successor

    def _last(
        self,
        program: NonlinearProgram,
        iterate: Iterate,
        direction: Direction,
        found: Accepted,
        subproblem: Subproblem,
    ) -> Iterate:
        """Iterate at a solution."""
        at_bound = program.optimality_gap(found.point) <= 2.0 * self.settings.equality
        successor = replace(
            iterate,
            point=found.point,
            lin=found.lin,
            y=direction.y,
            z=direction.z,
            excess=found.excess,
            number=iterate.number + 1,
            verdict=SQPStatus.BOUND_REACHED if at_bound else SQPStatus.OPTIMAL,
        )
        self._record(successor, direction, subproblem, found, relaxed=False)
        return successor

    def _less_clipped(
        self, iterate: Iterate, direction: Direction, found: Accepted, change: float
    ) -> CurvatureModel:
        """Curvature model after a step: less clipping after a good step, more after a bad one."""
        model = iterate.model
        if found.corrections > 1 or found.length < 1.0 or direction.inner > MANY_INNER:
            clipped = min(1.0, max(LEAST_CLIPPED_LATER, 2.0 * model.clipped))
            return replace(model, clipped=clipped)
        if model.kept_steps:
            return replace(model, kept_steps=model.kept_steps - 1)
        creeps = (
            iterate.number >= 3
            and iterate.change is not None
            and 0.5 * iterate.change < change < CREEPING
        )
        least = 0.0 if creeps else min(model.clipped, LEAST_CLIPPED)
        return replace(model, clipped=max(least, 0.5 * model.clipped))

    def _with_excess(self, program: NonlinearProgram, iterate: Iterate, change: float) -> Iterate:
        """Iterate with `NonlinearProgram.excess` added to its rows, late in the run."""
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
        excess = padded(raw)
        bare = replace(iterate.lin, at=without(iterate.lin.at, old))
        return replace(iterate, lin=with_excess(bare, excess), excess=excess)

    def _with_relaxation(self, iterate: Iterate, *, relaxed: bool, slack: bool) -> Iterate:
        """Iterate with its series of relaxed steps, and with the verdict INFEASIBLE if stuck."""
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
            # a point of larger objective might be less violated, and needs a higher price
            is_final = max(price, iterate.penalty.nonlinear) >= INFEASIBLE_PRICE
            verdict = SQPStatus.INFEASIBLE if is_final else None
            price, series = INFEASIBLE_PRICE, series[-1:]
        return replace(iterate, relaxation=Relaxation(slack, price, series), verdict=verdict)

    def _with_verdict(
        self,
        program: NonlinearProgram,
        iterate: Iterate,
        remaining: float,
        damping: float,
        *,
        full: bool,
    ) -> Iterate:
        """Iterate with the verdict on an accepted point, or marked for a finishing step."""
        if iterate.verdict is not None:
            return iterate
        settings = self.settings
        feasible = iterate.is_feasible(program.tolerance, settings.equality)
        if feasible and program.optimality_gap(iterate.point) <= 2.0 * settings.equality:
            return replace(iterate, verdict=SQPStatus.BOUND_REACHED)
        damped = damping > UNDAMPED and not iterate.finishing
        if not full or remaining >= settings.converged or damped:
            return replace(iterate, finishing=False)
        if feasible:
            return replace(iterate, verdict=SQPStatus.OPTIMAL)
        if iterate.violation < settings.coarse:
            return replace(iterate, verdict=SQPStatus.COARSE)
        return replace(iterate, finishing=iterate.violation < settings.closable)

    # --- records ----------------------------------------------------------------------------

    def _same_point(
        self,
        iterate: Iterate,
        subproblem: Subproblem,
        changed: Iterate,
        direction: Direction | None = None,
    ) -> Iterate:
        """Iterate at the same point with another model; it counts as an iteration."""
        stays = Accepted(iterate.point, iterate.lin, 0.0, 0)
        counted = replace(changed, number=iterate.number + 1)
        self._record(counted, direction, subproblem, stays, relaxed=False)
        return counted

    def _record(
        self,
        iterate: Iterate,
        direction: Direction | None,
        subproblem: Subproblem,
        found: Accepted,
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
            time=self.settings.clock() - self._started,
            decrease=nan if direction is None else direction.decrease,
        )
        self._history.append(record)
        if self.report is not None:
            self.report(record)

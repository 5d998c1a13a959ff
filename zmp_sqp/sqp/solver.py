"""The SQP: line search on an exact penalty, second-order correction, relaxation, convexified exact curvature."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.sparse as sp

from zmp_sqp.arrays import Array
from zmp_sqp.sqp.backends import QPBackend
from zmp_sqp.sqp.curvature import convexified
from zmp_sqp.sqp.merit import Merit
from zmp_sqp.sqp.nlp import Evaluation, Linearization, NonlinearProgram
from zmp_sqp.sqp.progress import LEAST_DAMPING, creeps, kkt_error, next_damping, nonlinear_weight
from zmp_sqp.sqp.restoration import CONTRACTION, restored
from zmp_sqp.sqp.result import IterationRecord, SQPResult, SQPStatus
from zmp_sqp.sqp.subproblem import Model, Multipliers, Step, Subproblem

__all__ = ["SQP", "SQPSettings"]

ARMIJO_SLOPE = 1e-4  # Nocedal & Wright 2006, eq. (3.4)
SHORTEST_STEP = 1e-3
# of a refused step, while each halves the violation (as in IPOPT, Waechter & Biegler 2006)
MOST_CORRECTIONS = 4
RELAXATION_GROWTH = 10.0  # of rho, when the relaxed QP keeps a slack
LEAST_RELAXATION, LARGEST_RELAXATION = 10.0, 1e5
# free variables up to which a backend for sparse QPs gets curved ones condensed
MOST_CONDENSED = 600
LARGEST_DAMPING = 1e3  # steps that are refused in spite of it end the run
# likewise QPs that fail: a flat model has steps too long for a QP solver's digits
LARGEST_QP_DAMPING = 1.0
ROUNDING = 1e-11  # of the merit function, relative: differences below it are noise


@dataclass(frozen=True, slots=True)
class SQPSettings:
    """When to stop and what to spend.

    Attributes:
        feasibility: Largest constraint violation of a solution.
        optimality: Largest predicted decrease of the objective at a solution, and largest
            Lagrangian gradient (1-norm).
        max_iterations: QPs at most.
        curvature_from: Least sum of multipliers of nonlinear rows for which their curvature is
            computed.
        floor: Least eigenvalue of the convexified Hessian.
        deadline: `time.perf_counter()` value after which no new QP of the SQP's own starts; None
            for none.
    """

    feasibility: float = 2e-7
    optimality: float = 2e-7
    max_iterations: int = 100
    curvature_from: float = 1e-4
    floor: float = 1e-8
    deadline: float | None = None


@dataclass(slots=True)
class SQP:
    r"""Sequential quadratic programming with a line search.

    Each iteration solves the QP of the linearised constraints and a convex model of the Lagrangian,
    then backtracks on an exact penalty function (`Merit`) until Armijo's condition holds.

    * Globalisation: weights above the multipliers' dual norms make the QP step a descent direction
      of the penalty, so limit points are Karush-Kuhn-Tucker points or stationary points of the
      violation (Han 1977; Nocedal & Wright 2006, chapter 18).
    * Second-order correction: a full step that is refused while it raises the violation is
      corrected with the constraints' values at its end, up to four times while each halves it,
      which undoes the Maratos effect.
    * Curvature: the exact Hessian of the Lagrangian, convexified in the null space of the active
      rows (`convexified`), computed only where multipliers of nonlinear rows make it count
      (equalities: of those whose gradients change).
    * A QP without solution is solved again with a slack on its nonlinear rows; if the slack stays
      although its price has grown by orders of magnitude, the point is a stationary point of the
      violation: INFEASIBLE.
    * Damping: after a short step the model's least curvature is raised tenfold, after full steps it
      fades (Levenberg and Marquardt's way to a trust region). It bounds steps along directions in
      which minimum time is all but flat.
    * A step that is refused to its shortest length is tried once more without curvature, then
      relaxed and with damping (the relaxed QP weighs feasibility against the length of the step); a
      QP that fails even when relaxed is damped, too. Then the run ends. It also ends where ten
      feasible steps have lowered the objective by less than a millionth.
    * While the objective stands at its proven bound, any feasible point is as good as another, so
      the tie breaker is left out, steps are the shortest ones that meet the linearised constraints,
      and a full step that leaves less than a third of the largest violation is taken: violations
      fall geometrically as long as that goes on.
    * It stops at a feasible point when the objective stands at its proven bound, when the
      Lagrangian's gradient and the complementarity products vanish, or when the QP predicts no
      decrease; never because steps are short: minimum time leaves joints with slack undetermined.
    """

    backend: QPBackend
    fallback: QPBackend | None = None
    settings: SQPSettings = field(default_factory=SQPSettings)
    report: Callable[[IterationRecord], None] | None = None

    def minimize(self, nlp: NonlinearProgram, x: Array) -> SQPResult:
        """Local minimiser of the program from an initial guess that need not be feasible.

        Args:
            nlp: The program.
            x: Initial guess, shape (n,).

        Returns:
            Last iterate; `status.is_feasible` says whether it satisfies the constraints.
        """
        started = time.perf_counter()
        settings, history = self.settings, list[IterationRecord]()
        lin = nlp.linearize(x)
        nonlinear = nlp.nonlinear_rows
        merit = Merit(nonlinear)
        y, z = np.zeros(len(lin.at.equalities)), np.zeros(len(lin.at.inequalities))
        if lin.basis is not None:
            y = y[lin.basis.eliminated :]
        if not lin.at.is_finite():
            return SQPResult(x, y, z, SQPStatus.NOT_FINITE, lin.at, ())

        last_feasible: tuple[Array, Array, Array, Evaluation] | None = None

        def record(
            backend: str,
            *,
            inner: int,
            rows: int,
            length: float,
            relaxed: bool = False,
            curvature: bool = False,
            corrected: bool = False,
        ) -> None:
            entry = IterationRecord(
                iteration=len(history) + 1,
                backend=backend,
                inner_iterations=inner,
                rows=rows,
                relaxed=relaxed,
                curvature=curvature,
                corrected=corrected,
                objective=lin.at.objective,
                violation=lin.at.violation,
                step=length,
                time=time.perf_counter() - started,
            )
            history.append(entry)
            if self.report is not None:
                self.report(entry)

        def late() -> bool:
            return settings.deadline is not None and time.perf_counter() > settings.deadline

        def finish(status: SQPStatus) -> SQPResult:
            if last_feasible is None:
                return SQPResult(x, y, z, status, lin.at, tuple(history))
            if not status.is_feasible:
                status = SQPStatus.FEASIBLE
            here = (x, y, z, lin.at) if lin.at.violation <= settings.feasibility else last_feasible
            return SQPResult(*here[:3], status, here[3], tuple(history))

        damping, refused, undamped = 0.0, False, False
        previous_gradients: Array | None = None
        while True:
            if lin.at.violation <= settings.feasibility:
                last_feasible = x, y, z, lin.at
                if nlp.optimality_gap(x) <= settings.optimality:
                    return finish(SQPStatus.BOUND_REACHED)
                if history and kkt_error(lin, y, z) <= settings.optimality:
                    return finish(SQPStatus.OPTIMAL)
            if len(history) >= settings.max_iterations:
                return finish(SQPStatus.ITERATION_LIMIT)
            if late():
                return finish(SQPStatus.TIME_LIMIT)
            if last_feasible is not None and creeps(history, settings.feasibility):
                return finish(SQPStatus.FEASIBLE)
            merit.breaks_ties = nlp.optimality_gap(x) > settings.optimality
            if not merit.breaks_ties and history:
                back = restored(
                    nlp, x, lin, z, feasibility=settings.feasibility, optimality=settings.optimality
                )
                if back is not None:
                    x, lin = back
                    record("restoration", inner=0, rows=int((z > 0.0).sum()), length=1.0)
                    continue
            subproblem = Subproblem(
                lin, nonlinear, self.backend, self.fallback, restoring=not merit.breaks_ties
            )
            gradients = subproblem.equality_gradients
            weight = float(z[nonlinear].sum())
            if previous_gradients is not None:
                weight += nonlinear_weight(y, gradients, previous_gradients)
            curved = merit.breaks_ties and weight > settings.curvature_from
            accepted, stationary = None, False
            for curvature in (True, False) if curved else (False,):
                if late():
                    return finish(SQPStatus.TIME_LIMIT)
                model = self._model(
                    nlp,
                    x,
                    y,
                    z,
                    subproblem,
                    merit.gradient(lin),
                    curvature=curvature,
                    damping=damping,
                )
                step = self._step(subproblem, model, (y, z), merit, elastic=refused)
                if not step.solved:
                    continue
                stationary = self._is_stationary(lin, step, merit)
                if stationary:
                    if damping > 0.0:  # it may be the damping that keeps the step short
                        break
                    y, z = step.y, step.z
                    infeasible = lin.at.violation > settings.feasibility
                    return finish(SQPStatus.INFEASIBLE if infeasible else SQPStatus.OPTIMAL)
                accepted = self._search(nlp, x, lin, step, merit, subproblem, model)
                if accepted is not None:
                    break
            if accepted is None:
                if late():
                    return finish(SQPStatus.TIME_LIMIT)
                if step.solved and stationary:
                    if undamped:  # at this point already: it would go round in circles
                        return finish(SQPStatus.STALLED)
                    damping, refused, undamped = 0.0, False, True
                    continue
                refused = step.solved and bool(nonlinear.any())
                damping = max(10.0 * damping, LEAST_DAMPING)
                if last_feasible is not None or damping > (
                    LARGEST_DAMPING if step.solved else LARGEST_QP_DAMPING
                ):
                    return finish(SQPStatus.STALLED if step.solved else SQPStatus.QP_FAILED)
                continue
            previous_gradients = gradients
            x, lin, length, corrected = accepted
            damping, refused, undamped = next_damping(damping, length), False, False
            y, z = step.y, step.z
            record(
                step.backend,
                inner=step.inner_iterations,
                rows=step.rows,
                length=length,
                curvature=curvature,
                relaxed=step.relaxation > settings.feasibility,
                corrected=corrected,
            )

    def _model(
        self,
        nlp: NonlinearProgram,
        x: Array,
        y: Array,
        z: Array,
        subproblem: Subproblem,
        gradient: Array,
        *,
        curvature: bool,
        damping: float,
    ) -> Model:
        """Convex model: of the objective alone, or with the constraints' curvature."""
        sparse = subproblem.prefers_whole and not (curvature and subproblem.size <= MOST_CONDENSED)
        weight = 1.0 if curvature else 0.0
        H = nlp.hessian(x, weight * y, weight * z, convex=sparse or not curvature)
        damped = H + damping * sp.eye_array(H.shape[0], format="csr") if damping > 0.0 else H
        if sparse:
            return Model(gradient, gradient, None, damped)
        condensed, g = subproblem.condensed_model(H, gradient)
        floor = max(self.settings.floor, damping)
        if not curvature:
            return Model(gradient, g, condensed + floor * np.eye(len(condensed)), damped)
        return Model(
            gradient, g, convexified(condensed, subproblem.active_rows(z), floor=floor), None
        )

    def _step(
        self,
        subproblem: Subproblem,
        model: Model,
        previous: Multipliers,
        merit: Merit,
        *,
        elastic: bool,
    ) -> Step:
        """Step of the QP, relaxed if it has no solution at a sane price, with penalty weights raised to multipliers."""
        if not elastic:
            step = subproblem.solve(model, previous=previous)
            if step.solved and step.z[merit.nonlinear].sum() <= LARGEST_RELAXATION:
                merit.raise_weights(step)
                return step
        # the model's curvature is that of the last multipliers: no higher; and nu outgrows each rho
        # that it is paid
        rho = min(max(LEAST_RELAXATION, merit.nu), LARGEST_RELAXATION)
        while True:
            step = subproblem.solve(model, previous=previous, relaxation_weight=rho)
            if (
                not step.solved
                or step.relaxation <= self.settings.feasibility
                or rho >= LARGEST_RELAXATION
            ):
                break
            current = float(
                np.maximum(subproblem.lin.at.inequalities[merit.nonlinear], 0.0).max(initial=0.0)
            )
            if step.relaxation <= 0.9 * current:  # it makes progress at this price
                break
            rho *= RELAXATION_GROWTH
        if step.solved:
            merit.raise_weights(step)
            merit.nu = max(
                merit.nu, rho if step.relaxation > self.settings.feasibility else merit.nu
            )
        return step

    def _is_stationary(self, lin: Linearization, step: Step, merit: Merit) -> bool:
        decrease = merit.predicted_decrease(lin, step.dx)
        if lin.at.violation <= self.settings.feasibility:
            return decrease <= self.settings.optimality
        return (
            step.relaxation > self.settings.feasibility
            and decrease <= merit.nu * self.settings.feasibility
        )

    def _search(
        self,
        nlp: NonlinearProgram,
        x: Array,
        lin: Linearization,
        step: Step,
        merit: Merit,
        subproblem: Subproblem,
        model: Model,
    ) -> tuple[Array, Linearization, float, bool] | None:
        """Point that satisfies Armijo's condition on the penalty function, with its linearisation."""
        start = merit.value(lin.at)
        slope = ARMIJO_SLOPE * max(merit.predicted_decrease(lin, step.dx), 0.0)
        noise = ROUNDING * max(1.0, abs(start))
        # nearly always accepted, so its derivatives are not wasted
        full = nlp.linearize(x + step.dx)
        contracted = full.at.is_finite() and full.at.violation <= CONTRACTION * lin.at.violation
        if (
            not merit.breaks_ties
            and contracted
            and nlp.optimality_gap(x + step.dx) <= self.settings.optimality
        ):
            return x + step.dx, full, 1.0, False
        if merit.value(full.at) <= start - slope + noise:
            return x + step.dx, full, 1.0, False
        if full.at.is_finite() and full.at.violation > lin.at.violation:
            end, dx = full.at, step.dx
            for _ in range(MOST_CORRECTIONS):
                before, corrected = (
                    end.violation,
                    self._corrected(lin, end, dx, step, subproblem, model),
                )
                if corrected is None:
                    break
                dx, end = corrected, nlp.evaluate(x + corrected)
                if merit.value(end) <= start - slope + noise:
                    return x + dx, nlp.linearize(x + dx), 1.0, True
                if not end.is_finite() or end.violation > 0.5 * before:
                    break
        length = 0.5
        while length >= SHORTEST_STEP:
            candidate = x + length * step.dx
            if merit.value(nlp.evaluate(candidate)) <= start - length * slope + noise:
                return candidate, nlp.linearize(candidate), length, False
            length *= 0.5
        return None

    def _corrected(
        self,
        lin: Linearization,
        end: Evaluation,
        dx: Array,
        step: Step,
        subproblem: Subproblem,
        model: Model,
    ) -> Array | None:
        """Step whose constraints carry the values found at the end of the refused one, dx."""
        equalities, inequalities = end.equalities - lin.A @ dx, end.inequalities - lin.C @ dx
        shifted = replace(lin, at=replace(lin.at, equalities=equalities, inequalities=inequalities))
        again = Subproblem(shifted, subproblem.nonlinear, self.backend, self.fallback)
        correction = again.solve(model, previous=(step.y, step.z))
        return correction.dx if correction.solved else None

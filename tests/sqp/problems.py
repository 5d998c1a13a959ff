"""Textbook programs with their published optimum, to test the SQP without a machine.

Numbers and formulas are those of W. Hock, K. Schittkowski, Test Examples for Nonlinear Programming
Codes, Lecture Notes in Economics and Mathematical Systems 187, Springer 1981 ("HS"). There
g(x) >= 0, here c = -g <= 0. Gradients are by complex steps, exact to rounding; Hessians are central
differences of the gradients.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.sparse as sp

from zmp_sqp.sqp.nlp import Evaluation, Linearization
from zmp_sqp.sqp.rows import Rows

__all__ = ["HOCK_SCHITTKOWSKI", "MARATOS", "Textbook", "named"]

Array = np.ndarray
Function = Callable[[Array], Any]
COMPLEX_STEP = 1e-30  # no difference is taken, so no digit is lost
NO_BOUND = -1.0  # last row of every program, where others bound their objective
TOLERANCE = 2e-7  # of inequalities at a solution
CENTRAL_STEP = 1e-5  # of exact gradients: error about 1e-10


@dataclass(frozen=True, eq=False)
class Textbook:
    """A small dense program with its known minimum.

    Attributes:
        name: In the book.
        start: The book's starting point.
        optimum: The book's f(x*).
        objective: f.
        equal: Equalities, a list of values.
        curved: Nonlinear inequalities, a list of values, feasible where <= 0.
        linear: Linear inequalities, a list of values, feasible where <= 0.
        lower, upper: Bounds of the variables, infinite where there are none.
        evaluations: Every point that was evaluated.
    """

    name: str
    start: Sequence[float]
    optimum: float
    objective: Function
    equal: Function = lambda x: []
    curved: Function = lambda x: []
    linear: Function = lambda x: []
    lower: float | Sequence[float] = -np.inf
    upper: float | Sequence[float] = np.inf
    evaluations: list[Array] = field(default_factory=list)

    @property
    def x0(self) -> Array:
        return np.array(self.start, dtype=float)

    @property
    def size(self) -> int:
        return len(self.start)

    @property
    def nonlinear(self) -> int:
        return len(self.curved(self.x0))

    @property
    def inequalities(self) -> int:
        return len(self._inequalities(self.x0))

    @property
    def equalities(self) -> int:
        return len(self.equal(self.x0))

    @property
    def tolerance(self) -> Array:
        return np.full(self.inequalities, TOLERANCE)

    def evaluate(self, x: Array) -> Evaluation:
        self.evaluations.append(np.array(x))
        with np.errstate(all="ignore"):
            return Evaluation(
                float(self.objective(x)),
                0.0,
                _vector(self.equal(x)).real,
                self._inequalities(x).real,
            )

    def linearize(self, x: Array) -> Linearization:
        parts = (self._objective, self._equalities, self._inequalities)
        gradient, A, C = (self._jacobian(part, x) for part in parts)
        A = sp.csc_matrix(A) if len(A) else None
        return Linearization(self.evaluate(x), gradient[0], A, Rows(sp.csc_matrix(C)), memory=x)

    def hessian(
        self, lin: Linearization, y: Array, z: Array, *, clipped: float, damping: float
    ) -> sp.csc_matrix:
        def gradient(x: Array) -> Array:
            parts = (self._objective, self._equalities, self._inequalities)
            f, A, C = (self._jacobian(part, x) for part in parts)
            return f[0] + y @ A + z @ C

        x, steps = lin.memory, CENTRAL_STEP * np.eye(self.size)
        H = np.array([(gradient(x + d) - gradient(x - d)) / (2.0 * CENTRAL_STEP) for d in steps])
        H = 0.5 * (H + H.T)
        if np.isfinite(H).all():
            values, vectors = np.linalg.eigh(H)
            kept = np.where(values > 0.0, values, (1.0 - clipped) * values)
            H = (vectors * kept) @ vectors.T
        return sp.csc_matrix(np.triu(H + damping * np.eye(self.size)))

    def moved(self, lin: Linearization, x: Array, step: Array) -> Array:
        return x + step

    def decisive(self, x: Array, *, early: bool) -> np.ndarray:
        return np.zeros(self.inequalities, dtype=bool)

    def excess(self, x: Array, at: Evaluation, *, fine: bool) -> None:
        return None

    def metric(self) -> sp.csc_matrix:
        return sp.csc_matrix(np.eye(self.size))

    def optimality_gap(self, x: Array) -> float:
        return np.inf

    def _objective(self, x: Array) -> Array:
        return _vector([self.objective(x)])

    def _equalities(self, x: Array) -> Array:
        return _vector(self.equal(x))

    def _inequalities(self, x: Array) -> Array:
        lower, upper = np.broadcast_to(self.lower, len(x)), np.broadcast_to(self.upper, len(x))
        has_lower, has_upper = np.isfinite(lower), np.isfinite(upper)
        bounds = [lower[has_lower] - x[has_lower], x[has_upper] - upper[has_upper]]
        rows = [_vector(self.curved(x)), _vector(self.linear(x)), *bounds, [NO_BOUND]]
        return np.concatenate(rows)

    def _jacobian(self, function: Function, x: Array) -> Array:
        with np.errstate(all="ignore"):
            columns = [
                function(x + 1j * COMPLEX_STEP * e).imag / COMPLEX_STEP for e in np.eye(len(x))
            ]
        return np.column_stack(columns)


def _vector(values: Any) -> Array:
    return np.array(list(values), dtype=complex)


def _hs43_rows(x: Array) -> list[Any]:
    a, b, c, d = x
    return [
        a**2 + b**2 + c**2 + d**2 + a - b + c - d - 8.0,
        a**2 + 2.0 * b**2 + c**2 + 2.0 * d**2 - a - d - 10.0,
        2.0 * a**2 + b**2 + c**2 + 2.0 * a - b - d - 5.0,
    ]


def _hs100_objective(x: Array) -> Any:
    a, b, c, d, e, f, g = x
    squares = (
        (a - 10.0) ** 2
        + 5.0 * (b - 12.0) ** 2
        + c**4
        + 3.0 * (d - 11.0) ** 2
        + 10.0 * e**6
        + 7.0 * f**2
        + g**4
    )
    return squares - 4.0 * f * g - 10.0 * f - 8.0 * g


def _hs100_rows(x: Array) -> list[Any]:
    a, b, c, d, e, f, g = x
    return [
        2.0 * a**2 + 3.0 * b**4 + c + 4.0 * d**2 + 5.0 * e - 127.0,
        7.0 * a + 3.0 * b + 10.0 * c**2 + d - e - 282.0,
        23.0 * a + b**2 + 6.0 * f**2 - 8.0 * g - 196.0,
        4.0 * a**2 + b**2 - 3.0 * a * b + 2.0 * c**2 + 5.0 * f - 11.0 * g,
    ]


def _hs104_objective(x: Array) -> Any:
    return 0.4 * (x[0] / x[6]) ** 0.67 + 0.4 * (x[1] / x[7]) ** 0.67 + 10.0 - x[0] - x[1]


def _hs104_rows(x: Array) -> list[Any]:
    a, b, c, d, e, f, g, h = x
    cost = _hs104_objective(x)
    return [
        0.0588 * e * g + 0.1 * a - 1.0,
        0.0588 * f * h + 0.1 * a + 0.1 * b - 1.0,
        4.0 * c / e + 2.0 / (c**0.71 * e) + 0.0588 * g / c**1.3 - 1.0,
        4.0 * d / f + 2.0 / (d**0.71 * f) + 0.0588 * h / d**1.3 - 1.0,
        1.0 - cost,
        cost - 4.2,
    ]


def _hs76_objective(x: Array) -> Any:
    a, b, c, d = x
    return a**2 + 0.5 * b**2 + c**2 + 0.5 * d**2 - a * c + c * d - a - 3.0 * b + c - d


def _hs35_objective(x: Array) -> Any:
    a, b, c = x
    return (
        9.0
        - 8.0 * a
        - 6.0 * b
        - 4.0 * c
        + 2.0 * a**2
        + 2.0 * b**2
        + c**2
        + 2.0 * a * b
        + 2.0 * a * c
    )


HOCK_SCHITTKOWSKI = (
    Textbook(
        "HS6",
        (-1.2, 1.0),
        0.0,
        lambda x: (1.0 - x[0]) ** 2,
        equal=lambda x: [10.0 * (x[1] - x[0] ** 2)],
    ),
    Textbook(
        "HS7",
        (2.0, 2.0),
        -np.sqrt(3.0),
        lambda x: np.log(1.0 + x[0] ** 2) - x[1],
        equal=lambda x: [(1.0 + x[0] ** 2) ** 2 + x[1] ** 2 - 4.0],
    ),
    Textbook(
        "HS21",
        (-1.0, -1.0),
        -99.96,
        lambda x: 0.01 * x[0] ** 2 + x[1] ** 2 - 100.0,
        linear=lambda x: [10.0 - 10.0 * x[0] + x[1]],
        lower=(2.0, -50.0),
        upper=50.0,
    ),
    Textbook(
        "HS26",
        (-2.6, 2.0, 2.0),
        0.0,
        lambda x: (x[0] - x[1]) ** 2 + (x[1] - x[2]) ** 4,
        equal=lambda x: [(1.0 + x[1] ** 2) * x[0] + x[2] ** 4 - 3.0],
    ),
    Textbook(
        "HS35",
        (0.5, 0.5, 0.5),
        1.0 / 9.0,
        _hs35_objective,
        linear=lambda x: [x[0] + x[1] + 2.0 * x[2] - 3.0],
        lower=0.0,
    ),
    Textbook(
        "HS39",
        (2.0, 2.0, 2.0, 2.0),
        -1.0,
        lambda x: -x[0],
        equal=lambda x: [x[1] - x[0] ** 3 - x[2] ** 2, x[0] ** 2 - x[1] - x[3] ** 2],
    ),
    Textbook(
        "HS43",
        (0.0, 0.0, 0.0, 0.0),
        -44.0,
        lambda x: (
            x[0] ** 2
            + x[1] ** 2
            + 2.0 * x[2] ** 2
            + x[3] ** 2
            - 5.0 * (x[0] + x[1])
            - 21.0 * x[2]
            + 7.0 * x[3]
        ),
        curved=_hs43_rows,
    ),
    Textbook(
        "HS71",
        (1.0, 5.0, 5.0, 1.0),
        17.0140173,
        lambda x: x[0] * x[3] * (x[0] + x[1] + x[2]) + x[2],
        equal=lambda x: [np.sum(x**2) - 40.0],
        curved=lambda x: [25.0 - np.prod(x)],
        lower=1.0,
        upper=5.0,
    ),
    Textbook(
        "HS76",
        (0.5, 0.5, 0.5, 0.5),
        -4.681818182,
        _hs76_objective,
        linear=lambda x: [
            x[0] + 2.0 * x[1] + x[2] + x[3] - 5.0,
            3.0 * x[0] + x[1] + 2.0 * x[2] - x[3] - 4.0,
            1.5 - x[1] - 4.0 * x[2],
        ],
        lower=0.0,
    ),
    Textbook(
        "HS100",
        (1.0, 2.0, 0.0, 4.0, 0.0, 1.0, 1.0),
        680.6300573,
        _hs100_objective,
        curved=_hs100_rows,
    ),
    Textbook(
        "HS104",
        (6.0, 3.0, 0.4, 0.2, 6.0, 6.0, 1.0, 0.5),
        3.9511634396,
        _hs104_objective,
        curved=_hs104_rows,
        lower=0.1,
        upper=10.0,
    ),
)

# Nocedal & Wright 2006, example 15.4. From a point of the circle the full step brings x much closer
# to the minimum (1, 0), but raises objective and violation, so that every merit function refuses
# it.
MARATOS = Textbook(
    "Maratos",
    (np.cos(0.8), np.sin(0.8)),
    -1.0,
    lambda x: 2.0 * (x[0] ** 2 + x[1] ** 2 - 1.0) - x[0],
    equal=lambda x: [x[0] ** 2 + x[1] ** 2 - 1.0],
)


def named(name: str) -> Textbook:
    """The book's problem of this name."""
    return next(problem for problem in HOCK_SCHITTKOWSKI if problem.name == name)

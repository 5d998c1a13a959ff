"""Shortest steps find a feasible point where one is near, and give up quickly where none is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.sqp.chain import BULGE, Chain
from tests.sqp.problems import Textbook
from zmp_sqp.sqp.backends import make_backend
from zmp_sqp.sqp.least_distance import STEPS, nearest_feasible

BACKENDS = ("auto", "proxqp", "piqp", "qpsolvers:clarabel", "qpsolvers:daqp")

# The last variable is the objective. The shortest way from (2, 0.5) into the disc leads along the
# ray through its centre to distance 1.
DISC = Textbook(
    "disc",
    (2.0, 0.5, 7.0),
    7.0,
    lambda x: x[2],
    curved=lambda x: [x[0] ** 2 + x[1] ** 2 - 1.0],
    linear=lambda x: [1.0 - x[2]],
)
# x >= 3 and x <= 1, in a bent coordinate.
TORN = Textbook(
    "torn",
    (2.0, 0.0, 7.0),
    np.inf,
    lambda x: x[2],
    curved=lambda x: [3.0 - x[0] + x[1] ** 2, x[0] - 1.0],
    linear=lambda x: [1.0 - x[2]],
)


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_nearest_feasible_point_keeps_the_objective(backend: str) -> None:
    found = nearest_feasible(DISC, DISC.x0, make_backend(backend))
    assert found.feasible
    assert found.at.violation <= 2e-7
    assert found.point[2] == 7.0
    expected = np.array([2.0, 0.5]) / np.hypot(2.0, 0.5)
    # each step is the shortest onto a tangent, so that their sum is nearly the shortest
    assert np.abs(found.point[:2] - expected).max() <= 0.05
    assert 1 <= found.steps <= STEPS


@pytest.mark.parametrize("backend", BACKENDS)
def test_constraints_without_a_common_point_are_given_up_at_once(backend: str) -> None:
    found = nearest_feasible(TORN, TORN.x0, make_backend(backend))
    assert not found.feasible
    assert found.steps <= 2


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_feasible_start_costs_no_step(backend: str) -> None:
    inside = np.array([0.3, 0.2, 7.0])
    found = nearest_feasible(DISC, inside, make_backend(backend))
    assert found.feasible
    assert found.steps == 0
    np.testing.assert_array_equal(found.point, inside)


def test_a_linear_program_with_equalities_is_entered_in_one_step() -> None:
    chain = Chain()
    found = nearest_feasible(chain, chain.start(0), make_backend("piqp"))
    assert found.feasible
    assert np.abs(found.at.equalities).max() <= 2e-7
    # the nonlinear ceiling may need a step or two more
    assert found.steps <= 4
    assert 0 < found.rows < chain.inequalities


def test_what_rows_exceed_between_their_places_counts() -> None:
    chain = replace(Chain(), bulges=True)
    found = nearest_feasible(chain, chain.start(0), make_backend("piqp"))
    assert found.feasible
    assert found.excess is not None
    assert found.excess.min() >= BULGE
    raw = chain.evaluate(found.point).inequalities[: chain.nonlinear]
    assert raw.max() <= -BULGE + 2e-7


def test_a_start_that_cannot_be_evaluated_is_no_success() -> None:
    nowhere = np.array([np.nan, 0.0, 7.0])
    assert not nearest_feasible(DISC, nowhere, make_backend("piqp")).feasible

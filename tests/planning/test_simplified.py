"""The simplified model, Song & Sharf 2020, (7)-(11), (20): mapping, derivatives, refusals."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.paper import PAPER_GOAL, PAPER_START, paper_scene
from tests.checks import central_differences
from tests.planning.conftest import LEANING, TEST_2, UPRIGHT, lumped, pose
from zmp_sqp.planning import simplified_coordinates
from zmp_sqp.planning.constraints.protocol import ConstraintRows, StageSample
from zmp_sqp.planning.program.formulation import bound_constraints
from zmp_sqp.planning.program.model import ArmModel
from zmp_sqp.planning.program.rows import StageRows

EXACT = 1e-9  # [rad, m, per second] closed forms, limits and boundary conditions
PRINTED = 1e-5  # [m] constants known to six digits
DERIVATIVE = 1e-6  # relative: central differences with a step of 1e-6


# --- the mapping (7)-(11) -----------------------------------------------------------------------


def test_the_papers_start_is_of_the_form() -> None:
    np.testing.assert_allclose(pose(0.0, -np.pi / 6), PAPER_START, atol=EXACT)


def test_the_lumped_mass_is_that_of_table_1() -> None:
    r"""Delta = (m2 l2/2 + m3 (l2 + l3/2) + 2 m4 l2 + 2 m5 l2) / sum m_i, the tree in m5."""
    m1, m2, m3, m4, m5, length, l4 = 5000.0, 2000.0, 1000.0, 50.0, 2600.0 + 4000.0, 3.27, 0.458
    total = m1 + m2 + m3 + m4 + m5
    delta = m2 * length / 2 + m3 * length + m3 * length / 2 + 2 * m4 * length + 2 * m5 * length
    found = lumped(UPRIGHT)
    assert found.mass == pytest.approx(total)
    np.testing.assert_allclose(
        [found.B, found.A], [delta / total, (m4 / 2 + m5) * l4 / total], atol=EXACT
    )
    np.testing.assert_allclose([found.B, found.A], [3.52669, 0.207116], atol=PRINTED)


@pytest.mark.parametrize("attitude", [UPRIGHT, LEANING])
def test_distance_is_where_the_slewing_mass_stands(attitude: float) -> None:
    """Eq. (9) against the centre of mass of all that slews, from static ZMPs."""
    machine, found = paper_scene().load(), lumped(attitude)
    booms = np.linspace(-1.3, -0.2, 7)
    q = np.array([pose(0.0, boom, attitude=attitude) for boom in booms])
    # the undercarriage stands on the axis
    at_rest = zs.zmp(machine, q, 0.0 * q, 0.0 * q, zs.Slope())[:, 0]
    np.testing.assert_allclose(
        found.distance(booms), at_rest * machine.mass / found.mass, atol=EXACT
    )


@pytest.mark.parametrize("attitude", [UPRIGHT, LEANING])
def test_boom_angle_and_distance_are_inverse_to_each_other(attitude: float) -> None:
    """Eq. (10)."""
    found, booms = lumped(attitude), np.linspace(-1.4, 0.6, 41)
    np.testing.assert_allclose(found.boom(found.distance(booms)), booms, atol=EXACT)


def test_derivatives_of_the_distance_are_those_of_differences() -> None:
    found, booms, step = lumped(LEANING), np.linspace(-1.4, 0.6, 21), 1e-6
    functions = (found.distance, *(lambda boom, i=i: found.derivatives(boom)[i] for i in range(2)))
    for function, derivative in zip(functions, found.derivatives(booms), strict=True):
        differences = (function(booms + step) - function(booms - step)) / (2.0 * step)
        np.testing.assert_allclose(derivative, differences, atol=DERIVATIVE * found.B)


def test_rate_and_acceleration_of_the_distance_are_those_of_differences_in_time() -> None:
    """Eq. (11), the other way round: a boom that swings as q2(t) = -0.6 + 0.3 sin(1.7 t)."""
    found, step = lumped(LEANING), 1e-4
    t = np.linspace(0.0, 4.0, 33)

    def boom(time: np.ndarray) -> np.ndarray:
        return -0.6 + 0.3 * np.sin(1.7 * time)

    d, rate, acceleration = found.motion(boom(t), 0.51 * np.cos(1.7 * t), -0.867 * np.sin(1.7 * t))
    behind, ahead = (found.distance(boom(t + sign * step)) for sign in (-1.0, 1.0))
    np.testing.assert_allclose(rate, (ahead - behind) / (2.0 * step), atol=1e-7)
    np.testing.assert_allclose(acceleration, (ahead - 2.0 * d + behind) / step**2, atol=1e-6)


# --- what the planner sees ----------------------------------------------------------------------


def stage_model() -> ArmModel:
    machine = TEST_2.load()
    coordinates = simplified_coordinates(machine, PAPER_START)
    return ArmModel(machine, TEST_2.ground.gravity(), coordinates)


def distance_rows(model: ArmModel) -> ConstraintRows:
    return zs.DistanceLimits(0.7, 0.9).rows(model.machine, model.coordinates)


def states(count: int = 6) -> np.ndarray:
    """(y, w, alpha, S) drawn at random, shape (count, 7)."""
    rng = np.random.default_rng(3)
    return np.column_stack(
        [rng.uniform([-2, -1.2, -2, -2, -6, -6, 5], [2, -0.2, 2, 2, 6, 6, 25], (count, 7))]
    )


def apart(x: np.ndarray) -> tuple[Any, ...]:
    return x[None, :2], x[None, 2:4], x[None, 4:6], float(x[6])


def test_coordinates_drive_the_joints_as_eq_7_says() -> None:
    coordinates = simplified_coordinates(paper_scene().load(), PAPER_START)
    y = np.array([0.7, -0.9])
    np.testing.assert_allclose(coordinates.joints(y), pose(*y), atol=EXACT)
    np.testing.assert_allclose(coordinates.coordinates_of(pose(*y)), y, atol=EXACT)
    np.testing.assert_allclose(
        central_differences(coordinates.joints, y), coordinates.G, atol=DERIVATIVE
    )


def test_wrench_derivatives_are_those_of_differences() -> None:
    model = stage_model()
    for x in states():
        wrench, slopes = model.effort_derivatives(*apart(x))
        np.testing.assert_allclose(wrench, model.efforts(*apart(x)), rtol=1e-12)
        differences = central_differences(lambda point: model.efforts(*apart(point))[0], x)
        np.testing.assert_allclose(
            slopes[0], differences, atol=DERIVATIVE * np.abs(differences).max()
        )


def test_rows_of_the_distance_bounds_have_the_jacobian_of_differences() -> None:
    model = stage_model()
    bounded = distance_rows(model)
    for x in states():
        rows, jacobian = bounded.linearize(StageSample(model, *apart(x)))
        assert (rows.shape, jacobian.shape) == ((1, 4), (1, 4, 7))
        differences = central_differences(
            lambda point: bounded.evaluate(StageSample(model, *apart(point)))[0], x
        )
        np.testing.assert_allclose(
            jacobian[0], differences, atol=DERIVATIVE * np.abs(differences).max()
        )


def test_rows_of_the_distance_bounds_have_the_curvature_of_differences() -> None:
    model, rng = stage_model(), np.random.default_rng(4)
    bounded = distance_rows(model)
    for x in states():
        weights = rng.normal(0.0, 1.0, 4)
        found = bounded.curvature(StageSample(model, *apart(x)), weights[None])[0]
        differences = central_differences(
            lambda p, w=weights: w @ bounded.linearize(StageSample(model, *apart(p)))[1][0], x
        )
        np.testing.assert_allclose(
            found, differences, atol=DERIVATIVE * max(1.0, np.abs(differences).max())
        )


def test_an_uncertain_payload_does_not_repeat_the_rows_of_the_distance() -> None:
    problem = zs.Problem(
        TEST_2.load(),
        PAPER_START,
        PAPER_GOAL,
        ground=TEST_2.ground,
        model="simplified",
        distance_limits=zs.DistanceLimits(0.7, 0.9),
        payload_uncertainty=0.05,
    )
    bound = bound_constraints(problem)
    assert len(bound.corners) == 2
    assert [name for name, _ in bound.common] == ["distance_limits"]
    assert StageRows(bound, 3.0).count == 2 * 5 + 4


# --- refusals -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["slider", "slewing_crane"])
def test_a_machine_without_such_an_arm_is_refused(name: str) -> None:
    machine = zs.load_machine(name)
    with pytest.raises(zs.ProblemError, match="slew, boom, stick and levelling joint"):
        zs.Problem(machine, np.zeros(machine.size), np.zeros(machine.size), model="simplified")


@pytest.mark.parametrize(
    ("stick", "tilt", "words"),
    [
        ((0.0, 0.0, 3.27), (0.0, 0.0, 2.9), "equal length"),
        ((0.5, 0.0, 3.27), (0.0, 0.0, 3.27), "point straight up"),
    ],
)
def test_a_chain_that_has_not_the_form_is_refused(stick: tuple, tilt: tuple, words: str) -> None:
    machine = paper_scene().load()
    model = machine.model.copy()
    for name, place in (("stick", stick), ("tilt", tilt)):
        model.jointPlacements[model.getJointId(name)].translation = np.array(place)
    with pytest.raises(zs.ProblemError, match=words):
        zs.Problem(replace(machine, model=model), PAPER_START, PAPER_GOAL, model="simplified")


def test_a_start_that_eq_7_cannot_reach_is_refused() -> None:
    start = PAPER_START.copy()
    start[1] += 0.01
    with pytest.raises(zs.ProblemError, match=r"'stick' = -pi - 2 'boom'.*start"):
        paper_scene().problem(start, PAPER_GOAL, model="simplified")


@pytest.mark.parametrize(("index", "joint"), [(1, "boom"), (3, "tilt"), (4, "head")])
def test_a_goal_that_eq_7_cannot_reach_is_refused_with_the_joint(index: int, joint: str) -> None:
    goal = PAPER_GOAL.copy()
    goal[index] += 0.02
    with pytest.raises(zs.ProblemError, match=f"cannot reach the goal: its joint '{joint}'"):
        paper_scene().problem(PAPER_START, goal, model="simplified")


def test_a_start_velocity_that_eq_7_cannot_have_is_refused() -> None:
    with pytest.raises(zs.ProblemError, match="start velocity"):
        paper_scene().problem(
            PAPER_START, PAPER_GOAL, start_velocity=[0.0, 0.1, 0.0, 0.0, 0.0], model="simplified"
        )


def test_distance_limits_belong_to_the_simplified_model() -> None:
    with pytest.raises(zs.ProblemError, match="simplified"):
        paper_scene().problem(PAPER_START, PAPER_GOAL, distance_limits=zs.DistanceLimits(1.0, 1.0))

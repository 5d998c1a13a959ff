"""The analytic slew: closed forms, derivatives by differences, the complete wrench, and the SQP."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

import zmp_sqp as zs
from benchmarks.problems.paper import PAPER_GOAL, PAPER_START, paper_scene
from benchmarks.problems.scene import GRAVITY
from tests.problems import slew, slew_time
from zmp_sqp.mechanics.wrench import ground_reaction
from zmp_sqp.mechanics.zero_moment_point import zmp_of_wrench
from zmp_sqp.planning.closed_forms.slew import analytic_slew, analytic_slew_duration
from zmp_sqp.planning.closed_forms.slew_circle import SlewInsight, slew_insight
from zmp_sqp.planning.proof.limits_in_time import limit_excess

PRINTED = 5e-6  # [s] half of the last digit of the closed forms in paper.md
ROUNDING = 1e-9
SAME_BY_QUADRATURE = 1e-8  # of the tests' own quadrature, which cuts 1e-9 off its singular end
OPTIMUM = 2e-3  # share by which SQP and quadrature may differ: grid, and polygon for circle
LEVEL = zs.Slope()
CRANE = SlewInsight(mass=1000.0, distance=2.0, height=3.0, total_mass=2000.0, mean_height=1.5)


def crane(*, radius: float, limited: bool = False) -> zs.Machine:
    return slew(radius=radius, limited=limited).problem.machine


def radii(machine: zs.Machine, trajectory: zs.Trajectory) -> np.ndarray:
    """Distances of the ZMP from the root origin, between nodes too, from the full wrench."""
    _, q, v, a = trajectory.within(np.linspace(0.0, 1.0, 33))
    return np.linalg.norm(zs.zmp(machine, q, v, a, LEVEL), axis=1)


@pytest.mark.parametrize(
    ("radius", "limited", "duration"),
    [(1.3, False, 3.58273), (1.1, False, 5.92736), (1.3, True, 4.5), (1.1, True, 5.92736)],
)
def test_the_closed_forms_are_met(radius, limited, duration):
    machine = crane(radius=radius, limited=limited)
    assert analytic_slew_duration(machine, [0.0], [np.pi], radius=radius) == pytest.approx(
        duration, abs=PRINTED
    )
    trajectory = analytic_slew(machine, [0.0], [np.pi], radius=radius)
    assert trajectory.duration == pytest.approx(duration, rel=1e-3)
    assert trajectory.intervals == 200


@pytest.mark.parametrize("angle", [0.01, 0.3, 0.6, 0.7, 0.75, 1.5, 6.0])
@pytest.mark.parametrize("acceleration", [0.5, 1.9, 100.0])
@pytest.mark.parametrize("velocity", [0.4, 100.0])
def test_short_and_long_slews_with_any_limit_agree_with_a_second_quadrature(
    angle, acceleration, velocity
):
    machine = crane(radius=1.3).with_limits(acceleration=acceleration, velocity=velocity)
    exact = slew_time(1.3, angle, max_velocity=velocity, max_acceleration=acceleration)
    assert analytic_slew_duration(machine, [0.0], [angle], radius=1.3) == pytest.approx(
        exact, abs=SAME_BY_QUADRATURE
    )
    trajectory = analytic_slew(machine, [0.0], [-angle], radius=1.3)
    assert trajectory.duration == pytest.approx(exact, rel=1e-3)
    assert trajectory.duration > exact - SAME_BY_QUADRATURE
    assert radii(machine, trajectory).max() <= 1.3 + ROUNDING
    assert limit_excess(machine, trajectory)[0] <= ROUNDING
    np.testing.assert_allclose(trajectory.positions[-1], [-angle], atol=ROUNDING)
    np.testing.assert_allclose(trajectory.velocities[[0, -1]], 0.0, atol=ROUNDING)


def test_the_top_rate_is_reached_in_finite_time():
    """The integrand is infinite there, the integral is not: a quadrature in w itself."""
    top = CRANE.top_rate(1.3)
    ramp = quad(lambda w: 1.0 / CRANE.acceleration_bound(w, 1.3), 0.0, top, limit=200)[0]
    turned = quad(lambda w: w / CRANE.acceleration_bound(w, 1.3), 0.0, top, limit=200)[0]
    duration = analytic_slew_duration(crane(radius=1.3), [0.0], [2.0], radius=1.3)
    # quad at a singular end
    assert duration == pytest.approx(2.0 * ramp + (2.0 - 2.0 * turned) / top, abs=1e-6)


@pytest.mark.parametrize("intervals", [8, 13, 50, 51, 400])
def test_any_number_of_intervals_keeps_the_circle_and_more_are_faster(intervals):
    machine = crane(radius=1.1)
    trajectory = analytic_slew(machine, [0.0], [np.pi], radius=1.1, intervals=intervals)
    assert trajectory.intervals == intervals
    assert radii(machine, trajectory).max() <= 1.1 + ROUNDING
    finer = analytic_slew(machine, [0.0], [np.pi], radius=1.1, intervals=2 * intervals)
    exact = analytic_slew_duration(machine, [0.0], [np.pi], radius=1.1)
    assert exact < finer.duration < trajectory.duration
    if intervals >= 50:
        assert trajectory.duration < exact * (1.0 + 1e-3)


@pytest.mark.parametrize(
    ("radius", "limited"),
    [
        (1.3, False),
        (1.3, True),
        pytest.param(1.1, False, marks=pytest.mark.slow),
        pytest.param(1.1, True, marks=pytest.mark.slow),
    ],
)
def test_the_sqp_agrees_on_the_same_problem(radius, limited):
    """On an inscribed 200-gon the optimum lies between those of its two circles."""
    problem = slew(radius=radius, limited=limited, intervals=100).problem
    plan = zs.plan(problem, qp_solver="piqp")  # made for so many rows
    on_circle = analytic_slew_duration(problem.machine, [0.0], [np.pi], radius=radius)
    # the largest circle in the polygon
    inside = analytic_slew_duration(problem.machine, [0.0], [np.pi])
    assert plan.success
    assert on_circle * (1.0 - ROUNDING) <= plan.duration
    assert plan.duration == pytest.approx(on_circle, rel=OPTIMUM)
    assert plan.duration == pytest.approx(inside, rel=OPTIMUM)


def test_on_the_crane_s_own_polygon_the_sqp_lies_between_inscribed_and_circumscribed_circle():
    """A 32-gon is 0.5 % smaller than its circle; with rho - 1 = 0.1, T differs by 2.6 %."""
    machine = zs.load_machine("slewing_crane")
    plan = zs.plan(zs.Problem(machine, [0.0], [np.pi], intervals=100), qp_solver="piqp")
    outside = analytic_slew_duration(machine, [0.0], [np.pi], radius=1.1)
    assert (
        outside < plan.duration < analytic_slew_duration(machine, [0.0], [np.pi]) * (1.0 + OPTIMUM)
    )


@pytest.mark.parametrize("point_masses", [True, False])
def test_the_circle_is_that_of_the_complete_wrench(point_masses):
    """With product of inertia for a height, many masses have the circle of one exactly."""
    machine = paper_scene(point_masses=point_masses).load()
    pose = np.array(PAPER_START)
    insight = slew_insight(machine, pose)
    rng = np.random.default_rng(1)
    w, alpha = rng.uniform(-1.0, 1.0, (2, 50))
    q, v, a = np.tile(pose, (50, 1)), np.zeros((50, 5)), np.zeros((50, 5))
    q[:, 0], v[:, 0], a[:, 0] = rng.uniform(-3.0, 3.0, 50), w, alpha
    found = np.linalg.norm(zs.zmp(machine, q, v, a, LEVEL) - insight.centre(), axis=1)
    np.testing.assert_allclose(found, insight.radius(w, alpha), atol=ROUNDING)
    assert (insight.mass, insight.total_mass) == pytest.approx((14650.0, 27650.0))


def test_the_crane_is_one_mass():
    found = slew_insight(crane(radius=1.1), [0.7])
    for name in ("mass", "distance", "height", "total_mass", "mean_height", "axis"):
        assert getattr(found, name) == pytest.approx(getattr(CRANE, name))
    assert found.reserve(1.3) == pytest.approx(1.3)


def test_the_radius_changes_at_the_rate_of_equation_18():
    """Radius of the ZMP against differences; it grows exactly while the slew speeds up."""
    step = 1e-5
    for w, alpha, jerk in np.random.default_rng(2).uniform(-2.0, 2.0, (40, 3)):
        squares = [
            CRANE.radius(w + alpha * t + 0.5 * jerk * t**2, alpha + jerk * t) ** 2
            for t in (-step, step)
        ]
        difference = (squares[1] - squares[0]) / (2.0 * step)
        assert CRANE.squared_radius_rate(w, alpha, jerk) == pytest.approx(
            difference, rel=1e-7, abs=1e-7
        )
        assert np.sign(CRANE.squared_radius_rate(w, alpha)) == np.sign(w * alpha)


def test_the_centre_moves_against_the_base_s_acceleration():
    """Eq. (17) against the wrench with an accelerating root, which counts the mass once."""
    machine = paper_scene(point_masses=False).load()
    pose = np.array([PAPER_START])
    insight = slew_insight(machine, pose[0])
    push = 0.8  # [m/s^2]
    root = np.array([push, 0.0, GRAVITY, 0.0, 0.0, 0.0])
    still = np.zeros_like(pose)
    wrench = ground_reaction(machine, pose, still, still, root_acceleration=root)
    assert machine.support is not None
    moved = zmp_of_wrench(wrench, machine.support.height)
    shift = moved - zs.zmp(machine, pose, still, still, LEVEL)
    np.testing.assert_allclose(shift[0], insight.centre(push) - insight.centre(), atol=ROUNDING)
    assert insight.centre_derivative == pytest.approx(
        (insight.centre(1.0) - insight.centre(0.0))[0]
    )
    assert insight.centre(np.array([0.0, 1.0])).shape == (2, 2)


def test_at_its_bound_the_acceleration_puts_the_zmp_on_the_circle():
    w = np.linspace(0.0, CRANE.top_rate(1.3), 20)
    np.testing.assert_allclose(
        CRANE.radius(w, CRANE.acceleration_bound(w, 1.3)), 1.3, atol=ROUNDING
    )
    assert CRANE.acceleration_bound(2.0 * CRANE.top_rate(1.3), 1.3) == 0.0


@pytest.mark.parametrize("head", [-np.pi / 2, 0.7])
def test_the_paper_s_machine_slews_inside_its_inscribed_circle(head):
    """With the head turned by 0.7 rad its bodies are skew: the circle is drawn in by a little."""
    machine = paper_scene(point_masses=False).load().with_limits(velocity=10.0, acceleration=50.0)
    start, goal = np.array(PAPER_START), np.array(PAPER_GOAL)
    start[4] = goal[4] = head
    trajectory = analytic_slew(machine, start, goal)
    assert radii(machine, trajectory).max() <= 1.615 + ROUNDING
    exact = analytic_slew_duration(machine, start, goal)
    assert exact < trajectory.duration < exact * (1.0 + 1e-3)
    np.testing.assert_allclose(trajectory.positions[:, 1:], np.tile(start[1:], (201, 1)))


def test_no_angle_takes_no_time():
    machine = crane(radius=1.1)
    assert analytic_slew(machine, [0.3], [0.3]).duration == 0.0
    assert analytic_slew_duration(machine, [0.3], [0.3]) == 0.0


def test_what_cannot_be_slewed_is_refused():
    machine = crane(radius=1.1)
    with pytest.raises(zs.ProblemError, match=r"tips over at rest: its ZMP stands 1\.000 m"):
        analytic_slew(machine, [0.0], [1.0], radius=1.0)
    with pytest.raises(zs.ProblemError, match="radius must be positive"):
        analytic_slew(machine, [0.0], [1.0], radius=-1.0)
    with pytest.raises(zs.ProblemError, match="at least 8, not 5"):
        analytic_slew(machine, [0.0], [1.0], intervals=5)
    with pytest.raises(zs.ProblemError, match="goal of joint 'slew' is 7, outside its limits"):
        analytic_slew(machine, [0.0], [7.0])
    with pytest.raises(zs.ProblemError, match="alone, but 'boom' moves by"):
        analytic_slew(
            paper_scene(point_masses=True).load(),
            PAPER_START,
            np.add(PAPER_GOAL, [0, 0.1, 0, 0, 0]),
        )


def test_what_is_no_slew_is_refused():
    with pytest.raises(
        zs.MachineError, match="'slider', must turn on the root about a vertical axis"
    ):
        analytic_slew(zs.load_machine("slider"), [0.0], [0.1])
    off = zs.SupportPolygon([[-2.0, -2.0], [2.5, -2.0], [2.5, 2.0], [-2.0, 2.0]])
    with pytest.raises(zs.MachineError, match="misses the centre of the support polygon"):
        analytic_slew(crane(radius=1.1).with_support(off), [0.0], [0.1])
    assert (
        analytic_slew(crane(radius=1.1).with_support(off), [0.0], [0.1], radius=1.1).duration > 0.0
    )

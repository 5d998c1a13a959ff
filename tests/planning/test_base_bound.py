"""The base's acceleration bound, eq. (21), and its motion, against the complete wrench."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.checks import Oracle
from benchmarks.problems.paper import PAPER_GOAL, PAPER_START, paper_scene
from benchmarks.problems.scene import FOOTPRINT, GRAVITY, Scene, Tree
from zmp_sqp.motion.double_integrator import minimum_time
from zmp_sqp.planning.closed_forms.base_bound import (
    base_acceleration_bound,
    moving_base_zmp,
    plan_base,
)
from zmp_sqp.planning.closed_forms.base_motion import (
    BaseMotion,
    asymmetric_profile,
    driven_trajectory,
)

SLOPE = np.deg2rad(15.0)
PAPER_DURATION = 4.5  # [s] test 2 of the paper
TENTH_OF_A_PERCENT = 1e-3
SAMPLED = 1e-7  # [m] arm plans are checked on a coarser grid
ROUNDING = 1e-9
LIMITS = {"max_speed": 10.0, "max_acceleration": 2.0}  # Section V-B
WIDE = zs.SupportPolygon([[-4.0, -4.0], [4.0, -4.0], [4.0, 4.0], [-4.0, 4.0]])
BOOM_UP, BOOM_DOWN = [0.0, 0.3, -2.0, 0.2, -1.57], [0.0, -0.5, -2.0, 0.2, -1.57]
LEVEL = zs.Slope()


def paper_2(*, point_masses: bool) -> Scene:
    """15 degrees to the left, 15 degrees nose down."""
    return Scene(
        "feller_buncher",
        FOOTPRINT,
        Tree(4000.0),
        roll=-SLOPE,
        pitch=SLOPE,
        point_masses=point_masses,
    )


@pytest.fixture(
    scope="module",
    params=[(True, "full"), (True, "simplified"), (False, "full")],
    ids=["points", "points, simplified", "rigid"],
)
def second_test(request) -> tuple[Scene, zs.Machine, zs.Plan]:
    point_masses, model = request.param
    scene = paper_2(point_masses=point_masses)
    # of the many fastest arm motions of rigid bodies, one that leaves the base its share
    margin = 0.0 if point_masses else 0.1
    problem = scene.problem(PAPER_START, PAPER_GOAL, model=model, margin=margin)
    return scene, problem.machine, zs.plan(problem)


def independent_excess(
    scene: Scene, arm: zs.Trajectory, base: BaseMotion, *, samples: int = 4001
) -> float:
    """Largest distance of the ZMP of arm and base beyond an edge [m], by an own model."""
    oracle, gravity = Oracle(scene), None
    gravity = oracle.model.gravity.linear.copy()
    t = np.linspace(0.0, base.duration, samples)
    worst = -np.inf
    for one, (q, v, a) in zip(t, zip(*arm(np.minimum(t, arm.duration)), strict=True), strict=True):
        waits = one > arm.duration
        oracle.model.gravity.linear = gravity - np.array([base(one)[2], 0.0, 0.0])  # d'Alembert
        worst = max(worst, oracle.excess(q[None], v[None] * (not waits), a[None] * (not waits)))
    return worst


def test_test_2_of_the_paper_takes_4_5_seconds_with_the_zmp_inside(second_test):
    scene, machine, plan = second_test
    assert plan.duration == pytest.approx(PAPER_DURATION, rel=TENTH_OF_A_PERCENT)
    base = plan_base(machine, plan.trajectory, scene.ground, distance=-2.0, **LIMITS)
    # it ends with the arm
    assert base.duration == pytest.approx(PAPER_DURATION, rel=TENTH_OF_A_PERCENT)
    assert (base.factor, base.shrunk) == (1.0, False)  # eq. (21) holds as it stands
    assert base.margin >= -SAMPLED
    assert independent_excess(scene, plan.trajectory, base) <= SAMPLED
    assert base.positions[[0, -1]] == pytest.approx([0.0, -2.0], abs=ROUNDING)
    assert base.speeds[[0, -1]] == pytest.approx([0.0, 0.0], abs=ROUNDING)
    assert np.abs(base.speeds).max() <= 10.0
    assert np.abs(base.accelerations).max() <= 2.0
    assert base.lower <= base.accelerations.min() < 0.0 < base.accelerations.max() <= base.upper


def test_an_arm_motion_with_a_margin_grants_the_base_its_share():
    """Of the fastest arm motions of test 2, one keeps 0.3 m, which the base may use."""
    scene = paper_2(point_masses=True)
    problem = scene.problem(PAPER_START, PAPER_GOAL, margin=0.3)
    roomy = zs.plan(problem)
    assert roomy.duration == pytest.approx(PAPER_DURATION, rel=TENTH_OF_A_PERCENT)
    lower, upper = base_acceleration_bound(problem.machine, roomy.trajectory, scene.ground)
    smaller = base_acceleration_bound(problem.machine, roomy.trajectory, scene.ground, margin=0.1)
    assert lower < smaller[0] < 0.0 < smaller[1] < upper
    per_metre = (smaller[0] - lower) / 0.1  # -G [1/s^2]
    assert lower <= -0.3 * per_metre * (1.0 - SAMPLED)
    assert upper >= 0.3 * per_metre * (1.0 - SAMPLED)


def test_the_bound_is_exact_where_nothing_moves_but_the_base():
    """z'' = 0 and z constant: at either end of the bound the ZMP stands on an edge."""
    machine = paper_scene(point_masses=False).load()
    ground = zs.Slope(pitch=0.1)
    q = np.array([[0.4, *PAPER_START[1:]]] * 2)
    still = zs.Trajectory(machine.joint_names, [0.0, 1.0], q, 0.0 * q, 0.0 * q[:1])
    for push, edge in zip(
        base_acceleration_bound(machine, still, ground), (2.5, -2.5), strict=True
    ):
        base = zs.Trajectory(
            ("base",), [0.0, 1.0], [[0.0], [0.5 * push]], [[0.0], [push]], [[push]]
        )
        _, points = moving_base_zmp(machine, still, base, ground)
        np.testing.assert_allclose(points[:, 0], edge, atol=ROUNDING)


def test_the_slope_of_the_zmp_is_that_of_equation_21():
    """Against differences: -sum m z / sum m (z'' - g_z) of point masses that move."""
    scene = paper_2(point_masses=True)
    machine, oracle = scene.load(), Oracle(scene)
    arm = zs.phase_plane(machine, BOOM_UP, BOOM_DOWN)
    zmps = []
    for push in (0.0, 0.3):
        base = zs.Trajectory(
            ("base",),
            [0.0, arm.duration],
            [[0.0], [0.5 * push * arm.duration**2]],
            [[0.0], [push * arm.duration]],
            [[push]],
        )
        times, points = moving_base_zmp(machine, arm, base, scene.ground)
        zmps.append(points)
    q, v, a = arm(times)
    slopes = []
    for one in zip(q, v, a, strict=True):
        heights, lifts, masses = point_motions(oracle, *one)
        slopes.append(-(masses @ heights) / (masses @ (lifts - oracle.model.gravity.linear[2])))
    # second differences below
    np.testing.assert_allclose((zmps[1] - zmps[0])[:, 0] / 0.3, slopes, atol=1e-6)
    # sideways nothing changes
    np.testing.assert_allclose(zmps[1][:, 1], zmps[0][:, 1], atol=ROUNDING)


def point_motions(
    oracle: Oracle, q, v, a, *, step: float = 1e-4
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Heights [m], their accelerations by second differences, and masses of the oracle's points."""
    import pinocchio as pin

    heights = []
    for t in (-step, 0.0, step):
        full = np.concatenate([[0, 0, 0, 0, 0, 0, 1.0], q + t * v + 0.5 * t**2 * a])
        pin.forwardKinematics(oracle.model, oracle.data, full)
        heights.append(
            np.array([oracle.data.oMi[joint].act(lever)[2] for joint, _, lever in oracle.points])
        )
    lifts = (heights[2] - 2.0 * heights[1] + heights[0]) / step**2
    return heights[1], lifts, np.array([mass for _, mass, _ in oracle.points])


@pytest.mark.parametrize(
    ("arm", "distance"), [((BOOM_UP, BOOM_DOWN), 5.0), ((BOOM_DOWN, BOOM_UP), -5.0)]
)
def test_the_bound_shrinks_where_the_arm_s_vertical_acceleration_counts(arm, distance):
    """A boom that begins to fall lightens the ground; the unmodified (21) would tip it."""
    machine = paper_scene(point_masses=False).load().with_support(WIDE)
    trajectory = zs.phase_plane(machine, *arm)
    base = plan_base(
        machine, trajectory, LEVEL, distance=distance, max_speed=10.0, max_acceleration=50.0
    )
    assert base.shrunk
    assert 0.8 < base.factor < 0.95
    assert 0.0 <= base.margin < 1e-2  # no more than needed
    assert base.accelerations.max() == pytest.approx(base.factor * base.upper)
    assert base.accelerations.min() == pytest.approx(base.factor * base.lower)
    scene = Scene("feller_buncher", tuple(map(tuple, WIDE.vertices)), Tree(4000.0))
    assert independent_excess(scene, trajectory, base) <= SAMPLED
    naive = replace(base, trajectory=scaled(base.trajectory, base.factor))
    assert independent_excess(scene, trajectory, naive) > 0.05


def scaled(motion: zs.Trajectory, factor: float) -> zs.Trajectory:
    """The same way as fast as the whole bound allows: accelerations by 1 / factor."""
    pace = np.sqrt(factor)
    return zs.Trajectory(
        motion.joint_names,
        motion.times * pace,
        motion.positions,
        motion.velocities / pace,
        motion.accelerations / factor,
    )


def test_a_longer_way_makes_the_arm_wait_at_its_goal():
    machine = paper_scene(point_masses=True).load().with_support(WIDE)
    arm = zs.phase_plane(machine, PAPER_START, PAPER_GOAL)
    base = plan_base(machine, arm, LEVEL, distance=-30.0, max_speed=3.0, max_acceleration=0.5)
    assert base.duration == pytest.approx(30.0 / 3.0 + 3.0 / 0.5)
    assert base.duration > arm.duration
    times, points = moving_base_zmp(machine, arm, base, LEVEL)
    coasting = (times > 3.0 / 0.5) & (times < base.duration - 3.0 / 0.5)
    at_rest = zs.zmp(machine, PAPER_GOAL, np.zeros(5), np.zeros(5), LEVEL)
    np.testing.assert_allclose(
        points[coasting], np.tile(at_rest, (coasting.sum(), 1)), atol=ROUNDING
    )
    position, speed, acceleration = base(np.array([0.0, 8.0]))
    np.testing.assert_allclose(
        [position[1], speed[1], acceleration[1]], [-0.5 * 6.0 * 3.0 - 2.0 * 3.0, -3.0, 0.0]
    )


@pytest.mark.filterwarnings("ignore:.*support polygon reaches:zmp_sqp.errors.MachineWarning")
@pytest.mark.parametrize("distance", [0.5, -3.0, 12.0])
def test_without_a_zmp_to_mind_the_base_moves_bang_coast_bang(distance):
    big = zs.SupportPolygon([[-1e3, -1e3], [1e3, -1e3], [1e3, 1e3], [-1e3, 1e3]])
    machine = paper_scene(point_masses=True).load().with_support(big)
    arm = zs.phase_plane(machine, PAPER_START, PAPER_START)  # no motion, no time
    base = plan_base(machine, arm, LEVEL, distance=distance, max_speed=1.5, max_acceleration=0.7)
    fastest = minimum_time(distance, max_velocity=1.5, max_acceleration=0.7)
    assert base.duration == pytest.approx(fastest.duration)
    assert np.abs(base.speeds).max() == pytest.approx(abs(fastest.peak))


def test_no_way_to_go_leaves_the_base_standing():
    machine = paper_scene(point_masses=True).load().with_support(WIDE)
    arm = zs.phase_plane(machine, PAPER_START, PAPER_GOAL)
    base = plan_base(machine, arm, LEVEL, distance=0.0, **LIMITS)
    assert base.duration == arm.duration
    assert not base.positions.any()


def test_what_cannot_be_is_refused():
    machine = paper_scene(point_masses=True).load()
    steep = zs.Slope(roll=-np.deg2rad(20.0))
    blind = zs.phase_plane(machine, PAPER_START, PAPER_GOAL)
    with pytest.raises(
        zs.ProblemError, match="the arm's motion alone misses the margin of 0 m from the left edge"
    ):
        plan_base(machine, blind, steep, distance=-2.0, **LIMITS)
    wide = machine.with_support(WIDE)
    for name in LIMITS:
        with pytest.raises(zs.ProblemError, match=f"{name} must be positive"):
            plan_base(wide, blind, LEVEL, distance=-2.0, **{**LIMITS, name: 0.0})
    with pytest.raises(zs.ProblemError, match="margin must not be negative"):
        plan_base(wide, blind, LEVEL, distance=-2.0, **LIMITS, margin=-0.1)
    with pytest.raises(zs.ProblemError, match="distance must be finite"):
        plan_base(wide, blind, LEVEL, distance=np.nan, **LIMITS)
    with pytest.raises(
        zs.ProblemError, match="the trajectory's joints are base, the machine's slew"
    ):
        plan_base(
            wide,
            zs.Trajectory(("base",), [0, 1], [[0], [0]], [[0], [0]], [[0]]),
            LEVEL,
            distance=1.0,
            **LIMITS,
        )


def test_an_arm_on_the_front_edge_leaves_the_base_no_room():
    machine = paper_scene(point_masses=True).load()
    arm = zs.phase_plane(machine, PAPER_START, PAPER_START)
    front = float(zs.zmp(machine, PAPER_START, np.zeros(5), np.zeros(5), LEVEL)[0])
    short = zs.SupportPolygon([[-2.5, -1.6], [front, -1.6], [front, 1.6], [-2.5, 1.6]])
    with pytest.raises(
        zs.ProblemError,
        match="no base motion is safe beside this arm motion: its ZMP comes up to the front",
    ):
        plan_base(machine.with_support(short), arm, LEVEL, distance=1.0, **LIMITS)


def test_heights_count_from_the_support_plane():
    """The same machine on tracks 1 m below its root origin may accelerate less."""
    machine = paper_scene(point_masses=True).load()
    arm = zs.phase_plane(machine, PAPER_START, PAPER_START)
    low = machine.with_support(zs.SupportPolygon(WIDE.vertices, height=-1.0))
    bounds = [base_acceleration_bound(m, arm, LEVEL) for m in (machine.with_support(WIDE), low)]
    margins = 4.0 - float(zs.zmp(machine, PAPER_START, np.zeros(5), np.zeros(5), LEVEL)[0])
    heights = [-margins * GRAVITY / lower for lower, _ in bounds]
    assert heights[1] - heights[0] == pytest.approx(1.0)


@pytest.mark.parametrize("distance", [-2.0, 6.0])  # the base ends first, the arm waits
def test_arm_and_base_in_one_trajectory_are_the_same_motion(distance: float) -> None:
    machine, start = zs.load_machine("feller_buncher"), np.array([1.0, -2.0, 0.7])
    arm = zs.phase_plane(machine, BOOM_DOWN, [1.0, *BOOM_UP[1:]])
    base = asymmetric_profile(
        distance, forward=1.0, backward=2.0, max_speed=1.5, least_duration=0.0
    )
    whole = driven_trajectory(arm, base, start)
    assert whole.duration == max(arm.duration, base.duration)
    t = np.linspace(0.0, whole.duration, 301)[:-1]
    q, v, a = whole(t)
    pose, rates, pushes = whole.base(t)
    waits, (joints, joint_rates, joint_pushes) = t > arm.duration, arm(np.minimum(t, arm.duration))
    rests, (way, speed, push) = t > base.duration, base(np.minimum(t, base.duration))
    assert waits.any() != rests.any()
    np.testing.assert_allclose(q, joints, atol=ROUNDING)
    np.testing.assert_allclose(v[~waits], joint_rates[~waits], atol=ROUNDING)
    np.testing.assert_allclose(a[~waits], joint_pushes[~waits], atol=ROUNDING)
    np.testing.assert_allclose(pose, start + way * [np.cos(0.7), np.sin(0.7), 0.0], atol=ROUNDING)
    np.testing.assert_allclose(rates[~rests, :1], speed[~rests], atol=ROUNDING)
    np.testing.assert_allclose(pushes[~rests, :1], push[~rests], atol=ROUNDING)
    for still in (v[waits], a[waits], rates[rests], pushes[rests], rates[:, 1]):
        assert not still.any()


@pytest.mark.parametrize("roll", [-0.4, -0.6])
def test_an_arm_that_leaves_the_polygon_between_far_nodes_is_refused(roll: float) -> None:
    """Ten samples in each of three pieces of the motion saw +8 mm where the margin is -11."""
    machine, ground = paper_scene().load(), zs.Slope(roll=np.radians(roll))
    arm = zs.phase_plane(machine, PAPER_START, PAPER_GOAL)
    assert zs.certify(machine, arm, ground).sampled < -0.01
    with pytest.raises(zs.ProblemError, match="the arm's motion alone misses the margin"):
        plan_base(machine, arm, ground, distance=0.0, **LIMITS)
    _, points = moving_base_zmp(machine, arm, None, ground)
    assert machine.support is not None
    found = machine.support.signed_distance(points).min()
    assert found == pytest.approx(zs.certify(machine, arm, ground).sampled, abs=1e-4)

"""The second opinion in ball arithmetic: samples, closed forms, motions that it must refute."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from math import inf, nextafter
from pathlib import Path

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.random_motions import random_motion
from tests.mimics import coupled
from zmp_sqp.cli import main
from zmp_sqp.mechanics.ground import GRAVITY
from zmp_sqp.mechanics.wrench import WRENCH, efforts
from zmp_sqp.motion.unicycle_motion import UnicycleMotion
from zmp_sqp.planning.proof.certificate import certify_at
from zmp_sqp.rigorous import Verdict
from zmp_sqp.rigorous.balls import above, below, flint_module, least_of, working
from zmp_sqp.rigorous.base_path import displacement
from zmp_sqp.rigorous.motion_series import MotionSeries
from zmp_sqp.rigorous.spline_cells import SplineCells
from zmp_sqp.rigorous.terrain_root import TerrainRoot
from zmp_sqp.scenario import load_scenario

pytest.importorskip("flint", reason="needs python-flint (extra proof)")
SEEDS = range(6)  # one of every kind at least
DIGITS = 1e-9  # rounding of sampled margins and shares, relative above one


def opinion(seed: int, margin: float, *, torques: bool = False) -> zs.RigorousCheck:
    motion = random_motion(seed)
    return zs.check_rigorously(
        motion.machine,
        motion.trajectory,
        motion.ground,
        margin,
        constraints=motion.constraints if torques else (),
        corners=motion.corners,
    )


def sampled_margin(seed: int) -> float:
    """Least margin of Pinocchio's inverse dynamics at 400 times per interval, at all corners."""
    motion = random_motion(seed)
    t, *_ = motion.trajectory.within(np.linspace(0.0, 1.0, 400))
    least = inf
    for corner in motion.corners:
        points = zs.trajectory_zmp(corner.machine, motion.trajectory, t, corner.ground)
        least = min(least, float(corner.machine.support.signed_distance(points).min()))
    return least


def test_directed_rounding_encloses():
    with working(4) as flint:
        third = flint.arb(1) / 3
        assert below(third) < 1.0 / 3.0 < above(third)
        assert below(flint.arb(0.1)) == nextafter(0.1, -inf)
        assert below(flint.arb.nan()) == -inf
        assert above(flint.arb.nan()) == inf


def test_the_context_of_flint_is_left_as_it_was():
    flint = flint_module()
    before = flint.ctx.prec, flint.ctx.cap
    opinion(0, 0.0)
    assert (flint.ctx.prec, flint.ctx.cap) == before


def test_bounds_of_polynomials_are_below_and_near_their_least_values():
    rng = np.random.default_rng(0)
    for _ in range(50):
        c, radius = rng.normal(size=6), rng.uniform(0.01, 0.3)
        with working(8) as flint:
            rows = [[flint.arb(float(x)) for x in c]]
            bound = least_of(flint, rows, flint.arb(radius))[0]
        least = np.polynomial.Polynomial(c)(np.linspace(-radius, radius, 2001)).min()
        assert bound <= least
        assert least - bound <= 4.0 * radius**2 * np.abs(c).sum()


def test_a_base_that_drives_an_arc_arrives_where_the_circle_does():
    speed, rate, h = 2.0, 0.8, 3.0
    zeros = np.zeros((1, 2))
    yaw = np.array([0.3, 0.3 + rate * h])
    base = UnicycleMotion.from_start(
        np.array([0.0, h]),
        np.array([1.0, 2.0, 0.3]),
        np.tile([speed, rate], (2, 1)),
        yaw,
        (zeros, zeros),
    )
    at = np.zeros((2, 1))
    motion = zs.Trajectory(("slider",), base.times, at, at, at[:1], base=base)
    with working(20) as flint:
        x, y = displacement(flint, MotionSeries(flint, motion), 0, 1.0)
        exact = speed / rate * (np.sin(yaw[1]) - np.sin(yaw[0]))
        assert abs(float(x.mid()) - exact) < 1e-14
        assert float(x.rad()) < 1e-14
        assert abs(float(y.mid()) - speed / rate * (np.cos(yaw[0]) - np.cos(yaw[1]))) < 1e-14


def test_the_margin_of_a_sliding_mass_is_that_of_the_closed_form():
    """A mass m_1 at x on a base m_0 has its ZMP at (m_1 (x g - z x'')) / (m g)."""
    machine = zs.load_machine("slider")
    a, h = 0.5, 1.0
    motion = zs.Trajectory(
        machine.joint_names,
        np.array([0.0, h]),
        np.array([[0.0], [0.5 * a * h**2]]),
        np.array([[0.0], [a * h]]),
        np.array([[a]]),
    )
    found = zs.check_rigorously(machine, motion, zs.Slope())["tip_over"]
    payload = machine.model.inertias[2]
    z = machine.model.jointPlacements[2].translation[2] + payload.lever[2]
    x = np.array([0.0, 0.5 * a]) + payload.lever[0]
    zmp = (payload.mass * (x - z * a / GRAVITY)) / machine.mass
    front, rear = machine.support.vertices[:, 0].max(), machine.support.vertices[:, 0].min()
    sides = np.abs(machine.support.vertices[:, 1]).min()
    expected = min((front - zmp).min(), (zmp - rear).min(), sides)
    assert found.lower <= expected + 1e-12
    assert found.upper >= expected - 1e-12
    assert found.upper - found.lower <= 1e-6


@pytest.mark.parametrize("seed", SEEDS)
def test_the_least_margin_lies_where_samples_of_inverse_dynamics_have_it(seed: int):
    found = opinion(seed, -100.0)["tip_over"]
    sampled = sampled_margin(seed)
    digits = DIGITS * max(1.0, abs(sampled))
    assert found.lower <= sampled + digits
    assert found.upper <= sampled + 1e-6 + digits  # the enclosure is at most so wide
    if random_motion(seed).kind != "uncertain":  # between corners the margin may be less
        assert found.upper - found.lower <= 1.1e-6


@pytest.mark.parametrize("seed", SEEDS)
def test_the_certified_margin_is_confirmed_and_more_is_not(seed: int):
    motion = random_motion(seed)
    certified = certify_at(motion.corners, motion.trajectory, -100.0).margin
    assert opinion(seed, certified)["tip_over"].verdict is Verdict.CONFIRMED
    raised = opinion(seed, certified + 1e-3 + _spread_room(seed))["tip_over"]
    assert raised.verdict in (Verdict.REFUTED, Verdict.UNDECIDED)


def _spread_room(seed: int) -> float:
    """What the certificate's bound between payload corners may leave unused."""
    return 1e-2 if random_motion(seed).kind == "uncertain" else 0.0


@pytest.mark.parametrize("seed", SEEDS)
def test_a_margin_that_is_missed_by_a_micrometre_is_refuted_where_it_is_missed(seed: int):
    motion = random_motion(seed)
    sampled = sampled_margin(seed)
    found = opinion(seed, sampled + 1e-6)["tip_over"]
    assert found.verdict is Verdict.REFUTED
    assert found.upper < sampled + 1e-6
    k, since = motion.trajectory.locate(np.array([found.time]))
    at = motion.trajectory.times[k] + since
    machine = next(
        corner for corner in motion.corners if corner.text == found.corner or not found.corner
    ).machine
    assert abs(at[0] - found.time) < 1e-12
    assert machine.support is not None


@pytest.mark.parametrize("seed", [1, 3, 5, 9])
def test_torques_leave_the_room_that_samples_of_inverse_dynamics_have(seed: int):
    motion = random_motion(seed)
    assert motion.constraints
    least, limit = inf, motion.machine.limits.effort
    _, q, v, a = motion.trajectory.within(np.linspace(0.0, 1.0, 200))
    for corner in motion.corners:
        root = np.concatenate([-corner.ground.gravity(), np.zeros(3)])
        torque = efforts(corner.machine, q, v, a, root_acceleration=root)[:, WRENCH:]
        least = min(least, float((1.0 - np.abs(torque) / limit).min()))
    found = opinion(seed, -100.0, torques=True)["torque_limits"]
    assert found.lower <= least + DIGITS
    assert found.verdict is (Verdict.CONFIRMED if least > 0.0 else Verdict.REFUTED)
    # a share just below the largest one that is used
    for share, verdict in ((1e-4, Verdict.CONFIRMED), (-1e-6, Verdict.REFUTED)):
        if len(motion.corners) > 1:
            continue  # between corners there is a little less room than at them
        tight = zs.TorqueLimits(1.0 - least + share)
        again = zs.check_rigorously(
            motion.machine, motion.trajectory, motion.ground, -100.0, constraints=[tight]
        )
        assert again["torque_limits"].verdict is verdict


@pytest.mark.parametrize("name", ["gripper", "linkage"])
def test_mimic_joints_move_with_their_leaders(name: str):
    machine = coupled(name).machine
    rng = np.random.default_rng(7)
    h, n = 0.4, machine.size
    q, v, a = rng.uniform(-0.2, 0.2, (3, n))
    motion = zs.Trajectory(
        machine.joint_names,
        np.array([0.0, h]),
        np.stack([q, q + h * v + 0.5 * h**2 * a]),
        np.stack([v, v + h * a]),
        a[None],
    )
    ground = zs.Slope(0.05, -0.08)
    found = zs.check_rigorously(machine, motion, ground, -100.0)["tip_over"]
    t = np.linspace(0.0, h, 500)
    least = machine.support.signed_distance(zs.trajectory_zmp(machine, motion, t, ground)).min()
    assert found.lower - DIGITS <= least <= found.upper + 1e-6


def test_payloads_inside_the_box_keep_the_lower_bound():
    motion, rng = random_motion(11), np.random.default_rng(5)
    assert len(motion.corners) == 64
    bound = opinion(11, -100.0)["tip_over"].lower
    for _ in range(40):
        machine = motion.machine.with_payload_scaled(rng.uniform(0.9, 1.1 / 0.9))
        machine = machine.with_payload_moved(rng.uniform(-1.0, 1.0, 3) * [0.1, 0.0, 0.2])
        lean, toward = 0.02 * rng.uniform(), rng.uniform(-np.pi, np.pi)
        g = motion.ground.gravity()
        axis = np.cross(g, [np.cos(toward), np.sin(toward), 0.0])
        axis /= np.linalg.norm(axis)
        tilted = g * np.cos(lean) + np.cross(axis, g) * np.sin(lean)
        _, q, v, a = motion.trajectory.within(np.linspace(0.0, 1.0, 40))
        wrench = efforts(
            machine, q, v, a, root_acceleration=np.concatenate([-tilted, np.zeros(3)]), joints=False
        )
        rows = machine.support.wrench_rows()
        assert ((wrench @ rows.T) / -wrench[:, 2:3]).min() >= bound


def test_joint_limits_may_be_exceeded_by_rounding_alone():
    machine = zs.load_machine("feller_buncher")
    start = np.array([0.0, -0.8, -2.0, 0.7, 0.0])
    motion = zs.phase_plane(machine, start, start + np.array([1.0, 0.2, -0.3, 0.1, 0.4]))
    limits = machine.limits.velocity
    peak = np.abs(motion.velocities).max(axis=0)
    for excess, verdict in ((1e-11, Verdict.CONFIRMED), (1e-7, Verdict.REFUTED)):
        tight = machine.with_limits(velocity=np.minimum(limits, peak - excess))
        found = zs.check_rigorously(tight, motion, zs.Slope())["joint_limits"]
        assert found.verdict is verdict
        assert found.label.endswith("velocity")


def test_a_machine_that_lifts_off_has_no_margin():
    machine = zs.load_machine("feller_buncher")
    n, h = machine.size, 0.2
    a = np.zeros(n)
    a[1] = 60.0
    motion = zs.Trajectory(
        machine.joint_names,
        np.array([0.0, h]),
        np.stack([np.full(n, 0.8), np.full(n, 0.8) + 0.5 * h**2 * a]),
        np.stack([np.zeros(n), h * a]),
        a[None],
    )
    found = zs.check_rigorously(machine, motion, zs.Slope())
    assert found["contact"].verdict is Verdict.REFUTED
    assert found["tip_over"].verdict is Verdict.REFUTED
    assert found["tip_over"].upper == -inf
    assert found.refuted
    assert not found.confirmed


def test_a_jump_that_a_trajectory_may_not_have_is_found():
    motion = random_motion(0)
    moved = motion.trajectory.positions.copy()
    moved[1:] += 9e-7  # below what `Trajectory` refuses
    for shift, verdict in ((0.0, Verdict.CONFIRMED), (2e-7, Verdict.REFUTED)):
        trajectory = replace(motion.trajectory, positions=moved)
        trajectory.positions.setflags(write=True)
        trajectory.positions[1:] += shift
        found = zs.check_rigorously(motion.machine, trajectory, motion.ground, -100.0)
        assert found["continuity"].verdict is verdict


def test_a_drive_is_confirmed_with_its_bounds_start_and_goal():
    problem = load_scenario("retreat").problem
    plan = zs.plan(problem)
    x = plan.trajectory.base(np.linspace(0.0, plan.duration, 3001))[0][:, 0]
    for bounds, verdict in (
        ((x.min() - 1e-3, x.max() + 1e-3), Verdict.CONFIRMED),
        ((x.min() - 1e-3, x.max()), Verdict.CONFIRMED),  # by its tolerance of 1e-6 m
    ):
        base = replace(problem.base, x_bounds=bounds)
        found = zs.check_rigorously(
            problem.machine, plan.trajectory, problem.ground, plan.certificate.margin, base=base
        )
        assert found.confirmed
        bound = next(one for one in found.guarantees if one.label == "x_bounds")
        assert bound.verdict is verdict
    away = replace(problem.base, goal=problem.base.goal + np.array([0.0, 1e-4, 0.0]))
    found = zs.check_rigorously(problem.machine, plan.trajectory, problem.ground, 0.0, base=away)
    assert [one.label for one in found.guarantees if one.verdict is Verdict.REFUTED] == [
        "goal position"
    ]


def test_a_users_own_rows_are_not_looked_at():
    motion = random_motion(0)
    own = zs.PathRows("own", lambda machine, q, v, a: (-np.ones((len(q), 1)), np.zeros(0)))
    found = zs.check_rigorously(motion.machine, motion.trajectory, motion.ground, constraints=[own])
    assert found["own"].verdict is Verdict.NOT_CHECKED


@pytest.fixture(scope="module")
def bumpy() -> tuple[zs.Problem, zs.Trajectory]:
    """A drive over a heightmap, whose support is off the root's origin."""
    problem = load_scenario("terrain").problem
    support = problem.machine.support
    lifted = zs.SupportPolygon(support.vertices, height=-0.2)
    machine = problem.machine.with_support(lifted)
    return problem, zs.plan(replace(problem, machine=machine, intervals=15)).trajectory


def test_the_spline_of_a_heightmap_is_met_on_all_cells(bumpy):
    ground, rng = bumpy[0].ground, np.random.default_rng(3)
    low, high = ground.extent
    with working(4) as flint:
        cells = SplineCells(flint, ground)
        for x, y in rng.uniform(low, high, (60, 2)):
            (cell,) = cells.over(flint.arb(x), flint.arb(y))
            found = cells.gradient(cell, flint.arb(x), flint.arb(y))
            expected = ground._surface.derivatives(np.array([x]), np.array([y]))[0]
            assert abs(float(found[0].mid()) - expected[1, 0]) < 1e-12
            assert abs(float(found[1].mid()) - expected[0, 1]) < 1e-12
        wide = cells.over(flint.arb(0, 0.6), flint.arb(0, 0.1))
        assert len(wide) > 1


def test_the_path_over_a_heightmap_is_that_of_the_motion(bumpy):
    problem, trajectory = bumpy
    base, h = trajectory.base, np.diff(trajectory.times)
    with working(20) as flint:
        motion = MotionSeries(flint, trajectory)
        root = TerrainRoot(flint, motion, base, problem.ground, flint.arb(0))
        for k in (0, 4, 9, 14):
            for share in (0.25, 0.5, 1.0):
                found = root.position(k, share)
                pose, *_ = base.state_in(np.array([k]), np.array([share * h[k]]))
                for axis in (0, 1):
                    assert abs(float(found[axis].mid()) - pose[0, axis]) < 1e-8
                    assert float(found[axis].rad()) < 1e-6


def test_a_drive_over_a_heightmap_is_decided(bumpy):
    problem, trajectory = bumpy
    x = trajectory.base(np.linspace(0.0, trajectory.duration, 2001))[0][:, 0]
    base = replace(problem.base, x_bounds=(x.min() - 1e-3, x.max() + 1e-3))
    height = -0.2
    support = zs.SupportPolygon(problem.machine.support.vertices, height=height)
    machine = problem.machine.with_support(support)
    t, *_ = trajectory.within(np.linspace(0.0, 1.0, 100))
    points = zs.trajectory_zmp(machine, trajectory, t, problem.ground)
    sampled = float(support.signed_distance(points).min())
    certified = zs.certify(machine, trajectory, problem.ground, base=problem.base)
    found = zs.check_rigorously(machine, trajectory, problem.ground, certified.margin, base=base)
    tip = found["tip_over"]
    assert tip.verdict is Verdict.CONFIRMED
    assert tip.lower <= sampled + DIGITS
    assert tip.upper - 2e-6 <= sampled
    assert found["continuity"].verdict is Verdict.CONFIRMED
    bound = next(one for one in found.guarantees if one.label == "x_bounds")
    assert bound.verdict is Verdict.CONFIRMED
    broken = zs.check_rigorously(machine, trajectory, problem.ground, sampled + 4e-6)
    assert broken["tip_over"].verdict is Verdict.REFUTED


def test_a_map_of_a_plane_is_the_plane():
    """A drive straight down the fall line is the same motion in both coordinates."""
    pitch = 0.12
    x = np.tile(np.linspace(-3.0, 9.0, 25), (13, 1))
    ground = zs.Heightmap(-np.tan(pitch) * x, 0.5, (-3.0, -3.0))
    machine = zs.load_machine("feller_buncher")
    times, v = np.array([0.0, 0.4, 0.8]), np.array([[0.0, 0.0], [0.6, 0.0], [0.0, 0.0]])
    controls = np.array([[1.5, 0.0], [-1.5, 0.0]]), np.zeros((2, 2))
    q = np.tile([0.4, -0.8, -2.0, 0.7, 0.0], (3, 1))
    still, least = np.zeros((2, 5)), []
    for plane in (ground, zs.Slope(pitch=pitch)):
        base = UnicycleMotion.from_start(times, np.zeros(3), v, np.zeros(3), controls, plane)
        motion = zs.Trajectory(
            machine.joint_names, times, q, np.zeros((3, 5)), still, still, base=base
        )
        least.append(zs.check_rigorously(machine, motion, plane)["tip_over"])
    assert least[0].lower - 1e-9 <= least[1].upper
    assert least[1].lower - 1e-9 <= least[0].upper
    assert least[0].verdict is Verdict.CONFIRMED


def test_without_flint_the_message_says_what_to_install(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "flint", None)
    motion = random_motion(0)
    with pytest.raises(zs.MissingExtra, match=r"pip install zmp-sqp\[proof\]"):
        zs.check_rigorously(motion.machine, motion.trajectory, motion.ground)


def test_bad_arguments_are_refused():
    motion = random_motion(0)
    with pytest.raises(zs.ProblemError, match="margin"):
        zs.check_rigorously(motion.machine, motion.trajectory, motion.ground, np.nan)
    with pytest.raises(zs.ProblemError, match="moves the joints"):
        zs.check_rigorously(zs.load_machine("slider"), motion.trajectory, motion.ground)
    with pytest.raises(zs.TrajectoryError, match="Trajectory"):
        zs.check_rigorously(motion.machine, "motion", motion.ground)
    with pytest.raises(zs.ProblemError, match="ground"):
        zs.check_rigorously(motion.machine, motion.trajectory, zs.Slope)
    with pytest.raises(KeyError):
        opinion(0, 0.0)["nothing"]


def test_plan_and_check_write_the_second_opinion(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    options = ["--intervals", "12", "--no-figures", "--out", str(tmp_path), "--rigorous"]
    assert main(["plan", "paper_1", *options]) == 0
    assert "confirmed at all times in ball arithmetic" in capsys.readouterr().out
    written = json.loads((tmp_path / "plan.json").read_text())
    assert written["rigorous"]["confirmed"]
    tip = next(one for one in written["rigorous"]["guarantees"] if one["name"] == "tip_over")
    assert tip["required"] == written["margin"] <= tip["lower"]
    motion = str(tmp_path / "trajectory.csv")
    check = ["check", "--scenario", "paper_1", motion, "--rigorous", "--json", "-"]
    assert main(check) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["rigorous"]["guarantees"][0]["verdict"] == "confirmed"
    assert main([*check, "--margin", "0.2"]) == 1
    result = json.loads(capsys.readouterr().out)
    assert result["rigorous"]["guarantees"][0]["verdict"] == "refuted"
    assert not result["rigorous"]["confirmed"]

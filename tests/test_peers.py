"""The planner beside its peers: IPOPT, fatrop, Drake, TOPP-RA, and the check of all motions."""

import warnings

import numpy as np
import pytest

import zmp_sqp as zs

pytest.importorskip("casadi")

from benchmarks.peer_checks import (
    drive_of,
    drive_violations,
    motion_of,
    polynomial_states,
    violations,
)
from benchmarks.peer_drive import DrivingPeer, driving_guess
from benchmarks.peer_dynamics import wrench_function
from benchmarks.peer_fatrop import StagedPeer
from benchmarks.peer_ipopt import first_guess
from benchmarks.peer_rows import Method, problem_rows, shooting
from benchmarks.peer_transcription import Peer, PeerMotion, edges_outward
from benchmarks.peers import failures
from benchmarks.problems.arm import HARD, random_problem
from benchmarks.problems.checks import Oracle
from benchmarks.problems.driving import random_driving_problem
from benchmarks.problems.paper import paper_1

INTERVALS = 12
ACTIVE = 14  # seed of a hard problem where tip-over costs 15 % of the time
SAME = 1e-9  # [m] rounding of two derivations of one ZMP


@pytest.fixture(scope="module")
def ipopt():
    scene = paper_1(point_masses=False).scene
    return Peer(scene, intervals=INTERVALS, expand=False, tolerance=1e-6)


@pytest.fixture(scope="module")
def active():
    return random_problem(ACTIVE, HARD, intervals=INTERVALS)


@pytest.fixture(scope="module")
def plan(active):
    return zs.plan(active.problem)


def toppra_of(named, trajectory, cells):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of toppra's docstrings when it is compiled
        pytest.importorskip("toppra")
        from benchmarks.peer_toppra import retimed
    return retimed(named, trajectory, cells=cells)


def test_paper_1_side_by_side(ipopt):
    named = paper_1(point_masses=False, intervals=INTERVALS)
    ours, theirs = problem_rows(named, [Method("ipopt", shooting(ipopt), 0.0)])
    assert (ours["status"], theirs["status"]) == ("certified", "solved")
    assert theirs["zmp"] < 1e-3
    assert theirs["limits"] < 1e-6
    assert 1.0 < theirs["ratio"] < 1.02
    assert failures([ours, theirs]) == []


def test_failures_name_what_the_planner_gives_away():
    good = {"zmp": 0.0, "limits": 0.0, "duration": 1.0, "ratio": 1.0}
    ours = good | {"problem": "swing", "method": "zmp_sqp", "status": "certified"}
    peer = ours | {"method": "fatrop", "status": "solved", "ratio": 0.99}
    assert failures([ours, peer]) == ["swing: fatrop takes 0.99000 times as long"]
    assert failures([ours, peer | {"zmp": 1e-3}]) == []  # faster because it tips over
    assert len(failures([ours, peer | {"method": "toppra", "ratio": 0.9994}])) == 1
    assert len(failures([ours | {"status": "NOT_SOLVED"}])) == 1
    assert len(failures([ours | {"zmp": 1e-3}])) == 1


def test_fatrop_finds_the_motion_of_ipopt(ipopt, active):
    guess = first_guess(active.problem)
    staged = StagedPeer(active.scene, intervals=INTERVALS, tolerance=1e-6).solve(active, guess)
    answer = ipopt.solve(active, guess)
    assert staged.status == answer.status == "Solve_Succeeded"
    assert staged.motion.duration == pytest.approx(answer.motion.duration, rel=1e-5)
    np.testing.assert_allclose(staged.motion.q, answer.motion.q, atol=1e-2)
    found = violations(active, motion_of(staged.motion.trajectory(active.problem.machine)))
    # between the three points per interval that both constrain, the ZMP strays a little
    assert found.zmp < 1e-3
    assert found.rest < 1e-6


def test_toppra_gains_nothing_along_a_planned_path(active, plan):
    answer = toppra_of(active, plan.trajectory, 20)
    assert answer.status == "solved"
    assert abs(answer.motion.duration / plan.duration - 1.0) < 1e-4
    # the planner keeps a fraction of a millimetre away from the edges, TOPP-RA does not
    found = violations(active, answer.motion)
    assert found.zmp < 5e-3
    assert found.rest < 0.05  # [rad/s^2] within cells, at whose starts TOPP-RA keeps the limits


def test_toppra_tells_a_motion_that_is_too_slow(active, plan):
    trajectory = plan.trajectory
    slower = PeerMotion(
        trajectory.positions,
        trajectory.velocities / 1.5,
        np.diff(trajectory.velocities / 1.5, axis=0) / (1.5 * np.diff(trajectory.times)[:, None]),
        1.5 * plan.duration,
    ).trajectory(active.problem.machine)
    answer = toppra_of(active, slower, 10)
    # the first and the last of 12 intervals are kept as slow as they are
    assert answer.motion.duration < 0.85 * slower.duration


def test_the_blind_motion_violates_the_zmp_and_nothing_else():
    named = paper_1(point_masses=False)
    problem = named.problem
    blind = zs.phase_plane(problem.machine, problem.start, problem.goal)
    found = violations(named, motion_of(blind))
    times = np.linspace(0.0, blind.duration, 2000)
    least = zs.stability_margin(problem.machine, *blind(times), problem.ground).min()
    assert found.zmp == pytest.approx(-least, abs=1e-2)
    assert found.zmp > 0.5
    assert found.rest < 1e-9


def test_polynomials_of_nodes_are_the_trajectory(plan):
    times = np.random.default_rng(0).uniform(0.0, plan.duration, 200)
    for ours, theirs in zip(
        polynomial_states(plan.trajectory, times), plan.trajectory(times), strict=True
    ):
        np.testing.assert_allclose(ours, theirs, atol=1e-9)


def test_two_models_of_a_driving_machine_agree():
    drawn, rng = random_driving_problem(2), np.random.default_rng(0)
    wrench, oracle = wrench_function(drawn.scene, driving=True), Oracle(drawn.scene)
    q, v, a = rng.uniform(-1.0, 1.0, (3, 50, drawn.problem.machine.size + 2))
    gravity, load = drawn.problem.ground.gravity(), drawn.scene.tree.mass
    f = np.array(wrench.map(50)(q.T, v.T, a.T, np.tile(gravity[:, None], 50), load)).T
    ours = np.column_stack([-f[:, 4], f[:, 3]]) / f[:, 2:3]
    assert np.abs(ours - oracle.zmp(q, v, a)).max() < SAME


def test_a_drive_is_no_slower_than_ipopts():
    drawn = random_driving_problem(2)
    plan = zs.plan(drawn.problem)
    found = drive_violations(drawn, drive_of(plan.trajectory))
    assert found.zmp == 0.0
    assert found.rest < 1e-6
    guess = driving_guess(drawn, INTERVALS, 1.15 * plan.lower_bound)
    answer = DrivingPeer(drawn, intervals=INTERVALS, tolerance=1e-6).solve(guess)
    assert answer.status == "Solve_Succeeded"
    assert plan.duration <= 1.001 * answer.motion.duration
    names = (*drawn.problem.machine.joint_names, "yaw", "length")
    found = drive_violations(drawn, motion_of(answer.motion.integrated(names)))
    assert found.zmp < 1e-3
    assert found.rest < 1e-3  # [m] Simpson's rule on few intervals


def test_drakes_edge_joints_feel_the_moments_about_the_edges(active):
    pytest.importorskip("pydrake")
    from benchmarks.peer_drake import edge_moments

    machine, ground, scene = active.problem.machine, active.problem.ground, active.scene
    q, v, a = np.random.default_rng(0).uniform(-1.0, 1.0, (3, machine.size))
    f = np.array(wrench_function(scene)(q, v, a, ground.gravity(), scene.tree.mass)).ravel()
    outward, offsets = edges_outward(scene)
    tilting = outward[:, 0] * -f[4] + outward[:, 1] * f[3] - offsets * f[2]
    moments = edge_moments(scene, ground.gravity(), q, v, a)
    np.testing.assert_allclose(moments, -tilting / machine.mass, rtol=1e-9)

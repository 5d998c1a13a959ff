"""The planner beside an independent transcription in CasADi, solved by IPOPT."""

import numpy as np
import pytest

import zmp_sqp as zs

pytest.importorskip("casadi")

from benchmarks.peer_dynamics import wrench_function
from benchmarks.peer_ipopt import SLOWER, first_guess, peered, planned
from benchmarks.peer_problems import peer_problem
from benchmarks.peer_transcription import Peer

INTERVALS = 20
SAME = 1e-9  # [m] rounding of two derivations of one ZMP


@pytest.fixture(scope="module")
def peer():
    return Peer(peer_problem(0).scene, intervals=INTERVALS, expand=False)


def test_the_peers_zmp_is_the_librarys():
    named, rng = peer_problem(0), np.random.default_rng(0)
    machine, wrench = named.problem.machine, wrench_function(named.scene)
    for _ in range(100):
        q, v, a = rng.uniform(-1.5, 1.5, (3, machine.size))
        _, _, fz, tx, ty, _ = np.array(
            wrench(q, v, a, named.scene.ground.gravity(), named.scene.tree.mass)
        ).ravel()
        assert (
            np.abs([-ty / fz, tx / fz] - zs.zmp(machine, q, v, a, named.scene.ground)).max() < SAME
        )


def test_ipopt_starts_from_a_motion_between_start_and_goal():
    problem = peer_problem(9, intervals=INTERVALS).problem
    guess = first_guess(problem)
    motion = guess.trajectory(problem.machine)
    np.testing.assert_allclose(motion.positions, guess.q, atol=SAME)
    np.testing.assert_allclose(motion.velocities, guess.v, atol=SAME)
    np.testing.assert_allclose(guess.q[[0, -1]], [problem.start, problem.goal], atol=SAME)
    np.testing.assert_allclose(guess.v[[0, -1]], 0.0, atol=SAME)


@pytest.mark.parametrize("seed", [9, 29])
def test_plans_are_no_slower_than_ipopts(seed, peer):
    named = peer_problem(seed, intervals=INTERVALS)
    row = planned(named)
    assert row["solved"]
    assert row["duration"] > 1.01 * row["lower_bound"]  # the ZMP costs time
    answer = peered(named, peer)
    assert answer["ipopt_solved"]
    assert row["duration"] <= (1.0 + SLOWER) * answer["ipopt_duration"]

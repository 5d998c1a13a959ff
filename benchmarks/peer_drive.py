"""Base and arm in motion together, in CasADi and solved by IPOPT: arm and unicycle in one program.

Yaw and path length of the base are two more coordinates after the joints, with constant
accelerations on each interval like those. The base's position follows by Simpson's rule.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from benchmarks.harness import timed
from benchmarks.peer_dynamics import wrench_function
from benchmarks.peer_transcription import (
    SETTINGS,
    PeerAnswer,
    PeerMotion,
    bare_mass,
    stage_function,
)
from benchmarks.problems.driving import DrivingProblem

__all__ = ["DrivingPeer", "driving_guess"]

Array = np.ndarray


def driving_guess(drawn: DrivingProblem, intervals: int, duration: float) -> PeerMotion:
    """Cubics from start to goal in all coordinates; the path is as long as the chord."""
    problem, base = drawn.problem, drawn.problem.base
    chord = base.goal[:2] - base.start[:2]
    heading = 0.5 * (base.start[2] + base.goal[2])
    ahead = chord @ [np.cos(heading), np.sin(heading)] >= 0.0
    length = np.hypot(*chord) * (1.0 if ahead else -1.0)
    start = np.concatenate([problem.start, [base.start[2], 0.0]])
    goal = np.concatenate([problem.goal, [base.goal[2], length]])
    s = np.linspace(0.0, 1.0, intervals + 1)[:, None]
    q = start + (3.0 - 2.0 * s) * s**2 * (goal - start)
    v = 6.0 * s * (1.0 - s) * (goal - start) / duration
    return PeerMotion(q, v, np.diff(v, axis=0) * intervals / duration, duration)


class DrivingPeer:
    r"""A program for IPOPT for base and arm from rest to rest on a slope.

    To the program of `peer_transcription.Peer` it adds yaw \psi and path length l to the
    coordinates, and the positions p of the base,

    .. math:: p_{k+1} = p_k + \int l' (\cos\psi, \sin\psi) \, ds \quad \text{(Simpson's rule)}
    """

    def __init__(
        self,
        drawn: DrivingProblem,
        *,
        intervals: int = 50,
        seconds: float = 60.0,
        tolerance: float = 1e-8,
    ) -> None:
        """Build the program of one problem.

        Args:
            drawn: Problem from rest to rest on a slope.
            intervals: N.
            seconds: Most processor time of a solve [s].
            tolerance: IPOPT's, a tenth of it for constraints.
        """
        self.N, self.drawn = intervals, drawn
        machine, base = drawn.problem.machine, drawn.problem.base
        self.c = machine.size + 2
        limits = machine.limits
        self._rates = np.concatenate([limits.velocity, [base.max_yaw_rate, base.max_speed]])
        self._accelerations = np.concatenate(
            [limits.acceleration, [base.max_yaw_acceleration, base.max_acceleration]]
        )
        free = np.full(2, np.inf)
        self._lower = np.concatenate([limits.position_lower, -free])
        self._upper = np.concatenate([limits.position_upper, free])
        options = {
            "ipopt": {
                **SETTINGS,
                "tol": tolerance,
                "constr_viol_tol": 0.1 * tolerance,
                "max_cpu_time": seconds,
            },
            "print_time": False,
            "expand": True,
        }
        self._solver = ca.nlpsol("drive", "ipopt", self._program(), options)

    def _program(self) -> dict[str, Any]:
        """CasADi's program; the bounds of its rows become attributes."""
        N, c, scene = self.N, self.c, self.drawn.scene
        wrench = wrench_function(scene, driving=True)
        stage = stage_function(wrench, bare_mass(scene, self.drawn.problem.machine), scene, c)
        Q, W, U, P = (
            ca.MX.sym(name, rows, count)
            for name, rows, count in (
                ("Q", c, N + 1),
                ("W", c, N + 1),
                ("U", c, N),
                ("P", 2, N + 1),
            )
        )
        sigma, h = ca.MX.sym("sigma"), ca.MX.sym("h")
        gravity = ca.DM(self.drawn.problem.ground.gravity())
        load = scene.tree.mass if scene.tree else 0.0
        same = (ca.repmat(value, 1, N) for value in (sigma, h, gravity, load))
        before, rate, pushed = Q[:, :N], W[:, :N], U
        rows = stage.map(N)(before, rate, pushed, *same)
        reach = 0.5 * h
        middle = before + reach * rate + 0.5 * reach**2 * pushed
        velocities = [
            _velocity(Q[:, :N], rate),
            4.0 * _velocity(middle, rate + reach * pushed),
            _velocity(Q[:, 1:], W[:, 1:]),
        ]
        v, a = ca.DM(self._rates), ca.DM(self._accelerations)
        equal = [
            Q[:, 1:] - before - h * rate - 0.5 * h**2 * U,
            W[:, 1:] - rate - h * U,
            P[:, 1:] - P[:, :N] - h / 6.0 * sum(velocities[1:], velocities[0]),
        ]
        not_positive = [
            rows,
            W[:, 1:N] - v * ca.sqrt(sigma),
            -W[:, 1:N] - v * ca.sqrt(sigma),
            U - a * sigma,
            -U - a * sigma,
        ]
        parts = [*map(ca.vec, equal), ca.vec(before + reach * rate), *map(ca.vec, not_positive)]
        sizes = [int(part.numel()) for part in parts]
        zero, below = np.zeros(sum(sizes[:3])), np.full(sum(sizes[4:]), -np.inf)
        self._lbg = np.concatenate([zero, np.tile(self._lower, N), below])
        self._ubg = np.concatenate([zero, np.tile(self._upper, N), np.zeros(sum(sizes[4:]))])
        return {
            "x": ca.vertcat(*map(ca.vec, (Q, W, U, P)), sigma),
            "p": h,
            "f": sigma,
            "g": ca.vertcat(*parts),
        }

    def solve(self, guess: PeerMotion) -> PeerAnswer:
        """Fastest motion of (joints, yaw, path length) that IPOPT finds from a guess."""
        problem, N, c = self.drawn.problem, self.N, self.c
        base = problem.base
        lower, upper = np.tile(self._lower, (N + 1, 1)), np.tile(self._upper, (N + 1, 1))
        lower[0] = upper[0] = [*problem.start, base.start[2], 0.0]
        lower[-1, :-1] = upper[-1, :-1] = [*problem.goal, base.goal[2]]
        rates = np.full((N + 1, c), np.inf)
        rates[[0, -1]] = 0.0
        free = np.full(N * c, np.inf)
        places = np.full((N + 1, 2), np.inf)
        least, most = -places, places.copy()
        for k, pose in ((0, base.start), (N, base.goal)):
            least[k] = most[k] = pose[:2]
        shares = (guess.q[:, -1] / (guess.q[-1, -1] or 1.0))[:, None]
        positions = base.start[:2] + shares * (base.goal[:2] - base.start[:2])
        arguments = {
            "x0": np.concatenate(
                [guess.q.ravel(), guess.v.ravel(), guess.a.ravel(), positions.ravel(), [1.0]]
            ),
            "p": guess.duration / N,
            "lbx": np.concatenate([lower.ravel(), -rates.ravel(), -free, least.ravel(), [1e-4]]),
            "ubx": np.concatenate([upper.ravel(), rates.ravel(), free, most.ravel(), [1e6]]),
            "lbg": self._lbg,
            "ubg": self._ubg,
        }
        found, took = timed(lambda: self._solver(**arguments))
        x, stats = np.array(found["x"]).ravel(), self._solver.stats()
        stretch, nodes = float(np.sqrt(x[-1])), (N + 1) * c
        motion = PeerMotion(
            q=x[:nodes].reshape(-1, c),
            v=x[nodes : 2 * nodes].reshape(-1, c) / stretch,
            a=x[2 * nodes : 2 * nodes + N * c].reshape(-1, c) / stretch**2,
            duration=stretch * guess.duration,
        )
        return PeerAnswer(
            str(stats["return_status"]), motion, int(stats["iter_count"]), took.processor
        )


def _velocity(coordinates: ca.MX, rates: ca.MX) -> ca.MX:
    """Velocity of the base in the plane, shape (2, K)."""
    yaw, speed = coordinates[-2, :], rates[-1, :]
    return ca.vertcat(speed * ca.cos(yaw), speed * ca.sin(yaw))

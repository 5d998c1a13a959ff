"""The minimum-time problem in CasADi for IPOPT: multiple shooting on a stretched clock, constant accelerations."""

from __future__ import annotations

import time
from dataclasses import dataclass

import casadi as ca
import numpy as np

import zmp_sqp as zs
from benchmarks.peer_dynamics import wrench_function
from benchmarks.problems.scene import GRAVITY, NamedProblem, Scene

__all__ = ["Peer", "PeerAnswer", "PeerMotion", "by_way_of"]

Array = np.ndarray
LEAST_NORMAL_FORCE = 0.05  # of the weight, as the planner asks
SETTINGS = {
    "tol": 1e-8,
    "constr_viol_tol": 1e-9,
    "acceptable_iter": 0,
    "max_iter": 3000,
    "print_level": 0,
    "sb": "yes",
}


@dataclass(frozen=True)
class PeerMotion:
    """Nodes q (N+1, n), v (N+1, n), accelerations a (N, n) in seconds, and the duration [s]."""

    q: Array
    v: Array
    a: Array
    duration: float

    def trajectory(self, machine: zs.Machine) -> zs.Trajectory:
        """The same, integrated anew from the first node, so that only accelerations and duration are believed."""
        h = self.duration / len(self.a)
        v = self.v[0] + np.vstack([0.0 * self.v[:1], np.cumsum(h * self.a, axis=0)])
        q = self.q[0] + np.vstack(
            [0.0 * self.q[:1], np.cumsum(h * v[:-1] + 0.5 * h**2 * self.a, axis=0)]
        )
        return zs.Trajectory(
            machine.joint_names, np.linspace(0.0, self.duration, len(self.a) + 1), q, v, self.a
        )


@dataclass(frozen=True)
class PeerAnswer:
    """What IPOPT said."""

    status: str
    motion: PeerMotion
    iterations: int
    seconds: float  # processor time


class Peer:
    r"""IPOPT on the question of a scene's machine; built once, solved for any ground, payload's mass, start and goal.

    .. math:: \min \sigma \quad \text{with} \quad t = \sqrt\sigma\, s, \;
              q_{k+1} = q_k + h w_k + \tfrac{h^2}{2} u_k, \; w_{k+1} = w_k + h u_k, \;
              |w_k| \le v \sqrt\sigma, \; |u_k| \le a \sigma, \; C f(q, w, u, \sigma g) \le 0

    s runs over the guess's duration, so w and u are rates and accelerations at sigma = 1. The
    wrench rows hold at both ends of every interval and, as in the planner, at the middle Bernstein
    control point of the parabola through start, middle and end; positions hold at the nodes and at
    their Bernstein points. No guard is kept from any edge.
    """

    def __init__(
        self, scene: Scene, *, intervals: int = 50, seconds: float = 60.0, expand: bool = True
    ) -> None:
        """Build the program.

        Args:
            scene: Machine, polygon and the tree's shape; ground and the tree's mass come with each
                problem.
            intervals: N.
            seconds: Of processor time, the most that one solve gets.
            expand: Into scalar operations: ten seconds to build instead of one, solves in half the
                time.
        """
        machine = scene.load()
        self.N, self.n, limits = intervals, machine.size, machine.limits
        N, n = self.N, self.n
        wrench = wrench_function(scene)
        stage = self._stage(wrench, machine.mass - (scene.tree.mass if scene.tree else 0.0), scene)
        Q, W, U = (
            ca.MX.sym(name, n, count) for name, count in (("Q", N + 1), ("W", N + 1), ("U", N))
        )
        sigma, h, gravity, load = (
            ca.MX.sym("sigma"),
            ca.MX.sym("h"),
            ca.MX.sym("gravity", 3),
            ca.MX.sym("load"),
        )
        rows = stage.map(N)(
            Q[:, :N],
            W[:, :N],
            U,
            ca.repmat(sigma, 1, N),
            ca.repmat(h, 1, N),
            ca.repmat(gravity, 1, N),
            ca.repmat(load, 1, N),
        )
        rate, push = ca.DM(limits.velocity), ca.DM(limits.acceleration)
        within = [
            rows,
            W[:, 1:N] - rate * ca.sqrt(sigma),
            -W[:, 1:N] - rate * ca.sqrt(sigma),
            U - push * sigma,
            -U - push * sigma,
        ]
        gaps = [Q[:, 1:] - Q[:, :N] - h * W[:, :N] - 0.5 * h**2 * U, W[:, 1:] - W[:, :N] - h * U]
        inner = Q[:, :N] + 0.5 * h * W[:, :N]
        parts = [*map(ca.vec, gaps), ca.vec(inner), *map(ca.vec, within)]
        sizes = [int(part.numel()) for part in parts]
        lower, upper = np.array(limits.position_lower), np.array(limits.position_upper)
        self._lbg = np.concatenate(
            [np.zeros(sum(sizes[:2])), np.tile(lower, N), np.full(sum(sizes[3:]), -np.inf)]
        )
        self._ubg = np.concatenate(
            [np.zeros(sum(sizes[:2])), np.tile(upper, N), np.zeros(sum(sizes[3:]))]
        )
        self._lower, self._upper = lower, upper
        program = {
            "x": ca.vertcat(ca.vec(Q), ca.vec(W), ca.vec(U), sigma),
            "p": ca.vertcat(h, gravity, load),
            "f": sigma,
            "g": ca.vertcat(*parts),
        }
        options = {
            "ipopt": {**SETTINGS, "max_cpu_time": seconds},
            "print_time": False,
            "expand": expand,
        }
        self._solver = ca.nlpsol("peer", "ipopt", program, options)

    def _stage(self, wrench: ca.Function, mass: float, scene: Scene) -> ca.Function:
        """Rows of one interval from its start, not positive where they hold [m, share of the weight]."""
        n = self.n
        q, w, u = (ca.SX.sym(name, n) for name in "qwu")
        sigma, h, gravity, load = (
            ca.SX.sym("sigma"),
            ca.SX.sym("h"),
            ca.SX.sym("gravity", 3),
            ca.SX.sym("load"),
        )
        corners = np.array(scene.vertices)
        edges = np.roll(corners, -1, axis=0) - corners
        outward = (
            np.column_stack([edges[:, 1], -edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
        )
        reach = np.einsum("ij,ij->i", outward, corners)
        weight = (mass + load) * GRAVITY

        def rows(s: float) -> ca.SX:
            f = wrench(
                q + s * h * w + 0.5 * (s * h) ** 2 * u, w + s * h * u, u, sigma * gravity, load
            )
            tilting = outward[:, 0] * -f[4] + outward[:, 1] * f[3] - reach * f[2]
            return ca.vertcat(tilting, LEAST_NORMAL_FORCE * sigma * weight - f[2]) / weight

        start, middle, end = rows(0.0), rows(0.5), rows(1.0)
        held = ca.vertcat(start, end, 2.0 * middle - 0.5 * (start + end))
        return ca.Function("stage", [q, w, u, sigma, h, gravity, load], [held])

    def solve(self, named: NamedProblem, guess: PeerMotion) -> PeerAnswer:
        """Fastest motion that IPOPT finds from a guess."""
        problem, N, n, tree = named.problem, self.N, self.n, named.scene.tree
        lower, upper = np.tile(self._lower, (N + 1, 1)), np.tile(self._upper, (N + 1, 1))
        lower[0] = upper[0] = problem.start
        lower[-1] = upper[-1] = problem.goal
        free, still = np.full((N - 1, n), np.inf), np.zeros((1, n))
        rates = np.vstack([still, free, still])
        pushes = np.full(N * n, np.inf)
        h = guess.duration / N
        started = time.process_time()
        found = self._solver(
            x0=np.concatenate([guess.q.ravel(), guess.v.ravel(), guess.a.ravel(), [1.0]]),
            p=np.concatenate([[h], problem.ground.gravity(), [0.0 if tree is None else tree.mass]]),
            lbx=np.concatenate([lower.ravel(), -rates.ravel(), -pushes, [1e-4]]),
            ubx=np.concatenate([upper.ravel(), rates.ravel(), pushes, [1e6]]),
            lbg=self._lbg,
            ubg=self._ubg,
        )
        seconds, stats = time.process_time() - started, self._solver.stats()
        x = np.array(found["x"]).ravel()
        stretch, nodes = float(np.sqrt(x[-1])), (N + 1) * n
        motion = PeerMotion(
            q=x[:nodes].reshape(-1, n),
            v=x[nodes : 2 * nodes].reshape(-1, n) / stretch,
            a=x[2 * nodes : -1].reshape(-1, n) / stretch**2,
            duration=stretch * guess.duration,
        )
        return PeerAnswer(str(stats["return_status"]), motion, int(stats["iter_count"]), seconds)


def by_way_of(problem: zs.Problem, guess: PeerMotion, pose: Array, *, slower: float) -> PeerMotion:
    """Another guess: from stop to stop by way of a pose, in so many times the duration."""
    N = len(guess.a)
    s = np.linspace(0.0, 1.0, N + 1)
    out, back = (
        part**3 * (10.0 - 15.0 * part + 6.0 * part**2)
        for part in np.clip([2.0 * s, 2.0 * s - 1.0], 0.0, 1.0)
    )
    q = problem.start + np.outer(out, pose - problem.start) + np.outer(back, problem.goal - pose)
    duration = slower * guess.duration
    v = np.gradient(q, duration / N, axis=0)
    v[0] = v[-1] = 0.0
    return PeerMotion(q, v, np.diff(v, axis=0) * N / duration, duration)

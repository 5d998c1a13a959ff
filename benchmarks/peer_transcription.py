"""The minimum-time problem in CasADi, solved by IPOPT: multiple shooting with scaled time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

import zmp_sqp as zs
from benchmarks.harness import timed
from benchmarks.peer_dynamics import wrench_function
from benchmarks.problems.scene import GRAVITY, NamedProblem, Scene

__all__ = [
    "COMPILED",
    "ONE_JACOBIAN",
    "SETTINGS",
    "Peer",
    "PeerAnswer",
    "PeerMotion",
    "bare_mass",
    "by_way_of",
    "edges_outward",
    "stage_function",
]

Array = np.ndarray
LEAST_NORMAL_FORCE = 0.05  # share of the weight, the planner's too
SETTINGS = {
    "tol": 1e-8,
    "constr_viol_tol": 1e-9,
    "acceptable_iter": 0,
    "max_iter": 3000,
    "print_level": 0,
    "sb": "yes",
}
COMPILED = {  # options of a program that CasADi writes as C code and hands to gcc
    "expand": False,
    "jit": True,
    "compiler": "shell",
    "jit_options": {"compiler": "gcc", "flags": ["-O1"], "verbose": False},
}
# a function whose directional derivatives are products with its Jacobian: a third less C code
ONE_JACOBIAN = {"jac_penalty": 0, "der_options": {"jac_penalty": 0}}


@dataclass(frozen=True)
class PeerMotion:
    """A motion with constant accelerations on each of N intervals."""

    q: Array  # positions at the nodes (N+1, n) [rad]
    v: Array  # rates at the nodes (N+1, n) [rad/s]
    a: Array  # accelerations of the intervals (N, n) [rad/s^2]
    duration: float  # [s]

    def trajectory(self, machine: zs.Machine) -> zs.Trajectory:
        """The motion of a machine's joints by `integrated`."""
        return self.integrated(machine.joint_names)

    def integrated(self, names: tuple[str, ...]) -> zs.Trajectory:
        """The motion that follows from first node, accelerations and duration by integration.

        The other nodes are not used, so that checks of the trajectory do not rely on them.
        """
        h = self.duration / len(self.a)
        v = self.v[0] + np.vstack([0.0 * self.v[:1], np.cumsum(h * self.a, axis=0)])
        q = self.q[0] + np.vstack(
            [0.0 * self.q[:1], np.cumsum(h * v[:-1] + 0.5 * h**2 * self.a, axis=0)]
        )
        times = np.linspace(0.0, self.duration, len(self.a) + 1)
        return zs.Trajectory(names, times, q, v, self.a)


@dataclass(frozen=True)
class PeerAnswer:
    """Answer of IPOPT."""

    status: str
    motion: PeerMotion
    iterations: int
    seconds: float  # [s] processor time


class Peer:
    r"""A program for IPOPT, built once for a machine and a support polygon.

    It is then solved for any slope, mass of the payload, start and goal.

    .. math:: \min \sigma \quad \text{with} \quad t = \sqrt\sigma\, s, \;
              q_{k+1} = q_k + h w_k + \tfrac{h^2}{2} u_k, \; w_{k+1} = w_k + h u_k, \;
              |w_k| \le v \sqrt\sigma, \; |u_k| \le a \sigma, \; C f(q, w, u, \sigma g) \le 0

    Here s is the time in the motion of the guess, and w and u are rates and accelerations in that
    time, so that sigma = 1 is the guess. The wrench rows C hold at both ends of every interval and
    at the middle Bernstein control point of the parabola through start, middle and end. Positions
    are within limits at the nodes and at their Bernstein control points. Unlike the planner, IPOPT
    keeps no small distance from the edges.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        intervals: int = 50,
        seconds: float = 60.0,
        expand: bool = True,
        compiled: bool = False,
        tolerance: float = 1e-8,
    ) -> None:
        """Build the program.

        Args:
            scene: Machine, polygon and shape of the tree. Slope and mass of the tree come with
                each problem.
            intervals: N.
            seconds: Most processor time of a solve [s].
            expand: Expand the program into scalar operations. Building it then takes ten seconds
                instead of one, a solve half the time.
            compiled: Generate C code and compile it; `expand` is not used then.
            tolerance: IPOPT's, a tenth of it for constraints.
        """
        machine = scene.load()
        self.N, self.n = intervals, machine.size
        self._lower = np.array(machine.limits.position_lower)
        self._upper = np.array(machine.limits.position_upper)
        wrench = wrench_function(scene, options=ONE_JACOBIAN if compiled else {})
        stage = stage_function(
            wrench, bare_mass(scene, machine), scene, self.n, symbol=ca.MX if compiled else ca.SX
        )
        options = {
            "ipopt": {
                **SETTINGS,
                "tol": tolerance,
                "constr_viol_tol": 0.1 * tolerance,
                "max_cpu_time": seconds,
            },
            "print_time": False,
            **(COMPILED if compiled else {"expand": expand}),
        }
        self._solver = ca.nlpsol("peer", "ipopt", self._program(stage, machine.limits), options)

    def _program(self, stage: ca.Function, limits: Any) -> dict[str, Any]:
        """CasADi's program; the bounds of its rows become attributes."""
        N, n = self.N, self.n
        Q, W, U = (
            ca.MX.sym(name, n, count) for name, count in (("Q", N + 1), ("W", N + 1), ("U", N))
        )
        sigma, h, load = (ca.MX.sym(name) for name in ("sigma", "h", "load"))
        gravity = ca.MX.sym("gravity", 3)
        same = (ca.repmat(value, 1, N) for value in (sigma, h, gravity, load))
        rows = stage.map(N)(Q[:, :N], W[:, :N], U, *same)
        rate, acceleration = ca.DM(limits.velocity), ca.DM(limits.acceleration)
        not_positive = [
            rows,
            W[:, 1:N] - rate * ca.sqrt(sigma),
            -W[:, 1:N] - rate * ca.sqrt(sigma),
            U - acceleration * sigma,
            -U - acceleration * sigma,
        ]
        gaps = [Q[:, 1:] - Q[:, :N] - h * W[:, :N] - 0.5 * h**2 * U, W[:, 1:] - W[:, :N] - h * U]
        # middle control points of the positions: within the joint limits
        inner = Q[:, :N] + 0.5 * h * W[:, :N]
        parts = [*map(ca.vec, gaps), ca.vec(inner), *map(ca.vec, not_positive)]
        sizes = [int(part.numel()) for part in parts]
        equal, below = np.zeros(sum(sizes[:2])), np.full(sum(sizes[3:]), -np.inf)
        self._lbg = np.concatenate([equal, np.tile(self._lower, N), below])
        self._ubg = np.concatenate([equal, np.tile(self._upper, N), np.zeros(sum(sizes[3:]))])
        return {
            "x": ca.vertcat(ca.vec(Q), ca.vec(W), ca.vec(U), sigma),
            "p": ca.vertcat(h, gravity, load),
            "f": sigma,
            "g": ca.vertcat(*parts),
        }

    def solve(self, named: NamedProblem, guess: PeerMotion) -> PeerAnswer:
        """Fastest motion that IPOPT finds, starting from a guess."""
        problem, N, n, tree = named.problem, self.N, self.n, named.scene.tree
        lower, upper = np.tile(self._lower, (N + 1, 1)), np.tile(self._upper, (N + 1, 1))
        lower[0] = upper[0] = problem.start
        lower[-1] = upper[-1] = problem.goal
        free, still = np.full((N - 1, n), np.inf), np.zeros((1, n))
        rates = np.vstack([still, free, still])
        accelerations = np.full(N * n, np.inf)  # bounded by rows, because the bound scales
        h, load = guess.duration / N, 0.0 if tree is None else tree.mass
        arguments = {
            "x0": np.concatenate([guess.q.ravel(), guess.v.ravel(), guess.a.ravel(), [1.0]]),
            "p": np.concatenate([[h], problem.ground.gravity(), [load]]),
            "lbx": np.concatenate([lower.ravel(), -rates.ravel(), -accelerations, [1e-4]]),
            "ubx": np.concatenate([upper.ravel(), rates.ravel(), accelerations, [1e6]]),
            "lbg": self._lbg,
            "ubg": self._ubg,
        }
        found, took = timed(lambda: self._solver(**arguments))
        stats = self._solver.stats()
        x = np.array(found["x"]).ravel()
        # duration over the guess's, entries of all positions
        stretch, nodes = float(np.sqrt(x[-1])), (N + 1) * n
        motion = PeerMotion(
            q=x[:nodes].reshape(-1, n),
            v=x[nodes : 2 * nodes].reshape(-1, n) / stretch,
            a=x[2 * nodes : -1].reshape(-1, n) / stretch**2,
            duration=stretch * guess.duration,
        )
        return PeerAnswer(
            str(stats["return_status"]), motion, int(stats["iter_count"]), took.processor
        )


def bare_mass(scene: Scene, machine: zs.Machine) -> float:
    """Mass of a scene's machine without its payload [kg]."""
    return machine.mass - (scene.tree.mass if scene.tree else 0.0)


def edges_outward(scene: Scene) -> tuple[Array, Array]:
    """Unit normals of the support polygon's edges, outward (E, 2), and their offsets (E,) [m]."""
    corners = np.array(scene.vertices)
    edges = np.roll(corners, -1, axis=0) - corners
    outward = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
    return outward, np.einsum("ij,ij->i", outward, corners)


def stage_function(
    wrench: ca.Function, mass: float, scene: Scene, n: int, *, symbol: Any = ca.SX
) -> ca.Function:
    """Wrench rows of one interval from the state at its start; they hold where not positive.

    Tilting moments about the edges and the least normal force, divided by the weight [m, -], at
    the start, the end and the middle control point.

    Args:
        wrench: Ground reaction.
        mass: Of the machine without payload [kg].
        scene: Support polygon.
        n: Number of joints.
        symbol: CasADi's type of scalar expressions (SX), or of those that call the ground reaction
            as a function (MX), so that C code contains it once.
    """
    q, w, u = (symbol.sym(name, n) for name in "qwu")
    sigma, h, load = (symbol.sym(name) for name in ("sigma", "h", "load"))
    gravity = symbol.sym("gravity", 3)
    outward, offsets = edges_outward(scene)
    weight = (mass + load) * GRAVITY

    def rows(s: float) -> Any:
        position, rate = q + s * h * w + 0.5 * (s * h) ** 2 * u, w + s * h * u
        f = wrench(position, rate, u, sigma * gravity, load)
        tilting = outward[:, 0] * -f[4] + outward[:, 1] * f[3] - offsets * f[2]
        return ca.vertcat(tilting, LEAST_NORMAL_FORCE * sigma * weight - f[2]) / weight

    start, middle, end = rows(0.0), rows(0.5), rows(1.0)
    values = ca.vertcat(start, end, 2.0 * middle - 0.5 * (start + end))
    return ca.Function("stage", [q, w, u, sigma, h, gravity, load], [values])


def by_way_of(problem: zs.Problem, guess: PeerMotion, pose: Array, *, slower: float) -> PeerMotion:
    """A guess that moves to a pose, stops there, and moves on to the goal.

    Args:
        problem: Start and goal.
        guess: Another guess, for the number of intervals and the duration.
        pose: To stop at (n,).
        slower: Factor of the duration.
    """
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

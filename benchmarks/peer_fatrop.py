"""The minimum-time problem in CasADi, solved by fatrop: stage by stage, as its structure asks."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from benchmarks.harness import timed
from benchmarks.peer_dynamics import wrench_function
from benchmarks.peer_transcription import (
    COMPILED,
    ONE_JACOBIAN,
    PeerAnswer,
    PeerMotion,
    bare_mass,
    stage_function,
)
from benchmarks.problems.scene import NamedProblem, Scene

__all__ = ["StagedPeer"]

SETTINGS = {"max_iter": 1000, "print_level": 0}


class StagedPeer:
    r"""A program for fatrop, built once for a machine and a support polygon.

    It is the program of `peer_transcription.Peer` but for one thing: each stage has a sigma of its
    own among its states, equal to the next one's, so that no variable is shared by all stages.

    .. math:: x_k = (q_k, w_k, \sigma_k), \quad x_{k+1} = A x_k + B u_k, \quad g_k(x_k, u_k) \le 0
    """

    def __init__(
        self,
        scene: Scene,
        *,
        intervals: int = 50,
        compiled: bool = False,
        tolerance: float = 1e-8,
    ) -> None:
        """Build the program.

        Args:
            scene: Machine, polygon and shape of the tree. Slope and mass of the tree come with
                each problem.
            intervals: N.
            compiled: Generate C code and compile it, instead of evaluating the expanded program.
            tolerance: fatrop's, for optimality and for constraints.
        """
        machine = scene.load()
        self.N, self.n = intervals, machine.size
        self._limits = machine.limits
        stage = stage_function(
            wrench_function(scene, options=ONE_JACOBIAN if compiled else {}),
            bare_mass(scene, machine),
            scene,
            self.n,
            symbol=ca.MX if compiled else ca.SX,
        )
        program, sizes = self._program(stage)
        options = {
            "fatrop": {**SETTINGS, "tol": tolerance},
            "print_time": False,
            "structure_detection": "manual",
            "N": self.N,
            "nx": [2 * self.n + 1] * (self.N + 1),
            "nu": [self.n] * self.N + [0],
            "ng": sizes,
            **(COMPILED if compiled else {"expand": True}),
        }
        self._solver = ca.nlpsol("peer", "fatrop", program, options)

    def _program(self, stage: ca.Function) -> tuple[dict[str, Any], list[int]]:
        """CasADi's program, and the number of path constraints of each stage.

        The bounds of its rows become attributes; those of start and goal come with each problem.
        """
        N, n = self.N, self.n
        states = [ca.MX.sym(f"x{k}", 2 * n + 1) for k in range(N + 1)]
        controls = [ca.MX.sym(f"u{k}", n) for k in range(N)]
        h, load, gravity = ca.MX.sym("h"), ca.MX.sym("load"), ca.MX.sym("gravity", 3)
        rows, lower, upper, sizes = [], [], [], []
        v, a = ca.DM(self._limits.velocity), ca.DM(self._limits.acceleration)
        for k in range(N):
            (q, w, sigma), u = _parts(states[k], n), controls[k]
            following = ca.vertcat(q + h * w + 0.5 * h**2 * u, w + h * u, sigma)
            wrench_rows = stage(q, w, u, sigma, h, gravity, load)
            within = [wrench_rows, u - a * sigma, -u - a * sigma]
            if k:
                within += [w - v * ca.sqrt(sigma), -w - v * ca.sqrt(sigma)]
            below = ca.vertcat(*within)
            ends = ca.vertcat(q, w) if k == 0 else ca.MX(0, 1)
            # middle control points of the positions: within the joint limits
            rows += [states[k + 1] - following, ends, q + 0.5 * h * w, below]
            fixed, count = np.zeros(2 * n + 1), int(below.numel())
            given = np.zeros(int(ends.numel()))
            lower += [fixed, given, self._limits.position_lower, np.full(count, -np.inf)]
            upper += [fixed, given, self._limits.position_upper, np.zeros(count)]
            sizes.append(len(given) + n + count)
        rows.append(states[N][: 2 * n])
        sizes.append(2 * n)
        self._lbg = np.concatenate([*lower, np.zeros(2 * n)])
        self._ubg = np.concatenate([*upper, np.zeros(2 * n)])
        chain = [part for pair in zip(states, controls, strict=False) for part in pair]
        program = {
            "x": ca.vertcat(*chain, states[N]),
            "p": ca.vertcat(h, gravity, load),
            "f": states[N][2 * n],
            "g": ca.vertcat(*rows),
        }
        return program, sizes

    def solve(self, named: NamedProblem, guess: PeerMotion) -> PeerAnswer:
        """Fastest motion that fatrop finds, starting from a guess."""
        problem, N, n, tree = named.problem, self.N, self.n, named.scene.tree
        h, load = guess.duration / N, 0.0 if tree is None else tree.mass
        lbg, ubg = self._lbg.copy(), self._ubg.copy()
        first, last = 2 * n + 1, len(lbg) - 2 * n  # rows of the first and the last positions
        for row, values in ((first, problem.start), (last, problem.goal)):
            lbg[row : row + n] = ubg[row : row + n] = values
        states = np.column_stack([guess.q, guess.v, np.ones(N + 1)])
        chain = np.column_stack([states[:-1], guess.a])
        lower, upper = self._bounds()
        arguments = {
            "x0": np.concatenate([chain.ravel(), states[-1]]),
            "p": np.concatenate([[h], problem.ground.gravity(), [load]]),
            "lbx": lower,
            "ubx": upper,
            "lbg": lbg,
            "ubg": ubg,
        }
        found, took = timed(lambda: self._solver(**arguments))
        stats, x = self._solver.stats(), np.array(found["x"]).ravel()
        inner = x[: N * (3 * n + 1)].reshape(N, 3 * n + 1)
        nodes = np.vstack([inner[:, : 2 * n + 1], x[N * (3 * n + 1) :]])
        stretch = float(np.sqrt(nodes[-1, -1]))  # duration over the guess's
        motion = PeerMotion(
            q=nodes[:, :n],
            v=nodes[:, n : 2 * n] / stretch,
            a=inner[:, 2 * n + 1 :] / stretch**2,
            duration=stretch * guess.duration,
        )
        status = str(stats.get("return_status", stats["unified_return_status"]))
        if stats["success"]:
            status = "Solve_Succeeded"
        return PeerAnswer(status, motion, int(stats.get("iter_count", -1)), took.processor)

    def _bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of the variables: joint limits of inner nodes, and a sigma that is positive."""
        N, n = self.N, self.n
        lower = np.full((N + 1, 3 * n + 1), -np.inf)
        upper = np.full((N + 1, 3 * n + 1), np.inf)
        lower[1:N, :n], upper[1:N, :n] = self._limits.position_lower, self._limits.position_upper
        lower[:, 2 * n] = 1e-4
        upper[:, 2 * n] = 1e6
        last = N * (3 * n + 1) + 2 * n + 1  # the last stage has no controls
        return lower.ravel()[:last], upper.ravel()[:last]


def _parts(x: ca.MX, n: int) -> tuple[ca.MX, ca.MX, ca.MX]:
    """Positions, rates and sigma of a stage."""
    return x[:n], x[n : 2 * n], x[2 * n]

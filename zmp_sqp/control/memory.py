"""Warm start: the remainder of the last motion, as initial guess of a changed problem."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.motion.trajectory import Trajectory
from zmp_sqp.planning.problem.problem import Problem
from zmp_sqp.planning.program.grid import ENDS, Grid
from zmp_sqp.planning.program.staged import POINTS, Motion, StagedProgram
from zmp_sqp.planning.search.answer import Status
from zmp_sqp.planning.search.run import Candidate
from zmp_sqp.planning.search.task import Task

__all__ = ["Memory", "Remainder"]

SAMPLES = 8  # per interval, at which the last motion is compared with a measured state
FINER = 8  # times that the interval about the nearest sample is divided by 8
NOTHING_ACTIVE = 1e-4  # sum of multipliers up to which no nonlinear row shapes the motion


@dataclass(frozen=True, slots=True, eq=False)
class Remainder:
    """Remainder of a motion, in the coordinates of the planner.

    Attributes:
        grid: Grid of its remaining nodes, in time normalised by `duration`.
        controls: Accelerations at both ends of the intervals times duration^2, shape (N, 2, n).
        duration: Duration of the remainder [s].
        rows: Multipliers of the nonlinear rows by interval, shape (N, R), and of the acceleration
            limits by side and interval, shape (2, N, 2 n); None if unknown.
        excess: Amounts added to the nonlinear rows for what happens between their points, shape
            (N, R); None if unknown.
    """

    grid: Grid
    controls: Array
    duration: float
    rows: tuple[Array, Array] | None
    excess: Array | None = None

    @property
    def is_active(self) -> bool:
        """Whether nonlinear constraints, such as tip-over, shape the motion."""
        return self.rows is not None and bool(self.rows[0].sum() > NOTHING_ACTIVE)

    def on(self, task: Task, grid: Grid, duration: float) -> tuple[StagedProgram, Motion]:
        """Program on a grid, and this motion on it, changed to meet the task's start and goal.

        Args:
            task: The planning task.
            grid: Grid of normalised time.
            duration: Duration of the motion [s].
        """
        program = task.program(duration, grid)
        return program, program.pack(self.grid.on(grid, self.controls), duration**2)

    def multipliers(self, program: StagedProgram) -> Array:
        """Multipliers of a program's inequalities, from those of the interval at the same time.

        In proportion to the lengths of the intervals. Limits of rates and positions get zeros.
        """
        z = np.zeros(program.inequalities)
        if self.rows is None:
            return z
        of_rows, of_controls = self.rows
        parent = self.grid.parents(program.grid)
        share = (program.grid.steps / self.grid.steps[parent])[:, None]
        if of_rows.shape[1] == program.rows.count * POINTS:
            z[: program.nonlinear] = (of_rows[parent] * share).ravel()
        size = of_controls.shape[2] * 2 * program.grid.size
        z[program.nonlinear : program.nonlinear + size] = (of_controls[:, parent] * share).ravel()
        return z

    def excess_of(self, program: StagedProgram) -> Array | None:
        """Excess of a program's nonlinear rows, from that of the interval at the same time.

        Like the height of a parabola over its chord it goes with the square of the length.
        """
        if self.excess is None or self.excess.shape[1] != program.rows.count * POINTS:
            return None
        parent = self.grid.parents(program.grid)
        share = program.reference * program.grid.steps / (self.duration * self.grid.steps[parent])
        return np.asarray((self.excess[parent] * share[:, None] ** 2).ravel())


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """Last certified plan of a planner, as far as the next one needs it.

    Attributes:
        problem: Problem that was planned.
        motion: Its certified motion.
        candidate: Point of the nonlinear program that the motion comes from; None where the motion
            was computed in closed form.
        status: How its search ended; None if it has not.
        unfinished: Number of calls in which the search for it ran out of time; 0 once certified.
    """

    problem: Problem
    motion: Trajectory
    candidate: Candidate | None
    status: Status | None = None
    unfinished: int = 0

    def fits(self, problem: Problem) -> bool:
        """Whether a new problem has the coordinates of this one."""
        old, names = self.problem, problem.machine.joint_names
        same = old.model == problem.model and old.machine.joint_names == names
        return same and (old.base is None) == (problem.base is None)

    def nearest(self, q: Array, v: Array, around: float | None = None) -> tuple[float, float]:
        """Time at which the last motion is nearest to a state [s], and its distance there.

        The distance is the largest over the joints of position differences per range of the motion
        (at least 0.1 rad or m) and of rate differences per velocity limit.

        Args:
            q, v: Joint coordinates and rates, shape (n,) each [rad or m, s].
            around: Time to start from [s]; None searches the whole motion.
        """
        motion = self.motion
        if around is not None:
            t = float(np.clip(around, 0.0, motion.duration))
            return t, self._distance(q, v, np.array([t]))[0]
        steps = np.diff(motion.times)[:, None] * (np.arange(SAMPLES) / SAMPLES)
        times = np.append((motion.times[:-1, None] + steps).ravel(), motion.duration)
        distances = self._distance(q, v, times)
        best = int(np.argmin(distances))
        low, high = times[max(best - 1, 0)], times[min(best + 1, len(times) - 1)]
        for _ in range(FINER):
            finer = np.linspace(low, high, 2 * SAMPLES + 1)
            distances = self._distance(q, v, finer)
            best = int(np.argmin(distances))
            low, high = finer[max(best - 1, 0)], finer[min(best + 1, len(finer) - 1)]
        return float(finer[best]), float(distances[best])

    def _distance(self, q: Array, v: Array, times: Array) -> Array:
        at_q, at_v, _ = self.motion(times)
        reach = np.maximum(np.ptp(self.motion.positions, axis=0), 0.1)
        off = np.abs(at_q - q) / reach, np.abs(at_v - v) / self.problem.machine.limits.velocity
        return np.asarray(np.maximum(*off).max(axis=1))

    def remainder(self, at: float) -> Remainder:
        """Remainder of the motion from a time on [s], in the coordinates of the planner."""
        grid, controls, duration, rows, excess = self._whole()
        left = duration - at
        s = (grid.nodes * duration - at) / left
        k = int(np.searchsorted(s, 1e-9, side="right")) - 1
        nodes = np.append(0.0, s[k + 1 :])
        nodes[-1] = 1.0
        kept = controls[k:] * (left / duration) ** 2
        passed = -s[k] / (s[k + 1] - s[k])
        kept[0, 0] += passed * (kept[0, 1] - kept[0, 0])
        cut = Grid(nodes, uniform=False)
        if rows is not None:
            # a multiplier is that of time itself, times the interval's share of the duration
            share = (cut.steps / grid.steps[k:])[:, None]
            rows = rows[0][k:] * share, rows[1][:, k:] * share
        return Remainder(cut, kept, left, rows, None if excess is None else excess[k:])

    def _whole(
        self,
    ) -> tuple[Grid, Array, float, tuple[Array, Array] | None, Array | None]:
        """Grid, controls, duration, multipliers and excess of the whole motion, see `Remainder`."""
        found = self.candidate
        if found is None:
            return *self._of_motion(), None, None
        program, z = found.program, found.result.z
        N, count = program.grid.size, program.nonlinear
        sides = 2 * ENDS * program.n * N
        of_controls = z[count : count + sides].reshape(2, N, -1)
        rows, excess = (z[:count].reshape(N, -1), of_controls), found.result.excess
        if excess is not None:
            excess = excess.reshape(N, -1)
        return program.grid, found.controls, found.duration, rows, excess

    def _of_motion(self) -> tuple[Grid, Array, float]:
        motion, duration = self.motion, self.motion.duration
        joints = np.stack([motion.accelerations, motion.end_accelerations], axis=1)
        coordinates = self.problem.coordinates
        if not coordinates.is_identity:
            joints = joints @ np.linalg.pinv(coordinates.G).T
        controls = duration**2 * joints
        if (base := motion.base) is not None:
            last = base.accelerations + np.diff(base.times)[:, None] * base.jerks
            of_base = np.stack([base.accelerations, last], axis=1)
            controls = np.concatenate([controls, duration**2 * of_base], axis=2)
        return Grid(motion.times / duration, uniform=False), controls, duration

"""Paths of poses in which the machine stands at rest, and joint values that no such pose has.

They tell a search that has failed whether a slow motion may still exist. All of it is heuristic and
seeded: a path may be missed, and a barrier is a value at which no pose was found, not a proof.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.mechanics.wrench import WRENCH
from zmp_sqp.planning.search.task import Task

__all__ = ["Barrier", "StillPoses"]

SPREAD = np.pi  # [rad or m] beyond start and goal, for joints without position limits
FAR = 100.0  # [rad or m] position limits of this size or more stand for none
SAMPLES = 2000  # random poses that a barrier is looked for among
VALUES = 12  # of a joint between start and goal, at which poses are looked for
SHORT = 0.05  # of its range: a joint that moves less has no barrier
ROUNDS, BEST, OFFSPRING = 12, 20, 10  # of the search for the best pose at one joint value
SHRINKING = 0.75  # of its steps per round
STEP = 0.12  # longest step of a tree, of the diagonal of a cube with sides of all joint ranges
FINE = 0.02  # distance of the poses that are looked at on the way, likewise
SHORTCUTS = 150  # attempts to shorten a path
# random poses at once among which targets are found. With targets that stand, 12 of 12 paths of a
# UR3 on its own base take 47 ms in the median and 0.5 s at most; with any targets 2 of 12 take more
# than 200 000 poses
BATCH = 500
TOWARDS = 0.1  # share of samples that are the other tree's root


@dataclass(frozen=True, slots=True)
class Barrier:
    """Value that a joint has to pass, at which no pose was found that keeps the margin at rest.

    Attributes:
        joint: Index of the joint.
        value: Its position [rad or m].
        outside: How far the ZMP is out at best, beyond the margin [m].
    """

    joint: int
    value: float
    outside: float


class StillPoses:
    """Poses of a machine that stands at rest, where the ZMP keeps the margin at all corners."""

    def __init__(self, task: Task, *, seed: int = 0) -> None:
        """Ranges of the joints: their limits, or half a turn beyond start and goal."""
        self.task, self.rng = task, np.random.default_rng(seed)
        self.start, self.goal = task.start.q, task.goal.q
        bounds = task.bounds
        low, high = np.minimum(self.start, self.goal), np.maximum(self.start, self.goal)
        given = [np.abs(bounds.position_lower) < FAR, np.abs(bounds.position_upper) < FAR]
        self.low = np.where(given[0], bounds.position_lower, low - SPREAD)
        self.high = np.where(given[1], bounds.position_upper, high + SPREAD)
        # + 0.0: numpy's generators take an upper end of -0.0 for less than a lower end of 0.0
        self.low, self.high = np.minimum(self.low, low) + 0.0, np.maximum(self.high, high) + 0.0
        self.range = np.maximum(self.high - self.low, 1e-9)
        self.evaluated = 0  # poses looked at so far
        self._standing: list[Array] = []  # targets of the trees

    def outside(self, q: Array) -> Array:
        """Violation of the margin at rest, shape (K,) [m]; infinite where the machine is off."""
        self.evaluated += len(q)
        constraints, still = self.task.constraints, np.zeros_like(q)
        if constraints.models is None:
            efforts = constraints.corners[0].model.efforts(q, still, still, 1.0)[None]
        else:
            efforts = constraints.models.efforts(q, still, still, 1.0)
        found = np.full(len(q), -np.inf)
        for corner, wrench in zip(constraints.corners, efforts[:, :, :WRENCH], strict=True):
            for rows in corner.tip_over:
                found = np.maximum(found, rows.outside(wrench))
            found[wrench[:, 2] <= 0.0] = np.inf
        return found

    # --- barriers ---------------------------------------------------------------------------

    def barrier(self) -> Barrier | None:
        """The worst value that some joint has to pass, or None where all have a pose."""
        q = self.rng.uniform(self.low, self.high, (SAMPLES, len(self.range)))
        worst: Barrier | None = None
        for joint in np.flatnonzero(np.abs(self.goal - self.start) > SHORT * self.range):
            for value in np.linspace(self.start[joint], self.goal[joint], VALUES + 2)[1:-1]:
                best = self._best_at(q, int(joint), float(value))
                if best > 0.0 and (worst is None or best > worst.outside):
                    worst = Barrier(int(joint), float(value), best)
        return worst

    def _best_at(self, samples: Array, joint: int, value: float) -> float:
        """Least violation that an evolutionary search finds with a joint at a value [m].

        It ends at the first pose that keeps the margin.
        """
        near = np.argsort(np.abs(samples[:, joint] - value))[: SAMPLES // VALUES]
        q = samples[near].copy()
        q[:, joint] = value
        found, step = self.outside(q), 0.2 * self.range
        for _ in range(ROUNDS):
            if found.min() <= 0.0:
                break
            best = np.argsort(found)[:BEST]
            parents = np.repeat(q[best], OFFSPRING, axis=0)
            sizes = self.rng.choice([1.0, 0.1], (len(parents), 1))
            children = parents + sizes * step * self.rng.normal(size=parents.shape)
            children = np.clip(children, self.low, self.high)
            children[:, joint] = value
            q = np.concatenate([q[best], children])
            found = np.concatenate([found[best], self.outside(children)])
            step = SHRINKING * step
        return float(found.min())

    # --- paths ------------------------------------------------------------------------------

    def path(self, most: int, is_late: Callable[[], bool]) -> Array | None:
        """Corners of a path from start to goal, shape (L, n); None if none was found.

        RRT-Connect (Kuffner & LaValle 2000): two trees of poses grow from start and goal towards
        random poses that stand and towards each other.

        Args:
            most: Number of poses to look at, after which the search ends.
            is_late: Whether the search has to end now.
        """
        if self.outside(np.vstack([self.start, self.goal])).max() > 0.0:
            return None
        trees = [_Tree(self.start, self.range), _Tree(self.goal, self.range)]
        until, turn = self.evaluated + most, 0
        while self.evaluated < until and not is_late():
            tree, other = trees[turn], trees[1 - turn]
            turn = 1 - turn
            towards = self.rng.random() < TOWARDS
            target = other.poses[0] if towards else self._target()
            reached = self._grown(tree, target)
            met = self._grown(other, tree.poses[reached])
            if np.array_equal(other.poses[met], tree.poses[reached]):
                ways = [tree.way_to(reached), other.way_to(met)]
                first, second = ways if turn == 1 else ways[::-1]
                return self._shortened(np.vstack([first, second[::-1][1:]]))
        return None

    def _target(self) -> Array:
        """Random pose, which stands if there is one among the next `BATCH` poses."""
        if not self._standing:
            q = self.rng.uniform(self.low, self.high, (BATCH, len(self.range)))
            standing = q[self.outside(q) <= 0.0]
            self._standing = list(standing if len(standing) else q[:1])
        return self._standing.pop()

    def _grown(self, tree: _Tree, target: Array) -> int:
        """Index of the last pose of a tree that has grown straight towards a target."""
        last = tree.nearest(target)
        ways = self._ways(tree.poses[last], target)
        clear = self.outside(ways) <= 0.0
        kept = len(ways) if clear.all() else int(np.argmin(clear))
        each = max(int(STEP / FINE), 1)
        for k in [*range(each, kept, each), kept]:
            if k > 0:
                last = tree.add(ways[k - 1], last)
        return last

    def _ways(self, start: Array, end: Array) -> Array:
        """Poses on the straight line, at most `FINE` apart, without its start, shape (K, n)."""
        length = np.linalg.norm((end - start) / self.range) / np.sqrt(len(start))
        count = max(int(np.ceil(length / FINE)), 1)
        share = np.arange(1, count + 1)[:, None] / count
        ways = start + share * (end - start)
        ways[-1] = end
        return np.asarray(ways)

    def _shortened(self, path: Array) -> Array:
        """The path with straight lines in place of detours, where poses on them stand."""
        for _ in range(SHORTCUTS):
            if len(path) < 3:
                break
            i, j = sorted(self.rng.choice(len(path), 2, replace=False))
            if j > i + 1 and self.outside(self._ways(path[i], path[j])).max() <= 0.0:
                path = np.vstack([path[: i + 1], path[j:]])
        return path


class _Tree:
    """Poses that are connected with a root by straight lines."""

    def __init__(self, root: Array, scale: Array) -> None:
        self.scale, self.count = scale, 1
        self._poses, self._scaled = (np.empty((64, len(root))) for _ in range(2))
        self._poses[0], self._scaled[0] = root, root / scale
        self.parents = [-1]

    @property
    def poses(self) -> Array:
        """All poses, shape (count, n)."""
        return self._poses[: self.count]

    def nearest(self, target: Array) -> int:
        """Index of the nearest pose, in shares of the joint ranges."""
        apart = self._scaled[: self.count] - target / self.scale
        return int(np.argmin(np.einsum("ij,ij->i", apart, apart)))

    def add(self, pose: Array, parent: int) -> int:
        """Index of a new pose."""
        if self.count == len(self._poses):
            self._poses, self._scaled = (
                np.vstack([part, np.empty_like(part)]) for part in (self._poses, self._scaled)
            )
        self._poses[self.count], self._scaled[self.count] = pose, pose / self.scale
        self.parents.append(parent)
        self.count += 1
        return self.count - 1

    def way_to(self, index: int) -> Array:
        """Poses from the root to a pose, shape (L, n)."""
        ways = []
        while index >= 0:
            ways.append(self._poses[index])
            index = self.parents[index]
        return np.array(ways[::-1])

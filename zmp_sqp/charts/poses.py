"""Poses of an arm that bring its lift point to a radius and a height."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.charts.arm import Arm
from zmp_sqp.errors import ProblemError

__all__ = ["Poses", "reach_along", "search_poses"]

SAMPLES = 1500  # random poses from which searches start
SEEDS = 12  # of them per point: the nearest, and as many at random
LANES = 4  # of searches per point that do not know of each other; the best of them goes on
ITERATIONS = 14  # of Newton's method
FARTHEST = 0.25  # of the reach: a point farther from every random pose is out of reach
TOLERANCE = 1e-8  # of the reach: distance at which a point counts as reached
DIFFERENCE = 1e-6  # [rad or m] step of the differences that stand for the Jacobian
LONGEST = 0.4  # [rad or m] longest step of a joint
RANK = 1e-4  # singular values below this share of the largest count as zero
SWEEPS = 200  # of the search among the poses of one point, at most
SHRINK = 0.7  # of its step where a direction does not help
WIDEST = 0.3  # [rad or m] its first step; it ends at `FINEST`
FINEST = 2e-3
GAIN = 1e-6  # relative gain below which a pose is no better

Score = Callable[[Array], Array]


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """Arm with the attitude that its lift point keeps, and random poses of it.

    Attributes:
        arm: The arm.
        vertical: The root's z axis in the axes of the frame, shape (3,), which every pose keeps;
            None leaves the attitude free.
        samples: Random poses with that attitude, slew joint at the neutral pose, shape (S, n).
        points: Their radius and height, shape (S, 2) [m].
        reach: Largest distance of these from the foot of the slew axis [m].
    """

    arm: Arm
    vertical: Array | None
    samples: Array
    points: Array
    reach: float

    @classmethod
    def of(cls, arm: Arm, held: Array | None) -> Poses:
        """Sample the poses of an arm.

        Args:
            arm: The arm.
            held: Joint coordinates whose attitude to the vertical is kept, shape (n,); None leaves
                it free.

        Raises:
            ProblemError: No pose within the limits has the attitude.
        """
        vertical = None if held is None else arm.placements(held[None])[1][0]
        neutral = arm.neutral if held is None else held
        lower, upper = arm.box
        samples = np.tile(neutral, (SAMPLES, 1))
        samples[:, arm.slew] = arm.neutral[arm.slew]
        shares = np.random.default_rng(0).random((SAMPLES, len(arm.joints)))
        samples[:, arm.joints] = lower[arm.joints] + shares * (upper - lower)[arm.joints]
        everything = cls(arm, vertical, samples, np.empty((0, 2)), 1.0)
        if vertical is not None:
            samples, reached = everything.project(samples, np.empty((SAMPLES, 0)))
            samples = samples[reached]
            if not len(samples):
                raise ProblemError(
                    f"no pose within the joint limits keeps the attitude of frame {arm.frame!r}: "
                    "leave it free"
                )
        points = arm.radius_and_height(arm.placements(samples)[0])
        return cls(arm, vertical, samples, points, float(np.linalg.norm(points, axis=1).max()))

    def project(self, q: Array, targets: Array) -> tuple[Array, Array]:
        """Nearby poses at given points, by Newton's method within the joint limits.

        Args:
            q: Poses to start from, shape (P, n).
            targets: Radius and height, shape (P, 2) [m]; shape (P, 0) asks only for the attitude.

        Returns:
            Poses, shape (P, n), and which of them are there, shape (P,).
        """
        q, joints = q.copy(), self.arm.joints
        lower, upper = (end[joints] for end in self.arm.box)
        targets = self._with_attitude(targets)
        tolerance = TOLERANCE * self.reach
        left = np.arange(len(q))
        reached = np.zeros(len(q), dtype=bool)
        for _ in range(ITERATIONS):
            values = self._values(q[left], targets.shape[1])
            residual = targets[left] - values
            done = np.abs(residual).max(axis=1, initial=0.0) <= tolerance
            reached[left[done]] = True
            left, residual, values = left[~done], residual[~done], values[~done]
            if not len(left) or not len(joints):
                break
            jacobian = self._jacobian(q[left], values)
            now = q[np.ix_(left, joints)]
            q[np.ix_(left, joints)] = _bounded_step(now, jacobian, residual, lower, upper)
        return q, reached

    def tangents(self, q: Array) -> Array:
        """Directions that keep the point to first order: projector, shape (P, A, A)."""
        values = self._values(q, 2 if self.vertical is None else 5)
        jacobian = self._jacobian(q, values)
        inverse = np.linalg.pinv(jacobian, rcond=RANK)
        return np.asarray(np.eye(len(self.arm.joints)) - inverse @ jacobian)

    def _with_attitude(self, targets: Array) -> Array:
        if self.vertical is None:
            return targets
        return np.hstack([targets, np.tile(self.reach * self.vertical, (len(targets), 1))])

    def _values(self, q: Array, size: int) -> Array:
        """Radius and height (unless only the attitude is asked for), and attitude, (P, size)."""
        points, verticals = self.arm.placements(q)
        values = [self.arm.radius_and_height(points)] if size in (2, 5) else []
        return np.hstack([*values, self.reach * verticals] if size >= 3 else values)

    def _jacobian(self, q: Array, values: Array) -> Array:
        """Differences of the values by the joints of the arm, shape (P, size, A)."""
        columns = []
        for joint in self.arm.joints:
            moved = q.copy()
            moved[:, joint] += DIFFERENCE
            columns.append((self._values(moved, values.shape[1]) - values) / DIFFERENCE)
        return np.stack(columns, axis=-1)


def _bounded_step(q: Array, jacobian: Array, residual: Array, lower: Array, upper: Array) -> Array:
    """Gauss-Newton step that leaves joints at a limit alone if it would lead beyond."""
    free = np.ones(q.shape, dtype=bool)
    for _ in range(2):
        inverse = np.linalg.pinv(jacobian * free[:, None, :], rcond=RANK)
        step = np.einsum("pak,pk->pa", inverse, residual)
        free &= ~((q <= lower) & (step < 0.0) | (q >= upper) & (step > 0.0))
    step = np.where(free, step, 0.0)
    longest = np.abs(step).max(axis=1, keepdims=True)
    step *= np.minimum(1.0, LONGEST / np.maximum(longest, 1e-12))
    return np.asarray(np.clip(q + step, lower, upper))


def search_poses(poses: Poses, targets: Array, score: Score) -> tuple[Array, Array]:
    """Best poses found at given points.

    Newton's method starts from random poses; the best of what it reaches is then improved among the
    poses of the same point, and by starting from the poses of neighbouring points. A better pose
    may exist: the search is local. It is the same every time.

    Args:
        poses: The arm.
        targets: Radius and height, shape (P, 2) [m].
        score: Value of poses (K, n), shape (K,), the higher the better.

    Returns:
        Poses, shape (P, n), NaN where none was found; and which were found, shape (P,).
    """
    count, random = len(targets), np.random.default_rng(0)
    distance = np.linalg.norm(poses.points[None] - targets[:, None], axis=2)  # (P, S)
    near = np.flatnonzero(distance.min(axis=1, initial=np.inf) <= FARTHEST * poses.reach)
    nearest = np.argsort(distance[near], axis=1)[:, :SEEDS]
    others = random.integers(len(poses.samples), size=(len(near), SEEDS))
    seeds = np.hstack([nearest, others])
    rows = LANES * near[:, None] + np.arange(seeds.shape[1]) % LANES  # lanes of a point in turn
    lanes = np.repeat(targets, LANES, axis=0)
    found, reached = poses.project(poses.samples[seeds.ravel()], lanes[rows.ravel()])
    best = np.full((LANES * count, poses.arm.machine.size), np.nan)
    values = np.full(LANES * count, -np.inf)
    _keep_better(best, values, rows.ravel()[reached], found[reached], score)
    _improve(poses, lanes, score, best, values)
    lead = values.reshape(count, LANES).argmax(axis=1) + LANES * np.arange(count)
    best, values = best[lead], values[lead]
    for _ in range(2):
        _from_neighbours(poses, targets, score, best, values)
        _improve(poses, targets, score, best, values)
    return best, np.isfinite(values)


def _keep_better(best: Array, values: Array, rows: Array, q: Array, score: Score) -> None:
    """Put candidates (K, n) for the points `rows` (K,) into `best` where they score higher."""
    if not len(q):
        return
    scores = score(q)
    for k in np.argsort(scores):  # the highest last
        row = rows[k]
        if scores[k] > values[row] + GAIN * abs(scores[k]) or not np.isfinite(values[row]):
            best[row], values[row] = q[k], scores[k]


def _improve(poses: Poses, targets: Array, score: Score, best: Array, values: Array) -> None:
    """Pattern search along random directions that keep the point, with steps that shrink."""
    rows = np.flatnonzero(np.isfinite(values))
    joints, random = poses.arm.joints, np.random.default_rng(1)
    if len(joints) <= 2 or not len(rows):
        return
    steps = np.full(len(values), WIDEST)
    shrink = SHRINK ** (1.0 / max(1, len(joints) - 3))  # more directions are tried where there are
    for _ in range(SWEEPS):
        rows = rows[steps[rows] > FINEST]
        if not len(rows):
            return
        before = values.copy()
        directions = random.standard_normal((len(rows), len(joints), 1))
        along = (poses.tangents(best[rows]) @ directions)[..., 0]
        length = np.linalg.norm(along, axis=1, keepdims=True)
        rows, along, length = (part[length[:, 0] > 1e-3] for part in (rows, along, length))
        both = np.tile(rows, 2)  # a step forwards and one backwards
        step, trial = steps[rows, None] * along / length, best[both]
        trial[:, joints] += np.vstack([step, -step])
        found, reached = poses.project(_clipped(poses.arm, trial), targets[both])
        _keep_better(best, values, both[reached], found[reached], score)
        steps[rows] *= np.where(values[rows] > before[rows], 1.3, shrink)


def _clipped(arm: Arm, q: Array) -> Array:
    lower, upper = arm.box
    clipped = q.copy()
    clipped[:, arm.joints] = np.clip(q[:, arm.joints], lower[arm.joints], upper[arm.joints])
    return clipped


def _from_neighbours(
    poses: Poses, targets: Array, score: Score, best: Array, values: Array
) -> None:
    """Start again from the poses of the four nearest points."""
    known = np.flatnonzero(np.isfinite(values))
    if len(known) < 2:
        return
    distance = np.linalg.norm(targets[known][None] - targets[:, None], axis=2)  # (P, known)
    nearest = known[np.argsort(distance, axis=1)[:, : min(5, len(known))]]  # itself among them
    rows = np.repeat(np.arange(len(targets)), nearest.shape[1])
    found, reached = poses.project(best[nearest.ravel()], targets[rows])
    _keep_better(best, values, rows[reached], found[reached], score)


def reach_along(poses: Poses, heights: Array, q: Array) -> tuple[Array, Array]:
    """Largest radius at given heights, by continuation outwards from poses at these heights.

    Args:
        poses: The arm.
        heights: Shape (R,) [m].
        q: Pose at each height, shape (R, n); NaN where there is none.

    Returns:
        Radii, shape (R,) [m], NaN where there is no pose; and poses there, shape (R, n).
    """
    q = q.copy()
    known = np.flatnonzero(np.isfinite(q).all(axis=1))
    radii = np.full(len(heights), np.nan)
    if not len(known):
        return radii, q
    radii[known] = poses.arm.radius_and_height(poses.arm.placements(q[known])[0])[:, 0]
    steps = np.full(len(heights), 0.05 * poses.reach)
    while len(rows := known[steps[known] > 1e-4 * poses.reach]):
        further = radii[rows] + steps[rows]
        found, reached = poses.project(q[rows], np.column_stack([further, heights[rows]]))
        q[rows[reached]], radii[rows[reached]] = found[reached], further[reached]
        steps[rows] *= np.where(reached, 1.3, 0.5)
    return radii, q

"""Seeded problems without a safe motion: the slew has to pass where the machine tips over."""

from __future__ import annotations

import numpy as np

import zmp_sqp as zs
from benchmarks.problems.scene import FOOTPRINT, Scene, Tree

__all__ = ["blocked_problem"]

ROOM = 0.1  # [rad] that the joints beyond the slew may move to either side of their start
OUTSIDE = -0.15  # [m] static margin on the way, in every corner of that room
STANDING = 0.03  # [m] static margin of start and goal
HEADINGS = 73  # slew angles looked at over one turn
STEEPEST = 0.45  # [rad] of roll and pitch
PAYLOAD = (2500.0, 6500.0)  # [kg]


def blocked_problem(seed: int) -> zs.Problem:
    """A slew from one side of a heading to the other at which the machine tips over.

    The arm may change its pose only a little, and none of the poses that it can take, at the
    corners and in the middle of its room, stands at some heading in between. Full turns are
    excluded by the slew's limits, so that there is no motion at all (but for poses between the
    corners, which the depth of the violation makes up for).
    """
    rng = np.random.default_rng([31, seed])
    headings = np.linspace(-np.pi, np.pi, HEADINGS)
    while True:
        roll, pitch = rng.uniform(-STEEPEST, STEEPEST, 2)
        tree = Tree(rng.uniform(*PAYLOAD))
        scene = Scene("feller_buncher", FOOTPRINT, tree, roll=roll, pitch=pitch)
        machine = scene.load()
        lower, upper = machine.limits.position_lower[1:], machine.limits.position_upper[1:]
        arm = rng.uniform(lower, upper)
        low, high = np.maximum(arm - ROOM, lower), np.minimum(arm + ROOM, upper)

        def margins(
            pose: np.ndarray, machine: zs.Machine = machine, ground: zs.Slope = scene.ground
        ) -> np.ndarray:
            q = np.column_stack([headings, np.tile(pose, (HEADINGS, 1))])
            return zs.stability_margin(machine, q, 0.0 * q, 0.0 * q, ground)

        middle = margins(arm)
        if middle.min() > OUTSIDE:
            continue
        sides = [(a, 0.5 * (a + b), b) for a, b in zip(low, high, strict=True)]
        poses = np.array(np.meshgrid(*sides)).reshape(len(low), -1).T
        best = np.max([margins(pose) for pose in poses], axis=0)
        bad, good = np.flatnonzero(best < OUTSIDE), np.flatnonzero(middle > STANDING)
        if not len(bad):
            continue
        left, right = good[good < bad.min()], good[good > bad.max()]
        if not (len(left) and len(right)):
            continue
        limits = {
            "position_lower": np.append(-np.pi, low),
            "position_upper": np.append(np.pi, high),
        }
        limited = Scene("feller_buncher", FOOTPRINT, tree, roll=roll, pitch=pitch, limits=limits)
        ends = [np.append(headings[rng.choice(side)], arm) for side in (left, right)]
        if rng.uniform() < 0.5:
            ends.reverse()
        try:
            return limited.problem(*ends)
        except zs.ProblemError:
            continue

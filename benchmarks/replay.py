"""Replays motions of seeded random problems in MuJoCo and compares its verdict with the sign of our certified margin.

    python -m benchmarks.replay [--count 50] [--hard] [--json FILE]

Each problem (benchmarks/problems/arm.py) gives three motions: the planned one, the phase plane's, and that
one slowed down by a random factor. The margin says that the zero moment point leaves the support
polygon; MuJoCo, that a track lifts by more than 5 mm. Where they differ further than 5 cm from an
edge, a third opinion is asked: a rigid body that rocks about one edge under the tipping moment of
our wrench, and comes down again if the moment lasts too short,

    I theta'' = (e . p - b) f_z,  theta >= 0,  lift = theta * (width of the polygon across that
    edge)

The exit code is 1 where a motion with a positive margin tips over, or a difference is not explained
that way.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

import zmp_sqp as zs
from benchmarks.harness import console, print_table, save_json
from benchmarks.problems.arm import HARD, ORDINARY, Recipe, random_problem
from zmp_sqp.arrays import Array
from zmp_sqp.mechanics import ground_reaction

LIFTED = 5e-3  # [m] the verdict: a track edge lifts by more
NEAR = 0.05  # [m] from the edge, where verdicts may differ
UNLOADED = 5e-5  # [m] a track that lifts at all: fifty times what the contacts give way
SLOWER = (1.05, 2.5)  # factors of the slowed motion's duration
HOLD = 1.0  # [s] at rest after the motion, in which a track that is up comes down
INSTANTS = 5000  # of the rocking body
CAPSIZED = 0.3  # [rad] the rocking body does not come back
COLUMNS = (
    "seed",
    "motion",
    "duration",
    "margin",
    "lift",
    "rocking",
    "least_load",
    "outside",
    "slide",
    "verdict",
)


def slowed(trajectory: zs.Trajectory, factor: float) -> zs.Trajectory:
    """The same path, slower by a factor."""
    return zs.Trajectory(
        trajectory.joint_names,
        factor * trajectory.times,
        trajectory.positions,
        trajectory.velocities / factor,
        trajectory.accelerations / factor**2,
        trajectory.jerks / factor**3,
    )


def rocking(
    machine: zs.Machine, trajectory: zs.Trajectory, ground: zs.Slope
) -> tuple[float, float]:
    """Largest lift [m] of a corner of the rocking body, and longest time [s] that the ZMP is outside of one edge."""
    support = machine.support
    times = np.linspace(0.0, trajectory.duration + HOLD, INSTANTS)
    moving = times < trajectory.duration
    q, v, a = trajectory(np.minimum(times, trajectory.duration))
    v, a = v * moving[:, None], a * moving[:, None]
    still = np.concatenate([-ground.gravity(), np.zeros(3)])
    # (K, V)
    moments = ground_reaction(machine, q, v, a, root_acceleration=still) @ support.wrench_rows().T
    some = np.linspace(0, INSTANTS - 1, 50).astype(int)
    # (50, V)
    inertias = np.array([edge_inertias(machine, state) for state in machine.configuration(q[some])])
    # (V, V), of each corner from each edge
    inside = support.offsets[:, None] - support.normals @ support.vertices.T
    h, outside, angles = times[1], 0.0, np.zeros_like(moments)
    for edge, moment in enumerate(moments.T):
        angle = rate = since = 0.0
        for k, push in enumerate(moment / np.interp(np.arange(INSTANTS), some, inertias[:, edge])):
            since = since + h if push > 0.0 else 0.0
            outside = max(outside, since)
            rate += h * push
            angle += h * rate
            if angle <= 0.0:
                angle = rate = 0.0
            angles[k:, edge] = angle
            if angle > CAPSIZED:
                break
    return float((angles @ inside).max()), outside


def edge_inertias(machine: zs.Machine, configuration: Array) -> Array:
    """Inertia of the whole machine about each edge of its support polygon, shape (V,) [kg m^2]."""
    support, model = machine.support, machine.model
    upper = np.triu(pin.crba(model, model.createData(), configuration)[:6, :6])
    inertia = upper + np.triu(upper, 1).T
    points = np.column_stack([support.vertices, np.full(len(support.vertices), support.height)])
    axes = np.roll(points, -1, axis=0) - points
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    twists = np.hstack([np.cross(points, axes), axes])  # of the root, for a turn about the edge
    return np.einsum("vi,ij,vj->v", twists, inertia, twists)


def judge(margin: float, lift: float, rocks: float) -> str:
    """Whether both agree; else why not."""
    if (margin < 0.0) == (lift > LIFTED):
        return "agree"
    if abs(margin) < NEAR:
        return "near the edge"
    if margin < 0.0 and lift > UNLOADED and rocks < LIFTED:
        return "short excursion"
    return "unexplained"


def run(seed: int, recipe: Recipe) -> list[dict[str, Any]]:
    """The three motions of a problem."""
    problem = random_problem(seed, recipe).problem
    machine, ground = problem.machine, problem.ground
    baseline = zs.phase_plane(machine, problem.start, problem.goal)
    factor = np.random.default_rng([5, seed]).uniform(*SLOWER)
    motions = {"phase plane": baseline, "slowed": slowed(baseline, factor)}
    found = zs.plan(problem)
    if found.success:
        motions = {"planned": found.trajectory, **motions}
    rows = []
    for name, motion in motions.items():
        margin = zs.certify(machine, motion, ground).margin
        replay = zs.replay(machine, motion, ground, hold=HOLD)
        rocks, outside = rocking(machine, motion, ground)
        rows.append(
            {
                "seed": seed,
                "motion": name,
                "duration": motion.duration,
                "margin": margin,
                "lift": replay.lift,
                "rocking": rocks,
                "least_load": replay.least_edge_load,
                "outside": outside,
                "slide": replay.slide,
                "verdict": judge(margin, replay.lift, rocks),
            }
        )
    return rows


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--count", type=int, default=50, help="how many problems: seeds 0, 1, ... (default 50)"
    )
    parser.add_argument(
        "--hard", action="store_true", help="heavier payloads, steeper slopes, poses near the edge"
    )
    parser.add_argument("--json", type=Path, help="write every replay's result here")
    options = parser.parse_args()
    recipe = HARD if options.hard else ORDINARY

    started = time.perf_counter()
    rows = [row for seed in range(options.count) for row in run(seed, recipe)]
    counts: dict[str, dict[str, int]] = {}
    for row in rows:
        kind = counts.setdefault(row["motion"], {})
        for key in (
            row["verdict"],
            "safe" if row["margin"] >= 0.0 else "unsafe",
            "tips" if row["lift"] > LIFTED else "",
        ):
            kind[key] = kind.get(key, 0) + 1
    shown = ("safe", "unsafe", "tips", "agree", "near the edge", "short excursion", "unexplained")
    print_table(
        f"{len(rows)} motions of {options.count} {recipe.name} problems, {time.perf_counter() - started:.0f} s",
        ("motion", *shown),
        [[name, *(kind.get(key, 0) for key in shown)] for name, kind in counts.items()],
    )
    differing = [row for row in rows if row["verdict"] != "agree"]
    units = (
        "seed",
        "motion",
        "margin [m]",
        "lift [mm]",
        "rocking body [mm]",
        "outside [s]",
        "verdict",
    )
    print_table(
        "where they differ",
        units,
        [
            [
                str(r["seed"]),
                r["motion"],
                f"{r['margin']:+.4f}",
                f"{1e3 * r['lift']:.3f}",
                f"{1e3 * r['rocking']:.3f}",
                f"{r['outside']:.3f}",
                r["verdict"],
            ]
            for r in differing
        ],
    )
    lifting = sum((row["margin"] < 0.0) == (row["lift"] > UNLOADED) for row in rows)
    small = [
        row["rocking"] / row["lift"]
        for row in rows
        if row["margin"] < 0.0 and 2.0 * UNLOADED < row["lift"] < 4.0 * LIFTED
    ]
    wrong = sum(row["margin"] >= 0.0 and row["lift"] > LIFTED for row in rows)
    summary = {
        "recipe": recipe.name,
        "count": options.count,
        "motions": len(rows),
        "counts": counts,
        "positive_margin_that_tips": wrong,
        "agree_on_any_lift": lifting,
        "rocking_over_lift": [float(np.percentile(small, share)) for share in (10, 50, 90)]
        if small
        else None,
    }
    console.print(
        f"{wrong} motions with a positive margin tip over; margin and lift of more than {1e3 * UNLOADED:.2f} mm "
        f"agree in {lifting} of {len(rows)}; rocking body over MuJoCo, lifts of 0.1 to 20 mm, 10, 50 and 90 %: "
        f"{summary['rocking_over_lift']}"
    )
    if options.json is not None:
        table = [
            [round(row[key], 7) if isinstance(row[key], float) else row[key] for key in COLUMNS]
            for row in rows
        ]
        save_json(options.json, {**summary, "columns": COLUMNS}, rows=table)
    return 1 if wrong or any(row["verdict"] == "unexplained" for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())

"""Replay motions in MuJoCo and compare what happens with the sign of the certified margin.

    python -m benchmarks.replay [--count 50] [--first 0] [--hard] [--json FILE]

Each problem of benchmarks/problems/arm.py gives three motions: the planned one, that of the
phase-plane method, and the latter slowed down by a random factor. A negative margin means that the
zero moment point leaves the support polygon; MuJoCo's verdict is whether a track lifts by more than
5 mm. The ZMP may leave the polygon so briefly that the machine barely lifts. Where the verdicts
differ and the margin is more than 5 cm from zero, a third model decides whether that is the reason:
a rigid body that rocks about one edge e of the polygon, driven by the moment of the ground reaction
about that edge, and hitting the ground without bouncing,

    I theta'' = (e . p - b) f_z,  theta >= 0,  lift = theta * (width of the polygon across the edge)

The exit code is 1 where a motion with a positive margin tips over, or where the third model does
not explain a difference.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

import zmp_sqp as zs
from benchmarks.harness import (
    Row,
    benchmark_parser,
    console,
    exit_code,
    print_table,
    save_json,
    seeds,
    timed,
)
from benchmarks.problems.arm import HARD, ORDINARY, Recipe, random_problem
from zmp_sqp.arrays import Array
from zmp_sqp.mechanics import ground_reaction

LIFTED = 5e-3  # [m] MuJoCo's verdict is "tips" where a track lifts by more
NEAR = 0.05  # [m] verdicts may differ where the margin is closer to zero
UNLOADED = 5e-5  # [m] a lift above this is one: contacts give way by a fiftieth of it
SLOWER = (1.05, 2.5)  # range of the factor by which a motion is slowed down
HOLD = 1.0  # [s] at rest after the motion, for a lifted track to come down
INSTANTS = 5000  # time steps of the rocking body
CAPSIZED = 0.3  # [rad] from here on the rocking body does not come back
COUNTED = ("safe", "unsafe", "tips", "agree", "near the edge", "short excursion", "unexplained")
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
    """The same path in a longer time."""
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
    """Motion of the rocking body.

    Returns:
        Largest lift of a corner [m], and the longest time that the ZMP is beyond an edge [s].
    """
    support = machine.support
    times = np.linspace(0.0, trajectory.duration + HOLD, INSTANTS)
    moving = times < trajectory.duration
    q, v, a = trajectory(np.minimum(times, trajectory.duration))
    v, a = v * moving[:, None], a * moving[:, None]
    still = np.concatenate([-ground.gravity(), np.zeros(3)])
    # (K, V)
    moments = ground_reaction(machine, q, v, a, root_acceleration=still) @ support.wrench_rows().T
    # inertias vary slowly: interpolated between 50 instants
    some = np.linspace(0, INSTANTS - 1, 50).astype(int)
    # (50, V)
    inertias = np.array([edge_inertias(machine, state) for state in machine.configuration(q[some])])
    # distance of each corner from each edge, (V, V)
    distances = support.offsets[:, None] - support.normals @ support.vertices.T
    h, outside, angles = times[1], 0.0, np.zeros_like(moments)
    for edge, moment in enumerate(moments.T):
        angle = rate = since = 0.0
        inertia = np.interp(np.arange(INSTANTS), some, inertias[:, edge])
        for k, acceleration in enumerate(moment / inertia):
            since = since + h if acceleration > 0.0 else 0.0
            outside = max(outside, since)
            rate += h * acceleration
            angle += h * rate
            if angle <= 0.0:
                angle = rate = 0.0
            angles[k:, edge] = angle
            if angle > CAPSIZED:
                break
    return float((angles @ distances).max()), outside


def edge_inertias(machine: zs.Machine, configuration: Array) -> Array:
    """Inertia of the whole machine about each edge of its support polygon, shape (V,) [kg m^2]."""
    support, model = machine.support, machine.model
    upper = np.triu(pin.crba(model, model.createData(), configuration)[:6, :6])
    inertia = upper + np.triu(upper, 1).T
    points = np.column_stack([support.vertices, np.full(len(support.vertices), support.height)])
    axes = np.roll(points, -1, axis=0) - points
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    twists = np.hstack([np.cross(points, axes), axes])  # of the root, turning about each edge
    return np.einsum("vi,ij,vj->v", twists, inertia, twists)


def judge(margin: float, lift: float, rocks: float) -> str:
    """Whether certificate and MuJoCo agree; if not, the reason."""
    if (margin < 0.0) == (lift > LIFTED):
        return "agree"
    if abs(margin) < NEAR:
        return "near the edge"
    if margin < 0.0 and lift > UNLOADED and rocks < LIFTED:
        return "short excursion"
    return "unexplained"


def run(seed: int, recipe: Recipe) -> list[Row]:
    """Results of the three motions of a problem; two if no plan was found."""
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


def count_by_motion(rows: Sequence[Row]) -> dict[str, dict[str, int]]:
    """How often each kind of motion is safe, tips over, and agrees with MuJoCo."""
    counts: dict[str, dict[str, int]] = {}
    for row in rows:
        kind = counts.setdefault(row["motion"], dict.fromkeys(COUNTED, 0))
        kind[row["verdict"]] += 1
        kind["safe" if row["margin"] >= 0.0 else "unsafe"] += 1
        kind["tips"] += row["lift"] > LIFTED
    return counts


def summarise(rows: Sequence[Row]) -> dict[str, Any]:
    """The numbers of all rows that README and notes cite."""
    # small lifts, where the rocking body should lift as MuJoCo's does
    ratios = [
        row["rocking"] / row["lift"]
        for row in rows
        if row["margin"] < 0.0 and 2.0 * UNLOADED < row["lift"] < 4.0 * LIFTED
    ]
    return {
        "motions": len(rows),
        "counts": count_by_motion(rows),
        "positive_margin_that_tips": sum(
            row["margin"] >= 0.0 and row["lift"] > LIFTED for row in rows
        ),
        "agree_on_any_lift": sum((row["margin"] < 0.0) == (row["lift"] > UNLOADED) for row in rows),
        "rocking_over_lift": [float(np.percentile(ratios, share)) for share in (10, 50, 90)]
        if ratios
        else None,
    }


def print_differences(rows: Sequence[Row]) -> None:
    """Print the motions on which certificate and MuJoCo differ."""
    print_table(
        "where they differ",
        (
            "seed",
            "motion",
            "margin [m]",
            "lift [mm]",
            "rocking body [mm]",
            "outside [s]",
            "verdict",
        ),
        [
            [
                str(row["seed"]),
                row["motion"],
                f"{row['margin']:+.4f}",
                f"{1e3 * row['lift']:.3f}",
                f"{1e3 * row['rocking']:.3f}",
                f"{row['outside']:.3f}",
                row["verdict"],
            ]
            for row in rows
            if row["verdict"] != "agree"
        ],
    )


def main() -> int:
    parser = benchmark_parser(__doc__, count=50)
    parser.add_argument(
        "--hard", action="store_true", help="heavier payloads, steeper slopes, poses near the edge"
    )
    options = parser.parse_args()
    recipe = HARD if options.hard else ORDINARY

    rows, took = timed(lambda: [row for seed in seeds(options) for row in run(seed, recipe)])
    summary = summarise(rows)
    print_table(
        f"{len(rows)} motions of {options.count} {recipe.name} problems, {took.wall:.0f} s",
        ("motion", *COUNTED),
        [[name, *kind.values()] for name, kind in summary["counts"].items()],
    )
    print_differences(rows)
    wrong = summary["positive_margin_that_tips"]
    console.print(
        f"{wrong} motions with a positive margin tip over; margin and lift of more than "
        f"{1e3 * UNLOADED:.2f} mm agree in {summary['agree_on_any_lift']} of {len(rows)}; rocking "
        f"body over MuJoCo, lifts of 0.1 to 20 mm, 10, 50 and 90 %: {summary['rocking_over_lift']}"
    )
    if options.json is not None:
        content = {"recipe": recipe.name, "count": options.count, **summary}
        save_json(options.json, content, rows=rows, columns=COLUMNS, digits=7)
    unexplained = any(row["verdict"] == "unexplained" for row in rows)
    return exit_code(success=not wrong and not unexplained)


if __name__ == "__main__":
    sys.exit(main())

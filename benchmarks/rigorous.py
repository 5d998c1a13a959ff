"""Second opinion on plans and random motions: none false, and how far certificates are below it.

    python -m benchmarks.rigorous [--count 500] [--first 0] [--json FILE]

As many plans as --count says, of hard and ordinary problems, drives on slopes and over heightmaps,
and uncertain payloads in turn, and as many random motions of the shipped machines, standing and
driving, quintics and uncertain payloads among them. Of each:

- the certified margin is decided in ball arithmetic, and must not be refuted;
- a margin 1e-6 m above the enclosure's upper bound must be refuted;
- the certified margin plus 1e-3 m must not be confirmed, except where a payload box is uncertain,
  whose bounds between corners differ;
- joint limits and, where there are any, torque limits must get the certificate's verdict, unless
  their room is within rounding of zero.

Looseness is the rigorous lower bound of the least margin less the certified one. The exit code is 1
where a verdict is false, or any is undecided.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence

import numpy as np

import zmp_sqp as zs
from benchmarks.harness import (
    Row,
    benchmark_parser,
    console,
    distribution,
    exit_code,
    print_table,
    save_json,
    seeds,
    timed,
)
from benchmarks.problems.arm import HARD, ORDINARY, random_problem
from benchmarks.problems.driving import random_driving_problem
from benchmarks.problems.random_motions import RandomMotion, random_motion
from benchmarks.problems.terrain import random_drive_problem
from zmp_sqp.planning.proof.certificate import Certificate, certify_at
from zmp_sqp.rigorous import RigorousCheck, Verdict

UNCERTAIN = {
    "tipping_fraction": 0.9,
    "payload_uncertainty": 0.1,
    "payload_com_uncertainty": 0.1,
}
KINDS: tuple[tuple[str, Callable[[int], zs.Problem]], ...] = (
    ("hard", lambda seed: random_problem(seed, HARD).problem),
    ("drive", lambda seed: random_driving_problem(seed).problem),
    ("ordinary", lambda seed: random_problem(seed, ORDINARY).problem),
    ("uncertain", lambda seed: random_problem(seed, ORDINARY, **UNCERTAIN).problem),
    ("terrain", lambda seed: random_drive_problem(seed, over_terrain=True)),
)
BREAK, RAISE = 1e-6, 1e-3  # [m]
ANY = -1e3  # [m] margin that every motion keeps that does not lift off
COLUMNS = ("set", "seed", "corners", "intervals", "stretches", "seconds", "margin", "looseness")
VERDICTS = ("tip_over", "broken", "raised", "joint_limits", "torque_limits", "false")
BINS = (-np.inf, 0.0, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, np.inf)  # [m] of the histogram


def planned(seed: int) -> RandomMotion | None:
    """Plan of a seed with all that it is checked for; None if there is none."""
    number, kind = divmod(seed, len(KINDS))
    try:
        problem = KINDS[kind][1](number)
    except zs.ProblemError:  # tips over at rest for one of the uncertain payloads
        return None
    plan = zs.plan(problem)
    if not plan.success:
        return None
    every, ground = problem.corners(every=True), problem.ground
    return RandomMotion(
        f"plan {KINDS[kind][0]}", problem.machine, plan.trajectory, ground, every, ()
    )


def motions(count: int, first: int) -> Iterator[tuple[int, RandomMotion]]:
    """`count` plans and as many random motions, with their seeds."""
    found, seed = 0, first
    while found < count:
        plan = planned(seed)
        if plan is not None:
            found += 1
            yield seed, plan
        seed += 1
    for seed in range(first, first + count):
        yield seed, random_motion(seed)


def opinion(motion: RandomMotion, margin: float, *, bare: bool = False) -> RigorousCheck:
    """Second opinion on a motion; bare: without torque limits."""
    return zs.check_rigorously(
        motion.machine,
        motion.trajectory,
        motion.ground,
        margin,
        constraints=() if bare else motion.constraints,
        corners=motion.corners,
    )


def agrees(found: RigorousCheck, name: str, certified: Certificate) -> tuple[str, bool]:
    """Verdict on a guarantee, and whether it is that of the certificate."""
    rigorous = [one for one in found.guarantees if one.name == name]
    given = [one for one in certified.guarantees if one.name == name]
    if not rigorous or not given:
        return "", True
    verdict = rigorous[0].verdict
    return verdict.value, verdict is (Verdict.CONFIRMED if given[0].kept else Verdict.REFUTED)


def run(seed: int, motion: RandomMotion) -> Row:
    """Verdicts on one motion."""
    certified = certify_at(motion.corners, motion.trajectory, ANY, constraints=motion.constraints)
    lost = not np.isfinite(certified.margin)
    margin = ANY if lost else certified.margin
    found, took = timed(lambda: opinion(motion, margin))
    tip = found["tip_over"]
    broken = opinion(motion, tip.upper + BREAK, bare=True)["tip_over"].verdict
    raised = opinion(motion, margin + RAISE, bare=True)["tip_over"].verdict
    row: Row = {
        "set": motion.kind,
        "seed": seed,
        "corners": len(motion.corners),
        "intervals": motion.trajectory.intervals,
        "stretches": found.stretches,
        "seconds": round(took.processor, 3),
        "margin": None if lost else margin,
        "looseness": None if lost else tip.lower - margin,
        "tip_over": tip.verdict.value,
        "broken": broken.value,
        "raised": raised.value,
    }
    box = any(corner.spread > 0.0 for corner in motion.corners)
    false = broken is not Verdict.REFUTED and np.isfinite(tip.upper)
    false |= raised is Verdict.CONFIRMED and not box and not lost
    false |= tip.verdict is Verdict.REFUTED and not lost
    for name in ("joint_limits", "torque_limits"):
        row[name], same = agrees(found, name, certified)
        false |= not same
    return row | {"false": bool(false)}


def histogram(rows: Sequence[Row]) -> list[dict[str, float]]:
    """Number of motions by looseness."""
    values = [row["looseness"] for row in rows if row["looseness"] is not None]
    counts, _ = np.histogram(values, bins=BINS)
    return [
        {"from": float(low), "to": float(high), "motions": int(count)}
        for low, high, count in zip(BINS, BINS[1:], counts, strict=False)
    ]


def main() -> int:
    options = benchmark_parser(__doc__, count=500).parse_args()
    rows = []
    for seed, motion in motions(options.count, seeds(options).start):
        row = run(seed, motion)
        rows.append(row)
        if row["false"] or row["tip_over"] == "undecided":
            console.print(f"look at {row}", style="bold", markup=False)
    kinds = sorted({row["set"] for row in rows})
    undecided = Counter(row["set"] for row in rows if row["tip_over"] == "undecided")
    summary = {}
    for kind in kinds:
        some = [row for row in rows if row["set"] == kind]
        loose = [row["looseness"] for row in some if row["looseness"] is not None]
        summary[kind] = {
            "motions": len(some),
            "false": sum(row["false"] for row in some),
            "undecided": undecided[kind],
            "seconds": distribution([row["seconds"] for row in some]),
            "looseness": distribution(loose) if loose else None,
        }
    print_table(
        "second opinion",
        (
            "set",
            "motions",
            "false",
            "undecided",
            "s median",
            "s max",
            "looseness median",
            "max [m]",
        ),
        [
            (
                kind,
                one["motions"],
                one["false"],
                one["undecided"],
                f"{one['seconds']['50 %']:.2f}",
                f"{one['seconds']['max']:.2f}",
                *(f"{one['looseness'][key]:.2g}" for key in ("50 %", "max")),
            )
            for kind, one in summary.items()
        ],
    )
    bars = histogram(rows)
    print_table(
        "looseness of the certified margins [m]",
        ("from", "to", "motions"),
        [(f"{bar['from']:.0e}", f"{bar['to']:.0e}", bar["motions"]) for bar in bars],
    )
    if options.json:
        named = [
            {"below": None if np.isinf(bar["to"]) else bar["to"], "motions": bar["motions"]}
            for bar in bars
        ]
        content = {"sets": summary, "histogram": named}
        save_json(options.json, content, rows=rows, columns=COLUMNS + VERDICTS)
    return exit_code(success=not any(row["false"] for row in rows) and not undecided)


if __name__ == "__main__":
    sys.exit(main())

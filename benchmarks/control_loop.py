"""Control loop of examples/control_loop.py for minutes of simulated work, as random tasks come.

    python -m benchmarks.control_loop [--minutes 10] [--count 3] [--first 0] [--jobs 1]
                                      [--json FILE]

On each stand the ground has another slope and the tree another mass. The machine reaches for the
tree, takes it, swings it to the pile and drops it there, three times. On the way to the pile, at
random: the pile moves, half of the tree drops, or an operator stops the machine and lets it go on a
second later. Drives lag by 30 to 60 ms, sensors are noisy, and MuJoCo integrates in steps of 2 ms.
Planning takes the processor time that it takes: a motion whose plan comes late is not executed.

The exit code is 1 where a sample was executed that is not certified, or where the machine tilts by
more than a milliradian. Tracking errors are not in the certificates: what they take of the margin
is measured, as the least margin of the zero moment point of the true accelerations.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

import zmp_sqp as zs
from benchmarks.harness import (
    Row,
    benchmark_parser,
    console,
    distribution,
    exit_code,
    measure_F,
    print_table,
    save_json,
    seeds,
)
from benchmarks.problems.scene import FOOTPRINT, arm_range
from examples.control_loop import PERIOD, Controller, Record, run_period
from zmp_sqp.simulation import ServoMachine

MARGIN = 0.15  # [m] planned for; tracking errors take their part of it
STANDS = 0.25  # [m] least margin at rest at every pose of a task, with and without the tree
SLOPE = np.radians(15.0)  # largest roll and pitch
MASS = (1000.0, 4500.0)  # [kg] of a tree
CYCLES = 3  # trees per stand
DWELL = 0.6  # [s] at the tree and at the pile, in which the lagging machine comes to rest
LONGEST = 20.0  # [s] for one leg; then it counts as not reached
TILTED = 1e-3  # [rad] at which a machine has lifted a track
EVENTS = ("nothing", "the pile moves", "half of the tree drops", "emergency stop")
COLUMNS = (
    "seed", "stand", "roll_deg", "pitch_deg", "mass", "seconds", "legs", "reached", "plans",
    "late", "uncertified", "jumps", "margin", "contact_margin", "tilt", "error", "stops", "slowest",
)  # fmt: skip


@dataclass(slots=True, eq=False)
class Work:
    """Stand of a machine, with what is drawn at random for it.

    Attributes:
        rng: Random numbers of the seed.
        empty, loaded: Machine without and with its tree.
        ground: Slope of the stand.
        poses: Home, tree and pile, shape (3, n) [rad].
        t: Time since the start of the stand [s].
        reached: Whether the goal of each leg was reached.
    """

    rng: np.random.Generator
    empty: zs.Machine
    loaded: zs.Machine
    ground: zs.Slope
    poses: np.ndarray
    t: float = 0.0
    reached: list[bool] = field(default_factory=list)

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Work:
        """Stand with three poses in which the machine stands, with and without the tree."""
        machine = zs.load_machine("feller_buncher", support=zs.SupportPolygon(FOOTPRINT))
        lower, upper = arm_range(machine)
        while True:
            ground = zs.Slope(*rng.uniform(-SLOPE, SLOPE, 2))
            tree = zs.Payload(rng.uniform(*MASS), (0.0, 0.0, 3.323), "head")
            loaded = machine.with_payload(tree)
            empty = loaded.with_payload_scaled(0.0)
            q = rng.uniform(lower, upper, (400, machine.size))
            margins = [zs.stability_margin(one, q, 0 * q, 0 * q, ground) for one in (empty, loaded)]
            good = q[np.min(margins, axis=0) > STANDS]
            if len(good) >= 3:
                return cls(rng, empty, loaded, ground, good[:3])

    def moved(self, pile: np.ndarray) -> np.ndarray:
        """Pile that has moved by up to 0.4 rad of slew, if the machine stands there too."""
        lower, upper = arm_range(self.loaded)
        near = pile + np.array(
            [self.rng.choice([-1.0, 1.0]) * self.rng.uniform(0.1, 0.4), *[0.0] * 4]
        )
        near = np.clip(near, lower, upper)
        still = np.zeros_like(near)
        margins = [
            zs.stability_margin(one, near, still, still, self.ground)
            for one in (self.empty, self.loaded)
        ]
        return near if min(map(float, margins)) > STANDS else pile


def go(
    work: Work,
    plant: ServoMachine,
    controller: Controller,
    record: Record,
    *,
    after: float = np.inf,
    then: Any = None,
) -> None:
    """Run the loop until the reference is at rest at the goal, and then until the machine is.

    Args:
        work, plant, controller, record: Stand, machine, controller and record.
        after: Time after which something happens [s].
        then: What happens; called once.
    """
    began = work.t
    while work.t < began + LONGEST:
        if work.t - began >= after and then is not None:
            then, happens = None, then
            happens()
        run_period(plant, controller, record, work.t)
        work.t += PERIOD
        if then is None and controller.is_there(work.t):
            break
    work.reached.append(controller.is_there(work.t))
    for _ in range(round(DWELL / PERIOD)):
        run_period(plant, controller, record, work.t)
        work.t += PERIOD


def one_cycle(work: Work, plant: ServoMachine, controller: Controller, record: Record) -> None:
    """Reach for a tree, swing it to the pile with an event on the way, drop it."""
    home, tree, pile = work.poses
    controller.go(tree)
    go(work, plant, controller, record)
    event, after = work.rng.choice(EVENTS), work.rng.uniform(0.3, 1.5)
    controller.go(pile, work.loaded)
    then = {
        "nothing": None,
        "the pile moves": partial(controller.go, work.moved(pile)),
        "half of the tree drops": partial(
            controller.go, pile, work.loaded.with_payload_scaled(0.5)
        ),
        "emergency stop": controller.stop,
    }[event]
    if event == "emergency stop":
        stop_and_go(work, plant, controller, record, after)
        then = None
    go(work, plant, controller, record, after=after, then=then)
    controller.go(home, work.empty)
    go(work, plant, controller, record)


def stop_and_go(
    work: Work, plant: ServoMachine, controller: Controller, record: Record, after: float
) -> None:
    """An operator stops the machine after a time [s], and lets it go on a second after that."""
    pile = controller.goal
    for k in range(round((after + 1.5) / PERIOD)):
        if k == round(after / PERIOD):
            controller.stop()
        run_period(plant, controller, record, work.t)
        work.t += PERIOD
    # the tree is in the grab if the motion with it had begun
    controller.go(pile, work.loaded)


def run_stand(seed: int, stand: int, rng: np.random.Generator) -> tuple[Row, list[Any]]:
    """Results of one stand, and its records of plans."""
    work = Work.drawn(rng)
    planner = zs.Planner(work.empty, ground=work.ground, margin=MARGIN)
    planner.clock = time.process_time
    controller, record = Controller.at_rest(planner, work.poses[0]), Record()
    plant = ServoMachine(
        work.empty, work.poses[0], work.ground, lag=rng.uniform(0.03, 0.06, 5), seed=seed
    )
    for _ in range(CYCLES):
        one_cycle(work, plant, controller, record)
    margins, plans = record.margins(work.ground), controller.plannings
    return {
        "seed": seed,
        "stand": stand,
        "roll_deg": np.degrees(work.ground.roll),
        "pitch_deg": np.degrees(work.ground.pitch),
        "mass": work.loaded.payload_mass,
        "seconds": work.t,
        "legs": len(work.reached),
        "reached": sum(work.reached),
        "plans": len(plans),
        "late": sum(not one.used for one in plans),
        "uncertified": record.uncertified,
        "jumps": sum(not one.continues for one in controller.motions),
        "margin": float(margins.min()),
        "contact_margin": min(record.contact),
        "tilt": record.tilt,
        "error": float(record.errors.max()),
        "stops": sum(one.status == "STOP" or one.why == "emergency stop" for one in plans),
        "slowest": 1e3 * max(one.took for one in plans),
    }, plans


def run_seed(seed: int, minutes: float) -> dict[str, Any]:
    """Stands of one seed until the minutes of simulated work are full."""
    rng, rows, plans = np.random.default_rng([14, seed]), list[Row](), list[Any]()
    machine = zs.load_machine("feller_buncher")
    F, began = measure_F(machine), time.process_time()
    while sum(row["seconds"] for row in rows) < 60.0 * minutes:
        row, found = run_stand(seed, len(rows), rng)
        rows.append(row)
        plans += found
    took = time.process_time() - began
    F = 0.5 * (F + measure_F(machine))
    return {
        "rows": rows,
        "F": F,
        "processor": took,
        "planning": [one.took for one in plans],
        "statuses": Counter(one.status for one in plans),
        "reasons": Counter(f"{one.why}: {one.status}" for one in plans),
    }


def summarise(found: list[dict[str, Any]], minutes: float) -> dict[str, Any]:
    """The numbers of all seeds."""
    rows = [row for one in found for row in one["rows"]]
    in_F = [took / one["F"] for one in found for took in one["planning"]]
    milliseconds = [1e3 * took for one in found for took in one["planning"]]
    reasons = sum((one["reasons"] for one in found), Counter())
    return {
        "seeds": len(found),
        "minutes_per_seed": minutes,
        "simulated_seconds": sum(row["seconds"] for row in rows),
        "processor_seconds": sum(one["processor"] for one in found),
        "planning_seconds": sum(sum(one["planning"]) for one in found),
        "F_seconds": [one["F"] for one in found],
        "planned_for_margin": MARGIN,
        "stands": len(rows),
        "legs": sum(row["legs"] for row in rows),
        "reached": sum(row["reached"] for row in rows),
        "uncertified_samples": sum(row["uncertified"] for row in rows),
        "worst_margin": min(row["margin"] for row in rows),
        "worst_contact_margin": min(row["contact_margin"] for row in rows),
        "largest_tilt": max(row["tilt"] for row in rows),
        "largest_tracking_error": max(row["error"] for row in rows),
        "plans": len(in_F),
        "late": sum(row["late"] for row in rows),
        "planning_in_F": distribution(in_F),
        "planning_in_ms": distribution(milliseconds),
        "share_within_22_ms": float(np.mean(np.array(milliseconds) <= 22.0)),
        "statuses": dict(sorted(reasons.items())),
    }


def print_summary(summary: dict[str, Any]) -> None:
    keys = [key for key, value in summary.items() if isinstance(value, int | float)]
    print_table("control loop", ("", "all seeds"), [(key, summary[key]) for key in keys])
    times = ("planning_in_F", "planning_in_ms")
    print_table(
        "planning times", ("", *summary[times[0]]), [(key, *summary[key].values()) for key in times]
    )
    print_table("plans", ("why: status", "number"), list(summary["statuses"].items()))


def main() -> int:
    parser = benchmark_parser(__doc__, count=3)
    parser.add_argument("--minutes", type=float, default=10.0, help="simulated, of each seed")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    options = parser.parse_args()
    run = partial(run_seed, minutes=options.minutes)
    if options.jobs > 1:
        with ProcessPoolExecutor(options.jobs) as executor:
            found = list(executor.map(run, seeds(options)))
    else:
        found = [run(seed) for seed in seeds(options)]
    summary = summarise(found, options.minutes)
    print_summary(summary)
    rows = [row for one in found for row in one["rows"]]
    if options.json is not None:
        save_json(options.json, summary, rows=rows, columns=COLUMNS, digits=5)
    wrong = summary["uncertified_samples"] > 0 or summary["largest_tilt"] > TILTED
    if wrong:
        console.print("an uncertified sample was executed, or the machine tipped", style="bold")
    return exit_code(success=not wrong)


if __name__ == "__main__":
    sys.exit(main())

"""Control loop at 100 Hz that executes nothing but certified motions, against a machine in MuJoCo.

    python examples/control_loop.py [--clock wall|processor] [--seed N] [--plot FILE.png]

A feller-buncher on a slope carries a tree. On the way its goal is moved, half of the tree drops, an
operator stops it and lets it go on, and the slew drive loses power for a while. Drives follow the
commanded rates with a lag, and sensors are noisy.

Which state should the next motion start from? The measured one lags behind the reference by what
the drives are late. Motions planned from there would set the reference back at every new plan:
what is executed would be pieces of certified motions with jumps between them. This controller plans
from the **reference**, at the time at which the plan will be there (now, and the time that planning
may take). The new motion continues the old one in positions and rates, so that all that is executed
is certified. That the machine follows the reference within some error is a further assumption,
which the margin must cover. Where the error grows beyond `ADRIFT` (a joint is blocked, a drive
saturates), the assumption is broken, and the next motion is planned from the **measured** state.

Planning takes time here as it does on a machine: a plan that was asked for at t begins at t + LEAD,
and is dropped if it took longer. `--clock processor` counts the processor time of this program
instead of wall time, for computers that do other work too.
"""

from __future__ import annotations

import argparse
import gc
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

import zmp_sqp as zs
from zmp_sqp.simulation import ServoMachine

PERIOD = 0.01  # [s] of the control loop
BUDGET = 0.02  # [s] for a plan
# [s] from asking for a plan to its start: the budget, at most 10 % or 2 ms more, in whole periods
LEAD = 0.03
STOP_BUDGET = 0.012  # [s] for the search of an emergency stop; doubled where it finds none
PROOF = 0.02  # [s] for what comes after that search, in whole periods
REPLAN = 0.1  # [s] between plans along a motion
LEFT = 0.15  # [s] of a motion from which on it is only followed to its end
ADRIFT = 0.15  # [rad or m] tracking error beyond which the reference is given up
GAIN = 2.0  # [1/s] of the position error, in the commanded rate
# [s] of the drives at least: the commanded rate is that much ahead. Lags differ from joint to joint
# and are not known well; a lead above the true lag would let accelerations overshoot
LEAST_LAG = 0.03
CONTINUES = 1e-5  # [rad, rad/s] largest jump of the reference that counts as none
AT_GOAL = 1e-5  # [rad or m]
NOW = 1e-6  # [s] times that are closer together are the same
TIPPED = 0.01  # [rad] tilt of a machine that lifts a track by several centimetres


@dataclass(frozen=True, slots=True, eq=False)
class Executed:
    """A motion that is executed, with the machine that it is certified for."""

    plan: zs.Plan
    machine: zs.Machine
    begins: float  # [s]
    why: str  # it was planned
    continues: bool  # whether it continues the reference before it

    def reference(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Joint coordinates and rates at a time [s]; at rest after the end of the motion."""
        return self.state(t)[:2]

    def state(self, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Joint coordinates, rates and accelerations at a time [s]."""
        motion = self.plan.trajectory
        q, v, a = motion(min(max(t - self.begins, 0.0), motion.duration))
        return q, v, a if t < self.ends else 0.0 * a

    @property
    def ends(self) -> float:
        """Time at which the motion ends [s]."""
        return self.begins + self.plan.duration

    def is_certified_for(self, machine: zs.Machine) -> bool:
        """Whether the motion is proven safe for this very machine."""
        return self.plan.success and self.plan.certificate.safe and self.machine is machine


@dataclass(frozen=True, slots=True)
class Planning:
    """Record of one plan that was asked for."""

    asked: float  # [s] at this time of the simulation
    why: str
    took: float  # [s]
    status: str
    used: bool = False


@dataclass(slots=True, eq=False)
class Controller:
    """Controller that always has a certified motion to execute.

    Attributes:
        planner: Planner with machine, ground and margin.
        now: The motion that is executed.
        goal: Joint coordinates to go to, shape (n,).
        motions, plannings: All that was executed, and all plans that were asked for.
    """

    planner: zs.Planner
    now: Executed
    goal: np.ndarray
    motions: list[Executed] = field(default_factory=list)
    plannings: list[Planning] = field(default_factory=list)
    _next: Executed | None = None
    _busy: float = -np.inf  # [s] until then the computer plans
    _asked: float = -np.inf  # [s] time of the last plan
    _planned_from: float | None = None  # [s] where the planner's last motion begins
    _stopping: bool = False
    _stop_budget: float = STOP_BUDGET  # [s]
    _goal_is_new: bool = False

    @classmethod
    def at_rest(cls, planner: zs.Planner, q: Any, t: float = 0.0) -> Controller:
        """Controller of a machine that stands at q."""
        stands = planner.plan(q, q)
        # what has been loaded by now stays: to search all of it for garbage takes 25 ms
        gc.collect()
        gc.freeze()
        now = Executed(stands, planner.machine, t, "at rest", continues=True)
        return cls(planner, now, np.array(q, dtype=float), [now])

    # --- what is asked of it ----------------------------------------------------------------

    def go(self, goal: Any, machine: zs.Machine | None = None) -> None:
        """Go to a goal. With another payload, the grab opens or closes as the next motion begins.

        Args:
            goal: Joint coordinates, shape (n,).
            machine: The machine with its new payload; None for the present one.
        """
        self.goal, self._goal_is_new, self._stopping = np.array(goal, dtype=float), True, False
        if machine is not None:
            self.planner.machine = machine

    def stop(self) -> None:
        """Come to rest as fast as the machine can without tipping over."""
        self._stopping, self._next, self._stop_budget = True, None, STOP_BUDGET
        self.planner.machine = self.now.machine

    def is_there(self, t: float) -> bool:
        """Whether the reference has come to rest at the goal."""
        off = np.abs(self.now.reference(t)[0] - self.goal).max()
        return bool(t >= self.now.ends and off < AT_GOAL and not self._goal_is_new)

    @property
    def _stop_lead(self) -> float:
        """Time from asking for an emergency stop to its begin [s]."""
        return float(PERIOD * np.ceil((self._stop_budget + PROOF) / PERIOD - NOW))

    # --- every period -----------------------------------------------------------------------

    def rates(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Joint rates to be commanded at a time.

        Args:
            t: Time [s].
            q, v: Measured joint coordinates and rates, shape (n,).
        """
        self._take_over(t)
        wanted, rate, acceleration = self.now.state(t)
        drifted = bool(np.abs(wanted - q).max() > ADRIFT)
        why = self._reason(t, drifted=drifted)
        if why:
            begins = t + (self._stop_lead if self._stopping else LEAD)
            measured = q + (begins - t) * v, v
            self._plan(t, why, begins, measured if drifted else self.now.reference(begins))
        most = self.planner.machine.limits.velocity
        rates = rate + LEAST_LAG * acceleration + GAIN * (wanted - q)
        return np.clip(rates, -most, most)

    def _take_over(self, t: float) -> None:
        """Begin the next motion at its time; drop it if its plan came too late."""
        following = self._next
        if following is None or t < following.begins - NOW:
            return
        self._next = None
        if self._busy > following.begins + NOW:
            self._planned_from, self._goal_is_new = None, True
            return
        self.now = following
        self.motions.append(following)
        self.plannings[-1] = replace(self.plannings[-1], used=True)

    def _reason(self, t: float, *, drifted: bool) -> str:
        """Why the next motion is to be planned now; empty if it is not."""
        if self._next is not None or t < self._busy:
            return ""
        moving = t < self.now.ends
        if self._stopping:
            return "emergency stop" if moving and self.now.why != "emergency stop" else ""
        if drifted:
            return "drifted off"
        if self._goal_is_new:
            return "new goal"
        arrives = np.abs(self.now.plan.problem.goal - self.goal).max() < AT_GOAL
        unfinished = not arrives or t < self.now.ends - LEFT
        return "next plan" if unfinished and t - self._asked >= REPLAN - NOW else ""

    def _plan(
        self, t: float, why: str, begins: float, state: tuple[np.ndarray, np.ndarray]
    ) -> None:
        """Plan the motion that begins at a later time, from the state that is expected then."""
        clock, planner = self.planner.clock, self.planner
        began = clock()
        if why == "emergency stop":
            q, v = state
            plan = zs.plan_stop(
                planner.machine,
                q,
                v,
                planner.ground,
                margin=planner.margin,
                time_budget=self._stop_budget,
                clock=clock,
            )
            self._stop_budget *= 2.0  # for the next attempt, if this one fails
        else:
            since = None if self._planned_from is None else begins - self._planned_from
            known = None if why == "drifted off" else since
            plan = planner.plan(state[0], self.goal, state[1], BUDGET, elapsed=known)
            self._planned_from = begins if plan.success else None
        took = clock() - began
        self._asked, self._busy = t, t + took
        self.plannings.append(Planning(t, why, took, plan.status.name))
        if not plan.success:  # the present motion goes on to its end
            self._goal_is_new = planner.machine is not self.now.machine
            return
        self._goal_is_new = False
        motion = plan.trajectory
        jumps = motion.positions[0] - state[0], motion.velocities[0] - state[1]
        continues = why != "drifted off" and bool(np.abs(jumps).max() < CONTINUES)
        self._next = Executed(plan, planner.machine, begins, why, continues)


# --- the loop ------------------------------------------------------------------------------------


@dataclass(slots=True, eq=False)
class Record:
    """What was seen at every period, and the largest tilt of the machine."""

    times: list[float] = field(default_factory=list)
    states: list[tuple[np.ndarray, ...]] = field(default_factory=list)  # true q, v, a
    wanted: list[np.ndarray] = field(default_factory=list)
    machines: list[zs.Machine] = field(default_factory=list)
    contact: list[float] = field(default_factory=list)  # [m] margin of the contact forces
    last: Executed | None = None  # motion of the last period
    uncertified: int = 0
    tilt: float = 0.0  # [rad]

    def margins(self, ground: Any) -> np.ndarray:
        """Margin of the zero moment point, from the true accelerations [m]."""
        found, first = [], 0
        for k in range(1, len(self.times) + 1):
            if k == len(self.times) or self.machines[k] is not self.machines[first]:
                q, v, a = (np.array(part) for part in zip(*self.states[first:k], strict=True))
                found.append(zs.stability_margin(self.machines[first], q, v, a, ground))
                first = k
        return np.concatenate(found)

    @property
    def errors(self) -> np.ndarray:
        """Largest tracking error of a joint at every period [rad or m]."""
        q = np.array([state[0] for state in self.states])
        return np.asarray(np.abs(q - np.array(self.wanted)).max(axis=1))


def run_period(
    plant: ServoMachine, controller: Controller, record: Record, t: float, most: Any = np.inf
) -> None:
    """One period of the loop.

    Args:
        plant, controller, record: The simulated machine, what drives it, and what is recorded.
        t: Time [s].
        most: Largest rates that the drives reach, whatever is commanded, scalar or shape (n,).
    """
    rates = controller.rates(t, *plant.measured)
    executed = controller.now
    if executed is not record.last and executed.machine is not plant.machine:
        plant.change_machine(executed.machine)  # the grab opens or closes as its motion begins
    record.last = executed
    proven = executed.is_certified_for(plant.machine)
    if not (proven and (executed.continues or executed.why == "drifted off")):
        record.uncertified += 1
    plant.drive(np.clip(rates, -np.asarray(most), most), PERIOD)
    record.times.append(t)
    record.states.append(plant.state)
    record.wanted.append(executed.reference(t + PERIOD)[0])
    record.machines.append(plant.machine)
    record.contact.append(plant.contact_margin)
    record.tilt = max(record.tilt, plant.tilt)


# --- the story -----------------------------------------------------------------------------------

HOME = np.array([0.0, -0.8, -2.0, 0.7, 0.0])  # slew, boom, stick, tilt, head [rad]
PILE = HOME + np.array([2.2, 0.3, 0.2, 0.0, 0.0])
LONGEST = 30.0  # [s]


def tell(plant: ServoMachine, controller: Controller, record: Record) -> None:
    """Swing the tree to the pile and back, with all that may happen on the way."""
    loaded = plant.machine
    lighter = loaded.with_payload_scaled(0.5)
    moved = PILE + np.array([0.4, 0.0, 0.0, 0.0, 0.0])
    events: list[tuple[float, str, Callable[[], None]]] = [
        (0.1, "to the pile", lambda: controller.go(PILE)),
        (1.2, "the goal moves by 0.4 rad", lambda: controller.go(moved)),
        (2.4, "half of the tree is dropped", lambda: controller.go(moved, lighter)),
        (6.0, "back", lambda: controller.go(HOME)),
        (7.0, "emergency stop", controller.stop),
        (8.5, "released", lambda: controller.go(HOME)),
        (9.5, "the slew drive loses power for a second", lambda: None),
    ]
    t = 0.0
    while t < LONGEST and (events or not controller.is_there(t)):
        while events and t >= events[0][0] - NOW:
            _, words, happens = events.pop(0)
            print(f"{t:6.2f} s  {words}")
            happens()
        weak = np.interp(t, [9.5, 10.0, 10.5, 10.8], [1.0, 0.3, 0.3, 1.0])
        run_period(plant, controller, record, t, most=weak * loaded.limits.velocity)
        t += PERIOD


def summarise(controller: Controller, record: Record, ground: Any) -> None:
    """Print what happened, in numbers."""
    margins, plannings = record.margins(ground), controller.plannings
    print(f"\n{len(record.times)} samples in {record.times[-1] + PERIOD:.2f} s of simulated time, ")
    print(f"  uncertified samples executed: {record.uncertified}")
    print(
        f"  jumps of the reference (planned from the measured state): "
        f"{sum(not one.continues for one in controller.motions)}"
    )
    print(f"  tracking error: {record.errors.max():.3f} rad at most")
    print(f"  tilt of the machine: {np.degrees(record.tilt):.3f} deg at most")
    proven = min(one.plan.margin for one in controller.motions)
    print(f"  margin: {proven:.3f} m proven of the reference, {margins.min():.3f} m seen")
    statuses = Counter(f"{one.why}: {one.status}" for one in plannings)
    late = sum(not one.used for one in plannings)
    print(f"  {len(plannings)} plans, {late} of them not used (too late, or overtaken by events)")
    for words, count in sorted(statuses.items()):
        print(f"    {count:4d}  {words}")
    print_histogram("planning times [ms]", [1e3 * one.took for one in plannings])
    print_histogram("margin that the physics saw [m]", margins)


def print_histogram(title: str, values: Any, bins: int = 12) -> None:
    """Print a histogram as text."""
    counts, edges = np.histogram(values, bins=bins)
    print(f"\n{title}")
    for count, low, high in zip(counts, edges, edges[1:], strict=False):
        bar = "#" * int(np.ceil(50.0 * count / counts.max()))
        print(f"  {low:8.3f} .. {high:8.3f} {count:6d} {bar}")


def save_plot(path: Path, controller: Controller, record: Record, ground: Any) -> None:
    """Draw reference and machine, margins and planning times as PNG."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    times, q = np.array(record.times) + PERIOD, np.array([state[0] for state in record.states])
    figure, (top, middle, bottom) = plt.subplots(3, 1, figsize=(9, 9), layout="constrained")
    top.plot(times, np.array(record.wanted)[:, 0], label="reference")
    top.plot(times, q[:, 0], label="machine")
    top.set(ylabel="slew [rad]", xlabel="time [s]")
    top.legend()
    margins = record.margins(ground)
    middle.plot(times, margins, label="zero moment point")
    middle.plot(times, record.contact, ":", label="centre of the contact forces")
    middle.axhline(controller.planner.margin, color="k", lw=0.8, label="planned for")
    middle.set(ylabel="distance to the nearest edge [m]", xlabel="time [s]")
    middle.set_ylim(0.0, 1.25 * margins.max())
    middle.legend(loc="upper center", ncols=3)
    bottom.hist([1e3 * one.took for one in controller.plannings], bins=30)
    bottom.set(xlabel="planning time [ms]", ylabel="plans")
    figure.savefig(path, dpi=110)
    print(f"\nwritten to {path}")


def main() -> int:
    """Run the story; exit code 1 where a sample was not certified or the machine tipped."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--clock", choices=("wall", "processor"), default="wall")
    parser.add_argument("--seed", type=int, default=0, help="of the measurement noise")
    parser.add_argument("--plot", type=Path, metavar="FILE.png")
    options = parser.parse_args()
    clock = time.perf_counter if options.clock == "wall" else time.process_time

    tree = zs.Payload(mass=3000.0, com=(0.0, 0.0, 3.323), frame="head")
    machine = zs.load_machine("feller_buncher").with_payload(tree)
    ground = zs.Slope(roll=np.radians(-12.0))
    planner = zs.Planner(machine, ground=ground, margin=0.15, clock=clock)
    controller, record = Controller.at_rest(planner, HOME), Record()
    lag = [0.06, 0.05, 0.04, 0.03, 0.03]  # [s]
    plant = ServoMachine(machine, HOME, ground, lag=lag, seed=options.seed)
    tell(plant, controller, record)
    summarise(controller, record, ground)
    if options.plot is not None:
        save_plot(options.plot, controller, record, ground)
    return 1 if record.uncertified or record.tilt > TIPPED else 0


if __name__ == "__main__":
    sys.exit(main())

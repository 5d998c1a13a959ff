"""The control loop of examples/: nothing uncertified is executed, and physics agrees."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import zmp_sqp as zs
from examples.control_loop import HOME, PERIOD, PILE, Controller, Record, run_period
from zmp_sqp.simulation import ServoMachine

pytestmark = pytest.mark.physics

GROUND, MARGIN = zs.Slope(roll=np.radians(-12.0)), 0.15
TREE = zs.Payload(mass=3000.0, com=(0.0, 0.0, 3.323), frame="head")


def loop() -> tuple[ServoMachine, Controller, Record]:
    machine, ticks = zs.load_machine("feller_buncher").with_payload(TREE), itertools.count()
    # a clock that goes on by half a millisecond whenever it is read: every run is the same
    planner = zs.Planner(machine, ground=GROUND, margin=MARGIN, clock=lambda: 5e-4 * next(ticks))
    plant = ServoMachine(machine, HOME, GROUND, lag=0.04, seed=3)
    return plant, Controller.at_rest(planner, HOME), Record()


def run(plant, controller, record, events, seconds) -> None:
    for k in range(round(seconds / PERIOD)):
        if k in events:
            events[k]()
        run_period(plant, controller, record, k * PERIOD)


def test_a_swing_with_a_moved_goal_a_dropped_payload_and_an_emergency_stop():
    plant, controller, record = loop()
    lighter = plant.machine.with_payload_scaled(0.5)
    moved = PILE + np.array([0.2, 0.0, 0.0, 0.0, 0.0])
    events = {
        0: lambda: controller.go(PILE),
        60: lambda: controller.go(moved),
        110: lambda: controller.go(moved, lighter),
        170: controller.stop,
    }
    run(plant, controller, record, events, 3.2)
    assert record.uncertified == 0
    assert plant.machine is lighter
    assert record.tilt < 1e-4
    margins = record.margins(GROUND)
    assert margins.min() > 0.5 * MARGIN
    np.testing.assert_allclose(record.contact, margins, atol=0.03)
    assert record.errors.max() < 0.1
    # it has moved, and stopped on the way
    q, v, _ = plant.state
    assert 0.3 < q[0] < moved[0] - 0.1
    assert np.abs(v).max() < 0.05
    assert controller.now.why == "emergency stop"
    for executed in controller.motions:
        again = zs.certify(executed.machine, executed.plan.trajectory, GROUND)
        assert again.margin >= MARGIN
    for earlier, later in itertools.pairwise(controller.motions):
        for one, other in zip(
            earlier.reference(later.begins), later.reference(later.begins), strict=True
        ):
            np.testing.assert_allclose(one, other, atol=1e-5)


def test_a_payload_that_is_lost_unseen_is_recorded_as_uncertified():
    plant, controller, record = loop()
    lost = plant.machine.with_payload_scaled(0.2)
    run(plant, controller, record, {2: lambda: plant.change_machine(lost)}, 0.05)
    assert record.uncertified == 3


def test_a_machine_that_falls_behind_is_planned_for_from_where_it_is():
    plant, controller, record = loop()
    controller.go(PILE)
    for k in range(250):
        most = np.full(5, 0.05 if 80 <= k < 180 else np.inf)
        run_period(plant, controller, record, k * PERIOD, most)
    assert any(executed.why == "drifted off" for executed in controller.motions)
    assert record.uncertified == 0
    assert record.errors.max() < 0.35

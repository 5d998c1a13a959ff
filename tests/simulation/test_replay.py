"""Replays: plans stand, the phase plane's motion tips over, lifts are as in closed forms."""

from __future__ import annotations

import sys
from functools import cache
from typing import Any

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.arm import HARD, ORDINARY, Recipe
from benchmarks.problems.paper import paper_1
from benchmarks.problems.scene import GRAVITY, NamedProblem
from benchmarks.replay import LIFTED, run
from tests.problems import SLIDER_HEIGHT

pytestmark = pytest.mark.physics

# [m] median distance of the two ZMPs: at jumps of the acceleration the contacts lag by a step
IN_MOTION = 1e-3
STANDS = 5e-5  # [m] lift of a machine that stands, fifty times what the rigid contacts yield
RESOLVED = 7e-4  # [m] by which the ZMP of contact forces differs from ours, a time step late
# relative: the closed form neither turns gravity nor moves the slider while the machine rocks
ROCKING = 0.05


@pytest.fixture(autouse=True)
def _engine() -> None:
    pytest.importorskip("mujoco")


@cache
def motions(point_masses: bool, margin: float) -> tuple[NamedProblem, zs.Trajectory, zs.Trajectory]:
    named = paper_1(point_masses=point_masses, margin=margin)
    problem = named.problem
    return (
        named,
        zs.plan(problem).trajectory,
        zs.phase_plane(problem.machine, problem.start, problem.goal),
    )


def push(
    acceleration: float, time: float, *, rate: float = 0.0
) -> tuple[zs.Machine, zs.Trajectory]:
    """The slider on a foot of 1 m x 4 m, pushed from its middle."""
    machine = zs.load_machine(
        "slider", support=zs.SupportPolygon([[-0.5, -2], [0.5, -2], [0.5, 2], [-0.5, 2]])
    )
    end = [rate * time + 0.5 * acceleration * time**2], [rate + acceleration * time]
    states = ([[0.0], end[0]], [[rate], end[1]], [[acceleration]])
    return machine, zs.Trajectory(machine.joint_names, [0.0, time], *states)


@pytest.mark.parametrize("point_masses", [True, False])
def test_the_phase_plane_tips_the_papers_machine_over_and_ours_does_not(point_masses: bool) -> None:
    named, planned, baseline = motions(point_masses, 0.0)
    machine, ground = named.problem.machine, named.problem.ground
    falls, stands = zs.replay(machine, baseline, ground), zs.replay(machine, planned, ground)
    assert falls.tipped
    assert falls.fell
    assert falls.max_tilt > np.pi / 4
    assert falls.lifted_at == pytest.approx(1.14, abs=0.02)  # [s], 3.4 s before its end
    assert machine.support is not None
    assert machine.support.edge_name(falls.pivot) == "left"
    assert falls.pivot == zs.certify(machine, baseline, ground).edge
    assert falls.least_edge_load == 0.0
    assert not stands.tipped
    assert not stands.fell
    assert stands.lift < STANDS
    assert stands.max_tilt < 1e-5
    assert stands.slide < STANDS
    assert np.isnan(stands.lifted_at)
    assert stands.tracking_error < 1e-6
    # it is watched at rest, too
    assert stands.times[-1] == pytest.approx(planned.duration + 1.0, abs=2e-3)
    assert stands.loads[-1].sum() == pytest.approx(-machine.mass * ground.gravity()[2], rel=1e-4)


def test_a_margin_keeps_load_on_the_upper_track() -> None:
    """With the ZMP 0.1 m inside, the other track carries at least 0.1 / 3.23 of the weight."""
    named, planned, _ = motions(True, 0.1)
    replay = zs.replay(named.problem.machine, planned, named.problem.ground, hold=0.0)
    total = replay.loads.sum(axis=1)
    share = (replay.edge_loads / total[:, None]).min()
    assert share == pytest.approx(0.1 / 3.23, rel=0.05)
    assert named.problem.machine.support is not None
    assert named.problem.machine.support.edge_name(replay.least_loaded_edge) == "right"
    assert replay.least_loads.shape == (4,)


def test_the_zmp_of_the_contact_forces_is_ours_in_motion_too() -> None:
    named, planned, _ = motions(False, 0.1)
    replay = zs.replay(named.problem.machine, planned, named.problem.ground, hold=0.0)
    inner = replay.times < planned.duration
    ours = zs.trajectory_zmp(
        named.problem.machine, planned, replay.times[inner], named.problem.ground
    )
    assert np.median(np.linalg.norm(replay.zmp[inner] - ours, axis=1)) < IN_MOTION


@pytest.mark.parametrize("time", [0.05, 0.1, 0.2])
def test_a_push_past_the_edge_lifts_as_a_rocking_body_does(time: float) -> None:
    r"""Rocking of two masses in the middle of the foot, lift = 2 L theta.

    theta'' = (m h a - (m + M) g L) / (m (L^2 + h^2) + I_m + M L^2 + I_M).
    """
    half, a, m, base = 0.5, 4.0, 1000.0, 100.0
    machine, trajectory = push(a, time)
    moment = m * SLIDER_HEIGHT * a - (m + base) * GRAVITY * half
    inertia = m * (half**2 + SLIDER_HEIGHT**2) + 16.0 + base * half**2 + 8.416667
    expected = 2.0 * half * 0.5 * moment / inertia * time**2
    replay = zs.replay(machine, trajectory, zs.Slope(), time_step=1e-4)
    assert replay.lift == pytest.approx(expected, rel=ROCKING)
    assert replay.pivot == 3  # pushed ahead, it tips backwards
    assert replay.tipped == (expected > LIFTED)


def test_the_verdict_does_not_hang_on_the_time_step() -> None:
    machine, trajectory = push(4.0, 0.1)
    lifts = [
        zs.replay(machine, trajectory, zs.Slope(), time_step=h).lift for h in (2e-3, 1e-3, 2.5e-4)
    ]
    assert lifts == pytest.approx([lifts[-1]] * 3, rel=0.05)


def test_a_start_in_motion_is_no_blow() -> None:
    machine, trajectory = push(0.0, 0.2, rate=1.0)
    assert zs.replay(machine, trajectory, zs.Slope()).lift < STANDS


@pytest.mark.parametrize(("recipe", "seed"), [(ORDINARY, 0), (ORDINARY, 29), (HARD, 4)])
def test_margin_and_physics_agree_but_for_short_excursions(recipe: Recipe, seed: int) -> None:
    """All 300 are in benchmarks/replay.py."""
    rows = run(seed, recipe)
    assert [row["motion"] for row in rows] == ["planned", "phase plane", "slowed"]
    for row in rows:
        assert row["verdict"] != "unexplained", row
        assert row["margin"] < RESOLVED or row["lift"] < STANDS, row
        assert row["margin"] < 0.0 or row["lift"] < 0.1 * LIFTED, row


# --- what is refused ----------------------------------------------------------------------------


def test_a_missing_engine_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    machine, trajectory = push(1.0, 0.1)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(zs.MissingExtra, match=r"pip install zmp-sqp\[sim\]"):
        zs.replay(machine, trajectory, zs.Slope())


@pytest.mark.parametrize(
    ("settings", "complaint"),
    [
        ({"time_step": 0.01}, "time_step must be from 1e-06 to 0.005, not 0.01"),
        ({"time_step": np.nan}, "time_step"),
        ({"hold": -1.0}, "hold must be from 0 to 3600, not -1"),
        ({"friction": -0.1}, "friction"),
        ({"sinkage": 1e-6}, "give a shorter time_step, or a sinkage of 0"),
    ],
)
def test_settings_out_of_range_are_refused(settings: dict[str, Any], complaint: str) -> None:
    machine, trajectory = push(1.0, 0.1)
    with pytest.raises(zs.ProblemError, match=complaint):
        zs.replay(machine, trajectory, zs.Slope(), **settings)


def test_what_is_no_replayable_motion_is_refused() -> None:
    machine, trajectory = push(1.0, 0.1)
    with pytest.raises(zs.ProblemError, match="the machine has"):
        zs.replay(zs.load_machine("feller_buncher"), trajectory, zs.Slope())
    with pytest.raises(zs.MachineError, match="must be a Machine"):
        zs.replay("slider", trajectory, zs.Slope())
    with pytest.raises(zs.TrajectoryError, match="must be a Trajectory"):
        zs.replay(machine, None, zs.Slope())
    with pytest.raises(zs.ProblemError, match=r"gravity\(yaw\)"):
        zs.replay(machine, trajectory, zs.Slope)


def test_a_base_that_drives_is_refused() -> None:
    machine, trajectory = push(1.0, 0.1)
    still = np.zeros((2, 3))
    motion: Any = driving(trajectory, still)
    with pytest.raises(zs.ProblemError, match="base drives"):
        zs.replay(machine, motion, zs.Slope())


def driving(trajectory: zs.Trajectory, poses: np.ndarray) -> zs.Trajectory:
    from dataclasses import replace

    from zmp_sqp.planning import UnicycleMotion

    base = UnicycleMotion(
        trajectory.times, poses, np.zeros((2, 2)), np.zeros((1, 2)), np.zeros((1, 2))
    )
    return replace(trajectory, base=base)

"""The feller-buncher with its root turned (y forward), raised by 0.5 m, or both, plans the same.

The slope turns along, because roll and pitch are about the root's axes. Durations agree to 1e-9 s
and sampled margins, which are of single states, likewise. Guaranteed margins of a raised root are
up to 2e-8 m higher: the polynomials' error is bounded for the moment about the root origin.
"""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.arm import HARD, ORDINARY, ROBUST, random_problem
from benchmarks.problems.driving import random_driving_problem
from tests.planning.conftest import LEANING, pose
from tests.rewritten import LIMITS, Array, rewritten, slope_of, turned_urdf
from zmp_sqp.cli import main
from zmp_sqp.mechanics.stability_measures import stability_measures
from zmp_sqp.planning import LumpedMass, simplified_coordinates
from zmp_sqp.planning.closed_forms.slew_circle import slew_insight
from zmp_sqp.scenario.load import load_scenario

TURNED, RAISED = {"turn": np.pi / 2}, {"raised": 0.5}
ROOTS = {"y forward": TURNED, "raised": RAISED, "both": {**TURNED, **RAISED}}
ALONE = ("y forward", "raised")
SAME = 1e-9  # [s, m]
ROUNDED = 1e-6  # [s] by which runs with corners in another order may differ
# [m] error of the proof's polynomials, which depends on where the root's origin is
PROVEN = 4e-7
# names of the edges follow the root's x axis (REP-103): with y forward they are a quarter turn off
NAMES = {"front": "left", "left": "rear", "rear": "right", "right": "front"}


def moved(problem: zs.Problem, root: str) -> zs.Problem:
    """The same problem for the machine of a rewritten URDF."""
    given = problem.machine
    machine = rewritten(**ROOTS[root])
    for frame in given.model.frames:
        if frame.name.startswith("payload"):
            carrier = given.model.frames[frame.parentFrame].name
            body = frame.inertia
            machine = machine.with_payload(zs.Payload(body.mass, body.lever, carrier, body.inertia))
    if not any(frame.inertia.inertia.any() for frame in given.model.frames):
        machine = machine.with_point_masses()
    ground = problem.ground
    if isinstance(ground, zs.Slope):
        ground = slope_of(ground, ROOTS[root].get("turn", 0.0))
    return replace(problem, machine=replace(machine, limits=given.limits), ground=ground)


def problem_of(name: str) -> zs.Problem:
    kind, _, seed = name.partition(" ")
    if kind == "hard":
        return random_problem(int(seed), HARD).problem
    if kind == "ordinary":
        return random_problem(int(seed), ORDINARY).problem
    if kind == "distances":
        simplified = load_scenario("paper_1_simplified").problem
        return replace(
            simplified,
            ground=zs.Slope(roll=-0.25, pitch=0.1),
            distance_limits=zs.DistanceLimits(0.9, 1.2),
        )
    return load_scenario(name).problem


def positions_of(plan: zs.Plan) -> Array:
    """Joint positions at 100 times, shape (100, 5)."""
    return np.asarray(plan.trajectory(np.linspace(0.0, plan.duration, 100))[0])


PROBLEMS = (
    *("paper_1", "paper_1_rigid", "paper_1_simplified", "distances", "paper_2", "torque"),
    *("hard 13", "hard 3", "hard 200", "ordinary 0", "ordinary 5"),
)


@pytest.mark.parametrize(
    ("name", "root"),
    [(name, "both") for name in PROBLEMS]
    + [(name, root) for name in ("paper_1_rigid", "distances", "torque") for root in ALONE],
)
def test_the_same_motion_has_the_same_margin(name: str, root: str) -> None:
    problem = problem_of(name)
    ours, theirs = zs.plan(problem), zs.plan(moved(problem, root))
    assert ours.success
    assert theirs.success, theirs.message
    assert (theirs.status, theirs.iterations) == (ours.status, ours.iterations)
    assert abs(theirs.duration - ours.duration) <= SAME
    one, other = ours.certificate, theirs.certificate
    assert abs(other.sampled - one.sampled) <= 5.0 * SAME
    assert abs(other.margin - one.margin) <= PROVEN
    assert np.abs(positions_of(theirs) - positions_of(ours)).max() <= 1e-4
    # one motion for both machines: nothing is left of the solver's rounding
    again = moved(problem, root)
    judged = zs.certify(again.machine, ours.trajectory, again.ground)
    assert judged.sampled == pytest.approx(one.sampled, abs=1e-12)
    names = [
        side.support.edge_name(done.edge)
        for side, done in ((problem.machine, one), (again.machine, judged))
    ]
    assert names[1] == (NAMES[names[0]] if "turn" in ROOTS[root] else names[0])


@pytest.mark.parametrize("root", ROOTS)
def test_an_uncertain_payload_and_slope_cost_the_same_time(root: str) -> None:
    """The pyramid about an uncertain gravity is aligned with the root: margins agree to 1e-5 m.

    Corners come in another order, so that runs which end at a change of 5e-5 round differently.
    """
    options = {"payload_uncertainty": 0.05, "slope_uncertainty": 0.01, "intervals": 25}
    problem = random_problem(0, ROBUST, **options).problem
    ours, theirs = zs.plan(problem), zs.plan(moved(problem, root))
    assert ours.success
    assert theirs.success
    assert abs(theirs.duration - ours.duration) <= ROUNDED
    assert abs(theirs.certificate.margin - ours.certificate.margin) <= 1e-5


@pytest.mark.parametrize("name", ["paper_2_joint", "retreat", "drive 2"])
def test_a_raised_root_drives_the_same(name: str) -> None:
    kind, _, seed = name.partition(" ")
    problem = random_driving_problem(int(seed)).problem if kind == "drive" else problem_of(name)
    ours, theirs = zs.plan(problem), zs.plan(moved(problem, "raised"))
    assert theirs.success
    assert abs(theirs.duration - ours.duration) <= SAME
    assert abs(theirs.certificate.margin - ours.certificate.margin) <= PROVEN


def test_a_raised_root_drives_the_same_over_terrain(monkeypatch) -> None:
    """The Hessian there lacks curvature that depends on the origin: another path, 1e-6 s longer.

    Proofs from other origins cut time into other stretches, so that margins agree to their
    resolution, which is 2e-5 m over terrain, and made finer here.
    """
    problem = problem_of("terrain")
    ours, theirs = zs.plan(problem), zs.plan(moved(problem, "raised"))
    assert theirs.success
    assert abs(theirs.duration - ours.duration) <= 1e-5
    monkeypatch.setattr("zmp_sqp.planning.constraints.tip_over.RESOLUTION", 4e-6)
    raised = moved(problem, "raised").machine
    found, judged = (
        zs.certify(machine, ours.trajectory, problem.ground)
        for machine in (problem.machine, raised)
    )
    assert judged.sampled == pytest.approx(found.sampled, abs=1e-12)
    assert judged.margin == pytest.approx(found.margin, abs=5e-7)


def test_a_base_drives_along_the_x_axis_of_its_root_whatever_is_forward() -> None:
    """A machine that is y-forward would drive sideways: braking moves its ZMP to its side."""
    base = zs.UnicycleBase(
        (0.0, 0.0, 0.0),
        (1.0, 0.0, 0.0),
        max_speed=1.0,
        max_acceleration=0.5,
        max_yaw_rate=0.5,
        max_yaw_acceleration=0.5,
    )
    margins = []
    for turn in (0.0, np.pi / 2):
        machine = rewritten(turn=turn)
        still = pose(0.0, -0.5)
        plan = zs.plan(zs.Problem(machine, still, still, base=base, intervals=10))
        margins.append(plan.certificate.margin)
    # level ground, 3 kN per track and more: half the width against half the length
    assert margins[1] != pytest.approx(margins[0], abs=1e-3)


@pytest.mark.parametrize("root", ROOTS)
def test_measures_and_closed_forms_are_the_same(root: str) -> None:
    problem = problem_of("paper_1_rigid")
    again = moved(problem, root)
    rng = np.random.default_rng(0)
    q, v, a = rng.uniform(-0.5, 0.5, (3, 20, 5)) + np.array([0.0, -0.5, -1.5, 0.0, 0.0])
    ours = stability_measures(problem.machine, q, v, a, problem.ground)
    theirs = stability_measures(again.machine, q, v, a, again.ground)
    for key in ("margin", "load_transfer_ratio", "force_angle", "tip_over_energy"):
        np.testing.assert_allclose(getattr(theirs, key), getattr(ours, key), rtol=1e-9, atol=1e-9)
    one, other = (slew_insight(side.machine, q[0]) for side in (problem, again))
    for key in ("mass", "distance", "height", "total_mass", "mean_height"):
        assert getattr(other, key) == pytest.approx(getattr(one, key), rel=1e-9)


@pytest.mark.parametrize("root", ROOTS)
def test_the_lumped_mass_is_the_same(root: str) -> None:
    one, other = (
        LumpedMass.of(machine, simplified_coordinates(machine, pose(0.0, -0.5, attitude=LEANING)))
        for machine in (rewritten(), rewritten(**ROOTS[root]))
    )
    np.testing.assert_allclose((other.A, other.B, other.mass), (one.A, one.B, one.mass), rtol=1e-12)


@pytest.mark.parametrize("root", ROOTS)
def test_check_judges_a_motion_the_same(
    root: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = zs.shipped_machines()["feller_buncher"]
    path = tmp_path / "machine.urdf"
    path.write_text(turned_urdf(source.read_text(), **ROOTS[root]))
    (tmp_path / "joint_limits.yaml").write_text(source.with_name(LIMITS).read_text())
    machine = zs.load_machine(source)
    motion = zs.phase_plane(machine, pose(0.0, -0.5), pose(1.5, -0.3))
    motion.to_csv(tmp_path / "motion.csv")
    told = []
    for urdf, turn in ((source, 0.0), (path, ROOTS[root].get("turn", 0.0))):
        slope = slope_of(zs.Slope(roll=-0.1, pitch=0.05), turn)
        angles = ["--roll", str(np.rad2deg(slope.roll)), "--pitch", str(np.rad2deg(slope.pitch))]
        code = main(["check", str(urdf), str(tmp_path / "motion.csv"), *angles])
        told.append((code, capsys.readouterr().out))
    assert told[0][0] == told[1][0] == 0
    certificates = [
        zs.certify(side, motion, slope_of(zs.Slope(roll=-0.1, pitch=0.05), turn))
        for side, turn in ((machine, 0.0), (rewritten(**ROOTS[root]), ROOTS[root].get("turn", 0.0)))
    ]
    assert certificates[0].sampled == pytest.approx(certificates[1].sampled, abs=1e-12)
    margins = [f"{found.margin:.3f}" for found in certificates]
    assert margins[0] == margins[1]
    assert all(margins[0] in text for _, text in told)


def test_some_of_the_suite_passes_on_the_rewritten_machine() -> None:
    """All tests of planning take minutes: `make rewritten`."""
    files = [f"tests/planning/test_{name}.py" for name in ("paper", "hard_problems")]
    options = ["-q", "-p", "no:cacheprovider", "--machine", "both"]
    root = Path(__file__).resolve().parents[2]
    run = subprocess.run(
        [sys.executable, "-m", "pytest", *options, *files],
        cwd=root,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert run.returncode == 0, run.stdout
    assert "passed" in run.stdout


@pytest.mark.physics
def test_the_physics_engine_sees_the_same() -> None:
    pytest.importorskip("mujoco")
    root = "both"
    problem = problem_of("paper_1_rigid")
    again = moved(problem, root)
    plan = zs.plan(problem)
    blind = zs.phase_plane(problem.machine, problem.start, problem.goal)
    stands = zs.replay(again.machine, plan.trajectory, again.ground)
    assert not stands.tipped
    assert stands.lift < 1e-4
    ours, theirs = (zs.replay(side.machine, blind, side.ground) for side in (problem, again))
    assert theirs.fell
    assert theirs.lifted_at == pytest.approx(ours.lifted_at, abs=2e-3)
    assert theirs.max_tilt == pytest.approx(ours.max_tilt, rel=1e-3)

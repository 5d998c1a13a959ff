"""Certificates against dense sampling of an own ZMP, and what must never be certified."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import zmp_sqp as zs
from benchmarks.problems.checks import joint_limit_excess
from tests.mechanics.conftest import PERMUTED, STEM, TREE_COM
from tests.planning.conftest import planned_paper_1
from tests.problems import slider
from zmp_sqp.mechanics.bounds.effort_bounds import effort_bounds
from zmp_sqp.motion.unicycle_motion import UnicycleMotion
from zmp_sqp.planning.constraints import tip_over
from zmp_sqp.planning.problem.unicycle_base import UnicycleBase
from zmp_sqp.planning.proof import corner_efforts, effort_curves
from zmp_sqp.planning.proof.limits_in_time import limit_excess
from zmp_sqp.planning.proof.subdivision import ROUNDING as TAKEN_OFF

Array = np.ndarray

ROUNDING = 1e-12  # relative to the larger of one metre and the margin itself
LOOSE = 3e-4  # [m] that a guarantee may fall short of the truth
EXACT = 1e-9
SPEEDS = {"slow": 0.02, "ordinary": 0.6, "fast": 4.0, "violent": 20.0}  # [rad/s or m/s]
OURS = ("excavator", "forwarder_crane", "mobile_manipulator")
MACHINES = (
    "feller_buncher",
    "rigid",
    "points",
    "slider",
    "slewing_crane",
    "permuted",
    "permuted with payload",
    *OURS,
)
LEVEL = zs.Slope()


@cache
def machine_of(name: str) -> zs.Machine:
    """Shipped machines, the paper's with its tree, and one with branches.

    The last one has a prismatic joint and two continuous ones.
    """
    if name in zs.shipped_machines():
        return zs.load_machine(name)
    if name in ("rigid", "points"):
        loaded = machine_of("feller_buncher").with_payload(
            zs.Payload(4000.0, TREE_COM, "head", np.diag([STEM, STEM, 0.0]))
        )
        return loaded if name == "rigid" else loaded.with_point_masses()
    with TemporaryDirectory() as folder:
        path = Path(folder) / "permuted.urdf"
        path.write_text(PERMUTED)
        machine = zs.load_machine(path)
    if name == "permuted":
        return machine
    return machine.with_payload(
        zs.Payload(50.0, (0.3, -0.2, 0.5), "tool", np.diag([5.0, 6.0, 7.0]))
    )


def integrated(
    machine: zs.Machine, times: Any, q: Any, v: Any, a: Any, j: Any = None
) -> zs.Trajectory:
    """Trajectory from its first state, accelerations and jerks."""
    times, a = np.asarray(times, dtype=float), np.asarray(a, dtype=float)
    j = np.zeros_like(a) if j is None else np.asarray(j, dtype=float)
    places, rates = [np.asarray(q, dtype=float)], [np.asarray(v, dtype=float)]
    for h, push, jerk in zip(np.diff(times), a, j, strict=True):
        places.append(places[-1] + h * rates[-1] + h**2 * push / 2.0 + h**3 * jerk / 6.0)
        rates.append(rates[-1] + h * push + h**2 * jerk / 2.0)
    return zs.Trajectory(machine.joint_names, times, np.array(places), np.array(rates), a, j)


def still(machine: zs.Machine, *, duration: float = 1.0, q: float = 0.0) -> zs.Trajectory:
    n = machine.size
    return integrated(machine, [0.0, duration], np.full(n, q), np.zeros(n), np.zeros((1, n)))


@dataclass(frozen=True)
class Case:
    machine: zs.Machine
    trajectory: zs.Trajectory
    ground: zs.Slope


def random_case(name: str, speed: float, seed: int, *, steps: Array | None = None) -> Case:
    """One interval of 5 s, a few of any length, or many of a millisecond.

    The support is sometimes aside and off z = 0.
    """
    rng = np.random.default_rng([seed, MACHINES.index(name), int(100 * speed)])
    machine = machine_of(name)
    n, support = machine.size, machine.support
    assert support is not None
    if seed % 2:
        support = zs.SupportPolygon(
            support.vertices + rng.uniform(-0.5, 0.5, 2), float(rng.choice([-0.5, 0.3]))
        )
        machine = machine.with_support(support)
    kinds = (
        np.array([5.0]),
        rng.uniform(0.02, 0.4, 6),
        10.0 ** rng.uniform(-4.0, -0.3, 8),
        np.full(300, 1e-3),
    )
    h = kinds[seed % len(kinds)] if steps is None else steps
    moving = rng.integers(0, 2, (3, n))
    push = speed / max(float(h.max()), 0.05) / np.sqrt(len(h))
    a, j = (
        push * moving[1] * rng.normal(size=(len(h), n)),
        push * moving[2] * rng.normal(size=(len(h), n)) / h[:, None],
    )
    times = np.concatenate([[0.0], np.cumsum(h)])
    trajectory = integrated(
        machine,
        times,
        rng.uniform(-1.0, 1.0, n),
        speed * moving[0] * rng.normal(size=n),
        a,
        j * (len(h) < 100),
    )
    return Case(machine, trajectory, zs.Slope(*rng.uniform(-0.4, 0.4, 2)))


def wrenches(machine: zs.Machine, q: Array, v: Array, a: Array, gravity: Array) -> Array:
    """Ground reaction about the root origin, gravity as the model's own, shape (K, 6)."""
    model = machine.model.copy()
    model.gravity = pin.Motion(gravity, np.zeros(3))
    data, zero = model.createData(), np.zeros((2, len(q), model.nv))
    zero[0][:, machine.index_v], zero[1][:, machine.index_v] = v, a
    rows = zip(machine.configuration(q), *zero, strict=True)
    return np.array([pin.rnea(model, data, *row)[:6] for row in rows])


def margins(machine: zs.Machine, q: Array, v: Array, a: Array, gravity: Array) -> Array:
    """Distance of the ZMP from the nearest edge (K,), -inf where the ground would pull."""
    support = machine.support
    assert support is not None
    fx, fy, fz, tx, ty, _ = wrenches(machine, q, v, a, gravity).T
    edges = np.roll(support.vertices, -1, axis=0) - support.vertices
    inward = np.column_stack([-edges[:, 1], edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
    offsets = np.einsum("ij,ij->i", inward, support.vertices)
    with np.errstate(all="ignore"):
        points = (
            np.column_stack([-(ty - support.height * fx), tx + support.height * fy]) / fz[:, None]
        )
        distances = (points @ inward.T - offsets).min(axis=1)
    return np.where(fz > 0.0, distances, -np.inf)


def least_sampled(case: Case, *, samples: int = 4000) -> float:
    """Least margin on a grid over every interval, and on a finer one about the least."""
    trajectory, gravity = case.trajectory, case.ground.gravity()
    shares = np.linspace(0.0, 1.0, max(3, samples // trajectory.intervals))
    _, q, v, a = trajectory.within(shares)
    found = margins(case.machine, q, v, a, gravity)
    k, at = divmod(int(found.argmin()), len(shares))
    near = np.linspace(shares[max(at - 1, 0)], shares[min(at + 1, len(shares) - 1)], 100)
    since = near * np.diff(trajectory.times)[k]
    closer = margins(case.machine, *trajectory.state_in(np.full(100, k), since), gravity)
    return float(min(found.min(), closer.min()))


def is_below(margin: float, least: float) -> bool:
    return margin == -np.inf or margin - least <= ROUNDING * max(1.0, abs(least))


# --- the guarantee ------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "speed"), list(product(MACHINES, SPEEDS)))
def test_the_guaranteed_margin_is_below_every_sample_and_close_to_the_least(
    name: str, speed: str
) -> None:
    for seed in range(4):
        case = random_case(name, SPEEDS[speed], seed)
        found = zs.certify(
            case.machine, case.trajectory, case.ground, margin=(0.0, -0.3, 0.2)[seed % 3]
        )
        least = least_sampled(case)
        if least == -np.inf:
            assert found.margin == -np.inf
            continue
        assert is_below(found.margin, least), seed
        assert found.margin <= found.sampled, seed
        assert found.margin >= found.sampled - LOOSE, seed


def look_at_whole_intervals(monkeypatch: pytest.MonkeyPatch, *, degree: int) -> None:
    """Let certificates take each interval as one polynomial, and leave its bound loose."""
    for module, constant, value in (
        (effort_curves, "DEGREES", (degree,)),
        (effort_curves, "TOLERANCE", np.inf),
        (tip_over, "RESOLUTION", 1e300),
    ):
        monkeypatch.setattr(module, constant, value)


@pytest.mark.parametrize("degree", [3, 6])
@pytest.mark.parametrize("name", MACHINES)
def test_the_error_of_a_single_polynomial_is_bounded_on_an_interval_of_any_length(
    name: str, degree: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    look_at_whole_intervals(monkeypatch, degree=degree)
    informative = 0
    for seed, (speed, length) in enumerate(product((0.1, 1.0, 10.0), np.geomspace(0.01, 1.0, 12))):
        case = random_case(name, speed, seed, steps=np.array([length / speed]))
        found = zs.certify(case.machine, case.trajectory, case.ground, margin=-1e9)
        if found.margin == -np.inf:
            continue
        least = least_sampled(case, samples=400)
        informative += found.sampled - found.margin > 1e-6
        assert is_below(found.margin, least), seed
    assert informative >= 5 or (name, degree) == ("slider", 6)  # its efforts have the degree 4


@given(seed=st.integers(0, 2**31), speed=st.floats(0.01, 20.0), name=st.sampled_from(MACHINES))
@settings(max_examples=25, deadline=None, derandomize=True)
def test_no_motion_that_hypothesis_finds_is_certified_above_its_samples(
    seed: int, speed: float, name: str
) -> None:
    case = random_case(name, speed, seed)
    least = least_sampled(case, samples=2000)
    assert is_below(zs.certify(case.machine, case.trajectory, case.ground).margin, least)


@pytest.mark.parametrize("name", MACHINES)
def test_second_derivatives_of_the_wrench_stay_below_their_bound(name: str) -> None:
    machine = machine_of(name)
    weights = np.array(
        [-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560]
    )
    for seed in range(150):
        rng = np.random.default_rng(seed)
        speed = 10.0 ** rng.uniform(-1.0, 1.3)
        moving = rng.integers(0, 2, (3, machine.size))
        v, a, j = (
            moving * rng.normal(size=moving.shape) * np.array([[speed], [speed**2], [speed**3]])
        )
        q, step = rng.uniform(-3.0, 3.0, machine.size), 0.02 / max(speed, 1.0)
        t = step * np.arange(-4, 5)[:, None]
        states = (
            q + t * v + t**2 * a / 2.0 + t**3 * j / 6.0,
            v + t * a + t**2 * j / 2.0,
            a + t * j,
        )
        gravity = zs.Slope(*rng.uniform(-1.0, 1.0, 2)).gravity()
        wrench = wrenches(machine, *states, gravity)
        second = weights @ wrench / step**2
        noise = 1e-10 * float(np.abs(wrench).max()) / step**2
        most = (np.abs(v)[None], np.abs(a)[None], np.abs(j)[None])
        size, bound = effort_bounds(machine, *most, reach=np.abs(q)[None], gravity=9.81)
        assert np.linalg.norm(second[:3]) <= bound.force[0] * (1.0 + 1e-6) + noise, seed
        assert np.linalg.norm(second[3:]) <= bound.moment[0] * (1.0 + 1e-6) + noise, seed
        assert np.linalg.norm(wrench[4, :3]) <= size.force[0] * (1.0 + ROUNDING), seed
        assert np.linalg.norm(wrench[4, 3:]) <= size.moment[0] * (1.0 + ROUNDING), seed


def test_the_bound_on_a_crane_that_slews_steadily_is_m_r_w4_itself() -> None:
    """1000 kg at 2 m: a centripetal force that turns."""
    one = np.ones((1, 1))
    _, bound = effort_bounds(
        machine_of("slewing_crane"), 3.0 * one, 0.0 * one, 0.0 * one, reach=one, gravity=9.81
    )
    assert bound.force[0] == pytest.approx(1000.0 * 2.0 * 3.0**4)


def test_the_least_sample_is_where_and_when_the_certificate_says() -> None:
    case = random_case("rigid", 0.6, 1)
    found = zs.certify(case.machine, case.trajectory, case.ground)
    support = case.machine.support
    assert support is not None
    k = int(np.clip(np.searchsorted(case.trajectory.times, found.margin_at) - 1, 0, None))
    since = np.array([found.margin_at - case.trajectory.times[k]])
    state = case.trajectory.state_in(np.array([k]), since)
    point = zs.zmp(case.machine, *state, case.ground)[0]
    distances = support.offsets - support.normals @ point
    assert int(distances.argmin()) == found.edge
    assert distances.min() == pytest.approx(found.sampled, abs=2.0 * effort_curves.TOLERANCE)


def test_a_margin_that_is_kept_by_a_micrometre_is_proven() -> None:
    case = random_case("rigid", 0.6, 1)
    sampled = zs.certify(case.machine, case.trajectory, case.ground).sampled
    kept = zs.certify(case.machine, case.trajectory, case.ground, margin=sampled - 1e-6)
    missed = zs.certify(case.machine, case.trajectory, case.ground, margin=sampled + 1e-6)
    assert kept.margin >= kept.required
    assert missed.margin < missed.required
    assert not missed.safe


def test_a_jolt_of_a_microsecond_in_a_calm_motion_is_seen() -> None:
    machine = machine_of("slider")
    a = np.array([[0.0], [30.0], [-30.0], [0.0]])
    trajectory = integrated(machine, [0.0, 1.0, 1.0 + 1e-6, 1.0 + 2e-6, 2.0], [0.0], [0.0], a)
    found = zs.certify(machine, trajectory, LEVEL)
    assert found.sampled < -5.0
    assert found.margin_at == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize("point_masses", [True, False])
def test_the_paper_plans_certificate_holds_at_ten_kilohertz(point_masses: bool) -> None:
    named, plan = planned_paper_1(point_masses)
    case = Case(named.problem.machine, plan.trajectory, named.scene.ground)
    least = least_sampled(case, samples=int(1e4 * plan.duration))
    assert plan.certificate.safe
    assert 0.0 <= plan.margin <= least
    assert plan.certificate.gap == pytest.approx(plan.duration / plan.lower_bound - 1.0, abs=EXACT)


def test_a_plan_that_hugs_the_edge_holds_at_ten_kilohertz() -> None:
    named = slider(intervals=25)
    plan = zs.plan(named.problem)
    case = Case(named.problem.machine, plan.trajectory, named.scene.ground)
    assert plan.certificate.safe
    assert 0.0 <= plan.margin <= least_sampled(case, samples=int(1e4 * plan.duration)) < 1e-3


# --- what must never be certified ---------------------------------------------------------------


def test_a_machine_that_lifts_off_has_no_margin() -> None:
    machine = machine_of("feller_buncher")
    a = [[0.0, -100.0, 0.0, 0.0, 0.0]]
    for end in (0.0, 0.1):  # the first without any curvature
        trajectory = integrated(machine, [0.0, end], [0.0, -1.0, -1.0, 0.0, 0.0], np.zeros(5), a)
        found = zs.certify(machine, trajectory, LEVEL)
        assert found.margin == found.sampled == -np.inf
        assert not found.safe


@pytest.mark.parametrize("size", [1e200, 1e300, 1.7e308])
def test_what_overflows_has_no_margin(size: float) -> None:
    machine = machine_of("permuted")
    n = machine.size
    rest, far, motion = (
        np.zeros((2, n)),
        np.full((2, n), size),
        np.array([[-0.5], [0.5]]) * np.full((2, n), size),
    )
    names = machine.joint_names
    for trajectory in (
        zs.Trajectory(names, [0.0, 1.0], far * np.sign([[-1.0, 1.0, 1.0]]), rest, rest[:1]),
        zs.Trajectory(names, [0.0, 1.0], motion, far, rest[:1]),
        zs.Trajectory(names, [0.0, 0.0], rest, rest, far[:1]),
        zs.Trajectory(names, [0.0, 0.0], rest, far, rest[:1]),
    ):
        found = zs.certify(machine, trajectory, LEVEL)
        # an acceleration that does not overflow has a zero moment point, here outside
        assert found.margin == -np.inf or found.margin <= found.sampled < 0.0
        assert not found.safe


@pytest.mark.parametrize("turns", [1e3, 1e6, 1e9, 1e12])
def test_a_coordinate_that_is_known_to_some_digits_only_costs_margin(turns: float) -> None:
    """An ulp of the angle moves the ZMP, which shows above 1e5 turns."""
    machine = machine_of("slewing_crane")
    angle = np.full((1, 1), 2.0 * np.pi * turns + 0.7)
    found = zs.certify(machine, still(machine, q=angle.item()), zs.Slope(0.2, 0.1))
    rest = np.zeros((1, 1))
    for one in (np.nextafter(angle, 0.0), angle, np.nextafter(angle, np.inf)):
        assert found.margin <= margins(machine, one, rest, rest, zs.Slope(0.2, 0.1).gravity())[0]


def test_gravity_of_any_strength_is_in_the_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a ground of their own people may put any gravity; here it decides the curvature alone."""
    look_at_whole_intervals(monkeypatch, degree=3)

    class Heavy:
        def gravity(self, yaw: float = 0.0) -> Array:
            return np.array([0.0, 0.0, -1e6])

    machine = machine_of("slider")
    trajectory = integrated(machine, [0.0, 1.0], [0.0], [4.0], [[-8.0]])  # there and back: 1 m
    found = zs.certify(machine, trajectory, Heavy(), margin=-1e9)
    assert found.margin <= margins(machine, *trajectory([0.5]), Heavy().gravity())[0]


def test_an_acceleration_hidden_in_gaps_between_many_nodes_is_refused() -> None:
    """0.9 rad/s^2 in jumps of 9e-7 rad/s: each is below what a trajectory's own check notices."""
    machine = machine_of("feller_buncher")
    count, h = 2000, 1e-6
    v = 9e-7 * np.arange(count + 1)[:, None] * np.ones(5)
    q = np.vstack([np.zeros((1, 5)), np.cumsum(h * v[:-1], axis=0)])
    with pytest.raises(zs.TrajectoryError, match=r"drift|do not follow"):
        zs.certify(
            machine,
            zs.Trajectory(
                machine.joint_names, h * np.arange(count + 1), q, v, np.zeros((count, 5))
            ),
            LEVEL,
        )


def test_corrupted_trajectories_are_refused() -> None:
    good = random_case("rigid", 0.6, 1).trajectory
    fields = ("times", "positions", "velocities", "accelerations", "jerks")
    for field, value in product(fields, (np.nan, np.inf, 1e-3)):
        arrays = {name: np.array(getattr(good, name)) for name in fields}
        arrays[field][-1] += value * (1.0 if field != "jerks" else 10.0)
        with pytest.raises(zs.TrajectoryError):
            zs.Trajectory(good.joint_names, **arrays)


def test_misuse_is_refused() -> None:
    machine, other = machine_of("feller_buncher"), machine_of("slider")
    motion = still(machine)

    class Odd:
        def __init__(self, *gravity: float) -> None:
            self.value = gravity

        def gravity(self, yaw: float = 0.0) -> Any:
            return self.value

    wrong: list[tuple[Any, type[zs.ZmpSqpError]]] = [
        ((None, motion, LEVEL), zs.MachineError),
        ((machine, None, LEVEL), zs.TrajectoryError),
        ((machine, motion, None), zs.ProblemError),
        ((machine, motion, Odd(0.0, 0.0, np.nan)), zs.ProblemError),
        ((machine, motion, Odd(0.0, 0.0)), zs.ProblemError),
        ((machine, still(other), LEVEL), zs.ProblemError),
        ((machine, motion, LEVEL, np.nan), zs.ProblemError),
        ((machine, motion, LEVEL, "wide"), zs.ProblemError),
    ]
    for arguments, error in wrong:
        with pytest.raises(error):
            zs.certify(*arguments)


def test_a_ground_that_pulls_the_machine_up_gives_no_margin() -> None:
    class Ceiling:
        def gravity(self, yaw: float = 0.0) -> Array:
            return np.array([0.0, 0.0, 9.81])

    machine = machine_of("feller_buncher")
    assert zs.certify(machine, still(machine), Ceiling()).margin == -np.inf


# --- how much it takes --------------------------------------------------------------------------


@pytest.mark.parametrize("duration", [1e3, 1e6, 1e9])
def test_a_long_motion_that_is_slow_takes_few_states(
    duration: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked_at = []
    inner = corner_efforts.efforts
    monkeypatch.setattr(
        corner_efforts,
        "efforts",
        lambda m, q, *rest, **more: looked_at.append(len(q)) or inner(m, q, *rest, **more),
    )
    machine = machine_of("slewing_crane")
    trajectory = integrated(machine, [0.0, duration], [0.0], [1e-3 / duration], [[0.0]])
    found = zs.certify(machine, trajectory, LEVEL)
    assert sum(looked_at) <= 100
    assert found.margin == pytest.approx(found.sampled, abs=LOOSE)


def test_a_motion_at_exactly_the_asked_margin_ends() -> None:
    machine = machine_of("slider")
    trajectory = integrated(machine, [0.0, 1.0], [0.0], [0.1], [[0.2]])
    sampled = zs.certify(machine, trajectory, LEVEL).sampled
    assert not zs.certify(machine, trajectory, LEVEL, margin=sampled).safe


@pytest.mark.parametrize("nodes", [2, 3])
def test_a_motion_of_no_duration_has_the_margin_of_its_state(nodes: int) -> None:
    machine = machine_of("feller_buncher")
    rest = np.zeros((nodes, 5))
    found = zs.certify(
        machine, zs.Trajectory(machine.joint_names, np.zeros(nodes), rest, rest, rest[1:]), LEVEL
    )
    static = margins(machine, rest[:1], rest[:1], rest[:1], LEVEL.gravity())[0]
    assert static - 2.0 * TAKEN_OFF <= found.margin <= static


# --- joint limits -------------------------------------------------------------------------------


@given(
    seed=st.integers(0, 2**31),
    size=st.floats(1e-6, 1e6),
    shape=st.sampled_from(["cubic", "parabola", "line"]),
)
@settings(max_examples=150, deadline=None, derandomize=True)
def test_limit_excess_is_that_of_dense_samples_and_of_bisection(
    seed: int, size: float, shape: str
) -> None:
    machine = machine_of("feller_buncher")
    rng = np.random.default_rng(seed)
    h = 10.0 ** rng.uniform(-3.0, 0.5, 4)
    a = size * rng.normal(size=(4, 5)) * (shape != "line")
    j = size * rng.normal(size=(4, 5)) / h[:, None] * (shape == "cubic")
    q, v = size * rng.normal(size=5), size * rng.normal(size=5)
    trajectory = integrated(machine, np.concatenate([[0.0], np.cumsum(h)]), q, v, a, j)
    limits = machine.limits
    found = limit_excess(machine, trajectory)[0]
    _, q, v, a = trajectory.within(np.linspace(0.0, 1.0, 500))
    over = (np.abs(v) - limits.velocity, np.abs(a) - limits.acceleration)
    sampled = max(
        float(part.max()) for part in (*over, q - limits.position_upper, limits.position_lower - q)
    )
    scale = max(1.0, float(np.abs(q).max()), float(np.abs(v).max()), float(np.abs(a).max()))
    assert sampled <= found + EXACT * scale
    assert found == pytest.approx(joint_limit_excess(limits, trajectory), abs=EXACT * scale)


def test_a_rate_and_a_position_that_peak_inside_an_interval_count() -> None:
    machine = machine_of("slider").with_limits(velocity=1.0, acceleration=100.0)
    # v = 6 t (1 - t): 1.5 m/s in the middle, nothing at the ends
    rate = integrated(machine, [0.0, 1.0], [0.0], [0.0], [[6.0]], [[-12.0]])
    assert limit_excess(machine, rate)[0] == pytest.approx(0.5, abs=EXACT)
    # q = 8 t (1 - t): 2 m in the middle, where the limit is 1 m
    place = integrated(machine.with_limits(velocity=100.0), [0.0, 1.0], [0.0], [8.0], [[-16.0]])
    assert limit_excess(machine.with_limits(velocity=100.0), place)[0] == pytest.approx(
        1.0, abs=EXACT
    )


def test_an_interval_whose_end_is_off_its_node_counts_with_its_own_end() -> None:
    machine = machine_of("slider")
    upper = float(machine.limits.position_upper[0])
    q, v = [[upper - 1.0 + 5e-7], [upper]], [[1.0], [1.0]]
    trajectory = zs.Trajectory(machine.joint_names, [0.0, 1.0], q, v, [[0.0]])
    assert limit_excess(machine, trajectory)[0] == pytest.approx(5e-7, abs=EXACT)


def test_limits_that_nobody_has_given_are_not_exceeded_and_the_others_are() -> None:
    machine = machine_of("permuted")  # no acceleration limits
    n = machine.size
    calm = integrated(machine, [0.0, 1.0], np.zeros(n), np.full(n, 0.1), np.zeros((1, n)))
    quick = integrated(machine, [0.0, 1.0], np.zeros(n), np.full(n, 0.6), np.zeros((1, n)))
    assert zs.certify(machine, calm, LEVEL).limits_ok
    found = zs.certify(machine, quick, LEVEL)
    assert found.limit_excess == pytest.approx(0.1)  # of the sliding joint's rate
    assert not found.limits_ok
    assert not found.safe


def test_a_rate_a_thousand_times_a_tiny_limit_is_not_rounding() -> None:
    machine = machine_of("slider").with_limits(velocity=1e-12)
    trajectory = integrated(machine, [0.0, 1.0], [0.0], [1e-9], [[0.0]])
    assert not zs.certify(machine, trajectory, LEVEL).limits_ok
    assert zs.certify(machine_of("slider").with_limits(velocity=1e-9), trajectory, LEVEL).limits_ok


# --- a base that drives -------------------------------------------------------------------------


def driving_case(seed: int, speed: float, steps: Array) -> Case:
    """A random motion of the arm while the base drives and turns at random."""
    case = random_case(("rigid", "permuted")[seed % 2], speed, seed, steps=steps)
    rng = np.random.default_rng([seed, int(100 * speed)])
    times, h = case.trajectory.times, np.diff(case.trajectory.times)
    pushes = speed / np.maximum(h[:, None], 0.05) * rng.normal(size=(2, len(h), 2))
    a, j = pushes[0], pushes[1] / h[:, None]
    v, yaw = [speed * rng.normal(size=2)], [rng.uniform(-3.0, 3.0)]
    for step, push, jerk in zip(h, a, j, strict=True):
        yaw.append(yaw[-1] + step * v[-1][1] + step**2 * push[1] / 2.0 + step**3 * jerk[1] / 6.0)
        v.append(v[-1] + step * push + step**2 * jerk / 2.0)
    base = UnicycleMotion.from_start(times, np.zeros(3), np.array(v), np.array(yaw), (a, j))
    return Case(case.machine, replace(case.trajectory, base=base), case.ground)


def least_driving(case: Case, *, samples: int) -> float:
    """Least margin with the root's motion in the model itself and gravity in the world."""
    trajectory, machine = case.trajectory, case.machine
    base, support = trajectory.base, machine.support
    assert base is not None
    assert support is not None
    shares = np.linspace(0.0, 1.0, samples)
    k = np.repeat(np.arange(trajectory.intervals), samples)
    since = np.outer(np.diff(trajectory.times), shares).ravel()
    pose, twist, push = base.state_in(k, since)
    q, v, a = trajectory.state_in(k, since)
    model = machine.model.copy()
    model.gravity = pin.Motion(case.ground.gravity(), np.zeros(3))
    data, full, rates = (
        model.createData(),
        machine.configuration(q),
        np.zeros((2, len(q), model.nv)),
    )
    full[:, 5], full[:, 6] = np.sin(pose[:, 2] / 2.0), np.cos(pose[:, 2] / 2.0)
    for array, joints, root in ((rates[0], v, twist), (rates[1], a, push)):
        array[:, machine.index_v], array[:, [0, 5]] = joints, root
    wrench = np.array([pin.rnea(model, data, *row)[:6] for row in zip(full, *rates, strict=True)])
    fx, fy, fz, tx, ty, _ = wrench.T
    points = np.column_stack([-(ty - support.height * fx), tx + support.height * fy]) / fz[:, None]
    return float(support.signed_distance(points).min()) if (fz > 0.0).all() else -np.inf


@pytest.mark.parametrize("speed", [0.1, 1.0, 5.0])
def test_the_guarantee_holds_while_the_base_drives_and_turns(speed: float) -> None:
    for seed in range(6):
        case = driving_case(seed, speed, np.array([0.2, 0.1, 0.3]) / max(speed, 1.0))
        found = zs.certify(case.machine, case.trajectory, case.ground)
        least = least_driving(case, samples=400)
        assert is_below(found.margin, least), seed
        assert found.margin == -np.inf or found.margin >= found.sampled - LOOSE, seed


def test_the_interpolation_error_is_bounded_over_a_single_stretch_of_a_driving_base(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    look_at_whole_intervals(monkeypatch, degree=4)
    informative = 0
    for seed, (speed, length) in enumerate(product((0.1, 1.0, 5.0), np.geomspace(0.01, 0.5, 12))):
        case = driving_case(seed, speed, np.array([length / max(speed, 1.0)]))
        found = zs.certify(case.machine, case.trajectory, case.ground, margin=-1e9)
        informative += np.isfinite(found.margin) and found.sampled - found.margin > 1e-6
        assert is_below(found.margin, least_driving(case, samples=200)), seed
    assert informative >= 5


def test_a_base_that_breaks_its_limits_or_does_not_arrive_is_not_safe() -> None:
    """The joints keep theirs."""
    machine = machine_of("feller_buncher")
    still_arm = still(machine, q=-0.5)
    pushes = np.zeros((1, 2)), np.zeros((1, 2))
    drive = UnicycleMotion.from_start(
        still_arm.times, np.zeros(3), np.array([[0.5, 0.0]] * 2), np.zeros(2), pushes
    )
    trajectory = replace(still_arm, base=drive)
    limits = {"max_acceleration": 1.0, "max_yaw_rate": 1.0, "max_yaw_acceleration": 1.0}
    rates = {"start_velocity": [0.5, 0.0], "goal_velocity": [0.5, 0.0]}
    good = UnicycleBase([0.0, 0.0, 0.0], [0.5, 0.0, 0.0], max_speed=1.0, **limits, **rates)
    elsewhere = UnicycleBase([0.0, 0.0, 0.0], [0.6, 0.0, 0.0], max_speed=1.0, **limits, **rates)
    slower = UnicycleBase([0.0, 0.0, 0.0], [0.5, 0.0, 0.0], max_speed=0.4, **limits)
    assert zs.certify(machine, trajectory, LEVEL, base=good).limits_ok
    for base in (elsewhere, slower):
        found = zs.certify(machine, trajectory, LEVEL, base=base)
        assert not found.limits_ok
        assert not found.safe

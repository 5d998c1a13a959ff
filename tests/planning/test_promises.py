"""Ways in which a motion once got `success` or `safe` without keeping what was asked, and crashes.

Each test is a case that an attack on the library found.
"""

from __future__ import annotations

import copy
import pickle
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zmp_sqp as zs
from zmp_sqp.planning.proof.subdivision import LeastValue
from zmp_sqp.scenario import load_scenario
from zmp_sqp.sqp.backends.piqp import PIQP
from zmp_sqp.sqp.backends.proxqp import ProxQP
from zmp_sqp.sqp.backends.qpsolvers import QPSolvers
from zmp_sqp.sqp.qp import QP

START = np.array([0.0, -0.8, -2.0, 0.7, 0.0])  # of the feller-buncher, slew to head [rad]
GOAL = START + np.array([2.0, 0.3, 0.2, 0.0, 0.0])
SLOW = 0.4  # [rad/s]
PAIR = """\
<robot name="pair">
  <link name="base"><inertial><mass value="100"/>{inertia}</inertial></link>
  <joint name="leader" type="prismatic">
    <parent link="base"/><child link="a"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" velocity="1" effort="100"/>
  </joint>
  <link name="a"><inertial><mass value="1"/>{inertia}</inertial></link>
  <joint name="follower" type="prismatic">
    <parent link="a"/><child link="b"/><axis xyz="1 0 0"/>
    <limit lower="-0.5" upper="0.5" velocity="0.2" effort="1"/><mimic joint="leader"/>
  </joint>
  <link name="b"><inertial><mass value="1"/>{inertia}</inertial></link>
</robot>
"""
INERTIA = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'


def slow(machine: zs.Machine, q: Any, v: Any, a: Any) -> tuple[np.ndarray, np.ndarray]:
    jacobian = np.zeros((len(q), 1, 15))
    jacobian[:, 0, 5] = 1.0
    return v[:, :1] - SLOW, jacobian


def test_a_function_that_overwrites_its_arguments_changes_no_motion() -> None:
    """Tip-over and other constraints must see the states, not what a function left of them."""

    def careless(machine: zs.Machine, q: Any, v: Any, a: Any) -> tuple[np.ndarray, np.ndarray]:
        found = slow(machine, q, v, a)
        found = found[0].copy(), found[1]
        for part in (q, v, a):
            part[:] = 0.0
        return found

    machine, ground = zs.load_machine("feller_buncher"), zs.Slope(roll=-0.1)
    plans = [
        zs.plan(
            zs.Problem(machine, START, GOAL, ground, constraints=[zs.PathRows("slow", function)])
        )
        for function in (slow, careless)
    ]
    assert plans[0].success
    assert plans[1].margin == plans[0].margin
    np.testing.assert_array_equal(plans[1].trajectory.positions, plans[0].trajectory.positions)


@pytest.mark.parametrize("kind", ["generator", "map", "own class"])
def test_constraints_that_can_be_read_only_once_hold_for_every_call(kind: str) -> None:
    class Once:
        def __init__(self) -> None:
            self.left = iter([zs.PathRows("slow", slow)])

        def __iter__(self) -> Iterator[zs.PathRows]:
            return self.left

    given: Any = {
        "generator": (zs.PathRows("slow", one) for one in [slow]),
        "map": map(lambda one: zs.PathRows("slow", one), [slow]),
        "own class": Once(),
    }[kind]
    machine = zs.load_machine("feller_buncher")
    planner = zs.Planner(machine, intervals=20, constraints=given)
    for k in range(3):
        plan = planner.plan(START, GOAL + 0.05 * k * np.eye(5)[0])
        assert plan.success
        assert plan.trajectory.velocities[:, 0].max() <= SLOW
        assert "slow" in [found.name for found in plan.certificate.guarantees]


def test_a_list_of_constraints_may_grow_between_calls() -> None:
    given: list[Any] = []
    planner = zs.Planner(zs.load_machine("feller_buncher"), intervals=20, constraints=given)
    assert planner.plan(START, GOAL).trajectory.velocities[:, 0].max() > 1.5 * SLOW
    given.append(zs.PathRows("slow", slow))
    assert planner.plan(START, GOAL).trajectory.velocities[:, 0].max() <= SLOW


@pytest.mark.parametrize("bound", [None, 100.0])
def test_rows_that_a_function_leaves_out_later_are_an_error(bound: float | None) -> None:
    def rows(machine: zs.Machine, q: Any, v: Any, a: Any) -> tuple[np.ndarray, np.ndarray]:
        jacobian = np.zeros((len(q), 2, 15))
        jacobian[:, 0, 0] = jacobian[:, 1, 5] = 1.0
        values = np.column_stack([q[:, 0] - 9.0, v[:, 0] - SLOW])
        kept = slice(None) if len(q) < 4 else slice(1)  # "only the active ones"
        return values[:, kept], jacobian[:, kept]

    constraint = zs.PathRows("two", rows, labels=["yaw", "rate"], curvature_bound=bound)
    machine = zs.load_machine("feller_buncher")
    with pytest.raises(zs.ProblemError, match=r"'two': its function gives 1 rows .* always give"):
        zs.plan(zs.Problem(machine, START, GOAL, intervals=20, constraints=[constraint]))
    motion = zs.phase_plane(machine, START, GOAL)
    with pytest.raises(zs.ProblemError, match="always give the same rows"):
        zs.certify(machine, motion, zs.Slope(), constraints=[constraint])


def test_a_bound_that_is_no_number_guarantees_nothing() -> None:
    value = LeastValue()
    value.keep(np.array([1.0, np.nan]))
    value.keep(np.array([2.0]))
    assert value.guaranteed == -np.inf
    machine = zs.load_machine("feller_buncher")
    for size in (1e30, 1e100, 1e140):
        a = np.zeros((1, 5))
        a[0, 1] = size
        nodes = np.stack([START, START + 0.5 * a[0]])
        motion = zs.Trajectory(machine.joint_names, [0.0, 1.0], nodes, [0.0 * a[0], a[0]], a)
        found = zs.certify(machine, motion, zs.Slope(), constraints=[zs.TorqueLimits()])
        assert not found.safe
        assert all(one.value < np.inf for one in found.guarantees)


def test_limits_that_a_mimic_does_not_allow_are_said(tmp_path: Path) -> None:
    path = tmp_path / "pair.urdf"
    path.write_text(PAIR.format(inertia=INERTIA), "utf-8")
    stand = zs.SupportPolygon([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    with pytest.warns(zs.MachineWarning, match="pass the velocity limit of 'follower', which mimi"):
        zs.load_machine(path, support=stand, limits={"acceleration": 1.0, "velocity": 0.3})
    with pytest.warns(zs.MachineWarning, match="pass the upper position limit of 'follower'"):
        zs.load_machine(path, support=stand, limits={"acceleration": 1.0, "position_upper": 0.6})
    kept = zs.load_machine(path, support=stand, limits={"acceleration": 1.0, "velocity": 0.2})
    np.testing.assert_array_equal(kept.limits.position_upper, [0.5])


def test_ground_that_no_problem_accepts_gets_no_certificate() -> None:
    grid = np.arange(-6.0, 6.01, 0.1)
    x, y = np.meshgrid(grid, grid, indexing="ij")
    bump = 0.8 * np.exp(-((x - 1.2) ** 2 + (y - 1.0) ** 2) / 0.5)
    ground = zs.Heightmap(bump, 0.1, (-6.0, -6.0))
    machine = zs.load_machine("feller_buncher")
    with pytest.raises(zs.ProblemError, match="too rough"):
        zs.Problem(machine, START, GOAL, ground=ground)
    with pytest.raises(zs.ProblemError, match="too rough"):
        zs.certify(machine, zs.phase_plane(machine, START, GOAL), ground)


# --- crashes ------------------------------------------------------------------------------------


@pytest.mark.parametrize("solver", ["auto", "proxqp", "qpsolvers:daqp"])
@pytest.mark.parametrize("intervals", [2, 3])
def test_few_intervals_within_a_budget(intervals: int, solver: str) -> None:
    planner = zs.Planner(zs.load_machine("slider"), intervals=intervals, qp_solver=solver)
    first = planner.plan([-0.5], [0.5])
    q, v, _ = first.trajectory(0.1 * first.duration)
    again = planner.plan(q, [0.45], v, time_budget=0.5)
    assert again.success
    assert again.certificate.safe


@pytest.mark.parametrize("backend", [PIQP(), ProxQP(), QPSolvers("daqp")], ids=lambda b: b.name)
def test_a_qp_without_variables_has_a_solution_if_its_rows_hold(backend: Any) -> None:
    import scipy.sparse as sp

    nothing = sp.csc_matrix((0, 0))
    for u, holds in (([0.1, 0.0], True), ([0.1, -0.1], False)):
        rows = sp.csc_matrix((2, 0))
        qp = QP(nothing, np.zeros(0), None, np.zeros(0), rows, np.array(u))
        found = backend.solve(qp, tolerance=1e-8, iterations=20)
        assert found.solved is holds
        assert found.x.shape == (0,)
        assert backend.solve_again(np.array([1.0, -1.0]), np.zeros(0)).solved is False


def test_joints_without_an_upper_limit_can_be_searched_for() -> None:
    machine = zs.load_machine("slewing_crane", limits={"position_upper": np.inf})
    bounded = zs.load_machine("slewing_crane", limits={"position_upper": 10.0})
    plans = [zs.plan(zs.Problem(one, [0.0], [2.0], intervals=20)) for one in (machine, bounded)]
    assert plans[0].iterations > 0
    assert plans[0].success
    assert plans[0].duration == pytest.approx(plans[1].duration, rel=1e-3)
    stop = zs.plan_stop(machine, [0.0], [0.3])
    assert stop.success


def test_turned_inertias_that_are_symmetric_but_for_rounding_load(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    stand = zs.SupportPolygon([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    for number in range(30):
        moments = 10.0 ** rng.uniform(3.0, 6.0) * rng.uniform(0.6, 1.0, 3)
        turn = " ".join(f"{angle:.6f}" for angle in rng.uniform(-3.0, 3.0, 3))
        names = " ".join(
            f'{name}="{value!r}"'
            for name, value in zip(("ixx", "iyy", "izz"), map(float, moments), strict=True)
        )
        turned = f'<origin rpy="{turn}"/><inertia {names} ixy="0" ixz="0" iyz="0"/>'
        path = tmp_path / f"turned_{number}.urdf"
        path.write_text(PAIR.format(inertia=turned).replace('value="1"', 'value="1e5"'), "utf-8")
        machine = zs.load_machine(path, support=stand, limits={"acceleration": 0.1})
        inertia = machine.model.inertias[2].inertia
        np.testing.assert_array_equal(inertia, inertia.T)


def test_boundaries_of_the_lumped_mass_are_proven_beside_uncertain_payloads() -> None:
    """Rows that do not depend on the corner have no stretches left where others still have."""

    def pose(slew: float, boom: float) -> np.ndarray:
        return np.array([slew, boom, -np.pi - 2.0 * boom, 0.4 + boom, 0.0])

    load = zs.Payload(mass=1000.0, com=(0.0, 0.0, 1.5), frame="head")
    plan = zs.plan(
        zs.Problem(
            zs.load_machine("feller_buncher").with_payload(load),
            pose(0.0, -1.0),
            pose(3.0, -0.6),
            ground=zs.Slope(-0.1),
            model="simplified",
            margin=0.1,
            intervals=8,
            distance_limits=zs.DistanceLimits(velocity=0.3, acceleration=0.5),
            payload_uncertainty=0.1,
        )
    )
    assert plan.success
    assert "distance_limits" in [found.name for found in plan.certificate.guarantees]


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
def test_copies_can_be_written_to_no_more_than_what_they_are_copies_of(copied: Any) -> None:
    machine = zs.load_machine("feller_buncher")
    problem = zs.Problem(machine, START, GOAL)
    motion = zs.phase_plane(machine, START, GOAL)
    stop = zs.plan_stop(machine, START, np.full(5, 0.1))
    same = copied(machine)
    for array in (
        copied(stop.problem).start,
        same.support.offsets,
        same.support.vertices,
        same.limits.velocity,
        copied(problem).goal,
        copied(motion).positions,
    ):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0
    assert (
        zs.certify(same, motion, zs.Slope()).margin
        == zs.certify(machine, motion, zs.Slope()).margin
    )


def test_numbers_in_lists_may_change_between_calls_of_a_planner() -> None:
    machine = zs.load_machine("feller_buncher").with_payload(
        zs.Payload(mass=1000.0, com=(0.0, 0.0, 1.5), frame="head")
    )
    box = [np.array(0.0), 0.0, 0.0]
    planner = zs.Planner(machine, margin=0.05, intervals=12, payload_com_uncertainty=box)
    before = planner.plan(START, GOAL).margin
    box[0][...] = 0.8
    after = planner.plan(START, GOAL)
    fresh = zs.Planner(machine, margin=0.05, intervals=12, payload_com_uncertainty=box)
    assert after.margin == fresh.plan(START, GOAL).margin < before


def test_no_base_drives_on_a_slope_whose_gravity_is_overridden() -> None:
    """Driving counts on roll and pitch: the plan was 0.68 m outside on the slope that was meant."""

    class Steeper(zs.Slope):
        def gravity(self, yaw: float = 0.0) -> np.ndarray:
            return zs.Slope(self.roll - 0.25, self.pitch).gravity(yaw)

    problem = load_scenario("retreat").problem
    steeper = Steeper(problem.ground.roll, problem.ground.pitch)
    with pytest.raises(zs.ProblemError, match=r"Steeper, which overrides gravity\(\)"):
        replace(problem, ground=steeper)
    motion = zs.plan(problem).trajectory
    with pytest.raises(zs.ProblemError, match="overrides gravity"):
        zs.certify(problem.machine, motion, steeper)

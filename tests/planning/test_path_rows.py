"""A user's own constraints: planned, proven or sampled, and checked before anything is planned."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.paper import PAPER_GOAL, PAPER_START, paper_scene
from benchmarks.problems.scene import Scene
from tests.planning.driving import retreat_problem
from tests.planning.path_rows import rate_rows
from tests.problems import BIG_FOOT
from zmp_sqp.planning.constraints.binding import RESERVED
from zmp_sqp.planning.proof.certificate import certify_for
from zmp_sqp.scenario import load_scenario

SAMPLING = 2000.0  # [1/s]
LIMIT = 0.5  # [rad/s]


def crane(*constraints: Any, **changes: Any) -> zs.Problem:
    """A slew by 2 rad of a machine that cannot tip over."""
    limits = {"velocity": 2.0, "acceleration": 0.5, **changes}
    scene = Scene("slewing_crane", BIG_FOOT, limits=limits)
    return scene.problem([0.0], [2.0], intervals=20, constraints=constraints)


def guarantee(certificate: zs.Certificate, name: str) -> zs.Guarantee:
    return next(found for found in certificate.guarantees if found.name == name)


# --- planned and proven -------------------------------------------------------------------------


def test_the_example_of_the_docstring_runs() -> None:
    text = re.search(r"say::\n\n(.*?)\n\n    The planner", zs.PathRows.__doc__ or "", re.DOTALL)
    assert text is not None
    code = "\n".join(line[8:] for line in text.group(1).splitlines())
    names: dict[str, Any] = {"np": np, "zs": zs}
    definition, _, problem = code.partition("zs.Problem(")
    exec(definition, names)
    start, goal = (pose - [0.0, 0.15, 0.0, 0.0, 0.0] for pose in (PAPER_START, PAPER_GOAL))
    constraint = eval(problem.split("constraints=[")[1].rpartition("]")[0], names)
    plan = zs.plan(zs.Problem(paper_scene().load(), start, goal, constraints=[constraint]))
    q, _, _ = plan.trajectory(np.linspace(0.0, plan.duration, 10_001))
    own = guarantee(plan.certificate, "wires")
    assert plan.success
    assert own.label == "height"
    sampled = float((2.5 - 3.0 * np.cos(q[:, 1])).min())
    assert own.value == pytest.approx(sampled, abs=1e-5)


@pytest.mark.parametrize("proven", [True, False])
def test_a_rate_limit_as_rows_gives_the_duration_of_the_machines_own_rate_limit(
    proven: bool,
) -> None:
    own, builtin = zs.plan(crane(rate_rows(LIMIT, proven=proven))), zs.plan(crane(velocity=LIMIT))
    assert own.success
    assert own.duration == pytest.approx(builtin.duration, rel=1e-5)
    assert own.duration == pytest.approx(2.0 / LIMIT + LIMIT / 0.5, rel=1e-3)


@pytest.mark.parametrize("bound", [40.0, [40.0, 40.0]], ids=["number", "numbers"])
def test_a_curvature_bound_may_be_a_number_or_one_per_row(bound: Any) -> None:
    rows = replace(rate_rows(LIMIT), curvature_bound=bound)  # [rad/s^3], above any jerk here
    plan = zs.plan(crane(rows))
    found = guarantee(plan.certificate, "rate")
    assert plan.success
    assert found.proven
    assert 0.0 <= found.value <= 1e-3


def test_a_bound_that_is_too_large_to_prove_anything_proves_nothing() -> None:
    motion = zs.plan(crane(rate_rows(LIMIT))).trajectory
    loose = replace(rate_rows(LIMIT), curvature_bound=np.inf)
    found = certify_for(crane(loose), motion)
    assert not found.safe
    assert guarantee(found, "rate").value == -np.inf
    assert "is not proven to keep rate" in found.fault


def test_a_bound_that_the_motion_refutes_is_an_error() -> None:
    """The second derivative of a rate is the jerk, whose peak is the least bound that is true."""
    problem = replace(crane(rate_rows(LIMIT)), intervals=13)  # no node where a jump would be best
    motion = zs.plan(problem).trajectory
    peak = float(np.abs(motion.jerks).max())
    assert peak > 1.0
    true, false = (
        replace(problem, constraints=[replace(rate_rows(LIMIT), curvature_bound=share * peak)])
        for share in (1.0, 0.999)
    )
    assert guarantee(certify_for(true, motion), "rate").proven
    with pytest.raises(zs.ProblemError, match=r"'rate': its curvature_bound is too small.*rad/s/s"):
        certify_for(false, motion)
    with pytest.raises(zs.ProblemError, match="its curvature_bound is too small"):
        zs.plan(false)


def test_a_dip_between_the_samples_is_not_hidden_by_a_false_bound() -> None:
    """A narrow wall that the joint passes between two nodes and middles of the grid."""

    def wall(machine: zs.Machine, q: Any, v: Any, a: Any) -> tuple[np.ndarray, np.ndarray]:
        off = (q[:, :1] - 0.9137) / 0.02
        jacobian = np.zeros((len(q), 1, 3 * machine.size))
        jacobian[:, :, 0] = -2.0 * off * np.exp(-(off**2)) / 0.02
        return np.exp(-(off**2)) - 0.5, jacobian

    motion = zs.plan(crane()).trajectory
    honest = zs.PathRows("wall", wall, curvature_bound=lambda m, v, a, j: 5e3 * v**2 + 50.0 * a)
    assert guarantee(certify_for(crane(honest), motion), "wall").value < -0.4
    with pytest.raises(zs.ProblemError, match="its curvature_bound is too small"):
        certify_for(crane(replace(honest, curvature_bound=0.1)), motion)


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["more room", "less room"])
def test_a_kink_refutes_the_bound_only_where_it_takes_room_away(sign: float) -> None:
    """sign |rate| bends without bound where the rate changes its sign."""

    def rows(machine: zs.Machine, q: Any, v: Any, a: Any) -> tuple[np.ndarray, np.ndarray]:
        jacobian = np.zeros((len(q), 1, 3 * machine.size))
        jacobian[:, 0, machine.size] = sign * np.sign(v[:, 0])
        return sign * np.abs(v[:, :1]) - 3.0, jacobian

    kinked = zs.PathRows("kinked", rows, curvature_bound=lambda m, v, a, j: j[:, :1])
    problem = replace(crane(), start_velocity=[-0.3])
    motion, problem = zs.plan(problem).trajectory, replace(problem, constraints=[kinked])
    _, rates, _ = motion(np.linspace(0.0, motion.duration, 50))
    assert rates.min() < 0.0 < rates.max()
    if sign > 0.0:
        assert guarantee(certify_for(problem, motion), "kinked").value > 0.0
        return
    with pytest.raises(zs.ProblemError, match="its curvature_bound is too small"):
        certify_for(problem, motion)


def test_what_is_proven_is_below_what_is_sampled_and_close() -> None:
    plan = zs.plan(crane(rate_rows(LIMIT)))
    t = np.linspace(0.0, plan.duration, 20_001)
    sampled = LIMIT - np.abs(plan.trajectory(t)[1]).max()
    found = guarantee(plan.certificate, "rate")
    assert found.proven
    assert sampled - 1e-3 <= found.value <= sampled + 1e-9


def test_without_a_bound_rows_are_sampled_and_named_so() -> None:
    plan = zs.plan(crane(rate_rows(LIMIT, proven=False)))
    found = guarantee(plan.certificate, "rate")
    assert plan.success
    assert not found.proven
    assert found.kept
    assert plan.message.endswith(
        "Sampled only, 2000 times a second, not proven: rate (forwards)."
    ), plan.message
    assert "Sampled" not in zs.plan(crane(rate_rows(LIMIT))).message


def test_rows_without_a_bound_are_looked_at_2000_times_a_second() -> None:
    motion = zs.plan(crane()).trajectory
    seen: list[np.ndarray] = []

    def spike(machine: zs.Machine, q: Any, v: Any, a: Any) -> tuple[np.ndarray, np.ndarray]:
        seen.append(q[:, 0])
        return np.full((len(q), 1), -1.0), np.zeros((len(q), 1, 3 * machine.size))

    certify_for(crane(zs.PathRows("spike", spike)), motion)
    densest = max(seen, key=len)
    assert len(densest) >= SAMPLING * motion.duration
    assert np.abs(np.diff(densest)).max() <= 1.01 * np.abs(motion.velocities).max() / SAMPLING


def test_a_motion_that_breaks_sampled_rows_is_not_safe() -> None:
    motion = zs.plan(crane()).trajectory
    peak = float(np.abs(motion.velocities).max())
    found = certify_for(crane(rate_rows(0.5 * peak, proven=False)), motion)
    own = guarantee(found, "rate")
    assert not found.safe
    assert own.value == pytest.approx(-0.5 * peak, abs=1e-3 * peak)
    assert "breaks rate (forwards) by" in found.fault


# --- where it works -----------------------------------------------------------------------------


def test_rows_hold_on_a_base_that_drives() -> None:
    problem = replace(retreat_problem(paper_scene(point_masses=False)), intervals=25)
    rows = rate_rows(LIMIT)
    plan = zs.plan(replace(problem, constraints=[rows]))
    limited = problem.machine.with_limits(velocity={"slew": LIMIT})
    slower = zs.plan(replace(problem, machine=limited))
    assert plan.success, plan.message
    # the plan at its bound has nodes where accelerations jump; rows are kept on a uniform grid
    assert slower.lower_bound <= plan.duration <= slower.duration * (1.0 + 3e-3)
    assert guarantee(plan.certificate, "rate").proven


def test_rows_hold_in_the_simplified_model() -> None:
    problem = load_scenario("paper_1_simplified").problem
    plan = zs.plan(replace(problem, constraints=[rate_rows(LIMIT)]))
    limited = problem.machine.with_limits(velocity={"slew": LIMIT})
    slower = zs.plan(replace(problem, machine=limited))
    assert plan.success, plan.message
    assert slower.lower_bound <= plan.duration <= slower.duration * (1.0 + 1e-3)


def test_rows_of_joints_that_follow_hold_in_the_simplified_model() -> None:
    """The stick turns twice as fast as the boom, by the model's ties."""
    problem = load_scenario("paper_1_simplified").problem
    goal = problem.goal + np.array([0.0, -0.3, 0.6, -0.3, 0.0])
    problem = replace(problem, goal=goal, ground=zs.Slope())
    free = zs.plan(problem)
    peak = float(np.abs(free.trajectory.velocities[:, 2]).max())
    plan = zs.plan(replace(problem, constraints=[rate_rows(0.5 * peak, joint=2)]))
    assert plan.success, plan.message
    assert np.abs(plan.trajectory.velocities[:, 2]).max() <= 0.5 * peak


def test_under_uncertainty_rows_are_called_with_the_machine_of_each_corner() -> None:
    """Rows that depend on the payload: a rate limit that falls with its mass."""
    nominal = 4000.0

    def rows(machine: zs.Machine, q: Any, v: Any, a: Any) -> tuple[np.ndarray, np.ndarray]:
        masses.add(round(machine.payload_mass))
        jacobian = np.zeros((len(q), 1, 3 * machine.size))
        jacobian[:, 0, machine.size] = 1.0
        return (v[:, 0] - LIMIT * nominal / machine.payload_mass)[:, None], jacobian

    masses: set[int] = set()
    problem = paper_scene().problem(
        PAPER_START,
        PAPER_GOAL,
        payload_uncertainty=0.1,
        intervals=25,
        constraints=[zs.PathRows("by_mass", rows, curvature_bound=100.0)],
    )
    plan = zs.plan(replace(problem, ground=zs.Slope()))
    found = guarantee(plan.certificate, "by_mass")
    assert {3600, 4400} <= masses
    assert plan.success, plan.message
    assert "payload" in found.corner
    assert np.abs(plan.trajectory.velocities[:, 0]).max() == pytest.approx(LIMIT / 1.1, rel=1e-3)


def test_two_constraints_hold_together() -> None:
    slow, slower = rate_rows(LIMIT, name="slow"), rate_rows(0.8 * LIMIT, name="slower")
    plan = zs.plan(crane(slow, slower))
    assert guarantee(plan.certificate, "slow").value == pytest.approx(0.2 * LIMIT, abs=1e-3)
    assert guarantee(plan.certificate, "slower").value == pytest.approx(0.0, abs=1e-3)


# --- what a guarantee means ---------------------------------------------------------------------


def entry(value: float, *, name: str = "rate", required: float = 0.0) -> zs.Guarantee:
    return zs.Guarantee(name, "row", value, "m", 1.0, "", proven=True, required=required)


def test_a_guarantee_is_kept_where_the_room_is_what_was_asked_for_and_not_negative() -> None:
    assert entry(0.0).kept
    assert not entry(-1e-12).kept
    assert entry(0.1, required=0.1).kept
    assert not entry(0.09, required=0.1).kept
    assert not entry(-0.1, required=-0.2).kept  # a negative margin asks for no less than zero
    assert not entry(-np.inf).kept
    assert not entry(np.nan).kept


def test_the_shortfall_is_what_is_missing() -> None:
    assert entry(-0.2).shortfall == pytest.approx(0.2)
    assert entry(0.04, required=0.1).shortfall == pytest.approx(0.06)
    assert entry(0.3).shortfall <= 0.0


def test_a_certificate_is_safe_if_all_of_its_guarantees_are_kept() -> None:
    found = certify_for(crane(rate_rows(2.0)), zs.plan(crane()).trajectory)
    assert found.safe
    assert found.broken == ()
    assert [row.name for row in found.guarantees] == ["tip_over", "contact", "rate", "joint_limits"]
    others = tuple(row for row in found.guarantees if row.name != "rate")
    for value in (-1e-9, -np.inf):
        broken = replace(found, guarantees=(*others, entry(value)))
        assert not broken.safe
        assert [row.name for row in broken.broken] == ["rate"]
        assert broken.limits_ok


# --- what is refused ----------------------------------------------------------------------------


def nothing(machine: Any, q: Any, v: Any, a: Any) -> Any:
    return np.full((len(q), 1), -1.0), np.zeros((len(q), 1, 3 * machine.size))


def raising(machine: Any, q: Any, v: Any, a: Any) -> Any:
    raise KeyError("no such wire")


FUNCTIONS = {
    "values of one dimension": (
        lambda m, q, v, a: (q[:, 0], np.zeros((len(q), 1, 3))),
        r"constraint 'mine': values must have shape \(1, R\), not \(1,\)",
    ),
    "values of other states": (
        lambda m, q, v, a: (np.zeros((7, 1)), np.zeros((7, 1, 3))),
        r"values must have shape \(1, R\), not \(7, 1\)",
    ),
    "Jacobian by q alone": (
        lambda m, q, v, a: (q, np.zeros((len(q), 1, 1))),
        r"the Jacobian must have shape \(1, 1, 3\), not \(1, 1, 1\)",
    ),
    "no Jacobian": (lambda m, q, v, a: q, "constraint 'mine': its function failed: ValueError"),
    "text": (lambda m, q, v, a: ("low", "high"), "its function failed: ValueError"),
    "a function that raises": (raising, r"its function failed: KeyError\('no such wire'\)"),
    "no rows": (
        lambda m, q, v, a: (np.zeros((len(q), 0)), np.zeros((len(q), 0, 3))),
        "constraint 'mine': its function gives no rows",
    ),
    "NaN": (
        lambda m, q, v, a: (np.nan * q, np.zeros((len(q), 1, 3))),
        r"constraint mine \(row 0\) has no value at rest at the start",
    ),
    "NaN in the Jacobian": (
        lambda m, q, v, a: (q - 9.0, np.full((len(q), 1, 3), np.nan)),
        "constraint 'mine': the Jacobian must be finite",
    ),
    "broken at the start": (
        lambda m, q, v, a: (q + 0.25, np.zeros((len(q), 1, 3))),
        r"constraint mine \(row 0\) is violated by 0.25.* at rest at the start",
    ),
    "broken at the goal": (
        lambda m, q, v, a: (q - 1.5, np.zeros((len(q), 1, 3))),
        r"constraint mine \(row 0\) is violated by 0.5.* at rest at the goal",
    ),
}


@pytest.mark.parametrize(("function", "message"), FUNCTIONS.values(), ids=FUNCTIONS.keys())
def test_a_function_that_cannot_be_used_is_refused(function: Any, message: str) -> None:
    with pytest.raises(zs.ProblemError, match=message):
        crane(zs.PathRows("mine", function))


OPTIONS = {
    "too many labels": ({"labels": ["a", "b"]}, "has 1 rows, but 2 labels"),
    "too few units": ({"units": []}, "has 1 rows, but 0 units"),
    "labels are no texts": ({"labels": [3]}, "labels of constraint 'mine' must be texts"),
    "labels are one text": ({"labels": "h"}, "labels of constraint 'mine' must be a list of texts"),
    "no name": ({"name": ""}, "a constraint needs a name, not ''"),
    "name is no text": ({"name": 3}, "a constraint needs a name, not 3"),
    "nothing to call": ({"function": 3}, "needs a function"),
    "scale of zero": ({"scale": 0.0}, "scale of constraint 'mine' must be positive"),
    "scale of nan": ({"scale": np.nan}, "scale of constraint 'mine' must be finite"),
    "bound is a text": ({"curvature_bound": "large"}, "curvature_bound"),
    "bound for other rows": ({"curvature_bound": [1.0, 2.0]}, "curvature_bound"),
    "bound is negative": ({"curvature_bound": -1.0}, "curvature_bound"),
    "bound is nan": ({"curvature_bound": np.nan}, "curvature_bound"),
    "bound of another shape": (
        {"curvature_bound": lambda m, v, a, j: np.ones((3, 3))},
        "curvature_bound must give",
    ),
    "bound that raises": ({"curvature_bound": raising}, "its curvature_bound failed: KeyError"),
}


@pytest.mark.parametrize(("options", "message"), OPTIONS.values(), ids=OPTIONS.keys())
def test_an_option_that_cannot_be_used_is_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(zs.ProblemError, match=message):
        crane(zs.PathRows(**{"name": "mine", "function": nothing, **options}))


def test_two_constraints_of_one_name_are_refused() -> None:
    with pytest.raises(zs.ProblemError, match="two constraints are named 'rate'"):
        crane(rate_rows(1.0), rate_rows(2.0))


@pytest.mark.parametrize("name", RESERVED)
def test_names_of_the_planners_own_constraints_are_refused(name: str) -> None:
    with pytest.raises(zs.ProblemError, match=f"a constraint cannot be named {name!r}"):
        crane(rate_rows(1.0, name=name))


@pytest.mark.parametrize(
    "given", [zs.TorqueLimits, 3, "torque_limits", None, lambda machine: machine]
)
def test_what_is_no_constraint_is_refused(given: Any) -> None:
    with pytest.raises(zs.ProblemError, match="constraints must be path constraints such as"):
        crane(given)


@pytest.mark.parametrize("given", [3, None, zs.TorqueLimits()])
def test_what_is_no_list_is_refused(given: Any) -> None:
    with pytest.raises(zs.ProblemError, match="constraints must be a list of path constraints"):
        replace(crane(), constraints=given)


def test_a_value_that_is_missing_on_the_way_does_not_pass() -> None:
    """The search finds no motion, or one that avoids it; it does not end in a traceback."""

    def undefined(machine: zs.Machine, q: Any, v: Any, a: Any) -> tuple[np.ndarray, np.ndarray]:
        values, jacobian = nothing(machine, q, v, a)
        return np.where(np.abs(q - 1.0) < 0.2, np.nan, values), jacobian

    plan = zs.plan(crane(zs.PathRows("hole", undefined)))
    assert not plan.success

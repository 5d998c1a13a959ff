"""Random and broken input at every public function: a typed error or a sound answer."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import zmp_sqp as zs
from benchmarks.problems.paper import paper_scene
from zmp_sqp.scenario import load_scenario

ROOT = Path(__file__).parent.parent
FEW = settings(
    max_examples=150,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
START = np.array([0.0, -np.pi / 6, -2 * np.pi / 3, np.pi / 6, -np.pi / 2])
GOAL = START + np.array([0.5, 0.1, 0.0, 0.0, 0.0])
TOKENS = (
    "nan",
    "-1",
    "1e308",
    "",
    "\x00",
    "<",
    '"',
    "]",
    "é",
    "0 0",
    "inf",
    "&x;",
    "true",
    "\n",
    "[a]",
    "1e-320",
    ",",
    "'",
)
NUMBERS = (
    st.floats(allow_nan=True, allow_infinity=True, width=64)
    | st.integers(-3, 3)
    | st.sampled_from([1e-300, 1e300])
)
THINGS = (
    NUMBERS
    | st.none()
    | st.text(max_size=3)
    | st.booleans()
    | st.lists(NUMBERS, max_size=6)
    | st.just(object())
)


@st.composite
def spoilt(draw: st.DrawFn, text: str) -> str:
    """A text in which a few words or stretches were replaced, doubled or dropped."""
    for _ in range(draw(st.integers(1, 4))):
        spans = [match.span() for match in re.finditer(r"[^\s<>=\"',\[\]]+", text)]
        if not spans:
            return text
        begin, end = draw(st.sampled_from(spans))
        kind = draw(st.integers(0, 3))
        if kind == 0:
            text = text[:begin] + draw(st.sampled_from(TOKENS)) + text[end:]
        elif kind == 1:
            text = text[:begin] + text[draw(st.integers(begin, min(len(text), begin + 80))) :]
        elif kind == 2:
            text = text[:end] + text[begin:end] + text[end:]
        else:
            other = draw(st.sampled_from(spans))
            text = text[:begin] + text[slice(*other)] + text[end:]
    return text


class Refused(Exception):
    """The library has said no, in words."""


@contextmanager
def politely(kind: type[Exception] = zs.ZmpSqpError, words: str = "") -> Iterator[None]:
    """Typed errors with a message are an answer; every other one is a bug."""
    try:
        yield
    except kind as error:
        if not str(error) or words not in str(error):
            raise AssertionError(f"an error without words: {error!r}") from error
        raise Refused from None


def write(path: Path, text: str) -> Path:
    path.write_bytes(text.encode("utf-8", errors="surrogatepass"))
    return path


@pytest.mark.filterwarnings("ignore::zmp_sqp.MachineWarning")
@pytest.mark.parametrize("name", ["feller_buncher", "slider"])
def test_urdfs(name: str, tmp_path: Path) -> None:
    good = (ROOT / "urdf" / f"{name}.urdf").read_text(encoding="utf-8")

    @FEW
    @given(text=spoilt(good))
    def fuzz(text: str) -> None:
        with suppress(Refused), politely(zs.MachineError):
            check(zs.load_machine(write(tmp_path / "machine.urdf", text)))

    def check(machine: zs.Machine) -> None:
        assert machine.mass >= 0.0
        assert np.isfinite(machine.mass)
        if machine.mass == 0.0:
            return
        still = np.zeros(machine.size)
        assert np.isfinite(zs.zmp(machine, still, still, still, zs.Slope())).all()

    fuzz()


def test_joint_limits(tmp_path: Path) -> None:
    good = (ROOT / "urdf" / "slider.joint_limits.yaml").read_text(encoding="utf-8")

    @FEW
    @given(text=spoilt(good))
    def fuzz(text: str) -> None:
        with suppress(Refused), politely(zs.MachineError):
            limits = zs.load_machine(
                "slider", limits=write(tmp_path / "joint_limits.yaml", text)
            ).limits
            for limit in (limits.velocity, limits.acceleration):
                assert (np.isnan(limit) | (limit > 0.0)).all()

    fuzz()


def test_scenarios(tmp_path: Path) -> None:
    good = (ROOT / "zmp_sqp" / "scenarios" / "retreat.toml").read_text(encoding="utf-8")

    @FEW
    @given(text=spoilt(good))
    def fuzz(text: str) -> None:
        with suppress(Refused), politely(zs.ScenarioError, "scenario.toml"):
            assert isinstance(
                load_scenario(write(tmp_path / "scenario.toml", text)).problem, zs.Problem
            )

    fuzz()


def test_trajectories(tmp_path: Path) -> None:
    machine = paper_scene().load()
    path = tmp_path / "motion.csv"
    zs.phase_plane(machine, START, GOAL).to_csv(path)
    good = "\n".join(path.read_text(encoding="utf-8").splitlines()[:40])

    @FEW
    @given(text=spoilt(good))
    def fuzz(text: str) -> None:
        with suppress(Refused), politely():
            motion = zs.Trajectory.from_csv(write(path, text), machine)
            found = zs.certify(machine, motion, zs.Slope())
            if found.safe:
                _, q, v, a = motion.within(np.linspace(0.0, 1.0, 5))
                assert (
                    zs.stability_margin(machine, q, v, a, zs.Slope()).min() >= found.margin - 1e-9
                )

    fuzz()


@FEW
@given(
    changes=st.dictionaries(
        st.sampled_from(sorted({field.name for field in fields(zs.Problem) if field.init})),
        THINGS,
        min_size=1,
        max_size=3,
    )
)
def test_problems_of_anything(changes: dict[str, Any]) -> None:
    given_ = {
        "machine": paper_scene().load(),
        "start": START,
        "goal": GOAL,
        "intervals": 5,
    } | changes
    with suppress(Refused), politely():
        plan = zs.plan(zs.Problem(**given_), time_budget=2.0)
        assert not plan.success or plan.certificate.safe


@settings(max_examples=30, deadline=None, derandomize=True)
@given(
    start=st.lists(st.floats(-1.0, 1.0), min_size=5, max_size=5),
    goal=st.lists(st.floats(-1.0, 1.0), min_size=5, max_size=5),
    rates=st.lists(st.sampled_from([0.0, 0.0, 0.0, 0.2, -0.2]), min_size=5, max_size=5),
    angles=st.tuples(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4)),
    margin=st.sampled_from([0.0, 0.0, 0.1, 0.3]),
)
def test_problems_that_might_be_meant(
    start: list[float],
    goal: list[float],
    rates: list[float],
    angles: tuple[float, float],
    margin: float,
) -> None:
    middle, width = np.array([0.0, -0.4, -1.5, 0.7, 0.0]), np.array([3.0, 0.9, 1.2, 2.0, 3.0])
    machine = paper_scene().load()
    with suppress(Refused), politely(zs.ProblemError):
        problem = zs.Problem(
            machine,
            middle + width * start,
            middle + width * goal,
            zs.Slope(*angles),
            start_velocity=rates,
            margin=margin,
            intervals=8,
        )
        plan = zs.plan(problem, time_budget=3.0)
        assert plan.message
        if plan.success:
            _, q, v, a = plan.trajectory.within(np.linspace(0.0, 1.0, 21))
            assert zs.stability_margin(machine, q, v, a, problem.ground).min() >= margin
            assert plan.certificate.safe


@FEW
@given(arguments=st.lists(THINGS, min_size=3, max_size=3))
def test_states_of_anything(arguments: list[Any]) -> None:
    machine = paper_scene().load()
    with suppress(Refused), politely():
        assert np.isfinite(zs.zmp(machine, *arguments, zs.Slope())).all()

"""A first user's walk on the excavator: plan, tail, re-plan, export, check, wrong files."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zmp_sqp as zs
from zmp_sqp.cli import main

Array = np.ndarray

# [m] what a 100 Hz recording of a plan may take of it, where accelerations jump between two samples
MARGIN = 0.25
LOAD = 2000.0  # [kg] at the bucket pin
START = np.radians([90.0, 40.0, -89.0, -41.0])  # slew, boom, stick, bucket
GOAL = np.radians([60.0, 5.0, -42.0, -53.0])
SLOPE = zs.Slope(roll=np.radians(-3.0))
SCENE = (
    *("--roll", "-3"),
    *("--payload", str(LOAD), "--payload-frame", "stick", "--payload-com", "2.925", "0", "0"),
)
DONE, UNSAFE, MISUSE = 0, 1, 2
RATE = 100.0  # [1/s]


@cache
def machine() -> zs.Machine:
    bare = zs.load_machine("excavator")
    return bare.with_payload(zs.Payload(LOAD, (2.925, 0.0, 0.0), "stick"))


@cache
def plan() -> zs.Plan:
    return zs.plan(
        zs.Problem(
            machine(),
            START,
            GOAL,
            ground=SLOPE,
            margin=MARGIN,
            constraints=[zs.TorqueLimits(share=0.9)],
        )
    )


Checker = Callable[..., dict[str, Any]]


@pytest.fixture
def check(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Checker:
    """Runs `zmp-sqp check` as a user would; returns what --json writes, with code and text."""

    def run(motion: Path, *options: str, code: int, scene: Sequence[str] = SCENE) -> dict[str, Any]:
        written = tmp_path / "verdict.json"
        found = main(["check", "excavator", str(motion), *scene, *options, "--json", str(written)])
        said = capsys.readouterr()
        assert found == code, said.out + said.err
        verdict: dict[str, Any] = json.loads(written.read_text()) if code != MISUSE else {}
        return verdict | {"text": " ".join((said.out + said.err).split())}

    return run


def write(path: Path, header: str, columns: Any, *, decimals: int = 6) -> Path:
    """A CSV file as a logger writes it."""
    rows = np.column_stack(columns)
    np.savetxt(path, rows, fmt=f"%.{decimals}f", delimiter=",", header=header, comments="")
    return path


def header(*quantities: str) -> str:
    return ",".join(
        ["time", *(f"{name}.{what}" for what in quantities for name in machine().joint_names)]
    )


def exported(folder: Path) -> Path:
    path = folder / "plan_100_hz.csv"
    plan().trajectory.to_csv(path, rate=RATE)
    return path


# --- plan, tail, re-plan ------------------------------------------------------------------------


def test_the_plan_is_certified_and_tip_over_costs_it_time() -> None:
    assert plan().success
    assert plan().certificate.margin >= MARGIN
    blind = zs.phase_plane(machine(), START, GOAL)
    assert zs.certify(machine(), blind, SLOPE).margin < 0.0
    assert plan().duration > 1.02 * plan().lower_bound


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
def test_the_tail_of_the_plan_is_the_rest_of_it_and_certified_as_such(share: float) -> None:
    t = share * plan().duration
    rest = plan().trajectory.after(t)
    assert rest.duration == pytest.approx(plan().duration - t, abs=1e-12)
    later = np.linspace(0.0, rest.duration, 300)
    for whole, tail in zip(plan().trajectory(t + later), rest(later), strict=True):
        np.testing.assert_allclose(tail[1:-1], whole[1:-1], atol=1e-6)
    found = zs.certify(
        machine(), rest, SLOPE, margin=MARGIN, constraints=[zs.TorqueLimits(share=0.9)]
    )
    assert found.safe
    assert found.margin >= plan().certificate.margin - 1e-4


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
def test_replanning_undisturbed_takes_no_longer_than_the_rest_of_the_plan(share: float) -> None:
    t = share * plan().duration
    q, v, _ = plan().trajectory(t)
    again = zs.plan(
        zs.Problem(
            machine(),
            q,
            GOAL,
            start_velocity=v,
            ground=SLOPE,
            margin=MARGIN,
            constraints=[zs.TorqueLimits(share=0.9)],
        )
    )
    assert again.success
    assert again.certificate.margin >= MARGIN
    assert again.duration <= 1.001 * (plan().duration - t)
    np.testing.assert_allclose(again.trajectory.velocities[0], v, atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_replanning_after_a_disturbance_finds_a_certified_motion(seed: int) -> None:
    rng = np.random.default_rng(seed)
    q, v, _ = plan().trajectory(rng.uniform(0.1, 0.9) * plan().duration)
    q, v = q + rng.normal(scale=0.01, size=4), v + rng.normal(scale=0.02, size=4)
    most = machine().limits.velocity
    again = zs.plan(
        zs.Problem(
            machine(),
            q,
            GOAL,
            start_velocity=np.clip(v, -most, most),
            ground=SLOPE,
            margin=MARGIN - 0.05,  # the disturbance may have taken some
            constraints=[zs.TorqueLimits(share=0.95)],
        )
    )
    assert again.success
    assert again.certificate.margin >= MARGIN - 0.05


@pytest.mark.physics
def test_physics_agrees_that_the_plan_stands_and_the_blind_motion_does_not() -> None:
    pytest.importorskip("mujoco")
    assert not zs.replay(machine(), plan().trajectory, SLOPE).tipped
    blind = zs.phase_plane(machine(), START, GOAL)
    assert zs.replay(machine(), blind, SLOPE).tipped


# --- export, and check of what was exported -----------------------------------------------------


def test_the_plans_own_file_is_exactly_the_plan(tmp_path: Path, check: Checker) -> None:
    path = tmp_path / "plan.csv"
    plan().trajectory.to_csv(path)
    found = check(path, "--margin", str(MARGIN), code=DONE)
    assert found["margin"] == pytest.approx(plan().certificate.margin, abs=1e-6)
    assert found["motion"]["departure"] is None


def test_a_100_hz_recording_keeps_the_polygon_and_names_what_its_jumps_exceed(
    tmp_path: Path, check: Checker
) -> None:
    path = exported(tmp_path)
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    np.testing.assert_allclose(np.diff(table[:-1, 0]), 1.0 / RATE, atol=1e-12)
    assert table[-1, 0] == pytest.approx(plan().duration)
    strict = check(path, code=UNSAFE)
    assert "acceleration limit" in strict["fault"]
    advice = re.search(r"--limit-tolerance (\S+)", " ".join(strict["hints"]))
    assert advice is not None  # and it helps
    found = check(path, "--limit-tolerance", advice.group(1), code=DONE)
    assert found["margin"] > 0.0
    assert found["motion"]["interpolation"] == "cubic"
    assert found["motion"]["samples"] == len(table)


def test_positions_alone_of_the_plan_are_checked_as_a_spline(
    tmp_path: Path, check: Checker
) -> None:
    times, q, _, _ = plan().trajectory.sampled(RATE)
    path = write(tmp_path / "positions.csv", header("position"), [times, q], decimals=9)
    found = check(path, "--limit-tolerance", "0.3", code=DONE)
    assert found["motion"]["interpolation"] == "spline"
    assert check(path, "--interpolation", "linear", code=UNSAFE)["fault"]


# --- a motion of his own ------------------------------------------------------------------------


def trapezoid(rate: float, *, speed: float, ramp: float) -> tuple[Array, Array, Array]:
    """All joints together from START to GOAL: ramp up, coast, ramp down, sampled at a rate.

    Args:
        rate: Samples per second [1/s].
        speed: Rate of the path's share, in 1/s.
        ramp: Time of a ramp [s]; a multiple of the sampling time, so that samples see the corners.
    """
    coast = 1.0 / speed - ramp
    duration = coast + 2.0 * ramp
    t = np.arange(round(duration * rate) + 1) / rate
    gone = np.where(
        t < ramp,
        0.5 * speed / ramp * t**2,
        np.where(
            t < ramp + coast,
            speed * (t - 0.5 * ramp),
            1.0 - 0.5 * speed / ramp * (duration - t) ** 2,
        ),
    )
    pace = speed * np.clip(np.minimum(t, duration - t) / ramp, 0.0, 1.0)
    way = GOAL - START
    return t, START + gone[:, None] * way, pace[:, None] * way


def test_a_slow_trapezoid_of_his_own_is_safe_with_the_digits_of_a_logger(
    tmp_path: Path, check: Checker
) -> None:
    t, q, v = trapezoid(50.0, speed=0.25, ramp=2.0)
    path = write(tmp_path / "slow.csv", header("position", "velocity"), [t, q, v])
    found = check(path, code=DONE)
    assert found["margin"] > MARGIN
    assert "level" not in found["rests_on"]["ground"]
    off = max(of["position"] for of in found["motion"]["departure"].values())
    assert off < 1e-9  # a cubic goes through the samples


def test_a_trapezoid_that_is_too_fast_names_joint_limit_and_unit(
    tmp_path: Path, check: Checker
) -> None:
    t, q, v = trapezoid(50.0, speed=0.8, ramp=0.5)
    path = write(tmp_path / "fast.csv", header("position", "velocity"), [t, q, v])
    found = check(path, code=UNSAFE)
    broken = [limit for limit in found["limits"] if not limit["kept"]]
    assert {(limit["joint"], limit["limit"]) for limit in broken} >= {("boom", "velocity")}
    (boom,) = (x for x in broken if (x["joint"], x["limit"]) == ("boom", "velocity"))
    assert boom["unit"] == "rad/s"
    assert boom["value"] == pytest.approx(0.8 * abs((GOAL - START)[1]), rel=1e-3)
    assert "'boom'" in found["fault"]


def test_nothing_given_is_said_to_be_level_ground_and_an_empty_bucket(
    tmp_path: Path, check: Checker
) -> None:
    t, q, v = trapezoid(50.0, speed=0.25, ramp=2.0)
    path = write(tmp_path / "slow.csv", header("position", "velocity"), [t, q, v])
    found = check(path, code=DONE, scene=())
    assert "level" in found["text"]
    assert "none" in found["rests_on"]["payload"]


# --- files that are wrong -----------------------------------------------------------------------


def test_a_truncated_file_is_unsafe_unless_it_may_end_in_motion(
    tmp_path: Path, check: Checker
) -> None:
    t, q, v = trapezoid(50.0, speed=0.25, ramp=2.0)
    half = len(t) // 2
    path = write(
        tmp_path / "cut.csv", header("position", "velocity"), [t[:half], q[:half], v[:half]]
    )
    found = check(path, code=UNSAFE)
    assert "ends in motion" in found["fault"]
    assert "--ends-in-motion" in found["text"]
    check(path, "--ends-in-motion", code=DONE)


def test_a_file_that_is_cut_within_a_row_names_the_row(tmp_path: Path, check: Checker) -> None:
    rows = exported(tmp_path).read_text().splitlines()
    whole, torn = rows[: len(rows) // 2], rows[len(rows) // 2]
    path = tmp_path / "torn.csv"
    path.write_text("\n".join([*whole, torn[: len(torn) // 2]]))
    said = check(path, code=MISUSE)["text"]
    assert f"torn.csv: row {len(whole) + 1} " in said
    assert "Traceback" not in said


def test_degrees_are_refused_with_the_way_out(tmp_path: Path, check: Checker) -> None:
    t, q, v = trapezoid(50.0, speed=0.25, ramp=2.0)
    columns = [t, np.degrees(q), np.degrees(v)]
    path = write(tmp_path / "degrees.csv", header("position", "velocity"), columns)
    found = check(path, code=UNSAFE)
    assert any("degree" in hint for hint in found["hints"])
    assert check(path, "--degrees", code=DONE)["margin"] > MARGIN


def test_milliseconds_are_noticed(tmp_path: Path, check: Checker) -> None:
    t, q, _ = trapezoid(50.0, speed=0.25, ramp=2.0)
    path = write(tmp_path / "milliseconds.csv", header("position"), [1e3 * t, q])
    found = check(path, code=DONE)
    assert any("millisecond" in hint for hint in found["hints"])


def test_a_telescope_in_millimetres_is_noticed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    forwarder = zs.load_machine("forwarder_crane")
    t = np.linspace(0.0, 10.0, 501)
    q = np.column_stack([0.0 * t, 0.4 + 0.0 * t, -0.9 + 0.0 * t, 1e3 * (1.0 - np.cos(0.3 * t))])
    names = ",".join(["time", *(f"{name}.position" for name in forwarder.joint_names)])
    path = write(tmp_path / "millimetres.csv", names, [t, q])
    written = tmp_path / "verdict.json"
    assert main(["check", "forwarder_crane", str(path), "--json", str(written)]) == UNSAFE
    found = json.loads(written.read_text())
    assert "'telescope'" in found["fault"]
    assert "Traceback" not in capsys.readouterr().err

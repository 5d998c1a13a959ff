"""Tipping load: closed form against attached payloads, levers, and sampled turns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics import Machine, Payload, Slope, SupportPolygon, load_machine
from zmp_sqp.mechanics.stability_measures import center_of_mass
from zmp_sqp.mechanics.tipping_load import frame_position, tipping_load, worst_turn
from zmp_sqp.mechanics.zero_moment_point import stability_margin


@pytest.fixture(scope="module")
def machine() -> Machine:
    return load_machine("feller_buncher")


def random_case(seed: int, machine: Machine) -> tuple[np.ndarray, Slope, np.ndarray]:
    rng = np.random.default_rng(seed)
    limits = machine.limits
    q = rng.uniform(limits.position_lower, limits.position_upper)
    return q, Slope(*rng.uniform(-0.25, 0.25, 2)), rng.uniform(-1.0, 1.0, 3)


def with_mass(machine: Machine, mass: float, offset: np.ndarray) -> Machine:
    return machine.with_payload(Payload(mass, offset, "head"))


def level_tipping_load(machine: Machine, q: np.ndarray, point: np.ndarray) -> float:
    """By levers on level ground: (machine's mass) (b - e . com) = m (e . point - b)."""
    support, com = machine.support, center_of_mass(machine, q[None])[0]
    loads = [
        machine.mass * (b - e @ com[:2]) / (e @ point[:2] - b)
        for e, b in zip(support.normals, support.offsets, strict=True)
        if e @ point[:2] > b
    ]
    return min(loads, default=np.inf)


def test_the_crane_tips_where_levers_say() -> None:
    """slewing_crane: 1000 kg in the middle, 1000 kg at 2 m; square foot of half side 1.2 m."""
    square = SupportPolygon([[-1.2, -1.2], [1.2, -1.2], [1.2, 1.2], [-1.2, 1.2]])
    crane = load_machine("slewing_crane", support=square)
    load = {"frame": "jib", "offset": np.array([3.0, 0.0, 0.0])}
    # 2000 kg at x = 1: 2000 (1.2 - 1) = m (3 - 1.2)
    found = tipping_load(crane, np.zeros(1), Slope(), **load)
    assert found.mass == pytest.approx(2000.0 * 0.2 / 1.8, rel=1e-12)
    assert square.edge_name(found.edge) == "front"
    # across a corner the edges are farther away along the jib: sqrt(2) 1.2 > 1.2
    aslant = tipping_load(crane, np.array([np.pi / 4]), Slope(), **load)
    away = np.sqrt(0.5)
    assert aslant.mass == pytest.approx(2000.0 * (1.2 - away) / (3.0 * away - 1.2), rel=1e-12)
    worst = worst_turn(crane, np.array([np.pi / 4]), Slope(), joint="slew", **load)
    assert worst.mass == pytest.approx(found.mass, rel=1e-12)
    assert np.isclose(np.mod(worst.coordinate + 1e-9, np.pi / 2), 1e-9, atol=1e-6)


@pytest.mark.parametrize("seed", range(8))
def test_a_payload_of_that_mass_puts_the_zmp_on_the_edge(seed: int, machine: Machine) -> None:
    q, slope, offset = random_case(seed, machine)
    still = np.zeros(machine.size)
    found = tipping_load(machine, q, slope, frame="head", offset=offset)
    if found.mass == 0.0:
        assert stability_margin(machine, q, still, still, slope) <= 0.0
        return
    assert stability_margin(machine, q, still, still, slope) > 0.0
    if found.mass > 5e4:  # twice the machine
        assert stability_margin(with_mass(machine, 5e4, offset), q, still, still, slope) > 0.0
        return
    loaded = with_mass(machine, found.mass, offset)
    assert stability_margin(loaded, q, still, still, slope) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_on_level_ground_it_is_the_law_of_the_lever(seed: int, machine: Machine) -> None:
    q, _, offset = random_case(seed, machine)
    point = frame_position(machine, q[None], "head", offset)[0]
    found = tipping_load(machine, q, Slope(), frame="head", offset=offset)
    assert found.mass == pytest.approx(max(level_tipping_load(machine, q, point), 0.0), rel=1e-9)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize(
    "turn", [(-np.inf, np.inf), (-0.4, 1.1), (-6.2, 6.2), (2.0, 9.0), (-1e16, 1e16)]
)
def test_the_worst_turn_is_the_least_of_a_dense_sweep(
    seed: int, turn: tuple[float, float], machine: Machine
) -> None:
    q, slope, offset = random_case(seed, machine)
    lower, upper = machine.limits.position_lower.copy(), machine.limits.position_upper.copy()
    lower[0], upper[0] = turn
    limits = replace(machine.limits, position_lower=lower, position_upper=upper)
    limited = replace(machine, limits=limits)
    q[0] = np.clip(q[0], *turn)
    worst = worst_turn(limited, q, slope, joint="slew", frame="head", offset=offset)
    from_, to = np.clip(turn, -10.0, 10.0)
    sweep = np.linspace(from_, to, 1 + int(115 * (to - from_)))  # half a degree apart
    poses = np.repeat(q[None], len(sweep), axis=0)
    poses[:, 0] = sweep
    loads = [tipping_load(machine, pose, slope, frame="head", offset=offset).mass for pose in poses]
    assert worst.mass <= min(loads) * (1.0 + 1e-9)
    assert worst.mass >= min(loads) * (1.0 - 2e-3) - 1.0  # 0.5 degrees beside it, a shade more
    if np.isfinite(worst.mass):
        assert turn[0] <= worst.coordinate <= turn[1]
        q[0] = worst.coordinate
        there = tipping_load(machine, q, slope, frame="head", offset=offset)
        assert there.mass == pytest.approx(worst.mass, rel=1e-6, abs=1e-3)


def test_a_load_above_the_tracks_never_tips_and_a_stranger_is_refused(machine: Machine) -> None:
    found = tipping_load(machine, np.zeros(5), Slope(), frame="base_link")
    assert (found.mass, found.edge) == (np.inf, -1)
    with pytest.raises(MachineError, match="no frame 'hook'; links are base_link"):
        tipping_load(machine, np.zeros(5), Slope(), frame="hook")
    with pytest.raises(MachineError, match="no support polygon"):
        tipping_load(replace(machine, support=None), np.zeros(5), Slope(), frame="head")


def test_a_machine_that_tips_unloaded_carries_nothing(machine: Machine) -> None:
    narrow = machine.with_support(SupportPolygon([[-0.1, -1.0], [0.05, -1.0], [0.05, 1.0]]))
    q = np.array([0.0, -0.5, -2.0, 0.7, 0.0])
    found = tipping_load(narrow, q, Slope(), frame="head")
    assert found.mass == 0.0
    assert narrow.support.edge_name(found.edge) == "edge 1"

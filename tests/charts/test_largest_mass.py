"""The closed form of the largest mass, against sampling all slew angles."""

from __future__ import annotations

import numpy as np
import pytest

from zmp_sqp.charts.largest_mass import harmonics, largest_mass

CASES = 400
SAMPLES = 8001


def value(base, load, mass, angles):
    """Row base + mass load at slew angles."""
    directions = np.stack([np.ones_like(angles), np.cos(angles), np.sin(angles)])
    return (base + mass * load) @ directions


def sampled_mass(base, load, angles):
    """Largest mass by the affine rows at many fixed angles: an upper bound on the closed form."""
    directions = np.stack([np.ones_like(angles), np.cos(angles), np.sin(angles)])
    at_rest, growth = base @ directions, load @ directions
    if at_rest.max() > 0.0:
        return 0.0
    return min((-at_rest[growth > 0.0] / growth[growth > 0.0]).min(initial=np.inf), 1e9)


@pytest.mark.parametrize("width", [0.0, 0.7, 3.0, 5.5, 2.0 * np.pi])
def test_closed_form_agrees_with_dense_sampling(width):
    random = np.random.default_rng(int(10 * width))
    base, load = random.normal(size=(2, CASES, 3))
    base[:, 0] -= 2.0  # most hold without mass
    lower = random.uniform(-8.0, 8.0, CASES)
    found, _ = largest_mass(base, load, lower, lower + width)
    finite = zero = 0
    for k in range(CASES):
        angles = np.linspace(lower[k], lower[k] + width, SAMPLES if width else 1)
        sampled = sampled_mass(base[k], load[k], angles)
        if np.isinf(found[k]):
            assert sampled > 1e4  # beyond it, samples near a tangent angle may still break
            continue
        finite += 1
        zero += found[k] == 0.0
        # the worst angle lies between samples: the sampled mass is never below the true one
        assert found[k] <= sampled * (1.0 + 1e-9) + 1e-9
        assert found[k] >= sampled * (1.0 - 1e-4) - 1e-6 or found[k] > 1e3
    assert finite > CASES / 4
    assert zero > 4


def test_the_row_is_zero_at_the_largest_mass_and_broken_beyond():
    random = np.random.default_rng(7)
    base, load = random.normal(size=(2, CASES, 3))
    base[:, 0] -= 3.0
    found, worst = largest_mass(base, load, np.array(-4.0), np.array(4.0))
    angles = np.linspace(-np.pi, np.pi, SAMPLES)
    inside = np.flatnonzero(np.isfinite(found) & (found > 0.0) & (found < 100.0))
    assert len(inside) > 100
    for k in inside:
        size = np.abs(base[k]).sum() + found[k] * np.abs(load[k]).sum()
        assert abs(value(base[k], load[k], found[k], angles).max()) < 1e-6 * size
        assert value(base[k], load[k], found[k] * 1.001, angles).max() > 0.0
        assert value(base[k], load[k], 0.0, angles).max() == pytest.approx(worst[k], abs=1e-6)


def test_without_an_arc_there_is_no_mass():
    found, worst = largest_mass(np.array([-1.0, 0, 0]), np.ones(3), np.array(np.nan), np.array(0.0))
    assert np.isnan(found)
    assert np.isnan(worst)


def test_three_samples_give_the_harmonics():
    random = np.random.default_rng(3)
    wanted = random.normal(size=(4, 5, 3))
    angles = np.array([0.0, 2.0 * np.pi / 3.0, -2.0 * np.pi / 3.0])
    basis = np.stack([np.ones(3), np.cos(angles), np.sin(angles)])  # (3 coefficients, 3 angles)
    samples = np.moveaxis(wanted @ basis, -1, 0)
    assert harmonics(samples) == pytest.approx(wanted, abs=1e-12)

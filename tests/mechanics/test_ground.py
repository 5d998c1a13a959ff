from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics.ground import GRAVITY, Ground, Slope

EXACT = 1e-14  # [m/s^2], closed form against matrices


@pytest.mark.parametrize("yaw", [0.0, 0.9, -2.0])
def test_gravity_is_that_of_the_rotation_matrices(yaw: float) -> None:
    slope = Slope(roll=-0.35, pitch=0.26)
    lean = pin.utils.rotate("y", slope.pitch) @ pin.utils.rotate("x", slope.roll) @ pin.utils.rotate("z", yaw)
    np.testing.assert_allclose(slope.gravity(yaw), lean.T @ [0.0, 0.0, -GRAVITY], atol=10 * EXACT)


def test_negative_roll_pulls_to_the_left_and_positive_pitch_to_the_front() -> None:
    assert Slope(roll=-0.1).gravity()[1] > 0.0
    assert Slope(pitch=0.1).gravity()[0] > 0.0
    np.testing.assert_allclose(Slope().gravity(), [0.0, 0.0, -GRAVITY], atol=EXACT)


def test_turning_round_on_a_slope_swaps_uphill_and_downhill() -> None:
    ahead, back = Slope(pitch=0.2).gravity(), Slope(pitch=0.2).gravity(np.pi)
    np.testing.assert_allclose(ahead * [-1, -1, 1], back, atol=10 * EXACT)


def test_slope_is_a_ground() -> None:
    assert isinstance(Slope(), Ground)


@pytest.mark.parametrize("angle", [np.nan, np.inf, np.pi / 2, -2.0, "steep", None])
@pytest.mark.parametrize("name", ["roll", "pitch"])
def test_impossible_slopes_are_refused_by_name(name: str, angle: object) -> None:
    with pytest.raises(MachineError, match=f"slope {name}"):
        Slope(**{name: angle})

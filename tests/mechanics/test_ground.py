from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics.ground import GRAVITY, Ground, Slope
from zmp_sqp.mechanics.support import SupportPolygon

EXACT = 1e-14  # [m/s^2], closed form against matrices


@pytest.mark.parametrize("yaw", [0.0, 0.9, -2.0])
def test_gravity_is_that_of_the_rotation_matrices(yaw: float) -> None:
    slope = Slope(roll=-0.35, pitch=0.26)
    lean = (
        pin.utils.rotate("y", slope.pitch)
        @ pin.utils.rotate("x", slope.roll)
        @ pin.utils.rotate("z", yaw)
    )
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


@pytest.mark.parametrize("slope", [Slope(), Slope(-0.35, 0.26)])
def test_a_base_at_rest_feels_gravity_alone(slope: Slope) -> None:
    pose, zero = np.array([[3.0, -2.0, 0.9], [0.0, 0.0, -2.0]]), np.zeros((2, 2))
    motion = slope.base_motion(pose, zero, zero, 4.0)
    np.testing.assert_allclose(motion.velocity, 0.0)
    np.testing.assert_allclose(
        motion.acceleration[:, :3], [-4.0 * slope.gravity(yaw) for yaw in pose[:, 2]]
    )
    np.testing.assert_allclose(motion.acceleration[:, 3:], 0.0)


def test_driving_a_bend_adds_no_speed_times_yaw_rate() -> None:
    motion = Slope().base_motion(np.zeros((1, 3)), np.array([[2.0, 0.5]]), np.array([[0.3, -0.1]]))
    np.testing.assert_allclose(motion.velocity, [[2.0, 0.0, 0.0, 0.0, 0.0, 0.5]])
    np.testing.assert_allclose(
        motion.acceleration, [[0.3, 0.0, GRAVITY, 0.0, 0.0, -0.1]], atol=EXACT
    )


def test_a_plane_goes_on_for_ever_and_tracks_follow_it() -> None:
    support = SupportPolygon([[1.0, -1.0], [1.0, 1.0], [-1.0, 0.0]])
    Slope(0.3).check_followable(support, np.array([[1e6, 0.0, 0.0]]))
    assert np.isinf(Slope().extent).all()

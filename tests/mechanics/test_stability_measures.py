"""Load transfer, force angle and tip-over energy: closed forms, and the sign of the ZMP."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import zmp_sqp as zs
from zmp_sqp.mechanics.stability_measures import center_of_mass, stability_measures

EXACT = 1e-9
HEIGHT, LENGTH, WIDTH, MASS = 2.0, 3.0, 1.5, 1100.0

BLOCK = f"""<robot name="block">
  <link name="base_link"><inertial><mass value="100"/><origin xyz="0 0 {HEIGHT}"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="weight"><inertial><mass value="1000"/>
    <inertia ixx="1e-9" iyy="1e-9" izz="1e-9" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="slide" type="prismatic"><parent link="base_link"/><child link="weight"/><origin
  xyz="0 0 {HEIGHT}"/>
    <axis xyz="0 1 0"/><limit lower="-5" upper="5" velocity="1" effort="1"/></joint>
</robot>"""


@pytest.fixture
def block(tmp_path: Path) -> zs.Machine:
    """A mass at height 2 m that slides sideways on a footprint of 6 m x 3 m."""
    path = tmp_path / "block.urdf"
    path.write_text(BLOCK, encoding="utf-8")
    corners = [(-LENGTH, -WIDTH), (LENGTH, -WIDTH), (LENGTH, WIDTH), (-LENGTH, WIDTH)]
    return zs.load_machine(path, support=zs.SupportPolygon(corners))


def test_a_block_at_rest_has_the_closed_forms(block: zs.Machine) -> None:
    still = np.zeros((1, 1))
    found = stability_measures(block, still, still, still, zs.Slope())
    reach = np.hypot(WIDTH, HEIGHT)
    assert found.margin[0] == pytest.approx(WIDTH, abs=EXACT)
    assert found.load_transfer_ratio[0] == pytest.approx(0.0, abs=EXACT)
    assert found.force_angle[0] == pytest.approx(np.arctan2(WIDTH, HEIGHT), abs=EXACT)
    assert found.tip_over_energy[0] == pytest.approx(MASS * 9.81 * (reach - HEIGHT), rel=1e-9)


def test_a_block_on_a_slope_has_its_angle_less_and_lifts_less(block: zs.Machine) -> None:
    still, lean = np.zeros((1, 1)), 0.2
    found = stability_measures(block, still, still, still, zs.Slope(roll=-lean))  # to its left
    edge = np.arctan2(WIDTH, HEIGHT)
    reach = np.hypot(WIDTH, HEIGHT)
    assert found.force_angle[0] == pytest.approx(edge - lean, abs=EXACT)
    assert found.tip_over_energy[0] == pytest.approx(
        MASS * 9.81 * reach * (1.0 - np.cos(edge - lean)), rel=1e-9
    )
    assert found.load_transfer_ratio[0] == pytest.approx(HEIGHT * np.tan(lean) / WIDTH, abs=EXACT)


def test_the_load_transfer_ratio_is_that_of_two_tracks(block: zs.Machine) -> None:
    """Loads of two tracks by moments about each of them."""
    q, v, a = np.array([[0.4]]), np.array([[0.3]]), np.array([[1.2]])
    found = stability_measures(block, q, v, a, zs.Slope())
    y = float(zs.zmp(block, q, v, a, zs.Slope())[0, 1])
    left, right = (y + WIDTH) / (2 * WIDTH), (WIDTH - y) / (2 * WIDTH)
    assert found.load_transfer_ratio[0] == pytest.approx(
        abs(left - right) / (left + right), abs=EXACT
    )


def test_all_measures_change_sign_with_the_zmp() -> None:
    machine = zs.load_machine("feller_buncher").with_payload(
        zs.Payload(mass=4000.0, com=(0.0, 0.0, 3.3), frame="head", inertia=np.diag([9e3, 9e3, 5e2]))
    )
    rng, signs = np.random.default_rng(0), []
    while len(signs) < 300:
        q, v, a = (
            rng.uniform(-1.5, 1.5, (3, 1, machine.size)) * np.array([1.0, 0.5, 0.8])[:, None, None]
        )
        try:
            found = stability_measures(machine, q, v, a, zs.Slope(*rng.uniform(-0.4, 0.4, 2)))
        except zs.ZmpSqpError:
            continue
        if abs(found.margin[0]) < 1e-6:
            continue
        signs.append(found.margin[0] > 0.0)
        assert (found.load_transfer_ratio[0] < 1.0) == signs[-1]
        assert (found.force_angle[0] > 0.0) == signs[-1]
        assert (found.tip_over_energy[0] > 0.0) == signs[-1]
    assert 50 < sum(signs) < 250  # both happened


def test_the_centre_of_mass_is_what_the_zmp_of_a_machine_at_rest_stands_under() -> None:
    machine = zs.load_machine("feller_buncher")
    q = np.random.default_rng(1).uniform(-1.0, 1.0, (5, machine.size))
    still = np.zeros_like(q)
    np.testing.assert_allclose(
        center_of_mass(machine, q)[:, :2], zs.zmp(machine, q, still, still, zs.Slope()), atol=EXACT
    )


def test_wrong_questions_get_the_zmps_own_errors(block: zs.Machine) -> None:
    one = np.zeros((1, 1))
    with pytest.raises(zs.MachineError, match="v must have the shape of q"):
        stability_measures(block, one, np.zeros((2, 1)), one, zs.Slope())
    with pytest.raises(zs.MachineError, match="must be finite"):
        stability_measures(block, one * np.nan, one, one, zs.Slope())

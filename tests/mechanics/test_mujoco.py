from __future__ import annotations

import numpy as np
import pytest

from zmp_sqp.mechanics.ground import Slope
from zmp_sqp.mechanics.urdf.loader import load_machine, shipped_machines
from zmp_sqp.mechanics.zero_moment_point import zmp

mujoco = pytest.importorskip("mujoco")

# [m], two engines on the same numbers; MuJoCo keeps inertial frames in its own order of axes
ENGINES = 1e-6


@pytest.mark.physics
@pytest.mark.parametrize("name", sorted(shipped_machines()))
def test_mujoco_reads_the_same_machine_with_the_same_mass_and_static_zmp(name: str) -> None:
    machine = load_machine(name)
    text = shipped_machines()[name].read_text()
    options = '<mujoco><compiler fusestatic="false" discardvisual="false"/></mujoco>'
    spec = mujoco.MjSpec.from_string(text.replace("</robot>", f"{options}</robot>"))
    spec.worldbody.first_body().add_freejoint()  # without it the base's mass is lost
    model = spec.compile()
    data = mujoco.MjData(model)
    assert model.body_mass.sum() == pytest.approx(machine.mass)
    random = np.random.default_rng(21)
    zero = np.zeros(machine.size)
    for _ in range(5):
        q = random.uniform(-0.5, 0.5, machine.size)
        for joint, value in zip(machine.joint_names, q, strict=True):
            data.joint(joint).qpos = value
        mujoco.mj_forward(model, data)
        at_rest = zmp(machine, q, zero, zero, Slope())  # on level ground: under the centre of mass
        np.testing.assert_allclose(at_rest, data.subtree_com[1, :2], atol=ENGINES)

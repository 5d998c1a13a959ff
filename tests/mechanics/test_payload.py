from __future__ import annotations

import re

import numpy as np
import pinocchio as pin
import pytest

from tests.mechanics.conftest import TREE_COM
from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics.machine import Machine
from zmp_sqp.mechanics.payload import Payload


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"mass": 0.0}, "mass must be positive, not 0.0 kg"),
        ({"mass": -3.0}, "mass must be positive, not -3.0 kg"),
        ({"mass": np.nan}, "mass must be finite"),
        ({"mass": "heavy"}, "mass must be a number, not 'heavy'"),
        ({"com": (0, 0)}, "com must have shape (3,)"),
        ({"com": (0, np.inf, 0)}, "entry [1] is inf"),
        ({"frame": 5}, "frame must be the name of a link, not 5"),
        ({"inertia": np.eye(2)}, "inertia must have shape (3, 3)"),
        ({"inertia": np.diag([1, 1, np.nan])}, "inertia must be finite"),
        ({"inertia": [[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]}, "inertia must be symmetric"),
        ({"inertia": np.diag([1, 1, -0.1])}, "positive semi-definite"),
        ({"inertia": np.diag([1, 1, 3])}, "triangle inequality"),
    ],
)
def test_impossible_payloads_are_refused_by_name(change: dict[str, object], named: str) -> None:
    with pytest.raises(MachineError, match=re.escape(named)):
        Payload(**{"mass": 10.0, "com": (0, 0, 1), "frame": "head", **change})


def test_a_slender_stem_may_have_no_inertia_about_its_axis() -> None:
    assert Payload(10.0, (0, 0, 1), "head", np.diag([2.0, 2.0, 0.0])).inertia is not None


def test_unknown_frame_lists_the_frames_there_are(feller_buncher: Machine) -> None:
    with pytest.raises(MachineError, match=r"no frame 'haed'.*base_link.*stick.*head"):
        feller_buncher.with_payload(Payload(10.0, (0, 0, 0), "haed"))


def test_the_universe_carries_nothing(feller_buncher: Machine) -> None:
    with pytest.raises(MachineError, match="no frame 'universe'"):
        feller_buncher.with_payload(Payload(10.0, (0, 0, 0), "universe"))


def test_payload_is_what_append_body_to_joint_makes_of_it(feller_buncher: Machine) -> None:
    inertia = np.diag([30.0, 40.0, 50.0])
    ours = feller_buncher.with_payload(Payload(4000.0, TREE_COM, "head", inertia)).model
    theirs = feller_buncher.model.copy()
    frame = theirs.frames[theirs.getFrameId("head", pin.FrameType.BODY)]
    body = pin.Inertia(4000.0, np.array(TREE_COM), inertia)
    theirs.appendBodyToJoint(frame.parentJoint, body, frame.placement)
    assert all(
        one.isApprox(other) for one, other in zip(ours.inertias, theirs.inertias, strict=True)
    )


def test_payload_sits_in_the_axes_of_a_fixed_frame(permuted: Machine) -> None:
    index = permuted.model.getFrameId("tool", pin.FrameType.BODY)
    loaded = permuted.with_payload(Payload(3.0, (0.1, 0.2, 0.3), "tool")).model
    joint, placement = (
        permuted.model.frames[index].parentJoint,
        permuted.model.frames[index].placement,
    )
    before, after = permuted.model.inertias[joint], loaded.inertias[joint]
    added = (after.mass * after.lever - before.mass * before.lever) / 3.0
    np.testing.assert_allclose(added, placement.act(np.array([0.1, 0.2, 0.3])), atol=1e-12)


def test_a_machine_can_carry_several_payloads(feller_buncher: Machine) -> None:
    twice = feller_buncher.with_payload(Payload(10.0, (0, 0, 0), "head")).with_payload(
        Payload(20.0, (0, 0, 1), "head")
    )
    assert twice.mass == pytest.approx(feller_buncher.mass + 30.0)
    assert twice.with_point_masses().mass == pytest.approx(feller_buncher.mass + 30.0)

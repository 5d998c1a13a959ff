from __future__ import annotations

import os
import re
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from tests.mechanics.conftest import PERMUTED
from zmp_sqp.errors import MachineError
from zmp_sqp.mechanics.support import SupportPolygon
from zmp_sqp.mechanics.urdf.loader import load_machine, shipped_machines

EXACT = 1e-12  # [m], sums of a few decimal numbers
INERTIA = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
BASE = f'<link name="base"><inertial><mass value="10"/>{INERTIA}</inertial></link>'
ARM = (
    f'<link name="arm"><inertial><origin xyz="0 0 1"/><mass value="2"/>{INERTIA}</inertial></link>'
)
TURN = (
    '<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>'
    '<limit lower="-1" upper="1" velocity="2" effort="3"/></joint>'
)
TOY = f'<robot name="toy">{BASE}{ARM}{TURN}</robot>'


def write(folder: Path, text: str | bytes, name: str = "toy.urdf") -> Path:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def test_feller_buncher_is_the_machine_of_the_paper() -> None:
    machine = load_machine("feller_buncher")
    assert machine.joint_names == ("slew", "boom", "stick", "tilt", "head")
    assert machine.mass == pytest.approx(23650.0)
    np.testing.assert_allclose(machine.limits.position_upper, [2 * np.pi, 0.6, -0.3, 3.1, 3.2])
    np.testing.assert_allclose(machine.limits.velocity, np.pi / 4)
    np.testing.assert_allclose(machine.limits.acceleration, np.pi / 2)
    assert not machine.model.gravity.vector.any()


@pytest.mark.parametrize(
    "support", [None, ("left_track", "right_track"), ["right_track", "left_track"]]
)
def test_feller_buncher_stands_on_a_rectangle_of_5_by_3_23_metres(support: object) -> None:
    found = load_machine("feller_buncher", support=support).support
    assert found is not None
    assert found.height == pytest.approx(0.0, abs=EXACT)
    corners = np.array(sorted(found.vertices.tolist()))
    np.testing.assert_allclose(
        corners, [[-2.5, -1.615], [-2.5, 1.615], [2.5, -1.615], [2.5, 1.615]], atol=EXACT
    )


@pytest.mark.parametrize("name", sorted(shipped_machines()))
def test_every_shipped_machine_loads_with_support_and_limits(name: str) -> None:
    machine = load_machine(name)
    assert machine.support is not None
    assert machine.limits.missing(machine.joint_names) == {}


def test_a_path_and_a_name_give_the_same_machine() -> None:
    path = shipped_machines()["feller_buncher"]
    for source in (path, str(path)):
        assert load_machine(source).joint_names == load_machine("feller_buncher").joint_names


@pytest.mark.parametrize(
    ("source", "named"),
    [
        ("feller_bunhcer", "no machine 'feller_bunhcer'; machines are excavator, feller_buncher"),
        ("none/arm.urdf", "no file none/arm.urdf"),
        ("arm.urdf", "no file arm.urdf"),
        (Path("arm"), "no file arm"),
        ("/", "is a folder"),
        ("", "source must be"),
        (None, "source must be"),
        ("a\0b", "a"),
    ],
)
def test_sources_that_are_not_there_are_named(source: object, named: str) -> None:
    with pytest.raises(MachineError, match=re.escape(named)):
        load_machine(source)


def edited(old: str, new: str) -> str:
    if old not in TOY:
        raise ValueError(f"{old} is not in the toy machine")
    return TOY.replace(old, new)


FAULTS = {
    "empty": ("", "the file is empty"),
    "blank": (" \n\t", "the file is empty"),
    "malformed": (
        "<robot name='toy'>\n<link name='a'>\n</robot>",
        "not well-formed XML: mismatched tag: line 3",
    ),
    "binary": (b"\x00\xff\xfe\x01 solid", "not well-formed XML"),
    "encoding": (b"<?xml version='1.0' encoding='utf-77'?><robot/>", "XML"),
    "not a robot": ("<sdf><model/></sdf>", "root element is <sdf>, not <robot>"),
    "xacro": (
        '<robot name="x" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arm/></robot>',
        "xacro",
    ),
    "doctype": (
        '<!DOCTYPE robot SYSTEM "file:///etc/passwd"><robot name="x"/>',
        "DOCTYPE and ENTITY",
    ),
    "entity": (
        '<?xml version="1.0"?>\n<!DOCTYPE r [<!ENTITY a "b">]><robot name="&a;"/>',
        "line 2: DOCTYPE",
    ),
    "nameless": (edited('<robot name="toy">', "<robot>"), "<robot> has no name"),
    "no links": ('<robot name="toy"/>', "no links"),
    "floating": (edited('type="revolute"', 'type="floating"'), "joint 'turn' has type 'floating'"),
    "planar": (edited('type="revolute"', 'type="planar"'), "joint 'turn' has type 'planar'"),
    "spherical": (
        edited('type="revolute"', 'type="spherical"'),
        "joint 'turn' has type 'spherical'",
    ),
    "no type": (edited(' type="revolute"', ""), "joint 'turn' has type ''"),
    "mimic of itself": (
        edited("<axis", '<mimic joint="turn"/><axis'),
        "joint 'turn' mimics itself",
    ),
    "mimic of nothing": (
        edited("<axis", "<mimic/><axis"),
        "joint 'turn': its <mimic> names no joint",
    ),
    "infinite mimic": (
        edited("<axis", '<mimic joint="turn" offset="inf"/><axis'),
        "joint 'turn': <mimic offset> must be finite",
    ),
    "no parent": (edited('<parent link="base"/>', ""), "joint 'turn' has no <parent link>"),
    "absent child": (
        edited('<child link="arm"/>', '<child link="leg"/>'),
        "joint 'turn' names link 'leg'",
    ),
    "zero axis": (
        edited('xyz="0 0 1"/><limit', 'xyz="0 0 0"/><limit'),
        "joint 'turn': its axis is zero",
    ),
    "two links of a name": (edited(ARM, ARM + ARM), "link 'arm' is there twice"),
    "two joints of a name": (edited(TURN, TURN + TURN), "joint 'turn' is there twice"),
    "universe": (edited('name="turn"', 'name="universe"'), "'universe'"),
    "several roots": (
        edited(TURN, TURN + '<link name="loose"/>'),
        "several root links: 'base', 'loose'",
    ),
    "two parents": (
        edited(TURN, TURN + TURN.replace('name="turn"', 'name="again"')),
        "link 'arm' has two parents",
    ),
    "loop": (
        edited(
            TURN,
            TURN + '<link name="a"/><link name="b"/>'
            '<joint name="ab" type="fixed"><parent link="a"/><child link="b"/></joint>'
            '<joint name="ba" type="fixed"><parent link="b"/><child link="a"/></joint>',
        ),
        "link 'a' hangs on a loop",
    ),
    "no mass": (edited('<mass value="2"/>', ""), "link 'arm': its <inertial> has no <mass>"),
    "mass without value": (
        edited('<mass value="2"/>', "<mass/>"),
        "link 'arm': <mass value> is missing",
    ),
    "negative mass": (
        edited('value="2"', 'value="-2"'),
        "link 'arm': mass must not be negative, not -2.0 kg",
    ),
    "infinite mass": (
        edited('value="2"', 'value="inf"'),
        "link 'arm': <mass value> must be finite",
    ),
    "nan mass": (edited('value="2"', 'value="nan"'), "link 'arm': <mass value> must be finite"),
    "mass in words": (
        edited('value="2"', 'value="2,5"'),
        "link 'arm': <mass value> must be a number, not '2,5'",
    ),
    "no inertia": (
        edited(f'<mass value="2"/>{INERTIA}', '<mass value="2"/>'),
        "link 'arm': its <inertial> has no",
    ),
    "inertia entry": (
        edited('iyz="0" izz="1"', 'izz="1"'),
        "link 'base': <inertia iyz> is missing",
    ),
    "nan inertia": (edited('izz="1"', 'izz="nan"'), "link 'base': <inertia izz> must be finite"),
    "nan origin": (
        edited('xyz="0 0 1"/><mass', 'xyz="0 nan 1"/><mass'),
        "link 'arm': <origin xyz> must be finite",
    ),
    "short origin": (
        edited('xyz="0 0 1"/><mass', 'xyz="0 1"/><mass'),
        "link 'arm': <origin xyz> must be 3 numbers",
    ),
    "limits crossed": (
        edited('lower="-1"', 'lower="2"'),
        "joint 'turn': lower position limit 2.0 is above upper",
    ),
    "nan limit": (edited('upper="1"', 'upper="nan"'), "joint 'turn': <limit upper> must be finite"),
    "negative velocity": (
        edited('velocity="2"', 'velocity="-2"'),
        "joint 'turn': velocity limit must not be negative",
    ),
}


@pytest.mark.parametrize("fault", sorted(FAULTS))
def test_each_fault_of_a_urdf_is_named(
    fault: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    text, named = FAULTS[fault]
    with pytest.raises(MachineError, match=re.escape(named)) as refusal:
        load_machine(write(tmp_path, text))
    assert str(refusal.value).startswith(str(tmp_path / "toy.urdf")), "the message names the file"
    assert capfd.readouterr() == ("", "")


def test_the_cause_that_pinocchio_only_prints_is_in_the_message(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path, edited("<axis", "<safety_controller/><axis"))
    with pytest.raises(
        MachineError, match=r"Pinocchio cannot read.*joint safety: no k_velocity.*\[turn\]"
    ):
        load_machine(path)
    assert capfd.readouterr() == ("", "")
    os.write(2, b"still open\n")
    assert capfd.readouterr().err == "still open\n"


@pytest.mark.parametrize("edit", ["", "<safety_controller/>"])
def test_what_other_threads_write_while_a_machine_loads_is_passed_on(
    edit: str, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path, edited("<axis", f"{edit}<axis"))
    build = pin.buildModelFromXML

    def beside(*given: object) -> object:
        os.write(2, b"Error: mine\nbefore\n")
        try:
            return build(*given)
        finally:
            os.write(2, b"after\n")

    monkeypatch.setattr(pin, "buildModelFromXML", beside)
    with nullcontext() if not edit else pytest.raises(MachineError, match="no k_velocity"):
        load_machine(path)
    assert capfd.readouterr().err == "Error: mine\nbefore\nafter\n"


def test_a_doctype_in_a_comment_is_no_doctype(tmp_path: Path) -> None:
    assert load_machine(
        write(tmp_path, edited(BASE, "<!-- <!DOCTYPE x> -->" + BASE))
    ).joint_names == ("turn",)


def test_a_joint_may_be_called_as_pinocchio_calls_the_root(tmp_path: Path) -> None:
    machine = load_machine(write(tmp_path, edited('name="turn"', 'name="root_joint"')))
    assert machine.joint_names == ("root_joint",)
    assert machine.index_v.tolist() == [6]


def test_meshes_that_cannot_be_found_are_no_error_unless_asked_for(tmp_path: Path) -> None:
    mesh = '<geometry><mesh filename="package://nowhere/none.stl"/></geometry>'
    path = write(
        tmp_path, edited("</link>", f"<visual>{mesh}</visual><collision>{mesh}</collision></link>")
    )
    machine = load_machine(path)
    assert machine.mass == pytest.approx(12.0)
    assert machine.support is None
    assert "'package://nowhere/none.stl' is not there" in machine.support_hint
    with pytest.raises(MachineError, match="contact link 'base': mesh 'package://nowhere/none"):
        load_machine(path, support=["base"])


@pytest.mark.parametrize(
    ("limit", "missing"),
    [
        ('<limit lower="-1" upper="1" velocity="2" effort="3"/>', {"acceleration"}),
        ('<limit lower="-1" upper="1" velocity="0" effort="0"/>', {"acceleration", "velocity"}),
        ('<limit lower="-1" upper="1"/>', {"acceleration", "velocity"}),
        ('<limit velocity="2"/>', {"acceleration", "position_lower", "position_upper"}),
        ("", {"acceleration", "velocity", "position_lower", "position_upper"}),
    ],
)
def test_a_limit_that_the_urdf_does_not_give_is_missing_but_no_error(
    tmp_path: Path, limit: str, missing: set[str]
) -> None:
    text = edited('<limit lower="-1" upper="1" velocity="2" effort="3"/>', limit)
    machine = load_machine(write(tmp_path, text))
    assert machine.limits.missing(machine.joint_names) == dict.fromkeys(sorted(missing), ("turn",))


def test_continuous_joints_have_no_position_limits(tmp_path: Path) -> None:
    machine = load_machine(write(tmp_path, edited("revolute", "continuous")))
    assert machine.limits.position_lower[0] == -np.inf
    assert machine.limits.missing(machine.joint_names) == {"acceleration": ("turn",)}


YAML = "joint_limits: {{turn: {{has_acceleration_limits: true, max_acceleration: {}}}}}"


def test_limits_come_from_beside_the_urdf_then_from_the_argument(tmp_path: Path) -> None:
    path = write(tmp_path, TOY)
    write(tmp_path, YAML.format(5), "joint_limits.yaml")
    assert load_machine(path).limits.acceleration == 5.0
    write(tmp_path, YAML.format(6), "toy.joint_limits.yaml")
    assert load_machine(path).limits.acceleration == 6.0
    assert load_machine(path, limits={"acceleration": 7}).limits.acceleration == 7.0
    both = load_machine(path, limits={"velocity": {"turn": 0.8}}).limits
    assert (both.velocity[0], both.acceleration[0], both.effort[0]) == (0.8, 6.0, 3.0)
    other = write(tmp_path, YAML.format(8), "other.yaml")
    for limits in (other, str(other)):
        assert load_machine(path, limits=limits).limits.acceleration == 8.0


@pytest.mark.parametrize("limits", [{"speed": 1}, 5, "none.yaml", {"velocity": {"twist": 1}}])
def test_bad_limits_are_refused(tmp_path: Path, limits: object) -> None:
    with pytest.raises(MachineError):
        load_machine(write(tmp_path, TOY), limits=limits)


def test_support_polygons_are_taken_as_they_are(tmp_path: Path) -> None:
    triangle = SupportPolygon([[0, 0], [1, 0], [0, 1]], height=-0.2)
    assert load_machine(write(tmp_path, TOY), support=triangle).support is triangle


def shapes(*collisions: str) -> str:
    """The toy machine with collision shapes on its base, each 'x y z r p y <geometry>'."""
    elements = ""
    for collision in collisions:
        x, y, z, roll, pitch, yaw, geometry = collision.split(maxsplit=6)
        origin = f'<origin xyz="{x} {y} {z}" rpy="{roll} {pitch} {yaw}"/>'
        elements += f"<collision>{origin}<geometry>{geometry}</geometry></collision>"
    return edited(BASE, BASE.replace("</link>", elements + "</link>"))


def corners(tmp_path: Path, *collisions: str) -> np.ndarray:
    support = load_machine(write(tmp_path, shapes(*collisions))).support
    if support is None:
        raise ValueError("no support")
    return np.array(sorted(np.round(support.vertices, 9).tolist()))


def test_lying_wheels_touch_the_ground_along_a_line(tmp_path: Path) -> None:
    wheel = '<cylinder radius="0.5" length="0.2"/>'
    wheels = (f"{x} {y} 0.5 1.5707963 0 0 {wheel}" for x in (-1, 1) for y in (-0.6, 0.6))
    np.testing.assert_allclose(
        corners(tmp_path, *wheels), [[-1, -0.7], [-1, 0.7], [1, -0.7], [1, 0.7]], atol=1e-6
    )


def test_an_upright_cylinder_stands_on_a_polygon_inside_its_base(tmp_path: Path) -> None:
    found = corners(tmp_path, '2 0 0.1 0 0 0 <cylinder radius="0.5" length="0.2"/>')
    assert len(found) == 32
    np.testing.assert_allclose(np.linalg.norm(found - [2, 0], axis=1), 0.5, atol=1e-8)


def test_spheres_touch_in_their_lowest_points_and_what_is_higher_does_not_count(
    tmp_path: Path,
) -> None:
    balls = [f'{x} {y} 0.3 0 0 0 <sphere radius="0.3"/>' for x, y in ((0, 0), (2, 0), (0, 1))]
    found = corners(
        tmp_path, *balls, '9 9 9 0 0 0 <box size="1 1 1"/>', '0 2 0.35 0 0 0 <sphere radius="0.3"/>'
    )
    np.testing.assert_allclose(found, [[0, 0], [0, 1], [2, 0]], atol=EXACT)


@pytest.mark.parametrize(
    "collisions",
    [(), ('0 0 1 0 0 0 <sphere radius="1"/>',), ('0 0 1 0.5 0.5 0 <box size="1 1 1"/>',)],
)
def test_shapes_that_span_no_polygon_give_no_support(
    tmp_path: Path, collisions: tuple[str, ...]
) -> None:
    assert load_machine(write(tmp_path, shapes(*collisions))).support is None


@pytest.mark.parametrize(
    ("support", "named"),
    [
        ("paw", "no contact link 'paw'; links are base, slide"),
        (["hand"], "contact link 'hand' moves with joint 'wrist'"),
        ([], "no contact links"),
        (5, "names of contact links, not 5"),
        ([[0, 0], [1, 0], [0, 1]], "names of contact links"),
    ],
)
def test_bad_contact_links_are_named(tmp_path: Path, support: object, named: str) -> None:
    with pytest.raises(MachineError, match=re.escape(named)):
        load_machine(write(tmp_path, PERMUTED), support=support)


def test_contact_links_at_different_heights_or_without_shape_are_named(tmp_path: Path) -> None:
    foot = '<collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision>'
    feet = "".join(
        f'<link name="{name}">{shape}</link><joint name="{name}_mount" type="fixed">'
        f'<parent link="base"/><child link="{name}"/><origin xyz="{x} 0 {z}"/></joint>'
        for name, shape, x, z in (
            ("low", foot, 0, 0.0),
            ("high", foot, 1, 0.05),
            ("bare", "", 2, 0.0),
        )
    )
    path = write(tmp_path, edited(TURN, TURN + feet))
    with pytest.raises(MachineError, match=r"contact link 'high' ends 0\.050 m above"):
        load_machine(path, support=["low", "high"])
    with pytest.raises(MachineError, match="contact link 'bare' has no collision shape"):
        load_machine(path, support=["low", "bare"])

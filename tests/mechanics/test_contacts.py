"""Support polygons from meshes, wheels, feet on held legs, and tracks of unequal height."""

from __future__ import annotations

import re
import struct
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import zmp_sqp as zs
from tests.mechanics.test_urdf import BASE, TOY, shapes, write

CUBE = np.array(list(product((0.0, 1.0), repeat=3)))  # corners of a cube of 1 m
FACES = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)]
FACES += [(2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]
FACES = [tuple(face) for face in FACES]


def stl(points: np.ndarray, faces: list[tuple[int, ...]] = FACES) -> bytes:
    data = b" " * 80 + struct.pack("<I", len(faces))
    for face in faces:
        corners = points[list(face)].ravel()
        data += struct.pack("<12fH", 0, 0, 0, *corners, 0)
    return data


def obj(points: np.ndarray) -> bytes:
    lines = [f"v {x} {y} {z}" for x, y, z in points]
    lines += ["f " + " ".join(str(i + 1) for i in face) for face in FACES]
    return ("mtllib ../secret.mtl\n" + "\n".join(lines) + "\n").encode()


def dae(points: np.ndarray, unit: float) -> bytes:
    numbers = " ".join(f"{value / unit}" for value in points.ravel())
    indices = " ".join(str(i) for face in FACES for i in face)
    return f"""<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="some" meter="{unit}"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh><source id="p">
<float_array id="a" count="{points.size}">{numbers}</float_array><technique_common>
<accessor source="#a" count="{len(points)}" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="{len(FACES)}"><input semantic="VERTEX" source="#v" offset="0"/><p>{indices}</p>
</triangles></mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="s">
<node id="n"><instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>""".encode()


def on_mesh(filename: str, scale: str = "1 1 1") -> str:
    return shapes(f'-0.5 -0.5 -0.2 0 0 0 <mesh filename="{filename}" scale="{scale}"/>')


def corners(machine: zs.Machine) -> list[list[float]]:
    assert machine.support is not None
    return sorted(np.round(machine.support.vertices, 6).tolist())


SQUARE = [[-0.5, -0.5], [-0.5, 0.5], [0.5, -0.5], [0.5, 0.5]]


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("cube.stl", stl(CUBE)),
        ("cube.STL", stl(CUBE)),
        ("cube.obj", obj(CUBE)),
        ("cube.dae", dae(CUBE, 1.0)),
        ("inches.dae", dae(CUBE, 0.0254)),
    ],
)
@pytest.mark.parametrize("uri", ["meshes/{}", "package://crane/meshes/{}", "file://{here}/{}"])
def test_meshes_stand_on_their_convex_hulls(
    tmp_path: Path, name: str, content: bytes, uri: str
) -> None:
    folder = tmp_path / "crane" / "meshes"
    folder.mkdir(parents=True)
    (folder / name).write_bytes(content)
    path = write(tmp_path / "crane", on_mesh(uri.format(name, here=folder)))
    dirs = [tmp_path] if uri.startswith("package") else None
    for support in (None, ["base"]):
        machine = zs.load_machine(path, support=support, package_dirs=dirs)
        assert corners(machine) == SQUARE
        assert machine.support.height == pytest.approx(-0.2)
    if dirs:  # the package itself may be named, too
        assert corners(zs.load_machine(path, package_dirs=tmp_path / "crane")) == SQUARE


def test_meshes_are_scaled(tmp_path: Path) -> None:
    (tmp_path / "cube.stl").write_bytes(stl(1000.0 * CUBE))
    path = write(tmp_path, on_mesh("cube.stl", "0.001 0.002 0.001"))
    assert corners(zs.load_machine(path)) == [[-0.5, -0.5], [-0.5, 1.5], [0.5, -0.5], [0.5, 1.5]]


def test_nothing_outside_the_allowed_folders_is_opened(tmp_path: Path) -> None:
    inside, outside = tmp_path / "robot", tmp_path / "outside"
    for folder in (inside, outside):
        folder.mkdir()
    (outside / "cube.stl").write_bytes(stl(CUBE))
    (inside / "link.stl").symlink_to(outside / "cube.stl")
    (inside / "folder").symlink_to(outside)
    for filename in (
        "../outside/cube.stl",
        "link.stl",
        "folder/cube.stl",
        str(outside / "cube.stl"),
        f"file://{outside}/cube.stl",
        "package://robot/../outside/cube.stl",
        "package://robot/link.stl",
        "package://%2e%2e/outside/cube.stl",
    ):
        path = write(inside, on_mesh(filename))
        with pytest.raises(zs.MachineError, match=r"'base': mesh .*(outside|not there)") as refusal:
            zs.load_machine(path, support=["base"], package_dirs=[inside])
        assert "\n" not in str(refusal.value)
        machine = zs.load_machine(path, package_dirs=[inside])
        assert machine.support is None
        if "%2e" not in filename:
            assert "outside" in machine.support_hint
            assert corners(zs.load_machine(path, package_dirs=[inside, outside])) == SQUARE


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("none.stl", None, "is not there; meshes may lie in"),
        ("empty.stl", b"", "is empty"),
        ("text.stl", b"no mesh at all", "cannot be read|no vertices"),
        ("cut.stl", stl(CUBE)[:300], "cannot be read|no vertices"),
        ("nan.stl", stl(CUBE * np.nan), "not finite"),
        ("bomb.dae", b'<!DOCTYPE a [<!ENTITY b "c">]>' + dae(CUBE, 1.0), "DOCTYPE"),
        ("unit.dae", dae(CUBE, 1.0).replace(b'meter="1.0"', b'meter="x"'), "not finite"),
        ("cube.3ds", stl(CUBE), "is none of .stl, .obj, .dae"),
        ("", None, "none of box, cylinder, sphere and mesh"),
        ("a\x00b", None, "invalid token|no path"),
    ],
)
def test_meshes_that_cannot_be_read_are_named(
    tmp_path: Path, name: str, content: bytes | None, message: str
) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(zs.MachineError, match=message) as refusal:
        zs.load_machine(write(tmp_path, on_mesh(name)), support=["base"])
    assert "\n" not in str(refusal.value)


def test_package_dirs_must_be_folders(tmp_path: Path) -> None:
    path = write(tmp_path, TOY)
    for given, message in (
        (tmp_path / "none", "package_dirs: there is no folder"),
        (3, "package_dirs must be paths"),
        ([3], "package_dirs must be paths"),
        (path, "package_dirs: there is no folder"),
    ):
        with pytest.raises(zs.MachineError, match=message):
            zs.load_machine(path, package_dirs=given)


# --- wheels and feet ----------------------------------------------------------------------------


def on_wheels(geometry: str, kind: str = "continuous", y: float = 0.4) -> str:
    """The toy machine on four wheels of radius 0.3 m, 0.2 m wide, with axles along y."""
    text = TOY.replace("</robot>", "")
    for i, (x, side) in enumerate(((0.6, y), (0.6, -y), (-0.6, y), (-0.6, -y))):
        text += (
            f'<link name="w{i}"><collision><origin rpy="1.5707963267948966 0 0"/><geometry>'
            f"{geometry}</geometry></collision></link>"
            f'<joint name="axle{i}" type="{kind}"><parent link="base"/><child link="w{i}"/>'
            f'<origin xyz="{x} {side} 0.3"/><axis xyz="0 1 0"/></joint>'
        )
    return text + "</robot>"


def wheel(count: int, turned: float = 0.0) -> bytes:
    """A wheel with as many corners, axis z, as an STL."""
    angles = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False) + turned
    rim = 0.3 * np.column_stack([np.cos(angles), np.sin(angles)])
    points = np.vstack([np.column_stack([rim, np.full(count, z)]) for z in (-0.1, 0.1)])
    faces = [(i, (i + 1) % count, count + i) for i in range(count)]
    return stl(points, faces)


@pytest.mark.parametrize("turned", [0.0, 0.1, 1.0])
@pytest.mark.parametrize("shape", ["cylinder", "mesh", "coarse mesh"])
def test_wheels_touch_the_ground_below_their_axles(
    tmp_path: Path, shape: str, turned: float
) -> None:
    (tmp_path / "wheel.stl").write_bytes(wheel(12 if shape == "coarse mesh" else 64, turned))
    geometry = (
        '<cylinder radius="0.3" length="0.2"/>'
        if shape == "cylinder"
        else '<mesh filename="wheel.stl"/>'
    )
    path = write(tmp_path, on_wheels(geometry))
    for machine in (
        zs.load_machine(path, joints=["turn"], support=["w0", "w1", "w2", "w3"]),
        zs.load_machine(path, joints=["turn"]),
        zs.load_machine(path, joints=["turn"], hold={"axle2": 1.234}),
    ):
        np.testing.assert_allclose(
            corners(machine), [[-0.6, -0.5], [-0.6, 0.5], [0.6, -0.5], [0.6, 0.5]], atol=1e-6
        )


BELLY = '<origin xyz="0 0 0.4"/><geometry><box size="2.0 0.5 0.2"/></geometry>'


@pytest.mark.parametrize("shape", ["cylinder", "mesh", "coarse mesh"])
@pytest.mark.filterwarnings("ignore::zmp_sqp.MachineWarning")
def test_a_machine_stands_on_wheels_that_are_planned_and_not_on_its_belly(
    tmp_path: Path, shape: str
) -> None:
    (tmp_path / "wheel.stl").write_bytes(wheel(12 if shape == "coarse mesh" else 64))
    geometry = '<mesh filename="wheel.stl"/>'
    if shape == "cylinder":
        geometry = '<cylinder radius="0.3" length="0.2"/>'
    text = on_wheels(geometry).replace(
        '<link name="base">', f'<link name="base"><collision>{BELLY}</collision>'
    )
    path = write(tmp_path, text)
    with pytest.warns(
        zs.MachineWarning,
        match=r"stands on wheels that planned joints turn: hold axle0, axle1, axle2, and 1 more",
    ):
        rolling = zs.load_machine(path)
    held = zs.load_machine(path, joints=["turn"])
    assert (rolling.wheels, held.wheels) == (("axle0", "axle1", "axle2", "axle3"), ())
    assert rolling.size == held.size + 4
    assert corners(rolling) == corners(held)
    np.testing.assert_allclose(np.abs(corners(rolling)), [[0.6, 0.5]] * 4, atol=1e-6)


def on_steered_wheels(geometry: str) -> str:
    """The toy machine on four wheels, each with a vertical steering joint above its axle."""
    text = on_wheels(geometry)
    for i in range(4):
        start = text.index(f'<joint name="axle{i}"')
        axle = text[start : text.index("</joint>", start)]
        place = re.search(r'xyz="([^"]*)"', axle)
        assert place is not None
        steering = (
            f'<link name="k{i}"/><joint name="steer{i}" type="revolute"><parent link="base"/>'
            f'<child link="k{i}"/><origin xyz="{place[1]}"/><axis xyz="0 0 1"/>'
            '<limit lower="-0.5" upper="0.5" velocity="1" effort="1"/></joint>'
        )
        turned = axle.replace('link="base"', f'link="k{i}"').replace(place[1], "0 0 0", 1)
        text = text.replace(axle, turned).replace("</robot>", f"{steering}</robot>")
    return text


@pytest.mark.filterwarnings("ignore::zmp_sqp.MachineWarning")
def test_a_machine_on_steered_wheels_does_not_stand_on_its_belly(tmp_path: Path) -> None:
    text = on_steered_wheels('<cylinder radius="0.3" length="0.2"/>').replace(
        '<link name="base">', f'<link name="base"><collision>{BELLY}</collision>'
    )
    path = write(tmp_path, text)
    planned = zs.load_machine(path)
    assert planned.support is None
    assert "link 'w0', which turns like a wheel and which planned joints move, reaches 0.300" in (
        planned.support_hint
    )
    assert "SupportPolygon" not in planned.support_hint  # on the belly
    held = zs.load_machine(path, joints=["turn"])
    np.testing.assert_allclose(np.abs(corners(held)), [[0.6, 0.5]] * 4, atol=1e-6)


@pytest.mark.parametrize(
    "kind", ["limited", "cambered", "steered", "tilted", "rocking", "hub", "three"]
)
@pytest.mark.filterwarnings("ignore::zmp_sqp.MachineWarning")
def test_a_machine_on_wheels_that_move_otherwise_does_not_stand_on_its_belly(
    tmp_path: Path, kind: str
) -> None:
    """Wheels with limits, on inclined axles, steered, on rockers, or that carry a further joint."""
    round_shape = '<cylinder radius="0.3" length="0.2"/>'
    text = on_wheels(round_shape)
    if kind in ("limited", "steered", "tilted", "rocking"):
        text = on_steered_wheels(round_shape) if kind != "limited" else text
        text = re.sub(
            r'(<joint name="axle\d" type=)"continuous"(.*?)</joint>',
            r'\1"revolute"\2<limit lower="-50" upper="50" velocity="1" effort="1"/></joint>',
            text,
        )
        axis = {"tilted": "0.17 0 1", "rocking": "0 1 0"}.get(kind, "0 0 1")
        steering = '<axis xyz="{}"/><limit lower="-0.5"'
        text = text.replace(steering.format("0 0 1"), steering.format(axis))
    elif kind == "three":  # rocker, suspension, steering
        text = on_steered_wheels(round_shape)
        limit = '<limit lower="-0.2" upper="0.2" velocity="1" effort="1"/>'
        for i in range(4):
            between = "".join(
                f'<link name="{name}{i}"/><joint name="j{name}{i}" type="{kind_of}"><parent link='
                f'"{parent}"/><child link="{name}{i}"/><axis xyz="{axis}"/>{limit}</joint>'
                for name, parent, kind_of, axis in (
                    ("rocker", "base", "revolute", "0 1 0"),
                    ("strut", f"rocker{i}", "prismatic", "0 0 1"),
                )
            )
            steer = f'<joint name="steer{i}" type="revolute"><parent link='
            text = text.replace(f'{steer}"base"/>', f'{steer}"strut{i}"/>')
            text = text.replace("</robot>", f"{between}</robot>")
    elif kind == "cambered":
        text = re.sub(r'(<joint name="axle\d.*?<origin) xyz', r'\1 rpy="0.2 0 0" xyz', text)
    else:
        for i in range(4):
            hub = f'<link name="h{i}"/><joint name="hub{i}" type="continuous"><parent link="w{i}"/>'
            hub += f'<child link="h{i}"/><axis xyz="0 1 0"/></joint>'
            text = text.replace("</robot>", f"{hub}</robot>")
    belly = f'<link name="base"><collision>{BELLY}</collision>'
    machine = zs.load_machine(write(tmp_path, text.replace('<link name="base">', belly)))
    assert machine.support is None
    assert "which turns like a wheel" in machine.support_hint


@pytest.mark.filterwarnings("ignore:.*leaves out link 'base'")
@pytest.mark.parametrize(("size", "clearance", "stands"), [(0.2, 0.009, False), (2.0, 0.009, True)])
def test_a_chassis_that_hangs_just_above_the_ground_touches_it_on_large_machines_only(
    tmp_path: Path, size: float, clearance: float, stands: bool
) -> None:
    """Wheels that stand close together, below a chassis that is three times as wide."""
    text = on_wheels('<cylinder radius="0.3" length="0.02"/>')
    for given in ("0.6 ", "0.4 "):
        text = text.replace(given, f"{float(given) * size / 2.0} ")
    z = clearance + 0.05
    box = f'<origin xyz="0 0 {z}"/><geometry><box size="{1.8 * size} {1.2 * size} 0.1"/></geometry>'
    chassis = f'<link name="base"><collision>{box}</collision>'
    path = write(tmp_path, text.replace('<link name="base">', chassis))
    machine = zs.load_machine(path, joints=["turn"])
    half = max(x for x, _ in corners(machine))
    assert half == pytest.approx(0.9 * size if stands else 0.3 * size, abs=1e-6)


@pytest.mark.parametrize("swung", [0.0, 0.9, -0.9])
def test_held_legs_on_joints_without_limits_stand_on_their_feet(
    tmp_path: Path, swung: float
) -> None:
    text = on_wheels('<sphere radius="0.05"/>').replace(
        '<origin rpy="1.5707963267948966 0 0"/>', '<origin xyz="0 0 -0.8"/>'
    )
    angles = dict.fromkeys((f"axle{i}" for i in range(4)), swung)
    for support in (None, ["w0", "w1", "w2", "w3"]):
        machine = zs.load_machine(
            write(tmp_path, text), joints=["turn"], hold=angles, support=support
        )
        x = sorted({round(x, 9) for x, _ in corners(machine)})
        moved = -0.8 * np.sin(swung)
        np.testing.assert_allclose(x, [-0.6 + moved, 0.6 + moved], atol=1e-6)


def test_what_is_no_wheel_carries_nothing_while_it_is_planned(tmp_path: Path) -> None:
    for geometry, kind in (('<box size="0.6 0.3 0.2"/>', "continuous"), ("", "revolute")):
        text = on_wheels(geometry or '<cylinder radius="0.3" length="0.2"/>', kind)
        limit = '<axis xyz="0 1 0"/><limit lower="-1" upper="1" velocity="1" effort="1"/>'
        if kind == "revolute":
            text = text.replace('<axis xyz="0 1 0"/>', limit)
        with pytest.warns(zs.MachineWarning):
            assert zs.load_machine(write(tmp_path, text)).support is None


def test_contact_links_that_are_planned_are_refused_with_what_to_do(tmp_path: Path) -> None:
    path = write(tmp_path, on_wheels('<cylinder radius="0.3" length="0.2"/>'))
    with pytest.raises(zs.MachineError, match=r"'w0' moves with joint 'axle0'.*hold=\{'axle0'"):
        zs.load_machine(path, support=["w0"])


def test_feet_on_held_legs_stand(tmp_path: Path) -> None:
    text = TOY.replace("</robot>", "")
    for i, (x, y) in enumerate(((0.5, 0.4), (0.5, -0.4), (-0.5, 0.4), (-0.5, -0.4))):
        text += (
            f'<link name="leg{i}"><collision><origin xyz="0 0 -0.5"/><geometry>'
            f'<sphere radius="0.05"/></geometry></collision></link>'
            f'<joint name="hip{i}" type="revolute"><parent link="base"/><child link="leg{i}"/>'
            f'<origin xyz="{x} {y} 0"/><axis xyz="0 1 0"/>'
            '<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
        )
    path = write(tmp_path, text + "</robot>")
    bent = zs.load_machine(path, joints=["turn"], hold={f"hip{i}": 0.3 for i in range(4)})
    x = 0.5 - 0.5 * np.sin(0.3), -0.5 - 0.5 * np.sin(0.3)
    np.testing.assert_allclose(
        corners(bent), [[x[1], -0.4], [x[1], 0.4], [x[0], -0.4], [x[0], 0.4]], atol=1e-5
    )
    assert bent.support.height == pytest.approx(-0.5 * np.cos(0.3) - 0.05)


# --- tracks of unequal height, and no contacts at all -------------------------------------------


def tracks(raised: float) -> str:
    boxes = (
        f'0 {y} {z} 0 0 0 <box size="5 0.6 1"/>' for y, z in ((1.3, 0.5), (-1.3, 0.5 + raised))
    )
    return shapes(*boxes)


@pytest.mark.parametrize("raised", [0.0, 0.01, 0.02])
def test_a_track_a_little_higher_than_the_other_counts(tmp_path: Path, raised: float) -> None:
    machine = zs.load_machine(write(tmp_path, tracks(raised)))
    assert corners(machine) == [[-2.5, -1.6], [-2.5, 1.6], [2.5, -1.6], [2.5, 1.6]]


def test_a_track_that_hangs_is_left_out_with_a_word(tmp_path: Path) -> None:
    with pytest.warns(zs.MachineWarning, match=r"leaves out link 'base', 0\.050 m above"):
        machine = zs.load_machine(write(tmp_path, tracks(0.05)))
    assert corners(machine) == [[-2.5, 1.0], [-2.5, 1.6], [2.5, 1.0], [2.5, 1.6]]
    far = zs.load_machine(write(tmp_path, tracks(0.5)))  # not a contact at all
    assert corners(far) == corners(machine)


def test_where_nothing_stands_the_problem_shows_how_to_give_a_polygon(tmp_path: Path) -> None:
    ball = shapes('0 0 1 0 0 0 <sphere radius="1"/>')
    box = '<visual><geometry><box size="2 1 0.5"/></geometry></visual>'
    drawn = TOY.replace(BASE, BASE.replace("</link>", box + "</link>"))
    for text, polygon in ((ball, None), (TOY, None), (drawn, [-1.0, -0.5, -0.25])):
        machine = zs.load_machine(write(tmp_path, text), limits={"acceleration": 1.0})
        with pytest.raises(zs.ProblemError, match="give one as support= of load_m") as refusal:
            zs.Problem(machine, [0.0], [0.5])
        if polygon is None:
            assert re.search(r"\((no link|1 contact points span)", str(refusal.value))
            continue
        code = re.search(r"support=(zs\.SupportPolygon\(.*\))\)", str(refusal.value))[1]
        suggested = eval(code, {"zs": zs})  # what a user would paste
        assert zs.plan(zs.Problem(machine.with_support(suggested), [0.0], [0.5])).success
        assert [*suggested.vertices.min(axis=0), suggested.height] == polygon


def test_a_polygon_of_two_points_is_refused(tmp_path: Path) -> None:
    with pytest.raises(zs.MachineError, match="at least 3 vertices, not 2"):
        zs.load_machine(write(tmp_path, TOY), support=zs.SupportPolygon([[0, 0], [1, 0]]))
    two = shapes(*(f'{x} 0 1 0 0 0 <sphere radius="1"/>' for x in (-1, 1)))
    with pytest.raises(zs.MachineError, match="span no support polygon"):
        zs.load_machine(write(tmp_path, two), support=["base"])


# --- other units --------------------------------------------------------------------------------


def test_sizes_in_other_units_are_warned_of(tmp_path: Path) -> None:
    heavy = TOY.replace('mass value="10"', 'mass value="20000"')
    path = write(tmp_path, heavy)
    machine = zs.load_machine(path)
    millimetres = zs.SupportPolygon([[-2500, -1600], [2500, -1600], [2500, 1600], [-2500, 1600]])
    for call, message in (
        (lambda: zs.load_machine(path, support=millimetres), "2968.* millimetres"),
        (lambda: machine.with_support(millimetres), "2968.* millimetres"),
        (
            lambda: zs.load_machine(write(tmp_path, heavy.replace('upper="1"', 'upper="180"'))),
            "'turn' may turn to 180 rad.*degrees",
        ),
        (
            lambda: zs.load_machine(
                write(tmp_path, heavy.replace('velocity="2"', 'velocity="45"'))
            ),
            "'turn' may turn at 45 rad/s.*degrees",
        ),
    ):
        with pytest.warns(zs.MachineWarning, match=message) as said:
            call()
        assert len(said) == 1
        assert said[0].filename == __file__
    machine.with_support(zs.SupportPolygon(millimetres.vertices / 1000))


def test_legs_that_are_planned_are_warned_of(tmp_path: Path) -> None:
    trunk = '<collision><geometry><box size="1 0.6 0.2"/></geometry></collision></link>'
    text = TOY.replace(BASE, BASE.replace("</link>", trunk)).replace(
        '<child link="arm"/>', '<child link="arm"/><origin xyz="0 0 -0.4"/>'
    )
    path = write(tmp_path, text)
    with pytest.warns(zs.MachineWarning, match=r"'arm' moves and is 0\.30 m below the support"):
        zs.load_machine(path)
    zs.load_machine(path, support=zs.SupportPolygon([[-1, -1], [1, -1], [0, 1]]))


def test_round_meshes_give_polygons_of_few_corners_inside_their_outlines(tmp_path: Path) -> None:
    (tmp_path / "foot.stl").write_bytes(wheel(400))
    machine = zs.load_machine(write(tmp_path, shapes('0 0 0 0 0 0 <mesh filename="foot.stl"/>')))
    distances = np.linalg.norm(machine.support.vertices, axis=1)
    assert len(distances) == 32
    np.testing.assert_allclose(distances, 0.3, rtol=1e-5)
    assert machine.support.offsets.min() > 0.98 * 0.3

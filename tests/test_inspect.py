"""`zmp-sqp inspect` and `zs.inspect`: what a newcomer sees of a machine before planning with it."""

from __future__ import annotations

import json
import sys
import warnings
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import zmp_sqp as zs
import zmp_sqp.cli as cli
from zmp_sqp.mechanics.link_tree import default_tip, link_tree
from zmp_sqp.plots.outlines import hull, link_shapes
from zmp_sqp.show.inspection_tables import INSPECTION_KEYS

BARE = """
<robot name="bare_crane">
  <link name="base">
    <inertial><mass value="900"/><origin xyz="0 0 0.2"/>
      <inertia ixx="90" iyy="90" izz="90" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0.1 0 0.1"/><geometry><box size="2 1.6 0.2"/></geometry></collision>
  </link>
  <link name="mast">
    <inertial><mass value="100"/><origin xyz="0 0 0.5"/>
      <inertia ixx="9" iyy="9" izz="2" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <link name="trolley">
    <inertial><mass value="50"/>
      <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><origin xyz="0.5 0 0" rpy="0 1.5707963 0"/>
      <geometry><cylinder radius="0.1" length="1"/></geometry></visual>
  </link>
  <link name="plate">
    <inertial><mass value="5"/>
      <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="slew" type="continuous">
    <parent link="base"/><child link="mast"/><origin xyz="0.3 0 0.4"/><axis xyz="0 0 1"/>
    <limit velocity="0.5" effort="100"/>
  </joint>
  <joint name="travel" type="prismatic">
    <parent link="mast"/><child link="trolley"/><origin xyz="0.4 0 1"/><axis xyz="1 0 0"/>
    <limit lower="0.2" upper="1.2" velocity="0.3" effort="100"/>
  </joint>
  <joint name="bolts" type="fixed"><parent link="mast"/><child link="plate"/></joint>
</robot>
"""


@pytest.fixture
def bare(tmp_path: Path) -> Path:
    path = tmp_path / "bare_crane.urdf"
    path.write_text(BARE, encoding="utf-8")
    return path


# --- the value ----------------------------------------------------------------------------------


def test_the_tree_holds_every_link_once_below_its_parent(bare: Path) -> None:
    links = link_tree(zs.load_machine(bare))
    assert [(link.name, link.depth, link.parent) for link in links] == [
        ("base", 0, ""),
        ("mast", 1, "base"),
        ("plate", 2, "mast"),
        ("trolley", 2, "mast"),
    ]
    assert [link.mass for link in links] == [900.0, 100.0, 5.0, 50.0]
    assert [link.motion for link in links] == ["root", "turns", "fixed", "slides"]
    assert [link.planned for link in links] == [False, True, False, True]
    assert [link.joint for link in links] == ["", "slew", "bolts", "travel"]


def test_masses_of_the_tree_are_the_machines(bare: Path) -> None:
    for name in zs.shipped_machines():
        machine = zs.load_machine(name)
        assert sum(link.mass for link in link_tree(machine)) == pytest.approx(machine.mass)
    loaded = zs.load_machine(bare).with_payload(zs.Payload(70.0, (0.0, 0.0, 0.0), "trolley"))
    carried = [link for link in link_tree(loaded) if link.motion == "payload"]
    assert [(link.mass, link.parent) for link in carried] == [(70.0, "trolley")]


def test_poses_stay_within_the_limits_and_are_clipped_to_them(bare: Path) -> None:
    found = zs.inspect(zs.load_machine(bare))
    poses = {pose.name: pose.q.tolist() for pose in found.poses}
    assert poses == {"zero": [0.0, 0.2], "middle": [0.0, 0.7]}
    assert (found.slew, found.tip) == ("slew", "trolley")
    assert found.missing == {"acceleration": ("slew", "travel")}


def test_centre_of_mass_margin_and_tipping_load_by_hand(bare: Path) -> None:
    """Masses and levers of BARE, in the pose 'middle': trolley at 0.3 + 0.4 + 0.7 m."""
    masses, x = np.array([900.0, 100.0, 50.0, 5.0]), np.array([0.0, 0.3, 1.4, 0.3])
    z = np.array([0.2, 0.9, 1.4, 0.4])
    pose = zs.inspect(zs.load_machine(bare)).poses[1]
    com = masses @ np.column_stack([x, 0.0 * x, z]) / masses.sum()
    np.testing.assert_allclose(pose.com, com, atol=1e-12)
    np.testing.assert_allclose(pose.zmp, com[:2], atol=1e-12)
    # the foot reaches from -0.9 to 1.1 m along x and from -0.8 to 0.8 m along y
    assert pose.margin == pytest.approx(0.8)
    assert pose.edge in ("left", "right")
    front = masses.sum() * (1.1 - com[0]) / (1.4 - 1.1)
    assert pose.tipping.mass == pytest.approx(front)
    # turned by 90 degrees the trolley is 1.1 m to the side, the parts at x = 0.3 stay on the axis
    side = (masses.sum() * 0.8 - 50.0 * 1.1) / (1.1 - 0.8)
    assert pose.worst.mass < min(front, side)
    assert abs(np.degrees(pose.worst.coordinate)) == pytest.approx(90.0, abs=10.0)


def test_the_zmp_at_rest_lies_below_the_centre_of_mass_along_gravity(bare: Path) -> None:
    slope = zs.Slope(roll=0.2, pitch=-0.1)
    for pose in zs.inspect(zs.load_machine(bare), slope).poses:
        down = slope.gravity()
        foot = pose.com - pose.com[2] / down[2] * down
        np.testing.assert_allclose(pose.zmp, foot[:2], atol=1e-12)


def test_the_tip_is_the_outermost_link_and_else_its_centre_of_mass() -> None:
    assert default_tip(zs.load_machine("feller_buncher")) == "head"
    crane = zs.inspect(zs.load_machine("slewing_crane"))
    assert crane.tip == "jib"
    np.testing.assert_allclose(crane.tip_offset, [2.0, 0.0, 0.0], atol=1e-9)


def with_more(more: str) -> str:
    return BARE.replace("</robot>", f"{more}</robot>")


def test_the_slew_turns_the_tip_and_nothing_follows_it(tmp_path: Path) -> None:
    mast = """<link name="lamp"><inertial><mass value="2"/>
        <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="swivel" type="continuous"><parent link="base"/><child link="lamp"/>
        <axis xyz="0 0 1"/>{mimic}<limit velocity="0.5" effort="1"/></joint>"""
    path = tmp_path / "lamp.urdf"
    path.write_text(with_more(mast.format(mimic="")), encoding="utf-8")
    free = zs.inspect(zs.load_machine(path))
    assert (free.slew, free.tip) == ("slew", "trolley")  # the swivel turns the lamp alone
    assert zs.inspect(zs.load_machine(path), tip="lamp").slew == "swivel"
    path.write_text(with_more(mast.format(mimic='<mimic joint="slew"/>')), encoding="utf-8")
    coupled = zs.inspect(zs.load_machine(path))
    assert coupled.slew == ""
    assert all(pose.worst is None for pose in coupled.poses)
    [lamp] = [link for link in coupled.links if link.name == "lamp"]
    assert (lamp.planned, lamp.motion) == (False, "turns")


def test_poses_of_the_user_are_checked(bare: Path) -> None:
    machine = zs.load_machine(bare)
    found = zs.inspect(machine, poses={"parked": [1.0, 0.3]})
    assert [pose.name for pose in found.poses] == ["parked"]
    for poses, words in (({"a": [1.0]}, "pose 'a'"), ({"a": [1.0, np.nan]}, "'travel'")):
        with pytest.raises(zs.MachineError, match=words):
            zs.inspect(machine, poses=poses)
    with pytest.raises(zs.MachineError, match="no frame 'hook'"):
        zs.inspect(machine, tip="hook")
    with pytest.raises(zs.MachineError, match="must be a Machine"):
        zs.inspect("feller_buncher")


def test_printing_a_machine_shows_mass_units_limits_and_polygon(bare: Path) -> None:
    text = str(zs.load_machine(bare))
    head, support, columns, slew, travel = text.splitlines()
    assert head == "bare_crane: 1055 kg, 2 planned joints"
    assert "2 m along x (forward), 1.6 m along y (left), at z = 0 m" in support
    assert columns.split() == [
        *("joint", "unit", "lower", "upper", "velocity", "acceleration", "effort"),
    ]
    assert slew.split() == ["slew", "rad", "none", "none", "0.5", "missing", "100"]
    assert travel.split() == ["travel", "m", "0.2", "1.2", "0.3", "missing", "100"]
    held = zs.load_machine(bare, hold={"slew": -0.0})
    assert str(held).splitlines()[-1] == "held: slew at 0"
    loaded = zs.load_machine("feller_buncher").with_payload(zs.Payload(4e3, (0, 0, 3), "head"))
    assert str(loaded).startswith(
        "feller_buncher: 27650 kg, of which 4000 kg payload, 5 planned joints\n"
    )


# --- the command --------------------------------------------------------------------------------


def test_the_command_prints_what_was_understood(
    bare: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["inspect", str(bare)]) == 0
    printed = capsys.readouterr().out
    for words in (
        "1055 kg",
        "    trolley",
        "travel (slides, planned)",
        "missing: acceleration limit of all 2 planned joints",
        "zmp-sqp init",
        "x (forward)",
        "tipping load",
        "a turn is of slew",
    ):
        assert words in printed
    tables = [line for line in printed.splitlines() if not line.startswith(("bare", "support"))]
    assert "\x1b" not in printed
    assert max(len(line) for line in tables if "zmp-sqp" not in line) <= 80


def test_json_holds_every_key_that_help_lists(
    bare: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["inspect", str(bare), "--json", "-"]) == 0
    captured = capsys.readouterr()
    result = json.loads(captured.out)
    listed = [
        key.strip()
        for line in INSPECTION_KEYS.splitlines()
        if line.startswith("  ") and line[2] != " "
        for key in line[2:19].split(",")
    ]
    assert set(result) == set(listed)
    assert result["mass"] == pytest.approx(1055.0)
    assert result["joints"]["slew"]["position_lower"] is None
    assert result["missing"] == {"acceleration": ["slew", "travel"]}
    assert result["support"]["edges"] == ["right", "front", "left", "rear"]
    assert set(result["support"]) == {"vertices", "height", "edges", "source"}
    assert "no planned joint moves" in result["support"]["source"]
    assert result["poses"]["middle"]["tipping"]["edge"] == "front"
    assert "bare_crane" in captured.err


def test_options_change_ground_load_point_and_machine(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--roll", "-20", "--payload", "4000", "--payload-frame", "head"]
    arguments += ["--payload-com", "0", "0", "3.3"]
    assert cli.main(["inspect", "feller_buncher", *arguments, "--json", "-"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["mass"] == pytest.approx(27650.0)
    assert result["tip_offset"] == [0.0, 0.0, 3.3]
    assert result["poses"]["zero"]["edge"] == "left"
    assert result["poses"]["zero"]["margin"] < 0.5
    tracks = ["--contact-links", "left_track", "right_track"]
    assert cli.main(["inspect", "feller_buncher", "--tip", "stick", *tracks, "--json", "-"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["tip"] == "stick"
    assert "left_track, right_track" in result["support"]["source"]


def test_warnings_of_loading_are_listed(
    bare: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    machine = zs.load_machine(bare)

    def load(_: object) -> zs.Machine:
        warnings.warn("link 'mast' is heavier than it looks", stacklevel=1)
        return machine

    monkeypatch.setattr("zmp_sqp.commands.inspect.machine_of", load)
    assert cli.main(["inspect", str(bare)]) == 0
    assert "warning: link 'mast' is heavier" in capsys.readouterr().out


def test_a_machine_without_support_is_described_all_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "floating.urdf"
    path.write_text(BARE.replace("<collision>", "<!--").replace("</collision>", "-->"))
    assert cli.main(["inspect", str(path), "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "support polygon: none" in printed
    assert json.loads((tmp_path / "inspect.json").read_text())["support"] is None
    assert (tmp_path / "inspect.png").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nobody"], "there is no machine 'nobody'"),
        (["feller_buncher", "--tip", "hook"], "'hook'"),
        (["feller_buncher", "--pose", "sitting"], "poses are zero, middle"),
        (["feller_buncher", "--roll", "100"], "roll"),
        (["feller_buncher", "--limits", "/no/such.yaml"], "/no/such.yaml"),
        (["feller_buncher", "--out", "/dev/null/folder"], "/dev/null"),
    ],
)
def test_bad_input_is_one_sentence(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["inspect", *arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith("zmp-sqp: error: ")
    assert words in error
    assert error.count("\n") == 1


# --- the picture --------------------------------------------------------------------------------


def test_shapes_are_hulls_of_their_corners(bare: Path) -> None:
    shapes = link_shapes(bare)
    assert set(shapes) == {"base", "trolley"}
    [box], [rod] = shapes["base"], shapes["trolley"]
    np.testing.assert_allclose(box.min(axis=0), [-0.9, -0.8, 0.0], atol=1e-12)
    np.testing.assert_allclose(box.max(axis=0), [1.1, 0.8, 0.2], atol=1e-12)
    np.testing.assert_allclose(rod.min(axis=0), [0.0, -0.1, -0.1], atol=1e-6)
    np.testing.assert_allclose(rod.max(axis=0), [1.0, 0.1, 0.1], atol=1e-6)
    corners = hull(np.array([[0.0, 0.0], [1.0, 0.0], [0.5, 0.2], [1.0, 1.0], [0.0, 1.0]]))
    assert len(corners) == 4
    assert len(hull(np.array([[0.0, 0.0], [1.0, 1.0], [0.5, 0.5]]))) == 2
    assert len(hull(np.zeros((3, 2)))) == 1


STL = """solid wedge
facet normal 0 0 1
outer loop
vertex 0 0 0
vertex 2 0 0
vertex 0 1 0
endloop
endfacet
facet normal 0 0 1
outer loop
vertex 0 0 0
vertex 2 0 0
vertex 0 0 3
endloop
endfacet
endsolid wedge
"""


def test_meshes_are_drawn_by_their_hull_unless_they_lie_elsewhere(tmp_path: Path) -> None:
    folder = tmp_path / "machine"
    folder.mkdir()
    for place in (folder, tmp_path):
        (place / "wedge.stl").write_text(STL)
    mesh = '<visual><geometry><mesh filename="{}" scale="1 1 0.5"/></geometry></visual></link>'
    for name, drawn in (("wedge.stl", True), ("../wedge.stl", False), ("none.stl", False)):
        text = BARE.replace("</link>", mesh.format(name), 1)
        (folder / "meshed.urdf").write_text(text, encoding="utf-8")
        shapes = link_shapes(folder / "meshed.urdf")
        # without a mesh that can be drawn, the collision box is
        [points] = shapes["base"]
        np.testing.assert_allclose(
            points.max(axis=0), [2.0, 1.0, 1.5] if drawn else [1.1, 0.8, 0.2], atol=1e-6
        )


def test_the_picture_shows_side_and_top_in_the_root_frame(
    bare: Path,
) -> None:
    pytest.importorskip("matplotlib")
    found = zs.inspect(zs.load_machine(bare))
    figure = zs.plots.machine(found, bare)
    side, top, other_side, other_top = figure.axes
    for axes in (side, other_side):
        assert (axes.get_xlabel(), axes.get_ylabel()) == ("x forward [m]", "z up [m]")
    for axes in (top, other_top):
        assert (axes.get_xlabel(), axes.get_ylabel()) == ("x forward [m]", "y left [m]")
    assert "pose 'middle'" in other_side.get_title()
    assert "stands" in other_side.get_title()
    by_label = {line.get_label(): line.get_xydata()[0] for line in other_side.get_lines()}
    pose = found.poses[1]
    np.testing.assert_allclose(by_label["centre of mass"], pose.com[[0, 2]])
    np.testing.assert_allclose(by_label["ZMP at rest"], [pose.zmp[0], 0.0])
    by_label = {line.get_label(): line.get_xydata()[0] for line in other_top.get_lines()}
    np.testing.assert_allclose(by_label["centre of mass"], pose.com[[0, 1]])
    np.testing.assert_allclose(by_label["load point: trolley"], pose.tip[[0, 1]])
    # everything is within the axes, the end of the rod at 2.4 m too, and not lost in them
    (left, right), (low, high) = other_side.get_xlim(), other_side.get_ylim()
    assert left < -0.9
    assert 2.4 < right < 3.0
    assert low < 0.0
    assert high > 1.5
    assert right - left < 5.0


def test_a_pose_that_tips_over_is_called_so_in_table_and_picture() -> None:
    pytest.importorskip("matplotlib")
    feet = zs.SupportPolygon([[-1.0, -1.0], [0.5, -1.0], [0.5, 1.0], [-1.0, 1.0]])
    found = zs.inspect(zs.load_machine("slewing_crane", support=feet))
    title = zs.plots.machine(found, poses=["zero"]).axes[0].get_title()
    assert "TIPS OVER: ZMP 0.500 m outside the front edge" in title
    assert found.poses[0].tipping.mass == 0.0


def test_without_matplotlib_the_tables_are_there(
    bare: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in [name for name in sys.modules if name.partition(".")[0] == "matplotlib"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert cli.main(["inspect", str(bare), "--out", str(tmp_path / "out")]) == 0
    assert "zmp-sqp[plots]" in capsys.readouterr().out
    assert (tmp_path / "out" / "inspect.json").exists()


def test_frames_of_the_tree_are_those_of_pinocchio(bare: Path) -> None:
    machine = zs.load_machine(bare)
    for link in link_tree(machine):
        frame = machine.model.frames[link.frame]
        assert (frame.name, frame.type) == (link.name, pin.FrameType.BODY)

"""xacro files are expanded, in a process that can read nothing but the allowed folders."""

from __future__ import annotations

from pathlib import Path

import pytest

import zmp_sqp as zs
from zmp_sqp.mechanics.urdf import xacro_files

OPEN = '<robot name="crane" xmlns:xacro="http://www.ros.org/wiki/xacro">'
INERTIA = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
MACHINE = (
    OPEN
    + '<xacro:arg name="mass" default="${2 * 5}"/><xacro:include filename="{include}"/>'
    + f'<link name="base"><inertial><mass value="$(arg mass)"/>{INERTIA}</inertial></link>'
    + '<xacro:arm length="${pi / 2}"/></robot>'
)
MACRO = (
    OPEN
    + '<xacro:macro name="arm" params="length"><link name="arm"><inertial>'
    + f'<mass value="2"/>{INERTIA}</inertial></link><joint name="turn" type="revolute">'
    + '<parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>'
    + '<limit lower="0" upper="${length}" velocity="1" effort="1"/></joint></xacro:macro></robot>'
)


def write(folder: Path, text: str, name: str = "crane.urdf.xacro") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("include", "place"),
    [("arm.xacro", "robot"), ("parts/arm.xacro", "robot/parts"), ("$(find kit)/arm.xacro", "kit")],
)
@pytest.mark.parametrize("name", ["crane.urdf.xacro", "crane.urdf"])
def test_xacro_is_expanded(tmp_path: Path, include: str, place: str, name: str) -> None:
    pytest.importorskip("xacro")
    write(tmp_path / place, MACRO, "arm.xacro")
    path = write(tmp_path / "robot", MACHINE.replace("{include}", include), name)
    machine = zs.load_machine(path, package_dirs=[tmp_path])
    assert machine.mass == pytest.approx(12.0)
    assert machine.limits.position_upper[0] == pytest.approx(1.5707963267948966)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ('<xacro:include filename="$(find kit)/arm.xacro"/>', "no package 'kit' in package_dirs"),
        ('<xacro:include filename="../secret.xacro"/>', "outside the URDF's folder"),
        ('<xacro:include filename="none.xacro"/>', "none.xacro"),
        ("<link name=\"${xacro.load_yaml('../secret.yaml')}\"/>", "outside the URDF's folder"),
        ("<link name=\"${open('crane')}\"/>", "open"),
        ('<link name="${[].__class__}"/>', "__class__"),
        ('<link name="$(env HOME)"/>', "HOME"),
        ("<xacro:arm/>", "unknown macro name: xacro:arm"),
        ('<xacro:macro name="a" params=""><xacro:a/></xacro:macro><xacro:a/>', "recursion|memory"),
        ('<link name="${[0] * 10**10}"/>', "when evaluating"),
    ],
)
def test_xacro_that_cannot_be_expanded_is_refused_in_a_sentence(
    tmp_path: Path, body: str, message: str
) -> None:
    pytest.importorskip("xacro")
    for name in ("secret.xacro", "secret.yaml"):
        write(tmp_path, OPEN + "</robot>", name)
    path = write(tmp_path / "robot", f"{OPEN}{body}</robot>")
    with pytest.raises(zs.MachineError, match=message) as refusal:
        zs.load_machine(path)
    assert str(path) in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_xacro_without_end_is_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("xacro")
    monkeypatch.setattr(xacro_files, "PATIENCE", 1.0)
    path = write(tmp_path, f'{OPEN}<link name="${{9**9**9}}"/></robot>')
    with pytest.raises(zs.MachineError, match="xacro was stopped"):
        zs.load_machine(path)


def test_without_the_package_the_sentence_says_how(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(xacro_files, "find_spec", lambda name: None)
    path = write(tmp_path, f"{OPEN}<xacro:arm/></robot>")
    with pytest.raises(zs.MissingExtra, match=r"pip install zmp-sqp\[xacro\].*xacro crane"):
        zs.load_machine(path)


def test_a_namespace_alone_needs_no_xacro(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(xacro_files, "find_spec", lambda name: None)
    path = write(tmp_path, f'{OPEN}<link name="base"/></robot>', "crane.urdf")
    assert zs.load_machine(path).size == 0

"""Expands xacro, the macro language in which many URDFs are written."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from zmp_sqp.errors import MachineError, MissingExtra
from zmp_sqp.mechanics.urdf.xml_reader import parse_xml

__all__ = ["expanded"]

CHILD = Path(__file__).with_name("xacro_child.py")
PATIENCE = 60.0  # [s] after which the process is stopped; its own limit is in processor time
# environment variables that Python and its packages need; others are not for a URDF to read
KEPT = ("PATH", "PYTHONPATH", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "LANG", "SYSTEMROOT")


def expanded(content: bytes, path: Path, package_dirs: Sequence[Path]) -> bytes:
    """URDF of a file that may be written in xacro; other files are returned as they are.

    Arguments of the file have their defaults. `$(find package)` and files to be included are looked
    for in the folder of the file and in `package_dirs` only; nothing else can be opened.

    Args:
        content: Content of the file.
        path: Path of the file.
        package_dirs: Folders that hold packages.

    Raises:
        MachineError: xacro cannot expand the file; the message has the cause, but not the path.
        MissingExtra: The package xacro is not installed.
    """
    if path.suffix != ".xacro" and b"xacro" not in content:
        return content
    tags = {element.tag for element in parse_xml(content, "robot", "a URDF").iter()}
    if path.suffix != ".xacro" and not any("xacro" in tag for tag in tags):
        return content
    if find_spec("xacro") is None:
        raise MissingExtra(
            f"{path} is written in xacro: pip install zmp-sqp[xacro], "
            f"or expand it first (xacro {path.name} > machine.urdf)"
        )
    import subprocess  # only needed here

    command = [sys.executable, "-P", "-B", str(CHILD), str(path), *map(str, package_dirs)]
    kept = {key: os.environ[key] for key in KEPT if key in os.environ}
    try:
        done = subprocess.run(command, env=kept, capture_output=True, timeout=PATIENCE, check=False)
    except subprocess.TimeoutExpired:
        raise MachineError(f"xacro was stopped after {PATIENCE:.0f} s without a result") from None
    except OSError as cause:
        raise MachineError(f"xacro could not be run: {cause}") from None
    if done.returncode == 0:
        return done.stdout
    if done.returncode < 0:
        raise MachineError("xacro was stopped: this file takes too long to expand")
    said = " ".join(done.stderr.decode(errors="replace").split())
    raise MachineError(f"xacro cannot expand this file: {said or 'no cause given'}")

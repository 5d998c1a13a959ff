"""Finds the files that describe a machine: shipped ones by name, others by path."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from zmp_sqp.arrays import shortened
from zmp_sqp.errors import MachineError

__all__ = ["find_machine", "package_folders", "shipped_machines"]


def shipped_machines() -> dict[str, Path]:
    """Machines that come with this library: path of the URDF by name of the machine."""
    package = Path(__file__).resolve().parents[2]
    folders = (package / "urdf", package.parent / "urdf")  # in a wheel; in a source checkout
    folder = next((folder for folder in folders if folder.is_dir()), folders[0])
    return {path.stem: path for path in sorted(folder.glob("*.urdf"))}


def find_machine(source: Any) -> Path:
    """Path of the URDF of a machine.

    Args:
        source: Name of a shipped machine, or path of a URDF.

    Raises:
        MachineError: There is no such machine or file.
    """
    if not isinstance(source, str | os.PathLike) or not os.fspath(source):
        raise MachineError(
            f"source must be the name of a machine or the path of a URDF, not {shortened(source)}"
        )
    shipped = shipped_machines()
    if isinstance(source, str) and source in shipped:
        return shipped[source]
    try:
        path = Path(source).expanduser()
        if path.is_file():
            return path
        if path.is_dir():
            raise MachineError(f"{path} is a folder, not a URDF")
    # a NUL byte, a name that is too long, no home folder, bytes instead of text
    except (ValueError, OSError, RuntimeError, TypeError) as cause:
        raise MachineError(f"{source!r} is not a path that can be read: {cause}") from None
    if isinstance(source, str) and path.name == source and not path.suffix:
        raise MachineError(
            f"there is no machine {source!r}; machines are {', '.join(shipped)}, "
            "or give the path of a URDF"
        )
    raise MachineError(f"there is no file {path}")


def package_folders(given: Any) -> tuple[Path, ...]:
    """Folders from the `package_dirs` argument of `load_machine`.

    Raises:
        MachineError: Not paths, or a folder that is not there.
    """
    if given is None:
        return ()
    if isinstance(given, str | os.PathLike):
        given = [given]
    if not isinstance(given, Sequence) or not all(
        isinstance(folder, str | os.PathLike) for folder in given
    ):
        raise MachineError(f"package_dirs must be paths of folders, not {shortened(given)}")
    folders = []
    for folder in given:
        try:
            path = Path(folder).expanduser()
            there = path.is_dir()
        except (ValueError, OSError, RuntimeError, TypeError) as cause:
            raise MachineError(f"package_dirs: {folder!r} is no path: {cause}") from None
        if not there:
            raise MachineError(f"package_dirs: there is no folder {path}")
        folders.append(path)
    return tuple(folders)

"""Expands one xacro file; run as a script by `xacro_files` in a process of its own.

xacro evaluates Python expressions. This process therefore can neither write files nor start other
processes nor use the network, reads files of the given folders only, and has limited time and
memory. The expanded file goes to the standard output, the cause of a failure to the standard error.

Usage: python xacro_child.py FILE PACKAGE_FOLDER...
"""

from __future__ import annotations

import errno
import os
import resource
import sys
from pathlib import Path

SECONDS, BYTES = 10, 1 << 30  # of processor time and of memory
REFUSED = ("socket.", "subprocess.", "os.", "shutil.", "ctypes.", "ftplib.", "urllib.", "http.")
LOOKED_AT = ("os.listdir", "os.scandir")  # harmless, and used by glob and the import system


def main(file: str, packages: list[str]) -> int:
    """Expand a file; returns the exit code."""
    import xacro
    from xacro import substitution_args

    def find(name: str) -> str:
        for folder in map(Path, packages):
            for package in (folder / name, folder):
                if package.name == name and package.is_dir():
                    return str(package)
        raise substitution_args.SubstitutionException(
            f"there is no package {name!r} in package_dirs ({', '.join(packages) or 'empty'})"
        )

    substitution_args._eval_find = substitution_args._eval_dict["find"] = find
    allowed = [os.path.realpath(folder) for folder in (os.path.dirname(file), *packages)]
    own = [os.path.realpath(folder) for folder in (*sys.path, sys.prefix, sys.base_prefix)]

    def guard(event: str, arguments: tuple[object, ...]) -> None:
        if event == "open" and isinstance(arguments[0], (str, bytes)):
            flags, place = arguments[2], os.path.realpath(os.fsdecode(arguments[0]))
            writes = isinstance(flags, int) and flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
            code = place.endswith((".py", ".pyc", ".so")) and _within(place, own)
            if writes or not (code or _within(place, allowed)):
                cause = "outside the URDF's folder and package_dirs, or to be written"
                raise PermissionError(errno.EACCES, cause, place)
        elif event.startswith(REFUSED) and event not in LOOKED_AT:
            raise PermissionError(errno.EACCES, "refused", event)

    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
    resource.setrlimit(resource.RLIMIT_AS, (BYTES, BYTES))
    sys.addaudithook(guard)
    try:
        text = xacro.process_file(file).toxml(encoding="utf-8")
    except MemoryError:
        sys.stderr.write("it needs more than 1 GB of memory")
        return 1
    except Exception as fault:  # user's expressions raise exceptions of any type
        sys.stderr.write(" ".join(str(fault).split()) or repr(fault))
        return 1
    sys.stdout.buffer.write(text)
    return 0


def _within(place: str, folders: list[str]) -> bool:
    """Whether a resolved path lies in one of the folders."""
    return any(os.path.commonpath([place, folder]) == folder for folder in folders)


if __name__ == "__main__":
    sys.exit(main(os.path.abspath(sys.argv[1]), sys.argv[2:]))

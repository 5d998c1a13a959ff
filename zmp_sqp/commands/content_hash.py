"""Hash of a scenario and all files that it names, which tells whether a result is still its own."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from zmp_sqp.errors import ZmpSqpError
from zmp_sqp.scenario import read_content

__all__ = ["content_hash"]

LONGEST_PATH = 200  # characters of a text that may be the name of a file


def content_hash(given: str, options: str) -> str:
    """Hash of what the result of a scenario depends on: its files, and options of planning.

    Args:
        given: Scenario file, or name of a shipped one.
        options: Options in words.
    """
    found = hashlib.sha256(f"{given if not Path(given).is_file() else ''} {options}".encode())
    for path in _files(given):
        try:
            found.update(path.read_bytes())
        except OSError as cause:
            found.update(str(cause).encode())
    return found.hexdigest()[:16]


def _files(given: str) -> list[Path]:
    """The file of a scenario, files that it names, and those that lie beside its URDF."""
    try:
        content, path = read_content(given)
    except ZmpSqpError:
        return [Path(given)] if Path(given).is_file() else []
    named = [path.parent / text for text in _texts(content)]
    files = [file for file in named if file.is_file()]
    beside = [other for file in files for other in sorted(file.parent.glob(f"{file.stem}.*"))]
    return list(dict.fromkeys([path, *files, *beside]))


def _texts(content: Any) -> Iterator[str]:
    """All texts in tables and lists of a scenario that may be names of files."""
    if isinstance(content, str) and len(content) < LONGEST_PATH and "\0" not in content:
        yield content
    elif isinstance(content, Mapping | list):
        for part in content.values() if isinstance(content, Mapping) else content:
            yield from _texts(part)

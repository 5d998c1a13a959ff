"""Rows of results that survive a killed run: JSON lines, and Parquet made of them."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import IO, Any

from zmp_sqp.errors import MissingExtra, ProblemError

__all__ = ["Journal"]

LINES, PARQUET = ".jsonl", ".parquet"
PART = ".part.jsonl"  # what a Parquet file grows from: Parquet cannot be appended to


class Journal:
    """File of rows to which one row after the other is added, each written at once.

    JSON lines are written as they come. For Parquet, lines are written beside it and turned into
    the file at the end.
    """

    def __init__(self, path: Path, *, resume: bool) -> None:
        """Open a file.

        Args:
            path: File that ends in .jsonl or .parquet.
            resume: Whether to keep the rows that it has; else there must be no such file.

        Raises:
            ProblemError: Another ending, a file that is there already, or one that is damaged.
            MissingExtra: Parquet without the package pyarrow.
        """
        if path.suffix not in (LINES, PARQUET):
            raise ProblemError(f"{path}: results are written to .jsonl or .parquet files")
        if path.suffix == PARQUET:
            _parquet()
        self.path = path
        self._lines = path if path.suffix == LINES else path.with_name(f"{path.name}{PART}")
        there = [file for file in (path, self._lines) if file.exists()]
        if there and not resume:
            raise ProblemError(
                f"{there[0]} is there already: resume it (--resume), or give another file"
            )
        self.rows = list(self._found()) if there else []
        self._file: IO[str] | None = None

    def __enter__(self) -> Journal:
        """Open the lines for writing, without a last one that was not finished."""
        self._lines.parent.mkdir(parents=True, exist_ok=True)
        text = "".join(f"{json.dumps(row)}\n" for row in self.rows)
        self._lines.write_text(text, encoding="utf-8")
        self._file = self._lines.open("a", encoding="utf-8")
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the lines; make the Parquet file unless the run was cut short."""
        if self._file is not None:
            self._file.close()
        if kind is None and self.path.suffix == PARQUET:
            self._to_parquet()

    def add(self, row: Mapping[str, Any]) -> None:
        """Write a row; numbers that are not finite become null."""
        if self._file is None:
            raise ValueError("a journal takes rows inside its `with` block only")
        clean = {
            key: None if isinstance(value, float) and not math.isfinite(value) else value
            for key, value in row.items()
        }
        self.rows.append(clean)
        self._file.write(f"{json.dumps(clean)}\n")
        self._file.flush()

    def _found(self) -> Iterator[dict[str, Any]]:
        """Rows of an earlier run."""
        if not self._lines.exists():
            yield from _parquet().read_table(self.path).to_pylist()
            return
        lines = self._lines.read_bytes().splitlines(keepends=True)
        for number, line in enumerate(lines, start=1):
            try:
                row = json.loads(line.decode("utf-8"))
            except ValueError:
                if number == len(lines):  # a killed run may leave half a line
                    return
                raise ProblemError(f"{self._lines}: line {number} is no JSON") from None
            if not isinstance(row, dict):
                raise ProblemError(f"{self._lines}: line {number} is no row of results")
            yield row

    def _to_parquet(self) -> None:
        """Turn the lines into the Parquet file, and remove them."""
        import pyarrow

        # all rows have all columns; a column without any value is one of numbers
        names = dict.fromkeys(name for row in self.rows for name in row)
        table = pyarrow.Table.from_pylist([{**dict.fromkeys(names), **row} for row in self.rows])
        kinds = [
            pyarrow.field(kind.name, pyarrow.float64())
            if pyarrow.types.is_null(kind.type)
            else kind
            for kind in table.schema
        ]
        table = table.cast(pyarrow.schema(kinds))
        unfinished = self.path.with_name(f"{self.path.name}.part")
        _parquet().write_table(table, unfinished)
        unfinished.replace(self.path)
        self._lines.unlink()


def _parquet() -> Any:
    try:
        import pyarrow.parquet
    except ModuleNotFoundError:
        raise MissingExtra(
            "Parquet files need pyarrow, which `pip install zmp-sqp[parquet]` brings; "
            "or write a .jsonl file"
        ) from None
    return pyarrow.parquet

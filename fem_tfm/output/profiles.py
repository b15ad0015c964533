# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tables for spreadsheets and scripts: profiles, and one row a step while a run works."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from fem_tfm.output.files import replaced, write_text

# numbers are written with 12 digits
ROUNDING = 1e-11


def header(names: Iterable[str], units: Mapping[str, str]) -> list[str]:
    """Column heads "name [unit]", or the bare name where no unit is known."""
    return [f"{name} [{units[name]}]" if name in units else name for name in names]


def cell(value: Any) -> Any:
    """Numbers with 12 significant digits, everything else as it is."""
    return f"{value:.12g}" if hasattr(value, "__float__") else value


def write_profiles(
    path: str | Path, columns: Mapping[str, Sequence[Any] | np.ndarray], units: Mapping[str, str]
) -> None:
    """Write columns of equal length as CSV with the heads "name [unit]", in one atomic step.

    Raises ValueError if the lengths differ.
    """
    lengths = {name: len(column) for name, column in columns.items()}
    if len(set(lengths.values())) > 1:
        raise ValueError(f"columns of different lengths: {lengths}")
    with replaced(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header(columns, units))
        for row in zip(*columns.values(), strict=True):
            writer.writerow(map(cell, row))


def drop_after(path: str | Path, column: str, limit: float) -> None:
    """Take out the rows of a CSV file, if there is one, whose `column` lies above `limit`."""
    path = Path(path)
    if not path.exists():
        return
    lines = [line for line in path.read_text(encoding="utf-8").splitlines(keepends=True)]
    rows = list(csv.reader(lines))
    names = [name.partition(" [")[0] for name in rows[0]] if rows else []
    if column not in names:
        return
    place, limit = names.index(column), limit + ROUNDING * abs(limit)
    # a row that a kill cut short has no line end
    kept = [
        line
        for line, row in zip(lines[1:], rows[1:], strict=True)
        if line.endswith("\n") and float(row[place]) <= limit
    ]
    write_text(path, "".join([lines[0], *kept]))


class Monitor:
    """monitor.csv: one row a step, on the disk as soon as it is written.

    Parameters
    ----------
    path : the file
    columns : unit of each column ("" for none), in order
    append : go on with the file of an earlier part of the run, if there is one

    Raises
    ------
    ValueError
        for a value without a column, or when an older file has other columns.
    """

    def __init__(self, path: str | Path, columns: Mapping[str, str], append: bool = False) -> None:
        self.path = Path(path)
        self.columns = tuple(columns)
        head = header(columns, {name: unit for name, unit in columns.items() if unit})
        self.path.parent.mkdir(parents=True, exist_ok=True)
        resumed = append and self.path.exists() and self._resume(head)
        self._file = self.path.open("a" if resumed else "w", newline="", encoding="utf-8")
        self._writer = csv.writer(self._file, lineterminator="\n")
        if not resumed:
            self._put(head)

    def write(self, values: Mapping[str, Any]) -> None:
        """Add one row; a column without a value stays empty."""
        unknown = [name for name in values if name not in self.columns]
        if unknown:
            raise ValueError(f"monitor has no column {', '.join(unknown)}")
        self._put([cell(values[name]) if name in values else "" for name in self.columns])

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _put(self, row: Iterable[Any]) -> None:
        self._writer.writerow(row)
        self._file.flush()

    def _resume(self, head: list[str]) -> bool:
        """Drop a row that a kill cut short; False if the older file holds nothing at all."""
        lines = self.path.read_text(encoding="utf-8").splitlines(keepends=True)
        whole = [line for line in lines if line.endswith("\n")]
        if whole and next(csv.reader(whole[:1])) != head:
            raise ValueError(f"{self.path} has other columns than this run")
        with replaced(self.path) as temporary:
            temporary.write_text("".join(whole), encoding="utf-8")
        return bool(whole)

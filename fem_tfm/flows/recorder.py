# SPDX-License-Identifier: LGPL-3.0-or-later
"""The life of a run, whatever it solves: its directory, its log, how it ends and what it leaves."""

from __future__ import annotations

import time
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from mpi4py import MPI

from fem_tfm.case import QUANTITIES, Case
from fem_tfm.errors import InputError
from fem_tfm.output import checkpoint
from fem_tfm.output.files import on_root, write_text
from fem_tfm.output.profiles import Monitor
from fem_tfm.output.result import (
    Quantity,
    Reference,
    Result,
    cpu_seconds,
    peak_memory_mb,
    versions,
)

if TYPE_CHECKING:
    from fem_tfm.progress import Progress

# keys that a resumed run may change
FREE_TO_CHANGE = (
    "title",
    "inferred",
    "reference",
    "output",
    "numerics.max_steps",
    "numerics.end_time",
)


class Recorder:
    """What a run tells and keeps while it works: progress, run.log, monitor.csv.

    Parameters
    ----------
    case : what is solved
    out : directory of the results, or None to keep nothing
    progress : where to tell
    resume : go on with an older monitor.csv
    columns : of monitor.csv, with their units

    `section` is what is solved, with its `mesh` and number `dofs` of unknowns; None before there is
    a state.
    """

    section: Any = None

    def __init__(
        self,
        case: Case,
        out: Path | None,
        progress: Progress,
        resume: bool,
        columns: Mapping[str, str],
    ) -> None:
        self.case = case
        self.out = out
        self.progress = progress
        self.resume = resume
        self.comm = MPI.COMM_WORLD
        self.seconds = {"setup": 0.0, "compile": 0.0, "solve": 0.0, "output": 0.0}
        self.monitor: Monitor | None = None
        self._file: TextIO | None = None
        self._began = self._lap = time.perf_counter()
        if out is not None and self.comm.rank == 0:
            self.monitor = Monitor(out / "monitor.csv", columns, append=resume)
            self._file = (out / "run.log").open("a", encoding="utf-8")
        self.log(f"fem_tfm {versions().get('fem_tfm', '')}, {self.comm.size} rank(s): {case.title}")

    def log(self, text: str) -> None:
        """One line of run.log, with the wall time since the start."""
        if self._file is not None:
            self._file.write(f"{time.perf_counter() - self._began:9.2f} s  {text}\n")
            self._file.flush()

    def lap(self, stage: str) -> None:
        """Book the time since the last call under a stage."""
        now = time.perf_counter()
        self.seconds[stage] += now - self._lap
        self._lap = now

    def step_back(self) -> None:
        """Go back to the last accepted state, where a step was cut short, and keep it."""

    def save_final(self) -> None:
        """Keep the state of an answer, where it is not kept already."""

    def close(self) -> None:
        """Close the monitor and the log."""
        for file in (self.monitor, self._file):
            if file is not None:
                file.close()

    def write(self, result: Result) -> None:
        """Put what the run has cost so far into its result, and write that."""
        result.cpu_seconds = cpu_seconds(self.comm)
        result.peak_memory_mb = peak_memory_mb(self.comm)
        if self.out is not None:
            on_root(self.comm, lambda: result.write(self.out))


def prepare(case: Case, out: Path, overwrite: bool, files: Sequence[str]) -> None:
    """Make the directory with the complete case; a replaced run leaves none of its `files`."""
    out.mkdir(parents=True, exist_ok=True)
    if overwrite:
        for name in (checkpoint.FILE, checkpoint.BEFORE, *files):
            (out / name).unlink(missing_ok=True)
    write_text(out / "case.toml", case.dump())


def check_resumable(case: Case, out: Path) -> None:
    """Refuse to go on with another case, or without a state to go on from."""
    if not checkpoint.numbers(out):
        raise InputError("--resume", str(out), "a directory that holds a checkpoint")
    stored = tomllib.loads((out / "case.toml").read_text(encoding="utf-8"))
    changed = sorted(_flat(stored).items() ^ _flat(tomllib.loads(case.dump())).items())
    keys = {key for key, _ in changed if not key.startswith(FREE_TO_CHANGE)}
    if keys:
        allowed = (
            f"the directory of a run of this very case; different are {', '.join(sorted(keys))}"
        )
        raise InputError("--resume", str(out), allowed)


def _flat(table: dict[str, Any], prefix: str = "") -> dict[str, str]:
    """Dotted keys and the text of their values."""
    flat = {}
    for key, value in table.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{prefix}{key}.")
        else:
            flat[prefix + key] = repr(value)
    return flat


def with_references(
    case: Case,
    found: Mapping[str, float],
    errors: Mapping[str, float | None],
    known: Mapping[str, Sequence[Reference]] | None = None,
) -> dict[str, Quantity]:
    """Quantities with their errors, the references of the case and those that are `known`."""
    references: dict[str, list[Reference]] = {}
    for given in case.reference:
        references.setdefault(given.quantity, []).append(Reference(given.value, given.source))
    for name, more in (known or {}).items():
        references.setdefault(name, []).extend(more)
    return {
        name: Quantity(
            value, QUANTITIES[name], errors[name], references=tuple(references.get(name, ()))
        )
        for name, value in found.items()
    }

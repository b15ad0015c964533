# SPDX-License-Identifier: LGPL-3.0-or-later
"""The life of a run, whatever it solves: its directory, its log, how it ends and what it leaves."""

from __future__ import annotations

import os
import time
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO

import tomli_w
from mpi4py import MPI

from fem_tfm.errors import InputError, TimeIsUp
from fem_tfm.geometry.section import RectangularSection
from fem_tfm.output import checkpoint, lock
from fem_tfm.output.files import on_root, write_text
from fem_tfm.output.particles import tracked as of_particles
from fem_tfm.output.particles.pictures import deposition_picture, particle_picture
from fem_tfm.output.profiles import Monitor
from fem_tfm.output.result import Result, cpu_seconds, peak_memory_mb, versions
from fem_tfm.progress import Progress
from fem_tfm.scenes.reading import tables_of

# keys that a resumed run may change
FREE_TO_CHANGE = (
    "title",
    "inferred",
    "uncertain",
    "reference",
    "output",
    "numerics.max_steps",
    "numerics.end_time",
    "numerics.time_limit",
    "numerics.error_estimate",
)


@dataclass(frozen=True)
class Setting:
    """Where and how a run works.

    out : directory of the results, or None to keep nothing
    progress : where to tell
    resume : go on from the checkpoint in `out`
    comm : ranks that work together
    """

    out: Path | None = None
    progress: Progress = field(default_factory=lambda: Progress(quiet=True))
    resume: bool = False
    comm: MPI.Comm = field(default_factory=lambda: MPI.COMM_WORLD)


class Recorder:
    """What a run tells and keeps while it works: progress, run.log, monitor.csv.

    Parameters
    ----------
    scene : what is solved
    setting : where and how
    columns : of monitor.csv, with their units

    `section` is what is solved, with its `mesh` and number `dofs` of unknowns; None before there is
    a state. `tracked` tells of its particles, if there are any.
    """

    section: Any = None
    tracked: of_particles.Tracked | None = None

    def __init__(self, scene: Any, setting: Setting, columns: Mapping[str, str]) -> None:
        self.scene = scene
        self.out, self.progress, self.resume = setting.out, setting.progress, setting.resume
        self.comm = setting.comm
        self.seconds = {"setup": 0.0, "compile": 0.0, "solve": 0.0, "output": 0.0}
        self.monitor: Monitor | None = None
        self._file: TextIO | None = None
        self._began = self._lap = time.perf_counter()
        if self.out is not None and self.comm.rank == 0:
            self.monitor = Monitor(self.out / "monitor.csv", columns, append=self.resume)
            self._file = (self.out / "run.log").open("a", encoding="utf-8")
        self.log(
            f"fem_tfm {versions().get('fem_tfm', '')}, {self.comm.size} rank(s): {scene.title}"
        )

    def log(self, text: str) -> None:
        """One line of run.log, with the wall time since the start."""
        if self._file is not None:
            self._file.write(f"{time.perf_counter() - self._began:9.2f} s  {text}\n")
            self._file.flush()

    def check_time(self, doing: str = "") -> None:
        """End a run that has used its time (collective); raises TimeIsUp.

        doing : what the run was at, such as "while ..."
        """
        limit = self.scene.numerics.time_limit
        if limit is None:
            return
        spent = self.comm.bcast(time.perf_counter() - self._began)
        if spent > limit:
            raise TimeIsUp(f"numerics.time_limit = {limit:g} s is over {doing}".rstrip())

    def lap(self, stage: str) -> None:
        """Book the time since the last call under a stage."""
        now = time.perf_counter()
        self.seconds[stage] += now - self._lap
        self._lap = now

    def step_back(self) -> None:
        """Go back to the last accepted state, where a step was cut short, and keep it."""

    def save_final(self) -> None:
        """Keep the state of an answer, where it is not kept already."""

    def write_files(self, result: Result) -> None:
        """Fields, tables and pictures of the state at hand, whether it is an answer or not."""

    def write_all(self, result: Result) -> None:
        """`write_files`, and what is told of the particles."""
        self.write_files(result)
        out, tracked = self.out, self.tracked
        result.tracked = tracked
        if out is not None and tracked is not None and tracked.last is not None:
            on_root(self.comm, lambda: _write_particles(out, tracked, self.scene))

    def close(self) -> None:
        """Close the monitor and the log."""
        for file in (self.monitor, self._file):
            if file is not None:
                file.close()
        if self.out is not None and self.comm.rank == 0:
            lock.release(self.out)

    def write(self, result: Result) -> None:
        """Put what the run has cost so far into its result, and write that."""
        result.cpu_seconds = cpu_seconds(self.comm)
        result.peak_memory_mb = peak_memory_mb(self.comm)
        out = self.out
        if out is not None:
            on_root(self.comm, lambda: result.write(out))


def _write_particles(out: Path, tracked: of_particles.Tracked, scene: Any) -> None:
    """Tables, files for ParaView and pictures of the particles of a run."""
    of_particles.write_tables(out, tracked)
    of_particles.write_trajectories(out, tracked)
    of_particles.write_cloud(out, tracked)
    if tracked.lattice is not None:
        tracked.lattice.write(out / "particle_fields.vtu", tracked.materials)
    if tracked.wear is not None and tracked.wear.sums:
        tracked.wear.write(out, scene.title, scene.output.pictures)
    if scene.output.pictures:
        size, title = scene.geometry.size, scene.title
        round_section = not isinstance(scene.section, RectangularSection)
        particle_picture(out / "particles.png", tracked, size, title, round_section)
        if tracked.counts()["deposited"]:
            deposition_picture(out / "deposition.png", tracked, title)


def prepare(scene: Any, setting: Setting, overwrite: bool) -> None:
    """Make the directory with the complete case; a replaced run leaves none of its files.

    Collective. Raises InputError where a run is to be resumed that is not there, or another one.
    """
    out, text = setting.out, case_text(scene)
    assert out is not None
    if setting.resume:
        check_resumable(text, out, scene.fixed)

    def make() -> None:
        try:
            out.mkdir(parents=True, exist_ok=True)
            if not lock.hold(out):
                raise InputError("--out", str(out), "a directory in which no other run is at work")
            if overwrite:
                own = (checkpoint.FILE, checkpoint.BEFORE, *scene.files)
                for name in (*own, *of_particles.FILES):
                    (out / name).unlink(missing_ok=True)
            write_text(out / "case.toml", text)
        except OSError as error:
            raise _unwritable(out, error) from error

    on_root(setting.comm, make)


def case_text(scene: Any) -> str:
    """The scene as a case file with every default."""
    return tomli_w.dumps(tables_of(scene))


def check_resumable(text: str, out: Path, fixed: tuple[str, ...] = ()) -> None:
    """Refuse to go on with another case, or without a state to go on from.

    fixed : keys that other scenes may change
    """
    if not checkpoint.numbers(out):
        raise InputError("--resume", str(out), "a directory that holds a checkpoint")
    stored = tomllib.loads((out / "case.toml").read_text(encoding="utf-8"))
    changed = sorted(_flat(stored).items() ^ _flat(tomllib.loads(text)).items())
    keys = {key for key, _ in changed if key in fixed or not key.startswith(FREE_TO_CHANGE)}
    if keys:
        allowed = (
            f"the directory of a run of this very case, each --set again; different are"
            f" {', '.join(sorted(keys))}"
        )
        raise InputError("--resume", str(out), allowed)


def _flat(table: dict[str, Any], prefix: str = "") -> dict[str, str]:
    """Dotted keys and the text of their values."""
    flat: dict[str, str] = {}
    for key, value in table.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{prefix}{key}.")
        else:
            flat[prefix + key] = repr(value)
    return flat


def results_directory(
    out: str | Path | None,
    overwrite: bool = False,
    resume: bool = False,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> Path | None:
    """Check where results are to go; nothing is made or changed.

    Rank 0 looks and all ranks hear the same answer, so that none sees what another wrote meanwhile.
    Raises `InputError` if the place holds something and neither overwrite nor resume is asked.
    """
    found: Path | InputError | None = None
    if comm.rank == 0:
        try:
            found = _free_directory(out, overwrite, resume)
        except InputError as error:
            found = error
    found = comm.bcast(found)
    if isinstance(found, InputError):
        raise found
    return found


def _unwritable(path: Path, error: OSError) -> InputError:
    """What is told of a place that cannot be written."""
    return InputError("--out", str(path), f"a directory that can be written ({error.strerror})")


def _free_directory(out: str | Path | None, overwrite: bool, resume: bool) -> Path | None:
    if overwrite and resume:
        raise InputError("--resume", True, "either --resume or --overwrite")
    if out is None:
        if resume:
            raise InputError("--resume", True, "--out with the directory of the run to resume")
        return None
    path = Path(out)
    try:
        ancestor = next(p for p in (path, *path.absolute().parents) if p.exists())
    except OSError as error:
        # such as a name that is too long
        raise _unwritable(path, error) from error
    if not (ancestor.is_dir() and os.access(ancestor, os.W_OK)):
        raise InputError("--out", str(out), f"a directory that can be written, unlike {ancestor}")
    filled = path.is_dir() and any(path.iterdir())
    if resume and not filled:
        raise InputError("--resume", str(out), "a directory with a run to resume")
    if filled and not (overwrite or resume):
        raise InputError("--out", str(out), "a new directory, or --overwrite or --resume")
    return path

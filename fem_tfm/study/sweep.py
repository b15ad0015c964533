# SPDX-License-Identifier: LGPL-3.0-or-later
"""A case solved for every combination of varied values: one table and one picture.

The points are visited in an order in which neighbours differ in one value and numbers rise or fall
step by step, however they are given. Each point is offered the answer of the point before: a
developed section goes on from it where only numbers change, other scenes start cold. Every point is
written as it ends, so that a sweep that was stopped goes on.
"""

from __future__ import annotations

import csv
import io
import itertools
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from mpi4py import MPI

from fem_tfm.case import Case, known_keys
from fem_tfm.errors import InputError, SolverError
from fem_tfm.output.files import on_root, write_text
from fem_tfm.output.result import Result, unit_of
from fem_tfm.progress import Progress
from fem_tfm.scenes.recorder import Setting
from fem_tfm.scenes.scene import Answer

TABLE, PICTURE, CASE, POINTS = "sweep.csv", "sweep.png", "case.toml", "points"
SOLVED, FAILED = ("converged", "finished"), "failed"
# seconds between two looks at what other processes have solved
LOOK = 0.5


@dataclass
class Point:
    """One combination of the varied values and what came of it.

    number : place in the table, that of `itertools.product`
    quantities, errors : by name, in the units of `unit_of`; empty if it failed
    start : "cold", or "warm" from the point before
    cpu_seconds, factorisations : of the solve
    warnings : what the answer does not hold for
    """

    number: int
    values: dict[str, Any]
    status: str = FAILED
    reason: str = ""
    start: str = "cold"
    quantities: dict[str, float] = field(default_factory=dict)
    errors: dict[str, float | None] = field(default_factory=dict)
    cpu_seconds: float = 0.0
    factorisations: int = 0
    warnings: list[str] = field(default_factory=list)

    @property
    def solved(self) -> bool:
        """Whether there is an answer."""
        return self.status in SOLVED


@dataclass
class Sweep:
    """All points in the order of the table; prints as a short summary."""

    points: list[Point]
    directory: Path

    @property
    def failed(self) -> list[Point]:
        """Points without an answer."""
        return [p for p in self.points if not p.solved]

    def __str__(self) -> str:
        solved = len(self.points) - len(self.failed)
        lines = [f"{solved} of {len(self.points)} points solved; table in {self.directory / TABLE}"]
        for point in self.failed:
            lines.append(f"  {_named(point.values)}: {point.reason}")
        return "\n".join(lines)


@dataclass(frozen=True)
class Plan:
    """What a sweep works on.

    case : what is varied
    out : directory of the table; None keeps nothing
    keep : also keep a results directory a point
    comm : ranks that share every point
    """

    case: Case
    out: Path | None = None
    keep: bool = False
    comm: MPI.Comm = field(default_factory=lambda: MPI.COMM_WORLD)

    @property
    def points(self) -> Path:
        """Directory of the points."""
        assert self.out is not None
        return self.out / POINTS

    def setting(self, point: Point) -> Setting:
        """Where and how a point is solved."""
        place = self.points / str(point.number) if self.keep else None
        return Setting(place, Progress(quiet=True), comm=self.comm)

    def save(self, point: Point) -> None:
        """Write a point that has ended."""
        if self.out is not None:
            text = json.dumps(asdict(point))
            on_root(self.comm, lambda: write_text(self.points / f"{point.number}.json", text))

    def load(self, point: Point) -> Point | None:
        """What was written about a point; None if it has not ended."""
        with suppress(OSError, ValueError, TypeError):
            text = (self.points / f"{point.number}.json").read_text(encoding="utf-8")
            found = Point(**json.loads(text))
            return found if found.values == point.values else None
        return None


def run(
    case: Case,
    vary: Mapping[str, Sequence[Any]],
    out: str | Path,
    jobs: int = 1,
    resume: bool = False,
    keep: bool = False,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> Sweep:
    """Solve every combination of the varied values and write the table and the picture to `out`.

    A point that fails says so in its row and the others go on. With `jobs` above 1 that many
    processes share the points; each starts cold once.

    resume : take over the points that an older sweep of the same case has solved
    keep : keep a results directory a point, in `out`/points
    comm : ranks that share every point

    Raises
    ------
    InputError
        jobs above 1 under mpirun, a combination that is no valid case or cannot be solved, or a
        sweep to resume that is one of another case; nothing is written.
    """
    if jobs > 1 and comm.size > 1:
        raise InputError("--jobs", jobs, "1 under mpirun, whose ranks share every point")
    vary = {key: [_plain(value) for value in values] for key, values in vary.items()}
    points = [Point(i, values) for i, values in enumerate(combinations(vary))]
    for point in points:
        case.with_values(point.values).scene.examine()
    plan, began = Plan(case, Path(out), keep, comm), time.perf_counter()
    known = comm.bcast(_known(plan, points) if resume else {})
    on_root(comm, lambda: _prepare(plan, known))
    route = [points[i] for i in tour([in_line(values) for values in vary.values()])]
    parts = chunks([point for point in route if point.number not in known], jobs)
    sweep = Sweep([known.get(point.number, point) for point in points], Path(out))
    for point in _in_processes(plan, parts) if len(parts) > 1 else told(solve(plan, parts[0])):
        sweep.points[point.number] = point
        on_root(comm, lambda: _write_table(sweep, list(vary)))
    on_root(comm, lambda: _write_table(sweep, list(vary)))
    on_root(comm, lambda: _draw(sweep, list(vary), case.scene.title))
    _say(f"{time.perf_counter() - began:.1f} s in all")
    return sweep


def _plain(value: Any) -> Any:
    """A value as a Python number, where it is one of numpy."""
    return value.item() if hasattr(value, "item") else value


def _prepare(plan: Plan, known: Mapping[int, Point]) -> None:
    """Make the directory; what an older sweep has written goes, but for the points that count."""
    for path in plan.points.glob("*.json"):
        if path.stem not in map(str, known):
            path.unlink()
    assert plan.out is not None
    write_text(plan.out / CASE, plan.case.dump())


def _known(plan: Plan, points: Sequence[Point]) -> dict[int, Point]:
    """Points that an older sweep of the same case has solved, by number."""
    assert plan.out is not None
    place = plan.out / CASE
    stored = tomllib.loads(place.read_text(encoding="utf-8")) if place.exists() else None
    if stored != tomllib.loads(plan.case.dump()):
        raise InputError("--resume", str(plan.out), "the directory of a sweep of this very case")
    found = {point.number: plan.load(point) for point in points}
    return {number: point for number, point in found.items() if point and point.solved}


# -- order -------------------------------------------------------------------------------------


def combinations(vary: Mapping[str, Sequence[Any]]) -> list[dict[str, Any]]:
    """Every combination, the last key fastest."""
    found: list[dict[str, Any]] = [{}]
    for key, values in vary.items():
        found = [{**given, key: value} for given in found for value in values]
    return found


def in_line(values: Sequence[Any]) -> list[int]:
    """Places of numbers in rising or falling order, of other values as they are given.

    The end that is nearer to the first of them comes first.
    """
    places = list(range(len(values)))
    if any(isinstance(value, bool) or not isinstance(value, int | float) for value in values):
        return places
    places.sort(key=values.__getitem__)
    return places[::-1] if places.index(0) > len(places) // 2 else places


def tour(axes: Sequence[Sequence[int]]) -> list[int]:
    """Numbers of the combinations in boustrophedon order: each differs from the last in one key.

    axes : places of the values of each key in the order in which they are visited
    """
    order = [0]
    for axis in axes:
        rows = (axis if k % 2 == 0 else reversed(axis) for k in range(len(order)))
        pairs = zip(order, rows, strict=True)
        order = [i * len(axis) + j for i, row in pairs for j in row]
    return order


def chunks(route: Sequence[Point], jobs: int) -> list[list[Point]]:
    """The route cut into at most `jobs` parts of nearly equal length."""
    number = max(1, min(jobs, len(route)))
    cuts = [len(route) * k // number for k in range(number + 1)]
    return [list(route[a:b]) for a, b in itertools.pairwise(cuts)]


# -- solving -----------------------------------------------------------------------------------


def solve(
    plan: Plan, route: Sequence[Point], read: Callable[[Case, Point, Answer], None] | None = None
) -> Iterator[Point]:
    """Solve the points one after another, each from the one before where that is possible.

    Points may differ in several values at once.

    read : told the case, the point and the answer (collective), for the next point uses it up
    """
    answer: Answer | None = None
    for point in route:
        cpu, changed = time.process_time(), plan.case.with_values(point.values)
        try:
            result, answer = changed.scene.carry_out(plan.setting(point), answer, overwrite=True)
            _take(point, result, answer)
        except (SolverError, InputError) as error:
            point.reason = str(error)
            if answer is not None:
                answer.close()
            answer = None
        point.cpu_seconds = plan.comm.allreduce(time.process_time() - cpu)
        if read is not None and answer is not None:
            read(changed, point, answer)
        plan.save(point)
        yield point
    if answer is not None:
        answer.close()


def _take(point: Point, result: Result, answer: Answer) -> None:
    point.status, point.start = result.status, answer.start
    point.factorisations, point.warnings = answer.factorisations, list(result.warnings)
    point.quantities = {name: quantity.value for name, quantity in result.quantities.items()}
    point.errors = {name: q.error_estimate for name, q in result.quantities.items()}


# -- processes ---------------------------------------------------------------------------------


def _in_processes(plan: Plan, parts: Sequence[Sequence[Point]]) -> Iterator[Point]:
    """Solve each part in a process of its own; a process that dies fails its points."""
    with tempfile.TemporaryDirectory() as folder:
        tasks = [Path(folder) / f"{k}.task" for k in range(len(parts))]
        running = [_started(plan, part, task) for part, task in zip(parts, tasks, strict=True)]
        waiting = {point.number: point for part in parts for point in part}
        try:
            while waiting:
                ended = [process.poll() for process in running]
                yield from _arrived(plan, waiting)
                if all(status is not None for status in ended):
                    break
                time.sleep(LOOK)
        finally:
            for process in running:
                process.kill()
        for part, status in zip(parts, ended, strict=True):
            for point in part:
                if point.number in waiting:
                    point.reason = f"the process of this point ended with status {status}"
                    yield point


def _arrived(plan: Plan, waiting: dict[int, Point]) -> Iterator[Point]:
    """Points that other processes have ended since the last look."""
    for point in list(waiting.values()):
        found = plan.load(point)
        if found is not None:
            del waiting[point.number]
            yield found


def _started(plan: Plan, part: Sequence[Point], task: Path) -> subprocess.Popen[bytes]:
    content = {
        "case": plan.case.dump(),
        "out": str(plan.out),
        "keep": plan.keep,
        "parent": os.getpid(),
        "points": [[p.number, p.values] for p in part],
    }
    task.write_text(json.dumps(content), encoding="utf-8")
    command = [sys.executable, "-m", "fem_tfm.study.sweep", str(task)]
    # one thread each: the processes share the machine already
    return subprocess.Popen(command, env={"OMP_NUM_THREADS": "1", **os.environ})


def _work(task: str) -> None:
    """Solve the points of a task file."""
    content = json.loads(Path(task).read_text(encoding="utf-8"))
    threading.Thread(target=_end_without, args=(content["parent"],), daemon=True).start()
    case = Case.from_dict(tomllib.loads(content["case"]))
    plan = Plan(case, Path(content["out"]), content["keep"])
    for _ in told(solve(plan, [Point(number, values) for number, values in content["points"]])):
        pass


def _end_without(parent: int) -> None:
    """End this process when its parent is gone, however that ended."""
    while os.getppid() == parent:
        time.sleep(LOOK)
    os._exit(1)


# -- output ------------------------------------------------------------------------------------


def told(points: Iterator[Point]) -> Iterator[Point]:
    """Pass points on and print a line about each."""
    for point in points:
        words = f"{point.start} start, {point.factorisations} factorisations"
        _say(f"{_named(point.values)}: {point.status}, {words}, {point.cpu_seconds:.1f} CPU s")
        yield point


def _say(text: str) -> None:
    if MPI.COMM_WORLD.rank == 0:
        print(text, flush=True)


def _named(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{key} = {_shown(value)}" for key, value in values.items())


def _shown(value: Any) -> Any:
    """A value as one cell of the table; a law by its name."""
    if isinstance(value, Mapping):
        return ", ".join(f"{k} {v}" if k != "model" else str(v) for k, v in value.items())
    return value


def units(names: Iterable[str]) -> dict[str, str]:
    """Units of varied keys and of quantities."""
    known = known_keys()
    return {n: known[n].unit if n in known else unit_of(n) or "" for n in names}


def rows(sweep: Sweep, keys: Sequence[str]) -> Iterator[list[Any]]:
    """Head and rows of the table; a failed point has empty quantities and its reason."""
    solved = [p for p in sweep.points if p.solved]
    names = list(dict.fromkeys(name for p in solved for name in p.quantities))
    told = units([*keys, *names])
    head = [f"{key} [{told[key]}]" if told[key] else key for key in keys]
    for name in names:
        head += [f"{name} [{told[name]}]", f"{name} error [{told[name]}]"]
    yield [*head, "status", "start", "CPU [s]", "factorisations", "reason", "warnings"]
    for p in sweep.points:
        row = [_shown(p.values[key]) for key in keys]
        for name in names:
            row += [_cell(p.quantities.get(name)), _cell(p.errors.get(name))]
        cost = [f"{p.cpu_seconds:.3g}", p.factorisations]
        yield [*row, p.status, p.start, *cost, p.reason, "; ".join(p.warnings)]


def _cell(value: float | None) -> str:
    return "" if value is None else f"{value:.10g}"


def _write_table(sweep: Sweep, keys: Sequence[str]) -> None:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows(sweep, keys))
    write_text(sweep.directory / TABLE, text.getvalue())


def _draw(sweep: Sweep, keys: Sequence[str], title: str) -> None:
    """Draw what all points that were solved have."""
    from fem_tfm.output.pictures import sweep_picture

    solved = [p for p in sweep.points if p.solved]
    if solved:
        shared = [n for n in solved[0].quantities if all(n in p.quantities for p in solved)]
        columns = {key: [_shown(p.values[key]) for p in solved] for key in keys}
        columns |= {name: [p.quantities[name] for p in solved] for name in shared}
        errors = {name: [p.errors.get(name) for p in solved] for name in shared}
        sweep_picture(sweep.directory / PICTURE, columns, keys, units(columns), title, errors)


if __name__ == "__main__":
    _work(*sys.argv[1:])

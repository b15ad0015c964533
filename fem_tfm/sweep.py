# SPDX-License-Identifier: LGPL-3.0-or-later
"""A case solved for every combination of varied values: one table and one picture.

The points are visited in an order in which neighbours differ in one value and numbers rise or fall
step by step, however they are given. Where only numbers change, the next point goes on from the
state of the last one, on its last two meshes and with its compiled forms. Where the mesh, the laws
or the kind of feed changes it starts cold.
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
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from mpi4py import MPI

from fem_tfm.case import QUANTITIES, Case, known_keys
from fem_tfm.errors import InputError, SolverError
from fem_tfm.flows import dense, developed, developing, duct, duct_developing
from fem_tfm.flows.case_geometry import geometry_of, resolution_of
from fem_tfm.flows.section import Section
from fem_tfm.output.files import on_root, write_text

TABLE, PICTURE = "sweep.csv", "sweep.png"
CONVERGED, FAILED = "converged", "failed"


@dataclass
class Point:
    """One combination of the varied values and what came of it.

    number : place in the table, that of `itertools.product`
    quantities, errors : by name, in the units of `case.QUANTITIES`; empty if it failed
    start : "cold", or "warm" from the point before
    cpu_seconds, factorisations : of the solve
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


@dataclass
class Sweep:
    """All points in the order of the table; prints as a short summary."""

    points: list[Point]
    directory: Path

    @property
    def failed(self) -> list[Point]:
        """Points without an answer."""
        return [p for p in self.points if p.status != CONVERGED]

    def __str__(self) -> str:
        solved = len(self.points) - len(self.failed)
        lines = [f"{solved} of {len(self.points)} points solved; table in {self.directory / TABLE}"]
        for point in self.failed:
            lines.append(f"  {_named(point.values)}: {point.reason}")
        return "\n".join(lines)


def run(case: Case, vary: Mapping[str, Sequence[Any]], out: Path, jobs: int = 1) -> Sweep:
    """Solve every combination of the varied values and write the table and the picture to `out`.

    A point that fails says so in its row and the others go on. With `jobs` above 1 that many
    processes share the points; each starts cold once.

    Raises
    ------
    InputError
        jobs above 1 under mpirun, or a combination that is no valid case.
    """
    comm = MPI.COMM_WORLD
    if jobs > 1 and comm.size > 1:
        raise InputError("--jobs", jobs, "1 under mpirun, whose ranks share every point")
    points = [Point(i, values) for i, values in enumerate(combinations(vary))]
    for point in points:
        case.with_values(point.values)
    route = [points[i] for i in tour([in_line(values) for values in vary.values()])]
    parts = chunks(route, jobs)
    began = time.perf_counter()
    solved = _in_processes(case, parts) if len(parts) > 1 else list(told(solve(case, route)))
    sweep = Sweep(sorted(solved, key=lambda p: p.number), Path(out))
    on_root(comm, lambda: _write(sweep, list(vary), case.title))
    _say(f"{time.perf_counter() - began:.1f} s in all")
    return sweep


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


def mesh_key(case: Case) -> tuple[Any, ...]:
    """What the meshes of a case depend on."""
    return geometry_of(case), resolution_of(case)


def solve(
    case: Case,
    route: Sequence[Point],
    read: Callable[[Case, Point, developed.Solution], None] | None = None,
) -> Iterator[Point]:
    """Solve the points one after another, each from the one before where that is possible.

    Points may differ in several values at once.

    read : told the case, the point and the answer of every developed dense flow (collective), for
        the next point uses the answer up
    """
    solver = _Solver()
    for point in route:
        cpu, changed = time.process_time(), case.with_values(point.values)
        try:
            solver.solve(changed, point)
            point.status = CONVERGED
        except SolverError as error:
            point.reason = str(error)
        point.cpu_seconds = MPI.COMM_WORLD.allreduce(time.process_time() - cpu)
        if read is not None and point.status == CONVERGED and solver.solution is not None:
            read(changed, point, solver.solution)
        yield point


class _Solver(developed.Observer):
    """Solves cases and keeps the last answer for the next one."""

    def __init__(self) -> None:
        self.solution: developed.Solution | None = None
        self.meshes: tuple[Any, ...] = ()
        self.begun: list[Section] = []

    def solve(self, case: Case, point: Point) -> None:
        """Solve a case into its point; SolverError if there is no answer."""
        if case.solution == "developing":
            self._march(case, point)
            return
        if case.flow == "duct":
            self._duct(case, point)
            return
        setup, limits = dense.setup_of(case), (case.numerics.tolerance, case.numerics.max_steps)
        fits = self.solution is not None and self.meshes == mesh_key(case)
        held, self.solution = self.solution, None
        if fits and held.section.setup.structure == setup.structure:
            sections = [level.section for level in held.levels[-2:]]
            before = sum(s.newton.factorisations for s in sections)
            with suppress(SolverError):
                point.start = "warm"
                self.solution = developed.resolve(held, setup, *limits, self)
            point.factorisations += sum(s.newton.factorisations for s in sections) - before
        if self.solution is None:
            point.start = "cold"
            self.begun, self.meshes = [], mesh_key(case)
            try:
                self.solution = developed.solve(dense.meshes(case), setup, *limits, self)
            finally:
                point.factorisations += sum(s.newton.factorisations for s in self.begun)
        self._read(case, point)

    def _march(self, case: Case, point: Point) -> None:
        flow = duct_developing if case.flow == "duct" else developing
        line = flow.solve(case, developing.QUIET)
        point.factorisations += line.station.newton.factorisations
        point.quantities = line.quantities()
        point.errors = dict.fromkeys(point.quantities)
        line.station.newton.destroy()

    def _duct(self, case: Case, point: Point) -> None:
        """A duct's gas starts cold: on its coarsest mesh that costs next to nothing."""
        solution = duct.solve(case, self)
        duct.checked_balances(solution.section)
        point.quantities, point.errors, _ = duct.estimated(case, solution)
        for level in solution.levels:
            point.factorisations += level.section.newton.factorisations
            level.section.newton.destroy()

    def _read(self, case: Case, point: Point) -> None:
        dense.checked_balances(self.solution.section)
        length = case.geometry.length
        point.quantities, point.errors = dense.estimated(self.solution, length)

    # what developed.solve tells

    def begin(self, section: Section, level: int, levels: int) -> None:
        """Keep the section, so that its factorisations are counted."""
        self.begun.append(section)


# -- processes ---------------------------------------------------------------------------------


def _in_processes(case: Case, parts: Sequence[Sequence[Point]]) -> list[Point]:
    """Solve each part in a process of its own; a process that dies fails its points."""
    with tempfile.TemporaryDirectory() as folder:
        running = [_started(case, part, Path(folder) / f"{k}") for k, part in enumerate(parts)]
        try:
            return [p for part, job in zip(parts, running, strict=True) for p in _ended(part, *job)]
        finally:
            for process, _ in running:
                process.kill()


def _started(case: Case, part: Sequence[Point], stem: Path) -> tuple[subprocess.Popen, Path]:
    task, answer = stem.with_suffix(".task"), stem.with_suffix(".answer")
    values = [[p.number, p.values] for p in part]
    task.write_text(json.dumps({"case": case.dump(), "points": values}), encoding="utf-8")
    command = [sys.executable, "-m", "fem_tfm.sweep", str(task), str(answer)]
    # one thread each: the processes share the machine already
    return subprocess.Popen(command, env={"OMP_NUM_THREADS": "1", **os.environ}), answer


def _ended(part: Sequence[Point], process: subprocess.Popen, answer: Path) -> list[Point]:
    status = process.wait()
    lines = answer.read_text(encoding="utf-8").splitlines() if answer.exists() else []
    found = {p.number: p for p in (Point(**json.loads(line)) for line in lines)}
    lost = f"the process of this point ended with status {status}"
    return [found.get(p.number) or Point(p.number, p.values, reason=lost) for p in part]


def _work(task: str, answer: str) -> None:
    """Solve the points of a task file, one line of the answer for each."""
    import tomllib

    content = json.loads(Path(task).read_text(encoding="utf-8"))
    case = Case.from_dict(tomllib.loads(content["case"]))
    points = [Point(number, values) for number, values in content["points"]]
    with Path(answer).open("w", encoding="utf-8") as file:
        for point in told(solve(case, points)):
            file.write(json.dumps(asdict(point)) + "\n")
            file.flush()


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


def units(keys: Sequence[str]) -> dict[str, str]:
    """Units of varied keys and of quantities."""
    return {key: _unit(key) for key in keys} | QUANTITIES


def _unit(key: str) -> str:
    info, table = None, Case
    for part in key.split("."):
        if key not in known_keys() or table is None:
            return ""
        info = table.model_fields[part]
        kinds = [info.annotation, *getattr(info.annotation, "__args__", ())]
        table = next((k for k in kinds if hasattr(k, "model_fields")), None)
    return (info.json_schema_extra or {}).get("unit", "")


def rows(sweep: Sweep, keys: Sequence[str]) -> Iterator[list[Any]]:
    """Head and rows of the table; a failed point has empty quantities and its reason."""
    solved = [p for p in sweep.points if p.status == CONVERGED]
    names = list(solved[0].quantities) if solved else []
    told = units(keys)
    head = [f"{key} [{told[key]}]" if told[key] else key for key in keys]
    for name in names:
        head += [f"{name} [{told[name]}]", f"{name} error [{told[name]}]"]
    yield [*head, "status", "start", "CPU [s]", "factorisations", "reason"]
    for p in sweep.points:
        row = [_shown(p.values[key]) for key in keys]
        for name in names:
            row += [_cell(p.quantities.get(name)), _cell(p.errors.get(name))]
        yield [*row, p.status, p.start, f"{p.cpu_seconds:.3g}", p.factorisations, p.reason]


def _cell(value: float | None) -> str:
    return "" if value is None else f"{value:.10g}"


def _write(sweep: Sweep, keys: Sequence[str], title: str) -> None:
    """Write the table, and the picture of the points that were solved."""
    from fem_tfm.output.pictures import sweep_picture

    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows(sweep, keys))
    write_text(sweep.directory / TABLE, text.getvalue())
    solved = [p for p in sweep.points if p.status == CONVERGED]
    if solved:
        columns = {key: [_shown(p.values[key]) for p in solved] for key in keys}
        columns |= {name: [p.quantities[name] for p in solved] for name in solved[0].quantities}
        sweep_picture(sweep.directory / PICTURE, columns, keys, units(keys), title)


if __name__ == "__main__":
    _work(*sys.argv[1:])

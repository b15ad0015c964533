# SPDX-License-Identifier: LGPL-3.0-or-later
"""Run time against error: the pressure gradient of the dense demo on a row of meshes.

Every mesh is solved as a user would get it, by nested iteration from the coarsest one, so that the
CPU time is that of all meshes up to it. The error is against a finer mesh of triangles than any in
the table. The meshes of the paper stand beside them: their errors against its own finest mesh, at
their numbers of cells, since its CPU times are not printed.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from mpi4py import MPI

from fem_tfm.bench.demo import demo
from fem_tfm.case import Case
from fem_tfm.output.files import on_root, replaced

DEMO = "dense_pipe/algebraic.toml"
CELLS = ("triangle", "quadrilateral")
LEVELS, REFERENCE_LEVEL = (1, 2, 3, 4, 5, 6), 8
# table 5 of the paper: cells of the pipe and pressure drop [kPa]; the last one is its reference
PUBLISHED = {
    "A": (216_000, 3.77),
    "B": (460_800, 3.91),
    "C": (806_400, 4.06),
    "D": (1_382_400, 4.09),
}


@dataclass(frozen=True)
class Measure:
    """One mesh of the benchmark.

    cells, number : shape of the cells and how many there are
    gradient : pressure gradient [Pa/m]
    cpu_seconds : of the solve on this mesh and the coarser ones that converged
    factorisations : on all meshes, those of a coarse mesh that failed too
    """

    cells: str
    level: int
    number: int
    unknowns: int
    gradient: float
    cpu_seconds: float
    factorisations: int


def measure(case: Case, cells: str, level: int) -> Measure:
    """Solve a developed section on one mesh level with one shape of cells.

    Raises
    ------
    SolverError
        there is no steady state on that mesh.
    """
    scene = case.with_values({"numerics.level": level, "numerics.cells": cells}).scene
    recorder = scene.recorder()
    answer = scene.solve(recorder)
    levels = answer.state.solution.levels
    measured = Measure(
        cells,
        level,
        recorder.section.mesh.num_cells,
        recorder.section.dofs,
        answer.quantities["pressure_gradient"],
        sum(one.cpu_seconds for one in levels),
        answer.factorisations,
    )
    answer.close()
    return measured


def table(measures: Sequence[Measure], reference: float) -> Iterator[str]:
    """Lines of the table; the error is relative to the reference [Pa/m]."""
    yield f"{'cells':<14} level  unknowns    G [Pa/m]     error   CPU [s]  factorisations"
    for m in measures:
        yield (
            f"{m.cells:<14} {m.level:5d}  {m.unknowns:8d}  {m.gradient:10.4f}  "
            f"{error(m, reference):8.1e}  {m.cpu_seconds:8.2f}  {m.factorisations:14d}"
        )


def error(found: Measure, reference: float) -> float:
    """Relative error of the pressure gradient [-]."""
    return abs(found.gradient / reference - 1)


def published_errors(meshes: Mapping[str, tuple[int, float]]) -> dict[str, tuple[int, float]]:
    """Cells and relative error of published meshes against the last of them, which is left out."""
    if not meshes:
        return {}
    *others, finest = meshes
    best = meshes[finest][1]
    return {name: (meshes[name][0], abs(meshes[name][1] / best - 1)) for name in others}


def picture(
    path: Path,
    measures: Sequence[Measure],
    reference: float,
    title: str,
    published: Mapping[str, tuple[int, float]],
) -> None:
    """Draw the error against run time and against cells, all axes logarithmic."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullFormatter

    figure = Figure(figsize=(8.4, 3.9), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, name in zip(panels, ("cpu_seconds", "number"), strict=True):
        for cells in dict.fromkeys(m.cells for m in measures):
            shown = [m for m in measures if m.cells == cells]
            errors = [max(error(m, reference), math.ulp(1.0)) for m in shown]
            axes.loglog([getattr(m, name) for m in shown], errors, "o-", label=f"{cells}s")
        axes.grid(color="#dddddd", linewidth=0.6, which="both")
        axes.spines[["top", "right"]].set_visible(False)
    timed, counted = panels
    timed.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    timed.xaxis.set_major_formatter("{x:g}")
    timed.xaxis.set_minor_formatter(NullFormatter())
    timed.set_xlabel("CPU time of the solve [s]")
    timed.set_ylabel("relative error of the pressure gradient")
    theirs = published_errors(published)
    counted.set_xlabel("cells" + (", ours of the section, theirs of the pipe" if theirs else ""))
    for name, (number, off) in theirs.items():
        timed.axhline(off, color="#888888", linewidth=0.8, linestyle="--")
        timed.annotate(f"paper's mesh {name}", (0.98, off), xycoords=timed.get_yaxis_transform(),
                       ha="right", va="bottom", fontsize=7, color="#666666")  # fmt: skip
        counted.annotate(f" {name}", (number, off), fontsize=8, color="#666666")
    if theirs:
        counted.loglog(*zip(*theirs.values(), strict=True), "s", color="#888888", label="paper")
    counted.legend(frameon=False, fontsize=8)
    figure.suptitle(title, fontsize=11)
    with replaced(path) as temporary:
        figure.savefig(temporary, dpi=150, format="png")


def run(out: Path) -> str:
    """Measure the dense demo on every mesh, write the picture and return the table."""
    case = demo(DEMO, {})
    return measured(case, LEVELS, REFERENCE_LEVEL, CELLS, out / "error.png", PUBLISHED)


def measured(
    case: Case,
    levels: Sequence[int],
    reference_level: int,
    shapes: Sequence[str],
    path: Path,
    published: Mapping[str, tuple[int, float]] | None = None,
) -> str:
    """Measure every mesh, print a line for each, write the picture and return the table.

    shapes : of the cells; the reference has the first
    published : cells and pressure drop of another author's meshes, coarse to fine
    """
    began, title = time.perf_counter(), case.scene.title
    for shape in shapes:
        # the forms are compiled outside the measurement
        measure(case, shape, 1)
    fine = measure(case, shapes[0], reference_level)
    tell(f"reference: level {reference_level}, {fine.unknowns} unknowns, {fine.gradient:.4f} Pa/m")
    found = []
    for shape in shapes:
        for level in levels:
            found.append(measure(case, shape, level))
            tell(f"{shape} level {level}: {error(found[-1], fine.gradient):.1e}")
    shown = published or {}
    on_root(MPI.COMM_WORLD, lambda: picture(path, found, fine.gradient, title, shown))
    lines = [*table(found, fine.gradient), f"picture in {path}"]
    return "\n".join([*lines, f"{time.perf_counter() - began:.0f} s in all"])


def tell(text: str) -> None:
    """Print on rank 0 at once."""
    if MPI.COMM_WORLD.rank == 0:
        print(text, flush=True)

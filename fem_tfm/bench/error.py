# SPDX-License-Identifier: LGPL-3.0-or-later
"""Run time against error: the pressure gradient of the dense demo on a row of meshes.

Every mesh is solved as a user would get it, by nested iteration from the coarsest one, so that the
CPU time is that of all meshes up to it. The error is against a finer mesh of triangles than any in
the table.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpi4py import MPI

from fem_tfm.bench.stress import Effort
from fem_tfm.case import Case
from fem_tfm.flows import dense, developed
from fem_tfm.output.files import on_root, replaced

# case 3 of Ding et al. (2024), as demos/dense_pipe/case3.toml has it
DEMO: dict[str, Any] = {
    "title": "dense pipe, case 3 of Ding et al. (2024)",
    "geometry": {"diameter": 0.010, "length": 2.4},
    "gas": {"density": 33.5, "viscosity": 1.8e-5},
    "solids": {"density": 1700.0, "diameter": 1.6e-4},
    "operation": {"gas_superficial_velocity": 6.43, "solids_fraction": 0.245},
}
CELLS = ("triangle", "quadrilateral")
LEVELS, REFERENCE_LEVEL = (1, 2, 3, 4, 5, 6), 8
PICTURE = Path("results") / "bench" / "error.png"


@dataclass(frozen=True)
class Measure:
    """One mesh of the benchmark.

    gradient : pressure gradient [Pa/m]
    cpu_seconds : of the solve on this mesh and the coarser ones that converged
    factorisations : on all meshes, those of a coarse mesh that failed too
    """

    cells: str
    level: int
    unknowns: int
    gradient: float
    cpu_seconds: float
    factorisations: int


def measure(cells: str, level: int) -> Measure:
    """Solve the demo on one mesh level with one shape of cells.

    Raises
    ------
    SolverError
        there is no steady state on that mesh.
    """
    case = Case.from_dict({**DEMO, "numerics": {"level": level, "cells": cells}})
    limits, effort = (case.numerics.tolerance, case.numerics.max_steps), Effort()
    solution = developed.solve(dense.meshes(case), dense.setup_of(case), *limits, effort)
    section = solution.section
    return Measure(
        cells,
        level,
        section.dofs,
        dense.pressure_gradient(section),
        sum(one.cpu_seconds for one in solution.levels),
        effort.factorisations,
    )


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


def picture(
    path: Path, measures: Sequence[Measure], reference: float, title: str = DEMO["title"]
) -> None:
    """Draw run time and unknowns against the error, both axes logarithmic."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 3.8), layout="constrained")
    for axes, name, label in zip(
        figure.subplots(1, 2, sharey=True),
        ("cpu_seconds", "unknowns"),
        ("CPU time of the solve [s]", "unknowns"),
        strict=True,
    ):
        for cells in dict.fromkeys(m.cells for m in measures):
            shown = [m for m in measures if m.cells == cells]
            errors = [max(error(m, reference), math.ulp(1.0)) for m in shown]
            axes.loglog([getattr(m, name) for m in shown], errors, "o-", label=cells)
        axes.set_xlabel(label)
        axes.grid(color="#dddddd", linewidth=0.6, which="both")
        axes.spines[["top", "right"]].set_visible(False)
    first = figure.axes[0]
    first.set_ylabel("relative error of the pressure gradient")
    first.legend(frameon=False)
    figure.suptitle(title, fontsize=11)
    with replaced(path) as temporary:
        figure.savefig(temporary, dpi=150, format="png")


def run(
    levels: Sequence[int] = LEVELS,
    reference_level: int = REFERENCE_LEVEL,
    shapes: Sequence[str] = CELLS,
    path: Path = PICTURE,
) -> str:
    """Measure every mesh, print a line for each, write the picture and return the table."""
    began = time.perf_counter()
    for shape in shapes:
        # the forms are compiled outside the measurement
        measure(shape, 1)
    fine = measure("triangle", reference_level)
    tell(f"reference: level {reference_level}, {fine.unknowns} unknowns, {fine.gradient:.4f} Pa/m")
    found = []
    for shape in shapes:
        for level in levels:
            found.append(measure(shape, level))
            tell(f"{shape} level {level}: {error(found[-1], fine.gradient):.1e}")
    on_root(MPI.COMM_WORLD, lambda: picture(path, found, fine.gradient))
    lines = [*table(found, fine.gradient), f"picture in {path}"]
    return "\n".join([*lines, f"{time.perf_counter() - began:.0f} s in all"])


def tell(text: str) -> None:
    """Print on rank 0 at once."""
    if MPI.COMM_WORLD.rank == 0:
        print(text, flush=True)

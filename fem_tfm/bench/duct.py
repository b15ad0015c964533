# SPDX-License-Identifier: LGPL-3.0-or-later
"""Run time against error: the pressure gradient of the square duct's gas on a row of meshes.

As for the dense pipe, every mesh is solved by nested iteration from the coarsest one, and the error
is against a finer mesh than any in the table.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mpi4py import MPI

from fem_tfm.bench import error
from fem_tfm.bench.error import Measure
from fem_tfm.case import Case
from fem_tfm.flows import duct
from fem_tfm.output.files import on_root

# the gas of Milanovic et al. (2018), as demos/square_duct/gas.toml has it
DEMO: dict[str, Any] = {
    "title": "gas of the square duct of Milanovic et al. (2018)",
    "flow": "duct",
    "geometry": {"shape": "duct", "width": 0.2, "length": 16.0},
    "gas": {"density": 1.2, "viscosity": 1.8e-5},
    "operation": {"gas_superficial_velocity": 22.0},
    "walls": {"distance": 8e-4},
}
CELLS = ("quadrilateral", "triangle")
LEVELS, REFERENCE_LEVEL = (1, 2, 3, 4, 5), 7
PICTURE = Path("results") / "bench" / "duct.png"


def measure(cells: str, level: int) -> Measure:
    """Solve the demo on one mesh level with one shape of cells.

    Raises
    ------
    SolverError
        there is no steady state on that mesh.
    """
    case = Case.from_dict({**DEMO, "numerics": {"level": level, "cells": cells}})
    solution = duct.solve(case)
    found = solution.section
    return Measure(
        cells,
        level,
        found.dofs,
        case.gas_material.density * found.pressure_gradient,
        sum(one.cpu_seconds for one in solution.levels),
        sum(one.section.newton.factorisations for one in solution.levels),
    )


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
    fine = measure(shapes[0], reference_level)
    error.tell(f"reference: level {reference_level}, {fine.unknowns} unknowns, {fine.gradient:.4f}")
    found = []
    for shape in shapes:
        for level in levels:
            found.append(measure(shape, level))
            error.tell(f"{shape} level {level}: {error.error(found[-1], fine.gradient):.1e}")
    on_root(MPI.COMM_WORLD, lambda: error.picture(path, found, fine.gradient, title=DEMO["title"]))
    lines = [*error.table(found, fine.gradient), f"picture in {path}"]
    return "\n".join([*lines, f"{time.perf_counter() - began:.0f} s in all"])

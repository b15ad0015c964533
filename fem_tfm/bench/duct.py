# SPDX-License-Identifier: LGPL-3.0-or-later
"""Run time against error: the pressure gradient of the square duct's gas on a row of meshes.

As for the dense pipe, every mesh is solved by nested iteration from the coarsest one, and the error
is against a finer mesh than any in the table.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fem_tfm.bench import error
from fem_tfm.bench.error import Measure
from fem_tfm.case import Case
from fem_tfm.flows import duct

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
        found.mesh.num_cells,
        found.dofs,
        case.gas_material.density * found.pressure_gradient,
        sum(one.cpu_seconds for one in solution.levels),
        sum(one.section.newton.factorisations for one in solution.levels),
    )


def run() -> str:
    """Measure every mesh, print a line for each, write the picture and return the table."""
    return error.run(LEVELS, REFERENCE_LEVEL, CELLS, PICTURE, measure, DEMO["title"], {})

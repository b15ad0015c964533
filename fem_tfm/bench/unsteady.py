# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cost of the unsteady flow: CPU time and memory a cell and iterations a step, on a row of meshes.

The dense pipe of case 3 is filled from its inlet with kinetic theory and friction; the first steps,
in which solvers are set up, are not counted.
"""

from __future__ import annotations

import resource
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fem_tfm.bench import error
from fem_tfm.case import Case
from fem_tfm.mesh import PipeGeometry, extruded
from fem_tfm.models.unsteady import Feed, Flow3D

DEMO = {
    "title": "filling of the dense pipe, case 3 of Ding et al. (2024)",
    "geometry": {"diameter": 0.01, "length": 0.1},
    "gas": {"density": 33.5, "viscosity": 1.8e-5},
    "solids": {"density": 1700.0, "diameter": 1.6e-4},
    "operation": {"gas_superficial_velocity": 6.43, "solids_fraction": 0.245},
}
FEED = Feed(6.43, 0.245, 6.09)
# level and layers of some 2, 10 and 27 thousand cells
MESHES = ((1, 25), (2, 60), (3, 85))
STEP, FIRST, STEPS = 2e-4, 10, 40


@dataclass(frozen=True)
class Cost:
    """What one mesh takes.

    microseconds : CPU time a cell and step [us]
    kilobytes : memory that the flow adds, a cell [kB]
    iterations : of each equation in the last step
    """

    cells: int
    microseconds: float
    kilobytes: float
    iterations: dict[str, int]


def measure(level: int, layers: int, steps: int = STEPS) -> Cost:
    """Run one mesh.

    Raises
    ------
    StepFailed
        a step has no result.
    """
    case = Case.from_dict(DEMO)
    mesh = extruded(
        PipeGeometry(case.geometry.diameter, "none"),
        case.geometry.length,
        layers,
        level,
        cells="quadrilateral",
        order=1,
    )
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    flow = Flow3D(case, mesh)
    flow.start(1e-8)
    flow.move(np.array([0.0, 0.0, 6.09]), np.array([0.0, 0.0, 6.43]))
    for _ in range(FIRST):
        flow.advance(STEP, FEED)
    began = time.process_time()
    for _ in range(steps):
        report = flow.advance(STEP, FEED)
    spent = flow.cells.total(time.process_time() - began)
    held = flow.cells.total(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    cells = mesh.num_cells
    return Cost(cells, 1e6 * spent / steps / cells, held / cells, dict(report.iterations))


def run(meshes: Sequence[tuple[int, int]] = MESHES, steps: int = STEPS) -> str:
    """Measure every mesh, print a line for each and return the table."""
    lines = [f"{DEMO['title']}, steps of {STEP:g} s", "cells  us/cell/step  kB/cell  iterations"]
    for level, layers in meshes:
        cost = measure(level, layers, steps)
        effort = ", ".join(f"{name} {number}" for name, number in cost.iterations.items())
        lines.append(f"{cost.cells:5d}  {cost.microseconds:.2f}  {cost.kilobytes:.1f}  {effort}")
        error.tell(lines[-1])
    return "\n".join(lines)

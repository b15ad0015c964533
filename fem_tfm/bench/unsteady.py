# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cost of the unsteady flow: CPU time and memory a cell and iterations a step, on a row of meshes.

The dense pipe of case 3 is filled from its inlet with kinetic theory and friction; the first steps,
in which solvers are set up, are not counted. Memory is what the largest mesh adds to that of a
process which has run a small one, and so has loaded every library.
"""

from __future__ import annotations

import resource
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fem_tfm.bench import error
from fem_tfm.case import Case
from fem_tfm.flows.unsteady import problem_of
from fem_tfm.mesh import PipeGeometry, extruded
from fem_tfm.models.finite_volume import Inflow, UnsteadyFlow

DEMO = {
    "title": "filling of the dense pipe, case 3 of Ding et al. (2024)",
    "geometry": {"diameter": 0.01, "length": 0.1},
    "gas": {"density": 33.5, "viscosity": 1.8e-5},
    "solids": {"density": 1700.0, "diameter": 1.6e-4},
    "operation": {"gas_superficial_velocity": 6.43, "solids_fraction": 0.245},
}
INFLOW = Inflow(6.43, 0.245, 6.09)
# level and layers of some 27, 10 and 2 thousand cells, and of 200 and 100 thousand: the largest
# first, since only what exceeds the memory of those before shows
MESHES, LARGE = ((3, 85), (2, 60), (1, 25)), ((3, 625), (3, 313))
STEP, FIRST, STEPS = 2e-4, 10, 40
# stretches of steps of which the fastest counts: other processes only make them slower
STRETCHES = 4
# mesh and steps of the long run, which memory must not grow in
LONG_MESH, LONG = (1, 5), 10000


@dataclass(frozen=True)
class Cost:
    """What one mesh takes.

    microseconds : CPU time a cell and step, of the fastest stretch of steps [us]
    milliseconds : time that a step takes on the ranks at hand, of the fastest stretch [ms]
    kilobytes : by which the largest memory of the process grows, a cell [kB]
    iterations : of each equation, mean over the steps
    """

    cells: int
    microseconds: float
    milliseconds: float
    kilobytes: float
    iterations: dict[str, float]


def filled(level: int, layers: int) -> UnsteadyFlow:
    """The pipe about to be filled: hardly any grains, both phases at the speed of the feed."""
    case = Case.from_dict(DEMO)
    geometry = PipeGeometry(case.geometry.diameter, "none")
    mesh = extruded(geometry, case.geometry.length, layers, level, cells="quadrilateral", order=1)
    flow = UnsteadyFlow(problem_of(case), mesh)
    flow.initialise(1e-8)
    flow.set_velocities(np.array([0.0, 0.0, 6.09]), np.array([0.0, 0.0, 6.43]))
    return flow


def peak() -> float:
    """Largest memory of this process so far [kB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def measure(level: int, layers: int, steps: int = STEPS) -> Cost:
    """Run one mesh.

    Raises
    ------
    StepFailed
        a step has no result.
    """
    before = peak()
    flow = filled(level, layers)
    for _ in range(FIRST):
        flow.advance(STEP, INFLOW)
    cells, iterations, fastest, shortest = flow.mesh.num_cells, dict[str, float](), np.inf, np.inf
    stretch = max(steps // STRETCHES, 1)
    for _ in range(STRETCHES):
        began, since = time.process_time(), time.perf_counter()
        for _ in range(stretch):
            for name, number in flow.advance(STEP, INFLOW).iterations.items():
                share = number / stretch / STRETCHES
                iterations[name] = iterations.get(name, 0.0) + share
        spent = flow.cells.total(time.process_time() - began)
        fastest = min(fastest, spent / stretch)
        shortest = min(shortest, flow.cells.largest(time.perf_counter() - since) / stretch)
    held = flow.cells.total(peak() - before)
    return Cost(cells, 1e6 * fastest / cells, 1e3 * shortest, held / cells, iterations)


def growth(steps: int = LONG) -> float:
    """Memory that the last nine tenths of a long run add [kB].

    Raises
    ------
    StepFailed
        a step has no result.
    """
    flow, early = filled(*LONG_MESH), 0.0
    for step in range(steps):
        if step == steps // 10:
            early = peak()
        flow.advance(STEP, INFLOW)
    return peak() - early


def table(meshes: Sequence[tuple[int, int]], steps: int) -> str:
    """Measure every mesh, print a line for each and return them."""
    filled(*LONG_MESH).advance(STEP, INFLOW)
    lines = [
        f"{DEMO['title']}, steps of {STEP:g} s",
        "cells  us/cell/step  ms/step  kB/cell  iterations",
    ]
    for level, layers in meshes:
        cost = measure(level, layers, steps)
        effort = ", ".join(f"{name} {number:.1f}" for name, number in cost.iterations.items())
        lines.append(
            f"{cost.cells:5d}  {cost.microseconds:.2f}  {cost.milliseconds:.1f}  "
            f"{f'{cost.kilobytes:.1f}' if cost.kilobytes else '-'}  {effort}"
        )
        error.tell(lines[-1])
    return "\n".join(lines)


def run() -> str:
    """A long run on a small mesh, and meshes of 27 thousand cells and fewer."""
    told = f"memory added by the last nine tenths of {LONG} steps: {growth():.0f} kB"
    error.tell(told)
    return f"{told}\n{table(MESHES, STEPS)}"


def run_large() -> str:
    """A few steps on large meshes."""
    return table(LARGE, STRETCHES)

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
from mpi4py import MPI

from fem_tfm.bench.demo import demo
from fem_tfm.bench.error import tell
from fem_tfm.geometry.mesh import extruded_mesh
from fem_tfm.geometry.resolution import Resolution
from fem_tfm.models.finite_volume import Inflow, UnsteadyFlow
from fem_tfm.scenes.unsteady import Unsteady

DEMO, LENGTH = "dense_pipe/startup.toml", 0.1
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


def scene() -> Unsteady:
    """The first part of the line of the demo."""
    changes = {"geometry.length": LENGTH, "output.sections": None, "output.probes": None}
    found = demo(DEMO, changes).scene
    assert isinstance(found, Unsteady)
    return found


def filled(level: int, layers: int) -> tuple[UnsteadyFlow, Inflow]:
    """The pipe about to be filled: hardly any grains, both phases at the speed of the feed."""
    given = scene()
    section, resolution = given.geometry.section("none"), Resolution(level, cells="quadrilateral")
    mesh = extruded_mesh(section, resolution, LENGTH, layers, MPI.COMM_WORLD, order=1)
    flow, inflow = UnsteadyFlow(given.problem(), mesh), given.inflow(np.inf)
    flow.initialise(1e-8)
    axis = np.array([0.0, 0.0, 1.0])
    flow.set_velocities(inflow.solids_velocity * axis, inflow.gas_velocity * axis)
    return flow, inflow


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
    flow, inflow = filled(level, layers)
    for _ in range(FIRST):
        flow.advance(STEP, inflow)
    cells, iterations, fastest, shortest = flow.mesh.num_cells, dict[str, float](), np.inf, np.inf
    stretch = max(steps // STRETCHES, 1)
    for _ in range(STRETCHES):
        began, since = time.process_time(), time.perf_counter()
        for _ in range(stretch):
            for name, number in flow.advance(STEP, inflow).iterations.items():
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
    (flow, inflow), early = filled(*LONG_MESH), 0.0
    for step in range(steps):
        if step == steps // 10:
            early = peak()
        flow.advance(STEP, inflow)
    return peak() - early


def table(meshes: Sequence[tuple[int, int]], steps: int) -> str:
    """Measure every mesh, print a line for each and return them."""
    flow, inflow = filled(*LONG_MESH)
    flow.advance(STEP, inflow)
    lines = [
        f"filling of {LENGTH:g} m of {DEMO}, steps of {STEP:g} s",
        "cells  us/cell/step  ms/step  kB/cell  iterations",
    ]
    for level, layers in meshes:
        cost = measure(level, layers, steps)
        effort = ", ".join(f"{name} {number:.1f}" for name, number in cost.iterations.items())
        lines.append(
            f"{cost.cells:5d}  {cost.microseconds:.2f}  {cost.milliseconds:.1f}  "
            f"{f'{cost.kilobytes:.1f}' if cost.kilobytes else '-'}  {effort}"
        )
        tell(lines[-1])
    return "\n".join(lines)


def run() -> str:
    """A long run on a small mesh, and meshes of 27 thousand cells and fewer."""
    told = f"memory added by the last nine tenths of {LONG} steps: {growth():.0f} kB"
    tell(told)
    return f"{told}\n{table(MESHES, STEPS)}"


def run_large() -> str:
    """A few steps on large meshes."""
    return table(LARGE, STRETCHES)

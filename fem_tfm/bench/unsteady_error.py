# SPDX-License-Identifier: LGPL-3.0-or-later
"""Run time against error of the unsteady flow, of first and of second order.

The first 0.3 m of the dense pipe of case 3 run from rest until they are steady, on a row of meshes
whose cells shrink alike in all directions. The errors are those of the pressure gradient and of the
hold-up over the last 0.1 m, against the march along the same line (`solution = "developing"`). The
walls let the gas slip or, with unsteady-error-log-law, they rub it by the law of a smooth wall at
the same fixed distance here and there.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from fem_tfm.bench.error import tell
from fem_tfm.case import Case
from fem_tfm.flows import developing, unsteady
from fem_tfm.mesh import line
from fem_tfm.models.finite_volume import UnsteadyFlow
from fem_tfm.output.files import on_root, replaced
from fem_tfm.solvers.time_stepping import TimeStepping

LENGTH, COMPARED = 0.3, 0.1
PIPE: dict[str, Any] = {
    "title": "first 0.3 m of the dense pipe, case 3 of Ding et al. (2024)",
    "geometry": {"diameter": 0.01, "length": LENGTH},
    "gas": {"density": 33.5, "viscosity": 1.8e-5},
    "solids": {"density": 1700.0, "diameter": 1.6e-4},
    "operation": {
        "gas_superficial_velocity": 6.43,
        "solids_fraction": 0.245,
        "solids_velocity": 6.09,
    },
}
# divisions of the mesh with the largest cells, for which its size and layers hold
MESHES, COARSEST, LAYERS = (1, 2, 3, 4), 2.4e-3, 75
ORDERS = (0, 1)
# the feeder opens within 5 ms; the gas needs 50 ms from end to end
OPENS, END, COURANT = 0.005, 0.08, 2.0
REFERENCE_LEVEL = 5
# of the wall law [m]; the strip of three of them that it stretches is wider than the largest cells
DISTANCE = 4e-4
PICTURES = Path("results") / "bench"


@dataclass(frozen=True)
class Found:
    """Of the last part of the line: mean pressure gradient [Pa/m] and hold-up [-]."""

    gradient: float
    holdup: float


@dataclass(frozen=True)
class Measure:
    """One run: order, cells, steps, CPU time [s], and what it found."""

    order: int
    cells: int
    steps: int
    cpu_seconds: float
    found: Found


def walls(wall: str) -> dict[str, Any]:
    """Table [walls] of a case with a wall law of the gas."""
    return {"gas": wall, "distance": DISTANCE}


def reference(wall: str, level: int = REFERENCE_LEVEL) -> Found:
    """The march along the line with a wall law of the gas.

    Raises
    ------
    SolverError
        the march does not reach the outlet.
    """
    given = {"solution": "developing", "walls": walls(wall), "numerics": {"level": level}}
    table = developing.solve(Case.from_dict(PIPE | given)).columns()
    z = np.linspace(LENGTH - COMPARED, LENGTH, 101)
    pressure, holdup = (np.interp(z, table["z"], table[name]) for name in ("pressure", "holdup"))
    lost = float(pressure[0] - pressure[-1])
    return Found(lost / COMPARED, float(np.trapezoid(holdup, z) / COMPARED))


def measure(wall: str, order: int, division: int, end: float = END) -> Measure:
    """Run one mesh from rest to `end` [s].

    Raises
    ------
    SolverError
        no step above the smallest succeeds.
    """
    given = {
        "solution": "unsteady",
        "walls": walls(wall),
        "operation": PIPE["operation"] | {"solids_schedule": [[0.0, 0.0], [OPENS, 1.0]]},
        "numerics": {
            "order": order,
            "mesh_size": COARSEST / division,
            "axial_cells": LAYERS * division,
            "end_time": end,
            "courant": COURANT,
        },
    }
    case = Case.from_dict(PIPE | given)
    began = time.process_time()
    flow = UnsteadyFlow(unsteady.problem_of(case), line(case))
    stepping = TimeStepping(unsteady.step_control(case), unsteady.milestones(case))
    unsteady.start(case, flow)
    stepped = unsteady.Stepped(case, flow)
    while not stepping.done:
        stepping.advance(stepped)
    spent = flow.cells.total(time.process_time() - began)
    return Measure(order, flow.mesh.num_cells, stepping.count, spent, means(flow))


def means(flow: UnsteadyFlow) -> Found:
    """What the last part of the line loses, whose outlet has no pressure, and holds."""
    cells, own = flow.cells, flow.line.own
    beyond = flow.mesh.straightened(cells.centre[own])[:, 2] - (LENGTH - COMPARED)
    layer = np.diff(np.unique(np.round(beyond, 9))).max(initial=0.0)

    def mean(values: Any, part: Any) -> float:
        weight = np.where(part, flow.line.volume, 0.0)
        return cells.total(weight * values) / cells.total(weight)

    # the two layers that meet there
    lost = mean(flow.now.p[own], np.abs(beyond) < layer)
    return Found(lost / COMPARED, mean(flow.now.alpha[own], beyond > 0))


def errors(measure: Measure, wanted: Found) -> tuple[float, float]:
    """Relative errors of pressure gradient and hold-up [-]."""
    found = measure.found
    return abs(found.gradient / wanted.gradient - 1), abs(found.holdup / wanted.holdup - 1)


def picture(path: Path, measures: Sequence[Measure], wanted: Found, wall: str) -> None:
    """Draw both errors against the CPU time, all axes logarithmic."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 3.9), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True)
    for k, (axes, name) in enumerate(zip(panels, ("pressure gradient", "hold-up"), strict=True)):
        for order in dict.fromkeys(m.order for m in measures):
            shown = [m for m in measures if m.order == order]
            off = [errors(m, wanted)[k] for m in shown]
            axes.loglog([m.cpu_seconds for m in shown], off, "o-", label=f"order {order}")
            for m, value in zip(shown, off, strict=True):
                axes.annotate(f" {m.cells}", (m.cpu_seconds, value), fontsize=7, color="#666666")
        axes.grid(color="#dddddd", linewidth=0.6, which="both")
        axes.spines[["top", "right"]].set_visible(False)
        # room for the numbers beside the points
        axes.margins(x=0.15)
        axes.set_xlabel("CPU time [s]")
        axes.set_ylabel(f"relative error of the {name}")
    panels[0].legend(frameon=False, fontsize=8)
    figure.suptitle(f"{PIPE['title']}: last {COMPARED:g} m, {wall}", fontsize=10)
    with replaced(path) as temporary:
        figure.savefig(temporary, dpi=150, format="png")


def run(
    wall: str = "free-slip",
    divisions: Sequence[int] = MESHES,
    orders: Sequence[int] = ORDERS,
    end: float = END,
    level: int = REFERENCE_LEVEL,
    pictures: Path = PICTURES,
) -> str:
    """Run every mesh with every order, print a line for each, write the picture, return the table.

    wall : law of the gas
    level : of the reference
    """
    wanted = reference(wall, level)
    lines = [
        f"{PIPE['title']}, {wall}",
        f"reference {wanted.gradient:.1f} Pa/m, hold-up {wanted.holdup:.5f}",
        "order  cells  steps  CPU [s]  Pa/m  error  hold-up  error",
    ]
    tell("\n".join(lines))
    found = []
    for division in divisions:
        for order in orders:
            found.append(one := measure(wall, order, division, end))
            off = errors(one, wanted)
            lines.append(
                f"{order:5d}  {one.cells:5d}  {one.steps:5d}  {one.cpu_seconds:7.1f}  "
                f"{one.found.gradient:6.1f} {off[0]:.1e}  {one.found.holdup:.5f} {off[1]:.1e}"
            )
            tell(lines[-1])
    path = pictures / f"unsteady_error_{wall}.png"
    on_root(MPI.COMM_WORLD, lambda: picture(path, found, wanted, wall))
    return "\n".join([*lines, f"picture in {path}"])

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Run time against error of the unsteady flow, of first and of second order.

The first 0.3 m of the dense pipe of case 3 run from rest until they are steady, on a row of meshes
whose cells shrink alike in all directions. The errors are those of the pressure gradient and of the
hold-up over the last 0.1 m, against the march along the same line (`solution = "developing"`). The
gas has a mixing length. The walls let it slip or, with unsteady-error-log-law, they rub it by the
law of a smooth wall at the same fixed distance here and there.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from fem_tfm.bench.demo import demo
from fem_tfm.bench.error import tell
from fem_tfm.output.files import on_root, replaced

DEMO, COMPARED = "dense_pipe/startup.toml", 0.1
# divisions of the mesh with the largest cells, for which its size and layers hold
MESHES, COARSEST, LAYERS = (1, 2, 3, 4), 2.4e-3, 75
ORDERS = (0, 1)
# the gas needs 50 ms from end to end
END = 0.08
REFERENCE_LEVEL = 5
# what a march does not read
IN_TIME = (
    "initial", "operation.solids_schedule", "numerics.axial_cells", "numerics.end_time",
    "numerics.courant", "output.interval", "output.probes", "output.sections",
)  # fmt: skip
# of both, whatever the demo has: one that the march passes without a wall law of the gas
TURBULENCE = {
    "closures.turbulence": "mixing-length",
    "closures.dispersed": None,
    "closures.dispersion": None,
}
# of the wall law [m]; the strip of three of them that it stretches is wider than the largest cells
DISTANCE = 4e-4


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


def reference(wall: str, level: int = REFERENCE_LEVEL) -> Found:
    """The march along the line with a wall law of the gas.

    Raises
    ------
    SolverError
        the march does not reach the outlet.
    """
    given = dict.fromkeys(IN_TIME) | {"solution": "developing", "numerics.level": level}
    given |= TURBULENCE | {"walls.gas": wall, "walls.distance": DISTANCE}
    scene = demo(DEMO, given).scene
    table, length = scene.run().sections["axis"], scene.geometry.length
    z = np.linspace(length - COMPARED, length, 101)
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
        **TURBULENCE,
        "walls.gas": wall,
        "walls.distance": DISTANCE,
        "numerics.order": order,
        "numerics.mesh_size": COARSEST / division,
        "numerics.axial_cells": LAYERS * division,
        "numerics.end_time": end,
        "output.interval": None,
        "output.probes": None,
        "output.sections": None,
    }
    scene = demo(DEMO, given).scene
    recorder, began = scene.recorder(), time.process_time()
    scene.solve(recorder)
    flow, steps = recorder.section.flow, recorder.stepping.count
    spent = flow.cells.total(time.process_time() - began)
    return Measure(order, flow.mesh.num_cells, steps, spent, means(flow, scene.geometry.length))


def means(flow: Any, length: float) -> Found:
    """What the last part of the line loses, whose outlet has no pressure, and holds."""
    cells, own = flow.cells, flow.line.own
    beyond = flow.mesh.straightened(cells.centre[own])[:, 2] - (length - COMPARED)
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
    figure.suptitle(f"{DEMO}: last {COMPARED:g} m, {wall}", fontsize=10)
    with replaced(path) as temporary:
        figure.savefig(temporary, dpi=150, format="png")


def run(
    out: Path,
    wall: str = "free-slip",
    divisions: Sequence[int] = MESHES,
    orders: Sequence[int] = ORDERS,
    end: float = END,
    level: int = REFERENCE_LEVEL,
) -> str:
    """Run every mesh with every order, print a line for each, write the picture, return the table.

    out : directory of the picture
    wall : law of the gas
    level : of the reference
    """
    wanted = reference(wall, level)
    lines = [
        f"{DEMO}, {wall}",
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
    path = out / f"unsteady_error_{wall}.png"
    on_root(MPI.COMM_WORLD, lambda: picture(path, found, wanted, wall))
    return "\n".join([*lines, f"picture in {path}"])

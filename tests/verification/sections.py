# SPDX-License-Identifier: LGPL-3.0-or-later
"""How the verification tests solve a developed section and read its answer."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import Any

from mpi4py import MPI
from scipy.optimize import brentq

from fem_tfm import Case
from fem_tfm.models.line import Line
from fem_tfm.models.two_fluid.quantities import quantities as section_quantities
from fem_tfm.scenes.recorder import Setting
from fem_tfm.solvers import nested

DEMO = "demos/dense_pipe/algebraic.toml"


def solve(case: Case, comm: MPI.Comm = MPI.COMM_WORLD, meshes: Any = None) -> nested.Solution:
    """Nested iteration of a case without any output, on the case's own meshes or on those given."""
    scene = case.scene
    physics, given = scene.physics, scene.numerics
    meshes = physics.meshes(comm) if meshes is None else meshes
    limits = given.tolerance, given.max_steps
    return nested.solve(meshes, physics.setup(), *limits, nested.Observer(), physics.scheme)


def line_of(case: Case, comm: MPI.Comm = MPI.COMM_WORLD) -> Line:
    """The line of a developing case before its inlet."""
    return case.scene.physics.line(comm)


def march(case: Case, out: Path | None = None, resume: bool = False, most: int = 0) -> Line:
    """The line of a developing case, marched once to its outlet, with its balances checked.

    out : where checkpoints are kept
    most : stations after which the user interrupts, 0 for never
    """
    scene = case.with_values({"numerics.error_estimate": False}).scene
    recorder = scene.recorder(Setting(out, resume=resume))
    accept = recorder.station

    def station(line: Line, stop: Any) -> None:
        accept(line, stop)
        if len(line.rows) - 1 == most:
            raise KeyboardInterrupt

    recorder.station = station
    return scene.solve(recorder).state.line


def drive(solution: nested.Solution) -> float:
    """G [Pa/m] on the finest mesh."""
    return solution.levels[-1].drive


def quantities(solution: nested.Solution) -> dict[str, float]:
    """Quantities of the finest section, per metre of length."""
    return section_quantities(solution.section, 1.0)


def factorisations(solution: nested.Solution) -> list[int]:
    """Factorisations spent on each mesh, coarse to fine."""
    return [level.section.newton.factorisations for level in solution.levels]


def prandtl_karman(reynolds: float) -> float:
    """Darcy friction factor of a smooth pipe, 1/sqrt(f) = 2 log10(Re sqrt(f)) - 0.8."""
    return brentq(
        lambda f: 1 / math.sqrt(f) - 2 * math.log10(reynolds * math.sqrt(f)) + 0.8, 1e-3, 1
    )


def orders(errors: list[float]) -> list[float]:
    """Observed orders between meshes of halved cells."""
    return [math.log2(a / b) for a, b in itertools.pairwise(errors)]

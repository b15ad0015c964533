# SPDX-License-Identifier: LGPL-3.0-or-later
"""How the verification tests solve a developed section and read its answer."""

from __future__ import annotations

import itertools
import math
from typing import Any

from mpi4py import MPI
from scipy.optimize import brentq

from fem_tfm import Case
from fem_tfm.flows import dense, developed

DEMO = "demos/dense_pipe/case3.toml"


def solve(case: Case, comm: MPI.Comm = MPI.COMM_WORLD, meshes: Any = None) -> developed.Solution:
    """Nested iteration of a case without any output, on the case's own meshes or on those given."""
    given = case.numerics
    meshes = dense.meshes(case, comm) if meshes is None else meshes
    return developed.solve(
        meshes, dense.setup_of(case), given.tolerance, given.max_steps, developed.Observer()
    )


def drive(solution: developed.Solution) -> float:
    """G [Pa/m] on the finest mesh."""
    return solution.levels[-1].pressure_gradient


def quantities(solution: developed.Solution) -> dict[str, float]:
    """Quantities of the finest section, per metre of length."""
    return dense.quantities(solution.section, 1.0)


def factorisations(solution: developed.Solution) -> list[int]:
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

# SPDX-License-Identifier: LGPL-3.0-or-later
"""How the pressure gradient of a developed section depends on the numbers of its case.

One solve with the transposed Jacobian gives the derivatives with respect to all of them::

    F(W, G, s; p) = 0, c(W; p) = 0   =>   dG/dp = -(v.dF/dp + w.dc/dp)

(v, w) is the adjoint of G; dF/dp and dc/dp are central differences at a fixed state, which cost two
assemblies each and no solve.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI

from fem_tfm.case import Case
from fem_tfm.errors import InputError
from fem_tfm.flows import dense
from fem_tfm.flows.case_geometry import geometry_of
from fem_tfm.flows.section import Section, Setup

# step of the differences over the number itself
STEP = 1e-4


@dataclass(frozen=True)
class Sensitivity:
    """Derivative of the pressure gradient G with respect to one number p of a case.

    key : of the case file
    value : of the number
    slope : dG/dp [Pa/m per unit of p]
    gradient : G [Pa/m]
    """

    key: str
    value: float
    slope: float
    gradient: float

    @property
    def relative(self) -> float:
        """dlnG/dlnp [-]."""
        return self.slope * self.value / self.gradient

    def change(self, low: float, high: float) -> float:
        """Change of G over a range of p to first order, relative to G [-]."""
        return self.slope * (high - low) / self.gradient


def sensitivities(case: Case, section: Section, keys: Iterable[str]) -> list[Sensitivity]:
    """Derivatives of G at the answer of a case, one for each key.

    section : holds the answer; it is left as it was

    Raises
    ------
    InputError
        a key does not stand for a number, or changes the mesh.
    LinearSolveError
        the Jacobian is singular.
    """
    adjoint = section.newton.adjoint(0)
    gradient = dense.pressure_gradient(section)
    found = []
    try:
        for key in keys:
            value = number(case, key)
            slope = _slope(case, section, key, value, adjoint)
            found.append(Sensitivity(key, value, slope, gradient))
    finally:
        section.update(dense.setup_of(case))
    return found


def number(case: Case, key: str) -> float:
    """The number at a dotted key of a case.

    Raises
    ------
    InputError
        there is none.
    """
    found: Any = case.model_dump()
    for part in key.split("."):
        found = found.get(part) if isinstance(found, dict) else None
    if isinstance(found, bool) or not isinstance(found, int | float):
        raise InputError(key, found, "a key at which the case has a number")
    return float(found)


def _slope(
    case: Case,
    section: Section,
    key: str,
    value: float,
    adjoint: tuple[np.ndarray, np.ndarray],
) -> float:
    step = STEP * (abs(value) or 1.0)
    (low, before), (high, after) = (
        _beside(case, key, value, sign * step, section.mesh.section) for sign in (-1, 1)
    )
    defects, weights = [], []
    for setup in (before, after):
        section.update(setup)
        residual = section.newton.assemble_residual().copy()
        defects.append((residual, np.array(section.newton.constraint_errors())))
        weights.append(dense.pressure_gradient(section))
    forms = section.mesh.mesh.comm.allreduce(
        float(adjoint[0] @ (defects[1][0] - defects[0][0])), MPI.SUM
    )
    borders = float(adjoint[1] @ (defects[1][1] - defects[0][1]))
    return (weights[1] - weights[0] - forms - borders) / (high - low)


def _beside(case: Case, key: str, value: float, step: float, geometry: Any) -> tuple[float, Setup]:
    """A neighbouring number and its setup; the number itself at the end of its range."""
    try:
        near = case.with_values({key: value + step})
    except InputError:
        return value, dense.setup_of(case)
    if geometry_of(near) != geometry:
        raise InputError(key, value, "a key that leaves the mesh as it is")
    return value + step, dense.setup_of(near)

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

import numpy as np
from mpi4py import MPI

from fem_tfm.case import Case
from fem_tfm.errors import InputError
from fem_tfm.models.section import Section
from fem_tfm.scenes.scene import Answer

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


def sensitivities(case: Case, answer: Answer, keys: Iterable[str]) -> list[Sensitivity]:
    """Derivatives of G at the answer of a case, one for each key.

    answer : that of a developed section; it is left as it was

    Raises
    ------
    InputError
        the scene is no developed section, a key does not stand for a number, or changes the mesh.
    LinearSolveError
        the Jacobian is singular.
    """
    solution = getattr(answer.state, "solution", None)
    if solution is None:
        words = "'developed', for sensitivities are those of a developed section"
        raise InputError("solution", case.scene.solution, words)
    section, physics = solution.section, case.scene.physics
    adjoint, found = section.newton.adjoint(0), []
    gradient = physics.signs(section)["pressure_gradient"]
    try:
        for key in keys:
            value = number(case, key)
            slope = _slope(case, section, key, value, adjoint)
            found.append(Sensitivity(key, value, slope, gradient))
    finally:
        section.update(physics.setup())
    return found


def number(case: Case, key: str) -> float:
    """The number at a dotted key of a case.

    Raises
    ------
    InputError
        there is none.
    """
    found = case[key]
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
    near = [_beside(case, key, value, sign * step) for sign in (-1, 1)]
    defects, weights = [], []
    for _, beside in near:
        section.update(beside.scene.physics.setup())
        residual = section.newton.assemble_residual().copy()
        defects.append((residual, np.array(section.newton.constraint_errors())))
        weights.append(beside.scene.physics.signs(section)["pressure_gradient"])
    forms = section.mesh.mesh.comm.allreduce(
        float(adjoint[0] @ (defects[1][0] - defects[0][0])), MPI.SUM
    )
    borders = float(adjoint[1] @ (defects[1][1] - defects[0][1]))
    return (weights[1] - weights[0] - forms - borders) / (near[1][0] - near[0][0])


def _beside(case: Case, key: str, value: float, step: float) -> tuple[float, Case]:
    """A neighbouring number and its case; the number itself at the end of its range."""
    try:
        near = case.with_values({key: value + step})
    except InputError:
        return value, case
    if near.scene.section != case.scene.section:
        raise InputError(key, value, "a key that leaves the mesh as it is")
    return value + step, near

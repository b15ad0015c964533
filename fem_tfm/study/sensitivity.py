# SPDX-License-Identifier: LGPL-3.0-or-later
"""How the pressure gradient of a scene that can tell, a developed section, depends on its numbers.

One solve with the transposed Jacobian gives the derivatives with respect to all of them::

    F(W, G, s; p) = 0, c(W; p) = 0   =>   dG/dp = dL/dp,   L = G - v.F - w.c

(v, w) is the adjoint of G; dL/dp is a central difference at a fixed state, which costs two
assemblies and no solve.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from fem_tfm.case import Case
from fem_tfm.errors import InputError
from fem_tfm.scenes.kinds import KINDS
from fem_tfm.scenes.scene import Answer, Differentiable

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
    """Derivatives of G at the answer of a case, one for each key; the answer stays as it was.

    answer : as `case.scene.carry_out` or `solve` gives it, not closed

    Raises
    ------
    InputError
        the scene has no sensitivities, a key does not stand for a number, or changes the mesh.
    LinearSolveError
        the Jacobian is singular.
    """
    if not case.scene.differentiable:
        words = " or ".join(
            sorted({repr(k.scene.solution) for k in KINDS if k.scene.differentiable})
        )
        allowed = f"{words}, the solution that tells how it depends on its numbers"
        raise InputError("solution", case.scene.solution, allowed)
    state: Differentiable = answer.state
    adjoint = state.adjoint()
    gradient, found = answer.quantities["pressure_gradient"], []
    for key in keys:
        value = number(case, key)
        step = STEP * (abs(value) or 1.0)
        (low, below), (high, above) = (_beside(case, key, value, sign * step) for sign in (-1, 1))
        change = state.lagrangian(above.scene, adjoint) - state.lagrangian(below.scene, adjoint)
        found.append(Sensitivity(key, value, change / (high - low), gradient))
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


def _beside(case: Case, key: str, value: float, step: float) -> tuple[float, Case]:
    """A neighbouring number and its case; the number itself at the end of its range."""
    try:
        near = case.with_values({key: value + step})
    except InputError:
        return value, case
    if near.scene.section != case.scene.section:
        raise InputError(key, value, "a key that leaves the mesh as it is")
    return value + step, near

# SPDX-License-Identifier: LGPL-3.0-or-later
"""How the pressure gradient of a case, a developed section, depends on its numbers."""

from __future__ import annotations

from collections.abc import Iterable

from fem_tfm.case import Case
from fem_tfm.errors import InputError
from fem_tfm.scenes.judged import inputs
from fem_tfm.scenes.judged.inputs import Sensitivity
from fem_tfm.scenes.kinds import KINDS
from fem_tfm.scenes.scene import Answer

__all__ = ["Sensitivity", "sensitivities"]


def sensitivities(case: Case, answer: Answer, keys: Iterable[str]) -> list[Sensitivity]:
    """Derivatives of G at the answer of a case, one for each key; the answer stays as it was.

    answer : as `case.scene.carry_out` or `solve` gives it, not closed

    Raises
    ------
    InputError
        the scene has no sensitivities, a key does not stand for a number, changes the mesh, or is
        one of particles, which the gas of a section does not feel.
    LinearSolveError
        the Jacobian is singular.
    """
    if not case.scene.differentiable:
        words = " or ".join(
            sorted({repr(k.scene.solution) for k in KINDS if k.scene.differentiable})
        )
        allowed = f"{words}, the solution that tells how it depends on its numbers"
        raise InputError("solution", case.scene.solution, allowed)
    return inputs.sensitivities(case.scene, answer, keys)

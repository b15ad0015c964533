# SPDX-License-Identifier: LGPL-3.0-or-later
"""How the pressure gradient of a developed section depends on numbers of its scene.

One solve with the transposed Jacobian gives the derivatives with respect to all of them::

    F(W, G, s; p) = 0, c(W; p) = 0   =>   dG/dp = dL/dp,   L = G - v.F - w.c

(v, w) is the adjoint of G; dL/dp is a central difference at a fixed state, which costs two
assemblies and no solve.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import MISSING, dataclass, replace
from typing import Any, ClassVar

from fem_tfm.errors import InputError
from fem_tfm.output.result import InputRange
from fem_tfm.parameters import Parameters, parameter
from fem_tfm.scenes.reading import put_at, scene_from, tables_of, value_at

# step of the differences over the number itself
STEP = 1e-4


@dataclass(frozen=True)
class Uncertain(Parameters):
    """A number that the source does not print, and between which values it lies."""

    key: str = parameter(MISSING, doc="dotted key of a number of the case")
    low: float = parameter(MISSING, doc="smallest value in the unit of the key")
    high: float = parameter(MISSING, doc="largest value in the unit of the key")
    reason: str = parameter(MISSING, doc="where the range is from")
    table: ClassVar[str] = "uncertain"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.low < self.high:
            raise InputError("uncertain.high", self.high, f"a number above low = {self.low:g}")
        if not self.reason:
            raise InputError("uncertain.reason", self.reason, "a text (where the range is from)")


@dataclass(frozen=True)
class Sensitivity:
    """Derivative of the pressure gradient G with respect to one number p of a scene.

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


def sensitivities(scene: Any, answer: Any, keys: Iterable[str]) -> list[Sensitivity]:
    """Derivatives of G at the answer of a scene, one for each key; the answer stays as it was.

    answer : not closed, with a `Differentiable` state

    Raises
    ------
    InputError
        a key does not stand for a number, changes the mesh, or is one of particles, which the gas
        of a section does not feel.
    LinearSolveError
        the Jacobian is singular.
    """
    adjoint = answer.state.adjoint()
    gradient, found = answer.quantities["pressure_gradient"], []
    for key in keys:
        value = number(scene, key)
        (low, below), (high, above) = neighbours(scene, key)
        change = answer.state.lagrangian(above, adjoint) - answer.state.lagrangian(below, adjoint)
        found.append(Sensitivity(key, value, change / (high - low), gradient))
    return found


def number(scene: Any, key: str) -> float:
    """The number at a dotted key of a scene; raises InputError where there is none."""
    found = value_at(tables_of(scene), key)
    if isinstance(found, bool) or not isinstance(found, int | float):
        raise InputError(key, found, "a key at which the case has a number")
    return float(found)


def neighbours(scene: Any, key: str) -> list[tuple[float, Any]]:
    """Neighbouring numbers and their scenes; the number itself at an end of its range.

    Raises InputError for a key that changes the mesh, and for one that the flow does not feel.
    """
    value, found = number(scene, key), []
    same = replace(with_number(scene, key, value), particles=None)
    step = STEP * (abs(value) or 1.0)
    for other in (value - step, value + step):
        try:
            near = with_number(scene, key, other)
        except InputError:
            found.append((value, scene))
            continue
        if near.section != scene.section:
            raise InputError(key, value, "a key that leaves the mesh as it is")
        if replace(near, particles=None) == same:
            words = "a key that the pressure gradient depends on; particles leave that of a section"
            raise InputError(key, value, f"{words} as it is")
        found.append((other, near))
    return found


def with_number(scene: Any, key: str, value: float) -> Any:
    """The scene with another number at a dotted key, without ranges and published values."""
    tables = tables_of(scene)
    put_at(tables, key, value)
    for name in ("uncertain", "reference"):
        tables.pop(name, None)
    return scene_from(tables)


def check_ranges(scene: Any, ranges: Sequence[Uncertain]) -> None:
    """Refuse ranges of what is no number of the scene, or does not hold it; raises InputError."""
    for at, one in enumerate(ranges):
        where = f"uncertain[{at}]"
        try:
            value = number(scene, one.key)
            neighbours(scene, one.key)
        except InputError as error:
            raise InputError(f"{where}.key", one.key, error.allowed) from None
        if not one.low <= value <= one.high:
            words = f"low and high around {one.key} = {value:g}"
            raise InputError(f"{where}.low", f"{one.low:g} to {one.high:g}", words)


def input_ranges(scene: Any, answer: Any, ranges: Sequence[Uncertain]) -> list[InputRange]:
    """What each range moves the pressure gradient by, to first order."""
    if not ranges:
        return []
    found, told = sensitivities(scene, answer, [one.key for one in ranges]), []
    for one, slope in zip(ranges, found, strict=True):
        down, up = sorted(slope.change(slope.value, end) for end in (one.low, one.high))
        told.append(InputRange(one.key, one.low, one.high, down, up, one.reason))
    return told

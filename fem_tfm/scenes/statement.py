# SPDX-License-Identifier: LGPL-3.0-or-later
"""What every scene may be told beside its model: numbers of the solver, files, published values."""

from __future__ import annotations

from dataclasses import MISSING, dataclass
from typing import Any, ClassVar, Literal

from fem_tfm.errors import InputError, nearest
from fem_tfm.output.result import PER_MATERIAL, QUANTITIES, unit_of
from fem_tfm.parameters import Parameters, parameter

FIELDS = (
    "alpha_s", "u_s", "u_g", "theta", "pressure", "k", "eps", "k_s", "eps_s", "reynolds_stress",
    "temperature", "heat_flux",
)  # fmt: skip
Field = Literal[
    "alpha_s", "u_s", "u_g", "theta", "pressure", "k", "eps", "k_s", "eps_s", "reynolds_stress",
    "temperature", "heat_flux",
]  # fmt: skip


@dataclass(frozen=True)
class Output(Parameters):
    """What is written beside the answer."""

    fields: tuple[Field, ...] = parameter(FIELDS, doc="fields in fields.xdmf")
    pictures: bool = parameter(True, doc="write pictures")
    xdmf: bool = parameter(True, doc="write fields.xdmf")
    stations: int = parameter(
        24, doc="sections of a developing flow in fields.xdmf", ge=1, le=10000
    )
    interval: float | None = parameter(
        None, "s", "time between the fields of an unsteady flow, default 1/20 of all", gt=0, le=1e6
    )
    checkpoint_interval: float | None = parameter(
        None, "s", "time between the checkpoints, default the interval", gt=0, le=1e6
    )
    probes: tuple[tuple[float, float, float], ...] = parameter(
        (), "m", "points [x, y, z] of an unsteady flow, one row a step in probes.csv"
    )
    sections: tuple[float, ...] = parameter(
        (), "m", "places along an unsteady flow, one row an interval in sections.csv"
    )
    table: ClassVar[str] = "output"


@dataclass(frozen=True)
class Reference(Parameters):
    """A published value of a quantity in its SI unit, printed beside the answer."""

    quantity: str = parameter(MISSING, doc="quantity of the result")
    value: float = parameter(MISSING, doc="published value in the quantity's SI unit")
    source: str = parameter(MISSING, doc="where it is published")
    table: ClassVar[str] = "reference"

    def __post_init__(self) -> None:
        super().__post_init__()
        if unit_of(self.quantity) is None:
            known = [*QUANTITIES, *(f"{name}_<material>" for name in PER_MATERIAL)]
            words, near = "one of " + ", ".join(known), nearest(self.quantity, known)
            raise InputError("reference.quantity", self.quantity, words, near)
        if not self.source:
            raise InputError("reference.source", self.source, "a text (where it is published)")


def wall_time_limit() -> Any:
    """The field `time_limit` of every kind of numerics."""
    doc = "wall time after which a run ends with its last state kept, default none"
    return parameter(None, "s", doc, gt=0, le=1e9)


@dataclass(frozen=True)
class SteadyNumerics(Parameters):
    """How strictly a steady section is solved."""

    tolerance: float = parameter(1e-9, "-", "largest update that counts as steady", gt=0, lt=1)
    max_steps: int = parameter(200, doc="largest number of pseudo-time steps", ge=1, le=1000000)
    quadrature_degree: int = parameter(5, doc="degree of the quadrature", ge=1, le=20)
    time_limit: float | None = wall_time_limit()
    table: ClassVar[str] = "numerics"


@dataclass(frozen=True)
class MarchNumerics(Parameters):
    """How strictly stations are solved, and how far they lie apart."""

    tolerance: float = parameter(1e-9, "-", "largest update that counts as steady", gt=0, lt=1)
    quadrature_degree: int = parameter(5, doc="degree of the quadrature", ge=1, le=20)
    axial_step: float | None = parameter(
        None, "m", "largest step along a developing flow, default 1/60 of its length", gt=0, le=1e5
    )
    axial_accuracy: float = parameter(
        0.03, "-", "how far a station may lie off the line through the two before it", gt=0, le=1
    )
    error_estimate: bool = parameter(
        True, doc="march a second time with cells and steps twice as large, for the error"
    )
    time_limit: float | None = wall_time_limit()
    table: ClassVar[str] = "numerics"


@dataclass(frozen=True)
class TimeNumerics(Parameters):
    """The end of an unsteady flow, its order and its steps."""

    end_time: float = parameter(MISSING, "s", "end of an unsteady flow", gt=0, le=1e6)
    order: int = parameter(
        0,
        doc="of an unsteady flow, 0: upwind and implicit Euler, 1: second order in space and time",
        ge=0,
        le=1,
    )
    courant: float = parameter(
        1.0, "-", "largest Courant number of an unsteady flow's steps", gt=0, le=1000
    )
    time_step: float | None = parameter(
        None, "s", "first step in time, default 1/100 of the largest", gt=0, le=1e6
    )
    largest_time_step: float | None = parameter(
        None, "s", "largest step in time, default the interval of the output", gt=0, le=1e6
    )
    smallest_time_step: float = parameter(
        1e-9, "s", "smallest step in time; the run ends below it", gt=0, le=1
    )
    time_limit: float | None = wall_time_limit()
    table: ClassVar[str] = "numerics"

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("time_step", "largest_time_step"):
            step = getattr(self, name)
            if step is not None and step < self.smallest_time_step:
                words = f"at least numerics.smallest_time_step = {self.smallest_time_step:g} s"
                raise InputError(f"numerics.{name}", step, words)

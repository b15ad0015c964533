# SPDX-License-Identifier: LGPL-3.0-or-later
"""A scene that stands in no file of the product: laminar gas in a pipe, by Poiseuille's law."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import MISSING, dataclass
from typing import Any, ClassVar

from fem_tfm.closures.base import Closure
from fem_tfm.errors import SolverError
from fem_tfm.geometry.shapes import Pipe
from fem_tfm.materials import Gas
from fem_tfm.parameters import Parameters, parameter
from fem_tfm.scenes.kinds import Kind
from fem_tfm.scenes.recorder import Recorder, Setting
from fem_tfm.scenes.scene import Answer, Scene


@dataclass(frozen=True)
class LaminarGas(Parameters):
    """A gas whose velocity at the wall is a slip length times the shear rate."""

    gas: Gas = parameter(MISSING, doc="gas", key="gas")
    slip_length: float = parameter(0.0, "m", "slip length", key="walls.slip_length", ge=0, le=1)
    solids: ClassVar[None] = None
    wall_distance: ClassVar[None] = None
    symmetry: ClassVar[str] = "quarter"

    def laws(self) -> Iterator[Closure]:
        """No law."""
        return iter(())

    def wall_offset(self, speed: float, diameter: float) -> float:
        """No wall law."""
        return 0.0


@dataclass(frozen=True)
class Accuracy(Parameters):
    """How the answer is rounded."""

    digits: int = parameter(9, doc="digits of the answer", ge=1, le=15)
    table: ClassVar[str] = "numerics"


@dataclass(frozen=True)
class Analytic(Scene):
    """A flow whose answer is a formula: dp/dz = -32 mu U/(D^2 + 8 D slip_length)."""

    model: LaminarGas
    numerics: Accuracy = parameter(doc="rounding", factory=Accuracy)
    solution: ClassVar[str] = "analytic"

    @property
    def files(self) -> Sequence[str]:
        """No more than every run leaves."""
        return ("result.json", "run.log", "monitor.csv")

    def recorder(self, setting: Setting) -> Recorder:
        """One without a section."""
        return Recorder(self, setting, {"step": ""})

    def solve(self, recorder: Recorder, previous: Answer | None = None) -> Answer:
        """The formula."""
        if self.reynolds > 2300:
            raise SolverError(f"the flow is turbulent at a Reynolds number of {self.reynolds:.0f}")
        width, gas = self.geometry.hydraulic_diameter, self.model.gas
        wide = width**2 + 8 * width * self.model.slip_length
        gradient = 32 * gas.viscosity * self.feed.gas_velocity / wide
        gradient = float(f"{gradient:.{self.numerics.digits}g}")
        found = {
            "pressure_gradient": gradient,
            "pressure_drop": gradient * self.geometry.length,
        }
        return Answer("finished", found, {"gas_mass": 0.0}, "pressure_gradient")

    def describe(self) -> dict[str, Any]:
        """In one line."""
        return {"solved": "laminar gas by Poiseuille's law", "skipped": self.skipped()}

    def skipped(self) -> list[str]:
        """All."""
        return ["everything: the answer is a formula"]

    def advice(self) -> list[str]:
        """None."""
        return []


class Tube:
    """What the model alone tells: nothing."""

    def __init__(self, scene: Any) -> None:
        self.scene = scene


KIND = Kind("laminar", Analytic, LaminarGas, (Pipe,), Tube, unread=("operation.gravity",))

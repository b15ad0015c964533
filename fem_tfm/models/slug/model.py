# SPDX-License-Identifier: LGPL-3.0-or-later
"""Grains as discrete elements in the pressure field of a gas, as a user states them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import MISSING, dataclass
from typing import ClassVar

from fem_tfm.closures.base import Closure, optional_law
from fem_tfm.closures.particles.wear import Wear
from fem_tfm.models.slug.gas import TubeGas
from fem_tfm.models.slug.grains import Grain
from fem_tfm.parameters import Parameters, parameter


@dataclass(frozen=True)
class DiscreteElements(Parameters):
    """Grains that touch each other and the wall, and a gas whose pressure moves them.

    wear : law of what impacts of grains take from the wall, None for none

    Raises InputError for a value out of range.
    """

    gas: TubeGas = parameter(MISSING, doc="gas", key="gas")
    solids: Grain = parameter(MISSING, doc="grains", key="solids")
    wear: Wear | None = parameter(
        None,
        doc="wear of the walls by impacts, none without a law",
        key="walls.wear",
        convert=optional_law("wear"),
    )
    flow: ClassVar[str] = "slug"
    symmetry: ClassVar[str] = "none"
    wall_distance: ClassVar[None] = None

    def laws(self) -> Iterator[Closure]:
        """The laws that are used."""
        yield self.solids.contact
        if self.solids.wall is not None:
            yield self.solids.wall
        yield self.gas.permeability
        if self.wear is not None:
            yield self.wear

    @property
    def turbulent_from(self) -> tuple[float, str]:
        """0: the gas has no turbulence."""
        return 0.0, ""

    def wall_offset(self, speed: float, diameter: float) -> float:
        """0: the wall of the gas is Poiseuille's resistance."""
        return 0.0

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Grains as discrete elements in the pressure field of a gas, as a user states them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import MISSING, dataclass
from typing import ClassVar

from fem_tfm.closures.base import Closure
from fem_tfm.models.slug.gas import TubeGas
from fem_tfm.models.slug.grains import Grain
from fem_tfm.parameters import Parameters, parameter


@dataclass(frozen=True)
class DiscreteElements(Parameters):
    """Grains that touch each other and the wall, and a gas whose pressure moves them.

    Raises InputError for a value out of range.
    """

    gas: TubeGas = parameter(MISSING, doc="gas", key="gas")
    solids: Grain = parameter(MISSING, doc="grains", key="solids")
    flow: ClassVar[str] = "slug"
    symmetry: ClassVar[str] = "none"
    wall_distance: ClassVar[None] = None

    def laws(self) -> Iterator[Closure]:
        """The laws that are used."""
        yield from (self.solids.contact, self.solids.wall_contact, self.gas.permeability)

    def wall_offset(self, speed: float, diameter: float) -> float:
        """0: the wall of the gas is Poiseuille's resistance."""
        return 0.0

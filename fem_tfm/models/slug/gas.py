# SPDX-License-Identifier: LGPL-3.0-or-later
"""The gas of a slug tube, and what bed and wall do to it at a point."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, dataclass
from typing import Any, ClassVar, Literal

from fem_tfm.closures.base import law
from fem_tfm.closures.permeability import Permeability
from fem_tfm.parameters import Parameters, parameter


@dataclass(frozen=True)
class TubeGas(Parameters):
    """The gas of a slug tube.

    balance : "linear" is the paper's eq. (5), "full" keeps the pressure in all coefficients
    porosity_floor : the resistance of the bed is that of this porosity where there is less gas
    """

    viscosity: float = parameter(MISSING, "Pa s", "effective dynamic viscosity", ge=1e-12, le=1)
    density: float = parameter(1.2, "kg/m3", "density at the reference pressure", ge=1e-9, le=2000)
    reference_pressure: float = parameter(
        101325.0, "Pa", "absolute pressure P_0 at the outlet", ge=0.01, le=1e9
    )
    permeability: Permeability = law(
        "permeability", "carman-kozeny", "resistance of the bed", "closures.permeability"
    )
    balance: Literal["linear", "full"] = parameter("linear", doc="form of the gas balance")
    porosity_floor: float = parameter(0.2, "-", "least porosity in the resistance", gt=0, lt=1)
    table: ClassVar[str] = "gas"
    temperature: ClassVar[float] = 293.0

    @property
    def pressure(self) -> float:
        """Absolute pressure at which the gas has its density [Pa]."""
        return self.reference_pressure


def resistance(
    gas: TubeGas,
    diameter: float,
    radius: float,
    porosity: Any,
    slope: Any,
    sqrt: Callable[[Any], Any],
) -> tuple[Any, Any]:
    """Resistance r of bed and wall, -grad P = r q, and the bed's share of it; UFL or arrays.

    The bed resists with a + b |q|, the wall as in Poiseuille's flow, 8 eta/R^2, which is what is
    left without grains.

    diameter, radius : of grains and tube [m]
    slope : |grad P|, which determines |q| [Pa/m]
    """
    a, b = gas.permeability.resistance(porosity, gas, diameter)
    both = a + 8 * gas.viscosity / radius**2
    speed = 2 * slope / (both + sqrt(both**2 + 4 * b * slope))
    bed, total = a + b * speed, both + b * speed
    return total, bed / total

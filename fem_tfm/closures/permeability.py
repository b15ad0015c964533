# SPDX-License-Identifier: LGPL-3.0-or-later
"""Resistance of a bed of grains to the gas that flows through it.

A law gives -grad P = (a + b |q|) q for the volume flux q of the gas relative to the grains.

Symbols: f porosity, q = f (v_g - u) [m/s], a [Pa s/m2], b [Pa s2/m3], eta viscosity [Pa s], rho gas
density [kg/m3], d grain diameter [m].
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any

from fem_tfm.closures.base import Closure, parameter, register
from fem_tfm.closures.ops import Value
from fem_tfm.materials import Fluid


@dataclass(frozen=True)
class Permeability(Closure):
    """Interface of a law of resistance."""

    @abstractmethod
    def resistance(self, porosity: Value, gas: Fluid, diameter: Any) -> tuple[Value, Value]:
        """a [Pa s/m2] and b [Pa s2/m3]."""


@register("permeability", "carman-kozeny")
@dataclass(frozen=True)
class CarmanKozeny(Permeability):
    """Carman and Kozeny's permeability of a packed bed of spheres.

        a = eta/kappa,   kappa = d^2 f^3/(C (1 - f)^2),   b = 0

    Validity: packed beds at small Reynolds numbers; an effective viscosity makes up for more.
    Source: Carman (1937), Trans. Inst. Chem. Eng. 15, 150-166; Strauss, McNamara and Herrmann, Plug
    conveying in a horizontal tube, eq. (4).
    """

    C: float = parameter(180.0, "-", "constant of Carman and Kozeny", gt=0, le=1000)

    def resistance(self, porosity: Value, gas: Fluid, diameter: Any) -> tuple[Value, Value]:
        """eta/kappa and nothing."""
        bed = (1 - porosity) ** 2 / (porosity**3 * diameter**2)
        return self.C * gas.viscosity * bed, 0 * bed


@register("permeability", "ergun")
@dataclass(frozen=True)
class ErgunPermeability(Permeability):
    """Ergun's resistance with its inertial part.

        a = A eta (1 - f)^2/(d^2 f^3),   b = B rho (1 - f)/(d f^3)

    Validity: packed beds at all Reynolds numbers.
    Source: Ergun (1952), Chem. Eng. Prog. 48, 89-94.
    """

    A: float = parameter(150.0, "-", "viscous constant", gt=0, le=1000)
    B: float = parameter(1.75, "-", "inertial constant", ge=0, le=100)

    def resistance(self, porosity: Value, gas: Fluid, diameter: Any) -> tuple[Value, Value]:
        """The viscous and the inertial part."""
        bed = (1 - porosity) / porosity**3
        viscous = self.A * gas.viscosity * bed * (1 - porosity) / diameter**2
        return viscous, self.B * gas.density * bed / diameter

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Granular energy that grains take from the gas they slip through.

Gas around many grains pushes each of them differently. The work of these differences feeds their
fluctuation, in an unsheared suspension alone:

    3/2 d(a rho_s Theta)/dt = ... + P - gamma - 3 beta Theta

Symbols: a = alpha_s, beta drag coefficient [kg/m3/s], u slip between the phases [m/s], d grain
diameter [m], Theta granular temperature [m2/s2], tau = a rho_s/beta relaxation time of a grain [s].
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from fem_tfm.closures.base import Closure, register
from fem_tfm.closures.ops import Value, sqrt
from fem_tfm.materials import Solids

_TINY_SPEED = 1e-30


class Production(NamedTuple):
    """Power that the slip gives to the granular energy.

    power : P [W/m3]
    fall : -dP/dTheta >= 0 [kg/m3/s]
    """

    power: Value
    fall: Value


class SlipProduction(Closure):
    """Interface of a production of granular energy by slip.

    absent : there is none
    """

    absent: ClassVar[bool] = False

    @abstractmethod
    def production(
        self, alpha_s: Value, theta: Value, beta: Value, square: Value, solids: Solids
    ) -> Production:
        """P and its fall with Theta, at the square u^2 of the slip [m2/s2]."""


@register("slip-production", "none")
@dataclass(frozen=True)
class NoSlipProduction(SlipProduction):
    """Shear alone feeds the granular energy.

        P = 0

    Validity: sheared flow, where the work of the shear is larger.
    Source: definition.
    """

    absent: ClassVar[bool] = True

    def production(
        self, alpha_s: Value, theta: Value, beta: Value, square: Value, solids: Solids
    ) -> Production:
        """Zero."""
        return Production(0.0, 0.0)


@register("slip-production", "koch")
@dataclass(frozen=True)
class Koch(SlipProduction):
    """Fluctuating drag of grains that pass each other in a dilute suspension (Koch).

        P = 0.25 beta^2 d u^2/(a rho_s sqrt(pi (Theta + v^2))),   v = d/(4 sqrt(pi) tau)

    v^2 is not printed. It keeps P = beta u^2 v/sqrt(Theta + v^2) below beta u^2, all the work of
    the drag, where the printed P is infinite at Theta = 0. Where drag is the only sink, Theta^(3/2)
    = v u^2/3: then v^2/Theta is (sqrt(3) v/u)^(4/3), small for grains of some inertia.

    Validity: dilute suspensions of grains with large Stokes and small Reynolds number.
    Source: Koch (1990), Phys. Fluids A 2, 1711-1723; as in MFiX and OpenFOAM.
    """

    def production(
        self, alpha_s: Value, theta: Value, beta: Value, square: Value, solids: Solids
    ) -> Production:
        """P and its fall with Theta, at the square u^2 of the slip [m2/s2]."""
        rate = beta / (alpha_s * solids.density)
        speed = solids.diameter * rate / (4 * math.sqrt(math.pi)) + _TINY_SPEED
        energy = theta + speed**2
        power = beta * square * speed / sqrt(energy)
        return Production(power, power / (2 * energy))

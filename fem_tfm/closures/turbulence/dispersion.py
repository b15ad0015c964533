# SPDX-License-Identifier: LGPL-3.0-or-later
"""Turbulent dispersion of the solids.

    force on the solids = -beta D (grad a/a - grad a_g/a_g),  the opposite on the gas

Symbols: a = alpha_s, a_g = 1 - a, beta drag coefficient [kg/m3/s], D diffusivity [m2/s], nu_g and
nu_s eddy viscosities of gas and solids [m2/s], the others as in the family dispersed.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from fem_tfm.closures.base import Closure, parameter, register
from fem_tfm.closures.ops import Value
from fem_tfm.closures.turbulence.dispersed import GasEddies, Grains, eddy_time, relaxation_time


class Dispersion(Closure):
    """Interface of a law of dispersion.

    needs_k : it asks for a gas turbulence that transports k
    """

    needs_k: ClassVar[bool] = False

    @abstractmethod
    def diffusivity(self, gas: GasEddies, grains: Grains, nu_s: Value) -> Value:
        """D [m2/s]."""


@register("dispersion", "none")
@dataclass(frozen=True)
class NoDispersion(Dispersion):
    """Eddies do not carry the grains.

        D = 0

    Validity: heavy grains, laminar gas.
    Source: definition.
    """

    def diffusivity(self, gas: GasEddies, grains: Grains, nu_s: Value) -> Value:
        """Zero."""
        return 0.0


@register("dispersion", "burns")
@dataclass(frozen=True)
class Burns(Dispersion):
    """Favre-averaged drag.

        D = nu_g/sigma

    Validity: any eddy viscosity; grains that follow the eddies.
    Source: Burns et al. (2004), 5th Int. Conf. Multiphase Flow, paper 392.
    """

    sigma: float = parameter(0.9, "-", "Schmidt number", gt=0)

    def diffusivity(self, gas: GasEddies, grains: Grains, nu_s: Value) -> Value:
        """D [m2/s]."""
        return gas.nu / self.sigma


@register("dispersion", "simonin")
@dataclass(frozen=True)
class SimoninDispersion(Dispersion):
    """Drift from the covariance of the velocities of gas and grains.

        D = tau_t k_gs/3,  k_gs = 2 k_g eta/(1 + eta),  eta = tau_t/tau_F

    Validity: dilute to moderately dense flow.
    Source: Simonin and Viollet (1990), Numerical Methods for Multiphase Flows, FED 91, 65-82.
    """

    needs_k: ClassVar[bool] = True

    C_A: float = parameter(0.5, "-", "added mass", ge=0)
    C_beta: float = parameter(0.45, "-", "crossing trajectories, slip along the flow", ge=0)

    def diffusivity(self, gas: GasEddies, grains: Grains, nu_s: Value) -> Value:
        """D [m2/s]."""
        time = eddy_time(gas, grains, self.C_beta)
        eta = time / relaxation_time(gas, grains, self.C_A)
        return 2 / 3 * time * gas.k * eta / (1 + eta)


@register("dispersion", "drift")
@dataclass(frozen=True)
class Drift(Dispersion):
    """Each phase spreads by its own eddies: the force whose work the dispersed laws count.

        D = (a_g nu_s + a nu_g)/sigma
        force on the solids = -beta (nu_s grad a/a - nu_g grad a_g/a_g)/sigma

    Validity: turbulence transported in both phases; nu_s = 0 leaves dilute regions unmixed.
    Source: Ding et al. (2024), Appl. Sci. 14, 2031, drift terms of eqs. (5)-(8).
    """

    needs_k: ClassVar[bool] = True

    sigma: float = parameter(1.0, "-", "Schmidt number", gt=0)

    def diffusivity(self, gas: GasEddies, grains: Grains, nu_s: Value) -> Value:
        """D [m2/s]."""
        return ((1 - grains.alpha) * nu_s + grains.alpha * gas.nu) / self.sigma

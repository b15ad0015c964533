# SPDX-License-Identifier: LGPL-3.0-or-later
"""Grains that take part in the eddies of the gas, each by its own inertia.

    mu_s,t = a rho_s nu_g s,   s = eta/(1 + eta),   eta = tau_t/tau_F
    rho_e  = rho_g + (a/a_g) rho_s s

The eddies of the gas carry the mass of the grains that follow them. Their Reynolds numbers at the
wall, Re_y and y+, are those of a fluid of density rho_e, and so is the logarithmic layer.

Symbols: as in the family dispersed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from fem_tfm.closures.base import parameter, register
from fem_tfm.closures.ops import Value
from fem_tfm.closures.turbulence.dispersed import (
    Dispersed,
    GasEddies,
    Grains,
    eddy_time,
    relaxation_time,
)
from fem_tfm.closures.walls.mixture import Followers


@register("dispersed", "tchen")
@dataclass(frozen=True)
class Tchen(Dispersed):
    """Grains follow the eddies of the gas by their relaxation time (Tchen).

        nu_s = nu_g s,  s = eta/(1 + eta),  eta = tau_t/tau_F,  gain_g = 0
        tau_t = (3/2) nu_g/k_g / sqrt(1 + C_beta 3 u^2/(2 k_g)),  u the slip
        rho_e = rho_g + (a/a_g) rho_s s  in y+ and at the wall

    nu_g s is the part k_gs tau_t/3 of Simonin's viscosity; the rest is uncorrelated motion, which
    the granular temperature transports. For tau_F -> 0 gas and grains are one fluid with the
    density of the mixture; for tau_F -> infinity the law is `none`. There is no sink of k_g: that
    of an exponential correlation tends to 15 Z eps in a fluid of tracers, which has none. A gas law
    without k has k_g = nu_g S/0.3 of the local equilibrium.

    Validity: any inertia of the grains, dilute to moderately dense suspensions.
    Source: Tchen (1947), dissertation, Delft; Hinze (1975), Turbulence, ch. 5; tau_t of Simonin
    (1996), VKI Lecture Series 1996-02.
    """

    needs_k: ClassVar[bool] = False
    follows: ClassVar[bool] = True

    C_A: float = parameter(0.5, "-", "added mass", ge=0)
    C_beta: float = parameter(0.45, "-", "crossing trajectories, slip along the flow", ge=0)

    def share(self, gas: GasEddies, grains: Grains) -> Value:
        """s = eta/(1 + eta) [-]."""
        time = eddy_time(gas, grains, self.C_beta)
        return time / (time + relaxation_time(gas, grains, self.C_A))

    def viscosity(self, gas: GasEddies, grains: Grains) -> Value:
        """nu_s = nu_g s [m2/s]."""
        return gas.nu * self.share(gas, grains)

    def gain(self, gas: GasEddies, grains: Grains) -> Value:
        """Zero."""
        return 0.0

    def at_wall(self, density: Value, grains: Grains) -> Followers:
        """What the logarithmic layer of the mixture needs."""
        added = self.C_A * density
        return Followers(
            loading=grains.loading(density),
            relaxation=(grains.solids.density + added) / grains.specific,
            slip=grains.slip,
            crossing=self.C_beta,
        )

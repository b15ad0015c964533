# SPDX-License-Identifier: LGPL-3.0-or-later
"""Turbulent heat fluxes of the gas.

    u.grad q_i = d_k (C_T k/eps R_kj d_j q_i) + P_i + Phi_i,   q_i = <theta u_i>
    P_i = -R_ik d_k T - q_k d_k U_i

Symbols: T temperature [K], q_i [K m/s], R_ij Reynolds stress [m2/s2], k, eps, L_ij = d_j U_i.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from fem_tfm.closures.base import Closure, parameter, register
from fem_tfm.closures.ops import Tensor, Value, dot
from fem_tfm.closures.turbulence.reynolds_stress import Wall


class HeatFlux(Closure):
    """Interface of the turbulent heat fluxes.

    transported : whether q_i are unknowns; else they follow the gradient of T
    """

    transported: ClassVar[bool] = True


@register("heat-flux", "launder")
@dataclass(frozen=True)
class Launder(HeatFlux):
    """Transport of the three heat fluxes, with reflection by walls.

        Phi_i = -C_T1 eps/k q_i + C_T2 q_k d_k U_i - sum over walls C_T1w eps/k q_k n_k n_i f_z

    f_z is that of the stresses. In the log layer it gives Pr_t = 0.79 with the stresses of `lrr`.

    Validity: forced convection at high Peclet number.
    Source: Launder (1978) in Turbulence, Topics in Applied Physics 12, 231-287; constants as
    printed in Milanovic et al. (2018), Thermal Science 22.
    """

    C_T: float = parameter(0.11, "-", "diffusion of the fluxes", gt=0)
    C_T1: float = parameter(2.45, "-", "decay by pressure", gt=0)
    C_T2: float = parameter(0.66, "-", "share of the production by shear that pressure takes")
    C_T1w: float = parameter(0.8, "-", "reflection of the decay", ge=0)

    def production(
        self, flux: Tensor, stress: Tensor, velocity: Tensor, temperature: Tensor
    ) -> Tensor:
        """P_i of q, R, L_ij and grad T [K m/s2]."""
        return -dot(stress, temperature) - dot(velocity, flux)

    def redistribution(
        self,
        flux: Tensor,
        velocity: Tensor,
        k: Value,
        eps: Value,
        walls: Sequence[tuple[Wall, Value]],
    ) -> Tensor:
        """Phi_i [K m/s2]; `walls` are pairs of a wall and its f_z."""
        total = -self.C_T1 * eps / k * flux + self.C_T2 * dot(velocity, flux)
        for wall, reflection in walls:
            share = self.C_T1w * eps / k * reflection * dot(flux, wall.normal)
            total = total - share * wall.normal
        return total

    def diffusivity(self, stress: Tensor, k: Value, eps: Value) -> Tensor:
        """C_T k/eps R [m2/s]."""
        return self.C_T * k / eps * stress


@register("heat-flux", "gradient")
@dataclass(frozen=True)
class Gradient(HeatFlux):
    """Eddy diffusivity.

        q = -C_mu k^2/(eps Pr_t) grad T

    Validity: flows whose turbulent Prandtl number is known; the companion of k-epsilon.
    Source: definition of the turbulent Prandtl number.
    """

    transported: ClassVar[bool] = False

    Pr_t: float = parameter(0.9, "-", "turbulent Prandtl number", gt=0)

    def diffusivity(self, eddy_viscosity: Value) -> Value:
        """nu_t/Pr_t [m2/s]."""
        return eddy_viscosity / self.Pr_t

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Wall laws of the solids.

A law gives a coefficient c [Pa s/m] of the traction along the wall,

    traction = -c u_t,   u_t velocity along the wall relative to it [m/s],

and the heat flux into the granular energy, the right side of kappa dTheta/dn = heat [W/m2] with n
outward. A law with `strong = True` asks for u_t = 0 instead. Slip speeds are regularised as
sqrt(u^2 + slip_floor^2), so c is finite at rest.

Symbols: a = alpha_s, g0 radial distribution, Theta granular temperature [m2/s2], p_f frictional
pressure [Pa], rho_s [kg/m3], u = |u_t| [m/s], e_w restitution at the wall, mu_w wall friction.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

from fem_tfm.closures.base import Closure, parameter, register
from fem_tfm.closures.granular import lun_pressure
from fem_tfm.closures.ops import Value, erf, exp, radians, smooth_norm, sqrt, tan
from fem_tfm.materials import Solids

_TINY_THETA = 1e-12
_TINY_RATIO = 1e-12


@dataclass(frozen=True)
class WallState:
    """Solids at the wall.

    alpha_s : solids fraction [-]
    theta : granular temperature [m2/s2]
    g0 : radial distribution [-]
    friction_pressure : p_f [Pa]
    slip : |u_t| >= 0 [m/s]
    """

    alpha_s: Any
    theta: Any
    g0: Any
    friction_pressure: Any
    slip: Any


class SolidsWall(Closure):
    """Interface of a wall law of the solids.

    strong : whether it holds the grains at rest
    heats : whether it gives or takes granular energy
    flat : whether grains that bounce off it keep their direction
    densest : mean fraction of the solids up to which it is meant [-]
    """

    strong: ClassVar[bool] = False
    heats: ClassVar[bool] = True
    flat: ClassVar[bool] = False
    densest: ClassVar[float] = 1.0

    @abstractmethod
    def friction(self, state: WallState, solids: Solids) -> Value:
        """Coefficient c [Pa s/m] of the traction -c u_t."""

    @abstractmethod
    def heat(self, state: WallState, solids: Solids) -> Value:
        """Flux into the granular energy [W/m2]."""


def _slip_floor() -> Any:
    return parameter(1e-2, "m/s", "speed that regularises the direction of sliding", gt=0)


@register("solids-wall", "schneiderbauer")
@dataclass(frozen=True)
class Schneiderbauer(SolidsWall):
    """Sliding and sticking collisions with a flat wall, plus Coulomb friction of the bed.

        c    = [eta mu_w a rho_s g0 Theta erf(b) + mu_w p_f]/u
        heat = share mu_w p_f u + a rho_s g0 eta sqrt(Theta)/sqrt(2 pi)
               {exp(-b^2)/c_0^2 [2 u^2 (2 eta - mu_0)
                                 + Theta (14 eta - 4 c_0 (1 + mu_w) - 6 mu_0^2 eta)]
                + Theta [4 (eta - 1) + 6 mu_w^2 eta]}
        b = u/(sqrt(2 Theta) mu_0), eta = (1 + e_w)/2, mu_0 = c_0 mu_w,
        c_0 = (7/2)(1 + e_w)/(1 + beta_0)

    heat is -q_w of the printed flux, whose collisional work tau u cancels its erf term exactly;
    the products exp(-b^2) exp(b^2) and mu_w/mu_0 are multiplied out, so nothing fails at rest,
    without friction or without fluctuations.

    Validity: flat frictional wall; collisions by kinetic theory, lasting contact by p_f.
    Source: Schneiderbauer et al. (2012), Int. J. Multiphase Flow 43, 149-156, with the frictional
    term of eqs. (24)-(26) of Ding et al. (2024), Appl. Sci. 14, 2031.
    """

    flat: ClassVar[bool] = True
    restitution: float = parameter(0.5, "-", "wall restitution e_w", ge=0, le=1)
    friction_coefficient: float = parameter(0.5, "-", "wall friction mu_w", ge=0, le=3)
    tangential_restitution: float = parameter(
        0.3, "-", "tangential restitution beta_0 of sticking collisions", gt=-1, le=1
    )
    sliding_heat: float = parameter(
        1.0, "-", "share of the Coulomb work that heats the grains", ge=0, le=1
    )
    slip_floor: float = _slip_floor()

    def _collision(self, state: WallState) -> tuple[Value, Value, Value, Value]:
        """eta, c_0, the regularised slip and b."""
        eta = (1 + self.restitution) / 2
        c_0 = 7 * eta / (1 + self.tangential_restitution)
        slip = smooth_norm(state.slip, self.slip_floor)
        spread = sqrt(2 * (state.theta + _TINY_THETA)) * (c_0 * self.friction_coefficient)
        return eta, c_0, slip, slip / (spread + _TINY_RATIO)

    def friction(self, state: WallState, solids: Solids) -> Value:
        """Coefficient c [Pa s/m] of the traction -c u_t."""
        eta, _, slip, b = self._collision(state)
        impulse = eta * state.alpha_s * solids.density * state.g0 * state.theta * erf(b)
        return self.friction_coefficient * (impulse + state.friction_pressure) / slip

    def heat(self, state: WallState, solids: Solids) -> Value:
        """Flux into the granular energy [W/m2]."""
        eta, c_0, slip, b = self._collision(state)
        mu, theta, slip2 = self.friction_coefficient, state.theta, state.slip**2
        mu_0 = c_0 * mu
        rate = state.alpha_s * solids.density * state.g0 * eta
        rate = rate * sqrt((theta + _TINY_THETA) / (2 * math.pi))
        sticking = 14 * eta - 4 * c_0 * (1 + mu) - 6 * mu_0**2 * eta
        sticking = exp(-b * b) * (2 * slip2 * (2 * eta - mu_0) + theta * sticking) / c_0**2
        sliding = theta * (4 * (eta - 1) + 6 * mu**2 * eta)
        work = self.sliding_heat * mu * state.friction_pressure * slip2 / slip
        return work + rate * (sticking + sliding)


@register("solids-wall", "johnson-jackson")
@dataclass(frozen=True)
class JohnsonJacksonWall(SolidsWall):
    """Johnson-Jackson partial slip with its flux of granular energy.

        c    = (pi/6) sqrt(3 Theta) psi (a/a_max) rho_s g0 + p_f tan(delta)/u
        heat = (pi/6) sqrt(3 Theta) psi (a/a_max) rho_s g0 u^2
               - (sqrt(3) pi/4) (1 - e_w^2) (a/a_max) rho_s g0 Theta^1.5

    Validity: rough walls; psi is fitted to the wall. delta = 0 leaves sliding friction out.
    Source: Johnson and Jackson (1987), J. Fluid Mech. 176, 67-93.
    """

    specularity: float = parameter(0.05, "-", "specularity psi", ge=0, le=1)
    restitution: float = parameter(0.9, "-", "wall restitution e_w", ge=0, le=1)
    friction_angle_deg: float = parameter(
        0.0, "deg", "angle of wall friction delta of lasting contact", ge=0, lt=90
    )
    slip_floor: float = _slip_floor()

    def _collisional(self, state: WallState, solids: Solids) -> Value:
        """(pi/6) sqrt(3 Theta) (a/a_max) rho_s g0, c of a fully diffuse wall [Pa s/m]."""
        mass = state.alpha_s / solids.packing_limit * solids.density * state.g0
        return math.pi / 6 * sqrt(3 * (state.theta + _TINY_THETA)) * mass

    def friction(self, state: WallState, solids: Solids) -> Value:
        """Coefficient c [Pa s/m] of the traction -c u_t."""
        sliding = state.friction_pressure * tan(radians(self.friction_angle_deg))
        slip = smooth_norm(state.slip, self.slip_floor)
        return self.specularity * self._collisional(state, solids) + sliding / slip

    def heat(self, state: WallState, solids: Solids) -> Value:
        """Flux into the granular energy [W/m2]."""
        gain = self.specularity * state.slip**2
        loss = 1.5 * (1 - self.restitution**2) * state.theta
        return self._collisional(state, solids) * (gain - loss)


@register("solids-wall", "coulomb")
@dataclass(frozen=True)
class Coulomb(SolidsWall):
    """Coulomb sliding under the whole solids pressure.

        c    = mu_w (p_f + p_kin)/u,   p_kin = a rho_s Theta [1 + 2 (1 + e) a g0]
        heat = share mu_w (p_f + p_kin) u

    Validity: a bed that slides as a whole.
    Source: Coulomb (1785); p_kin of Lun et al. (1984), J. Fluid Mech. 140, 223-256.
    """

    friction_coefficient: float = parameter(0.5, "-", "wall friction mu_w", ge=0, le=3)
    sliding_heat: float = parameter(0.0, "-", "share of the work that heats the grains", ge=0, le=1)
    slip_floor: float = _slip_floor()

    def friction(self, state: WallState, solids: Solids) -> Value:
        """Coefficient c [Pa s/m] of the traction -c u_t."""
        kinetic = lun_pressure(state.alpha_s, state.theta, state.g0, solids)
        slip = smooth_norm(state.slip, self.slip_floor)
        return self.friction_coefficient * (state.friction_pressure + kinetic) / slip

    def heat(self, state: WallState, solids: Solids) -> Value:
        """Flux into the granular energy [W/m2]."""
        return self.sliding_heat * self.friction(state, solids) * state.slip**2


@register("solids-wall", "free-slip")
@dataclass(frozen=True)
class SolidsFreeSlip(SolidsWall):
    """Smooth wall without traction on the solids.

        c = heat = 0

    Validity: frictionless elastic walls, symmetry planes.
    Source: definition.
    """

    heats: ClassVar[bool] = False

    def friction(self, state: WallState, solids: Solids) -> Value:
        """Zero."""
        return 0.0

    def heat(self, state: WallState, solids: Solids) -> Value:
        """Zero."""
        return 0.0


@register("solids-wall", "no-slip")
@dataclass(frozen=True)
class SolidsNoSlip(SolidsWall):
    """Wall that holds the solids.

        u_t = 0, heat = 0

    Validity: very rough walls, verification.
    Source: definition.
    """

    strong: ClassVar[bool] = True
    heats: ClassVar[bool] = False

    def friction(self, state: WallState, solids: Solids) -> Value:
        """Zero: the condition is imposed on the velocity."""
        return 0.0

    def heat(self, state: WallState, solids: Solids) -> Value:
        """Zero."""
        return 0.0

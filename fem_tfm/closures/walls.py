# SPDX-License-Identifier: LGPL-3.0-or-later
"""Wall laws of both phases.

A law gives a coefficient c [Pa s/m] of the traction along the wall,

    traction = -c u_t,   u_t velocity along the wall relative to it [m/s],

and a law of the solids also the heat flux into the granular energy, the right side of
kappa dTheta/dn = heat [W/m2] with n outward. A law with `strong = True` asks for u_t = 0 instead.
Slip speeds are regularised as sqrt(u^2 + slip_floor^2), so c is finite at rest.

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
from fem_tfm.materials import Gas, Solids
from fem_tfm.closures.ops import (
    Value,
    erf,
    exp,
    lambert_w,
    ln,
    maximum,
    radians,
    smooth_norm,
    sqrt,
    tan,
)

# width of the strip of the log law over y_p, and the flux it adds to a pipe
STRIP, STRIP_FLUX = 3.0, 5.0
# the same with the fall of the stress over y_p, for a law by the turbulent energy
ENERGY_FLUX = 16.0
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
    """Interface of a wall law of the solids."""

    strong: ClassVar[bool] = False

    @abstractmethod
    def friction(self, state: WallState, solids: Solids) -> Value:
        """Coefficient c [Pa s/m] of the traction -c u_t."""

    @abstractmethod
    def heat(self, state: WallState, solids: Solids) -> Value:
        """Flux into the granular energy [W/m2]."""


@dataclass(frozen=True)
class GasWallState:
    """Gas at the wall.

    speed : of the gas along the wall [m/s]
    distance : height above the wall at which it has this speed [m]
    gas : material
    k : turbulent energy [m2/s2], where it is transported
    """

    speed: Any
    distance: Any
    gas: Gas
    k: Any = None


class GasWall(Closure):
    """Interface of a wall law of the gas.

    needs_k : it asks for a turbulence that transports k
    resolved : the mesh reaches into the viscous sublayer
    """

    strong: ClassVar[bool] = False
    needs_k: ClassVar[bool] = False
    resolved: ClassVar[bool] = False

    def coefficient(self, state: GasWallState) -> Value:
        """Coefficient c [Pa s/m] of the traction -c u_t."""
        return self.friction(state.speed, state.distance, state.gas)

    @abstractmethod
    def friction(self, speed: Value, distance: Value, gas: Gas) -> Value:
        """Coefficient c [Pa s/m] at a speed [m/s] found `distance` [m] off the wall."""

    def stretched(self, distance: Value, offset: Value) -> tuple[Value, Value]:
        """Height y' [m] of the profile that a point `distance` y off the wall carries, and dy'/dy.

        A wall that holds or frees the gas leaves the profile where it is: y' = y.
        """
        return distance, 1.0

    def height(self, offset: Value, diameter: Value) -> Value:
        """Height [m] at which the law is evaluated for the gas on the wall."""
        return offset


class OffsetWall(GasWall):
    """A law of the velocity U at a height, carried to the wall of the mesh.

    The gas on the wall of the mesh has the velocity U(h) of the law. Over a strip of three y_p the
    profile is stretched so that it is U(y) itself beyond the strip, whatever y_p::

        V(y) = U(y'),  y' = y + y_p (1 - y/(3 y_p))^2 within the strip,  h = y_p/(1 + 5 y_p/D)

    U'(y') (mu_g + mu_t(y')) is then the stress of V' = U' dy'/dy. h makes up for the flux that the
    strip adds to a pipe: 4 y_p^2/D of the shear rate in viscous, 5.5 u_tau y_p/(kappa D) in
    logarithmic flow.
    """

    def stretched(self, distance: Value, offset: Value) -> tuple[Value, Value]:
        """y' = y + y_p (1 - y/(3 y_p))^2 within three y_p of the wall [m], and dy'/dy."""
        rest = maximum(1 - distance / (STRIP * offset), 0.0)
        return distance + offset * rest**2, 1 - 2 / STRIP * rest

    def height(self, offset: Value, diameter: Value) -> Value:
        """h = y_p/(1 + 5 y_p/D) [m]."""
        return offset / (1 + STRIP_FLUX * offset / diameter)


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

    restitution: float = parameter(0.5, "-", "wall restitution e_w", ge=0, le=1)
    friction_coefficient: float = parameter(0.5, "-", "wall friction mu_w", ge=0)
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
class JohnsonJackson(SolidsWall):
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

    friction_coefficient: float = parameter(0.5, "-", "wall friction mu_w", ge=0)
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

    def friction(self, state: WallState, solids: Solids) -> Value:
        """Zero: the condition is imposed on the velocity."""
        return 0.0

    def heat(self, state: WallState, solids: Solids) -> Value:
        """Zero."""
        return 0.0


@register("gas-wall", "log-law")
@dataclass(frozen=True)
class LogLaw(OffsetWall):
    """Logarithmic law of a smooth wall, explicit and valid down to the viscous sublayer.

        viscous:  u+ = y+               =>  u+ = sqrt(Re_p),          Re_p = rho_g u y/mu_g
        log:      u+ = ln(E y+)/kappa   =>  kappa u+ = W(kappa E Re_p)
        u+ = (viscous^-n + log^-n)^(-1/n),   c = rho_g u/u+^2

    W is the Lambert function. Its argument carries Re_p + exp(-Re_p) for Re_p, so that the log
    branch does not undercut the viscous one below y+ = 0.1 and c -> mu_g/y as u -> 0.

    n = 5 agrees best with the laws of turbulence: with each, the friction of a smooth pipe is
    within 3 % and u+ within 5 % of ln(9.8 y+)/0.41 from Re 2e4 on.

    Validity: attached flow along smooth walls, y+ < 1e4.
    Source: Launder and Spalding (1974), Comput. Methods Appl. Mech. Eng. 3, 269-289; the blend of
    Churchill and Usagi (1972), AIChE J. 18, 1121-1128.
    """

    kappa: float = parameter(0.41, "-", "von Karman constant", gt=0)
    E: float = parameter(9.8, "-", "constant of a smooth wall", gt=1)
    n: float = parameter(5.0, "-", "sharpness of the blend", ge=1)

    def friction(self, speed: Value, distance: Value, gas: Gas) -> Value:
        """Coefficient c [Pa s/m] at a speed [m/s] found `distance` [m] off the wall."""
        re = gas.density * speed * distance / gas.viscosity
        log = lambert_w(self.kappa * self.E * (re + exp(-re))) / self.kappa
        blend = (1 + (re / log**2) ** (self.n / 2)) ** (2 / self.n)
        return gas.viscosity / distance * blend


@register("gas-wall", "log-law-k")
@dataclass(frozen=True)
class EnergyLogLaw(LogLaw):
    """Logarithmic law with the friction velocity of the turbulent energy and a viscous limit.

        c = mu_g/y [1 + (y*/u*)^n]^(1/n),  u* = ln(1 + E y*)/kappa,
        y* = rho_g C_mu^(1/4) sqrt(k) y/mu_g

    Gas whose turbulence the grains destroy rubs the wall as a laminar layer of thickness y does;
    in a gas alone it is the logarithmic law, for k = u_tau^2/sqrt(C_mu) in equilibrium. y is
    y_p/(1 + 16 y_p/D): beside the flux of the strip it makes up for k, which carries the stress at
    y_p and not the wall's, 2 y_p/D higher.

    Validity: attached flow along smooth walls, y+ > 30 in a gas alone.
    Source: Launder and Spalding (1974), Comput. Methods Appl. Mech. Eng. 3, 269-289.
    """

    needs_k: ClassVar[bool] = True

    C_mu: float = parameter(0.09, "-", "C_mu of the friction velocity", gt=0)

    def coefficient(self, state: GasWallState) -> Value:
        """Coefficient c [Pa s/m] of the traction -c u_t."""
        nu = state.gas.viscosity / state.gas.density
        y_star = self.C_mu**0.25 * sqrt(state.k) * state.distance / nu
        ratio = self.kappa * y_star / ln(1 + self.E * y_star)
        return state.gas.viscosity / state.distance * (1 + ratio**self.n) ** (1 / self.n)

    def height(self, offset: Value, diameter: Value) -> Value:
        """y = y_p/(1 + 16 y_p/D) [m]."""
        return offset / (1 + ENERGY_FLUX * offset / diameter)


@register("gas-wall", "low-reynolds")
@dataclass(frozen=True)
class LowReynolds(OffsetWall):
    """No wall function: the mesh resolves the layer down to the viscous sublayer.

        c = mu_g/y

    y is within the sublayer, where u+ = y+ whatever goes on outside. k has no flux there: it is
    three times what it would be at y, and a correction that falls as 1/y is lost on the flow. The
    law of turbulence must know the layer; the two-equation laws and the mixing length do. Where the
    case gives neither, y_p is at y+ = 2 of the gas alone and so is the wall cell's height.

    Validity: y+ < 4.
    Source: Chen and Patel (1988), AIAA J. 26, 641-648.
    """

    resolved: ClassVar[bool] = True

    def friction(self, speed: Value, distance: Value, gas: Gas) -> Value:
        """Coefficient c = mu_g/y [Pa s/m]."""
        return gas.viscosity / distance


@register("gas-wall", "no-slip")
@dataclass(frozen=True)
class GasNoSlip(GasWall):
    """Wall that holds the gas.

        u_t = 0

    Validity: meshes that resolve the viscous sublayer; laminar flow.
    Source: definition.
    """

    strong: ClassVar[bool] = True

    def friction(self, speed: Value, distance: Value, gas: Gas) -> Value:
        """Zero: the condition is imposed on the velocity."""
        return 0.0


@register("gas-wall", "free-slip")
@dataclass(frozen=True)
class GasFreeSlip(GasWall):
    """Wall without traction on the gas.

        c = 0

    Validity: symmetry planes, verification.
    Source: definition.
    """

    def friction(self, speed: Value, distance: Value, gas: Gas) -> Value:
        """Zero."""
        return 0.0

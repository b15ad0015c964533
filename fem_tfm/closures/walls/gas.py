# SPDX-License-Identifier: LGPL-3.0-or-later
"""Wall laws of the gas.

A law gives a coefficient c [Pa s/m] of the traction along the wall,

    traction = -c u_t,   u_t velocity along the wall relative to it [m/s].

A law with `strong = True` asks for u_t = 0 instead.

Symbols: rho_g [kg/m3], mu_g [Pa s], y height above the wall [m], u = |u_t| [m/s] at y, k turbulent
energy [m2/s2], y_p distance between the wall and that of the mesh [m], D hydraulic diameter [m].
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

from fem_tfm.closures.base import Closure, parameter, register
from fem_tfm.closures.ops import Value, exp, lambert_w, ln, maximum, sqrt
from fem_tfm.materials import Fluid

# width of the strip of the log law over y_p, and the flux it adds to a pipe
STRIP, STRIP_FLUX = 3.0, 5.0
# the same with the fall of the stress over y_p, for a law by the turbulent energy
ENERGY_FLUX = 16.0


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
    gas: Fluid
    k: Any = None


class GasWall(Closure):
    """Interface of a wall law of the gas.

    needs_k : it asks for a turbulence that transports k
    strong : the wall holds the gas
    resolved : the law is that of a mesh which reaches into the viscous sublayer
    """

    strong: ClassVar[bool] = False
    needs_k: ClassVar[bool] = False
    resolved: ClassVar[bool] = False

    def coefficient(self, state: GasWallState) -> Value:
        """Coefficient c [Pa s/m] of the traction -c u_t."""
        return self.friction(state.speed, state.distance, state.gas)

    @abstractmethod
    def friction(self, speed: Value, distance: Value, gas: Fluid) -> Value:
        """Coefficient c [Pa s/m] at a speed [m/s] found `distance` [m] off the wall."""

    def friction_velocity(self, state: GasWallState, friction: Value) -> Value:
        """sqrt(c u/rho_g) of the coefficient c; that of k where the law asks for k [m/s]."""
        return sqrt(friction * state.speed / state.gas.density)

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

    @property
    def sharpness(self) -> Value:
        """m of the blend c^m = (mu_g/y)^m + c_log^m [-]; n/2, for c goes as u+^-2."""
        return self.n / 2

    def friction(self, speed: Value, distance: Value, gas: Fluid) -> Value:
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

    @property
    def sharpness(self) -> Value:
        """m of the blend [-]; n, for c goes as 1/u+."""
        return self.n

    def friction_velocity(self, state: GasWallState, friction: Value) -> Value:
        """C_mu^(1/4) sqrt(k) [m/s]."""
        return self.C_mu**0.25 * sqrt(state.k)

    def coefficient(self, state: GasWallState) -> Value:
        """Coefficient c [Pa s/m] of the traction -c u_t."""
        nu = state.gas.viscosity / state.gas.density
        y_star = self.friction_velocity(state, 0.0) * state.distance / nu
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

    def friction(self, speed: Value, distance: Value, gas: Fluid) -> Value:
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

    def friction(self, speed: Value, distance: Value, gas: Fluid) -> Value:
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

    def friction(self, speed: Value, distance: Value, gas: Fluid) -> Value:
        """Zero."""
        return 0.0

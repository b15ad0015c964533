# SPDX-License-Identifier: LGPL-3.0-or-later
"""Wall functions of the gas: the mesh begins in the log layer, at a stated distance y off the wall.

    u_k = C_mu^(1/4) sqrt(k),   y+ = u_k y/nu,   u+ = ln(E y+)/kappa
    traction/rho = u_k u/u+ = c u,   eps = u_k^3/(kappa y)
    flux/(rho c_p) = u_k (T - T_w)/T+ = h (T - T_w)

The strip between the mesh and the wall carries the log law; its share of the fluxes of mass and
heat is told per area of wall.

Symbols: k turbulent energy at the plane [m2/s2], u velocity along the wall [m/s], nu kinematic
viscosity [m2/s], Pr Prandtl number of the gas.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

from fem_tfm.closures.base import Closure, parameter, register
from fem_tfm.closures.ops import Value, exp, ln, maximum, sqrt

# y+ below which the log law is not followed further down
LOWEST = 11.0


class WallFunction(Closure):
    """Interface of a wall function of the velocity.

    kappa, E : constants of its log law [-]
    """

    kappa: float
    E: float

    @abstractmethod
    def friction(self, k: Value, distance: Value, nu: Value) -> Value:
        """c [m/s] of the traction over the density, c u."""

    @abstractmethod
    def dissipation(self, k: Value, distance: Value) -> Value:
        """eps at the plane [m2/s3]."""

    @abstractmethod
    def strip(self, k: Value, distance: Value, nu: Value) -> Value:
        """Volume flux of the strip per width over the velocity at the plane [m]."""


@register("wall-function", "equilibrium")
@dataclass(frozen=True)
class Equilibrium(WallFunction):
    """Log layer in equilibrium with the turbulent energy at the plane.

        c     = u_k/u+,   u+ = ln(E max(y+, 11))/kappa,   u_k = C_mu^(1/4) sqrt(k)
        eps   = u_k^3/(kappa y)
        strip = y [1 - 1/(kappa u+)]

    C_mu is u_tau^4/k^2 of the stresses' own log layer, so that u_k is the friction velocity there;
    an eddy viscosity's 0.09 is not that of a stress law.

    Validity: smooth walls, 30 < y+ < 0.2 of the half width in wall units.
    Source: Launder and Spalding (1974), Comput. Methods Appl. Mech. Eng. 3, 269-289.
    """

    kappa: float = parameter(0.41, "-", "von Karman constant", gt=0)
    E: float = parameter(9.0, "-", "constant of a smooth wall", gt=1)
    C_mu: float = parameter(0.0, "-", "C_mu of u_k; 0 takes that of the stresses", ge=0)

    def speed(self, k: Value) -> Value:
        """u_k [m/s]."""
        return sqrt(sqrt(self.C_mu) * k)

    def velocity(self, k: Value, distance: Value, nu: Value) -> Value:
        """u+ [-]."""
        y_plus = maximum(self.speed(k) * distance / nu, LOWEST)
        return ln(self.E * y_plus) / self.kappa

    def friction(self, k: Value, distance: Value, nu: Value) -> Value:
        """c [m/s] of the traction over the density, c u."""
        return self.speed(k) / self.velocity(k, distance, nu)

    def dissipation(self, k: Value, distance: Value) -> Value:
        """eps at the plane [m2/s3]."""
        return self.speed(k) ** 3 / (self.kappa * distance)

    def strip(self, k: Value, distance: Value, nu: Value) -> Value:
        """Volume flux of the strip per width over the velocity at the plane [m]."""
        return distance * (1 - 1 / (self.kappa * self.velocity(k, distance, nu)))


class ThermalWall(Closure):
    """Interface of a wall function of the temperature; it stands on one of the velocity."""

    @abstractmethod
    def conductance(
        self, function: Equilibrium, k: Value, distance: Value, nu: Value, prandtl: Value
    ) -> Value:
        """h/(rho c_p) [m/s] of the flux h (T - T_w)."""

    @abstractmethod
    def strip(
        self, function: Equilibrium, k: Value, distance: Value, nu: Value, prandtl: Value
    ) -> Value:
        """Heat that the strip carries per width, over u (T - T_w) at the plane [m]."""


@register("thermal-wall", "jayatilleke")
@dataclass(frozen=True)
class Jayatilleke(ThermalWall):
    """Log law of the temperature with the resistance of the sublayer.

        T+ = Pr_t (u+ + P),   P = 9.24 [(Pr/Pr_t)^(3/4) - 1] [1 + 0.28 exp(-0.007 Pr/Pr_t)]

    Validity: smooth walls, 0.5 < Pr < 1e4, y+ as for the wall function.
    Source: Jayatilleke (1969), Prog. Heat Mass Transfer 1, 193-329.
    """

    Pr_t: float = parameter(0.9, "-", "turbulent Prandtl number of the log layer", gt=0)

    def resistance(self, prandtl: Value) -> Value:
        """P [-]."""
        ratio = prandtl / self.Pr_t
        return 9.24 * (ratio**0.75 - 1) * (1 + 0.28 * exp(-0.007 * ratio))

    def conductance(
        self, function: Equilibrium, k: Value, distance: Value, nu: Value, prandtl: Value
    ) -> Value:
        """h/(rho c_p) [m/s] of the flux h (T - T_w)."""
        u_plus = function.velocity(k, distance, nu)
        return function.speed(k) / (self.Pr_t * (u_plus + self.resistance(prandtl)))

    def strip(
        self, function: Equilibrium, k: Value, distance: Value, nu: Value, prandtl: Value
    ) -> Value:
        """Heat that the strip carries per width, over u (T - T_w) at the plane [m].

        Mean of u+ (u+ + P) over the logarithmic strip, over its value at the plane.
        """
        u, slope = function.velocity(k, distance, nu), 1 / function.kappa
        resistance = self.resistance(prandtl)
        mean = u * u - 2 * slope * u + 2 * slope * slope + resistance * (u - slope)
        return distance * mean / (u * (u + resistance))

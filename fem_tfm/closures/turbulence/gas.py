# SPDX-License-Identifier: LGPL-3.0-or-later
"""Eddy viscosity of the gas.

    sigma_g = 2 a_g (mu_g + mu_t) S_g

A law is algebraic, or it transports scales of the turbulence: then it names their logarithms, which
become unknowns, and says how each spreads and grows.

Symbols: a_g gas fraction, S shear rate sqrt(2 S_g:S_g) [1/s], y distance to the wall [m], R half
the hydraulic diameter [m], rho_g [kg/m3], mu_g [Pa s].
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

from fem_tfm.closures.base import Closure, parameter, register
from fem_tfm.closures.ops import Value, acos, cos, exp, maximum, safe_pow
from fem_tfm.materials import Fluid

_TINY_RE = 1e-4
_KINK = 1e-3


@dataclass(frozen=True)
class Eddies:
    """What a law of turbulence sees at a point.

    strain : S = sqrt(2 S_ij S_ij) [1/s]
    distance : y [m]
    gas : density and viscosity
    radius : R [m]
    spin : U* = sqrt(S_ij S_ij + Omega_ij Omega_ij) [1/s]
    A_s : of the realizable laws, as `realizable_slope` gives it [-]
    k, eps : turbulent energy [m2/s2] and its dissipation [m2/s3], where they are transported
    """

    strain: Any
    distance: Any
    gas: Fluid
    radius: Any
    spin: Any = None
    A_s: Any = None
    k: Any = None
    eps: Any = None


def realizable_slope(skewness: Value) -> Value:
    """A_s = sqrt(6) cos(acos(sqrt(6) W)/3) of sqrt(6) W, from -1 to 1 [-].

    W = S_ij S_jk S_ki/(S_ij S_ij)^1.5; a little inside -1 and 1, where the slope of the arc cosine
    is finite.

    Source: Shih et al. (1995), Computers Fluids 24, 227-238.
    """
    return math.sqrt(6) * cos(acos((1 - _KINK) * skewness) / 3)


@dataclass(frozen=True)
class Balance:
    """Transport of the logarithm of a scale x.

    diffusivity : of x [m2/s]
    rate : sources over x [1/s]
    """

    diffusivity: Any
    rate: Any


class Turbulence(Closure):
    """Interface of a law of turbulence.

    transported : names of the logarithms that it makes unknowns, none for an algebraic law
    """

    transported: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def viscosity(self, eddies: Eddies) -> Value:
        """mu_t [Pa s]."""

    def balances(self, eddies: Eddies, gain: Value) -> dict[str, Balance]:
        """Transport of each logarithm; `gain` is the power that grains give to k, over k [1/s]."""
        return {}

    def wall_values(self, eddies: Eddies) -> dict[str, Value]:
        """Logarithms held at the plane of the wall law; the others have no flux through it."""
        return {}

    def estimate(self, speed: Value, intensity: Value, length: Value) -> dict[str, Value]:
        """Logarithms at an intensity of the mean speed [m/s] and a length of the eddies [m]."""
        return {}


class Algebraic(Turbulence):
    """Interface of an algebraic eddy viscosity."""

    def viscosity(self, eddies: Eddies) -> Value:
        """mu_t [Pa s]."""
        return self.eddy_viscosity(eddies.strain, eddies.distance, eddies.gas, eddies.radius)

    @abstractmethod
    def eddy_viscosity(self, strain: Value, distance: Value, gas: Fluid, radius: Value) -> Value:
        """mu_t [Pa s] at shear rate `strain` [1/s] and wall distance [m]; radius R [m]."""


def nikuradse(distance: Value, radius: Value) -> Value:
    """Mixing length l = R (0.14 - 0.08 eta^2 - 0.06 eta^4), eta = max(0, 1 - y/R) [m]."""
    eta2 = maximum(1 - distance / radius, 0.0) ** 2
    return radius * (0.14 - 0.08 * eta2 - 0.06 * eta2**2)


@register("turbulence", "laminar")
@dataclass(frozen=True)
class Laminar(Algebraic):
    """No turbulence.

        mu_t = 0

    Validity: laminar gas.
    Source: definition.
    """

    def eddy_viscosity(self, strain: Value, distance: Value, gas: Fluid, radius: Value) -> Value:
        """Zero."""
        return 0.0


@register("turbulence", "mixing-length")
@dataclass(frozen=True)
class MixingLength(Algebraic):
    """Prandtl's mixing length with Nikuradse's profile and van Driest's damping.

        mu_t = rho_g l^2 S
        l    = R (0.14 - 0.08 eta^2 - 0.06 eta^4) [1 - exp(-y+/A)],  eta = max(0, 1 - y/R)
        y+   = kappa Re_S (1 - w) + sqrt(Re_S) w,  w = exp(-Re_S/Re_0),  Re_S = rho_g y^2 S/mu_g

    y+ comes from the local shear: Re_S = y+^2 in the viscous sublayer and y+/kappa in the log
    layer, so no wall stress is needed. The estimate runs ahead of y+ in the buffer layer, so
    that A = 33 replaces van Driest's 26: u+ = ln(9.8 y+)/0.41 within 3.2 % for 50 < y+ < 500.

    Validity: fully developed flow in pipes and ducts, smooth walls.
    Source: Nikuradse (1932), VDI-Forschungsheft 356; van Driest (1956), J. Aeronaut. Sci. 23,
    1007-1011.
    """

    A: float = parameter(33.0, "-", "damping constant, fitted to the log law", gt=0)
    kappa: float = parameter(0.41, "-", "von Karman constant", gt=0)
    Re_0: float = parameter(60.0, "-", "Re_S at which the estimate of y+ switches", gt=0)

    def eddy_viscosity(self, strain: Value, distance: Value, gas: Fluid, radius: Value) -> Value:
        """mu_t [Pa s]."""
        damped = self.length(distance, radius) * self.damping(strain, distance, gas)
        return gas.density * damped**2 * strain

    def length(self, distance: Value, radius: Value) -> Value:
        """Nikuradse's mixing length without damping [m]."""
        return nikuradse(distance, radius)

    def damping(self, strain: Value, distance: Value, gas: Fluid) -> Value:
        """van Driest's factor 1 - exp(-y+/A) [-]."""
        re = gas.density * distance**2 * strain / gas.viscosity
        near = exp(-re / self.Re_0)
        y_plus = self.kappa * re * (1 - near) + safe_pow(re, 0.5, _TINY_RE) * near
        return 1 - exp(-y_plus / self.A)

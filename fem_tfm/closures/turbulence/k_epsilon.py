# SPDX-License-Identifier: LGPL-3.0-or-later
"""Two-equation turbulence of the gas: k and its dissipation eps.

    mu_t = rho_g f k^2/eps
    dk/dt   + u.grad k   = div[(nu + nu_t/sigma_k) grad k] + G_k - eps + gain k
    deps/dt + u.grad eps = div[(nu + nu_t/sigma_eps) grad eps] + eps (production - destruction)
                           + C_3 gain eps

with G_k = nu_t S^2, to be read with a_g rho_g in every term; the unknowns are ln k and ln eps, so
both stay positive. `gain` is what the grains give to k, over k.

Next to the wall, where Re_y = y sqrt(k)/nu is small, the length scale is that of the wall::

    eps = k^1.5/l_eps,  l_eps = C_l y_n [1 - exp(-Re_y/(2 C_l))],  C_l = kappa C_mu0^-0.75
    f   = b C_mu + (1 - b) C_mu0 [1 - exp(-Re_y/A)]/[1 - exp(-Re_y/(2 C_l))]

with C_mu0 = 0.09. b(Re_y) switches from 0 to 1 around Re_y = 200; y_n = l/0.4 with Nikuradse's
mixing length l, which is y at the wall and keeps the eddies of a gas without turbulence of its own
within the pipe. The equation of eps is pulled to the wall's value with a time of
l_eps/(hold sqrt(k)), and further out only where the eddies are e times as long: turbulence that
grains destroy would else grow them. Where they do so faster than the pull, mu_t still sees eddies
of at most e times that length.

Symbols: S shear rate [1/s], nu = mu_g/rho_g [m2/s], y distance to the wall [m].
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar

from fem_tfm.closures.base import parameter, register
from fem_tfm.closures.ops import Value, exp, ln, positive_part, softplus, sqrt, tanh
from fem_tfm.closures.turbulence.gas import Balance, Eddies, Turbulence, nikuradse

C_MU = 0.09
# slope of Nikuradse's mixing length at the wall
NEAR_WALL = 0.4
# Re_y at which the wall's length scale gives way, and over which it does
SWITCH, WIDTH = 200.0, 10.0
# logarithm of the largest eddies over those of the wall's length scale
LARGEST = 1.0
# keeps the ratio of two exponentials finite on the wall itself
_TINY_RE = 1e-6
_KINK = 1e-3


def scales(speed: Value, intensity: Value, length: Value) -> tuple[Value, Value]:
    """ln k and ln eps of k = 3/2 (I u)^2 [m2/s2] and eps = C_mu^0.75 k^1.5/length [m2/s3]."""
    k = 1.5 * (intensity * speed) ** 2
    return ln(k), ln(C_MU**0.75 * k**1.5 / length)


@dataclass(frozen=True)
class TwoEquation(Turbulence):
    """Parts that the k-epsilon laws share."""

    transported: ClassVar[tuple[str, ...]] = ("ln_k", "ln_eps")

    kappa: float = parameter(0.41, "-", "von Karman constant of the wall's length scale", gt=0)
    A: float = parameter(70.0, "-", "damping of mu_t next to the wall", gt=0)
    hold: float = parameter(20.0, "-", "strength of the wall's length scale", ge=0)
    C_3: float = parameter(1.3, "-", "share of the gain from grains in the eps equation", ge=0)

    @abstractmethod
    def c_mu(self, eddies: Eddies) -> Value:
        """C_mu [-]."""

    @abstractmethod
    def growth(self, eddies: Eddies) -> Value:
        """Production minus destruction of eps, over eps [1/s]."""

    @property
    @abstractmethod
    def prandtl(self) -> tuple[Value, Value]:
        """sigma_k and sigma_eps."""

    def reynolds(self, eddies: Eddies) -> Value:
        """Re_y = y sqrt(k)/nu [-]."""
        return eddies.gas.density * eddies.distance * sqrt(eddies.k) / eddies.gas.viscosity

    def outer(self, eddies: Eddies) -> Value:
        """Share b of the outer flow [-]."""
        return (1 + tanh((self.reynolds(eddies) - SWITCH) / WIDTH)) / 2

    def _c_l(self) -> Value:
        return self.kappa / C_MU**0.75

    def wall_dissipation(self, eddies: Eddies) -> Value:
        """eps = k^1.5/l_eps [m2/s3]."""
        c_l, re = self._c_l(), self.reynolds(eddies) + _TINY_RE
        length = c_l * nikuradse(eddies.distance, eddies.radius) / NEAR_WALL
        return eddies.k * sqrt(eddies.k) / (length * (1 - exp(-re / (2 * c_l))))

    def kinematic(self, eddies: Eddies) -> Value:
        """nu_t [m2/s]."""
        re, outer = self.reynolds(eddies) + _TINY_RE, self.outer(eddies)
        damped = (1 - exp(-re / self.A)) / (1 - exp(-re / (2 * self._c_l())))
        eddies = replace(eddies, eps=eddies.eps * exp(self.oversize(eddies)))
        share = outer * self.c_mu(eddies) + (1 - outer) * C_MU * damped
        return share * eddies.k**2 / eddies.eps

    def oversize(self, eddies: Eddies) -> Value:
        """Logarithm of the eddies' length over the largest, smoothly zero below it [-]."""
        excess = ln(self.wall_dissipation(eddies) / eddies.eps)
        return softplus(excess - LARGEST, LARGEST / 10)

    def viscosity(self, eddies: Eddies) -> Value:
        """mu_t [Pa s]."""
        return eddies.gas.density * self.kinematic(eddies)

    def balances(self, eddies: Eddies, gain: Value) -> dict[str, Balance]:
        """Transport of ln k and ln eps."""
        nu, nu_t = eddies.gas.viscosity / eddies.gas.density, self.kinematic(eddies)
        frequency = eddies.eps / eddies.k
        energy = nu_t * eddies.strain**2 / eddies.k - frequency + gain
        rate = self.growth(eddies) + self.C_3 * gain + self.pull(eddies)
        sigma_k, sigma_eps = self.prandtl
        return {
            "ln_k": Balance(nu + nu_t / sigma_k, energy),
            "ln_eps": Balance(nu + nu_t / sigma_eps, rate),
        }

    def pull(self, eddies: Eddies) -> Value:
        """Rate at which eps is drawn to the wall's value, and away from larger eddies [1/s]."""
        wall, outer = self.wall_dissipation(eddies), self.outer(eddies)
        excess = (1 - outer) * ln(wall / eddies.eps) + outer * self.oversize(eddies)
        return self.hold * wall / eddies.k * excess

    def wall_values(self, eddies: Eddies) -> dict[str, Value]:
        """ln eps by the wall's length scale; k has no flux into the wall."""
        return {"ln_eps": ln(self.wall_dissipation(eddies))}

    def estimate(self, speed: Value, intensity: Value, length: Value) -> dict[str, Value]:
        """ln k and ln eps."""
        return dict(zip(self.transported, scales(speed, intensity, length), strict=True))


@register("turbulence", "k-epsilon")
@dataclass(frozen=True)
class StandardKEpsilon(TwoEquation):
    """Standard k-epsilon with the wall's length scale next to the wall.

        production - destruction of eps = (C_1 nu_t S^2 - C_2 eps)/k,  C_mu constant

    Validity: attached turbulent flow; y+ of the wall law from 5 to 0.1 Re_tau.
    Source: Launder and Spalding (1974), Comput. Methods Appl. Mech. Eng. 3, 269-289; layer at the
    wall of Chen and Patel (1988), AIAA J. 26, 641-648.
    """

    C_mu: float = parameter(C_MU, "-", "C_mu", gt=0)
    C_1: float = parameter(1.44, "-", "C_1", gt=0)
    C_2: float = parameter(1.92, "-", "C_2", gt=0)
    sigma_k: float = parameter(1.0, "-", "sigma_k", gt=0)
    sigma_eps: float = parameter(1.3, "-", "sigma_eps", gt=0)

    @property
    def prandtl(self) -> tuple[Value, Value]:
        """sigma_k and sigma_eps."""
        return self.sigma_k, self.sigma_eps

    def c_mu(self, eddies: Eddies) -> Value:
        """C_mu [-]."""
        return self.C_mu

    def growth(self, eddies: Eddies) -> Value:
        """(C_1 nu_t S^2 - C_2 eps)/k [1/s]."""
        made = self.C_1 * self.kinematic(eddies) * eddies.strain**2
        return (made - self.C_2 * eddies.eps) / eddies.k


def realizable_c_mu(eddies: Eddies, constant: Value) -> Value:
    """C_mu = 1/(A_0 + A_s U* k/eps) [-]."""
    return 1 / (constant + eddies.A_s * eddies.spin * eddies.k / eddies.eps)


def realizable_growth(eddies: Eddies, c_2: Value, floor: Value) -> Value:
    """C_1 S - C_2 eps/(k + floor), C_1 = max(0.43, eta/(eta + 5)), eta = S k/eps [1/s]."""
    eta = eddies.strain * eddies.k / eddies.eps
    c_1 = 0.43 + positive_part(eta / (eta + 5) - 0.43, _KINK)
    return c_1 * eddies.strain - c_2 * eddies.eps / (eddies.k + floor)


@register("turbulence", "realizable")
@dataclass(frozen=True)
class RealizableKEpsilon(TwoEquation):
    """Realizable k-epsilon with the wall's length scale next to the wall.

        production - destruction of eps = C_1 S - C_2 eps/(k + viscous sqrt(nu eps))
        C_1 = max(0.43, eta/(eta + 5)),  eta = S k/eps
        C_mu = 1/(A_0 + A_s U* k/eps),  A_s = sqrt(6) cos(acos(sqrt(6) W)/3)
        U* = sqrt(S_ij S_ij + Omega_ij Omega_ij),  W = S_ij S_jk S_ki/(S_ij S_ij)^1.5

    sqrt(nu eps) keeps the published destruction finite where k vanishes. Here k > 0 anyway, and the
    term still takes 7 % of the destruction at y+ = 50, which costs 2 % of the friction of a pipe;
    hence it is left out by default. kappa is fitted to the friction of smooth pipes.

    Validity: as the standard law, and no negative normal stresses at any strain.
    Source: Shih et al. (1995), Computers Fluids 24, 227-238; layer at the wall of Chen and Patel
    (1988), AIAA J. 26, 641-648.
    """

    kappa: float = parameter(0.43, "-", "von Karman constant of the wall's length scale", gt=0)
    A_0: float = parameter(4.04, "-", "A_0 of C_mu", gt=0)
    C_2: float = parameter(1.9, "-", "C_2", gt=0)
    sigma_k: float = parameter(1.0, "-", "sigma_k", gt=0)
    sigma_eps: float = parameter(1.2, "-", "sigma_eps", gt=0)
    viscous: float = parameter(
        0.0, "-", "share of sqrt(nu eps) in the destruction, 1 as published", ge=0, le=1
    )

    @property
    def prandtl(self) -> tuple[Value, Value]:
        """sigma_k and sigma_eps."""
        return self.sigma_k, self.sigma_eps

    def c_mu(self, eddies: Eddies) -> Value:
        """C_mu = 1/(A_0 + A_s U* k/eps) [-]."""
        return realizable_c_mu(eddies, self.A_0)

    def growth(self, eddies: Eddies) -> Value:
        """C_1 S - C_2 eps/(k + viscous sqrt(nu eps)) [1/s]."""
        nu = eddies.gas.viscosity / eddies.gas.density
        return realizable_growth(eddies, self.C_2, self.viscous * sqrt(nu * eddies.eps))

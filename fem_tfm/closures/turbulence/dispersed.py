# SPDX-License-Identifier: LGPL-3.0-or-later
"""Turbulence of the solids, what it takes from the gas's, and what it gives to their stress.

    sigma_s = ... + 2 mu_s,t S_s,  mu_s,t = a rho_s nu_s
    gas:    a_g rho_g dk_g/dt = ... + gain_g a_g rho_g k_g
    solids: a rho_s dk_s/dt   = ... + gain_s a rho_s k_s

Both gains contain the work of the drag on the turbulent drift, the same in both phases::

    drift power = -beta (u_s - u_g).grad a (nu_s/a + nu_g/a_g)/sigma

Symbols: a = alpha_s, a_g = 1 - a, beta drag coefficient [kg/m3/s], k turbulent energy and eps its
dissipation, nu_g and nu_s eddy viscosities of gas and solids [m2/s], Z = a rho_s/(a_g rho_g),
tau_F = a (rho_s + C_A rho_g)/beta relaxation time of a grain [s], tau_t time that a grain spends
in an eddy [s], Theta granular temperature [m2/s2].
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

from fem_tfm.closures.base import Closure, parameter, register
from fem_tfm.closures.ops import Value, sqrt
from fem_tfm.closures.turbulence.gas import Balance, Eddies
from fem_tfm.closures.turbulence.k_epsilon import realizable_c_mu, realizable_growth, scales
from fem_tfm.closures.walls.mixture import Followers
from fem_tfm.materials import Solids


@dataclass(frozen=True)
class Grains:
    """What a law of dispersed turbulence sees of the solids at a point.

    alpha, theta, g0 : solids fraction, granular temperature [m2/s2], radial distribution
    specific : beta/alpha_s [kg/m3/s]
    slip : |u_g - u_s| [m/s]
    drift : (u_s - u_g).grad(alpha_s)/alpha_s [1/s]
    solids : material
    viscosity : kinetic viscosity over alpha_s rho_s [m2/s]
    eddies : k, eps, rates of strain of the solids where they are transported, else None
    """

    alpha: Any
    theta: Any
    g0: Any
    specific: Any
    slip: Any
    drift: Any
    solids: Solids
    viscosity: Any = None
    eddies: Eddies | None = None

    def loading(self, density: Any) -> Value:
        """Z = a rho_s/(a_g rho_g) beside gas of a density [-]."""
        return self.alpha * self.solids.density / ((1 - self.alpha) * density)

    @property
    def own(self) -> Eddies:
        """The eddies of the solids, for a law that transports them."""
        assert self.eddies is not None
        return self.eddies


@dataclass(frozen=True)
class GasEddies:
    """Gas turbulence as the grains meet it.

    k, eps, nu : energy [m2/s2], dissipation [m2/s3], eddy viscosity [m2/s]; a gas law that does
        not transport k has that of the local equilibrium, and no eps
    density : rho_g [kg/m3]
    floor : energy that grains leave to the gas [m2/s2]
    """

    k: Any
    eps: Any
    nu: Any
    density: Any
    floor: Any = 0.0


class Dispersed(Closure):
    """Interface of a law of the solids' turbulence.

    transported : names of the logarithms that it makes unknowns
    needs_k : it asks for a gas turbulence that transports k
    still : the solids have no eddy viscosity
    follows : grains share the eddies of the gas, its profile at the wall and its wall law
    normal_stress : share of 2/3 a rho k in the stress of each phase [-]
    """

    transported: ClassVar[tuple[str, ...]] = ()
    needs_k: ClassVar[bool] = True
    still: ClassVar[bool] = False
    follows: ClassVar[bool] = False
    normal_stress: float = 0.0

    @abstractmethod
    def viscosity(self, gas: GasEddies, grains: Grains) -> Value:
        """nu_s [m2/s]."""

    @abstractmethod
    def gain(self, gas: GasEddies, grains: Grains) -> Value:
        """Power given to k_g over a_g rho_g k_g [1/s]."""

    def balances(self, gas: GasEddies, grains: Grains) -> dict[str, Balance]:
        """Transport of each logarithm."""
        return {}

    def estimate(self, speed: Value, intensity: Value, length: Value) -> dict[str, Value]:
        """Logarithms at an intensity of the mean speed [m/s] and a length of the eddies [m]."""
        return {}

    def share(self, gas: GasEddies, grains: Grains) -> Value:
        """Share s of their mass that grains give to the eddies of the gas, if they follow [-]."""
        return 0.0

    def at_wall(self, density: Value, grains: Grains) -> Followers | None:
        """Grains that follow the eddies of a gas of a density [kg/m3] at a wall, or None."""
        return None


def relaxation_time(gas: GasEddies, grains: Grains, added_mass: Value) -> Value:
    """tau_F = a (rho_s + C_A rho_g)/beta [s]."""
    return (grains.solids.density + added_mass * gas.density) / grains.specific


def eddy_time(gas: GasEddies, grains: Grains, crossing: Value) -> Value:
    """tau_t = (3/2) nu_g/k_g / sqrt(1 + C_beta xi^2), xi^2 = 3 u^2/(2 k_g), u the slip [s]."""
    xi2 = 1.5 * grains.slip**2 / gas.k
    return 1.5 * gas.nu / gas.k / sqrt(1 + crossing * xi2)


def drift_power(gas: GasEddies, grains: Grains, nu_s: Value, sigma: Value) -> Value:
    """Power of the drag on the drift over a [W/m3]."""
    spread = nu_s + gas.nu * grains.alpha / (1 - grains.alpha)
    return -grains.specific * grains.drift * spread / sigma


def _per_gas(power: Value, gas: GasEddies, grains: Grains) -> Value:
    """A power over a as a rate of k_g [1/s]."""
    return power * grains.alpha / ((1 - grains.alpha) * gas.density * gas.k)


@register("dispersed", "none")
@dataclass(frozen=True)
class NoDispersed(Dispersed):
    """The solids neither share nor damp the turbulence of the gas.

        mu_s,t = 0, gain_g = 0

    Validity: dense beds, or grains too heavy and too few to matter.
    Source: definition.
    """

    needs_k: ClassVar[bool] = False
    still: ClassVar[bool] = True

    def viscosity(self, gas: GasEddies, grains: Grains) -> Value:
        """Zero."""
        return 0.0

    def gain(self, gas: GasEddies, grains: Grains) -> Value:
        """Zero."""
        return 0.0


@register("dispersed", "simonin")
@dataclass(frozen=True)
class Simonin(Dispersed):
    """Solids in local equilibrium with the gas's turbulence (Tchen-Simonin).

        eta = tau_t/tau_F,  b = (1 + C_A)/(rho_s/rho_g + C_A)
        k_s  = k_g (b^2 + eta)/(1 + eta)
        k_gs = 2 [k_g (b + eta) + agitation eta Z q]/[1 + eta (1 + agitation Z)],  q = (3/2) Theta
        nu_s = [k_gs tau_t + k_s tau_F]/3 / (1 + tau_F sigma_c/(2 tau_c))
        gain_g = [damping beta (k_gs - 2 k_g) + drift drift power]/(a_g rho_g k_g)
        1/tau_c = 24 a g0 sqrt(Theta/pi)/d,  sigma_c = (1 + e)(3 - e)/5

    The grains take 2 beta k_g from the gas and give beta k_gs back; in the gain k_g counts from the
    floor, which they leave to the gas. With agitation = 1 their own random motion q takes part: it
    keeps k_g from vanishing where the loading Z is high. Collisions cut the path on which a grain
    carries momentum.

    Validity: grains slower than the eddies; agitation = 0 for dilute flow, Z < 1.
    Source: Simonin (1996), VKI Lecture Series 1996-02; Peirano and Leckner (1998), Prog. Energy
    Combust. Sci. 24, 259-296.
    """

    damping: float = parameter(1.0, "-", "share of the sink of k_g", ge=0, le=1)
    agitation: float = parameter(1.0, "-", "share of the grains' own agitation", ge=0, le=1)
    drift: float = parameter(1.0, "-", "share of the drift power", ge=0, le=1)
    C_A: float = parameter(0.5, "-", "added mass", ge=0)
    C_beta: float = parameter(0.45, "-", "crossing trajectories, slip along the flow", ge=0)
    sigma: float = parameter(0.75, "-", "Schmidt number of the drift", gt=0)

    def covariance(self, gas: GasEddies, grains: Grains) -> Value:
        """k_gs [m2/s2]."""
        return self._shared(gas.k, gas, grains)

    def _shared(self, k: Value, gas: GasEddies, grains: Grains) -> Value:
        """k_gs of an energy k of the same eddies [m2/s2]."""
        eta, b, loading = self._ratios(gas, grains)
        shared = self.agitation * eta * loading
        return 2 * (k * (b + eta) + shared * 1.5 * grains.theta) / (1 + eta + shared)

    def _ratios(self, gas: GasEddies, grains: Grains) -> tuple[Value, Value, Value]:
        """eta, b and Z [-]."""
        time = eddy_time(gas, grains, self.C_beta)
        ratio = grains.solids.density / gas.density
        eta = time / relaxation_time(gas, grains, self.C_A)
        loading = grains.alpha * ratio / (1 - grains.alpha)
        return eta, (1 + self.C_A) / (ratio + self.C_A), loading

    def viscosity(self, gas: GasEddies, grains: Grains) -> Value:
        """nu_s [m2/s]."""
        eta, b, _ = self._ratios(gas, grains)
        time = relaxation_time(gas, grains, self.C_A)
        k_s = gas.k * (b**2 + eta) / (1 + eta)
        k_gs = 2 * gas.k * (b + eta) / (1 + eta)
        e = grains.solids.restitution
        collisions = 24 * grains.alpha * grains.g0 * sqrt(grains.theta / math.pi)
        collisions = collisions / grains.solids.diameter
        limit = 1 + time * collisions * (1 + e) * (3 - e) / 10
        return (k_gs * eta * time + k_s * time) / (3 * limit)

    def gain(self, gas: GasEddies, grains: Grains) -> Value:
        """Power given to k_g over a_g rho_g k_g [1/s]."""
        free = gas.k - gas.floor
        sink = self.damping * grains.specific * (self._shared(free, gas, grains) - 2 * free)
        drift = drift_power(gas, grains, self.viscosity(gas, grains), self.sigma)
        return _per_gas(sink + self.drift * drift, gas, grains)


@register("dispersed", "k-epsilon")
@dataclass(frozen=True)
class DispersedKEpsilon(Dispersed):
    """k and epsilon of the solids, the second half of the four-equation model.

        dk_s/dt   = G_k - eps_s + gain_s k_s + diffusion
        deps_s/dt = eps_s (C_1 S - C_2 eps_s/k_s) + C_3 gain_s eps_s + diffusion
        gain_s = [C_gs k_g - C_sg k_s + drift power/beta]/(tau_s k_s),  tau_s = a rho_s/beta
        gain_g = beta [C_sg k_s - C_gs k_g + drift power/beta]/(a_g rho_g k_g)
        C_gs = 2 eta/(1 + eta),  eta = tau_t/tau_F,  nu_s = C_mu k_s^2/eps_s

    with the realizable C_1 and C_mu of the solids' own rates of strain. No flux of k_s and eps_s
    through walls. Boussinesq's stress has the part -(2/3) a rho k I in each phase, which the
    published stresses leave out; in the solids it lifts the bed as a pressure does.

    Validity: as published for dense-phase conveying.
    Source: Ding et al. (2024), Appl. Sci. 14, 2031, eqs. (5)-(8); exchange of Simonin (1996), VKI
    Lecture Series 1996-02.
    """

    transported: ClassVar[tuple[str, ...]] = ("ln_k_s", "ln_eps_s")

    C_sg: float = parameter(2.0, "-", "C_sg", ge=0)
    C_3: float = parameter(1.3, "-", "C_3", ge=0)
    drift: float = parameter(1.0, "-", "share of the drift power", ge=0, le=1)
    C_A: float = parameter(0.5, "-", "added mass", ge=0)
    C_beta: float = parameter(0.45, "-", "crossing trajectories, slip along the flow", ge=0)
    A_0: float = parameter(4.04, "-", "A_0 of C_mu", gt=0)
    C_2: float = parameter(1.9, "-", "C_2", gt=0)
    sigma_k: float = parameter(1.0, "-", "sigma_k", gt=0)
    sigma_eps: float = parameter(1.2, "-", "sigma_eps", gt=0)
    normal_stress: float = parameter(
        0.0, "-", "share of 2/3 a rho k in the stress of each phase, 0 as published", ge=0, le=1
    )

    def viscosity(self, gas: GasEddies, grains: Grains) -> Value:
        """nu_s [m2/s]."""
        own = grains.own
        return realizable_c_mu(own, self.A_0) * own.k**2 / own.eps

    def _power(self, gas: GasEddies, grains: Grains, received: Value) -> Value:
        """Exchange received by a phase plus the drift power, over a [W/m3]."""
        drift = drift_power(gas, grains, self.viscosity(gas, grains), self.sigma_k)
        return grains.specific * received + self.drift * drift

    def exchange(self, gas: GasEddies, grains: Grains) -> Value:
        """C_sg k_s - C_gs k_g [m2/s2]."""
        time = relaxation_time(gas, grains, self.C_A)
        eta = eddy_time(gas, grains, self.C_beta) / time
        return self.C_sg * grains.own.k - 2 * eta / (1 + eta) * gas.k

    def gain(self, gas: GasEddies, grains: Grains) -> Value:
        """Power given to k_g over a_g rho_g k_g [1/s]."""
        return _per_gas(self._power(gas, grains, self.exchange(gas, grains)), gas, grains)

    def balances(self, gas: GasEddies, grains: Grains) -> dict[str, Balance]:
        """Transport of ln k_s and ln eps_s."""
        own, nu_t = grains.own, self.viscosity(gas, grains)
        power = self._power(gas, grains, -self.exchange(gas, grains))
        gain = power / (grains.solids.density * own.k)
        energy = nu_t * own.strain**2 / own.k - own.eps / own.k + gain
        rate = realizable_growth(own, self.C_2, 0.0) + self.C_3 * gain
        return {
            "ln_k_s": Balance(grains.viscosity + nu_t / self.sigma_k, energy),
            "ln_eps_s": Balance(grains.viscosity + nu_t / self.sigma_eps, rate),
        }

    def estimate(self, speed: Value, intensity: Value, length: Value) -> dict[str, Value]:
        """ln k_s and ln eps_s."""
        return dict(zip(self.transported, scales(speed, intensity, length), strict=True))

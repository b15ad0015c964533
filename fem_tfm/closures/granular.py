# SPDX-License-Identifier: LGPL-3.0-or-later
"""Kinetic theory of granular flow: stresses, conduction and dissipation of the granular energy.

    sigma_kin = (-p + lambda D) I + 2 mu S
    3/2 [d(a rho_s Theta)/dt + div(a rho_s u_s Theta)]
        = sigma_kin : grad u_s + div(kappa grad Theta) - gamma - 3 beta Theta

Viscosities and conductivity are those of the whole phase (they contain alpha_s). In every law
p ~ Theta, mu, lambda, kappa ~ sqrt(Theta) and gamma ~ Theta^1.5.

Symbols: a = alpha_s, e restitution, d grain diameter [m], rho_s [kg/m3], Theta granular temperature
[m2/s2], g0 radial distribution, S = dev(sym(grad u_s)) [1/s], D = div u_s [1/s],
eta = (1 + e)/2.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, NamedTuple

from fem_tfm.closures.base import Closure, register
from fem_tfm.closures.ops import Value, sqrt, where_greater
from fem_tfm.materials import Solids

_SQRT_PI = math.sqrt(math.pi)
_TINY_THETA = 1e-16
_TINY_DISSIPATION = 1e-100


class Kinetic(NamedTuple):
    """Coefficients of the kinetic theory.

    pressure : p [Pa]
    shear_viscosity : mu [Pa s]
    bulk_viscosity : lambda [Pa s]
    conductivity : kappa [kg/m/s]
    dissipation : gamma [W/m3]
    """

    pressure: Any
    shear_viscosity: Any
    bulk_viscosity: Any
    conductivity: Any
    dissipation: Any


class Granular(Closure):
    """Interface of a kinetic theory."""

    @abstractmethod
    def coefficients(
        self, alpha_s: Value, theta: Value, g0: Value, solids: Solids, length: Value
    ) -> Kinetic:
        """Coefficients at granular temperature `theta` [m2/s2], pipe diameter `length` [m]."""

    @abstractmethod
    def dilute(
        self, alpha_s: Value, theta: Value, solids: Solids, length: Value
    ) -> tuple[Value, Value]:
        """mu_d [Pa s] and kappa_d [kg/m/s] of grains that carry by their flights alone.

        The kinetic parts of mu and kappa tend to them as a -> 0, where g0 = 1 and d << R; at any a
        they are without what collisions add to the flights.
        """

    def pressure(self, alpha_s: Value, theta: Value, g0: Value, solids: Solids) -> Value:
        """p [Pa], that of the coefficients, without the others."""
        return lun_pressure(alpha_s, theta, g0, solids)


def speed(theta: Value) -> Value:
    """sqrt(Theta) [m/s] with a finite slope at Theta = 0."""
    return sqrt(theta + _TINY_THETA)


def lun_pressure(alpha_s: Value, theta: Value, g0: Value, solids: Solids) -> Value:
    """p = a rho_s Theta [1 + 2 (1 + e) a g0] [Pa] (Lun et al. 1984)."""
    return alpha_s * solids.density * theta * (1 + 2 * (1 + solids.restitution) * alpha_s * g0)


def collisional_viscosity(alpha_s: Value, theta: Value, g0: Value, solids: Solids) -> Value:
    """mu_col = (4/5) a^2 rho_s d g0 (1 + e) sqrt(Theta/pi) [Pa s]; lambda is 5/3 of it."""
    scale = solids.density * solids.diameter * (1 + solids.restitution) * speed(theta) / _SQRT_PI
    return 0.8 * alpha_s**2 * g0 * scale


def lun_dissipation(alpha_s: Value, theta: Value, g0: Value, solids: Solids) -> Value:
    """gamma = 12 (1 - e^2) g0 rho_s a^2 Theta^1.5/(d sqrt(pi)) [W/m3] (Lun et al. 1984)."""
    rate = 12 * (1 - solids.restitution**2) * g0 * speed(theta) / (solids.diameter * _SQRT_PI)
    return rate * solids.density * alpha_s**2 * theta


@register("granular", "gidaspow")
@dataclass(frozen=True)
class GidaspowKinetics(Granular):
    """Gidaspow viscosity and conductivity with Lun's pressure, bulk viscosity and dissipation.

        p      = a rho_s Theta [1 + 2 (1 + e) a g0]
        lambda = (4/3) a^2 rho_s d g0 (1 + e) sqrt(Theta/pi)
        mu     = (3/5) lambda + 10 rho_s d sqrt(pi Theta)/[96 (1 + e) g0] [1 + (4/5) a g0 (1 + e)]^2
        kappa  = 150 rho_s d sqrt(pi Theta)/[384 (1 + e) g0] [1 + (6/5) a g0 (1 + e)]^2
                 + 2 a^2 rho_s d g0 (1 + e) sqrt(Theta/pi)
        gamma  = 12 (1 - e^2) g0 rho_s a^2 Theta^1.5/(d sqrt(pi))

    Validity: nearly elastic spheres, e > 0.9; used far below that in practice. mu stays finite
    as a -> 0, where no grain limits its free path.
    Source: Gidaspow (1994), Multiphase Flow and Fluidization; Lun et al. (1984), J. Fluid Mech.
    140, 223-256.
    """

    def coefficients(
        self, alpha_s: Value, theta: Value, g0: Value, solids: Solids, length: Value
    ) -> Kinetic:
        """Coefficients at granular temperature `theta` [m2/s2]; `length` is not used."""
        e1 = 1 + solids.restitution
        thermal = solids.density * solids.diameter * _SQRT_PI * speed(theta) / (e1 * g0)
        collisional = collisional_viscosity(alpha_s, theta, g0, solids)
        return Kinetic(
            pressure=lun_pressure(alpha_s, theta, g0, solids),
            shear_viscosity=collisional + 10 / 96 * thermal * (1 + 0.8 * alpha_s * g0 * e1) ** 2,
            bulk_viscosity=5 / 3 * collisional,
            conductivity=150 / 384 * thermal * (1 + 1.2 * alpha_s * g0 * e1) ** 2
            + 2.5 * collisional,
            dissipation=lun_dissipation(alpha_s, theta, g0, solids),
        )

    def dilute(
        self, alpha_s: Value, theta: Value, solids: Solids, length: Value
    ) -> tuple[Value, Value]:
        """mu_d and kappa_d; only Theta counts."""
        unit = _flights(theta, solids) / (1 + solids.restitution)
        return 10 / 96 * unit, 150 / 384 * unit


def _flights(theta: Value, solids: Solids) -> Value:
    """rho_s d sqrt(pi Theta) [Pa s]."""
    return solids.density * solids.diameter * _SQRT_PI * speed(theta)


def _lun_dilute(theta: Value, solids: Solids) -> tuple[Value, Value]:
    """Lun's mu_d and kappa_d."""
    eta, unit = (1 + solids.restitution) / 2, _flights(theta, solids)
    return 5 / 96 * unit / (eta * (2 - eta)), 25 / 16 * unit / (eta * (41 - 33 * eta))


def _lun_coefficients(
    alpha_s: Value, theta: Value, g0: Value, solids: Solids, free_path: Value
) -> Kinetic:
    """Lun's coefficients with `free_path` = 1/(g0 (1 + path/R)) for 1/g0 in the kinetic parts."""
    a, eta = alpha_s, (1 + solids.restitution) / 2
    unit = _flights(theta, solids)
    packed = 8 * eta * a * g0
    mu = (free_path / eta + 1.6 * a) * (1 + 0.2 * (3 * eta - 2) * packed) / (2 - eta)
    mu = mu + 768 / (25 * math.pi) * eta * a**2 * g0
    kappa = 1 + 0.3 * eta * (4 * eta - 3) * packed
    kappa = (8 * free_path / eta + 96 / 5 * a) * kappa / (41 - 33 * eta)
    kappa = kappa + 512 / (25 * math.pi) * eta * a**2 * g0
    return Kinetic(
        pressure=lun_pressure(a, theta, g0, solids),
        shear_viscosity=5 / 96 * unit * mu,
        bulk_viscosity=5 / 3 * collisional_viscosity(a, theta, g0, solids),
        conductivity=25 / 128 * unit * kappa,
        dissipation=lun_dissipation(a, theta, g0, solids),
    )


@register("granular", "lun")
@dataclass(frozen=True)
class Lun(Granular):
    """Lun-Savage-Jeffrey-Chepurniy kinetic theory of slightly inelastic spheres.

        mu    = (5 sqrt(pi)/96) rho_s d sqrt(Theta) {[1/(eta g0) + 8a/5]
                [1 + (8/5) eta (3 eta - 2) a g0]/(2 - eta) + 768/(25 pi) eta a^2 g0}
        kappa = (25 sqrt(pi)/128) rho_s d sqrt(Theta) {[8/(eta g0) + 96a/5]
                [1 + (12/5) eta^2 (4 eta - 3) a g0]/(41 - 33 eta) + 512/(25 pi) eta a^2 g0}

    p, lambda and gamma as in `gidaspow`.

    Validity: e > 0.9.
    Source: Lun, Savage, Jeffrey and Chepurniy (1984), J. Fluid Mech. 140, 223-256.
    """

    def coefficients(
        self, alpha_s: Value, theta: Value, g0: Value, solids: Solids, length: Value
    ) -> Kinetic:
        """Coefficients at granular temperature `theta` [m2/s2]; `length` is not used."""
        return _lun_coefficients(alpha_s, theta, g0, solids, 1 / g0)

    def dilute(
        self, alpha_s: Value, theta: Value, solids: Solids, length: Value
    ) -> tuple[Value, Value]:
        """mu_d and kappa_d; only Theta counts."""
        return _lun_dilute(theta, solids)


@register("granular", "hrenya-sinclair")
@dataclass(frozen=True)
class HrenyaSinclair(Granular):
    """Lun's theory with the mean free path limited by the pipe.

        1/g0 -> 1/[g0 (1 + path/R)] in the kinetic parts of mu and kappa,  path = d/(6 sqrt(2) a)

    R is the pipe radius, length/2. mu and kappa vanish as a -> 0 in place of Lun's finite limits.
    p, lambda and gamma as in `gidaspow`.

    Validity: e > 0.9, dilute to dense flow in a pipe of radius R.
    Source: Hrenya and Sinclair (1997), AIChE J. 43, 853-869.
    """

    def coefficients(
        self, alpha_s: Value, theta: Value, g0: Value, solids: Solids, length: Value
    ) -> Kinetic:
        """Coefficients at granular temperature `theta` [m2/s2], pipe diameter `length` [m]."""
        knudsen = self._knudsen(solids, length)
        return _lun_coefficients(alpha_s, theta, g0, solids, alpha_s / ((alpha_s + knudsen) * g0))

    def dilute(
        self, alpha_s: Value, theta: Value, solids: Solids, length: Value
    ) -> tuple[Value, Value]:
        """mu_d and kappa_d, Lun's over 1 + path/R."""
        share = alpha_s / (alpha_s + self._knudsen(solids, length))
        viscosity, conductivity = _lun_dilute(theta, solids)
        return share * viscosity, share * conductivity

    @staticmethod
    def _knudsen(solids: Solids, length: Value) -> Value:
        """a path/R [-]."""
        return solids.diameter / (6 * math.sqrt(2) * (length / 2))


@register("granular", "syamlal-obrien")
@dataclass(frozen=True)
class SyamlalOBrienKinetics(Granular):
    """Syamlal-O'Brien viscosity and conductivity.

        mu    = a rho_s d sqrt(pi Theta)/[6 (3 - e)] [1 + (2/5)(1 + e)(3e - 1) a g0]
                + (4/5) a^2 rho_s d g0 (1 + e) sqrt(Theta/pi)
        kappa = 15 a rho_s d sqrt(pi Theta)/[4 (41 - 33 eta)] {1 + (12/5) eta^2 (4 eta - 3) a g0
                + [16/(15 pi)] (41 - 33 eta) eta a g0}

    The kinetic parts are proportional to a, so they vanish as a -> 0. p, lambda and gamma as in
    `gidaspow`.

    Validity: e > 1/3; dense flow, since the dilute limit of the kinetic theory is left out.
    Source: Syamlal and O'Brien (1988), Int. J. Multiphase Flow 14, 473-481; Syamlal, Rogers and
    O'Brien (1993), MFIX Documentation: Theory Guide.
    """

    def coefficients(
        self, alpha_s: Value, theta: Value, g0: Value, solids: Solids, length: Value
    ) -> Kinetic:
        """Coefficients at granular temperature `theta` [m2/s2]; `length` is not used."""
        a, e, eta = alpha_s, solids.restitution, (1 + solids.restitution) / 2
        thermal = self._thermal(a, theta, solids)
        collisional = collisional_viscosity(a, theta, g0, solids)
        kinetic = 1 + 0.4 * (1 + e) * (3 * e - 1) * a * g0
        factor = 41 - 33 * eta
        kappa = 1 + 2.4 * eta**2 * (4 * eta - 3) * a * g0
        kappa = kappa + 16 / (15 * math.pi) * factor * eta * a * g0
        return Kinetic(
            pressure=lun_pressure(a, theta, g0, solids),
            shear_viscosity=thermal / (6 * (3 - e)) * kinetic + collisional,
            bulk_viscosity=5 / 3 * collisional,
            conductivity=15 / 4 * thermal / factor * kappa,
            dissipation=lun_dissipation(a, theta, g0, solids),
        )

    def dilute(
        self, alpha_s: Value, theta: Value, solids: Solids, length: Value
    ) -> tuple[Value, Value]:
        """mu_d and kappa_d, proportional to a."""
        e, thermal = solids.restitution, self._thermal(alpha_s, theta, solids)
        return thermal / (6 * (3 - e)), 15 / 4 * thermal / (41 - 33 * (1 + e) / 2)

    @staticmethod
    def _thermal(alpha_s: Value, theta: Value, solids: Solids) -> Value:
        """a rho_s d sqrt(pi Theta) [Pa s]."""
        return alpha_s * solids.density * solids.diameter * _SQRT_PI * speed(theta)


@register("granular", "garzo-dufty")
@dataclass(frozen=True)
class GarzoDufty(Granular):
    """Garzo-Dufty kinetic theory of a dense gas of inelastic spheres.

        c      = 32 (1 - e)(1 - 2 e^2)/[81 - 17 e + 30 e^2 (1 - e)]
        z      = (5/12) g0 (1 - e^2)(1 + 3c/32),  N = 1 + 2 (1 + e) a g0,  p = a rho_s Theta N
        mu_0   = 5 sqrt(pi) rho_s d sqrt(Theta)/96,  kappa_0 = 15 mu_0/4
        lambda = mu_0 128/(5 pi) a^2 g0 (1 + e)(1 - c/32)
        mu     = mu_0 M [1 + (4/5) a g0 (1 + e)] + (3/5) lambda
        M      = [1 - (2/5)(1 + e)(1 - 3e) a g0]/{g0 [1 - (1 - e)^2/4](1 - c/64) - z/2}
        kappa  = kappa_0 {K [1 + (6/5) a g0 (1 + e)] + 256/(25 pi) a^2 g0 (1 + e)(1 + 7c/32)}
        K      = (2/3) {1 + (1 + N) c/2 + (3/5) a g0 (1 + e)^2
                 [2e - 1 + ((1 + e)/2 - 5/(3 (1 + e))) c]}
                 /{(1 + e) g0/3 [1 + (33/16)(1 - e) + (19 - 3e) c/1024] - 2z}
        gamma  = (3/2) (a rho_s)^2 Theta^2 z/mu_0

    The heat flux by grad alpha_s (Dufour term) and the cooling by div u_s are left out.

    Validity: 0.5 < e <= 1, without the limit to nearly elastic grains of the other theories.
    Source: Garzo and Dufty (1999), Phys. Rev. E 59, 5895-5911.
    """

    def coefficients(
        self, alpha_s: Value, theta: Value, g0: Value, solids: Solids, length: Value
    ) -> Kinetic:
        """Coefficients at granular temperature `theta` [m2/s2]; `length` is not used."""
        a, e, c = alpha_s, solids.restitution, self._kurtosis(solids)
        unit = self._unit(theta, solids)
        bulk = unit * 128 / (5 * math.pi) * a**2 * g0 * (1 + e) * (1 - c / 32)
        kinetic = unit * self._viscous(a, e, c, g0) * (1 + 0.8 * a * g0 * (1 + e))
        conduction = self._thermal(a, e, c, g0) * (1 + 1.2 * a * g0 * (1 + e))
        contact = 256 / (25 * math.pi) * a**2 * g0 * (1 + e) * (1 + 7 / 32 * c)
        return Kinetic(
            pressure=lun_pressure(a, theta, g0, solids),
            shear_viscosity=kinetic + 0.6 * bulk,
            bulk_viscosity=bulk,
            conductivity=15 / 4 * unit * (conduction + contact),
            dissipation=lun_dissipation(a, theta, g0, solids) * (1 + 3 / 32 * c),
        )

    def dilute(
        self, alpha_s: Value, theta: Value, solids: Solids, length: Value
    ) -> tuple[Value, Value]:
        """mu_d and kappa_d; only Theta counts."""
        e, c, unit = solids.restitution, self._kurtosis(solids), self._unit(theta, solids)
        return unit * self._viscous(0.0, e, c, 1.0), 15 / 4 * unit * self._thermal(0.0, e, c, 1.0)

    @staticmethod
    def _unit(theta: Value, solids: Solids) -> Value:
        """mu_0 [Pa s]."""
        return 5 / 96 * _SQRT_PI * solids.density * solids.diameter * speed(theta)

    @staticmethod
    def _kurtosis(solids: Solids) -> Value:
        """c [-]."""
        e = solids.restitution
        return 32 * (1 - e) * (1 - 2 * e**2) / (81 - 17 * e + 30 * e**2 * (1 - e))

    @staticmethod
    def _viscous(a: Value, e: Value, c: Value, g0: Value) -> Value:
        """M, the kinetic viscosity over mu_0 [-]."""
        rate = (1 - (1 - e) ** 2 / 4) * (1 - c / 64) - 5 / 24 * (1 - e**2) * (1 + 3 / 32 * c)
        return (1 - 0.4 * (1 + e) * (1 - 3 * e) * a * g0) / (g0 * rate)

    @staticmethod
    def _thermal(a: Value, e: Value, c: Value, g0: Value) -> Value:
        """K, the kinetic conductivity over kappa_0 [-]."""
        rate = (1 + e) / 3 * (1 + 33 / 16 * (1 - e) + (19 - 3 * e) / 1024 * c)
        rate = rate - 5 / 6 * (1 - e**2) * (1 + 3 / 32 * c)
        excess = 1 + (1 + (1 + e) * a * g0) * c
        bracket = 2 * e - 1 + ((1 + e) / 2 - 5 / (3 * (1 + e))) * c
        return 2 / 3 * (excess + 0.6 * a * g0 * (1 + e) ** 2 * bracket) / (g0 * rate)


def algebraic_theta(
    alpha_s: Value,
    g0: Value,
    shear: Value,
    dilation: Value,
    granular: Granular,
    solids: Solids,
    length: Value,
    drag: Value = 0.0,
    strain_floor: float = 1e-12,
) -> Value:
    """Granular temperature where production equals dissipation, Theta [m2/s2].

        2 mu S:S + lambda D^2 - p D = gamma + 3 beta Theta

    With p = p1 Theta, mu = mu1 sqrt(Theta), lambda = lambda1 sqrt(Theta), gamma = g1 Theta^1.5 and
    w = sqrt(Theta) it is the quadratic g1 w^2 + (p1 D + 3 beta) w = 2 mu1 S:S + lambda1 D^2, whose
    positive root is taken in the form that does not cancel.

    shear : S:S [1/s2]; dilation : D [1/s]; drag : beta [kg/m3/s], which bounds Theta in dilute flow
    strain_floor : added to S:S [1/s2], so that the slope is finite at rest

    Validity: e < 1 or drag > 0; transport of granular energy is negligible.
    Source: Syamlal, Rogers and O'Brien (1993), MFIX Documentation: Theory Guide; with drag added.
    """
    unit = granular.coefficients(alpha_s, 1.0, g0, solids, length)
    production = 2 * unit.shear_viscosity * (shear + strain_floor)
    production += unit.bulk_viscosity * dilation**2
    linear = unit.pressure * dilation + 3 * drag
    size = where_greater(linear, 0.0, linear, -linear)
    total = size + sqrt(linear**2 + 4 * unit.dissipation * production)
    # elastic grains have no equilibrium without drag: a huge Theta, but no division by zero
    unlimited = total / (2 * unit.dissipation + _TINY_DISSIPATION)
    return where_greater(linear, 0.0, 2 * production / total, unlimited) ** 2


def haff(
    theta0: Value,
    time: Value,
    alpha_s: Value,
    g0: Value,
    granular: Granular,
    solids: Solids,
    length: Value = 1.0,
) -> Value:
    """Granular temperature of a homogeneous gas of grains that cools, Haff's law [m2/s2].

        Theta = Theta_0/(1 + C sqrt(Theta_0) t/2)^2,   C = 2 gamma/(3 a rho_s Theta^1.5)

    which solves 3/2 a rho_s dTheta/dt = -gamma; C = 8 (1 - e^2) g0 a/(d sqrt(pi)) for Lun's gamma.

    theta0 : initial value [m2/s2]; time : t [s]

    Validity: no flow, no gas, clusters not yet formed.
    Source: Haff (1983), J. Fluid Mech. 134, 401-430.
    """
    gamma = granular.coefficients(alpha_s, 1.0, g0, solids, length).dissipation
    rate = 2 * gamma / (3 * alpha_s * solids.density)
    return theta0 / (1 + rate * sqrt(theta0) * time / 2) ** 2

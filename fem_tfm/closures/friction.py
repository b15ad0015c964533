# SPDX-License-Identifier: LGPL-3.0-or-later
"""Frictional stress of solids in lasting contact, added to the kinetic stress.

    sigma_f = -p_f I + 2 mu_f S

The laws act above the solids fraction a_min and vanish below it. The onset (a - a_min)+ is a
softplus of stated width, which decays as exp(-|a - a_min|/width); the printed laws are the limit
of zero width and zero strain floor. At D = Theta = 0 the viscosities of Schaeffer, Dartevelle and
Srivastava-Sundaresan are the same, Coulomb's |tau| = p_f sin(phi) in simple shear, where
S:S = (shear rate)^2/2.

Symbols: a = alpha_s, a_min = friction_limit, a_max = packing_limit, phi friction angle [rad],
d grain diameter [m], S = dev(sym(grad u_s)) [1/s], D = div u_s [1/s], Theta granular temperature
[m2/s2], s0 strain floor [1/s2], R = S:S + Theta/d^2 [1/s2].
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, NamedTuple

from fem_tfm.closures.base import Closure, parameter, register
from fem_tfm.closures.ops import Value, is_expr, positive_part, sin, softplus, sqrt, tanh
from fem_tfm.errors import InputError
from fem_tfm.materials import Solids

_SQRT2 = math.sqrt(2)
_YIELD_EPS = 1e-3
_TINY_PRESSURE = 1e-12


class Frictional(NamedTuple):
    """Frictional stress: pressure p_f [Pa] and viscosity mu_f [Pa s]."""

    pressure: Any
    viscosity: Any


class Friction(Closure):
    """Interface of a frictional stress."""

    @abstractmethod
    def stress(
        self, alpha_s: Value, theta: Value, shear: Value, dilation: Value, solids: Solids
    ) -> Frictional:
        """Stress at shear = S:S [1/s2] and dilation = D [1/s]."""


def _width() -> Any:
    return parameter(5e-3, "-", "width of the smooth onset at a_min", gt=0, le=0.1)


def _floor() -> Any:
    return parameter(1.0, "1/s2", "strain floor s0 in the root of mu_f", gt=0)


def excess(alpha_s: Value, solids: Solids, width: Value) -> Value:
    """Smooth (a - a_min)+ [-]."""
    return softplus(alpha_s - solids.friction_limit, width)


def fluctuating_shear(shear: Value, theta: Value, solids: Solids) -> Value:
    """R = S:S + Theta/d^2 [1/s2] (Savage 1998)."""
    return shear + theta / solids.diameter**2


def coulomb_viscosity(p_f: Value, shear: Value, floor: Value, solids: Solids) -> Value:
    """Schaeffer's mu_f = p_f sin(phi)/(2 sqrt(I_2D)), I_2D = S:S/2 [Pa s]."""
    return p_f * sin(solids.friction_angle) / sqrt(2 * shear + floor)


def capped_floor(p_f: Value, cap: Value, floor: Value, solids: Solids) -> Value:
    """Strain floor that keeps `coulomb_viscosity` below a cap [Pa s] smoothly [1/s2]."""
    return floor + (p_f * sin(solids.friction_angle) / cap) ** 2


def dartevelle_viscosity(
    p_f: Value, theta: Value, shear: Value, dilation: Value, floor: Value, solids: Solids
) -> Value:
    """mu_f = p_f sin^2(phi)/sqrt(2 sin^2(phi) R + D^2 + s0) [Pa s]."""
    sin2 = sin(solids.friction_angle) ** 2
    rate2 = 2 * sin2 * fluctuating_shear(shear, theta, solids) + dilation**2
    return p_f * sin2 / sqrt(rate2 + floor)


@dataclass(frozen=True)
class JohnsonJacksonPressure(Friction):
    """What laws with the frictional pressure of Johnson and Jackson (1987) share."""

    Fr: float = parameter(0.05, "Pa", "pressure scale", gt=0)
    r: float = parameter(2.0, "-", "exponent of the excess over a_min", ge=1)
    s: float = parameter(5.0, "-", "exponent of the distance to a_max", gt=0)
    width: float = _width()
    strain_floor: float = _floor()

    def pressure(self, alpha_s: Value, solids: Solids) -> Value:
        """Fr (a - a_min)^r/(a_max - a)^s [Pa]."""
        above = excess(alpha_s, solids, self.width)
        return self.Fr * above**self.r / (solids.packing_limit - alpha_s) ** self.s


@register("friction", "none")
@dataclass(frozen=True)
class NoFriction(Friction):
    """No frictional stress.

        p_f = mu_f = 0

    Validity: solids that collide but do not rest on each other.
    Source: kinetic theory alone.
    """

    def stress(
        self, alpha_s: Value, theta: Value, shear: Value, dilation: Value, solids: Solids
    ) -> Frictional:
        """Zero pressure and viscosity."""
        return Frictional(0.0, 0.0)


@register("friction", "dartevelle")
@dataclass(frozen=True)
class Dartevelle(Friction):
    """Dartevelle friction from the Pitman-Schaeffer-Gray-Stiles yield criterion.

        p_f  = P [(a - a_min)/(a_max - a)]^3
        mu_f = p_f sin^2(phi)/sqrt(2 sin^2(phi) R + D^2 + s0)

    Validity: a_min < a < a_max; dilating and compacting solids.
    Source: Dartevelle (2004), Geochem. Geophys. Geosyst. 5, Q08003, as eqs. (13)-(14) of Ding et
    al. (2024), Appl. Sci. 14, 2031.
    """

    coefficient: float = parameter(1000.0, "Pa", "pressure scale P", gt=0)
    width: float = _width()
    strain_floor: float = _floor()

    def stress(
        self, alpha_s: Value, theta: Value, shear: Value, dilation: Value, solids: Solids
    ) -> Frictional:
        """Pressure [Pa] and viscosity [Pa s]."""
        ratio = excess(alpha_s, solids, self.width) / (solids.packing_limit - alpha_s)
        p_f = self.coefficient * ratio**3
        args = (p_f, theta, shear, dilation, self.strain_floor, solids)
        return Frictional(p_f, dartevelle_viscosity(*args))


@register("friction", "berzi")
@dataclass(frozen=True)
class Berzi(Friction):
    """Modified Berzi friction, from the stiffness of the grains.

        p_f  = a_B (k_n/d) (a - a_min)/(a_max - a)
        mu_f = p_f sin^2(phi)/sqrt(2 sin^2(phi) R + D^2 + s0)

    Validity: a_min < a < a_max. The source does not print k_n; k_n/d = 2.97e6 Pa is inferred from
    the crossing with Johnson-Jackson at a = 0.47 in its Fig. 7.
    Source: Berzi, di Prisco and Vescovi (2011), Phys. Rev. E 84, 031301, as modified in eqs.
    (18)-(19) of Ding et al. (2024), Appl. Sci. 14, 2031.
    """

    coefficient: float = parameter(1.8e-6, "-", "material coefficient a_B", gt=0)
    stiffness: float = parameter(2.97e6, "Pa", "normal stiffness over diameter, k_n/d", gt=0)
    width: float = _width()
    strain_floor: float = _floor()

    def stress(
        self, alpha_s: Value, theta: Value, shear: Value, dilation: Value, solids: Solids
    ) -> Frictional:
        """Pressure [Pa] and viscosity [Pa s]."""
        ratio = excess(alpha_s, solids, self.width) / (solids.packing_limit - alpha_s)
        p_f = self.coefficient * self.stiffness * ratio
        args = (p_f, theta, shear, dilation, self.strain_floor, solids)
        return Frictional(p_f, dartevelle_viscosity(*args))


@register("friction", "srivastava-sundaresan")
@dataclass(frozen=True)
class SrivastavaSundaresan(JohnsonJacksonPressure):
    """Srivastava-Sundaresan friction, Johnson-Jackson at the critical state.

        p_c  = Fr (a - a_min)^r/(a_max - a)^s
        p_f  = p_c B^(n-1),  B = 1 - D/(sqrt(2) n sin(phi) sqrt(R + s0))
        mu_f = p_f sin(phi)/(sqrt(2) sqrt(R + s0)) [n - (n - 1) B]
        n    = sqrt(3)/(2 sin(phi)) for D > 0 (dilation), 1.03 for D < 0 (compaction)

    B is (p_f/p_c)^(1/(n-1)) of the printed form, written without the quotient. B and the bracket
    are kept positive smoothly; n switches by tanh over a band of width `switch_width` in
    X = D/(sqrt(2) sin(phi) sqrt(R + s0)).

    Validity: a_min < a < a_max, phi < 60 deg so that n > 1 in dilation.
    Source: Srivastava and Sundaresan (2003), Powder Technol. 129, 72-85.
    """

    compaction_n: float = parameter(1.03, "-", "exponent n in compaction", gt=1)
    switch_width: float = parameter(0.05, "-", "width of the switch of n in X", gt=0)

    def stress(
        self, alpha_s: Value, theta: Value, shear: Value, dilation: Value, solids: Solids
    ) -> Frictional:
        """Pressure [Pa] and viscosity [Pa s]."""
        sin_phi = sin(solids.friction_angle)
        rate = _SQRT2 * sqrt(fluctuating_shear(shear, theta, solids) + self.strain_floor)
        x = dilation / (sin_phi * rate)
        dilating = (1 + tanh(x / self.switch_width)) / 2
        n = self.compaction_n + (math.sqrt(3) / 2 / sin_phi - self.compaction_n) * dilating
        base = positive_part(1 - x / n, _YIELD_EPS)
        p_c = self.pressure(alpha_s, solids)
        p_f = p_c * base ** (n - 1)
        bracket = positive_part(n - (n - 1) * base, _YIELD_EPS)
        return Frictional(p_f, p_f * sin_phi / rate * bracket)


@register("friction", "johnson-jackson")
@dataclass(frozen=True)
class JohnsonJackson(JohnsonJacksonPressure):
    """Johnson-Jackson frictional pressure with Schaeffer's viscosity.

        p_f  = Fr (a - a_min)^r/(a_max - a)^s
        mu_f = p_f sin(phi)/sqrt(4 I_2D + s0),  I_2D = S:S/2

    Validity: a_min < a < a_max; slow shear at constant volume.
    Source: Johnson and Jackson (1987), J. Fluid Mech. 176, 67-93; Schaeffer (1987), J. Differ.
    Equ. 66, 19-50.
    """

    def stress(
        self, alpha_s: Value, theta: Value, shear: Value, dilation: Value, solids: Solids
    ) -> Frictional:
        """Pressure [Pa] and viscosity [Pa s]."""
        p_f = self.pressure(alpha_s, solids)
        return Frictional(p_f, coulomb_viscosity(p_f, shear, self.strain_floor, solids))


@dataclass(frozen=True)
class PlasticPressure(Friction):
    """Plastic pressure of a nearly incompressible bed, P (a - a_min)^m."""

    coefficient: float = parameter(1e24, "Pa", "pressure scale P", gt=0)
    exponent: float = parameter(10.0, "-", "exponent m of the excess over a_min", ge=1)
    width: float = _width()
    strain_floor: float = _floor()

    def pressure(self, alpha_s: Value, solids: Solids) -> Value:
        """p_f [Pa]."""
        return self.coefficient * excess(alpha_s, solids, self.width) ** self.exponent


@register("friction", "schaeffer")
@dataclass(frozen=True)
class Schaeffer(PlasticPressure):
    """Plastic pressure of a nearly incompressible bed with Schaeffer's viscosity.

        p_f  = P (a - a_min)^m
        mu_f = p_f sin(phi)/sqrt(4 I_2D + s0),  I_2D = S:S/2

    Validity: packed beds; a_min is the packed fraction here (e.g. 0.58), since a bed 1 m deep
    rests 0.01 above it.
    Source: Schaeffer (1987), J. Differ. Equ. 66, 19-50; pressure of Syamlal, Rogers and O'Brien
    (1993), MFIX Documentation: Theory Guide.
    """

    def stress(
        self, alpha_s: Value, theta: Value, shear: Value, dilation: Value, solids: Solids
    ) -> Frictional:
        """Pressure [Pa] and viscosity [Pa s]."""
        p_f = self.pressure(alpha_s, solids)
        return Frictional(p_f, coulomb_viscosity(p_f, shear, self.strain_floor, solids))


@register("friction", "syamlal")
@dataclass(frozen=True)
class Syamlal(PlasticPressure):
    """Syamlal-Rogers-O'Brien friction: plastic pressure and Schaeffer's viscosity with a cap.

        p_f  = P (a - a_min)^m
        mu_f = min[p_f sin(phi)/sqrt(4 I_2D), mu_max]

    The minimum is smooth: 1/mu_f^2 is the sum of both inverse squares.

    Validity: packed beds; a_min is the packed fraction here (e.g. 0.58).
    Source: Syamlal, Rogers and O'Brien (1993), MFIX Documentation: Theory Guide, with its cap of
    1000 poise.
    """

    max_viscosity: float = parameter(100.0, "Pa s", "cap mu_max of the viscosity", gt=0)

    def stress(
        self, alpha_s: Value, theta: Value, shear: Value, dilation: Value, solids: Solids
    ) -> Frictional:
        """Pressure [Pa] and viscosity [Pa s]."""
        p_f = self.pressure(alpha_s, solids)
        floor = capped_floor(p_f, self.max_viscosity, self.strain_floor, solids)
        return Frictional(p_f, coulomb_viscosity(p_f, shear, floor, solids))


@register("friction", "pu")
@dataclass(frozen=True)
class Pu(JohnsonJacksonPressure):
    """Pu friction of pulverised coal: Johnson-Jackson pressure, scaled Syamlal viscosity.

        p_f  = Fr (a - a_min)^r/(a_max - a)^s
        mu_f = K min[p_f sin(phi)/sqrt(4 I_2D), mu_max]

    K stands for the authors' fit of Syamlal's viscosity to their pressure drops; their constants
    are not at hand, so K = 1 leaves the viscosity unmodified.

    Validity: dense conveying of pulverised coal at high pressure, once K is fitted.
    Source: Pu et al. (2010), Chem. Eng. Sci. 65, 2500-2512; Syamlal, Rogers and O'Brien (1993),
    MFIX Documentation: Theory Guide.
    """

    viscosity_factor: float = parameter(1.0, "-", "fitted factor K of the viscosity", gt=0)
    max_viscosity: float = parameter(100.0, "Pa s", "cap mu_max of the viscosity", gt=0)

    def stress(
        self, alpha_s: Value, theta: Value, shear: Value, dilation: Value, solids: Solids
    ) -> Frictional:
        """Pressure [Pa] and viscosity [Pa s]."""
        p_f = self.pressure(alpha_s, solids)
        floor = capped_floor(p_f, self.max_viscosity, self.strain_floor, solids)
        mu_f = coulomb_viscosity(p_f, shear, floor, solids)
        return Frictional(p_f, self.viscosity_factor * mu_f)


@register("friction", "mu-i")
@dataclass(frozen=True)
class MuI(JohnsonJacksonPressure):
    """mu(I) rheology of dense granular flow under the Johnson-Jackson pressure.

        p_f  = Fr (a - a_min)^r/(a_max - a)^s
        mu_f = mu(I) p_f/G,  G = sqrt(2 S:S + s0)
        mu(I) = mu_s + (mu_2 - mu_s) I/(I_0 + I),  I = G d sqrt(rho_s/p_f)

    The friction angle of the solids is not used: mu_s and mu_2 take its place.

    Validity: dense flow of rigid grains, I < 0.6; defaults are those of glass beads.
    Source: Jop, Forterre and Pouliquen (2006), Nature 441, 727-730.
    """

    mu_s: float = parameter(0.38, "-", "friction of slow shear", gt=0, le=2)
    mu_2: float = parameter(0.64, "-", "friction of fast shear", gt=0, le=3)
    I_0: float = parameter(0.279, "-", "inertial number of the change", gt=0, le=10)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not is_expr(self.mu_s, self.mu_2) and self.mu_2 < self.mu_s:
            words = f"at least mu_s = {self.mu_s:g}, a coefficient without a unit"
            raise InputError("mu_2", self.mu_2, words)

    def stress(
        self, alpha_s: Value, theta: Value, shear: Value, dilation: Value, solids: Solids
    ) -> Frictional:
        """Pressure [Pa] and viscosity [Pa s]."""
        p_f = self.pressure(alpha_s, solids)
        rate = sqrt(2 * shear + self.strain_floor)
        inertial = rate * solids.diameter * sqrt(solids.density)
        share = inertial / (self.I_0 * sqrt(p_f + _TINY_PRESSURE) + inertial)
        return Frictional(p_f, (self.mu_s + (self.mu_2 - self.mu_s) * share) * p_f / rate)

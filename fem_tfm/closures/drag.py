# SPDX-License-Identifier: LGPL-3.0-or-later
"""Drag between gas and solids.

The interphase force per volume on the solids is beta (u_g - u_s), with the gas pressure gradient
acting separately on both phases (-alpha_i grad p, model A). A law gives beta/alpha_s, which stays
finite where the solids vanish. Products such as C_D Re are multiplied out, so that nothing is
divided by the slip speed.

Symbols: a = alpha_s solids fraction, a_g = 1 - a, u slip speed |u_g - u_s| [m/s], d grain diameter
[m], rho_g [kg/m3], mu_g [Pa s], Re = a_g rho_g d u/mu_g unless stated, beta [kg/m3/s].
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from fem_tfm.closures.base import Closure, parameter, register
from fem_tfm.closures.ops import Value, atan, exp, ln, safe_pow, smooth_norm, smooth_step, sqrt
from fem_tfm.materials import Fluid, Solids

_TINY_RE = 1e-4
_TINY_FRACTION = 1e-5


class Drag(Closure):
    """Interface of a drag law.

    filtered : whether it accounts for clusters that are not resolved
    """

    filtered: ClassVar[bool] = False

    @abstractmethod
    def specific(self, alpha_s: Value, slip: Value, gas: Fluid, solids: Solids) -> Value:
        """beta/alpha_s [kg/m3/s] at a slip speed >= 0 [m/s]."""

    def beta(self, alpha_s: Value, slip: Value, gas: Fluid, solids: Solids) -> Value:
        """Drag coefficient beta = alpha_s specific(...) [kg/m3/s]."""
        return alpha_s * self.specific(alpha_s, slip, gas, solids)


def particle_reynolds(slip: Value, gas: Fluid, solids: Solids) -> Value:
    """Reynolds number of a grain, rho_g d u/mu_g, without the gas fraction [-]."""
    return gas.density * solids.diameter * slip / gas.viscosity


def stokes(gas: Fluid, solids: Solids) -> Value:
    """Stokes drag of a lone grain per solids fraction, 18 mu_g/d^2 [kg/m3/s]."""
    return 18 * gas.viscosity / solids.diameter**2


def schiller_naumann_factor(re: Value) -> Value:
    """C_D Re/24 = 1 + 0.15 Re^0.687 below Re = 1000, 0.44 Re/24 above.

    The two differ by 0.4 % at 1000; a cubic step over 900 < Re < 1100 joins them.
    """
    low = 1 + 0.15 * safe_pow(re, 0.687, _TINY_RE)
    return low + (0.44 / 24 * re - low) * smooth_step(re, 1000.0, 200.0)


def _ergun(alpha_s: Value, slip: Value, gas: Fluid, solids: Solids) -> Value:
    d = solids.diameter
    viscous = 150 * alpha_s * gas.viscosity / ((1 - alpha_s) * d**2)
    return viscous + 1.75 * gas.density * slip / d


def _wen_yu(alpha_s: Value, slip: Value, gas: Fluid, solids: Solids) -> Value:
    re = (1 - alpha_s) * particle_reynolds(slip, gas, solids)
    return stokes(gas, solids) * schiller_naumann_factor(re) * (1 - alpha_s) ** -2.65


def _gibilaro(alpha_s: Value, slip: Value, gas: Fluid, solids: Solids) -> Value:
    d, a_g = solids.diameter, 1 - alpha_s
    viscous = 17.3 * gas.viscosity / (a_g * d**2)
    return (viscous + 0.336 * gas.density * slip / d) * a_g**-1.8


@register("drag", "three-zone")
@dataclass(frozen=True)
class ThreeZone(Drag):
    """Three-zone drag of dense-phase conveying.

        a_g < 0.6:         beta = 150 a^2 mu_g/(a_g d^2) + 1.75 rho_g a u/d          (Ergun)
        0.6 <= a_g < 0.9:  beta = C (17.3/Re + 0.336) rho_g a u a_g^-1.8/d           (McKeen)
        a_g >= 0.9:        beta = (3/4) C_D a a_g rho_g u a_g^-2.65/d                (Wen-Yu)

    A cubic step of the stated width in a_g joins the branches at both switches.

    Validity: all fractions; the source does not print C (1: Gibilaro; 0.25: McKeen, FCC powder).
    Source: Ding et al. (2024), Appl. Sci. 14, 2031, eq. (9); McKeen and Pugsley (2003), Powder
    Technol. 129, 139-152.
    """

    C: float = parameter(1.0, "-", "factor of the intermediate zone", gt=0)
    width: float = parameter(0.02, "-", "width in a_g of the two blends", gt=0, le=0.2)

    def specific(self, alpha_s: Value, slip: Value, gas: Fluid, solids: Solids) -> Value:
        """beta/alpha_s [kg/m3/s]."""
        args = (alpha_s, slip, gas, solids)
        dense, middle, dilute = _ergun(*args), self.C * _gibilaro(*args), _wen_yu(*args)
        first = smooth_step(1 - alpha_s, 0.6, self.width)
        second = smooth_step(1 - alpha_s, 0.9, self.width)
        return dense + (middle - dense) * first + (dilute - middle) * second


@register("drag", "ergun")
@dataclass(frozen=True)
class Ergun(Drag):
    """Ergun drag of a packed bed.

        beta = 150 a^2 mu_g/(a_g d^2) + 1.75 rho_g a u/d

    Validity: packed beds, a > 0.4; it misses Stokes' drag as a -> 0.
    Source: Ergun (1952), Chem. Eng. Prog. 48, 89-94.
    """

    def specific(self, alpha_s: Value, slip: Value, gas: Fluid, solids: Solids) -> Value:
        """beta/alpha_s [kg/m3/s]."""
        return _ergun(alpha_s, slip, gas, solids)


@register("drag", "wen-yu")
@dataclass(frozen=True)
class WenYu(Drag):
    """Wen-Yu drag of a fluidised suspension.

        beta = (3/4) C_D a a_g rho_g u a_g^-2.65/d
        C_D  = 24/Re (1 + 0.15 Re^0.687) below Re = 1000, 0.44 above

    Validity: a < 0.2; the exponent comes from the expansion of fluidised beds.
    Source: Wen and Yu (1966), Chem. Eng. Prog. Symp. Ser. 62, 100-111.
    """

    def specific(self, alpha_s: Value, slip: Value, gas: Fluid, solids: Solids) -> Value:
        """beta/alpha_s [kg/m3/s]."""
        return _wen_yu(alpha_s, slip, gas, solids)


@register("drag", "gidaspow")
@dataclass(frozen=True)
class Gidaspow(Drag):
    """Gidaspow drag: Ergun where dense, Wen-Yu where dilute.

        a_g < 0.8: Ergun,   a_g >= 0.8: Wen-Yu

    The printed switch jumps; a cubic step of the stated width in a_g joins the branches.

    Validity: all fractions.
    Source: Ding and Gidaspow (1990), AIChE J. 36, 523-538.
    """

    width: float = parameter(0.02, "-", "width in a_g of the blend", gt=0, le=0.4)

    def specific(self, alpha_s: Value, slip: Value, gas: Fluid, solids: Solids) -> Value:
        """beta/alpha_s [kg/m3/s]."""
        dense = _ergun(alpha_s, slip, gas, solids)
        dilute = _wen_yu(alpha_s, slip, gas, solids)
        return dense + (dilute - dense) * smooth_step(1 - alpha_s, 0.8, self.width)


@register("drag", "huilin-gidaspow")
@dataclass(frozen=True)
class HuilinGidaspow(Drag):
    """Huilin-Gidaspow drag: the Gidaspow pair with a smooth switch.

        beta = (1 - phi) beta_Ergun + phi beta_Wen-Yu
        phi  = atan[150 x 1.75 (0.2 - a)]/pi + 1/2

    Validity: all fractions; 0.6 % of Ergun remains as a -> 0.
    Source: Lu Huilin and Gidaspow (2003), Chem. Eng. Sci. 58, 3777-3792.
    """

    def specific(self, alpha_s: Value, slip: Value, gas: Fluid, solids: Solids) -> Value:
        """beta/alpha_s [kg/m3/s]."""
        dense = _ergun(alpha_s, slip, gas, solids)
        dilute = _wen_yu(alpha_s, slip, gas, solids)
        share = atan(150 * 1.75 * (0.2 - alpha_s)) / math.pi + 0.5
        return dense + (dilute - dense) * share


@register("drag", "gibilaro")
@dataclass(frozen=True)
class Gibilaro(Drag):
    """Gibilaro drag of a fluidised bed, one formula for all Reynolds numbers.

        beta = (17.3/Re + 0.336) rho_g a u a_g^-1.8/d

    Validity: a > 0.1 in fluidised beds.
    Source: Gibilaro, Di Felice, Waldram and Foscolo (1985), Chem. Eng. Sci. 40, 1817-1823.
    """

    def specific(self, alpha_s: Value, slip: Value, gas: Fluid, solids: Solids) -> Value:
        """beta/alpha_s [kg/m3/s]."""
        return _gibilaro(alpha_s, slip, gas, solids)


@register("drag", "syamlal-obrien")
@dataclass(frozen=True)
class SyamlalOBrien(Drag):
    """Syamlal-O'Brien drag from terminal velocities in settling suspensions.

        beta = (3/4) C_D a a_g rho_g u/(v_r^2 d),  C_D = (0.63 + 4.8 sqrt(v_r/Re))^2
        v_r  = [A - 0.06 Re + sqrt((0.06 Re)^2 + 0.12 Re (2B - A) + A^2)]/2
        A    = a_g^4.14,  B = c a_g^1.28 for a_g <= 0.85, a_g^n above,  Re = rho_g d u/mu_g

    c and n are the two constants that are tuned to a measured minimum fluidisation; c 0.85^1.28
    should equal 0.85^n. A cubic step of width 0.02 joins the branches of B.

    Validity: all fractions of settling or fluidised suspensions.
    Source: Syamlal and O'Brien (1989), AIChE Symp. Ser. 85, 22-31; Garside and Al-Dibouni (1977).
    """

    c: float = parameter(0.8, "-", "factor of B where dense", gt=0)
    n: float = parameter(2.65, "-", "exponent of B where dilute", gt=0)

    def specific(self, alpha_s: Value, slip: Value, gas: Fluid, solids: Solids) -> Value:
        """beta/alpha_s [kg/m3/s]."""
        a_g, re = 1 - alpha_s, particle_reynolds(slip, gas, solids)
        v_r = self.velocity_ratio(a_g, re)
        drag = (0.63 * safe_pow(re, 0.5, _TINY_RE) + 4.8 * sqrt(v_r)) ** 2
        return 0.75 * drag * a_g * gas.viscosity / (v_r * solids.diameter) ** 2

    def velocity_ratio(self, a_g: Value, re: Value) -> Value:
        """Terminal velocity in the suspension over that of a lone grain, v_r [-]."""
        a = a_g**4.14
        dense = self.c * a_g**1.28
        b = dense + (a_g**self.n - dense) * smooth_step(a_g, 0.85, 0.02)
        x = 0.06 * re
        return (a - x + sqrt(x**2 + 2 * x * (2 * b - a) + a**2)) / 2


@register("drag", "beetstra")
@dataclass(frozen=True)
class Beetstra(Drag):
    """Beetstra-van der Hoef-Kuipers (BVK) drag from lattice-Boltzmann simulations.

        beta = 18 mu_g a a_g F/d^2
        F    = 10 a/a_g^2 + a_g^2 (1 + 1.5 sqrt(a)) + 0.413 Re/(24 a_g^2)
               (1/a_g + 3 a a_g + 8.4 Re^-0.343)/(1 + 10^(3a) Re^(-(1 + 4a)/2))

    Validity: 0.1 < a < 0.6, Re < 1000; Stokes' drag as a, Re -> 0.
    Source: Beetstra, van der Hoef and Kuipers (2007), AIChE J. 53, 489-501.
    """

    def specific(self, alpha_s: Value, slip: Value, gas: Fluid, solids: Solids) -> Value:
        """beta/alpha_s [kg/m3/s]."""
        a, a_g = alpha_s, 1 - alpha_s
        re = a_g * particle_reynolds(slip, gas, solids)
        creeping = 10 * a / a_g**2 + a_g**2 * (1 + 1.5 * safe_pow(a, 0.5, _TINY_FRACTION))
        power = safe_pow(re, 0.5 + 2 * a, _TINY_RE)
        rise = re * (1 / a_g + 3 * a * a_g) + 8.4 * safe_pow(re, 0.657, _TINY_RE)
        inertial = 0.413 / (24 * a_g**2) * rise * power / (power + exp(3 * math.log(10) * a))
        return stokes(gas, solids) * a_g * (creeping + inertial)


@register("drag", "di-felice")
@dataclass(frozen=True)
class DiFelice(Drag):
    """Di Felice drag: that of a lone grain times a power of the gas fraction.

        beta = (3/4) C_D rho_g a u a_g^(2 - chi)/d,  C_D = (0.63 + 4.8/sqrt(Re))^2
        chi  = 3.7 - 0.65 exp[-(1.5 - log10 Re)^2/2]

    Validity: all fractions and Reynolds numbers.
    Source: Di Felice (1994), Int. J. Multiphase Flow 20, 153-159.
    """

    def specific(self, alpha_s: Value, slip: Value, gas: Fluid, solids: Solids) -> Value:
        """beta/alpha_s [kg/m3/s]."""
        a_g = 1 - alpha_s
        re = a_g * particle_reynolds(slip, gas, solids)
        decade = ln(smooth_norm(re, _TINY_RE)) / math.log(10)
        chi = 3.7 - 0.65 * exp(-((1.5 - decade) ** 2) / 2)
        drag = (0.63 * safe_pow(re, 0.5, _TINY_RE) + 4.8) ** 2
        return 0.75 * drag * gas.viscosity / solids.diameter**2 * a_g ** (1 - chi)


@register("drag", "koch-hill")
@dataclass(frozen=True)
class KochHill(Drag):
    """Koch-Hill drag from lattice-Boltzmann simulations, in its form linear in Re.

        beta = 18 mu_g a_g^2 a (F_0 + F_3 Re/2)/d^2
        F_0  = [1 + 3 sqrt(a/2) + (135/64) a ln a + 16.14 a]/(1 + 0.681 a - 8.48 a^2 + 8.16 a^3)
               for a < 0.4, 10 a/a_g^3 above
        F_3  = 0.0673 + 0.212 a + 0.0232/a_g^5

    A cubic step of width 0.02 in a joins the branches of F_0.

    Validity: 0.01 < a < 0.64, Re > 20 (the quadratic rise at small Re is left out).
    Source: Hill, Koch and Ladd (2001), J. Fluid Mech. 448, 213-278; Koch and Hill (2001), Annu.
    Rev. Fluid Mech. 33, 619-647.
    """

    def specific(self, alpha_s: Value, slip: Value, gas: Fluid, solids: Solids) -> Value:
        """beta/alpha_s [kg/m3/s]."""
        a, a_g = alpha_s, 1 - alpha_s
        re = a_g * particle_reynolds(slip, gas, solids)
        f_3 = 0.0673 + 0.212 * a + 0.0232 / a_g**5
        return stokes(gas, solids) * a_g**2 * (self.creeping(a) + f_3 * re / 2)

    def creeping(self, a: Value) -> Value:
        """F_0 [-]."""
        series = 1 + 3 * safe_pow(a / 2, 0.5, _TINY_FRACTION) + 16.14 * a
        series = series + 135 / 64 * a * ln(smooth_norm(a, _TINY_FRACTION))
        # the denominator stays above 0.1 where the dense branch holds alone
        dilute = series / (1 + a * (0.681 + a * (8.16 * a - 8.48)))
        dense = 10 * a / (1 - a) ** 3
        return dilute + (dense - dilute) * smooth_step(a, 0.4, 0.02)


@register("drag", "tenneti")
@dataclass(frozen=True)
class Tenneti(Drag):
    """Tenneti-Garg-Subramaniam drag from particle-resolved simulations.

        beta = 18 mu_g a a_g^2 F/d^2
        F    = (1 + 0.15 Re^0.687)/a_g^3 + 5.81 a/a_g^3 + 0.48 a^(1/3)/a_g^4
               + a^3 Re [0.95 + 0.61 a^3/a_g^2]

    Validity: 0.1 <= a <= 0.5, 0.01 <= Re <= 300.
    Source: Tenneti, Garg and Subramaniam (2011), Int. J. Multiphase Flow 37, 1072-1092.
    """

    def specific(self, alpha_s: Value, slip: Value, gas: Fluid, solids: Solids) -> Value:
        """beta/alpha_s [kg/m3/s]."""
        a, a_g = alpha_s, 1 - alpha_s
        re = a_g * particle_reynolds(slip, gas, solids)
        lone = (schiller_naumann_factor(re) + 5.81 * a) / a_g**3
        crowd = 0.48 * safe_pow(a, 1 / 3, _TINY_FRACTION) / a_g**4
        inertial = a**3 * re * (0.95 + 0.61 * a**3 / a_g**2)
        return stokes(gas, solids) * a_g**2 * (lone + crowd + inertial)


@register("drag", "schiller-naumann")
@dataclass(frozen=True)
class SchillerNaumann(Drag):
    """Schiller-Naumann drag of a lone grain.

        beta = (3/4) C_D rho_g a u/d,  Re = rho_g d u/mu_g
        C_D  = 24/Re (1 + 0.15 Re^0.687) below Re = 1000, 0.44 above

    Validity: a < 0.01.
    Source: Schiller and Naumann (1935), Z. VDI 77, 318-320.
    """

    def specific(self, alpha_s: Value, slip: Value, gas: Fluid, solids: Solids) -> Value:
        """beta/alpha_s [kg/m3/s]."""
        re = particle_reynolds(slip, gas, solids)
        return stokes(gas, solids) * schiller_naumann_factor(re)


@register("drag", "clift-gauvin")
@dataclass(frozen=True)
class CliftGauvin(Drag):
    """Clift-Gauvin drag of a lone grain, one formula up to the drag crisis.

        beta = (3/4) C_D rho_g a u/d,  Re = rho_g d u/mu_g
        C_D  = 24/Re (1 + 0.15 Re^0.687) + 0.42/(1 + 4.25e4 Re^-1.16)

    Validity: a < 0.01, Re < 3e5.
    Source: Clift and Gauvin (1970), Proc. Chemeca 70, 14-28.
    """

    def specific(self, alpha_s: Value, slip: Value, gas: Fluid, solids: Solids) -> Value:
        """beta/alpha_s [kg/m3/s]."""
        re = particle_reynolds(slip, gas, solids)
        power = safe_pow(re, 1.16, _TINY_RE)
        inertial = 0.42 / 24 * re * power / (power + 4.25e4)
        return stokes(gas, solids) * (1 + 0.15 * safe_pow(re, 0.687, _TINY_RE) + inertial)


@register("drag", "constant")
@dataclass(frozen=True)
class ConstantDrag(Drag):
    """Drag linear in the slip, for tests and estimates.

        beta = value a

    Validity: verification.
    Source: definition.
    """

    value: float = parameter(1e4, "kg/m3/s", "beta/alpha_s", gt=0)

    def specific(self, alpha_s: Value, slip: Value, gas: Fluid, solids: Solids) -> Value:
        """beta/alpha_s [kg/m3/s]."""
        return self.value

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Published correlations of conveying lines and turbulent ducts, to start from and compare with."""

from __future__ import annotations

import math

from scipy.optimize import brentq

from fem_tfm.closures.ops import Value, maximum
from fem_tfm.materials import Gas, Solids


def smooth_friction(reynolds: float) -> float:
    """Darcy friction factor f of a smooth pipe, 1/sqrt(f) = 2 log10(Re sqrt(f)) - 0.8 [-].

    Valid for 4e3 < Re < 1e7. Source: Prandtl and von Karman; Schlichting, Boundary-Layer Theory.
    """

    def error(f: float) -> float:
        return 1 / math.sqrt(f) - 2 * math.log10(reynolds * math.sqrt(f)) + 0.8

    return brentq(error, 1e-4, 1.0)


def laminar_equivalent(width: float, height: float) -> float:
    """Factor Re*/Re of a rectangular duct, 2/3 + 11/24 a (2 - a), a the shorter over the longer.

    With Re* the friction of a pipe holds, laminar within 2 % and turbulent within 5 %.
    Source: Jones (1976), J. Fluids Eng. 98, 173-180.
    """
    ratio = min(width, height) / max(width, height)
    return 2 / 3 + 11 / 24 * ratio * (2 - ratio)


def jones_friction(reynolds: float, width: float, height: float) -> float:
    """Darcy friction factor of a smooth rectangular duct, Re with the hydraulic diameter [-].

    Source: Jones (1976), J. Fluids Eng. 98, 173-180.
    """
    return smooth_friction(reynolds * laminar_equivalent(width, height))


def gnielinski(reynolds: float, prandtl: float) -> float:
    """Nusselt number of developed turbulent flow in smooth pipes and ducts [-].

        Nu = (f/8) (Re - 1000) Pr/(1 + 12.7 sqrt(f/8) (Pr^(2/3) - 1)),
        f = (1.82 log10 Re - 1.64)^-2

    Re with the hydraulic diameter. Valid for 3e3 < Re < 5e6, 0.5 < Pr < 2000, within 10 %.
    Source: Gnielinski (1976), Int. Chem. Eng. 16, 359-368.
    """
    share = (1.82 * math.log10(reynolds) - 1.64) ** -2 / 8
    spread = 1 + 12.7 * math.sqrt(share) * (prandtl ** (2 / 3) - 1)
    return share * (reynolds - 1000) * prandtl / spread


def friction_velocity(speed: float, width: float, viscosity: float) -> float:
    """u_tau = U sqrt(f/8) [m/s] of a smooth pipe at a kinematic viscosity [m2/s]."""
    return speed * math.sqrt(smooth_friction(speed * width / viscosity) / 8)


def sound_speed(gas: Gas) -> float:
    """sqrt(1.4 R T) of an ideal gas, 343 m/s of one by its density [m/s].

    1.4 is cp/cv of gases with two atoms a molecule; others are within 10 %.
    """
    if gas.pressure is None:
        return 343.0
    return math.sqrt(1.4 * gas.pressure / gas.density)


def cunningham(gas: Gas, diameter: float) -> float:
    """Factor by which the slip of a gas lowers the drag of a grain [-].

        C = 1 + Kn [1.257 + 0.4 exp(-1.1/Kn)],  Kn = 2 l/d,  l = (mu/rho) sqrt(pi/(2 R T))

    diameter : of the grain d [m]

    Source: Davies (1945), Proc. Phys. Soc. 57, 259-270.
    """
    path = gas.viscosity / gas.density * math.sqrt(1.4 * math.pi / 2) / sound_speed(gas)
    knudsen = 2 * path / diameter
    return 1 + knudsen * (1.257 + 0.4 * math.exp(-1.1 / knudsen))


# Reynolds number below which Stokes's drag is that of any law
CREEPING = 1e-12


def terminal_velocity(gas: Gas, solids: Solids, gravity: float) -> float:
    """Velocity at which one grain falls through the gas [m/s].

    Drag of Schiller and Naumann (1935), Z. Ver. Dtsch. Ing. 77, 318-320, with 0.44 from Re 1000 on.
    """
    d, excess = solids.diameter, abs(solids.density - gas.density)
    weight = 4 / 3 * excess / gas.density * gravity * d

    def surplus(speed: float) -> float:
        reynolds = gas.density * speed * d / gas.viscosity
        drag = 24 / reynolds * (1 + 0.15 * reynolds**0.687) if reynolds < 1000 else 0.44
        return drag * speed**2 - weight

    if not weight > 0:
        return 0.0
    # Stokes's drag is the least, and at most 19 times as much below Re 1000
    most = weight * gas.density * d / (24 * gas.viscosity)
    if gas.density * most * d / gas.viscosity < CREEPING:
        return most
    least = min(most / 20, 0.9 * math.sqrt(weight / 0.44))
    return brentq(surplus, least, 1.1 * most, xtol=1e-9 * least)


def rizk_velocity(
    mass_flow: float, diameter: float, gas: Gas, solids: Solids, gravity: float
) -> float:
    """Gas velocity at which grains begin to settle in a level line [m/s].

        M_s/(rho_g A U) = 10^-delta (U/sqrt(g D))^chi,  delta = 1440 d + 1.96, chi = 1100 d + 2.5

    mass_flow : of the solids [kg/s]
    diameter : of the pipe D [m]

    Made for grains of 0.1 to 2 mm. Source: Rizk (1973), dissertation, University of Karlsruhe.
    """
    if not mass_flow * gravity > 0:
        return 0.0
    delta, chi = 1440 * solids.diameter + 1.96, 1100 * solids.diameter + 2.5
    flux = mass_flow / (gas.density * math.pi / 4 * diameter**2)
    # a power of large grains is beyond the range of numbers, its logarithm is not
    wanted = math.log10(flux) + delta + chi / 2 * math.log10(gravity * diameter)
    return float(10 ** (wanted / (chi + 1)))


def konno_saito(flux: float, diameter: float, gravity: float) -> float:
    """Pressure gradient by the friction of conveyed grains, 0.057 G sqrt(g/D) [Pa/m].

    flux : G of the solids [kg/m2/s]
    diameter : hydraulic diameter D [m]

    Made for grains of 0.1 to 1 mm in dilute lines, level and rising, within 30 %. Source: Konno and
    Saito (1969), J. Chem. Eng. Japan 2, 211-217.
    """
    return 0.057 * flux * math.sqrt(gravity / diameter)


# the power law ends short of the wall, over half the hydraulic diameter
NEAREST = 0.01


def feed_velocity(gas_velocity: float, diameter: float, gas: Gas, solids: Solids) -> float:
    """Mean velocity of the solids at the inlet [m/s].

        u_s = U_g (1 - 0.68 d^0.92 rho_s^0.5 rho_g^-0.2 D^-0.54)

    gas_velocity : superficial U_g [m/s]
    diameter : hydraulic diameter of the section D [m]

    Not above zero for grains too large or heavy for the correlation. Source: eq. (22) of Ding et
    al. (2024), Appl. Sci. 14, 2031, all in SI units.
    """
    lag = 0.68 * solids.diameter**0.92 * solids.density**0.5
    return gas_velocity * (1 - lag * gas.density**-0.2 * diameter**-0.54)


def power_law(height: Value, radius: Value) -> Value:
    """Velocity at the inlet over that on the axis, (y/R)^(1/7) [-].

    height : distance y to the wall [m]
    radius : half the hydraulic diameter R [m]

    It ends short of the wall, at y/R = 0.01. Source: eqs. (20) and (21) of Ding et al. (2024),
    Appl. Sci. 14, 2031.
    """
    return maximum(height / radius, NEAREST) ** (1 / 7)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""What enters a line: velocity of the solids where a case does not give it, and the profile."""

from __future__ import annotations

from fem_tfm.closures.materials import Gas, Solids
from fem_tfm.closures.ops import Value, maximum

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

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Velocity at which a feeder hands the solids to the gas, where a case does not give it."""

from __future__ import annotations

from fem_tfm.closures.materials import Gas, Solids


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

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Common carrier gases: gas constant and viscosity, so that a case may name its gas."""

from __future__ import annotations

from dataclasses import dataclass

MOLAR_GAS_CONSTANT = 8.314462618


@dataclass(frozen=True)
class Species:
    """Ideal gas with Sutherland viscosity.

    R = R_u/M,   mu(T) = mu_0 (T/T_0)^{3/2} (T_0 + S)/(T + S)

    molar_mass : M [kg/mol]
    viscosity_0 : mu_0 at T_0 = 273 K and 1 bar [Pa s]
    sutherland : S [K]

    Valid at low pressure: within 2 % from 273 to 400 K and 4 % up to 600 K, compared with Huber
    and Harvey, CRC Handbook of Chemistry and Physics.
    Source: F. M. White, Viscous Fluid Flow, 3rd ed. 2006, table 1-2.
    """

    molar_mass: float
    viscosity_0: float
    sutherland: float

    @property
    def gas_constant(self) -> float:
        """R = R_u/M [J/kg/K]."""
        return MOLAR_GAS_CONSTANT / self.molar_mass

    def viscosity(self, temperature: float) -> float:
        """Sutherland's mu(T) [Pa s] at a temperature [K]."""
        t0, s = 273.0, self.sutherland
        return self.viscosity_0 * (temperature / t0) ** 1.5 * (t0 + s) / (temperature + s)


SPECIES = {
    "air": Species(28.9647e-3, 1.716e-5, 111.0),
    "Ar": Species(39.948e-3, 2.125e-5, 144.0),
    "CO": Species(28.0101e-3, 1.657e-5, 136.0),
    "CO2": Species(44.0095e-3, 1.370e-5, 222.0),
    "H2": Species(2.01588e-3, 8.411e-6, 97.0),
    "N2": Species(28.0134e-3, 1.663e-5, 107.0),
    "O2": Species(31.9988e-3, 1.919e-5, 139.0),
}

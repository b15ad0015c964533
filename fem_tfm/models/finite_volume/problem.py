# SPDX-License-Identifier: LGPL-3.0-or-later
"""The unsteady two-fluid problem in numbers and laws, in SI units; the mesh is given apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fem_tfm.materials import Gas, Solids
from fem_tfm.models.pointwise import (
    PACKING_PRESSURE,
    VOID_FRACTION,
    ClosureSet,
    Pointwise,
    Regularisation,
)

# granular temperature of a void where the problem asks for none [m2/s2]
SMALLEST_THETA = 1e-12


@dataclass(frozen=True)
class UnsteadyProblem:
    """Materials, laws, forces, scales and boundary data of an unsteady flow.

    gas, solids : materials; the gas flows alone where `solids` is None
    closures : one law of each family, those of the walls among them
    gravity : acceleration (3,) [m/s2]
    gas_velocity : superficial velocity, the velocity scale U [m/s]
    diameter : hydraulic diameter, the length scale D [m]
    wall_offset : height at which the wall law of the gas holds [m]
    theta_floor : smallest granular temperature [m2/s2]
    grain_gap : height over which the drag fades to the wall [m], 0 for none
    inlet_profile : "power-law" or "uniform"
    solids_intensity, gas_intensity : turbulence intensity of each phase at the inlet [-]
    length_scale : size of the eddies at the inlet over D [-]
    second_order : limited linear values in space and BDF2 in time, or upwind values and Euler
    compressible : the density of the gas follows the pressure at constant temperature
    reference_pressure : absolute pressure at which a compressible gas has its density [Pa]
    outlet_pressure : absolute pressure at the outlet [Pa], None for the reference pressure
    """

    gas: Gas
    solids: Solids | None
    closures: ClosureSet
    gravity: npt.NDArray[np.float64]
    gas_velocity: float
    diameter: float
    wall_offset: float
    theta_floor: float = 1e-8
    grain_gap: float = 0.0
    inlet_profile: str = "power-law"
    solids_intensity: float = 0.0
    gas_intensity: float = 0.05
    length_scale: float = 0.07
    second_order: bool = False
    compressible: bool = False
    reference_pressure: float | None = None
    outlet_pressure: float | None = None

    def pointwise(self) -> Pointwise:
        """Coefficients of both phases in cells, regularised by the scales of the problem."""
        density = self.solids.density if self.solids else 0.0
        regularisation = Regularisation.scaled(
            self.gas_velocity,
            self.diameter,
            self.solids,
            # the finite volumes divide by Theta
            max(self.theta_floor, SMALLEST_THETA),
            self.grain_gap,
            void_fraction=VOID_FRACTION,
            packing_pressure=PACKING_PRESSURE * density * self.gas_velocity**2,
        )
        return Pointwise(self.gas, self.solids, self.closures, regularisation, self.diameter)

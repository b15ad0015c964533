# SPDX-License-Identifier: LGPL-3.0-or-later
"""Coefficients of both phases in cells: what the laws of a case make of a state.

Arrays over any set of cells go in, arrays over the same cells come out; nothing here knows faces,
neighbours or matrices.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import Self

import numpy as np

from fem_tfm.case import Case
from fem_tfm.closures.granular import Kinetic, algebraic_theta
from fem_tfm.closures.turbulence import Eddies
from fem_tfm.closures.walls import GasWallState, WallState
from fem_tfm.models.unsteady.state import (
    LONELY_FRACTION,
    SMALLEST_FRACTION,
    SMALLEST_THETA,
    Rates,
)
from fem_tfm.solvers.cells import Array

# viscosity and conduction of grains, which laws keep finite in a void, fade below this fraction
FADING_FRACTION = 1e-4
# largest viscosity of the solids over rho_s U D
MOST_VISCOUS = 100.0
# speeds that regularise drag and walls, and shear, over U and U/D
SLIP_FLOOR, SHEAR_FLOOR = 1e-4, 1e-3
# step of the slip, over itself, for the slope of the drag
SLIP_STEP = 1e-3


@dataclass(frozen=True)
class Grains:
    """Coefficients of the solids in cells.

    kinetic : of kinetic theory
    g0 : radial distribution [-]
    p_f, mu_f : frictional pressure [Pa] and viscosity [Pa s]
    """

    kinetic: Kinetic
    g0: Array
    p_f: Array
    mu_f: Array


@dataclass(frozen=True)
class LocalGas:
    """Gas as a law sees it, its density an array over cells.

    density : [kg/m3]
    viscosity : [Pa s]
    """

    density: Array
    viscosity: float


class CellLaws:
    """The laws of a case, evaluated on arrays.

    Parameters
    ----------
    case : laws, materials, scales
    """

    def __init__(self, case: Case) -> None:
        self.gas, self.solids = case.gas_material, case.solids_material
        self.laws, self.walls = case.closures, case.walls
        self.speed = case.operation.gas_superficial_velocity
        self.width = case.geometry.hydraulic_diameter

    def of(self, relative: Array) -> Self:
        """The laws in cells where the gas has this density over that of the case [-]."""
        found = copy.copy(self)
        found.gas = LocalGas(relative * self.gas.density, self.gas.viscosity)
        return found

    # -- solids --------------------------------------------------------------------------------

    def rates(self, gradient: Array, dilation: Array) -> Rates:
        """Deformation from the gradient of u_s (cells, 3, 3) and its divergence [1/s]."""
        strain = (gradient + np.swapaxes(gradient, 1, 2)) / 2
        trace = np.einsum("nii->n", strain)
        shear = np.einsum("nij,nij->n", strain, strain) - trace**2 / 3
        return Rates(gradient, np.maximum(shear, 0.0), dilation)

    def solids_pressure(self, alpha: Array, theta: Array, rates: Rates) -> Array:
        """p_s of kinetic theory and friction [Pa]."""
        laws, solids = self.laws, self.solids
        alpha = np.maximum(alpha, 0.0)
        g0 = laws.radial.g0(alpha, solids)
        kinetic = laws.granular.pressure(alpha, theta, g0, solids)
        friction = laws.friction.stress(alpha, theta, rates.shear, rates.dilation, solids)
        return kinetic + friction.pressure

    def grains(self, alpha: Array, theta: Array, rates: Rates) -> Grains:
        """Coefficients of kinetic theory and friction."""
        laws, solids = self.laws, self.solids
        alpha = np.maximum(alpha, 0.0)
        g0 = laws.radial.g0(alpha, solids)
        kinetic = laws.granular.coefficients(alpha, theta, g0, solids, self.width)
        # its square leaves less to diffuse through a void than moves there: fewer iterations
        fade = alpha**2 / (alpha**2 + FADING_FRACTION**2)
        kinetic = kinetic._replace(
            shear_viscosity=fade * kinetic.shear_viscosity,
            conductivity=fade * kinetic.conductivity,
        )
        friction = laws.friction.stress(alpha, theta, rates.shear, rates.dilation, solids)
        cap = MOST_VISCOUS * solids.density * self.speed * self.width
        zero = np.zeros_like(alpha)
        viscosity = np.minimum(zero + friction.viscosity, cap)
        return Grains(kinetic, g0, zero + friction.pressure, viscosity)

    def balanced_theta(self, alpha: Array, grains: Grains, shear: Array, beta: Array) -> Array:
        """Granular temperature where production equals dissipation and drag [m2/s2]."""
        found = algebraic_theta(
            alpha, grains.g0, shear, 0.0, self.laws.granular, self.solids, self.width, beta
        )
        alone = alpha < LONELY_FRACTION
        return np.clip(found, SMALLEST_THETA, np.where(alone, self.speed**2, np.inf))

    # -- between the phases, and gas -----------------------------------------------------------

    def drag(self, alpha: Array, slip: Array) -> Array:
        """beta [kg/m3/s] at u_g - u_s (cells, 3) [m/s]."""
        floor = SLIP_FLOOR * self.speed
        speed = np.sqrt(np.einsum("ni,ni->n", slip, slip) + floor**2)
        return self.laws.drag.beta(
            np.maximum(alpha, SMALLEST_FRACTION), speed, self.gas, self.solids
        )

    def steepness(self, alpha: Array, slip: Array, beta: Array) -> Array:
        """|u| d(beta)/d|u| [kg/m3/s] at u = u_g - u_s (cells, 3) [m/s], of which beta is known."""
        rise = (self.drag(alpha, (1 + SLIP_STEP) * slip) - beta) / SLIP_STEP
        return np.maximum(rise, 0.0)

    def gas_viscosity(self, gradient: Array, distance: Array) -> Array:
        """mu_g + mu_t [Pa s] at grad u_g (cells, 3, 3) [1/s] and a distance to the wall [m]."""
        strain = (gradient + np.swapaxes(gradient, 1, 2)) / 2
        trace = np.einsum("nii->n", strain)
        shear = 2 * (np.einsum("nij,nij->n", strain, strain) - trace**2 / 3)
        rate = np.sqrt(np.maximum(shear, 0.0) + (SHEAR_FLOOR * self.speed / self.width) ** 2)
        eddies = Eddies(rate, distance, self.gas, self.width / 2)
        return self.gas.viscosity + self.laws.turbulence.viscosity(eddies)

    # -- walls ---------------------------------------------------------------------------------

    def slip(self, velocity: Array, normal: Array) -> Array:
        """Speed along walls of unit normals `normal` [m/s]."""
        along = velocity - np.einsum("ni,ni->n", velocity, normal)[:, None] * normal
        floor = SLIP_FLOOR * self.speed
        return np.sqrt(np.einsum("ni,ni->n", along, along) + floor**2)

    def wall_state(
        self, alpha: Array, theta: Array, grains: Grains, slip: Array, at: Array
    ) -> WallState:
        """What the wall law of the solids sees in the cells `at` of a wall."""
        alpha = np.maximum(alpha[at], 0.0)
        return WallState(alpha, theta[at], grains.g0[at], grains.p_f[at], slip)

    def wall_heat(self, state: WallState) -> Array:
        """Flux from a wall into the granular energy [W/m2]."""
        return np.zeros_like(state.slip) + self.walls.solids.heat(state, self.solids)

    def solids_friction(self, state: WallState) -> Array:
        """c [Pa s/m] of the traction -c u of a wall on the solids."""
        return np.zeros_like(state.slip) + self.walls.solids.friction(state, self.solids)

    def gas_friction(self, void: Array, slip: Array, height: Array) -> Array:
        """c [Pa s/m] of the traction -c u of a wall on gas of a speed found at a height [m]."""
        c = self.walls.gas.coefficient(GasWallState(slip, height, self.gas))
        return void * (np.zeros_like(slip) + c)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Coefficients of both phases in cells: what the laws make of a state.

Arrays over any set of cells go in, arrays over the same cells come out; nothing here knows faces,
neighbours or matrices.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from fem_tfm.closures.granular import Kinetic, algebraic_theta
from fem_tfm.closures.turbulence.gas import Eddies, realizable_slope
from fem_tfm.closures.walls.gas import GasWallState
from fem_tfm.closures.walls.solids import WallState
from fem_tfm.models.finite_volume.cells.mesh import Array
from fem_tfm.models.finite_volume.problem import UnsteadyProblem
from fem_tfm.models.finite_volume.state import (
    LONELY_FRACTION,
    SMALLEST_FRACTION,
    SMALLEST_THETA,
    SolidsDeformation,
)

# viscosity and conduction of grains, which laws keep finite in a void, fade below this fraction
FADING_FRACTION = 1e-4
# largest viscosity of the solids over rho_s U D
MOST_VISCOUS = 100.0
# speeds that regularise drag and walls, and shear, over U and U/D
SLIP_FLOOR, SHEAR_FLOOR = 1e-4, 1e-3
# step of the slip, over itself, for the slope of the drag
SLIP_STEP = 1e-3


@dataclass(frozen=True)
class SolidsCoefficients:
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


def _deviator(gradient: Array) -> tuple[Array, list[Array]]:
    """Gradient (9, cells), and xx, yy, zz, xy, xz, yz of its symmetric part without trace."""
    # one array for each component, which is several times as fast as one of tensors
    d = np.ascontiguousarray(gradient.reshape(-1, 9).T)
    third = (d[0] + d[4] + d[8]) / 3
    pairs = ((1, 3), (2, 6), (5, 7))
    return d, [*(d[i] - third for i in (0, 4, 8)), *((d[i] + d[j]) / 2 for i, j in pairs)]


class CellLaws:
    """The laws of a problem, evaluated on arrays.

    Parameters
    ----------
    problem : laws, materials, scales
    """

    def __init__(self, problem: UnsteadyProblem) -> None:
        self.gas, self.solids = problem.gas, problem.solids
        self.laws = problem.closures
        self.speed = problem.gas_velocity
        self.width = problem.diameter
        self.gap = problem.grain_gap

    def of(self, relative: Array) -> Self:
        """The laws in cells where the gas has this density over the reference [-]."""
        found = copy.copy(self)
        found.gas = LocalGas(relative * self.gas.density, self.gas.viscosity)
        return found

    def within(self, which: Any) -> Self:
        """The laws in some of the cells in which these hold."""
        if not isinstance(self.gas, LocalGas):
            return self
        found = copy.copy(self)
        found.gas = replace(self.gas, density=self.gas.density[which])
        return found

    # -- solids --------------------------------------------------------------------------------

    def deformation(self, gradient: Array, dilation: Array) -> SolidsDeformation:
        """Deformation from the gradient of u_s (cells, 3, 3) and its divergence [1/s]."""
        xx, yy, zz, xy, xz, yz = _deviator(gradient)[1]
        shear = xx * xx + yy * yy + zz * zz + 2 * (xy * xy + xz * xz + yz * yz)
        return SolidsDeformation(gradient, shear, dilation)

    def solids_pressure(
        self, alpha: Array, theta: Array, deformation: SolidsDeformation, lift: Array | float = 0.0
    ) -> Array:
        """p_s of kinetic theory and friction, and of a normal stress `lift` over a rho_s [Pa]."""
        laws, solids = self.laws, self.solids
        alpha = np.maximum(alpha, 0.0)
        g0 = laws.radial.g0(alpha, solids)
        kinetic = laws.granular.pressure(alpha, theta, g0, solids)
        friction = laws.friction.stress(
            alpha, theta, deformation.shear, deformation.dilation, solids
        )
        return kinetic + friction.pressure + alpha * solids.density * lift

    def grains(
        self, alpha: Array, theta: Array, deformation: SolidsDeformation
    ) -> SolidsCoefficients:
        """Coefficients of kinetic theory and friction."""
        laws, solids = self.laws, self.solids
        alpha = np.maximum(alpha, 0.0)
        g0, kinetic = self.kinetic(alpha, theta)
        friction = laws.friction.stress(
            alpha, theta, deformation.shear, deformation.dilation, solids
        )
        cap = MOST_VISCOUS * solids.density * self.speed * self.width
        zero = np.zeros_like(alpha)
        viscosity = np.minimum(zero + friction.viscosity, cap)
        return SolidsCoefficients(kinetic, g0, zero + friction.pressure, viscosity)

    def kinetic(self, alpha: Array, theta: Array) -> tuple[Array, Kinetic]:
        """g0 and the coefficients of kinetic theory, at alpha >= 0."""
        g0 = self.laws.radial.g0(alpha, self.solids)
        found = self.laws.granular.coefficients(alpha, theta, g0, self.solids, self.width)
        # its square leaves less to diffuse through a void than moves there: fewer iterations
        fade = alpha**2 / (alpha**2 + FADING_FRACTION**2)
        return g0, found._replace(
            shear_viscosity=fade * found.shear_viscosity, conductivity=fade * found.conductivity
        )

    def balanced_theta(
        self, alpha: Array, grains: SolidsCoefficients, shear: Array, beta: Array
    ) -> Array:
        """Granular temperature where production equals dissipation and drag [m2/s2]."""
        found = algebraic_theta(
            alpha, grains.g0, shear, 0.0, self.laws.granular, self.solids, self.width, beta
        )
        alone = alpha < LONELY_FRACTION
        return np.clip(found, SMALLEST_THETA, np.where(alone, self.speed**2, np.inf))

    # -- between the phases, and gas -----------------------------------------------------------

    def slip_speed(self, slip: Array) -> Array:
        """|u_g - u_s| of the difference (cells, 3), kept off zero [m/s]."""
        floor = SLIP_FLOOR * self.speed
        return np.sqrt(np.einsum("ni,ni->n", slip, slip) + floor**2)

    def drag(self, alpha: Array, speed: Array, distance: Array) -> Array:
        """beta [kg/m3/s] at a slip speed [m/s] and a distance to the wall [m].

        It fades as y^2/(y^2 + gap^2) next to the wall, which the grains' centres cannot reach.
        """
        alpha = np.maximum(alpha, SMALLEST_FRACTION)
        found = self.laws.drag.beta(alpha, speed, self.gas, self.solids)
        return found * distance**2 / (distance**2 + self.gap**2) if self.gap else found

    def steep_drag(self, alpha: Array, slip: Array, distance: Array) -> tuple[Array, Array]:
        """beta and its growth |u| d(beta)/d|u| >= 0 at u = u_g - u_s (cells, 3) [kg/m3/s]."""
        speed = self.slip_speed(slip)
        # at both speeds at once, which share what the fraction makes
        both = self.drag(alpha, np.stack([speed, (1 + SLIP_STEP) * speed]), distance)
        beta, beyond = np.broadcast_to(both, (2, alpha.size))
        return beta, np.maximum((beyond - beta) / SLIP_STEP, 0.0)

    def gas_viscosity(self, gradient: Array, height: Array, slope: Array) -> Array:
        """Viscosity [Pa s] that the profile at height y' [m] shows at grad u_g [1/s].

        (mu_g + mu_t)/(dy'/dy); grad u_g (cells, 3, 3), slope dy'/dy
        """
        eddies = self.eddies(gradient, height, slope)
        return (self.gas.viscosity + self.laws.turbulence.viscosity(eddies)) / slope

    def eddies(
        self,
        gradient: Array,
        height: Array,
        slope: Array | float,
        k: Array | None = None,
        eps: Array | None = None,
    ) -> Eddies:
        """What a law of turbulence sees of a phase, at the gradient of its velocity [1/s].

        height, slope : y' [m] and dy'/dy of its profile
        """
        d, (xx, yy, zz, xy, xz, yz) = _deviator(gradient)
        shear = 2 * (xx * xx + yy * yy + zz * zz) + 4 * (xy * xy + xz * xz + yz * yz)
        shear += (SHEAR_FLOOR * self.speed / self.width) ** 2
        found = Eddies(np.sqrt(shear) / slope, height, self.gas, self.width / 2)
        if k is None:
            return found
        turn = ((d[1] - d[3]) ** 2 + (d[2] - d[6]) ** 2 + (d[5] - d[7]) ** 2) / 2
        # S_ij S_jk S_ki = 3 det S without trace
        det = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
        return replace(
            found,
            spin=np.sqrt(shear / 2 + turn) / slope,
            A_s=realizable_slope(3 * math.sqrt(6) * det / (shear / 2) ** 1.5),
            k=k,
            eps=eps,
        )

    # -- walls ---------------------------------------------------------------------------------

    def slip(self, velocity: Array, normal: Array) -> Array:
        """Speed along walls of unit normals `normal` [m/s]."""
        along = velocity - np.einsum("ni,ni->n", velocity, normal)[:, None] * normal
        floor = SLIP_FLOOR * self.speed
        return np.sqrt(np.einsum("ni,ni->n", along, along) + floor**2)

    def wall_state(
        self, alpha: Array, theta: Array, grains: SolidsCoefficients, slip: Array, at: Array
    ) -> WallState:
        """What the wall law of the solids sees in the cells `at` of a wall."""
        alpha = np.maximum(alpha[at], 0.0)
        return WallState(alpha, theta[at], grains.g0[at], grains.p_f[at], slip)

    def wall_heat(self, state: WallState) -> Array:
        """Flux from a wall into the granular energy [W/m2]."""
        return np.zeros_like(state.slip) + self.laws.solids_wall.heat(state, self.solids)

    def solids_friction(self, state: WallState) -> Array:
        """c [Pa s/m] of the traction -c u of a wall on the solids."""
        return np.zeros_like(state.slip) + self.laws.solids_wall.friction(state, self.solids)

    def gas_friction(
        self, void: Array | float, slip: Array, height: Array, k: Array | None = None
    ) -> Array:
        """c [Pa s/m] of the traction -c u of a wall on gas of a speed found at a height [m]."""
        c = self.laws.gas_wall.coefficient(GasWallState(slip, height, self.gas, k))
        return void * (np.zeros_like(slip) + c)

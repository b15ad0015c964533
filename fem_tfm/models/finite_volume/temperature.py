# SPDX-License-Identifier: LGPL-3.0-or-later
"""Granular temperature equation: implicit, its sinks in the diagonal, so that Theta > 0.

    3/2 [alpha rho Theta]_t + 3/2 div(alpha rho u_s Theta)
        = 2 mu S:S + (bulk div u_s - p_kin) div u_s + div(kappa grad Theta) - gamma - 3 beta Theta
          + production by slip

Sinks are divided by the Theta of the coefficients and multiplied by the new one.
"""

from __future__ import annotations

import numpy as np

from fem_tfm.models.finite_volume.cells.line import LineMesh
from fem_tfm.models.finite_volume.cells.mesh import Array
from fem_tfm.models.finite_volume.cells.transport import ScalarTransport
from fem_tfm.models.finite_volume.problem import UnsteadyProblem
from fem_tfm.models.finite_volume.state import SMALLEST_FRACTION
from fem_tfm.models.finite_volume.time_levels import Step
from fem_tfm.models.pointwise import Pointwise, SolidsCoefficients, tangential
from fem_tfm.models.solids_wall import HalfCell, at_wall


class GranularTemperature:
    """The equation with its sources.

    Parameters
    ----------
    problem : turbulence intensity of the solids at the inlet
    line, laws : mesh and coefficients
    transport : solver of scalars
    """

    def __init__(
        self,
        problem: UnsteadyProblem,
        line: LineMesh,
        laws: Pointwise,
        transport: ScalarTransport,
    ) -> None:
        self.line, self.laws, self.transport = line, laws, transport
        self._intensity = problem.solids_intensity
        self._lonely = laws.free_fraction
        self._fast = problem.gas_velocity**2 + np.linalg.norm(problem.gravity) * problem.diameter

    def solve(self, step: Step) -> tuple[Array, int]:
        """Granular temperature in all cells [m2/s2], and the iterations (collective).

        Raises
        ------
        SolverError
            the linear solver does not converge.
        """
        line, laws, solids = self.line, self.laws, step.solids
        own, theta, shear = line.own, step.state.theta, step.deformation.shear
        alpha, dilation = np.maximum(solids.alpha, 0.0), self._dilation(step)
        coefficients = laws.coefficients(alpha, theta, shear, dilation, step.beta)
        if laws.closures.theta == "algebraic":
            found = self._relaxed(step, alpha, coefficients.g0, dilation)
            return self._bounded(found, alpha), 0
        start, density = step.levels.start, laws.solids.density
        inertia = 1.5 * density * np.maximum(start.alpha[own], SMALLEST_FRACTION)
        inertia = inertia * line.volume / step.levels.span
        sink, source = self._sources(step, coefficients, dilation)
        diagonal, rhs = inertia + sink, inertia * start.theta[own] + source
        if line.has_wall:
            self._add_wall(step, coefficients, diagonal, rhs)
        values, iterations = self.transport.solve(
            1.5 * density * solids.flux,
            coefficients.kinetic.conductivity,
            diagonal,
            rhs,
            guess=theta[own],
            entering=(self._intensity * step.inflow.solids_velocity) ** 2,
            share=step.levels.second_order_faces,
        )
        return line.cells.ghosted(self._bounded(values, alpha[own])), iterations

    def _relaxed(self, step: Step, alpha: Array, g0: Array, dilation: Array) -> Array:
        """Theta on its way to the value where production equals dissipation and drag.

            Theta = Theta_0 + r dt/(1 + r dt) (Theta_eq - Theta_0),
            r = [gamma/Theta_eq + 3 beta + p/Theta_eq max(D, 0)]/(3/2 alpha rho)

        Grains that hardly collide within a step do not reach that value in it; if they did, their
        pressure would drive the motion that feeds it. No step makes more of it than the motion
        within a cell can give.
        """
        laws, shear, now = self.laws, step.deformation.shear, step.levels.now.theta
        expansion = np.maximum(dilation, 0.0)
        wanted = laws.algebraic_theta(alpha, g0, shear, step.beta, expansion)
        kinetic = laws.kinetic(alpha, wanted, step.beta)[1]
        decay = (kinetic.dissipation + kinetic.pressure * expansion) / wanted + 3 * step.beta
        inertia = 1.5 * laws.grain.density * np.maximum(alpha, SMALLEST_FRACTION) / step.dt
        found = now + decay / (decay + inertia) * (wanted - now)
        return np.minimum(found, now + shear * self.line.cells.volume ** (2 / 3))

    def _dilation(self, step: Step) -> Array:
        """div u_s [1/s] that feeds the granular energy: the larger of two, where they disagree.

        One is that of the fluxes of this step, the other that predicted. Dense grains heat up a
        thousand times faster than they are compressed; a compression that only one of two steps
        shows would drive pressure waves. At second order the step's own value holds where both
        compress or the step expands.
        """
        found, predicted = step.solids.dilation, step.deformation.dilation
        larger = np.maximum(found, predicted)
        agreed = ((found < 0) & (predicted < 0)) | (found > 0)
        return larger + step.levels.second_order * agreed * (found - larger)

    def _sources(
        self, step: Step, coefficients: SolidsCoefficients, dilation: Array
    ) -> tuple[Array, Array]:
        """Sinks over Theta [kg/s] and sources [W] of the owned cells."""
        own, volume, state = self.line.own, self.line.volume, step.state
        theta, shear = state.theta, step.deformation.shear
        alpha, slip = np.maximum(state.alpha, SMALLEST_FRACTION), state.u_g - state.u_s
        energy = self.laws.granular_energy(
            coefficients, alpha, theta, shear, dilation, step.beta, slip
        )
        sink = energy.decay + np.maximum(energy.compression, 0.0) / theta
        source = energy.production + np.maximum(-energy.compression, 0.0)
        given = step.inflow.sources.energy
        sink = sink[own] * volume + np.maximum(-given, 0.0) / theta[own] * volume
        return sink, (source[own] + np.maximum(given, 0.0)) * volume

    def _add_wall(
        self, step: Step, coefficients: SolidsCoefficients, diagonal: Array, rhs: Array
    ) -> None:
        """Add the energy that the wall gives to `rhs`, and what it takes to `diagonal`."""
        line, cells, laws, state = self.line, self.line.cells, self.laws, step.state
        edge = cells.first[line.wall]
        slip = tangential(state.u_s[edge], line.normal[line.wall])
        alpha = np.maximum(step.solids.alpha, 0.0)
        centre = laws.wall_state(alpha, state.theta, coefficients, slip, edge)
        viscosity = coefficients.viscosity[edge]
        if step.turbulence is not None:
            eddies = alpha * laws.solids.density * step.turbulence.nu_s
            viscosity = viscosity + eddies[edge]
        near = line.inverse_distance[line.wall]
        conductance = coefficients.kinetic.conductivity[edge] * near
        square, dilation = step.deformation.at(edge)
        half = HalfCell.beside(laws, centre, square, dilation, step.solids.wall_rise)
        heat = at_wall(laws, half, viscosity * near, conductance)[1]
        heat = heat * cells.face_area[line.wall]
        cells.add_boundary("wall", rhs, np.maximum(heat, 0.0))
        cells.add_boundary("wall", diagonal, np.maximum(-heat, 0.0) / state.theta[edge])

    def _bounded(self, theta: Array, alpha: Array) -> Array:
        """Theta above its floor, and below U^2 + g D of grains that meet the wall, and no other."""
        single = alpha < self._lonely
        theta[single] = np.minimum(theta[single], self._fast)
        return np.maximum(theta, self.laws.regularisation.theta_floor)

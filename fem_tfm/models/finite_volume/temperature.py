# SPDX-License-Identifier: LGPL-3.0-or-later
"""Granular temperature of a step: implicit, its sinks in the diagonal."""

from __future__ import annotations

import numpy as np

from fem_tfm.models.finite_volume.cells.line import LineMesh
from fem_tfm.models.finite_volume.cells.matrix import CellMatrix
from fem_tfm.models.finite_volume.cells.mesh import Array
from fem_tfm.models.finite_volume.cells.transport import ScalarTransport
from fem_tfm.models.finite_volume.problem import UnsteadyProblem
from fem_tfm.models.finite_volume.state import (
    LONELY_FRACTION,
    SMALLEST_FRACTION,
    Inflow,
    SolidsDeformation,
    SolidsTransport,
    State,
)
from fem_tfm.models.finite_volume.time_levels import TimeLevels
from fem_tfm.models.pointwise import Pointwise, SolidsCoefficients, tangential


class GranularTemperature:
    """Moves the granular energy with the solids, makes and loses it.

    Parameters
    ----------
    problem : turbulence intensity of the solids at the inlet
    line, laws : mesh and coefficients
    matrix : scalar matrix, whose values are overwritten
    """

    def __init__(
        self, problem: UnsteadyProblem, line: LineMesh, laws: Pointwise, matrix: CellMatrix
    ) -> None:
        self.line, self.laws = line, laws
        self._intensity = problem.solids_intensity
        self.transport = ScalarTransport(line, matrix)

    def solve(
        self,
        old: State,
        beta: Array,
        levels: TimeLevels,
        start: State,
        transported: SolidsTransport,
        deformation: SolidsDeformation,
        inflow: Inflow,
        effort: dict[str, int],
    ) -> Array:
        """Granular temperature after a step from `start` [m2/s2] (collective).

        old, beta : state of which coefficients are taken, and its drag [kg/m3/s]

        Raises
        ------
        SolverError
            the linear solver does not converge.
        """
        line, cells, laws = self.line, self.line.cells, self.laws
        alpha = np.maximum(transported.alpha, 0.0)
        # dense grains heat up thousandfold faster than they are compressed: what only one of two
        # steps compresses would drive waves of their pressure
        dilation = np.maximum(transported.dilation, deformation.dilation)
        if line.order:
            # what both compress is compressed as the step says
            both = (transported.dilation < 0) & (deformation.dilation < 0)
            trusted = levels.second_order * (both | (transported.dilation > 0))
            dilation = dilation + trusted * (transported.dilation - dilation)
        grains = laws.coefficients(alpha, old.theta, deformation.shear, dilation)
        if laws.closures.theta == "algebraic":
            found = laws.algebraic_theta(alpha, grains.g0, deformation.shear, beta)
            return self._bounded(found, alpha)
        own = line.own
        density = laws.solids.density
        mass = 1.5 * density * np.maximum(start.alpha[own], SMALLEST_FRACTION)
        inertia = mass * line.volume / levels.span
        made = laws.granular_energy(grains, old.theta, deformation.shear, dilation, beta)
        sink = made.decay + np.maximum(made.compression, 0.0) / old.theta
        gain = made.production + np.maximum(-made.compression, 0.0)
        energy = inflow.sources.energy
        diagonal = inertia + sink[own] * line.volume
        diagonal += np.maximum(-energy, 0.0) / old.theta[own] * line.volume
        rhs = inertia * start.theta[own] + (gain[own] + np.maximum(energy, 0.0)) * line.volume
        if line.has_wall:
            heat = self._wall_heat(old, alpha, grains) * cells.face_area[line.wall]
            edge = cells.first[line.wall]
            cells.add_boundary("wall", rhs, np.maximum(heat, 0.0))
            cells.add_boundary("wall", diagonal, np.maximum(-heat, 0.0) / old.theta[edge])
        found = self.transport.solve(
            1.5 * density * transported.flux,
            grains.kinetic.conductivity,
            diagonal,
            rhs,
            old.theta[own],
            entering=(self._intensity * inflow.solids_velocity) ** 2,
            linear=levels.second_order_faces if line.order else None,
        )
        effort["theta"] = self.transport.iterations
        return cells.ghosted(self._bounded(found, alpha[own]))

    def _bounded(self, theta: Array, alpha: Array) -> Array:
        """Theta above its floor; grains that are all but alone do not fly faster than the gas."""
        alone = alpha < LONELY_FRACTION
        theta[alone] = np.minimum(theta[alone], self.line.velocity_scale**2)
        return np.maximum(theta, self.laws.regularisation.theta_floor)

    def _wall_heat(self, old: State, alpha: Array, grains: SolidsCoefficients) -> Array:
        """Flux from the faces of the wall into the granular energy [W/m2]."""
        edge = self.line.cells.first[self.line.wall]
        slip = tangential(old.u_s[edge], self.line.normal[self.line.wall])
        state = self.laws.wall_state(alpha, old.theta, grains, slip, edge)
        return self.laws.solids_wall_heat(state)

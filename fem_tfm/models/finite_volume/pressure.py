# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pressure equation: the projection that makes the flux of both phases fulfil its balance.

The change of the pressure accelerates the phases against their inertia and drag alone,

    delta(u_i.S) = -sum_j R_ij alpha_j |S|^2/(S.d) delta(p_other - p),
    R = [[m_s/dt + beta, -beta], [-beta, m_g/dt + beta]]^-1,  m_i = alpha_i rho_i

and is such that div(alpha_s u_s + alpha_g u_g) = sources, or that the mass of a compressible gas is
balanced.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import reduce
from operator import add
from typing import Any

import numpy as np

from fem_tfm.errors import SolverError
from fem_tfm.models.finite_volume.cells.krylov import Krylov
from fem_tfm.models.finite_volume.cells.line import LineMesh
from fem_tfm.models.finite_volume.cells.matrix import CellMatrix
from fem_tfm.models.finite_volume.cells.mesh import Array
from fem_tfm.models.finite_volume.scheme import FirstOrder
from fem_tfm.models.finite_volume.state import SMALLEST_FRACTION, Phase, State
from fem_tfm.models.finite_volume.time_levels import Step
from fem_tfm.models.pointwise import Pointwise

# relative residual of the linear system, and the residual that ends it, over rho_g U^2
TOLERANCE, SMALL_PRESSURE = 1e-6, 1e-9
# steps after which the multigrid is built anew, and iterations above which it is
MULTIGRID_AGE, MULTIGRID_EFFORT = 20, 15


@dataclass(frozen=True)
class _Fluxes:
    """Fluxes before the projection and how they follow the pressure; one entry for each phase.

    fractions (faces) : volume fractions [-]
    response (faces) : R, rows of velocities and columns of pressure gradients [m3 s/kg]
    flux (faces) : u_i.S with the present pressure [m3/s]
    mobility (faces) : u_i.S per pressure difference [m3/s/Pa]
    """

    fractions: list[Array]
    response: list[list[Array]]
    flux: list[Array]
    mobility: list[Array]

    @property
    def total(self) -> Array:
        """Flux of both phases [m3/s]."""
        return reduce(add, (a * flux for a, flux in zip(self.fractions, self.flux, strict=True)))

    @property
    def stiffness(self) -> Array:
        """Flux of both phases per pressure difference [m3/s/Pa]."""
        return reduce(add, (a * m for a, m in zip(self.fractions, self.mobility, strict=True)))


class PressureProjection:
    """The equation with its matrix and multigrid.

    Parameters
    ----------
    line, laws, scheme : mesh, coefficients, order
    compressible : the density of the gas follows the pressure
    """

    def __init__(
        self, line: LineMesh, laws: Pointwise, scheme: FirstOrder, compressible: bool = False
    ) -> None:
        self.line, self.laws, self.scheme = line, laws, scheme
        # without an outlet nothing sets the level of the pressure in a gas of constant density
        self._level_is_free = not (line.has_outlet or compressible)
        self._matrix = CellMatrix(line.cells)
        self._krylov = Krylov(self._matrix, "pressure", TOLERANCE)
        self._age = MULTIGRID_AGE

    def response(
        self, alpha: Array, beta: Array, dt: Array | float, density: Array | float
    ) -> tuple[Array, Array, Array]:
        """R_ss, R_sg = R_gs, R_gg on faces [m3 s/kg].

        alpha, beta : solids fraction [-] and drag [kg/m3/s] in all cells
        dt : step, one or of every face [s]
        density : of the gas, one or of every face [kg/m3]
        """
        alpha, beta = self.line.cells.to_faces(alpha), self.line.cells.to_faces(beta)
        gas = density * np.maximum(1 - alpha, SMALLEST_FRACTION) / dt
        solids = self.laws.solids.density * np.maximum(alpha, SMALLEST_FRACTION) / dt
        # (gas + beta)(solids + beta) - beta^2 without the difference
        determinant = gas * solids + beta * (gas + solids)
        return (gas + beta) / determinant, beta / determinant, (solids + beta) / determinant

    def project(
        self,
        step: Step,
        phases: list[Phase],
        velocities: list[Array],
        face_forces: list[Array],
    ) -> tuple[State, int]:
        """State with the pressure, velocities and fluxes after the step, and the iterations.

        velocities : of the phases with the present pressure (cells, 3) [m/s]
        face_forces : forces along the normals of faces in excess of those of the cells [N/m3]

        Collective. Raises SolverError where the linear solver does not converge.
        """
        line, cells = self.line, self.line.cells
        fluxes = self._fluxes(step, phases, velocities, face_forces)
        total, stiffness = fluxes.total, fluxes.stiffness
        sources = step.inflow.sources
        growth = (sources.solids + sources.gas) * line.volume
        capacity: Array | float
        if step.gas is None:
            weight, capacity, rhs = stiffness, 0.0, growth - cells.net_flux(total)
        else:
            weight = step.gas.flux_weight * stiffness
            capacity, rhs = step.gas.compressibility, -step.gas.residual(total)
        self._set(weight, capacity)
        change, iterations = self._solve(rhs)
        change = cells.ghosted(change)
        drop = self._difference(change)
        total = total - stiffness * drop
        if step.gas is None:
            total = self._close(total, growth)
        else:
            total, change = step.gas.close(total, change)
        corrections = [-mobility * drop for mobility in fluxes.mobility]
        velocities = [
            cells.ghosted(velocity[line.own] + line.reconstruct(flux / cells.face_area))
            for velocity, flux in zip(velocities, corrections, strict=True)
        ]
        state = replace(
            step.state,
            p=step.state.p + change,
            u_s=step.levels.start.u_s,
            u_g=velocities[-1],
            total_flux=total,
        )
        if len(phases) == 2:
            flux = fluxes.flux[0] + corrections[0]
            solids = self._solids(step, phases[0], fluxes.response[0][0], velocities[0], flux)
            state = replace(state, **solids)
        return state, iterations

    def _fluxes(
        self,
        step: Step,
        phases: list[Phase],
        velocities: list[Array],
        face_forces: list[Array],
    ) -> _Fluxes:
        """Fluxes of the phases with the present pressure, and how they follow its change."""
        line, cells, inflow = self.line, self.line.cells, step.inflow
        response, share = self._responses(step, phases), step.levels.second_order_faces[line.outlet]
        fractions = [phase.face_fraction for phase in phases]
        if line.has_inlet and len(phases) == 2:
            solids = fractions[0].copy()
            solids[line.inlet] = inflow.solids_fraction
            fractions = [solids, 1 - solids]
        fluxes, mobilities = [], []
        for row, phase, velocity in zip(response, phases, velocities, strict=True):
            flux = cells.flux(velocity)
            flux[line.outlet] += share * self.scheme.outflow(velocity)
            flux += cells.face_area * sum(
                r * force for r, force in zip(row, face_forces, strict=True)
            )
            flux *= line.open
            mobility = sum(r * a for r, a in zip(row, fractions, strict=True))
            mobility = mobility * cells.face_weight * line.open
            if line.has_inlet:
                mean = inflow.mean_velocity(phase.name)
                flux[line.inlet] = line.inlet_flux(mean) * phase.density.inlet_expansion(line.inlet)
            if phase.name == "solids" and inflow.blocked:
                flux[line.outlet] = mobility[line.outlet] = 0.0
            fluxes.append(flux)
            mobilities.append(mobility)
        return _Fluxes(fractions, response, fluxes, mobilities)

    def _responses(self, step: Step, phases: list[Phase]) -> list[list[Array]]:
        """R on faces."""
        span, density = step.levels.span_faces, phases[-1].density.faces
        if len(phases) == 1:
            return [[span / (density * np.ones(self.line.cells.face_count))]]
        ss, sg, gg = self.response(step.state.alpha, step.drag, span, density)
        return [[ss, sg], [sg, gg]]

    def _solids(
        self, step: Step, phase: Phase, response: Array, velocity: Array, flux: Array
    ) -> dict[str, Any]:
        """Fields of the solids in the new state."""
        cells, inner, p_s = self.line.cells, self.line.inner, phase.pressure
        assert p_s is not None
        rise = p_s[cells.second] - p_s[cells.first[inner]]
        if phase.thermal_rise is not None:
            rise -= phase.thermal_rise[inner]
        pressure_flux = np.zeros(cells.face_count)
        pressure_flux[inner] = -response[inner] * cells.face_weight[inner]
        pressure_flux[inner] *= rise
        # of the cells' velocities: the flux itself drops what alternates from cell to cell
        acceleration = cells.flux(velocity - step.levels.start.u_s) / step.levels.span_faces
        return {
            "u_s": velocity,
            "solids_flux": flux,
            "flux_acceleration": acceleration,
            "pressure_flux": pressure_flux,
            "response": response,
        }

    # -- the linear system ---------------------------------------------------------------------

    def _set(self, weight: Array, capacity: Array | float) -> None:
        """The matrix of differences across faces, times `weight`, and of the cells' capacity."""
        cells, inner = self.line.cells, self.line.inner
        diagonal = cells.sum_faces(weight) + capacity
        if self._level_is_free and cells.map.local_range[0] == 0:
            # one cell keeps its pressure
            diagonal[:1] *= 2
        self._matrix.set([diagonal], [(-weight[inner], -weight[inner])])

    def _difference(self, values: Array) -> Array:
        """Difference across each face; beyond the outlet the change is zero."""
        line, cells = self.line, self.line.cells
        found = np.zeros(cells.face_count)
        found[line.inner] = values[cells.second] - values[cells.first[line.inner]]
        found[line.outlet] = -values[cells.first[line.outlet]]
        return found

    def _solve(self, rhs: Array) -> tuple[Array, int]:
        """Change of the pressure, and the iterations; the multigrid is kept for some steps."""
        line, cells = self.line, self.line.cells
        if self._level_is_free:
            rhs = rhs - cells.total(rhs) / cells.map.size_global
        keep = self._age < MULTIGRID_AGE
        zero = np.zeros(cells.owned)
        enough = line.small_norm(SMALL_PRESSURE * self.laws.gas.density * line.velocity_scale**2)
        self._krylov.update(keep)
        try:
            found = self._krylov.solve(rhs, zero, enough)
        except SolverError:
            if not keep:
                raise
            keep = False
            self._krylov.update(False)
            found = self._krylov.solve(rhs, zero, enough)
        self._age = self._age + 1 if keep else 1
        if self._krylov.iterations > MULTIGRID_EFFORT:
            self._age = MULTIGRID_AGE
        return found, self._krylov.iterations

    def _close(self, total: Array, growth: Array) -> Array:
        """Let the divergence that the linear solver leaves out through the outlet."""
        cells, outlet = self.line.cells, self.line.outlet
        size = cells.face_area[outlet]
        area = cells.total(size)
        if area > 0:
            total[outlet] -= cells.total(cells.net_flux(total) - growth) * size / area
        return total

    def renew(self) -> None:
        """Let the next step build its multigrid from nothing."""
        self._age = MULTIGRID_AGE
        self._krylov.reset()

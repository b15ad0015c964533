# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pressure of a step: it makes the flux of both phases free of divergence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fem_tfm.errors import SolverError
from fem_tfm.models.finite_volume.cells.krylov import Krylov
from fem_tfm.models.finite_volume.cells.line import LineMesh
from fem_tfm.models.finite_volume.cells.matrix import CellMatrix
from fem_tfm.models.finite_volume.cells.mesh import Array
from fem_tfm.models.finite_volume.ideal_gas import GasBalance
from fem_tfm.models.finite_volume.state import SMALLEST_FRACTION, Inflow, Phase, State
from fem_tfm.models.pointwise import Pointwise

# residual of the linear system over the right-hand side, and what ends it over rho_g U^2
TOLERANCE, SMALL_PRESSURE = 1e-6, 1e-9
# steps after which the multigrid is built anew, and iterations above which it is
MULTIGRID_AGE, MULTIGRID_EFFORT = 20, 15


class PressureProjection:
    """Projection with the response of mass and drag alone.

    Parameters
    ----------
    line, laws : mesh and coefficients
    compressible : the density of the gas follows the pressure
    """

    def __init__(self, line: LineMesh, laws: Pointwise, compressible: bool = False) -> None:
        self.line, self.laws = line, laws
        # nothing sets the level of the pressure
        self._floats = not (line.has_outlet or compressible)
        self._matrix = CellMatrix(line.cells)
        self._krylov = Krylov(self._matrix, "pressure", TOLERANCE)
        self._age = MULTIGRID_AGE

    def response(
        self, alpha: Array, beta: Array, dt: Array | float, density: Array | float
    ) -> tuple[Array, Array, Array]:
        """R_ss, R_sg = R_gs, R_gg on faces, of alpha_s and beta in cells [m3 s/kg].

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
        at: State,
        phases: list[Phase],
        beta: Array,
        guess: list[Array],
        gaps: list[Array],
        dt: Array | float,
        inflow: Inflow,
        effort: dict[str, int],
        gas_balance: GasBalance | None = None,
    ) -> State:
        """The state with pressure, velocities and fluxes after the step (collective).

        guess, gaps : velocities of the phases, and forces that faces have beyond those of the cells
        gas_balance : the gas, None where its density is constant

        Raises
        ------
        SolverError
            the linear solver does not converge.
        """
        line, cells, inner = self.line, self.line.cells, self.line.inner
        shares = [phase.face_fraction for phase in phases]
        if len(phases) == 2:
            ss, sg, gg = self.response(at.alpha, beta, dt, phases[-1].density.faces)
            response = [[ss, sg], [sg, gg]]
        else:
            response = [[dt / (phases[-1].density.faces * np.ones(cells.face_count))]]
        blocked = inflow.blocked and len(phases) == 2
        carried = []
        for row, phase, velocity in zip(response, phases, guess, strict=True):
            flux = cells.flux(velocity)
            flux += cells.face_area * sum(r * gap for r, gap in zip(row, gaps, strict=True))
            flux *= line.open
            if line.has_inlet:
                mean = inflow.mean_velocity(phase.name)
                flux[line.inlet] = line.inlet_flux(mean) * phase.density.inlet_expansion(line.inlet)
            if phase.name == "solids" and blocked:
                flux[line.outlet] = 0.0
            carried.append(flux)
        if line.has_inlet and len(phases) == 2:
            shares[0] = shares[0].copy()
            shares[0][line.inlet] = inflow.solids_fraction
            shares[1] = 1 - shares[0]
        total = sum(share * flux for share, flux in zip(shares, carried, strict=True))
        # how each phase follows a difference of pressure
        follow = [
            sum(r * share for r, share in zip(row, shares, strict=True))
            * cells.face_weight
            * line.open
            for row in response
        ]
        if blocked:
            follow[0][line.outlet] = 0.0
        stiff = sum(share * part for share, part in zip(shares, follow, strict=True))
        grown = (inflow.sources.solids + inflow.sources.gas) * line.volume
        if gas_balance is None:
            ties, diagonal, rest = stiff, cells.sum_faces(stiff), grown - cells.net_flux(total)
        else:
            ties, rest = gas_balance.flux_weight * stiff, -gas_balance.residual(total)
            diagonal = cells.sum_faces(ties) + gas_balance.compressibility
        if self._floats and cells.map.local_range[0] == 0:
            # one cell keeps its pressure
            diagonal[:1] *= 2
        self._matrix.set([diagonal], [(-ties[inner], -ties[inner])])
        change = cells.ghosted(self._solve(rest, effort))
        drop = np.zeros(cells.face_count)
        drop[inner] = change[cells.second] - change[cells.first[inner]]
        drop[line.outlet] = -change[cells.first[line.outlet]]
        total = total - stiff * drop
        if gas_balance is None:
            total = self._close(total, grown)
        else:
            total, change = gas_balance.close(total, change)
        corrected = [-part * drop for part in follow]
        transported = [
            cells.ghosted(velocity[: cells.owned] + line.reconstruct(flux / cells.face_area))
            for velocity, flux in zip(guess, corrected, strict=True)
        ]
        found = replace(at, p=at.p + change, u_g=transported[-1], total_flux=total)
        if len(phases) == 1:
            return found
        p_s, pushed = phases[0].pressure, np.zeros(cells.face_count)
        pushed[inner] = -response[0][0][inner] * cells.face_weight[inner]
        pushed[inner] *= p_s[cells.second] - p_s[cells.first[inner]]
        # a flux forgets what alternates from cell to cell, and must not be credited with it
        gained = cells.flux(transported[0] - at.u_s) / dt
        return replace(
            found,
            u_s=transported[0],
            solids_flux=carried[0] + corrected[0],
            flux_acceleration=gained,
            pressure_flux=pushed,
            response=response[0][0],
        )

    def _solve(self, rhs: Array, effort: dict[str, int]) -> Array:
        """Change of pressure, by a multigrid that is kept for some steps."""
        line, cells = self.line, self.line.cells
        if self._floats:
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
        effort["pressure"] = self._krylov.iterations
        self._age = self._age + 1 if keep else 1
        if self._krylov.iterations > MULTIGRID_EFFORT:
            self._age = MULTIGRID_AGE
        return found

    def _close(self, total: Array, grown: Array) -> Array:
        """Take what the linear solver left of the divergence out through the outlet."""
        cells, outlet = self.line.cells, self.line.outlet
        size = cells.face_area[outlet]
        area = cells.total(size)
        if area > 0:
            total[outlet] -= cells.total(cells.net_flux(total) - grown) * size / area
        return total

    def renew(self) -> None:
        """Let the next step build its multigrid from nothing."""
        self._age = MULTIGRID_AGE
        self._krylov.reset()

# SPDX-License-Identifier: LGPL-3.0-or-later
"""A gas whose density follows the pressure at constant temperature, and its mass in a step.

Densities are taken over the reference density, which the gas has at the reference pressure,

    d = rho_g/rho_ref = p_abs/p_ref,  p_abs = p_outlet + p + d_outlet rho_ref g.(x - x_outlet)

so that mass flows are volume flows at the reference density. The mass of a cell changes as

    V/dt [(1 - alpha_s) d]_before^after + sum passed = source
    passed = s d_f (total - solids) + (1 - s) passed_before

with s = 1 or that of BDF2, one for all faces, so that the total flux of a gas of constant density
is free of divergence whatever share of its past the flux of the solids takes. d_f, upwind, is
foreseen: the system of the pressure stays symmetric, and its diagonal gains
(1 - alpha_s) V/(dt p_ref).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fem_tfm.models.finite_volume.cells.line import LineMesh
from fem_tfm.models.finite_volume.cells.mesh import Array
from fem_tfm.models.finite_volume.problem import UnsteadyProblem
from fem_tfm.models.finite_volume.state import Density, Inflow, SolidsTransport, State
from fem_tfm.models.finite_volume.time_levels import TimeLevels

# velocity that counts as none, over U
STILL = 1e-12


@dataclass(frozen=True)
class RelativeDensity:
    """Relative density of the gas in all cells [-].

    now, start, end : before the step, where its levels start, and foreseen for its end
    """

    now: Array
    start: Array
    end: Array


class IdealGas:
    """Density of the gas as a function of its pressure.

    Parameters
    ----------
    problem : gas, pressures, gravity
    line : mesh

    Attributes
    ----------
    reference : pressure at which the gas has its reference density [Pa]
    density : that density [kg/m3]
    hydrostatic_density : density at the outlet, whose weight p leaves out [kg/m3]
    """

    def __init__(self, problem: UnsteadyProblem, line: LineMesh) -> None:
        self.line, self.density = line, problem.gas.density
        self.reference = problem.reference_pressure
        outlet = problem.outlet_pressure or self.reference
        self.hydrostatic_density = self.density * outlet / self.reference
        cells, weight = line.cells, self.hydrostatic_density * problem.gravity
        size, middle = cells.face_area[line.outlet], cells.face_centre[line.outlet]
        area = max(cells.total(size), 1e-300)
        datum = np.array([cells.total(size * middle[:, i]) for i in range(3)]) / area
        self._level = outlet + (cells.centre - datum) @ weight
        self.outlet_relative_density = (outlet + (middle - datum) @ weight) / self.reference

    def relative(self, p: Array) -> Array:
        """d at a pressure in all cells."""
        return (p + self._level) / self.reference

    def extrapolate(self, levels: TimeLevels, dt: float) -> RelativeDensity:
        """Densities of a step of `dt` [s] by its levels in time."""
        now, past = self.relative(levels.now.p), levels.previous
        if past is None:
            return RelativeDensity(now, now, now)
        before, r = self.relative(past.p), dt / past.dt
        start = now + levels.ratio * r / (1 + 2 * r) * (now - before)
        return RelativeDensity(now, start, levels.extrapolate(now, before))

    def balance(
        self,
        relative_density: RelativeDensity,
        levels: TimeLevels,
        transported: SolidsTransport | None,
        dt: float,
        inflow: Inflow,
    ) -> GasBalance:
        """What a step makes of the gas, behind that of the solids (collective)."""
        line, cells, own = self.line, self.line.cells, self.line.own
        past, later = levels.previous, relative_density.end
        solids, alpha = np.zeros(cells.face_count), levels.now.alpha
        if transported is not None:
            solids, alpha = transported.step_flux, transported.alpha
        faces, upwind = self._on_faces(later, levels.predicted.total_flux - solids)
        share, kept, fed = 1.0, np.zeros(cells.face_count), inflow.sources.gas
        if past is not None:
            w = dt / (past.dt + 2 * dt)
            share, kept, fed = (
                1 - w,
                w * past.gas_step_flux,
                (1 - w) * fed + w * past.gas_step_source[own],
            )
            solids = (solids - w * past.step_flux) / share
        grown = relative_density.now[own] * (levels.now.alpha - alpha)[own] * line.volume / dt
        density = Density(
            start=self.density * relative_density.start[own],
            cells=self.density * later[own],
            faces=self.density * faces,
            upwind=self.density * upwind,
            inflow=self.density,
        )
        rate = (1 - alpha[own]) * line.volume / (dt * self.reference)
        fed = np.broadcast_to(fed, cells.owned)
        return GasBalance(line, density, later, solids, share * upwind, kept, rate, grown, fed)

    def _on_faces(self, relative: Array, flux: Array) -> tuple[Array, Array]:
        """d of all cells on faces, interpolated and upwind of a flux (collective)."""
        line, cells, inner = self.line, self.line.cells, self.line.inner
        # of a flux that is nothing but round-off two ranks may see two signs
        still = np.abs(flux) < STILL * line.velocity_scale * cells.face_area
        toward, faces = np.where(still, 0.0, np.sign(flux)), cells.to_faces(relative)
        upwind = np.where(still, faces, relative[cells.first])
        upwind[inner] = np.where(toward[inner] < 0, relative[cells.second], upwind[inner])
        if line.order:
            slope = cells.ghosted(cells.gradient(relative))
            upwind += toward * line.second_order_flux(toward, relative, faces[inner], slope)
        upwind[line.outlet] = faces[line.outlet] = self.outlet_relative_density
        return faces, upwind


@dataclass(frozen=True)
class GasBalance:
    """Mass of the gas in a step, as volumes at the reference density.

    density : for its momentum
    relative_density : d foreseen, in all cells
    solids_flux (faces) : volume flux of the solids, which the levels make what has passed [m3/s]
    flux_weight, previous_flux (faces) : the mean flux of the gas in the step is `flux_weight` times
        its volume flux plus `previous_flux` [m3/s]
    compressibility (owned) : growth of the mass in a step with the pressure [m3/s/Pa]
    mass_growth (owned) : growth at the pressure before the step [m3/s]
    source (owned) : what comes in without passing the boundary [1/s]
    """

    line: LineMesh
    density: Density
    relative_density: Array
    solids_flux: Array
    flux_weight: Array
    previous_flux: Array
    compressibility: Array
    mass_growth: Array
    source: Array

    def step_flux(self, total: Array) -> Array:
        """What passes the faces in the step at a volume flux of both phases [m3/s]."""
        return self.flux_weight * (total - self.solids_flux) + self.previous_flux

    def residual(self, total: Array, change: Array | float = 0.0) -> Array:
        """What owned cells gain and lose beyond what they are fed [m3/s].

        change (owned) : of the pressure [Pa]
        """
        leaving = self.line.cells.net_flux(self.step_flux(total))
        return (
            self.mass_growth
            + self.compressibility * change
            + leaving
            - self.source * self.line.volume
        )

    def close(self, total: Array, change: Array) -> tuple[Array, Array]:
        """Flux and change of pressure that conserve the mass of the line exactly (collective).

        What the linear solver has left goes out through the outlet, or raises the pressure where
        there is none.
        """
        cells, outlet = self.line.cells, self.line.outlet
        left = cells.total(self.residual(total, change[self.line.own]))
        if not self.line.has_outlet:
            return total, change - left / cells.total(self.compressibility)
        size = cells.face_area[outlet]
        total[outlet] -= left * size / (cells.total(size) * self.flux_weight[outlet])
        return total, change


def gas_volume(gas: IdealGas | None, at: State, volume: Array) -> Array:
    """Gas in owned cells, as volumes at the reference density [m3]."""
    void = (1 - at.alpha[: volume.size]) * volume
    return void if gas is None else void * gas.relative(at.p)[: volume.size]

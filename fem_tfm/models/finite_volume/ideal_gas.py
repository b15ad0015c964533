# SPDX-License-Identifier: LGPL-3.0-or-later
"""A gas whose density follows the pressure at constant temperature, and its mass balance.

The relative density is the density over the one at the reference pressure,

    d = rho_g/rho_ref = p_abs/p_ref,  p_abs = p_outlet + p + d_outlet rho_ref g.(x - x_outlet)

so mass flows are volume flows at the reference density. The mass of a cell changes as

    V/dt [(1 - alpha_s) d]_before^after + sum step_flux = source
    step_flux = s d_f (total_flux - solids_flux) + (1 - s) step_flux_before

with s = 1, or that of BDF2, on all faces alike: the total flux of a gas of constant density is then
free of divergence, whatever share of the last step the flux of the solids takes. The density d_f on
faces is upwind and predicted, so that the pressure system stays symmetric; its diagonal gains
(1 - alpha_s) V/(dt p_ref).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fem_tfm.models.finite_volume.cells.line import LineMesh
from fem_tfm.models.finite_volume.cells.mesh import Array
from fem_tfm.models.finite_volume.problem import UnsteadyProblem
from fem_tfm.models.finite_volume.scheme import FirstOrder
from fem_tfm.models.finite_volume.state import Density, State
from fem_tfm.models.finite_volume.time_levels import GasBalance, Step, TimeLevels

# velocity that counts as none, over U
STILL = 1e-12


@dataclass(frozen=True)
class RelativeDensity:
    """Relative density of the gas in all cells [-].

    now, start, end : of the present state, of the start level, and predicted for the end of a step
    """

    now: Array
    start: Array
    end: Array


class IdealGas:
    """Density of the gas as a function of its pressure.

    Parameters
    ----------
    problem : gas, pressures, gravity
    line, scheme : mesh and order

    Attributes
    ----------
    reference : pressure at which the gas has its reference density [Pa]
    density : that density [kg/m3]
    hydrostatic_density : density at the outlet, whose weight p leaves out [kg/m3]
    outlet_relative_density : on the faces of the outlet [-]
    """

    def __init__(self, problem: UnsteadyProblem, line: LineMesh, scheme: FirstOrder) -> None:
        self.line, self.scheme, self.density = line, scheme, problem.gas.density
        assert problem.reference_pressure is not None
        self.reference = problem.reference_pressure
        outlet = problem.outlet_pressure or self.reference
        self.hydrostatic_density = self.density * outlet / self.reference
        cells, weight = line.cells, self.hydrostatic_density * problem.gravity
        size, middle = cells.face_area[line.outlet], cells.face_centre[line.outlet]
        area = max(cells.total(size), 1e-300)
        datum = np.array([cells.total(size * middle[:, i]) for i in range(3)]) / area
        self._hydrostatic_pressure = outlet + (cells.centre - datum) @ weight
        self.outlet_relative_density = (outlet + (middle - datum) @ weight) / self.reference

    def relative(self, p: Array) -> Array:
        """Relative density at a pressure in all cells [-]."""
        return (p + self._hydrostatic_pressure) / self.reference

    def extrapolate(self, levels: TimeLevels, dt: float) -> RelativeDensity:
        """Relative densities of a step of `dt` [s]."""
        now, previous = self.relative(levels.now.p), levels.previous
        if previous is None:
            return RelativeDensity(now, now, now)
        assert previous.p is not None
        before, r = self.relative(previous.p), dt / previous.dt
        start = now + levels.ratio * r / (1 + 2 * r) * (now - before)
        return RelativeDensity(now, start, levels.extrapolate(now, before))

    def balance(self, step: Step, relative: RelativeDensity) -> GasBalance:
        """Mass balance of the gas in a step whose solids fraction is solved (collective)."""
        line, cells, own, dt = self.line, self.line.cells, self.line.own, step.dt
        now, previous = step.levels.now, step.levels.previous
        solids, alpha = np.zeros(cells.face_count), now.alpha
        if step.solids is not None:
            solids, alpha = step.solids.step_flux, step.solids.alpha
        faces, upwind = self._on_faces(relative.end, step.levels.predicted.total_flux - solids)
        weight, kept, source = 1.0, np.zeros(cells.face_count), step.inflow.sources.gas
        if previous is not None:
            assert previous.gas_step_flux is not None and previous.gas_step_source is not None
            before = dt / (previous.dt + 2 * dt)
            weight, kept = 1 - before, before * previous.gas_step_flux
            source = weight * source + before * previous.gas_step_source[own]
            solids = (solids - before * previous.step_flux) / weight
        density = Density(
            start=self.density * relative.start[own],
            cells=self.density * relative.end[own],
            faces=self.density * faces,
            upwind=self.density * upwind,
            inflow=self.density,
        )
        return GasBalance(
            line,
            density,
            relative_density=relative.end,
            solids_flux=solids,
            flux_weight=weight * upwind,
            previous_flux=kept,
            compressibility=(1 - alpha[own]) * line.volume / (dt * self.reference),
            mass_growth=relative.now[own] * (now.alpha - alpha)[own] * line.volume / dt,
            source=np.broadcast_to(source, cells.owned),
        )

    def _on_faces(self, relative: Array, flux: Array) -> tuple[Array, Array]:
        """Relative density on faces, interpolated and upwind of a flux (collective)."""
        line, cells, inner = self.line, self.line.cells, self.line.inner
        # two ranks may see different signs of a flux that is nothing but round-off
        still = np.abs(flux) < STILL * line.velocity_scale * cells.face_area
        direction, faces = np.where(still, 0.0, np.sign(flux)), cells.to_faces(relative)
        upwind = np.where(still, faces, relative[cells.first])
        upwind[inner] = np.where(direction[inner] < 0, relative[cells.second], upwind[inner])
        upwind += direction * self.scheme.correction(direction, relative, faces[inner])
        upwind[line.outlet] = faces[line.outlet] = self.outlet_relative_density
        return faces, upwind


def gas_volume(gas: IdealGas | None, state: State, volume: Array) -> Array:
    """Gas in the owned cells, as volumes at the reference density [m3]."""
    void = (1 - state.alpha[: volume.size]) * volume
    return void if gas is None else void * gas.relative(state.p)[: volume.size]

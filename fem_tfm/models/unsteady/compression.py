# SPDX-License-Identifier: LGPL-3.0-or-later
"""A gas whose density follows the pressure at constant temperature, and its mass in a step.

Densities are taken over that of the case, which the gas has at gas.pressure,

    d = rho_g/rho_ref = p_abs/p_ref,  p_abs = p_outlet + p + d_outlet rho_ref g.(x - x_outlet)

so that flows of mass are volumes of the case's gas. The mass of a cell changes as

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

from fem_tfm.case import Case
from fem_tfm.models.unsteady.levels import Levels
from fem_tfm.models.unsteady.line import Line
from fem_tfm.models.unsteady.state import Density, Feed, Moment, Moved
from fem_tfm.solvers.cells import Array

# velocity that counts as none, over U
STILL = 1e-12


@dataclass(frozen=True)
class Thickness:
    """Relative density of the gas in all cells [-].

    now, start, later : before the step, where its levels start, and foreseen for its end
    """

    now: Array
    start: Array
    later: Array


class IdealGas:
    """Density of the gas of a case as a function of its pressure.

    Parameters
    ----------
    case : gas, pressure at the outlet, gravity
    line : mesh

    Attributes
    ----------
    reference : pressure at which the gas has the density of the case [Pa]
    density : that density [kg/m3]
    lifted : density at the outlet, whose weight p leaves out [kg/m3]
    """

    def __init__(self, case: Case, line: Line) -> None:
        self.line, self.density = line, case.gas_material.density
        self.reference = case.gas.pressure
        outlet = case.operation.outlet_pressure or self.reference
        self.lifted = self.density * outlet / self.reference
        cells, weight = line.cells, self.lifted * np.array(case.gravity_vector)
        size, middle = cells.size[line.outlet], cells.middle[line.outlet]
        area = max(cells.total(size), 1e-300)
        datum = np.array([cells.total(size * middle[:, i]) for i in range(3)]) / area
        self._level = outlet + (cells.centre - datum) @ weight
        self.at_outlet = (outlet + (middle - datum) @ weight) / self.reference

    def relative(self, p: Array) -> Array:
        """d at a pressure in all cells."""
        return (p + self._level) / self.reference

    def foresee(self, levels: Levels, dt: float) -> Thickness:
        """Densities of a step of `dt` [s] by its levels in time."""
        now, past = self.relative(levels.now.p), levels.past
        if past is None:
            return Thickness(now, now, now)
        before, r = self.relative(past.p), dt / past.dt
        start = now + levels.ratio * r / (1 + 2 * r) * (now - before)
        return Thickness(now, start, levels.grown(now, before))

    def compress(
        self, thickness: Thickness, levels: Levels, moved: Moved | None, dt: float, feed: Feed
    ) -> Compressed:
        """What a step makes of the gas, behind that of the solids (collective)."""
        line, cells, own = self.line, self.line.cells, self.line.own
        past, later = levels.past, thickness.later
        solids, alpha = np.zeros(cells.faces), levels.now.alpha
        if moved is not None:
            solids, alpha = moved.passed, moved.alpha
        faces, upwind = self._on_faces(later, levels.expected.total - solids)
        share, kept, fed = 1.0, np.zeros(cells.faces), feed.inside.gas
        if past is not None:
            w = dt / (past.dt + 2 * dt)
            share, kept, fed = 1 - w, w * past.gas, (1 - w) * fed + w * past.fed[own]
            solids = (solids - w * past.passed) / share
        grown = thickness.now[own] * (levels.now.alpha - alpha)[own] * line.volume / dt
        density = Density(
            start=self.density * thickness.start[own],
            cells=self.density * later[own],
            faces=self.density * faces,
            carried=self.density * upwind,
            fed=self.density,
        )
        rate = (1 - alpha[own]) * line.volume / (dt * self.reference)
        fed = np.broadcast_to(fed, cells.owned)
        return Compressed(line, density, later, solids, share * upwind, kept, rate, grown, fed)

    def _on_faces(self, relative: Array, flux: Array) -> tuple[Array, Array]:
        """d of all cells on faces, interpolated and upwind of a flux (collective)."""
        line, cells, inner = self.line, self.line.cells, self.line.inner
        # of a flux that is nothing but round-off two ranks may see two signs
        still = np.abs(flux) < STILL * line.speed * cells.size
        toward, faces = np.where(still, 0.0, np.sign(flux)), cells.mean(relative)
        upwind = np.where(still, faces, relative[cells.first])
        upwind[inner] = np.where(toward[inner] < 0, relative[cells.second], upwind[inner])
        if line.order:
            slope = cells.whole(cells.gradient(relative))
            upwind += toward * line.beyond(toward, relative, faces[inner], slope)
        upwind[line.outlet] = faces[line.outlet] = self.at_outlet
        return faces, upwind


@dataclass(frozen=True)
class Compressed:
    """Mass of the gas in a step, in volumes of the case's gas.

    density : for its momentum
    relative : d foreseen, in all cells
    solids (faces) : volume flux of the solids, which the levels make what has passed [m3/s]
    weight, kept (faces) : the gas passes `weight` times its volume flux plus `kept` [m3/s]
    rate (owned) : growth of the mass in a step with the pressure [m3/s/Pa]
    grown (owned) : growth at the pressure before the step [m3/s]
    fed (owned) : what comes in without passing the boundary [1/s]
    """

    line: Line
    density: Density
    relative: Array
    solids: Array
    weight: Array
    kept: Array
    rate: Array
    grown: Array
    fed: Array

    def passed(self, total: Array) -> Array:
        """What passes the faces in the step at a volume flux of both phases [m3/s]."""
        return self.weight * (total - self.solids) + self.kept

    def surplus(self, total: Array, change: Array | float = 0.0) -> Array:
        """What owned cells gain and lose beyond what they are fed [m3/s].

        change (owned) : of the pressure [Pa]
        """
        leaving = self.line.cells.sum(self.passed(total))
        return self.grown + self.rate * change + leaving - self.fed * self.line.volume

    def close(self, total: Array, change: Array) -> tuple[Array, Array]:
        """Flux and change of pressure that conserve the mass of the line exactly (collective).

        What the linear solver has left goes out through the outlet, or raises the pressure where
        there is none.
        """
        cells, outlet = self.line.cells, self.line.outlet
        left = cells.total(self.surplus(total, change[self.line.own]))
        if not self.line.has_outlet:
            return total, change - left / cells.total(self.rate)
        size = cells.size[outlet]
        total[outlet] -= left * size / (cells.total(size) * self.weight[outlet])
        return total, change


def held(gas: IdealGas | None, at: Moment, volume: Array) -> Array:
    """Gas in owned cells, in volumes of the case's gas [m3]."""
    void = (1 - at.alpha[: volume.size]) * volume
    return void if gas is None else void * gas.relative(at.p)[: volume.size]

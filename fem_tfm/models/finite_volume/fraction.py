# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solids fraction of a step: upwind fluxes with an implicit, nonlinear pressure of the solids."""

from __future__ import annotations

import numpy as np

from fem_tfm.errors import SolverError
from fem_tfm.models.finite_volume.cells.krylov import Krylov
from fem_tfm.models.finite_volume.cells.limiter import limit_flux
from fem_tfm.models.finite_volume.cells.line import LineMesh
from fem_tfm.models.finite_volume.cells.matrix import CellMatrix
from fem_tfm.models.finite_volume.cells.mesh import Array
from fem_tfm.models.finite_volume.state import (
    LONELY_FRACTION,
    SECOND_ORDER_SOLVES,
    Inflow,
    SolidsDeformation,
    SolidsTransport,
    TurbulenceCoefficients,
)
from fem_tfm.models.finite_volume.time_levels import TimeLevels
from fem_tfm.models.pointwise import Pointwise

# relative residual, change and iterations of Newton's method
RESIDUAL, CHANGE, ITERATIONS = 1e-10, 1e-12, 40
# share of the way to a bound of the fraction that slopes may take a cell
MOST_OF_ROOM = 0.5
# residual of its linear systems over the right-hand side: a step of the method needs little
LINEAR_TOLERANCE = 1e-4


class SolidsFraction:
    """Moves the solids by their fluxes and their pressure.

    Parameters
    ----------
    line, laws : mesh and coefficients
    matrix : scalar matrix, whose values are overwritten
    """

    def __init__(self, line: LineMesh, laws: Pointwise, matrix: CellMatrix) -> None:
        self.line, self.laws, self.matrix = line, laws, matrix
        self._krylov = Krylov(matrix, "transport", LINEAR_TOLERANCE)
        self._edges = line.cells.first[line.cells.inner_count :]

    def solve(
        self,
        levels: TimeLevels,
        response: Array,
        deformation: SolidsDeformation,
        dt: float,
        inflow: Inflow,
        effort: dict[str, int],
        coefficients: TurbulenceCoefficients | None = None,
    ) -> SolidsTransport:
        """Solids fraction after the step.

        The pressure is the one that has moved the solids: their momentum must feel the same, or
        the fluctuations that a step brings would throw a packed bed apart.

        Raises
        ------
        SolverError
            Newton's method fails or the fraction leaves its bounds.
        """
        old, theta = levels.start, levels.predicted.theta
        line, cells, limit = self.line, self.line.cells, self.laws.solids.packing_limit
        inner, edge = line.inner, slice(cells.inner_count, None)
        share = levels.flux_weight
        push = (share * response * cells.face_weight)[inner]
        first, second = cells.first[inner], cells.second
        rate = line.volume / dt
        ahead, back, ties = (np.zeros(cells.face_count) for _ in range(3))
        alpha = np.maximum(old.alpha, 0.0)
        w = alpha / (limit - alpha)

        lift, spread = 0.0, None
        if coefficients is not None:
            lift = 0.0 if coefficients.normal_stress is None else coefficients.normal_stress["k_s"]
            if coefficients.dispersion is not None:
                spread = self._spread(levels, coefficients)
                spread[edge] = 0.0

        def pressure(alpha: Array) -> Array:
            p_s = self.laws.solids_pressure(alpha, theta, *deformation.rates)
            return p_s + alpha * self.laws.solids.density * lift

        def stiffness(w: Array, p_s: Array) -> Array:
            step = 1e-7 * (1 + w)
            found = (pressure(limit * (w + step) / (1 + w + step)) - p_s) / step
            return np.maximum(found, 0.0)

        p_s = pressure(alpha)
        stiff = stiffness(w, p_s)
        # where the pressure is too stiff for the step, its waves would run on without end: there
        # the flux is that at the end of the step, which damps them
        ties[inner] = push
        slow = (stiff * alpha * (1 + w) ** 2)[line.own] / limit
        sound = cells.ghosted(cells.sum_faces(ties) / rate * slow)
        sound = np.maximum(sound.take(first), sound.take(second))
        flux = old.solids_flux - old.pressure_flux
        trust = levels.acceleration_share[inner]
        if spread is not None:
            # what spreads further than a cell in a step is not carried on either
            wide = cells.ghosted(cells.sum_faces(spread) / rate)
            trust = trust / (1 + np.maximum(wide.take(first), wide.take(second)) ** 2)
        carried_on = np.maximum(sound / (1 + sound), trust)
        span = np.broadcast_to(levels.span_faces, cells.face_count)[inner]
        flux[inner] += carried_on * span * old.flux_acceleration[inner]
        if spread is not None:
            # what eddies have spread is there; what they will spread beyond it is found below
            flux[inner] += spread[inner] * (alpha.take(second) - alpha.take(first))
            spread *= share
        flux[line.inlet] = 0.0
        if inflow.blocked:
            flux[line.outlet] = 0.0
        flux[line.outlet] = np.maximum(flux[line.outlet], 0.0)
        flux *= share
        ahead[edge] = np.maximum(flux[edge], 0.0)
        entering = line.inlet_flux(inflow.solids_velocity) * inflow.solids_fraction
        entering = entering * share[line.inlet]
        beyond = np.zeros(cells.face_count)
        added = levels.span / dt * inflow.sources.solids + levels.previous_source

        def fluxes(alpha: Array, p_s: Array) -> tuple[Array, Array]:
            """What passes faces, and the fraction upwind of the inner ones."""
            here, there = alpha.take(first), alpha.take(second)
            # upwind by what the pressure leaves of the flux: grains at rest do not creep
            transported = flux[inner] - push * (p_s.take(second) - p_s.take(first))
            if spread is not None:
                transported -= spread[inner] * (there - here)
            np.maximum(transported, 0.0, out=ahead[inner])
            np.subtract(ahead[inner], transported, out=back[inner])
            upwind = np.where(transported > 0, here, there)
            found = np.empty(cells.face_count)
            np.multiply(transported, upwind, out=found[inner])
            found[edge] = ahead[edge] * alpha[self._edges]
            found[line.inlet] = entering
            found += levels.previous_flux
            return found, upwind

        for iteration in range(1, ITERATIONS + 1):
            effort["solids fraction"] = iteration
            through, upwind = fluxes(alpha, p_s)
            if line.order and iteration <= SECOND_ORDER_SOLVES:
                beyond = self._beyond(ahead - back, alpha, levels, rate)
            through += beyond
            residual = rate * (alpha[: cells.owned] - old.alpha[: cells.owned]) + cells.net_flux(
                through
            )
            residual -= added * line.volume
            worst = cells.largest(np.abs(residual) / rate)
            if not np.isfinite(worst):
                raise SolverError("the solids fraction is not finite")
            if worst < RESIDUAL:
                break
            if iteration > 1:
                stiff = stiffness(w, p_s)
            slope = limit / (1 + w) ** 2
            leave, enter = ahead, back
            if spread is not None:
                wider = spread[inner] * upwind
                leave, enter = ahead.copy(), back.copy()
                leave[inner] += wider
                enter[inner] += wider
            diagonal = (rate + cells.sum_by_side(leave, enter)) * slope[line.own]
            ties[inner] = pushed = push * upwind
            diagonal += cells.sum_faces(ties) * stiff[line.own]
            across = [
                -(through_it[inner] * slope.take(cell) + pushed * stiff.take(cell))
                for through_it, cell in ((enter, second), (leave, first))
            ]
            self.matrix.set([diagonal], [(across[0], across[1])])
            self._krylov.update()
            change = self._krylov.solve(-residual, np.zeros(cells.owned))
            # w stays positive and finite, and p_s is nearly linear in it
            own = w[: cells.owned]
            w = cells.ghosted(np.clip(own + change, 0.1 * own, 10 * (1 + own)))
            alpha = limit * w / (1 + w)
            p_s = pressure(alpha)
            if cells.largest(np.abs(change) * slope[: cells.owned]) < CHANGE:
                through = fluxes(alpha, p_s)[0] + beyond
                break
        else:
            raise SolverError("Newton's method of the solids fraction does not converge")
        alpha = old.alpha[: cells.owned] - cells.net_flux(through) / rate + dt * added
        # round-off may leave an emptied cell below zero
        lowest = -cells.largest(-alpha)
        if lowest < -1e-9 or cells.largest(alpha) >= limit:
            raise SolverError("the solids fraction leaves its bounds")
        transported = flux
        transported[inner] = (ahead - back)[inner]
        transported = transported / share
        transported[line.inlet] = line.inlet_flux(inflow.solids_velocity)
        dilation = cells.ghosted(cells.net_flux(transported) / line.volume)
        flux = (through - levels.previous_flux) / share
        return SolidsTransport(cells.ghosted(alpha), flux, through, added, p_s, dilation)

    def _spread(self, levels: TimeLevels, coefficients: TurbulenceCoefficients) -> Array:
        """Volume flux over -(difference of alpha_s) by which faces follow dispersion [m3/s].

        With m = a rho/dt of the phases a force F on the solids and -F on the gas, which fill the
        volume together, move the solids by u_s = a_g F/(a_g^2 m_s + a_s^2 m_g + beta).
        """
        cells, laws = self.line.cells, self.laws
        alpha = cells.to_faces(levels.now.alpha)
        void, span = 1 - alpha, levels.span_faces
        gas = laws.gas.density
        if coefficients.relative_density is not None:
            gas = gas * cells.to_faces(coefficients.relative_density)
        inertia = laws.solids.density * void + gas * alpha
        hold = alpha * void * inertia / span + cells.to_faces(coefficients.drag)
        return void / hold * cells.to_faces(coefficients.dispersion) * cells.face_weight

    def _beyond(self, transported: Array, alpha: Array, levels: TimeLevels, rate: Array) -> Array:
        """What slopes in the cells add to the upwind fluxes, within the bounds of the fraction."""
        line, cells = self.line, self.line.cells
        gradient = cells.ghosted(cells.gradient(alpha))
        # a surface is as sharp as its cells: no slope reaches over it into a void
        void = cells.to_faces((alpha < LONELY_FRACTION).astype(float)) > 0
        linear = np.where(void, 0.0, levels.second_order_faces)
        found = linear * line.second_order_flux(
            transported, alpha, cells.to_faces(alpha)[line.inner], gradient
        )
        held = levels.start.alpha[line.own] - cells.net_flux(levels.previous_flux) / rate
        room = self.laws.solids.packing_limit - held
        return limit_flux(cells, found, MOST_OF_ROOM * rate * held, MOST_OF_ROOM * rate * room)

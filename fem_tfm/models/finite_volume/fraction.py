# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solids fraction equation: upwind fluxes with an implicit, nonlinear solids pressure.

    V/dt (alpha - alpha_0) + sum alpha_upwind F - V source = 0
    F = F_0 - R (p_s(alpha) - p_s_other)  on each face

F_0 is the volume flux of the solids without the pressure at the end of the step, R the flux that a
difference of that pressure drives. Newton's method solves for w = alpha/(limit - alpha), in which
p_s is nearly linear; its matrix is an M-matrix, so 0 <= alpha < limit at any step. It stays one
where grad(Theta) exerts no force: the slope of p_s in a cell is then taken at a Theta between those
of the two cells of a face, (1 - s) Theta_1 + s Theta_2. The result is taken from the fluxes, so
that the mass of the solids is conserved to round-off.
"""

from __future__ import annotations

import numpy as np

from fem_tfm.errors import SolverError
from fem_tfm.models.finite_volume.cells.krylov import Krylov
from fem_tfm.models.finite_volume.cells.line import LineMesh
from fem_tfm.models.finite_volume.cells.matrix import CellMatrix
from fem_tfm.models.finite_volume.cells.mesh import Array
from fem_tfm.models.finite_volume.scheme import FirstOrder
from fem_tfm.models.finite_volume.state import LONELY_FRACTION, SolidsTransport, State
from fem_tfm.models.finite_volume.time_levels import Step
from fem_tfm.models.pointwise import Pointwise

# residual [-], change [-] and iterations of Newton's method
RESIDUAL, CHANGE, ITERATIONS = 1e-10, 1e-12, 40
# change [-] that is round-off where the residual falls no more, as in a bed packed to its limit
ROUND_OFF = 1e-9
# a change is cut where the residual [-] rises by more than this factor above a harmless one
LARGEST_RISE, HARMLESS, CUT, MOST_CUTS = 4.0, 10.0, 0.25, 5
# relative residual of its linear systems: an iteration of the method needs little
LINEAR_TOLERANCE = 1e-4
# share of the way to a bound of the fraction that corrections of second order may take a cell
MOST_OF_ROOM = 0.5
# step of w, over 1 + w, for the derivative of the pressure
PRESSURE_STEP = 1e-7
# round-off that may leave an emptied cell below zero
LOWEST = -1e-9


class SolidsFraction:
    """The equation with its matrix and linear solver.

    Parameters
    ----------
    line, laws, scheme : mesh, coefficients, order
    """

    def __init__(self, line: LineMesh, laws: Pointwise, scheme: FirstOrder) -> None:
        self.line, self.laws, self.scheme = line, laws, scheme
        self._matrix = CellMatrix(line.cells)
        self._krylov = Krylov(self._matrix, "transport", LINEAR_TOLERANCE)

    def solve(self, step: Step, response: Array) -> tuple[SolidsTransport, int]:
        """Solids fraction, fluxes and pressure after the step, and the iterations (collective).

        The momentum equation must use this pressure and no other: the change of the pressure in a
        step would otherwise accelerate a packed bed.

        response (faces) : velocity of the solids per pressure gradient on them [m3 s/kg]

        Raises
        ------
        SolverError
            Newton's method fails or the fraction leaves its bounds.
        """
        cells = self.line.cells
        equation = _Equation(self.line, self.laws, self.scheme, step, response)
        before, change = np.inf, np.zeros(cells.owned)
        for iteration in range(1, ITERATIONS + 1):
            equation.evaluate()
            if iteration <= self.scheme.solves:
                equation.correct()
            residual = equation.residual()
            worst = cells.largest(np.abs(residual) / equation.rate)
            for _ in range(MOST_CUTS):
                # a pressure that grows like a high power makes the method leap beyond packing
                if not worst > max(LARGEST_RISE * before, HARMLESS):
                    break
                change = CUT * change
                equation.retreat(change)
                residual = equation.residual()
                worst = cells.largest(np.abs(residual) / equation.rate)
            stalled, before = worst > before / 2, worst
            if not np.isfinite(worst):
                raise SolverError("the solids fraction is not finite")
            if worst < RESIDUAL:
                break
            self._matrix.set(*equation.jacobian())
            self._krylov.update()
            change = self._krylov.solve(-residual, np.zeros(cells.owned))
            moved = equation.update(change)
            if moved < CHANGE or (stalled and moved < ROUND_OFF):
                equation.evaluate()
                break
        else:
            raise SolverError("Newton's method of the solids fraction does not converge")
        return equation.result(), iteration


class _Equation:
    """The equation of one step at the present iterate of Newton's method.

    Attributes
    ----------
    rate (owned) : V/dt [m3/s]
    w, alpha, p_s (cells) : the iterate, its fraction [-] and solids pressure [Pa]
    """

    def __init__(
        self, line: LineMesh, laws: Pointwise, scheme: FirstOrder, step: Step, response: Array
    ) -> None:
        self.line, self.laws, self.scheme, self.step = line, laws, scheme, step
        cells, levels, inflow = line.cells, step.levels, step.inflow
        self.limit, self.rate = laws.solids.packing_limit, line.volume / step.dt
        self._first, self._second = cells.first[line.inner], cells.second
        self._edge = slice(cells.inner_count, None)
        weight = levels.flux_weight
        self._normal_stress: Array | float = 0.0
        if step.turbulence is not None and step.turbulence.normal_stress is not None:
            self._normal_stress = step.turbulence.normal_stress["k_s"]
        self.alpha = np.maximum(levels.start.alpha, 0.0)
        self.w = self.alpha / (self.limit - self.alpha)
        self.p_s = self._pressure(self.alpha)
        self._stiffness: Array | None = self._pressure_stiffness()
        self._thermal = None if laws.feels_theta else _ThermalRise(line, laws, levels.predicted)
        # flux per difference of pressure and of fraction
        self._response = (weight * response * cells.face_weight)[line.inner]
        self._dispersion = self._dispersion_coefficient()
        self._flux = weight * self._flux_without_pressure()
        if self._dispersion is not None:
            self._dispersion *= weight
        # volume fluxes out of the first cells and out of the second
        self._ahead, self._back, self._on_faces = (np.zeros(cells.face_count) for _ in range(3))
        self._ahead[self._edge] = np.maximum(self._flux[self._edge], 0.0)
        entering = line.inlet_flux(inflow.solids_velocity) * inflow.solids_fraction
        self._entering = entering * weight[line.inlet]
        self._source = levels.span / step.dt * inflow.sources.solids + levels.previous_source
        self._correction: Array | float = 0.0

    # -- coefficients --------------------------------------------------------------------------

    def _pressure(self, alpha: Array) -> Array:
        """Solids pressure [Pa] at a fraction, at the predicted granular temperature."""
        theta, rates = self.step.levels.predicted.theta, self.step.deformation.rates
        eddies = alpha * self.laws.solids.density * self._normal_stress
        return self.laws.solids_pressure(alpha, theta, *rates) + eddies

    def _pressure_stiffness(self) -> Array:
        """d(p_s)/dw >= 0 [Pa]."""
        change = PRESSURE_STEP * (1 + self.w)
        beyond = self.limit * (self.w + change) / (1 + self.w + change)
        return np.maximum((self._pressure(beyond) - self.p_s) / change, 0.0)

    def _dispersion_coefficient(self) -> Array | None:
        """Volume flux over -(difference of alpha) by which eddies disperse solids, or None [m3/s].

        With m = a rho/dt of the phases a force F on the solids and -F on the gas, which fill the
        volume together, move the solids by u_s = a_g F/(a_g^2 m_s + a_s^2 m_g + beta).
        """
        turbulence, levels = self.step.turbulence, self.step.levels
        if turbulence is None or turbulence.dispersion is None:
            return None
        assert turbulence.drag is not None
        cells, gas = self.line.cells, self.laws.gas.density
        alpha = cells.to_faces(levels.now.alpha)
        void, span = 1 - alpha, levels.span_faces
        if turbulence.relative_density is not None:
            gas = gas * cells.to_faces(turbulence.relative_density)
        inertia = self.laws.solids.density * void + gas * alpha
        hold = alpha * void * inertia / span + cells.to_faces(turbulence.drag)
        found = void / hold * cells.to_faces(turbulence.dispersion) * cells.face_weight
        found[self._edge] = 0.0
        return found

    def _flux_without_pressure(self) -> Array:
        """Volume flux of the solids without the pressure at the end of the step [m3/s]."""
        line, cells, inner = self.line, self.line.cells, self.line.inner
        levels, inflow = self.step.levels, self.step.inflow
        start = levels.start
        flux = start.solids_flux - start.pressure_flux
        span = np.broadcast_to(levels.span_faces, cells.face_count)[inner]
        flux[inner] += self._acceleration_share() * span * start.flux_acceleration[inner]
        if self._dispersion is not None:
            # the flux at the start contains the dispersion of the fractions there, and the
            # equation adds that of the fractions at the end
            rise = self.alpha.take(self._second) - self.alpha.take(self._first)
            flux[inner] += self._dispersion[inner] * rise
        flux[line.inlet] = 0.0
        if inflow.blocked:
            flux[line.outlet] = 0.0
        flux[line.outlet] = np.maximum(flux[line.outlet], 0.0)
        return flux

    def _acceleration_share(self) -> Array:
        """Share of the faces' acceleration in the flux at the end of the step, on inner faces.

        Where the pressure is too stiff for the step its waves would persist without damping: there
        the flux is extrapolated to the end of the step. What disperses by more than a cell in a
        step is not extrapolated.
        """
        cells, own = self.line.cells, self.line.own
        share = self.step.levels.acceleration_share[self.line.inner]
        if self._dispersion is not None:
            share = share / (1 + self._steps_of_cells(self._dispersion, 1.0) ** 2)
        slope = (self._stiffness * self.alpha * (1 + self.w) ** 2)[own] / self.limit
        response = np.zeros(cells.face_count)
        response[self.line.inner] = self._response
        waves = self._steps_of_cells(response, slope)
        return np.maximum(waves / (1 + waves), share)

    def _steps_of_cells(self, coefficient: Array, slope: Array | float) -> Array:
        """Diffusion number of a step, the larger of both cells of each inner face (collective)."""
        cells = self.line.cells
        number = cells.ghosted(cells.sum_faces(coefficient) / self.rate * slope)
        return np.maximum(number.take(self._first), number.take(self._second))

    # -- Newton's method -----------------------------------------------------------------------

    def evaluate(self) -> None:
        """Fluxes at the iterate."""
        line, inner = self.line, self.line.inner
        here, there = self.alpha.take(self._first), self.alpha.take(self._second)
        # upwind by the flux that the pressure leaves, so that grains at rest do not creep
        rise = self.p_s.take(self._second) - self.p_s.take(self._first)
        if self._thermal is not None:
            rise -= self._thermal.at(self.alpha)[inner]
        flux = self._flux[inner] - self._response * rise
        if self._dispersion is not None:
            flux -= self._dispersion[inner] * (there - here)
        np.maximum(flux, 0.0, out=self._ahead[inner])
        np.subtract(self._ahead[inner], flux, out=self._back[inner])
        self._upwind = np.where(flux > 0, here, there)
        found = np.empty(line.cells.face_count)
        np.multiply(flux, self._upwind, out=found[inner])
        found[self._edge] = self._ahead[self._edge] * self.alpha[line.cells.first[self._edge]]
        found[line.inlet] = self._entering
        self._upwind_flux = found + self.step.levels.previous_flux

    def correct(self) -> None:
        """Replace the correction of second order by that of the iterate."""
        line, cells, levels = self.line, self.line.cells, self.step.levels
        # a surface is as sharp as its cells: no slope reaches over it into a void
        void = cells.to_faces((self.alpha < LONELY_FRACTION).astype(float)) > 0
        share = np.where(void, 0.0, levels.second_order_faces)
        kept = levels.start.alpha[line.own] - cells.net_flux(levels.previous_flux) / self.rate
        most = MOST_OF_ROOM * self.rate
        self._correction = self.scheme.bounded_correction(
            self._ahead - self._back, self.alpha, share, most * kept, most * (self.limit - kept)
        )

    @property
    def _step_flux(self) -> Array:
        """Mean flux of the solids in the step, on all faces [m3/s]."""
        return self._upwind_flux + self._correction

    def residual(self) -> Array:
        """Imbalance of the owned cells [m3/s]."""
        line, start = self.line, self.step.levels.start
        growth = self.rate * (self.alpha[line.own] - start.alpha[line.own])
        return growth + line.cells.net_flux(self._step_flux) - self._source * line.volume

    def jacobian(self) -> tuple[list[Array], list[tuple[Array, Array]]]:
        """Derivatives with respect to w, as `CellMatrix.set` takes them."""
        cells, own, inner = self.line.cells, self.line.own, self.line.inner
        if self._stiffness is None:
            self._stiffness = self._pressure_stiffness()
        stiff, slope = self._stiffness, self.limit / (1 + self.w) ** 2
        ahead, back = self._ahead, self._back
        if self._dispersion is not None:
            wider = self._dispersion[inner] * self._upwind
            ahead, back = ahead.copy(), back.copy()
            ahead[inner] += wider
            back[inner] += wider
        diagonal = (self.rate + cells.sum_by_side(ahead, back)) * slope[own]
        self._on_faces[inner] = pressed = self._response * self._upwind
        diagonal += cells.sum_faces(self._on_faces) * stiff[own]
        row_of_first, row_of_second = (
            -(flux[inner] * slope.take(other) + pressed * stiff.take(other))
            for flux, other in ((back, self._second), (ahead, self._first))
        )
        if self._thermal is not None:
            of_first, of_second = self._thermal.slopes(self.w, self.limit)
            row_of_first += pressed * of_second
            row_of_second -= pressed * of_first
            ahead, back = np.zeros((2, cells.face_count))
            ahead[inner], back[inner] = pressed * of_first, -pressed * of_second
            diagonal += cells.sum_by_side(ahead, back)
        return [diagonal], [(row_of_first, row_of_second)]

    def retreat(self, change: Array) -> None:
        """Take a smaller change than the last one from the iterate before it."""
        self.w = self._last
        self.update(change)
        self.evaluate()

    def update(self, change: Array) -> float:
        """Add a change of w, limited so that w stays positive; the largest change of alpha."""
        self._last = self.w
        cells, w = self.line.cells, self.w[self.line.own]
        slope = self.limit / (1 + w) ** 2
        self.w = cells.ghosted(np.clip(w + change, 0.1 * w, 10 * (1 + w)))
        self.alpha = self.limit * self.w / (1 + self.w)
        self.p_s, self._stiffness = self._pressure(self.alpha), None
        return cells.largest(np.abs(change) * slope)

    # -- the result ----------------------------------------------------------------------------

    def result(self) -> SolidsTransport:
        """The fraction that the fluxes leave, and these.

        Raises
        ------
        SolverError
            the fraction leaves its bounds.
        """
        line, cells, step = self.line, self.line.cells, self.step
        levels = step.levels
        step_flux = self._step_flux
        outflow = cells.net_flux(step_flux) / self.rate
        alpha = levels.start.alpha[line.own] - outflow + step.dt * self._source
        if -cells.largest(-alpha) < LOWEST or cells.largest(alpha) >= self.limit:
            raise SolverError("the solids fraction leaves its bounds")
        volume_flux = self._flux
        volume_flux[line.inner] = (self._ahead - self._back)[line.inner]
        volume_flux = volume_flux / levels.flux_weight
        volume_flux[line.inlet] = line.inlet_flux(step.inflow.solids_velocity)
        return SolidsTransport(
            alpha=cells.ghosted(alpha),
            flux=(step_flux - levels.previous_flux) / levels.flux_weight,
            step_flux=step_flux,
            step_source=self._source,
            pressure=self.p_s,
            wall_rise=line.rise_to_wall(self.p_s),
            dilation=cells.ghosted(cells.net_flux(volume_flux) / line.volume),
            thermal_rise=None if self._thermal is None else self._thermal.at(self.alpha),
        )


class _ThermalRise:
    """Rise of the kinetic pressure across faces by that of Theta: mean(p/Theta) rise(Theta).

    Without it the rise is that of alpha_s alone, at a Theta between those of both cells.

    Parameters
    ----------
    line, laws : mesh and coefficients
    state : with the Theta of the pressure
    """

    def __init__(self, line: LineMesh, laws: Pointwise, state: State) -> None:
        self._cells, self._inner = line.cells, line.inner
        self._laws, self._theta = laws, state.theta
        self._first, self._second = line.cells.first[line.inner], line.cells.second
        self._rise = self._theta.take(self._second) - self._theta.take(self._first)

    def at(self, alpha: Array) -> Array:
        """The rise at a fraction, zero on the boundary [Pa]."""
        found = self._cells.to_faces(self._laws.pressure_per_theta(alpha, self._theta))
        found[self._inner] *= self._rise
        found[self._cells.inner_count :] = 0.0
        return found

    def slopes(self, w: Array, limit: float) -> tuple[Array, Array]:
        """Its derivatives with respect to w = alpha/(limit - alpha) of the first and second cells.

        By differences, as those of the pressure.
        """
        change = PRESSURE_STEP * (1 + w)
        here, beyond = (
            self._laws.pressure_per_theta(limit * odds / (1 + odds), self._theta)
            for odds in (w, w + change)
        )
        slope = np.maximum((beyond - here) / change, 0.0)
        share, rise = self._cells.interpolation_weight, self._rise
        return (
            share * slope.take(self._first) * rise,
            (1 - share) * slope.take(self._second) * rise,
        )


def thermal_rise(line: LineMesh, laws: Pointwise, state: State) -> Array | None:
    """Share of the rise of p_s of a state across faces that exerts no force [Pa], or None."""
    if laws.feels_theta:
        return None
    return _ThermalRise(line, laws, state).at(np.maximum(state.alpha, 0.0))

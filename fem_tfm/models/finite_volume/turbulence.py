# SPDX-License-Identifier: LGPL-3.0-or-later
"""Turbulence equations: k and epsilon of the gas, and of the solids, where laws transport them.

The laws give the diffusivity D and the rate r of each scale X, dX/dt = ... + r X, and the slope s
by which r falls with ln X. An Euler step is, with q = dt r/(1 + dt s), the change of ln X,

    a (dt r/(e^q - 1)) (X - e^q X_0)/dt + a u.grad X = div(a D grad X)

and a step of second order, with the predicted X_1 and q = dt r,

    a ((f - q + dt s) X - f X_0 - dt s X_1)/dt + a u.grad X = div(a D grad X),
    f = sqrt(1 + max(q, 0)^2)

Both keep X positive at any step, and have the steady state of the laws. For a compressible gas, a
is alpha_g rho_g/rho_ref. Coefficients are those of the predicted state.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from fem_tfm.closures.turbulence.dispersed import GasEddies, Grains
from fem_tfm.closures.turbulence.gas import Balance, Eddies
from fem_tfm.models.finite_volume.cells.line import LineMesh
from fem_tfm.models.finite_volume.cells.mesh import Array, Index
from fem_tfm.models.finite_volume.cells.transport import ScalarTransport
from fem_tfm.models.finite_volume.problem import UnsteadyProblem
from fem_tfm.models.finite_volume.state import (
    SMALLEST_FRACTION,
    Density,
    State,
    TurbulenceCoefficients,
)
from fem_tfm.models.finite_volume.time_levels import Step, TimeLevels
from fem_tfm.models.pointwise import Invariants, LocalGas, Pointwise, dot, tangential

# smallest intensity of turbulence, with eddies as wide as the line
LEAST_INTENSITY = 1e-5
# largest step of ln X
LARGEST_STEP = 5.0
# changes of ln k and ln eps for the slope of their rates: in this direction eddies become shorter,
# so that every sink, and the relaxation of eps to its value at the wall, count
SMALL_RISE = {"k": 1e-5, "eps": 2.5e-5}
# smallest change of ln X, and of the shear in the wall's cells [1/s], that is divided by
SMALLEST_CHANGE = 1e-12


class Turbulence:
    """The equations of the transported scales, and the effect of turbulence on both phases.

    Parameters
    ----------
    problem : turbulence intensities at the inlet
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
        self.line, self.laws, self.problem = line, laws, problem
        self.transport = transport
        self.gas_law, self.dispersed = laws.closures.turbulence, laws.closures.dispersed
        self._of_gas = _plain(self.gas_law.transported)
        self._of_solids = _plain(self.dispersed.transported) if laws.solids else ()
        self._edges = np.unique(line.cells.first[line.wall])
        self._height = line.wall_height
        self._floors: dict[str, float] = {}
        for phase in ("gas", "solids") if self._of_solids else ("gas",):
            self._floors |= self._estimate(
                phase, line.velocity_scale, LEAST_INTENSITY, laws.diameter
            )

    @staticmethod
    def is_needed(laws: Pointwise) -> bool:
        """Whether the laws have more than an algebraic viscosity of the gas."""
        found = laws.closures
        return bool(
            found.turbulence.transported
            or (laws.solids and (not found.dispersed.still or found.dispersion.name != "none"))
        )

    def initial(self) -> dict[str, Array]:
        """Scales of the inlet's turbulence at the velocity scale, in all cells."""
        found = self._entering("gas", self.line.velocity_scale)
        if self._of_solids:
            found |= self._entering("solids", self.line.velocity_scale)
        return {name: np.full(self.line.cells.count, value) for name, value in found.items()}

    def _entering(self, phase: str, speed: float) -> dict[str, float]:
        """Scales of a phase at the inlet at a mean velocity [m/s]."""
        given, laws = self.problem, self.laws
        intensity = given.gas_intensity if phase == "gas" else given.solids_intensity
        speed = max(speed, LEAST_INTENSITY * self.line.velocity_scale)
        return self._estimate(phase, speed, intensity, given.length_scale * laws.diameter)

    def _estimate(
        self, phase: str, speed: float, intensity: float, length: float
    ) -> dict[str, float]:
        """Scales of a phase from velocity [m/s], intensity [-] and length of the eddies [m]."""
        law = self.gas_law if phase == "gas" else self.dispersed
        found = law.estimate(speed, intensity, length)
        return {name.removeprefix("ln_"): float(np.exp(value)) for name, value in found.items()}

    # -- coefficients --------------------------------------------------------------------------

    def coefficients(
        self, levels: TimeLevels, relative: Array | None = None
    ) -> TurbulenceCoefficients:
        """Coefficients at the predicted state (collective).

        relative : density of the gas over the reference [-], None where it is constant
        """
        line, cells, at = self.line, self.line.cells, levels.predicted
        laws = self.laws if relative is None else self.laws.with_density(relative)
        gradient = cells.ghosted(cells.gradient(levels.now.u_g))
        later = gradient if levels.previous is None else cells.ghosted(cells.gradient(at.u_g))
        scales = [at.scales[name] for name in self._of_gas]
        gas_rate = Invariants(self._mirrored(later))
        eddies = laws.eddies(gas_rate, *line.gas_profile, *scales)
        if laws.solids:
            eddies = laws.laden(eddies, *self._beside(at, laws), line.gas_profile[0])
        eddies = self._at_wall(eddies, at, laws)
        grains = self._grains(at, laws) if laws.solids else None
        gas = laws.gas_eddies(eddies)
        balances = self._balances(eddies, gas, grains)
        nu_s, spread, drag, normal = 0.0, None, None, None
        if grains is not None:
            nu_s = laws.solids_eddy_viscosity(gas, grains, line.gas_profile[1])
            if laws.closures.dispersion.name != "none":
                spread = laws.dispersion(gas, grains, nu_s)
                drag = grains.specific * grains.alpha
            if self._of_solids and self.dispersed.normal_stress:
                normal = {name: laws.eddy_pressure(at.scales[name]) for name in ("k", "k_s")}
        stiffness = {}
        for name, rate in self._rates_beside(eddies, gas, grains).items():
            stiffness[name] = np.maximum((balances[name].rate - rate) / SMALL_RISE["k"], 0.0)
        # the scales of the gas are those of its stretched profile
        stretch = {name: line.gas_profile[1] if name in self._of_gas else 1.0 for name in balances}
        return TurbulenceCoefficients(
            gradient,
            gas.nu * laws.gas.density,
            nu_s,
            spread,
            drag,
            normal,
            {name: balance.diffusivity / stretch[name] for name, balance in balances.items()},
            {name: balance.rate * stretch[name] for name, balance in balances.items()},
            {name: stiff * stretch[name] for name, stiff in stiffness.items()},
            relative,
            eddies.gas.viscosity if self.dispersed.follows and laws.solids else None,
        )

    @staticmethod
    def _beside(at: State, laws: Pointwise) -> tuple[Array, Array]:
        """Solids fraction [-], and slip speed between the phases [m/s]."""
        return np.maximum(at.alpha, SMALLEST_FRACTION), laws.speed(at.u_g - at.u_s)

    def _balances(
        self, eddies: Eddies, gas: GasEddies, grains: Grains | None, which: str = "both"
    ) -> dict[str, Balance]:
        """Transport coefficients of the scales of "gas", "solids" or "both"."""
        found: dict[str, Balance] = {}
        if which != "solids":
            found |= self.laws.gas_balances(eddies, gas, grains)
        if which != "gas" and grains is not None:
            found |= self.dispersed.balances(gas, grains)
        return {name.removeprefix("ln_"): balance for name, balance in found.items()}

    def _rates_beside(
        self, eddies: Eddies, gas: GasEddies, grains: Grains | None
    ) -> dict[str, Array]:
        """Rates where the scales of a phase are larger by SMALL_RISE."""
        found: dict[str, Balance] = {}
        if self._of_gas:
            risen = _risen(eddies)
            found |= self._balances(risen, self.laws.gas_eddies(risen), grains, "gas")
        if self._of_solids:
            assert grains is not None and grains.eddies is not None
            of_solids = replace(grains, eddies=_risen(grains.eddies))
            found |= self._balances(eddies, gas, of_solids, "solids")
        return {name: balance.rate for name, balance in found.items()}

    def _grains(self, now: State, laws: Pointwise) -> Grains:
        """Input of the laws of dispersed turbulence."""
        line, cells = self.line, self.line.cells
        slip, alpha = now.u_g - now.u_s, np.maximum(now.alpha, SMALLEST_FRACTION)
        speed, height = laws.speed(slip), line.gas_profile[0]
        beta = laws.drag(alpha, speed, height)
        g0, kinetic = laws.kinetic(alpha, now.theta, beta)
        gradient = cells.ghosted(cells.gradient(now.alpha))
        # grad(alpha)/alpha is limited to that of a front as wide as a cell
        limit = dot(gradient, gradient) * cells.volume ** (2 / 3) / 4
        drift = -dot(slip, gradient) / np.sqrt(alpha**2 + limit)
        eddies = None
        if self._of_solids:
            gradient = self._mirrored(cells.ghosted(cells.gradient(now.u_s)))
            scales = (now.scales[name] for name in self._of_solids)
            eddies = laws.eddies(Invariants(gradient), line.wall_distance, 1.0, *scales)
        return laws.grains(
            alpha,
            now.theta,
            g0,
            kinetic.shear_viscosity,
            speed,
            height,
            drift,
            eddies,
        )

    def _mirrored(self, gradient: Array) -> Array:
        """Gradient of a velocity, corrected in the cells next to planes of symmetry.

        Least squares find no neighbour across the plane. They give the normal slope of tangential
        velocities half a cell further in, where it is twice as large.
        """
        line, cells = self.line, self.line.cells
        if "symmetry" not in cells.parts:
            return gradient
        part = cells.parts["symmetry"]
        edge, normal = cells.first[part], line.normal[part]
        slope = np.einsum("nij,nj->ni", gradient[edge], normal)
        slope = tangential(slope, normal)
        found = gradient.copy()
        np.subtract.at(found, edge, 0.5 * slope[:, :, None] * normal[:, None, :])
        return cells.update_ghosts(found)

    def _at_wall(self, eddies: Eddies, now: State, laws: Pointwise) -> Eddies:
        """Eddies with the shear of the wall in the cells next to it, which the gradient lacks.

            S = min(S_w/2 + S_g, max(S_w, S_g))

        S_w follows from the traction of the wall, (mu + mu_t) S_w, S_g from the gradient. In a log
        layer with cells of one height S_w/2 = S_g = u_tau/(2 kappa y), in a viscous one S_w = S_g;
        where the solids carry the stress within a cell, S is S_w/2.
        """
        line, cells, edges = self.line, self.line.cells, self._edges
        if not line.has_wall or not self._of_gas:
            return eddies
        first = cells.first[line.wall]
        within = _at(eddies, edges)
        slip = laws.speed(tangential(now.u_g[first], line.normal[line.wall]))
        friction = laws.gas.viscosity / self._height
        if not laws.closures.gas_wall.strong:
            beside = None
            if laws.solids:
                alpha, slipping = self._beside(now, laws)
                beside = alpha[first], slipping[first]
            k = eddies.k[first]
            friction, _ = laws.at(first).wall_friction(slip, self._height, k, beside)
        squares = np.zeros(cells.owned)
        np.add.at(squares, first, (friction * slip) ** 2)
        traction = np.sqrt(squares[edges])

        def sheared(strain: Array) -> Array:
            """Shear of the layer with the viscosity at a given one."""
            eddy = 0.0
            if not laws.closures.gas_wall.strong:
                eddy = self.gas_law.viscosity(_strained(within, strain))
            return traction / (laws.gas.viscosity + eddy)

        # 1/mu_t of the laws is linear in the shear: two iterations and Aitken's formula solve it
        one = sheared(within.strain)
        two = sheared(one)
        change = np.where(np.abs(one - within.strain) > SMALLEST_CHANGE, one - within.strain, 1.0)
        ratio = np.minimum((two - one) / change, 0.9)
        strain = np.empty(cells.count)
        strain[: cells.owned] = eddies.strain[: cells.owned]
        wall, gradient = one + (two - one) / (1 - ratio), within.strain
        strain[edges] = np.minimum(wall / 2 + gradient, np.maximum(wall, gradient))
        return _strained(eddies, cells.update_ghosts(strain))

    # -- the step ------------------------------------------------------------------------------

    def solve(self, step: Step) -> tuple[dict[str, Array], int]:
        """Scales after the step, in all cells, and the iterations (collective).

        Raises
        ------
        SolverError
            the linear solver does not converge.
        """
        start, state = step.levels.start, step.state
        found, iterations = dict[str, Array](), 0
        solids = np.zeros(self.line.cells.face_count)
        if step.solids is not None:
            solids = step.solids.flux
        if self._of_gas:
            density = Density.constant(1.0)
            if step.gas is not None:
                density = step.gas.density.relative_to(self.laws.gas.density)
            fractions = 1 - start.alpha, 1 - state.alpha
            flux = state.total_flux - solids
            found, iterations = self._solve_phase(step, "gas", density, fractions, flux)
        if self._of_solids:
            fractions = start.alpha, state.alpha
            density = Density.constant(1.0)
            more, taken = self._solve_phase(step, "solids", density, fractions, solids)
            found, iterations = found | more, iterations + taken
        return found, iterations

    def _solve_phase(
        self,
        step: Step,
        phase: str,
        density: Density,
        fractions: tuple[Array, Array],
        flux: Array,
    ) -> tuple[dict[str, Array], int]:
        """Scales of one phase, and the iterations.

        density : over the reference density [-]
        fractions : of the phase at the start and at the end of the step, in all cells [-]
        flux : volume flux of the phase [m3/s]
        """
        line, own, coefficients = self.line, self.line.own, step.turbulence
        assert coefficients is not None
        before, after = (np.maximum(fraction, SMALLEST_FRACTION) for fraction in fractions)
        inertia = density.start * before[own] * line.volume
        if phase == "gas" and coefficients.relative_density is not None:
            after = after * coefficients.relative_density
        entering = self._entering(phase, step.inflow.mean_velocity(phase))
        found, iterations = dict[str, Array](), 0
        for name in self._of_gas if phase == "gas" else self._of_solids:
            diagonal, rhs = self._inertia_and_source(name, step)
            values, taken = self.transport.solve(
                density.upwind * flux,
                after * coefficients.diffusivity[name],
                inertia * diagonal,
                inertia * rhs,
                guess=step.levels.now.scales[name][own],
                entering=entering[name],
                share=step.levels.second_order_faces,
                prescribed=self._wall_values(name, coefficients, found),
            )
            found[name] = line.cells.ghosted(np.maximum(values, self._floors[name]))
            iterations += taken
        return found, iterations

    def _inertia_and_source(self, name: str, step: Step) -> tuple[Array, Array]:
        """Inertia and source of a scale over a, for matrix and right-hand side (owned) [1/s]."""
        own, levels, coefficients = self.line.own, step.levels, step.turbulence
        span = levels.span
        rise, stiff = span * coefficients.rate[name][own], span * coefficients.stiffness[name][own]
        before = levels.start.scales[name][own]
        if levels.previous is None:
            change = np.clip(rise / (1 + stiff), -LARGEST_STEP, LARGEST_STEP)
            small = np.abs(change) < SMALLEST_CHANGE
            change = np.where(small, SMALLEST_CHANGE, change)
            fitted = np.where(small, 1 + stiff, rise / np.expm1(change)) / span
            return fitted, fitted * np.exp(change) * before
        kept = np.sqrt(1 + np.square(np.maximum(rise, 0.0)))
        predicted = levels.predicted.scales[name][own]
        return (kept - rise + stiff) / span, (kept * before + stiff * predicted) / span

    def _wall_values(
        self, name: str, coefficients: TurbulenceCoefficients, found: dict[str, Array]
    ) -> tuple[Index, Array] | None:
        """Cells next to the wall where the law prescribes a scale, and its values, or None."""
        if not self.line.has_wall or name not in self._of_gas or name == self._of_gas[0]:
            return None
        laws, edges = self.laws, self._edges
        if coefficients.relative_density is not None:
            laws = laws.with_density(coefficients.relative_density).at(edges)
        k, gas = found[self._of_gas[0]][edges], laws.gas
        if coefficients.laden_viscosity is not None:
            gas = LocalGas(gas.density, coefficients.laden_viscosity[edges])
        distance = self.line.gas_profile[0][edges]
        eddies = Eddies(None, distance, gas, laws.diameter / 2, k=k)
        values = self.gas_law.wall_values(eddies)
        if f"ln_{name}" not in values:
            return None
        return edges, np.exp(values[f"ln_{name}"])


def _plain(logarithms: tuple[str, ...]) -> tuple[str, ...]:
    """Names of the scales from those of their logarithms."""
    return tuple(name.removeprefix("ln_") for name in logarithms)


def _risen(eddies: Eddies) -> Eddies:
    """Eddies with k and eps larger by SMALL_RISE."""
    return replace(
        eddies,
        k=eddies.k * np.exp(SMALL_RISE["k"]),
        eps=eddies.eps * np.exp(SMALL_RISE["eps"]),
    )


def _strained(eddies: Eddies, strain: Array) -> Eddies:
    """The same eddies at another strain rate, in proportion to which they spin."""
    return replace(eddies, strain=strain, spin=eddies.spin * strain / eddies.strain)


def _at(eddies: Eddies, which: Any) -> Eddies:
    """Eddies in some of the cells, with the gas there."""
    names, gas = ("strain", "distance", "spin", "A_s", "k", "eps"), eddies.gas
    if isinstance(gas, LocalGas):
        density, viscosity = (
            value[which] if np.ndim(value) else value for value in (gas.density, gas.viscosity)
        )
        gas = LocalGas(density, viscosity)
    return replace(eddies, gas=gas, **{name: getattr(eddies, name)[which] for name in names})

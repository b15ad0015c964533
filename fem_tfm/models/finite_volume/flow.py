# SPDX-License-Identifier: LGPL-3.0-or-later
"""The unsteady flow on one mesh: its state, its steps, its balances, and what others read."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np
from dolfinx import fem

from fem_tfm.errors import SolverError
from fem_tfm.geometry.mesh import Mesh
from fem_tfm.models.finite_volume.cells.line import LineMesh
from fem_tfm.models.finite_volume.cells.mesh import Array
from fem_tfm.models.finite_volume.cells.transport import ScalarTransport
from fem_tfm.models.finite_volume.fraction import SolidsFraction, thermal_rise
from fem_tfm.models.finite_volume.ideal_gas import IdealGas, RelativeDensity, gas_volume
from fem_tfm.models.finite_volume.momentum import Momentum
from fem_tfm.models.finite_volume.pressure import PressureProjection
from fem_tfm.models.finite_volume.problem import UnsteadyProblem
from fem_tfm.models.finite_volume.scheme import FirstOrder, SecondOrder
from fem_tfm.models.finite_volume.state import (
    CELL_FIELDS,
    FACE_FIELDS,
    SMALLEST_FRACTION,
    Inflow,
    Masses,
    Report,
    SolidsDeformation,
    State,
    StepFailed,
)
from fem_tfm.models.finite_volume.temperature import GranularTemperature
from fem_tfm.models.finite_volume.time_levels import (
    PREVIOUS_CELL_FIELDS,
    PREVIOUS_FACE_FIELDS,
    PREVIOUS_GAS_CELL_FIELDS,
    PREVIOUS_GAS_FACE_FIELDS,
    PreviousStep,
    Step,
    TimeLevels,
)
from fem_tfm.models.finite_volume.told.pressure_level import PressureLevel
from fem_tfm.models.finite_volume.told.speeds import SpeedLimit
from fem_tfm.models.finite_volume.told.split import DropSplit
from fem_tfm.models.finite_volume.turbulence import Turbulence
from fem_tfm.models.pointwise import Invariants

FAILURES = (SolverError, FloatingPointError, np.linalg.LinAlgError)


class UnsteadyFlow:
    """An unsteady flow on one mesh.

    Parameters
    ----------
    problem : laws, materials, boundary data
    mesh : three-dimensional, with the parts inlet, outlet, wall, symmetry that it has

    Attributes
    ----------
    line, laws, scheme : mesh, coefficients, order
    fraction, temperature, momentum, pressure : equations of a step; the first two only with solids
    turbulence : its equations, None where the gas has an algebraic law alone
    ideal_gas : the gas where its density follows the pressure, else None
    level, split : pressure with the weight of the gas, and the parts of its drop
    speed_limit : largest velocities that a step may end with
    now, previous : present state, and what a step of second order needs of the one before it
    """

    def __init__(self, problem: UnsteadyProblem, mesh: Mesh) -> None:
        self.problem, self.mesh = problem, mesh
        self.gas, self.solids = problem.gas, problem.solids
        self.line, self.laws = LineMesh(problem, mesh), problem.pointwise()
        self.cells = self.line.cells
        self.scheme = FirstOrder(self.line)
        if problem.second_order:
            limit = 1.0 if self.solids is None else self.solids.packing_limit
            self.scheme = SecondOrder(self.line, limit)
        self._build()
        self._functions: dict[str, fem.Function] = {}
        self.initialise()

    def _build(self) -> None:
        """Make the equations."""
        problem, line, laws, scheme = self.problem, self.line, self.laws, self.scheme
        self.turbulence = None
        if self.solids is not None or Turbulence.is_needed(laws):
            transport = ScalarTransport(line, scheme)
        if Turbulence.is_needed(laws):
            self.turbulence = Turbulence(problem, line, laws, transport)
        if self.solids is not None:
            self.fraction = SolidsFraction(line, laws, scheme)
            self.temperature = GranularTemperature(problem, line, laws, transport)
        self.ideal_gas, hydrostatic_density = None, self.gas.density
        if problem.compressible:
            self.ideal_gas = IdealGas(problem, line, scheme)
            hydrostatic_density = self.ideal_gas.hydrostatic_density
        self.momentum = Momentum(line, laws, scheme, problem.gravity, hydrostatic_density)
        self.pressure = PressureProjection(line, laws, scheme, problem.compressible)
        self.level = PressureLevel(line, problem.gravity, hydrostatic_density)
        self.split = DropSplit(line, problem.gravity)
        self.speed_limit = SpeedLimit(line, laws, problem.gravity)
        # what the parts of the drop need of the last step
        self._wall_friction: dict[str, Array] = {}
        self._thermal_rise: Array | None = None

    def initialise(self, alpha: Any = 0.0, theta: float | None = None, p: Any = 0.0) -> None:
        """Put both phases at rest, at time zero.

        alpha, p : solids fraction [-] and pressure [Pa], numbers or arrays over all cells
        theta : granular temperature [m2/s2], None for the smallest
        """
        cells = self.cells
        zero, flux = np.zeros(cells.count), np.zeros(cells.face_count)
        vector = np.zeros((cells.count, 3))
        self.now = State(
            alpha=zero + alpha,
            theta=zero + (self.laws.regularisation.theta_floor if theta is None else theta),
            p=zero + p,
            u_s=vector,
            u_g=vector,
            total_flux=flux,
            solids_flux=flux,
            pressure_flux=flux,
            response=flux,
            flux_acceleration=flux,
            scales=self.turbulence.initial() if self.turbulence else {},
        )
        self.previous: PreviousStep | None = None
        self.time, self.steps = 0.0, 0
        self._wall_friction = {}
        self._count_masses()

    def set_velocities(self, u_s: Array, u_g: Array) -> None:
        """Set the velocities of both phases, (3,) or (cells, 3) [m/s]; nothing passes the walls."""
        cells = self.cells
        u_s, u_g = (np.broadcast_to(u, (cells.count, 3)).astype(float) for u in (u_s, u_g))
        fluxes = [cells.flux(u) for u in (u_s, u_g)]
        for flux in fluxes:
            for part in ("wall", "symmetry"):
                flux[cells.parts.get(part, slice(0, 0))] = 0.0
        alpha = cells.to_faces(self.now.alpha)
        self.now = replace(
            self.now,
            u_s=u_s,
            u_g=u_g,
            solids_flux=fluxes[0],
            total_flux=alpha * fluxes[0] + (1 - alpha) * fluxes[1],
        )

    def _count_masses(self) -> None:
        """Begin the mass balances with the present state."""
        solids = self.cells.total(self.now.alpha[: self.cells.owned] * self.line.volume)
        self.masses = Masses(solids=solids, gas=self._gas_volume(self.now, solids))

    def _gas_volume(self, state: State, solids: float) -> float:
        """Gas in the line beside a volume of solids, at the reference density [m3]."""
        if self.ideal_gas is None:
            return self.cells.total(self.line.volume) - solids
        return self.cells.total(gas_volume(self.ideal_gas, state, self.line.volume))

    # -- the step ------------------------------------------------------------------------------

    def advance(self, dt: float, inflow: Inflow, largest_courant: float = math.inf) -> Report:
        """One step of `dt` [s] (collective).

        largest_courant : Courant number of the velocities after the step above which it fails

        Raises
        ------
        StepFailed
            a solver did not converge or a value left its bounds; nothing has changed.
        """
        failure: Exception | None = None
        for levels in self.scheme.attempts(
            self.now, self.previous, dt, inflow, self._gas_densities()
        ):
            try:
                step = self._step(levels, dt, inflow)
                solids, gas = self._solids_balance(step), self._gas_balance(step)
                masses = self._masses_after(dt, solids, gas)
                report = self._report(step, masses)
                self._check(step, report.courant, largest_courant)
                previous = self._previous_step(step, solids, gas)
            except FAILURES as error:
                failure = error
                continue
            self.now, self.previous, self.masses = step.state, previous, masses
            self.time += dt
            self.steps += 1
            return report
        raise StepFailed(str(failure)) from failure

    def _gas_densities(self) -> tuple[Array | float, Array | float]:
        """Relative density of the gas in the present and in the previous state [-]."""
        if self.ideal_gas is None or self.previous is None:
            return 1.0, 1.0
        assert self.previous.p is not None
        return self.ideal_gas.relative(self.now.p), self.ideal_gas.relative(self.previous.p)

    def _step(self, levels: TimeLevels, dt: float, inflow: Inflow) -> Step:
        """The step with all equations solved."""
        still = np.zeros(self.cells.count)
        step, density = Step(levels, dt, inflow, levels.predicted, still, still), None
        if self.ideal_gas:
            density = self.ideal_gas.extrapolate(levels, dt)
        if self.turbulence:
            relative = None if density is None else density.end
            step = replace(step, turbulence=self.turbulence.coefficients(levels, relative))
        if self.solids is not None:
            step = self._solve_fraction(step, density)
            step = self._solve_temperature(step, density)
        if self.ideal_gas and density is not None:
            step = replace(step, gas=self.ideal_gas.balance(step, density))
        if self.turbulence:
            scales, iterations = self.turbulence.solve(step)
            state = replace(step.state, scales=scales)
            step = step.after("turbulence", iterations, state=state)
        phases = self.momentum.phases(step)
        self._wall_friction = {phase.name: phase.wall_friction for phase in phases}
        self._thermal_rise = phases[0].thermal_rise
        face_forces, accelerations = self.momentum.forces(step, phases)
        velocities, iterations = self.momentum.solve(step, phases, accelerations)
        step = step.after("momentum", iterations)
        state, iterations = self.pressure.project(step, phases, velocities, face_forces)
        return step.after("pressure", iterations, state=state)

    def _solve_fraction(self, step: Step, density: RelativeDensity | None) -> Step:
        """Solve the solids fraction, and take it back to the start level of the step."""
        cells, levels = self.cells, step.levels
        step = replace(step, deformation=self._predicted_deformation(levels))
        response = step.state.response
        if not self.steps:
            step, response = self._with_first_pressure(step, density)
        solids, iterations = self.fraction.solve(step, response)
        if levels.previous is not None:
            # the start level from which an Euler step with the flux at the end gives this fraction
            rate = cells.net_flux(solids.flux) / self.line.volume - step.inflow.sources.solids
            alpha = solids.alpha[: cells.owned] + levels.span * rate
            start = replace(levels.start, alpha=cells.ghosted(np.clip(alpha, 0.0, 1.0)))
            step = replace(step, levels=replace(levels, start=start))
        state = replace(step.state, alpha=solids.alpha)
        return step.after("solids fraction", iterations, state=state, solids=solids)

    def _with_first_pressure(
        self, step: Step, density: RelativeDensity | None
    ) -> tuple[Step, Array]:
        """The first step with its response, and with the flux of the weight that p_s carries.

        The solids pressure acts on the flux from the first step on, so its weight must, too.
        """
        cells, state, start = self.cells, step.state, step.levels.start
        gas_density: Array | float = self.gas.density
        if density is not None:
            gas_density = gas_density * cells.to_faces(density.now)
        drag, growth = self.drag(state, density)
        response = self.pressure.response(state.alpha, drag + growth, step.dt, gas_density)[0]
        alpha = np.maximum(state.alpha, 0.0)
        p_s = self.laws.solids_pressure(alpha, state.theta, *step.deformation.rates)
        unforced = thermal_rise(self.line, self.laws, state)
        weight = self.momentum.supported_weight(state.alpha, p_s, unforced)
        flux = start.solids_flux + response * cells.face_area * weight
        levels = replace(step.levels, start=replace(start, solids_flux=flux))
        return replace(step, levels=levels), response

    def _solve_temperature(self, step: Step, density: RelativeDensity | None) -> Step:
        """Solve the granular temperature, and linearise the drag.

        The drag follows the slip at once where the gas has little inertia. With the coefficient of
        the predicted slip alone the drag and the flow would alternate, so its growth with the slip
        is implicit, too.
        """
        beta, growth = self.drag(step.state, density)
        step = replace(step, beta=beta)
        theta, iterations = self.temperature.solve(step)
        state = replace(step.state, theta=theta)
        excess = growth[:, None] * (state.u_g - state.u_s)
        found = {"state": state, "drag": beta + growth, "explicit_drag": excess}
        return step.after("theta", iterations, **found)

    def deformation(self, state: State | PreviousStep) -> SolidsDeformation:
        """Deformation of the solids of a state, in all cells (collective).

        The shear beside walls is extrapolated to the cells there, but not for an algebraic Theta:
        that follows the shear at once, without conduction.
        """
        cells = self.cells
        gradient = cells.ghosted(cells.gradient(state.u_s))
        seen = gradient
        if self.laws.closures.theta != "algebraic":
            seen = self.line.at_sides(gradient)
        shear = cells.update_ghosts(Invariants(seen).square)
        dilation = cells.ghosted(cells.net_flux(state.solids_flux) / self.line.volume)
        return SolidsDeformation(gradient, shear, dilation)

    def _predicted_deformation(self, levels: TimeLevels) -> SolidsDeformation:
        """Deformation predicted for the end of the step, but for the gradient, which is present.

        The explicit stresses of an extrapolated gradient would grow.
        """
        flux = levels.predicted.solids_flux
        found = self.deformation(replace(levels.now, solids_flux=flux))
        if levels.previous is None:
            return found
        before = self.deformation(levels.previous)
        return replace(found, shear=levels.extrapolate(found.shear, before.shear))

    def drag(self, state: State, density: RelativeDensity | None = None) -> tuple[Array, Array]:
        """beta and its growth with the slip, |u| d(beta)/d|u|, in all cells [kg/m3/s]."""
        laws = self.laws if density is None else self.laws.with_density(density.end)
        alpha, speed = np.maximum(state.alpha, SMALLEST_FRACTION), laws.speed(state.u_g - state.u_s)
        return laws.drag_and_growth(alpha, speed, self.line.gas_profile[0])

    # -- masses --------------------------------------------------------------------------------

    def _solids_balance(self, step: Step) -> tuple[Array, Array]:
        """Mean flux (faces) [m3/s] and source (owned) [1/s] of the solids in a step."""
        if step.solids is None:
            return np.zeros(self.cells.face_count), np.zeros(self.cells.owned)
        return step.solids.step_flux, step.solids.step_source

    def _gas_balance(self, step: Step) -> tuple[Array, Array]:
        """Those of the gas, at the reference density."""
        total = step.state.total_flux
        if step.gas is None:
            flux, source = self._solids_balance(step)
            sources = step.inflow.sources
            return total - flux, sources.solids + sources.gas - source
        density = self.ideal_gas.relative(step.state.p)[: self.cells.owned]
        if not self.cells.largest(-density) < 0:
            raise SolverError("the density of the gas is not positive")
        return step.gas.step_flux(total), step.gas.source

    def _previous_step(
        self, step: Step, solids: tuple[Array, Array], gas: tuple[Array, Array]
    ) -> PreviousStep | None:
        """What a step of second order needs of the present state and of the step from it."""
        if not self.scheme.needs_previous:
            return None
        flux, source = solids
        found = PreviousStep.of(self.now, step.dt, flux, self.cells.ghosted(source))
        if step.gas is None:
            return found
        source = self.cells.ghosted(gas[1])
        return replace(found, gas_step_flux=gas[0], gas_step_source=source)

    def _masses_after(
        self, dt: float, solids: tuple[Array, Array], gas: tuple[Array, Array]
    ) -> Masses:
        """Masses after a step with these mean fluxes and sources."""
        cells, edge = self.cells, slice(self.cells.inner_count, None)
        gained = {}
        for name, (flux, source) in (("solids", solids), ("gas", gas)):
            out, given = flux[edge], source * self.line.volume
            entered = cells.total(np.maximum(-out, 0.0)) + cells.total(np.maximum(given, 0.0))
            net = cells.total(given) - cells.total(out)
            gained[f"{name}_in"] = getattr(self.masses, f"{name}_in") + dt * entered
            gained[f"{name}_net"] = getattr(self.masses, f"{name}_net") + dt * net
        return replace(self.masses, **gained)

    def _mass_errors(self, state: State, masses: Masses) -> dict[str, float]:
        """Relative errors of the masses of both phases in a state."""
        solids = self.cells.total(state.alpha[: self.cells.owned] * self.line.volume)
        found = {}
        for name, now in (("solids", solids), ("gas", self._gas_volume(state, solids))):
            start, entered = getattr(masses, name), getattr(masses, f"{name}_in")
            missing = now - start - getattr(masses, f"{name}_net")
            found[f"{name}_mass"] = abs(missing) / max(start + entered, 1e-300)
        return found

    def balances(self) -> dict[str, float]:
        """Relative errors of the masses of both phases since the start."""
        found = self._mass_errors(self.now, self.masses)
        return found if self.solids is not None else {"gas_mass": found["gas_mass"]}

    # -- what others read ----------------------------------------------------------------------

    def _report(self, step: Step, masses: Masses) -> Report:
        """Effort and extreme values of a step, which must be finite."""
        cells, state, own = self.cells, step.state, self.line.own
        values = {name: getattr(state, name) for name in CELL_FIELDS} | dict(state.scales)
        for name, value in values.items():
            # a sum is finite where all values are
            if not np.isfinite(cells.total(value[own])):
                raise SolverError(f"{name} is not finite")
        return Report(
            step.iterations,
            cells.largest(state.alpha[own]),
            cells.largest(state.theta[own]),
            step.dt * max(self._courant(state)),
            max(self._mass_errors(state, masses).values()),
            cells.largest(state.scales["k"][own]) if "k" in state.scales else 0.0,
        )

    def _check(self, step: Step, courant: float, largest_courant: float) -> None:
        """Refuse velocities that nothing can make, or that are too fast for the step."""
        density = None if self.ideal_gas is None else self.ideal_gas.relative(step.state.p)
        self.speed_limit.check(self.now, step, density)
        if courant > largest_courant:
            raise SolverError(
                f"the step ends at a Courant number of {courant:.3g}, above {largest_courant:.3g}"
            )

    def courant(self) -> tuple[float, float]:
        """Largest Courant number of solids and gas over the step [1/s]."""
        return self._courant(self.now)

    def _courant(self, state: State) -> tuple[float, float]:
        """That of a state."""
        cells, alpha = self.cells, self.cells.to_faces(state.alpha)
        gas = state.total_flux - alpha * state.solids_flux
        gas = gas / np.maximum(1 - alpha, SMALLEST_FRACTION)
        of_solids, of_gas = (
            cells.largest(
                cells.sum_by_side(np.maximum(flux, 0.0), np.maximum(-flux, 0.0)) / self.line.volume
            )
            for flux in (state.solids_flux, gas)
        )
        return of_solids, of_gas

    def quantities(self) -> dict[str, float]:
        """Quantities of the whole line, in SI units (collective).

        Mass flows are those through the outlet. The pressure drop is the one from the faces of the
        inlet to those of the outlet, with the weight of the gas. Behind the first step it is not a
        number: the pressure there holds the impulse that puts the flow at rest into motion.
        """
        cells, now, own = self.cells, self.now, slice(0, self.cells.owned)
        drop = math.nan if self.steps == 1 else self.level.drop(now.p)
        factor = self.mesh.section.area_factor
        leaving = cells.to_faces(now.alpha)[self.line.outlet] * now.solids_flux[self.line.outlet]
        gas = now.total_flux[self.line.outlet] - leaving
        if self.ideal_gas is not None:
            gas = gas * self.ideal_gas.outlet_relative_density
        room = cells.total(self.line.volume)
        assert self.mesh.length is not None
        found = {
            "pressure_gradient": drop / self.mesh.length,
            "pressure_drop": drop,
            **self._parts(drop),
            "gas_mass_flow": factor * self.gas.density * cells.total(gas),
        }
        if self.solids is None:
            return found
        return found | {
            "solids_mass_flow": factor * self.solids.density * cells.total(leaving),
            "holdup": cells.total(now.alpha[own] * self.line.volume) / room,
            "max_solids_fraction": cells.largest(now.alpha[own]),
        }

    def _parts(self, drop: float) -> dict[str, float]:
        """Parts of the pressure drop [Pa]; none before a step has found the forces of the wall."""
        if self.steps < 2 or not self._wall_friction:
            return {}
        own, now = self.line.own, self.now
        density = self.gas.density * (1 - now.alpha[own])
        if self.ideal_gas is not None:
            density = density * self.ideal_gas.relative(now.p)[own]
        if self.solids is not None:
            density = density + self.solids.density * now.alpha[own]
        return self.split.parts(now, self._wall_friction, self._thermal_rise, density, drop)

    def state(self) -> dict[str, Array]:
        """Everything that the next step needs for the same result, bit for bit.

        Arrays over owned cells, those on faces as (owned, facets of a cell), and numbers. The next
        step builds its multigrid anew, so that a run that continues equals one that is restored.
        """
        self.pressure.renew()
        cells, own = self.cells, slice(0, self.cells.owned)
        found = {name: getattr(self.now, name)[own].copy() for name in CELL_FIELDS}
        for name, directed in FACE_FIELDS.items():
            found[name] = cells.faces_by_cell(getattr(self.now, name), directed)
        found |= {name: values[own].copy() for name, values in self.now.scales.items()}
        of_cells, of_faces = self._previous_fields
        if self.previous is not None:
            for name in of_cells:
                found[f"before_{name}"] = getattr(self.previous, name)[own].copy()
            for name, values in self.previous.scales.items():
                found[f"before_{name}"] = values[own].copy()
            for name in of_faces:
                found[f"before_{name}"] = cells.faces_by_cell(getattr(self.previous, name))
            found["before_dt"] = np.array(self.previous.dt)
        found["time"], found["steps"] = np.array(self.time), np.array(self.steps)
        return found | {f"mass_{n}": np.array(v) for n, v in vars(self.masses).items()}

    @property
    def _previous_fields(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Names of the fields of the previous step, in cells and on faces."""
        if self.ideal_gas is None:
            return PREVIOUS_CELL_FIELDS, PREVIOUS_FACE_FIELDS
        return (
            PREVIOUS_CELL_FIELDS + PREVIOUS_GAS_CELL_FIELDS,
            PREVIOUS_FACE_FIELDS + PREVIOUS_GAS_FACE_FIELDS,
        )

    def restore(self, state: Mapping[str, Array]) -> None:
        """Restore what `state` gave, also from another partition of the mesh (collective)."""
        cells = self.cells
        found: dict[str, Any] = {n: cells.ghosted(np.asarray(state[n])) for n in CELL_FIELDS}
        for name, directed in FACE_FIELDS.items():
            found[name] = cells.from_faces_by_cell(np.asarray(state[name]), directed)
        found["scales"] = {n: cells.ghosted(np.asarray(state[n])) for n in self.now.scales}
        self.now, self.previous = State(**found), None
        if self.scheme.needs_previous and "before_dt" in state:
            of_cells, of_faces = self._previous_fields
            scales = self.now.scales
            names = *of_cells, *of_faces, *scales
            given = {name: np.asarray(state[f"before_{name}"]) for name in names}
            found = {name: cells.ghosted(given[name]) for name in of_cells}
            found |= {name: cells.from_faces_by_cell(given[name]) for name in of_faces}
            found["scales"] = {name: cells.ghosted(given[name]) for name in scales}
            self.previous = PreviousStep(float(state["before_dt"]), **found)
        self.time, self.steps = float(state["time"]), int(state["steps"])
        self._wall_friction = {}
        masses = {f.name: float(state[f"mass_{f.name}"]) for f in fields(Masses)}
        self.masses = Masses(**masses)
        self.pressure.renew()

    def fields(self) -> dict[str, fem.Function]:
        """Fields of the cells for output; the functions are made once.

        The pressure is the one above the mean at the outlet, with the weight of the gas.
        """
        arrays = {"u_g": self.now.u_g, "pressure": self.level.of_cells(self.now.p)}
        if self.solids is not None:
            arrays = {"alpha_s": self.now.alpha, "u_s": self.now.u_s, **arrays}
            arrays["theta"] = self.now.theta
        arrays |= self.now.scales
        for name, values in arrays.items():
            if name not in self._functions:
                shape = (3,) if values.ndim == 2 else ()
                space = fem.functionspace(self.mesh.mesh, ("DG", 0, shape))
                self._functions[name] = fem.Function(space, name=name)
            self._functions[name].x.array[:] = values.ravel()
        return self._functions

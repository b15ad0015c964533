# SPDX-License-Identifier: LGPL-3.0-or-later
"""The unsteady flow on one mesh: its state, its steps, its balances, and what others read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np
from dolfinx import fem

from fem_tfm.errors import SolverError
from fem_tfm.mesh import Mesh
from fem_tfm.models.finite_volume.cells.line import LineMesh
from fem_tfm.models.finite_volume.cells.matrix import CellMatrix
from fem_tfm.models.finite_volume.cells.mesh import Array
from fem_tfm.models.finite_volume.fraction import SolidsFraction
from fem_tfm.models.finite_volume.ideal_gas import IdealGas, RelativeDensity, gas_volume
from fem_tfm.models.finite_volume.momentum import Momentum
from fem_tfm.models.finite_volume.pressure import PressureProjection
from fem_tfm.models.finite_volume.problem import UnsteadyProblem
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
    TimeLevels,
    bdf2,
    implicit_euler,
)
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
    line, laws : mesh and coefficients
    fraction, agitation, momenta, projection : parts of a step; the first two only with solids
    ideal : the gas, None where its density is constant
    turbulence : what it makes, None where an algebraic law of the gas is all
    now, past : state, and what a step of second order takes from the one before it
    """

    def __init__(self, problem: UnsteadyProblem, mesh: Mesh) -> None:
        self.problem, self.mesh = problem, mesh
        self.gas, self.solids = problem.gas, problem.solids
        self.line, self.laws = LineMesh(problem, mesh), problem.pointwise()
        self.cells = self.line.cells
        scalar = CellMatrix(self.cells)
        self.turbulence = None
        if Turbulence.is_needed(self.laws):
            self.turbulence = Turbulence(problem, self.line, self.laws, scalar)
        if self.solids is not None:
            self.fraction = SolidsFraction(self.line, self.laws, scalar)
            self.temperature = GranularTemperature(problem, self.line, self.laws, scalar)
        self.ideal_gas = IdealGas(problem, self.line) if problem.compressible else None
        lifted = self.ideal_gas.hydrostatic_density if self.ideal_gas else self.gas.density
        self.momentum = Momentum(self.line, self.laws, problem.gravity, lifted)
        self.pressure = PressureProjection(self.line, self.laws, problem.compressible)
        self._functions: dict[str, fem.Function] = {}
        self.initialise()

    def initialise(self, alpha: Any = 0.0, theta: float | None = None, p: Any = 0.0) -> None:
        """Both phases at rest; solids fraction and pressure are numbers or those of all cells.

        theta : granular temperature, None for the smallest [m2/s2]
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
        self._count_masses()

    def set_velocities(self, u_s: Array, u_g: Array) -> None:
        """Give both phases velocities, (3,) or (cells, 3) [m/s]; walls hold their normal part."""
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
        solids = self.cells.total(self.now.alpha[: self.cells.owned] * self.line.volume)
        self.masses = Masses(solids=solids, gas=self._gas_held(self.now, solids))

    def _gas_held(self, at: State, solids: float) -> float:
        """Gas in the line beside solids, at the reference density [m3]."""
        if self.ideal_gas is None:
            return self.cells.total(self.line.volume) - solids
        return self.cells.total(gas_volume(self.ideal_gas, at, self.line.volume))

    # -- the step ------------------------------------------------------------------------------

    def advance(self, dt: float, inflow: Inflow) -> Report:
        """One step of `dt` [s].

        Raises
        ------
        StepFailed
            a solver did not converge or a value left its bounds; nothing has changed.
        """
        try:
            found, past, report, masses = self._attempt(dt, inflow)
        except FAILURES as error:
            raise StepFailed(str(error)) from error
        self.now, self.previous, self.masses = found, past, masses
        self.time += dt
        self.steps += 1
        return report

    def _attempt(
        self, dt: float, inflow: Inflow
    ) -> tuple[State, PreviousStep | None, Report, Masses]:
        """A step of the order chosen, or of first order where that one fails."""
        if self.line.order:
            try:
                return self._step(self._time_levels(dt, inflow), dt, inflow)
            except FAILURES:
                pass
        return self._step(implicit_euler(self.line, self.now, dt), dt, inflow)

    def _time_levels(self, dt: float, inflow: Inflow) -> TimeLevels:
        limit = 1.0 if self.solids is None else self.solids.packing_limit
        if self.previous is None:
            return implicit_euler(self.line, self.now, dt, limit)
        gas = 1.0, 1.0
        if self.ideal_gas:
            gas = self.ideal_gas.relative(self.now.p), self.ideal_gas.relative(self.previous.p)
        return bdf2(self.line, self.now, self.previous, dt, limit, inflow, gas)

    def _step(
        self, levels: TimeLevels, dt: float, inflow: Inflow
    ) -> tuple[State, PreviousStep | None, Report, Masses]:
        old, start, span = levels.predicted, levels.start, levels.span_faces
        cells, effort = self.cells, {}
        transported, deformation, beta, dragged = None, None, np.zeros(cells.count), None
        at, coefficients, gas_balance = old, None, None
        relative_density = self.ideal_gas.extrapolate(levels, dt) if self.ideal_gas else None
        if self.turbulence:
            coefficients = self.turbulence.coefficients(
                levels, relative_density and relative_density.end
            )
        if self.solids is not None:
            deformation = self._expected_rates(levels)
            response = old.response
            if not self.steps:
                density = self.gas.density
                if relative_density:
                    density = density * cells.to_faces(relative_density.now)
                drag = sum(self._drag(old, relative_density))
                response = self.pressure.response(old.alpha, drag, dt, density)[0]
                # the pressure of the solids acts from the first step on: what it bears must too
                alpha = np.maximum(old.alpha, 0.0)
                p_s = self.laws.solids_pressure(alpha, old.theta, *deformation.rates)
                borne = response * cells.face_area * self.momentum.supported_weight(old.alpha, p_s)
                levels = replace(
                    levels, start=replace(start, solids_flux=start.solids_flux + borne)
                )
            transported = self.fraction.solve(
                levels, response, deformation, dt, inflow, effort, coefficients
            )
            if self.previous is not None:
                lost = cells.net_flux(transported.flux) / self.line.volume - inflow.sources.solids
                before = transported.alpha[: cells.owned] + levels.span * lost
                start = replace(start, alpha=cells.ghosted(np.clip(before, 0.0, 1.0)))
            at = replace(old, alpha=transported.alpha)
            beta, steep = self._drag(at, relative_density)
            theta = self.temperature.solve(
                at, beta, levels, start, transported, deformation, inflow, effort
            )
            at = replace(at, theta=theta)
            # a gas that gives way follows its drag at once: with that of the slip foreseen alone,
            # flow and drag would take turns
            beta, dragged = beta + steep, steep[:, None] * (at.u_g - at.u_s)
        if self.ideal_gas:
            gas_balance = self.ideal_gas.balance(relative_density, levels, transported, dt, inflow)
        if self.turbulence:
            scales = self.turbulence.solve(
                at, levels, start, coefficients, transported, inflow, effort, gas_balance
            )
            at = replace(at, scales=scales)
        phases = self.momentum.phases(
            at, levels, start, transported, deformation, coefficients, gas_balance
        )
        gaps, accelerated = self.momentum.forces(at, phases, beta, levels, inflow)
        guess = self.momentum.solve(phases, beta, accelerated, levels, inflow, effort, dragged)
        at = replace(at, u_s=start.u_s)
        found = self.pressure.project(
            at, phases, beta, guess, gaps, span, inflow, effort, gas_balance
        )
        passed, added = np.zeros(cells.face_count), np.zeros(cells.owned)
        if transported is not None:
            passed, added = transported.step_flux, transported.step_source
        volume = self.line.volume
        if gas_balance is None:
            grown = (inflow.sources.solids + inflow.sources.gas) * volume
            gas = found.total_flux - passed, grown - added * volume
        else:
            self._check_density(found)
            gas = gas_balance.step_flux(found.total_flux), gas_balance.source * volume
        masses = self._balance((passed, added * volume), gas, dt)
        past = None
        if self.line.order:
            past = PreviousStep.of(self.now, dt, passed, cells.ghosted(added))
            if self.ideal_gas:
                past = replace(
                    past, gas_step_flux=gas[0], gas_step_source=cells.ghosted(gas_balance.source)
                )
        return found, past, self._report(found, dt, effort, masses), masses

    def deformation(self, at: State | PreviousStep) -> SolidsDeformation:
        """How the solids of a state deform, in all cells (collective)."""
        cells = self.cells
        gradient = cells.ghosted(cells.gradient(at.u_s))
        dilation = cells.ghosted(cells.net_flux(at.solids_flux) / self.line.volume)
        return SolidsDeformation(gradient, Invariants(gradient).square, dilation)

    def _expected_rates(self, levels: TimeLevels) -> SolidsDeformation:
        """Deformation predicted for the end of a step; the gradient is the present one.

        Stresses that the matrix does not hold would grow if they were extrapolated.
        """
        found = self.deformation(replace(levels.now, solids_flux=levels.predicted.solids_flux))
        if levels.previous is None:
            return found
        shear = levels.extrapolate(found.shear, self.deformation(levels.previous).shear)
        return replace(found, shear=shear)

    def _drag(
        self, at: State, relative_density: RelativeDensity | None = None
    ) -> tuple[Array, Array]:
        """beta and its growth with the slip, |u| d(beta)/d|u|, in all cells [kg/m3/s]."""
        laws = self.laws.with_density(relative_density.end) if relative_density else self.laws
        alpha, speed = np.maximum(at.alpha, SMALLEST_FRACTION), laws.speed(at.u_g - at.u_s)
        return laws.drag_and_growth(alpha, speed, self.line.gas_profile[0])

    # -- what others read ----------------------------------------------------------------------

    def _check_density(self, found: State) -> None:
        density = self.ideal_gas.relative(found.p)[: self.cells.owned]
        if not self.cells.largest(-density) < 0:
            raise SolverError("the density of the gas is not positive")

    def _balance(self, solids: tuple[Array, Array], gas: tuple[Array, Array], dt: float) -> Masses:
        """Masses with what has passed faces in a step and what was put into cells [m3/s]."""
        cells, edge = self.cells, slice(self.cells.inner_count, None)
        gained = {}
        for name, (passed, inside) in (("solids", solids), ("gas", gas)):
            flux = passed[edge]
            entered = cells.total(np.maximum(-flux, 0.0)) + cells.total(np.maximum(inside, 0.0))
            net = cells.total(inside) - cells.total(flux)
            gained[f"{name}_in"] = getattr(self.masses, f"{name}_in") + dt * entered
            gained[f"{name}_net"] = getattr(self.masses, f"{name}_net") + dt * net
        return replace(self.masses, **gained)

    def _report(self, found: State, dt: float, effort: dict[str, int], masses: Masses) -> Report:
        cells, own = self.cells, slice(0, self.cells.owned)
        values = {name: getattr(found, name) for name in CELL_FIELDS} | dict(found.scales)
        for name, value in values.items():
            # a sum is finite where all values are
            if not np.isfinite(cells.total(value[own])):
                raise SolverError(f"{name} is not finite")
        return Report(
            effort,
            cells.largest(found.alpha[own]),
            cells.largest(found.theta[own]),
            dt * max(self._courant(found)),
            max(self._errors(found, masses).values()),
            cells.largest(found.scales["k"][own]) if "k" in found.scales else 0.0,
        )

    def courant(self) -> tuple[float, float]:
        """Largest Courant number of solids and gas for a step of one second [1/s]."""
        return self._courant(self.now)

    def _courant(self, at: State) -> tuple[float, float]:
        cells = self.cells
        alpha = cells.to_faces(at.alpha)
        gas = (at.total_flux - alpha * at.solids_flux) / np.maximum(1 - alpha, SMALLEST_FRACTION)
        deformation = []
        for flux in (at.solids_flux, gas):
            leaving = cells.sum_by_side(np.maximum(flux, 0.0), np.maximum(-flux, 0.0))
            deformation.append(cells.largest(leaving / self.line.volume))
        return deformation[0], deformation[1]

    def _errors(self, at: State, masses: Masses) -> dict[str, float]:
        solids = self.cells.total(at.alpha[: self.cells.owned] * self.line.volume)
        found = {}
        for name, now in (("solids", solids), ("gas", self._gas_held(at, solids))):
            start, entered = getattr(masses, name), getattr(masses, f"{name}_in")
            missing = now - start - getattr(masses, f"{name}_net")
            found[f"{name}_mass"] = abs(missing) / max(start + entered, 1e-300)
        return found

    def balances(self) -> dict[str, float]:
        """Relative errors of the masses of both phases since the start."""
        found = self._errors(self.now, self.masses)
        return found if self.solids is not None else {"gas_mass": found["gas_mass"]}

    def quantities(self) -> dict[str, float]:
        """Numbers of the whole line now, in SI units.

        The flows are those through the outlet, the pressure drop that from the inlet's cells to it.
        """
        cells, now, own = self.cells, self.now, slice(0, self.cells.owned)
        entry, size = cells.first[self.line.inlet], cells.face_area[self.line.inlet]
        area = max(cells.total(size), 1e-300)
        drop = cells.total(now.p[entry] * size) / area
        factor = self.mesh.geometry.area_factor
        leaving = cells.to_faces(now.alpha)[self.line.outlet] * now.solids_flux[self.line.outlet]
        gas = now.total_flux[self.line.outlet] - leaving
        gas = cells.total(gas * self.ideal_gas.outlet_relative_density if self.ideal_gas else gas)
        room = cells.total(self.line.volume)
        found = {
            "pressure_gradient": drop / self.mesh.length,
            "pressure_drop": drop,
            "gas_mass_flow": factor * self.gas.density * gas,
        }
        if self.solids is None:
            return found
        return found | {
            "solids_mass_flow": factor * self.solids.density * cells.total(leaving),
            "holdup": cells.total(now.alpha[own] * self.line.volume) / room,
            "max_solids_fraction": cells.largest(now.alpha[own]),
        }

    def state(self) -> dict[str, Array]:
        """Everything that the next step needs, bit for bit.

        Arrays over owned cells, those on faces as (owned, facets of a cell), and numbers. The next
        step builds its multigrid anew, so that a run that goes on equals one that is restored.
        """
        self.pressure.renew()
        cells, own = self.cells, slice(0, self.cells.owned)
        found = {name: getattr(self.now, name)[own].copy() for name in CELL_FIELDS}
        for name, directed in FACE_FIELDS.items():
            found[name] = cells.faces_by_cell(getattr(self.now, name), directed)
        found |= {name: values[own].copy() for name, values in self.now.scales.items()}
        of_cells, of_faces = self._names_of_past
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
    def _names_of_past(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """What the next step takes from before the last one, in cells and on faces."""
        if self.ideal_gas is None:
            return PREVIOUS_CELL_FIELDS, PREVIOUS_FACE_FIELDS
        return (
            PREVIOUS_CELL_FIELDS + PREVIOUS_GAS_CELL_FIELDS,
            PREVIOUS_FACE_FIELDS + PREVIOUS_GAS_FACE_FIELDS,
        )

    def restore(self, state: Mapping[str, Array]) -> None:
        """Take over what `state` gave, also from another division into ranks (collective)."""
        cells = self.cells
        found = {name: cells.ghosted(np.asarray(state[name])) for name in CELL_FIELDS}
        for name, directed in FACE_FIELDS.items():
            found[name] = cells.from_faces_by_cell(np.asarray(state[name]), directed)
        found["scales"] = {n: cells.ghosted(np.asarray(state[n])) for n in self.now.scales}
        self.now, self.previous = State(**found), None
        if self.line.order and "before_dt" in state:
            of_cells, of_faces = self._names_of_past
            scales = self.now.scales
            names = *of_cells, *of_faces, *scales
            given = {name: np.asarray(state[f"before_{name}"]) for name in names}
            found = {name: cells.ghosted(given[name]) for name in of_cells}
            found |= {name: cells.from_faces_by_cell(given[name]) for name in of_faces}
            found["scales"] = {name: cells.ghosted(given[name]) for name in scales}
            self.previous = PreviousStep(float(state["before_dt"]), **found)
        self.time, self.steps = float(state["time"]), int(state["steps"])
        names = (f.name for f in fields(Masses))
        self.masses = Masses(**{name: float(state[f"mass_{name}"]) for name in names})
        self.pressure.renew()

    def fields(self) -> dict[str, fem.Function]:
        """Values of the cells for output, in functions that are made once."""
        arrays = {"u_g": self.now.u_g, "pressure": self.now.p}
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

# SPDX-License-Identifier: LGPL-3.0-or-later
"""The unsteady flow on one mesh: its state, its steps, its balances, and what others read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np
from dolfinx import fem

from fem_tfm.case import Case
from fem_tfm.errors import SolverError
from fem_tfm.geometry.mesh import Mesh
from fem_tfm.models.unsteady.agitation import Agitation
from fem_tfm.models.unsteady.compression import IdealGas, Thickness, held
from fem_tfm.models.unsteady.fraction import SolidsFraction
from fem_tfm.models.unsteady.laws import CellLaws
from fem_tfm.models.unsteady.levels import (
    GAS_OF_CELLS,
    GAS_OF_FACES,
    PAST_OF_CELLS,
    PAST_OF_FACES,
    Levels,
    Past,
    euler,
    second_order,
)
from fem_tfm.models.unsteady.line import Line
from fem_tfm.models.unsteady.momenta import Momenta
from fem_tfm.models.unsteady.projection import Projection
from fem_tfm.models.unsteady.state import (
    OF_CELLS,
    OF_FACES,
    SMALLEST_FRACTION,
    SMALLEST_THETA,
    Feed,
    Masses,
    Moment,
    Rates,
    Report,
    StepFailed,
)
from fem_tfm.models.unsteady.turbulence import Turbulence
from fem_tfm.solvers.cells import Array, CellMatrix

FAILURES = (SolverError, FloatingPointError, np.linalg.LinAlgError)


class Flow3D:
    """An unsteady flow on one mesh.

    Parameters
    ----------
    case : laws, materials, inlet
    mesh : three-dimensional, with the parts inlet, outlet, wall, symmetry that it has

    Attributes
    ----------
    line, laws : mesh and coefficients
    fraction, agitation, momenta, projection : parts of a step; the first two only with solids
    ideal : the gas, None where its density is constant
    turbulence : what it makes, None where an algebraic law of the gas is all
    now, past : state, and what a step of second order takes from the one before it
    """

    def __init__(self, case: Case, mesh: Mesh) -> None:
        self.case, self.mesh = case, mesh
        self.gas, self.solids = case.gas_material, case.solids_material
        self.line, self.laws = Line(case, mesh), CellLaws(case)
        self.cells = self.line.cells
        scalar = CellMatrix(self.cells)
        self.turbulence = None
        if Turbulence.is_needed(self.laws):
            self.turbulence = Turbulence(case, self.line, self.laws, scalar)
        if self.solids is not None:
            self.fraction = SolidsFraction(self.line, self.laws, scalar)
            self.agitation = Agitation(case, self.line, self.laws, scalar)
        self.ideal = IdealGas(case, self.line) if case.gas.compressible else None
        lifted = self.ideal.lifted if self.ideal else self.gas.density
        self.momenta = Momenta(self.line, self.laws, np.array(case.gravity_vector), lifted)
        self.projection = Projection(self.line, self.laws, case.gas.compressible)
        self._functions: dict[str, fem.Function] = {}
        self.start()

    def start(self, alpha: Any = 0.0, theta: float = SMALLEST_THETA, p: Any = 0.0) -> None:
        """Both phases at rest; solids fraction and pressure are numbers or those of all cells."""
        cells = self.cells
        zero, flux = np.zeros(cells.count), np.zeros(cells.faces)
        vector = np.zeros((cells.count, 3))
        self.now = Moment(
            alpha=zero + alpha,
            theta=zero + theta,
            p=zero + p,
            u_s=vector,
            u_g=vector,
            total=flux,
            carried=flux,
            pushed=flux,
            response=flux,
            gained=flux,
            scales=self.turbulence.start() if self.turbulence else {},
        )
        self.past: Past | None = None
        self.time, self.steps = 0.0, 0
        self._count_masses()

    def move(self, u_s: Array, u_g: Array) -> None:
        """Give both phases velocities, (3,) or (cells, 3) [m/s]; walls hold their normal part."""
        cells = self.cells
        u_s, u_g = (np.broadcast_to(u, (cells.count, 3)).astype(float) for u in (u_s, u_g))
        fluxes = [cells.flux(u) for u in (u_s, u_g)]
        for flux in fluxes:
            for part in ("wall", "symmetry"):
                flux[cells.parts.get(part, slice(0, 0))] = 0.0
        alpha = cells.mean(self.now.alpha)
        self.now = replace(
            self.now,
            u_s=u_s,
            u_g=u_g,
            carried=fluxes[0],
            total=alpha * fluxes[0] + (1 - alpha) * fluxes[1],
        )

    def _count_masses(self) -> None:
        solids = self.cells.total(self.now.alpha[: self.cells.owned] * self.line.volume)
        self.masses = Masses(solids=solids, gas=self._gas_held(self.now, solids))

    def _gas_held(self, at: Moment, solids: float) -> float:
        """Gas in the line beside solids, at the density of the case [m3]."""
        if self.ideal is None:
            return self.cells.total(self.line.volume) - solids
        return self.cells.total(held(self.ideal, at, self.line.volume))

    # -- the step ------------------------------------------------------------------------------

    def advance(self, dt: float, feed: Feed) -> Report:
        """One step of `dt` [s].

        Raises
        ------
        StepFailed
            a solver did not converge or a value left its bounds; nothing has changed.
        """
        try:
            found, past, report, masses = self._attempt(dt, feed)
        except FAILURES as error:
            raise StepFailed(str(error)) from error
        self.now, self.past, self.masses = found, past, masses
        self.time += dt
        self.steps += 1
        return report

    def _attempt(self, dt: float, feed: Feed) -> tuple[Moment, Past | None, Report, Masses]:
        """A step of the case's order, or of first order where that one fails."""
        if self.line.order:
            try:
                return self._step(self._levels(dt, feed), dt, feed)
            except FAILURES:
                pass
        return self._step(euler(self.line, self.now, dt), dt, feed)

    def _levels(self, dt: float, feed: Feed) -> Levels:
        limit = 1.0 if self.solids is None else self.solids.packing_limit
        if self.past is None:
            return euler(self.line, self.now, dt, limit)
        gas = 1.0, 1.0
        if self.ideal:
            gas = self.ideal.relative(self.now.p), self.ideal.relative(self.past.p)
        return second_order(self.line, self.now, self.past, dt, limit, feed, gas)

    def _step(
        self, levels: Levels, dt: float, feed: Feed
    ) -> tuple[Moment, Past | None, Report, Masses]:
        old, start, span = levels.expected, levels.start, levels.span_faces
        cells, effort = self.cells, {}
        moved, rates, beta, dragged = None, None, np.zeros(cells.count), None
        at, stirred, compressed = old, None, None
        thickness = self.ideal.foresee(levels, dt) if self.ideal else None
        if self.turbulence:
            stirred = self.turbulence.stir(levels, thickness and thickness.later)
        if self.solids is not None:
            rates = self._expected_rates(levels)
            response = old.response
            if not self.steps:
                density = self.gas.density
                if thickness:
                    density = density * cells.mean(thickness.now)
                drag = sum(self._drag(old, thickness))
                response = self.projection.response(old.alpha, drag, dt, density)[0]
                # the pressure of the solids acts from the first step on: what it bears must too
                p_s = self.laws.solids_pressure(old.alpha, old.theta, rates)
                borne = response * cells.size * self.momenta.weight_borne(old.alpha, p_s)
                levels = replace(levels, start=replace(start, carried=start.carried + borne))
            moved = self.fraction.move(levels, response, rates, dt, feed, effort, stirred)
            if self.past is not None:
                lost = cells.sum(moved.flux) / self.line.volume - feed.inside.solids
                before = moved.alpha[: cells.owned] + levels.span * lost
                start = replace(start, alpha=cells.whole(np.clip(before, 0.0, 1.0)))
            at = replace(old, alpha=moved.alpha)
            beta, steep = self._drag(at, thickness)
            theta = self.agitation.warm(at, beta, levels, start, moved, rates, feed, effort)
            at = replace(at, theta=theta)
            # a gas that gives way follows its drag at once: with that of the slip foreseen alone,
            # flow and drag would take turns
            beta, dragged = beta + steep, steep[:, None] * (at.u_g - at.u_s)
        if self.ideal:
            compressed = self.ideal.compress(thickness, levels, moved, dt, feed)
        if self.turbulence:
            scales = self.turbulence.carry(
                at, levels, start, stirred, moved, feed, effort, compressed
            )
            at = replace(at, scales=scales)
        phases = self.momenta.phases(at, levels, start, moved, rates, stirred, compressed)
        gaps, accelerated = self.momenta.forces(at, phases, beta, levels, feed)
        guess = self.momenta.solve(phases, beta, accelerated, levels, feed, effort, dragged)
        at = replace(at, u_s=start.u_s)
        found = self.projection.project(
            at, phases, beta, guess, gaps, span, feed, effort, compressed
        )
        passed, added = np.zeros(cells.faces), np.zeros(cells.owned)
        if moved is not None:
            passed, added = moved.passed, moved.added
        volume = self.line.volume
        if compressed is None:
            grown = (feed.inside.solids + feed.inside.gas) * volume
            gas = found.total - passed, grown - added * volume
        else:
            self._check_density(found)
            gas = compressed.passed(found.total), compressed.fed * volume
        masses = self._balance((passed, added * volume), gas, dt)
        past = None
        if self.line.order:
            past = Past.of(self.now, dt, passed, cells.whole(added))
            if self.ideal:
                past = replace(past, gas=gas[0], fed=cells.whole(compressed.fed))
        return found, past, self._report(found, dt, effort, masses), masses

    def rates(self, at: Moment | Past) -> Rates:
        """How the solids of a state deform, in all cells (collective)."""
        cells = self.cells
        gradient = cells.whole(cells.gradient(at.u_s))
        dilation = cells.whole(cells.sum(at.carried) / self.line.volume)
        return self.laws.rates(gradient, dilation)

    def _expected_rates(self, levels: Levels) -> Rates:
        """Rates at the end of a step as far as they are foreseen; the gradient is that of now.

        Stresses that the matrix does not hold would grow if they were extrapolated.
        """
        found = self.rates(replace(levels.now, carried=levels.expected.carried))
        if levels.past is None:
            return found
        shear = levels.grown(found.shear, self.rates(levels.past).shear)
        return replace(found, shear=shear)

    def _drag(self, at: Moment, thickness: Thickness | None = None) -> tuple[Array, Array]:
        """beta and its growth with the slip, |u| d(beta)/d|u|, in all cells [kg/m3/s]."""
        laws = self.laws.of(thickness.later) if thickness else self.laws
        return laws.steep_drag(at.alpha, at.u_g - at.u_s, self.line.gas_profile[0])

    # -- what others read ----------------------------------------------------------------------

    def _check_density(self, found: Moment) -> None:
        density = self.ideal.relative(found.p)[: self.cells.owned]
        if not self.cells.largest(-density) < 0:
            raise SolverError("the density of the gas is not positive")

    def _balance(self, solids: tuple[Array, Array], gas: tuple[Array, Array], dt: float) -> Masses:
        """Masses with what has passed faces in a step and what was put into cells [m3/s]."""
        cells, edge = self.cells, slice(self.cells.inner, None)
        gained = {}
        for name, (passed, inside) in (("solids", solids), ("gas", gas)):
            flux = passed[edge]
            entered = cells.total(np.maximum(-flux, 0.0)) + cells.total(np.maximum(inside, 0.0))
            net = cells.total(inside) - cells.total(flux)
            gained[f"{name}_in"] = getattr(self.masses, f"{name}_in") + dt * entered
            gained[f"{name}_net"] = getattr(self.masses, f"{name}_net") + dt * net
        return replace(self.masses, **gained)

    def _report(self, found: Moment, dt: float, effort: dict[str, int], masses: Masses) -> Report:
        cells, own = self.cells, slice(0, self.cells.owned)
        values = {name: getattr(found, name) for name in OF_CELLS} | dict(found.scales)
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

    def _courant(self, at: Moment) -> tuple[float, float]:
        cells = self.cells
        alpha = cells.mean(at.alpha)
        gas = (at.total - alpha * at.carried) / np.maximum(1 - alpha, SMALLEST_FRACTION)
        rates = []
        for flux in (at.carried, gas):
            leaving = cells.sum_out(np.maximum(flux, 0.0), np.maximum(-flux, 0.0))
            rates.append(cells.largest(leaving / self.line.volume))
        return rates[0], rates[1]

    def _errors(self, at: Moment, masses: Masses) -> dict[str, float]:
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
        """Numbers of the whole line now, in the units of `case.QUANTITIES`.

        The flows are those through the outlet, the pressure drop that from the inlet's cells to it.
        """
        cells, now, own = self.cells, self.now, slice(0, self.cells.owned)
        entry, size = cells.first[self.line.inlet], cells.size[self.line.inlet]
        area = max(cells.total(size), 1e-300)
        drop = cells.total(now.p[entry] * size) / area
        factor = self.mesh.section.area_factor
        leaving = cells.mean(now.alpha)[self.line.outlet] * now.carried[self.line.outlet]
        gas = now.total[self.line.outlet] - leaving
        gas = cells.total(gas * self.ideal.at_outlet if self.ideal else gas)
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
        self.projection.renew()
        cells, own = self.cells, slice(0, self.cells.owned)
        found = {name: getattr(self.now, name)[own].copy() for name in OF_CELLS}
        for name, directed in OF_FACES.items():
            found[name] = cells.to_sides(getattr(self.now, name), directed)
        found |= {name: values[own].copy() for name, values in self.now.scales.items()}
        of_cells, of_faces = self._names_of_past
        if self.past is not None:
            for name in of_cells:
                found[f"before_{name}"] = getattr(self.past, name)[own].copy()
            for name, values in self.past.scales.items():
                found[f"before_{name}"] = values[own].copy()
            for name in of_faces:
                found[f"before_{name}"] = cells.to_sides(getattr(self.past, name))
            found["before_dt"] = np.array(self.past.dt)
        found["time"], found["steps"] = np.array(self.time), np.array(self.steps)
        return found | {f"mass_{n}": np.array(v) for n, v in vars(self.masses).items()}

    @property
    def _names_of_past(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """What the next step takes from before the last one, in cells and on faces."""
        if self.ideal is None:
            return PAST_OF_CELLS, PAST_OF_FACES
        return PAST_OF_CELLS + GAS_OF_CELLS, PAST_OF_FACES + GAS_OF_FACES

    def restore(self, state: Mapping[str, Array]) -> None:
        """Take over what `state` gave, also from another division into ranks (collective)."""
        cells = self.cells
        found = {name: cells.whole(np.asarray(state[name])) for name in OF_CELLS}
        for name, directed in OF_FACES.items():
            found[name] = cells.from_sides(np.asarray(state[name]), directed)
        found["scales"] = {n: cells.whole(np.asarray(state[n])) for n in self.now.scales}
        self.now, self.past = Moment(**found), None
        if self.line.order and "before_dt" in state:
            of_cells, of_faces = self._names_of_past
            scales = self.now.scales
            names = *of_cells, *of_faces, *scales
            given = {name: np.asarray(state[f"before_{name}"]) for name in names}
            found = {name: cells.whole(given[name]) for name in of_cells}
            found |= {name: cells.from_sides(given[name]) for name in of_faces}
            found["scales"] = {name: cells.whole(given[name]) for name in scales}
            self.past = Past(float(state["before_dt"]), **found)
        self.time, self.steps = float(state["time"]), int(state["steps"])
        names = (f.name for f in fields(Masses))
        self.masses = Masses(**{name: float(state[f"mass_{name}"]) for name in names})
        self.projection.renew()

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

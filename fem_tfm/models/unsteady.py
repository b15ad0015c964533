# SPDX-License-Identifier: LGPL-3.0-or-later
"""The unsteady two-fluid flow in three dimensions, one value a cell.

One step, without outer iterations:

1. solids fraction: upwind with the volume fluxes, the pressure of the solids implicit and
   nonlinear; the matrix is an M-matrix, so 0 <= alpha_s < packing_limit at any step, and alpha_s is
   taken from its own fluxes, so that the mass of the solids is exact to round-off;
2. granular temperature: implicit, its sinks in the diagonal, so Theta > 0;
3. momenta of both phases with their drag in one matrix for all three components;
4. pressure: what the momenta leave of div(alpha_s u_s + alpha_g u_g) = 0, by a projection whose
   response is that of mass and drag alone, R = [[m_s/dt + beta, -beta], [-beta, m_g/dt + beta]]^-1.

Forces act as accelerations of faces and are carried to the cells from there, so that neither
pressure oscillates and fluids at rest stay at rest. p is the pressure without the weight of the gas
at the outlet.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from dolfinx import fem

from fem_tfm.case import Case
from fem_tfm.closures.granular import Kinetic, algebraic_theta
from fem_tfm.closures.turbulence import Eddies
from fem_tfm.closures.walls import GasWallState, WallState
from fem_tfm.errors import SolverError
from fem_tfm.feed import power_law
from fem_tfm.mesh import Mesh
from fem_tfm.solvers.cells import Array, CellMatrix, Cells, Krylov

PARTS = ("inlet", "outlet", "wall", "symmetry")
# a phase that is not there moves as one of this fraction; a void has this granular temperature
SMALLEST_FRACTION, SMALLEST_THETA = 1e-9, 1e-12
# viscosity and conduction of grains, which laws keep finite in a void, fade below this fraction
FADING_FRACTION = 1e-4
# grains below this fraction are not faster than the gas
LONELY_FRACTION = 1e-6
# largest viscosity of the solids over rho_s U D
MOST_VISCOUS = 100.0
# speeds that regularise drag and walls, and shear, over U and U/D
SLIP_FLOOR, SHEAR_FLOOR = 1e-4, 1e-3
# solids fraction: relative residual, change and iterations of its Newton's method
ALPHA_RESIDUAL, ALPHA_CHANGE, ALPHA_ITERATIONS = 1e-10, 1e-12, 40
# residuals of linear systems over right-hand sides; a step of Newton's method needs little
TRANSPORT_TOLERANCE, PRESSURE_TOLERANCE, NEWTON_TOLERANCE = 1e-6, 1e-6, 1e-4
# residuals that end a solver, over U and rho_g U^2 in every cell
SMALL_VELOCITY, SMALL_PRESSURE = 1e-9, 1e-9
# steps after which the multigrid is built anew, and iterations above which it is
MULTIGRID_AGE, MULTIGRID_EFFORT = 20, 15


class StepFailed(SolverError):
    """A time step has no acceptable result; the state is the one before it."""


@dataclass(frozen=True)
class Feed:
    """What enters and leaves at the end of a step.

    gas_velocity : superficial [m/s]
    solids_fraction, solids_velocity : of what enters [-], [m/s]
    blocked : the outlet lets the gas pass and holds the solids
    """

    gas_velocity: float
    solids_fraction: float = 0.0
    solids_velocity: float = 0.0
    blocked: bool = False


@dataclass(frozen=True)
class Report:
    """What a step took and where it led: effort, early warning.

    iterations : of each equation
    courant : largest share of a cell that leaves it in the step [-]
    mass_error : relative errors of the masses of solids and gas since the start
    """

    iterations: Mapping[str, int]
    max_alpha_s: float
    max_theta: float
    courant: float
    mass_error: float


@dataclass(frozen=True)
class Moment:
    """The state at one time; its arrays are replaced, never changed.

    alpha, theta, p : solids fraction [-], granular temperature [m2/s2], pressure [Pa] in cells
    u_s, u_g : velocities (cells, 3) [m/s]
    total : volume flux of both phases through faces [m3/s]
    carried : volume flux of the solids by u_s.S, its share that their pressure pushes is `pushed`
    response : R_ss on faces, [m3 s/kg]
    gained : what the last step has added to `carried`, in a second [m3/s2]
    """

    alpha: Array
    theta: Array
    p: Array
    u_s: Array
    u_g: Array
    total: Array
    carried: Array
    pushed: Array
    response: Array
    gained: Array


# names in a Moment, and whether a value on faces has their direction
OF_CELLS = ("alpha", "theta", "p", "u_s", "u_g")
OF_FACES = {"total": True, "carried": True, "pushed": True, "response": False, "gained": True}


@dataclass(frozen=True)
class Grains:
    """Coefficients of the solids in all cells."""

    kinetic: Kinetic
    g0: Array
    p_f: Array
    mu_f: Array
    shear: Array
    dilation: Array


@dataclass
class Masses:
    """What has entered and left, for the balances [m3]."""

    solids: float = 0.0
    solids_in: float = 0.0
    solids_net: float = 0.0
    gas: float = 0.0
    gas_in: float = 0.0
    gas_net: float = 0.0


class Flow3D:
    """An unsteady flow on one mesh.

    Parameters
    ----------
    case : laws, materials, inlet
    mesh : three-dimensional, with the parts inlet, outlet, wall, symmetry that it has
    """

    def __init__(self, case: Case, mesh: Mesh) -> None:
        self.case, self.mesh = case, mesh
        self.cells = Cells(mesh, [name for name in PARTS if name in mesh.tags])
        self.gas, self.solids = case.gas_material, case.solids_material
        self.gravity = np.array(case.gravity_vector)
        self.laws, self.walls = case.closures, case.walls
        self.speed = case.operation.gas_superficial_velocity
        self.width = case.geometry.hydraulic_diameter
        self.time, self.steps = 0.0, 0
        self._prepare()
        self.masses = Masses()
        self._functions: dict[str, fem.Function] = {}
        self.start()

    # -- set-up --------------------------------------------------------------------------------

    def _prepare(self) -> None:
        """Distances, weights, matrices and solvers, which all steps share."""
        cells = self.cells
        self._volume = cells.volume[: cells.owned]
        self._wall = cells.parts.get("wall", slice(0, 0))
        self._inlet = cells.parts.get("inlet", slice(0, 0))
        self._outlet = cells.parts.get("outlet", slice(0, 0))
        self.distance = self.mesh.distance_at(cells.centre)
        self._reconstruct = cells.reconstruction([n for n in ("inlet",) if n in cells.parts])
        self._normal = cells.area / cells.size[:, None]
        # rises along the normals, for the weight of a phase [m/s2]
        self._weight = self._normal @ self.gravity
        self._normal_slope = cells.reach / cells.size
        self._height = 1 / self._normal_slope[self._wall]
        self._open = np.zeros(cells.faces)
        self._open[: cells.inner] = 1.0
        self._open[self._outlet] = 1.0
        self._profile = self._inlet_profile()
        self._edges = cells.first[cells.inner :]
        phases = 1 if self.solids is None else 2
        self._scalar, self._coupled = CellMatrix(cells), CellMatrix(cells, phases)
        self._transport = Krylov(self._scalar, "transport", TRANSPORT_TOLERANCE)
        self._newton = Krylov(self._scalar, "transport", NEWTON_TOLERANCE)
        self._momentum = Krylov(self._coupled, "transport", TRANSPORT_TOLERANCE)
        self._laplacian = CellMatrix(cells)
        self._pressure = Krylov(self._laplacian, "pressure", PRESSURE_TOLERANCE)
        self._age = MULTIGRID_AGE
        self._known: tuple[Any, Any] = (None, None)
        self._has_outlet = cells.total(self._outlet.stop - self._outlet.start) > 0

    def _inlet_profile(self) -> Array:
        """Normal velocity of what enters over its mean, on the faces of the inlet [-]."""
        cells = self.cells
        shape = np.ones(self._inlet.stop - self._inlet.start)
        if self.case.inlet.profile == "power-law":
            height = self.mesh.distance_at(cells.middle[self._inlet])
            shape = power_law(height, self.width / 2)
        size = cells.size[self._inlet]
        area, flux = cells.total(size), cells.total(size * shape)
        return shape * (area / flux) if flux > 0 else shape

    def start(self, alpha: Any = 0.0, theta: float = SMALLEST_THETA) -> None:
        """Both phases at rest, with a solids fraction given as a number or in all cells."""
        cells = self.cells
        zero, flux = np.zeros(cells.count), np.zeros(cells.faces)
        vector = np.zeros((cells.count, 3))
        self.now = Moment(
            alpha=zero + alpha,
            theta=zero + theta,
            p=zero,
            u_s=vector,
            u_g=vector,
            total=flux,
            carried=flux,
            pushed=flux,
            response=flux,
            gained=flux,
        )
        self.time, self.steps = 0.0, 0
        self._count_masses()

    def move(self, u_s: Array, u_g: Array) -> None:
        """Give both phases velocities, (3,) or (cells, 3) [m/s]; walls hold their normal part."""
        cells = self.cells
        u_s, u_g = (np.broadcast_to(u, (cells.count, 3)).astype(float) for u in (u_s, u_g))
        fluxes = [np.einsum("ni,ni->n", cells.mean(u), cells.area) for u in (u_s, u_g)]
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
        solids = self.cells.total(self.now.alpha[: self.cells.owned] * self._volume)
        room = self.cells.total(self._volume)
        self.masses = Masses(solids=solids, gas=room - solids)

    # -- the step ------------------------------------------------------------------------------

    def advance(self, dt: float, feed: Feed) -> Report:
        """One step of `dt` [s].

        Raises
        ------
        StepFailed
            a solver did not converge or a value left its bounds; nothing has changed.
        """
        try:
            found, report, masses = self._step(dt, feed)
        except (SolverError, FloatingPointError, np.linalg.LinAlgError) as error:
            raise StepFailed(str(error)) from error
        self.now, self.masses = found, masses
        self.time += dt
        self.steps += 1
        return report

    def _step(self, dt: float, feed: Feed) -> tuple[Moment, Report, Masses]:
        old, cells, effort = self.now, self.cells, {}
        through = np.zeros(cells.faces)
        alpha, theta, p_s = old.alpha, old.theta, None
        if self.solids is not None:
            alpha, through, p_s, dilation = self._fraction(old, dt, feed, effort)
            theta = self._agitation(old, alpha, through, dilation, dt, feed, effort)
        at = replace(old, alpha=alpha, theta=theta)
        found = self._flow(at, old, through, p_s, dt, feed, effort)
        masses = self._balance(found, through, dt)
        return found, self._report(found, through, dt, effort, masses), masses

    # -- solids fraction -----------------------------------------------------------------------

    def _fraction(
        self, old: Moment, dt: float, feed: Feed, effort: dict[str, int]
    ) -> tuple[Array, Array, Array, Array]:
        """Solids fraction after the step, their volume flux [m3/s], pressure [Pa], dilation [1/s].

        The pressure is the one that has moved the solids: their momentum must feel the same, or
        the fluctuations that a step brings would throw a packed bed apart. The dilation is that of
        the velocities behind the flux.
        """
        cells, limit = self.cells, self.solids.packing_limit
        response = old.response if self.steps else self._response(old, self._drag(old), dt)[0]
        inner, edge = slice(0, cells.inner), slice(cells.inner, None)
        push = (response * cells.reach)[inner]
        shear, dilation = self._rates(old)[1:]
        first, second = cells.first[inner], cells.second
        rate = self._volume / dt
        ahead, back, ties = (np.zeros(cells.faces) for _ in range(3))
        alpha = np.maximum(old.alpha, 0.0)
        w = alpha / (limit - alpha)

        def pressure(alpha: Array) -> Array:
            return self._solids_pressure(alpha, old.theta, shear, dilation)

        def stiffness(w: Array, p_s: Array) -> Array:
            step = 1e-7 * (1 + w)
            found = (pressure(limit * (w + step) / (1 + w + step)) - p_s) / step
            return np.maximum(found, 0.0)

        p_s = pressure(alpha)
        stiff = stiffness(w, p_s)
        # where the pressure is too stiff for the step, its waves would run on without end: there
        # the flux is that at the end of the step, which damps them
        sound = np.zeros(cells.count)
        ties[inner] = push
        sound[: cells.owned] = (
            cells.add(ties) / rate * (stiff * alpha * (1 + w) ** 2)[: cells.owned]
        )
        sound = np.max(cells.exchange(sound / limit)[np.stack([first, second])], axis=0)
        flux = old.carried - old.pushed
        flux[inner] += sound / (1 + sound) * dt * old.gained[inner]
        flux[self._inlet] = 0.0
        if feed.blocked:
            flux[self._outlet] = 0.0
        flux[self._outlet] = np.maximum(flux[self._outlet], 0.0)
        ahead[edge] = np.maximum(flux[edge], 0.0)
        entering = self._entering(feed.solids_velocity) * feed.solids_fraction

        def fluxes(alpha: Array, p_s: Array) -> Array:
            # upwind by what the pressure leaves of the flux: grains at rest do not creep
            moved = flux[inner] - push * (p_s[second] - p_s[first])
            ahead[inner], back[inner] = np.maximum(moved, 0.0), np.maximum(-moved, 0.0)
            found = np.empty(cells.faces)
            found[inner] = ahead[inner] * alpha[first] - back[inner] * alpha[second]
            found[edge] = ahead[edge] * alpha[self._edges]
            found[self._inlet] = entering
            return found

        for iteration in range(1, ALPHA_ITERATIONS + 1):
            effort["solids fraction"] = iteration
            through = fluxes(alpha, p_s)
            residual = rate * (alpha[: cells.owned] - old.alpha[: cells.owned]) + cells.sum(through)
            worst = cells.largest(np.abs(residual) / rate)
            if not np.isfinite(worst):
                raise SolverError("the solids fraction is not finite")
            if worst < ALPHA_RESIDUAL:
                break
            slope = limit / (1 + w) ** 2
            ties[inner] = upwind = push * np.where(ahead[inner] > 0, alpha[first], alpha[second])
            diagonal = (rate + cells.sum_out(ahead, back)) * slope[: cells.owned]
            diagonal += cells.add(ties) * stiff[: cells.owned]
            self._scalar.set(
                [diagonal],
                [
                    (
                        -back[inner] * slope[second] - upwind * stiff[second],
                        -ahead[inner] * slope[first] - upwind * stiff[first],
                    )
                ],
            )
            self._newton.renew()
            change = self._newton.solve(-residual, np.zeros(cells.owned))
            # w stays positive and finite, and p_s is nearly linear in it
            own = w[: cells.owned]
            w = cells.whole(np.clip(own + change, 0.1 * own, 10 * (1 + own)))
            alpha = limit * w / (1 + w)
            p_s = pressure(alpha)
            if cells.largest(np.abs(change) * slope[: cells.owned]) < ALPHA_CHANGE:
                through = fluxes(alpha, p_s)
                break
            stiff = stiffness(w, p_s)
        else:
            raise SolverError("Newton's method of the solids fraction does not converge")
        alpha = old.alpha[: cells.owned] - cells.sum(through) / rate
        # round-off may leave an emptied cell below zero
        lowest = -cells.largest(-alpha)
        if lowest < -1e-9 or cells.largest(alpha) >= limit:
            raise SolverError("the solids fraction leaves its bounds")
        moved = np.where(np.arange(cells.faces) < cells.inner, ahead - back, flux)
        moved[self._inlet] = self._entering(feed.solids_velocity)
        return cells.whole(alpha), through, p_s, cells.whole(cells.sum(moved) / self._volume)

    def _solids_pressure(self, alpha: Array, theta: Array, shear: Array, dilation: Array) -> Array:
        laws, solids = self.laws, self.solids
        alpha = np.maximum(alpha, 0.0)
        g0 = laws.radial.g0(alpha, solids)
        kinetic = laws.granular.coefficients(alpha, theta, g0, solids, self.width)
        friction = laws.friction.stress(alpha, theta, shear, dilation, solids)
        return kinetic.pressure + friction.pressure

    def _entering(self, mean: float) -> Array:
        """Volume flux into the domain at a mean velocity, negative as it enters [m3/s]."""
        return -mean * self._profile * self.cells.size[self._inlet]

    # -- coefficients --------------------------------------------------------------------------

    def _rates(self, at: Moment) -> tuple[Array, Array, Array]:
        """Gradient of u_s, S:S and div u_s in all cells [1/s]; found once for a state."""
        if self._known[0] is not at:
            self._known = at, self._find_rates(at)
        return self._known[1]

    def _find_rates(self, at: Moment) -> tuple[Array, Array, Array]:
        cells = self.cells
        gradient = cells.whole(cells.gradient(at.u_s))
        dilation = cells.whole(cells.sum(at.carried) / self._volume)
        strain = (gradient + np.swapaxes(gradient, 1, 2)) / 2
        trace = np.einsum("nii->n", strain)
        shear = np.einsum("nij,nij->n", strain, strain) - trace**2 / 3
        return gradient, np.maximum(shear, 0.0), dilation

    def _grains(self, at: Moment, shear: Array, dilation: Array) -> Grains:
        """Coefficients of kinetic theory and friction."""
        laws, solids = self.laws, self.solids
        alpha = np.maximum(at.alpha, 0.0)
        g0 = laws.radial.g0(alpha, solids)
        kinetic = laws.granular.coefficients(alpha, at.theta, g0, solids, self.width)
        fade = alpha / (alpha + FADING_FRACTION)
        kinetic = kinetic._replace(
            shear_viscosity=fade * kinetic.shear_viscosity,
            conductivity=fade * kinetic.conductivity,
        )
        friction = laws.friction.stress(alpha, at.theta, shear, dilation, solids)
        cap = MOST_VISCOUS * solids.density * self.speed * self.width
        zero = np.zeros_like(alpha)
        return Grains(
            kinetic,
            g0,
            zero + friction.pressure,
            np.minimum(zero + friction.viscosity, cap),
            shear,
            dilation,
        )

    def _drag(self, at: Moment) -> Array:
        """beta [kg/m3/s] in all cells."""
        slip = at.u_g - at.u_s
        floor = SLIP_FLOOR * self.speed
        speed = np.sqrt(np.einsum("ni,ni->n", slip, slip) + floor**2)
        alpha = np.maximum(at.alpha, SMALLEST_FRACTION)
        return self.laws.drag.beta(alpha, speed, self.gas, self.solids)

    def _response(self, at: Moment, beta: Array, dt: float) -> tuple[Array, ...]:
        """R_ss, R_sg = R_gs, R_gg on faces [m3 s/kg]."""
        alpha, beta = self.cells.mean(at.alpha), self.cells.mean(beta)
        gas = self.gas.density * np.maximum(1 - alpha, SMALLEST_FRACTION) / dt
        solids = self.solids.density * np.maximum(alpha, SMALLEST_FRACTION) / dt
        # (gas + beta)(solids + beta) - beta^2 without the difference
        determinant = gas * solids + beta * (gas + solids)
        return (gas + beta) / determinant, beta / determinant, (solids + beta) / determinant

    # -- granular temperature ------------------------------------------------------------------

    def _agitation(
        self,
        old: Moment,
        alpha: Array,
        through: Array,
        dilation: Array,
        dt: float,
        feed: Feed,
        effort: dict[str, int],
    ) -> Array:
        """Granular temperature after the step [m2/s2]."""
        cells, solids = self.cells, self.solids
        at = replace(old, alpha=alpha)
        _, shear, earlier = self._rates(old)
        # dense grains heat up thousandfold faster than they are compressed: what only one of two
        # steps compresses would drive waves of their pressure
        dilation = np.maximum(dilation, earlier)
        grains, beta = self._grains(at, shear, dilation), self._drag(at)
        if self.laws.theta == "algebraic":
            found = algebraic_theta(
                alpha, grains.g0, shear, 0.0, self.laws.granular, solids, self.width, beta
            )
            alone = alpha < LONELY_FRACTION
            return np.clip(found, SMALLEST_THETA, np.where(alone, self.speed**2, np.inf))
        own, k = slice(0, cells.owned), grains.kinetic
        mass = 1.5 * solids.density * np.maximum(old.alpha[own], SMALLEST_FRACTION)
        inertia = mass * self._volume / dt
        work = 2 * k.shear_viscosity * shear + k.bulk_viscosity * dilation**2
        if self.laws.friction_feeds_theta:
            work = work + 2 * grains.mu_f * shear
        unit = k.pressure / old.theta * dilation
        sink = k.dissipation / old.theta + 3 * beta + np.maximum(unit, 0.0)
        gain = work + np.maximum(-unit, 0.0) * old.theta
        spread = cells.mean(k.conductivity) * cells.reach
        spread[cells.inner :] = 0.0
        flux = 1.5 * solids.density * through
        ahead, back = np.maximum(flux, 0.0), np.maximum(-flux, 0.0)
        inflow = cells.sum_out(back, ahead)
        diagonal = inertia + sink[own] * self._volume + inflow + cells.add(spread)
        rhs = inertia * old.theta[own] + gain[own] * self._volume
        entering = (
            back[self._inlet] * (self.case.inlet.solids_intensity * feed.solids_velocity) ** 2
        )
        cells.to_boundary("inlet", rhs, entering) if "inlet" in cells.parts else None
        if "wall" in cells.parts:
            heat = self._wall_heat(at, grains) * cells.size[self._wall]
            edge = cells.first[self._wall]
            cells.to_boundary("wall", rhs, np.maximum(heat, 0.0))
            cells.to_boundary("wall", diagonal, np.maximum(-heat, 0.0) / old.theta[edge])
        inner = slice(0, cells.inner)
        self._scalar.set([diagonal], [(-(back + spread)[inner], -(ahead + spread)[inner])])
        self._transport.renew()
        found = self._transport.solve(rhs, old.theta[own])
        effort["theta"] = self._transport.iterations
        # grains that are all but alone do not fly faster than the gas
        alone = alpha[own] < LONELY_FRACTION
        found[alone] = np.minimum(found[alone], self.speed**2)
        return cells.whole(np.maximum(found, SMALLEST_THETA))

    def _wall_state(self, at: Moment, grains: Grains) -> tuple[WallState, Array]:
        """What the wall law of the solids sees, and the velocity along the wall."""
        edge, normal = self.cells.first[self._wall], self._normal[self._wall]
        u = at.u_s[edge]
        u = u - np.einsum("ni,ni->n", u, normal)[:, None] * normal
        floor = SLIP_FLOOR * self.speed
        slip = np.sqrt(np.einsum("ni,ni->n", u, u) + floor**2)
        alpha = np.maximum(at.alpha[edge], 0.0)
        state = WallState(alpha, at.theta[edge], grains.g0[edge], grains.p_f[edge], slip)
        return state, u

    def _wall_heat(self, at: Moment, grains: Grains) -> Array:
        state, _ = self._wall_state(at, grains)
        return np.zeros_like(state.slip) + self.walls.solids.heat(state, self.solids)

    # -- momentum and pressure -----------------------------------------------------------------

    def _flow(
        self,
        at: Moment,
        old: Moment,
        through: Array,
        p_s: Array | None,
        dt: float,
        feed: Feed,
        effort: dict[str, int],
    ) -> Moment:
        """Velocities and pressure after the step."""
        phases = self._phases(at, old, through, p_s)
        gaps, accelerated = self._forces(at, phases, feed)
        guess = self._momenta(at, old, phases, accelerated, dt, feed, effort)
        return self._project(at, phases, guess, gaps, dt, feed, effort)

    def _phases(self, at: Moment, old: Moment, through: Array, p_s: Array | None) -> list[_Phase]:
        """Coefficients of the phases, the gas last."""
        cells = self.cells
        gradient_g = cells.whole(cells.gradient(at.u_g))
        found = []
        beta = np.zeros(cells.count)
        if self.solids is not None:
            gradient, shear, dilation = self._rates(old)
            grains = self._grains(at, shear, dilation)
            beta = self._drag(at)
            mu = grains.kinetic.shear_viscosity + grains.mu_f
            bulk = grains.kinetic.bulk_viscosity
            found.append(
                _Phase(
                    "solids",
                    self.solids.density,
                    at.alpha,
                    old.alpha,
                    at.u_s,
                    through,
                    mu,
                    bulk,
                    gradient,
                    self._solids_traction(at, grains, mu),
                    p_s,
                )
            )
        void = 1 - at.alpha
        mu = void * self._gas_viscosity(gradient_g)
        passing = old.total - through
        passing[self._inlet] = 0.0
        found.append(
            _Phase(
                "gas",
                self.gas.density,
                void,
                1 - old.alpha,
                at.u_g,
                passing,
                mu,
                np.zeros_like(mu),
                gradient_g,
                self._gas_traction(at, mu),
                None,
            )
        )
        self._beta = beta
        return found

    def _gas_viscosity(self, gradient: Array) -> Array:
        """mu_g + mu_t [Pa s] in all cells."""
        strain = (gradient + np.swapaxes(gradient, 1, 2)) / 2
        trace = np.einsum("nii->n", strain)
        shear = 2 * (np.einsum("nij,nij->n", strain, strain) - trace**2 / 3)
        rate = np.sqrt(np.maximum(shear, 0.0) + (SHEAR_FLOOR * self.speed / self.width) ** 2)
        eddies = Eddies(rate, self.distance, self.gas, self.width / 2)
        return self.gas.viscosity + self.laws.turbulence.viscosity(eddies)

    def _solids_traction(self, at: Moment, grains: Grains, mu: Array) -> Array:
        """Friction c |S| of the wall on the solids [kg/s]."""
        law, size = self.walls.solids, self.cells.size[self._wall]
        if law.strong:
            return mu[self.cells.first[self._wall]] * self.cells.reach[self._wall]
        state, _ = self._wall_state(at, grains)
        return (np.zeros_like(state.slip) + law.friction(state, self.solids)) * size

    def _gas_traction(self, at: Moment, mu: Array) -> Array:
        """Friction c |S| of the wall on the gas [kg/s], found at the centre of the wall's cells."""
        law, edge = self.walls.gas, self.cells.first[self._wall]
        if law.strong:
            return mu[edge] * self.cells.reach[self._wall]
        normal = self._normal[self._wall]
        u = at.u_g[edge]
        u = u - np.einsum("ni,ni->n", u, normal)[:, None] * normal
        speed = np.sqrt(np.einsum("ni,ni->n", u, u) + (SLIP_FLOOR * self.speed) ** 2)
        c = law.coefficient(GasWallState(speed, self._height, self.gas))
        return (1 - at.alpha[edge]) * (np.zeros_like(speed) + c) * self.cells.size[self._wall]

    def _forces(
        self, at: Moment, phases: list[_Phase], feed: Feed
    ) -> tuple[list[Array], list[Array]]:
        """Accelerations by pressures and weight: vectors in cells, and what faces have beyond them.

        The second is the force [N/m3] along the normals of the faces that interpolated cells lack.
        """
        cells, inner = self.cells, slice(0, self.cells.inner)
        slope = np.zeros(cells.faces)
        first, second = cells.first[inner], cells.second
        slope[inner] = (at.p[second] - at.p[first]) * self._normal_slope[inner]
        slope[self._outlet] = -at.p[cells.first[self._outlet]] * self._normal_slope[self._outlet]
        gaps, accelerated = [], []
        for phase in phases:
            share = np.maximum(cells.mean(phase.fraction), SMALLEST_FRACTION)
            force = -share * slope
            force += share * (phase.density - self.gas.density) * self._weight
            if phase.pressure is not None:
                p_s = phase.pressure
                force[inner] -= (p_s[second] - p_s[first]) * self._normal_slope[inner]
            force *= self._open
            if phase.name == "solids" and feed.blocked:
                force[self._outlet] = 0.0
            mass = phase.density * share
            vector = cells.whole(self._reconstruct(force / mass))
            average = np.einsum("ni,ni->n", cells.mean(vector), self._normal)
            gaps.append(force - mass * average * self._open)
            accelerated.append(vector)
        return gaps, accelerated

    def _momenta(
        self,
        at: Moment,
        old: Moment,
        phases: list[_Phase],
        accelerated: list[Array],
        dt: float,
        feed: Feed,
        effort: dict[str, int],
    ) -> list[Array]:
        """Velocities that the momenta give with the old pressure, in all cells."""
        cells, own, inner = self.cells, slice(0, self.cells.owned), slice(0, self.cells.inner)
        many = len(phases)
        coupling = self._beta[own] * self._volume
        diagonals, across, sides = [], [], []
        for phase, acceleration in zip(phases, accelerated, strict=True):
            inertia = phase.density * np.maximum(phase.before[own], SMALLEST_FRACTION)
            inertia = inertia * self._volume / dt
            flux = phase.density * phase.flux
            ahead, back = np.maximum(flux, 0.0), np.maximum(-flux, 0.0)
            spread = cells.mean(phase.viscosity) * cells.reach
            spread[cells.inner :] = 0.0
            diagonal = inertia + cells.sum_out(back, ahead) + cells.add(spread)
            rhs = inertia[:, None] * phase.velocity[own]
            mass = phase.density * np.maximum(phase.fraction[own], SMALLEST_FRACTION)
            rhs += (mass * self._volume)[:, None] * acceleration[own] + self._stress(phase)
            if "wall" in cells.parts:
                cells.to_boundary("wall", diagonal, phase.traction)
            if "inlet" in cells.parts:
                mean = self._mean_velocity(phase.name, feed)
                fraction = feed.solids_fraction
                fraction = fraction if phase.name == "solids" else 1 - fraction
                entering = phase.density * fraction * -self._entering(mean)
                velocity = -mean * self._profile[:, None] * self._normal[self._inlet]
                # what a passing flux without inlet has left out
                missing = entering - back[self._inlet]
                cells.to_boundary("inlet", diagonal, missing)
                cells.to_boundary("inlet", rhs, entering[:, None] * velocity)
            diagonals.append(diagonal)
            across.append((-(back + spread)[inner], -(ahead + spread)[inner]))
            sides.append(rhs)
        if many == 2:
            blocks = [diagonals[0] + coupling, -coupling, -coupling, diagonals[1] + coupling]
        else:
            blocks = diagonals
        self._coupled.set(blocks, across)
        self._momentum.renew()
        found = np.empty((cells.owned, many, 3))
        start = np.stack([phase.velocity[own] for phase in phases], axis=1)
        side = np.stack(sides, axis=1)
        effort["momentum"] = 0
        # the components share one measure: what is small across the pipe need not be sharper
        largest = max(cells.total(start[:, :, i] ** 2) for i in range(3)) ** 0.5
        enough = TRANSPORT_TOLERANCE * largest + self._little(SMALL_VELOCITY * self.speed)
        for i in range(3):
            x = self._momentum.solve(side[:, :, i].ravel(), start[:, :, i].ravel(), enough)
            effort["momentum"] += self._momentum.iterations
            found[:, :, i] = x.reshape(-1, many)
        return [cells.whole(np.ascontiguousarray(found[:, k])) for k in range(many)]

    def _mean_velocity(self, name: str, feed: Feed) -> float:
        """Mean velocity with which a phase enters [m/s]."""
        if name == "solids":
            return feed.solids_velocity
        return feed.gas_velocity / (1 - feed.solids_fraction)

    def _stress(self, phase: _Phase) -> Array:
        """What the implicit difference leaves of the viscous force on the owned cells [N]."""
        cells, inner = self.cells, slice(0, self.cells.inner)
        rate = cells.mean(phase.gradient.reshape(-1, 9)).reshape(-1, 3, 3)[inner]
        mu = cells.mean(phase.viscosity)[inner]
        bulk = cells.mean(phase.bulk)[inner] - 2 / 3 * mu
        area, trace = cells.area[inner], np.einsum("nii->n", rate)
        force = np.zeros((cells.faces, 3))
        turned = np.einsum("nji,nj->ni", rate, area) + np.einsum(
            "nij,nj->ni", rate, cells.skew[inner]
        )
        force[inner] = mu[:, None] * turned + (bulk * trace)[:, None] * area
        return cells.sum(force)

    def _project(
        self,
        at: Moment,
        phases: list[_Phase],
        guess: list[Array],
        gaps: list[Array],
        dt: float,
        feed: Feed,
        effort: dict[str, int],
    ) -> Moment:
        """Pressure that makes the flux of both phases free of divergence."""
        cells, inner = self.cells, slice(0, self.cells.inner)
        shares = [cells.mean(phase.fraction) for phase in phases]
        if len(phases) == 2:
            ss, sg, gg = self._response(at, self._beta, dt)
            response = [[ss, sg], [sg, gg]]
        else:
            response = [[dt / (self.gas.density * np.ones(cells.faces))]]
        blocked = feed.blocked and len(phases) == 2
        carried = []
        for row, phase, velocity in zip(response, phases, guess, strict=True):
            flux = np.einsum("ni,ni->n", cells.mean(velocity), cells.area)
            flux += cells.size * sum(r * gap for r, gap in zip(row, gaps, strict=True))
            flux *= self._open
            if "inlet" in cells.parts:
                flux[self._inlet] = self._entering(self._mean_velocity(phase.name, feed))
            if phase.name == "solids" and blocked:
                flux[self._outlet] = 0.0
            carried.append(flux)
        if "inlet" in cells.parts and len(phases) == 2:
            shares[0] = shares[0].copy()
            shares[0][self._inlet] = feed.solids_fraction
            shares[1] = 1 - shares[0]
        total = sum(share * flux for share, flux in zip(shares, carried, strict=True))
        # how each phase follows a difference of pressure
        follow = [
            sum(r * share for r, share in zip(row, shares, strict=True)) * cells.reach * self._open
            for row in response
        ]
        if blocked:
            follow[0][self._outlet] = 0.0
        stiff = sum(share * part for share, part in zip(shares, follow, strict=True))
        self._laplacian.set([cells.add(stiff)], [(-stiff[inner], -stiff[inner])])
        change = cells.whole(self._solve_pressure(-cells.sum(total), effort))
        drop = np.zeros(cells.faces)
        drop[inner] = change[cells.second] - change[cells.first[inner]]
        drop[self._outlet] = -change[cells.first[self._outlet]]
        total = self._close(total - stiff * drop)
        corrected = [-part * drop for part in follow]
        moved = [
            cells.whole(velocity[: cells.owned] + self._reconstruct(flux / cells.size))
            for velocity, flux in zip(guess, corrected, strict=True)
        ]
        found = replace(at, p=at.p + change, u_g=moved[-1], total=total)
        if len(phases) == 1:
            return found
        p_s, pushed = phases[0].pressure, np.zeros(cells.faces)
        pushed[inner] = -response[0][0][inner] * cells.reach[inner]
        pushed[inner] *= p_s[cells.second] - p_s[cells.first[inner]]
        return replace(
            found,
            u_s=moved[0],
            carried=carried[0] + corrected[0],
            gained=(carried[0] + corrected[0] - at.carried) / dt,
            pushed=pushed,
            response=response[0][0],
        )

    def _solve_pressure(self, rhs: Array, effort: dict[str, int]) -> Array:
        """Solve for the change of pressure with a multigrid that is kept for some steps."""
        if not self._has_outlet:
            rhs = rhs - self.cells.total(rhs) / self.cells.map.size_global
        keep = self._age < MULTIGRID_AGE
        zero = np.zeros(self.cells.owned)
        enough = self._little(SMALL_PRESSURE * self.gas.density * self.speed**2)
        self._pressure.renew(keep)
        try:
            found = self._pressure.solve(rhs, zero, enough)
        except SolverError:
            if not keep:
                raise
            keep = False
            self._pressure.renew(False)
            found = self._pressure.solve(rhs, zero, enough)
        effort["pressure"] = self._pressure.iterations
        self._age = self._age + 1 if keep else 1
        if self._pressure.iterations > MULTIGRID_EFFORT:
            self._age = MULTIGRID_AGE
        return found

    def _little(self, value: float) -> float:
        """Norm of a vector with `value` in every cell."""
        return value * self.cells.map.size_global**0.5

    def _close(self, total: Array) -> Array:
        """Take what the linear solver left of the divergence out through the outlet."""
        size = self.cells.size[self._outlet]
        area = self.cells.total(size)
        if area > 0:
            total[self._outlet] -= self.cells.total(self.cells.sum(total)) * size / area
        return total

    # -- what others read ----------------------------------------------------------------------

    def _balance(self, found: Moment, through: Array, dt: float) -> Masses:
        """Masses with what this step has carried over the boundary."""
        cells, edge = self.cells, slice(self.cells.inner, None)
        gas = found.total - through
        gained = {}
        for name, flux in (("solids", through[edge]), ("gas", gas[edge])):
            gained[f"{name}_in"] = getattr(self.masses, f"{name}_in") + dt * cells.total(
                np.maximum(-flux, 0.0)
            )
            gained[f"{name}_net"] = getattr(self.masses, f"{name}_net") - dt * cells.total(flux)
        return replace(self.masses, **gained)

    def _report(
        self, found: Moment, through: Array, dt: float, effort: dict[str, int], masses: Masses
    ) -> Report:
        cells, own = self.cells, slice(0, self.cells.owned)
        for name in ("alpha", "theta", "p", "u_s", "u_g"):
            if not np.isfinite(cells.largest(np.abs(getattr(found, name)[own]))):
                raise SolverError(f"{name} is not finite")
        return Report(
            effort,
            cells.largest(found.alpha[own]),
            cells.largest(found.theta[own]),
            dt * max(self._courant(found)),
            max(self._errors(found, masses).values()),
        )

    def courant(self) -> tuple[float, float]:
        """Largest Courant number of solids and gas for a step of one second [1/s]."""
        return self._courant(self.now)

    def _courant(self, at: Moment) -> tuple[float, float]:
        cells = self.cells
        share = np.maximum(1 - cells.mean(at.alpha), SMALLEST_FRACTION)
        gas = (at.total - cells.mean(at.alpha) * at.carried) / share
        rates = []
        for flux in (at.carried, gas):
            leaving = cells.sum_out(np.maximum(flux, 0.0), np.maximum(-flux, 0.0))
            rates.append(cells.largest(leaving / self._volume))
        return rates[0], rates[1]

    def _errors(self, at: Moment, masses: Masses) -> dict[str, float]:
        held = self.cells.total(at.alpha[: self.cells.owned] * self._volume)
        room = self.cells.total(self._volume)
        found = {}
        for name, now in (("solids", held), ("gas", room - held)):
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
        entry, size = cells.first[self._inlet], cells.size[self._inlet]
        area = max(cells.total(size), 1e-300)
        drop = cells.total(now.p[entry] * size) / area
        factor = self.mesh.geometry.area_factor
        leaving = cells.mean(now.alpha)[self._outlet] * now.carried[self._outlet]
        gas = cells.total(now.total[self._outlet] - leaving)
        found = {
            "pressure_gradient": drop / self.mesh.length,
            "pressure_drop": drop,
            "gas_mass_flow": factor * self.gas.density * gas,
        }
        if self.solids is None:
            return found
        return found | {
            "solids_mass_flow": factor * self.solids.density * cells.total(leaving),
            "holdup": cells.total(now.alpha[own] * self._volume) / cells.total(self._volume),
            "max_solids_fraction": cells.largest(now.alpha[own]),
        }

    def state(self) -> dict[str, Array]:
        """Everything that the next step needs, bit for bit.

        Arrays over owned cells, those on faces as (owned, facets of a cell), and numbers. The next
        step builds its multigrid anew, so that a run that goes on equals one that is restored.
        """
        self._renew_multigrid()
        cells, own = self.cells, slice(0, self.cells.owned)
        found = {name: getattr(self.now, name)[own].copy() for name in OF_CELLS}
        for name, directed in OF_FACES.items():
            found[name] = cells.to_sides(getattr(self.now, name), directed)
        found["time"], found["steps"] = np.array(self.time), np.array(self.steps)
        return found | {f"mass_{n}": np.array(v) for n, v in vars(self.masses).items()}

    def restore(self, state: Mapping[str, Array]) -> None:
        """Take over what `state` gave, also from another division into ranks (collective)."""
        cells = self.cells
        found = {name: cells.whole(np.asarray(state[name])) for name in OF_CELLS}
        for name, directed in OF_FACES.items():
            found[name] = cells.from_sides(np.asarray(state[name]), directed)
        self.now = Moment(**found)
        self.time, self.steps = float(state["time"]), int(state["steps"])
        names = (f.name for f in fields(Masses))
        self.masses = Masses(**{name: float(state[f"mass_{name}"]) for name in names})
        self._renew_multigrid()

    def _renew_multigrid(self) -> None:
        """Let the next step build its multigrid from nothing."""
        self._age = MULTIGRID_AGE
        self._pressure.forget()

    def fields(self) -> dict[str, fem.Function]:
        """Values of the cells for output, in functions that are made once."""
        arrays = {"u_g": self.now.u_g, "pressure": self.now.p}
        if self.solids is not None:
            arrays = {"alpha_s": self.now.alpha, "u_s": self.now.u_s, **arrays}
            arrays["theta"] = self.now.theta
        for name, values in arrays.items():
            if name not in self._functions:
                shape = (3,) if values.ndim == 2 else ()
                space = fem.functionspace(self.mesh.mesh, ("DG", 0, shape))
                self._functions[name] = fem.Function(space, name=name)
            self._functions[name].x.array[:] = values.ravel()
        return self._functions


@dataclass(frozen=True)
class _Phase:
    """One phase in a step; arrays over all cells unless said otherwise.

    fraction, before : alpha after and before the step
    flux : volume flux (faces) [m3/s]
    viscosity, bulk : of the whole phase [Pa s]
    traction : friction of the faces of the wall [kg/s]
    pressure : p_s [Pa], None for the gas
    """

    name: str
    density: float
    fraction: Array
    before: Array
    velocity: Array
    flux: Array
    viscosity: Array
    bulk: Array
    gradient: Array
    traction: Array
    pressure: Array | None

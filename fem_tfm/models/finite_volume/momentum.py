# SPDX-License-Identifier: LGPL-3.0-or-later
"""Momentum of a step: both phases with their drag, and the components that sides tie."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sparse

from fem_tfm.models.finite_volume.body_force import BodyForceBalance
from fem_tfm.models.finite_volume.cells.krylov import Krylov
from fem_tfm.models.finite_volume.cells.line import LineMesh
from fem_tfm.models.finite_volume.cells.matrix import CellMatrix
from fem_tfm.models.finite_volume.cells.mesh import Array, Cells
from fem_tfm.models.finite_volume.ideal_gas import GasBalance
from fem_tfm.models.finite_volume.state import (
    SECOND_ORDER_SOLVES,
    SMALLEST_FRACTION,
    TRANSPORT_TOLERANCE,
    Density,
    Inflow,
    Phase,
    SolidsDeformation,
    SolidsTransport,
    State,
    TurbulenceCoefficients,
)
from fem_tfm.models.finite_volume.time_levels import TimeLevels
from fem_tfm.models.pointwise import Invariants, Pointwise, tangential

# residual that ends the solver, over U in every cell
SMALL_VELOCITY = 1e-9
# product of two components of a side's normal that ties them
SMALLEST_TIE = 1e-9


@dataclass(frozen=True)
class _Equation:
    """Momentum of one phase in all owned cells.

    diagonal, across : of the matrix, as `CellMatrix.set` takes them
    wall_stiffness : normal force of walls and planes of symmetry over the velocity of the cells
        next to them, (edges, 3, 3) [kg/s]
    side, lagging : right-hand side, and its part that follows the velocity [N]
    """

    diagonal: Array
    across: tuple[Array, Array]
    wall_stiffness: Array
    side: Array
    lagging: Array


class _System:
    """Equations of components that sides tie to each other.

    components : of the velocities, which this matrix holds
    edges : cells at sides
    width : number of phases
    """

    def __init__(self, cells: Cells, edges: Array, components: list[int], width: int) -> None:
        self.components, self._edges = components, edges
        self._matrix = CellMatrix(cells, width, len(components), edges)
        self.krylov = Krylov(self._matrix, "transport", TRANSPORT_TOLERANCE)

    def set(self, equations: list[_Equation], coupling: Array) -> None:
        """The matrix, with the drag [kg/s] between the phases."""
        diagonal = []
        for i in self.components:
            blocks = [one.diagonal.copy() for one in equations]
            for block, one in zip(blocks, equations, strict=True):
                block[self._edges] += one.wall_stiffness[:, i, i]
            if len(blocks) == 2:
                blocks = [blocks[0] + coupling, -coupling, -coupling, blocks[1] + coupling]
            diagonal += blocks
        pairs = itertools.permutations(self.components, 2)
        ties = [one.wall_stiffness[:, i, j] for i, j in pairs for one in equations]
        self._matrix.set(diagonal, [one.across for one in equations], ties)
        self.krylov.update()

    def solve(self, side: Array, start: Array, enough: float) -> Array:
        """Its components (cells, components, phases) of those of `side` and `start`."""
        given, guess = (values[:, self.components] for values in (side, start))
        return self.krylov.solve(given.ravel(), guess.ravel(), enough).reshape(given.shape)


class Momentum:
    """Velocities that forces, stresses and drag give with the old pressure.

    Parameters
    ----------
    line, laws : mesh and coefficients
    gravity : vector [m/s2]
    lifted : density of the gas whose weight the pressure leaves out [kg/m3]
    """

    def __init__(self, line: LineMesh, laws: Pointwise, gravity: Array, lifted: float) -> None:
        self.line, self.laws, self._lifted = line, laws, lifted
        # rises along the normals, for the weight of a phase [m/s2]
        self._weight = line.normal @ gravity
        if laws.solids is not None:
            self._body_force = BodyForceBalance(line, gravity, laws.solids.density - lifted)
        self._area, self._non_orthogonal = (
            part[line.inner].T for part in (line.cells.area, line.cells.non_orthogonal)
        )
        # cells at sides of the line, the sum over their faces there, and n n of these
        normal, faces = (
            line.normal[line.impermeable],
            np.arange(line.impermeable.stop - line.impermeable.start),
        )
        self._edges, edge = np.unique(line.cells.first[line.impermeable], return_inverse=True)
        shape = self._edges.size, faces.size
        self._gather = sparse.csr_array((np.ones(faces.size), (edge, faces)), shape=shape)
        self._across = (normal[:, :, None] * normal[:, None, :]).reshape(-1, 9)
        self._along = np.eye(3).ravel() - self._across
        width = 1 if laws.solids is None else 2
        self._systems = [_System(line.cells, self._edges, tied, width) for tied in self._tied()]

    def _tied(self) -> list[list[int]]:
        """Components that sides tie to each other: none where all sides lie along the axes."""
        groups = [[0], [1], [2]]
        for i, j in itertools.combinations(range(3), 2):
            if self.line.cells.largest(np.abs(self._across[:, 3 * i + j])) > SMALLEST_TIE:
                both = [group for group in groups if i in group or j in group]
                groups = [group for group in groups if group not in both]
                groups.append(sorted({k for group in both for k in group}))
        return groups

    # -- the phases ----------------------------------------------------------------------------

    def phases(
        self,
        at: State,
        levels: TimeLevels,
        start: State,
        transported: SolidsTransport | None,
        deformation: SolidsDeformation,
        coefficients: TurbulenceCoefficients | None = None,
        gas_balance: GasBalance | None = None,
    ) -> list[Phase]:
        """Phases that step from `start`, the gas last, with coefficients of `at`.

        coefficients : what turbulence does, None where an algebraic law of the gas is all
        gas_balance : the gas, None where its density is constant
        """
        if transported is None:
            alone = np.ones(self.line.cells.face_count)
            return [self._gas(at, levels, start, transported, alone, coefficients, gas_balance)]
        solids = self._solids(at, levels, start, transported, deformation, coefficients)
        gas = self._gas(
            at, levels, start, transported, 1 - solids.face_fraction, coefficients, gas_balance
        )
        if coefficients is None or coefficients.dispersion is None:
            return [solids, gas]
        force = self._dispersion_force(at, coefficients)
        return [replace(solids, dispersion_force=-force), replace(gas, dispersion_force=force)]

    def _dispersion_force(self, at: State, coefficients: TurbulenceCoefficients) -> Array:
        """Force on the gas by which eddies spread the solids, along the normals of faces [N/m3]."""
        cells, inner, alpha = self.line.cells, self.line.inner, at.alpha
        force = np.zeros(cells.face_count)
        rise = alpha[cells.second] - alpha[cells.first[inner]]
        force[inner] = (
            cells.to_faces(coefficients.dispersion)[inner]
            * rise
            * self.line.inverse_distance[inner]
        )
        return force

    def _solids(
        self,
        at: State,
        levels: TimeLevels,
        start: State,
        transported: SolidsTransport,
        deformation: SolidsDeformation,
        coefficients: TurbulenceCoefficients | None,
    ) -> Phase:
        laws, line = self.laws, self.line
        alpha = np.maximum(at.alpha, 0.0)
        grains = laws.coefficients(alpha, at.theta, *deformation.rates)
        mu = grains.viscosity
        if coefficients is not None:
            mu = mu + alpha * laws.solids.density * coefficients.nu_s
        edge, wall = line.cells.first[line.wall], line.wall
        if laws.closures.solids_wall.strong:
            wall_friction = mu[edge] * line.cells.face_weight[wall]
        else:
            slip = tangential(at.u_s[edge], line.normal[wall])
            state = laws.wall_state(alpha, at.theta, grains, slip, edge)
            wall_friction = laws.solids_wall_friction(state) * line.cells.face_area[wall]
        support = self._body_force.support(at.alpha, transported.pressure)
        # what a void lacks of the smallest fraction moves with the gas
        absent = np.clip(1 - start.alpha / SMALLEST_FRACTION, 0.0, 1.0)[:, None]
        mass = laws.solids.density * np.maximum(start.alpha, SMALLEST_FRACTION)
        return Phase(
            name="solids",
            density=Density.constant(laws.solids.density),
            fraction=at.alpha,
            fraction_start=start.alpha,
            velocity_start=start.u_s + absent * (start.u_g - start.u_s),
            velocity_now=levels.now.u_s,
            flux=transported.flux,
            viscosity=mu,
            bulk_viscosity=grains.kinetic.bulk_viscosity,
            gradient=deformation.gradient,
            wall_friction=wall_friction,
            pressure=transported.pressure,
            face_fraction=support.fraction,
            support=support,
            implicit_correction=self._implicit_correction(
                grains.kinetic.bulk_viscosity, mass, levels
            ),
        )

    def _gas(
        self,
        at: State,
        levels: TimeLevels,
        start: State,
        transported: SolidsTransport | None,
        share: Array,
        coefficients: TurbulenceCoefficients | None,
        gas_balance: GasBalance | None,
    ) -> Phase:
        laws, line, cells = self.laws, self.line, self.line.cells
        edge, wall = cells.first[line.wall], line.wall
        density = Density.constant(laws.gas.density)
        if gas_balance is not None:
            density, laws = gas_balance.density, laws.with_density(gas_balance.relative_density)
        void = 1 - at.alpha
        if coefficients is None:
            gradient = cells.ghosted(cells.gradient(levels.now.u_g))
            mu = self._gas_viscosity(laws, gradient)
            if levels.previous is not None:
                before = cells.ghosted(cells.gradient(levels.previous.u_g))
                mu = levels.extrapolate(mu, self._gas_viscosity(laws, before))
        else:
            gradient = coefficients.gradient
            mu = (laws.gas.viscosity + coefficients.mu_t) / line.gas_profile[1]
        mu = void * mu
        flux = at.total_flux - (0.0 if transported is None else transported.flux)
        flux[line.inlet] = 0.0
        if laws.closures.gas_wall.strong:
            wall_friction = mu[edge] * cells.face_weight[wall]
        else:
            speed = laws.speed(tangential(at.u_g[edge], line.normal[wall]))
            k = at.scales["k"][edge] if "k" in at.scales else None
            friction = laws.at(edge).gas_wall_friction(speed, line.wall_height, k)
            wall_friction = void[edge] * friction * cells.face_area[wall]
        implicit_correction = None
        if not laws.closures.turbulence.transported and (mu > laws.gas.viscosity).any():
            eddy = np.maximum(mu - void * laws.gas.viscosity, 0.0)
            implicit_correction = self._implicit_correction(eddy, void * laws.gas.density, levels)
        eddies = None
        if coefficients is not None and coefficients.normal_stress is not None:
            eddies = void * laws.gas.density * coefficients.normal_stress["k"]
        return Phase(
            name="gas",
            density=density,
            fraction=void,
            fraction_start=1 - start.alpha,
            velocity_start=start.u_g,
            velocity_now=levels.now.u_g,
            flux=flux,
            viscosity=mu,
            bulk_viscosity=np.zeros_like(mu),
            gradient=gradient,
            wall_friction=wall_friction,
            pressure=eddies,
            face_fraction=share,
            support=None,
            implicit_correction=implicit_correction,
        )

    def _gas_viscosity(self, laws: Pointwise, gradient: Array) -> Array:
        """Viscosity of an algebraic law at grad u_g [Pa s]."""
        height, slope = self.line.gas_profile
        return laws.gas_viscosity(laws.eddies(Invariants(gradient), height, slope), slope)

    def _implicit_correction(self, viscosity: Array, mass: Array, levels: TimeLevels) -> Array:
        """What the matrix holds of a stress beyond mu S that lags a step behind, of faces [kg/s].

        mu_t of a mixing length grows with the shear S: with that of the state before the step
        S_new S_old stays what the stress makes it. A bulk viscosity above mu throws the few grains
        beside a bed from side to side. Where inertia does not hold S both swing for ever. As much
        in the matrix, less what that adds at the velocities before, ends it.

        viscosity, mass : of the lagging stress [Pa s], of the phase [kg/m3]
        """
        cells, inner = self.line.cells, self.line.inner
        lagging = cells.to_faces(viscosity) * cells.face_weight
        lagging[cells.inner_count :] = 0.0
        held = mass * cells.volume
        inertia = np.zeros(cells.face_count)
        inertia[inner] = np.minimum(held[cells.first[inner]], held[cells.second])
        return lagging**2 / np.maximum(lagging + inertia / levels.span_faces, 1e-300)

    # -- forces --------------------------------------------------------------------------------

    def supported_weight(self, alpha: Array, p_s: Array) -> Array:
        """Weight of the solids along normals, no more than p_s bears [N/m3] (collective)."""
        line, cells, inner = self.line, self.line.cells, self.line.inner
        share = self._body_force.support(alpha, p_s).fraction
        weight = share * (self.laws.solids.density - self._lifted) * self._weight
        rise = np.zeros(cells.face_count)
        rise[inner] = (p_s[cells.second] - p_s[cells.first[inner]]) * line.inverse_distance[inner]
        return np.clip(weight, np.minimum(rise, 0.0), np.maximum(rise, 0.0))

    def forces(
        self, at: State, phases: list[Phase], beta: Array, levels: TimeLevels, inflow: Inflow
    ) -> tuple[list[Array], list[Array]]:
        """Accelerations by pressures and weight: vectors in cells, and what faces have beyond them.

        The second is the force [N/m3] along the normals of the faces that interpolated cells lack.
        Cells of the gas take the mean of what the forces of their faces make of its velocity
        against inertia and drag, as the projection does: beside a bed, where hardly any drag holds
        it, gas would else take off with half of the pressure that drives it through the bed.
        """
        line, cells, inner = self.line, self.line.cells, self.line.inner
        slope = np.zeros(cells.face_count)
        first, second = cells.first[inner], cells.second
        slope[inner] = (at.p[second] - at.p[first]) * line.inverse_distance[inner]
        slope[line.outlet] = -at.p[cells.first[line.outlet]] * line.inverse_distance[line.outlet]
        gaps, accelerated = [], []
        for phase in phases:
            # a void has no weight
            force = -phase.face_fraction * slope
            force += phase.face_fraction * (phase.density.faces - self._lifted) * self._weight
            if phase.pressure is not None:
                p_s = phase.pressure
                force[inner] -= (p_s[second] - p_s[first]) * line.inverse_distance[inner]
            if phase.dispersion_force is not None:
                force += phase.dispersion_force
            force *= line.open
            if phase.name == "solids" and inflow.blocked:
                force[line.outlet] = 0.0
            mass = phase.density.faces * np.maximum(phase.face_fraction, SMALLEST_FRACTION)
            if phase.support is None:
                hold = mass / levels.span_faces + cells.to_faces(beta)
                vector = cells.ghosted(line.reconstruct(force / hold))
                average = hold * (cells.flux(vector) / cells.face_area)
                held = phase.density.cells * np.maximum(phase.fraction[line.own], SMALLEST_FRACTION)
                vector = vector[line.own] * (1 / levels.span + beta[line.own] / held)[:, None]
            else:
                vector = cells.ghosted(line.reconstruct(force / mass, phase.support.partial_faces))
                held = np.maximum(phase.fraction, SMALLEST_FRACTION)
                average = self._body_force.mean_force(phase.support, held, vector)
                average *= phase.density.faces
            gaps.append(force - average * line.open)
            accelerated.append(vector)
        return gaps, accelerated

    def _stress(self, phase: Phase, velocity: Array, gradient: Array) -> Array:
        """What the implicit difference leaves of the viscous force on the owned cells [N]."""
        cells, inner, sides = self.line.cells, self.line.inner, self.line.impermeable
        # one array for each component, which is several times as fast as one of tensors
        rate = [cells.to_faces(part)[inner] for part in gradient.reshape(-1, 9).T]
        mu = cells.to_faces(phase.viscosity)[inner]
        bulk = cells.to_faces(phase.bulk_viscosity)[inner] - 2 / 3 * mu
        trace = bulk * (rate[0] + rate[4] + rate[8])
        force = np.zeros((cells.face_count, 3))
        for i in range(3):
            turned = sum(
                rate[3 * j + i] * self._area[j] + rate[3 * i + j] * self._non_orthogonal[j]
                for j in range(3)
            )
            force[inner, i] = mu * turned + trace * self._area[i]
        if phase.implicit_correction is not None:
            rise = velocity.take(cells.first[inner], axis=0) - velocity.take(cells.second, axis=0)
            force[inner] += phase.implicit_correction[inner, None] * rise
        # what spreads along a side; the rest of its normal stress is in the matrix
        edge = cells.first[sides]
        along = np.einsum("nk,nk->n", self._along, gradient.reshape(-1, 9)[edge])
        along *= phase.bulk_viscosity[edge] - 2 / 3 * phase.viscosity[edge]
        force[sides] = along[:, None] * cells.area[sides]
        return cells.net_flux(force)

    def _wall_stiffness(self, phase: Phase) -> Array:
        """Force over the velocity by which sides hold the cells next to them, (edges, 3, 3) [kg/s].

        Nothing passes a side, so that the normal velocity falls to zero within its cells: there the
        normal stress is (4/3 mu + bulk) du_n/dn beside that of what spreads along the side.
        """
        line, cells = self.line, self.line.cells
        edge = cells.first[line.impermeable]
        pull = (phase.bulk_viscosity[edge] + 4 / 3 * phase.viscosity[edge]) * cells.face_weight[
            line.impermeable
        ]
        # the law of a wall slows all components
        pull[: line.wall.stop - line.wall.start] -= phase.wall_friction
        found = self._gather @ (np.maximum(pull, 0.0)[:, None] * self._across)
        return found.reshape(-1, 3, 3)

    # -- the linear system ---------------------------------------------------------------------

    def solve(
        self,
        phases: list[Phase],
        beta: Array,
        accelerated: list[Array],
        levels: TimeLevels,
        inflow: Inflow,
        effort: dict[str, int],
        dragged: Array | None = None,
    ) -> list[Array]:
        """Velocities of the phases before the projection, in all cells (collective).

        dragged : force (cells, 3) on the gas that beta times the slip has beyond the drag [N/m3]

        Raises
        ------
        SolverError
            the linear solver does not converge.
        """
        line, cells, own, many = self.line, self.line.cells, self.line.own, len(phases)
        coupling = beta[own] * line.volume
        equations = [
            self._equation(phase, acceleration, levels, inflow)
            for phase, acceleration in zip(phases, accelerated, strict=True)
        ]
        for system in self._systems:
            system.set(equations, coupling)
        start = np.stack([phase.velocity_start[own] for phase in phases], axis=2)
        # the components share one measure: what is small across the pipe need not be sharper
        largest = max(cells.total(start[:, i] ** 2) for i in range(3)) ** 0.5
        enough = TRANSPORT_TOLERANCE * largest + line.small_norm(
            SMALL_VELOCITY * line.velocity_scale
        )
        given, velocities = np.stack([one.side for one in equations], axis=2), []
        if dragged is not None:
            force = dragged[own] * line.volume[:, None]
            given += np.stack([-force, force], axis=2)
        effort["momentum"] = 0
        for _ in range(SECOND_ORDER_SOLVES if line.order else 1):
            side = given.copy()
            for k, u in enumerate(velocities):
                gradient = cells.ghosted(cells.gradient(u))
                later = self._lagging(phases[k], u, gradient, levels)
                side[:, :, k] += later - equations[k].lagging
            found = np.empty_like(start)
            for system in self._systems:
                found[:, system.components] = system.solve(side, start, enough)
                effort["momentum"] += system.krylov.iterations
            start = found
            velocities = [cells.ghosted(found[:, :, k]) for k in range(many)]
        return velocities

    def _equation(
        self, phase: Phase, acceleration: Array, levels: TimeLevels, inflow: Inflow
    ) -> _Equation:
        """Momentum of one phase without drag."""
        line, cells, own, inner = self.line, self.line.cells, self.line.own, self.line.inner
        density = phase.density
        inertia = density.start * np.maximum(phase.fraction_start[own], SMALLEST_FRACTION)
        inertia = inertia * line.volume / levels.span
        flux = density.upwind * phase.flux
        ahead, back = np.maximum(flux, 0.0), np.maximum(-flux, 0.0)
        spread = cells.to_faces(phase.viscosity) * cells.face_weight
        spread[cells.inner_count :] = 0.0
        if phase.implicit_correction is not None:
            spread += phase.implicit_correction
        diagonal = inertia + cells.sum_by_side(back, ahead) + cells.sum_faces(spread)
        side = inertia[:, None] * phase.velocity_start[own]
        mass = density.cells * np.maximum(phase.fraction[own], SMALLEST_FRACTION)
        lagging = self._lagging(phase, phase.velocity_now, phase.gradient, levels)
        side += (mass * line.volume)[:, None] * acceleration[own] + lagging
        side += inflow.sources.force(phase.name) * line.volume[:, None]
        if line.has_wall:
            cells.add_boundary("wall", diagonal, phase.wall_friction)
        if line.has_inlet:
            mean = inflow.mean_velocity(phase.name)
            entering = density.inflow * inflow.fraction(phase.name) * -line.inlet_flux(mean)
            speed = mean * density.inlet_expansion(line.inlet) * line.inlet_profile
            velocity = -speed[:, None] * line.normal[line.inlet]
            # what a passing flux without inlet has left out
            missing = entering - back[line.inlet]
            cells.add_boundary("inlet", diagonal, missing)
            cells.add_boundary("inlet", side, entering[:, None] * velocity)
        across = -(back + spread)[inner], -(ahead + spread)[inner]
        return _Equation(diagonal, across, self._wall_stiffness(phase), side, lagging)

    def _lagging(self, phase: Phase, velocity: Array, gradient: Array, levels: TimeLevels) -> Array:
        """Force on the owned cells that the matrix does not hold, of a known velocity [N]."""
        line, found = self.line, self._stress(phase, velocity, gradient)
        if not line.order:
            return found
        flux = levels.second_order_faces * phase.density.upwind * phase.flux
        return found - line.cells.net_flux(
            line.second_order_flux(flux, velocity, line.velocity_scale, gradient)
        )

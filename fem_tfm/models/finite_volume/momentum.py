# SPDX-License-Identifier: LGPL-3.0-or-later
"""Momentum equations: both phases with their drag in one matrix, at the present pressure.

    m_i (u_i - u_i_start)/dt + div(m_i u_i u_i) = div(tau_i) - alpha_i grad p - grad p_i
        + alpha_i (rho_i - rho_0) g +- beta (u_g - u_s) +- dispersion,   m_i = alpha_i rho_i

rho_0 is the density whose weight p leaves out. Diffusion mu grad u is implicit; the rest of the
stress follows the present velocity and, at second order, that of a first solve. Walls and planes
of symmetry couple the components of the cells next to them, where they do not lie along the axes.

Pressure, weight and dispersion act on faces. Cells take their accelerations from their faces, and
the pressure equation gets the forces of the faces in excess of the interpolated ones: the pressure
does not oscillate, and fluids at rest stay at rest.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sparse

from fem_tfm.models.finite_volume.body_force import BodyForceBalance
from fem_tfm.models.finite_volume.cells.krylov import Krylov
from fem_tfm.models.finite_volume.cells.line import LineMesh
from fem_tfm.models.finite_volume.cells.matrix import CellMatrix
from fem_tfm.models.finite_volume.cells.mesh import SMALLEST, Array, Cells, Index
from fem_tfm.models.finite_volume.scheme import FirstOrder
from fem_tfm.models.finite_volume.state import (
    SMALLEST_FRACTION,
    TRANSPORT_TOLERANCE,
    Density,
    Phase,
)
from fem_tfm.models.finite_volume.time_levels import Step, TimeLevels
from fem_tfm.models.pointwise import Invariants, Pointwise, SolidsCoefficients, tangential
from fem_tfm.models.solids_wall import HalfCell, at_wall

# residual that ends the linear solver, over U in every cell
SMALL_VELOCITY = 1e-9
# product of two components of a normal that couples them
SMALLEST_COUPLING = 1e-9


@dataclass(frozen=True)
class _Equation:
    """Momentum equation of one phase without drag, in the owned cells.

    diagonal, across : of the matrix, as `CellMatrix.set` takes them [kg/s]
    wall_stiffness : normal force of walls and planes of symmetry over the velocity of the cells
        next to them, (edges, 3, 3) [kg/s]
    rhs : right-hand side [N]
    explicit : its part that follows the velocity [N]
    """

    diagonal: Array
    across: tuple[Array, Array]
    wall_stiffness: Array
    rhs: Array
    explicit: Array


class _System:
    """Linear system of components that walls and planes of symmetry couple.

    components : of the velocities
    edges : cells next to walls and planes of symmetry
    width : number of phases
    """

    def __init__(self, cells: Cells, edges: Index, components: list[int], width: int) -> None:
        self.components, self._edges = components, edges
        self._matrix = CellMatrix(cells, width, len(components), edges)
        self._krylov = Krylov(self._matrix, "transport", TRANSPORT_TOLERANCE)

    def set(self, equations: list[_Equation], drag: Array) -> None:
        """The matrix, with the drag coefficient [kg/s] between the phases."""
        diagonal = []
        for i in self.components:
            blocks = [one.diagonal.copy() for one in equations]
            for block, one in zip(blocks, equations, strict=True):
                block[self._edges] += one.wall_stiffness[:, i, i]
            if len(blocks) == 2:
                blocks = [blocks[0] + drag, -drag, -drag, blocks[1] + drag]
            diagonal += blocks
        pairs = itertools.permutations(self.components, 2)
        couplings = [one.wall_stiffness[:, i, j] for i, j in pairs for one in equations]
        self._matrix.set(diagonal, [one.across for one in equations], couplings)
        self._krylov.update()

    def solve(self, rhs: Array, guess: Array, enough: float) -> tuple[Array, int]:
        """Its components (cells, components, phases) of all, and the iterations."""
        rhs, guess = (values[:, self.components] for values in (rhs, guess))
        found = self._krylov.solve(rhs.ravel(), guess.ravel(), enough).reshape(rhs.shape)
        return found, self._krylov.iterations


class Momentum:
    """The equations of both phases with their matrices.

    Parameters
    ----------
    line, laws, scheme : mesh, coefficients, order
    gravity : acceleration (3,) [m/s2]
    hydrostatic_density : density whose weight the pressure leaves out [kg/m3]
    """

    def __init__(
        self,
        line: LineMesh,
        laws: Pointwise,
        scheme: FirstOrder,
        gravity: Array,
        hydrostatic_density: float,
    ) -> None:
        self.line, self.laws, self.scheme = line, laws, scheme
        self._hydrostatic_density = hydrostatic_density
        # along the normals [m/s2]
        self._gravity = line.normal @ gravity
        if laws.solids is not None:
            excess = laws.solids.density - hydrostatic_density
            self._body_force = BodyForceBalance(line, gravity, excess)
        self._area = line.cells.area[line.inner].T
        self._non_orthogonal = line.cells.non_orthogonal[line.inner].T
        # cells next to walls and planes of symmetry, the sum over their faces there, n n of these
        normal = line.normal[line.impermeable]
        self._edges, edge = np.unique(line.cells.first[line.impermeable], return_inverse=True)
        entries = np.ones(edge.size), (edge, np.arange(edge.size))
        self._gather = sparse.csr_array(entries, shape=(self._edges.size, edge.size))
        self._normal_part = (normal[:, :, None] * normal[:, None, :]).reshape(-1, 9)
        self._tangential_part = np.eye(3).ravel() - self._normal_part
        width = 1 if laws.solids is None else 2
        self._systems = [
            _System(line.cells, self._edges, group, width) for group in self._coupled_components()
        ]

    def _coupled_components(self) -> list[list[int]]:
        """Groups of components that the normals of walls and planes of symmetry couple."""
        groups = [[0], [1], [2]]
        for i, j in itertools.combinations(range(3), 2):
            largest = self.line.cells.largest(np.abs(self._normal_part[:, 3 * i + j]))
            if largest > SMALLEST_COUPLING:
                both = [group for group in groups if i in group or j in group]
                groups = [group for group in groups if group not in both]
                groups.append(sorted({k for group in both for k in group}))
        return groups

    # -- the phases ----------------------------------------------------------------------------

    def phases(self, step: Step) -> list[Phase]:
        """Coefficients of the phases, the gas last (collective)."""
        if step.solids is None:
            return [self._gas(step, np.ones(self.line.cells.face_count))]
        solids = self._solids(step)
        gas = self._gas(step, 1 - solids.face_fraction)
        if step.turbulence is None or step.turbulence.dispersion is None:
            return [solids, gas]
        force = self._dispersion_force(
            step.state.alpha, step.turbulence.dispersion, solids.face_fraction
        )
        return [replace(solids, dispersion_force=-force), replace(gas, dispersion_force=force)]

    def _dispersion_force(self, alpha: Array, coefficient: Array, carried: Array) -> Array:
        """Force on the gas by which eddies disperse solids, along the normals of faces [N/m3].

        It acts on the solids that a face carries: on the surface of a bed these are few.

        carried (faces) : their fraction [-]
        """
        cells, inner = self.line.cells, self.line.inner
        force = np.zeros(cells.face_count)
        rise = alpha[cells.second] - alpha[cells.first[inner]]
        coefficient = cells.to_faces(coefficient)[inner]
        force[inner] = coefficient * rise * self.line.inverse_distance[inner]
        return force * np.minimum(carried / np.maximum(cells.to_faces(alpha), SMALLEST), 1.0)

    def _solids(self, step: Step) -> Phase:
        """Coefficients of the solids."""
        laws, state, levels, solids = self.laws, step.state, step.levels, step.solids
        start = levels.start
        alpha = np.maximum(state.alpha, 0.0)
        shear, dilation = step.deformation.rates
        found = laws.coefficients(alpha, state.theta, shear, dilation, step.beta)
        viscosity, bulk = found.viscosity, found.kinetic.bulk_viscosity
        if step.turbulence is not None:
            viscosity = viscosity + alpha * laws.solids.density * step.turbulence.nu_s
        bulk_on_faces = self.line.cells.in_series(bulk)
        support = self._body_force.support(state.alpha, solids.pressure)
        # the part of the smallest fraction that a void lacks moves with the gas
        absent = np.clip(1 - start.alpha / SMALLEST_FRACTION, 0.0, 1.0)[:, None]
        mass = laws.solids.density * np.maximum(start.alpha, SMALLEST_FRACTION)
        return Phase(
            name="solids",
            density=Density.constant(laws.solids.density),
            fraction=state.alpha,
            fraction_start=start.alpha,
            velocity_start=start.u_s + absent * (start.u_g - start.u_s),
            velocity_now=levels.now.u_s,
            flux=solids.flux,
            viscosity=viscosity,
            bulk_viscosity=bulk,
            face_viscosity=self.line.cells.in_series(viscosity),
            face_bulk_viscosity=bulk_on_faces,
            gradient=step.deformation.gradient,
            wall_friction=self._wall_friction_of_solids(step, found, viscosity),
            pressure=solids.pressure,
            face_fraction=support.fraction,
            support=support,
            implicit_correction=self._implicit_correction(bulk_on_faces, mass, levels),
            thermal_rise=solids.thermal_rise,
        )

    def _wall_friction_of_solids(
        self, step: Step, coefficients: SolidsCoefficients, viscosity: Array
    ) -> Array:
        """Tangential force over the velocity of the cells on the wall's faces [kg/s]."""
        laws, line, state = self.laws, self.line, step.state
        edge, wall = line.cells.first[line.wall], line.wall
        if laws.closures.solids_wall.strong:
            return viscosity[edge] * line.cells.face_weight[wall]
        alpha, slip = np.maximum(state.alpha, 0.0), tangential(state.u_s[edge], line.normal[wall])
        centre = laws.wall_state(alpha, state.theta, coefficients, slip, edge)
        near = line.inverse_distance[wall]
        conductance = None
        if laws.closures.theta != "algebraic":
            conductance = coefficients.kinetic.conductivity[edge] * near
        square, dilation = step.deformation.at(edge)
        half = HalfCell.beside(laws, centre, square, dilation, step.solids.wall_rise)
        friction, _ = at_wall(laws, half, viscosity[edge] * near, conductance)
        if step.gas is not None:
            laws = laws.with_density(step.gas.relative_density)
        return (friction + self._eddies_at_wall(step, laws)[1]) * line.cells.face_area[wall]

    def _gas(self, step: Step, face_fraction: Array) -> Phase:
        """Coefficients of the gas."""
        laws, line, state, levels = self.laws, self.line, step.state, step.levels
        density = Density.constant(laws.gas.density)
        if step.gas is not None:
            density, laws = step.gas.density, laws.with_density(step.gas.relative_density)
        void = 1 - state.alpha
        viscosity, gradient = self._gas_viscosity(step, laws)
        viscosity = void * viscosity
        flux = state.total_flux - (0.0 if step.solids is None else step.solids.flux)
        flux[line.inlet] = 0.0
        correction = None
        if not laws.closures.turbulence.transported and (viscosity > laws.gas.viscosity).any():
            eddy = np.maximum(viscosity - void * laws.gas.viscosity, 0.0)
            eddy = line.cells.to_faces(eddy)
            correction = self._implicit_correction(eddy, void * laws.gas.density, levels)
        pressure = None
        if step.turbulence is not None and step.turbulence.normal_stress is not None:
            pressure = void * laws.gas.density * step.turbulence.normal_stress["k"]
        return Phase(
            name="gas",
            density=density,
            fraction=void,
            fraction_start=1 - levels.start.alpha,
            velocity_start=levels.start.u_g,
            velocity_now=levels.now.u_g,
            flux=flux,
            viscosity=viscosity,
            bulk_viscosity=np.zeros_like(viscosity),
            face_viscosity=line.cells.to_faces(viscosity),
            face_bulk_viscosity=np.zeros(line.cells.face_count),
            gradient=gradient,
            wall_friction=self._wall_friction_of_gas(step, laws, viscosity),
            pressure=pressure,
            face_fraction=face_fraction,
            support=None,
            implicit_correction=correction,
        )

    def _gas_viscosity(self, step: Step, laws: Pointwise) -> tuple[Array, Array]:
        """Viscosity of the gas, eddies included, over its fraction [Pa s], and grad u_g [1/s]."""
        line, cells, levels = self.line, self.line.cells, step.levels
        if step.turbulence is not None:
            viscosity = (laws.gas.viscosity + step.turbulence.mu_t) / line.gas_profile[1]
            return viscosity, step.turbulence.gradient
        gradient = cells.ghosted(cells.gradient(levels.now.u_g))
        viscosity = self._algebraic_viscosity(laws, gradient)
        if levels.previous is not None:
            before = cells.ghosted(cells.gradient(levels.previous.u_g))
            before = self._algebraic_viscosity(laws, before)
            viscosity = levels.extrapolate(viscosity, before)
        return viscosity, gradient

    def _algebraic_viscosity(self, laws: Pointwise, gradient: Array) -> Array:
        """Viscosity of an algebraic law at grad u_g [Pa s]."""
        height, slope = self.line.gas_profile
        return laws.gas_viscosity(laws.eddies(Invariants(gradient), height, slope), slope)

    def _wall_friction_of_gas(self, step: Step, laws: Pointwise, viscosity: Array) -> Array:
        """Tangential force over velocity on the wall's faces [kg/s]."""
        line, cells, state = self.line, self.line.cells, step.state
        edge, wall = cells.first[line.wall], line.wall
        if laws.closures.gas_wall.strong:
            return viscosity[edge] * cells.face_weight[wall]
        friction, _ = self._eddies_at_wall(step, laws)
        return (1 - state.alpha[edge]) * friction * cells.face_area[wall]

    def _eddies_at_wall(self, step: Step, laws: Pointwise) -> tuple[Array, Array | float]:
        """c [Pa s/m] of the wall on pure gas, and of its eddies on the solids."""
        line, state = self.line, step.state
        edge = line.cells.first[line.wall]
        speed = laws.speed(tangential(state.u_g[edge], line.normal[line.wall]))
        k = state.scales["k"][edge] if "k" in state.scales else None
        beside = None
        if laws.solids is not None:
            alpha = np.maximum(state.alpha[edge], SMALLEST_FRACTION)
            beside = alpha, laws.speed(state.u_g[edge] - state.u_s[edge])
        return laws.at(edge).wall_friction(speed, line.wall_height, k, beside)

    def _implicit_correction(self, viscosity: Array, mass: Array, levels: TimeLevels) -> Array:
        """Stiffness on faces of an explicit stress, by which the matrix stabilises it [kg/s].

        The eddy viscosity of a mixing length grows with the shear; taken from the present state it
        makes the shear alternate from step to step where inertia does not hold it. So does a bulk
        viscosity above the viscosity with the few grains beside a bed. Diffusion by this stiffness
        is added to the matrix, and subtracted explicitly with the present velocity.

        viscosity (faces) : of that stress [Pa s]
        mass : of the phase over the volume [kg/m3]
        """
        cells, inner = self.line.cells, self.line.inner
        stiffness = viscosity * cells.face_weight
        stiffness[cells.inner_count :] = 0.0
        mass = mass * cells.volume
        inertia = np.zeros(cells.face_count)
        inertia[inner] = np.minimum(mass[cells.first[inner]], mass[cells.second])
        return stiffness**2 / np.maximum(stiffness + inertia / levels.span_faces, 1e-300)

    # -- forces --------------------------------------------------------------------------------

    def supported_weight(self, alpha: Array, p_s: Array, unforced: Array | None) -> Array:
        """Weight of the solids along normals, at most what p_s carries [N/m3] (collective).

        unforced (faces) : rise of p_s that exerts no force [Pa], None without
        """
        line, cells, inner = self.line, self.line.cells, self.line.inner
        fraction = self._body_force.support(alpha, p_s).fraction
        weight = fraction * (self.laws.solids.density - self._hydrostatic_density) * self._gravity
        slope = np.zeros(cells.face_count)
        rise = p_s[cells.second] - p_s[cells.first[inner]]
        if unforced is not None:
            rise -= unforced[inner]
        slope[inner] = rise * line.inverse_distance[inner]
        return np.clip(weight, np.minimum(slope, 0.0), np.maximum(slope, 0.0))

    def forces(self, step: Step, phases: list[Phase]) -> tuple[list[Array], list[Array]]:
        """Face forces in excess of the cells', and accelerations of the cells, of the phases.

        The first are forces along the normals of all faces less those interpolated from the cells
        [N/m3], the second vectors (cells, 3) [m/s2].
        """
        slope, face_forces, accelerations = self._pressure_slope(step.state.p), [], []
        for phase in phases:
            force = self._face_force(step, phase, slope)
            of_cells = self._solids_force if phase.support is not None else self._gas_force
            interpolated, acceleration = of_cells(step, phase, force)
            face_forces.append(force - interpolated * self.line.open)
            accelerations.append(acceleration)
        return face_forces, accelerations

    def _pressure_slope(self, p: Array) -> Array:
        """dp/dn on all faces [Pa/m]; p is zero at the outlet."""
        line, cells, inner = self.line, self.line.cells, self.line.inner
        slope, outlet = np.zeros(cells.face_count), line.outlet
        slope[inner] = (p[cells.second] - p[cells.first[inner]]) * line.inverse_distance[inner]
        slope[outlet] = -p[cells.first[outlet]] * line.inverse_distance[outlet]
        return slope

    def _face_force(self, step: Step, phase: Phase, slope: Array) -> Array:
        """Pressures, weight and dispersion along the normals of faces [N/m3]."""
        line, cells, inner = self.line, self.line.cells, self.line.inner
        # a void has no weight
        force = -phase.face_fraction * slope
        excess = phase.density.faces - self._hydrostatic_density
        force += phase.face_fraction * excess * self._gravity
        if phase.pressure is not None:
            p_i = phase.pressure
            rise = p_i[cells.second] - p_i[cells.first[inner]]
            if phase.thermal_rise is not None:
                rise -= phase.thermal_rise[inner]
            force[inner] -= rise * line.inverse_distance[inner]
        if phase.dispersion_force is not None:
            force += phase.dispersion_force
        force *= line.open
        if phase.name == "solids" and step.inflow.blocked:
            force[line.outlet] = 0.0
        return force

    def _gas_force(self, step: Step, phase: Phase, force: Array) -> tuple[Array, Array]:
        """Force interpolated from the cells to faces, and acceleration of the owned cells.

        The cells average the velocities that the face forces cause against inertia and drag, as the
        pressure equation does. An average of forces would accelerate gas beside a bed, which has
        hardly any drag, by half of the pressure force that drives gas through the bed.
        """
        line, cells, own, beta = self.line, self.line.cells, self.line.own, step.drag
        mass = phase.density.faces * np.maximum(phase.face_fraction, SMALLEST_FRACTION)
        resistance = mass / step.levels.span_faces + cells.to_faces(beta)
        velocity = cells.ghosted(line.reconstruct(force / resistance))
        interpolated = resistance * (cells.flux(velocity) / cells.face_area)
        mass = phase.density.cells * np.maximum(phase.fraction[own], SMALLEST_FRACTION)
        rate = 1 / step.levels.span + beta[own] / mass
        return interpolated, velocity[own] * rate[:, None]

    def _solids_force(self, step: Step, phase: Phase, force: Array) -> tuple[Array, Array]:
        """Force interpolated from the cells to faces, and acceleration of all cells."""
        line, cells = self.line, self.line.cells
        mass = phase.density.faces * np.maximum(phase.face_fraction, SMALLEST_FRACTION)
        assert phase.support is not None
        partial = phase.support.partial_faces
        acceleration = cells.ghosted(line.reconstruct(force / mass, partial))
        fraction = np.maximum(phase.fraction, SMALLEST_FRACTION)
        interpolated = self._body_force.mean_force(phase.support, fraction, acceleration)
        return interpolated * phase.density.faces, acceleration

    # -- the linear system ---------------------------------------------------------------------

    def solve(
        self, step: Step, phases: list[Phase], accelerations: list[Array]
    ) -> tuple[list[Array], int]:
        """Velocities of the phases before the projection, in all cells, and the iterations.

        Collective. Raises SolverError where a linear solver does not converge.
        """
        line, cells, own = self.line, self.line.cells, self.line.own
        equations = [
            self._equation(step, phase, acceleration)
            for phase, acceleration in zip(phases, accelerations, strict=True)
        ]
        for system in self._systems:
            system.set(equations, step.drag[own] * line.volume)
        rhs = np.stack([one.rhs for one in equations], axis=2)
        if step.explicit_drag is not None:
            force = step.explicit_drag[own] * line.volume[:, None]
            rhs += np.stack([-force, force], axis=2)
        guess = np.stack([phase.velocity_start[own] for phase in phases], axis=2)
        # one measure for all components: the small ones across the line need not be sharper
        largest = max(cells.total(guess[:, i] ** 2) for i in range(3)) ** 0.5
        small = line.small_norm(SMALL_VELOCITY * line.velocity_scale)
        enough = TRANSPORT_TOLERANCE * largest + small
        velocities, iterations = self._solve_systems(rhs, guess, enough)
        for _ in range(1, self.scheme.solves):
            corrected = rhs.copy()
            for k, (phase, one) in enumerate(zip(phases, equations, strict=True)):
                u = cells.ghosted(velocities[:, :, k])
                gradient = cells.ghosted(cells.gradient(u))
                explicit = self._explicit_force(phase, u, gradient, step.levels)
                corrected[:, :, k] += explicit - one.explicit
            velocities, more = self._solve_systems(corrected, velocities, enough)
            iterations += more
        return [cells.ghosted(velocities[:, :, k]) for k in range(len(phases))], iterations

    def _solve_systems(self, rhs: Array, guess: Array, enough: float) -> tuple[Array, int]:
        """Velocities (owned, components, phases), and the iterations."""
        found, iterations = np.empty_like(guess), 0
        for system in self._systems:
            found[:, system.components], taken = system.solve(rhs, guess, enough)
            iterations += taken
        return found, iterations

    def _equation(self, step: Step, phase: Phase, acceleration: Array) -> _Equation:
        """Momentum of one phase without drag."""
        line, cells, own, inner = self.line, self.line.cells, self.line.own, self.line.inner
        density, levels = phase.density, step.levels
        inertia = density.start * np.maximum(phase.fraction_start[own], SMALLEST_FRACTION)
        inertia = inertia * line.volume / levels.span
        flux = density.upwind * phase.flux
        ahead, back = np.maximum(flux, 0.0), np.maximum(-flux, 0.0)
        spread = phase.face_viscosity * cells.face_weight
        spread[cells.inner_count :] = 0.0
        if phase.implicit_correction is not None:
            spread += phase.implicit_correction
        diagonal = inertia + cells.sum_by_side(back, ahead) + cells.sum_faces(spread)
        rhs = inertia[:, None] * phase.velocity_start[own]
        mass = density.cells * np.maximum(phase.fraction[own], SMALLEST_FRACTION)
        explicit = self._explicit_force(phase, phase.velocity_now, phase.gradient, levels)
        rhs += (mass * line.volume)[:, None] * acceleration[own] + explicit
        rhs += step.inflow.sources.force(phase.name) * line.volume[:, None]
        if line.has_wall:
            cells.add_boundary("wall", diagonal, phase.wall_friction)
        if line.has_inlet:
            self._add_inlet(step, phase, back[line.inlet], diagonal, rhs)
        across = -(back + spread)[inner], -(ahead + spread)[inner]
        return _Equation(diagonal, across, self._wall_stiffness(phase), rhs, explicit)

    def _add_inlet(
        self, step: Step, phase: Phase, convected: Array, diagonal: Array, rhs: Array
    ) -> None:
        """Add the momentum that enters, with the mass flow that `convected` [kg/s] leaves out."""
        line, cells, inflow, density = self.line, self.line.cells, step.inflow, phase.density
        mean = inflow.mean_velocity(phase.name)
        mass_flow = density.inflow * inflow.fraction(phase.name) * -line.inlet_flux(mean)
        speed = mean * density.inlet_expansion(line.inlet) * line.inlet_profile
        velocity = -speed[:, None] * line.normal[line.inlet]
        cells.add_boundary("inlet", diagonal, mass_flow - convected)
        cells.add_boundary("inlet", rhs, mass_flow[:, None] * velocity)

    def _explicit_force(
        self, phase: Phase, velocity: Array, gradient: Array, levels: TimeLevels
    ) -> Array:
        """Force on the owned cells that the matrix does not contain, of a known velocity [N]."""
        flux = levels.second_order_faces * phase.density.upwind * phase.flux
        convection = self.scheme.net_correction(flux, velocity, self.line.velocity_scale, gradient)
        return self._explicit_stress(phase, velocity, gradient) - convection

    def _explicit_stress(self, phase: Phase, velocity: Array, gradient: Array) -> Array:
        """Viscous force on the owned cells without the implicit difference across faces [N]."""
        cells, inner, sides = self.line.cells, self.line.inner, self.line.impermeable
        # one array for each component, which is several times as fast as one of tensors
        rate = [cells.to_faces(part)[inner] for part in gradient.reshape(-1, 9).T]
        mu = phase.face_viscosity[inner]
        bulk = phase.face_bulk_viscosity[inner] - 2 / 3 * mu
        trace = bulk * (rate[0] + rate[4] + rate[8])
        force = np.zeros((cells.face_count, 3))
        for i in range(3):
            transposed = sum(
                rate[3 * j + i] * self._area[j] + rate[3 * i + j] * self._non_orthogonal[j]
                for j in range(3)
            )
            force[inner, i] = mu * transposed + trace * self._area[i]
        if phase.implicit_correction is not None:
            rise = velocity.take(cells.first[inner], axis=0) - velocity.take(cells.second, axis=0)
            force[inner] += phase.implicit_correction[inner, None] * rise
        # normal stress of the tangential divergence; the rest is in the wall stiffness
        edge = cells.first[sides]
        divergence = np.einsum("nk,nk->n", self._tangential_part, gradient.reshape(-1, 9)[edge])
        divergence *= phase.bulk_viscosity[edge] - 2 / 3 * phase.viscosity[edge]
        force[sides] = divergence[:, None] * cells.area[sides]
        return cells.net_flux(force)

    def _wall_stiffness(self, phase: Phase) -> Array:
        """Normal force of walls and planes of symmetry over the velocity, (edges, 3, 3) [kg/s].

        The normal velocity falls to zero within the cells next to them, so the normal stress there
        has the part (4/3 mu + bulk) du_n/dn.
        """
        line, cells = self.line, self.line.cells
        edge, weight = cells.first[line.impermeable], cells.face_weight[line.impermeable]
        stiffness = (phase.bulk_viscosity[edge] + 4 / 3 * phase.viscosity[edge]) * weight
        # the wall friction acts on all components
        stiffness[: line.wall.stop - line.wall.start] -= phase.wall_friction
        found = self._gather @ (np.maximum(stiffness, 0.0)[:, None] * self._normal_part)
        return found.reshape(-1, 3, 3)

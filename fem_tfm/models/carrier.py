# SPDX-License-Identifier: LGPL-3.0-or-later
"""What carries particles: the gas of a model, read into the rows of the tracker, and what it loses.

`update` reads the unknowns of a section; `keep` begins a slab of a march, so that the next `update`
gives its end. `deposit` turns the sums of the tracker into functions on the mesh.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import numpy as np
from dolfinx import fem
from mpi4py import MPI

from fem_tfm.closures.particles.dispersion import ParticleDispersion
from fem_tfm.closures.turbulence.gas import Laminar
from fem_tfm.closures.turbulence.k_epsilon import C_MU
from fem_tfm.errors import InputError
from fem_tfm.fenics import compile_expression
from fem_tfm.geometry.mesh import Mesh
from fem_tfm.materials import Gas
from fem_tfm.models.finite_volume import UnsteadyFlow
from fem_tfm.models.particles.field import Field
from fem_tfm.models.particles.grid import Floats, Gathered, Grid
from fem_tfm.models.particles.partition import Partition
from fem_tfm.models.particles.sinks import Sinks
from fem_tfm.models.pointwise import Invariants
from fem_tfm.models.reynolds_stress.heat import GasHeat
from fem_tfm.models.reynolds_stress.section import ReynoldsStressSection
from fem_tfm.models.section import Section
from fem_tfm.models.two_fluid.section import TwoFluidSection

# names of what `deposit` makes, and how many components each has
DEPOSITS = {"impulse": 3, "slope": 1, "residence": 1, "moment": 3, "heat": 1, "heat_slope": 1}
# the least turbulent energy that particles see [m2/s2]
SMALLEST_ENERGY = 1e-12
# places of the six unknown stresses in R
STRESSES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


class Carrier(ABC):
    """A gas that carries particles.

    gas : density and viscosity
    grid : cells that this rank holds
    field : what the tracker reads
    """

    def __init__(self, mesh: Mesh, gas: Gas, grid: Grid) -> None:
        self.mesh, self.gas, self.grid = mesh, gas, grid
        self.field = Field(self.grid, float(gas.density), float(gas.viscosity))

    @abstractmethod
    def update(self) -> None:
        """Read the gas at hand into the field (collective)."""

    def keep(self, start: float, end: float) -> None:
        """Begin a slab: the field at hand holds at `start`, what `update` reads next at `end`."""
        self.field.keep(start, end)

    def deposit(self, sinks: Sinks, length: float = 1.0) -> dict[str, fem.Function]:
        """Sums of all ranks per volume of the flow, as cell-wise functions on the mesh.

        impulse [N/m3], slope [kg/m3/s], residence [kg/m3], moment [kg/m2/s] and, with heat, heat
        [W/m3] and heat_slope [W/m3/K], each over `length` of a section [m] or, in three dimensions,
        over 1. A folded section stands for the whole one. `Sinks.reduce` comes before (collective
        on the mesh).
        """
        found = {}
        share = 1 / (self.grid.sizes * self.mesh.section.area_factor * length)
        for name, width in DEPOSITS.items():
            if name.startswith("heat") and sinks.heat_sums is None:
                continue
            shape = (width,) if width > 1 else ()
            space = fem.functionspace(self.mesh.mesh, ("DG", 0, shape))
            values = getattr(sinks, name)
            density = values * (share if values.ndim == 1 else share[:, None])
            function = fem.Function(space, name=name)
            here = density[self.grid.owned].reshape(len(self.grid.owned), -1)
            dofs = np.asarray(space.dofmap.list)[: len(self.grid.owned), 0]
            array = function.x.array.reshape(-1, width)
            array[dofs] = here
            function.x.scatter_forward()
            found[name] = function
        return found


class _SectionCarrier(Carrier):
    """Unknowns of a section at the nodes of its grid, which every rank holds whole."""

    def __init__(self, section: Section, gas: Gas, dispersion: ParticleDispersion) -> None:
        self.gathered = Gathered.of(section.mesh)
        super().__init__(section.mesh, gas, self.gathered.grid)
        self.section, self.dispersion = section, dispersion
        self._dofs: dict[str, list[np.ndarray]] = {}
        self._expressions: tuple[fem.Function, list[fem.Expression], np.ndarray] | None = None

    def nodal(self, name: str) -> Floats:
        """Values of an unknown at the nodes that this rank gives, (nodes, components)."""
        if name not in self._dofs:
            sub = self.section.space.sub(self.section.names.index(name))
            parts = [sub.sub(i) for i in range(sub.num_sub_spaces)] or [sub]
            self._dofs[name] = [self.gathered.at_nodes(part.dofmap) for part in parts]
        array = self.section.now.x.array
        return np.stack([array[dofs] for dofs in self._dofs[name]], axis=1)


class ReynoldsStressCarrier(_SectionCarrier):
    """A duct's gas by Reynolds stresses or by its eddy viscosity.

    Nodes whose stresses are not realisable are counted in `field.clipped`.

    heat : the temperature of the section, None where it has none
    """

    section: ReynoldsStressSection
    heat: GasHeat | None = None

    def warm(self, heat: GasHeat, heat_capacity: float) -> None:
        """Let particles see the temperature of the gas; its c_p [J/kg/K]."""
        self.heat, field = heat, self.field
        field.heat_capacity = heat_capacity
        field.conductivity = self.gas.viscosity * heat_capacity / heat.prandtl
        self._warm_dofs = self.gathered.at_nodes(heat.space.sub(0).dofmap)

    def _temperature(self) -> Floats:
        """Temperature at the nodes that this rank gives [K]."""
        base = np.full(len(self.gathered.places), float(self.gas.temperature))
        return base if self.heat is None else base + self.heat.now.x.array[self._warm_dofs]

    def update(self) -> None:
        """Read velocity, stresses, T_L and the log law of the strip (collective)."""
        setup = self.section.setup
        velocity, eps = self.nodal("u"), np.exp(self.nodal("e")[:, 0])
        turbulent = self.dispersion.turbulent
        if setup.law.transported:
            values = self.nodal("r")
            k = values[:, :3].sum(axis=1) / 2
            stress = np.empty((len(k), 3, 3))
            for c, (i, j) in enumerate(STRESSES):
                stress[:, i, j] = stress[:, j, i] = values[:, c]
        else:
            k = np.exp(self.nodal("q")[:, 0])
            stress = self._modelled_stress() if turbulent else np.zeros((len(k), 3, 3))
        k = np.maximum(k, SMALLEST_ENERGY)
        distance = float(setup.numbers.wall_offset)
        covered = setup.function.strip(k, distance, float(setup.numbers.viscosity))
        gradient = np.zeros_like(velocity)
        gradient[:, 2] = -self.section.pressure_gradient
        columns = [
            velocity,
            stress.reshape(-1, 9),
            self.dispersion.life(k, eps)[:, None],
            (1 - np.asarray(covered) / distance)[:, None],
            gradient,
            self._temperature()[:, None],
        ]
        whole = self.gathered.gather(np.concatenate(columns, axis=1))
        self.field.fill(
            temperature=whole[:, 17],
            velocity=whole[:, :3],
            stress=whole[:, 3:12].reshape(-1, 3, 3) if turbulent else None,
            time=whole[:, 12] if turbulent else None,
            strip=whole[:, 13],
            pressure_gradient=whole[:, 14:17],
        )

    def _modelled_stress(self) -> Floats:
        """Stresses of an eddy viscosity at the nodes that this rank gives."""
        section = self.section
        if self._expressions is None:
            space = fem.functionspace(section.mesh.mesh, ("Lagrange", 2, (3, 3)))
            expression = section.model.stress(section.state(section.now))
            made = compile_expression(expression, space.element.interpolation_points)
            dofs = self.gathered.at_nodes(space.dofmap)
            self._expressions = fem.Function(space), [made], dofs
        function, expressions, dofs = self._expressions
        function.interpolate(expressions[0])
        return np.asarray(function.x.array.reshape(-1, 3, 3)[dofs])


class TwoFluidCarrier(_SectionCarrier):
    """The gas of a two-fluid section.

    Its stresses are 2/3 k I. An algebraic eddy viscosity stands for the turbulence in equilibrium
    that would have it: eps = nu_t S^2 and k = nu_t S/C_mu^(1/2), S the shear rate.
    """

    section: TwoFluidSection

    def update(self) -> None:
        """Read velocity, stresses and T_L (collective)."""
        velocity = self.nodal("u_g")
        gradient = np.zeros_like(velocity)
        gradient[:, 2] = -float(self.section.drive.value) / self.gas.density
        columns = [velocity, gradient]
        scales = self._scales() if self.dispersion.turbulent else None
        if scales is not None:
            k, eps = scales
            columns += [k[:, None], self.dispersion.life(k, eps)[:, None]]
        whole = self.gathered.gather(np.concatenate(columns, axis=1))
        stress = time = None
        if scales is not None:
            stress, time = 2 / 3 * whole[:, 6, None, None] * np.eye(3), whole[:, 7]
        self.field.fill(
            velocity=whole[:, :3], stress=stress, time=time, pressure_gradient=whole[:, 3:6]
        )

    def _scales(self) -> tuple[Floats, Floats] | None:
        """k [m2/s2] and eps [m2/s3] at the nodes that this rank gives; None in a laminar gas."""
        if "ln_k" in self.section.names:
            k, eps = (np.exp(self.nodal(name)[:, 0]) for name in ("ln_k", "ln_eps"))
            return k, eps
        if isinstance(self.section.setup.model.turbulence, Laminar):
            return None
        shear, viscosity = self._shear_and_viscosity()
        comm, width = self.mesh.mesh.comm, self.mesh.section.hydraulic_diameter
        return equilibrium(shear, viscosity, width, comm)

    def _shear_and_viscosity(self) -> tuple[Floats, Floats]:
        """S [1/s] and nu_t [m2/s] at the nodes that this rank gives."""
        section = self.section
        if self._expressions is None:
            eddies = section.model.eddies(section.state(section.now))
            mu = section.model.closures.turbulence.viscosity(eddies)
            space = fem.functionspace(section.mesh.mesh, ("Lagrange", 2))
            points = space.element.interpolation_points
            made = [compile_expression(e, points) for e in (eddies.strain, mu)]
            dofs = self.gathered.at_nodes(space.dofmap)
            self._expressions = fem.Function(space), made, dofs
        function, expressions, dofs = self._expressions
        found = []
        for expression in expressions:
            function.interpolate(expression)
            found.append(function.x.array[dofs])
        return found[0], found[1] / self.gas.density


class LineCarrier(Carrier):
    """The gas of an unsteady flow in a line, its cell values averaged at the nodes by volume.

    The stresses are 2/3 k I; an algebraic eddy viscosity stands for turbulence in equilibrium, as
    for a two-fluid section. Walls are those of the line, exact whatever the mesh. A rank holds its
    own cells.
    """

    def __init__(self, flow: UnsteadyFlow, dispersion: ParticleDispersion) -> None:
        self.partition = Partition.of(flow.mesh)
        super().__init__(flow.mesh, flow.gas, self.partition.grid)
        self.flow, self.dispersion = flow, dispersion

    def update(self) -> None:
        """Read velocity, turbulence and pressure gradient (collective)."""
        flow, own = self.flow, self.flow.line.own
        columns = [flow.now.u_g[own], flow.cells.gradient(flow.now.p) / self.gas.density]
        scales = self._scales() if self.dispersion.turbulent else None
        if scales is not None:
            columns += [scales[0][:, None], scales[1][:, None]]
        nodal = self.partition.at_nodes(np.concatenate(columns, axis=1))
        stress = time = None
        if scales is not None:
            k = np.maximum(nodal[:, 6], SMALLEST_ENERGY)
            stress = 2 / 3 * k[:, None, None] * np.eye(3)
            time = self.dispersion.life(k, nodal[:, 7])
        self.field.fill(
            velocity=nodal[:, :3], stress=stress, time=time, pressure_gradient=nodal[:, 3:6]
        )

    def _scales(self) -> tuple[Floats, Floats] | None:
        """k [m2/s2] and eps [m2/s3] in the owned cells; None in a laminar gas."""
        flow, own = self.flow, self.flow.line.own
        if "k" in flow.now.scales:
            return flow.now.scales["k"][own], flow.now.scales["eps"][own]
        law = flow.laws.closures.turbulence
        if isinstance(law, Laminar):
            return None
        gradient = flow.cells.gradient(flow.now.u_g)
        height, slope = (values[own] for values in flow.line.gas_profile)
        eddies = flow.laws.eddies(Invariants(gradient), height, slope)
        viscosity = np.asarray(law.viscosity(eddies)) / self.gas.density
        comm, width = self.mesh.mesh.comm, self.mesh.section.hydraulic_diameter
        return equilibrium(np.asarray(eddies.strain), viscosity, width, comm)


def equilibrium(
    shear: Floats, viscosity: Floats, width: float, comm: MPI.Comm
) -> tuple[Floats, Floats]:
    """k and eps of turbulence whose production is its dissipation (collective).

    k = nu_t S/C_mu^(1/2) and eps = C_mu^(1/2) S k, of a shear rate S [1/s] and an eddy viscosity
    nu_t [m2/s]; no eddy turns more slowly than the largest across the width [m].
    """
    k = np.maximum(viscosity * shear / math.sqrt(C_MU), SMALLEST_ENERGY)
    most = comm.allreduce(float(k.max(initial=0.0)), MPI.MAX)
    return k, k * np.maximum(shear * math.sqrt(C_MU), math.sqrt(most) / width)


def SectionCarrier(section: Section, gas: Gas, dispersion: ParticleDispersion) -> _SectionCarrier:
    """The carrier of a section of any model, with its gas and a law of dispersion.

    Raises
    ------
    InputError
        the model has no carrier.
    """
    if isinstance(section, ReynoldsStressSection):
        return ReynoldsStressCarrier(section, gas, dispersion)
    if isinstance(section, TwoFluidSection):
        return TwoFluidCarrier(section, gas, dispersion)
    raise InputError("particles.carrier", type(section).__name__, "a section of a known model")

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Temperature of a duct's gas, one-way on a flow that is solved: one factorisation.

The section carries heat with a velocity near its own whose divergence is exactly that of the axial
flow, so that what walls give is what the gas takes, to round-off.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import basix.ufl
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from dolfinx.mesh import exterior_facet_indices
from mpi4py import MPI
from petsc4py import PETSc

from fem_tfm.closures.turbulence.heat_flux import HeatFlux
from fem_tfm.closures.walls.functions import ThermalWall
from fem_tfm.errors import SolverError
from fem_tfm.fenics import compile_form
from fem_tfm.interpolation import point_values
from fem_tfm.models.axis import DevelopingAxis
from fem_tfm.models.reynolds_stress.heat_forms import HeatModel, HeatState, Proportional
from fem_tfm.models.reynolds_stress.section import ReynoldsStressSection
from fem_tfm.solvers.newton import DirectSolver

# the operator of phi gets this share of 1/D^2 as a reaction, for phi has no level of its own
PIN = 1e-9
# relative change of the decay rate at which its iteration ends
DECAY_TOLERANCE, MOST_ITERATIONS = 1e-11, 200


class MatchedVelocity:
    """Velocity in the section whose divergence is exactly the change of the axial flow.

        (psi_y, -psi_x) + grad phi

    psi takes the curl of the flow's velocity, phi the divergence that continuity asks for where the
    flow develops; both are of degree 2, as the temperature that they carry.
    """

    def __init__(self, section: ReynoldsStressSection) -> None:
        mesh, flow = section.mesh.mesh, section.state(section.now)
        space = fem.functionspace(mesh, ("Lagrange", 2))
        trial, test = ufl.TrialFunction(space), ufl.TestFunction(space)
        stiffness = ufl.inner(ufl.grad(trial), ufl.grad(test)) * section.dx
        mesh.topology.create_connectivity(1, 2)
        edge = exterior_facet_indices(mesh.topology)
        zero = section._constant(0.0)
        bcs = [fem.dirichletbc(zero, fem.locate_dofs_topological(space, 1, edge), space)]
        psi, phi = fem.Function(space), fem.Function(space)
        turning = (flow.u[0] * test.dx(1) - flow.u[1] * test.dx(0)) * section.dx
        self._systems = [_Linear(stiffness, turning, psi, bcs)]
        self.velocity = ufl.as_vector((psi.dx(1), -psi.dx(0)))
        if section.develops:
            model, width = section.model, section.mesh.section.hydraulic_diameter
            # phi is determined but for a constant
            pinned = section._constant(PIN / width**2) * trial * test * section.dx
            swelling = model.axis.change(lambda s: s.u[2], flow) * test * section.dx
            swelling += model.axis.change(model.strip_flux, flow) * test * section.domain.ds_wall
            self._systems.append(_Linear(stiffness + pinned, swelling, phi, []))
            self.velocity += ufl.grad(phi)
        for system in self._systems:
            system.factor()

    def update(self) -> None:
        """Take over the velocity at hand."""
        for system in self._systems:
            system.solve()


class _Linear:
    """A linear system with its factors.

    left, right : its two sides; with `corrects` the right one is what the solution misses, and the
        answer is added to it
    bcs : conditions that vanish
    """

    def __init__(
        self,
        left: Any,
        right: Any,
        solution: fem.Function,
        bcs: list[Any],
        corrects: bool = False,
    ) -> None:
        self.left, self.right = compile_form(left), compile_form(right)
        self.solution, self.bcs, self.corrects = solution, bcs, corrects
        self.matrix = fem_petsc.create_matrix(self.left)
        self.rhs = fem_petsc.create_vector(solution.function_space)
        self.answer = self.rhs.duplicate()
        self.solver = DirectSolver(self.matrix)

    def factor(self) -> None:
        """Assemble and factorise the matrix."""
        self.matrix.zeroEntries()
        fem_petsc.assemble_matrix(self.matrix, self.left, bcs=self.bcs)
        self.matrix.assemble()
        self.solver.refactor(self.matrix)

    def solve(self) -> None:
        """Solve for the right side at hand."""
        with self.rhs.localForm() as local:
            local.set(0)
        fem_petsc.assemble_vector(self.rhs, self.right)
        self.rhs.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        for bc in self.bcs:
            bc.set(self.rhs.array_w)
        self.solver.solve(self.rhs, self.answer)
        x = self.solution.x
        before = x.array[: self.answer.local_size] if self.corrects else 0.0
        x.array[: self.answer.local_size] = before + self.answer.array_r
        x.scatter_forward()

    def destroy(self) -> None:
        """Free every PETSc object."""
        self.solver.destroy()
        for one in (self.matrix, self.rhs, self.answer):
            one.destroy()


class GasHeat:
    """Temperature above the wall on the mesh of a section.

    Parameters
    ----------
    section : the flow
    law : turbulent heat fluxes
    wall : wall function of the temperature
    prandtl : of the gas [-]
    """

    def __init__(
        self, section: ReynoldsStressSection, law: HeatFlux, wall: ThermalWall, prandtl: float
    ) -> None:
        self.section, self.law, self.prandtl = section, law, prandtl
        self.carrier = MatchedVelocity(section)
        self.space = fem.functionspace(section.mesh.mesh, self._element())
        self.now, self.old, self.older = (fem.Function(self.space) for _ in range(3))
        # temperatures of the wall here and at the stations before, and the one that is imposed
        self.walls = [section._constant(0.0) for _ in range(3)]
        self.imposed = 0.0
        # of the fields that are told over those that are solved
        self.scale = 1.0
        self.model = HeatModel(
            law.bound(section._constant),
            wall.bound(section._constant),
            section._constant(prandtl),
            section.model,
            section.state(section.now),
            self.carrier.velocity,
            self._axis(),
        )
        self._warmed: fem.Form | None = None
        if (exchange := section.exchange) is not None and exchange.heat is not None:
            temperature = self._split(self.now).t
            exchange.heat.bind(ufl.as_vector((temperature,)), section.dx)
            self._warmed = compile_form(exchange.warming(temperature) * section.dx)
        form = self.model.residual(
            self._split(self.now), HeatState(0.0, *ufl.TestFunctions(self.space))
        )
        left = ufl.derivative(form, self.now, ufl.TrialFunction(self.space))
        self.system = _Linear(left, -form, self.now, self._conditions(), corrects=True)
        state = self._split(self.now)
        flow, domain = section.state(section.now), section.domain
        change = self.model.axis.change
        inside = change(lambda s: s[0].u[2] * s[1].t, (flow, state)) * section.dx
        strip = change(self.model.strip_heat, (flow, state)) * domain.ds_wall
        self._taken = compile_form(inside + strip)
        self._carried = compile_form(self.model.carried(state))
        self._lost = compile_form(self.model.lost(state))

    def _axis(self) -> Any:
        """d/dz: of a march with its flow, or as the field `old` gives it."""
        section = self.section
        if not section.develops:
            return Proportional(self._split(self.old))
        flows = (section.state(f) for f in (section.old, section.older))
        heats = (self._split(f) for f in (self.old, self.older))
        return DevelopingAxis(section.weights, list(zip(flows, heats, strict=True)))

    def _element(self) -> Any:
        p2 = basix.ufl.element("Lagrange", self.section.mesh.mesh.basix_cell(), 2)
        more = [basix.ufl.blocked_element(p2, shape=(n,)) for n in (3, 2)]
        return basix.ufl.mixed_element([p2, *more] if self.law.transported else [p2])

    def _split(self, function: fem.Function) -> HeatState:
        wall = self.walls[(self.now, self.old, self.older).index(function)]
        return HeatState(wall, *ufl.split(function))

    @property
    def wall_temperature(self) -> float:
        """Of the wall at hand, above the reference [K]."""
        return float(self.walls[0].value)

    def _conditions(self) -> list[fem.DirichletBC]:
        """No flux normal to planes of symmetry."""
        mesh = self.section.mesh
        bcs: list[fem.DirichletBC] = []
        if not self.law.transported:
            return bcs
        for tag, component in (("symmetry", 0), ("symmetry_x", 0), ("symmetry_y", 1)):
            for part in (1, 2) if tag in mesh.tags else ():
                sub = self.space.sub(part).sub(component)
                dofs = fem.locate_dofs_topological(sub, 1, mesh.facets(tag))
                bcs.append(fem.dirichletbc(self.section._constant(0.0), dofs, sub))
        return bcs

    def _set_temperature(self, function: fem.Function, value: float) -> None:
        dofs = np.asarray(self.space.sub(0).collapse()[1]).ravel()
        function.x.array[dofs] = value

    # -- solving -------------------------------------------------------------------------------

    def constant_flux(self) -> None:
        """Developed T above the wall for dT/dz = -1 K/m and one temperature around the section."""
        self.carrier.update()
        self.old.x.array[:] = 0.0
        self._set_temperature(self.old, -1.0)
        self.system.factor()
        self.system.solve()

    def constant_temperature(self) -> float:
        """Developed T that keeps its shape as it decays, above the wall; returns its rate [1/m].

        Power iteration on the inverse of the section's operator.

        Raises
        ------
        SolverError
            the rate does not settle.
        """
        self.constant_flux()
        decay = math.nan
        for _ in range(MOST_ITERATIONS):
            before = decay
            self.old.x.array[:] = -self.now.x.array / self.bulk()
            self.system.solve()
            decay = 1 / self.bulk()
            if abs(decay - before) <= DECAY_TOLERANCE * decay:
                # the equations hold d/dz = -decay T
                return decay
        raise SolverError("the decay of the temperature along the duct does not settle")

    def enter(self, temperature: float, wall: float) -> None:
        """Uniform temperature at the inlet of a march, and that of its walls, above a reference."""
        self.now.x.array[:] = 0.0
        self._set_temperature(self.now, temperature)
        # what enters has not met the wall yet
        self.walls[0].value, self.imposed = temperature, wall

    def keep(self) -> None:
        """The temperature at hand becomes that of the station before."""
        self.older.x.array[:] = self.old.x.array
        self.old.x.array[:] = self.now.x.array
        values = [float(wall.value) for wall in self.walls]
        self.walls[1].value, self.walls[2].value = values[:2]

    def step(self, flux: float | None = None) -> None:
        """Temperature of a station of a march whose flow is solved.

        flux : into the gas over rho c_p [K m/s]; it decides on the temperature of the wall, the
            same around the section. None takes the temperature that is imposed.
        """
        self.carrier.update()
        self.system.factor()
        wall = self.walls[0]
        if flux is None:
            wall.value = self.imposed
        self.system.solve()
        if flux is None:
            return
        # the loss is linear in the temperature of the wall
        first, lost = float(wall.value), self.lost()
        wall.value = first + 1.0
        self.system.solve()
        slope = self.lost() - lost
        wall.value = first + (-flux * self._perimeter - lost) / slope
        self.system.solve()

    def copies(self) -> dict[str, fem.Function]:
        """T, q and m of this station and the one before, each on its own space."""
        parts = range(self.space.num_sub_spaces)
        return {
            f"{key}.heat{i}": getattr(self, key).sub(i).collapse()
            for key in ("now", "old")
            for i in parts
        }

    def restore(self, copies: Mapping[str, fem.Function]) -> None:
        """Put back what `copies` gave."""
        for name, function in copies.items():
            key, _, i = name.partition(".heat")
            dofs = np.asarray(self.space.sub(int(i)).collapse()[1]).ravel()
            getattr(self, key).x.array[dofs] = function.x.array

    # -- what others read ----------------------------------------------------------------------

    def _sum(self, form: fem.Form) -> float:
        return self.section.mesh.mesh.comm.allreduce(fem.assemble_scalar(form), MPI.SUM)

    def bulk(self) -> float:
        """Mean temperature of what flows, above the reference [K]."""
        return self._sum(self._carried) / self.section.flux()

    def lost(self) -> float:
        """Heat into the wall per length of the part solved, over rho c_p [K m2/s]."""
        return self._sum(self._lost)

    def warmed(self) -> float:
        """Heat from particles per length of the part solved, over rho c_p [K m2/s]."""
        return 0.0 if self._warmed is None else self._sum(self._warmed)

    @property
    def _perimeter(self) -> float:
        """Wetted perimeter of the part solved [m]."""
        geometry = self.section.mesh.section
        return geometry.perimeter / geometry.area_factor

    def flux(self) -> float:
        """Mean heat flux from the wall into the gas over rho c_p [K m/s]."""
        return -self.lost() / self._perimeter

    def nusselt(self) -> float:
        """Nu of the wall flux at the hydraulic diameter; nan where gas and wall are alike [-]."""
        excess = self.wall_temperature - self.bulk()
        diffusivity = self.section.setup.numbers.viscosity / self.prandtl
        width = self.section.mesh.section.hydraulic_diameter
        return self.flux() * width / (diffusivity * excess) if excess else math.nan

    def balance(self) -> float:
        """Relative difference between the heat that the section gives and that of the wall [-]."""
        taken = self._sum(self._taken)
        return abs(taken + self.lost()) / abs(taken)

    def fields(self) -> dict[str, fem.Function]:
        """temperature above the reference [K], heat_flux q [K m/s] where it is transported."""
        names = ("temperature", "heat_flux") if self.law.transported else ("temperature",)
        fields = {name: self.now.sub(i).collapse() for i, name in enumerate(names)}
        for name, function in fields.items():
            function.x.array[:] *= self.scale
            function.name = name
        return fields

    def profiles(self, at: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """(T - T_w)/(T_b - T_w) along lines, and Pr_t along one called "bisector" (along x).

        at : points of each line, shape (n, 2) [m]

        Pr_t = (R_xz/q_x) (dT/dx)/(dW/dx) with the projected gradients; nan where both vanish.
        """
        fields, columns = self.fields(), {}
        for line, points in at.items():
            values = point_values(fields["temperature"], points)
            wall = self.wall_temperature
            excess = values / self.scale - wall
            columns[f"{line} (T - T_w)/(T_b - T_w)"] = excess / (self.bulk() - wall)
        if self.law.transported and self.section.setup.law.transported and "bisector" in at:
            sampled = [self.section.unknown("r"), self.section.unknown("d")]
            sampled += [fields["heat_flux"], self.now.sub(2).collapse()]
            r, d, q, m = point_values(sampled, at["bisector"])
            q = q / self.scale
            with np.errstate(invalid="ignore", divide="ignore"):
                columns["bisector Pr_t"] = r[:, 4] / q[:, 0] * m[:, 0] / d[:, 0]
            # on the axis all four vanish
            columns["bisector Pr_t"][0] = np.nan
        return columns

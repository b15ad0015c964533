# SPDX-License-Identifier: LGPL-3.0-or-later
"""Temperature of a duct's gas, one-way on a flow that is solved: one factorisation.

The flow carries heat with the divergence-free velocity nearest to its own, so that what walls give
is what the gas takes, to round-off.
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

from fem_tfm.closures.heat_flux import HeatFlux
from fem_tfm.closures.wall_functions import ThermalWall
from fem_tfm.errors import SolverError
from fem_tfm.fenics import compile_form
from fem_tfm.flows.duct_section import DuctSection
from fem_tfm.interpolation import point_values
from fem_tfm.models.heat import HeatModel, HeatState
from fem_tfm.solvers.newton import DirectSolver

# relative change of the decay rate at which its iteration ends
DECAY_TOLERANCE, MOST_ITERATIONS = 1e-11, 200


class Streamfunction:
    """Projection of a velocity in the section on those without divergence and through-flow."""

    def __init__(self, section: DuctSection) -> None:
        mesh = section.mesh.mesh
        space = fem.functionspace(mesh, ("Lagrange", 2))
        self.psi = fem.Function(space)
        u = section.state(section.now).u
        trial, test = ufl.TrialFunction(space), ufl.TestFunction(space)
        mesh.topology.create_connectivity(1, 2)
        edge = exterior_facet_indices(mesh.topology)
        zero = fem.Constant(mesh, PETSc.ScalarType(0))
        bcs = [fem.dirichletbc(zero, fem.locate_dofs_topological(space, 1, edge), space)]
        self._system = _Linear(
            ufl.inner(ufl.grad(trial), ufl.grad(test)) * section.dx,
            (u[0] * test.dx(1) - u[1] * test.dx(0)) * section.dx,
            self.psi,
            bcs,
        )

    @property
    def velocity(self) -> Any:
        """(psi_y, -psi_x), a UFL expression."""
        return ufl.as_vector((self.psi.dx(1), -self.psi.dx(0)))

    def update(self) -> None:
        """Take over the velocity at hand."""
        self._system.factor()
        self._system.solve()


class _Linear:
    """A linear system with its factors."""

    def __init__(self, left: Any, right: Any, solution: fem.Function, bcs: list[Any]) -> None:
        self.left, self.right = compile_form(left), compile_form(right)
        self.solution, self.bcs = solution, bcs
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
        x.array[: self.answer.local_size] = self.answer.array_r
        x.scatter_forward()

    def destroy(self) -> None:
        """Free every PETSc object."""
        self.solver.destroy()
        for one in (self.matrix, self.rhs, self.answer):
            one.destroy()


class DuctHeat:
    """Temperature above the wall on the mesh of a section.

    Parameters
    ----------
    section : the flow
    law : turbulent heat fluxes
    wall : wall function of the temperature
    prandtl : of the gas [-]
    """

    def __init__(
        self, section: DuctSection, law: HeatFlux, wall: ThermalWall, prandtl: float
    ) -> None:
        self.section, self.law, self.prandtl = section, law, prandtl
        self.stream = Streamfunction(section)
        self.space = fem.functionspace(section.mesh.mesh, self._element())
        self.now, self.given = fem.Function(self.space), fem.Function(self.space)
        self.rate = section._constant(0.0)
        self.model = HeatModel(
            law.bound(section._constant),
            wall.bound(section._constant),
            section._constant(prandtl),
            section.model,
            section.state(section.now),
            self.stream.velocity,
        )
        trial = HeatState(*ufl.TrialFunctions(self.space))
        test = HeatState(*ufl.TestFunctions(self.space))
        form = self.model.residual(trial, test, self.rate, self._split(self.given))
        self.system = _Linear(ufl.lhs(form), ufl.rhs(form), self.now, self._conditions())
        state = self._split(self.now)
        along = self.rate * state.t + self._split(self.given).t
        taken = section.state(section.now).u[2] * along * section.dx
        self._taken = compile_form(taken)
        self._carried = compile_form(self.model.carried(state))
        self._lost = compile_form(self.model.lost(state))

    def _element(self) -> Any:
        p2 = basix.ufl.element("Lagrange", self.section.mesh.mesh.basix_cell(), 2)
        more = [basix.ufl.blocked_element(p2, shape=(n,)) for n in (3, 2)]
        return basix.ufl.mixed_element([p2, *more] if self.law.transported else [p2])

    @staticmethod
    def _split(function: fem.Function) -> HeatState:
        return HeatState(*ufl.split(function))

    def _conditions(self) -> list[fem.DirichletBC]:
        """No flux normal to planes of symmetry."""
        mesh, bcs = self.section.mesh, []
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
        """T for dT/dz = -1 K/m everywhere and a wall of one temperature around the section."""
        self.stream.update()
        self.rate.value = 0.0
        self.given.x.array[:] = 0.0
        self._set_temperature(self.given, -1.0)
        self.system.factor()
        self.system.solve()

    def constant_temperature(self) -> float:
        """T that keeps its shape as it decays, with mean one; returns its rate [1/m].

        Power iteration on the inverse of the section's operator.

        Raises
        ------
        SolverError
            the rate does not settle.
        """
        self.constant_flux()
        decay = math.nan
        for _ in range(MOST_ITERATIONS):
            before, bulk = decay, self.bulk()
            self.given.x.array[:] = -self.now.x.array / bulk
            self.system.solve()
            decay = 1 / self.bulk()
            if abs(decay - before) <= DECAY_TOLERANCE * decay:
                # what the equations hold is d/dz = -decay T
                self.given.x.array[:] *= decay
                self.now.x.array[:] *= decay
                return decay
        raise SolverError("the decay of the temperature along the duct does not settle")

    def step(self, rate: float, given: np.ndarray) -> None:
        """T where d/dz is `rate` [1/m] times it plus `given`."""
        self.stream.update()
        self.rate.value = rate
        self.given.x.array[:] = given
        self.system.factor()
        self.system.solve()

    # -- what others read ----------------------------------------------------------------------

    def _sum(self, form: fem.Form) -> float:
        return self.section.mesh.mesh.comm.allreduce(fem.assemble_scalar(form), MPI.SUM)

    def bulk(self) -> float:
        """Mean temperature of what flows, above the wall's [K]."""
        return self._sum(self._carried) / self.section.flux()

    def lost(self) -> float:
        """Heat into the wall per length of the part solved, over rho c_p [K m2/s]."""
        return self._sum(self._lost)

    def nusselt(self, rise: float) -> float:
        """Nu of a bulk temperature that changes by `rise` along the axis [K/m]."""
        geometry = self.section.mesh.geometry
        flux = -rise * self.section.setup.velocity * geometry.hydraulic_diameter / 4
        diffusivity = self.section.setup.numbers.viscosity / self.prandtl
        return flux * geometry.hydraulic_diameter / (diffusivity * self.bulk())

    def balance(self) -> float:
        """Relative difference between the heat that the section gives and that of the wall [-]."""
        taken = self._sum(self._taken)
        return abs(taken + self.lost()) / abs(taken)

    def fields(self) -> dict[str, fem.Function]:
        """temperature above the wall [K], and heat_flux q [K m/s] where it is transported."""
        names = ("temperature", "heat_flux") if self.law.transported else ("temperature",)
        fields = {name: self.now.sub(i).collapse() for i, name in enumerate(names)}
        for name, function in fields.items():
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
            columns[f"{line} (T - T_w)/(T_b - T_w)"] = values / self.bulk()
        if self.law.transported and self.section.setup.law.transported and "bisector" in at:
            sampled = [self.section.unknown("r"), self.section.unknown("d")]
            sampled += [fields["heat_flux"], self.now.sub(2).collapse()]
            r, d, q, m = point_values(sampled, at["bisector"])
            with np.errstate(invalid="ignore", divide="ignore"):
                columns["bisector Pr_t"] = r[:, 4] / q[:, 0] * m[:, 0] / d[:, 0]
            # on the axis all four vanish
            columns["bisector Pr_t"][0] = np.nan
        return columns

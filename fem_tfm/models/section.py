# SPDX-License-Identifier: LGPL-3.0-or-later
"""A section on one mesh: what every model has in common, whatever its equations.

A section is developed, d/dz = 0, or a station of a march: then d/dz is a backward difference to the
stations before it. What enters a station leaves it: continuity gives each phase the flux of the
station before for any G. A wrong G would show as a mean of the pressure in the section, so G is the
one for which that mean is zero.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import ufl
from dolfinx import fem
from petsc4py import PETSc

from fem_tfm.closures.base import Closure
from fem_tfm.fenics import compile_form, compile_forms
from fem_tfm.geometry.mesh import Mesh
from fem_tfm.models.axis import Axis, DevelopedAxis, DevelopingAxis
from fem_tfm.solvers.newton import Block, Border, BorderedNewton

# the state of a section: its unknowns and its multipliers
type Stored = tuple[np.ndarray, tuple[float, ...]]


def structure(law: Any) -> Any:
    """A law without its numbers; a plain switch is itself."""
    if not isinstance(law, Closure):
        return law
    values = ((f.name, getattr(law, f.name)) for f in fields(law))
    return type(law), tuple((k, v) for k, v in values if not isinstance(v, float))


def between(a: Any, b: Any, share: float) -> Any:
    """A setup whose numbers lie between those of two of the same structure, b's at a share of 1."""
    if isinstance(a, float):
        return (1 - share) * a + share * b
    if isinstance(a, tuple):
        return tuple(between(x, y, share) for x, y in zip(a, b, strict=True))
    if is_dataclass(a):
        parts = {f.name: between(getattr(a, f.name), getattr(b, f.name), share) for f in fields(a)}
        return replace(b, **parts)
    return b


class Section(ABC):
    """A mixed space on a mesh, its unknowns, its forms and the solver that carries them.

    Parameters
    ----------
    mesh : the section with its tags and geometry
    setup : numbers of the problem, with `structure`, `bound` and `quadrature_degree`
    names : of the unknowns, in the order of the element
    element : mixed element with one part for each unknown
    develops : whether it is a station of a march, which has `weights` and the state `older` too

    Attributes
    ----------
    now, old : unknowns, and those before the step in pseudo-time or along the axis
    owned_dofs : dofs of each unknown that this rank owns
    idt, drive : Constants 1/dt [1/s] and G
    lag : Constant, share of the rates of the mesh's terms that is that of `old`; 0 in an answer
    newton : the system, whose first border is that of G
    """

    def __init__(
        self, mesh: Mesh, setup: Any, names: Sequence[str], element: Any, develops: bool
    ) -> None:
        self.mesh, self.setup, self.develops = mesh, setup, develops
        self.names = tuple(names)
        self.space = fem.functionspace(mesh.mesh, element)
        self.now = fem.Function(self.space, name="unknowns")
        self.old = fem.Function(self.space)
        metadata = {"quadrature_degree": setup.quadrature_degree}
        self.dx = ufl.Measure("dx", mesh.mesh, metadata=metadata)
        self.ds = ufl.Measure("ds", mesh.mesh, subdomain_data=mesh.facet_tags, metadata=metadata)
        self._numbers: list[fem.Constant] = []
        self._integrals: dict[str, fem.Form] = {}
        self.owned_dofs = [self._sub_dofs(i) for i in range(len(self.names))]
        self.idt, self.drive, self.lag = (self._constant(0.0) for _ in range(3))
        self.newton: BorderedNewton
        # what carries the unknowns here from another mesh again and again, by its section
        self.carriers: WeakKeyDictionary[Section, list[Any]] = WeakKeyDictionary()

    def _axis(self) -> Axis:
        """How the flow changes along the axis."""
        if not self.develops:
            return DevelopedAxis()
        self.older = fem.Function(self.space)
        self.weights = [self._constant(0.0) for _ in range(3)]
        return DevelopingAxis(self.weights, [self.state(self.old), self.state(self.older)])

    # -- what a model gives --------------------------------------------------------------------

    @abstractmethod
    def state(self, function: fem.Function) -> Any:
        """UFL state of a Function of the mixed space."""

    @abstractmethod
    def residual(self, test: Any) -> ufl.Form:
        """Sum of all balances."""

    @abstractmethod
    def boundary_conditions(self) -> list[fem.DirichletBC]:
        """Conditions that the unknowns fulfil exactly."""

    @abstractmethod
    def borders(self) -> list[Border]:
        """Multipliers and what determines them, G first; their forms are UFL."""

    @abstractmethod
    def targets(self) -> list[float]:
        """What the borders of the model aim at."""

    @abstractmethod
    def blocks(self) -> list[Block]:
        """Sizes of the unknowns."""

    # -- the solver ----------------------------------------------------------------------------

    def build(self, progress: Callable[[str], None]) -> None:
        """Compile the forms side by side and make the solver; `progress` hears what is compiled."""
        progress("residual, Jacobian and constraints")
        form, borders = self.residual(self._test()), self.borders()
        wanted = [form, ufl.derivative(form, self.now, ufl.TrialFunction(self.space))]
        for border in borders:
            wanted += [border.column, border.constraint, border.row]
        residual, jacobian, *rest = compile_forms(wanted)
        parts = zip(borders, rest[::3], rest[1::3], rest[2::3], strict=True)
        borders = [replace(b, column=c, constraint=g, row=r) for b, c, g, r in parts]
        conditions, blocks = self.boundary_conditions(), self.blocks()
        self.newton = BorderedNewton(residual, jacobian, self.now, conditions, borders, blocks)

    def _test(self) -> Any:
        kind = type(self.state(self.now))
        return kind(**dict(zip(self.names, ufl.TestFunctions(self.space), strict=True)))

    def update(self, setup: Any) -> None:
        """Take over the numbers of a setup of the same structure; nothing is compiled or built.

        Raises
        ------
        ValueError
            the setup has other laws, another kind of feed or another quadrature.
        """
        if setup.structure != self.setup.structure:
            raise ValueError("a section can take over numbers only, and this setup has other laws")
        self._renew(setup.bound)
        self.setup = setup
        for border, target in zip(self.newton.borders, self.targets(), strict=True):
            border.target.value = target
        self.newton.blocks = self.blocks()

    def stored(self) -> Stored:
        """The state: a copy of the unknowns, and the multipliers."""
        multipliers = tuple(float(b.multiplier.value) for b in self.newton.borders)
        return self.now.x.array.copy(), multipliers

    def restore(self, state: Stored) -> None:
        """Put back what `stored` gave; at rest, or its forces would hold those of a lost step."""
        self.now.x.array[:], multipliers = state
        self.old.x.array[:] = self.now.x.array
        for border, value in zip(self.newton.borders, multipliers, strict=True):
            border.multiplier.value = value

    def fulfil(self) -> None:
        """Give the unknowns the values that the boundary conditions ask for."""
        for condition in self.newton.bcs:
            condition.set(self.now.x.array)
        self.now.x.scatter_forward()

    def _zero(self, name: str, component: int, facets: np.ndarray) -> fem.DirichletBC:
        """One component of an unknown vanishes on facets."""
        self.mesh.mesh.topology.create_connectivity(1, 2)
        sub = self.space.sub(self.names.index(name)).sub(component)
        dofs = fem.locate_dofs_topological(sub, 1, facets)
        return fem.dirichletbc(self._constant(0.0), dofs, sub)

    # -- numbers in forms ----------------------------------------------------------------------

    def _constant(self, value: Any) -> fem.Constant:
        return fem.Constant(self.mesh.mesh, np.asarray(value, dtype=PETSc.ScalarType))

    def _number(self, value: Any) -> fem.Constant:
        """A constant that `_renew` changes."""
        self._numbers.append(self._constant(value))
        return self._numbers[-1]

    def _renew(self, bind: Callable[[Callable[[Any], Any]], Any]) -> None:
        """Give every number the value that `bind` wraps in its place; nothing is compiled."""
        held = iter(self._numbers)

        def renew(value: Any) -> fem.Constant:
            constant = next(held)
            constant.value = value
            return constant

        bind(renew)

    def _border(
        self, multiplier: fem.Constant, column: Any, constraint: Any, target: float
    ) -> Border:
        """A border in UFL; `build` compiles its forms beside the others."""
        row = ufl.derivative(constraint, self.now, ufl.TestFunction(self.space))
        return Border(multiplier, column, constraint, row, self._constant(target))

    # -- unknowns ------------------------------------------------------------------------------

    def _sub_dofs(self, i: int) -> np.ndarray:
        _, dofs = self.space.sub(i).collapse()
        dofs = np.asarray(dofs).ravel()
        owned = self.space.dofmap.index_map.size_local * self.space.dofmap.index_map_bs
        return dofs[dofs < owned]

    @property
    def area(self) -> float:
        """Area of the mesh [m2]."""
        return self.integral("area", self._constant(1.0))

    @property
    def dofs(self) -> int:
        """Unknowns on all ranks."""
        return self.space.dofmap.index_map.size_global * self.space.dofmap.index_map_bs

    def unknown(self, name: str) -> fem.Function:
        """A copy of one unknown on its own space."""
        return self.now.sub(self.names.index(name)).collapse()

    def set_unknown(self, name: str, function: fem.Function) -> None:
        """Put back what `unknown` gave."""
        dofs = np.asarray(self.space.sub(self.names.index(name)).collapse()[1]).ravel()
        self.now.x.array[dofs] = function.x.array
        self.now.x.scatter_forward()

    # -- what others read ----------------------------------------------------------------------

    def integral(self, name: str, integrand: Any, measure: ufl.Measure | None = None) -> float:
        """Integral over the part of the section that is solved, or over its wall.

        The form is compiled when `name` is met for the first time and kept: the same name always
        means the same integrand.
        """
        if name not in self._integrals:
            self._integrals[name] = compile_form(integrand * (measure or self.dx))
        value = fem.assemble_scalar(self._integrals[name])
        return self.mesh.mesh.comm.allreduce(value)

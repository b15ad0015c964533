# SPDX-License-Identifier: LGPL-3.0-or-later
"""Unknowns on one mesh: what every section has in common, whatever its equations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import ufl
from dolfinx import fem
from petsc4py import PETSc

from fem_tfm.fenics import compile_form
from fem_tfm.geometry.mesh import Mesh
from fem_tfm.solvers.newton import Border


class Discretisation:
    """A mixed space on a mesh, its unknowns and the numbers that its forms hold.

    Parameters
    ----------
    mesh : the section with its tags and geometry
    element : mixed element with one part for each unknown
    names : of the unknowns, in the order of the element
    quadrature_degree : of integrals over the section
    """

    def __init__(
        self, mesh: Mesh, element: Any, names: Sequence[str], quadrature_degree: int
    ) -> None:
        self.mesh = mesh
        self.names = tuple(names)
        self.space = fem.functionspace(mesh.mesh, element)
        self.now = fem.Function(self.space, name="unknowns")
        self.old = fem.Function(self.space)
        self.dx = ufl.Measure("dx", mesh.mesh, metadata={"quadrature_degree": quadrature_degree})
        self._numbers: list[fem.Constant] = []
        self._integrals: dict[str, fem.Form] = {}
        self._dofs = [self._sub_dofs(i) for i in range(len(self.names))]
        # what carries the unknowns here from another mesh again and again, by its discretisation
        self.carriers: WeakKeyDictionary[Discretisation, list[Any]] = WeakKeyDictionary()

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
        row = ufl.derivative(constraint, self.now, ufl.TestFunction(self.space))
        return Border(
            multiplier,
            compile_form(column),
            compile_form(constraint),
            compile_form(row),
            self._constant(target),
        )

    # -- unknowns ------------------------------------------------------------------------------

    def _sub_dofs(self, i: int) -> np.ndarray:
        _, dofs = self.space.sub(i).collapse()
        dofs = np.asarray(dofs).ravel()
        owned = self.space.dofmap.index_map.size_local * self.space.dofmap.index_map_bs
        return dofs[dofs < owned]

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

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cells and faces of a mesh in UFL, exactly as the arrays of `Cells` see them.

Values of cells are DG0 functions. A value of a face is the flux of a Raviart-Thomas function of the
lowest order. Integrals over facets have one quadrature point, the middle of the facet: there the
normal n of a straight or bilinear face is that of its area vector S, and the surface element is
|S|. n points from the side "+", the first cell, to the side "-", and out of the domain. With c the
centres of the cells and x the middle of a face

    d = c(-) - c(+) inside, x - c on the boundary,      |S|^2/(S.d) = int 1/(n.d) dS
    mean(q) = s q(+) + (1 - s) q(-),    s = n.(c(-) - x)/(n.d)
    in_series(k) = 1/[(1 - s)/k(+) + s/k(-)]

A flux F leaves the first cell and enters the second: the sum over the faces of each cell is

    int F (w(+) - w(-)) dS + int F w ds
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

import basix.ufl
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import default_scalar_type, fem, la
from dolfinx import mesh as dmesh

from fem_tfm.fenics import compile_form
from fem_tfm.models.finite_volume.cells.line import MOST_CHANGE
from fem_tfm.models.finite_volume.cells.mesh import SMALLEST, Array, Cells

PARTS = ("inlet", "outlet", "wall", "symmetry")
IMPERMEABLE = ("wall", "symmetry")
# bounds of the weight s
LEAST_SHARE, LARGEST_SHARE = 0.05, 0.95
# arrays over faces that hold the integral over a face; the others hold a value on it
FLUXES = {
    "flux",
    "flux_acceleration",
    "implicit_correction",
    "pressure_flux",
    "previous_flux",
    "solids_flux",
    "step_flux",
    "total_flux",
}


class Face:
    """An expression on faces: `inner` of restricted functions, `edge` on the boundary."""

    def __init__(self, inner: Any, edge: Any) -> None:
        self.inner, self.edge = inner, edge

    @staticmethod
    def of(function: Callable[..., Any], *parts: Any) -> Face:
        """A function of expressions on faces and of numbers or constants."""

        def on(side: str) -> Any:
            return function(*(getattr(p, side) if isinstance(p, Face) else p for p in parts))

        return Face(on("inner"), on("edge"))

    def __add__(self, other: Any) -> Face:
        return Face.of(lambda a, b: a + b, self, other)

    def __sub__(self, other: Any) -> Face:
        return Face.of(lambda a, b: a - b, self, other)

    def __mul__(self, other: Any) -> Face:
        return Face.of(lambda a, b: a * b, self, other)

    def __truediv__(self, other: Any) -> Face:
        return Face.of(lambda a, b: a / b, self, other)

    def __rsub__(self, other: Any) -> Face:
        return Face.of(lambda a, b: b - a, self, other)

    def __rtruediv__(self, other: Any) -> Face:
        return Face.of(lambda a, b: b / a, self, other)

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self) -> Face:
        return Face(-self.inner, -self.edge)


class FacetForms:
    """Measures, geometry and data of cells and faces in UFL, and the operators of forms on them.

    Parameters
    ----------
    cells : operators of the solver, whose arrays become functions

    Attributes
    ----------
    dx, dS : measures of cells and of inner facets
    scalars, vectors, tensors : spaces of one value, vector or tensor a cell
    fluxes : space of the fluxes of faces
    normal, delta, distance, weight : n, d, n.d and 1/(n.d) on faces
    face_area : |S|, for what is not an integral
    """

    def __init__(self, cells: Cells) -> None:
        self.cells, self.domain = cells, cells.mesh.mesh
        domain = self.domain
        shapes: tuple[tuple[int, ...], ...] = ((), (3,), (3, 3))
        self._spaces = [fem.functionspace(domain, ("DG", 0, shape)) for shape in shapes]
        self.scalars, self.vectors, self.tensors = self._spaces
        self.fluxes = fem.functionspace(domain, basix.ufl.element("RT", domain.basix_cell(), 1))
        middle = {"quadrature_degree": 1}
        self.dx = ufl.Measure("dx", domain, metadata={"quadrature_degree": 2})
        self.dS = ufl.Measure("dS", domain, metadata=middle)
        self._ds = ufl.Measure("ds", domain, metadata=middle, subdomain_data=self._tags())
        n, x, c = ufl.FacetNormal(domain), ufl.SpatialCoordinate(domain), self.cell(cells.centre)
        self.normal = Face(n("+"), n)
        self.delta = Face(c("-") - c("+"), x - c)
        self.distance = Face.of(ufl.dot, self.normal, self.delta)
        self.weight = 1 / self.distance
        share = ufl.dot(n("+"), c("-") - x("+")) / self.distance.inner
        self._share = ufl.max_value(LEAST_SHARE, ufl.min_value(LARGEST_SHARE, share))
        self._numbers = self._number_faces()
        self._sign = np.ones(cells.face_count)
        self._sign = np.sign(self.values(Face(1, 1)))
        self.face_area = self.face(cells.face_area)

    def _tags(self) -> dmesh.MeshTags:
        """Tags of the boundary's facets, one more than the place of their part in PARTS."""
        parts = self.cells.parts
        facets = np.concatenate([self.cells.facets[part] for part in parts.values()])
        tags = [np.full(p.stop - p.start, PARTS.index(name) + 1) for name, p in parts.items()]
        order = np.argsort(facets)
        tag = np.concatenate(tags).astype(np.int32)
        return dmesh.meshtags(self.domain, 2, facets[order], tag[order])

    def _number_faces(self) -> npt.NDArray[np.int32]:
        """Degree of freedom of the flux of each face."""
        dofmap, topology = self.fluxes.dofmap, self.domain.topology
        links = topology.connectivity(3, 2)
        local = [dofmap.dof_layout.entity_dofs(2, i)[0] for i in range(links.links(0).size)]
        found = np.zeros(links.array.max() + 1, dtype=np.int32)
        for cell in range(self.cells.count):
            found[links.links(cell)] = dofmap.cell_dofs(cell)[local]
        return found[self.cells.facets]

    # -- arrays as functions -------------------------------------------------------------------

    def constant(self, value: Any) -> fem.Constant:
        """A number or a vector that may change without another compilation."""
        return fem.Constant(self.domain, np.asarray(value, dtype=default_scalar_type))

    def cell(self, values: Array) -> fem.Function:
        """Function of values of cells: numbers, vectors or tensors."""
        found = fem.Function(self._spaces[values.ndim - 1])
        found.x.array[: values.size] = values.ravel()
        return found

    def density(self, sums: Array) -> Face:
        """Flux density: its integral over each face is the value of the face, or its vector."""
        if sums.ndim == 2:
            parts = (self.density(sums[:, i]) for i in range(3))
            return Face.of(lambda *components: ufl.as_vector(components), *parts)
        found = fem.Function(self.fluxes)
        found.x.array[self._numbers] = sums * self._sign
        return Face.of(ufl.dot, Face(found("+"), found), self.normal)

    def face(self, values: Array) -> Face:
        """Expression that has on each face the value of the face."""
        return self.density(values * self.cells.face_area)

    def on_part(self, name: str, values: Array) -> Array:
        """Array over faces that is zero but on one part of the boundary."""
        found = np.zeros(self.cells.face_count)
        found[self.cells.parts.get(name, slice(0, 0))] = values
        return found

    def fields(self, given: Any, name: str = "") -> Any:
        """The same in UFL: of a number, an array, or what a data class or a mapping holds."""
        if dataclasses.is_dataclass(given):
            return SimpleNamespace(**self.fields(vars(given)))
        if isinstance(given, Mapping):
            return {key: self.fields(value, key) for key, value in given.items()}
        if isinstance(given, np.ndarray) and given.ndim:
            if given.shape[0] == self.cells.face_count:
                return self.density(given) if name in FLUXES else self.face(given)
            if given.shape[0] in (self.cells.count, self.cells.owned):
                return self.cell(given)
            return self.constant(given)
        if isinstance(given, float | np.ndarray):
            return self.constant(given)
        return given

    # -- forms as arrays -----------------------------------------------------------------------

    def assembled(self, form: ufl.Form) -> Array:
        """Vector of a form of DG0 functions: an array over owned cells (collective)."""
        width = form.arguments()[0].ufl_function_space().value_size
        found = fem.assemble_vector(compile_form(form))
        found.scatter_reverse(la.InsertMode.add)
        found = found.array[: self.cells.owned * width]
        return found.reshape(-1, width) if width > 1 else found

    def cell_values(self, value: Any) -> Array:
        """Values of an expression of DG0 functions in the owned cells."""
        w = ufl.TestFunction(self.vectors if value.ufl_shape else self.scalars)
        volume = self.cells.volume[: self.cells.owned]
        found = self.assembled(ufl.inner(value, w) * self.dx)
        return found / volume.reshape(-1, *(1,) * (found.ndim - 1))

    def values(self, face: Face, *parts: str) -> Array:
        """Values of an expression on inner faces and parts of the boundary, all without a name.

        They are its moments with the functions of H(div) that have one unit of flux.
        """
        q = ufl.TestFunction(self.fluxes)
        unit = Face.of(ufl.dot, Face(q("+"), q), self.normal)
        form = face.inner * unit.inner * self.dS + face.edge * unit.edge * self.ds(*parts)
        found = fem.assemble_vector(compile_form(form)).array
        return found[self._numbers] * self._sign

    # -- operators -----------------------------------------------------------------------------

    def ds(self, *parts: str) -> ufl.Measure:
        """Measure of parts of the boundary, of all of it without a name."""
        return self._ds(tuple(PARTS.index(part) + 1 for part in parts or PARTS))

    def mean(self, q: Any) -> Face:
        """Values of cells interpolated to faces; that of the cell on the boundary."""
        return Face(self._share * q("+") + (1 - self._share) * q("-"), q)

    def in_series(self, q: Any) -> Face:
        """Conductivities of both halves of the way across faces, one behind the other."""
        resistance = (1 - self._share) * q("-") + self._share * q("+")
        return Face(q("+") * q("-") / ufl.max_value(resistance, SMALLEST), q)

    def rise(self, q: Any, outside: Any = None) -> Face:
        """Difference across faces; on the boundary none, or that to a value outside."""
        return Face(q("-") - q("+"), 0 * q if outside is None else outside - q)

    def out(self, flux: Face, w: Any, *parts: str) -> ufl.Form:
        """Sum of a flux over the inner faces of each cell, and over those of parts."""
        found = ufl.inner(flux.inner, w("+") - w("-")) * self.dS
        return found + ufl.inner(flux.edge, w) * self.ds(*parts) if parts else found

    def both(self, value: Face, w: Any, *parts: str) -> ufl.Form:
        """The same of what enters the equations of both cells with one sign."""
        found = ufl.inner(value.inner, w("+") + w("-")) * self.dS
        return found + ufl.inner(value.edge, w) * self.ds(*parts) if parts else found

    def least_squares(self, u: Any, v: Any, counts: tuple[Any, Any] = (1, 1)) -> ufl.Form:
        """Normal components of a vector of each cell on its faces but those of the inlet.

            int c (u.n)(v.n)

        counts : c of the sides "+" and "-" of inner faces
        """
        n, (ahead, back) = self.normal, counts
        plus = ufl.dot(u("+"), n.inner) * ufl.dot(v("+"), n.inner)
        minus = ufl.dot(u("-"), n.inner) * ufl.dot(v("-"), n.inner)
        edge = ufl.dot(u, n.edge) * ufl.dot(v, n.edge)
        return (ahead * plus + back * minus) * self.dS + edge * self.ds(*PARTS[1:])

    def least_squares_of(
        self, normal: Face, v: Any, *parts: str, counts: tuple[Any, Any] = (1, 1)
    ) -> ufl.Form:
        """Right-hand side of `least_squares`, of components that vanish on all but some parts."""
        n, (ahead, back) = self.normal, counts
        plus, minus = ufl.dot(v("+"), n.inner), ufl.dot(v("-"), n.inner)
        found = normal.inner * (ahead * plus + back * minus) * self.dS
        return found + normal.edge * ufl.dot(v, n.edge) * self.ds(*parts) if parts else found

    def gradient(self, g: Any, v: Any) -> ufl.Form:
        """Normal equations of the gradient g of a scalar by least squares over the neighbours.

        sum over the inner faces of (d.g)(d.v)/|d|^2
        """
        d = self.delta.inner
        both = sum(ufl.dot(d, g(s)) * ufl.dot(d, v(s)) for s in "+-")
        return both / (ufl.dot(d, d) * self.face_area.inner) * self.dS

    def gradient_of(self, q: Any, v: Any) -> ufl.Form:
        """Right-hand side of `gradient`, of values of cells."""
        d, rise = self.delta.inner, self.rise(q).inner
        both = rise * (ufl.dot(d, v("+")) + ufl.dot(d, v("-")))
        return both / (ufl.dot(d, d) * self.face_area.inner) * self.dS

    def at_sides(self, gradient: Any, opposite: tuple[Any, Any], v: Any) -> ufl.Form:
        """What the linear values of a gradient add to it in the cells beside impermeable faces.

            sum over opposite faces of (q - q_2) min(1, |q|/(2 |q - q_2|)) n,   q = n.grad u

        with q_2 of the cell across them.

        opposite : 1 on faces whose cell "+" or "-" has an impermeable one opposite to them, else 0
        v : tensor of a cell
        """
        n, found = self.normal.inner, 0
        for side, other, here in zip("+-", "-+", opposite, strict=True):
            slope = ufl.dot(gradient(side), n)
            change = slope - ufl.dot(gradient(other), n)
            size, most = (ufl.sqrt(ufl.dot(q, q)) for q in (change, slope))
            share = ufl.min_value(1, MOST_CHANGE * most / ufl.max_value(size, SMALLEST))
            added = here * share * ufl.inner(ufl.outer(change, n), v(side))
            found += added / self.face_area.inner * self.dS
        return found


def larger(a: Any, b: Any) -> Face:
    """The larger of two values on faces."""
    return Face.of(ufl.max_value, a, b)

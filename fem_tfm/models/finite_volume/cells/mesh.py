# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cells and faces of a mesh: what a conservative scheme with one value a cell needs.

A scheme of this kind is the lowest discontinuous Galerkin space with upwind facet terms, written
out over flat arrays: one product with a sparse matrix takes fluxes to cells. The tests hold it
against the facet forms that it writes out. Nothing here knows physics.

Arrays over cells hold the owned cells and then the ghosts; arrays over faces hold the inner faces
and then those of the boundary, part by part. A flux is positive from the first cell of a face to
the second, and out of the domain on the boundary.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import dolfinx.la
import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse
import ufl
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc

from fem_tfm.fenics import compile_form
from fem_tfm.geometry.mesh import Mesh

type Array = npt.NDArray[np.float64]


class Cells:
    """Geometry and connections of the cells of a 3D mesh, and what they do to arrays.

    Parameters
    ----------
    mesh : three-dimensional, every boundary facet tagged, with ghosts across facets in parallel
    parts : names of the boundary's parts in the order of their faces

    Attributes
    ----------
    owned, count : cells of this rank, and with its ghosts
    volume (count), centre (count, 3)
    inner_count, face_count : inner faces, and with those of the boundary
    first, second : cells of the inner faces; `first` goes on with the cells of the boundary
    area (faces, 3) : vector from the first cell to the second, or outwards
    face_area (faces) : its length
    face_centre (faces, 3) : centre of the face
    delta (faces, 3) : d, from the centre of the first cell to that of the second or to the face
    face_weight (faces) : |S|^2/(S.d), the weight of a difference in a diffusive flux [m]
    non_orthogonal (faces, 3) : S - d |S|^2/(S.d), what that difference misses
    interpolation_weight (inner) : weight of the first cell in a value interpolated to the face
    parts : slice of each part of the boundary in an array over faces
    """

    def __init__(self, mesh: Mesh, parts: Sequence[str]) -> None:
        self.mesh = mesh
        self.comm = mesh.mesh.comm
        topology = mesh.mesh.topology
        self.map = topology.index_map(3)
        self.owned = self.map.size_local
        self.count = self.owned + self.map.num_ghosts
        self._vectors: dict[int, dolfinx.la.Vector] = {}
        self._measure_cells()
        self._connect(parts)
        self._measure_faces()
        self._build()

    # -- geometry ------------------------------------------------------------------------------

    def _measure_cells(self) -> None:
        """Volumes and centres by quadrature."""
        domain = self.mesh.mesh
        space = fem.functionspace(domain, ("DG", 0))
        w, x = ufl.TestFunction(space), ufl.SpatialCoordinate(domain)
        dx = ufl.dx(domain, metadata={"quadrature_degree": 4})

        def cellwise(integrand: ufl.core.expr.Expr) -> Array:
            found = fem.assemble_vector(compile_form(integrand * w * dx))
            found.scatter_forward()
            return found.array.copy()

        one = fem.Constant(domain, PETSc.ScalarType(1))
        self.volume = cellwise(one)
        self.centre = np.stack([cellwise(x[i]) for i in range(3)], axis=1) / self.volume[:, None]

    def _connect(self, parts: Sequence[str]) -> None:
        topology = self.mesh.mesh.topology
        topology.create_connectivity(2, 3)
        topology.create_connectivity(3, 2)
        links = topology.connectivity(2, 3)
        number = np.diff(links.offsets)
        inner = np.flatnonzero(number == 2)
        pair = links.array[links.offsets[inner][:, None] + np.arange(2)]
        # a face between two ghosts belongs to other ranks
        ours = (pair < self.owned).any(axis=1)
        inner, pair = inner[ours], pair[ours]
        facets, cells, self.parts, begin = [inner], [pair[:, 0]], {}, inner.size
        for name in parts:
            found = self.mesh.facets(name)
            cell = links.array[links.offsets[found]]
            found, cell = found[cell < self.owned], cell[cell < self.owned]
            self.parts[name] = slice(begin, begin + found.size)
            begin += found.size
            facets.append(found)
            cells.append(cell)
        self.inner_count = inner.size
        self.facets = np.concatenate(facets).astype(np.int32)
        # numpy takes values by its own kind of integers twice as fast
        self.first = np.concatenate(cells).astype(np.intp)
        self.second = pair[:, 1].astype(np.intp)
        self.face_count = self.facets.size

    def _measure_faces(self) -> None:
        """Area vectors from the corners, which close every cell exactly, and weights."""
        domain = self.mesh.mesh
        domain.topology.create_connectivity(2, 0)
        corners = domain.topology.connectivity(2, 0)
        many = int(np.diff(corners.offsets).max(initial=3))
        begins = corners.offsets[self.facets]
        points = self._points(corners.array[begins[:, None] + np.arange(many)])
        if many == 4:
            # corners of a tensor-product face: 0-1-3-2 runs around it
            a, b = points[:, 3] - points[:, 0], points[:, 2] - points[:, 1]
            area = np.cross(a, b) / 2
        else:
            area = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]) / 2
        self.face_centre = points.mean(axis=1)
        outward = self.face_centre - self.centre[self.first]
        area[np.einsum("ij,ij->i", area, outward) < 0] *= -1
        # by component: so a part of one lies in one piece
        self.area, self.face_area = np.asfortranarray(area), np.linalg.norm(area, axis=1)
        there = np.concatenate([self.centre[self.second], self.face_centre[self.inner_count :]])
        self.delta = there - self.centre[self.first]
        along = np.einsum("ij,ij->i", area, self.delta)
        self.face_weight = self.face_area**2 / along
        away = np.einsum(
            "ij,ij->i", area[: self.inner_count], (there - self.face_centre)[: self.inner_count]
        )
        self.interpolation_weight = np.clip(away / along[: self.inner_count], 0.05, 0.95)
        self.non_orthogonal = np.asfortranarray(area - self.face_weight[:, None] * self.delta)

    @cached_property
    def ways(self) -> tuple[Array, Array, Array]:
        """From cell to cell, and from either to the middle of the inner faces; by component."""
        middle = self.face_centre[: self.inner_count]
        first, second = self.centre[self.first[: self.inner_count]], self.centre[self.second]
        ways = second - first, middle - first, middle - second
        along, ahead, back = (np.ascontiguousarray(way.T) for way in ways)
        return along, ahead, back

    def _points(self, vertices: npt.NDArray[np.int32]) -> Array:
        """Coordinates of vertices."""
        domain = self.mesh.mesh
        domain.topology.create_connectivity(0, 3)
        local = np.unique(vertices)
        found = dolfinx.mesh.entities_to_geometry(domain, 0, local.astype(np.int32))
        place = np.zeros(int(local.max(initial=0)) + 1, dtype=np.int64)
        place[local] = np.asarray(found).ravel()
        return domain.geometry.x[place[vertices]]

    # -- operators -----------------------------------------------------------------------------

    def _build(self) -> None:
        inner = np.arange(self.inner_count)
        first, second = self.first[: self.inner_count], self.second
        mine, yours = first < self.owned, second < self.owned
        edge = np.arange(self.inner_count, self.face_count)
        rows = [first[mine], second[yours], self.first[self.inner_count :]]
        columns = [inner[mine], inner[yours], edge]
        signs = [np.ones(mine.sum()), -np.ones(yours.sum()), np.ones(edge.size)]
        shape = (self.owned, self.face_count)
        place = np.concatenate(rows), np.concatenate(columns)
        sign = np.concatenate(signs)
        ones = sign > 0
        self._from_first = sparse.csr_array(
            (sign[ones], (place[0][ones], place[1][ones])), shape=shape
        )
        self._from_second = sparse.csr_array(
            (-sign[~ones], (place[0][~ones], place[1][~ones])), shape=shape
        )
        # what a face takes from its two sides
        self._mean = sparse.csr_array(
            (
                np.concatenate(
                    [self.interpolation_weight, 1 - self.interpolation_weight, np.ones(edge.size)]
                ),
                (
                    np.concatenate([inner, inner, edge]),
                    np.concatenate([first, second, self.first[self.inner_count :]]),
                ),
            ),
            shape=(self.face_count, self.count),
        )
        # vectors interpolated and projected at once
        along = [sparse.diags_array(self.area[:, i]) @ self._mean for i in range(3)]
        corner = [sparse.csr_array(np.eye(3)[i : i + 1]) for i in range(3)]
        parts = (sparse.kron(part, one) for part, one in zip(along, corner, strict=True))
        self._flux = sparse.csr_array(sum(parts))
        self._gradient = self._least_squares(mine, yours)
        for name in ("_from_first", "_from_second", "_mean", "_flux", "_gradient"):
            setattr(self, name, narrow(getattr(self, name)))

    def _least_squares(self, mine: Array, yours: Array) -> sparse.csr_array:
        """Gradient in owned cells, exact for a linear field whatever the shape of the cells."""
        first, second = self.first[: self.inner_count], self.second
        away = self.delta[: self.inner_count]
        weight = 1 / np.einsum("ij,ij->i", away, away)
        here = np.concatenate([first[mine], second[yours]])
        there = np.concatenate([second[mine], first[yours]])
        away = np.concatenate([away[mine], -away[yours]])
        weight = np.concatenate([weight[mine], weight[yours]])
        products = np.zeros((self.owned, 3, 3))
        np.add.at(products, here, weight[:, None, None] * away[:, :, None] * away[:, None, :])
        # a direction without neighbours has no gradient
        inverse = np.linalg.pinv(products, rcond=1e-8, hermitian=True)
        row = np.einsum("nij,nj->ni", inverse[here], weight[:, None] * away)
        shape = (self.owned, self.count)
        parts = []
        for i in range(3):
            ahead = sparse.csr_array((row[:, i], (here, there)), shape=shape)
            back = sparse.csr_array((row[:, i], (here, here)), shape=shape)
            parts.append(ahead - back)
        return sparse.csr_array(sparse.vstack(parts))

    def net_flux(self, flux: Array) -> Array:
        """What leaves each owned cell through its faces."""
        return self._from_first @ flux - self._from_second @ flux

    def sum_by_side(self, ahead: Array, back: Array) -> Array:
        """What leaves each owned cell: `ahead` from first cells, `back` from second ones."""
        return self._from_first @ ahead + self._from_second @ back

    def sum_faces(self, values: Array) -> Array:
        """Sum of the values of each owned cell's faces, without their direction."""
        return self.sum_by_side(values, values)

    def to_faces(self, values: Array) -> Array:
        """Values on the faces, interpolated; those of the cell itself on the boundary."""
        return self._mean @ values

    def flux(self, vectors: Array) -> Array:
        """Flux through the faces of vectors (count, 3), interpolated as by `to_faces`."""
        return self._flux @ vectors.ravel()

    def gradient(self, values: Array) -> Array:
        """Gradient in the owned cells by least squares over their neighbours, (owned, ..., 3)."""
        found = (self._gradient @ values).reshape(3, self.owned, *values.shape[1:])
        return np.moveaxis(found, 0, -1)

    def add_boundary(self, part: str, values: Array, faces: Array) -> Array:
        """Add to `values` over owned cells what the faces of one part give, and return them."""
        np.add.at(values, self.first[self.parts[part]], faces)
        return values

    def faces_by_cell(self, values: Array, directed: bool = True) -> Array:
        """Values on faces as the owned cells see them, (owned, facets of a cell).

        A flux is positive out of the cell. In this shape it can be handed to any other rank.
        """
        place, sign = self._sides()
        found = values[place]
        return found * sign if directed else found

    def from_faces_by_cell(self, sides: Array, directed: bool = True) -> Array:
        """Values on faces from what `faces_by_cell` gave."""
        place, sign = self._sides()
        found = np.empty(self.face_count)
        found[place] = sides * sign if directed else sides
        return found

    def _sides(self) -> tuple[npt.NDArray[np.int64], Array]:
        """Face and direction of each facet of the owned cells."""
        topology = self.mesh.mesh.topology
        links = topology.connectivity(3, 2)
        many = int(links.offsets[1]) if self.count else 0
        facets = links.array[: self.owned * many].reshape(self.owned, many)
        face = np.full(topology.index_map(2).size_local + topology.index_map(2).num_ghosts, -1)
        face[self.facets] = np.arange(self.face_count)
        place = face[facets]
        ahead = self.first[place] == np.arange(self.owned)[:, None]
        return place, np.where(ahead, 1.0, -1.0)

    def update_ghosts(self, values: Array) -> Array:
        """Give the ghosts the values of their owners, in place (collective)."""
        if self.comm.size == 1:
            return values
        width = int(np.prod(values.shape[1:], dtype=int))
        if width not in self._vectors:
            self._vectors[width] = dolfinx.la.vector(self.map, width)
        vector = self._vectors[width]
        vector.array[: self.owned * width] = values[: self.owned].ravel()
        vector.scatter_forward()
        values[self.owned :] = vector.array[self.owned * width :].reshape(
            values[self.owned :].shape
        )
        return values

    def ghosted(self, owned: Array) -> Array:
        """An array over all local cells from that over the owned ones (collective)."""
        found = np.empty((self.count, *owned.shape[1:]))
        found[: self.owned] = owned
        return self.update_ghosts(found)

    def total(self, owned: Array | float) -> float:
        """Sum over all ranks (collective)."""
        return float(self.comm.allreduce(float(np.sum(owned))))

    def largest(self, owned: Array | float) -> float:
        """Maximum over all ranks (collective)."""
        value = float(np.max(owned, initial=-np.inf))
        # a value that is not finite must not be lost by a comparison
        broken = self.comm.allreduce(int(np.isnan(value)))
        return float("nan") if broken else float(self.comm.allreduce(value, MPI.MAX))


def narrow(matrix: sparse.csr_array) -> sparse.csr_array:
    """The same matrix with indices of four bytes, which take half the memory."""
    index = (part.astype(np.int32) for part in (matrix.indices, matrix.indptr))
    return sparse.csr_array((matrix.data, *index), shape=matrix.shape)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cells and faces of a mesh, and the operators of a cell-centred finite-volume scheme.

The scheme is the lowest discontinuous Galerkin space with upwind facet terms, written out over flat
arrays: products with sparse matrices sum fluxes over the faces of cells. The tests compare it with
the facet forms. This module knows no physics.

Arrays over cells contain the owned cells and then the ghosts; arrays over faces contain the inner
faces and then those of the boundary, part by part. A flux is positive from the first cell of a face
to the second, and out of the domain on the boundary.
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

# keeps quotients of conductivities finite
SMALLEST = 1e-300

type Array = npt.NDArray[np.float64]
type Index = npt.NDArray[np.integer]


class Cells:
    """Geometry, connectivity and operators of the cells of a 3D mesh.

    Parameters
    ----------
    mesh : three-dimensional, every boundary facet tagged, with ghosts across facets in parallel
    parts : names of the boundary's parts in the order of their faces

    Attributes
    ----------
    owned, count : number of cells of this rank, and with its ghosts
    volume (count) : [m3]
    centre (count, 3) : [m]
    inner_count, face_count : number of inner faces, and with those of the boundary
    first, second : cells of the inner faces; `first` continues with the cells of the boundary
    area (faces, 3) : area vector S, from the first cell to the second or outwards [m2]
    face_area (faces) : |S| [m2]
    face_centre (faces, 3) : [m]
    delta (faces, 3) : d, from the centre of the first cell to that of the second or to the face [m]
    face_weight (faces) : |S|^2/(S.d), factor of the difference in a diffusive flux [m]
    non_orthogonal (faces, 3) : S - d |S|^2/(S.d), the part of S without that difference [m2]
    interpolation_weight (inner) : weight of the first cell in a value interpolated to the face [-]
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

        one = fem.Constant(domain, np.asarray(1, dtype=PETSc.ScalarType))
        self.volume = cellwise(one)
        self.centre = np.stack([cellwise(x[i]) for i in range(3)], axis=1) / self.volume[:, None]

    def _connect(self, parts: Sequence[str]) -> None:
        """Number the faces: inner ones with an owned cell, then those of each boundary part."""
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
        # numpy gathers by its native integers twice as fast
        self.first = np.concatenate(cells).astype(np.intp)
        self.second = pair[:, 1].astype(np.intp)
        self.face_count = self.facets.size

    def _measure_faces(self) -> None:
        """Area vectors from the corners, so that every cell is closed exactly, and weights."""
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
        # in Fortran order, so that each component is contiguous
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
    def inner_vectors(self) -> tuple[Array, Array, Array]:
        """Vectors (3, inner) from the first cell to the second, and from either to the face [m]."""
        middle = self.face_centre[: self.inner_count]
        first, second = self.centre[self.first[: self.inner_count]], self.centre[self.second]
        vectors = second - first, middle - first, middle - second
        across, from_first, from_second = (np.ascontiguousarray(one.T) for one in vectors)
        return across, from_first, from_second

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
        """The operators as sparse matrices."""
        faces = np.arange(self.face_count)
        inner, second = faces[: self.inner_count], self.second
        shape = (self.owned, self.face_count)
        self.from_first, self.from_second = (
            narrow(sparse.csr_array((np.ones(ours.sum()), (cell[ours], face[ours])), shape=shape))
            for cell, face, ours in (
                (self.first, faces, self.first < self.owned),
                (second, inner, second < self.owned),
            )
        )
        weight = np.ones(self.face_count)
        weight[inner] = self.interpolation_weight
        weights = np.concatenate([weight, 1 - self.interpolation_weight])
        places = np.concatenate([faces, inner]), np.concatenate([self.first, second])
        mean = sparse.csr_array((weights, places), shape=(self.face_count, self.count))
        # vectors are interpolated and projected at once
        projected = [sparse.diags_array(self.area[:, i]) @ mean for i in range(3)]
        component = [sparse.csr_array(np.eye(3)[i : i + 1]) for i in range(3)]
        parts = (sparse.kron(part, one) for part, one in zip(projected, component, strict=True))
        self._mean, self._flux = narrow(mean), narrow(sparse.csr_array(sum(parts)))
        self._gradient = narrow(self._least_squares())

    def _least_squares(self) -> sparse.csr_array:
        """Gradient in owned cells, exact for a linear field whatever the shape of the cells."""
        first, second = self.first[: self.inner_count], self.second
        mine, yours = first < self.owned, second < self.owned
        away = self.delta[: self.inner_count]
        weight = 1 / np.einsum("ij,ij->i", away, away)
        here = np.concatenate([first[mine], second[yours]])
        there = np.concatenate([second[mine], first[yours]])
        away = np.concatenate([away[mine], -away[yours]])
        weight = np.concatenate([weight[mine], weight[yours]])
        products = np.zeros((self.owned, 3, 3))
        np.add.at(products, here, weight[:, None, None] * away[:, :, None] * away[:, None, :])
        # the gradient along a direction without neighbours is zero
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
        """Sum of the fluxes out of each owned cell."""
        return self.from_first @ flux - self.from_second @ flux

    def sum_by_side(self, ahead: Array, back: Array) -> Array:
        """Sum over the faces of each owned cell: of `ahead` for first cells, `back` for second."""
        return self.from_first @ ahead + self.from_second @ back

    def sum_faces(self, values: Array) -> Array:
        """Sum of the values on the faces of each owned cell."""
        return self.sum_by_side(values, values)

    def to_faces(self, values: Array) -> Array:
        """Values interpolated to the faces; that of the cell on the boundary."""
        return self._mean @ values

    def in_series(self, values: Array) -> Array:
        """Conductivities >= 0 of both halves of the way across faces, one behind the other.

            1/k = (1 - w)/k_first + w/k_second,   w the weight of the first cell by `to_faces`

        What one side does not conduct the other cannot pass on: a void holds no stress of a bed.
        """
        first, second = values.take(self.first), values.take(self.second)
        n = self.inner_count
        share, here = self.interpolation_weight, first[:n]
        first[:n] *= second / np.maximum((1 - share) * second + share * here, SMALLEST)
        return first

    def flux(self, vectors: Array) -> Array:
        """Flux through the faces of vectors (count, 3), interpolated as by `to_faces`."""
        return self._flux @ vectors.ravel()

    def gradient(self, values: Array) -> Array:
        """Gradient in the owned cells by least squares over their neighbours, (owned, ..., 3)."""
        found = (self._gradient @ values).reshape(3, self.owned, *values.shape[1:])
        return np.moveaxis(found, 0, -1)

    def extrapolation(self, part: slice) -> sparse.csr_array:
        """Matrix of the linear values of cells on the faces of the boundary in `part`.

        q + g.(x - c),  g by `gradient`
        """
        cell, delta = self.first[part], self.delta[part]
        number = cell.size
        here = sparse.csr_array((np.ones(number), (np.arange(number), cell)), (number, self.count))
        slopes = (
            sparse.diags_array(delta[:, i]) @ self._gradient[i * self.owned + cell]
            for i in range(3)
        )
        return narrow(sparse.csr_array(sum(slopes, here)))

    def add_boundary(self, part: str, values: Array, faces: Array) -> Array:
        """Add values on the faces of one part to `values` of their cells, and return these."""
        np.add.at(values, self.first[self.parts[part]], faces)
        return values

    def faces_by_cell(self, values: Array, directed: bool = True) -> Array:
        """Values on the faces of each owned cell, (owned, facets of a cell).

        A `directed` value, such as a flux, is positive out of the cell. In this shape values can be
        given to any other partition of the mesh.
        """
        place, sign = self._sides()
        found = values[place]
        return found * sign if directed else found

    def from_faces_by_cell(self, sides: Array, directed: bool = True) -> Array:
        """Values on faces from those of `faces_by_cell`."""
        place, sign = self._sides()
        found = np.empty(self.face_count)
        found[place] = sides * sign if directed else sides
        return found

    def _sides(self) -> tuple[npt.NDArray[np.int64], Array]:
        """Face of each facet of the owned cells, and 1, or -1 where the cell is its second."""
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
        """Copy the owners' values to the ghosts, in place (collective)."""
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
        """An array over owned cells extended by the ghosts (collective)."""
        found = np.empty((self.count, *owned.shape[1:]))
        found[: self.owned] = owned
        return self.update_ghosts(found)

    def total(self, owned: Array | float) -> float:
        """Sum over all ranks (collective)."""
        return float(self.comm.allreduce(float(np.sum(owned))))

    def largest(self, owned: Array | float) -> float:
        """Maximum over all ranks (collective)."""
        value = float(np.max(owned, initial=-np.inf))
        # comparisons with nan would lose it
        broken = self.comm.allreduce(int(np.isnan(value)))
        return float("nan") if broken else float(self.comm.allreduce(value, MPI.MAX))


def narrow(matrix: sparse.csr_array) -> sparse.csr_array:
    """The same matrix with indices of four bytes, which take half the memory."""
    index = (part.astype(np.int32) for part in (matrix.indices, matrix.indptr))
    return sparse.csr_array((matrix.data, *index), shape=matrix.shape)

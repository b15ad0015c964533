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

import itertools
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

from fem_tfm.errors import SolverError
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
    first, second : cells of the inner faces; `first` goes on with the cells of the boundary
    area (faces, 3) : vector from the first cell to the second, or outwards
    size (faces) : its length
    middle (faces, 3) : centre of the face
    apart (faces, 3) : d, from the centre of the first cell to that of the second or to the face
    reach (faces) : |S|^2/(S.d), the weight of a difference in a diffusive flux [m]
    skew (faces, 3) : S - d |S|^2/(S.d), what that difference misses
    share (inner) : weight of the first cell in a value interpolated to the face
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
        self.inner = inner.size
        self.facets = np.concatenate(facets).astype(np.int32)
        # numpy takes values by its own kind of integers twice as fast
        self.first = np.concatenate(cells).astype(np.intp)
        self.second = pair[:, 1].astype(np.intp)
        self.faces = self.facets.size

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
        self.middle = points.mean(axis=1)
        outward = self.middle - self.centre[self.first]
        area[np.einsum("ij,ij->i", area, outward) < 0] *= -1
        # by component: so a part of one lies in one piece
        self.area, self.size = np.asfortranarray(area), np.linalg.norm(area, axis=1)
        there = np.concatenate([self.centre[self.second], self.middle[self.inner :]])
        self.apart = there - self.centre[self.first]
        along = np.einsum("ij,ij->i", area, self.apart)
        self.reach = self.size**2 / along
        away = np.einsum("ij,ij->i", area[: self.inner], (there - self.middle)[: self.inner])
        self.share = np.clip(away / along[: self.inner], 0.05, 0.95)
        self.skew = np.asfortranarray(area - self.reach[:, None] * self.apart)

    @cached_property
    def _ways(self) -> tuple[Array, Array, Array]:
        """From cell to cell, and from either to the middle of the inner faces; by component."""
        middle = self.middle[: self.inner]
        first, second = self.centre[self.first[: self.inner]], self.centre[self.second]
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
        inner = np.arange(self.inner)
        first, second = self.first[: self.inner], self.second
        mine, yours = first < self.owned, second < self.owned
        edge = np.arange(self.inner, self.faces)
        rows = [first[mine], second[yours], self.first[self.inner :]]
        columns = [inner[mine], inner[yours], edge]
        signs = [np.ones(mine.sum()), -np.ones(yours.sum()), np.ones(edge.size)]
        shape = (self.owned, self.faces)
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
                np.concatenate([self.share, 1 - self.share, np.ones(edge.size)]),
                (
                    np.concatenate([inner, inner, edge]),
                    np.concatenate([first, second, self.first[self.inner :]]),
                ),
            ),
            shape=(self.faces, self.count),
        )
        # vectors interpolated and projected at once
        along = [sparse.diags_array(self.area[:, i]) @ self._mean for i in range(3)]
        corner = [sparse.csr_array(np.eye(3)[i : i + 1]) for i in range(3)]
        parts = (sparse.kron(part, one) for part, one in zip(along, corner, strict=True))
        self._flux = sparse.csr_array(sum(parts))
        self._gradient = self._least_squares(mine, yours)
        for name in ("_from_first", "_from_second", "_mean", "_flux", "_gradient"):
            setattr(self, name, _narrow(getattr(self, name)))

    def _least_squares(self, mine: Array, yours: Array) -> sparse.csr_array:
        """Gradient in owned cells, exact for a linear field whatever the shape of the cells."""
        first, second = self.first[: self.inner], self.second
        away = self.apart[: self.inner]
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

    def sum(self, flux: Array) -> Array:
        """What leaves each owned cell through its faces."""
        return self._from_first @ flux - self._from_second @ flux

    def sum_out(self, ahead: Array, back: Array) -> Array:
        """What leaves each owned cell: `ahead` from first cells, `back` from second ones."""
        return self._from_first @ ahead + self._from_second @ back

    def add(self, values: Array) -> Array:
        """Sum of the values of each owned cell's faces, without their direction."""
        return self.sum_out(values, values)

    def mean(self, values: Array) -> Array:
        """Values on the faces, interpolated; those of the cell itself on the boundary."""
        return self._mean @ values

    def flux(self, vectors: Array) -> Array:
        """Flux through the faces of vectors (count, 3), interpolated as by `mean`."""
        return self._flux @ vectors.ravel()

    def gradient(self, values: Array) -> Array:
        """Gradient in the owned cells by least squares over their neighbours, (owned, ..., 3)."""
        found = (self._gradient @ values).reshape(3, self.owned, *values.shape[1:])
        return np.moveaxis(found, 0, -1)

    def rise(self, values: Array, gradient: Array, small: Array | float) -> tuple[Array, Array]:
        """What values on the inner faces have beyond those of the first and of the second cell.

        Linear in each cell, and limited where differences across and upwind of a face disagree:

            rise = psi g.(x_face - x_cell),  psi = max(0, 2 (a.b + e^2)/(a.a + b.b + 2 e^2))

        with b the difference across the face and a = 2 g.d - b that behind the cell. Smooth values,
        for which a and b agree, keep their slope, also at extrema that are flatter than e.

        values (count, ...) : of a scalar or a vector, which has one psi
        gradient (count, ..., 3) : g
        small (inner) : e, in the unit of the values

        Source: van Albada, van Leer and Roberts (1982), Astron. Astrophys. 108, 76-84.
        """
        first, second = self.first[: self.inner], self.second
        # component by component: these arrays are the largest of a step
        parts = values.reshape(self.count, -1).T
        slopes = np.ascontiguousarray(gradient.reshape(self.count, -1, 3).transpose(1, 2, 0))
        across = [part[second] - part[first] for part in parts]
        size = sum(b * b for b in across) + 2 * np.square(small)
        (apart, *ways), found = self._ways, []
        for cell, way in zip((first, second), ways, strict=True):
            slope = [[g[cell] for g in part] for part in slopes]
            behind = [
                2 * sum(g * d for g, d in zip(part, apart, strict=True)) - b
                for part, b in zip(slope, across, strict=True)
            ]
            agree = sum(a * b for a, b in zip(behind, across, strict=True)) + np.square(small)
            size_behind = sum(a * a for a in behind)
            psi = 2 * np.maximum(agree, 0.0) / np.maximum(size + size_behind, 1e-300)
            rise = [psi * sum(g * d for g, d in zip(part, way, strict=True)) for part in slope]
            found.append(np.stack(rise, axis=1).reshape(-1, *values.shape[1:]))
        ahead, back = found
        return ahead, back

    def within(self, flux: Array, loss: Array, gain: Array) -> Array:
        """Fluxes that are reduced until no cell loses or gains too much by them (collective).

        Each is taken times the smaller of the shares that its two cells allow, so that what one
        cell loses another gains.

        flux (faces) : what is carried through faces
        loss, gain (owned) : most that the sum over a cell's outgoing and incoming fluxes may be

        Source: Zalesak (1979), J. Comput. Phys. 31, 335-362.
        """
        ahead, back = np.maximum(flux, 0.0), np.maximum(-flux, 0.0)
        shares = []
        for most, carried in (
            (loss, self.sum_out(ahead, back)),
            (gain, self.sum_out(back, ahead)),
        ):
            share = np.minimum(1.0, most / np.maximum(carried, 1e-300))
            shares.append(self.whole(np.maximum(share, 0.0)))
        leave, enter = shares
        first, second, inner = self.first, self.second, slice(0, self.inner)
        share = np.where(flux > 0, leave[first], enter[first])
        other = np.where(flux[inner] > 0, enter[second], leave[second])
        share[inner] = np.minimum(share[inner], other)
        return share * flux

    def to_boundary(self, part: str, values: Array, faces: Array) -> Array:
        """Add to `values` over owned cells what the faces of one part give, and return them."""
        np.add.at(values, self.first[self.parts[part]], faces)
        return values

    def reconstruction(self, without: Sequence[str]) -> Reconstruction:
        """From normal components on faces to vectors in cells."""
        return Reconstruction(self, without)

    def to_sides(self, values: Array, directed: bool = True) -> Array:
        """Values on faces as the owned cells see them, (owned, facets of a cell).

        A flux is positive out of the cell. In this shape it can be handed to any other rank.
        """
        place, sign = self._sides()
        found = values[place]
        return found * sign if directed else found

    def from_sides(self, sides: Array, directed: bool = True) -> Array:
        """Values on faces from what `to_sides` gave."""
        place, sign = self._sides()
        found = np.empty(self.faces)
        found[place] = sides * sign if directed else sides
        return found

    def _sides(self) -> tuple[npt.NDArray[np.int64], Array]:
        """Face and direction of each facet of the owned cells."""
        topology = self.mesh.mesh.topology
        links = topology.connectivity(3, 2)
        many = int(links.offsets[1]) if self.count else 0
        facets = links.array[: self.owned * many].reshape(self.owned, many)
        face = np.full(topology.index_map(2).size_local + topology.index_map(2).num_ghosts, -1)
        face[self.facets] = np.arange(self.faces)
        place = face[facets]
        ahead = self.first[place] == np.arange(self.owned)[:, None]
        return place, np.where(ahead, 1.0, -1.0)

    def exchange(self, values: Array) -> Array:
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

    def whole(self, owned: Array) -> Array:
        """An array over all local cells from that over the owned ones (collective)."""
        found = np.empty((self.count, *owned.shape[1:]))
        found[: self.owned] = owned
        return self.exchange(found)

    def total(self, owned: Array | float) -> float:
        """Sum over all ranks (collective)."""
        return float(self.comm.allreduce(float(np.sum(owned))))

    def largest(self, owned: Array | float) -> float:
        """Maximum over all ranks (collective)."""
        value = float(np.max(owned, initial=-np.inf))
        # a value that is not finite must not be lost by a comparison
        broken = self.comm.allreduce(int(np.isnan(value)))
        return float("nan") if broken else float(self.comm.allreduce(value, MPI.MAX))


class Reconstruction:
    """Vectors in cells from normal components on their faces, by least squares.

    u = (sum c S S/|S|)^-1 sum c S u_n, exact for a uniform field; faces of the parts `without` are
    left out. c is one unless it is given.
    """

    def __init__(self, cells: Cells, without: Sequence[str]) -> None:
        used = np.ones(cells.faces)
        for name in without:
            used[cells.parts[name]] = 0.0
        weight = used / cells.size
        products = cells.area[:, :, None] * cells.area[:, None, :] * weight[:, None, None]
        matrix = cells.add(products.reshape(-1, 9)).reshape(-1, 3, 3)
        self._matrix, inverse = matrix, np.linalg.inv(matrix)
        # the same vector for both cells of a face: |S| n n.u summed without direction
        self._operator = []
        faces = cells._from_first + cells._from_second
        for i in range(3):
            part = 0
            for j in range(3):
                rows = sparse.diags_array(inverse[:, i, j])
                columns = sparse.diags_array(cells.area[:, j] * used)
                part = part + rows @ faces @ columns
            self._operator.append(sparse.csr_array(part))
        self._operator = _narrow(sparse.csr_array(sparse.vstack(self._operator)))
        self._cells = cells

    def __call__(
        self, normal: Array, less: tuple[npt.NDArray, npt.NDArray, Array] | None = None
    ) -> Array:
        """Vectors (owned, 3) from components along the area vectors (faces).

        less : inner faces with c < 1, on which side, 0 for the first cell, and c
        """
        found = (self._operator @ normal).reshape(3, -1).T
        if less is None:
            return found
        cells, (face, side, count) = self._cells, less
        cell = np.where(side, cells.second[face], cells.first[face])
        ours = cell < cells.owned
        if not ours.any():
            return found
        face, cell, lack = face[ours], cell[ours], 1 - count[ours]
        here, place = np.unique(cell, return_inverse=True)
        area = cells.area[face]
        along = area / cells.size[face, None]
        off = lack * (np.einsum("ni,ni->n", along, found[cell]) - normal[face])

        def gather(values: Array) -> Array:
            return np.bincount(place, values, here.size)

        rest = np.stack([gather(off * area[:, i]) for i in range(3)], axis=1)
        lost = np.empty((here.size, 3, 3))
        for i in range(3):
            for j in range(i + 1):
                lost[:, i, j] = lost[:, j, i] = gather(lack * area[:, i] * along[:, j])
        found[here] += _solved(self._matrix[here] - lost, rest)
        return found


def _narrow(matrix: sparse.csr_array) -> sparse.csr_array:
    """The same matrix with indices of four bytes, which take half the memory."""
    index = (part.astype(np.int32) for part in (matrix.indices, matrix.indptr))
    return sparse.csr_array((matrix.data, *index), shape=matrix.shape)


def _solved(matrix: Array, side: Array) -> Array:
    """Solutions (n, 3) of symmetric 3 x 3 systems by Cramer's rule."""
    a, b, c = matrix[:, 0], matrix[:, 1], matrix[:, 2]
    rows = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
    return np.einsum("nij,nj->ni", rows, side) / np.einsum("ni,ni->n", a, rows[:, 0])[:, None]


class CellMatrix:
    """Sparse matrix that couples each cell with the cells across its faces.

    width : unknowns in a cell; they couple with each other, and each with its own kind next door
    components : of a vector that each of them is
    tied : owned cells in which the components of an unknown couple
    """

    def __init__(
        self, cells: Cells, width: int = 1, components: int = 1, tied: Array | None = None
    ) -> None:
        self.cells, self.components = cells, components
        first, second = cells.first[: cells.inner], cells.second
        self._mine, self._yours = (
            # a slice costs nothing where there are no ghosts
            slice(None) if (cell < cells.owned).all() else np.flatnonzero(cell < cells.owned)
            for cell in (first, second)
        )
        rows, columns = [], []
        own, many = np.arange(cells.owned), width * components
        for start in range(0, many, width):
            for i in range(start, start + width):
                for j in range(start, start + width):
                    rows.append(own * many + i)
                    columns.append(own * many + j)
        for i in range(many):
            for a, b, mask in ((first, second, self._mine), (second, first, self._yours)):
                rows.append(a[mask] * many + i)
                columns.append(b[mask] * many + i)
        for i, j in itertools.permutations(range(components), 2):
            for k in range(width):
                rows.append(tied * many + i * width + k)
                columns.append(tied * many + j * width + k)
        self._assign(np.concatenate(rows), np.concatenate(columns), many)

    def _assign(self, rows: Array, columns: Array, many: int) -> None:
        """Give every entry its place in the arrays of the matrix, which PETSc shares."""
        cells = self.cells
        local = cells.owned * many
        self._blocks: list[tuple[Array, npt.NDArray[np.intp]]] = []
        parts = []
        for far in (False, True):
            # of each row from left to right, as an incomplete factorisation wants them
            order = np.flatnonzero((columns >= local) == far)
            order = order[np.lexsort((columns[order], rows[order]))]
            begins = np.searchsorted(rows[order], np.arange(local + 1))
            place = columns[order]
            if far:
                cell = cells.map.local_to_global((place // many).astype(np.int32))
                place = cell * many + place % many
            values = np.zeros(order.size)
            self._blocks.append((values, order))
            parts.append((begins.astype(PETSc.IntType), place.astype(PETSc.IntType), values))
        size = (local, cells.map.size_global * many)
        csr = parts[0] if cells.comm.size == 1 else tuple(parts)
        self.matrix = PETSc.Mat().createAIJWithArrays((size, size), csr, comm=cells.comm)

    def set(
        self,
        diagonal: Sequence[Array],
        across: Sequence[tuple[Array, Array]],
        ties: Sequence[Array] = (),
    ) -> None:
        """New values (collective).

        diagonal : for each component width^2 arrays over owned cells, row by row
        across : for each unknown, entries of the first cell's row and of the second's over inner
            faces, the same for all components
        ties : for each component and each other one, entries of each unknown over the tied cells
        """
        values = list(diagonal)
        for ahead, back in [*across] * self.components:
            values += [ahead[self._mine], back[self._yours]]
        entries = np.concatenate([*values, *ties])
        for block, order in self._blocks:
            np.take(entries, order, out=block, mode="clip")
        self.matrix.assemble()

    def destroy(self) -> None:
        """Free the matrix."""
        self.matrix.destroy()


class Krylov:
    """A Krylov solver of one CellMatrix, whose preconditioner follows the matrix or is kept.

    method : "transport" (BiCGStab, incomplete LU of each rank's part) or "pressure" (conjugate
        gradients, algebraic multigrid with Richardson and SOR smoothing)
    tolerance : of the residual over that of the right-hand side
    """

    def __init__(self, matrix: CellMatrix, method: str, tolerance: float) -> None:
        self.matrix, self._method, self._tolerance = matrix, method, tolerance
        self.x, self.b = matrix.matrix.createVecs()
        self.iterations = 0
        self._create()

    def _create(self) -> None:
        self.ksp = PETSc.KSP().create(self.matrix.cells.comm)
        self.ksp.setOperators(self.matrix.matrix)
        # parts of a preconditioner read their options when it is first set up: they stay
        prefix = f"fem_tfm_cells_{self._method}_"
        self.ksp.setOptionsPrefix(prefix)
        options = {
            "transport": {
                "ksp_type": "bcgs",
                "pc_type": "bjacobi",
                "sub_pc_type": "ilu",
                # pivots have units: a small one is a small cell
                "sub_pc_factor_zeropivot": 1e-100,
            },
            "pressure": {
                "ksp_type": "cg",
                "pc_type": "gamg",
                "mg_levels_ksp_type": "richardson",
                "mg_levels_ksp_max_it": 1,
                "mg_levels_pc_type": "sor",
                "pc_gamg_threshold": 0.02,
            },
        }[self._method]
        table = PETSc.Options()
        for key, value in options.items():
            table.setValue(prefix + key, value)
        # a multigrid of one level leaves some unread, which is no one's mistake
        table.setValue("options_left", "no")
        self.ksp.setInitialGuessNonzero(True)
        self.ksp.setTolerances(rtol=self._tolerance, atol=1e-50, max_it=300)
        self.ksp.setFromOptions()

    def renew(self, keep: bool = False) -> None:
        """The matrix has new values; `keep` the preconditioner of older ones."""
        self.ksp.setOperators(self.matrix.matrix)
        self.ksp.getPC().setReusePreconditioner(keep)

    def solve(self, rhs: Array, start: Array, enough: float = 1e-50) -> Array:
        """Solution over the owned unknowns (collective).

        A preconditioned residual of norm `enough`, which has the unit of the unknowns, ends it too.

        Raises
        ------
        SolverError
            the iterations do not converge.
        """
        self.b.array[:] = rhs
        self.x.array[:] = start
        self.ksp.setTolerances(atol=max(enough, 1e-50))
        self.ksp.solve(self.b, self.x)
        self.iterations = self.ksp.getIterationNumber()
        reason = self.ksp.getConvergedReason()
        if reason < 0:
            raise SolverError(f"a linear solver stopped after {self.iterations} iterations")
        return self.x.array_r.copy()

    def forget(self) -> None:
        """Start from nothing: a multigrid keeps more of its past than its age."""
        self.ksp.destroy()
        self._create()

    def destroy(self) -> None:
        """Free the solver."""
        for held in (self.ksp, self.x, self.b):
            held.destroy()

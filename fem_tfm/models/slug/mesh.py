# SPDX-License-Identifier: LGPL-3.0-or-later
"""The tube's mesh of hexahedra: its nodes in an order along the tube, and grains in its cells.

The mesh is a section of quadrilaterals times layers along z, on one process. Node number
layer * (nodes of the section) + node of the section makes every matrix a narrow band.
"""

from __future__ import annotations

import functools

import basix.ufl
import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI
from scipy import sparse

from fem_tfm._kernel import grains as kernel
from fem_tfm.errors import InputError
from fem_tfm.geometry.mesh import Mesh, extruded_mesh
from fem_tfm.geometry.resolution import Resolution
from fem_tfm.geometry.section import RoundSection, Section
from fem_tfm.models.slug.grains import Grains

Array = npt.NDArray[np.float64]
# Gauss points of all integrals, in UFL and in tables: exact for three basis functions of a brick
DEGREE = 3
# digits to which nodes of one plane agree
ROUNDING = 9


def tube_mesh(section: Section, length: float, across: int, layers: int | None = None) -> Mesh:
    """Straight-edged hexahedra with the area of the section.

    across : cells across the section, an even number, or 1 in a round section
    layers : along the tube, default half as long as the section is wide, or cells as long as wide

    Raises InputError for another number of cells across.
    """
    round_section = isinstance(section, RoundSection)
    if not (across == 1 and round_section) and (across < 2 or across % 2):
        words = "an even number from 2" + ", or 1" * round_section
        raise InputError("numerics.cells_across", across, words)
    width = min(section.size) / max(across, 2)
    resolution = Resolution(mesh_size=width, cells="quadrilateral", wall_grading=1.0)
    return extruded_mesh(
        section,
        resolution,
        length,
        layers or max(round(length / width), 1),
        MPI.COMM_SELF,
        order=1,
        layout=("block" if across == 1 else "blocks") if round_section else None,
        fills=round_section,
    )


class TubeMesh:
    """Continuous trilinear functions on the tube's mesh, by their nodal values in tube order.

    space : of DOLFINx
    order : dof of DOLFINx of each node; node of each dof is `rank`
    points : places of the nodes (n, 3) [m]
    volumes : integrals of the nodal basis functions (n,) [m3]
    """

    def __init__(self, mesh: Mesh) -> None:
        if mesh.mesh.comm.size > 1:
            raise ValueError("the pressure of a slug tube lives on one process")
        self.mesh = mesh
        self.space = fem.functionspace(mesh.mesh, ("Lagrange", 1))
        points = self.space.tabulate_dof_coordinates()
        flat = np.round(points / np.abs(points).max(), ROUNDING)
        self.order = np.lexsort((flat[:, 0], flat[:, 1], flat[:, 2]))
        self.rank = np.empty_like(self.order)
        self.rank[self.order] = np.arange(len(points))
        self.points = points[self.order]
        self.planes = np.unique(flat[:, 2]) * np.abs(points).max()
        self.per_plane = len(points) // len(self.planes)
        self.cells = self.rank[self.space.dofmap.list]
        self._check_layers()
        self.volumes = self.integrals(np.ones(self.weights.size))
        self.tents = kernel.Tents(*self._section_cells(), self.planes)

    def _check_layers(self) -> None:
        """All sections hold the same nodes, or the order along the tube is none."""
        layers = self.points.reshape(len(self.planes), self.per_plane, 3)
        size = np.abs(self.points).max()
        assert np.allclose(layers[:, :, :2], layers[0, :, :2], atol=1e-7 * size)
        assert np.allclose(layers[:, :, 2], self.planes[:, None], atol=1e-7 * size)
        self.planes = layers[:, 0, 2].copy()

    def _section_cells(self) -> tuple[Array, npt.NDArray[np.int32]]:
        """Corners and nodes of the quadrilaterals, in the order of the reference square."""
        bottom = self.cells[(self.cells < self.per_plane).sum(axis=1) == 4]
        quads = np.array([cell[cell < self.per_plane] for cell in bottom], dtype=np.int32)
        return np.ascontiguousarray(self.points[quads][:, :, :2]), quads

    @property
    def size(self) -> int:
        """Number of nodes."""
        return len(self.points)

    @property
    def length(self) -> float:
        """Of the tube [m]."""
        return float(self.planes[-1] - self.planes[0])

    def function(self, values: Array) -> fem.Function:
        """Function of DOLFINx with nodal values."""
        found = fem.Function(self.space)
        found.x.array[self.order] = values
        return found

    def nodal(self, dofs: Array) -> Array:
        """Nodal values of an array of DOLFINx."""
        return dofs[self.order]

    # -- points of the quadrature ------------------------------------------------------------------

    @functools.cached_property
    def _rule(self) -> tuple[Array, Array]:
        points, weights = basix.make_quadrature(basix.CellType.hexahedron, DEGREE)
        return points, weights

    @functools.cached_property
    def table(self) -> Array:
        """Basis functions and their slopes at the points of the reference cell (4, points, 8)."""
        element = basix.ufl.element("Lagrange", "hexahedron", 1)
        return np.asarray(element.tabulate(1, self._rule[0]))

    @functools.cached_property
    def _jacobian(self) -> Array:
        return np.einsum("cad,eqa->cqde", self.points[self.cells], self.table[1:])

    @functools.cached_property
    def weights(self) -> Array:
        """Weights of all points in space (cells * points,)."""
        return (np.abs(np.linalg.det(self._jacobian)) * self._rule[1]).ravel()

    @functools.cached_property
    def gradients(self) -> Array:
        """Gradients of the basis functions (cells, points, 8, 3)."""
        return np.einsum("cqed,eqa->cqad", np.linalg.inv(self._jacobian), self.table[1:])

    def _at_points(self, values: Array) -> sparse.csr_matrix:
        """Matrix from nodal values to the points, of (cells, points, 8)."""
        cells, points, _ = values.shape
        rows = np.repeat(np.arange(cells * points), 8)
        columns = np.repeat(self.cells[:, None, :], points, axis=1).ravel()
        return sparse.csr_matrix((values.ravel(), (rows, columns)), (cells * points, self.size))

    @functools.cached_property
    def value(self) -> sparse.csr_matrix:
        """Matrix that gives a function's values at the points."""
        shape = (len(self.cells), *self.table[0].shape)
        return self._at_points(np.broadcast_to(self.table[0], shape))

    @functools.cached_property
    def slope(self) -> sparse.csr_matrix:
        """Matrix that gives a function's gradient at the points, component by component."""
        return sparse.vstack([self._at_points(self.gradients[..., d]) for d in range(3)]).tocsr()

    @functools.cached_property
    def _value_back(self) -> sparse.csr_matrix:
        return (self.value.T @ sparse.diags(self.weights)).tocsr()

    @functools.cached_property
    def _slope_back(self) -> sparse.csr_matrix:
        return (self.slope.T @ sparse.diags(np.tile(self.weights, 3))).tocsr()

    def integrals(self, values: Array) -> Array:
        """Integrals of values at the points with each basis function."""
        return np.asarray(self._value_back @ values)

    def integrals_of_slopes(self, vectors: Array) -> Array:
        """Integrals of vectors at the points (3, points) with each basis function's gradient."""
        return np.asarray(self._slope_back @ vectors.ravel())

    # -- grains ------------------------------------------------------------------------------------

    def spread(self, grains: Grains) -> tuple[Array, Array]:
        """Volume (n,) [m3] and volume times velocity (n, 3) [m4/s] that grains give to nodes."""
        volume, momentum = np.zeros(self.size), np.zeros((self.size, 3))
        self.tents.locate(grains.core)
        self.tents.deposit(grains.core, volume, momentum)
        return volume, momentum

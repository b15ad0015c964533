# SPDX-License-Identifier: LGPL-3.0-or-later
"""The tube's mesh of hexahedra: its nodes in an order along the tube, and grains in its cells.

The mesh is a section of quadrilaterals times layers along the axis, on one process. Node number
layer * (nodes of the section) + node of the section makes every matrix a narrow band.
"""

from __future__ import annotations

import basix.ufl
import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI
from scipy.spatial import cKDTree

from fem_tfm._kernel import grains as kernel
from fem_tfm.errors import InputError
from fem_tfm.geometry.arc import Arc
from fem_tfm.geometry.mesh import Mesh, extruded_mesh
from fem_tfm.geometry.resolution import Resolution
from fem_tfm.geometry.section import RoundSection, Section
from fem_tfm.models.slug.grains import Grains

Array = npt.NDArray[np.float64]
# Gauss points of all integrals, in UFL and in tables: exact for three basis functions of a brick
DEGREE = 3
# volume of the least node over that of a grain, and the least average over its diameter that takes
# the place of larger nodes
LEAST_VOLUME, LEAST_WIDTH = 0.3, 0.5
# digits to which nodes of one plane agree
ROUNDING = 9


def layers_along(section: Section, length: float, across: int) -> int:
    """Layers half as long as the section is wide, or of cells at most twice as long as wide."""
    return max(round(length / (2 * min(section.size) / max(across, 4))), 1)


def tube_mesh(
    section: Section,
    length: float,
    across: int,
    layers: int | None = None,
    arc: Arc | None = None,
) -> Mesh:
    """Straight-edged hexahedra with the area of the section.

    across : cells across the section, an even number, or 1 in a round section
    layers : along the tube, default `layers_along`
    arc : in the axis, None for a straight tube

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
        layers or layers_along(section, length, across),
        MPI.COMM_SELF,
        arc=arc,
        order=1,
        layout=("block" if across == 1 else "blocks") if round_section else None,
        fills=round_section,
    )


def by_cell(values: Array, table: Array) -> Array:
    """Rows of the cells (quads, layers, a) times their tables (quads, layers or 1, a, b)."""
    if table.shape[1] == 1:
        return np.asarray(values @ table[:, 0])
    return np.asarray((values[:, :, None] @ table)[:, :, 0])


def _along_the_tube(straight: Array) -> tuple[npt.NDArray[np.int64], int]:
    """Order of nodes, plane by plane and in each as at the inlet, and nodes of a plane."""
    s, size = straight[:, 2], np.abs(straight).max()
    low, length = s.min(), np.ptp(s)
    first = np.flatnonzero(s - low < 1e-7 * size)
    layer = np.rint((s - low) / length * (len(s) // len(first) - 1))
    flat = np.round(straight[first, :2] / size, ROUNDING)
    first = first[np.lexsort((flat[:, 0], flat[:, 1]))]
    place = cKDTree(straight[first, :2]).query(straight[:, :2])[1]
    return np.lexsort((place, layer)), len(first)


class TubeMesh:
    """Continuous trilinear functions on the tube's mesh, by their nodal values in tube order.

    A cell is a quadrilateral of the section in a layer, and what belongs to a cell is an array
    (quads, layers, ...). In a straight tube all slices are alike: tables then have one layer.

    space : of DOLFINx
    order : dof of DOLFINx of each node; node of each dof is `rank`
    points, straight : places of the nodes (n, 3), and those in the straight line [m]
    planes : places of the planes of nodes along the axis (layers + 1,) [m]
    cells : nodes of the cells (quads, layers, 8)
    volumes : integrals of the nodal basis functions (n,) [m3]
    """

    def __init__(self, mesh: Mesh) -> None:
        if mesh.mesh.comm.size > 1:
            raise ValueError("the pressure of a slug tube lives on one process")
        self.mesh = mesh
        self.space = fem.functionspace(mesh.mesh, ("Lagrange", 1))
        points = self.space.tabulate_dof_coordinates()
        straight = mesh.straightened(points)
        self.order, self.per_plane = _along_the_tube(straight)
        self.rank = np.empty_like(self.order)
        self.rank[self.order] = np.arange(len(points))
        self.points, self.straight = points[self.order], straight[self.order]
        self.planes = self.straight[:: self.per_plane, 2].copy()
        self.cells = self._cells()
        self._check_slices()
        self._tabulate()
        self.volumes = self.integrals(np.ones((*self.cells.shape[:2], self.weights.shape[-1])))
        corners = np.ascontiguousarray(self.straight[self.cells[:, 0, :4], :2])
        self.tents = kernel.Tents(corners, self.cells[:, 0, :4].astype(np.int32), self.planes)

    def _cells(self) -> npt.NDArray[np.int64]:
        found = self.rank[self.space.dofmap.list]
        # the first four nodes of a cell are upstream of the others
        assert (found[:, 4:] - found[:, :4] == self.per_plane).all()
        layer, first = np.divmod(found[:, :4], self.per_plane)
        number = np.lexsort((*first.T, layer[:, 0]))
        layers = len(self.planes) - 1
        return found[number].reshape(layers, -1, 8).swapaxes(0, 1).copy()

    def _check_slices(self) -> None:
        """All slices of the straight line hold the same cells."""
        size = np.abs(self.straight).max()
        planes = self.straight.reshape(-1, self.per_plane, 3)
        assert np.allclose(planes[:, :, :2], planes[0, :, :2], atol=1e-7 * size)
        assert np.allclose(np.diff(self.planes), self.length / (len(self.planes) - 1))
        steps = self.per_plane * np.arange(self.cells.shape[1])[:, None]
        assert (self.cells - steps == self.cells[:, :1]).all()

    def _tabulate(self) -> None:
        """Basis functions and gradients at the points of the quadrature, in slices that differ."""
        points, weights = basix.make_quadrature(basix.CellType.hexahedron, DEGREE)
        element = basix.ufl.element("Lagrange", "hexahedron", 1)
        table = np.asarray(element.tabulate(1, points))
        corners = self.points[self.cells[:, : None if self.mesh.arc else 1]]
        jacobian = np.einsum("clad,eqa->clqde", corners, table[1:])
        # basis functions (points, 8), gradients (quads, layers or 1, points, 8, 3), weights (quads,
        # layers or 1, points)
        self.basis = table[0]
        self.gradients = np.einsum("clqed,eqa->clqad", np.linalg.inv(jacobian), table[1:])
        self.weights = np.abs(np.linalg.det(jacobian)) * weights
        shape = (*corners.shape[:2], 8, 3 * len(points))
        # from the nodes of a cell to slopes (component, point), and back
        self._slopes = self.gradients.transpose(0, 1, 3, 4, 2).reshape(shape).copy()
        self._slopes_back = self._slopes.swapaxes(2, 3).copy()

    @property
    def size(self) -> int:
        """Number of nodes."""
        return len(self.points)

    @property
    def length(self) -> float:
        """Of the tube [m]."""
        return float(self.planes[-1] - self.planes[0])

    @property
    def area(self) -> float:
        """Mean of the sections [m2]."""
        return float(self.volumes.sum()) / self.length

    def function(self, values: Array) -> fem.Function:
        """Function of DOLFINx with nodal values."""
        found = fem.Function(self.space)
        found.x.array[self.order] = values
        return found

    def nodal(self, dofs: Array) -> Array:
        """Nodal values of an array of DOLFINx."""
        return dofs[self.order]

    # -- points of the quadrature ------------------------------------------------------------------

    def value(self, nodal: Array) -> Array:
        """Values of a function at the points (quads, layers, points)."""
        return np.asarray(nodal[self.cells] @ self.basis.T)

    def vector(self, nodal: Array) -> Array:
        """Values of vectors (n, 3) at the points (quads, layers, 3, points)."""
        parts = [self.value(component) for component in np.ascontiguousarray(nodal.T)]
        return np.stack(parts, axis=2)

    def slope(self, nodal: Array) -> Array:
        """Gradient of a function at the points (quads, layers, 3, points)."""
        found = by_cell(nodal[self.cells], self._slopes)
        return np.asarray(found).reshape(*found.shape[:2], 3, -1)

    def integrals(self, values: Array) -> Array:
        """Integrals of values at the points with each basis function."""
        return self._summed((values * self.weights) @ self.basis)

    def integrals_of_slopes(self, vectors: Array) -> Array:
        """Integrals of vectors at the points with each basis function's gradient."""
        weighted = vectors * self.weights[:, :, None]
        flat = weighted.reshape(*weighted.shape[:2], -1)
        return self._summed(by_cell(flat, self._slopes_back))

    def _summed(self, local: Array) -> Array:
        return np.bincount(self.cells.ravel(), local.ravel(), minlength=self.size)

    # -- grains ------------------------------------------------------------------------------------

    def spread(self, grains: Grains) -> tuple[Array, Array]:
        """Volume (n,) [m3] and volume times velocity (n, 3) [m4/s] that grains give to nodes."""
        volume, momentum = np.zeros(self.size), np.zeros((self.size, 3))
        self.tents.locate(grains.core)
        self.tents.deposit(grains.core, volume, momentum)
        return volume, momentum

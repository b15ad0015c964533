# SPDX-License-Identifier: LGPL-3.0-or-later
"""The tube's mesh of hexahedra: its nodes in an order along the tube, and grains in its cells.

The mesh is a section of quadrilaterals times layers along z, on one process. Node number
layer * (nodes of the section) + node of the section makes every matrix a narrow band.
"""

from __future__ import annotations

import functools
from typing import Any

import basix.ufl
import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI

from fem_tfm._kernel import grains as kernel
from fem_tfm.errors import InputError
from fem_tfm.geometry.mesh import Mesh, extruded_mesh
from fem_tfm.geometry.resolution import Resolution
from fem_tfm.geometry.section import RoundSection, Section
from fem_tfm.models.slug.grains import Grains

Array = npt.NDArray[np.float64]
# Gauss points of all integrals, in UFL and in tables: exact for three basis functions of a brick
DEGREE = 4
# length of a cell over its width, by default one
ROUNDING = 9


def tube_mesh(section: Section, length: float, across: int, layers: int | None = None) -> Mesh:
    """Straight-edged hexahedra with the area of the section.

    across : cells across the section, an even number
    layers : along the tube, default cells as long as wide

    Raises InputError for an odd number of cells across.
    """
    if across < 2 or across % 2:
        raise InputError("numerics.cells_across", across, "an even number from 2")
    width = min(section.size) / across
    round_section = isinstance(section, RoundSection)
    resolution = Resolution(mesh_size=width, cells="quadrilateral", wall_grading=1.0)
    return extruded_mesh(
        section,
        resolution,
        length,
        layers or max(round(length / width), 1),
        MPI.COMM_SELF,
        order=1,
        layout="blocks" if round_section else None,
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
        self.volumes = self.integrated(np.einsum("cq,qa->ca", self._weights, self._values))
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

    # -- integrals over cells ----------------------------------------------------------------------

    @functools.cached_property
    def _rule(self) -> tuple[Array, Array]:
        points, weights = basix.make_quadrature(basix.CellType.hexahedron, DEGREE)
        return points, weights

    @functools.cached_property
    def _table(self) -> Array:
        element = basix.ufl.element("Lagrange", "hexahedron", 1)
        return np.asarray(element.tabulate(1, self._rule[0]))

    @property
    def _values(self) -> Array:
        """Basis functions at the points (points, 8)."""
        return self._table[0]

    @functools.cached_property
    def _jacobian(self) -> Array:
        return np.einsum("cad,eqa->cqde", self.points[self.cells], self._table[1:])

    @functools.cached_property
    def _weights(self) -> Array:
        """Weights of the points in space (cells, points)."""
        return np.abs(np.linalg.det(self._jacobian)) * self._rule[1]

    @functools.cached_property
    def _gradients(self) -> Array:
        """Gradients of the basis functions (cells, points, 8, 3)."""
        return np.einsum("cqed,eqa->cqad", np.linalg.inv(self._jacobian), self._table[1:])

    def integrated(self, local: Array) -> Array:
        """Sum over cells of (cells, 8) in the nodes."""
        return np.bincount(self.cells.ravel(), local.ravel(), minlength=self.size)

    def products(self) -> dict[str, Array]:
        """Integrals over each cell of products of the basis functions.

        diffusion : N_k grad N_a . grad N_b (cells, a, b, k)
        mass : N_a N_k (cells, a, k)
        slope : N_k dN_a/dx_d (cells, a, k, d)
        """
        n, g, w = self._values, self._gradients, self._weights
        best: dict[str, Any] = {"optimize": True}
        return {
            "diffusion": np.einsum("cq,qk,cqad,cqbd->cabk", w, n, g, g, **best),
            "mass": np.einsum("cq,qa,qk->cak", w, n, n, **best),
            "slope": np.einsum("cq,qk,cqad->cakd", w, n, g, **best),
        }

    # -- grains ------------------------------------------------------------------------------------

    def spread(self, grains: Grains) -> tuple[Array, Array]:
        """Volume (n,) [m3] and volume times velocity (n, 3) [m4/s] that grains give to the nodes."""
        volume, momentum = np.zeros(self.size), np.zeros((self.size, 3))
        self.tents.locate(grains.core)
        self.tents.deposit(grains.core, volume, momentum)
        return volume, momentum

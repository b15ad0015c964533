# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes of sections and lines, with their parts tagged.

Parts are named "fluid", "wall", "symmetry" (half), "symmetry_x" and "symmetry_y" (quarter: the
planes x = 0 and y = 0) and, in three dimensions, "inlet" and "outlet". A bend is a straight line
whose nodes have been moved onto the arc. What depends on the version of DOLFINx is here alone.

Every function is collective: all ranks raise the same InputError for bad input, before any
communication, and SolverError if Gmsh fails.
"""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx.io import gmsh as gmsh_io
from dolfinx.mesh import GhostMode, MeshTags, create_cell_partitioner
from dolfinx.mesh import Mesh as DolfinxMesh
from mpi4py import MPI

from fem_tfm.geometry.arc import Arc
from fem_tfm.geometry.gmsh import GmshModel, from_root, import_gmsh
from fem_tfm.geometry.resolution import Resolution
from fem_tfm.geometry.section import Section
from fem_tfm.geometry.shapes import Shape


@dataclass(frozen=True, eq=False)
class Mesh:
    """A tagged DOLFINx mesh and the section or line it stands for.

    mesh       : dolfinx Mesh, with a layer of ghost cells across facets in parallel
    cell_tags  : MeshTags of the cells ("fluid")
    facet_tags : MeshTags of the boundary facets; every one has exactly one tag
    tags       : tag of each name
    section    : the section and the part of it that is solved
    size       : core cell size [m] as built; the wall cell is wall_ratio times that
    length     : length along the axis [m], None for a section
    arc        : the arc in the axis, None for a straight line
    """

    mesh: DolfinxMesh[Any]
    cell_tags: MeshTags
    facet_tags: MeshTags
    tags: dict[str, int]
    section: Section
    size: float
    length: float | None = None
    arc: Arc | None = None

    @property
    def num_cells(self) -> int:
        """Cells on all ranks."""
        return int(self.mesh.topology.index_map(self.mesh.topology.dim).size_global)

    def wall_distance(self) -> Any:
        """UFL distance to the wall of a section or straight line [m], see Section.wall_distance.

        Raises ValueError for a bend, where `distance_at` tells it.
        """
        if self.arc is not None:
            raise ValueError("the wall of a bend has no distance in x and y")
        return self.section.wall_distance(ufl.SpatialCoordinate(self.mesh))

    def straightened(self, x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Coordinates (x, y, s) of points in the straight line, s along the axis, (n, 3) [m]."""
        return x if self.arc is None else self.arc.straightened(x)

    def axis(self, x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Unit vectors along the axis at points, shape (n, 3)."""
        if self.arc is None:
            return np.broadcast_to(np.array([0.0, 0.0, 1.0]), x.shape)
        return self.arc.axis(x)

    def distance_at(self, x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Distance of points to the wall, shape (n,) [m]; see Section.wall_distance."""
        return np.asarray(self.section.wall_distance(self.straightened(x).T))

    def plane(
        self, rows: int, columns: int
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """A grid in the vertical plane through the axis of a line.

        Points in space, shape (rows, columns, 3), and where to draw them, shape (rows, columns, 2):
        along and up as they lie, but a bend to the side unrolled [m]. They keep half a spacing from
        walls and ends, and a hair from the plane of symmetry. Raises ValueError for a section.
        """
        if self.length is None:
            raise ValueError("a section has no plane along its axis")
        width, height = self.section.size
        low = -height / 2 if self.section.symmetry != "quarter" else 0.0
        y = low + (height / 2 - low) * (np.arange(rows) + 0.5) / rows
        s = self.length * (np.arange(columns) + 0.5) / columns
        y, s = np.meshgrid(y, s, indexing="ij")
        straight = np.stack([np.full_like(y, 1e-6 * width), y, s], axis=-1).reshape(-1, 3)
        points = straight if self.arc is None else self.arc.bent(straight)
        unrolled = self.arc is not None and self.arc.towards == "side"
        drawn = (straight if unrolled else points)[:, [2, 1]]
        return points.reshape(rows, columns, 3), drawn.reshape(rows, columns, 2)

    def facets(self, name: str) -> npt.NDArray[np.int32]:
        """Local indices of the facets called `name`; empty if the mesh has no such part."""
        tag = self.tags.get(name)
        return np.empty(0, dtype=np.int32) if tag is None else self.facet_tags.find(tag)


def section_mesh(
    section: Section,
    resolution: Resolution,
    comm: MPI.Comm,
    *,
    order: int = 2,
    layout: str | None = None,
) -> Mesh:
    """Mesh of a section in the plane (x, y); order and layout as in GmshModel."""
    return _build(GmshModel(section, resolution, order=order, layout=layout), comm)


def extruded_mesh(
    section: Section,
    resolution: Resolution,
    length: float,
    layers: int,
    comm: MPI.Comm,
    *,
    arc: Arc | None = None,
    order: int = 2,
    layout: str | None = None,
    fills: bool = False,
) -> Mesh:
    """Mesh of a line of a length along its axis [m], in `layers` equal slices.

    It lies at 0 <= z <= length, or follows an arc. Triangles become tetrahedra, quadrilaterals
    hexahedra. Layout and fills as in GmshModel.
    """
    return _build(GmshModel(section, resolution, length, layers, arc, order, layout, fills), comm)


def line_model(shape: Shape, section: Section, resolution: Resolution) -> GmshModel:
    """A whole line in straight-edged cells, whose section has the area of its circle."""
    layers = axial_layers(shape, section, resolution)
    return GmshModel(section, resolution, shape.length, layers, shape.arc, order=1, fills=True)


def line_mesh(shape: Shape, section: Section, resolution: Resolution, comm: MPI.Comm) -> Mesh:
    """Mesh of a whole line in straight-edged cells; `section` is the part that is solved."""
    return _build(line_model(shape, section, resolution), comm)


def axial_layers(shape: Shape, section: Section, resolution: Resolution) -> int:
    """Slices of a line, twice as long as core cells are wide unless their number is given."""
    if resolution.axial_cells is not None:
        return resolution.axial_cells
    return max(round(shape.length / (2 * resolution.core_size(section))), 1)


def line_cells(shape: Shape, section: Section, resolution: Resolution, comm: MPI.Comm) -> int:
    """Cells of a line, counted on its section."""
    per_slice = 3 if resolution.cell_shape == "triangle" else 1
    slices = axial_layers(shape, section, resolution) * per_slice
    return section_mesh(section, resolution, comm).num_cells * slices


def _build(model: GmshModel, comm: MPI.Comm) -> Mesh:
    """Mesh of a model, distributed over `comm`."""
    with ExitStack() as stack:

        def work() -> float:
            gmsh = stack.enter_context(model.opened())
            return float(gmsh.parser.getNumber("core_size")[0])

        size = from_root(comm, work)
        data = gmsh_io.model_to_mesh(
            import_gmsh().model if comm.rank == 0 else None,
            comm,
            0,
            gdim=model.dim,
            # Gmsh meshes come without ghosts, which interior-facet integrals need
            partitioner=create_cell_partitioner(GhostMode.shared_facet, 2),
        )
    cells = data.mesh.topology.index_map(model.dim)
    ghosts = comm.allreduce(cells.num_ghosts)
    assert comm.size == 1 or ghosts > 0 or comm.allreduce(cells.size_local > 0) == 1
    assert data.cell_tags is not None and data.facet_tags is not None
    tags = {name: group.tag for name, group in data.physical_groups.items()}
    return Mesh(
        data.mesh,
        data.cell_tags,
        data.facet_tags,
        tags,
        model.section,
        size,
        model.length,
        model.arc,
    )

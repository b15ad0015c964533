# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the tests of the meshes share: meshes in one line, and what is measured on them."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from mpi4py import MPI

from fem_tfm.geometry.arc import Arc
from fem_tfm.geometry.mesh import Mesh, extruded_mesh, section_mesh
from fem_tfm.geometry.resolution import Resolution
from fem_tfm.geometry.section import RectangularSection, RoundSection, Section

RADIUS = 0.005
PIPE = RoundSection(2 * RADIUS)
DUCT = RectangularSection(0.02, 0.01)
LENGTH = 0.03
SYMMETRIES = ("half", "quarter", "none")
COMM = MPI.COMM_WORLD


def section(
    part: Section, level: int = 3, *, order: int = 2, layout: str | None = None, **given: Any
) -> Mesh:
    """Mesh of a section; further keywords are those of Resolution."""
    return section_mesh(part, Resolution(level, **given), COMM, order=order, layout=layout)


def extruded(
    part: Section, length: float, layers: int, level: int = 3, arc: Arc | None = None, **given: Any
) -> Mesh:
    """Mesh of a line of curved cells; further keywords are those of Resolution."""
    return extruded_mesh(part, Resolution(level, **given), length, layers, COMM, arc=arc)


def integral(mesh: Mesh, name: str | None = None) -> float:
    """Volume of the cells, or area of the facets called `name`."""
    one = fem.Constant(mesh.mesh, 1.0)
    ds = ufl.Measure("ds", mesh.mesh, subdomain_data=mesh.facet_tags)
    measure = ufl.Measure("dx", mesh.mesh) if name is None else ds(mesh.tags[name])
    return float(mesh.mesh.comm.allreduce(fem.assemble_scalar(fem.form(one * measure))))


def jacobians(mesh: Mesh) -> npt.NDArray[np.float64]:
    """|det J| at a lattice of points of each cell, negative where a cell is folded."""
    lattice = fem.functionspace(mesh.mesh, ("DG", 3)).element.interpolation_points
    table = fem.Expression(ufl.JacobianDeterminant(mesh.mesh), lattice)
    cells = np.arange(mesh.num_cells, dtype=np.int32)
    values = table.eval(mesh.mesh, cells).reshape(len(cells), -1)
    return values * np.sign(values[:, :1])


def nodes(mesh: Mesh, name: str) -> npt.NDArray[np.float64]:
    """Coordinates of the geometry nodes on the facets called `name`, shape (n, 3)."""
    space = fem.functionspace(mesh.mesh, ("Lagrange", mesh.mesh.geometry.cmaps[0].degree))
    dim = mesh.mesh.topology.dim - 1
    dofs = fem.locate_dofs_topological(space, dim, mesh.facets(name))
    return space.tabulate_dof_coordinates()[dofs]


def slope(sizes: list[float], errors: list[float]) -> float:
    """Observed order of convergence."""
    return float(np.polyfit(np.log(sizes), np.log(errors), 1)[0])

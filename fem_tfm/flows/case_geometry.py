# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shape, section, resolution and meshes of a case."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

from fem_tfm.case import Case
from fem_tfm.geometry import mesh
from fem_tfm.geometry.files import write_mesh
from fem_tfm.geometry.gmsh import GmshModel
from fem_tfm.geometry.mesh import Mesh
from fem_tfm.geometry.resolution import Resolution
from fem_tfm.geometry.section import Section
from fem_tfm.geometry.shapes import Shape


def shape_of(case: Case) -> Shape:
    """Shape of a case."""
    return Shape.from_table(case.geometry.model_dump())


def geometry_of(case: Case) -> Section:
    """Part of the section that is solved.

    The gas of a duct has no weight and is solved on a quarter that begins at the distance of the
    wall functions.
    """
    part, offset = ("quarter", case.wall_distance) if case.flow == "duct" else ("half", 0.0)
    return shape_of(case).section(part, offset)


def resolution_of(case: Case) -> Resolution:
    """Resolution of a case, graded to the wall."""
    given = case.numerics
    found = Resolution(
        given.level, given.mesh_size, given.wall_grading, given.cells, given.axial_cells
    )
    if case.flow == "dense" and case.walls.gas.resolved:
        return found.with_wall_cell(geometry_of(case), case.wall_distance)
    return found


def line(case: Case, comm: MPI.Comm = MPI.COMM_WORLD) -> Mesh:
    """Mesh of the whole line of a case."""
    return mesh.line_mesh(shape_of(case), geometry_of(case), resolution_of(case), comm)


def axial_layers(case: Case) -> int:
    """Slices of the line of a case."""
    return mesh.axial_layers(shape_of(case), geometry_of(case), resolution_of(case))


def line_cells(case: Case, comm: MPI.Comm = MPI.COMM_WORLD) -> int:
    """Cells of the line of a case."""
    return mesh.line_cells(shape_of(case), geometry_of(case), resolution_of(case), comm)


def write_case_mesh(case: Case, path: str | Path, comm: MPI.Comm = MPI.COMM_WORLD) -> None:
    """Write the section of a case, or the line of an unsteady one."""
    section, resolution = geometry_of(case), resolution_of(case)
    if case.solution == "unsteady":
        write_mesh(mesh.line_model(shape_of(case), section, resolution), path, comm)
    else:
        write_mesh(GmshModel(section, resolution), path, comm)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files of meshes: cells, tags and names of every format, refused paths."""

from __future__ import annotations

from pathlib import Path

import dolfinx
import meshio
import pytest
from measures import (
    COMM,
    LENGTH,
    PIPE,
    extruded,
    integral,
    section,
)

from fem_tfm.errors import InputError
from fem_tfm.geometry.files import SUFFIXES, write_mesh
from fem_tfm.geometry.gmsh import GmshModel
from fem_tfm.geometry.mesh import Mesh, line_cells, line_model
from fem_tfm.geometry.resolution import Resolution
from fem_tfm.geometry.shapes import Bend


@pytest.mark.parametrize("cells", ["triangle", "quadrilateral"])
@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("length", [None, LENGTH])
def test_files_hold_the_mesh(tmp_path: Path, suffix: str, cells: str, length: float | None) -> None:
    path = tmp_path / f"pipe{suffix}"
    write_mesh(GmshModel(PIPE, Resolution(1, cells=cells), length, layers=2), path, COMM)
    if length is None:
        built = section(PIPE, 1, cells=cells)
    else:
        built = extruded(PIPE, length, 2, 1, cells=cells)
    dim = built.mesh.topology.dim
    read = meshio.read(path)
    assert sum(len(b.data) for b in read.cells if b.dim == dim) == built.num_cells
    key = "gmsh:physical" if suffix == ".msh" else "tag"
    tags = {int(t) for values in read.cell_data[key] for t in values}
    if suffix == ".xdmf":
        facets = meshio.read(tmp_path / "pipe_facets.xdmf")
        tags |= {int(t) for values in facets.cell_data[key] for t in values}
    assert tags == set(built.tags.values())


def test_msh_file_keeps_the_names(tmp_path: Path) -> None:
    write_mesh(GmshModel(PIPE, Resolution(1)), tmp_path / "pipe.msh", COMM)
    assert set(meshio.read(tmp_path / "pipe.msh").field_data) == {"fluid", "wall", "symmetry"}


@pytest.mark.mpi
def test_dolfinx_reads_the_xdmf_file(tmp_path: Path) -> None:
    write_mesh(GmshModel(PIPE, Resolution(2)), tmp_path / "pipe.xdmf", COMM)
    with dolfinx.io.XDMFFile(COMM, tmp_path / "pipe.xdmf", "r") as file:
        mesh = file.read_mesh(name="Grid")
    mesh.topology.create_connectivity(1, 2)
    with dolfinx.io.XDMFFile(COMM, tmp_path / "pipe_facets.xdmf", "r") as file:
        tags = file.read_meshtags(mesh, name="Grid")
    built = section(PIPE, 2)
    found = Mesh(mesh, built.cell_tags, tags, built.tags, PIPE, built.size)
    assert integral(found) == pytest.approx(integral(built), rel=1e-12)
    for name in ("wall", "symmetry"):
        assert integral(found, name) == pytest.approx(integral(built, name), rel=1e-12)


@pytest.mark.parametrize("name", ["pipe.stl", "pipe", "pipe.xdm"])
def test_unknown_suffix_lists_the_known_ones(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"\.msh, \.xdmf, \.vtu"):
        write_mesh(GmshModel(PIPE, Resolution(1)), tmp_path / name, COMM)
    assert not list(tmp_path.iterdir())


def test_missing_directory(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="directory that exists"):
        write_mesh(GmshModel(PIPE, Resolution(1)), tmp_path / "none" / "pipe.msh", COMM)


def test_a_bent_line_is_written(tmp_path: Path) -> None:
    shape, resolution = Bend(0.01, length=0.1), Resolution(1, cells="quadrilateral")
    write_mesh(line_model(shape, shape.section(), resolution), tmp_path / "bend.vtu", COMM)
    found = meshio.read(tmp_path / "bend.vtu")
    expected = line_cells(shape, shape.section(), resolution, COMM)
    assert len(found.cells_dict["hexahedron"]) == expected
    assert found.points[:, 1].max() > 0.03

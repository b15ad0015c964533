# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes for other programs: .msh of Gmsh, .vtu and .xdmf."""

from __future__ import annotations

import tempfile
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from fem_tfm.errors import InputError, nearest
from fem_tfm.geometry.gmsh import GmshModel, from_root

SUFFIXES = (".msh", ".xdmf", ".vtu")


def write_mesh(model: GmshModel, path: str | Path, comm: MPI.Comm) -> None:
    """Write a mesh to .msh (Gmsh 4.1, with names), .vtu or .xdmf + .h5.

    .vtu holds cells and boundary facets with the tag of each as cell data "tag"; .xdmf the cells,
    and a second file NAME_facets.xdmf the facets, which is the pair that DOLFINx reads. Collective.
    Raises InputError for another suffix or a missing directory, SolverError if Gmsh fails.
    """
    target = checked_path(path)

    def work() -> None:
        with model.opened() as gmsh:
            _save(gmsh, target, model.dim)

    from_root(comm, work)


def checked_path(path: str | Path) -> Path:
    """Path of a mesh file; raises InputError for an unknown suffix or a missing directory."""
    path = Path(path)
    if path.suffix not in SUFFIXES:
        near = nearest(path.suffix, SUFFIXES)
        raise InputError("--out", str(path), "a file name ending in " + ", ".join(SUFFIXES), near)
    if not path.parent.is_dir():
        raise InputError("--out", str(path), "a file in a directory that exists")
    return path


def _save(gmsh: ModuleType, path: Path, dim: int) -> None:
    """Write the current model to `path` by its suffix."""
    if path.suffix == ".msh":
        gmsh.write(str(path))
        return
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "mesh.msh"
        gmsh.write(str(source))
        _convert(source, path, dim)


def _convert(source: Path, path: Path, dim: int) -> None:
    """Rewrite a Gmsh file as .vtu or .xdmf."""
    import meshio

    mesh = meshio.read(source)
    blocks = list(zip(mesh.cells, mesh.cell_data["gmsh:physical"], strict=True))
    kinds = {"cells": dim, "facets": dim - 1}
    parts = {
        kind: [(b, tag) for b, tag in blocks if b.dim == number] for kind, number in kinds.items()
    }
    if path.suffix == ".vtu":
        _merged(mesh.points, parts["cells"] + parts["facets"]).write(path)
        return
    # DOLFINx takes the dimension of space from the columns, and its wheel reads no compressed HDF5
    points = mesh.points[:, :dim]
    plain: dict[str, Any] = {"compression": None, "compression_opts": None}
    _merged(points, parts["cells"]).write(path, **plain)
    _merged(points, parts["facets"]).write(path.with_name(path.stem + "_facets.xdmf"), **plain)


def _merged(points: npt.NDArray[np.float64], blocks: list[tuple[Any, Any]]) -> Any:
    """Meshio mesh with one block per type of cell."""
    import meshio

    kinds = dict.fromkeys(block.type for block, _ in blocks)
    cells = [
        (kind, np.concatenate([block.data for block, _ in blocks if block.type == kind]))
        for kind in kinds
    ]
    tags = [np.concatenate([tag for block, tag in blocks if block.type == kind]) for kind in kinds]
    return meshio.Mesh(points, cells, cell_data={"tag": tags})

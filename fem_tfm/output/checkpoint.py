# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checkpoints that outlive a kill and do not depend on the number of ranks.

A field is kept as the coordinates of its nodes and the values there; reading it back matches nodes
by their place. Values of cells are kept in the order in which the mesh was made. The file is on the
disk before it takes its name, and the one before it is kept beside it, so a kill at any moment
leaves a whole state.
"""

from __future__ import annotations

import os
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from scipy.spatial import cKDTree

from fem_tfm.errors import InputError
from fem_tfm.output.files import on_root, replaced

FILE, BEFORE = "checkpoint/state.npz", "checkpoint/before.npz"
# nodes of the same mesh agree to round-off; anything else is another mesh
SAME_PLACE = 1e-9


def save(
    directory: str | Path,
    comm: Any,
    fields: Mapping[str, fem.Function],
    numbers: Mapping[str, float],
    tables: Mapping[str, Sequence[float]] | None = None,
    others: Mapping[str, np.ndarray] | None = None,
) -> None:
    """Write fields, numbers, columns of numbers and other arrays (collective).

    others : whole arrays of any type and shape; those of rank 0 are written
    """
    arrays: dict[str, np.ndarray] = {}
    for name, function in fields.items():
        points, values = _owned(function)
        gathered = comm.gather((points, values))
        if comm.rank == 0:
            arrays[f"{name}.points"] = np.concatenate([part[0] for part in gathered])
            arrays[f"{name}.values"] = np.concatenate([part[1] for part in gathered])
    arrays |= {f"number.{key}": np.asarray(value) for key, value in numbers.items()}
    arrays |= {f"table.{key}": np.asarray(column) for key, column in (tables or {}).items()}
    arrays |= {f"array.{key}": np.asarray(value) for key, value in (others or {}).items()}
    on_root(comm, lambda: _write(Path(directory), arrays))


def save_cells(
    directory: str | Path,
    mesh: Any,
    values: Mapping[str, np.ndarray],
    numbers: Mapping[str, float],
    tables: Mapping[str, npt.ArrayLike] | None = None,
    others: Mapping[str, np.ndarray] | None = None,
) -> None:
    """Write values of the owned cells, each of shape (cells, ...), numbers and tables (collective).

    others : as for `save`
    """
    comm, owned = mesh.comm, _owned_cells(mesh)
    place = comm.gather(mesh.topology.original_cell_index[:owned])
    order = np.argsort(np.concatenate(place)) if comm.rank == 0 else None
    arrays = {f"number.{key}": np.asarray(value) for key, value in numbers.items()}
    arrays |= {f"table.{key}": np.asarray(column) for key, column in (tables or {}).items()}
    arrays |= {f"array.{key}": np.asarray(value) for key, value in (others or {}).items()}
    for name, array in values.items():
        gathered = comm.gather(np.ascontiguousarray(array[:owned]))
        if comm.rank == 0:
            arrays[f"cells.{name}"] = np.concatenate(gathered)[order]
    on_root(comm, lambda: _write(Path(directory), arrays))


def load_cells(directory: str | Path, mesh: Any) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """Values of the owned cells, on any number of ranks, and the numbers.

    Raises
    ------
    InputError
        there is no checkpoint, or it was written on another mesh.
    """
    place = mesh.topology.original_cell_index[: _owned_cells(mesh)]
    count = mesh.topology.index_map(mesh.topology.dim).size_global
    with np.load(_path(directory)) as stored:
        values = {}
        for key in stored.files:
            if key.startswith("cells."):
                array = stored[key]
                if len(array) != count:
                    allowed = f"a checkpoint of the same mesh, {count} cells"
                    raise InputError("--resume", f"{len(array)} cells", allowed)
                values[key.removeprefix("cells.")] = array[place]
        return values, _numbers(stored)


def _owned_cells(mesh: Any) -> int:
    return mesh.topology.index_map(mesh.topology.dim).size_local


def _write(directory: Path, arrays: Mapping[str, Any]) -> None:
    """Replace the checkpoint; the one that was there is kept under another name."""
    path, before = directory / FILE, directory / BEFORE
    path.parent.mkdir(parents=True, exist_ok=True)
    with replaced(path) as temporary:
        with temporary.open("wb") as file:
            np.savez(file, **arrays)
            file.flush()
            os.fsync(file.fileno())
        if path.exists():
            with replaced(before) as kept:
                os.link(path, kept)


def _path(directory: str | Path) -> Path:
    """The checkpoint, or the one before it where that cannot be read; raises InputError."""
    for name in (FILE, BEFORE):
        path = Path(directory) / name
        if path.exists() and zipfile.is_zipfile(path):
            return path
    raise InputError("--resume", str(directory), "a directory that holds a checkpoint")


def _numbers(stored: Any) -> dict[str, float]:
    keys = [key for key in stored.files if key.startswith("number.")]
    return {key.removeprefix("number."): float(stored[key]) for key in keys}


def load(directory: str | Path, comm: Any, fields: Mapping[str, fem.Function]) -> dict[str, float]:
    """Read fields in place and return the numbers (collective).

    Raises
    ------
    InputError
        there is no checkpoint, or it was written on another mesh.
    """
    with np.load(_path(directory)) as stored:
        for name, function in fields.items():
            _place(name, function, stored[f"{name}.points"], stored[f"{name}.values"])
        return _numbers(stored)


def numbers(directory: str | Path) -> dict[str, float]:
    """The numbers of a checkpoint, empty if there is none."""
    try:
        path = _path(directory)
    except InputError:
        return {}
    with np.load(path) as stored:
        return _numbers(stored)


def tables(directory: str | Path) -> dict[str, list[float]]:
    """The columns of a checkpoint."""
    with np.load(_path(directory)) as stored:
        keys = [key for key in stored.files if key.startswith("table.")]
        return {key.removeprefix("table."): stored[key].tolist() for key in keys}


def others(directory: str | Path) -> dict[str, np.ndarray]:
    """The other arrays of a checkpoint, whole on every rank."""
    with np.load(_path(directory)) as stored:
        keys = [key for key in stored.files if key.startswith("array.")]
        return {key.removeprefix("array."): stored[key] for key in keys}


def _owned(function: fem.Function) -> tuple[np.ndarray, np.ndarray]:
    space = function.function_space
    size, width = space.dofmap.index_map.size_local, space.dofmap.index_map_bs
    points = space.tabulate_dof_coordinates()[:size]
    return points, function.x.array[: size * width].reshape(size, width)


def _place(name: str, function: fem.Function, points: np.ndarray, values: np.ndarray) -> None:
    own, _ = _owned(function)
    distance, nearest = cKDTree(points).query(own)
    extent = np.ptp(points, axis=0).max()
    if len(own) and distance.max() > SAME_PLACE * extent:
        raise InputError("--resume", name, "a checkpoint of the same case and mesh")
    function.x.array[: values.shape[1] * len(own)] = values[nearest].ravel()
    function.x.scatter_forward()

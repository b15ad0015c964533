# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checkpoints that outlive a kill and do not depend on the number of ranks.

A field is kept as the coordinates of its nodes and the values there; reading it back matches nodes
by their place. The file is replaced in one step, so the previous state survives a kill.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from dolfinx import fem
from scipy.spatial import cKDTree

from fem_tfm.errors import InputError
from fem_tfm.output.files import on_root, replaced

FILE = "checkpoint/state.npz"
# nodes of the same mesh agree to round-off; anything else is another mesh
SAME_PLACE = 1e-9


def save(
    directory: str | Path,
    comm: Any,
    fields: Mapping[str, fem.Function],
    numbers: Mapping[str, float],
    tables: Mapping[str, Sequence[float]] | None = None,
) -> None:
    """Write fields, numbers and columns of numbers (collective)."""
    arrays: dict[str, np.ndarray] = {}
    for name, function in fields.items():
        points, values = _owned(function)
        gathered = comm.gather((points, values))
        if comm.rank == 0:
            arrays[f"{name}.points"] = np.concatenate([part[0] for part in gathered])
            arrays[f"{name}.values"] = np.concatenate([part[1] for part in gathered])
    arrays |= {f"number.{key}": np.asarray(value) for key, value in numbers.items()}
    arrays |= {f"table.{key}": np.asarray(column) for key, column in (tables or {}).items()}
    path = Path(directory) / FILE

    def write() -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replaced(path) as temporary, temporary.open("wb") as file:
            np.savez(file, **arrays)

    on_root(comm, write)


def load(directory: str | Path, comm: Any, fields: Mapping[str, fem.Function]) -> dict[str, float]:
    """Read fields in place and return the numbers (collective).

    Raises
    ------
    InputError
        there is no checkpoint, or it was written on another mesh.
    """
    path = Path(directory) / FILE
    found = comm.bcast(path.exists() if comm.rank == 0 else None)
    if not found:
        raise InputError("--resume", str(directory), "a directory that holds a checkpoint")
    with np.load(path) as stored:
        for name, function in fields.items():
            _place(name, function, stored[f"{name}.points"], stored[f"{name}.values"])
        keys = [key for key in stored.files if key.startswith("number.")]
        return {key.removeprefix("number."): float(stored[key]) for key in keys}


def numbers(directory: str | Path) -> dict[str, float]:
    """The numbers of a checkpoint, empty if there is none."""
    path = Path(directory) / FILE
    if not path.exists():
        return {}
    with np.load(path) as stored:
        keys = [key for key in stored.files if key.startswith("number.")]
        return {key.removeprefix("number."): float(stored[key]) for key in keys}


def tables(directory: str | Path) -> dict[str, list[float]]:
    """The columns of a checkpoint."""
    with np.load(Path(directory) / FILE) as stored:
        keys = [key for key in stored.files if key.startswith("table.")]
        return {key.removeprefix("table."): stored[key].tolist() for key in keys}


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

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checkpoints give back fields, numbers and tables to the last digit."""

from __future__ import annotations

import math
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dolfinx import fem
from dolfinx.mesh import create_unit_cube, create_unit_square
from mpi4py import MPI

from fem_tfm.errors import InputError
from fem_tfm.output import checkpoint

COMM = MPI.COMM_WORLD


def field(cells: int = 3) -> fem.Function:
    """A smooth function of degree 2."""
    function = fem.Function(fem.functionspace(create_unit_square(COMM, cells, cells), ("P", 2)))
    function.interpolate(lambda x: np.sin(3 * x[0]) + x[1] ** 2)
    return function


def test_what_is_saved_comes_back(tmp_path: Path) -> None:
    given, found = field(), field()
    found.x.array[:] = 0
    table = {"z": [0.0, 0.1, 1 / 3], "G": [math.nan, 2.0, 3.0]}
    checkpoint.save(tmp_path, COMM, {"u": given}, {"step": 0.1}, table)
    assert checkpoint.load(tmp_path, COMM, {"u": found}) == {"step": 0.1}
    assert checkpoint.numbers(tmp_path) == {"step": 0.1}
    assert np.array_equal(found.x.array, given.x.array)
    tables = checkpoint.tables(tmp_path)
    assert list(tables) == ["z", "G"]
    assert tables["z"] == table["z"]
    assert math.isnan(tables["G"][0])


def test_arrays_of_any_type_come_back(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    given = {"cloud.x": rng.normal(size=(5, 3)), "cloud.id": np.arange(5, dtype=np.int64)}
    given["cloud.status"] = np.array([0, 1, 0, 3, 0], dtype=np.int8)
    checkpoint.save(tmp_path, COMM, {}, {"step": 0.1}, others=given)
    found = checkpoint.others(tmp_path)
    assert list(found) == list(given)
    for name, array in given.items():
        assert found[name].dtype == array.dtype
        assert np.array_equal(found[name], array)
    assert checkpoint.tables(tmp_path) == {}


def test_without_tables_there_are_none(tmp_path: Path) -> None:
    checkpoint.save(tmp_path, COMM, {}, {"step": 1})
    assert checkpoint.tables(tmp_path) == {}
    assert checkpoint.others(tmp_path) == {}


def test_another_mesh_and_no_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a directory that holds a checkpoint"):
        checkpoint.load(tmp_path, COMM, {})
    assert checkpoint.numbers(tmp_path) == {}
    checkpoint.save(tmp_path, COMM, {"u": field(3)}, {})
    with pytest.raises(InputError, match="the same case and mesh"):
        checkpoint.load(tmp_path, COMM, {"u": field(4)})


# -- values of cells ---------------------------------------------------------------------------


def of_cells(mesh: Any) -> dict[str, np.ndarray]:
    """A scalar, a vector and a table of each owned cell that tell the cell from its place."""
    owned = mesh.topology.index_map(3).size_local
    place = mesh.topology.original_cell_index[:owned].astype(float)
    return {"a": place, "u": np.outer(place, [1, 2, 3]), "faces": np.outer(place, np.arange(6.0))}


@pytest.mark.mpi
def test_values_of_cells_come_back_on_any_number_of_ranks(tmp_path: Path) -> None:
    mesh = create_unit_cube(COMM, 3, 4, 5)
    checkpoint.save_cells(tmp_path, mesh, of_cells(mesh), {"time": 0.1})
    for comm in (COMM, MPI.COMM_SELF):
        other = create_unit_cube(comm, 3, 4, 5)
        values, numbers = checkpoint.load_cells(tmp_path, other)
        assert numbers == {"time": 0.1}
        for name, expected in of_cells(other).items():
            assert np.array_equal(values[name], expected), name


def test_cells_of_another_mesh_are_refused(tmp_path: Path) -> None:
    mesh, other = create_unit_cube(COMM, 2, 2, 2), create_unit_cube(COMM, 2, 2, 3)
    checkpoint.save_cells(tmp_path, mesh, of_cells(mesh), {})
    with pytest.raises(InputError, match="a checkpoint of the same mesh, 72 cells"):
        checkpoint.load_cells(tmp_path, other)


def test_the_state_before_is_kept(tmp_path: Path) -> None:
    mesh = create_unit_cube(COMM, 2, 2, 2)
    for time_ in (1.0, 2.0):
        checkpoint.save_cells(tmp_path, mesh, of_cells(mesh), {"time": time_})
    assert checkpoint.numbers(tmp_path) == {"time": 2.0}
    (tmp_path / checkpoint.FILE).write_bytes(b"PK half a file")
    assert checkpoint.numbers(tmp_path) == {"time": 1.0}
    assert checkpoint.load_cells(tmp_path, mesh)[1] == {"time": 1.0}


ENDLESS = """
import sys, itertools, pathlib
import numpy as np
from fem_tfm.output.checkpoint import _write
for number in itertools.count(1):
    _write(pathlib.Path(sys.argv[1]), {"number.time": np.array(number), "a": np.zeros(200000)})
    print(number, flush=True)
"""


def test_a_kill_while_writing_leaves_a_state(tmp_path: Path) -> None:
    """Killed at some moment of a write, the file holds one of the states written last."""
    for moment in range(3):
        command = [sys.executable, "-c", ENDLESS, str(tmp_path / str(moment))]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            last = [int(process.stdout.readline()) for _ in range(3)][-1]
            time.sleep(moment * 1e-3)
            process.kill()
            last = int((process.stdout.read().split() or [last])[-1])
        found = checkpoint.numbers(tmp_path / str(moment))
        assert last <= found["time"] <= last + 1

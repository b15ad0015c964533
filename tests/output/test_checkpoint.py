# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checkpoints give back fields, numbers and tables to the last digit."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from dolfinx import fem
from dolfinx.mesh import create_unit_square
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


def test_without_tables_there_are_none(tmp_path: Path) -> None:
    checkpoint.save(tmp_path, COMM, {}, {"step": 1})
    assert checkpoint.tables(tmp_path) == {}


def test_another_mesh_and_no_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a directory that holds a checkpoint"):
        checkpoint.load(tmp_path, COMM, {})
    assert checkpoint.numbers(tmp_path) == {}
    checkpoint.save(tmp_path, COMM, {"u": field(3)}, {})
    with pytest.raises(InputError, match="the same case and mesh"):
        checkpoint.load(tmp_path, COMM, {"u": field(4)})

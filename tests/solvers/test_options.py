# SPDX-License-Identifier: LGPL-3.0-or-later
"""The user's own PETSc options overrule the defaults of every linear solver."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator

import dolfinx_solver  # noqa: F401
import numpy as np
import pytest
from petsc4py import PETSc

from fem_tfm.solvers.newton import DirectSolver
from fem_tfm.solvers.options import configure

PREFIXES = ("fem_tfm_direct_", "mine_")


@pytest.fixture
def table() -> Iterator[PETSc.Options]:
    """PETSc's table of options without ours, and as it was afterwards."""
    options = PETSc.Options()
    before = options.getAll()
    for key in before:
        if key.startswith(PREFIXES):
            options.delValue(key)
    yield options
    for key in options.getAll():
        if key.startswith(PREFIXES):
            options.delValue(key)
    for key, value in before.items():
        options.setValue(key, value or None)


@pytest.fixture
def matrix() -> Iterator[PETSc.Mat]:
    """A small matrix."""
    found = PETSc.Mat().createAIJ([3, 3], comm=PETSc.COMM_SELF)
    found.setUp()
    for i in range(3):
        found.setValue(i, i, 2.0 + i)
    found.assemble()
    yield found
    found.destroy()


def test_a_default_is_set_where_the_user_has_said_nothing(table: PETSc.Options) -> None:
    ksp = PETSc.KSP().create(PETSc.COMM_SELF)
    configure(ksp, "mine_", {"ksp_type": "cg", "pc_type": "none"})
    assert (ksp.getType(), ksp.getPC().getType()) == ("cg", "none")


def test_what_the_user_has_set_stays(table: PETSc.Options) -> None:
    table["mine_ksp_type"] = "gmres"
    table["options_left"] = "yes"
    ksp = PETSc.KSP().create(PETSc.COMM_SELF)
    configure(ksp, "mine_", {"ksp_type": "cg", "pc_type": "none"})
    assert (ksp.getType(), ksp.getPC().getType()) == ("gmres", "none")
    assert table["mine_ksp_type"] == "gmres" and table["options_left"] == "yes"


def test_the_direct_solver_gives_mumps_room_unless_told_otherwise(
    table: PETSc.Options, matrix: PETSc.Mat
) -> None:
    for told, room in ((None, 60), (35, 35)):
        if told:
            table["fem_tfm_direct_mat_mumps_icntl_14"] = told
        solver = DirectSolver(matrix)
        solver.refactor(matrix)
        assert solver.ksp.getPC().getFactorMatrix().getMumpsIcntl(14) == room
        solver.destroy()


def test_the_direct_solver_may_be_another(table: PETSc.Options, matrix: PETSc.Mat) -> None:
    table["fem_tfm_direct_pc_factor_mat_solver_type"] = "superlu_dist"
    solver = DirectSolver(matrix)
    rhs, solution = matrix.createVecs()
    rhs.array[:] = 1
    solver.refactor(matrix)
    solver.solve(rhs, solution)
    assert solver.ksp.getPC().getFactorSolverType() == "superlu_dist"
    np.testing.assert_allclose(solution.array, [1 / 2, 1 / 3, 1 / 4])


def test_the_variable_of_the_environment_is_heard() -> None:
    program = (
        "import dolfinx_solver\nfrom petsc4py import PETSc\n"
        "from fem_tfm.solvers.options import configure\n"
        "ksp = PETSc.KSP().create()\nconfigure(ksp, 'mine_', {'ksp_type': 'cg'})\n"
        "print(ksp.getType())"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | {"PETSC_OPTIONS": "-mine_ksp_type gmres"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == "gmres"

# SPDX-License-Identifier: LGPL-3.0-or-later
"""The answer does not depend on the number of ranks."""

from __future__ import annotations

from pathlib import Path

import pytest
from mpi4py import MPI
from sections import DEMO, factorisations, quantities, solve

from fem_tfm import Case
from fem_tfm.models.two_fluid.quantities import balances


@pytest.mark.mpi
@pytest.mark.parametrize("level", [1, 3])
def test_ranks_agree_with_a_serial_run(level: int) -> None:
    """All ranks together and each alone find the same numbers, to 1e-8."""
    case = Case.load(Path(__file__).parents[2] / DEMO).with_values({"numerics.level": level})
    # together first: rank 0 compiles while the others wait
    together, alone = solve(case), solve(case, MPI.COMM_SELF)
    expected = quantities(alone)
    for name, value in quantities(together).items():
        assert value == pytest.approx(expected[name], rel=1e-8), name
    assert max(balances(together.section).values()) < 1e-9
    assert together.section.dofs == alone.section.dofs
    # round-off may decide on a last step
    counts = zip(factorisations(together), factorisations(alone), strict=True)
    assert all(abs(a - b) <= 2 for a, b in counts)


@pytest.mark.mpi
def test_ranks_share_the_mesh() -> None:
    """Every rank owns some of the unknowns, and all of them are owned once."""
    case = Case.load(Path(__file__).parents[2] / DEMO).with_values({"numerics.level": 1})
    mesh = case.scene.mesh()
    owned = mesh.mesh.topology.index_map(2).size_local
    shares = MPI.COMM_WORLD.allgather(owned)
    assert sum(shares) == mesh.num_cells
    assert min(shares) > 0

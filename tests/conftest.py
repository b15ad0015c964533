# SPDX-License-Identifier: LGPL-3.0-or-later
"""What all tests share; on several ranks only rank 0 reports, and files are in one place."""

from __future__ import annotations

import copy
import gc
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mpi4py import MPI

import fem_tfm  # noqa: F401  (loads MPI and PETSc in the order they need)

from petsc4py import PETSc  # isort: skip

RANK = MPI.COMM_WORLD.rank
ROOT = Path(__file__).parent.parent

DENSE = {
    "geometry": {"diameter": 0.01},
    "gas": {"density": 33.5, "viscosity": 1.8e-5},
    "solids": {"density": 1700.0, "diameter": 1.6e-4},
    "operation": {"gas_superficial_velocity": 6.43, "solids_fraction": 0.245},
}


@pytest.hookimpl(trylast=True)
def pytest_configure(config: pytest.Config) -> None:
    """Let rank 0 report for all."""
    if RANK > 0:
        config.pluginmanager.unregister(name="terminalreporter")


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Failures on another rank are shown all the same."""
    if RANK > 0 and report.failed:
        print(f"rank {RANK}: {report.nodeid}\n{report.longreprtext}", file=sys.stderr, flush=True)


@pytest.fixture(scope="module", autouse=True)
def freed(request: pytest.FixtureRequest) -> Iterator[None]:
    """Give back what the tests of a module share: MPI has some two thousand communicators."""
    yield
    for shared in vars(request.module).values():
        if hasattr(shared, "cache_clear"):
            shared.cache_clear()
    gc.collect()
    PETSc.garbage_cleanup()


@pytest.fixture
def tmp_path(tmp_path: Path) -> Path:
    """An empty directory, the same on all ranks."""
    return MPI.COMM_WORLD.bcast(tmp_path)


@pytest.fixture
def root() -> Path:
    """The checkout."""
    return ROOT


@pytest.fixture
def dense() -> dict[str, Any]:
    """The shortest complete case of dense flow, to be changed at will."""
    return copy.deepcopy(DENSE)

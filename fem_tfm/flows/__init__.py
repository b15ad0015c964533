# SPDX-License-Identifier: LGPL-3.0-or-later
"""Flows: each module puts mesh, model, solver and output together for one kind of scene."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from fem_tfm.case import FLOWS, SOLUTIONS, Case

if TYPE_CHECKING:
    from fem_tfm.output.result import Result
    from fem_tfm.progress import Progress


def _module(case: Case) -> ModuleType:
    own = SOLUTIONS.get(case.solution, {})
    return import_module(own.get(case.flow) or FLOWS[case.flow])


def run(
    case: Case, out: Path | None, *, resume: bool, overwrite: bool, progress: Progress
) -> Result:
    """Solve a case and write its results to `out` (nothing is written when it is None).

    Raises
    ------
    SolverError
        no answer was reached; the last good state and the reason are in `out`.
    """
    # late, so that this module loads without PETSc
    from fem_tfm.flows.driver import drive

    scene = _module(case).SCENE
    return drive(scene, case, out, resume=resume, overwrite=overwrite, progress=progress)


def describe(case: Case) -> dict[str, Any]:
    """What would be solved, what is left out and why, and what it would take."""
    return _module(case).describe(case)

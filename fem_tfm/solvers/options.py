# SPDX-License-Identifier: LGPL-3.0-or-later
"""Options of PETSc's linear solvers: defaults that the user's own settings overrule."""

from __future__ import annotations

from collections.abc import Mapping

from petsc4py import PETSc


def configure(ksp: PETSc.KSP, prefix: str, defaults: Mapping[str, object]) -> None:
    """Give a solver its options, by PETSc's names without the prefix.

    What stands in PETSc's table under the prefix stays: the user has put it there by the variable
    PETSC_OPTIONS or by `PETSc.Options()`, as in `-fem_tfm_direct_pc_factor_mat_solver_type
    superlu_dist`. The defaults stay in the table too, since parts of a preconditioner read theirs
    when they are first set up.

    Numbers that differ from solver to solver are no defaults of a prefix: set them on the solver
    before, and the user's settings overrule them as well.
    """
    ksp.setOptionsPrefix(prefix)
    table = PETSc.Options()
    # a multigrid of one level leaves some unread, which is no one's mistake
    wanted = {prefix + key: value for key, value in defaults.items()} | {"options_left": "no"}
    for key, value in wanted.items():
        if not table.hasName(key):
            table.setValue(key, value)
    ksp.setFromOptions()

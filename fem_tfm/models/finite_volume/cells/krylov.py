# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linear solvers of the equations of the cells."""

from __future__ import annotations

from petsc4py import PETSc

from fem_tfm.errors import SolverError
from fem_tfm.models.finite_volume.cells.matrix import CellMatrix
from fem_tfm.models.finite_volume.cells.mesh import Array
from fem_tfm.solvers.options import configure

SMALLEST = 1e-50
OPTIONS: dict[str, dict[str, object]] = {
    "transport": {
        "ksp_type": "bcgs",
        "pc_type": "bjacobi",
        "sub_pc_type": "ilu",
        # pivots have units: a small one is a small cell
        "sub_pc_factor_zeropivot": 1e-100,
    },
    "pressure": {
        "ksp_type": "cg",
        "pc_type": "gamg",
        "mg_levels_ksp_type": "richardson",
        "mg_levels_ksp_max_it": 1,
        "mg_levels_pc_type": "sor",
        "pc_gamg_threshold": 0.02,
    },
}


class Krylov:
    """A Krylov solver of one matrix; the preconditioner follows the matrix or is kept.

    PETSc options with the prefix fem_tfm_cells_transport_ or fem_tfm_cells_pressure_ replace those
    that are set here.

    Parameters
    ----------
    matrix : of the equations
    method : "transport" (BiCGStab, incomplete LU of each rank's part) or "pressure" (conjugate
        gradients, algebraic multigrid with Richardson and SOR smoothing)
    tolerance : of the residual over the right-hand side

    Attributes
    ----------
    iterations : of the last solution
    """

    def __init__(self, matrix: CellMatrix, method: str, tolerance: float) -> None:
        self.matrix, self._method, self._tolerance = matrix, method, tolerance
        self.x, self.b = matrix.matrix.createVecRight(), matrix.matrix.createVecLeft()
        self.iterations = 0
        self._create()

    def _create(self) -> None:
        """The solver without any preconditioner."""
        self.ksp = PETSc.KSP().create(self.matrix.cells.comm)
        self.ksp.setOperators(self.matrix.matrix)
        self.ksp.setInitialGuessNonzero(True)
        self.ksp.setTolerances(rtol=self._tolerance, atol=SMALLEST, max_it=300)
        prefix = f"fem_tfm_cells_{self._method}_"
        configure(self.ksp, prefix, OPTIONS[self._method])
        self._fixed = PETSc.Options().hasName(prefix + "ksp_atol")

    def update(self, keep: bool = False) -> None:
        """Take over new values of the matrix; `keep` the preconditioner of older ones."""
        self.ksp.setOperators(self.matrix.matrix)
        self.ksp.getPC().setReusePreconditioner(keep)

    def solve(self, rhs: Array, start: Array, enough: float = SMALLEST) -> Array:
        """Solution over the owned unknowns (collective).

        enough : norm of the preconditioned residual, in the unit of the unknowns, that ends the
            iterations, too

        Raises
        ------
        SolverError
            the iterations do not converge.
        """
        self.b.array[:] = rhs
        self.x.array[:] = start
        if not self._fixed:
            self.ksp.setTolerances(atol=max(enough, SMALLEST))
        self.ksp.solve(self.b, self.x)
        self.iterations = self.ksp.getIterationNumber()
        if self.ksp.is_diverged:
            raise SolverError(f"a linear solver stopped after {self.iterations} iterations")
        return self.x.array_r.copy()

    def reset(self) -> None:
        """Start anew: a multigrid keeps more from older matrices than its hierarchy."""
        self.ksp.destroy()
        self._create()

    def destroy(self) -> None:
        """Free the solver."""
        for held in (self.ksp, self.x, self.b):
            held.destroy()

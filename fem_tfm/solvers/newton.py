# SPDX-License-Identifier: LGPL-3.0-or-later
"""Newton's method for a monolithic system bordered by scalar constraints.

Solves F(W, m) = 0 with c_k(W) = 0, where the multipliers m_k enter F linearly::

    [ J  B ] [dW]     [F]
    [ C  0 ] [dm] = - [c]        B_k = dF/dm_k,  C_k = dc_k/dW

by block elimination: one factorisation of J, one solve per multiplier and one for F. It knows
forms, spaces and numbers, and no physics.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from mpi4py import MPI
from petsc4py import PETSc

from fem_tfm.solvers.options import configure

# owned unknowns and multipliers, or what is added to them
Change = tuple[np.ndarray, np.ndarray]
# MUMPS may take 60 % more memory than it foresees
DIRECT = {
    "ksp_type": "preonly",
    "pc_type": "lu",
    "pc_factor_mat_solver_type": "mumps",
    "mat_mumps_icntl_14": 60,
}
# a linear solution is refined at most so often, and not where its residual is this small
REFINEMENTS, EXACT = 1, 1e-10
# step lengths below this are a failure; corrections of this size are noise
SHORTEST, ROUND_OFF = 0.01, 1e-8
# share of a correction that a full step has to remove
DECREASE = 0.25
# polishing: each correction at most this share of the one before, and at most so many
CONTRACTION, MOST_POLISHES = 0.3, 8


@dataclass(frozen=True)
class Border:
    """A scalar unknown and the scalar equation that determines it.

    multiplier : the unknown, a Constant that enters the residual linearly
    column : linear form dF/dm
    constraint : rank-0 form whose assembled value must equal `target`
    row : linear form, the derivative of the constraint
    target : value of the constraint (a Constant or float)
    """

    multiplier: fem.Constant
    column: fem.Form
    constraint: fem.Form
    row: fem.Form
    target: fem.Constant


@dataclass(frozen=True)
class Block:
    """A group of unknowns measured and limited together.

    dofs : owned local indices
    scale : typical size, so that update/scale is relative
    limit : for logarithms, the largest change of one unknown in one step, or None
    follows : has no history of its own but follows the others at once, as a pressure does
    """

    name: str
    dofs: np.ndarray
    scale: float
    limit: float | None = None
    follows: bool = False


@dataclass(frozen=True)
class Update:
    """One Newton step.

    blocks : relative rms of the full correction of each block
    rest : size of the correction that remained after the step
    length : share of the correction that was taken
    """

    blocks: dict[str, float]
    rest: float
    length: float

    @property
    def size(self) -> float:
        """Largest relative correction."""
        return max(self.blocks.values())


class LinearSolveError(ArithmeticError):
    """The factorisation or a solve failed, or gave numbers that are not finite."""


class DirectSolver:
    """Factorisation of one matrix, by MUMPS, reused for any number of right-hand sides.

    PETSc's options begin with fem_tfm_direct_.
    """

    def __init__(self, matrix: PETSc.Mat) -> None:
        self._create(matrix)

    def _create(self, matrix: PETSc.Mat) -> None:
        self.failed = False
        self.ksp = PETSc.KSP().create(matrix.comm)
        self.ksp.setOperators(matrix)
        configure(self.ksp, "fem_tfm_direct_", DIRECT)

    def refactor(self, matrix: PETSc.Mat) -> None:
        """Factorise new values of the matrix."""
        if self.failed:
            # PETSc remembers a failure and would report it again whatever the values
            self.destroy()
            self._create(matrix)
        self.ksp.setOperators(matrix)
        try:
            self.ksp.setUp()
        except PETSc.Error as error:
            self.failed = True
            raise LinearSolveError("factorisation failed") from error

    def solve(self, rhs: PETSc.Vec, solution: PETSc.Vec, transposed: bool = False) -> None:
        """Solve with the last factorisation, or with its transpose."""
        (self.ksp.solveTranspose if transposed else self.ksp.solve)(rhs, solution)
        if self.ksp.is_diverged or not np.isfinite(solution.norm()):
            self.failed = True
            raise LinearSolveError("linear solve failed")

    def destroy(self) -> None:
        """Free the factors."""
        self.ksp.destroy()


class BorderedNewton:
    """Owns the matrix, the vectors and the factorisation of one bordered nonlinear system.

    Parameters
    ----------
    residual, jacobian : compiled forms F and dF/dW
    unknowns : the Function W, changed in place
    bcs : Dirichlet conditions that W fulfils already
    borders : scalar constraints with their multipliers
    blocks : groups of unknowns for norms and limits
    """

    def __init__(
        self,
        residual: fem.Form,
        jacobian: fem.Form,
        unknowns: fem.Function,
        bcs: Sequence[fem.DirichletBC],
        borders: Sequence[Border],
        blocks: Sequence[Block],
    ) -> None:
        self.residual = residual
        self.jacobian = jacobian
        self.unknowns = unknowns
        self.bcs = list(bcs)
        self.borders = list(borders)
        self.blocks = list(blocks)
        self.comm = unknowns.function_space.mesh.comm
        self.matrix = fem_petsc.create_matrix(jacobian)
        self.rhs = fem_petsc.create_vector(unknowns.function_space)
        self.work = self.rhs.duplicate()
        self.step_vector = self.rhs.duplicate()
        self.correction = self.rhs.duplicate()
        self.columns = [self.rhs.duplicate() for _ in borders]
        self.rows = [self.rhs.duplicate() for _ in borders]
        self.solved = [self.rhs.duplicate() for _ in borders]
        self.solver = DirectSolver(self.matrix)
        self.factorisations = 0

    def destroy(self) -> None:
        """Free every PETSc object."""
        self.solver.destroy()
        vectors = (self.rhs, self.work, self.step_vector, self.correction)
        for obj in (self.matrix, *vectors, *self.columns, *self.rows, *self.solved):
            obj.destroy()

    def _assemble(self, form: fem.Form, vector: PETSc.Vec) -> None:
        with vector.localForm() as local:
            local.set(0)
        fem_petsc.assemble_vector(vector, form)
        vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        for bc in self.bcs:
            bc.set(vector.array_w, alpha=0.0)

    def _constraint(self, border: Border) -> float:
        value = fem.assemble_scalar(border.constraint)
        return self.comm.allreduce(value, op=MPI.SUM) - float(border.target.value)

    def assemble_residual(self) -> np.ndarray:
        """Owned part of F at the current unknowns, zero on Dirichlet rows."""
        self._assemble(self.residual, self.rhs)
        return self.rhs.array_r

    def constraint_errors(self) -> list[float]:
        """c_k(W) - target of each border."""
        return [self._constraint(border) for border in self.borders]

    def step(self, saturate: bool = True, decrease: float = DECREASE) -> Update:
        """One Newton step on unknowns and multipliers, with one factorisation.

        The step k d is shortened until the simplified correction s = -J^-1 F(x + k d) has at most
        the size of (1 - k decrease) d (natural monotonicity, which does not depend on the scaling
        of the equations); a full step is followed by s itself.

        decrease : share of the correction that a full step has to remove
        saturate : cut far-off unknowns one by one, which is quicker; False shortens the whole step,
            which keeps its direction and gets through where the other way does not

        Raises
        ------
        LinearSolveError
            when the matrix is singular, a value is not finite, or no step length will do.
        """
        self.factor()
        start = self.position()
        change = self._tamed(self._correction(), saturate)
        size = self._sizes(change)
        length = self._longest(change)
        while True:
            self.move(start, change, length)
            try:
                follow = self._tamed(self._correction(), saturate)
                rest = self._sizes(follow)
            except LinearSolveError:
                rest = {"": math.inf}
            if max(rest.values()) <= (1 - length * decrease) * max(size.values()) + ROUND_OFF:
                break
            length /= 2
            if length < SHORTEST:
                self.move(start, change, 0.0)
                raise LinearSolveError("no step length brings Newton closer to a solution")
        if length == 1.0:
            self.move(self.position(), follow, self._longest(follow))
        return Update(size, max(rest.values()), length)

    def polish(
        self, tolerance: float, size: float = math.inf, saturate: bool = True
    ) -> tuple[float, float]:
        """Corrections with the last factorisation until they are below `tolerance`.

        It ends early where they do not shrink fast enough.

        size : of the correction before the first one
        saturate : as for `step`
        Returns the sizes of the first and of the last correction that was made.
        """
        first = math.inf
        for _ in range(MOST_POLISHES):
            change = self._tamed(self._correction(), saturate)
            found = max(self._sizes(change).values())
            if found > max(CONTRACTION * size, tolerance):
                break
            self.move(self.position(), change, 1.0)
            first, size = (found if math.isinf(first) else first), found
            if size <= tolerance:
                break
        return first, size

    def adjoint(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Adjoint (v, w) of one multiplier at a solution, with one factorisation.

            [ J^T  C^T ] [v]   [  0  ]
            [ B^T   0  ] [w] = [ e_n ]

        A change dF of the residual and dc of the constraints moves the multiplier by
        -(v.dF + w.dc).

        number : of the border whose multiplier it is
        Returns the owned part of v, and w.

        Raises
        ------
        LinearSolveError
            when the matrix is singular.
        """
        self.factor()
        schur = np.array([[row.dot(column) for column in self.solved] for row in self.rows])
        unit, rows = np.eye(len(self.borders))[number], np.zeros(len(self.borders))
        found = self.step_vector
        found.set(0)
        for _ in range(REFINEMENTS + 1):
            self.matrix.multTranspose(found, self.work)
            self.work.scale(-1)
            self._take_rows(rows, self.work)
            missing = unit - np.array([column.dot(found) for column in self.columns])
            change = np.array([column.dot(self.work) for column in self.solved]) - missing
            change = np.linalg.solve(schur.T, change)
            self._take_rows(change, self.work)
            self.solver.solve(self.work, self.correction, transposed=True)
            found.axpy(1, self.correction)
            rows += change
        return found.array_r.copy(), rows

    def _take_rows(self, factors: np.ndarray, vector: PETSc.Vec) -> None:
        """Subtract C^T times the factors from a vector."""
        for factor, row in zip(factors, self.rows, strict=True):
            vector.axpy(-factor, row)

    def factor(self) -> None:
        """Assemble the Jacobian at the unknowns and factorise it."""
        self.matrix.zeroEntries()
        fem_petsc.assemble_matrix(self.matrix, self.jacobian, bcs=self.bcs)
        self.matrix.assemble()
        self.solver.refactor(self.matrix)
        self.factorisations += 1
        for border, column, row, solved in zip(
            self.borders, self.columns, self.rows, self.solved, strict=True
        ):
            self._assemble(border.column, column)
            self._assemble(border.row, row)
            self.solver.solve(column, solved)

    def position(self) -> Change:
        """Owned unknowns and the multipliers."""
        owned = self.unknowns.x.array[: self.rhs.local_size].copy()
        return owned, np.array([float(b.multiplier.value) for b in self.borders])

    def move(self, start: Change, change: Change, k: float) -> None:
        """Go to start + k change."""
        self.unknowns.x.array[: start[0].size] = start[0] + k * change[0]
        self.unknowns.x.scatter_forward()
        for border, value, delta in zip(self.borders, start[1], change[1], strict=True):
            border.multiplier.value = value + k * delta

    def full_correction(self, factor: bool = True) -> Change:
        """Newton's full correction here, with a new factorisation or with the last one.

        Raises
        ------
        LinearSolveError
            when the matrix is singular or a value is not finite.
        """
        if factor:
            self.factor()
        return self._correction()

    def size(self, change: Change) -> float:
        """Largest relative rms of the blocks of a change (collective)."""
        return max(self._sizes(change).values())

    def _correction(self) -> Change:
        """Newton correction at the present position with the last factorisation.

        Block elimination, refined where it is not exact. J alone is nearly singular when only a
        constraint fixes a mode (the total mass at a large dt); refining against the bordered
        residual restores the digits that elimination loses there.
        """
        self.assemble_residual()
        if not math.isfinite(self.rhs.norm()):
            raise LinearSolveError("the residual is not finite")
        wanted = -np.array(self.constraint_errors())
        step, changes = self.step_vector, np.zeros(len(self.borders))
        step.set(0)
        self.rhs.copy(self.work)
        self.work.scale(-1)
        size, missing = self.work.norm(), wanted
        for _ in range(REFINEMENTS + 1):
            changes += self._eliminate(missing)
            self.matrix.mult(step, self.work)
            self.work.axpy(1, self.rhs)
            self.work.scale(-1)
            for change, column in zip(changes, self.columns, strict=True):
                self.work.axpy(-change, column)
            missing = wanted - np.array([row.dot(step) for row in self.rows])
            if self.work.norm() <= EXACT * size:
                break
        return step.array_r.copy(), changes

    def _eliminate(self, wanted: np.ndarray) -> np.ndarray:
        """Add the solution for right-hand sides `work` and `wanted` to `step_vector`."""
        self.solver.solve(self.work, self.correction)
        schur = np.array([[row.dot(column) for column in self.solved] for row in self.rows])
        rhs = np.array([row.dot(self.correction) for row in self.rows]) - wanted
        self.step_vector.axpy(1, self.correction)
        if not self.borders:
            return rhs
        try:
            changes = np.linalg.solve(schur, rhs)
        except np.linalg.LinAlgError as error:
            raise LinearSolveError("the constraints are dependent") from error
        for change, column in zip(changes, self.solved, strict=True):
            self.step_vector.axpy(-change, column)
        return changes

    def _sizes(self, change: Change) -> dict[str, float]:
        """Relative rms of each block of a correction."""
        sizes = {b.name: self.relative_rms(b, change[0]) for b in self.blocks}
        if not all(map(math.isfinite, sizes.values())):
            raise LinearSolveError("the Newton step is not finite")
        return sizes

    def _tamed(self, change: Change, saturate: bool) -> Change:
        """A correction with its limited blocks saturated, unknown by unknown, if asked for.

        d becomes sign(d) ln(1 + |d|), for growth Newton's step of the exponential, and is cut
        at the limit.
        """
        for block in self.blocks if saturate else ():
            if block.limit is not None:
                raw = change[0][block.dofs]
                mild = np.copysign(np.log1p(np.abs(raw)), raw)
                change[0][block.dofs] = np.clip(mild, -block.limit, block.limit)
        return change

    def _longest(self, change: Change) -> float:
        """Share of a correction, at most 1, that keeps every limited block within its limit."""
        share = 1.0
        for block in self.blocks:
            if block.limit is not None:
                peak = self.comm.allreduce(np.abs(change[0][block.dofs]).max(initial=0.0), MPI.MAX)
                share = min(share, block.limit / max(peak, 1e-300))
        return share

    def relative_rms(self, block: Block, values: np.ndarray) -> float:
        """Root mean square of a block of `values` in its scale (collective)."""
        return self._rms(values[block.dofs]) / block.scale

    def _rms(self, values: np.ndarray) -> float:
        total = self.comm.allreduce(np.array([np.dot(values, values), values.size]))
        return math.sqrt(total[0] / max(total[1], 1.0))

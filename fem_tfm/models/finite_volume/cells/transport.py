# SPDX-License-Identifier: LGPL-3.0-or-later
"""Implicit transport of positive values of the cells, by an M-matrix."""

from __future__ import annotations

import numpy as np

from fem_tfm.models.finite_volume.cells.krylov import Krylov
from fem_tfm.models.finite_volume.cells.line import LineMesh
from fem_tfm.models.finite_volume.cells.matrix import CellMatrix
from fem_tfm.models.finite_volume.cells.mesh import Array, Index
from fem_tfm.models.finite_volume.scheme import FirstOrder
from fem_tfm.models.finite_volume.state import TRANSPORT_TOLERANCE

# share of what a cell holds that corrections of second order may take out of it
MOST_OUT = 0.5


class ScalarTransport:
    """Convection and diffusion of scalars, one after the other in the same matrix.

    The equations of granular temperature and turbulence share it: every call sets all its values.

    Parameters
    ----------
    line, scheme : mesh and order
    """

    def __init__(self, line: LineMesh, scheme: FirstOrder) -> None:
        self.line, self.scheme = line, scheme
        self._matrix = CellMatrix(line.cells)
        self._krylov = Krylov(self._matrix, "transport", TRANSPORT_TOLERANCE)

    def solve(
        self,
        flux: Array,
        diffusion: Array,
        diagonal: Array,
        rhs: Array,
        guess: Array,
        entering: float,
        share: Array,
        prescribed: tuple[Index, Array] | None = None,
    ) -> tuple[Array, int]:
        """Values X > 0 of the owned cells, and the iterations that they took (collective).

            s X + sum_in F (X - X_upwind) + sum D |S|^2/(S.d) (X - X_other) = b

        flux (faces) : F
        diffusion (cells) : D, interpolated to the faces
        diagonal, rhs, guess (owned) : s > 0, b > 0, and where the iterations begin
        entering : X at the inlet
        share (faces) : share of the second order
        prescribed : owned cells whose values are given, and these

        Raises
        ------
        SolverError
            the linear solver does not converge.
        """
        line, cells = self.line, self.line.cells
        ahead, back = np.maximum(flux, 0.0), np.maximum(-flux, 0.0)
        spread = cells.to_faces(diffusion) * cells.face_weight
        spread[cells.inner_count :] = 0.0
        diagonal = diagonal + cells.sum_by_side(back, ahead) + cells.sum_faces(spread)
        rhs = rhs.copy()
        if line.has_inlet:
            cells.add_boundary("inlet", rhs, back[line.inlet] * entering)
        across = -(back + spread)[line.inner], -(ahead + spread)[line.inner]
        if prescribed is not None:
            across = self._prescribe(prescribed, diagonal, rhs, across)
        self._matrix.set([diagonal], [across])
        self._krylov.update()
        values, iterations = guess, 0
        for _ in range(self.scheme.solves):
            explicit = rhs - self.scheme.net_bounded_correction(
                flux, values, share, MOST_OUT * rhs, np.inf
            )
            if prescribed is not None:
                explicit[prescribed[0]] = rhs[prescribed[0]]
            values = self._krylov.solve(explicit, values)
            iterations += self._krylov.iterations
        return values, iterations

    def _prescribe(
        self,
        prescribed: tuple[Index, Array],
        diagonal: Array,
        rhs: Array,
        across: tuple[Array, Array],
    ) -> tuple[Array, Array]:
        """Give cells their values: in `rhs`, and without entries of other cells in their rows."""
        cells, (where, values) = self.line.cells, prescribed
        rhs[where] = diagonal[where] * values
        free = np.ones(cells.count)
        free[where] = 0.0
        first = cells.first[self.line.inner]
        return across[0] * free[first], across[1] * free[cells.second]

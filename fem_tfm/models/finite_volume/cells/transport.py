# SPDX-License-Identifier: LGPL-3.0-or-later
"""Transport of positive values of the cells: implicit, upwind, by an M-matrix."""

from __future__ import annotations

import numpy as np

from fem_tfm.models.finite_volume.cells.krylov import Krylov
from fem_tfm.models.finite_volume.cells.limiter import limit_flux
from fem_tfm.models.finite_volume.cells.line import LineMesh
from fem_tfm.models.finite_volume.cells.matrix import CellMatrix
from fem_tfm.models.finite_volume.cells.mesh import Array
from fem_tfm.models.finite_volume.state import SECOND_ORDER_SOLVES, TRANSPORT_TOLERANCE

# share of what a cell holds that slopes may take out of it
MOST_BY_SLOPES = 0.5


class ScalarTransport:
    """Carries values by a flux and spreads them.

    Parameters
    ----------
    line : mesh
    matrix : scalar matrix, whose values are overwritten
    """

    def __init__(self, line: LineMesh, matrix: CellMatrix) -> None:
        self.line, self.matrix = line, matrix
        self._krylov = Krylov(matrix, "transport", TRANSPORT_TOLERANCE)
        self.iterations = 0

    def solve(
        self,
        flux: Array,
        diffusion: Array,
        diagonal: Array,
        side: Array,
        guess: Array,
        entering: float = 0.0,
        linear: Array | None = None,
        held: tuple[Array, Array] | None = None,
    ) -> Array:
        """Values X > 0 of the owned cells (collective), with s > 0 the diagonal and b > 0 the side:

            s X + sum_in F (X - X_upwind) + sum D |S|^2/(S.d) (X - X_beyond) = b

        flux (faces), diffusion (cells) : F, and D on cells, of which faces take the mean
        diagonal, side, guess (owned) : s, b and where the iterations begin
        entering : X of what enters
        linear (faces) : share of linear values in cells, None for upwind ones
        held : cells (owned) whose values are given, and these

        Raises
        ------
        SolverError
            the linear solver does not converge.
        """
        line, cells, inner = self.line, self.line.cells, self.line.inner
        spread = cells.to_faces(diffusion) * cells.face_weight
        spread[cells.inner_count :] = 0.0
        ahead, back = np.maximum(flux, 0.0), np.maximum(-flux, 0.0)
        diagonal = diagonal + cells.sum_by_side(back, ahead) + cells.sum_faces(spread)
        side = side.copy()
        if line.has_inlet:
            cells.add_boundary("inlet", side, back[line.inlet] * entering)
        across = -(back + spread)[inner], -(ahead + spread)[inner]
        if held is not None:
            where, values = held
            free = np.ones(cells.count)
            free[where] = 0.0
            side[where] = diagonal[where] * values
            across = across[0] * free[cells.first[inner]], across[1] * free[cells.second]
        self.matrix.set([diagonal], [across])
        self._krylov.update()
        found, self.iterations = guess, 0
        for _ in range(1 if linear is None else SECOND_ORDER_SOLVES):
            later = side
            if linear is not None:
                beyond = self._beyond(flux, found, linear, side)
                if held is not None:
                    beyond[held[0]] = 0.0
                later = side - beyond
            found = self._krylov.solve(later, found)
            self.iterations += self._krylov.iterations
        return found

    def _beyond(self, flux: Array, values: Array, linear: Array, side: Array) -> Array:
        """What slopes take out of each owned cell, no more than a share of what is there."""
        line, cells = self.line, self.line.cells
        values = cells.ghosted(values)
        gradient = cells.ghosted(cells.gradient(values))
        beyond = line.second_order_flux(flux, values, cells.to_faces(values)[line.inner], gradient)
        most = np.full(cells.owned, np.inf)
        return cells.net_flux(limit_flux(cells, linear * beyond, MOST_BY_SLOPES * side, most))

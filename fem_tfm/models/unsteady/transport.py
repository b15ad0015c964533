# SPDX-License-Identifier: LGPL-3.0-or-later
"""Transport of positive values of the cells: implicit, upwind, by an M-matrix."""

from __future__ import annotations

import numpy as np

from fem_tfm.models.unsteady.line import Line
from fem_tfm.models.unsteady.state import SLOPES, TRANSPORT_TOLERANCE
from fem_tfm.solvers.cells import Array, CellMatrix, Krylov

# share of what a cell holds that slopes may take out of it
MOST_BY_SLOPES = 0.5


class Transport:
    """Carries values by a flux and spreads them.

    Parameters
    ----------
    line : mesh
    matrix : scalar matrix, whose values are overwritten
    """

    def __init__(self, line: Line, matrix: CellMatrix) -> None:
        self.line, self.matrix = line, matrix
        self._krylov = Krylov(matrix, "transport", TRANSPORT_TOLERANCE)
        self.iterations = 0

    def carry(
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
        spread = cells.mean(diffusion) * cells.reach
        spread[cells.inner :] = 0.0
        ahead, back = np.maximum(flux, 0.0), np.maximum(-flux, 0.0)
        diagonal = diagonal + cells.sum_out(back, ahead) + cells.add(spread)
        side = side.copy()
        if line.has_inlet:
            cells.to_boundary("inlet", side, back[line.inlet] * entering)
        across = -(back + spread)[inner], -(ahead + spread)[inner]
        if held is not None:
            where, values = held
            free = np.ones(cells.count)
            free[where] = 0.0
            side[where] = diagonal[where] * values
            across = across[0] * free[cells.first[inner]], across[1] * free[cells.second]
        self.matrix.set([diagonal], [across])
        self._krylov.renew()
        found, self.iterations = guess, 0
        for _ in range(1 if linear is None else SLOPES):
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
        values = cells.whole(values)
        gradient = cells.whole(cells.gradient(values))
        beyond = line.beyond(flux, values, cells.mean(values)[line.inner], gradient)
        most = np.full(cells.owned, np.inf)
        return cells.sum(cells.within(linear * beyond, MOST_BY_SLOPES * side, most))

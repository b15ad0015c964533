# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sparse matrix of the equations of the cells."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from fem_tfm.models.finite_volume.cells.mesh import Array, Cells, Index


class CellMatrix:
    """Sparse matrix that couples each cell with the cells across its faces.

    The unknowns of a cell couple with each other, and each with the same unknown across a face.

    Parameters
    ----------
    cells : mesh
    width : number of unknowns in a cell (phases)
    components : number of components of each of them
    coupled : owned cells in which the components of an unknown couple with each other
    """

    def __init__(
        self, cells: Cells, width: int = 1, components: int = 1, coupled: Index | None = None
    ) -> None:
        self.cells, self.components = cells, components
        first, second = cells.first[: cells.inner_count], cells.second
        # inner faces whose first and whose second cell is owned; a slice costs nothing
        self._mine, self._yours = (
            slice(None) if (cell < cells.owned).all() else np.flatnonzero(cell < cells.owned)
            for cell in (first, second)
        )
        rows, columns = [], []
        own, many = np.arange(cells.owned), width * components
        for start in range(0, many, width):
            for i in range(start, start + width):
                for j in range(start, start + width):
                    rows.append(own * many + i)
                    columns.append(own * many + j)
        for i in range(many):
            for a, b, mask in ((first, second, self._mine), (second, first, self._yours)):
                rows.append(a[mask] * many + i)
                columns.append(b[mask] * many + i)
        for i, j in itertools.permutations(range(components), 2):
            assert coupled is not None
            for k in range(width):
                rows.append(coupled * many + i * width + k)
                columns.append(coupled * many + j * width + k)
        self._assign(np.concatenate(rows), np.concatenate(columns), many)

    def _assign(self, rows: Array, columns: Array, many: int) -> None:
        """Place every entry in the arrays of the matrix, which PETSc shares."""
        cells = self.cells
        local = cells.owned * many
        self._blocks: list[tuple[Array, npt.NDArray[np.intp]]] = []
        parts = []
        for far in (False, True):
            # incomplete factorisation needs the entries of a row in order
            order = np.flatnonzero((columns >= local) == far)
            order = order[np.lexsort((columns[order], rows[order]))]
            begins = np.searchsorted(rows[order], np.arange(local + 1))
            place = columns[order]
            if far:
                cell = cells.map.local_to_global((place // many).astype(np.int32))
                place = cell * many + place % many
            values = np.zeros(order.size)
            self._blocks.append((values, order))
            parts.append((begins.astype(PETSc.IntType), place.astype(PETSc.IntType), values))
        size = (local, cells.map.size_global * many)
        csr = parts[0] if cells.comm.size == 1 else tuple(parts)
        self.matrix = PETSc.Mat().createAIJWithArrays((size, size), csr, comm=cells.comm)

    def set(
        self,
        diagonal: Sequence[Array],
        across: Sequence[tuple[Array, Array]],
        couplings: Sequence[Array] = (),
    ) -> None:
        """Set all entries (collective).

        diagonal : for each component, width^2 arrays over owned cells, row by row
        across : for each unknown, entries over inner faces in the row of the first cell and in that
            of the second, the same for all components
        couplings : for each pair of components, entries of each unknown over the coupled cells
        """
        values = list(diagonal)
        for of_first, of_second in [*across] * self.components:
            values += [of_first[self._mine], of_second[self._yours]]
        entries = np.concatenate([*values, *couplings])
        for block, order in self._blocks:
            np.take(entries, order, out=block, mode="clip")
        self.matrix.assemble()

    def destroy(self) -> None:
        """Free the matrix."""
        self.matrix.destroy()

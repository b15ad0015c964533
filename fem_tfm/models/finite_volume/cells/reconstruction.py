# SPDX-License-Identifier: LGPL-3.0-or-later
"""Vectors in cells from their normal components on faces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from fem_tfm.models.finite_volume.cells.mesh import Array, Cells, narrow


class Reconstruction:
    """Vectors in cells from their normal components u_n on faces, by least squares.

        u = (sum c S S/|S|)^-1 sum c S u_n

    exact for a uniform field. Faces of the boundary parts `without` are left out; the weight c of
    the others is one unless it is given.
    """

    def __init__(self, cells: Cells, without: Sequence[str]) -> None:
        used = np.ones(cells.face_count)
        for name in without:
            used[cells.parts[name]] = 0.0
        weight = used / cells.face_area
        products = cells.area[:, :, None] * cells.area[:, None, :] * weight[:, None, None]
        matrix = cells.sum_faces(products.reshape(-1, 9)).reshape(-1, 3, 3)
        self._matrix, inverse = matrix, np.linalg.inv(matrix)
        # S u_n does not depend on the direction of S: one sum for both cells of a face
        rows_of_component = []
        faces = cells.from_first + cells.from_second
        for i in range(3):
            part = 0
            for j in range(3):
                rows = sparse.diags_array(inverse[:, i, j])
                columns = sparse.diags_array(cells.area[:, j] * used)
                part = part + rows @ faces @ columns
            rows_of_component.append(sparse.csr_array(part))
        self._operator = narrow(sparse.csr_array(sparse.vstack(rows_of_component)))
        self._cells = cells

    def __call__(
        self, normal: Array, partial: tuple[npt.NDArray, npt.NDArray, Array] | None = None
    ) -> Array:
        """Vectors (owned, 3) from components along the area vectors (faces).

        partial : inner faces with c < 1 for one of their cells, side of it (0: the first), and c
        """
        found = (self._operator @ normal).reshape(3, -1).T
        if partial is None:
            return found
        cells, (face, side, count) = self._cells, partial
        cell = np.where(side, cells.second[face], cells.first[face])
        ours = cell < cells.owned
        if not ours.any():
            return found
        face, cell, lack = face[ours], cell[ours], 1 - count[ours]
        here, place = np.unique(cell, return_inverse=True)
        area = cells.area[face]
        along = area / cells.face_area[face, None]
        off = lack * (np.einsum("ni,ni->n", along, found[cell]) - normal[face])

        def gather(values: Array) -> Array:
            return np.bincount(place, values, here.size)

        rest = np.stack([gather(off * area[:, i]) for i in range(3)], axis=1)
        lost = np.empty((here.size, 3, 3))
        for i in range(3):
            for j in range(i + 1):
                lost[:, i, j] = lost[:, j, i] = gather(lack * area[:, i] * along[:, j])
        found[here] += _solved(self._matrix[here] - lost, rest)
        return found


def _solved(matrix: Array, side: Array) -> Array:
    """Solutions (n, 3) of symmetric 3 x 3 systems by Cramer's rule."""
    a, b, c = matrix[:, 0], matrix[:, 1], matrix[:, 2]
    rows = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
    return np.einsum("nij,nj->ni", rows, side) / np.einsum("ni,ni->n", a, rows[:, 0])[:, None]

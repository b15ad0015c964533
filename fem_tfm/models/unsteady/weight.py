# SPDX-License-Identifier: LGPL-3.0-or-later
"""Weight of the solids on faces, such that a column at rest stays at rest.

A face takes half of the weight of either cell by interpolation. What a cell lays on the face above
its centre, only its own pressure of the solids can bear: at the surface of a bed there is nothing
above. Where that pressure is too small, the rest is laid on the face below, so that

    p_s - p_s_above = (alpha_f) (rho_s - rho_g) g d

has a solution for every column, and all faces of a column that fulfils it are without force.
"""

from __future__ import annotations

import numpy as np

from fem_tfm.models.unsteady.line import Line
from fem_tfm.models.unsteady.state import LONELY_FRACTION, Bearing
from fem_tfm.solvers.cells import Array

# faces are above or below a cell if they lie flatter than this: |g.n|/|g|
FLAT = 0.2
# least weight of a face in what a cell takes from its faces
LEAST = 1e-8


class Weight:
    """Lays the weight of the solids on faces.

    Parameters
    ----------
    line : mesh
    gravity : vector [m/s2]
    excess : rho_s - rho_g [kg/m3]
    """

    def __init__(self, line: Line, gravity: Array, excess: float) -> None:
        self.line = line
        cells, inner = line.cells, line.inner
        down, size = excess * line.normal[inner] @ gravity, excess * np.linalg.norm(gravity)
        flat = np.minimum(1.0, np.abs(down) / (FLAT * abs(size))) if size else 0 * down
        # pressure over fraction that bears what interpolation lays on a face [Pa]
        most = np.abs(down) / line.normal_slope[inner]
        self._sides = [
            (cell, share, share * most, np.where(above, -flat, flat))
            for cell, share, above in (
                (cells.first[inner], cells.share, down < 0),
                (cells.second, 1 - cells.share, down > 0),
            )
        ]

    def bear(self, alpha: Array, p_s: Array) -> Bearing:
        """Where solids of a fraction and a pressure [Pa] lay their weight, both in all cells."""
        share, counts, moved = self.line.cells.mean(alpha), [], []
        # grains that are all but alone fall whatever bears them
        there = alpha > LONELY_FRACTION
        for cell, part, needed, way in self._sides:
            unborne = needed * alpha[cell] - p_s[cell]
            face = np.flatnonzero((unborne > 0) & there[cell] & (way != 0))
            here = cell[face]
            lack = unborne[face] / (needed[face] * alpha[here]) * way[face]
            count = np.ones(cell.size)
            count[face] = np.where(lack < 0, np.maximum(1 + lack, LEAST), 1.0)
            counts.append(count)
            moved.append((face, here, lack * part[face] * alpha[here]))
        found = tuple(np.concatenate(x) for x in zip(*moved, strict=True))
        np.add.at(share, found[0], found[2])
        return Bearing(share, tuple(counts), found)

    def mean_force(self, bearing: Bearing, alpha: Array, acceleration: Array) -> Array:
        """Normal component of alpha a on faces, of what they bear of their cells [m/s2].

        acceleration : in all cells (cells, 3) [m/s2]
        """
        cells, (face, cell, part) = self.line.cells, bearing.moved
        found = cells.flux(alpha[:, None] * acceleration) / cells.size
        along = np.einsum("ni,ni->n", acceleration[cell], self.line.normal[face])
        np.add.at(found, face, part * along)
        return found

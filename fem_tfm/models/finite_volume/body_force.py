# SPDX-License-Identifier: LGPL-3.0-or-later
"""Weight of the solids on faces, balanced so that a column at rest stays at rest.

By interpolation a face carries half of the weight of either cell. The half above the centre of a
cell needs the solids pressure of that cell alone, which may be too small at the surface of a bed.
The remainder is carried by the face below, so that at rest

    p_s - p_s_above = alpha_f (rho_s - rho_g) g d

holds on every face of a column, whatever the uppermost cell contains. The acceleration of a cell
then follows the faces that carry its weight.
"""

from __future__ import annotations

import numpy as np

from fem_tfm.models.finite_volume.cells.line import LineMesh
from fem_tfm.models.finite_volume.cells.mesh import Array
from fem_tfm.models.finite_volume.state import FaceSupport

# faces with a smaller vertical part of the normal, |g.n|/|g|, count as above a cell in part
UPRIGHT = 0.2
# a face is a surface in full, and not at all, where the solids fraction above it over that below is
SURFACE = 0.25, 0.5
# smallest weight of a face in the reconstruction of a cell
LEAST = 1e-8


class BodyForceBalance:
    """Distributes the weight of the solids over the faces.

    Parameters
    ----------
    line : mesh
    gravity : acceleration (3,) [m/s2]
    excess : rho_s - rho_g [kg/m3]
    """

    def __init__(self, line: LineMesh, gravity: Array, excess: float) -> None:
        self.line = line
        cells, inner = line.cells, line.inner
        down, largest = excess * (line.normal[inner] @ gravity), excess * np.linalg.norm(gravity)
        self._faces = np.flatnonzero(down)
        down = down[self._faces]
        first, second = cells.first[self._faces], cells.second[self._faces]
        self._first_is_high = down > 0
        self._low = np.where(self._first_is_high, second, first)
        self._high = np.where(self._first_is_high, first, second)
        weight = cells.interpolation_weight[self._faces]
        self._weight_of_low = np.where(self._first_is_high, 1 - weight, weight)
        self._upright = np.minimum(1.0, np.abs(down) / (UPRIGHT * abs(largest)))
        # pressure over fraction that carries what interpolation gives to a face [Pa]
        self._needed = self._weight_of_low * np.abs(down) / line.inverse_distance[self._faces]
        # share of each face among the faces above its lower cell
        area = np.abs(down) * cells.face_area[self._faces]
        self._share_above = area / np.bincount(self._low, area, cells.count)[self._low]

    def support(self, alpha: Array, p_s: Array) -> FaceSupport:
        """Fraction of the solids that each face carries (collective).

        alpha, p_s : solids fraction [-] and pressure [Pa] in all cells
        """
        cells, (full, none) = self.line.cells, SURFACE
        below, above = alpha[self._low], alpha[self._high]
        is_surface = (above < none * below) & (p_s[self._low] < self._needed * below)
        surface = np.flatnonzero(is_surface)
        low, below, above = self._low[surface], below[surface], above[surface]
        # share of the interpolated weight that the pressure of the lower cell does not carry
        sharpness = np.minimum((none - above / below) / (none - full), 1.0)
        missing = sharpness * (1 - p_s[low] / (self._needed[surface] * below))
        lost = np.bincount(low, self._share_above[surface] * missing, cells.count)
        lost = cells.update_ghosts(lost)[self._high]
        missing *= self._upright[surface]
        # the faces below these cells carry it
        lower = np.flatnonzero(lost)
        faces = np.concatenate([self._faces[surface], self._faces[lower]])
        cell = np.concatenate([low, self._high[lower]])
        added = (1 - self._weight_of_low) * self._upright * lost
        shifted = np.concatenate([-missing * self._weight_of_low[surface], added[lower]])
        shifted = shifted * alpha[cell]
        fraction = cells.to_faces(alpha)
        np.add.at(fraction, faces, shifted)
        side = np.where(self._first_is_high[surface], 1, 0)
        weight = np.maximum(1 - missing, LEAST)
        return FaceSupport(fraction, (self._faces[surface], side, weight), (faces, cell, shifted))

    def mean_force(self, support: FaceSupport, alpha: Array, acceleration: Array) -> Array:
        """alpha a.n on faces, of the fraction of their cells that the faces carry [m/s2].

        acceleration : a in all cells (cells, 3) [m/s2]
        """
        cells, (face, cell, fraction) = self.line.cells, support.shifted
        found = cells.flux(alpha[:, None] * acceleration) / cells.face_area
        normal_part = np.einsum("ni,ni->n", acceleration[cell], self.line.normal[face])
        np.add.at(found, face, fraction * normal_part)
        return found

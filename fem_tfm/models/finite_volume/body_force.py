# SPDX-License-Identifier: LGPL-3.0-or-later
"""Weight of the solids on faces, such that a column at rest stays at rest.

By interpolation a face bears half of the weight of either cell. What a cell lays on the face above
its centre only its own pressure of the solids can bear, and at the surface of a bed that may be too
small: there the rest is laid on the face below, so that at rest

    p_s - p_s_above = alpha_f (rho_s - rho_g) g d

holds on every face of a column, whatever fills its uppermost cell. Cells then follow the faces that
bear them, and not those that bear nothing.
"""

from __future__ import annotations

import numpy as np

from fem_tfm.models.finite_volume.cells.line import LineMesh
from fem_tfm.models.finite_volume.cells.mesh import Array
from fem_tfm.models.finite_volume.state import FaceSupport

# faces that lie flatter than this are above and below their cells: |g.n|/|g|
FLAT = 0.2
# solids fraction above a face over that below it where it is all of a surface, and where it is none
SURFACE = 0.25, 0.5
# least that a face counts for a cell
LEAST = 1e-8


class BodyForceBalance:
    """Lays the weight of the solids on faces.

    Parameters
    ----------
    line : mesh
    gravity : vector [m/s2]
    excess : rho_s - rho_g [kg/m3]
    """

    def __init__(self, line: LineMesh, gravity: Array, excess: float) -> None:
        self.line = line
        cells, inner = line.cells, line.inner
        down, size = excess * (line.normal[inner] @ gravity), excess * np.linalg.norm(gravity)
        self._faces = np.flatnonzero(down)
        down = down[self._faces]
        first, second = cells.first[self._faces], cells.second[self._faces]
        self._ahead = down > 0
        self._low = np.where(self._ahead, second, first)
        self._high = np.where(self._ahead, first, second)
        share = cells.interpolation_weight[self._faces]
        self._of_low = np.where(self._ahead, 1 - share, share)
        self._flat = np.minimum(1.0, np.abs(down) / (FLAT * abs(size)))
        # pressure over fraction that bears what interpolation lays on a face [Pa]
        self._needed = self._of_low * np.abs(down) / line.inverse_distance[self._faces]
        # a face among those above its lower cell
        roof = np.abs(down) * cells.face_area[self._faces]
        self._part = roof / np.bincount(self._low, roof, cells.count)[self._low]

    def support(self, alpha: Array, p_s: Array) -> FaceSupport:
        """Faces that solids of a fraction [-] and a pressure [Pa] rest on (collective).

        alpha, p_s : in all cells
        """
        cells = self.line.cells
        share = cells.to_faces(alpha)
        below, above = alpha[self._low], alpha[self._high]
        full, none = SURFACE
        bare = np.flatnonzero((above < none * below) & (p_s[self._low] < self._needed * below))
        low, held = self._low[bare], below[bare]
        surface = np.minimum((none - above[bare] / held) / (none - full), 1.0)
        unborne = surface * (1 - p_s[low] / (self._needed[bare] * held))
        lost = np.bincount(low, self._part[bare] * unborne, cells.count)
        lost = cells.update_ghosts(lost)[self._high]
        unborne *= self._flat[bare]
        laid = np.flatnonzero(lost)
        faces = np.concatenate([self._faces[bare], self._faces[laid]])
        here = np.concatenate([low, self._high[laid]])
        more = (1 - self._of_low) * self._flat * lost
        shifted = np.concatenate([-unborne * self._of_low[bare], more[laid]]) * alpha[here]
        np.add.at(share, faces, shifted)
        sides = np.where(self._ahead[bare], 1, 0)
        count = np.maximum(1 - unborne, LEAST)
        return FaceSupport(share, (faces[: bare.size], sides, count), (faces, here, shifted))

    def mean_force(self, support: FaceSupport, alpha: Array, acceleration: Array) -> Array:
        """alpha a along the normals of faces, of what these bear of their cells [m/s2].

        acceleration : in all cells (cells, 3) [m/s2]
        """
        cells, (face, cell, part) = self.line.cells, support.shifted
        found = cells.flux(alpha[:, None] * acceleration) / cells.face_area
        along = np.einsum("ni,ni->n", acceleration[cell], self.line.normal[face])
        np.add.at(found, face, part * along)
        return found

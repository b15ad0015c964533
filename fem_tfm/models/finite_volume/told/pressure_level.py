# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pressure with the weight of the gas, from face to face of a line.

The equations of a step leave out the weight of a gas of one density rho_0. What others read holds
it, as in every other solution:

    P - P_outlet = p + rho_0 g.(x - x_outlet)

P_outlet is the mean at the outlet and x_outlet the centre of the outlet. The drop of the line is
the mean over the faces of the inlet, to which the pressure of the first cells is extrapolated.
"""

from __future__ import annotations

import numpy as np

from fem_tfm.models.finite_volume.cells.line import LineMesh
from fem_tfm.models.finite_volume.cells.mesh import Array


class PressureLevel:
    """Pressure above the mean at the outlet.

    Parameters
    ----------
    line : mesh
    gravity : acceleration (3,) [m/s2]
    density : rho_0, whose weight p leaves out [kg/m3]
    """

    def __init__(self, line: LineMesh, gravity: Array, density: float) -> None:
        self.line = line
        cells, weight = line.cells, density * gravity
        size, middle = cells.face_area[line.outlet], cells.face_centre[line.outlet]
        area = max(cells.total(size), 1e-300)
        outlet = np.array([cells.total(size * middle[:, i]) for i in range(3)]) / area
        self._of_cells = (cells.centre - outlet) @ weight
        self._of_inlet = (cells.face_centre[line.inlet] - outlet) @ weight

    def of_cells(self, p: Array) -> Array:
        """P - P_outlet in all cells [Pa]."""
        return p + self._of_cells

    def drop(self, p: Array) -> float:
        """Mean of P - P_outlet over the faces of the inlet [Pa] (collective)."""
        line, cells = self.line, self.line.cells
        if not line.has_inlet:
            return 0.0
        entry, size = cells.first[line.inlet], cells.face_area[line.inlet]
        rise = np.einsum("ij,ij->i", cells.gradient(p)[entry], cells.delta[line.inlet])
        found = cells.total(size * (p[entry] + rise + self._of_inlet))
        return found / max(cells.total(size), 1e-300)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""The arc in the axis of a bent line: a map between straight and bent coordinates."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

# normals to the axis at the inlet, along which a bend turns
TOWARDS = {"up": (0.0, 1.0), "down": (0.0, -1.0), "side": (1.0, 0.0)}


@dataclass(frozen=True)
class Arc:
    """An arc in the axis of a line.

    radius  : of the axis [m]
    angle   : by which the axis turns, (0, pi] [rad]
    before  : straight length between inlet and arc [m]
    towards : "up" (+y), "down" (-y) or "side" (+x) as seen at the inlet

    A point has the coordinates (x, y, s) in the straight line, s along the axis. With n the normal
    of the axis towards the centre of the arc, c = (x, y).n and phi = (s - before)/radius, it lies
    in the arc at

        c' = radius - (radius - c) cos(phi),    z = before + (radius - c) sin(phi).
    """

    radius: float
    angle: float
    before: float
    towards: str = "up"

    @property
    def end(self) -> float:
        """Length along the axis at which the arc ends [m]."""
        return self.before + self.radius * self.angle

    @property
    def normal(self) -> npt.NDArray[np.float64]:
        """Normal n of the axis at the inlet, towards the centre of the arc, shape (3,)."""
        return np.array([*TOWARDS[self.towards], 0.0])

    def bent(self, straight: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Places of points (x, y, s) of the straight line, shape (n, 3) [m]."""
        s = straight[:, 2]
        phi = np.clip((s - self.before) / self.radius, 0.0, self.angle)
        lever = self.radius - straight @ self.normal
        # what lies before and behind the arc goes straight on
        rest = s - np.clip(s, self.before, self.end)
        across = self.radius - lever * np.cos(phi) + rest * np.sin(phi)
        along = self.before + lever * np.sin(phi) + rest * np.cos(phi)
        return self._with(straight, across, along)

    def straightened(self, x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Coordinates (x, y, s) of points in the straight line, the inverse of `bent` [m]."""
        phi = self._turned(x)
        lever, ahead = self.radius - x @ self.normal, x[:, 2] - self.before
        across = self.radius - lever * np.cos(phi) - ahead * np.sin(phi)
        rest = ahead * np.cos(phi) - lever * np.sin(phi)
        return self._with(x, across, self.before + self.radius * phi + rest)

    def axis(self, x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Unit vectors along the axis at points, shape (n, 3)."""
        phi = self._turned(x)[:, None]
        tangent = np.sin(phi) * self.normal + np.cos(phi) * np.array([0.0, 0.0, 1.0])
        return np.asarray(tangent)

    def straightened_vectors(
        self, x: npt.NDArray[np.float64], vectors: npt.NDArray[np.float64]
    ) -> npt.NDArray[np.float64]:
        """Vectors (n, 3) at points (n, 3) in the straight line: across as at the inlet, along z."""
        phi = self._turned(x)[:, None]
        ahead = np.array([0.0, 0.0, 1.0])
        normal = np.cos(phi) * self.normal - np.sin(phi) * ahead
        tangent = np.sin(phi) * self.normal + np.cos(phi) * ahead
        turned = vectors - (vectors @ self.normal)[:, None] * self.normal
        turned[:, 2] = (vectors * tangent).sum(axis=1)
        turned += (vectors * normal).sum(axis=1)[:, None] * self.normal
        return turned

    def _turned(self, x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Angle by which the axis has turned at points, shape (n,) [rad]."""
        phi = np.arctan2(x[:, 2] - self.before, self.radius - x @ self.normal)
        # legs lie within a quarter turn of the ends of the arc
        phi = np.where(phi < -math.pi / 2, phi + 2 * math.pi, phi)
        return np.clip(phi, 0.0, self.angle)

    def _with(
        self,
        x: npt.NDArray[np.float64],
        across: npt.NDArray[np.float64],
        along: npt.NDArray[np.float64],
    ) -> npt.NDArray[np.float64]:
        """Points with other coordinates along the normal and along z."""
        moved = x + (across - x @ self.normal)[:, None] * self.normal
        moved[:, 2] = along
        return moved

# SPDX-License-Identifier: LGPL-3.0-or-later
"""The wall of a line as triangles, and the triangle in which a point of the wall lies."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from fem_tfm.geometry.arc import Arc
from fem_tfm.geometry.section import RectangularSection, RoundSection, Section

Array = npt.NDArray[np.float64]
# sides of a round section at least
LEAST_SECTORS = 8


class WallSurface:
    """Triangles on the wall of a whole section along a line.

    The wall is cut into stretches along the axis and sectors around it. Each quadrilateral of these
    is two triangles, numbers 2 q and 2 q + 1 with q = stretch * sectors + sector.

    size : about the edge of the triangles [m]
    arc : in the axis, None for a straight line

    Attributes
    ----------
    points : corners (n, 3) [m]
    triangles : numbers of their corners (m, 3)
    areas : (m,) [m2]
    along, around : of the stretches' and the sectors' edges, along the axis [m] and around it, as
        a share of the perimeter; a round section begins on the right (+x) and turns towards the
        top, a rectangular one at its lower right corner
    """

    def __init__(
        self, section: Section, length: float, size: float, arc: Arc | None = None
    ) -> None:
        self.section = section
        ring, self.around = _ring(section, size)
        self.sectors = len(ring)
        self.along = np.linspace(0.0, length, max(round(length / size), 1) + 1)
        stretches = len(self.along) - 1
        straight = np.column_stack(
            [np.tile(ring, (stretches + 1, 1)), np.repeat(self.along, self.sectors)]
        )
        self.points = straight if arc is None else arc.bent(straight)
        first = np.arange(stretches * self.sectors)
        second = first - first % self.sectors + (first + 1) % self.sectors
        low, high = np.stack([first, second]), np.stack([first, second]) + self.sectors
        halves = [[low[0], low[1], high[0]], [high[1], high[0], low[1]]]
        self.triangles = np.array(halves).transpose(2, 0, 1).reshape(-1, 3)
        a, b, c = (self.points[self.triangles[:, k]] for k in range(3))
        self.areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2

    def triangle_at(self, straight: Array) -> npt.NDArray[np.int64]:
        """Triangles of points on the wall, by their coordinates (x, y, s) in the straight line.

        A point before the inlet or behind the end is in the first or last stretch.
        """
        stretch, b = _bins(straight[:, 2], self.along)
        sector, a = _bins(_share(self.section, straight), self.around)
        upper = a + b > 1
        return np.asarray(2 * (stretch * self.sectors + sector) + upper)


def _bins(values: Array, edges: Array) -> tuple[npt.NDArray[np.int64], Array]:
    """Bins of values, and how far they are in them, from 0 to 1."""
    found = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    inside = (values - edges[found]) / (edges[found + 1] - edges[found])
    return found, np.clip(inside, 0.0, 1.0)


def _ring(section: Section, size: float) -> tuple[Array, Array]:
    """Corners around a section (n, 2) [m], and their share of the perimeter (n + 1,)."""
    if isinstance(section, RoundSection):
        number = max(round(section.perimeter / size), LEAST_SECTORS)
        share = np.linspace(0.0, 1.0, number + 1)
        angle = 2 * math.pi * share[:-1]
        return section.radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1), share
    assert isinstance(section, RectangularSection)
    width, height = section.size
    corner = np.array([[1, -1], [1, 1], [-1, 1], [-1, -1], [1, -1]]) * [width / 2, height / 2]
    sides = (height, width, height, width)
    steps = [np.arange(n) / n for n in (max(round(side / size), 1) for side in sides)]
    ring = [corner[k] + step[:, None] * (corner[k + 1] - corner[k]) for k, step in enumerate(steps)]
    before = np.cumsum([0.0, *sides])
    walked = np.concatenate([before[k] + step * sides[k] for k, step in enumerate(steps)])
    return np.concatenate(ring), np.append(walked, before[-1]) / before[-1]


def _share(section: Section, x: Array) -> Array:
    """Place around the axis of points on the wall, as a share of the perimeter."""
    if isinstance(section, RoundSection):
        return np.asarray(np.arctan2(x[:, 1], x[:, 0]) % (2 * math.pi) / (2 * math.pi))
    width, height = section.size
    right, top = x[:, 0] / (width / 2), x[:, 1] / (height / 2)
    upright = np.abs(right) >= np.abs(top)
    sides = [upright & (right > 0), ~upright & (top > 0), upright & (right <= 0)]
    way = [
        x[:, 1] + height / 2,
        height + width / 2 - x[:, 0],
        height + width + height / 2 - x[:, 1],
    ]
    found = np.select(sides, way, 2 * height + width + width / 2 + x[:, 0])
    return np.asarray(found / (2 * (width + height)))

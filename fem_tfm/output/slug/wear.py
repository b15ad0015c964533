# SPDX-License-Identifier: LGPL-3.0-or-later
"""Impacts of grains on the triangles of a wall, and what they take from it.

wall.vtu   the wall in triangles for ParaView: impacts, their speed and angle, and what is removed
wear.csv   the triangles that were hit, a row each
wear.png   what is removed as a map along and around the wall
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np
from numpy.typing import NDArray

from fem_tfm.output.files import replaced
from fem_tfm.output.particles.wear import wear_picture
from fem_tfm.output.profiles import write_profiles

type Floats = NDArray[np.float64]


class WallWear:
    """Sums over impacts on the triangles of a wall.

    surface : with `points` (n, 3) [m], `triangles` (m, 3), their `areas` [m2], and the edges of
        quadrilaterals of two triangles each, `along` the axis [m] and `around` it (share of the
        perimeter)

    Attributes
    ----------
    sums : (m, 4): impacts, and those times speed [m/s], angle to the wall [rad] and the mass that
        is removed [kg]
    seconds : over which is summed
    """

    def __init__(self, surface: Any) -> None:
        self.surface = surface
        self.sums, self.seconds = np.zeros((len(surface.triangles), 4)), 0.0

    def add(
        self, triangle: NDArray[np.int64], speed: Floats, angle: Floats, removed: Floats
    ) -> None:
        """Enter impacts on triangles."""
        columns = (np.ones(len(triangle)), speed, angle, removed)
        size = len(self.sums)
        self.sums += np.stack([np.bincount(triangle, c, size) for c in columns], axis=1)

    def quantities(self) -> dict[str, float]:
        """Loss of the wall [kg/s], impacts [1/s], their mean speed [m/s] and angle [deg]."""
        if self.seconds <= 0:
            return {}
        count, speed, angle, removed = self.sums.sum(axis=0)
        found = {"wear": removed / self.seconds, "impact_rate": count / self.seconds}
        if count > 0:
            found |= {
                "impact_speed": speed / count,
                "impact_angle": float(np.degrees(angle / count)),
            }
        return {name: float(value) for name, value in found.items()}

    def columns(self) -> dict[str, Floats]:
        """Impacts [1/s/m2], their speed [m/s] and angle [deg], wear [kg/s/m2] of the triangles."""
        per = self.surface.areas * max(self.seconds, 1e-300)
        count = self.sums[:, 0]
        some = np.maximum(count, 1)
        return {
            "impacts": count / per,
            "speed": self.sums[:, 1] / some,
            "angle": np.degrees(self.sums[:, 2] / some),
            "removed": self.sums[:, 3] / per,
        }

    # -- state and files -----------------------------------------------------------------------

    def state(self) -> dict[str, NDArray[Any]]:
        """Arrays from which `restore` goes on."""
        return {"sums": self.sums.copy(), "seconds": np.array([self.seconds])}

    def restore(self, arrays: dict[str, NDArray[Any]]) -> None:
        """Put back what `state` gave."""
        self.sums, self.seconds = arrays["sums"].copy(), float(arrays["seconds"][0])

    def write(self, out: Path, title: str, pictures: bool) -> None:
        """wall.vtu, wear.csv and wear.png."""
        surface, columns = self.surface, self.columns()
        cells = [("triangle", surface.triangles)]
        data = {name: [values] for name, values in columns.items()}
        with replaced(out / "wall.vtu") as temporary:
            mesh = meshio.Mesh(surface.points, cells, cell_data=data)
            meshio.write(temporary, mesh, file_format="vtu")
        hit = np.flatnonzero(self.sums[:, 0])
        stretch, sector = np.divmod(hit // 2, len(surface.around) - 1)
        middles = [(e[1:] + e[:-1]) / 2 for e in (surface.along, surface.around)]
        place = {"along": middles[0][stretch], "around": 360 * middles[1][sector]}
        units = {
            "along": "m", "around": "deg", "area": "m2", "impacts": "1/s/m2", "speed": "m/s",
            "angle": "deg", "removed": "kg/s/m2",
        }  # fmt: skip
        chosen = {name: values[hit] for name, values in columns.items()}
        write_profiles(out / "wear.csv", place | {"area": surface.areas[hit]} | chosen, units)
        if pictures:
            wear_picture(out / "wear.png", surface.along, surface.around, self._map(), title)

    def _map(self) -> Floats:
        """Wear of the quadrilaterals (stretches, sectors) [kg/s/m2]."""
        removed, area = (
            values.reshape(-1, len(self.surface.around) - 1, 2).sum(axis=2)
            for values in (self.sums[:, 3], self.surface.areas)
        )
        return np.asarray(removed / area / max(self.seconds, 1e-300))

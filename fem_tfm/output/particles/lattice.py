# SPDX-License-Identifier: LGPL-3.0-or-later
"""Concentration and velocity of a cloud in every cell, as a file for ParaView.

Cells of a section are drawn out along the line over each stretch between two places.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import meshio
import numpy as np
from numpy.typing import NDArray

from fem_tfm.output.files import replaced

type Floats = NDArray[np.float64]
# corners of lattice cells in the order of VTK, and the names of cells by dimension and corners
TURNED = {4: (0, 1, 3, 2), 8: (0, 1, 3, 2, 4, 5, 7, 6)}
DRAWN = {3: "wedge", 4: "hexahedron"}
WHOLE = {4: "tetra", 8: "hexahedron"}


@dataclass
class Lattice:
    """What is in the cells of a grid, stretch by stretch.

    points : (n, dim) of a section or of a line in three dimensions [m]
    corners : (cells, corners) numbers of points in the order of a lattice
    folds : planes of symmetry about which the grid is folded, 0 to 2
    edges : start and end of each stretch [m]
    fields : of each stretch, shape (materials, cells, 8): concentration [kg/m3], number a volume
        [1/m3], mean velocity x y z and its standard deviation x y z [m/s]
    """

    points: Floats
    corners: NDArray[np.int32]
    folds: int = 0
    edges: list[tuple[float, float]] = field(default_factory=list)
    fields: list[Floats] = field(default_factory=list)

    def take(self, start: float, end: float, fields: Floats) -> None:
        """Keep a stretch."""
        self.edges.append((start, end))
        self.fields.append(fields.copy())

    def state(self) -> dict[str, NDArray[Any]]:
        """Arrays from which `restore` goes on."""
        return {"edges": np.array(self.edges), "fields": np.array(self.fields)}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Put back what `state` gave."""
        self.edges = [(float(a), float(b)) for a, b in arrays["edges"]]
        self.fields = list(arrays["fields"])

    def write(self, path: Path, materials: Sequence[str]) -> None:
        """Write all stretches into one file; a folded grid stands for its mirror images too."""
        if not self.fields:
            return
        points, kind, cells = self._cells()
        data: dict[str, list[Any]] = {}
        for number, name in enumerate(materials):
            table = np.concatenate([fields[number] for fields in self.fields])
            parts = {"concentration": 0, "number": 1}
            data |= {f"{name}_{what}": [table[:, at]] for what, at in parts.items()}
            data[f"{name}_velocity"] = [table[:, 2:5]]
            data[f"{name}_velocity_sd"] = [table[:, 5:8]]
        mesh = meshio.Mesh(points, [(kind, cells)], cell_data=data)
        with replaced(path) as temporary:
            meshio.write(temporary, mesh, file_format="vtu")

    def _cells(self) -> tuple[Floats, str, NDArray[np.int64]]:
        """Points, kind and cells of the file."""
        count = self.corners.shape[1]
        if self.points.shape[1] == 3:
            turned = self.corners[:, TURNED[8]] if count == 8 else self.corners
            return self.points, WHOLE[count], turned.astype(np.int64)
        base: NDArray[Any] = self.corners[:, TURNED[4]] if count == 4 else self.corners
        # a section keeps its vertices alone
        used, numbers = np.unique(base, return_inverse=True)
        base = numbers.reshape(len(self.corners), -1)
        plane = self.points[used]
        points, cells = [], []
        for number, (start, end) in enumerate(self.edges):
            for z in (start, end):
                points.append(np.column_stack([plane, np.full(len(plane), z)]))
            first = 2 * number * len(plane)
            cells.append(np.hstack([base + first, base + first + len(plane)]))
        return np.concatenate(points), DRAWN[count], np.concatenate(cells)

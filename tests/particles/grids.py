# SPDX-License-Identifier: LGPL-3.0-or-later
"""Grids and gases for tests of particles, made without a mesh."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from fem_tfm.models.particles.field import Field
from fem_tfm.models.particles.grid import Grid, Walls
from fem_tfm.models.particles.shapes import HEXAHEDRON, QUADRILATERAL, TETRAHEDRON, TRIANGLE

AIR = {"density": 1.2, "viscosity": 1.8e-5}


def _lattice(*axes: np.ndarray) -> tuple[np.ndarray, tuple[int, ...]]:
    """Points of a lattice, the first axis fastest, and how many along each axis."""
    count = tuple(len(a) for a in axes)
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    order = tuple(reversed(range(len(axes))))
    return points.transpose(*order, len(axes)).reshape(-1, len(axes)), count


def duct(
    cells: int = 6,
    half: tuple[float, float] = (0.1, 0.1),
    folds: int = 0,
    strip: float = 0.0,
    triangles: bool = False,
    wall: bool = True,
    warp: Callable[[np.ndarray], np.ndarray] | None = None,
) -> Grid:
    """A rectangular section in cells of degree two, whole or folded about x = 0 and y = 0."""
    low = [0.0 if folds > i else -(half[i] - strip) for i in range(2)]
    axes = [np.linspace(low[i], half[i] - strip, 2 * cells + 1) for i in range(2)]
    points, (nx, _) = _lattice(*axes)
    i, j = (a.ravel() for a in np.meshgrid(np.arange(cells), np.arange(cells), indexing="ij"))
    base = 2 * (j * nx + i)
    quad = np.stack([base + p + q * nx for q in range(3) for p in range(3)], axis=1)
    nodes, cell = quad, QUADRILATERAL
    if triangles:
        # vertices and middles of the two halves of each square
        nodes = np.concatenate([quad[:, [0, 2, 6, 4, 3, 1]], quad[:, [8, 6, 2, 4, 5, 7]]])
        cell = TRIANGLE
    if triangles:
        used, nodes = np.unique(nodes, return_inverse=True)
        points, nodes = points[used], nodes.reshape(-1, 6)
    points = points if warp is None else warp(points)
    walls = Walls("rectangle", half, strip) if wall else Walls("none", half)
    return Grid(cell, nodes.astype(np.int32), points, walls, folds)


def box(cells: tuple[int, int, int], size: tuple[float, float, float], kind: str) -> Any:
    """Nodes and points of a box 0 <= x_i <= size_i of hexahedra or tetrahedra."""
    axes = [np.linspace(0, size[i], cells[i] + 1) for i in range(3)]
    points, (nx, ny, _) = _lattice(*axes)
    i, j, k = (a.ravel() for a in np.meshgrid(*(np.arange(n) for n in cells), indexing="ij"))
    base = (k * ny + j) * nx + i
    corners = [base + p + nx * (q + ny * r) for r in range(2) for q in range(2) for p in range(2)]
    nodes = np.stack(corners, axis=1)
    if kind == "hexahedron":
        return HEXAHEDRON, nodes.astype(np.int32), points
    paths = ((1, 3), (1, 5), (2, 3), (2, 6), (4, 5), (4, 6))
    split = [nodes[:, [0, a, b, 7]] for a, b in paths]
    return TETRAHEDRON, np.concatenate(split).astype(np.int32), points


def gas(grid: Grid, **fields: Any) -> Field:
    """A gas on a grid; fields are functions of the points (n, dim), or constants."""
    field = Field(grid, **AIR)
    n = len(grid.points)
    given = {name: f(grid.points) if callable(f) else np.asarray(f) for name, f in fields.items()}
    given["velocity"] = np.broadcast_to(given.get("velocity", np.zeros(3)), (n, 3))
    if "stress" in given:
        given["stress"] = np.broadcast_to(given["stress"], (n, 3, 3)).copy()
        given["time"] = np.broadcast_to(given["time"], (n,))
    field.fill(**given)
    return field

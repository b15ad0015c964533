# SPDX-License-Identifier: LGPL-3.0-or-later
"""Kinds of cells as the kernel knows them: nodes, facets, and their maps.

Reference coordinates run from -1 to 1 in quadrilaterals and hexahedra and from 0 to 1 in triangles
and tetrahedra. The map of a cell is stored relative to an origin that is split into two floats.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx.mesh import CellType

from fem_tfm.errors import InputError

type Floats = npt.NDArray[np.float64]

# where the inverse of the Jacobian and the coefficients of the map stand in a row of the kernel
INVERSE, COEFFICIENTS = {2: 4, 3: 6}, {2: 8, 3: 16}
# floats of a line of the processor's cache
LINE = 16


@dataclass(frozen=True)
class Cell:
    """A kind of cell.

    number : in the kernel
    dim : of space
    order : places of DOLFINx's nodes in the order of the kernel
    facets : vertices of each facet, as numbers of nodes of the kernel
    reference : (nodes, dim) coordinates of the nodes
    origin : reference coordinates of the origin of the map
    powers : exponents of the monomials of the map, the constant left out
    width : floats of a row of the kernel
    rule : points and weights that measure a cell
    middles : DOLFINx's vertices between which its further nodes lie
    """

    number: int
    dim: int
    order: tuple[int, ...]
    facets: tuple[tuple[int, ...], ...]
    reference: Floats
    origin: Floats
    powers: tuple[tuple[int, ...], ...]
    width: int
    rule: Callable[[], tuple[Floats, Floats]]
    middles: tuple[tuple[int, ...], ...] = ()

    @property
    def vertices(self) -> list[int]:
        """Numbers of the nodes that are vertices."""
        return sorted({n for facet in self.facets for n in facet})

    @property
    def linear(self) -> Floats:
        """Weights (nodes, nodes) that give each node the linear interpolant of the vertices."""
        ref, vertices = self.reference, self.vertices
        corners = ref[vertices]
        weights = np.zeros((len(ref), len(ref)))
        if ref.min() < 0:
            weights[:, vertices] = np.prod((1 + ref[:, None] * corners) / 2, axis=2)
        else:
            rest = 1 - ref.sum(axis=1, keepdims=True)
            at_origin = corners.sum(axis=1) == 0
            weights[:, vertices] = np.where(at_origin, rest, ref @ corners.T)
        return weights

    def coefficients(self, nodes: Floats) -> Floats:
        """Coefficients of the monomials of the maps, shape (cells, 1 + powers, dim) [m]."""
        powers = ((0,) * self.dim, *self.powers)
        table = np.stack([monomial(self.reference, p) for p in powers], axis=1)
        return np.einsum("ij,cjd->cid", np.linalg.inv(table), nodes)

    def jacobians(self, coefficients: Floats, at: Floats) -> Floats:
        """d x_i/d xi_j at a reference point, shape (cells, dim, dim)."""
        slopes = np.stack(
            [
                np.array([slope(at, p, j) for p in ((0,) * self.dim, *self.powers)])
                for j in range(self.dim)
            ],
            axis=1,
        )
        return np.einsum("cpd,pj->cdj", coefficients, slopes)

    def maps(self, nodes: Floats, straight: float) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
        """Rows of the kernel and whether each cell is curved."""
        c = self.coefficients(nodes)
        jacobian = self.jacobians(c, self.origin)
        inverse = np.linalg.inv(jacobian)
        rows = aligned(len(nodes), self.width)
        high = c[:, 0].astype(np.float32)
        for i in range(self.dim):
            rows[:, 2 * i] = high[:, i]
            rows[:, 2 * i + 1] = c[:, 0, i] - high[:, i]
        n = self.dim**2
        at = INVERSE[self.dim]
        rows[:, at : at + n] = inverse.reshape(-1, n)
        beyond = np.abs(c[:, 1 + self.dim :]).max(axis=(1, 2), initial=0.0)
        curved = beyond > straight * np.abs(jacobian).max(axis=(1, 2))
        count, start = len(self.powers), COEFFICIENTS[self.dim]
        step = 8 if self.dim == 2 else count
        for i in range(self.dim if curved.any() else 0):
            rows[:, start + i * step : start + i * step + count] = c[:, 1:, i]
        return rows, np.ascontiguousarray(curved.astype(np.uint8))

    def sizes(self, nodes: Floats) -> Floats:
        """Areas or volumes."""
        c = self.coefficients(nodes)
        points, weights = self.rule()
        return np.asarray(
            sum(
                weight * np.abs(np.linalg.det(self.jacobians(c, point)))
                for point, weight in zip(points, weights, strict=True)
            )
        )


def aligned(count: int, width: int) -> npt.NDArray[np.float32]:
    """Rows of zeros that begin where a line of the processor's cache does."""
    space = np.zeros(count * width + LINE, dtype=np.float32)
    start = (-space.ctypes.data // 4) % LINE
    return space[start : start + count * width].reshape(count, width)


def monomial(x: Floats, powers: tuple[int, ...]) -> Floats:
    """Product of powers of the coordinates of points (n, dim)."""
    return np.asarray(np.prod(x ** np.array(powers), axis=-1))


def slope(x: Floats, powers: tuple[int, ...], axis: int) -> float:
    """Derivative of a monomial at a point."""
    if powers[axis] == 0:
        return 0.0
    lower = tuple(p - (i == axis) for i, p in enumerate(powers))
    return float(powers[axis] * monomial(x[None, :], lower)[0])


def _gauss(dim: int, count: int) -> tuple[Floats, Floats]:
    x, w = np.polynomial.legendre.leggauss(count)
    grid = np.stack(np.meshgrid(*[x] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    weights = (
        np.stack(np.meshgrid(*[w] * dim, indexing="ij"), axis=-1).reshape(-1, dim).prod(axis=1)
    )
    return grid, weights


def _triangle_rule() -> tuple[Floats, Floats]:
    """Exact to degree four: a square collapsed onto the triangle."""
    x, w = _gauss(2, 4)
    a, b = (1 + x[:, 0]) / 2, (1 + x[:, 1]) / 2
    return np.stack([a, b * (1 - a)], axis=1), w / 4 * (1 - a)


def _tetrahedron_rule() -> tuple[Floats, Floats]:
    return np.full((1, 3), 0.25), np.array([1 / 6])


_LINE = np.array([-1.0, 0.0, 1.0])
QUADRILATERAL = Cell(
    number=0,
    dim=2,
    # DOLFINx: vertices, then the middles of the sides 01, 02, 13, 23, then the centre
    order=(0, 4, 1, 5, 8, 6, 2, 7, 3),
    # below, left, right, above, as the kernel asks for them
    facets=((0, 2), (0, 6), (2, 8), (6, 8)),
    reference=np.array([[a, b] for b in _LINE for a in _LINE]),
    origin=np.zeros(2),
    powers=((1, 0), (0, 1), (1, 1), (2, 0), (0, 2), (2, 1), (1, 2), (2, 2)),
    width=24,
    rule=lambda: _gauss(2, 3),
    middles=((0, 1), (0, 2), (1, 3), (2, 3), (0, 1, 2, 3)),
)
TRIANGLE = Cell(
    number=1,
    dim=2,
    order=(0, 1, 2, 3, 4, 5),
    facets=((1, 2), (0, 2), (0, 1)),
    reference=np.array([[0, 0], [1, 0], [0, 1], [0.5, 0.5], [0, 0.5], [0.5, 0]]),
    origin=np.zeros(2),
    powers=((1, 0), (0, 1), (1, 1), (2, 0), (0, 2)),
    width=24,
    rule=_triangle_rule,
    middles=((1, 2), (0, 2), (0, 1)),
)
TETRAHEDRON = Cell(
    number=2,
    dim=3,
    order=(0, 1, 2, 3),
    facets=((1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2)),
    reference=np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]),
    origin=np.zeros(3),
    powers=((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    width=16,
    rule=_tetrahedron_rule,
)
HEXAHEDRON = Cell(
    number=3,
    dim=3,
    order=(0, 1, 2, 3, 4, 5, 6, 7),
    facets=((0, 1, 2, 3), (0, 1, 4, 5), (0, 2, 4, 6), (1, 3, 5, 7), (2, 3, 6, 7), (4, 5, 6, 7)),
    reference=np.array([[a, b, c] for c in (-1.0, 1.0) for b in (-1, 1) for a in (-1, 1)]),
    origin=np.zeros(3),
    powers=((1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, 0, 1), (0, 1, 1), (1, 1, 1)),
    width=48,
    rule=lambda: _gauss(3, 2),
)
CELLS = {
    CellType.quadrilateral: QUADRILATERAL,
    CellType.triangle: TRIANGLE,
    CellType.tetrahedron: TETRAHEDRON,
    CellType.hexahedron: HEXAHEDRON,
}


def cell_of(mesh: Any) -> Cell:
    """Kind of the cells of a DOLFINx mesh.

    Raises
    ------
    InputError
        the kernel does not know it.
    """
    found = CELLS.get(mesh.topology.cell_type)
    if found is None:
        words = "one of " + ", ".join(kind.name for kind in CELLS)
        raise InputError("mesh.cells", mesh.topology.cell_type.name, words)
    return found

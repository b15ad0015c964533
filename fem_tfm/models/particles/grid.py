# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cells that particles move through: all of them, or the part of a rank.

A distributed section is gathered in the order of its input, so that cells and nodes have the same
numbers on any number of ranks. Its cells carry fields of degree two: nine nodes of a quadrilateral,
six of a triangle.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI
from scipy.spatial import cKDTree

import fem_tfm._kernel as _kernel
from fem_tfm.errors import InputError
from fem_tfm.geometry.arc import Arc
from fem_tfm.geometry.mesh import Mesh
from fem_tfm.geometry.section import RectangularSection, Section
from fem_tfm.models.particles import faces, shapes
from fem_tfm.models.particles.shapes import Cell

type Floats = npt.NDArray[np.float64]
type Integers = npt.NDArray[np.int32]
type Numbers = npt.NDArray[np.int64]

# a cell whose map leaves the affine one by this share of its size is curved
STRAIGHT = 1e-9
# places whose nearest cell is looked for are moved by these shares of the width, so that no two
# cells of a regular mesh are equally near
ASIDE = (3.1e-5, 1.7e-5, 2.3e-5)
# ratio of nodal values in a cell up to which their interpolant of degree two is positive
STEEP = 4.0
FOLDS = {"none": 0, "half": 1, "quarter": 2}
# walls as the kernel numbers them
WALLS = {"none": 0, "rectangle": 1, "circle": 2, "planes": 3, "bent rectangle": 4, "bent circle": 5}


@dataclass(frozen=True)
class Walls:
    """Walls of a line, exact whatever the mesh.

    kind : a name out of WALLS
    half : half width and height of a rectangle [m], the radius first for a circle
    strip : distance from the wall at which the mesh begins [m]
    arc : straight length before the arc, radius and angle, and its normal in the section
    length : along the axis, beyond whose ends a parcel is out [m]; 0 for no ends
    """

    kind: str
    half: tuple[float, float] = (0.0, 0.0)
    strip: float = 0.0
    arc: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 1.0)
    length: float = 0.0

    @classmethod
    def of(cls, section: Section, length: float | None = None, arc: Arc | None = None) -> Walls:
        """Those of a section, or of a line of a length [m]."""
        if isinstance(section, RectangularSection):
            kind, half = "rectangle", (section.width / 2, section.height / 2)
        else:
            kind, half = "circle", (section.radius, section.radius)
        if arc is None:
            return cls(kind, half, section.wall_offset, length=length or 0.0)
        x, y, _ = (float(n) for n in arc.normal)
        turn = arc.before, arc.radius, arc.angle, x, y
        return cls(f"bent {kind}", half, section.wall_offset, turn, length or 0.0)

    def for_kernel(self) -> dict[str, Any]:
        """Numbers of the kernel."""
        names = "before", "radius", "angle", "normal_x", "normal_y"
        return {
            "wall": WALLS[self.kind],
            "half_x": self.half[0],
            "half_y": self.half[1],
            "strip": self.strip,
            "length": self.length,
            **dict(zip(names, self.arc, strict=True)),
        }


@dataclass(eq=False)
class Grid:
    """Cells of a section or a line, their nodes and walls: all of them, or the part of a rank.

    cell : kind of the cells
    nodes : (cells, nodes of a cell) in the order of the kernel
    points : (nodes, dim) of all nodes [m]
    walls : what particles touch
    folds : planes of symmetry about which the part solved is folded: 0, 1 (x = 0), 2 (y = 0 too)
    owned : number in the grid of each owned cell of the mesh on this rank
    open : (facets, 2) cell and facet through which parcels leave, where walls are planes;
        other facets of the boundary are walls unless they lie in the plane x = 0 of a fold
    comm : ranks that hold the other parts; one rank holds all cells
    global_number : (cells,) of each cell in the whole, ascending
    keys : (nodes,) of each node in the whole
    beyond : (facets, 3) cell, facet and number of the ghost across it
    ghosts : (ghosts, 2) rank that owns it, number in the whole

    Attributes
    ----------
    width : smaller width of the section, or of the box around a line [m]
    arrays, kernel : what the kernel knows of the cells

    Where other ranks hold parts it is made on all of them (collective).
    """

    cell: Cell
    nodes: Integers
    points: Floats
    walls: Walls
    folds: int = 0
    owned: Integers = field(default_factory=lambda: np.empty(0, dtype=np.int32))
    open: Integers = field(default_factory=lambda: np.empty((0, 2), dtype=np.int32))
    comm: MPI.Comm = field(default_factory=lambda: MPI.COMM_SELF)
    global_number: Numbers = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    keys: Numbers = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    beyond: Integers = field(default_factory=lambda: np.empty((0, 3), dtype=np.int32))
    ghosts: Numbers = field(default_factory=lambda: np.empty((0, 2), dtype=np.int64))
    width: float = field(init=False)
    arrays: dict[str, Any] = field(init=False, repr=False)
    kernel: _kernel.Grid = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not len(self.global_number):
            self.global_number, self.keys = np.arange(len(self.nodes)), np.arange(len(self.points))
        self.width = self._width()
        maps, curved = self.cell.maps(self.points[self.nodes], STRAIGHT)
        self.arrays = {
            "node": np.ascontiguousarray(self.nodes, dtype=np.int32),
            "neighbour": neighbours(self.cell, self.nodes),
            "map": maps,
            "curved": curved,
        }
        self.arrays["neighbour"][self.beyond[:, 0], self.beyond[:, 1]] = -2 - self.beyond[:, 2]
        if self.walls.kind == "planes":
            self.arrays |= faces.near(self)
        self.kernel = _kernel.Grid(self.cell.number, self.arrays, len(self.points), self.folds)

    @property
    def count(self) -> int:
        """Cells."""
        return len(self.nodes)

    def _width(self) -> float:
        """Smaller width of the section, or of the box around all parts [m] (collective)."""
        if self.walls.half[0] > 0:
            return 2 * min(self.walls.half)
        # the lowest coordinates, and the highest with their sign turned
        ends = np.concatenate([self.points, -self.points], axis=1).min(axis=0, initial=np.inf)
        self.comm.Allreduce(MPI.IN_PLACE, ends, MPI.MIN)
        low, high = np.split(ends, 2)
        return float((-high - low).min())

    @property
    def sizes(self) -> Floats:
        """Areas [m2] or volumes [m3] of the cells."""
        return self.cell.sizes(self.points[self.nodes])

    def positive(self, values: Floats) -> Floats:
        """Positive nodal values (n,) whose interpolant is positive in between, too.

        One of degree two may fall below zero where they differ much; in such cells it becomes the
        linear one of the vertices.
        """
        found, inside = values.copy(), values[self.nodes]
        steep = inside.max(axis=1) > STEEP * inside.min(axis=1)
        found[self.nodes[steep]] = inside[steep] @ self.cell.linear.T
        return found

    # -- parts ---------------------------------------------------------------------------------

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.points[self.nodes].mean(axis=1))

    def nearest(self, x: Floats) -> tuple[Floats, npt.NDArray[np.int64]]:
        """Distance to the nearest centre of a cell of this part, and the cell; x (n, 3) [m]."""
        if self.count == 0:
            return np.full(len(x), np.inf), np.zeros(len(x), dtype=np.int64)
        places = x[:, : self.points.shape[1]].copy()
        places[:, : self.folds] = np.abs(places[:, : self.folds])
        return self._tree.query(places + self.width * np.array(ASIDE)[: places.shape[1]])

    def find(self, x: Floats) -> npt.NDArray[np.int64]:
        """Rank and number in the whole of the cell whose centre is nearest, (n, 2) (collective).

        A walk from there leads to the cell that holds the place.
        """
        counts = self.comm.allgather(len(x))
        everywhere = np.concatenate(self.comm.allgather(x))
        distance, cell = self.nearest(everywhere)
        least, number = distance.copy(), np.full(len(everywhere), np.iinfo(np.int64).max)
        self.comm.Allreduce(MPI.IN_PLACE, least, MPI.MIN)
        near = distance == least
        number[near] = self.global_number[cell[near]]
        mine = number.copy()
        self.comm.Allreduce(MPI.IN_PLACE, number, MPI.MIN)
        rank = np.where(near & (mine == number), self.comm.rank, -1)
        self.comm.Allreduce(MPI.IN_PLACE, rank, MPI.MAX)
        here = slice(sum(counts[: self.comm.rank]), sum(counts[: self.comm.rank + 1]))
        return np.stack([rank[here], number[here]], axis=1)

    def local(self, number: npt.NDArray[Any]) -> Integers:
        """Cells of this part by their numbers in the whole, -1 for those of other ranks."""
        at = np.searchsorted(self.global_number, number)
        at = np.minimum(at, max(self.count - 1, 0))
        own = self.global_number[at] == number if self.count else np.zeros(len(at), dtype=bool)
        return np.where(own, at, -1).astype(np.int32)

    def numbered(self, cell: Integers) -> Integers:
        """Numbers in the whole of cells of this part; below 0 nothing changes."""
        return np.where(cell < 0, cell, self.global_number[np.maximum(cell, 0)]).astype(np.int32)

    def collect(self, values: npt.NDArray[Any], axis: int = 0) -> npt.NDArray[Any] | None:
        """Values of all cells in the order of the whole on rank 0, None elsewhere (collective)."""
        parts = self.comm.gather((self.global_number, values))
        if parts is None:
            return None
        order = np.argsort(np.concatenate([part[0] for part in parts]), kind="stable")
        return np.take(np.concatenate([part[1] for part in parts], axis=axis), order, axis=axis)

    def whole(self) -> tuple[Floats, Integers]:
        """Points and nodes of all cells on rank 0, of none elsewhere (collective)."""
        keys, x = self.collect(self.keys[self.nodes]), self.collect(self.points[self.nodes])
        if keys is None or x is None:
            return self.points[:0], self.nodes[:0]
        nodes, first = as_met(keys)
        return x.reshape(-1, x.shape[-1])[first], nodes


def as_met(keys: npt.NDArray[np.int64]) -> tuple[Integers, npt.NDArray[np.int64]]:
    """Nodes numbered as the cells meet them, shape of `keys`, and where each is met first."""
    _, first, inverse = np.unique(keys.ravel(), return_index=True, return_inverse=True)
    position = np.empty(len(first), dtype=np.int64)
    position[np.argsort(first)] = np.arange(len(first))
    return position[inverse.ravel()].reshape(keys.shape).astype(np.int32), np.sort(first)


def neighbours(cell: Cell, nodes: Integers) -> Integers:
    """Cell across each facet, -1 where there is none; shape (cells, facets)."""
    sides = np.sort(nodes[:, cell.facets], axis=2).reshape(-1, len(cell.facets[0]))
    _, number = np.unique(sides, axis=0, return_inverse=True)
    number = number.ravel()
    found = np.full(len(sides), -1, dtype=np.int32)
    order = np.argsort(number, kind="stable")
    same = np.flatnonzero(number[order][1:] == number[order][:-1])
    one, other = order[same], order[same + 1]
    found[one], found[other] = other // len(cell.facets), one // len(cell.facets)
    return np.ascontiguousarray(found.reshape(len(nodes), len(cell.facets)))


def node_coordinates(domain: Any, cell: Cell, degree: int) -> Floats:
    """Places of the nodes of the owned cells, (cells, nodes of a cell, dim), as the mesh has them.

    Where its geometry is of degree one, nodes of degree two lie half-way between vertices.
    """
    dim = domain.topology.dim
    own = domain.topology.index_map(dim).size_local
    x = domain.geometry.x[np.asarray(domain.geometry.dofmaps[0])[:own]][:, :, :dim]
    given = domain.geometry.cmaps[0].degree
    if given not in (1, degree):
        raise InputError("mesh.order", given, f"1 or {degree}")
    if given != degree:
        middles = [x[:, list(pair)].sum(axis=1) / len(pair) for pair in cell.middles]
        x = np.concatenate([x, np.stack(middles, axis=1)], axis=1)
    return np.ascontiguousarray(x[:, cell.order])


@dataclass(eq=False)
class Gathered:
    """A section with its nodes of degree two, whole on every rank.

    grid : the grid
    places : (local nodes, 2): cell on this rank and node in it, of the nodes that this rank gives
    given : numbers of these nodes in the grid
    """

    grid: Grid
    places: npt.NDArray[np.int64]
    given: npt.NDArray[np.int64]
    comm: MPI.Comm

    @classmethod
    def of(cls, mesh: Mesh) -> Gathered:
        """That of a mesh (collective)."""
        domain = mesh.mesh
        cell = shapes.cell_of(domain)
        space = fem.functionspace(domain, ("Lagrange", 2))
        cells = domain.topology.index_map(domain.topology.dim)
        local = space.dofmap.list[: cells.size_local].astype(np.int64)[:, cell.order]
        keys = space.dofmap.index_map.local_to_global(local.ravel().astype(np.int32))
        x = node_coordinates(domain, cell, 2)
        original = np.asarray(domain.topology.original_cell_index[: cells.size_local])
        comm = domain.comm
        order = np.concatenate(comm.allgather(original))
        keys_all = np.concatenate(comm.allgather(keys.reshape(local.shape)))
        x_all = np.concatenate(comm.allgather(x))
        ranked = np.argsort(order, kind="stable")
        number = np.empty(len(order), dtype=np.int32)
        number[ranked] = np.arange(len(order), dtype=np.int32)
        nodes, first = as_met(keys_all[ranked])
        points = x_all[ranked].reshape(-1, x_all.shape[-1])[first]
        start = sum(comm.allgather(cells.size_local)[: comm.rank])
        owned = number[start : start + cells.size_local]
        grid = Grid(
            cell,
            nodes,
            points,
            Walls.of(mesh.section, mesh.length, mesh.arc),
            FOLDS[mesh.section.symmetry],
            owned,
        )
        # a node is given by the rank of the first cell that has it
        width = nodes.shape[1]
        giver, place = np.divmod(first, width)
        mine = np.full(len(order), -1, dtype=np.int64)
        mine[owned] = np.arange(len(owned))
        here = mine[giver] >= 0
        places = np.stack([mine[giver][here], np.asarray(cell.order)[place[here]]], axis=1)
        return cls(grid, places, np.flatnonzero(here), comm)

    def gather(self, values: Floats) -> Floats:
        """Values at all nodes of the grid, from those at the nodes that each rank gives."""
        found = np.empty((len(self.grid.points), *values.shape[1:]))
        for numbers, part in zip(
            self.comm.allgather(self.given), self.comm.allgather(values), strict=True
        ):
            found[numbers] = part
        return found

    def at_nodes(self, dofmap: Any) -> npt.NDArray[np.int64]:
        """Dofs of a scalar space at the nodes that this rank gives."""
        dofs = np.asarray(dofmap.list)
        return dofs[self.places[:, 0], self.places[:, 1]].astype(np.int64)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""A line's mesh as its ranks hold it: own cells, and what they must know of the cells around.

Cells are numbered in the order of the mesh's input, so that the numbers in the whole are the same
on any number of ranks; a rank keeps its own in that order.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from scipy.sparse import csr_matrix, diags

from fem_tfm.geometry.mesh import Mesh
from fem_tfm.models.particles import shapes
from fem_tfm.models.particles.faces import FLAT
from fem_tfm.models.particles.grid import (
    FOLDS,
    Floats,
    Grid,
    Numbers,
    Walls,
    as_met,
    neighbours,
    node_coordinates,
)


@dataclass(eq=False)
class Partition:
    """The part of a line that a rank holds, and the layer of ghost cells that touch it.

    grid : own cells
    average : (nodes, own and ghost cells) weights that average cell values at the nodes by volume
    sent : for each rank, own cells whose values it needs
    order : (own and ghost cells,) places among own and received values, by number in the whole
    """

    grid: Grid
    average: csr_matrix
    sent: list[npt.NDArray[np.int32]]
    order: Numbers

    @classmethod
    def of(cls, mesh: Mesh, walls: Walls | None = None) -> Partition:
        """That of a mesh in three dimensions (collective).

        walls : those of its section by default; planes are open at the inlet and at the outlet
        """
        domain = mesh.mesh
        comm, cells = domain.comm, domain.topology.index_map(3)
        cell, own = shapes.cell_of(domain), cells.size_local
        space = fem.functionspace(domain, ("Lagrange", 1))
        local = np.asarray(space.dofmap.list)[:, cell.order]
        keys = space.dofmap.index_map.local_to_global(local.ravel()).reshape(local.shape)
        original = np.asarray(domain.topology.original_cell_index, dtype=np.int64)
        ranked = np.argsort(original[:own])
        owned = np.empty(own, dtype=np.int32)
        owned[ranked] = np.arange(own, dtype=np.int32)
        nodes, first = as_met(keys[ranked])
        x = node_coordinates(domain, cell, 1)[ranked]
        # ghosts of the mesh lie across facets
        around = np.concatenate([ranked, np.arange(own, len(keys))])
        beside = neighbours(cell, as_met(keys[around])[0])[:own]
        at, facet = np.nonzero(beside >= own)
        if walls is None:
            walls = Walls.of(mesh.section, mesh.length, mesh.arc)
        openings = np.empty((0, 2), dtype=np.int32)
        if walls.kind == "planes":
            openings = _ends(mesh, x[:, [list(facet) for facet in cell.facets]])
        grid = Grid(
            cell,
            nodes,
            x.reshape(-1, 3)[first],
            walls,
            FOLDS[mesh.section.symmetry],
            owned,
            openings,
            comm=comm,
            global_number=original[ranked],
            keys=keys[ranked].ravel()[first],
            beyond=np.stack([at, facet, beside[at, facet] - own], axis=1).astype(np.int32),
            ghosts=np.stack([np.asarray(cells.owners), original[own:]], axis=1),
        )
        return cls(grid, *_layer(grid, _sharers(space)))

    def at_nodes(self, values: Floats) -> Floats:
        """Cell values averaged at the nodes of the grid by volume (collective).

        values : (own cells of the mesh, components) in the order of the mesh
        """
        own = np.empty_like(values)
        own[self.grid.owned] = values
        got = self.grid.comm.alltoall([own[cells] for cells in self.sent])
        return np.asarray(self.average @ np.concatenate([own, *got])[self.order])


def _ends(mesh: Mesh, corners: Floats) -> npt.NDArray[np.int32]:
    """Cell and facet of those in the planes of the inlet and of the outlet, (n, 2).

    corners : of each cell's facets (cells, facets, corners, 3) [m]
    """
    assert mesh.length is not None
    along = mesh.straightened(corners.reshape(-1, 3))[:, 2].reshape(corners.shape[:-1])
    near = FLAT * mesh.length
    found = (np.abs(along) < near).all(axis=2) | (np.abs(along - mesh.length) < near).all(axis=2)
    return np.argwhere(found).astype(np.int32)


def _sharers(space: Any) -> tuple[Numbers, Numbers]:
    """Numbers in the whole of nodes that other ranks have too, and one of these ranks each."""
    nodes = space.dofmap.index_map
    # any tag of its messages will do
    ranks = nodes.index_to_dest_ranks(0)
    at = np.repeat(np.arange(len(ranks.offsets) - 1, dtype=np.int32), np.diff(ranks.offsets))
    return nodes.local_to_global(at), np.asarray(ranks.array, dtype=np.int64)


def _layer(
    grid: Grid, shared: tuple[Numbers, Numbers]
) -> tuple[csr_matrix, list[npt.NDArray[np.int32]], Numbers]:
    """Average, sent and order of a partition (collective)."""
    comm = grid.comm
    width, sizes = grid.nodes.shape[1], grid.sizes
    # every rank is told which cells of others touch the nodes that it has
    flat, owner = grid.keys[grid.nodes].ravel(), np.repeat(np.arange(grid.count), width)
    told = []
    for rank in range(comm.size):
        here = np.isin(flat, shared[0][shared[1] == rank])
        cells = owner[here]
        told.append((flat[here], grid.global_number[cells], sizes[cells]))
    keys, number, size = (np.concatenate(a) for a in zip(*comm.alltoall(told), strict=True))
    touching = np.isin(keys, grid.keys)
    keys, number, size = keys[touching], number[touching], size[touching]
    sent, wanted = _ask(grid, np.unique(number))
    everyone = np.concatenate([grid.global_number, wanted])
    order = np.argsort(everyone)
    # entries by node and, at a node, by the number of the cell in the whole
    by_key = np.argsort(grid.keys)
    there = by_key[np.searchsorted(grid.keys[by_key], keys)]
    rows = np.concatenate([grid.nodes.ravel(), there])
    columns = np.searchsorted(everyone[order], np.concatenate([grid.global_number[owner], number]))
    weights = np.concatenate([sizes[owner], size])
    ranked = np.lexsort((columns, rows))
    entries = weights[ranked], (rows[ranked], columns[ranked])
    volume = csr_matrix(entries, shape=(len(grid.points), len(everyone)))
    average = diags(1 / np.asarray(volume.sum(axis=1)).ravel()) @ volume
    return average, sent, order


def _ask(grid: Grid, ghosts: Numbers) -> tuple[list[npt.NDArray[np.int32]], Numbers]:
    """Own cells that each rank needs, and the ghosts in the order in which they are received."""
    comm = grid.comm
    asked = [grid.local(numbers) for numbers in comm.allgather(ghosts)]
    sent = [cells[cells >= 0] for cells in asked]
    got = comm.alltoall([grid.global_number[cells] for cells in sent])
    return sent, np.concatenate(got)

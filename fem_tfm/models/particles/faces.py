# SPDX-License-Identifier: LGPL-3.0-or-later
"""The boundary of a mesh in space as triangles, for walls that are those of its facets."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

import fem_tfm._kernel as _kernel

if TYPE_CHECKING:
    from fem_tfm.models.particles.shapes import Cell

type Floats = npt.NDArray[np.float64]

WALL, OPEN = 1.0, 2.0
# a facet lies in the plane of a fold if its corners do, to this share of the mesh
FLAT = 1e-9


def near(grid: Any) -> dict[str, npt.NDArray[Any]]:
    """Triangles of the boundary and, for each cell, those that share a node with it (collective).

    They are those of all cells, in the order of the whole, whoever holds the cells.

    grid : with cell, nodes, points, keys, global_number, folds, open, comm, arrays["neighbour"]
    """
    everyones = zip(*grid.comm.allgather(_own(grid)), strict=True)
    place, keys, rows = (np.concatenate(parts) for parts in everyones)
    touching = np.isin(keys, grid.keys).any(axis=1)
    place, keys, rows = place[touching], keys[touching], rows[touching]
    order = np.lexsort(place.T[::-1])
    # nodes that no cell of this part has get one number more
    count, by_key = len(grid.points), np.argsort(grid.keys)
    at = np.minimum(np.searchsorted(grid.keys[by_key], keys[order]), max(count - 1, 0))
    known = np.append(by_key, count)[at]
    triangles = np.where(np.append(grid.keys, -1)[known] == keys[order], known, count)
    start, numbers = _around(grid.nodes, triangles, count + 1)
    return {"face": np.ascontiguousarray(rows[order]), "near_start": start, "near": numbers}


def _own(grid: Any) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], Floats]:
    """Triangles of the cells of this part, (n, 3): where they are in the whole, and their nodes.

    The third are their rows of the kernel. Collective.
    """
    cell: Cell = grid.cell
    facets = np.argwhere(grid.arrays["neighbour"] == -1)
    corners = grid.nodes[facets[:, 0]][:, :, None]
    table = np.array(cell.facets)
    picked = np.take_along_axis(corners[:, :, 0], table[facets[:, 1]], axis=1)
    if grid.folds:
        x, comm = grid.points[:, 0], grid.comm
        extent = comm.allreduce(x.max(initial=-np.inf), MPI.MAX)
        extent -= comm.allreduce(x.min(initial=np.inf), MPI.MIN)
        flat = (np.abs(grid.points[picked][:, :, 0]) < FLAT * extent).all(axis=1)
        facets, picked = facets[~flat], picked[~flat]
    open_pairs = {tuple(pair) for pair in np.asarray(grid.open).tolist()}
    kinds = np.array([OPEN if tuple(f) in open_pairs else WALL for f in facets.tolist()])
    # corners of a quadrilateral come in the order of a lattice
    splits = ((0, 1, 2),) if picked.shape[1] == 3 else ((0, 1, 3), (0, 3, 2))
    triangles = np.concatenate([picked[:, list(split)] for split in splits])
    kinds, owners = np.tile(kinds, len(splits)), np.tile(facets[:, 0], len(splits))
    inside = grid.points[grid.nodes[owners]].mean(axis=1)
    split = np.repeat(np.arange(len(splits)), len(facets))
    facet = np.tile(facets[:, 1], len(splits))
    place = np.stack([split, grid.global_number[owners], facet], axis=1)
    return place, grid.keys[triangles], _faces(grid.points[triangles], inside, kinds)


def _faces(corners: Floats, inside: Floats, kinds: Floats) -> Floats:
    """Rows of the kernel: normal out, offset, corners turning right about the normal, kind."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    inward = np.einsum("ij,ij->i", normal, corners[:, 0] - inside) < 0
    corners = np.where(inward[:, None, None], corners[:, [0, 2, 1]], corners)
    normal = np.where(inward[:, None], -normal, normal)
    offset = np.einsum("ij,ij->i", normal, corners[:, 0])
    rows = np.column_stack([normal, offset, corners.reshape(-1, 9), kinds])
    assert rows.shape[1] == _kernel.FACE
    return np.ascontiguousarray(rows)


def _around(
    nodes: npt.NDArray[Any], triangles: npt.NDArray[Any], count: int
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """Triangles that have a node in common with each cell, as starts and numbers."""
    from scipy.sparse import csr_matrix

    def incidence(rows: npt.NDArray[Any]) -> Any:
        at = np.repeat(np.arange(len(rows)), rows.shape[1])
        return csr_matrix((np.ones(rows.size), (at, rows.ravel())), shape=(len(rows), count))

    touching = incidence(nodes) @ incidence(triangles).T
    touching.sort_indices()
    return touching.indptr.astype(np.int32), touching.indices.astype(np.int32)

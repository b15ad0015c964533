# SPDX-License-Identifier: LGPL-3.0-or-later
"""Parcels on their way to the ranks that hold their cells.

A parcel whose search for its cell comes to a ghost is broken off before its step, with its full
state, and goes on at the owner as if it had not been. One that goes astray is looked for on all
ranks by its distance to the centres of the cells. What a parcel does is therefore the same on any
number of ranks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

import fem_tfm._kernel as _kernel
from fem_tfm.models.particles.cloud import INSIDE, KINDS, Parcels
from fem_tfm.models.particles.grid import Grid

# turns in which a rank moves its parcels, and the least parcels of one
TURNS, LEAST = 16, 128


@dataclass
class Moving:
    """Parcels of this rank that have a way to go.

    search : (n, 2) moves of a search that was broken off, steps since the call began
    slot : (n,) by which they are put in order when all have arrived
    """

    parcels: Parcels
    search: npt.NDArray[np.int32]
    slot: npt.NDArray[np.int64]

    @classmethod
    def of(cls, parcels: Parcels, grid: Grid) -> Moving:
        """All parcels, before their first step."""
        count = len(parcels)
        slot = (np.int64(grid.comm.rank) << 32) + np.arange(count)
        return cls(parcels, np.zeros((count, 2), dtype=np.int32), slot)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """What the kernel changes."""
        return self.parcels.arrays() | {"search": self.search}

    def select(self, chosen: npt.NDArray[Any]) -> Moving:
        """A copy of some."""
        return Moving(self.parcels.select(chosen), self.search[chosen], self.slot[chosen])

    def turn(self, most: int) -> tuple[Moving, list[Moving]]:
        """The first of them, and what waits; all of them, not copied, where nothing must."""
        count = len(self.parcels)
        if count <= most:
            return self, []
        return self.select(np.arange(most)), [self.select(np.arange(most, count))]


def portion(parcels: Parcels, grid: Grid) -> int:
    """Parcels that a rank moves before it hands over what has left (collective).

    So the next rank has work while this one goes on with the others of a pulse.
    """
    if grid.comm.size == 1:
        return len(parcels)
    most = grid.comm.allreduce(len(parcels), MPI.MAX)
    return max(math.ceil(most / TURNS), LEAST)


def joined(parts: list[Moving]) -> Moving:
    """All of some parts."""
    return Moving(
        Parcels.concatenate([part.parcels for part in parts]),
        np.concatenate([part.search for part in parts]),
        np.concatenate([part.slot for part in parts]),
    )


def locate(parcels: Parcels, grid: Grid) -> None:
    """Give parcels whose cell was never looked up to the ranks of their cells (collective)."""
    moving = Moving.of(parcels, grid)
    new = (parcels.status == INSIDE) & (parcels.cell < 0)
    parcels.cell[new], parcels.status[new] = -1, _kernel.AWAY
    arrived = handed_over(moving, grid)
    if arrived is not None:
        put_in_order([moving.select(parcels.status != _kernel.AWAY), arrived], parcels)


def numbered(parcels: Parcels, grid: Grid) -> Parcels:
    """A copy whose cells are numbered as in the whole, to be stored."""
    found = parcels.copy()
    found.cell = grid.numbered(parcels.cell)
    return found


def dealt_by_cell(whole: Parcels, grid: Grid) -> Parcels:
    """Those of a stored cloud that all ranks have whose cells this rank holds.

    Parcels without a cell are dealt out by id.
    """
    new = whole.cell < 0
    found = whole.copy()
    found.cell[~new] = grid.local(whole.cell[~new])
    mine = whole.id % grid.comm.size == grid.comm.rank
    return found.select(np.where(new, mine, found.cell >= 0))


def handed_over(moving: Moving, grid: Grid, waiting: int = 0) -> Moving | None:
    """What comes to this rank of all that is away on any rank (collective).

    None where nothing is away and none waits on any rank.
    """
    comm = grid.comm
    away = moving.parcels.status == _kernel.AWAY
    if comm.allreduce(int(away.sum()) + waiting) == 0:
        return None
    gone = moving.select(away)
    parcels = gone.parcels
    astray = parcels.cell == -1
    goal = np.empty((len(parcels), 2), dtype=np.int64)
    goal[~astray] = grid.ghosts[-2 - parcels.cell[~astray]]
    goal[astray] = grid.find(parcels.x[astray])
    table = _packed(gone, goal[:, 1])
    sent = [table[goal[:, 0] == rank] for rank in range(comm.size)]
    return _unpacked(np.concatenate(comm.alltoall(sent)), grid)


def put_in_order(parts: list[Moving], into: Parcels) -> None:
    """Put parcels that have arrived into one cloud, in order of their slots."""
    found = joined(parts)
    into.replace(found.parcels.select(np.argsort(found.slot, kind="stable")))


def _packed(moving: Moving, cell: npt.NDArray[np.int64]) -> npt.NDArray[Any]:
    """One row a parcel, with the number of its cell in the whole."""
    columns = moving.parcels.arrays() | moving.parcels.carried
    columns |= {"search": moving.search, "slot": moving.slot, "goal": cell}
    kinds = [(name, column.dtype, column.shape[1:]) for name, column in columns.items()]
    table = np.empty(len(cell), dtype=kinds)
    for name, column in columns.items():
        table[name] = column
    return table


def _unpacked(table: npt.NDArray[Any], grid: Grid) -> Moving:
    """Parcels of rows that have come to this rank."""
    assert table.dtype.names is not None
    columns = {name: np.ascontiguousarray(table[name]) for name in table.dtype.names}
    search, slot, goal = (columns.pop(name) for name in ("search", "slot", "goal"))
    columns["cell"] = grid.local(goal)
    columns["status"][:] = INSIDE
    own = {name: columns.pop(name) for name in KINDS}
    return Moving(Parcels(**own, carried=columns), search, slot)

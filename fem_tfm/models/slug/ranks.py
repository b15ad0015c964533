# SPDX-License-Identifier: LGPL-3.0-or-later
"""Grains of one tube shared out among processes: slabs along the axis, ghosts at their ends.

A process moves the grains of its slab. Of others' grains that may touch its own until the neighbour
list is made anew it holds copies, ghosts, whose places and velocities come from their owners before
each step. Both sides work out the contacts between a grain and a ghost from the same numbers. When
the list of any process ends, grains go to the slabs in which they are, and new ghosts are chosen;
slabs are cut anew into equal numbers of grains when one holds too many.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from fem_tfm.errors import SolverError
from fem_tfm.models.slug.grains import Grains, check_overlap

Array = npt.NDArray[np.float64]
Rows = dict[str, npt.NDArray[Any]]
# mark of a ghost, and numbers of a grain that its owner sends before each step
GHOST, PACKED = 128, 9
# bins along the axis by which slabs are cut, and the share above the mean that cuts them anew
BINS, UNEVEN = 4096, 1.05
SPRINGS = ("spring_0", "spring_1", "spring_2")
# arrays with a row a grain, and those with a row a pair
OF_GRAINS = ("place", "motion", "force", *SPRINGS, "marks", "number")
OF_PAIRS = ("pairs", "shear")
FLYING = "grains fly apart: take a smaller numerics.time_step"


@dataclass(frozen=True)
class AllGrains:
    """Grains of all processes, with the same meaning as in Grains; the same on every process."""

    number: npt.NDArray[np.int64]
    place: Array
    straight: Array
    radius: Array
    velocity: Array
    gas_force: Array
    wall_force: Array
    wall_pressing: Array
    grain_force: Array

    @property
    def count(self) -> int:
        """Grains inside."""
        return len(self.number)


@dataclass
class _Partner:
    """What is exchanged with another process before each step: rows of the kernel, and buffers."""

    rank: int
    give: npt.NDArray[np.int32]
    take: npt.NDArray[np.int32]
    given: Array
    taken: Array


class SharedGrains(Grains):
    """The part of a tube's grains that this process moves, and its ghosts.

    Methods that add, remove, step or tell of all grains are collective.

    comm : processes
    length : of the tube [m]
    """

    def __init__(self, *given: Any, comm: MPI.Comm, length: float, **more: Any) -> None:
        super().__init__(*given, **more)
        self._comm, self._failed = comm, False
        self._cuts = np.linspace(0.0, length, comm.size + 1)[1:-1]
        # held grains come in from before the inlet
        low = -self.grain.largest_diameter
        self._bins = np.linspace(low, length, BINS + 1)
        self._partners: list[_Partner] = []
        walls, skin = given[1], more.get("skin", 0.2) * self.grain.diameter
        self._reach = self.grain.largest_diameter + skin
        if walls.arc is not None:
            inner = walls.arc.radius - walls.section.radius
            half = math.asin(min(self._reach / (2 * inner), 1.0))
            self._reach = 2 * walls.arc.radius * half

    # -- coming and going --------------------------------------------------------------------------

    def add(
        self,
        place: npt.ArrayLike,
        velocity: npt.ArrayLike = (0.0, 0.0, 0.0),
        radius: npt.ArrayLike | None = None,
        *,
        held: bool = False,
    ) -> None:
        """Add grains, the same on all processes; they go to their slabs before the next step.

        Raises InputError as Grains.add does.
        """
        if self._comm.rank == 0:
            return super().add(place, velocity, radius, held=held)
        x = np.atleast_2d(np.asarray(place, dtype=float))
        given = self.grain.diameter / 2 if radius is None else radius
        check_overlap(x, np.broadcast_to(np.asarray(given, dtype=float), len(x)))
        self._next += len(x)
        return None

    def remove_beyond(self, z: float) -> int:
        """Take out the grains beyond a place along the axis [m]; how many of all processes."""
        return int(self._comm.allreduce(super().remove_beyond(z)))

    def inside(self) -> int:
        """Grains inside, of all processes."""
        return int(self._comm.allreduce(int(self._own().sum())))

    def impacts(self) -> Array:
        """Impacts since the last call, of all processes."""
        return np.concatenate(self._comm.allgather(super().impacts()))

    def _own(self) -> npt.NDArray[np.bool_]:
        return np.asarray(self.core.marks < GHOST)

    # -- steps -------------------------------------------------------------------------------------

    def run(self, steps: int) -> None:
        """Take time steps.

        Raises
        ------
        SolverError
            grains fly apart, on any process.
        """
        mine, all_ = np.zeros(1, dtype=np.int32), np.zeros(1, dtype=np.int32)
        for _ in range(steps):
            mine[0] = 2 if self._failed else self.core.stale
            self._comm.Allreduce(mine, all_, MPI.MAX)
            if all_[0] == 2:
                raise SolverError(FLYING)
            if all_[0]:
                self._share()
            self._exchange()
            # what fails here is told to all before the next step
            self._failed = self._failed or not self.core.run(1)

    def _exchange(self) -> None:
        """Bring places and velocities of the ghosts from their owners."""
        requests = [self._comm.Irecv(partner.taken, partner.rank) for partner in self._partners]
        for partner in self._partners:
            self.core.pack(partner.give, partner.given)
            requests.append(self._comm.Isend(partner.given, partner.rank))
        MPI.Request.Waitall(requests)
        for partner in self._partners:
            self.core.unpack(partner.take, partner.taken)

    # -- slabs -------------------------------------------------------------------------------------

    def _share(self) -> None:
        """Send grains to the slabs in which they are, and copies to where they may touch others."""
        core, me = self.core, self._comm.rank
        along, own = core.straight()[:, 2], self._own()
        self._cut(along[own])
        to = np.where(own, self._owner(along), -1)
        near = [own & ((to == r) | self._near(along, r)) for r in range(self._comm.size)]
        outgoing: list[Any] = [None] * self._comm.size
        for r, chosen in enumerate(near):
            if r != me and chosen.any():
                which = np.flatnonzero(chosen).astype(np.int32)
                table, *springs = core.some(which)
                table[:, -1] += GHOST * (to[which] != r)
                outgoing[r] = (table, *springs)
        incoming = [part for part in self._comm.alltoall(outgoing) if part is not None]
        # a grain that leaves stays as a ghost where it is near
        core.marks[own & (to != me)] |= GHOST
        core.take_out((~near[me]).astype(np.uint8))
        if incoming:
            table, pairs, shear = (np.concatenate(parts) for parts in zip(*incoming, strict=True))
            pairs, first = np.unique(pairs, axis=0, return_index=True)
            core.append(table, np.ascontiguousarray(pairs), np.ascontiguousarray(shear[first]))
        if not core.run(0):
            self._failed = True
        self._meet()

    def _cut(self, along: Array) -> None:
        """Cut slabs of equal numbers of grains where they have become uneven."""
        size = self._comm.size
        counts = self._comm.allreduce(np.bincount(self._owner(along), minlength=size))
        if counts.max() <= UNEVEN * counts.mean():
            return
        found = np.histogram(np.clip(along, self._bins[0], self._bins[-1]), self._bins)[0]
        found = self._comm.allreduce(found)
        up_to = np.concatenate([[0], np.cumsum(found)])
        shares = up_to[-1] * np.arange(1, size) / size
        self._cuts = self._bins[np.searchsorted(up_to, shares)]

    def _owner(self, along: Array) -> npt.NDArray[np.int64]:
        return np.searchsorted(self._cuts, along, side="right")

    def _near(self, along: Array, rank: int) -> npt.NDArray[np.bool_]:
        """Which places are within reach of a slab."""
        ends = np.concatenate([[-np.inf], self._cuts, [np.inf]])
        low, high = ends[rank] - self._reach, ends[rank + 1] + self._reach
        return np.asarray((along >= low) & (along <= high))

    def _meet(self) -> None:
        """Find what is exchanged before each step: both sides sort grains by their numbers."""
        comm, number = self._comm, self.core.number.copy()
        along, own = self.core.straight()[:, 2], self._own()
        owner, order = self._owner(along), np.argsort(number)
        self._partners = []
        for rank in range(comm.size):
            if rank == comm.rank:
                continue
            give = order[(own & self._near(along, rank))[order]].astype(np.int32)
            take = order[(~own & (owner == rank))[order]].astype(np.int32)
            if len(give) + len(take) == 0:
                continue
            given, taken = np.zeros((len(give), PACKED)), np.zeros((len(take), PACKED))
            self._partners.append(_Partner(rank, give, take, given, taken))

    # -- all grains --------------------------------------------------------------------------------

    def everything(self) -> AllGrains:
        """Grains of all processes."""
        own = self._own()
        found = {
            name: np.concatenate(self._comm.allgather(getattr(self, name)[own]))
            for name in AllGrains.__dataclass_fields__
        }
        return AllGrains(**found)

    def total(self, *values: Array) -> tuple[Array, ...]:
        """Sums of arrays over the processes, in their order: the same bits on each."""
        flat = np.concatenate([value.ravel() for value in values])
        every = np.empty((self._comm.size, flat.size))
        self._comm.Allgather(flat, every)
        sizes = np.cumsum([value.size for value in values])[:-1]
        parts = np.split(every.sum(axis=0), sizes)
        return tuple(p.reshape(v.shape) for p, v in zip(parts, values, strict=True))

    # -- restart -----------------------------------------------------------------------------------

    def state(self) -> dict[str, Any]:
        """All grains as rows, the same on every process, for any number of processes."""
        rows = self.core.rows()
        parts = self._comm.allgather(_chosen(rows, rows["marks"] < GHOST))
        found = {name: np.concatenate([p[name] for p in parts]) for name in (*OF_GRAINS, *OF_PAIRS)}
        _, first = np.unique(found["pairs"], axis=0, return_index=True)
        found |= {name: found[name][first] for name in OF_PAIRS}
        return found | {"next": np.array([self._next])}

    def restore(self, state: dict[str, Any]) -> None:
        """Put back what `state` gave, of this or of another number of processes."""
        self._next = int(state["next"][0])
        rows = as_rows(state)
        chosen = np.full(len(rows["number"]), self._comm.rank == 0)
        own = _chosen(rows, chosen)
        self.core.set_rows({name: np.ascontiguousarray(row) for name, row in own.items()})


def as_rows(state: dict[str, Any]) -> Rows:
    """Rows of a state; the neighbour list of one process gives up its springs."""
    if "origin" not in state:
        return {name: np.asarray(state[name]) for name in (*OF_GRAINS, *OF_PAIRS)}
    found = {name: np.asarray(state[name]) for name in OF_GRAINS}
    if "kept" in state:
        pairs, shear = np.asarray(state["kept"]), np.asarray(state["kept_shear"])
    else:
        touching = np.asarray(state["pairs"])[:, 2] != 0
        pairs = np.asarray(state["pairs"])[touching, :2]
        shear = np.asarray(state["shear"])[touching]
    number = found["number"][pairs].reshape(-1, 2)
    turned = number[:, 0] > number[:, 1]
    sign = np.where(turned, -1.0, 1.0)[:, None]
    return found | {"pairs": np.sort(number, axis=1), "shear": sign * shear.reshape(-1, 4)}


def _chosen(rows: Rows, which: npt.NDArray[np.bool_]) -> Rows:
    """Some of the rows, and the springs of pairs that they are part of."""
    found = {name: rows[name][which] for name in OF_GRAINS}
    touched = np.isin(rows["pairs"], found["number"]).any(axis=1)
    return found | {name: rows[name][touched] for name in OF_PAIRS}

# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is in each cell: how many particles, how fast, and how often they collide.

With a law of collisions particles meet what was found in a pass before. The cloud of a steady
stream is not known before it was followed. A stretch is therefore followed again until the
collisions of a pass are those of the cloud that it left.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

import fem_tfm._kernel as _kernel
from fem_tfm.closures.particles.collisions import ParticleCollisions
from fem_tfm.models.particles.cloud import Parcels
from fem_tfm.models.particles.grid import Floats, Grid
from fem_tfm.models.particles.sinks import FEWEST, FINENESS, TIME

# typical velocity [m/s], a power of two
SPEED = 32.0
FIELDS = 8
# quanta of the largest part of a sum over the cells, which leaves room for 2^27 parts
GRAIN = 2.0**-36
NO_COLLISIONS = {
    "pair_restitution": 1.0, "pair_friction": 0.0, "pair_correlation": 0.0, "pair_share": 0.0,
}  # fmt: skip


def _power(value: float) -> float:
    """The least power of two that is not below a value."""
    return float(2.0 ** math.ceil(math.log2(max(value, 1e-300))))


class Encounters:
    """Number, mean velocity and its deviation in each cell, by material.

    Parameters
    ----------
    law : of the collisions, None only counts
    grid : cells
    parcels : of this rank, as they enter (collective on `comm`)
    materials : number of materials of the whole cloud

    Attributes
    ----------
    fields : (materials, cells, 8) of the last pass: concentration [kg/m3], number a volume [1/m3],
        mean velocity x y z, standard deviation x y z [m/s]
    partners : (materials, cells, 8) what the next pass meets: number a volume [1/m3], mean velocity
        x y z, standard deviation x y z [m/s], mean diameter [m]
    """

    def __init__(
        self,
        law: ParticleCollisions | None,
        grid: Grid,
        parcels: Parcels,
        materials: int,
        comm: MPI.Comm | None = None,
    ) -> None:
        self.law, self.grid, self.comm = law, grid, comm
        count = len(parcels) if comm is None else comm.allreduce(len(parcels))
        unit = FINENESS * self._most(parcels.rate) * 2.0 ** math.ceil(math.log2(max(count, FEWEST)))
        self.quanta = {
            "number": unit * TIME,
            "pair_moment": unit * TIME * SPEED,
            "pair_square": unit * TIME * SPEED**2,
            "events": unit,
            "pair_mass": unit * TIME * self._most(parcels.mass),
        }
        shape = (materials, grid.count)
        self.sums = np.zeros((*shape, _kernel.PAIRS), dtype=np.int64)
        self.partners = np.zeros((*shape, _kernel.PARTNER), dtype=np.float32)
        self.fields = np.zeros((*shape, FIELDS))
        self._totals = np.zeros((materials, _kernel.PAIRS), dtype=np.int64)
        self._sizes(parcels, materials)
        self._frequency = 0.0

    def _most(self, values: Floats) -> float:
        """A power of two that no value of any rank exceeds (collective)."""
        most = float(values.max(initial=0.0))
        if self.comm is not None:
            most = self.comm.allreduce(most, MPI.MAX)
        return _power(most)

    def _sizes(self, parcels: Parcels, materials: int) -> None:
        """Diameters of each material in shares of equal number, and its density."""
        own = parcels.material, parcels.diameter, parcels.density, parcels.rate
        parts = [own] if self.comm is None else self.comm.allgather(own)
        material, diameter, density, rate = (np.concatenate(p) for p in zip(*parts, strict=True))
        middles = (np.arange(_kernel.PARTNER_SIZES) + 0.5) / _kernel.PARTNER_SIZES
        self.diameter = np.ones((materials, _kernel.PARTNER_SIZES))
        self.density = np.ones(materials)
        for number in range(materials):
            chosen = material == number
            if not chosen.any():
                continue
            order = np.lexsort((rate[chosen], diameter[chosen]))
            sizes, weight = diameter[chosen][order], rate[chosen][order]
            share = (np.cumsum(weight) - weight / 2) / weight.sum()
            self.diameter[number] = np.interp(middles, share, sizes)
            self.density[number] = density[chosen][0]

    def clear(self) -> None:
        """Begin a pass."""
        self.sums[:] = 0

    def for_kernel(self) -> dict[str, Any]:
        """Sums, scales and what is met."""
        return {
            "pairs": self.sums,
            "partners": self.partners,
            "partner_diameter": self.diameter,
            "partner_density": self.density,
            **{name: 1 / quantum for name, quantum in self.quanta.items()},
            **(NO_COLLISIONS if self.law is None else self.law.numbers()),
        }

    def renew(self, volume: npt.ArrayLike) -> float:
        """Take over what the cloud did in a pass; the relative change (collective).

        volume : of each cell with its images, over the stretch that was followed [m3]; for parcels
            that stand for numbers and not for rates, times the time that was followed [m3 s]

        The change is that of the mean frequency of collisions that the cloud would expect.
        """
        # a rank that holds a part of the grid has all of its cells' sums
        if self.comm is not None and self.grid.comm.size == 1:
            self.comm.Allreduce(MPI.IN_PLACE, self.sums, MPI.SUM)
        self._totals = self.grid.comm.allreduce(self.sums.sum(axis=1))
        time = self.sums[..., 0] * self.quanta["number"]
        whole = np.where(time > 0, time, 1.0)[..., None]
        mean = self.sums[..., 1:4] * self.quanta["pair_moment"] / whole
        square = self.sums[..., 4:7] * self.quanta["pair_square"] / whole
        self.partners[..., 0] = time / np.asarray(volume)
        self.partners[..., 1:4] = mean
        self.partners[..., 4:7] = np.sqrt(np.maximum(square - mean**2, 0.0))
        self.partners[..., 7] = self.diameter.mean(axis=1)[:, None]
        self.fields[..., 0] = self.sums[..., 8] * self.quanta["pair_mass"] / np.asarray(volume)
        self.fields[..., 1:] = self.partners[..., :7]
        before, self._frequency = (
            self._frequency,
            float(self._expected(np.asarray(time, dtype=float))),
        )
        return (
            abs(self._frequency - before) / max(self._frequency, 1e-300) if self._frequency else 0.0
        )

    def _expected(self, time: Floats) -> Any:
        """Mean frequency of collisions between particles of a kind, without correlation [1/s]."""
        spread = np.sqrt(2 * (self.partners[..., 4:7].astype(float) ** 2).sum(axis=-1))
        reach = self.partners[..., 7].astype(float)
        rate = ParticleCollisions.frequency(self.partners[..., 0].astype(float), reach, spread)
        return self._total(time * rate) / max(self._total(time), 1e-300)

    def _total(self, values: Floats) -> float:
        """Sum over the cells of all ranks, in whole numbers so that their order does not matter."""
        quantum = self.grid.comm.allreduce(_power(float(values.max(initial=0.0))), MPI.MAX) * GRAIN
        whole = int(np.rint(values / quantum).astype(np.int64).sum())
        return float(self.grid.comm.allreduce(whole) * quantum)

    @property
    def collisions(self) -> Floats:
        """Collisions of the particles of each material in the last pass (materials,) [1/s]."""
        return np.asarray(self._totals[:, 7] * self.quanta["events"])

    @property
    def residence(self) -> Floats:
        """Number of particles of each material in the stretch of the last pass (materials,)."""
        return np.asarray(self._totals[:, 0] * self.quanta["number"])

# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the particles take from the gas, cell by cell, in sums that do not depend on their order.

A sum is a whole number of quanta; whole numbers add up without round-off.
"""

from __future__ import annotations

import math
from typing import Any, Self

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

import fem_tfm._kernel as _kernel
from fem_tfm.models.particles.cloud import Parcels
from fem_tfm.models.particles.grid import Floats, Grid

# quanta in a typical sum, which leaves room for sums 2^11 times as large
FINENESS = 2.0**-52
# a single step adds less than 2^51 quanta if the scale is that of so many parcels
FEWEST = 1024
# typical change of velocity, time and path [m/s], [s], [m]; powers of two
SPEED, TIME, PATH = 4.0, 0.0625, 1.0


class Sinks:
    """Sums over the steps of all parcels, by the cell of the middle of each step.

    Parameters
    ----------
    grid : cells
    mass_flow : scale of the sums [kg/s], equal on all ranks: a bound on the sum of rate m, and a
        thousand times the largest
    heat_capacity : of particles [J/kg/K], the scale of heat; None for no heat
    """

    def __init__(self, grid: Grid, mass_flow: float, heat_capacity: float | None = None) -> None:
        self.grid = grid
        unit = FINENESS * 2.0 ** math.ceil(math.log2(max(mass_flow, 1e-300)))
        self.quanta = {
            "impulse": unit * SPEED,
            "slope": unit,
            "residence": unit * TIME,
            "moment": unit * PATH,
        }
        self.sums = np.zeros((grid.count, _kernel.SUMS), dtype=np.int64)
        self.heat_sums: npt.NDArray[np.int64] | None = None
        if heat_capacity is not None:
            per_kelvin = unit * 2.0 ** math.ceil(math.log2(heat_capacity))
            self.quanta |= {"heat": per_kelvin * SPEED, "heat_slope": per_kelvin}
            self.heat_sums = np.zeros((grid.count, 2), dtype=np.int64)

    @classmethod
    def of(
        cls,
        grid: Grid,
        parcels: Parcels,
        comm: MPI.Comm | None = None,
        heat_capacity: float | None = None,
    ) -> Self:
        """Sums whose scale suits a cloud (collective on `comm`)."""
        most, count = float(parcels.mass_flow.max(initial=0.0)), len(parcels)
        if comm is not None:
            most, count = comm.allreduce(most, MPI.MAX), comm.allreduce(count)
        return cls(grid, most * max(count, FEWEST), heat_capacity)

    def clear(self) -> None:
        """Begin anew."""
        self.sums[:] = 0
        if self.heat_sums is not None:
            self.heat_sums[:] = 0

    def reduce(self, comm: MPI.Comm) -> None:
        """Add up the sums of all ranks that hold all cells (collective).

        Where each rank holds its part of the grid, its sums are whole already.
        """
        if self.grid.comm.size > 1:
            return
        for sums in (self.sums, self.heat_sums):
            if sums is not None:
                comm.Allreduce(MPI.IN_PLACE, sums, MPI.SUM)

    def for_kernel(self) -> dict[str, Any]:
        """Sums and scales of the kernel."""
        scales = {name: 1 / quantum for name, quantum in self.quanta.items()}
        if self.heat_sums is None:
            return {"sums": self.sums, **scales}
        scales["heat_scale"] = scales.pop("heat")
        return {"sums": self.sums, "heat": self.heat_sums, **scales}

    @property
    def impulse(self) -> Floats:
        """Momentum that the gas gave to particles per second, sum of rate m dv (cells, 3) [N].

        Drag and the other forces of the gas, without weight and walls.
        """
        return np.asarray(self.sums[:, :3] * self.quanta["impulse"])

    @property
    def slope(self) -> Floats:
        """Sum of rate m (1 - e^(-B dt)) (cells,) [kg/s]: minus its growth with the gas velocity."""
        return np.asarray(self.sums[:, 3] * self.quanta["slope"])

    @property
    def residence(self) -> Floats:
        """Sum of rate m dt: mass of particles in each cell (cells,) [kg]."""
        return np.asarray(self.sums[:, 4] * self.quanta["residence"])

    @property
    def moment(self) -> Floats:
        """Sum of rate m v dt (cells, 3) [kg m/s]; over `residence` the mean velocity."""
        return np.asarray(self.sums[:, 5:] * self.quanta["moment"])

    @property
    def heat(self) -> Floats:
        """Heat that the gas gave to particles (cells,) [W]."""
        assert self.heat_sums is not None
        return np.asarray(self.heat_sums[:, 0] * self.quanta["heat"])

    @property
    def heat_slope(self) -> Floats:
        """Its growth with the gas temperature (cells,) [W/K]."""
        assert self.heat_sums is not None
        return np.asarray(self.heat_sums[:, 1] * self.quanta["heat_slope"])

# SPDX-License-Identifier: LGPL-3.0-or-later
"""The gas at the nodes of a grid as the kernel reads it: one row a node."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

import fem_tfm._kernel as _kernel
from fem_tfm.models.particles.grid import Floats, Grid
from fem_tfm.models.particles.shapes import aligned

# places in a row
VELOCITY, RATE, TIME, FACTOR = slice(0, 3), 3, 4, slice(5, 11)
STRIP, TEMPERATURE, PRESSURE = 11, 12, slice(13, 16)
# places of the factor in a matrix, lower triangle by rows
LOWER = (0, 1, 1, 2, 2, 2), (0, 0, 1, 0, 1, 2)
# T_L where there is no turbulence [s]
CALM = 1e6
# the least principal stress that is kept, over k
SMALLEST_STRESS = 1e-3


@dataclass(eq=False)
class Field:
    """Gas velocity, turbulence, temperature and pressure gradient at the nodes of a grid.

    density, viscosity : of the gas [kg/m3], [Pa s]
    rows : (nodes, 16) velocity [m/s], 1/T_L [1/s], T_L [s], Cholesky factor of the Reynolds
        stresses L11 L21 L22 L31 L32 L33 [m/s], 1/(kappa u+) of the strip at the wall,
        temperature [K], grad p/rho [m/s2]
    rows_ahead : the rows at the end of `span`, linear in between; None for one station
    span : z [m], or times [s], of the rows
    conductivity, heat_capacity : of the gas [W/m/K], [J/kg/K]
    clipped : nodes whose Reynolds stresses were made realisable
    """

    grid: Grid
    density: float
    viscosity: float
    rows: npt.NDArray[np.float32] = field(init=False)
    rows_ahead: npt.NDArray[np.float32] | None = None
    span: tuple[float, float] = (0.0, 0.0)
    conductivity: float = 0.0
    heat_capacity: float = 1.0
    clipped: int = 0

    def __post_init__(self) -> None:
        self.rows = empty_rows(len(self.grid.points))

    def fill(
        self,
        velocity: Floats,
        stress: Floats | None = None,
        time: Floats | None = None,
        strip: Floats | float = 0.0,
        temperature: Floats | float = 0.0,
        pressure_gradient: Floats | float = 0.0,
    ) -> None:
        """Set the rows, those ahead where there are two stations.

        velocity : (nodes, 3);  stress : (nodes, 3, 3) or None;  time : (nodes,) T_L
        """
        rows = empty_rows(len(self.grid.points))
        rows[:, VELOCITY] = velocity
        if stress is not None and time is not None:
            factor, self.clipped = cholesky(stress)
            rows[:, FACTOR] = factor[:, LOWER[0], LOWER[1]]
            rows[:, TIME], rows[:, RATE] = self.grid.positive(time), self.grid.positive(1 / time)
        rows[:, STRIP] = strip
        rows[:, TEMPERATURE] = temperature
        rows[:, PRESSURE] = pressure_gradient
        if self.rows_ahead is None:
            self.rows = rows
        else:
            self.rows_ahead = rows

    def keep(self, start: float, end: float) -> None:
        """The newest rows become those at `start`; what `fill` sets next holds at `end`."""
        if self.rows_ahead is not None:
            self.rows = self.rows_ahead
        self.rows_ahead, self.span = self.rows.copy(), (start, end)

    def settle(self) -> None:
        """The newest rows hold everywhere."""
        if self.rows_ahead is not None:
            self.rows, self.rows_ahead = self.rows_ahead, None

    def forget(self) -> None:
        """The rows at the beginning of the slab hold everywhere again."""
        self.rows_ahead = None

    def fastest(self) -> float:
        """Largest speed at a node of any rank [m/s] (collective on the grid)."""
        both = (rows for rows in (self.rows, self.rows_ahead) if rows is not None)
        most = max(float(np.linalg.norm(r[:, VELOCITY], axis=1).max(initial=0.0)) for r in both)
        return float(self.grid.comm.allreduce(most, MPI.MAX))

    def for_kernel(self) -> dict[str, Any]:
        """Rows and numbers of the kernel."""
        return {
            "rows": self.rows,
            "rows_ahead": self.rows_ahead,
            "from": self.span[0],
            "to": self.span[1],
            "density": self.density,
            "viscosity": self.viscosity,
            "conductivity": self.conductivity,
            "heat_capacity": self.heat_capacity,
        }


def empty_rows(count: int) -> npt.NDArray[np.float32]:
    """Rows of a gas at rest."""
    rows = aligned(count, _kernel.ROW)
    rows[:, RATE], rows[:, TIME] = 1 / CALM, CALM
    return rows


def cholesky(stress: Floats) -> tuple[Floats, int]:
    """Lower factors of symmetric matrices (n, 3, 3), and how many had to be made positive.

    A principal stress below 1e-3 k is raised to that; a discretised transport equation may leave
    the realisable range.
    """
    stress = (stress + stress.transpose(0, 2, 1)) / 2
    values, vectors = np.linalg.eigh(stress)
    k = np.maximum(np.trace(stress, axis1=1, axis2=2) / 2, 1e-30)
    low = values[:, 0] < SMALLEST_STRESS * k
    if low.any():
        raised = np.maximum(values[low], (SMALLEST_STRESS * k[low])[:, None])
        v = vectors[low]
        stress[low] = np.einsum("nij,nj,nkj->nik", v, raised, v)
    return np.linalg.cholesky(stress), int(low.sum())

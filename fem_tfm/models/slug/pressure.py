# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steps of the gas pressure: tables built once, matrices filled by values, banded Cholesky.

`forms` states the balance. Every integral is linear in one nodal field, so that a matrix or vector
is a constant sparse matrix times the values of that field. Time steps are BDF2, the first one
implicit Euler: second order, and L-stable, which the stiff diffusion in a slug needs.
"""

from __future__ import annotations

from dataclasses import MISSING, dataclass
from typing import Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.linalg import lapack

from fem_tfm.closures.base import law
from fem_tfm.closures.permeability import Permeability
from fem_tfm.errors import InputError, SolverError
from fem_tfm.fenics import compile_forms
from fem_tfm.models.slug.forms import GasForms
from fem_tfm.models.slug.grains import Grains
from fem_tfm.models.slug.mesh import TubeMesh
from fem_tfm.parameters import Parameters, parameter

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class TubeGas(Parameters):
    """The gas of a slug tube.

    balance : "linear" is the paper's eq. (5), "full" keeps the pressure in all coefficients
    porosity_floor : the resistance of the bed is that of this porosity where there is less gas
    """

    viscosity: float = parameter(MISSING, "Pa s", "effective dynamic viscosity", gt=0, le=1)
    density: float = parameter(1.2, "kg/m3", "density at the reference pressure", gt=0, le=2000)
    reference_pressure: float = parameter(
        101325.0, "Pa", "absolute pressure P_0 at the outlet", gt=0, le=1e9
    )
    permeability: Permeability = law(
        "permeability", "carman-kozeny", "resistance of the bed", "closures.permeability"
    )
    balance: Literal["linear", "full"] = parameter("linear", doc="form of the gas balance")
    porosity_floor: float = parameter(0.2, "-", "least porosity in the resistance", gt=0, lt=1)
    table: ClassVar[str] = "gas"


class GasTables:
    """Sparse matrices that turn nodal fields into vectors and into the band of a matrix.

    The unknowns are the nodes before the outlet, which come first in tube order.
    """

    def __init__(self, tube: TubeMesh) -> None:
        self.tube = tube
        self.unknowns = tube.size - tube.per_plane
        products, n = tube.products(), tube.size
        a, b, k = np.broadcast_arrays(
            tube.cells[:, :, None, None], tube.cells[:, None, :, None], tube.cells[:, None, None, :]
        )
        lower = (a >= b) & (a < self.unknowns)
        self.width = int((a - b)[lower].max())
        place = (a - b) * self.unknowns + b
        size = (self.width + 1) * self.unknowns
        self.diffusion = _table(products["diffusion"], place, k, lower, (size, n))
        a, k = np.broadcast_arrays(tube.cells[:, :, None], tube.cells[:, None, :])
        everywhere = np.ones(a.shape, dtype=bool)
        self.storage = _table(products["mass"], a, k, everywhere, (n, n))
        slopes = [_table(products["slope"][..., d], a, k, everywhere, (n, n)) for d in range(3)]
        # int c u . grad w of the values of c u by component
        self.displacement = sparse.hstack(slopes).tocsr()
        # int grad P' w of the values of P', by component
        self.gradient = sparse.vstack([slope.T for slope in slopes]).tocsr()
        self.inlet = self._inlet()
        self.inlet_area = float(self.inlet.sum())

    def _inlet(self) -> Array:
        from dolfinx import fem

        zero = self.tube.function(np.zeros(self.tube.size))
        (form,) = compile_forms([GasForms(self.tube, zero, zero, None, zero).inlet()])
        return self.tube.nodal(fem.assemble_vector(form).array)

    def band(self, mobility: Array) -> Array:
        """Lower band of int m grad P' . grad w, (width + 1, unknowns)."""
        return (self.diffusion @ mobility).reshape(self.width + 1, self.unknowns)

    def nodal_gradient(self, pressure: Array) -> Array:
        """int grad P' w, (n, 3)."""
        return (self.gradient @ pressure).reshape(3, -1).T


def _table(
    values: Array,
    rows: npt.NDArray[Any],
    columns: npt.NDArray[Any],
    used: npt.NDArray[np.bool_],
    shape: tuple[int, int],
) -> sparse.csr_matrix:
    entries = values[used], (rows[used], columns[used])
    return sparse.coo_matrix(entries, shape=shape).tocsr()


class GasPressure:
    """The pressure field, its steps, and the force on the grains.

    pressure : P' at the nodes [Pa]
    porosity, velocity : f and u at the nodes, from the grains
    """

    def __init__(self, tube: TubeMesh, gas: TubeGas, diameter: float) -> None:
        self.tube, self.gas, self.diameter = tube, gas, diameter
        self.tables = GasTables(tube)
        n = tube.size
        self.pressure, self.before = np.zeros(n), np.zeros(n)
        self.porosity, self.velocity = np.ones(n), np.zeros((n, 3))
        self.solids = np.zeros(n)
        self.resistance, self.share = np.zeros(n), np.zeros(n)
        self.last_step = 0.0
        radius = tube.mesh.section.radius
        # the empty tube resists as Poiseuille's flow does
        self._wall = 8 * gas.viscosity / radius**2

    # -- the grains --------------------------------------------------------------------------------

    def take(self, grains: Grains) -> None:
        """Take porosity and velocity from the grains."""
        self.set_grains(*self.tube.spread(grains))

    def set_grains(self, solids: Array, momentum: Array) -> None:
        """Set porosity and velocity from the volume (n,) and volume times velocity (n, 3)."""
        self.solids = solids
        self.porosity = np.maximum(1 - solids / self.tube.volumes, 0.0)
        some = np.maximum(solids, 1e-300)[:, None]
        self.velocity = np.where(solids[:, None] > 0, momentum / some, 0.0)

    def push(self, grains: Grains) -> None:
        """Put the force of the gas on the grains that `take` has seen last."""
        self.tube.tents.pull(grains.core, self.force_field())

    def force_field(self) -> Array:
        """Force on the grains per their volume at the nodes, (n, 3) [N/m3].

        Grains bear the part of grad P that their resistance has in that of bed and wall. A node's
        part is shared by the grains around it in the proportions in which they have given it their
        volume; hence what the gas loses is what the grains gain.
        """
        slope = self.tables.nodal_gradient(self.pressure) * self.share[:, None]
        some = np.maximum(self.solids, 1e-300)[:, None]
        return np.ascontiguousarray(np.where(self.solids[:, None] > 0, -slope / some, 0.0))

    # -- steps -------------------------------------------------------------------------------------

    def _resist(self) -> None:
        """Resistance of bed and wall, and the share of the bed, at the present slope."""
        open_share = np.maximum(self.porosity, self.gas.porosity_floor)
        a, b = self.gas.permeability.resistance(open_share, self.gas, self.diameter)
        # no bed where there are no grains, whatever a law says there
        both = a + self._wall
        if np.any(b):
            slope = self.tables.nodal_gradient(self.pressure) / self.tube.volumes[:, None]
            size = np.linalg.norm(slope, axis=1)
            # both q + b q^2 = |grad P|
            speed = 2 * size / (both + np.sqrt(both**2 + 4 * b * size))
            a, both = a + b * speed, both + b * speed
        self.resistance, self.share = both, a / both

    def step(self, time_step: float, inflow: float, source: Array | None = None) -> None:
        """Take one step with the grains as they are at its end.

        inflow : volume of gas and grains that comes in through an area at the inlet [m/s]
        source : further right hand side at the nodes [Pa m3/s]

        Raises
        ------
        SolverError
            the matrix is not positive definite: a field is not finite.
        """
        self._resist()
        level = self._level(time_step)
        flux = (level[:, None] * self.velocity).T.ravel()
        band = self.tables.band(level / self.resistance)
        right = self.tables.displacement @ flux + level * inflow * self.tables.inlet
        if self.gas.balance == "full":
            moved = ((1 - self.porosity)[:, None] * self.velocity).T.ravel()
            slope = self.tables.gradient @ self._ahead(time_step)
            right += (moved * slope).reshape(3, -1).sum(axis=0)
        if source is not None:
            right += source
        storage = self.tables.storage @ self.porosity
        now, old = self._scheme(time_step)
        right += storage * old
        n = self.tables.unknowns
        band[0] += now * storage[:n]
        _, found, info = lapack.dpbsv(band, right[:n], lower=1, overwrite_ab=1, overwrite_b=1)
        if info != 0 or not np.isfinite(found).all():
            raise SolverError("the gas pressure has no solution: take smaller time steps")
        self.before, self.pressure = self.pressure, np.append(found, np.zeros(self.tube.per_plane))
        self.last_step = time_step

    def _ahead(self, time_step: float) -> Array:
        """P' extrapolated to the end of the step, second order after the first."""
        ratio = time_step / self.last_step if self.last_step else 0.0
        return self.pressure + ratio * (self.pressure - self.before)

    def _level(self, time_step: float) -> Array:
        """c: P_0, or P at the end of the step."""
        base = np.full(self.tube.size, self.gas.reference_pressure)
        return base + self._ahead(time_step) if self.gas.balance == "full" else base

    def _scheme(self, time_step: float) -> tuple[float, Array]:
        """dP'/dt = now P' - old: BDF2 on steps of any length, or implicit Euler."""
        if self.last_step == 0.0:
            return 1 / time_step, self.pressure / time_step
        w = time_step / self.last_step
        now = (1 + 2 * w) / (1 + w) / time_step
        old = ((1 + w) * self.pressure - w**2 / (1 + w) * self.before) / time_step
        return now, old

    # -- what is known -----------------------------------------------------------------------------

    @property
    def drop(self) -> float:
        """Mean pressure at the inlet over that at the outlet [Pa]."""
        return float(self.tables.inlet @ self.pressure / self.tables.inlet_area)

    def along(self) -> Array:
        """Mean pressure of each plane of nodes, weighted by their volumes [Pa]."""
        shape = (len(self.tube.planes), self.tube.per_plane)
        w, p = self.tube.volumes.reshape(shape), self.pressure.reshape(shape)
        return np.asarray((w * p).sum(axis=1) / w.sum(axis=1))

    def lost_by_gas(self) -> Array:
        """Force that the gas exerts on the grains, from its own balance (3,) [N]."""
        has = self.solids > 0
        slope = self.tables.nodal_gradient(self.pressure) * self.share[:, None]
        return np.asarray(-slope[has].sum(axis=0))

    def state(self) -> dict[str, Any]:
        """What the next step depends on."""
        times = np.array([self.last_step])
        return {"pressure": self.pressure.copy(), "before": self.before.copy(), "times": times}

    def restore(self, state: dict[str, Any]) -> None:
        """Put back what `state` gave."""
        self.pressure = np.array(state["pressure"], dtype=float)
        self.before = np.array(state["before"], dtype=float)
        self.last_step = float(state["times"][0])

    def check(self) -> None:
        """Raise InputError for cells that are hardly larger than a grain."""
        volume = np.pi / 6 * self.diameter**3
        least = float(self.tube.volumes.min() / volume)
        if least < 0.3:
            words = "fewer: the least node of the mesh has a volume below 0.3 grains"
            raise InputError("numerics.cells_across", f"{least:.2g} grains a node", words)

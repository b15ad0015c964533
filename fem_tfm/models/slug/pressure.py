# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steps of the gas pressure: tables built once, matrices filled by values, banded Cholesky.

`forms` states the balance. Coefficients are evaluated at the points of the quadrature, as UFL does;
each matrix and vector then is a sum over cells of constant tables times their values there. Time
steps are BDF2, the first one implicit Euler: second order, and L-stable, which the stiff diffusion
needs.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from scipy.linalg import lapack

from fem_tfm.errors import SolverError
from fem_tfm.fenics import compile_forms
from fem_tfm.models.slug.averaging import Averaging
from fem_tfm.models.slug.forms import GasForms
from fem_tfm.models.slug.gas import TubeGas, resistance
from fem_tfm.models.slug.grains import Grains
from fem_tfm.models.slug.mesh import TubeMesh, by_cell

Array = npt.NDArray[np.float64]


class Band:
    """The matrix of int m grad P' . grad w, from the values of m at the points to its band.

    The unknowns are the nodes before the outlet, which come first in tube order.

    width : of the band below the diagonal
    """

    def __init__(self, tube: TubeMesh) -> None:
        self.unknowns = tube.size - tube.per_plane
        g, nodes = tube.gradients, tube.cells[:, 0]
        products = np.einsum("clq,clqad,clqbd->clqab", tube.weights, g, g)
        quads = len(products)
        # the same pairs of nodes in all slices, the greater number first
        pairs = [np.nonzero(one[:, None] >= one) for one in nodes]
        first, second = (np.array([pair[k] for pair in pairs]) for k in (0, 1))
        number = np.arange(quads)[:, None]
        table = products.transpose(0, 3, 4, 1, 2)[number, first, second]
        self._table = table.transpose(0, 2, 3, 1).copy()
        a, b = (np.take_along_axis(tube.cells, one[:, None], axis=2) for one in (first, second))
        self.width = int((a - b).max())
        self._size = (self.width + 1) * self.unknowns
        # column by column, as LAPACK wants it
        place = np.where(a < self.unknowns, (a - b) + b * (self.width + 1), self._size)
        self._place = place.ravel()

    def __call__(self, mobility: Array) -> Array:
        """Lower band (width + 1, unknowns)."""
        values = by_cell(mobility, self._table).ravel()
        found = np.bincount(self._place, values, minlength=self._size + 1)[:-1]
        return found.reshape(self.unknowns, self.width + 1).T


class GasPressure:
    """The pressure field, its steps, and the force on the grains.

    width : standard deviation of the averages of the grains [m], 0 where the mesh alone averages
    pressure : P' at the nodes [Pa]
    porosity, velocity : f and u at the nodes, from the grains
    """

    def __init__(self, tube: TubeMesh, gas: TubeGas, diameter: float, width: float = 0.0) -> None:
        self.tube, self.gas, self.diameter = tube, gas, diameter
        self.average = Averaging(tube, width)
        self.band = Band(tube)
        n = tube.size
        self.pressure, self.before = np.zeros(n), np.zeros(n)
        self.porosity, self.velocity = np.ones(n), np.zeros((n, 3))
        self.solids = np.zeros(n)
        self.last_step = 0.0
        self._inlet = self._inlet_weights()
        # what the slope of the pressure is needed for
        inertial = bool(gas.permeability.resistance(0.5, gas, diameter)[1])
        self._sloping = inertial or gas.balance == "full"
        # the bed's share of the resistance at the points, in the last step
        self._share = np.zeros((*tube.cells.shape[:2], tube.weights.shape[-1]))

    def _inlet_weights(self) -> Array:
        nothing: Any = None
        forms = GasForms(self.tube, self.gas, self.diameter, nothing, nothing, nothing)
        (form,) = compile_forms([forms.inlet()])
        return self.tube.nodal(fem.assemble_vector(form).array)

    # -- the grains --------------------------------------------------------------------------------

    def take(self, grains: Grains) -> None:
        """Take porosity and velocity from the grains."""
        self.average_over(*self.tube.spread(grains))

    def average_over(self, volume: Array, momentum: Array) -> None:
        """Take porosity and velocity from averages of what all grains have given to the nodes."""
        self.set_grains(self.average.spread(volume), self.average.spread(momentum))

    def set_grains(self, solids: Array, momentum: Array) -> None:
        """Set porosity and velocity from the volume (n,) and volume times velocity (n, 3)."""
        self.solids = solids
        self.porosity = np.maximum(1 - solids / self.tube.volumes, 0.0)
        some = np.maximum(solids, 1e-300)[:, None]
        self.velocity = np.where(solids[:, None] > 0, momentum / some, 0.0)

    def push(self, grains: Grains) -> None:
        """Put the force of the gas on the grains that `take` has seen last."""
        some = np.maximum(self.solids, 1e-300)[:, None]
        field = np.where(self.solids[:, None] > 0, self.nodal_force() / some, 0.0)
        self.tube.tents.pull(grains.core, np.ascontiguousarray(self.average(field)))

    def nodal_force(self) -> Array:
        """-int s grad P' w with the bed's share s of the resistance, (n, 3) [N].

        Grains bear the part of grad P that their resistance has in that of bed and wall. A node's
        part is shared by the grains around it in the proportions in which they have given it their
        volume; hence what the gas loses is what the grains gain.
        """
        slope = -self.tube.slope(self.pressure) * self._share[:, :, None]
        return np.stack([self.tube.integrals(slope[:, :, d]) for d in range(3)], axis=-1)

    # -- steps -------------------------------------------------------------------------------------

    def coefficients(self, ahead: Array) -> tuple[Array, Array, Array]:
        """c/r and the bed's share at the points; right hand side without the inlet."""
        tube, gas = self.tube, self.gas
        porosity, velocity = tube.value(self.porosity), tube.vector(self.velocity)
        slope = tube.slope(ahead) if self._sloping else np.zeros((1, 1, 3, 1))
        size = np.sqrt((slope**2).sum(axis=2))
        open_share = np.maximum(porosity, gas.porosity_floor)
        radius = tube.mesh.section.radius
        r, share = resistance(gas, self.diameter, radius, open_share, size, np.sqrt)
        level = np.full_like(porosity, gas.reference_pressure)
        if gas.balance == "full":
            level += tube.value(ahead)
        right = tube.integrals_of_slopes(level[:, :, None] * velocity)
        if gas.balance == "full":
            right += tube.integrals((1 - porosity) * (velocity * slope).sum(axis=2))
        return level / r, share, right

    def step(self, time_step: float, inflow: float) -> None:
        """Take one step with the grains as they are at its end.

        inflow : volume of gas and grains that comes in through an area at the inlet [m/s]

        Raises
        ------
        SolverError
            the matrix is not positive definite: a field is not finite.
        """
        ahead = self._ahead(time_step)
        mobility, self._share, right = self.coefficients(ahead)
        level = np.full_like(ahead, self.gas.reference_pressure)
        if self.gas.balance == "full":
            level += ahead
        right += level * inflow * self._inlet
        storage = self.tube.integrals(self.tube.value(self.porosity))
        now, old = self._scheme(time_step)
        right += storage * old
        n, band = self.band.unknowns, self.band(mobility)
        band[0] += now * storage[:n]
        _, found, info = lapack.dpbsv(band, right[:n], lower=1, overwrite_ab=1, overwrite_b=1)
        if info != 0 or not np.isfinite(found).all():
            raise SolverError("the gas pressure has no solution: take a smaller numerics.gas_step")
        self.before, self.pressure = self.pressure, np.append(found, np.zeros(self.tube.per_plane))
        self.last_step = time_step

    def _ahead(self, time_step: float) -> Array:
        """P' extrapolated to the end of the step, second order after the first."""
        ratio = time_step / self.last_step if self.last_step else 0.0
        return self.pressure + ratio * (self.pressure - self.before)

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
        return float(self._inlet @ self.pressure / self._inlet.sum())

    def along(self) -> Array:
        """Mean pressure of each plane of nodes, weighted by their volumes [Pa]."""
        shape = (len(self.tube.planes), self.tube.per_plane)
        w, p = self.tube.volumes.reshape(shape), self.pressure.reshape(shape)
        return np.asarray((w * p).sum(axis=1) / w.sum(axis=1))

    def state(self) -> dict[str, Any]:
        """What the next step depends on."""
        times = np.array([self.last_step])
        return {"pressure": self.pressure.copy(), "before": self.before.copy(), "times": times}

    def restore(self, state: dict[str, Any]) -> None:
        """Put back what `state` gave."""
        self.pressure = np.array(state["pressure"], dtype=float)
        self.before = np.array(state["before"], dtype=float)
        self.last_step = float(state["times"][0])

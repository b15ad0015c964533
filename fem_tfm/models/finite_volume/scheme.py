# SPDX-License-Identifier: LGPL-3.0-or-later
"""The scheme of a flow in space and time, chosen once: of first or of second order.

Equations take the upwind value on every face and ask the scheme for the correction of its flux.
Corrections are explicit, so an equation of second order is solved `solves` times.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fem_tfm.models.finite_volume.cells.limiter import limit_flux, limited_increments
from fem_tfm.models.finite_volume.cells.line import LineMesh
from fem_tfm.models.finite_volume.cells.mesh import Array
from fem_tfm.models.finite_volume.state import Inflow, State
from fem_tfm.models.finite_volume.time_levels import (
    PreviousStep,
    TimeLevels,
    bdf2,
    implicit_euler,
)

# differences below this share of a scale, for cells as wide as the line, are not limited
SMOOTH = 0.3


class FirstOrder:
    """Upwind values in space and the implicit Euler method in time.

    Attributes
    ----------
    solves : times that an equation is solved in a step
    needs_previous : whether a step needs the state before the present one
    """

    solves, needs_previous = 1, False

    def __init__(self, line: LineMesh) -> None:
        self.line = line

    def attempts(
        self,
        now: State,
        previous: PreviousStep | None,
        dt: float,
        inflow: Inflow,
        gas_density: tuple[Array | float, Array | float],
    ) -> Iterator[TimeLevels]:
        """Levels of a step of `dt` [s], the next ones for where the step from these fails."""
        yield implicit_euler(self.line, now, dt)

    def correction(
        self, flux: Array, values: Array, scale: Array | float, gradient: Array | None = None
    ) -> Array | float:
        """Flux of face values less that of upwind ones, on all faces (collective).

        flux (faces) : what carries the values
        values (cells, ...) : a scalar or a vector
        scale (inner) : of the values, below which differences are not limited
        gradient (cells, ..., 3) : of the values, found where it is None
        """
        return 0.0

    def net_correction(
        self, flux: Array, values: Array, scale: Array | float, gradient: Array
    ) -> Array | float:
        """The correction's net flux out of each owned cell."""
        return 0.0

    def outflow(self, velocity: Array) -> Array | float:
        """Flux out of the outlet's faces less that of the velocity of their cells [m3/s]."""
        return 0.0

    def bounded_correction(
        self, flux: Array, values: Array, share: Array, loss: Array, gain: Array | float
    ) -> Array | float:
        """The correction times `share` (faces), limited so that cells keep their bounds.

        loss, gain (owned) : most that the corrections may take out of a cell and bring into it
        """
        return 0.0

    def net_bounded_correction(
        self, flux: Array, values: Array, share: Array, loss: Array, gain: Array | float
    ) -> Array | float:
        """The bounded correction's net flux out of each owned cell; values (owned)."""
        return 0.0


class SecondOrder(FirstOrder):
    """Limited linear values in space and BDF2 in time; of first order where solids are packed.

    packing_limit : of the solids [-]; 1 without them
    """

    solves, needs_previous = 2, True

    def __init__(self, line: LineMesh, packing_limit: float) -> None:
        super().__init__(line)
        self._packing_limit = packing_limit
        # extrema of smooth values are lower than this in fine cells
        spacing = np.linalg.norm(line.cells.delta[line.inner], axis=1)
        self._small = SMOOTH * (spacing / line.diameter) ** 1.5

    def attempts(
        self,
        now: State,
        previous: PreviousStep | None,
        dt: float,
        inflow: Inflow,
        gas_density: tuple[Array | float, Array | float],
    ) -> Iterator[TimeLevels]:
        """BDF2, or Euler in the first step; where that fails, Euler with upwind values."""
        if previous is None:
            yield implicit_euler(self.line, now, dt, self._packing_limit)
        else:
            yield bdf2(self.line, now, previous, dt, self._packing_limit, inflow, gas_density)
        yield implicit_euler(self.line, now, dt)

    def correction(
        self, flux: Array, values: Array, scale: Array | float, gradient: Array | None = None
    ) -> Array:
        """Flux of limited linear values less that of upwind ones, on all faces."""
        cells, inner, outlet = self.line.cells, self.line.inner, self.line.outlet
        leaving = np.maximum(flux[outlet], 0.0)
        if gradient is None:
            gradient = cells.ghosted(cells.gradient(values))
        ahead, back = limited_increments(cells, values, gradient, scale * self._small)
        found = np.zeros((cells.face_count, *values.shape[1:]))
        flux = flux[inner].reshape(-1, *(1,) * (values.ndim - 1))
        found[inner] = flux * np.where(flux > 0, ahead, back)
        leaving = leaving.reshape(-1, *(1,) * (values.ndim - 1))
        found[outlet] = leaving * self.line.rise_to_outlet(values)
        return found

    def net_correction(
        self, flux: Array, values: Array, scale: Array | float, gradient: Array
    ) -> Array:
        """The correction's net flux out of each owned cell."""
        return self.line.cells.net_flux(self.correction(flux, values, scale, gradient))

    def outflow(self, velocity: Array) -> Array:
        """Flux of linear values out of the outlet's faces less that of the cells [m3/s]."""
        area = self.line.cells.area[self.line.outlet]
        return np.einsum("ni,ni->n", self.line.rise_to_outlet(velocity), area)

    def bounded_correction(
        self, flux: Array, values: Array, share: Array, loss: Array, gain: Array | float
    ) -> Array:
        """The correction times `share`, limited so that cells keep their bounds."""
        cells = self.line.cells
        scale = cells.to_faces(values)[self.line.inner]
        return limit_flux(cells, share * self.correction(flux, values, scale), loss, gain)

    def net_bounded_correction(
        self, flux: Array, values: Array, share: Array, loss: Array, gain: Array | float
    ) -> Array:
        """The bounded correction's net flux out of each owned cell; values (owned)."""
        cells = self.line.cells
        values = cells.ghosted(values)
        return cells.net_flux(self.bounded_correction(flux, values, share, loss, gain))

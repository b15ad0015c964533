# SPDX-License-Identifier: LGPL-3.0-or-later
"""The largest velocities that pressure, weight and drag can make.

What enters at U gains at most the work of the pressure and the weight along the line, and of what
the solids pressure stores; drag makes no phase faster than the other one is:

    u_g^2 <= F^2 [max(U_g, u_s)^2 + 2 dp/rho_g]
    u_s^2 <= F^2 [max(U_s, u_g)^2 + 2 (dp/rho_s + dPhi + max(p_s/(a_s rho_s)))]

with dp the range of the pressure before and after a step, dPhi that of the weight's potential, and
a factor F = 2 for what swings; where eddies disperse the solids, the slip that they cause adds to
both U. A flow that is faster already may grow by a tenth in a step, and one
below a millionth of the velocity scale is round-off.
"""

from __future__ import annotations

import math

import numpy as np

from fem_tfm.errors import SolverError
from fem_tfm.models.finite_volume.cells.line import LineMesh
from fem_tfm.models.finite_volume.cells.mesh import SMALLEST, Array
from fem_tfm.models.finite_volume.state import (
    LONELY_FRACTION,
    SMALLEST_FRACTION,
    Inflow,
    State,
)
from fem_tfm.models.finite_volume.time_levels import Step
from fem_tfm.models.pointwise import Pointwise

FACTOR, GROWTH, ROUND_OFF = 2.0, 1.1, 1e-6


class SpeedLimit:
    """The bound of one line.

    Parameters
    ----------
    line, laws : mesh and materials
    gravity : acceleration (3,) [m/s2]
    """

    def __init__(self, line: LineMesh, laws: Pointwise, gravity: Array) -> None:
        self.line, self.laws = line, laws
        self._potential = self._range(line.cells.centre @ gravity)
        self._sharpest = line.cells.largest(line.inverse_distance)
        self._peak = max(line.cells.largest(line.inlet_profile), 1.0)

    def check(self, before: State, step: Step, relative_density: Array | None) -> None:
        """Refuse a step that makes a phase faster than anything can (collective).

        Sources, which may push as they want, are not judged.

        relative_density : of a compressible gas after the step, over the reference [-]

        Raises
        ------
        SolverError
            a velocity beyond its bound.
        """
        if step.inflow.sources is not Inflow.sources:
            return
        after, pressure = step.state, self._range(before.p, step.state.p)
        thinnest = 1.0
        if relative_density is not None:
            thinnest = max(-self.line.cells.largest(-relative_density), 1e-9)
        work = pressure / (thinnest * self.laws.gas.density)
        fed = self._peak * step.inflow.mean_velocity("gas") / thinnest
        gas, gas_before = self._fastest(after.u_g), self._fastest(before.u_g)
        solids = solids_before = 0.0
        if step.solids is not None:
            solids, solids_before = self._fastest(after.u_s), self._fastest(before.u_s)
        drift = self._drift(step)
        self._judge("gas", gas, gas_before, max(fed, solids_before) + drift, work)
        if step.solids is not None:
            density = self.laws.grain.density
            stored = step.solids.pressure / np.maximum(step.solids.alpha, LONELY_FRACTION)
            work = (pressure + self.line.cells.largest(stored)) / density + self._potential
            fed = max(self._peak * step.inflow.solids_velocity, gas, gas_before)
            self._judge("solids", solids, solids_before, fed + drift, work)

    def _drift(self, step: Step) -> float:
        """Largest slip c |grad alpha|/beta by which eddies disperse a front as sharp as a cell."""
        turbulence = step.turbulence
        if turbulence is None or turbulence.dispersion is None or turbulence.drag is None:
            return 0.0
        alpha = np.maximum(step.state.alpha, SMALLEST_FRACTION)
        spread = 2 * turbulence.dispersion * alpha / np.maximum(turbulence.drag, SMALLEST)
        return self.line.cells.largest(spread) * self._sharpest

    def _judge(self, phase: str, speed: float, before: float, carried: float, work: float) -> None:
        most = max(FACTOR * math.sqrt(carried**2 + 2 * work), GROWTH * before)
        most = max(most, ROUND_OFF * self.line.velocity_scale)
        if speed > most:
            raise SolverError(
                f"the {phase} would reach {speed:.3g} m/s, and pressure, weight and drag make"
                f" {most:.3g} m/s at most"
            )

    def _fastest(self, velocity: Array) -> float:
        """Largest velocity of the owned cells [m/s]."""
        return self.line.cells.largest(np.linalg.norm(velocity[self.line.own], axis=1))

    def _range(self, *values: Array) -> float:
        """Largest less smallest value of the owned cells."""
        cells, own = self.line.cells, self.line.own
        high = max(cells.largest(value[own]) for value in values)
        return high - min(-cells.largest(-value[own]) for value in values)

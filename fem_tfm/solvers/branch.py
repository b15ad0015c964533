# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pseudo-arclength continuation of a solution in one parameter.

A branch of solutions (x, s) of F(x, s) = 0 is followed by its arc, so that it may turn back in the
parameter s: each point is predicted along the line through the last two and corrected by Newton's
method in the plane across it::

    F(x, s) = 0,   t.(x - x_p) + t_s (s - s_p) = 0

with the unit tangent (t, t_s) and the prediction (x_p, s_p); lengths are relative to the scales of
the unknowns. Source: H. B. Keller (1977), Numerical solution of bifurcation and nonlinear
eigenvalue problems. It knows no equation.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from fem_tfm.errors import SolverError
from fem_tfm.solvers.newton import BorderedNewton, Change, LinearSolveError

# arc to the first point, the longest and the shortest step, and factors on it
FIRST, LONGEST, SHORTEST, LONGER, SHORTER, HALVED = 0.1, 0.7, 1e-3, 1.6, 0.7, 0.5
# Newton iterations of a point: at most, and those at or below and above which the step changes
MOST, EASY, HARD = 8, 3, 5
# a correction below this is solved; one above or growing so much diverges
SOLVED, LARGEST, GROWTH = 1e-5, 3.0, 2.0
# largest correction of the parameter, and the change that its derivative is taken from
LARGEST_SHIFT, SHIFT = 0.5, 1e-4


class Branch:
    """A branch of solutions, followed towards a smaller parameter at first.

    Parameters
    ----------
    newton : the system at a solution
    alter : sets the parameter
    parameter : its value at that solution

    Raises
    ------
    LinearSolveError
        when the matrix is singular there.
    """

    def __init__(
        self, newton: BorderedNewton, alter: Callable[[float], None], parameter: float
    ) -> None:
        self.newton = newton
        self.alter = alter
        self.parameter = parameter
        self._step = FIRST
        self._point = newton.position()
        response = self._response(parameter)[1]
        self._tangent = self._unit((-response[0], -response[1]), -1.0)

    def advance(self, least: float) -> float:
        """Go to the next point, whose parameter is returned, with none below `least`.

        Raises
        ------
        SolverError
            the steps have become too short.
        """
        while self._step >= SHORTEST:
            try:
                found, iterations = self._corrected(least)
            except LinearSolveError:
                self._step *= HALVED
                continue
            before, self._point = self._point, self.newton.position()
            change = self._point[0] - before[0], self._point[1] - before[1]
            self._tangent = self._unit(change, found - self.parameter)
            self.parameter = found
            if iterations <= EASY:
                self._step = min(LONGER * self._step, LONGEST)
            elif iterations > HARD:
                self._step *= SHORTER
            return found
        raise SolverError("no step along the branch leads to another solution")

    def _corrected(self, least: float) -> tuple[float, int]:
        """Parameter of the next point and the iterations that it took."""
        change, slope = self._tangent
        step, last = self._step, self.parameter + self._step * slope <= least
        if last:
            step = (least - self.parameter) / slope
        self.newton.move(self._point, change, step)
        aim, predicted = self.newton.position(), least if last else self.parameter + step * slope
        parameter, size = predicted, math.inf
        for iteration in range(1, MOST + 1):
            correction, response = self._response(parameter)
            shift = 0.0
            if not last:
                now = self.newton.position()
                gap = now[0] - aim[0] + correction[0], now[1] - aim[1] + correction[1]
                missing = self._dot(change, gap) + slope * (parameter - predicted)
                shift = -missing / (self._dot(change, response) + slope)
            correction = correction[0] + shift * response[0], correction[1] + shift * response[1]
            before, size = size, max(self.newton.size(correction), abs(shift))
            if not size <= min(GROWTH * before, LARGEST) or abs(shift) > LARGEST_SHIFT:
                raise LinearSolveError("no convergence to the branch")
            self.newton.move(self.newton.position(), correction, 1.0)
            parameter += shift
            if size <= SOLVED:
                self.alter(parameter)
                return parameter, iteration
        raise LinearSolveError(f"no convergence to the branch in {MOST} iterations")

    def _response(self, parameter: float) -> tuple[Change, Change]:
        """Correction at a parameter, and its derivative by it, with one factorisation."""
        self.alter(parameter)
        correction = self.newton.full_correction()
        self.alter(parameter + SHIFT)
        shifted = self.newton.full_correction(factor=False)
        self.alter(parameter)
        first, second = ((s - c) / SHIFT for s, c in zip(shifted, correction, strict=True))
        return correction, (first, second)

    def _unit(self, change: Change, slope: float) -> tuple[Change, float]:
        """A direction of length one."""
        length = math.sqrt(self._dot(change, change) + slope**2)
        return (change[0] / length, change[1] / length), slope / length

    def _dot(self, a: Change, b: Change) -> float:
        """Mean product of two changes in the scales of the unknowns (collective)."""
        newton, total = self.newton, 0.0
        for block in newton.blocks:
            one, other = a[0][block.dofs], b[0][block.dofs]
            sums = newton.comm.allreduce(np.array([np.dot(one, other), one.size]))
            total += sums[0] / (max(sums[1], 1.0) * block.scale**2)
        return float(total)

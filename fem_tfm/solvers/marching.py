# SPDX-License-Identifier: LGPL-3.0-or-later
"""Marching of a nonlinear system along a coordinate, station by station.

At each station a BorderedNewton is solved whose residual holds backward differences over the
stations before. The step grows where little happens and Newton is quick; a step that fails is taken
back and repeated with a smaller one. The object decides on steps alone: it knows no equation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from dolfinx import fem

from fem_tfm.errors import SolverError
from fem_tfm.solvers.newton import BorderedNewton, LinearSolveError
from fem_tfm.solvers.step import StepControl, attempt

# a step within this share of the rest of the way takes all of it
LAST = 1.001
SAFETY = 0.9


def backward_weights(step: float, before: float | None) -> tuple[float, float, float]:
    """Weights of the present station and the two before it in a backward difference.

    BDF2 on uneven steps, r = step/before, or backward Euler where there is no step before::

        w_0 = (1 + 2r)/((1 + r) step),  w_1 = -(1 + r)/step,  w_2 = r^2/((1 + r) step)
    """
    if before is None:
        return 1 / step, -1 / step, 0.0
    r = step / before
    return (1 + 2 * r) / (1 + r) / step, -(1 + r) / step, r**2 / (1 + r) / step


@dataclass(frozen=True, kw_only=True)
class MarchControl(StepControl):
    """How the step [m] moves; only failures make it smaller than the first.

    bend : how far a station may lie from the line through the two before it, relative rms
    growth : largest factor from one step to the next; BDF2 is stable below 1 + sqrt(2)
    easy, hard : Newton iterations at or below which the step may grow, above which it shrinks
    tolerance : relative update at which a station counts as solved
    max_iterations, first_iterations : Newton iterations of a station, and of the first one, where
        what enters meets the wall
    order : 1 for backward Euler, 2 for BDF2
    refusals : how often a station that is no answer is tried again with a smaller step
    max_stations : stations before giving up
    """

    bend: float = 0.03
    growth: float = 1.5
    cut: float = 0.4
    easy: int = 3
    hard: int = 5
    tolerance: float = 1e-10
    max_iterations: int = 8
    first_iterations: int = 30
    order: int = 2
    refusals: int = 2
    max_stations: int = 10000


class _Refused(LinearSolveError):
    """Newton has solved a station that is no answer."""


@dataclass(frozen=True)
class Place:
    """Where a march is: coordinate, the step that led there and the one to try next [m].

    last is None at the start and after a restart without the station before, where a first-order
    step follows.
    """

    z: float
    last: float | None
    next: float


@dataclass(frozen=True)
class Stop:
    """What a march tells of a station: place, Newton iterations, update and bend."""

    place: Place
    iterations: int
    update: float
    bend: float


class March:
    """Drives a BorderedNewton downstream.

    Parameters
    ----------
    newton : the system, whose residual holds the backward differences
    upstream : Functions with the unknowns of the two stations before, nearest first
    weights : Constants of the backward difference, the first that of the present station [1/m]
    control : step control
    check : why a station that Newton has solved is no answer, or an empty text
    observe : called after each accepted station; may raise to stop
    retry : called with the new step [m] and the reason when a step is taken back
    """

    def __init__(
        self,
        newton: BorderedNewton,
        upstream: Sequence[fem.Function],
        weights: Sequence[fem.Constant],
        control: MarchControl,
        check: Callable[[], str] = lambda: "",
        observe: Callable[[Stop], None] = lambda stop: None,
        retry: Callable[[float, str], None] = lambda step, reason: None,
    ) -> None:
        self.newton = newton
        self.old, self.older = upstream
        self.weights = tuple(weights)
        self.control = control
        self.check = check
        self.observe = observe
        self.retry = retry

    def run(self, end: float, start: Place | None = None) -> Place:
        """March to `end` [m]; the unknowns hold the station that `start` tells.

        Raises
        ------
        SolverError
            when the step falls below its minimum or the stations are used up; the unknowns are
            those of the last accepted station.
        """
        control = self.control
        place = start or Place(0.0, None, control.first)
        for _ in range(control.max_stations):
            if place.z >= end:
                return place
            rest = end - place.z
            step = rest if place.next * LAST >= rest else min(place.next, rest / 2)
            self._keep(forget=place.last is None)
            stop = self._accepted(place, min(step, rest), end)
            place = stop.place
            self.observe(stop)
        if place.z >= end:
            return place
        raise SolverError(f"{control.max_stations} stations led to z = {place.z:.4g} m only")

    def _accepted(self, place: Place, step: float, end: float) -> Stop:
        """Repeat a step with smaller ones until it succeeds."""
        control, refusals = self.control, 0

        def shrink(step: float, error: Exception) -> float:
            nonlocal refusals
            refusals += isinstance(error, _Refused)
            return control.cut * step if refusals <= control.refusals else 0.0

        stop, step = attempt(
            step,
            control.smallest,
            lambda step: (self._solved(place, step), step),
            shrink,
            failures=LinearSolveError,
            restore=self._restore,
            retry=self.retry,
            refuse=lambda error: f"marching ends at z = {place.z:.4g} m: {error}",
        )
        z = end if end - place.z - step <= 1e-12 * end else place.z + step
        return replace(stop, place=Place(z, step, self._next(step, stop)))

    def _solved(self, place: Place, step: float) -> Stop:
        """Newton at one station from the line through the two before it."""
        control = self.control
        before = place.last if control.order == 2 else None
        for weight, value in zip(self.weights, backward_weights(step, before), strict=True):
            weight.value = value
        guess = self._predict(step / place.last if place.last else 0.0)
        most = control.first_iterations if place.last is None else control.max_iterations
        iterations, update = self._newton(most)
        if reason := self.check():
            raise _Refused(reason)
        return Stop(place, iterations, update, self._bend(guess))

    def _newton(self, most: int) -> tuple[int, float]:
        control, rest = self.control, math.inf
        for iteration in range(1, most + 1):
            update = self.newton.step()
            rest = update.rest
            if update.length == 1.0 and rest > control.tolerance and rest < 1:
                rest = self.newton.polish(control.tolerance, rest)[1]
            if update.length == 1.0 and rest <= control.tolerance:
                return iteration, rest
        raise LinearSolveError(f"no convergence in {most} Newton iterations")

    def _predict(self, ratio: float) -> np.ndarray:
        """Put the unknowns on the line through the last two stations and return them."""
        x = self.newton.unknowns.x.array
        x[:] = self.old.x.array + ratio * (self.old.x.array - self.older.x.array)
        return x.copy()

    def _bend(self, guess: np.ndarray) -> float:
        """Largest relative rms distance of a block from the guess."""
        away = self.newton.unknowns.x.array - guess
        return max(self.newton.relative_rms(b, away) for b in self.newton.blocks if not b.follows)

    def _next(self, step: float, stop: Stop) -> float:
        """The step to try after this one."""
        control = self.control
        factor = SAFETY * math.sqrt(control.bend / max(stop.bend, 1e-12))
        if stop.iterations > control.hard:
            factor = min(factor, 0.7)
        elif stop.iterations > control.easy:
            factor = min(factor, 1.0)
        wanted = step * min(max(factor, control.cut), control.growth)
        return min(max(wanted, min(step, control.first)), control.largest)

    def _keep(self, forget: bool) -> None:
        """The unknowns become those of the last station."""
        x = self.newton.unknowns.x.array
        self.older.x.array[:] = x if forget else self.old.x.array
        self.old.x.array[:] = x
        self._multipliers = [float(b.multiplier.value) for b in self.newton.borders]

    def _restore(self) -> None:
        self.newton.unknowns.x.array[:] = self.old.x.array
        for border, value in zip(self.newton.borders, self._multipliers, strict=True):
            border.multiplier.value = value

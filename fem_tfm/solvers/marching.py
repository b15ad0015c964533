# SPDX-License-Identifier: LGPL-3.0-or-later
"""Marching of a nonlinear system along a coordinate, station by station.

At each station a BorderedNewton is solved whose residual holds backward differences over the
stations before. The step grows where little happens and Newton is quick; a step that fails is taken
back and repeated with a smaller one. The object decides on steps alone: it knows no equation.

What the system exchanges with something else that goes the same way, such as particles, is found by
passes over the slab between two stations: solve, follow the other, solve again with what it tells.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np
from dolfinx import fem

from fem_tfm.errors import SolverError
from fem_tfm.solvers.newton import BorderedNewton, LinearSolveError
from fem_tfm.solvers.step import StepControl, attempt

# a step within this share of the rest of the way takes all of it
LAST = 1.001
SAFETY = 0.9
# before the last pass over a slab the system is solved to this share of the change that may be left
BEFORE = 0.03


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
    exchange : relative change of what a coupled march exchanges at which its passes end
    passes : most passes over a slab; the last one counts, however much it changed
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
    exchange: float = 1e-3
    passes: int = 8
    refusals: int = 2
    max_stations: int = 10000

    def coarser(self, factor: float) -> Self:
        """The same with steps longer by a factor; the bend of a step goes with its square."""
        return replace(
            self,
            first=factor * self.first,
            largest=factor * self.largest,
            bend=factor**2 * self.bend,
        )


class Coupler(Protocol):
    """What goes downstream beside the system and exchanges something with it, slab by slab."""

    def begin(self, start: float, end: float) -> None:
        """A slab is tried, from the last accepted station to a new one [m]."""
        ...

    def trace(self) -> float:
        """Cross the slab with the unknowns at hand and renew what the system gets.

        Returns the relative change of that.
        """
        ...

    def accept(self) -> None:
        """The slab counts as it was traced last."""
        ...

    def reject(self) -> None:
        """The slab was never tried."""
        ...


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
    """What a march tells of a station: place, most Newton iterations at once, update and bend.

    passes, change : of a coupled march, with the change of what was exchanged in the last of them
    """

    place: Place
    iterations: int
    update: float
    bend: float
    passes: int = 0
    change: float = 0.0


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
    coupler : what exchanges something with the system, None for a system alone
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
        coupler: Coupler | None = None,
    ) -> None:
        self.newton = newton
        self.old, self.older = upstream
        self.weights = tuple(weights)
        self.control = control
        self.check = check
        self.observe = observe
        self.retry = retry
        self.coupler = coupler

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
            lambda step: (self._solved(place, step, _reached(place.z, step, end)), step),
            shrink,
            failures=LinearSolveError,
            restore=self._restore,
            retry=self.retry,
            refuse=lambda error: f"marching ends at z = {place.z:.4g} m: {error}",
        )
        if self.coupler:
            self.coupler.accept()
        z = _reached(place.z, step, end)
        return replace(stop, place=Place(z, step, self._next(step, stop)))

    def _solved(self, place: Place, step: float, z: float) -> Stop:
        """Newton at one station, at z, from the line through the two before it."""
        control = self.control
        before = place.last if control.order == 2 else None
        for weight, value in zip(self.weights, backward_weights(step, before), strict=True):
            weight.value = value
        guess = self._predict(step / place.last if place.last else 0.0)
        if self.coupler:
            self.coupler.begin(place.z, z)
        most = control.first_iterations if place.last is None else control.max_iterations
        stop = self._station(place, most)
        if reason := self.check():
            raise _Refused(reason)
        return replace(stop, bend=self._bend(guess))

    def _station(self, place: Place, limit: int) -> Stop:
        """Newton, and with a coupler passes over the slab until what is exchanged hardly changes.

        The system has the last word, so that it fulfils its balances with what it was told last.
        """
        control, coupler = self.control, self.coupler
        if coupler is None:
            return Stop(place, *self._newton(limit, control.tolerance), bend=math.nan)
        most, passes, change = 0, 0, math.inf
        tolerance = max(control.tolerance, BEFORE * control.exchange)
        iterations, update = self._newton(limit, tolerance)
        while change > control.exchange and passes < control.passes:
            change, passes, most = coupler.trace(), passes + 1, max(most, iterations)
            if change <= control.exchange or passes == control.passes:
                tolerance = control.tolerance
            iterations, update = self._newton(limit, tolerance, polish=True)
        return Stop(place, max(most, iterations), update, math.nan, passes, change)

    def _newton(self, most: int, tolerance: float, polish: bool = False) -> tuple[int, float]:
        """Iterations, and the last update.

        most : iterations before it fails
        polish : try the last factorisation first, for little has changed since
        """
        rest = math.inf
        if polish and (rest := self.newton.polish(tolerance)[1]) <= tolerance:
            return 0, rest
        for iteration in range(1, most + 1):
            update = self.newton.step()
            rest = update.rest
            if update.length == 1.0 and rest > tolerance and rest < 1:
                rest = self.newton.polish(tolerance, rest)[1]
            if update.length == 1.0 and rest <= tolerance:
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
        if self.coupler:
            self.coupler.reject()
        self.newton.unknowns.x.array[:] = self.old.x.array
        for border, value in zip(self.newton.borders, self._multipliers, strict=True):
            border.multiplier.value = value


def _reached(z: float, step: float, end: float) -> float:
    """Where a step leads, the end itself where only round-off is left [m]."""
    return end if end - z - step <= 1e-12 * end else z + step

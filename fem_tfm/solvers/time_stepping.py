# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steps in time: how large the next one is, and what happens when one fails.

A step follows a Courant number and the effort of the solver, lands on milestones exactly, and is
taken back and repeated smaller where it fails. The object decides on steps alone: it knows no
equation. Every change is told with its reason.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from fem_tfm.errors import SolverError
from fem_tfm.solvers.step import StepControl, attempt

# a step within this factor of the way to a milestone takes all of it
LAST = 1.001
# a step is told where it differs by this factor from the last one told
TOLD = 1.25


class _Refused(Exception):
    """The system has refused a step."""


class System(Protocol):
    """What is stepped in time."""

    def advance(self, dt: float, time: float) -> float:
        """Go a step of `dt` [s] to `time` [s] and return its effort, 1 being all that is allowed.

        Raises SolverError where it fails, with the state before the step.
        """
        ...

    def rate(self) -> float:
        """Courant number over the step that gives it [1/s], of the present state."""
        ...


@dataclass(frozen=True, kw_only=True)
class TimeControl(StepControl):
    """How the step [s] moves.

    courant : largest Courant number
    easy, hard : effort up to which the step may grow, and above which it shrinks by `ease`
    share : least share of what the Courant number and `largest` allow to which effort shrinks the
        step, for an effort that does not depend on the step is not worth more steps
    patience : steps after a failure before it grows again
    """

    courant: float
    growth: float = 1.2
    easy: float = 0.4
    hard: float = 0.7
    ease: float = 0.8
    share: float = 0.25
    patience: int = 5


class TimeStepping:
    """Steps a system from one milestone to the next.

    Parameters
    ----------
    control : step control
    milestones : times that steps end at exactly, rising [s]; the last is the end
    tell : called with a sentence for each change of the step and its reason

    Attributes
    ----------
    time : of the system [s]; a milestone's own number after the step that ends there
    step : last step [s], 0 before the first
    count : steps taken
    """

    def __init__(
        self,
        control: TimeControl,
        milestones: Sequence[float],
        tell: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.control = control
        self.milestones = sorted(set(milestones))
        self.tell = tell
        self.time, self.step, self.count = 0.0, 0.0, 0
        self._wanted = control.first
        self._wait = 0
        self._told = (0.0, "")
        self._allowed = control.largest

    @property
    def done(self) -> bool:
        """Whether the end is reached."""
        return self.time >= self.milestones[-1]

    def advance(self, system: System) -> float:
        """Take one step, with as many trials as it needs, and return its size [s].

        Raises
        ------
        SolverError
            no step above the smallest one succeeds; the system has the state before it.
        """
        control = self.control

        def trial(wanted: float) -> float:
            self._wanted = wanted
            bound, reason = self._choose(system.rate())
            dt, to = self._land(bound)
            self._tried = dt
            try:
                effort = system.advance(dt, to)
            except SolverError as failure:
                raise _Refused(str(failure)) from failure
            self._accept(dt, to, bound, reason, effort)
            return dt

        def shrink(_: float, failure: Exception) -> float:
            self._wait = control.patience
            return control.cut * self._tried

        self._tried = 0.0
        return attempt(
            self._wanted,
            control.smallest,
            trial,
            shrink,
            failures=_Refused,
            retry=lambda size, reason: self._tell(size, f"taken back: {reason}"),
            refuse=lambda failure: (
                f"no step above {control.smallest:.3g} s succeeds at {self.time:.6g} s: {failure}"
            ),
        )

    def state(self) -> dict[str, float]:
        """Numbers from which `restore` goes on as if nothing had happened."""
        return {
            "time": self.time,
            "step": self.step,
            "count": self.count,
            "wanted": self._wanted,
            "wait": self._wait,
        }

    def restore(self, state: Mapping[str, float]) -> None:
        """Go on from the numbers of `state`."""
        self.time, self.step, self._wanted = (state[key] for key in ("time", "step", "wanted"))
        self.count, self._wait = int(state["count"]), int(state["wait"])

    def _choose(self, rate: float) -> tuple[float, str]:
        """The step that time, rate and effort allow [s], and what bounds it."""
        control = self.control
        bounds = {
            "growth": self._wanted,
            "the largest step": control.largest,
            "the Courant number": control.courant / rate if rate > 0 else math.inf,
        }
        self._allowed = min(bound for name, bound in bounds.items() if name != "growth")
        reason = min(bounds, key=lambda name: bounds[name])
        bound = bounds[reason]
        if not bound >= control.smallest:
            raise SolverError(
                f"{reason} asks for a step of {bound:.3g} s at {self.time:.6g} s, below the"
                f" smallest of {control.smallest:.3g} s"
            )
        return bound, reason

    def _land(self, bound: float) -> tuple[float, float]:
        """The step of at most `bound` that suits the next milestone, and the time it ends at."""
        milestone = next(time for time in self.milestones if time > self.time)
        way = milestone - self.time
        if way <= LAST * bound:
            return way, milestone
        # two even steps in place of a large and a tiny one
        dt = min(bound, way / 2)
        return dt, self.time + dt

    def _accept(self, dt: float, to: float, bound: float, reason: str, effort: float) -> None:
        """Book a step; `bound` is what it could have been without a milestone."""
        control = self.control
        size, told = self._told
        # where growth and the Courant number take turns, one of them is told
        another = reason not in (told, "growth")
        if another or not size / TOLD <= bound <= size * TOLD:
            self._tell(bound, reason)
        self.time, self.step, self.count = to, dt, self.count + 1
        least = control.share * self._allowed
        if effort > control.hard and bound > least:
            self._wanted = max(control.ease * bound, least)
            self._tell(self._wanted, f"effort {effort:.2f} of what the solver may take")
            return
        held = self._wait > 0 or (effort > control.easy and bound >= least)
        self._wait = max(self._wait - 1, 0)
        self._wanted = bound if held else control.growth * bound

    def _tell(self, dt: float, reason: str) -> None:
        self._told = dt, reason
        self.tell(f"step {dt:.3g} s at {self.time:.6g} s: {reason}")

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pseudo-time continuation of a nonlinear system to its steady state.

Implicit Euler steps with a growing dt carry any start to the neighbourhood of the steady state;
there dt is so large that the steps are Newton's on the steady equations. A step that fails is taken
back and repeated with a smaller dt. The object decides on steps alone: it knows no equation.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from dolfinx import fem

from fem_tfm.errors import SolverError
from fem_tfm.solvers.newton import DECREASE, BorderedNewton, LinearSolveError
from fem_tfm.solvers.step import StepControl, attempt

# a steady state may still move by this many tolerances in a step of the largest dt
STEP_ALLOWANCE = 1e4
# largest growth of dt after a step that was taken back
CAUTIOUS = 10.0


@dataclass(frozen=True, kw_only=True)
class PseudoTimeControl(StepControl):
    """How dt [s] moves.

    easy, hard : Newton iterations at or below which dt grows, above which it shrinks
    loose : relative update at which a transient step counts as solved
    tolerance : relative update at which the steady state counts as reached
    max_steps : steps before giving up
    saturate : Newton limits each block by itself; False shortens its steps as a whole
    decrease : share of a correction that a full Newton step has to remove
    """

    growth: float = 1.8
    cut: float = 0.3
    easy: int = 4
    hard: int = 5
    loose: float = 0.6
    tolerance: float = 1e-9
    max_steps: int = 200
    max_iterations: int = 9
    saturate: bool = True
    decrease: float = DECREASE


@dataclass
class History:
    """What a continuation did: one row a step (dt, iterations, update, residual)."""

    rows: list[dict[str, float]] = field(default_factory=list)
    update: float = math.inf


class PseudoTime:
    """Drives a BorderedNewton to steady state.

    Parameters
    ----------
    newton : the system, whose residual contains `idt` times the change since `old`
    old : Function that holds the unknowns of the last accepted step
    idt : Constant 1/dt [1/s]
    control : step control
    observe : called after each accepted step with the newest row; may raise to stop
    retry : called with the new dt [s] and the reason when a step is taken back
    lag : Constant, 1 where the residual shall take what stops Newton from `old`; it is so while a
        step that was taken back is tried again
    """

    def __init__(
        self,
        newton: BorderedNewton,
        old: fem.Function,
        idt: fem.Constant,
        control: PseudoTimeControl,
        observe: Callable[[dict[str, float]], None] = lambda row: None,
        retry: Callable[[float, str], None] = lambda dt, reason: None,
        lag: fem.Constant | None = None,
    ) -> None:
        self.newton = newton
        self.old = old
        self.idt = idt
        self.control = control
        self.observe = observe
        self.retry = retry
        self.lag = lag

    def run(self, first: float | None = None) -> History:
        """March to the steady state.

        Raises
        ------
        SolverError
            when dt falls below its minimum or the steps are used up; the last accepted state is
            kept.
        """
        try:
            return self._marched(min(first or self.control.first, self.control.largest))
        finally:
            self._hold(False)

    def _marched(self, dt: float) -> History:
        """Steps from a first dt to the steady state."""
        control, history = self.control, History()
        for _ in range(control.max_steps):
            wanted = dt
            dt = self._accepted_step(wanted, history)
            row = history.rows[-1]
            self.observe(row)
            if self._settled(row) or self._confirmed(row, history):
                return history
            growth = self._growth(row)
            if dt < wanted:
                growth = min(growth, CAUTIOUS)
            dt = min(dt * growth, control.largest)
        raise SolverError(
            f"not steady after {control.max_steps} pseudo-time steps "
            f"(relative update {history.update:.1e}, wanted {control.tolerance:.0e})"
        )

    def _hold(self, held: bool) -> None:
        """Take what stops Newton from `old`, or not."""
        if self.lag is not None:
            self.lag.value = float(held)

    def approach(self) -> None:
        """Go towards the steady state with the factors of a neighbouring problem, while they lead.

        A correction costs an eighth of a factorisation; a state that is not finite is taken back.
        """
        self._keep()
        self.idt.value = 1.0 / self.control.largest
        try:
            self.newton.polish(self.control.tolerance, saturate=self.control.saturate)
        except LinearSolveError:
            self._restore()

    def _settled(self, row: dict[str, float]) -> bool:
        """Whether nothing moves: what remains is below tolerance, and the step was small too.

        The step counts because dt is finite: it leaves an error of its size over dt.
        """
        tolerance, quick = self.control.tolerance, row["iterations"] == 1
        steady = row["dt"] >= self.control.largest and row["change"] <= STEP_ALLOWANCE * tolerance
        return quick and steady and row["update"] <= tolerance

    def _confirmed(self, row: dict[str, float], history: History) -> bool:
        """Whether a step of the largest dt with the factors at hand moves nothing any more."""
        tolerance, dt = self.control.tolerance, row["dt"]
        if dt < self.control.largest or row["update"] > tolerance:
            return False
        self._keep()
        try:
            change, update = self.newton.polish(tolerance, saturate=self.control.saturate)
        except LinearSolveError:
            change = update = math.inf
        row = {"dt": dt, "iterations": 1, "update": update, "change": change}
        if not self._settled(row):
            self._restore()
            return False
        history.update = update
        history.rows.append(row)
        return True

    def _growth(self, row: dict[str, float]) -> float:
        """Factor on dt: by effort far from the steady state, by the update close to it."""
        control = self.control
        if row["iterations"] == 1:
            return min(max(control.growth, control.loose / max(row["update"], 1e-12)), 1e3)
        if row["iterations"] <= control.easy:
            return control.growth
        return 1.0 if row["iterations"] <= control.hard else 0.7

    def _accepted_step(self, dt: float, history: History) -> float:
        """Repeat a step with smaller dt until it succeeds; returns the dt that worked."""
        control = self.control

        def shrink(dt: float, error: Exception) -> float:
            # far above the first step the failure says little: go half-way back (in decades)
            return min(dt * control.cut, math.sqrt(dt * control.first))

        def step(tried: float) -> dict[str, float]:
            self._hold(tried < dt)
            return self._step(tried)

        row = attempt(
            dt,
            control.smallest,
            step,
            shrink,
            failures=LinearSolveError,
            restore=self._restore,
            retry=self.retry,
            refuse=lambda error: f"pseudo-time step fell below {control.smallest:.1e} s ({error})",
        )
        history.update = row["update"]
        history.rows.append(row)
        return row["dt"]

    def _step(self, dt: float) -> dict[str, float]:
        control = self.control
        self._keep()
        self.idt.value = 1.0 / dt
        for iteration in range(1, control.max_iterations + 1):
            update = self.newton.step(control.saturate, control.decrease)
            if update.length == 1.0 and update.rest <= control.loose:
                rest = update.rest
                if dt >= control.largest and rest > control.tolerance:
                    rest = self.newton.polish(control.tolerance, rest, control.saturate)[1]
                row = {"iterations": iteration, "update": rest, "change": update.size}
                return {"dt": dt, **row}
        raise LinearSolveError(f"no convergence in {control.max_iterations} Newton iterations")

    def _keep(self) -> None:
        """Remember the present state as the last accepted one."""
        self.old.x.array[:] = self.newton.unknowns.x.array
        self._multipliers = [float(b.multiplier.value) for b in self.newton.borders]

    def _restore(self) -> None:
        self.newton.unknowns.x.array[:] = self.old.x.array
        for border, value in zip(self.newton.borders, self._multipliers, strict=True):
            border.multiplier.value = value

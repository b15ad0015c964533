# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steady states with raised terms of the mesh, which are lowered to the standard ones.

Two ways lead from a flow that the mesh holds up to the stated one. `lowered` starts with a stronger
capture and damping in a cold march. `Calming` starts with a large least rate of both, where the
solids are mixed over the section and hardly anything flows across it: an easy problem, whose
solution is then followed by Newton alone. Where the standard terms are not reached, the answer
keeps the raised ones, and the section holds the state with twice as much of them for the error.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from fem_tfm.errors import SolverError
from fem_tfm.flows.section import MeshTerms
from fem_tfm.solvers.pseudo_time import History, PseudoTime, StepControl

# decimal exponents of the factor on the least rate: at the start, and the largest of an answer
CALMEST, LARGEST_OF_ANSWER = 7.0, 3.0
# the first step in the exponent, the largest, and the one below which a branch has ended
FIRST, LONGEST, SHORTEST = 1.0, 2.0, 0.05
# factors on the step after an easy, a hard and a failed solution; factorisations of the first two
LONGER, SHORTER, HALVED, EASY, HARD = 1.7, 0.7, 0.5, 6, 10
# steps across the end of a branch, tried in this order, the step after one, and how many of them
LEAPS, AFTER_A_LEAP, MOST_LEAPS = (0.3, 1.0), 0.5, 5
# updates at which a state on the way is good enough, by Newton and by a march in time
ON_THE_WAY, AFTER_A_MARCH = 1e-4, 1e-3
# a solution that is followed takes few Newton iterations or none at all
FOLLOWED = {"max_steps": 3, "max_iterations": 15}


def lowered(
    section: Any,
    march: PseudoTime,
    follower: PseudoTime,
    ease: Callable[[Any, MeshTerms], None],
    factor: float,
) -> History:
    """Steady state at raised terms of the mesh, then at half of them, down to the standard.

    Where the standard is not reached, the difference to the state before is part of the error: what
    the last halving of the terms changed, the rest of them changes as much again.

    Raises
    ------
    SolverError
        there is no steady state at the raised terms.
    """
    history = march.run()
    section.rougher = None
    while factor > 1:
        kept = section.stored()
        ease(section, MeshTerms(factor / 2))
        try:
            history = follower.run(march.control.largest)
        except SolverError:
            ease(section, MeshTerms(factor))
            section.restore(kept)
            break
        factor, section.rougher = factor / 2, kept if factor > 2 else None
    if factor > 1 and section.rougher is None:
        _double(section, follower, ease, MeshTerms(2 * factor))
    return history


def _double(
    section: Any,
    follower: PseudoTime,
    ease: Callable[[Any, MeshTerms], None],
    terms: MeshTerms,
) -> None:
    """Solve with other terms of the mesh for the error, and go back."""
    kept, found = section.stored(), section.mesh_terms
    ease(section, terms)
    follower.run(follower.control.largest)
    section.rougher = section.stored()
    ease(section, found)
    section.restore(kept)


@dataclass
class Calming:
    """Follows the steady state of a calm section to that of the stated one.

    section : with its cold start
    march : makes the driver of the section for a step control
    control : of an answer
    ease : sets the terms of the mesh
    """

    section: Any
    march: Callable[[StepControl], PseudoTime]
    control: StepControl
    ease: Callable[[Any, MeshTerms], None]

    def run(self) -> History:
        """Steady state with the least rate at its standard or as near to it as can be.

        Raises
        ------
        SolverError
            the last state still needs a rate that no answer may have.
        """
        self.section.rougher = None
        self._exponent, self._step = CALMEST, FIRST
        self._solve(CALMEST, replace(self.control, tolerance=ON_THE_WAY))
        leaps, history = 0, None
        while self._exponent > 0:
            history = self._follow() or history
            if self._step >= SHORTEST:
                continue
            found = self._leap() if leaps < MOST_LEAPS else None
            if found is None:
                return self._raised()
            leaps, history = leaps + 1, found
        return history

    def _solve(self, exponent: float, control: StepControl, first: float | None = None) -> History:
        """Steady state at a rate, from the state at hand, which a failure leaves as it was."""
        kept, terms = self.section.stored(), self.section.mesh_terms
        self.ease(self.section, MeshTerms(rate=10**exponent))
        if exponent == 0:
            control = replace(control, tolerance=self.control.tolerance)
        try:
            history = self.march(control).run(first)
        except SolverError:
            self.ease(self.section, terms)
            self.section.restore(kept)
            raise
        self._exponent = exponent
        return history

    def _follow(self) -> History | None:
        """Newton's solution one step further, or None; the step adapts."""
        newton, largest = self.section.newton, self.control.largest
        control = replace(self.control, tolerance=ON_THE_WAY, smallest=largest, **FOLLOWED)
        before = newton.factorisations
        try:
            history = self._solve(max(self._exponent - self._step, 0.0), control, largest)
        except SolverError:
            self._step *= HALVED
            return None
        taken = newton.factorisations - before
        if taken < EASY:
            self._step = min(LONGER * self._step, LONGEST)
        elif taken > HARD:
            self._step *= SHORTER
        return history

    def _leap(self) -> History | None:
        """A steady state beyond the end of a branch by a march in time, or None."""
        control = replace(self.control, tolerance=AFTER_A_MARCH)
        for leap in LEAPS:
            try:
                history = self._solve(max(self._exponent - leap, 0.0), control)
            except SolverError:
                continue
            self._step = AFTER_A_LEAP
            return history
        return None

    def _raised(self) -> History:
        """The answer where the branch has ended, and a state with twice its rate for the error."""
        rate = 10**self._exponent
        if self._exponent > LARGEST_OF_ANSWER:
            raise SolverError(
                f"no steady state was found below {rate:.0f} times the least rate of the terms of"
                f" the mesh, and an answer may have {10**LARGEST_OF_ANSWER:.0f}"
            )
        history = self._solve(self._exponent, self.control, self.control.largest)
        follower = self.march(replace(self.control, tolerance=ON_THE_WAY))
        _double(self.section, follower, self.ease, MeshTerms(rate=2 * rate))
        return history

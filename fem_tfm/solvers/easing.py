# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steady states with raised terms of the mesh, which are lowered to the standard ones.

A flow that the mesh holds up is easier to find. `lowered` takes its capture and damping back from
any start with a higher strength of them. `Calming` is such a start and one for the standard
strength: at a large least rate of both the solids are mixed over the section and hardly anything
flows across it, and that solution is followed along its branch to the standard rate. Where the
standard terms are not reached, the answer keeps the raised ones, and the section holds a state
with more of them for the error.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from fem_tfm.errors import SolverError
from fem_tfm.solvers.branch import Branch
from fem_tfm.solvers.newton import LinearSolveError
from fem_tfm.solvers.pseudo_time import History, PseudoTime, PseudoTimeControl

# decimal exponents of the factor on the least rate: at the start, and the largest of an answer
CALMEST, LARGEST_OF_ANSWER = 7.0, 3.0
# points of all branches and of a direct one, and how far in the exponent one is followed back
MOST_POINTS, DIRECT_POINTS, BACK = 120, 60, 0.5
# steps across the end of a branch, tried in this order, and how often
LEAPS, MOST_LEAPS = (0.3, 1.0), 4
# updates at which a state on the way is good enough, from the start and beyond a leap
ON_THE_WAY, AFTER_A_LEAP = 1e-4, 1e-3
# ratios of the terms of the mesh that tell the error of an answer with raised ones
COMPARED = (2.0, 1.25)


@dataclass(frozen=True)
class MeshTerms:
    """Factors on the terms that stand in for what the mesh cannot carry, 1 for the standard.

    strength : on capture and damping
    rate : on the smallest rate of both
    """

    strength: float = 1.0
    rate: float = 1.0

    @property
    def raised(self) -> bool:
        """Whether one is not the standard."""
        return self != MeshTerms()


@dataclass(frozen=True)
class Rougher:
    """A state with more of the raised terms of the mesh.

    state : as the section's `stored` gives it
    ratio : of its terms to those of the answer
    """

    state: Any
    ratio: float


def lowered(
    section: Any,
    begin: Callable[[], History],
    follower: PseudoTime,
    ease: Callable[[Any, MeshTerms], None],
) -> History:
    """Steady state at raised terms of the mesh, then at half their strength, down to the standard.

    Where the standard is not reached, the difference to a state with more of the terms tells the
    error: what the last halving changed, the rest of them changes as much again.

    begin : finds the first state

    Raises
    ------
    SolverError
        there is no steady state at the raised terms.
    """
    history, section.rougher = begin(), None
    while (terms := section.mesh_terms).strength > 1:
        kept, half = section.stored(), replace(terms, strength=terms.strength / 2)
        ease(section, half)
        try:
            history = follower.run(follower.control.largest)
        except SolverError:
            ease(section, terms)
            section.restore(kept)
            break
        section.rougher = Rougher(kept, 2.0) if half.strength > 1 else None
    if terms.rate > 1 or (terms.strength > 1 and section.rougher is None):
        _compare(section, follower, ease)
    return history


def _compare(section: Any, follower: PseudoTime, ease: Callable[[Any, MeshTerms], None]) -> None:
    """Solve with more of the raised terms of the mesh for the error, and go back.

    Raises
    ------
    SolverError
        there is no steady state with a little more of them either.
    """
    kept, terms = section.stored(), section.mesh_terms
    for ratio in COMPARED:
        strength, rate = (ratio * f if f > 1 else f for f in (terms.strength, terms.rate))
        ease(section, MeshTerms(strength, rate))
        try:
            follower.run(follower.control.largest)
            section.rougher = Rougher(section.stored(), ratio)
        except SolverError:
            continue
        finally:
            ease(section, terms)
            section.restore(kept)
        return
    raise SolverError("no steady state with more of the mesh's terms tells the error of the answer")


@dataclass
class Calming:
    """Follows the steady state of a calm section to that of the stated one.

    section : with its cold start
    march : makes the driver of the section for a step control
    control : of an answer
    ease : sets the terms of the mesh
    strength : of these terms
    direct : gives up where the first branch does not lead to the standard rate
    """

    section: Any
    march: Callable[[PseudoTimeControl], PseudoTime]
    control: PseudoTimeControl
    ease: Callable[[Any, MeshTerms], None]
    strength: float = 1.0
    direct: bool = False

    def run(self) -> History:
        """Steady state with the least rate at its standard or as near to it as can be.

        Raises
        ------
        SolverError
            the last state still needs a rate that no answer may have, or any if `direct`.
        """
        self._points = DIRECT_POINTS if self.direct else MOST_POINTS
        self._solve(CALMEST, ON_THE_WAY)
        if self.direct:
            self._follow()
            if self._exponent > 0:
                raise SolverError("the branch of the calm state does not lead to the stated one")
            return self._answer()
        for _ in range(MOST_LEAPS + 1):
            self._follow()
            if self._exponent == 0 or not self._leapt():
                break
        return self._answer()

    def _solve(self, exponent: float, tolerance: float, first: float | None = None) -> History:
        """Steady state at a rate, from the state at hand, which a failure leaves as it was."""
        kept, terms = self.section.stored(), self.section.mesh_terms
        self._alter(exponent)
        try:
            history = self.march(replace(self.control, tolerance=tolerance)).run(first)
        except SolverError:
            self.ease(self.section, terms)
            self.section.restore(kept)
            raise
        self._exponent = exponent
        return history

    def _alter(self, exponent: float) -> None:
        self.ease(self.section, MeshTerms(self.strength, 10**exponent))

    def _follow(self) -> None:
        """Go along the branch, and back to its point of the least rate."""
        kept = self.section.stored()
        self.section.idt.value = 1 / self.control.largest
        self.section.old.x.array[:] = self.section.now.x.array
        try:
            branch = Branch(self.section.newton, self._alter, self._exponent)
            while self._points > 0 and 0 < branch.parameter <= self._exponent + BACK:
                self._points -= 1
                if branch.advance(0.0) < self._exponent:
                    kept, self._exponent = self.section.stored(), max(branch.parameter, 0.0)
        except (LinearSolveError, SolverError):
            pass
        self._alter(self._exponent)
        self.section.restore(kept)

    def _leapt(self) -> bool:
        """Whether a march in time found a steady state beyond the end of a branch."""
        for leap in LEAPS:
            try:
                self._solve(max(self._exponent - leap, 0.0), AFTER_A_LEAP)
            except SolverError:
                continue
            return True
        return False

    def _answer(self) -> History:
        """The answer where the way ends."""
        if self._exponent > LARGEST_OF_ANSWER:
            raise SolverError(
                f"no steady state was found below {10**self._exponent:.0f} times the least rate of"
                f" the mesh's terms, and an answer may have {10**LARGEST_OF_ANSWER:.0f}"
            )
        return self._solve(self._exponent, self.control.tolerance, self.control.largest)

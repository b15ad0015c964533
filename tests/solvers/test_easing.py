# SPDX-License-Identifier: LGPL-3.0-or-later
"""A calm state followed to the stated one, where a branch leads there and where it does not.

Bratu's problem stands in for a section: its load grows from none at the calmest rate of the terms
of the mesh to a stated one at their standard rate. There is no solution above the load of the fold.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import pytest
from dolfinx import fem
from solvers.test_branch import LARGEST, Bratu, heat

from fem_tfm.errors import SolverError
from fem_tfm.solvers import easing, nested
from fem_tfm.solvers.easing import Calming, MeshTerms
from fem_tfm.solvers.pseudo_time import PseudoTimeControl


class Section:
    """Bratu's problem with the interface of a section."""

    def __init__(self, load: float) -> None:
        self.problem, self.load = Bratu(), load
        self.newton, self.now = self.problem.newton, self.problem.u
        self.old = self.now.copy()
        self.idt = fem.Constant(self.now.function_space.mesh, 0.0)
        self.ease(MeshTerms(rate=10**easing.CALMEST))

    def ease(self, terms: MeshTerms) -> None:
        exponent = math.log10(terms.rate)
        self.problem.alter(-self.load * (1 - exponent / easing.CALMEST))
        self.mesh_terms = terms

    def stored(self) -> Any:
        return self.now.x.array.copy()

    def restore(self, state: Any) -> None:
        self.now.x.array[:] = state


def calming(section: Section, direct: bool) -> Calming:
    control = PseudoTimeControl(first=1e-3, largest=1e3, smallest=1e-9, max_steps=50)
    march = partial(nested._march, section, observer=nested.QUIET)
    return Calming(section, march, control, Section.ease, direct=direct)


@pytest.mark.parametrize("direct", [True, False])
def test_a_branch_leads_to_the_standard_rate(direct: bool) -> None:
    section = Section(0.9 * LARGEST)
    calming(section, direct).run()
    assert section.mesh_terms == MeshTerms()
    assert heat(section.problem.middle) == pytest.approx(section.load, rel=1e-4)


def test_a_direct_way_ends_at_a_fold() -> None:
    section = Section(1.1 * LARGEST)
    with pytest.raises(SolverError, match="does not lead to the stated one"):
        calming(section, direct=True).run()


def test_another_way_keeps_the_least_rate_that_has_a_solution() -> None:
    section = Section(1.1 * LARGEST)
    calming(section, direct=False).run()
    found = heat(section.problem.middle)
    assert 0.97 * LARGEST < found <= 1.001 * LARGEST and section.mesh_terms.rate > 1

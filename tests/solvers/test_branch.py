# SPDX-License-Identifier: LGPL-3.0-or-later
"""Continuation by arclength around a fold that is known in closed form, and a calm start by it.

Bratu's problem -u'' = l exp(u) on the unit interval, u = 0 at its ends, has two solutions for
l = 8 a^2/cosh(a)^2 below the largest, where a tanh(a) = 1, and none above it. The middle of a
solution is u(1/2) = 2 ln cosh(a).

The problem also stands in for a section whose load grows from none at the calmest rate of the terms
of the mesh to a stated one at their standard rate.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI

from fem_tfm.errors import SolverError
from fem_tfm.fenics import compile_form
from fem_tfm.solvers import easing, nested
from fem_tfm.solvers.branch import Branch
from fem_tfm.solvers.easing import Calming, MeshTerms
from fem_tfm.solvers.newton import Block, BorderedNewton, LinearSolveError
from fem_tfm.solvers.pseudo_time import PseudoTimeControl

# the root of a tanh(a) = 1
FOLD = 1.1996786402577339
LARGEST = 8 * FOLD**2 / math.cosh(FOLD) ** 2


class Bratu:
    """The problem; its parameter is -l, which falls along the first part of the branch."""

    def __init__(self, cells: int = 32) -> None:
        domain = mesh.create_unit_interval(MPI.COMM_WORLD, cells)
        space = fem.functionspace(domain, ("Lagrange", 2))
        self.u, self.heat = fem.Function(space), fem.Constant(domain, 0.0)
        u, w = self.u, ufl.TestFunction(space)
        residual = (ufl.inner(ufl.grad(u), ufl.grad(w)) - self.heat * ufl.exp(u) * w) * ufl.dx
        domain.topology.create_connectivity(0, 1)
        ends = mesh.exterior_facet_indices(domain.topology)
        dofs = fem.locate_dofs_topological(space, 0, ends)
        self.newton = BorderedNewton(
            compile_form(residual),
            compile_form(ufl.derivative(residual, u)),
            u,
            [fem.dirichletbc(fem.Constant(domain, 0.0), dofs, space)],
            [],
            [Block("u", np.arange(space.dofmap.index_map.size_local), scale=1.0)],
        )
        self.branch = Branch(self.newton, self.alter, 0.0)

    def alter(self, parameter: float) -> None:
        self.heat.value = -parameter

    @property
    def middle(self) -> float:
        return float(self.u.x.array.max())


def heat(middle: float) -> float:
    """l of the solution with u(1/2) = middle, on either side of the fold."""
    a = math.acosh(math.exp(middle / 2))
    return 8 * a**2 / math.cosh(a) ** 2


def test_a_branch_is_followed_around_its_fold() -> None:
    problem = Bratu()
    points = []
    while problem.middle < 3:
        parameter = problem.branch.advance(-10.0)
        points.append((-parameter, problem.middle))
    assert len(points) < 60
    for load, middle in points:
        assert load == pytest.approx(heat(middle), rel=1e-4)
    top = max(load for load, _ in points)
    assert 0.98 * LARGEST < top < 1.0001 * LARGEST
    # the upper solutions lie beyond the fold
    assert points[-1][0] < 0.9 * LARGEST


def test_the_last_point_lies_at_the_bound() -> None:
    problem = Bratu()
    while problem.branch.parameter > -2.0:
        problem.branch.advance(-2.0)
    assert problem.branch.parameter == -2.0
    assert float(problem.heat.value) == 2.0
    assert heat(problem.middle) == pytest.approx(2.0, rel=1e-4)


def test_a_branch_that_cannot_be_followed_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = Bratu()
    problem.branch.advance(-1.0)

    def broken(factor: bool = True) -> None:
        raise LinearSolveError("not finite")

    monkeypatch.setattr(problem.newton, "full_correction", broken)
    with pytest.raises(SolverError, match="no step along the branch"):
        problem.branch.advance(-1.0)


class Section:
    """Bratu's problem with the interface of a section."""

    def __init__(self, load: float) -> None:
        self.problem, self.load = Bratu(), load
        self.newton, self.now = self.problem.newton, self.problem.u
        self.old = self.now.copy()
        self.idt = fem.Constant(self.now.function_space.mesh, 0.0)
        self.lag = None
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

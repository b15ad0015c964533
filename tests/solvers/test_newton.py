# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bordered Newton and its pseudo-time on a small problem with a known answer.

-div((1 + u^2) grad u) = m on the unit interval, u = 0 at its ends, with m such that the mean of u
is given. With v = u + u^3/3 this is -v'' = m, so that v = m x (1 - x)/2.
"""

from __future__ import annotations

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI

from fem_tfm.errors import SolverError
from fem_tfm.fenics import compile_form
from fem_tfm.solvers.newton import Block, Border, BorderedNewton, LinearSolveError
from fem_tfm.solvers.pseudo_time import CAUTIOUS, PseudoTime, PseudoTimeControl

CONTROL = PseudoTimeControl(first=1e-2, largest=1e8, smallest=1e-6)


class Membrane:
    """The problem with its forms and its solver."""

    def __init__(self, cells: int = 16, mean: float = 1.0) -> None:
        domain = mesh.create_unit_interval(MPI.COMM_WORLD, cells)
        space = fem.functionspace(domain, ("Lagrange", 2))
        self.u, self.old = fem.Function(space), fem.Function(space)
        self.load, self.idt = fem.Constant(domain, 0.0), fem.Constant(domain, 0.0)
        self.target = fem.Constant(domain, mean)
        u, w, dx = self.u, ufl.TestFunction(space), ufl.dx(metadata={"quadrature_degree": 6})
        self.lag = fem.Constant(domain, 0.0)
        square = (1 - self.lag) * u * u + self.lag * self.old * self.old
        flux = (1 + square) * ufl.grad(u)
        residual = (self.idt * (u - self.old) * w + ufl.inner(flux, ufl.grad(w))) * dx
        residual -= self.load * w * dx
        domain.topology.create_connectivity(0, 1)
        ends = mesh.exterior_facet_indices(domain.topology)
        dofs = fem.locate_dofs_topological(space, 0, ends)
        border = Border(
            self.load,
            compile_form(-w * dx),
            compile_form(u * dx),
            compile_form(w * dx),
            self.target,
        )
        owned = np.arange(space.dofmap.index_map.size_local)
        self.newton = BorderedNewton(
            compile_form(residual),
            compile_form(ufl.derivative(residual, u)),
            u,
            [fem.dirichletbc(fem.Constant(domain, 0.0), dofs, space)],
            [border],
            [Block("u", owned, scale=1.0)],
        )
        self.march = PseudoTime(self.newton, self.old, self.idt, CONTROL)


def exact_load(mean: float) -> float:
    """m by quadrature and bisection of the closed form."""
    x, weights = np.polynomial.legendre.leggauss(40)
    x, weights = (x + 1) / 2, weights / 2

    def mean_of(load: float) -> float:
        v = load * x * (1 - x) / 2
        # the real root of u + u^3/3 = v
        half = 1.5 * v
        root = np.sqrt(half**2 + 1)
        return float(weights @ (np.cbrt(half + root) + np.cbrt(half - root)))

    low, high = 0.0, 1e4
    for _ in range(200):
        middle = (low + high) / 2
        low, high = (middle, high) if mean_of(middle) < mean else (low, middle)
    return low


@pytest.mark.parametrize("mean", [0.1, 0.5, 1.0])
def test_multiplier_against_the_closed_form(mean: float) -> None:
    problem = Membrane(mean=mean)
    history = problem.march.run()
    assert history.update <= CONTROL.tolerance
    assert float(problem.load.value) == pytest.approx(exact_load(mean), rel=2e-5)
    assert problem.newton.constraint_errors()[0] == pytest.approx(0.0, abs=1e-12)


def test_corrections_shrink_quadratically() -> None:
    problem = Membrane()
    problem.march.run()
    problem.u.x.array[:] *= 1.05
    for bc in problem.newton.bcs:
        bc.set(problem.u.x.array)
    sizes = [problem.newton.step().size for _ in range(3)]
    assert sizes[1] < 0.1 * sizes[0]
    assert sizes[2] < 1e-3 * sizes[1]


@pytest.mark.parametrize("decrease", [0.25, 0.6, 0.9])
def test_a_step_removes_the_share_that_is_asked_for(decrease: float) -> None:
    """Mean 3 from rest is far away: a full step removes little of its correction."""
    problem = Membrane(mean=3.0)
    problem.newton.step()
    update = problem.newton.step(decrease=decrease)
    assert update.rest <= (1 - update.length * decrease) * update.size * (1 + 1e-9)


def test_steps_that_have_to_remove_more_are_shorter() -> None:
    lengths = []
    for decrease in (0.25, 0.9):
        problem = Membrane(mean=3.0)
        problem.newton.step()
        lengths.append(problem.newton.step(decrease=decrease).length)
    assert lengths[1] < lengths[0]


def test_a_neighbouring_problem_is_approached_without_a_factorisation() -> None:
    problem = Membrane()
    problem.march.run()
    spent = problem.newton.factorisations
    problem.target.value = 1.1
    problem.march.approach()
    assert problem.newton.factorisations == spent
    assert float(problem.load.value) == pytest.approx(exact_load(1.1), rel=1e-3)
    problem.march.run(first=CONTROL.largest)
    warm = problem.newton.factorisations - spent
    cold = Membrane(mean=1.1)
    cold.march.run()
    assert warm < cold.newton.factorisations / 2
    assert float(problem.load.value) == pytest.approx(float(cold.load.value), rel=1e-9)


def test_an_approach_that_leads_nowhere_is_taken_back(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = Membrane()
    problem.march.run()
    kept, load = problem.u.x.array.copy(), float(problem.load.value)
    problem.target.value = 2.0

    def broken(*_: float, **__: bool) -> None:
        problem.u.x.array[:] = np.nan
        raise LinearSolveError("not finite")

    monkeypatch.setattr(problem.newton, "polish", broken)
    problem.march.approach()
    assert np.array_equal(problem.u.x.array, kept)
    assert float(problem.load.value) == load


def test_a_matrix_without_a_solution_is_refused() -> None:
    problem = Membrane()
    problem.idt.value = np.nan
    with pytest.raises(LinearSolveError):
        problem.newton.step()


def test_a_step_that_was_taken_back_holds_and_the_next_does_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The answer is that without holding."""
    problem, told = Membrane(), []
    problem.march.lag = lag = problem.lag
    step, failures = problem.newton.step, iter([True])

    def stubborn(*args: object) -> object:
        told.append((1 / float(problem.idt.value), float(lag.value)))
        if told[-1][0] > 1.0 and next(failures, False):
            raise LinearSolveError("no step length brings Newton closer to a solution")
        return step(*args)

    monkeypatch.setattr(problem.newton, "step", stubborn)
    problem.march.run()
    steps = list(dict.fromkeys(told))
    failed = next(n for n, (dt, held) in enumerate(steps) if dt > 1.0)
    assert [held for _, held in steps] == [float(n == failed + 1) for n in range(len(steps))]
    growth = steps[failed + 2][0] / steps[failed + 1][0]
    assert 1.0 < growth <= CAUTIOUS * (1 + 1e-12)
    free = Membrane()
    free.march.run()
    assert float(problem.load.value) == pytest.approx(float(free.load.value), rel=1e-9)


def test_a_march_that_fails_holds_nothing_afterwards(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = Membrane()
    problem.march.lag = problem.lag

    def stuck(*args: object) -> object:
        raise LinearSolveError("no step length brings Newton closer to a solution")

    monkeypatch.setattr(problem.newton, "step", stuck)
    with pytest.raises(SolverError, match="fell below"):
        problem.march.run()
    assert float(problem.lag.value) == 0.0


def test_no_steady_state_within_the_steps() -> None:
    problem = Membrane()
    problem.march.control = PseudoTimeControl(first=1e-6, largest=1e8, smallest=1e-9, max_steps=2)
    with pytest.raises(SolverError, match="not steady after 2 pseudo-time steps"):
        problem.march.run()

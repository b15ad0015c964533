# SPDX-License-Identifier: LGPL-3.0-or-later
"""Marching on an ordinary differential equation with a known answer: order, steps, retries."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import create_unit_interval
from mpi4py import MPI
from scipy.integrate import solve_ivp

from fem_tfm.errors import SolverError
from fem_tfm.fenics import compile_form
from fem_tfm.solvers.marching import Coupler, March, MarchControl, Stop, backward_weights
from fem_tfm.solvers.newton import Block, BorderedNewton


@pytest.mark.parametrize("before", [0.1, 0.25, 2.0])
def test_weights_differentiate_parabolas_exactly(before: float) -> None:
    """On uneven steps too; they add up to zero, which is what conserves a flux."""
    step, here = 0.3, 1.7
    places = (here, here - step, here - step - before)
    weights = backward_weights(step, before)
    for power in range(3):
        found = sum(w * z**power for w, z in zip(weights, places, strict=True))
        assert found == pytest.approx(power * here ** max(power - 1, 0), abs=1e-12)
    assert sum(weights) == pytest.approx(0, abs=1e-12)


def test_without_a_station_before_the_difference_is_eulers() -> None:
    assert backward_weights(0.5, None) == (2.0, -2.0, 0.0)


class Decay:
    """y' = -y^2 + s with y(0) = 1, on a mesh where y is one number; with s = 0 y = 1/(1 + z)."""

    def __init__(self) -> None:
        mesh = create_unit_interval(MPI.COMM_SELF, 1)
        space = fem.functionspace(mesh, ("Discontinuous Lagrange", 0))
        self.y, self.old, self.older, self.source = (fem.Function(space) for _ in range(4))
        self.weights = [fem.Constant(mesh, 0.0) for _ in range(3)]
        w, stations = ufl.TestFunction(space), (self.y, self.old, self.older)
        rate = sum(c * f for c, f in zip(self.weights, stations, strict=True))
        form = (rate + self.y**2 - self.source) * w * ufl.dx
        jacobian = ufl.derivative(form, self.y, ufl.TrialFunction(space))
        blocks = [Block("y", np.arange(1), 1.0)]
        parts = (compile_form(form), compile_form(jacobian), self.y, [], [], blocks)
        self.newton = BorderedNewton(*parts)
        self.y.x.array[:] = 1.0
        self.stops: list[Stop] = []
        self.retries: list[tuple[float, str]] = []

    @property
    def value(self) -> float:
        """y at the station at hand."""
        return float(self.y.x.array[0])

    def march(
        self,
        control: MarchControl,
        check: Callable[[], str] = lambda: "",
        coupler: Coupler | None = None,
    ) -> March:
        """A march of this equation that keeps what it tells."""
        stations = (self.old, self.older)
        tell: Any = lambda step, reason: self.retries.append((step, reason))  # noqa: E731
        parts = (control, check, self.stops.append, tell, coupler)
        return March(self.newton, stations, self.weights, *parts)


def fixed(step: float, order: int) -> MarchControl:
    """Equal steps."""
    return MarchControl(first=step, largest=step, smallest=step / 10, bend=1.0, order=order)


@pytest.mark.parametrize("order", [1, 2])
def test_order_along_the_axis(order: int) -> None:
    """Backward Euler is of order 1, BDF2 of order 2."""
    errors = []
    for step in (1 / 16, 1 / 32, 1 / 64):
        problem = Decay()
        problem.march(fixed(step, order)).run(1.0)
        errors.append(abs(problem.value - 0.5))
    assert min(math.log2(a / b) for a, b in itertools.pairwise(errors)) > order - 0.2


def test_steps_grow_to_the_largest_and_end_at_the_end() -> None:
    problem = Decay()
    control = MarchControl(first=1e-3, largest=0.5, smallest=1e-6, bend=0.01)
    place = problem.march(control).run(20.0)
    steps = [stop.place.last for stop in problem.stops]
    assert place.z == 20.0
    assert sum(steps) == pytest.approx(20.0, rel=1e-12)
    assert max(b / a for a, b in itertools.pairwise(steps)) < 1.51
    assert steps[0] == 1e-3
    assert max(steps) == 0.5
    assert problem.value == pytest.approx(1 / 21, rel=0.02)


def test_a_refused_station_is_tried_again_with_a_smaller_step() -> None:
    """Where y may not fall by more than 1 % in a step, and where it may not fall below 0.7."""
    problem = Decay()

    def check() -> str:
        fall = float(problem.old.x.array[0]) - problem.value
        return "too far" if fall > 0.01 else "too low" if problem.value < 0.7 else ""

    march = problem.march(MarchControl(first=0.02, largest=0.02, smallest=1e-7, bend=1.0), check)
    with pytest.raises(SolverError, match=r"marching ends at z = 0\.4\d+ m: too low"):
        march.run(1.0)
    assert "too far" in {reason for _, reason in problem.retries}
    # the last accepted station is put back
    assert problem.value == float(problem.old.x.array[0])
    assert 0.7 <= problem.value < 0.71


def test_too_many_stations() -> None:
    control = MarchControl(first=0.01, largest=0.01, smallest=1e-3, max_stations=5)
    with pytest.raises(SolverError, match=r"5 stations led to z = 0\.05 m only"):
        Decay().march(control).run(1.0)


def test_a_march_goes_on_where_another_stopped() -> None:
    """The same numbers, also for the second order, whose formula reaches two stations back."""
    whole, parts = Decay(), Decay()
    control = MarchControl(first=1e-3, largest=0.1, smallest=1e-6, bend=0.01)
    whole.march(control).run(1.0)
    march = parts.march(control)

    def stop_at_the_tenth(stop: Stop) -> None:
        parts.stops.append(stop)
        if len(parts.stops) == 10:
            raise KeyboardInterrupt

    march.observe = stop_at_the_tenth
    with pytest.raises(KeyboardInterrupt):
        march.run(1.0)
    assert len(whole.stops) > 11
    parts.march(control).run(1.0, parts.stops[-1].place)
    assert parts.value == whole.value


# -- a march with something beside it ----------------------------------------------------------


class Follower:
    """p' = (y - p)/L beside the decay, which gets s = -(y - p)/L, by backward Euler."""

    def __init__(self, problem: Decay, length: float) -> None:
        self.problem, self.length = problem, length
        self.begun = self.ended = 0.0
        self.calls: list[str] = []

    def begin(self, start: float, end: float) -> None:
        self.slab = start, end
        self.calls.append("begin")

    def trace(self) -> float:
        start, end = self.slab
        y, share = self.problem.value, (end - start) / self.length
        self.ended = (self.begun + share * y) / (1 + share)
        before = self.problem.source.x.array[0]
        self.problem.source.x.array[:] = -(y - self.ended) / self.length
        self.calls.append("trace")
        return abs(self.problem.source.x.array[0] - before) / abs(before or 1.0)

    def accept(self) -> None:
        self.begun = self.ended
        self.calls.append("accept")

    def reject(self) -> None:
        self.ended = self.begun
        self.calls.append("reject")


def test_what_goes_along_is_followed() -> None:
    """y and p against their equations, and the passes of each slab until the source stands."""
    problem = Decay()
    follower = Follower(problem, 0.5)
    control = replace(fixed(1 / 256, 1), exchange=1e-6, passes=20)
    problem.march(control, coupler=follower).run(1.0)
    exact = solve_ivp(
        lambda z, y: [-(y[0] ** 2) - (y[0] - y[1]) / 0.5, (y[0] - y[1]) / 0.5],
        (0, 1),
        [1.0, 0.0],
        rtol=1e-10,
    ).y[:, -1]
    assert problem.value == pytest.approx(exact[0], rel=5e-3)
    assert follower.begun == pytest.approx(exact[1], rel=5e-3)
    assert all(0 < stop.change <= 1e-6 for stop in problem.stops)
    assert sum(stop.passes for stop in problem.stops) == follower.calls.count("trace")
    assert follower.slab[1] == 1.0
    # the system has the last word, with the source at hand
    change = backward_weights(1 / 256, None)[0] * (problem.value - problem.old.x.array[0])
    source = problem.source.x.array[0]
    assert change == pytest.approx(-(problem.value**2) + source, rel=1e-9)


def test_passes_end_at_their_cap() -> None:
    problem = Decay()
    control = replace(fixed(1 / 4, 1), exchange=0.0, passes=3)
    problem.march(control, coupler=Follower(problem, 0.5)).run(1.0)
    assert [stop.passes for stop in problem.stops] == [3] * 4
    assert min(stop.change for stop in problem.stops) > 0


def test_a_slab_taken_back_is_rejected_first() -> None:
    problem = Decay()
    follower = Follower(problem, 0.5)

    def check() -> str:
        return "too far" if float(problem.old.x.array[0]) - problem.value > 0.03 else ""

    control = MarchControl(first=0.03, largest=0.03, smallest=1e-7, bend=1.0)
    problem.march(control, check, follower).run(0.05)
    assert problem.retries
    told = [call for call in follower.calls if call != "trace"]
    ends = told[1::2]
    assert told[::2] == ["begin"] * len(ends)
    assert ends.count("reject") == len(problem.retries)
    assert ends.count("accept") == len(problem.stops)

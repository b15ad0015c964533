# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steps in time: milestones, Courant number, retries, and going on from a state."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from fem_tfm.errors import SolverError
from fem_tfm.solvers.time_stepping import TimeControl, TimeStepping

CONTROL = TimeControl(first=1e-3, largest=0.1, smallest=1e-6, courant=1.0)


class Decay:
    """y' = -y by implicit Euler; steps above `largest` fail within `rough`."""

    def __init__(self, rough: tuple[float, float] = (9.0, 9.0), largest: float = 1.0) -> None:
        self.y, self.time, self.effort = 1.0, 0.0, 0.1
        self.rough, self.largest, self.speed = rough, largest, 0.0
        self.steps: list[float] = []

    def advance(self, dt: float, time: float) -> float:
        begin, end = self.rough
        if dt > self.largest and begin <= self.time < end:
            raise SolverError("too rough")
        self.y /= 1 + dt
        self.time = time
        self.steps.append(dt)
        return self.effort

    def rate(self) -> float:
        return self.speed


def run(system: Decay, stepping: TimeStepping) -> list[float]:
    """Times of all steps to the end."""
    times = []
    while not stepping.done:
        stepping.advance(system)
        times.append(stepping.time)
    return times


def test_milestones_are_hit_exactly_and_do_not_slow_the_run() -> None:
    milestones = [0.1 * k for k in range(1, 11)] + [1 / 3]
    system = Decay()
    times = run(system, TimeStepping(replace(CONTROL, largest=0.04), milestones))
    assert set(milestones) <= set(times)
    assert times[-1] == milestones[9]
    # a tiny step is never needed, nor is the step forgotten behind a milestone
    assert min(system.steps[20:]) > 0.01
    assert system.y == pytest.approx(math.exp(-1), rel=0.02)


def test_the_step_grows_from_the_first_to_the_largest() -> None:
    system = Decay()
    run(system, TimeStepping(CONTROL, [2.0]))
    assert system.steps[0] == CONTROL.first
    assert max(system.steps) == pytest.approx(CONTROL.largest)
    ratios = [b / a for a, b in zip(system.steps, system.steps[1:], strict=False)]
    assert max(ratios) <= CONTROL.growth * (1 + 1e-12)


def test_the_courant_number_bounds_the_step() -> None:
    system, said = Decay(), []
    system.speed = 50.0
    run(system, TimeStepping(CONTROL, [1.0], said.append))
    assert max(system.steps) <= 1 / 50 * (1 + 1e-12)
    assert any(text.endswith("the Courant number") for text in said)


def test_a_failed_step_is_taken_back_and_tried_smaller() -> None:
    system, said = Decay(rough=(0.3, 0.5), largest=0.004), []
    times = run(system, TimeStepping(CONTROL, [1.0], said.append))
    begins = [0.0, *times[:-1]]
    within = [dt for dt, time in zip(system.steps, begins, strict=True) if 0.3 <= time < 0.5]
    assert within and max(within) <= 0.004
    assert any("taken back: too rough" in text for text in said)
    assert max(system.steps[-10:]) > 0.01
    # each value is one of the accepted steps, so nothing of a failed one is left
    assert system.y == pytest.approx(math.prod(1 / (1 + dt) for dt in system.steps), rel=1e-12)


def test_no_step_below_the_smallest() -> None:
    system = Decay(rough=(0.2, 0.4), largest=1e-9)
    stepping = TimeStepping(CONTROL, [1.0])
    with pytest.raises(SolverError, match=r"no step above 1e-06 s succeeds at 0\.2.* too rough"):
        run(system, stepping)
    assert 0.2 <= stepping.time == system.time < 0.4
    system = Decay()
    system.speed = 1e7
    with pytest.raises(SolverError, match="the Courant number asks for a step of 1e-07 s"):
        run(system, TimeStepping(CONTROL, [1.0]))


def test_much_effort_makes_the_step_smaller() -> None:
    system, said = Decay(), []
    system.effort = 0.8
    stepping = TimeStepping(replace(CONTROL, first=0.1), [1.0], said.append)
    for _ in range(5):
        stepping.advance(system)
    assert system.steps == pytest.approx([0.1 * 0.8**k for k in range(5)])
    assert any("effort 0.80" in text for text in said)


@pytest.mark.parametrize("first", [1e-5, 0.1])
def test_effort_that_the_step_does_not_change_does_not_stall_the_run(first: float) -> None:
    system, said = Decay(), []
    system.effort, system.speed = 2.0, 50.0
    run(system, TimeStepping(replace(CONTROL, first=first), [1.0], said.append))
    # a quarter of what the Courant number allows, whether the step comes from above or below
    assert min(system.steps[60:-2]) >= 0.25 / 50 * (1 - 1e-12)
    assert system.steps[-3] == pytest.approx(0.25 / 50, rel=0.2)
    assert len(said) < 40


def test_changes_alone_are_told() -> None:
    system, said = Decay(), []
    run(system, TimeStepping(replace(CONTROL, first=0.01, largest=0.01), [1.0], said.append))
    assert len(system.steps) == 100
    assert len(said) <= 2


def test_a_run_goes_on_from_a_state_bit_for_bit() -> None:
    whole, halves = Decay(rough=(0.3, 0.5), largest=0.004), Decay(rough=(0.3, 0.5), largest=0.004)
    times = run(whole, TimeStepping(CONTROL, [0.7, 1.0]))
    first = TimeStepping(CONTROL, [0.7, 1.0])
    for _ in range(len(times) // 2):
        first.advance(halves)
    second = TimeStepping(CONTROL, [0.7, 1.0])
    second.restore(first.state())
    assert times[len(times) // 2 :] == run(halves, second)
    assert whole.y == halves.y
    assert second.count == len(times)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Times of a flow in time, and what they give away: seconds and milliseconds, late schedules."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from fem_tfm.scenes.judged.gas import Derived

# end of a run over the time in which the gas passes the line, outside of which it was hardly meant
PASSAGES = (0.01, 1000.0)
# factor of a schedule at its largest, outside of which it was hardly meant
FACTORS = (0.5, 5.0)
# CPU time that is told before a run [s]
DAY = 86400.0
SCHEDULES = ("gas_schedule", "solids_schedule")


def of_the_times(scene: Any, blamed: bool) -> Iterator[Derived]:
    """The end of a run in passages of the gas, and times and factors that do not fit it.

    blamed : whether velocity or length are doubted, from which the passages follow
    """
    end, speed = scene.numerics.end_time, scene.feed.gas_velocity
    low, high = PASSAGES
    passages, doubt = end * speed / scene.geometry.length, ""
    if speed > 0 and not blamed and not low <= passages <= high:
        doubt = f"is numerics.end_time = {end:g} in s, not in ms?"
    yield Derived("end of the run over the passage of the gas", passages, "", doubt)
    for name in ("interval", "checkpoint_interval"):
        span = getattr(scene.output, name, None)
        if span is not None and span > end:
            doubt = f"nothing is written before the end at {end:g} s"
            yield Derived(f"output.{name}", span, "s", doubt)
    for name in SCHEDULES:
        points = getattr(scene.feed, name, ())
        if points:
            yield from _of_a_schedule(name, points, end)


def _of_a_schedule(name: str, points: Any, end: float) -> Iterator[Derived]:
    """Whether a schedule holds factors and ends with the run."""
    (low, high), most = FACTORS, max(factor for _, factor in points)
    if not low <= most <= high:
        doubt = f"operation.{name} lists [time in s, factor on what is fed], 1 for all of it"
        yield Derived(f"largest factor of operation.{name}", most, "", doubt)
    last = points[-1][0]
    if last > end:
        doubt = f"the run ends at {end:g} s; are the times of operation.{name} in s?"
        yield Derived(f"last time of operation.{name}", last, "s", doubt)


def too_long(scene: Any) -> list[str]:
    """Whether a run takes days, one sentence; empty where it does not."""
    told = scene.expected_time()
    if not math.isfinite(told) or told < DAY:
        return []
    return [
        f"the run would take about {told / DAY:.0f} days of CPU time: are steps, end and lengths in"
        " SI units?"
    ]

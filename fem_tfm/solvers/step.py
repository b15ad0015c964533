# SPDX-License-Identifier: LGPL-3.0-or-later
"""One step of any kind: tried, taken back where it fails, and tried again with a smaller size.

Pseudo-time, marches and time stepping share these lines; each has its own rule of growth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from fem_tfm.errors import SolverError


@dataclass(frozen=True, kw_only=True)
class StepControl:
    """How a step moves.

    first, largest, smallest : sizes, in the unit of the step
    growth : largest factor from one step to the next
    cut : factor after a failed step
    """

    first: float
    largest: float
    smallest: float
    growth: float = 1.5
    cut: float = 0.5


def attempt[Outcome](
    size: float,
    smallest: float,
    trial: Callable[[float], Outcome],
    shrink: Callable[[float, Exception], float],
    *,
    failures: type[Exception] | tuple[type[Exception], ...],
    restore: Callable[[], None] = lambda: None,
    retry: Callable[[float, str], None] = lambda size, reason: None,
    refuse: Callable[[Exception], str],
) -> Outcome:
    """Result of the largest step at or below `size` that succeeds.

    trial : takes a step of a size; raises one of `failures` where it fails
    shrink : next size to try, told the one that failed and why
    restore : puts back the state before a failed step
    retry : told the next size and why the one before failed
    refuse : says that no step succeeds

    Raises
    ------
    SolverError
        no step above the smallest succeeds; the state is the one before it.
    """
    while True:
        try:
            return trial(size)
        except failures as error:
            restore()
            size = shrink(size, error)
            if not size >= smallest:
                raise SolverError(refuse(error)) from error
            retry(size, str(error))

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Benchmarks: how many random cases converge, and run time against error.

Each is a module with `run(out) -> str`, which prints as it goes, writes its pictures to `out` and
returns its summary. A new one is one line in `BENCHMARKS`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from fem_tfm.bench import (
    duct,
    error,
    grains,
    particles,
    stress,
    stress_unsteady,
    times,
    unsteady,
    unsteady_error,
)
from fem_tfm.errors import InputError, nearest

BENCHMARKS: dict[str, Callable[[Path], str]] = {
    "error": error.run,
    "duct": duct.run,
    "grains": lambda out: grains.run(),
    "particles": lambda out: particles.run(),
    "stress": lambda out: stress.run(),
    "stress-quick": lambda out: stress.run_quick(),
    "stress-turbulence": lambda out: stress.run_turbulent(),
    "stress-unsteady": lambda out: stress_unsteady.run(),
    "times": lambda out: times.run(),
    "unsteady": lambda out: unsteady.run(),
    "unsteady-error": unsteady_error.run,
    "unsteady-error-log-law": lambda out: unsteady_error.run(out, "log-law"),
    "unsteady-large": lambda out: unsteady.run_large(),
}
# what `fem-tfm bench` runs without a name
ALL = ("error", "duct", "stress")
# where pictures go by default, below the current directory
RESULTS = Path("results") / "bench"


def run(name: str | None = None, out: str | Path = RESULTS, scenes: str | None = None) -> str:
    """Run one benchmark, or error, duct and stress in turn; return their summaries.

    out : directory of the pictures
    scenes : numbers of those of stress-unsteady, "7" or "1-50"

    Raises
    ------
    InputError
        there is no benchmark of that name, no such scene, or no demo to measure
    """
    if scenes is not None:
        if name != "stress-unsteady":
            raise InputError("--scenes", scenes, "the benchmark stress-unsteady beside it")
        return stress_unsteady.run(*stress_unsteady.numbers(scenes))
    if name is not None and name not in BENCHMARKS:
        allowed = "one of " + ", ".join(BENCHMARKS)
        raise InputError("benchmark", name, allowed, nearest(name, BENCHMARKS))
    return "\n\n".join(BENCHMARKS[one](Path(out)) for one in ([name] if name else ALL))

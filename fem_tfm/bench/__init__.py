# SPDX-License-Identifier: LGPL-3.0-or-later
"""Benchmarks: how many random cases converge, and run time against error.

Each is a module with `run() -> str`, which prints as it goes and returns its summary. A new one is
one line in `BENCHMARKS`.
"""

from __future__ import annotations

from collections.abc import Callable

from fem_tfm.bench import duct, error, stress, unsteady, unsteady_error
from fem_tfm.errors import InputError, nearest

BENCHMARKS: dict[str, Callable[[], str]] = {
    "error": error.run,
    "duct": duct.run,
    "stress": stress.run,
    "stress-quick": stress.run_quick,
    "stress-turbulence": stress.run_turbulent,
    "unsteady": unsteady.run,
    "unsteady-error": unsteady_error.run,
    "unsteady-error-log-law": lambda: unsteady_error.run("log-law"),
    "unsteady-large": unsteady.run_large,
}
# what `fem-tfm bench` runs without a name
ALL = ("error", "duct", "stress")


def run(name: str | None = None) -> str:
    """Run one benchmark, or error, duct and stress in turn; return their summaries.

    Raises
    ------
    InputError
        there is no benchmark of that name
    """
    if name is not None and name not in BENCHMARKS:
        allowed = "one of " + ", ".join(BENCHMARKS)
        raise InputError("benchmark", name, allowed, nearest(name, BENCHMARKS))
    return "\n\n".join(BENCHMARKS[one]() for one in ([name] if name else ALL))

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Habits of DOLFINx in one place: how forms are compiled, and why their cache is hit.

UFL orders the constants of a product by the text of their running number, so "99" and "100"
swap places and the same form gets another name and is compiled again. Numbers of equal length
keep their order.
"""

from __future__ import annotations

import itertools
import time
from pathlib import Path
from typing import Any

import ufl
from dolfinx import fem, jit

from fem_tfm.errors import SolverError

# measured on the dense section: -O1 compiles in 2/3 of the time of -O2 and runs as fast; a second
# run that needs the same form waits for the first, which takes longer than FFCx's default of 10 s
JIT_OPTIONS = {"cffi_extra_compile_args": ["-O1", "-march=native"], "timeout": 300}

ufl.Constant._counter = itertools.count(10**9)


def compile_form(form: Any) -> fem.Form:
    """Compile a UFL form, or take it from the cache.

    Raises
    ------
    SolverError
        another run has been compiling the same form for too long, or was killed while it did.
    """
    began = time.time()
    try:
        return fem.form(form, jit_options=JIT_OPTIONS)
    except TimeoutError as error:
        raise SolverError(f"a form could not be compiled: {error}") from error
    except KeyboardInterrupt:
        _remove_unfinished(began)
        raise


def _remove_unfinished(began: float) -> None:
    """Delete what an interrupted compilation leaves, for which the next run would wait in vain."""
    cache = Path(jit.get_options()["cache_dir"])
    for source in cache.glob("*.c"):
        done = source.with_suffix(".c.cached").exists()
        if not done and source.stat().st_mtime >= began - 1:
            source.unlink(missing_ok=True)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Habits of DOLFINx in one place: how forms are compiled, and why their cache is hit.

UFL orders the constants of a product by the text of their running number, so "99" and "100"
swap places and the same form gets another name and is compiled again. Numbers of equal length
keep their order.
"""

from __future__ import annotations

import itertools
from typing import Any

import ufl
from dolfinx import fem

# measured on the dense section: -O1 compiles in 2/3 of the time of -O2 and runs as fast
JIT_OPTIONS = {"cffi_extra_compile_args": ["-O1", "-march=native"]}

ufl.Constant._counter = itertools.count(10**9)


def compile_form(form: Any) -> fem.Form:
    """Compile a UFL form, or take it from the cache."""
    return fem.form(form, jit_options=JIT_OPTIONS)

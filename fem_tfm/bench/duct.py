# SPDX-License-Identifier: LGPL-3.0-or-later
"""Run time against error: the pressure gradient of the square duct's gas on a row of meshes.

As for the dense pipe, every mesh is solved by nested iteration from the coarsest one, and the error
is against a finer mesh than any in the table.
"""

from __future__ import annotations

from pathlib import Path

from fem_tfm.bench import error
from fem_tfm.bench.demo import demo
from fem_tfm.case import Case

CELLS = ("quadrilateral", "triangle")
LEVELS, REFERENCE_LEVEL = (1, 2, 3, 4, 5), 7


def case() -> Case:
    """What is measured: the gas alone, without its heat."""
    return demo("square_duct/gas.toml", {"heat": None})


def run(out: Path) -> str:
    """Measure every mesh, print a line for each, write the picture and return the table."""
    return error.measured(case(), LEVELS, REFERENCE_LEVEL, CELLS, out / "duct.png")

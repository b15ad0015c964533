# SPDX-License-Identifier: LGPL-3.0-or-later
"""Closure laws of the two-fluid model: pure expressions of UFL, numpy or plain numbers.

Every module of this folder and of its subfolders is imported here, so a file dropped in registers
its laws by itself. The functions below look them up by family and name.
"""

import importlib
import pkgutil

from fem_tfm.closures.base import (
    Closure,
    catalogue,
    every_law,
    families,
    make,
    names,
    parameter,
    register,
)

for _module in pkgutil.walk_packages(__path__, __name__ + "."):
    importlib.import_module(_module.name)

__all__ = [
    "Closure",
    "catalogue",
    "every_law",
    "families",
    "make",
    "names",
    "parameter",
    "register",
]

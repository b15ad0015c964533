# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scenes: a model in a line with its feed, solved in one way.

Every module of this folder is imported here, so a file dropped in registers its scenes by itself.
"""

import importlib
import pkgutil

for _module in pkgutil.iter_modules(__path__, __name__ + "."):
    importlib.import_module(_module.name)

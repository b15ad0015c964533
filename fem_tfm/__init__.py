# SPDX-License-Identifier: LGPL-3.0-or-later
"""fem_tfm: gas-solid flow in pneumatic conveying by finite elements.

In Python::

    from fem_tfm import Case

    result = Case.load("demos/dense_pipe/case3.toml").run()
    result["pressure_gradient"]
"""

from __future__ import annotations

import importlib.util
from typing import TYPE_CHECKING, Any

# the wheel of DOLFINx must load MPI and PETSc in its own order; other installations lack it
if importlib.util.find_spec("dolfinx_solver") is not None:
    import dolfinx_solver  # noqa: F401

if TYPE_CHECKING:
    from fem_tfm.case import Case
    from fem_tfm.output.result import Result

__version__ = "0.1.0"
__all__ = ["Case", "Result", "__version__"]


def __getattr__(name: str) -> Any:
    """Load Case and Result when they are first used, so that closures import quickly."""
    if name == "Case":
        from fem_tfm.case import Case

        return Case
    if name == "Result":
        from fem_tfm.output.result import Result

        return Result
    raise AttributeError(f"module 'fem_tfm' has no attribute {name!r}")

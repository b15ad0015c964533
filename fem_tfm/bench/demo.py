# SPDX-License-Identifier: LGPL-3.0-or-later
"""The demos of the checkout, which are what the benchmarks measure."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import fem_tfm
from fem_tfm.case import Case
from fem_tfm.errors import InputError

DEMOS = Path(fem_tfm.__file__).parents[1] / "demos"


def demo(name: str, changes: Mapping[str, Any]) -> Case:
    """A demo with dotted keys changed.

    name : of its file below demos/

    Raises
    ------
    InputError
        the package is installed without the checkout.
    """
    path = DEMOS / name
    if not path.exists():
        words = f"to be run from a checkout of the repository; there is no {path}"
        raise InputError("benchmark", name, words)
    return Case.load(path).with_values(changes)

# SPDX-License-Identifier: LGPL-3.0-or-later
from typing import Any

import numpy as np
import numpy.typing as npt

ROW: int
FACE: int
SUMS: int
PAIRS: int
PARTNER: int
PARTNER_SIZES: int
CHUNK: int
AWAY: int
DRAG_FIRST: int
DRAG_OCTAVES: int
DRAG_PIECES: int
VARIANT: str

# grains as discrete elements, a module inside
grains: Any

class Grid:
    def __init__(
        self,
        cells: int,
        arrays: dict[str, Any],
        nodes: int,
        folds: int,
    ) -> None: ...

class Impacts:
    def __init__(self) -> None: ...
    def sorted(self) -> npt.NDArray[np.float64]: ...

def advance(
    grid: Grid,
    geometry: dict[str, Any],
    gas: dict[str, Any],
    options: dict[str, Any],
    cloud: dict[str, Any],
    sinks: dict[str, Any],
    impacts: Impacts | None,
    variant: str,
    threads: int,
    first: int,
    seconds: float,
) -> tuple[int, int, int, int, int]: ...

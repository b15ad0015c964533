# SPDX-License-Identifier: LGPL-3.0-or-later
"""Material properties of the two phases, in SI units."""

from __future__ import annotations

import math
from dataclasses import dataclass

from fem_tfm.closures.base import Parameters, parameter
from fem_tfm.closures.ops import is_expr
from fem_tfm.errors import InputError


@dataclass(frozen=True)
class Gas(Parameters):
    """Gas of constant density.

    Raises InputError for a number out of range.
    """

    density: float = parameter(unit="kg/m3", doc="density rho_g", gt=0)
    viscosity: float = parameter(unit="Pa s", doc="dynamic viscosity mu_g", gt=0)


@dataclass(frozen=True)
class Solids(Parameters):
    """Granular solids of equal spheres.

    Raises InputError for a number out of range, or a friction limit not below the packing limit.
    """

    density: float = parameter(unit="kg/m3", doc="material density rho_s", gt=0)
    diameter: float = parameter(unit="m", doc="grain diameter d", gt=0)
    restitution: float = parameter(0.7, "-", "restitution e of two grains", gt=0, le=1)
    packing_limit: float = parameter(0.63, "-", "largest solids fraction a_max", gt=0, le=0.75)
    friction_limit: float = parameter(0.4, "-", "solids fraction a_min of first friction", gt=0)
    friction_angle: float = parameter(
        math.radians(32), "rad", "angle of internal friction phi", gt=0, lt=math.pi / 2
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        low, high = self.friction_limit, self.packing_limit
        if not is_expr(low, high) and low >= high:
            raise InputError("friction_limit", low, f"a number below packing_limit = {high:g}")

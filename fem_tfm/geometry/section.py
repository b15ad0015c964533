# SPDX-License-Identifier: LGPL-3.0-or-later
"""The cross-section of a line and the part of it that is solved.

A section lies in the plane (x, y), y up, z downstream, its centre at the origin; a half section
keeps x >= 0, a quarter x >= 0 and y >= 0.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import ufl

from fem_tfm.errors import InputError, nearest

# quadrants of the section that each part keeps
QUADRANTS = {"none": 4, "half": 2, "quarter": 1}
# the wall distance stops here, over the half width, so that its logarithm is finite on the wall
DISTANCE_FLOOR = 1e-9


class Section(ABC):
    """Part of a cross-section: its size, and the distance to its wall.

    symmetry    : part that is solved, "none" (the whole section), "half" or "quarter"
    wall_offset : the mesh ends at this distance from the wall, where wall functions hold [m]

    Area, perimeter and wall distance are those of the whole section up to the wall. Raises
    InputError for a part that does not exist or an offset that leaves no section.
    """

    symmetry: str
    wall_offset: float
    # Gmsh script in meshes/, and the layouts of cells that it knows, the first by default
    script: ClassVar[str]
    layouts: ClassVar[tuple[str, ...]]

    def __post_init__(self) -> None:
        if self.symmetry not in QUADRANTS:
            allowed = "one of " + ", ".join(QUADRANTS)
            near = nearest(self.symmetry, QUADRANTS)
            raise InputError("geometry.symmetry", self.symmetry, allowed, near)
        half = min(self.size) / 2
        if not 0 <= self.wall_offset < half:
            raise InputError("wall_offset", self.wall_offset, f"from 0 to below {half:g} m")

    @property
    @abstractmethod
    def size(self) -> tuple[float, float]:
        """Width and height of the whole section [m]."""

    @staticmethod
    @abstractmethod
    def _area(width: float, height: float) -> float:
        """Area of a whole section of a size [m2]."""

    @property
    @abstractmethod
    def perimeter(self) -> float:
        """Wetted perimeter P of the whole section [m]."""

    @property
    @abstractmethod
    def level_size(self) -> float:
        """Core cell size of level 1 [m]."""

    @property
    @abstractmethod
    def constants(self) -> dict[str, float]:
        """Constants of the Gmsh script."""

    @abstractmethod
    def wall_distance(self, x: Any) -> Any:
        """Distance y to the wall [m], above zero on it.

        `x` is a UFL SpatialCoordinate or a numpy array of shape (2 or 3, n); lengths enter forms as
        constants.
        """

    @property
    def area(self) -> float:
        """Area A of the whole section [m2]."""
        return self._area(*self.size)

    @property
    def area_factor(self) -> int:
        """Area of the whole section over that of the part solved [-]."""
        return 4 // QUADRANTS[self.symmetry]

    @property
    def meshed_area(self) -> float:
        """Area of the part solved without the strip along the wall, circle exact [m2]."""
        width, height = (side - 2 * self.wall_offset for side in self.size)
        return self._area(width, height) / self.area_factor

    @property
    def hydraulic_diameter(self) -> float:
        """D_h = 4 A/P [m]."""
        return 4 * self.area / self.perimeter

    @property
    def radius(self) -> float:
        """Half the hydraulic diameter [m]."""
        return self.hydraulic_diameter / 2


@dataclass(frozen=True)
class RoundSection(Section):
    """Section of a pipe of an inner diameter [m]."""

    diameter: float
    symmetry: str = "half"
    wall_offset: float = 0.0
    script: ClassVar[str] = "pipe"
    layouts: ClassVar[tuple[str, ...]] = ("o-grid", "free", "blocks", "block")

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the whole section, the diameter D [m]."""
        return self.diameter, self.diameter

    @staticmethod
    def _area(width: float, height: float) -> float:
        return math.pi * (width * height) / 4

    @property
    def perimeter(self) -> float:
        """Wetted perimeter pi D [m]."""
        return math.pi * self.diameter

    @property
    def hydraulic_diameter(self) -> float:
        """4 A/P = D, without round-off [m]."""
        return self.diameter

    @property
    def level_size(self) -> float:
        """Core cell size of level 1, D/8 [m]."""
        return self.diameter / 8

    @property
    def constants(self) -> dict[str, float]:
        """Constants of the Gmsh script."""
        inner = self.diameter - 2 * self.wall_offset
        return {"diameter": inner, "quadrants": QUADRANTS[self.symmetry]}

    def wall_distance(self, x: Any) -> Any:
        """Distance to the wall, y = max(R - |x|, 1e-9 R) [m].

        Exact but for the floor (curved elements cross the circle by round-off and O(h^4)) and for
        1e-6 R at the axis, where its gradient stays finite.
        """
        sqrt, maximum, constant = _functions(x)
        radius = constant(self.radius)
        axis = constant((1e-6 * self.radius) ** 2)
        r = sqrt(x[0] * x[0] + x[1] * x[1] + axis)
        return maximum(radius - r, constant(DISTANCE_FLOOR * self.radius))


@dataclass(frozen=True)
class RectangularSection(Section):
    """Section of a duct of an inner width along x and height along y [m]."""

    width: float
    height: float
    symmetry: str = "half"
    wall_offset: float = 0.0
    script: ClassVar[str] = "duct"
    layouts: ClassVar[tuple[str, ...]] = ("grid",)

    @property
    def size(self) -> tuple[float, float]:
        """Width W and height H of the whole section [m]."""
        return self.width, self.height

    @staticmethod
    def _area(width: float, height: float) -> float:
        return width * height

    @property
    def perimeter(self) -> float:
        """Wetted perimeter 2 (W + H) [m]."""
        return 2 * (self.width + self.height)

    @property
    def level_size(self) -> float:
        """Core cell size of level 1, 0.23 of the shorter side [m]."""
        return 0.23 * min(self.size)

    @property
    def constants(self) -> dict[str, float]:
        """Constants of the Gmsh script."""
        return {
            "width": self.width,
            "height": self.height,
            "wall_offset": self.wall_offset,
            "quadrants": QUADRANTS[self.symmetry],
        }

    def wall_distance(self, x: Any) -> Any:
        """Distance to the walls, y = (a^-4 + b^-4)^(-1/4) [m], of the distances a and b.

        a = W/2 - |x|, b = H/2 - |y|. Smooth across the diagonals; below min(a, b) by (a/b)^4/4 of
        it: exact near a wall away from corners, 16 % low where a = b. The kinks of |x| and |y| are
        rounded over 1e-3 W and 1e-3 H; a and b are floored at 1e-9 of the half sides.
        """
        sqrt, maximum, constant = _functions(x)

        def side(coordinate: Any, length: float) -> Any:
            rounding = constant((1e-3 * length) ** 2)
            # zero on the wall itself, rounding or not
            end = constant(math.sqrt(length**2 / 4 + (1e-3 * length) ** 2))
            distance = end - sqrt(coordinate * coordinate + rounding)
            return maximum(distance, constant(DISTANCE_FLOOR * length / 2))

        a, b = side(x[0], self.width), side(x[1], self.height)
        # a b/(a^4 + b^4)^(1/4) divided through, so that no fourth power underflows
        low, high = a / (a + b), b / (a + b)
        return (a + b) * low * high / sqrt(sqrt(low**4 + high**4))


def _functions(x: Any) -> tuple[Any, Callable[[Any, Any], Any], Callable[[float], Any]]:
    """Square root, maximum and constant for arrays or, without a literal in the form, for UFL."""
    if isinstance(x, ufl.core.expr.Expr):
        from dolfinx import fem

        domain = ufl.domain.extract_unique_domain(x)
        return ufl.sqrt, ufl.max_value, lambda value: fem.Constant(domain, value)
    return np.sqrt, np.maximum, lambda value: value

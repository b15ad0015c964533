# SPDX-License-Identifier: LGPL-3.0-or-later
"""How fine a mesh is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Literal, Self

from fem_tfm.errors import InputError
from fem_tfm.geometry.section import Section
from fem_tfm.parameters import Parameters, parameter

CELLS = ("triangle", "quadrilateral")
# thickness of the wall cell over the core cell
WALL_RATIO = 0.25
# sizes accepted over the hydraulic diameter, and wall ratios: the smallest make millions of cells
SMALLEST_SIZE, LARGEST_SIZE, SMALLEST_RATIO = 5e-4, 0.5, 1e-3
# a coarse mesh may be this much above the coarsest size asked for
SLACK = 1.001


@dataclass(frozen=True)
class Resolution(Parameters):
    """Size, grading and shape of the cells.

    level        : core cell size = section.level_size/sqrt(2)^(level - 1): cells double per level
    mesh_size    : core cell size [m] in place of the level; rounded so that whole cells fit
    wall_grading : thickness of the wall cell over the core cell, 0.25 by default; sizes between
                   them change linearly with the wall distance
    cells        : extruded to tetrahedra or hexahedra, "triangle" by default
    axial_cells  : along an unsteady flow, by default twice as long as core cells are wide

    A kind of flow may fill in what is None. Raises InputError for a value out of range.
    """

    level: int = parameter(3, doc="finest mesh level, 1 = coarsest", ge=1, le=12)
    mesh_size: float | None = parameter(None, "m", "mesh size in place of the level", gt=0, le=100)
    wall_grading: float | None = parameter(
        None, doc="wall cell over core cell, default that of the mesh", ge=SMALLEST_RATIO, le=1
    )
    cells: Literal["triangle", "quadrilateral"] | None = parameter(None, doc="shape of the cells")
    axial_cells: int | None = parameter(
        None, doc="cells along an unsteady flow, default twice as long as wide", ge=1, le=1000000
    )
    table: ClassVar[str] = "numerics"

    @property
    def wall_ratio(self) -> float:
        """Thickness of the wall cell over the core cell, given or 0.25 [-]."""
        return WALL_RATIO if self.wall_grading is None else self.wall_grading

    @property
    def cell_shape(self) -> Literal["triangle", "quadrilateral"]:
        """Shape of the cells, given or "triangle"."""
        return "triangle" if self.cells is None else self.cells

    def core_size(self, section: Section) -> float:
        """Core cell size asked for [m]; raises InputError if the section cannot carry it."""
        size = self.mesh_size
        if size is None:
            size = section.level_size / 2 ** ((self.level - 1) / 2)
        lower, upper = (f * section.hydraulic_diameter for f in (SMALLEST_SIZE, LARGEST_SIZE))
        if not lower <= size <= upper:
            raise InputError("numerics.mesh_size", size, f"from {lower:g} to {upper:g} m")
        return size

    def nested_sizes(self, section: Section, coarsest: float) -> list[float]:
        """Core cell sizes of the nested iteration, coarse to fine, each half the one before [m].

        coarsest : largest of them over the hydraulic diameter, unless the finest is above it [-]
        """
        sizes = [self.core_size(section)]
        while 2 * sizes[0] <= SLACK * coarsest * section.hydraulic_diameter:
            sizes.insert(0, 2 * sizes[0])
        return sizes

    def nested(self, section: Section, coarsest: float) -> list[Self]:
        """The resolutions of the nested iteration, coarse to fine; see `nested_sizes`."""
        return [replace(self, mesh_size=size) for size in self.nested_sizes(section, coarsest)]

    def with_wall_cell(self, section: Section, height: float) -> Self:
        """The same with a wall cell of at most a height [m], unless the grading is given."""
        if self.wall_grading is not None:
            return self
        wanted = max(height / self.core_size(section), SMALLEST_RATIO)
        return replace(self, wall_grading=min(WALL_RATIO, wanted))

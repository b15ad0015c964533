# SPDX-License-Identifier: LGPL-3.0-or-later
"""The conveying line that a user states: a pipe, a duct or a bend.

Its section lies in the plane (x, y), y up, z downstream at the inlet. A shape tells the sizes of
its whole section; `section` gives the part that is solved.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from typing import Any, ClassVar, Literal

from fem_tfm.errors import InputError, nearest
from fem_tfm.geometry.arc import Arc
from fem_tfm.geometry.section import RectangularSection, RoundSection, Section
from fem_tfm.parameters import Parameters, allowed, parameter


@dataclass(frozen=True, kw_only=True)
class Shape(Parameters, ABC):
    """A line of a length along its axis, inclined at the inlet.

    Raises InputError for a number out of range or numbers that contradict each other.
    """

    length: float = parameter(1.0, "m", "length over which the pressure drop is told", gt=0, le=1e5)
    inclination_deg: float = parameter(
        0.0, "deg", "angle of the inlet's axis above the horizontal", ge=-90, le=90
    )
    symmetry: Literal["auto", "quarter", "half", "none"] = parameter(
        "auto", doc="part of the section solved"
    )
    table: ClassVar[str] = "geometry"
    # name of the shape, key geometry.shape
    shape: ClassVar[str]

    @staticmethod
    def from_table(values: Mapping[str, Any]) -> Shape:
        """The shape of a table [geometry]; None stands for the default.

        Raises InputError for a name that is no shape, a size that is missing, and a key that
        belongs to another shape.
        """
        given = {key: value for key, value in values.items() if value is not None}
        name = given.pop("shape", Pipe.shape)
        if not isinstance(name, str) or name not in SHAPES:
            words = f"one of {', '.join(SHAPES)} (shape of the line)"
            raise InputError("geometry.shape", name, words, nearest(name, SHAPES))
        cls = SHAPES[name]
        own, bend = ({f.name: f for f in fields(kind)} for kind in (cls, Bend))
        size = "width" if cls is Duct else "diameter"
        for key in ("diameter", "width", "height"):
            if key in given and key not in own:
                words = f"geometry.{size} in its place for shape {name!r}"
                raise InputError(f"geometry.{key}", given[key], words)
        for key in given:
            if key in bend and key not in own:
                raise InputError(f"geometry.{key}", given[key], "geometry.shape = 'bend' beside it")
        if size not in given:
            words = f"{allowed(cls, own[size])} for shape {name!r}"
            raise InputError(f"geometry.{size}", None, words)
        return cls(**given)

    def to_table(self) -> dict[str, Any]:
        """The table [geometry] from which `from_table` makes the same shape."""
        return {"shape": self.shape} | {f.name: getattr(self, f.name) for f in fields(self)}

    @abstractmethod
    def _part(self, symmetry: str, wall_offset: float) -> Section:
        """A part of the section, without the strip of a thickness [m] along the wall."""

    def section(self, part: str = "half", wall_offset: float = 0.0) -> Section:
        """Part of the section that is solved.

        part        : "none" (the whole), "half" or "quarter", taken where the symmetry is "auto"
        wall_offset : distance from the wall where the mesh ends, for wall functions [m]

        Raises InputError for another part, or an offset that leaves no section.
        """
        return self._part(part if self.symmetry == "auto" else self.symmetry, wall_offset)

    @property
    def arc(self) -> Arc | None:
        """The arc in the axis, None for a straight line."""
        return None

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the section [m]."""
        return self._part("none", 0.0).size

    @property
    def area(self) -> float:
        """Area A of the whole section [m2]."""
        return self._part("none", 0.0).area

    @property
    def perimeter(self) -> float:
        """Wetted perimeter P of the whole section [m]."""
        return self._part("none", 0.0).perimeter

    @property
    def hydraulic_diameter(self) -> float:
        """D_h = 4 A/P [m]."""
        return self._part("none", 0.0).hydraulic_diameter

    @property
    def words(self) -> str:
        """Shape, size, length and inclination in words."""
        width, height = self.size
        across = f"{width:g} m" if width == height else f"{width:g} by {height:g} m"
        slope = f"{self.inclination_deg:g} deg upwards" if self.inclination_deg else "level"
        return f"{self.shape} of {across}, {self.length:g} m long, {slope}"

    def gravity_vector(self, g: float) -> tuple[float, float, float]:
        """(0, -g cos(theta), -g sin(theta)) of gravity g, theta the inclination [m/s2]."""
        theta = math.radians(self.inclination_deg)
        return 0.0, -g * math.cos(theta), -g * math.sin(theta)


@dataclass(frozen=True)
class Pipe(Shape):
    """A straight round pipe, such as `Pipe(0.010, length=2.4)`."""

    diameter: float = parameter(MISSING, "m", "inner diameter of a pipe or bend", gt=0, le=100)
    shape: ClassVar[str] = "pipe"

    def _part(self, symmetry: str, wall_offset: float) -> Section:
        return RoundSection(self.diameter, symmetry, wall_offset)


@dataclass(frozen=True)
class Duct(Shape):
    """A straight rectangular duct, such as `Duct(0.2, length=16)`; square without a height."""

    width: float = parameter(MISSING, "m", "inner width of a duct", gt=0, le=100)
    height: float | None = parameter(
        None, "m", "inner height of a duct, default width", gt=0, le=100
    )
    shape: ClassVar[str] = "duct"

    def _part(self, symmetry: str, wall_offset: float) -> Section:
        height = self.width if self.height is None else self.height
        return RectangularSection(self.width, height, symmetry, wall_offset)


@dataclass(frozen=True, kw_only=True)
class Bend(Pipe):
    """A round pipe that turns by an angle, such as `Bend(0.010, length=2.4, bend_towards="down")`.

    Its length is that of the axis, legs and arc together; the arc turns about a point outside the
    pipe. A bend upwards or downwards has a vertical plane of symmetry, one to the side has none.
    """

    bend_radius: float | None = parameter(
        None, "m", "radius of the axis of a bend, default 3 diameters", gt=0, le=1e4
    )
    bend_angle_deg: float = parameter(90.0, "deg", "angle by which a bend turns", gt=0, le=180)
    bend_start: float | None = parameter(
        None, "m", "straight leg before a bend, default half the straight length", ge=0, le=1e5
    )
    bend_towards: Literal["up", "down", "side"] = parameter("up", doc="to where a bend turns")
    shape: ClassVar[str] = "bend"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.axis_radius <= self.diameter / 2:
            words = f"a radius above half of geometry.diameter, {self.diameter / 2:g} m"
            raise InputError("geometry.bend_radius", self.bend_radius, words)
        before, arc, _ = self.legs
        if before + arc > self.length * (1 + 1e-9):
            words = (
                f"at least the leg before the bend of {before:g} m and its arc of {arc:g} m, whose"
                f" radius is {self.axis_radius:g} m"
            )
            raise InputError("geometry.length", self.length, words)
        if self.bend_towards == "side" and self.symmetry not in ("auto", "none"):
            words = "'none' or 'auto' where the bend turns to the side"
            raise InputError("geometry.symmetry", self.symmetry, words)
        if self.symmetry == "quarter":
            words = "'half', 'none' or 'auto' where the line bends"
            raise InputError("geometry.symmetry", self.symmetry, words)

    @property
    def axis_radius(self) -> float:
        """Radius of the axis of the arc [m]."""
        return 3 * self.diameter if self.bend_radius is None else self.bend_radius

    @property
    def legs(self) -> tuple[float, float, float]:
        """Lengths along the axis before, in and behind the arc [m]."""
        arc = self.axis_radius * math.radians(self.bend_angle_deg)
        straight = max(self.length - arc, 0.0)
        before = straight / 2 if self.bend_start is None else self.bend_start
        return before, arc, max(straight - before, 0.0)

    @property
    def arc(self) -> Arc:
        """The arc in the axis."""
        angle = math.radians(self.bend_angle_deg)
        return Arc(self.axis_radius, angle, self.legs[0], self.bend_towards)

    def section(self, part: str = "half", wall_offset: float = 0.0) -> Section:
        """Part of the section that is solved: at most a half, the whole of a bend to the side.

        See Shape.section.
        """
        if self.bend_towards == "side":
            part = "none"
        elif part == "quarter":
            part = "half"
        return super().section(part, wall_offset)


SHAPES: dict[str, type[Pipe] | type[Duct]] = {cls.shape: cls for cls in (Pipe, Duct, Bend)}

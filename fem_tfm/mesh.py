# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes of pipes, ducts and bends: opens the Gmsh scripts in meshes/ and tags their parts.

A section lies in the plane (x, y), y up, z downstream; a half section keeps x >= 0, a quarter
x >= 0 and y >= 0. Parts are named "fluid", "wall", "symmetry" (half), "symmetry_x" and
"symmetry_y" (quarter: the planes x = 0 and y = 0) and, in three dimensions, "inlet" and "outlet".
A bend is a straight line whose nodes have been moved onto the arc.
Gmsh runs on rank 0 alone. What depends on the version of DOLFINx is here and nowhere else.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.io import gmsh as gmsh_io
from dolfinx.mesh import GhostMode, MeshTags, create_cell_partitioner
from dolfinx.mesh import Mesh as DolfinxMesh
from mpi4py import MPI

from fem_tfm.errors import InputError, SolverError, nearest
from fem_tfm.signals import kept

QUADRANTS = {"none": 4, "half": 2, "quarter": 1}
CELLS = ("triangle", "quadrilateral")
SUFFIXES = (".msh", ".xdmf", ".vtu")
WALL_RATIO = 0.25
# sizes accepted over the hydraulic diameter, and wall ratios: the smallest make millions of cells
SMALLEST_SIZE, LARGEST_SIZE, SMALLEST_RATIO = 5e-4, 0.5, 1e-3
# the wall distance stops here, over the half width, so that its logarithm is finite on the wall
DISTANCE_FLOOR = 1e-9
# Debian packages of the libraries that the wheel of Gmsh loads but does not bring
DEBIAN_PACKAGES = (
    "libglu1-mesa libgl1 libxrender1 libxcursor1 libxfixes3 libxext6 libxft2 libxinerama1 "
    "libfontconfig1 libgomp1"
)
# what the scripts set in Gmsh, put back afterwards for users who run Gmsh themselves
GMSH_OPTIONS = (
    "General.Terminal",
    "Mesh.ElementOrder",
    "Mesh.SecondOrderIncomplete",
    "Mesh.MeshSizeExtendFromBoundary",
    "Mesh.MeshSizeFromPoints",
)


def _number(value: object) -> bool:
    real = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
    return real and math.isfinite(value)  # type: ignore[arg-type]


def _positive(key: str, value: float) -> None:
    if not (_number(value) and value > 0):
        raise InputError(key, value, "a finite number above 0 m")


def _whole(key: str, value: int, upper: int) -> None:
    whole = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not (whole and 1 <= value <= upper):
        raise InputError(key, value, f"a whole number from 1 to {upper}")


def _choice(key: str, value: str, valid: tuple[str, ...]) -> None:
    if value not in valid:
        near = nearest(value, valid) if isinstance(value, str) else None
        raise InputError(key, value, "one of " + ", ".join(map(repr, valid)), near)


def _offset(value: float, half: float) -> None:
    if not (_number(value) and 0 <= value < half):
        raise InputError("wall_offset", value, f"from 0 to below {half:g} m")


def _functions(x: Any) -> tuple[Any, Callable[[Any, Any], Any], Callable[[float], Any]]:
    """Square root, maximum and constant for arrays or, without a literal in the form, for UFL."""
    if isinstance(x, ufl.core.expr.Expr):
        domain = ufl.domain.extract_unique_domain(x)
        return ufl.sqrt, ufl.max_value, lambda value: fem.Constant(domain, value)
    return np.sqrt, np.maximum, lambda value: value


@dataclass(frozen=True)
class PipeGeometry:
    """Section of a round pipe: diameter [m] and the part solved ("half", "none", "quarter").

    The mesh ends at `wall_offset` [m] from the wall, for wall functions; area, perimeter and wall
    distance are those of the pipe. Raises InputError for a diameter that is not positive, an offset
    that leaves no section, or a part that does not exist.
    """

    diameter: float
    symmetry: str = "half"
    wall_offset: float = 0.0
    script: ClassVar[str] = "pipe"
    layouts: ClassVar[tuple[str, ...]] = ("o-grid", "free")

    def __post_init__(self) -> None:
        _positive("geometry.diameter", self.diameter)
        _choice("geometry.symmetry", self.symmetry, tuple(QUADRANTS))
        _offset(self.wall_offset, self.diameter / 2)

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the whole section [m]."""
        return self.diameter, self.diameter

    @property
    def radius(self) -> float:
        """Radius of the pipe [m]."""
        return self.diameter / 2

    @property
    def area(self) -> float:
        """Area pi D^2/4 of the whole section [m2]."""
        return math.pi * self.diameter**2 / 4

    @property
    def area_factor(self) -> int:
        """Whole section over the part solved [-]."""
        return 4 // QUADRANTS[self.symmetry]

    @property
    def meshed_area(self) -> float:
        """Area of the mesh, circle exact: of the part solved and without the strip [m2]."""
        inner = self.diameter - 2 * self.wall_offset
        return math.pi * inner**2 / 4 / self.area_factor

    @property
    def perimeter(self) -> float:
        """Wetted perimeter pi D of the whole section [m]."""
        return math.pi * self.diameter

    @property
    def hydraulic_diameter(self) -> float:
        """4 A/P = D [m]."""
        return self.diameter

    @property
    def level_size(self) -> float:
        """Core cell size of level 1, D/8 [m]; every level divides it by sqrt(2)."""
        return self.diameter / 8

    @property
    def constants(self) -> dict[str, float]:
        """Constants of the Gmsh script."""
        inner = self.diameter - 2 * self.wall_offset
        return {"diameter": inner, "quadrants": QUADRANTS[self.symmetry]}

    def wall_distance(self, x: Any) -> Any:
        """Distance to the wall, y = max(R - |x|, 1e-9 R) [m].

        Exact but for the floor (curved elements cross the circle by round-off and O(h^4)) and for
        1e-6 R at the axis, where its gradient stays finite. `x` is a UFL SpatialCoordinate or a
        numpy array of shape (2 or 3, n); lengths enter forms as constants.
        """
        sqrt, maximum, constant = _functions(x)
        radius = constant(self.radius)
        axis = constant((1e-6 * self.radius) ** 2)
        r = sqrt(x[0] * x[0] + x[1] * x[1] + axis)
        return maximum(radius - r, constant(DISTANCE_FLOOR * self.radius))


@dataclass(frozen=True)
class DuctGeometry:
    """Section of a rectangular duct: width along x, height along y [m] and the part solved.

    The mesh starts at `wall_offset` [m] from the walls, for wall functions; area, perimeter and
    wall distance are those of the duct. Raises InputError for lengths that are not positive, an
    offset that leaves no section, or a part that does not exist.
    """

    width: float
    height: float
    symmetry: str = "half"
    wall_offset: float = 0.0
    script: ClassVar[str] = "duct"
    layouts: ClassVar[tuple[str, ...]] = ("grid",)

    def __post_init__(self) -> None:
        _positive("geometry.width", self.width)
        _positive("geometry.height", self.height)
        _choice("geometry.symmetry", self.symmetry, tuple(QUADRANTS))
        _offset(self.wall_offset, min(self.width, self.height) / 2)

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the whole section [m]."""
        return self.width, self.height

    @property
    def radius(self) -> float:
        """Half the hydraulic diameter [m]."""
        return self.hydraulic_diameter / 2

    @property
    def area(self) -> float:
        """Area W H of the whole section [m2]."""
        return self.width * self.height

    @property
    def area_factor(self) -> int:
        """Whole section over the part solved [-]."""
        return 4 // QUADRANTS[self.symmetry]

    @property
    def meshed_area(self) -> float:
        """Area of the mesh: of the part solved and without the strip at the walls [m2]."""
        inner = (self.width - 2 * self.wall_offset) * (self.height - 2 * self.wall_offset)
        return inner / self.area_factor

    @property
    def perimeter(self) -> float:
        """Wetted perimeter 2 (W + H) of the whole section [m]."""
        return 2 * (self.width + self.height)

    @property
    def hydraulic_diameter(self) -> float:
        """4 A/P = 2 W H/(W + H) [m]."""
        return 4 * self.area / self.perimeter

    @property
    def level_size(self) -> float:
        """Core cell size of level 1, 0.23 of the shorter side [m]; levels divide it by sqrt(2)."""
        return 0.23 * min(self.width, self.height)

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


Geometry = PipeGeometry | DuctGeometry
# normals to the axis at the inlet, along which a bend turns
TOWARDS = {"up": (0.0, 1.0), "down": (0.0, -1.0), "side": (1.0, 0.0)}


@dataclass(frozen=True)
class Bend:
    """An arc in the axis of a line.

    radius  : of the axis [m]
    angle   : by which the axis turns, (0, pi] [rad]
    before  : straight length between inlet and arc [m]
    towards : "up" (+y), "down" (-y) or "side" (+x) as seen at the inlet

    A point has the coordinates (x, y, s) in the straight line, s along the axis. With n the normal
    of the axis towards the centre of the arc, c = (x, y).n and phi = (s - before)/radius, it lies
    in the arc at

        c' = radius - (radius - c) cos(phi),    z = before + (radius - c) sin(phi).

    Raises InputError.
    """

    radius: float
    angle: float
    before: float
    towards: str = "up"

    def __post_init__(self) -> None:
        _positive("geometry.bend_radius", self.radius)
        if not (_number(self.angle) and 0 < self.angle <= math.pi):
            raise InputError("geometry.bend_angle_deg", self.angle, "above 0 and at most 180 deg")
        if not (_number(self.before) and self.before >= 0):
            raise InputError("geometry.bend_start", self.before, "at least 0 m")
        _choice("geometry.bend_towards", self.towards, tuple(TOWARDS))

    @property
    def end(self) -> float:
        """Length along the axis at which the arc ends [m]."""
        return self.before + self.radius * self.angle

    @property
    def normal(self) -> npt.NDArray[np.float64]:
        """Normal n of the axis at the inlet, towards the centre of the arc, shape (3,)."""
        return np.array([*TOWARDS[self.towards], 0.0])

    def bent(self, straight: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Places of points (x, y, s) of the straight line, shape (n, 3) [m]."""
        s = straight[:, 2]
        phi = np.clip((s - self.before) / self.radius, 0.0, self.angle)
        lever = self.radius - straight @ self.normal
        # what lies before and behind the arc goes straight on
        rest = s - np.clip(s, self.before, self.end)
        across = self.radius - lever * np.cos(phi) + rest * np.sin(phi)
        along = self.before + lever * np.sin(phi) + rest * np.cos(phi)
        return self._with(straight, across, along)

    def straightened(self, x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Coordinates (x, y, s) of points in the straight line, the inverse of `bent` [m]."""
        phi = self._turned(x)
        lever, ahead = self.radius - x @ self.normal, x[:, 2] - self.before
        across = self.radius - lever * np.cos(phi) - ahead * np.sin(phi)
        rest = ahead * np.cos(phi) - lever * np.sin(phi)
        return self._with(x, across, self.before + self.radius * phi + rest)

    def axis(self, x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Unit vectors along the axis at points, shape (n, 3)."""
        phi = self._turned(x)[:, None]
        return np.sin(phi) * self.normal + np.cos(phi) * np.array([0.0, 0.0, 1.0])

    def fits(self, geometry: Geometry, length: float) -> None:
        """Refuse a bend that the line or its section cannot make; raises InputError."""
        lost = ("quarter", "half") if self.towards == "side" else ("quarter",)
        if geometry.symmetry in lost:
            allowed = "a part that the bend leaves symmetric"
            raise InputError("geometry.symmetry", geometry.symmetry, allowed)
        width, height = geometry.size
        half = (width if self.towards == "side" else height) / 2
        if self.radius <= half:
            raise InputError("geometry.bend_radius", self.radius, f"above {half:g} m")
        if length < self.end * (1 - 1e-9):
            raise InputError(
                "geometry.length", length, f"at least {self.end:g} m, to the arc's end"
            )

    def _turned(self, x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Angle by which the axis has turned at points, shape (n,) [rad]."""
        phi = np.arctan2(x[:, 2] - self.before, self.radius - x @ self.normal)
        # legs lie within a quarter turn of the ends of the arc
        phi = np.where(phi < -math.pi / 2, phi + 2 * math.pi, phi)
        return np.clip(phi, 0.0, self.angle)

    def _with(self, x: npt.NDArray[np.float64], across: Any, along: Any) -> npt.NDArray[np.float64]:
        """Points with other coordinates along the normal and along z."""
        moved = x + (across - x @ self.normal)[:, None] * self.normal
        moved[:, 2] = along
        return moved


@dataclass(frozen=True)
class Resolution:
    """How fine a mesh is and what its cells are.

    level      : core cell size = geometry.level_size/sqrt(2)^(level - 1): cells double per level
    size       : core cell size [m] in place of the level; rounded so that whole cells fit
    wall_ratio : thickness of the wall cell over the core cell, (0, 1]; sizes between them change
                 linearly with the wall distance
    cells      : "triangle" | "quadrilateral"; extruded to tetrahedra | hexahedra
    order      : 2 curves the cells along the wall, 1 has straight edges between nodes on the wall
    layout     : pipe: "o-grid" (thin long cells in layers along the wall) | "free" (isotropic
                 triangles); duct: "grid". None takes the first.

    Raises InputError.
    """

    level: int = 3
    size: float | None = None
    wall_ratio: float = WALL_RATIO
    cells: str = "triangle"
    order: int = 2
    layout: str | None = None

    def __post_init__(self) -> None:
        _whole("numerics.level", self.level, 12)
        if self.size is not None:
            _positive("numerics.mesh_size", self.size)
        ratio = self.wall_ratio
        if not (_number(ratio) and SMALLEST_RATIO <= ratio <= 1):
            raise InputError("numerics.wall_grading", ratio, f"from {SMALLEST_RATIO:g} to 1")
        _choice("numerics.cells", self.cells, CELLS)
        _whole("order", self.order, 2)

    def core_size(self, geometry: Geometry) -> float:
        """Core cell size asked for [m]; raises InputError if the section cannot carry it."""
        size = self.size
        if size is None:
            size = geometry.level_size / math.sqrt(2) ** (self.level - 1)
        lower, upper = (f * geometry.hydraulic_diameter for f in (SMALLEST_SIZE, LARGEST_SIZE))
        if not lower <= size <= upper:
            raise InputError("numerics.mesh_size", size, f"from {lower:g} to {upper:g} m")
        return size

    def chosen_layout(self, geometry: Geometry) -> str:
        """The layout asked for or the first of the geometry; raises InputError."""
        layout = geometry.layouts[0] if self.layout is None else self.layout
        _choice("layout", layout, geometry.layouts)
        if layout == "free" and self.cells != "triangle":
            raise InputError("numerics.cells", self.cells, "'triangle' in the layout 'free'")
        return layout


@dataclass(frozen=True, eq=False)
class Mesh:
    """A tagged DOLFINx mesh and the geometry it stands for.

    mesh       : dolfinx Mesh, with a layer of ghost cells across facets in parallel
    cell_tags  : MeshTags of the cells ("fluid")
    facet_tags : MeshTags of the boundary facets; every one has exactly one tag
    tags       : tag of each name
    geometry   : PipeGeometry or DuctGeometry
    size       : core cell size [m] as built; the wall cell is wall_ratio times that
    length     : length along the axis [m], None for a section
    bend       : the arc in the axis, None for a straight line
    """

    mesh: DolfinxMesh
    cell_tags: MeshTags
    facet_tags: MeshTags
    tags: dict[str, int]
    geometry: Geometry
    size: float
    length: float | None = None
    bend: Bend | None = None

    @property
    def num_cells(self) -> int:
        """Cells on all ranks."""
        return int(self.mesh.topology.index_map(self.mesh.topology.dim).size_global)

    def wall_distance(self) -> Any:
        """UFL distance to the wall of a section or straight line [m], see the geometry.

        Raises ValueError for a bend, where `distance_at` tells it.
        """
        if self.bend is not None:
            raise ValueError("the wall of a bend has no distance in x and y")
        return self.geometry.wall_distance(ufl.SpatialCoordinate(self.mesh))

    def straightened(self, x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Coordinates (x, y, s) of points in the straight line, s along the axis, (n, 3) [m]."""
        return x if self.bend is None else self.bend.straightened(x)

    def axis(self, x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Unit vectors along the axis at points, shape (n, 3)."""
        if self.bend is None:
            return np.broadcast_to([0.0, 0.0, 1.0], x.shape)
        return self.bend.axis(x)

    def distance_at(self, x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Distance of points to the wall, shape (n,) [m]; see the geometry."""
        return self.geometry.wall_distance(self.straightened(x).T)

    def plane(
        self, rows: int, columns: int
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """A grid in the vertical plane through the axis of a line.

        Points in space, shape (rows, columns, 3), and where to draw them, shape (rows, columns, 2):
        along and up as they lie, but a bend to the side unrolled [m]. They keep half a spacing from
        walls and ends, and a hair from the plane of symmetry.
        """
        width, height = self.geometry.size
        low = -height / 2 if self.geometry.symmetry != "quarter" else 0.0
        y = low + (height / 2 - low) * (np.arange(rows) + 0.5) / rows
        s = self.length * (np.arange(columns) + 0.5) / columns
        y, s = np.meshgrid(y, s, indexing="ij")
        straight = np.stack([np.full_like(y, 1e-6 * width), y, s], axis=-1).reshape(-1, 3)
        points = straight if self.bend is None else self.bend.bent(straight)
        unrolled = self.bend is not None and self.bend.towards == "side"
        drawn = (straight if unrolled else points)[:, [2, 1]]
        return points.reshape(rows, columns, 3), drawn.reshape(rows, columns, 2)

    def facets(self, name: str) -> npt.NDArray[np.int32]:
        """Local indices of the facets called `name`; empty if the mesh has no such part."""
        tag = self.tags.get(name)
        return np.empty(0, dtype=np.int32) if tag is None else self.facet_tags.find(tag)


def section(
    geometry: Geometry, level: int = 3, *, comm: MPI.Comm = MPI.COMM_WORLD, **resolution: Any
) -> Mesh:
    """Mesh of a section in the plane (x, y).

    `resolution`: size, wall_ratio, cells, order, layout as in Resolution, e.g.
    section(PipeGeometry(0.01), size=5e-4, wall_ratio=0.1). Collective; every rank raises the same
    InputError for bad input, before any communication, and SolverError if Gmsh fails.
    """
    return _build(_Request(geometry, Resolution(level, **resolution)), comm)


def extruded(
    geometry: Geometry,
    length: float,
    layers: int,
    level: int = 3,
    *,
    bend: Bend | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
    **resolution: Any,
) -> Mesh:
    """Mesh of a pipe or duct of a length along its axis [m], in `layers` equal slices.

    It lies at 0 <= z <= length, or follows a bend. Triangles become tetrahedra, quadrilaterals
    hexahedra. Arguments and errors as for section().
    """
    return _build(_Request(geometry, Resolution(level, **resolution), length, layers, bend), comm)


def line(case: Any, comm: MPI.Comm = MPI.COMM_WORLD) -> Mesh:
    """Mesh of the whole line of a case, straight cells; collective, errors as for section()."""
    return _build(_line_request(case), comm)


def axial_layers(case: Any) -> int:
    """Slices of line(), twice as long as core cells are wide unless the case tells their number."""
    if case.numerics.axial_cells is not None:
        return case.numerics.axial_cells
    size = Resolution(**resolution_of(case)).core_size(geometry_of(case))
    return max(round(case.geometry.length / (2 * size)), 1)


def line_cells(case: Any, comm: MPI.Comm = MPI.COMM_WORLD) -> int:
    """Cells of line(), counted on the section; collective."""
    request = _line_request(case)
    per_slice = 3 if request.resolution.cells == "triangle" else 1
    mesh = _build(_Request(request.geometry, request.resolution), comm)
    return mesh.num_cells * request.layers * per_slice


def write(
    geometry: Geometry,
    path: str | Path,
    level: int = 3,
    *,
    length: float | None = None,
    layers: int = 10,
    bend: Bend | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
    **resolution: Any,
) -> None:
    """Write the mesh to .msh (Gmsh 4.1, with names), .vtu or .xdmf + .h5.

    .vtu holds cells and boundary facets with the tag of each as cell data "tag"; .xdmf the cells,
    and a second file NAME_facets.xdmf the facets, which is the pair that DOLFINx reads. A length
    [m] writes the extruded mesh. Collective. Raises InputError for another suffix or a missing
    directory.
    """
    _write(_Request(geometry, Resolution(level, **resolution), length, layers, bend), path, comm)


def _write(request: _Request, path: str | Path, comm: MPI.Comm) -> None:
    path = check_path(path)

    def work() -> None:
        with _model(request) as gmsh:
            _save(gmsh, path, request.dim)

    _on_root(comm, work)


def check_path(path: str | Path) -> Path:
    """Path of a mesh file; raises InputError for an unknown suffix or a missing directory."""
    path = Path(path)
    if path.suffix not in SUFFIXES:
        near = nearest(path.suffix, SUFFIXES)
        raise InputError("--out", str(path), "a file name ending in " + ", ".join(SUFFIXES), near)
    if not path.parent.is_dir():
        raise InputError("--out", str(path), "a file in a directory that exists")
    return path


def geometry_of(case: Any) -> Geometry:
    """Geometry of a case's section, raises InputError.

    Symmetry "auto" takes the half, or the whole where a bend turns to the side; for a duct's gas,
    which has no weight, the quarter, and the mesh begins at the distance of the wall functions.
    """
    given = case.geometry
    _choice("geometry.shape", given.shape, ("pipe", "duct", "bend"))
    weightless = case.flow == "duct"
    part, offset = ("quarter", case.wall_distance) if weightless else ("half", 0.0)
    if given.shape == "bend" and given.bend_towards == "side":
        part = "none"
    symmetry = part if given.symmetry == "auto" else given.symmetry
    if given.shape != "duct":
        return PipeGeometry(given.diameter, symmetry, offset)
    height = given.width if given.height is None else given.height
    return DuctGeometry(given.width, height, symmetry, offset)


def resolution_of(case: Any) -> dict[str, Any]:
    """Keyword arguments `level`, `size`, `wall_ratio`, `cells` of section() from a case."""
    given, ratio = case.numerics, case.numerics.wall_grading
    if ratio is None:
        ratio = WALL_RATIO
        if case.flow == "dense" and case.walls.gas.resolved:
            core = Resolution(given.level, given.mesh_size).core_size(geometry_of(case))
            ratio = min(ratio, max(case.wall_distance / core, SMALLEST_RATIO))
    return {
        "level": given.level,
        "size": given.mesh_size,
        "wall_ratio": ratio,
        "cells": given.cells,
    }


def write_case_mesh(case: Any, path: str | Path, comm: MPI.Comm = MPI.COMM_WORLD) -> None:
    """Write the section of a case, or the line of an unsteady one; see write()."""
    if case.solution == "unsteady":
        _write(_line_request(case), path, comm)
    else:
        write(geometry_of(case), path, comm=comm, **resolution_of(case))


def _line_request(case: Any) -> _Request:
    """The line of a case."""
    given, geometry = case.geometry, geometry_of(case)
    resolution, bend = Resolution(**resolution_of(case), order=1), None
    if given.shape == "bend":
        angle = math.radians(given.bend_angle_deg)
        bend = Bend(given.axis_radius, angle, given.legs[0], given.bend_towards)
    return _Request(geometry, resolution, given.length, axial_layers(case), bend, fills=True)


@dataclass(frozen=True)
class _Request:
    """One mesh to make, checked."""

    geometry: Geometry
    resolution: Resolution
    length: float | None = None
    layers: int = 1
    bend: Bend | None = None
    fills: bool = False

    def __post_init__(self) -> None:
        if self.length is not None:
            _positive("length", self.length)
        _whole("layers", self.layers, 10**6)
        if self.bend is not None:
            self.bend.fits(self.geometry, self.length)
        self.resolution.core_size(self.geometry)
        self.resolution.chosen_layout(self.geometry)

    @property
    def dim(self) -> int:
        return 2 if self.length is None else 3

    @property
    def constants(self) -> dict[str, float]:
        """Constants of the Gmsh script."""
        given = self.resolution
        return {
            **self.geometry.constants,
            "size": given.core_size(self.geometry),
            "wall_ratio": given.wall_ratio,
            "layout": self.geometry.layouts.index(given.chosen_layout(self.geometry)),
            "quads": CELLS.index(given.cells),
            "order": given.order,
            "length": self.length or 0.0,
            "axial_layers": self.layers,
        }

    @property
    def curves_diagonals(self) -> bool:
        given = self.resolution
        curved = given.chosen_layout(self.geometry) == "o-grid" and given.order == 2
        return curved and given.cells == "triangle"


def _import_gmsh() -> ModuleType:
    try:
        import gmsh
    except OSError as error:
        raise SolverError(
            f"Gmsh misses a system library ({error}); on Debian or Ubuntu install {DEBIAN_PACKAGES}"
        ) from error
    except ImportError as error:
        raise SolverError(f"Gmsh is not installed ({error}): pip install gmsh") from error
    return gmsh


def _script(name: str) -> Path:
    """Path of a Gmsh script: beside the package in a checkout, inside it when installed."""
    here = Path(__file__).resolve().parent
    for folder in (here / "meshes", here.parent / "meshes"):
        if (folder / f"{name}.geo").is_file():
            return folder / f"{name}.geo"
    raise SolverError(f"meshes/{name}.geo is missing from the installation of fem_tfm")


@contextmanager
def _session() -> Iterator[ModuleType]:
    """A silent Gmsh with a model of its own; leaves a Gmsh that the user runs as it was."""
    gmsh = _import_gmsh()
    own = not gmsh.isInitialized()
    if own:
        with kept():
            gmsh.initialize(readConfigFiles=False, interruptible=False)
    else:
        current = gmsh.model.getCurrent()
    options = {name: gmsh.option.getNumber(name) for name in GMSH_OPTIONS}
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.add("fem_tfm")
    try:
        yield gmsh
    finally:
        gmsh.model.remove()
        for name, value in options.items():
            gmsh.option.setNumber(name, value)
        if own:
            gmsh.finalize()
        else:
            gmsh.model.setCurrent(current)


@contextmanager
def _model(request: _Request) -> Iterator[ModuleType]:
    """Gmsh with the mesh of `request` as its current model."""
    with _session() as gmsh:
        for name, value in request.constants.items():
            gmsh.parser.setNumber(name, [value])
        try:
            gmsh.merge(str(_script(request.geometry.script)))
            gmsh.model.mesh.generate(request.dim)
            if request.curves_diagonals:
                _curve_diagonals(gmsh, request.dim)
            if request.fills and isinstance(request.geometry, PipeGeometry):
                _fill(gmsh, request.geometry)
            if request.bend is not None:
                _follow(gmsh, request.bend)
            yield gmsh
        finally:
            gmsh.parser.clear()


def _curve_diagonals(gmsh: ModuleType, dim: int) -> None:
    """Move the mid-side nodes of diagonals to the centre of their curved quadrilateral.

    A straight diagonal cuts through the curved sides of a long thin cell; the centre is that of the
    transfinite map, half the sum of the four mid-sides less a quarter of that of the corners.
    """
    tags, points, _ = gmsh.model.mesh.getNodes()
    points = points.reshape(-1, 3)
    row = np.zeros(int(tags.max()) + 1, dtype=np.int64)
    row[tags] = np.arange(tags.size)
    first, second = _pairs(gmsh, dim)
    first, second = row[first], row[second]
    shared = first[:, 3:, None] == second[:, None, 3:]
    if not np.all(shared.sum(axis=(1, 2)) == 1):
        raise SolverError("Gmsh did not split each quadrilateral into two triangles that follow")
    edges = np.argwhere(shared)
    middle = first[edges[:, 0], 3 + edges[:, 1]]
    sides = sum(points[t[:, 3:]].sum(axis=1) for t in (first, second)) - 2 * points[middle]
    ends = sum(points[first[edges[:, 0], (edges[:, 1] + i) % 3]] for i in (0, 1))
    corners = sum(points[t[:, :3]].sum(axis=1) for t in (first, second)) - ends
    _move(gmsh, tags, points, points[middle], sides / 2 - corners / 4, dim)


def _fill(gmsh: ModuleType, pipe: PipeGeometry) -> None:
    """Widen a straight line of straight cells until its section has the area of the circle.

    A polygon on the circle lacks 2.5 % of it on a coarse mesh, and so would all flows.
    """
    tags, points, _ = gmsh.model.mesh.getNodes()
    points = points.reshape(-1, 3)
    radius = pipe.radius - pipe.wall_offset
    wall = np.abs(np.hypot(points[:, 0], points[:, 1]) - radius) < 1e-6 * radius
    wall &= np.abs(points[:, 2]) < 1e-9 * radius
    turns = np.diff(np.sort(np.arctan2(points[wall, 1], points[wall, 0]) % (2 * math.pi)))
    missing = QUADRANTS[pipe.symmetry] * math.pi / 2 - turns.sum()
    # the gap that sorting leaves: the last side of a whole pipe, the open part of any other
    sides = np.append(turns[turns < 1], missing if pipe.symmetry == "none" else [])
    points[:, :2] *= math.sqrt(sides.sum() / np.sin(sides).sum())
    for tag, place in zip(tags, points, strict=True):
        gmsh.model.mesh.setNode(tag, place, [])


def _follow(gmsh: ModuleType, bend: Bend) -> None:
    """Move the nodes of a straight line onto a bend."""
    tags, points, _ = gmsh.model.mesh.getNodes()
    for tag, place in zip(tags, bend.bent(points.reshape(-1, 3)), strict=True):
        gmsh.model.mesh.setNode(tag, place, [])


def _pairs(gmsh: ModuleType, dim: int) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Nodes of the first and second triangles of the section's split quadrilaterals."""
    name = "fluid" if dim == 2 else "inlet"
    model = gmsh.model
    groups = {model.getPhysicalName(*group): group for group in model.getPhysicalGroups(2)}
    entities = model.getEntitiesForPhysicalGroup(*groups[name])
    nodes = [model.mesh.getElements(2, entity)[2][0] for entity in entities]
    triangles = np.concatenate(nodes).reshape(-1, 6)
    return triangles[0::2], triangles[1::2]


def _move(
    gmsh: ModuleType,
    tags: npt.NDArray[Any],
    points: npt.NDArray[np.float64],
    old: npt.NDArray[np.float64],
    new: npt.NDArray[np.float64],
    dim: int,
) -> None:
    """Move the nodes at `old` to `new`, and with them all those above (same x and y)."""
    shift = new - old
    far = np.linalg.norm(shift, axis=1) > 1e-9 * np.abs(points[:, :2]).max()
    old, shift = old[far], shift[far]
    for node, by in zip(*_above(points, old, shift), strict=True):
        gmsh.model.mesh.setNode(tags[node], points[node] + by, [])


def _above(
    points: npt.NDArray[np.float64], old: npt.NDArray[np.float64], shift: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[Any], npt.NDArray[np.float64]]:
    """Rows of `points` over each of `old`, and the shift of each."""
    from scipy.spatial import cKDTree

    if not len(old):
        return np.empty(0, dtype=np.int64), shift
    reach = 1e-7 * np.abs(points[:, :2]).max()
    distance, nearest_one = cKDTree(old[:, :2]).query(points[:, :2], distance_upper_bound=reach)
    hit = np.flatnonzero(np.isfinite(distance))
    return hit, shift[nearest_one[hit]]


def _on_root(comm: MPI.Comm, work: Callable[[], Any]) -> Any:
    """Result of `work` on rank 0, on every rank; its failure is raised on every rank."""
    result, error = None, None
    if comm.rank == 0:
        try:
            result = work()
        except Exception as failure:  # whatever happens, the other ranks wait for the news
            error = failure
    message = comm.bcast(None if error is None else str(error), root=0)
    if message is not None:
        raise SolverError(f"no mesh: {message}") from error
    return comm.bcast(result, root=0)


def _build(request: _Request, comm: MPI.Comm) -> Mesh:
    """Mesh of `request`, distributed over `comm`."""
    with ExitStack() as stack:

        def work() -> float:
            gmsh = stack.enter_context(_model(request))
            return float(gmsh.parser.getNumber("core_size")[0])

        size = _on_root(comm, work)
        data = gmsh_io.model_to_mesh(
            _import_gmsh().model if comm.rank == 0 else None,
            comm,
            0,
            gdim=request.dim,
            # Gmsh meshes come without ghosts, which interior-facet integrals need
            partitioner=create_cell_partitioner(GhostMode.shared_facet, 2),
        )
    cells = data.mesh.topology.index_map(request.dim)
    ghosts = comm.allreduce(cells.num_ghosts)
    assert comm.size == 1 or ghosts > 0 or comm.allreduce(cells.size_local > 0) == 1
    tags = {name: group.tag for name, group in data.physical_groups.items()}
    return Mesh(
        data.mesh,
        data.cell_tags,
        data.facet_tags,
        tags,
        request.geometry,
        size,
        request.length,
        request.bend,
    )


def _save(gmsh: ModuleType, path: Path, dim: int) -> None:
    """Write the current model to `path` by its suffix."""
    if path.suffix == ".msh":
        gmsh.write(str(path))
        return
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "mesh.msh"
        gmsh.write(str(source))
        _convert(source, path, dim)


def _convert(source: Path, path: Path, dim: int) -> None:
    """Rewrite a Gmsh file as .vtu or .xdmf."""
    import meshio

    mesh = meshio.read(source)
    blocks = list(zip(mesh.cells, mesh.cell_data["gmsh:physical"], strict=True))
    kinds = {"cells": dim, "facets": dim - 1}
    parts = {
        kind: [(b, tag) for b, tag in blocks if b.dim == number] for kind, number in kinds.items()
    }
    if path.suffix == ".vtu":
        _merged(mesh.points, parts["cells"] + parts["facets"]).write(path)
        return
    # DOLFINx takes the dimension of space from the columns, and its wheel reads no compressed HDF5
    points = mesh.points[:, :dim]
    plain: dict[str, Any] = {"compression": None, "compression_opts": None}
    _merged(points, parts["cells"]).write(path, **plain)
    _merged(points, parts["facets"]).write(path.with_name(path.stem + "_facets.xdmf"), **plain)


def _merged(points: npt.NDArray[np.float64], blocks: list[tuple[Any, Any]]) -> Any:
    """Meshio mesh with one block per type of cell."""
    import meshio

    kinds = dict.fromkeys(block.type for block, _ in blocks)
    cells = [
        (kind, np.concatenate([block.data for block, _ in blocks if block.type == kind]))
        for kind in kinds
    ]
    tags = [np.concatenate([tag for block, tag in blocks if block.type == kind]) for kind in kinds]
    return meshio.Mesh(points, cells, cell_data={"tag": tags})

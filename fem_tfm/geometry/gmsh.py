# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes made by Gmsh from the scripts in meshes/: the session, the script, moved nodes.

Gmsh runs on rank 0 alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from fem_tfm.errors import InputError, SolverError, nearest
from fem_tfm.geometry.arc import Arc
from fem_tfm.geometry.resolution import CELLS, Resolution
from fem_tfm.geometry.section import QUADRANTS, RoundSection, Section
from fem_tfm.signals import kept

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


@dataclass(frozen=True)
class GmshModel:
    """One mesh to make: a section, or a line of it.

    length : along the axis [m], None for the section alone
    layers : slices of equal thickness along the length
    arc    : in the axis, None for a straight line
    order  : 2 curves the cells along the wall, 1 has straight edges between nodes on the wall
    layout : of a round section "o-grid" (thin long cells in layers along the wall), "free"
             (isotropic triangles), "blocks" (straight-edged quadrilaterals, one block a quadrant)
             or "block" (one straight-edged quadrilateral for all of a whole section), of a
             rectangular one "grid"; None takes the first
    fills  : whether a straight-edged section is widened to the area of its circle

    Raises InputError for a size that the section cannot carry, or a layout that it does not have.
    """

    section: Section
    resolution: Resolution
    length: float | None = None
    layers: int = 1
    arc: Arc | None = None
    order: int = 2
    layout: str | None = None
    fills: bool = False

    def __post_init__(self) -> None:
        if self.length is not None and not 0 < self.length < math.inf:
            raise InputError("length", self.length, "a finite number above 0 m")
        if self.layers < 1:
            raise InputError("layers", self.layers, "a whole number from 1")
        if self.order not in (1, 2):
            raise InputError("order", self.order, "1 or 2")
        layouts = self.section.layouts
        if self.layout is not None and self.layout not in layouts:
            near = nearest(self.layout, layouts)
            raise InputError("layout", self.layout, "one of " + ", ".join(layouts), near)
        if self.layout == "free" and self.resolution.cell_shape != "triangle":
            allowed = "'triangle' in the layout 'free'"
            raise InputError("numerics.cells", self.resolution.cell_shape, allowed)
        blocks = self.layout in ("blocks", "block")
        if blocks and (self.resolution.cell_shape != "quadrilateral" or self.order != 1):
            raise InputError("layout", self.layout, "another one for triangles or curved edges")
        if self.layout == "block" and self.section.symmetry != "none":
            raise InputError("layout", self.layout, "another one for a part of a section")
        self.resolution.core_size(self.section)

    @property
    def dim(self) -> int:
        """Dimension of the mesh."""
        return 2 if self.length is None else 3

    @property
    def constants(self) -> dict[str, float]:
        """Constants of the Gmsh script."""
        given, layouts = self.resolution, self.section.layouts
        return {
            **self.section.constants,
            "size": given.core_size(self.section),
            "wall_ratio": given.wall_ratio,
            "layout": layouts.index(self.layout or layouts[0]),
            "quads": CELLS.index(given.cell_shape),
            "order": self.order,
            "length": self.length or 0.0,
            "axial_layers": self.layers,
        }

    @contextmanager
    def opened(self) -> Iterator[ModuleType]:
        """Gmsh with this mesh as its current model; on rank 0 alone.

        Raises SolverError where Gmsh or its script is missing.
        """
        with _session() as gmsh:
            for name, value in self.constants.items():
                gmsh.parser.setNumber(name, [value])
            try:
                gmsh.merge(str(script(self.section.script)))
                gmsh.model.mesh.generate(self.dim)
                self._move_nodes(gmsh)
                yield gmsh
            finally:
                gmsh.parser.clear()

    def _move_nodes(self, gmsh: ModuleType) -> None:
        """Move nodes to where the script cannot put them."""
        round_section = isinstance(self.section, RoundSection)
        split = self.resolution.cell_shape == "triangle" and self.layout != "free"
        if round_section and split and self.order == 2:
            _curve_diagonals(gmsh, self.dim)
        if round_section and self.fills:
            _fill(gmsh, self.section)
        if self.arc is not None:
            tags, points = _nodes(gmsh)
            _set_nodes(gmsh, tags, self.arc.bent(points))


def import_gmsh() -> ModuleType:
    """The module of Gmsh; raises SolverError where it, or a library that it loads, is missing."""
    try:
        import gmsh
    except OSError as error:
        raise SolverError(
            f"Gmsh misses a system library ({error}); on Debian or Ubuntu install {DEBIAN_PACKAGES}"
        ) from error
    except ImportError as error:
        raise SolverError(f"Gmsh is not installed ({error}): pip install gmsh") from error
    module: ModuleType = gmsh
    return module


def script(name: str) -> Path:
    """Path of a Gmsh script: beside the package in a checkout, inside it when installed."""
    here = Path(__file__).resolve().parent.parent
    for folder in (here / "meshes", here.parent / "meshes"):
        if (folder / f"{name}.geo").is_file():
            return folder / f"{name}.geo"
    raise SolverError(f"meshes/{name}.geo is missing from the installation of fem_tfm")


@contextmanager
def _session() -> Iterator[ModuleType]:
    """A silent Gmsh with a model of its own; leaves a Gmsh that the user runs as it was."""
    gmsh = import_gmsh()
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


def _nodes(gmsh: ModuleType) -> tuple[npt.NDArray[np.uint64], npt.NDArray[np.float64]]:
    """Tags of the nodes and their places, shape (n, 3)."""
    tags, points, _ = gmsh.model.mesh.getNodes()
    return tags, points.reshape(-1, 3)


def _set_nodes(
    gmsh: ModuleType, tags: npt.NDArray[np.uint64], places: npt.NDArray[np.float64]
) -> None:
    for tag, place in zip(tags, places, strict=True):
        gmsh.model.mesh.setNode(tag, place, [])


def _curve_diagonals(gmsh: ModuleType, dim: int) -> None:
    """Move the mid-side nodes of diagonals to the centre of their curved quadrilateral.

    A straight diagonal cuts through the curved sides of a long thin cell; the centre is that of the
    transfinite map, half the sum of the four mid-sides less a quarter of that of the corners.
    """
    tags, points = _nodes(gmsh)
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


def _fill(gmsh: ModuleType, section: Section) -> None:
    """Widen a straight line of straight cells until its section has the area of the circle.

    A polygon on the circle lacks 2.5 % of it on a coarse mesh, and so would all flows.
    """
    tags, points = _nodes(gmsh)
    radius = section.radius - section.wall_offset
    wall = np.abs(np.hypot(points[:, 0], points[:, 1]) - radius) < 1e-6 * radius
    wall &= np.abs(points[:, 2]) < 1e-9 * radius
    turns = np.diff(np.sort(np.arctan2(points[wall, 1], points[wall, 0]) % (2 * math.pi)))
    missing = QUADRANTS[section.symmetry] * math.pi / 2 - turns.sum()
    # the gap that sorting leaves: the last side of a whole pipe, the open part of any other
    whole = section.symmetry == "none"
    sides = np.append(turns, missing) if whole else turns[turns < 1]
    points[:, :2] *= math.sqrt(sides.sum() / np.sin(sides).sum())
    _set_nodes(gmsh, tags, points)


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
    rows, by = _above(points, old, shift)
    _set_nodes(gmsh, tags[rows], points[rows] + by)


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


def from_root[T](comm: MPI.Comm, work: Callable[[], T]) -> T:
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
    found: T = comm.bcast(result, root=0)
    return found

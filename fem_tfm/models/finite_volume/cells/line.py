# SPDX-License-Identifier: LGPL-3.0-or-later
"""The mesh of a line: its cells, boundary parts, wall distances and inlet profile."""

from __future__ import annotations

import numpy as np

from fem_tfm.closures.walls.gas import GasWall
from fem_tfm.correlations import power_law
from fem_tfm.geometry.mesh import Mesh
from fem_tfm.models.finite_volume.cells.mesh import Array, Cells
from fem_tfm.models.finite_volume.cells.reconstruction import Reconstruction
from fem_tfm.models.finite_volume.problem import UnsteadyProblem

# walls whose normals have a smaller part along the axis are sides of the line, not its ends
ALONG = 0.7
PARTS = ("inlet", "outlet", "wall", "symmetry")
# smallest stretching of the gas profile at the wall, over the height of the wall law
SHORTEST = 1e-9


class LineMesh:
    """Cells of one line with its inlet, outlet and walls.

    Parameters
    ----------
    problem : inlet profile, wall law of the gas, scales
    mesh : three-dimensional, with the parts inlet, outlet, wall, symmetry that it has

    Attributes
    ----------
    cells : geometry and operators
    volume : of the owned cells [m3]
    own, inner : slices of the owned cells and of the inner faces
    inlet, outlet, wall : slices of faces, empty where the mesh has no such part
    impermeable : slice of the faces of the wall, followed by those of planes of symmetry
    has_inlet, has_wall, has_outlet : whether the mesh has the part, on any rank
    normal (faces, 3) : unit normal
    inverse_distance (faces) : 1/distance of the centres along the normal [1/m]
    open (faces) : 1 on inner faces and at the outlet, 0 elsewhere
    wall_distance (cells) : to the wall [m]
    gas_profile (cells) : height y' [m] in the gas profile, which the wall law stretches, and dy'/dy
    wall_height (wall's faces) : height at which the wall law holds for the cells there [m]
    inlet_profile (inlet's faces) : normal velocity over its mean [-]
    velocity_scale, diameter : U [m/s] and D [m]
    """

    def __init__(self, problem: UnsteadyProblem, mesh: Mesh) -> None:
        self.mesh = mesh
        self.cells = cells = Cells(mesh, [name for name in PARTS if name in mesh.tags])
        self.velocity_scale = problem.gas_velocity
        self.diameter = problem.diameter
        self.own, self.inner = slice(0, cells.owned), slice(0, cells.inner_count)
        self.volume = cells.volume[: cells.owned]
        self.wall, self.inlet, self.outlet = (
            cells.parts.get(name, slice(0, 0)) for name in ("wall", "inlet", "outlet")
        )
        ends = (cells.parts.get(name, slice(0, 0)).stop for name in ("inlet", "outlet"))
        self.impermeable = slice(max(cells.inner_count, *ends), cells.face_count)
        self.has_inlet, self.has_wall = "inlet" in cells.parts, "wall" in cells.parts
        self.has_outlet = cells.total(self.outlet.stop - self.outlet.start) > 0
        self.normal = cells.area / cells.face_area[:, None]
        self.inverse_distance = cells.face_weight / cells.face_area
        self.open = np.zeros(cells.face_count)
        self.open[: cells.inner_count] = 1.0
        self.open[self.outlet] = 1.0
        self.reconstruct = Reconstruction(cells, ["inlet"] if self.has_inlet else [])
        self.wall_distance = self._wall_distance()
        law, offset = problem.closures.gas_wall, problem.wall_offset
        self.gas_profile = _stretched(law, self.wall_distance, offset)
        self.wall_height = _wall_height(
            law, 1 / self.inverse_distance[self.wall], offset, self.diameter
        )
        self.inlet_profile = self._inlet_profile(problem.inlet_profile)

    def _wall_distance(self) -> Array:
        """Distance of the cells to the wall as the mesh has it (collective).

        The faces of a curved wall lie inside it, by more than the height of a thin cell; their mean
        distance to the wall is subtracted.
        """
        cells, mesh = self.cells, self.mesh
        found, middle = mesh.distance_at(cells.centre), cells.face_centre[self.wall]
        across = np.einsum("ij,ij->i", mesh.axis(middle), self.normal[self.wall])
        size = cells.face_area[self.wall] * (np.abs(across) < ALONG)
        area = cells.total(size)
        if area == 0:
            return found
        sagitta = cells.total(mesh.distance_at(middle) * size) / area
        thinnest = -cells.largest(-1 / self.inverse_distance[self.wall])
        return np.maximum(found - sagitta, thinnest / 2)

    def _inlet_profile(self, name: str) -> Array:
        """Normal velocity on the inlet's faces over its mean [-] (collective)."""
        cells = self.cells
        shape = np.ones(self.inlet.stop - self.inlet.start)
        if name == "power-law":
            height = self.mesh.distance_at(cells.face_centre[self.inlet])
            shape = power_law(height, self.diameter / 2)
        size = cells.face_area[self.inlet]
        area, flux = cells.total(size), cells.total(size * shape)
        return shape * (area / flux) if flux > 0 else shape

    def inlet_flux(self, mean: float) -> Array:
        """Volume flux through the inlet's faces at a mean velocity, negative inwards [m3/s]."""
        return -mean * self.inlet_profile * self.cells.face_area[self.inlet]

    def small_norm(self, value: float) -> float:
        """Norm of a vector with this value in every cell."""
        return value * self.cells.map.size_global**0.5


def _stretched(law: GasWall, distance: Array, offset: float) -> tuple[Array, Array]:
    """Height y' in the gas profile at a distance to the wall [m], and dy'/dy."""
    height, slope = law.stretched(distance, offset)
    return height, np.zeros_like(distance) + slope


def _wall_height(law: GasWall, distance: Array, offset: float, diameter: float) -> Array:
    """Height [m] at which the wall law holds for cells with centres at a distance to the wall.

    The law compensates for the flow that its stretched strip adds within the cell.
    """
    height, _ = _stretched(law, distance, offset)
    added = np.maximum(height - distance, SHORTEST * offset)
    return height * law.height(added, diameter) / added

# SPDX-License-Identifier: LGPL-3.0-or-later
"""The mesh of a line: its cells, boundary parts, wall distances and inlet profile."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sparse

from fem_tfm.closures.walls.gas import GasWall
from fem_tfm.correlations import power_law
from fem_tfm.geometry.mesh import Mesh
from fem_tfm.models.finite_volume.cells.mesh import SMALLEST, Array, Cells, Index
from fem_tfm.models.finite_volume.cells.reconstruction import Reconstruction
from fem_tfm.models.finite_volume.problem import UnsteadyProblem

# walls whose normals have a smaller part along the axis are sides of the line, not its ends
ALONG = 0.7
PARTS = ("inlet", "outlet", "wall", "symmetry")
# smallest stretching of the gas profile at the wall, over the height of the wall law
SHORTEST = 1e-9
# bounds of values at the wall over those at the centres of the cells beside it
RISES = 0.5, 2.0
# largest rise of a value to the outlet over that of the cell there
MOST_OUTWARD = 0.5
# largest change of a slope beside an impermeable face over the slope by least squares
MOST_CHANGE = 0.5
# faces are opposite to each other if the product of their outward normals is below minus this
FACING = 0.8


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
    opposite : inner faces opposite to the wall or to planes of symmetry, and the side of their cell
        there (0: the first)
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
        self._to_wall, self._to_outlet = map(cells.extrapolation, (self.wall, self.outlet))
        self.opposite = self._opposite()

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

    def _opposite(self) -> tuple[Index, Index]:
        """Inner faces opposite to impermeable ones in the same cell, and the side of that cell."""
        cells, number = self.cells, self.cells.inner_count
        edge = cells.first[self.impermeable]
        along = sparse.csr_array(
            (np.ones(edge.size), (edge, np.arange(edge.size))), (cells.count, edge.size)
        )
        faces, sides = [], []
        for side, cell in enumerate((cells.first[:number], cells.second)):
            # pairs of an inner and an impermeable face of an owned cell
            pairs = along[cell].tocoo()
            inner, beside = pairs.coords
            out = self.normal[inner] * (1 if side == 0 else -1)
            found = np.einsum("ni,ni->n", out, self.normal[self.impermeable][beside]) < -FACING
            inner = np.unique(inner[found])
            faces.append(inner)
            sides.append(np.full(inner.size, side))
        return np.concatenate(faces), np.concatenate(sides)

    def at_sides(self, gradient: Array) -> Array:
        """Gradient of a velocity with its linear values in the cells beside impermeable faces.

        Least squares have neighbours on one side there, and give the slope q = n.grad u half a cell
        further in. With q_2 that of the cell across the opposite face it is at the centre

            q + (q - q_2) min(1, |q|/(2 |q - q_2|))

        gradient (cells, 3, 3) : by least squares, with ghosts; the result holds in owned cells
        """
        cells, (face, side) = self.cells, self.opposite
        normal = self.normal[face]
        here = np.where(side == 0, cells.first[face], cells.second[face])
        there = np.where(side == 0, cells.second[face], cells.first[face])
        slope, further = (np.einsum("nij,nj->ni", gradient[c], normal) for c in (here, there))
        change = slope - further
        size, most = (np.linalg.norm(q, axis=1) for q in (change, slope))
        change *= np.minimum(1.0, MOST_CHANGE * most / np.maximum(size, SMALLEST))[:, None]
        found = gradient.copy()
        np.add.at(found, here, change[:, :, None] * normal[:, None, :])
        return found

    def rise_to_outlet(self, values: Array) -> Array:
        """Linear values on the faces of the outlet less those q of the cells there.

        A rise is at most half of |q|: beyond the outlet nothing tells whether the slope goes on.
        """
        here = values[self.cells.first[self.outlet]]
        rise = self._to_outlet @ values - here
        size, most = (np.abs(q) if q.ndim == 1 else _norm(q) for q in (rise, here))
        return rise * np.minimum(1.0, MOST_OUTWARD * most / np.maximum(size, SMALLEST))

    def rise_to_wall(self, values: Array) -> Array:
        """Linear values on the faces of the wall over those >= 0 of the cells there, 1/2 to 2."""
        here = values[self.cells.first[self.wall]]
        return np.clip((self._to_wall @ values + SMALLEST) / (here + SMALLEST), *RISES)

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


def _norm(vectors: Array) -> Array:
    """Norms of vectors, (n, 1)."""
    return np.linalg.norm(vectors, axis=1, keepdims=True)


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

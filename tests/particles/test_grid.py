# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cells: maps, neighbours, sizes, and the gas that the kernel finds in them."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest
from grids import box, duct, gas
from mpi4py import MPI

from fem_tfm.errors import InputError
from fem_tfm.geometry.mesh import section_mesh
from fem_tfm.geometry.resolution import Resolution
from fem_tfm.geometry.section import RectangularSection, RoundSection
from fem_tfm.materials import Solids
from fem_tfm.models.particles import shapes
from fem_tfm.models.particles.cloud import Parcels
from fem_tfm.models.particles.field import Field, cholesky
from fem_tfm.models.particles.grid import Gathered, Grid, Walls, neighbours
from fem_tfm.models.particles.tracker import Steps, Tracker

POINT = Solids(density=1000.0, diameter=1e-4)


def warped(x: np.ndarray) -> np.ndarray:
    """Curved cells that still fill the square."""
    k = np.pi / 0.1
    bump = 2e-3 * np.sin(k * x[:, 0]) * np.sin(k * x[:, 1])
    return x + np.stack([bump, -bump], axis=1)


def seen(field: Field, places: np.ndarray) -> np.ndarray:
    """Gas velocity at places, as remembered after a very short step."""
    parcels = Parcels.release(places, [0, 0, 0], POINT, diameter=0.0)
    tracker = Tracker([POINT], steps=Steps(largest=1e-12, smallest=1e-13))
    report = tracker.advance(parcels, field, until_time=1e-12)
    assert report.strays == 0
    return parcels.memory[:, :3]


@pytest.mark.parametrize("triangles", [False, True])
@pytest.mark.parametrize("curved", [False, True])
def test_fields_are_those_of_the_elements(triangles: bool, curved: bool) -> None:
    """A quadratic field is exact in straight cells; in curved ones as good as its nodes."""
    grid = duct(cells=12, triangles=triangles, warp=warped if curved else None)
    assert bool(grid.arrays["curved"].any()) == curved

    def velocity(x: np.ndarray) -> np.ndarray:
        a, b = x[:, 0], x[:, 1]
        return np.stack([1 + a * b, 3 * a - b**2, 20 - 800 * (a**2 + b**2)], axis=1)

    x = np.zeros((3000, 3))
    x[:, :2] = np.random.default_rng(1).uniform(-0.1, 0.1, (3000, 2))
    found = seen(gas(grid, velocity=velocity), x)
    np.testing.assert_allclose(found, velocity(x), atol=2e-3 if curved else 2e-5)


def test_sizes_and_neighbours() -> None:
    for triangles in (False, True):
        grid = duct(cells=5, triangles=triangles, warp=warped)
        assert grid.sizes.sum() == pytest.approx(0.04, rel=1e-3)
        beside = grid.arrays["neighbour"]
        assert (beside == -1).sum() == 20
        for cell, facet in np.argwhere(beside >= 0):
            assert cell in beside[beside[cell, facet]]


@pytest.mark.parametrize(("kind", "outer"), [("hexahedron", 2 * 82), ("tetrahedron", 4 * 82)])
def test_neighbours_in_space(kind: str, outer: int) -> None:
    cell, nodes, points = box((3, 4, 10), (1.0, 2.0, 3.0), kind)
    beside = neighbours(cell, nodes)
    assert (beside == -1).sum() == outer
    assert cell.sizes(points[nodes]).sum() == pytest.approx(6.0)


def test_stresses_are_made_realisable() -> None:
    good = np.diag([1.0, 2.0, 3.0])
    bad = np.array([[1.0, 1.2, 0.0], [1.2, 1.0, 0.0], [0.0, 0.0, 1.0]])
    factor, clipped = cholesky(np.stack([good, bad]))
    assert clipped == 1
    assert factor[0] @ factor[0].T == pytest.approx(good)
    raised = factor[1] @ factor[1].T
    assert np.linalg.eigvalsh(raised) == pytest.approx([1.5e-3, 1.0, 2.2])


# -- meshes ------------------------------------------------------------------------------------


@functools.cache
def gathered(shape: str, cell: str, alone: bool = False) -> Gathered:
    section: RectangularSection | RoundSection
    if shape == "round":
        section = RoundSection(0.2, symmetry="half")
    else:
        section = RectangularSection(0.2, 0.1, symmetry="quarter", wall_offset=1e-3)
    comm = MPI.COMM_SELF if alone else MPI.COMM_WORLD
    return Gathered.of(section_mesh(section, Resolution(level=2, cells=cell), comm))


@pytest.mark.mpi
@pytest.mark.parametrize("shape", ["round", "rectangular"])
@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_mesh_on_every_rank(shape: str, cell: str) -> None:
    """Numbers do not depend on the ranks, and values at nodes come from where they are."""
    found = gathered(shape, cell)
    grid, comm = found.grid, MPI.COMM_WORLD
    exact = math.pi * 0.01 / 2 if shape == "round" else 0.099 * 0.049
    assert grid.sizes.sum() == pytest.approx(exact, rel=1e-4)
    assert comm.allreduce(len(grid.owned)) == grid.count
    assert comm.allreduce(len(found.given)) == len(grid.points)
    whole = found.gather(grid.points[found.given])
    assert np.array_equal(whole, grid.points)
    alone = gathered(shape, cell, alone=True).grid
    for name, values in alone.arrays.items():
        assert np.array_equal(grid.arrays[name], values), name
    assert np.array_equal(alone.points, grid.points)
    x = np.zeros((2000, 3))
    x[:, :2] = np.random.default_rng(1).uniform(-0.068, 0.068, (2000, 2)) * [1, 0.7]

    def velocity(p: np.ndarray) -> np.ndarray:
        return np.stack([p[:, 0], 0 * p[:, 0], 20 - 800 * (p[:, 0] ** 2 + p[:, 1] ** 2)], axis=1)

    field = gas(grid, velocity=velocity)
    np.testing.assert_allclose(seen(field, x), velocity(x), atol=6e-3 if shape == "round" else 1e-4)


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_a_place_between_mesh_and_round_wall_sees_the_wall(cell: str) -> None:
    """The mesh misses a sliver of the circle; the nearest cell carries on."""
    grid = gathered("round", cell).grid
    angle = np.linspace(-3.1, 3.1, 400)
    r = 0.1 * (1 - 1e-9)
    x = np.stack([r * np.sin(angle), r * np.cos(angle), 0 * angle], axis=1)
    field = gas(grid, velocity=lambda p: np.outer(1 - (p**2).sum(axis=1) / 0.01, [0, 0, 20.0]))
    assert np.abs(seen(field, x)[:, 2]).max() < 2e-2


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_straight_meshes_get_their_middles(cell: str) -> None:
    section = RectangularSection(0.2, 0.1, symmetry="quarter", wall_offset=1e-3)
    mesh = section_mesh(section, Resolution(level=2, cells=cell), MPI.COMM_SELF, order=1)
    grid, exact = Gathered.of(mesh).grid, gathered("rectangular", cell, alone=True).grid
    assert grid.points == pytest.approx(exact.points, abs=1e-12)
    assert np.array_equal(grid.nodes, exact.nodes)


def test_unknown_cells_are_refused() -> None:
    from dolfinx.mesh import create_interval

    from fem_tfm.models.particles.shapes import cell_of

    with pytest.raises(InputError, match="quadrilateral"):
        cell_of(create_interval(MPI.COMM_SELF, 2, (0.0, 1.0)))


@pytest.mark.parametrize("cell", [shapes.QUADRILATERAL, shapes.TRIANGLE], ids=["quad", "tri"])
def test_steep_positive_values_stay_positive_in_between(cell: shapes.Cell) -> None:
    at = cell.reference
    # linear values are kept by the weights of the vertices
    plane = 2.0 + at @ np.array([0.3, -0.4])
    assert cell.linear @ plane == pytest.approx(plane)
    # a value that falls twentyfold within a third of the cell undershoots with degree two
    low, high = at.min(), at.max()
    share = (at[:, 0] - low) / (high - low)
    steep = np.where(share > 0.9, 20.0, 1.0)
    table = np.stack([shapes.monomial(at, p) for p in ((0, 0), *cell.powers)], axis=1)
    some = low + (high - low) * np.array([[0.25, 0.0], [0.2, 0.1], [0.3, 0.05]])
    there = np.stack([shapes.monomial(some, p) for p in ((0, 0), *cell.powers)], axis=1)
    assert (there @ np.linalg.solve(table, steep)).min() < 0
    assert (there @ np.linalg.solve(table, cell.linear @ steep)).min() >= 1.0 - 1e-12


@pytest.mark.mpi
@pytest.mark.parametrize(("walls", "width"), [("none", 0.1), ("rectangle", 0.06)])
def test_the_width_is_that_of_all_parts(walls: str, width: float) -> None:
    """It is found once, so that one rank alone may look for what is near."""
    comm = MPI.COMM_WORLD
    kind, nodes, points = box((2, 1, 1), (0.3, 0.1, 0.1), "hexahedron")
    half = (0.03, 0.04) if walls == "rectangle" else (0.0, 0.0)
    aside = points + np.array([0.3 * comm.rank, 0.0, 0.0])
    # the last of several ranks holds no cells
    some = slice(0, len(nodes) if comm.rank < max(comm.size - 1, 1) else 0)
    nodes, aside = nodes[some], aside if some.stop else aside[:0]
    grid = Grid(kind, nodes, aside, Walls(walls, half), comm=comm)
    assert grid.width == pytest.approx(width)
    if comm.rank == 0:
        assert grid.nearest(np.array([[0.2, 0.0, 0.0]]))[1].tolist() == [1]

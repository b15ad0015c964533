# SPDX-License-Identifier: LGPL-3.0-or-later
"""Transfer between meshes and values at points: exactness, order, curved walls, ranks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from dolfinx import fem
from mpi4py import MPI

from fem_tfm.errors import InputError, SolverError
from fem_tfm.geometry.mesh import Mesh, extruded_mesh, section_mesh
from fem_tfm.geometry.resolution import Resolution
from fem_tfm.geometry.section import RectangularSection, RoundSection, Section
from fem_tfm.interpolation import point_values, transfer

RADIUS = 0.005
PIPE = RoundSection(2 * RADIUS)
Field = Callable[[np.ndarray], np.ndarray]


def section(
    part: Section, level: int, *, order: int = 2, layout: str | None = None, **given: Any
) -> Mesh:
    """Mesh of a section; further keywords are those of Resolution."""
    resolution = Resolution(level, **given)
    return section_mesh(part, resolution, MPI.COMM_WORLD, order=order, layout=layout)


def linear(x: np.ndarray) -> np.ndarray:
    return 1 + 2 * x[0] / RADIUS - 3 * x[1] / RADIUS


def vector(x: np.ndarray) -> np.ndarray:
    return np.stack([linear(x), -x[0] / RADIUS, 2 + x[1] / RADIUS])


def smooth(x: np.ndarray) -> np.ndarray:
    return np.sin(3 * x[0] / RADIUS) * np.cos(2 * x[1] / RADIUS)


def function(mesh: Mesh, field: Field | None, degree: int = 2, shape: tuple = ()) -> fem.Function:
    """Lagrange interpolant of `field`, zero for None."""
    found = fem.Function(fem.functionspace(mesh.mesh, ("Lagrange", degree, shape)))
    if field is not None:
        found.interpolate(field)
    return found


def distance(a: fem.Function, b: fem.Function) -> float:
    """Largest difference of nodal values on all ranks."""
    far = np.abs(a.x.array - b.x.array).max() if len(a.x.array) else 0.0
    return float(MPI.COMM_WORLD.allreduce(far, MPI.MAX))


@pytest.mark.mpi
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(("coarse", "fine"), [(1, 3), (3, 1), (2, 2), (3, 4)])
def test_linear_functions_are_exact(coarse: int, fine: int, order: int) -> None:
    source, target = (section(PIPE, level, order=order) for level in (coarse, fine))
    found = transfer(function(source, linear), function(target, None))
    assert distance(found, function(target, linear)) < 1e-12


@pytest.mark.mpi
@pytest.mark.parametrize("degree", [1, 2])
def test_vectors_and_degrees(degree: int) -> None:
    square = RectangularSection(0.01, 0.01)
    source, target = section(square, 1), section(square, 2)
    found = transfer(function(source, vector, degree, (3,)), function(target, None, 2, (3,)))
    assert distance(found, function(target, vector, 2, (3,))) < 1e-12


@pytest.mark.parametrize("degree", [1, 2])
def test_order_of_the_error(degree: int) -> None:
    target = section(PIPE, 5, layout="free", wall_grading=1.0)
    exact = function(target, smooth, degree)
    errors, sizes = [], []
    for level in (2, 4, 6):
        source = section(PIPE, level)
        found = transfer(function(source, smooth, degree), function(target, None, degree))
        errors.append(np.sqrt(np.mean((found.x.array - exact.x.array) ** 2)))
        sizes.append(source.size)
    assert np.polyfit(np.log(sizes), np.log(errors), 1)[0] > degree + 0.8


@pytest.mark.parametrize("layouts", [("o-grid", "free"), ("free", "o-grid")])
@pytest.mark.parametrize("cells", ["triangle", "quadrilateral"])
def test_other_layouts_and_cells(layouts: tuple[str, str], cells: str) -> None:
    built = [
        section(PIPE, 2, layout=layout, cells="triangle" if layout == "free" else cells)
        for layout in layouts
    ]
    found = transfer(function(built[0], linear), function(built[1], None))
    assert distance(found, function(built[1], linear)) < 1e-12


def test_polygon_to_circle_and_back() -> None:
    straight, curved = section(PIPE, 1, order=1), section(PIPE, 1, order=2)
    for source, target in ((straight, curved), (curved, straight)):
        found = transfer(function(source, linear), function(target, None))
        assert distance(found, function(target, linear)) < 1e-12


def test_transfer_between_pipes() -> None:
    source, target = (
        extruded_mesh(PIPE, Resolution(1), 0.02, layers, MPI.COMM_WORLD) for layers in (1, 2)
    )
    found = transfer(function(source, linear, 2), function(target, None, 2))
    assert distance(found, function(target, linear, 2)) < 1e-12


@pytest.mark.mpi
def test_transfer_from_another_region_is_refused() -> None:
    source, target = section(PIPE, 1), section(RoundSection(4 * RADIUS), 1)
    with pytest.raises(SolverError, match="nodes are too far outside"):
        transfer(function(source, linear), function(target, None))


def test_transfer_of_another_shape_is_refused() -> None:
    mesh = section(PIPE, 1)
    with pytest.raises(InputError, match="shape"):
        transfer(function(mesh, linear), function(mesh, None, 2, (3,)))


@pytest.mark.mpi
@pytest.mark.parametrize("order", [1, 2])
def test_point_values(order: int) -> None:
    mesh = section(PIPE, 2, order=order)
    s = np.linspace(-1, 1, 21)
    points = np.concatenate([np.stack([0 * s, s], 1), np.stack([np.abs(s), 0 * s], 1)]) * RADIUS
    several = [function(mesh, linear), function(mesh, vector, 2, (3,))]
    scalar, triple = point_values(several, points)
    np.testing.assert_allclose(scalar, linear(points.T), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(triple, vector(points.T).T, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(point_values(several[0], points), scalar)


@pytest.mark.mpi
def test_points_outside_are_nan() -> None:
    mesh = section(PIPE, 1)
    points = np.array([[0.5, 0, 0], [1.5, 0, 0], [-0.5, 0, 0], [1.001, 0, 0]]) * RADIUS
    found = point_values(function(mesh, linear), points)
    np.testing.assert_array_equal(np.isnan(found), [False, True, True, False])
    strict = point_values(function(mesh, linear), points, tolerance=1e-4 * RADIUS)
    np.testing.assert_array_equal(np.isnan(strict), [False, True, True, True])


def test_points_on_the_wall_of_a_polygon() -> None:
    mesh = section(PIPE, 3, order=1)
    angle = np.linspace(-np.pi / 2, np.pi / 2, 91)
    points = RADIUS * np.stack([np.cos(angle), np.sin(angle)], 1)
    found = point_values(function(mesh, linear), points)
    np.testing.assert_allclose(found, linear(points.T), rtol=1e-12, atol=1e-12)


def test_order_of_point_values() -> None:
    points = np.random.default_rng(1).uniform(0, RADIUS / 2**0.5, (200, 2))
    errors, sizes = [], []
    for level in (1, 3, 5):
        mesh = section(PIPE, level)
        found = point_values(function(mesh, smooth), points)
        errors.append(np.sqrt(np.mean((found - smooth(points.T)) ** 2)))
        sizes.append(mesh.size)
    assert np.polyfit(np.log(sizes), np.log(errors), 1)[0] > 2.8


def test_no_points_and_no_functions() -> None:
    mesh = section(PIPE, 1)
    assert point_values(function(mesh, linear), np.empty((0, 2))).shape == (0,)
    assert point_values([], [[0.0, 0.0]]) == []


@pytest.mark.parametrize("points", [[0.0, 0.0], [[0.0]], [[[0.0, 0.0]]]])
def test_points_of_another_shape_are_refused(points: list) -> None:
    with pytest.raises(InputError, match="points"):
        point_values(function(section(PIPE, 1), linear), points)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes: sizes against formulas, names of the parts, symmetry, grading, files, bad input."""

from __future__ import annotations

import builtins
import math
import signal
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import dolfinx
import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI
from scipy.spatial import cKDTree

from fem_tfm import mesh as meshes
from fem_tfm.case import Case
from fem_tfm.errors import InputError, SolverError
from fem_tfm.interpolation import point_values
from fem_tfm.mesh import (
    Bend,
    DuctGeometry,
    Geometry,
    Mesh,
    PipeGeometry,
    extruded,
    line,
    line_cells,
    section,
    write,
    write_case_mesh,
)

RADIUS = 0.005
PIPE = PipeGeometry(2 * RADIUS)
DUCT = DuctGeometry(0.02, 0.01)
LENGTH = 0.03
SYMMETRIES = ("half", "quarter", "none")


def integral(mesh: Mesh, name: str | None = None) -> float:
    """Volume of the cells, or area of the facets called `name`."""
    one = fem.Constant(mesh.mesh, 1.0)
    ds = ufl.Measure("ds", mesh.mesh, subdomain_data=mesh.facet_tags)
    measure = ufl.Measure("dx", mesh.mesh) if name is None else ds(mesh.tags[name])
    return float(mesh.mesh.comm.allreduce(fem.assemble_scalar(fem.form(one * measure))))


def jacobians(mesh: Mesh) -> np.ndarray:
    """|det J| at a lattice of points of each cell, negative where a cell is folded."""
    lattice = fem.functionspace(mesh.mesh, ("DG", 3)).element.interpolation_points
    table = fem.Expression(ufl.JacobianDeterminant(mesh.mesh), lattice)
    cells = np.arange(mesh.num_cells, dtype=np.int32)
    values = table.eval(mesh.mesh, cells).reshape(len(cells), -1)
    return values * np.sign(values[:, :1])


def nodes(mesh: Mesh, name: str) -> np.ndarray:
    """Coordinates of the geometry nodes on the facets called `name`, shape (n, 3)."""
    space = fem.functionspace(mesh.mesh, ("Lagrange", mesh.mesh.section.cmaps[0].degree))
    dim = mesh.mesh.topology.dim - 1
    dofs = fem.locate_dofs_topological(space, dim, mesh.facets(name))
    return space.tabulate_dof_coordinates()[dofs]


def slope(sizes: list[float], errors: list[float]) -> float:
    """Observed order of convergence."""
    return float(np.polyfit(np.log(sizes), np.log(errors), 1)[0])


@pytest.mark.parametrize("symmetry", SYMMETRIES)
@pytest.mark.parametrize("cells", ["triangle", "quadrilateral"])
def test_pipe_area_and_perimeter(symmetry: str, cells: str) -> None:
    geometry = PipeGeometry(2 * RADIUS, symmetry)
    mesh = section(geometry, 3, cells=cells)
    whole = math.pi * RADIUS**2
    assert geometry.area == pytest.approx(whole)
    assert geometry.area_factor * integral(mesh) == pytest.approx(whole, rel=1e-5)
    wall = geometry.area_factor * integral(mesh, "wall")
    assert wall == pytest.approx(geometry.perimeter, rel=1e-5)
    assert geometry.hydraulic_diameter == pytest.approx(4 * geometry.area / geometry.perimeter)


@pytest.mark.parametrize(("order", "expected"), [(1, 2.0), (2, 4.0)])
def test_order_of_the_curved_wall(order: int, expected: float) -> None:
    built = [section(PIPE, level, order=order) for level in (1, 3, 5)]
    errors = [abs(integral(mesh) - PIPE.meshed_area) for mesh in built]
    assert slope([mesh.size for mesh in built], errors) == pytest.approx(expected, abs=0.1)


@pytest.mark.parametrize("layout", PipeGeometry.layouts)
@pytest.mark.parametrize("order", [1, 2])
def test_wall_nodes_are_on_the_circle(order: int, layout: str) -> None:
    x = nodes(section(PIPE, 1, order=order, layout=layout), "wall")
    assert len(x) > 8
    np.testing.assert_allclose(np.hypot(x[:, 0], x[:, 1]), RADIUS, rtol=1e-12)


@pytest.mark.parametrize("symmetry", SYMMETRIES)
def test_duct_area_and_perimeter(symmetry: str) -> None:
    geometry = DuctGeometry(0.02, 0.01, symmetry)
    mesh = section(geometry, 2)
    assert geometry.area_factor * integral(mesh) == pytest.approx(2e-4, rel=1e-12)
    assert geometry.area_factor * integral(mesh, "wall") == pytest.approx(0.06, rel=1e-12)
    assert geometry.hydraulic_diameter == pytest.approx(4 * 2e-4 / 0.06)


def test_duct_with_wall_offset() -> None:
    geometry = DuctGeometry(0.02, 0.01, "half", wall_offset=5e-4)
    mesh = section(geometry, 2)
    assert geometry.area == pytest.approx(2e-4)
    assert integral(mesh) == pytest.approx(0.019 * 0.009 / 2, rel=1e-12)
    assert geometry.meshed_area == pytest.approx(integral(mesh))
    wall = nodes(mesh, "wall").T
    wall = wall[:, np.hypot(wall[0] - 0.01, np.abs(wall[1]) - 0.005) > 4e-3]
    np.testing.assert_allclose(geometry.wall_distance(wall), 5e-4, rtol=1e-3)


@pytest.mark.parametrize(
    ("geometry", "names"),
    [
        (PipeGeometry(0.01, "none"), {"fluid", "wall"}),
        (PipeGeometry(0.01, "half"), {"fluid", "wall", "symmetry"}),
        (PipeGeometry(0.01, "quarter"), {"fluid", "wall", "symmetry_x", "symmetry_y"}),
        (DuctGeometry(0.02, 0.01, "none"), {"fluid", "wall"}),
        (DuctGeometry(0.02, 0.01, "half"), {"fluid", "wall", "symmetry"}),
        (DuctGeometry(0.02, 0.01, "quarter"), {"fluid", "wall", "symmetry_x", "symmetry_y"}),
    ],
)
@pytest.mark.parametrize("length", [None, LENGTH])
def test_tags_are_complete_and_disjoint(
    geometry: Geometry, names: set[str], length: float | None
) -> None:
    solid = length is not None
    mesh = extruded(geometry, LENGTH, 2, 1) if solid else section(geometry, 1)
    assert set(mesh.tags) == names | ({"inlet", "outlet"} if solid else set())
    assert len(set(mesh.tags.values())) == len(mesh.tags)
    exterior = dolfinx.mesh.exterior_facet_indices(mesh.mesh.topology)
    np.testing.assert_array_equal(np.sort(mesh.facet_tags.indices), np.sort(exterior))
    assert set(mesh.facet_tags.values) == {mesh.tags[n] for n in mesh.tags if n != "fluid"}
    assert set(mesh.cell_tags.values) == {mesh.tags["fluid"]}
    assert len(mesh.cell_tags.indices) == mesh.num_cells


@pytest.mark.parametrize("geometry", [PipeGeometry(0.01, "quarter"), PIPE, DUCT])
def test_each_part_is_where_its_name_says(geometry: Geometry) -> None:
    mesh = extruded(geometry, LENGTH, 2, 1)
    planes = {"symmetry": (0, 0.0), "symmetry_x": (0, 0.0), "symmetry_y": (1, 0.0)}
    planes |= {"inlet": (2, 0.0), "outlet": (2, LENGTH)}
    for name in set(planes) & set(mesh.tags):
        axis, value = planes[name]
        np.testing.assert_allclose(nodes(mesh, name)[:, axis], value, atol=1e-15)
    assert np.all(geometry.wall_distance(nodes(mesh, "wall").T) <= 1e-8 * geometry.radius)
    assert len(mesh.facets("no such part")) == 0


@pytest.mark.parametrize("kind", [PipeGeometry, DuctGeometry])
def test_whole_is_the_half_and_its_mirror_image(kind: type) -> None:
    lengths = (0.01,) if kind is PipeGeometry else (0.02, 0.01)
    half, whole = (section(kind(*lengths, symmetry), 2) for symmetry in ("half", "none"))
    tree = cKDTree(whole.mesh.section.x)
    images = [half.mesh.section.x * [side, 1, 1] for side in (1, -1)]
    matches = [tree.query(image) for image in images]
    assert max(gap.max() for gap, _ in matches) < 1e-8 * RADIUS
    assert len(np.unique([row for _, rows in matches for row in rows])) == tree.n
    assert whole.num_cells == 2 * half.num_cells


@pytest.mark.parametrize("symmetry", SYMMETRIES)
@pytest.mark.parametrize("kind", [PipeGeometry, DuctGeometry])
def test_no_triangle_has_two_edges_on_walls(kind: type, symmetry: str) -> None:
    lengths = (0.01,) if kind is PipeGeometry else (0.01, 0.01)
    mesh = section(kind(*lengths, symmetry), 2)
    mesh.mesh.topology.create_connectivity(1, 2)
    cells = mesh.mesh.topology.connectivity(1, 2)
    owners = np.concatenate([cells.links(facet) for facet in mesh.facets("wall")])
    assert np.unique(owners, return_counts=True)[1].max() == 1


def test_no_triangle_touches_wall_and_symmetry_plane_of_a_pipe_with_an_edge_each() -> None:
    mesh = section(PIPE, 2)
    mesh.mesh.topology.create_connectivity(1, 2)
    cells = mesh.mesh.topology.connectivity(1, 2)
    wall, plane = (
        {int(c) for f in mesh.facets(n) for c in cells.links(f)} for n in ("wall", "symmetry")
    )
    assert wall and plane and not wall & plane


@pytest.mark.parametrize("ratio", [1.0, 0.25, 0.02])
def test_grading_of_a_pipe(ratio: float) -> None:
    mesh = section(PIPE, 3, wall_ratio=ratio, order=1)
    x = mesh.mesh.section.x
    axis = np.sort(x[(np.abs(x[:, 0]) < 1e-12) & (x[:, 1] >= 0), 1])
    steps = np.diff(axis)
    assert steps[-1] == pytest.approx(ratio * mesh.size, rel=1e-6)
    assert steps[0] == pytest.approx(mesh.size, rel=1e-6)
    layers = steps[axis[:-1] >= 0.5 * RADIUS - 1e-9]
    growth = layers[:-1] / layers[1:]
    np.testing.assert_allclose(growth, growth[0], rtol=1e-6)
    assert growth[0] < 1.8 and layers[0] < 1.5 * mesh.size


@pytest.mark.parametrize("ratio", [1.0, 0.25, 0.02])
def test_grading_of_a_duct(ratio: float) -> None:
    mesh = section(DUCT, 3, wall_ratio=ratio)
    for axis, half in ((0, DUCT.width / 2), (1, DUCT.height / 2)):
        x = mesh.mesh.section.x[:, axis] / half
        lines = np.unique(np.round(x, 9))
        # every second coordinate is a mid-side node
        steps = np.diff(lines[lines > -1e-9][::2]) * half
        assert steps[-1] == pytest.approx(ratio * mesh.size, rel=0.1 if ratio == 1 else 1e-5)
        assert steps[0] < 1.4 * mesh.size


def test_layers_along_a_curved_wall_are_even() -> None:
    mesh = section(PIPE, 1, wall_ratio=0.02)
    x = mesh.mesh.section.x
    r = np.unique(np.round(np.hypot(x[:, 0], x[:, 1]) / RADIUS, 7))
    # wall, middle of the wall cell, its inner side: nothing between them
    thickness = 0.02 * mesh.size / RADIUS
    np.testing.assert_allclose(r[-3:], [1 - thickness, 1 - thickness / 2, 1], atol=2e-7)


def test_free_triangles_are_finer_at_the_wall() -> None:
    mesh = section(PIPE, size=1e-3, layout="free", wall_ratio=0.25)
    cells = np.arange(mesh.num_cells, dtype=np.int32)
    sizes = mesh.mesh.h(2, cells)
    middle = dolfinx.mesh.compute_midpoints(mesh.mesh, 2, cells)
    r = np.hypot(middle[:, 0], middle[:, 1]) / RADIUS
    assert np.median(sizes[r > 0.93]) == pytest.approx(0.25e-3, rel=0.3)
    assert np.median(sizes[r < 0.2]) == pytest.approx(1e-3, rel=0.3)


@pytest.mark.parametrize("ratio", [1.0, 0.25, 0.005])
@pytest.mark.parametrize("cells", ["triangle", "quadrilateral"])
def test_no_cell_is_folded_or_badly_bent(cells: str, ratio: float) -> None:
    for level in (1, 3):
        values = jacobians(section(PIPE, level, cells=cells, wall_ratio=ratio))
        assert (values.min(axis=1) / values.max(axis=1)).min() > 0.3


def test_levels_double_the_cells() -> None:
    built = [section(PIPE, level) for level in (1, 2, 3, 4, 5)]
    assert [mesh.num_cells for mesh in built] == [80, 180, 320, 720, 1216]
    assert built[0].size / built[2].size == pytest.approx(2)
    assert built[2].size / built[4].size == pytest.approx(2)
    assert section(PIPE, size=built[2].size).num_cells == 320


@pytest.mark.parametrize("diameter", [1e-4, 10.0])
def test_size_of_the_pipe_does_not_matter(diameter: float) -> None:
    geometry = PipeGeometry(diameter)
    mesh = extruded(geometry, 2 * diameter, 2, 1)
    assert mesh.num_cells == 80 * 2 * 3
    assert integral(mesh) == pytest.approx(geometry.meshed_area * 2 * diameter, rel=1e-4)


@pytest.mark.parametrize("geometry", [PIPE, PipeGeometry(0.01, "none"), DUCT])
@pytest.mark.parametrize(("cells", "per_cell"), [("triangle", 3), ("quadrilateral", 1)])
def test_extruded(geometry: Geometry, cells: str, per_cell: int) -> None:
    flat = section(geometry, 2, cells=cells)
    mesh = extruded(geometry, LENGTH, 3, 2, cells=cells)
    assert mesh.length == LENGTH and mesh.size == flat.size
    assert mesh.num_cells == 3 * per_cell * flat.num_cells
    assert integral(mesh) == pytest.approx(geometry.meshed_area * LENGTH, rel=2e-5)
    wall = geometry.perimeter / geometry.area_factor * LENGTH
    assert integral(mesh, "wall") == pytest.approx(wall, rel=2e-5)
    for end in ("inlet", "outlet"):
        assert integral(mesh, end) == pytest.approx(geometry.meshed_area, rel=2e-5)
    values = jacobians(mesh)
    assert (values.min(axis=1) / values.max(axis=1)).min() > 0.3


# -- bends -------------------------------------------------------------------------------------

TURNS = [("up", 30.0), ("up", 90.0), ("down", 90.0), ("side", 120.0), ("down", 180.0)]


def bend(towards: str, degrees: float) -> Bend:
    return Bend(4 * RADIUS, math.radians(degrees), RADIUS, towards)


@pytest.mark.parametrize(("towards", "degrees"), TURNS)
def test_a_bend_moves_points_there_and_back(towards: str, degrees: float) -> None:
    arc = bend(towards, degrees)
    x = np.random.default_rng(1).uniform(-RADIUS, RADIUS, (200, 3))
    x[:, 2] = np.linspace(0, arc.end + 3 * RADIUS, len(x))
    there = arc.bent(x)
    np.testing.assert_allclose(arc.straightened(there), x, atol=1e-15)
    before = x[:, 2] <= arc.before
    np.testing.assert_allclose(there[before], x[before], atol=1e-17)
    # distances along the normal of the axis's plane, and to the axis, are kept
    binormal = np.cross(arc.normal, [0, 0, 1])
    np.testing.assert_allclose(there @ binormal, x @ binormal, atol=1e-17)
    axis = arc.bent(x * [0, 0, 1])
    assert np.linalg.norm(there - axis, axis=1) == pytest.approx(np.hypot(*x[:, :2].T), abs=1e-15)


@pytest.mark.parametrize(("towards", "degrees"), TURNS)
def test_the_axis_of_a_bend_has_its_length_and_direction(towards: str, degrees: float) -> None:
    arc, step = bend(towards, degrees), 1e-7
    s = np.linspace(0, arc.end + 3 * RADIUS, 7)
    x = arc.bent(np.column_stack([0 * s, 0 * s, s]))
    ahead = arc.bent(np.column_stack([0 * s, 0 * s, s + step]))
    np.testing.assert_allclose((ahead - x) / step, arc.axis(x), atol=1e-5)
    last = arc.axis(x[-1:])[0]
    assert last @ [0, 0, 1] == pytest.approx(math.cos(math.radians(degrees)))
    assert last @ arc.normal == pytest.approx(math.sin(math.radians(degrees)))


@pytest.mark.parametrize("cells", ["triangle", "quadrilateral"])
@pytest.mark.parametrize(("geometry", "towards"), [(PIPE, "up"), (DUCT, "down")])
def test_a_bent_line_is_as_large_as_a_straight_one(
    geometry: Geometry, towards: str, cells: str
) -> None:
    arc = bend(towards, 90.0)
    length = arc.end + RADIUS
    mesh = extruded(geometry, length, 16, 2, cells=cells, bend=arc)
    # Pappus: centroids lie on the axis
    assert integral(mesh) == pytest.approx(geometry.meshed_area * length, rel=1e-4)
    wall = geometry.perimeter / geometry.area_factor * length
    assert integral(mesh, "wall") == pytest.approx(wall, rel=1e-4)
    for end in ("inlet", "outlet"):
        assert integral(mesh, end) == pytest.approx(geometry.meshed_area, rel=2e-5)
    values = jacobians(mesh)
    assert (values.min(axis=1) / values.max(axis=1)).min() > 0.2
    outlet = nodes(mesh, "outlet")
    assert outlet @ arc.normal == pytest.approx(arc.radius + RADIUS)
    assert np.all(mesh.distance_at(nodes(mesh, "wall")) < 1e-3 * RADIUS)
    with pytest.raises(ValueError, match="bend"):
        mesh.wall_distance()


@pytest.mark.parametrize(
    ("build", "named"),
    [
        (lambda: Bend(0.0, 1.0, 0.0), "bend_radius"),
        (lambda: Bend(1.0, 3.2, 0.0), "bend_angle_deg"),
        (lambda: Bend(1.0, 1.0, -1.0), "bend_start"),
        (lambda: Bend(1.0, 1.0, 0.0, "left"), "bend_towards"),
        (lambda: extruded(PIPE, 1.0, 4, bend=Bend(RADIUS, 1.0, 0.0)), "bend_radius"),
        (lambda: extruded(PIPE, 1.0, 4, bend=Bend(1.0, 1.1, 0.0)), "geometry.length"),
        (lambda: extruded(PIPE, 1.0, 4, bend=Bend(0.1, 1.0, 0.0, "side")), "symmetry"),
        (
            lambda: extruded(PipeGeometry(0.01, "quarter"), 1.0, 4, bend=Bend(0.1, 1.0, 0.0)),
            "symmetry",
        ),
    ],
)
def test_a_bend_that_cannot_be_is_refused(build: Any, named: str) -> None:
    with pytest.raises(InputError, match=named):
        build()


def line_case(**geometry: Any) -> Case:
    return Case.from_dict(
        {
            "solution": "unsteady",
            "geometry": {"shape": "bend", "diameter": 0.01, "length": 0.1, **geometry},
            "gas": {"density": 1.2, "viscosity": 1.8e-5},
            "operation": {"gas_superficial_velocity": 1.0},
            "numerics": {"end_time": 1.0, "level": 1},
        }
    )


@pytest.mark.parametrize("towards", ["up", "down", "side", None])
def test_the_vertical_plane_of_a_line(towards: str | None) -> None:
    bends = {"shape": "pipe"} if towards is None else {"bend_towards": towards}
    mesh = line(line_case(**bends))
    points, drawn = mesh.plane(6, 40)
    flat = points.reshape(-1, 3)
    straight = mesh.straightened(flat).reshape(points.shape)
    np.testing.assert_allclose(straight[..., 0], 1e-8, rtol=1e-6)
    assert np.all(mesh.distance_at(flat) > RADIUS / 7)
    assert straight[3, :, 1] == pytest.approx(RADIUS / 6)
    assert straight[0, [0, -1], 2] == pytest.approx([0.1 / 80, 0.1 - 0.1 / 80])
    where = straight if towards == "side" else points
    np.testing.assert_allclose(drawn, where[..., [2, 1]], atol=1e-15)
    # all of them lie in the mesh: a function of place has its value there
    space = fem.functionspace(mesh.mesh, ("Lagrange", 1))
    height = fem.Function(space)
    height.interpolate(lambda x: x[1])
    found = point_values(height, flat, tolerance=1e-4 * RADIUS)
    np.testing.assert_allclose(found, flat[:, 1], atol=1e-9)


@pytest.mark.parametrize("towards", ["up", "side"])
def test_the_line_of_a_case(towards: str) -> None:
    case = line_case(bend_towards=towards)
    mesh = line(case)
    assert mesh.mesh.topology.cell_type.name == "hexahedron"
    assert mesh.num_cells == line_cells(case)
    assert ("symmetry" in mesh.tags) == (towards == "up")
    assert mesh.bend.end == pytest.approx(sum(case.geometry.legs[:2]))
    s = mesh.straightened(nodes(mesh, "outlet"))[:, 2]
    assert s == pytest.approx(0.1)
    tangent = mesh.axis(nodes(mesh, "outlet"))
    np.testing.assert_allclose(tangent, np.tile(mesh.bend.normal, (len(tangent), 1)), atol=1e-12)
    # edges are straight, so a little of the section is cut off
    whole = mesh.geometry.meshed_area * 0.1
    assert 0.96 * whole < integral(mesh) < whole


def test_axial_cells_of_a_case() -> None:
    case = line_case(shape="pipe")
    other = case.with_values({"numerics.axial_cells": 7})
    assert line_cells(other) == 7 * line_cells(case) / round(0.1 / (2 * 0.01 / 8))
    straight = line(other)
    assert straight.bend is None and straight.num_cells == line_cells(other)


def test_the_line_of_a_case_is_written(tmp_path: Path) -> None:
    meshio = pytest.importorskip("meshio")
    write_case_mesh(line_case(), tmp_path / "bend.vtu")
    found = meshio.read(tmp_path / "bend.vtu")
    assert len(found.cells_dict["hexahedron"]) == line_cells(line_case())
    assert found.points[:, 1].max() > 0.03


# -- wall distance -----------------------------------------------------------------------------


def test_wall_distance_of_a_pipe() -> None:
    x = np.array([[0, 0.001, -0.003, RADIUS, 1.01 * RADIUS], [0, 0.002, 0.004 - 1e-6, 0, 0]])
    exact = RADIUS - np.hypot(*x)
    found = PIPE.wall_distance(x)
    np.testing.assert_allclose(found[1:3], exact[1:3], atol=1e-6 * RADIUS)
    assert found[0] == pytest.approx(RADIUS, rel=2e-6)
    assert np.all(found[3:] > 0) and np.all(found[3:] < 1e-8 * RADIUS)


def test_wall_distance_of_a_duct() -> None:
    square = DuctGeometry(0.02, 0.02, "none")
    near = 0.01 - np.array([1e-6, 1e-4, 1e-3])
    for x in ([near, 0 * near], [0 * near, -near], [near, 0 * near + 2e-3]):
        np.testing.assert_allclose(square.wall_distance(np.array(x)), 0.01 - near, rtol=1e-3)
    assert square.wall_distance(np.zeros((2, 1))) == pytest.approx(0.01 / 2**0.25, rel=3e-3)
    corner = square.wall_distance(np.full((2, 1), 0.01))
    assert 0 < corner[0] < 1e-8
    line = np.array([[0.004] * 5, [0.006, 0.0062, 0.0064, 0.0066, 0.0068]])
    assert np.all(np.diff(square.wall_distance(line)) < 0)


@pytest.mark.parametrize("geometry", [PIPE, DUCT])
def test_wall_distance_in_forms_is_that_of_arrays(geometry: Geometry) -> None:
    mesh = section(geometry, 2)
    space = fem.functionspace(mesh.mesh, ("Lagrange", 2))
    found = fem.Function(space)
    found.interpolate(fem.Expression(mesh.wall_distance(), space.element.interpolation_points))
    expected = geometry.wall_distance(space.tabulate_dof_coordinates().T)
    np.testing.assert_allclose(found.x.array, expected, rtol=1e-10, atol=1e-12)
    assert found.x.array.min() > 0


def test_lengths_are_no_literals_in_forms() -> None:
    distances = [section(PipeGeometry(d), 1).wall_distance() for d in (0.01, 0.02)]
    literals = [{float(v) for v in _literals(d)} for d in distances]
    assert literals[0] == literals[1]


def _literals(expression: Any) -> list[Any]:
    """Numbers written into a UFL expression."""
    from ufl.constantvalue import ScalarValue
    from ufl.corealg.traversal import unique_pre_traversal

    return [node for node in unique_pre_traversal(expression) if isinstance(node, ScalarValue)]


@pytest.mark.mpi
@pytest.mark.parametrize("build", [section, lambda g, level: extruded(g, LENGTH, 2, level)])
def test_ghosts_across_facets(build: Any) -> None:
    mesh = build(PIPE, 2)
    topology, comm = mesh.mesh.topology, mesh.mesh.comm
    dim = topology.dim
    topology.create_connectivity(dim - 1, dim)
    neighbours = topology.connectivity(dim - 1, dim)
    owned = topology.index_map(dim - 1).size_local
    # every owned facet sees both its cells, so those with one are the tagged boundary
    single = {f for f in range(owned) if len(neighbours.links(f)) == 1}
    tagged = {int(f) for f in mesh.facet_tags.indices if f < owned}
    assert single == tagged
    assert comm.size == 1 or comm.allreduce(topology.index_map(dim).num_ghosts) > 0
    assert integral(mesh, "wall") == pytest.approx(
        math.pi * RADIUS * (1 if dim == 2 else LENGTH), rel=1e-4
    )


@pytest.mark.mpi
def test_bad_input_is_refused_on_every_rank() -> None:
    with pytest.raises(InputError, match=r"numerics\.level"):
        section(PIPE, 0)


@pytest.mark.mpi
def test_failure_of_gmsh_is_raised_on_every_rank(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(meshes, "_script", lambda name: Path("/no/such/script.geo"))
    with pytest.raises(SolverError, match="no mesh"):
        section(PIPE, 1)


def test_missing_system_library_is_one_clear_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    original = builtins.__import__

    def refuse(name: str, *args: Any, **kwargs: Any) -> Any:
        if name == "gmsh":
            raise OSError("libGLU.so.1: cannot open shared object file")
        return original(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", refuse)
    with pytest.raises(SolverError, match=r"libGLU\.so\.1.*libglu1-mesa"):
        section(PIPE, 1)


def test_interrupts_still_reach_python() -> None:
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    section(PIPE, 1)
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before


def test_gmsh_of_the_user_is_left_alone() -> None:
    import gmsh

    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("of the user")
        order = gmsh.option.getNumber("Mesh.ElementOrder")
        counts = [section(PIPE, level).num_cells for level in (1, 2)]
        counts += [section(DUCT, level).num_cells for level in (1, 1)]
        assert counts == [80, 180, counts[2], counts[2]]
        assert gmsh.model.getCurrent() == "of the user"
        assert gmsh.option.getNumber("Mesh.ElementOrder") == order
        assert gmsh.isInitialized()
    finally:
        gmsh.finalize()


@pytest.mark.parametrize("name", ["pipe", "duct"])
def test_scripts_open_in_gmsh_as_they_are(name: str, root: Path) -> None:
    import gmsh

    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(root / "meshes" / f"{name}.geo"))
        gmsh.model.mesh.generate(2)
        kinds, tags, _ = gmsh.model.mesh.getElements(2)
        assert list(kinds) == [9] and len(tags[0]) > 100
        names = {gmsh.model.getPhysicalName(*group) for group in gmsh.model.getPhysicalGroups()}
        assert names == {"fluid", "wall", "symmetry"}
    finally:
        gmsh.finalize()


@pytest.mark.parametrize("cells", ["triangle", "quadrilateral"])
@pytest.mark.parametrize("suffix", meshes.SUFFIXES)
@pytest.mark.parametrize("length", [None, LENGTH])
def test_files_hold_the_mesh(tmp_path: Path, suffix: str, cells: str, length: float | None) -> None:
    import meshio

    path = tmp_path / f"pipe{suffix}"
    write(PIPE, path, 1, cells=cells, length=length, layers=2)
    if length is None:
        built = section(PIPE, 1, cells=cells)
    else:
        built = extruded(PIPE, length, 2, 1, cells=cells)
    dim = built.mesh.topology.dim
    read = meshio.read(path)
    assert sum(len(b.data) for b in read.cells if b.dim == dim) == built.num_cells
    key = "gmsh:physical" if suffix == ".msh" else "tag"
    tags = {int(t) for values in read.cell_data[key] for t in values}
    if suffix == ".xdmf":
        facets = meshio.read(tmp_path / "pipe_facets.xdmf")
        tags |= {int(t) for values in facets.cell_data[key] for t in values}
    assert tags == set(built.tags.values())


def test_msh_file_keeps_the_names(tmp_path: Path) -> None:
    import meshio

    write(PIPE, tmp_path / "pipe.msh", 1)
    assert set(meshio.read(tmp_path / "pipe.msh").field_data) == {"fluid", "wall", "symmetry"}


@pytest.mark.mpi
def test_dolfinx_reads_the_xdmf_file(tmp_path: Path) -> None:
    comm = MPI.COMM_WORLD
    write(PIPE, tmp_path / "pipe.xdmf", 2)
    with dolfinx.io.XDMFFile(comm, tmp_path / "pipe.xdmf", "r") as file:
        mesh = file.read_mesh(name="Grid")
    mesh.topology.create_connectivity(1, 2)
    with dolfinx.io.XDMFFile(comm, tmp_path / "pipe_facets.xdmf", "r") as file:
        tags = file.read_meshtags(mesh, name="Grid")
    built = section(PIPE, 2)
    found = Mesh(mesh, built.cell_tags, tags, built.tags, PIPE, built.size)
    assert integral(found) == pytest.approx(integral(built), rel=1e-12)
    for name in ("wall", "symmetry"):
        assert integral(found, name) == pytest.approx(integral(built, name), rel=1e-12)


def _case(**geometry: Any) -> Case:
    return Case.from_dict(
        {
            "geometry": geometry or {"diameter": 0.01},
            "gas": {"density": 1.2, "viscosity": 1.8e-5},
            "operation": {"gas_superficial_velocity": 1.0},
            "numerics": {"level": 1},
        }
    )


def test_mesh_of_a_case(tmp_path: Path) -> None:
    import meshio

    case = _case()
    meshes.write_case_mesh(case, tmp_path / "case.vtu")
    cells = sum(len(b.data) for b in meshio.read(tmp_path / "case.vtu").cells if b.dim == 2)
    built = section(meshes.geometry_of(case), **meshes.resolution_of(case))
    assert cells == built.num_cells == 80
    graded = case.with_values({"numerics.wall_grading": 0.1})
    assert section(PIPE, **meshes.resolution_of(graded)).num_cells > 80


def test_geometry_of_a_case() -> None:
    whole = _case(diameter=0.01, symmetry="none")
    assert meshes.geometry_of(whole) == PipeGeometry(0.01, "none")
    duct = _case(shape="duct", width=0.03)
    assert meshes.geometry_of(duct) == DuctGeometry(0.03, 0.03, "half")
    flat = duct.with_values({"geometry.height": 0.01})
    assert meshes.geometry_of(flat) == DuctGeometry(0.03, 0.01, "half")
    cone = SimpleNamespace(geometry=SimpleNamespace(shape="cone"))
    with pytest.raises(InputError, match=r"geometry\.shape .*'pipe', 'duct'"):
        meshes.geometry_of(cone)


@pytest.mark.parametrize("name", ["pipe.stl", "pipe", "pipe.xdm"])
def test_unknown_suffix_lists_the_known_ones(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"\.msh, \.xdmf, \.vtu"):
        write(PIPE, tmp_path / name, 1)
    assert not list(tmp_path.iterdir())


def test_missing_directory(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="directory that exists"):
        write(PIPE, tmp_path / "none" / "pipe.msh", 1)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: PipeGeometry(0), "geometry.diameter = 0"),
        (lambda: PipeGeometry(float("nan")), "geometry.diameter = nan"),
        (lambda: PipeGeometry("1"), "geometry.diameter = '1'"),
        (lambda: PipeGeometry(0.01, "haf"), "did you mean 'half'"),
        (lambda: DuctGeometry(0.01, -1), "geometry.height = -1"),
        (lambda: DuctGeometry(0.01, 0.01, "half", 0.005), "wall_offset = 0.005"),
        (lambda: DuctGeometry(0.01, 0.01, "half", -1e-3), "wall_offset = -0.001"),
        (lambda: section(PIPE, 13), "numerics.level = 13"),
        (lambda: section(PIPE, 2.5), "numerics.level = 2.5"),
        (lambda: section(PIPE, True), "numerics.level = true"),
        (lambda: section(PIPE, size=0.0), "numerics.mesh_size = 0.0"),
        (lambda: section(PIPE, size=1e-9), "numerics.mesh_size = 1e-09"),
        (lambda: section(PIPE, size=1.0), "numerics.mesh_size = 1.0"),
        (lambda: section(PIPE, wall_ratio=1.5), "numerics.wall_grading = 1.5"),
        (lambda: section(PIPE, wall_ratio=None), "numerics.wall_grading"),
        (lambda: section(PIPE, cells="triangles"), "did you mean 'triangle'"),
        (lambda: section(PIPE, order=3), "order = 3"),
        (lambda: section(PIPE, layout="grid"), "layout = 'grid'"),
        (lambda: section(DUCT, layout="free"), "layout = 'free'"),
        (lambda: section(PIPE, layout="free", cells="quadrilateral"), "numerics.cells"),
        (lambda: extruded(PIPE, 0, 2), "length = 0"),
        (lambda: extruded(PIPE, 1.0, 0), "layers = 0"),
    ],
)
def test_bad_input(make: Any, text: str) -> None:
    with pytest.raises(InputError) as caught:
        make()
    assert text in str(caught.value)


@pytest.mark.parametrize("symmetry", ["none", "half"])
@pytest.mark.parametrize("cells", ["quadrilateral", "triangle"])
def test_a_line_of_straight_cells_has_the_area_of_its_pipe(symmetry: str, cells: str) -> None:
    case = Case.from_dict(
        {
            "solution": "unsteady",
            "geometry": {"diameter": 0.01, "length": 0.05, "symmetry": symmetry},
            "gas": {"density": 1.2, "viscosity": 1.8e-5},
            "operation": {"gas_superficial_velocity": 1.0},
            "numerics": {"end_time": 1.0, "level": 1, "axial_cells": 4, "cells": cells},
        }
    )
    mesh = line(case)
    ds = ufl.Measure("ds", mesh.mesh, subdomain_data=mesh.facet_tags)
    one = fem.Constant(mesh.mesh, 1.0)
    inlet = fem.assemble_scalar(fem.form(one * ds(mesh.tags["inlet"])))
    area = mesh.mesh.comm.allreduce(inlet)
    assert area == pytest.approx(mesh.geometry.meshed_area, rel=1e-9)

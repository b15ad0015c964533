# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes: sizes against formulas, names of the parts, symmetry, grading, lines, ranks."""

from __future__ import annotations

import math
from typing import Any

import dolfinx
import numpy as np
import pytest
from dolfinx import fem
from measures import (
    COMM,
    DUCT,
    LENGTH,
    PIPE,
    RADIUS,
    SYMMETRIES,
    extruded,
    integral,
    jacobians,
    nodes,
    section,
    slope,
)
from scipy.spatial import cKDTree

from fem_tfm.errors import InputError
from fem_tfm.geometry.arc import Arc
from fem_tfm.geometry.mesh import axial_layers, extruded_mesh, line_cells, line_mesh
from fem_tfm.geometry.resolution import Resolution
from fem_tfm.geometry.section import RectangularSection, RoundSection, Section
from fem_tfm.geometry.shapes import Bend, Pipe, Shape
from fem_tfm.interpolation import point_values


@pytest.mark.parametrize("symmetry", SYMMETRIES)
@pytest.mark.parametrize("cells", ["triangle", "quadrilateral"])
def test_pipe_area_and_perimeter(symmetry: str, cells: str) -> None:
    geometry = RoundSection(2 * RADIUS, symmetry)
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


@pytest.mark.parametrize("layout", ["o-grid", "free"])
@pytest.mark.parametrize("order", [1, 2])
def test_wall_nodes_are_on_the_circle(order: int, layout: str) -> None:
    x = nodes(section(PIPE, 1, order=order, layout=layout), "wall")
    assert len(x) > 8
    np.testing.assert_allclose(np.hypot(x[:, 0], x[:, 1]), RADIUS, rtol=1e-12)


@pytest.mark.parametrize(
    ("symmetry", "size"), [("none", 5e-3), ("half", 2.5e-3), ("quarter", 1e-3)]
)
def test_blocks_reach_from_the_axis_to_the_wall(symmetry: str, size: float) -> None:
    part = RoundSection(2 * RADIUS, symmetry)
    mesh = section(part, order=1, layout="blocks", cells="quadrilateral", mesh_size=size)
    cells_along = round(RADIUS / size)
    assert mesh.num_cells == {"none": 4, "half": 2, "quarter": 1}[symmetry] * cells_along**2
    x = nodes(mesh, "wall")
    np.testing.assert_allclose(np.hypot(x[:, 0], x[:, 1]), RADIUS, rtol=1e-12)
    assert (jacobians(mesh) > 0).all()


@pytest.mark.parametrize("layout", ["blocks", "block"])
def test_coarse_straight_lines_have_the_volume_of_the_pipe(layout: str) -> None:
    part, resolution = (
        RoundSection(2 * RADIUS, "none"),
        Resolution(mesh_size=RADIUS, cells="quadrilateral"),
    )
    mesh = extruded_mesh(part, resolution, LENGTH, 3, COMM, order=1, layout=layout, fills=True)
    assert mesh.num_cells == 3 * {"blocks": 4, "block": 1}[layout]
    assert integral(mesh) == pytest.approx(part.area * LENGTH, rel=1e-12)
    assert integral(mesh, "inlet") == pytest.approx(part.area, rel=1e-12)


@pytest.mark.parametrize("symmetry", SYMMETRIES)
def test_duct_area_and_perimeter(symmetry: str) -> None:
    geometry = RectangularSection(0.02, 0.01, symmetry)
    mesh = section(geometry, 2)
    assert geometry.area_factor * integral(mesh) == pytest.approx(2e-4, rel=1e-12)
    assert geometry.area_factor * integral(mesh, "wall") == pytest.approx(0.06, rel=1e-12)
    assert geometry.hydraulic_diameter == pytest.approx(4 * 2e-4 / 0.06)


def test_duct_with_wall_offset() -> None:
    geometry = RectangularSection(0.02, 0.01, "half", wall_offset=5e-4)
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
        (RoundSection(0.01, "none"), {"fluid", "wall"}),
        (RoundSection(0.01, "half"), {"fluid", "wall", "symmetry"}),
        (RoundSection(0.01, "quarter"), {"fluid", "wall", "symmetry_x", "symmetry_y"}),
        (RectangularSection(0.02, 0.01, "none"), {"fluid", "wall"}),
        (RectangularSection(0.02, 0.01, "half"), {"fluid", "wall", "symmetry"}),
        (RectangularSection(0.02, 0.01, "quarter"), {"fluid", "wall", "symmetry_x", "symmetry_y"}),
    ],
)
@pytest.mark.parametrize("length", [None, LENGTH])
def test_tags_are_complete_and_disjoint(
    geometry: Section, names: set[str], length: float | None
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


@pytest.mark.parametrize("geometry", [RoundSection(0.01, "quarter"), PIPE, DUCT])
def test_each_part_is_where_its_name_says(geometry: Section) -> None:
    mesh = extruded(geometry, LENGTH, 2, 1)
    planes = {"symmetry": (0, 0.0), "symmetry_x": (0, 0.0), "symmetry_y": (1, 0.0)}
    planes |= {"inlet": (2, 0.0), "outlet": (2, LENGTH)}
    for name in set(planes) & set(mesh.tags):
        axis, value = planes[name]
        np.testing.assert_allclose(nodes(mesh, name)[:, axis], value, atol=1e-15)
    assert np.all(geometry.wall_distance(nodes(mesh, "wall").T) <= 1e-8 * geometry.radius)
    assert len(mesh.facets("no such part")) == 0


@pytest.mark.parametrize("kind", [RoundSection, RectangularSection])
def test_whole_is_the_half_and_its_mirror_image(kind: type) -> None:
    lengths = (0.01,) if kind is RoundSection else (0.02, 0.01)
    half, whole = (section(kind(*lengths, symmetry), 2) for symmetry in ("half", "none"))
    tree = cKDTree(whole.mesh.geometry.x)
    images = [half.mesh.geometry.x * [side, 1, 1] for side in (1, -1)]
    matches = [tree.query(image) for image in images]
    assert max(gap.max() for gap, _ in matches) < 1e-8 * RADIUS
    assert len(np.unique([row for _, rows in matches for row in rows])) == tree.n
    assert whole.num_cells == 2 * half.num_cells


@pytest.mark.parametrize("symmetry", SYMMETRIES)
@pytest.mark.parametrize("kind", [RoundSection, RectangularSection])
def test_no_triangle_has_two_edges_on_walls(kind: type, symmetry: str) -> None:
    lengths = (0.01,) if kind is RoundSection else (0.01, 0.01)
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
    mesh = section(PIPE, 3, wall_grading=ratio, order=1)
    x = mesh.mesh.geometry.x
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
    mesh = section(DUCT, 3, wall_grading=ratio)
    for axis, half in ((0, DUCT.width / 2), (1, DUCT.height / 2)):
        x = mesh.mesh.geometry.x[:, axis] / half
        lines = np.unique(np.round(x, 9))
        # every second coordinate is a mid-side node
        steps = np.diff(lines[lines > -1e-9][::2]) * half
        assert steps[-1] == pytest.approx(ratio * mesh.size, rel=0.1 if ratio == 1 else 1e-5)
        assert steps[0] < 1.4 * mesh.size


def test_layers_along_a_curved_wall_are_even() -> None:
    mesh = section(PIPE, 1, wall_grading=0.02)
    x = mesh.mesh.geometry.x
    r = np.unique(np.round(np.hypot(x[:, 0], x[:, 1]) / RADIUS, 7))
    # wall, middle of the wall cell, its inner side: nothing between them
    thickness = 0.02 * mesh.size / RADIUS
    np.testing.assert_allclose(r[-3:], [1 - thickness, 1 - thickness / 2, 1], atol=2e-7)


def test_free_triangles_are_finer_at_the_wall() -> None:
    mesh = section(PIPE, mesh_size=1e-3, layout="free", wall_grading=0.25)
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
        values = jacobians(section(PIPE, level, cells=cells, wall_grading=ratio))
        assert (values.min(axis=1) / values.max(axis=1)).min() > 0.3


def test_levels_double_the_cells() -> None:
    built = [section(PIPE, level) for level in (1, 2, 3, 4, 5)]
    assert [mesh.num_cells for mesh in built] == [80, 180, 320, 720, 1216]
    assert built[0].size / built[2].size == pytest.approx(2)
    assert built[2].size / built[4].size == pytest.approx(2)
    assert section(PIPE, mesh_size=built[2].size).num_cells == 320


@pytest.mark.parametrize("diameter", [1e-4, 10.0])
def test_size_of_the_pipe_does_not_matter(diameter: float) -> None:
    geometry = RoundSection(diameter)
    mesh = extruded(geometry, 2 * diameter, 2, 1)
    assert mesh.num_cells == 80 * 2 * 3
    assert integral(mesh) == pytest.approx(geometry.meshed_area * 2 * diameter, rel=1e-4)


@pytest.mark.parametrize("geometry", [PIPE, RoundSection(0.01, "none"), DUCT])
@pytest.mark.parametrize(("cells", "per_cell"), [("triangle", 3), ("quadrilateral", 1)])
def test_extruded(geometry: Section, cells: str, per_cell: int) -> None:
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


# -- lines -------------------------------------------------------------------------------------


@pytest.mark.parametrize("cells", ["triangle", "quadrilateral"])
@pytest.mark.parametrize(("geometry", "towards"), [(PIPE, "up"), (DUCT, "down")])
def test_a_bent_line_is_as_large_as_a_straight_one(
    geometry: Section, towards: str, cells: str
) -> None:
    arc = Arc(4 * RADIUS, math.pi / 2, RADIUS, towards)
    length = arc.end + RADIUS
    mesh = extruded(geometry, length, 16, 2, cells=cells, arc=arc)
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


def turned(towards: Any) -> Bend:
    return Bend(2 * RADIUS, length=0.1, bend_towards=towards)


QUADS = Resolution(1, cells="quadrilateral")


@pytest.mark.parametrize(
    "shape", [turned("up"), turned("down"), turned("side"), Pipe(0.01, length=0.1)]
)
def test_the_vertical_plane_of_a_line(shape: Shape) -> None:
    mesh = line_mesh(shape, shape.section(), QUADS, COMM)
    points, drawn = mesh.plane(6, 40)
    flat = points.reshape(-1, 3)
    straight = mesh.straightened(flat).reshape(points.shape)
    np.testing.assert_allclose(straight[..., 0], 1e-8, rtol=1e-6)
    assert np.all(mesh.distance_at(flat) > RADIUS / 7)
    assert straight[3, :, 1] == pytest.approx(RADIUS / 6)
    assert straight[0, [0, -1], 2] == pytest.approx([0.1 / 80, 0.1 - 0.1 / 80])
    sideways = shape.arc is not None and shape.arc.towards == "side"
    where = straight if sideways else points
    np.testing.assert_allclose(drawn, where[..., [2, 1]], atol=1e-15)
    # all of them lie in the mesh: a function of place has its value there
    space = fem.functionspace(mesh.mesh, ("Lagrange", 1))
    height = fem.Function(space)
    height.interpolate(lambda x: x[1])
    found = point_values(height, flat, tolerance=1e-4 * RADIUS)
    np.testing.assert_allclose(found, flat[:, 1], atol=1e-9)


def test_a_section_has_no_plane_along_an_axis() -> None:
    with pytest.raises(ValueError, match="axis"):
        section(PIPE, 1).plane(2, 2)


@pytest.mark.parametrize("towards", ["up", "side"])
def test_a_line_follows_its_bend(towards: str) -> None:
    shape = turned(towards)
    part = shape.section()
    mesh = line_mesh(shape, part, QUADS, COMM)
    assert mesh.mesh.topology.cell_type.name == "hexahedron"
    assert mesh.num_cells == line_cells(shape, part, QUADS, COMM)
    assert ("symmetry" in mesh.tags) == (towards == "up")
    assert mesh.arc == shape.arc
    s = mesh.straightened(nodes(mesh, "outlet"))[:, 2]
    assert s == pytest.approx(0.1)
    tangent = mesh.axis(nodes(mesh, "outlet"))
    expected = np.tile(shape.arc.normal, (len(tangent), 1))
    np.testing.assert_allclose(tangent, expected, atol=1e-12)
    # edges are straight, so a little of the arc is cut off
    whole = mesh.section.meshed_area * 0.1
    assert 0.96 * whole < integral(mesh) < whole


def test_cells_along_a_line_are_twice_as_long_as_wide_unless_their_number_is_given() -> None:
    shape, part = Pipe(0.01, length=0.1), Pipe(0.01).section()
    given = Resolution(1, axial_cells=7)
    assert axial_layers(shape, part, Resolution(1)) == round(0.1 / (2 * 0.01 / 8))
    assert axial_layers(shape, part, given) == 7
    assert axial_layers(Pipe(0.01, length=1e-4), part, Resolution(1)) == 1
    straight = line_mesh(shape, part, given, COMM)
    assert straight.arc is None and straight.length == 0.1
    assert straight.num_cells == line_cells(shape, part, given, COMM) == 7 * 3 * 80


@pytest.mark.parametrize("symmetry", ["none", "half"])
@pytest.mark.parametrize("cells", ["quadrilateral", "triangle"])
def test_a_line_of_straight_cells_has_the_area_of_its_pipe(symmetry: Any, cells: Any) -> None:
    shape, resolution = Pipe(0.01, length=0.05), Resolution(1, cells=cells, axial_cells=4)
    mesh = line_mesh(shape, shape.section(symmetry), resolution, COMM)
    assert integral(mesh, "inlet") == pytest.approx(mesh.section.meshed_area, rel=1e-9)


# -- ranks ----------------------------------------------------------------------------------------


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


# -- bad input ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: section(PIPE, mesh_size=1e-9), "numerics.mesh_size = 1e-09"),
        (lambda: section(PIPE, mesh_size=1.0), "numerics.mesh_size = 1.0"),
        (lambda: section(PIPE, order=3), "order = 3"),
        (lambda: section(PIPE, layout="grid"), "layout = 'grid'"),
        (lambda: section(DUCT, layout="free"), "layout = 'free'"),
        (lambda: section(PIPE, layout="free", cells="quadrilateral"), "numerics.cells"),
        (lambda: section(PIPE, layout="blocks", order=1), "layout = 'blocks'"),
        (
            lambda: section(PIPE, layout="block", order=1, cells="quadrilateral"),
            "layout = 'block'",
        ),
        (lambda: extruded(PIPE, 0, 2), "length = 0"),
        (lambda: extruded(PIPE, 1.0, 0), "layers = 0"),
    ],
)
def test_bad_input_is_refused(make: Any, text: str) -> None:
    with pytest.raises(InputError) as caught:
        make()
    assert text in str(caught.value)

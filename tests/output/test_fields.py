# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fields written by a run are read back, node by node, by the programs that users have."""

from __future__ import annotations

import importlib.util
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import basix.ufl
import h5py
import meshio
import numpy as np
import pytest
from dolfinx import fem
from dolfinx.mesh import CellType, create_mesh, create_unit_cube, create_unit_square
from mpi4py import MPI

from fem_tfm.output import fields
from fem_tfm.output.fields import FieldWriter, snapshot

# VTK is no dependency of the package: it reads along where it happens to be installed
READERS = ("meshio", "vtk") if importlib.util.find_spec("vtk") else ("meshio",)
KINDS = {
    (name, degree): f"{name}-{degree}"
    for name in ("triangle", "quadrilateral", "tetrahedron", "hexahedron", "prism")
    for degree in (1, 2)
}
# number of corners, and the corners around each further node, from the documentation of VTK
CORNERS = {"triangle": 3, "quadrilateral": 4, "tetrahedron": 4, "hexahedron": 8, "prism": 6}
AROUND = {
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quadrilateral": ((0, 1), (1, 2), (2, 3), (3, 0), range(4)),
    "tetrahedron": ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    "hexahedron": (
        (0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4),
        (0, 4), (1, 5), (2, 6), (3, 7),
        (0, 3, 7, 4), (1, 2, 6, 5), (0, 1, 5, 4), (3, 2, 6, 7), (0, 1, 2, 3), (4, 5, 6, 7),
        range(8),
    ),
    "prism": (
        (0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5),
        (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5),
    ),
}  # fmt: skip
SIMPLICES = ("triangle-1", "triangle-2", "tetrahedron-1", "tetrahedron-2")
LAST = 1.5


def unit_mesh(name: str, degree: int = 1, n: int = 2) -> Any:
    """Unit square or cube with straight cells of degree 1 or 2."""
    comm, cell = MPI.COMM_WORLD, CellType[name]
    if name in ("triangle", "quadrilateral"):
        mesh = create_unit_square(comm, n, n, cell)
    else:
        mesh = create_unit_cube(comm, n, n, n, cell)
    return mesh if degree == 1 else quadratic(mesh)


def quadratic(mesh: Any, bend: Any = lambda x: x) -> Any:
    """The same mesh with quadratic cells, their nodes moved by `bend`."""
    gdim = mesh.geometry.dim
    space = fem.functionspace(mesh, ("Lagrange", 2))
    dofs = space.dofmap.list[: mesh.topology.index_map(mesh.topology.dim).size_local]
    numbers = space.dofmap.index_map.local_to_global(dofs.ravel()).reshape(dofs.shape)
    nodes = bend(space.tabulate_dof_coordinates()[: space.dofmap.index_map.size_local, :gdim])
    element = basix.ufl.element("Lagrange", mesh.basix_cell(), 2, shape=(gdim,))
    return create_mesh(mesh.comm, numbers, element, nodes)


def function(mesh: Any, element: tuple, values: Any) -> fem.Function:
    """Interpolate `values` into a space on the mesh."""
    found = fem.Function(fem.functionspace(mesh, element))
    found.interpolate(values)
    return found


def linear(x: np.ndarray) -> np.ndarray:
    """A linear field of which every node has another value."""
    return 1 + x[0] + 2 * x[1] + 3 * x[2]


def some_fields(mesh: Any, factor: float = 1.0) -> dict[str, fem.Function]:
    """Scalars and vectors at nodes and in cells, all linear."""
    return {
        "scalar": function(mesh, ("Lagrange", 1), lambda x: factor * linear(x)),
        "vector": function(mesh, ("Lagrange", 1, (3,)), lambda x: factor * x + 1),
        "plane": function(mesh, ("DG", 1, (2,)), lambda x: factor * x[:2]),
        "cell": function(mesh, ("DG", 0), lambda x: factor * linear(x)),
        "cell vector": function(mesh, ("DG", 0, (3,)), lambda x: factor * x),
    }


@pytest.fixture(scope="module")
def series(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A directory with one series of every kind of cell."""
    directory = tmp_path_factory.mktemp("series")
    for (name, degree), stem in KINDS.items():
        mesh = unit_mesh(name, degree)
        with FieldWriter(directory / stem, mesh) as writer:
            for time in (0.0, 0.25, LAST):
                writer.write(time, some_fields(mesh, 1 + time))
    return directory


def with_meshio(stem: Path, step: int = -1) -> dict[str, np.ndarray]:
    """One step as meshio reads it."""
    with meshio.xdmf.TimeSeriesReader(f"{stem}.xdmf") as reader:
        points, cells = reader.read_points_cells()
        step = range(reader.num_steps)[step]
        time, nodal, cellwise = reader.read_data(step)
    found = {"points": points, "cells": cells[0].data, "kind": cells[0].type, "time": time}
    found |= {f"nodal/{name}": values for name, values in nodal.items()}
    return found | {f"cellwise/{name}": values[0] for name, values in cellwise.items()}


@pytest.fixture(scope="module", params=READERS)
def read(request: pytest.FixtureRequest, series: Path) -> dict[str, dict[str, np.ndarray]]:
    """The last step of every series, as one of the readers sees it."""
    stems = [series / stem for stem in KINDS.values()]
    if request.param == "meshio":
        return {stem.name: with_meshio(stem) for stem in stems}
    program = Path(__file__).parent / "read_with_vtk.py"
    subprocess.run([sys.executable, program, str(LAST), *stems], check=True, timeout=120)
    return {stem.name: dict(np.load(f"{stem}.npz")) for stem in stems}


@pytest.mark.parametrize("stem", KINDS.values())
def test_values_stand_at_their_points(read: dict, stem: str) -> None:
    found = read[stem]
    x, factor = found["points"], 1 + LAST
    assert x.shape[1] == 3
    assert found["nodal/scalar"] == pytest.approx(factor * linear(x.T))
    assert found["nodal/vector"] == pytest.approx(factor * x + 1)
    assert found["nodal/plane"] == pytest.approx(factor * x * [1, 1, 0])
    centres = x[found["cells"]].mean(axis=1)
    assert found["cellwise/cell"] == pytest.approx(factor * linear(centres.T))
    assert found["cellwise/cell vector"] == pytest.approx(factor * centres)


@pytest.mark.parametrize(("kind", "stem"), KINDS.items())
def test_no_node_is_lost_or_doubled(read: dict, kind: tuple[str, int], stem: str) -> None:
    name, degree = kind
    dim = 2 if name in ("triangle", "quadrilateral") else 3
    x = read[stem]["points"]
    assert len(x) == (2 * degree + 1) ** dim
    assert len(np.unique(x.round(9), axis=0)) == len(x)
    assert set(np.unique(read[stem]["cells"])) == set(range(len(x)))


@pytest.mark.parametrize("stem", SIMPLICES)
def test_cells_fill_the_domain(read: dict, stem: str) -> None:
    dim = 2 if stem.startswith("triangle") else 3
    corners = read[stem]["points"][read[stem]["cells"][:, : dim + 1]][:, :, :dim]
    edges = corners[:, 1:] - corners[:, :1]
    volumes = np.abs(np.linalg.det(edges)) / (2 if dim == 2 else 6)
    assert volumes.sum() == pytest.approx(1)


@pytest.mark.parametrize("stem", KINDS.values())
def test_nodes_of_a_cell_stand_in_the_order_of_vtk(series: Path, stem: str) -> None:
    """Corners go round, then come the middles of VTK's edges, faces and the cell."""
    found = with_meshio(series / stem)
    name, degree = stem[:-2], stem[-1]
    nodes = found["points"][found["cells"]]
    corners = nodes[:, : CORNERS[name]]
    if name in ("quadrilateral", "hexahedron"):
        # opposite corners of a parallelogram have the same sum
        assert corners[:, 0] + corners[:, 2] == pytest.approx(corners[:, 1] + corners[:, 3])
    further = nodes[:, CORNERS[name] :]
    middles = [corners[:, list(group)].mean(axis=1) for group in AROUND[name]]
    assert further.shape[1] == (len(middles) if degree == "2" else 0)
    for i in range(further.shape[1]):
        assert further[:, i] == pytest.approx(middles[i])


def test_one_grid_a_step_carries_all_fields(series: Path) -> None:
    root = ElementTree.parse(series / "triangle-2.xdmf").getroot()
    (collection,) = root.find("Domain")
    assert collection.get("CollectionType") == "Temporal"
    assert [float(step.find("Time").get("Value")) for step in collection] == [0.0, 0.25, LAST]
    for step in collection:
        names = [attribute.get("Name") for attribute in step.findall("Attribute")]
        assert names == ["scalar", "vector", "plane", "cell", "cell vector"]
    # all steps point at one copy of the mesh
    meshes = {ElementTree.tostring(step.find("Topology")) for step in collection}
    assert len(meshes) == 1


def test_earlier_steps_are_read_too(series: Path) -> None:
    found = with_meshio(series / "quadrilateral-1", 1)
    assert found["time"] == 0.25
    assert found["nodal/scalar"] == pytest.approx(1.25 * linear(found["points"].T))


def test_curved_cells_keep_their_nodes(tmp_path: Path) -> None:
    mesh = quadratic(unit_mesh("triangle"), lambda x: x + 0.1 * np.sin(3 * x[:, ::-1]))
    with FieldWriter(tmp_path / "f", mesh) as writer:
        writer.write(0.0, {"scalar": function(mesh, ("Lagrange", 2), linear)})
    found = with_meshio(tmp_path / "f")
    assert found["kind"] == "triangle6"
    straight = unit_mesh("triangle", 2).geometry.x
    bent = straight + 0.1 * np.sin(3 * straight[:, [1, 0, 2]]) * [1, 1, 0]
    assert np.sort(found["points"], axis=0) == pytest.approx(np.sort(bent, axis=0))
    assert found["nodal/scalar"] == pytest.approx(linear(found["points"].T))


def test_quadratic_field_on_straight_mesh_is_kept_exactly(tmp_path: Path) -> None:
    mesh = unit_mesh("triangle")
    field = function(mesh, ("Lagrange", 2), lambda x: x[0] ** 2 - x[0] * x[1])
    with FieldWriter(tmp_path / "f", mesh) as writer:
        writer.write(0.0, {"square": field})
    found = with_meshio(tmp_path / "f")
    x, y, _ = found["points"].T
    assert found["kind"] == "triangle6"
    assert found["nodal/square"] == pytest.approx(x**2 - x * y)


def test_part_of_a_mixed_function_is_written(tmp_path: Path) -> None:
    mesh = unit_mesh("triangle", 2)
    p1 = basix.ufl.element("Lagrange", "triangle", 1)
    p2 = basix.ufl.element("Lagrange", "triangle", 2, shape=(3,))
    mixed = fem.Function(fem.functionspace(mesh, basix.ufl.mixed_element([p2, p1])))
    mixed.sub(0).interpolate(lambda x: x + 2)
    mixed.sub(1).interpolate(linear)
    found = snapshot(mesh, {"u": mixed.sub(0), "p": mixed.sub(1), "u_z": mixed.sub(0).sub(2)})
    assert found.nodal["u"] == pytest.approx(found.points + 2)
    assert found.nodal["p"] == pytest.approx(linear(found.points.T))
    assert found.nodal["u_z"] == pytest.approx(found.points[:, 2] + 2)


def test_plane_tensor_becomes_three_by_three(tmp_path: Path) -> None:
    mesh = unit_mesh("triangle")
    rows = function(mesh, ("Lagrange", 1, (2, 2)), lambda x: x[[0, 1, 0, 1]] * [[1], [1], [2], [1]])
    with FieldWriter(tmp_path / "f", mesh) as writer:
        writer.write(0.0, {"stress": rows})
    found = with_meshio(tmp_path / "f")
    x, y, none = found["points"].T
    expected = np.stack([x, y, none, 2 * x, y, none, none, none, none], axis=1)
    assert found["nodal/stress"] == pytest.approx(expected)


def test_what_cannot_be_written_is_refused(tmp_path: Path) -> None:
    mesh, other = unit_mesh("triangle"), unit_mesh("triangle")
    field = function(mesh, ("Lagrange", 1), linear)
    writer = FieldWriter(tmp_path / "f", mesh)
    with pytest.raises(ValueError, match="'far' lives on another mesh"):
        writer.write(0.0, {"far": function(other, ("Lagrange", 1), linear)})
    with pytest.raises(ValueError, match="'long' of shape"):
        writer.write(0.0, {"long": fem.Function(fem.functionspace(mesh, ("DG", 0, (4,))))})
    assert not list(tmp_path.iterdir())
    writer.write(0.0, {"p": field})
    with pytest.raises(ValueError, match="not after"):
        writer.write(0.0, {"p": field})
    with pytest.raises(ValueError, match="not after"):
        writer.write(float("nan"), {"p": field})
    writer.close()
    with pytest.raises(ValueError, match="closed"):
        writer.write(1.0, {"p": field})
    assert with_meshio(tmp_path / "f")["time"] == 0.0


def test_new_series_replaces_an_old_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = unit_mesh("triangle")
    monkeypatch.setattr(fields, "SEGMENT_BYTES", 1)
    for steps in (3, 1):
        with FieldWriter(tmp_path / "f", mesh) as writer:
            for time in range(steps):
                writer.write(time, some_fields(mesh))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["f.1.h5", "f.h5", "f.xdmf"]


@pytest.mark.parametrize("segment", [1, 1 << 24])
def test_a_series_goes_on_where_a_killed_run_left_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, segment: int
) -> None:
    """In the same file or a further one; a step whose data alone were written is written again."""
    mesh = unit_mesh("triangle")
    monkeypatch.setattr(fields, "SEGMENT_BYTES", segment)
    for times in ((0, 1), (2, 3)):
        with FieldWriter(tmp_path / "f", mesh, append=True) as writer:
            for time in times:
                writer.write(time, some_fields(mesh, 1.0 + time))
        writer = FieldWriter(tmp_path / "f", mesh, append=True)
        monkeypatch.setattr(fields, "write_text", lambda *unused: None)
        writer.write(times[1] + 1, some_fields(mesh, -1.0))
        monkeypatch.undo()
        monkeypatch.setattr(fields, "SEGMENT_BYTES", segment)
    whole = tmp_path / "whole"
    with FieldWriter(whole, mesh) as writer:
        for time in range(4):
            writer.write(time, some_fields(mesh, 1.0 + time))
    for step in range(4):
        found, wanted = (with_meshio(stem, step) for stem in (tmp_path / "f", whole))
        assert found["time"] == wanted["time"] == step
        for name in wanted:
            assert np.array_equal(found[name], wanted[name]), name
    with FieldWriter(tmp_path / "f", mesh, append=True) as writer, pytest.raises(ValueError):
        writer.write(3, some_fields(mesh))
        writer.write(3, some_fields(mesh))


def test_large_series_goes_on_in_further_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = unit_mesh("triangle", n=8)
    monkeypatch.setattr(fields, "SEGMENT_BYTES", 20_000)
    with FieldWriter(tmp_path / "f", mesh) as writer:
        for time in range(6):
            writer.write(time, some_fields(mesh, 1.0 + time))
    assert len(list(tmp_path.glob("f*.h5"))) > 1
    for step in range(6):
        found = with_meshio(tmp_path / "f", step)
        assert found["nodal/scalar"] == pytest.approx((1 + step) * linear(found["points"].T))


KILLED = """
import os, signal, sys
import fem_tfm
import h5py
from fem_tfm.output import fields, files
sys.path.insert(0, sys.argv[1])
import test_fields as here

def die(*given):
    os.kill(os.getpid(), signal.SIGKILL)

def half(group, name, values, write=h5py.Group.__setitem__):
    write(group, name, values)
    group.file.flush()
    if name == "steps/000002/vector":
        die()

mesh = here.unit_mesh("triangle")
writer = fields.FieldWriter(sys.argv[2], mesh)
for step in range(3):
    if step == 2 and sys.argv[3] == "heavy":
        h5py.Group.__setitem__ = half
    if step == 2 and sys.argv[3] == "light":
        fields.write_text = die
    writer.write(step, here.some_fields(mesh, 1.0 + step))
"""


@pytest.mark.parametrize("data", ["heavy", "light"])
def test_kill_leaves_the_steps_before(tmp_path: Path, data: str) -> None:
    stem = tmp_path / "f"
    command = [sys.executable, "-c", KILLED, Path(__file__).parent, stem, data]
    assert subprocess.run(command, timeout=120).returncode == -signal.SIGKILL
    for step in (0, 1):
        found = with_meshio(stem, step)
        assert found["nodal/scalar"] == pytest.approx((1 + step) * linear(found["points"].T))
    with meshio.xdmf.TimeSeriesReader(f"{stem}.xdmf") as reader:
        assert reader.num_steps == 2


@pytest.mark.mpi
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("name", ["triangle", "hexahedron"])
def test_series_of_several_ranks_is_whole(tmp_path: Path, name: str, degree: int) -> None:
    mesh = unit_mesh(name, degree, n=4)
    with FieldWriter(tmp_path / "f", mesh) as writer:
        writer.write(0.0, some_fields(mesh))
    mesh.comm.barrier()
    found = with_meshio(tmp_path / "f")
    x = found["points"]
    dim = mesh.topology.dim
    assert len(np.unique(x.round(9), axis=0)) == len(x) == (4 * degree + 1) ** dim
    assert len(found["cells"]) == mesh.topology.index_map(dim).size_global
    assert found["nodal/scalar"] == pytest.approx(linear(x.T))
    assert found["nodal/vector"] == pytest.approx(x + 1)
    assert found["cellwise/cell"] == pytest.approx(linear(x[found["cells"]].mean(axis=1).T))


@pytest.mark.mpi
def test_failure_of_rank_0_is_raised_on_all(tmp_path: Path) -> None:
    mesh = unit_mesh("triangle", n=4)
    writer = FieldWriter(tmp_path / "f", mesh)
    if mesh.comm.rank == 0:
        # a directory where the file has to go
        (tmp_path / "f.xdmf").mkdir()
    mesh.comm.barrier()
    with pytest.raises((OSError, RuntimeError)):
        writer.write(0.0, some_fields(mesh))


def test_plain_hdf5_finds_fields_by_name(series: Path) -> None:
    with h5py.File(series / "triangle-1.h5") as file:
        assert set(file["steps/000001"]) >= {"scalar", "vector", "cell"}
        assert file["mesh/points"].shape == (9, 3)

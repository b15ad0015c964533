# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fields of a run as one XDMF time series with its heavy data in HDF5.

One temporal grid carries all fields of a step; topology and geometry are stored once and every
step points at them. Quadratic cells stay quadratic.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import h5py
import numpy as np
from dolfinx import cpp, fem
from numpy.typing import NDArray

from fem_tfm.output.files import on_root, replaced, write_text

# (name in DOLFINx, degree) -> (name in XDMF, name in meshio)
CELLS = {
    ("triangle", 1): ("Triangle", "triangle"),
    ("triangle", 2): ("Triangle_6", "triangle6"),
    ("quadrilateral", 1): ("Quadrilateral", "quad"),
    ("quadrilateral", 2): ("Quadrilateral_9", "quad9"),
    ("tetrahedron", 1): ("Tetrahedron", "tetra"),
    ("tetrahedron", 2): ("Tetrahedron_10", "tetra10"),
    ("hexahedron", 1): ("Hexahedron", "hexahedron"),
    ("hexahedron", 2): ("Hexahedron_27", "hexahedron27"),
    ("prism", 1): ("Wedge", "wedge"),
    ("prism", 2): ("Wedge_18", "wedge18"),
}
ATTRIBUTES = {1: "Scalar", 3: "Vector", 9: "Tensor"}
# an HDF5 file is copied to be replaced; beyond this size a further one is begun instead
SEGMENT_BYTES = 1 << 24


@dataclass(frozen=True)
class Snapshot:
    """Fields of one moment as plain arrays, whole on rank 0.

    points : node coordinates, shape (n, 3) [m]
    cells : node numbers in VTK's order, shape (m, nodes of a cell)
    kind : cell type in meshio's words ("triangle6")
    nodal, cellwise : values, shape (n,) or (n, 3) and (m,) or (m, 3)
    """

    points: NDArray[np.float64]
    cells: NDArray[np.int64]
    kind: str
    nodal: dict[str, NDArray[np.float64]]
    cellwise: dict[str, NDArray[np.float64]]


class Nodes:
    """Lagrange nodes of degree 1 or 2 on a mesh, and the values of Functions there.

    Every method is collective and gathers to rank 0, in the numbering of the owners; other ranks
    get empty arrays.
    """

    def __init__(self, mesh: Any, degree: int) -> None:
        name = mesh.topology.cell_type.name
        if (name, degree) not in CELLS:
            raise ValueError(f"cells of type {name} and degree {degree} cannot be written to XDMF")
        self.mesh = mesh
        self.degree = degree
        self.xdmf_type, self.kind = CELLS[name, degree]
        self._spaces: dict[tuple[int, ...], tuple[Any, NDArray[np.int32]]] = {}
        self._space = fem.functionspace(mesh, ("Lagrange", degree))
        self._owned_cells = mesh.topology.index_map(mesh.topology.dim).size_local

    def points(self) -> NDArray[np.float64]:
        """Coordinates, shape (n, 3) [m]."""
        owned = self._space.dofmap.index_map.size_local
        return self._gather(self._space.tabulate_dof_coordinates()[:owned])

    def cells(self) -> NDArray[np.int64]:
        """Node numbers of each cell in VTK's order, shape (m, nodes of a cell)."""
        local = self._space.dofmap.list[: self._owned_cells]
        order = np.argsort(cpp.io.perm_vtk(self.mesh.topology.cell_type, local.shape[1]))
        numbers = self._space.dofmap.index_map.local_to_global(local[:, order].ravel())
        return self._gather(numbers.reshape(local.shape))

    def nodal(self, function: fem.Function) -> NDArray[np.float64]:
        """Values at the nodes, interpolated where the element is another one."""
        space, where = self._target(tuple(function.function_space.value_shape))
        target = fem.Function(space)
        target.interpolate(function)
        owned = self._space.dofmap.index_map.size_local
        return self._gather(three_components(self._rows(target)[where[:owned]]))

    def cellwise(self, function: fem.Function) -> NDArray[np.float64]:
        """Values of a cellwise constant Function, one row a cell."""
        dofs = function.function_space.dofmap.list[: self._owned_cells, 0]
        return self._gather(three_components(self._rows(function)[dofs]))

    def _rows(self, function: fem.Function) -> NDArray[np.float64]:
        shape = tuple(function.function_space.value_shape)
        return function.x.array.reshape(-1, *shape)

    def _target(self, shape: tuple[int, ...]) -> tuple[Any, NDArray[np.int32]]:
        """Space of a value shape, and its block number of each node."""
        if shape not in self._spaces:
            space = fem.functionspace(self.mesh, ("Lagrange", self.degree, shape))
            nodes, blocks = self._space.dofmap.list, space.dofmap.list
            where = np.empty(nodes.max(initial=-1) + 1, dtype=np.int32)
            where[nodes] = blocks
            self._spaces[shape] = space, where
        return self._spaces[shape]

    def _gather(self, rows: NDArray[Any]) -> NDArray[Any]:
        parts = self.mesh.comm.gather(np.ascontiguousarray(rows), root=0)
        return rows[:0] if parts is None else np.concatenate(parts)


def three_components(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Pad vectors to 3 components and tensors to 3 x 3, flattened to 9; scalars stay (n,)."""
    if values.ndim == 1:
        return values
    missing = [(0, 3 - n) for n in values.shape[1:]]
    return np.pad(values, [(0, 0), *missing]).reshape(len(values), -1)


def checked(name: str, function: fem.Function, mesh: Any) -> fem.Function:
    """Return `function`, collapsed if it is part of a mixed one; refuse what cannot be written."""
    space = function.function_space
    if space.mesh is not mesh:
        raise ValueError(f"field {name!r} lives on another mesh than its writer")
    if tuple(space.value_shape) not in ((), (2,), (3,), (2, 2), (3, 3)):
        shape = tuple(space.value_shape)
        raise ValueError(f"field {name!r} of shape {shape} is no scalar, vector or tensor")
    return function.collapse() if space.component() else function


def degree(mesh: Any, fields: Mapping[str, fem.Function]) -> int:
    """Degree that keeps geometry and nodal fields as they are, at most 2 [-]."""
    degrees = [function.function_space.ufl_element().degree for function in fields.values()]
    return max(mesh.geometry.cmaps[0].degree, min(2, max(degrees, default=1)))


def snapshot(mesh: Any, fields: Mapping[str, fem.Function]) -> Snapshot:
    """Gather fields to rank 0 as plain arrays, for pictures and reports (collective)."""
    fields = {name: checked(name, function, mesh) for name, function in fields.items()}
    nodes = Nodes(mesh, degree(mesh, fields))
    nodal, cellwise = _sample(nodes, fields)
    return Snapshot(nodes.points(), nodes.cells(), nodes.kind, nodal, cellwise)


def _sample(nodes: Nodes, fields: Mapping[str, fem.Function]) -> tuple[dict, dict]:
    nodal, cellwise = {}, {}
    for name, function in fields.items():
        if function.function_space.ufl_element().degree == 0:
            cellwise[name] = nodes.cellwise(function)
        else:
            nodal[name] = nodes.nodal(function)
    return nodal, cellwise


class HeavyData:
    """Arrays in HDF5 files ``stem.h5``, ``stem.1.h5``, ... that are replaced as a whole.

    HDF5 changes its tables in place, and a kill between two of these changes makes the old
    datasets unreadable too; so a step is added to a copy, which then takes the file's name.
    """

    def __init__(self, stem: str | Path) -> None:
        self.stem = Path(stem)
        self._number = -1

    def remove(self) -> None:
        """Remove the files of an earlier run of the same name."""
        self._path(0).unlink(missing_ok=True)
        number = 1
        while self._path(number).exists():
            self._path(number).unlink()
            number += 1

    def resume(self) -> None:
        """Go on after the files of an earlier part of the run."""
        while self._path(self._number + 1).exists():
            self._number += 1

    def add(self, arrays: Mapping[str, NDArray[Any]]) -> str:
        """Add arrays under their names and return the name of the file that holds them."""
        fresh = self._number < 0 or self._path(self._number).stat().st_size > SEGMENT_BYTES
        path = self._path(self._number + fresh)
        with replaced(path) as temporary:
            if not fresh:
                shutil.copyfile(path, temporary)
            with h5py.File(temporary, "a") as file:
                for name, array in arrays.items():
                    # left by a run that was killed before it could name them
                    if name in file:
                        del file[name]
                    file[name] = array
        self._number += fresh
        return path.name

    def _path(self, number: int) -> Path:
        suffix = f".{number}.h5" if number else ".h5"
        return self.stem.with_name(self.stem.name + suffix)


class FieldWriter:
    """Time series of fields in ``stem.xdmf`` and ``stem.h5``.

    Parameters
    ----------
    path_stem : path of the two files without suffix
    mesh : DOLFINx mesh of degree 1 or 2; degree 2 is written as quadratic cells
    append : go on with the series of an earlier part of the run on the same mesh, if there is one
    until : with `append`, the time [s] behind which the earlier part is dropped

    Notes
    -----
    Lagrange fields are written at the nodes: those of the mesh, or quadratic ones on a straight
    mesh if the first step holds a field of degree 2 or more. Fields of degree 0 are written per
    cell. Every other field is interpolated to the nodes; where it jumps, one of its values is
    taken. Vectors get 3 components, tensors 9.

    The files are replaced in one step each, the heavy data first, so a kill at any moment leaves
    the series up to the step before. No file is held open between steps.

    All methods but `close` are collective.

    Raises
    ------
    ValueError
        for a field on another mesh, a field that is no scalar, vector or tensor, a time that does
        not grow, a mesh of degree above 2, or a write after `close`.
    """

    def __init__(
        self, path_stem: str | Path, mesh: Any, append: bool = False, until: float = np.inf
    ) -> None:
        self.mesh = mesh
        self.append = append
        self.until = until
        self.path = Path(f"{path_stem}.xdmf")
        self._heavy = HeavyData(path_stem)
        self._nodes: Nodes | None = None
        self._mesh_xml = ""
        self._steps: list[str] = []
        self._time = -np.inf
        self._closed = False

    def write(self, time: float, fields: Mapping[str, fem.Function]) -> None:
        """Add one step with all its fields (collective); `time` [s] grows from step to step."""
        if self._closed:
            raise ValueError(f"{self.path} is closed")
        if not time > self._time:
            raise ValueError(f"time {time} s is not after the previous step's {self._time} s")
        fields = {name: checked(name, function, self.mesh) for name, function in fields.items()}
        if self._nodes is None:
            self._begin(fields)
        assert self._nodes is not None
        nodal, cellwise = _sample(self._nodes, fields)
        on_root(self.mesh.comm, lambda: self._add(time, nodal, cellwise))
        self._time = time

    def close(self) -> None:
        """End the series; the files are complete already."""
        self._closed = True
        self._nodes = None

    def __enter__(self) -> FieldWriter:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _begin(self, fields: Mapping[str, fem.Function]) -> None:
        """Write the mesh; an older series of this name goes first, for its data are replaced."""
        nodes = Nodes(self.mesh, degree(self.mesh, fields))
        if self.append and self.mesh.comm.bcast(self.path.exists()):
            on_root(self.mesh.comm, self._resume)
            self._nodes = nodes
            return
        points, cells = nodes.points(), nodes.cells()

        def begin() -> None:
            self.path.unlink(missing_ok=True)
            self._heavy.remove()
            file = self._heavy.add({"mesh/points": points, "mesh/cells": cells})
            self._mesh_xml = (
                f'<Topology TopologyType="{nodes.xdmf_type}" NumberOfElements="{len(cells)}">'
                f"{_item(file, 'mesh/cells', cells)}</Topology>\n"
                f'<Geometry GeometryType="XYZ">{_item(file, "mesh/points", points)}</Geometry>\n'
            )

        on_root(self.mesh.comm, begin)
        self._nodes = nodes

    def _resume(self) -> None:
        """Take over the steps of the series that is there."""
        found = self.path.read_text(encoding="utf-8").split('<Grid Name="step"')[1:]
        ends = (text.partition("</Grid>\n")[0] for text in found)
        steps = [f'<Grid Name="step"{text}</Grid>\n' for text in ends]
        start, end = steps[0].index("<Topology"), steps[0].index("</Geometry>\n")
        self._mesh_xml = steps[0][start:end] + "</Geometry>\n"
        times = [float(text.partition('<Time Value="')[2].partition('"')[0]) for text in steps]
        kept = sum(time <= self.until for time in times)
        self._steps, self._time = steps[:kept], max(times[:kept], default=-np.inf)
        self._heavy.resume()

    def _add(self, time: float, nodal: dict, cellwise: dict) -> None:
        group = f"steps/{len(self._steps):06d}"
        fields = [("Node", *item) for item in nodal.items()]
        fields += [("Cell", *item) for item in cellwise.items()]
        file = self._heavy.add({f"{group}/{name}": values for _, name, values in fields})
        attributes = (
            _attribute(center, name, values, file, f"{group}/{name}")
            for center, name, values in fields
        )
        step = (
            f'<Grid Name="step" GridType="Uniform">\n<Time Value="{float(time)!r}"/>\n'
            f"{self._mesh_xml}{''.join(attributes)}</Grid>\n"
        )
        write_text(self.path, _document([*self._steps, step]))
        self._steps.append(step)


def _document(steps: list[str]) -> str:
    return (
        '<?xml version="1.0" encoding="utf-8"?>\n<Xdmf Version="3.0">\n<Domain>\n'
        '<Grid Name="fields" GridType="Collection" CollectionType="Temporal">\n'
        f"{''.join(steps)}</Grid>\n</Domain>\n</Xdmf>\n"
    )


def _attribute(center: str, name: str, values: NDArray[Any], file: str, path: str) -> str:
    kind = ATTRIBUTES[values[0].size if len(values) else 1]
    return (
        f'<Attribute Name={quoteattr(name)} AttributeType="{kind}" Center="{center}">'
        f"{_item(file, path, values)}</Attribute>\n"
    )


def _item(file: str, path: str, array: NDArray[Any]) -> str:
    kind = "Float" if array.dtype.kind == "f" else "Int"
    dimensions = " ".join(map(str, array.shape))
    return (
        f'<DataItem DataType="{kind}" Precision="{array.dtype.itemsize}" '
        f'Dimensions="{dimensions}" Format="HDF">{file}:/{path}</DataItem>'
    )

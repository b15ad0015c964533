# SPDX-License-Identifier: LGPL-3.0-or-later
"""Values of finite-element functions at points, and their transfer to another mesh.

Both accept points slightly outside the mesh, as the nodes of another curved mesh of the same
section are: such a point takes the polynomial of the nearest cell. Both are collective.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, overload

import numpy as np
import numpy.typing as npt
from dolfinx import fem, geometry
from dolfinx.mesh import Mesh
from mpi4py import MPI

from fem_tfm.errors import InputError, SolverError

# how far outside a mesh a node may be, over its extent; wide boxes cost time, so thin ones first
PADDINGS = (1e-6, 1e-3, 3e-2)
# the same for a probe; more than a polygon of 20 edges is from its circle
TOLERANCE = 1e-2


class Transfer:
    """Interpolation of functions of one space into another, on another mesh of the same region.

    Which cell holds which node is found once. For scalar or vector Lagrange spaces of equal shape.
    Exact where a function is a polynomial in x that the cells of both meshes carry; otherwise the
    error is that of the function itself. Nodes outside the source mesh by up to 3 % of its extent
    are extrapolated.

    known : transfers between the same two meshes by the nodes of their targets' cells; one of equal
        nodes lends what it found, and a new one is entered

    Raises
    ------
    InputError
        the spaces have different shapes.
    SolverError
        a node is further away.
    """

    def __init__(
        self,
        source: fem.FunctionSpace,
        target: fem.FunctionSpace,
        known: dict[bytes, Transfer] | None = None,
    ) -> None:
        shapes = source.value_shape, target.value_shape
        if shapes[0] != shapes[1]:
            raise InputError("source", shapes[0], f"a function of shape {shapes[1]}, as the target")
        self._cells = np.arange(_count_cells(target.mesh), dtype=np.int32)
        held, nodes = {} if known is None else known, target.element.interpolation_points.tobytes()
        held.setdefault(nodes, self)
        self._data: Any
        if held[nodes] is not self:
            self._data = held[nodes]._data
            return
        extent = _extent(source.mesh)
        for padding in PADDINGS:
            self._data = fem.create_interpolation_data(
                target, source, self._cells, padding=padding * extent
            )
            lost = target.mesh.comm.allreduce(int(np.count_nonzero(self._data.src_owner < 0)))
            if not lost:
                return
        raise SolverError(f"{lost} nodes are too far outside the mesh that the values come from")

    def carry(self, source: fem.Function, target: fem.Function) -> fem.Function:
        """Interpolate `source` into `target` and return it, ghosts up to date."""
        target.interpolate_nonmatching(source, self._cells, self._data)
        target.x.scatter_forward()
        return target


def transfer(source: fem.Function, target: fem.Function) -> fem.Function:
    """Interpolate `source` into `target` once; see `Transfer`."""
    return Transfer(source.function_space, target.function_space).carry(source, target)


@overload
def point_values(
    functions: Sequence[fem.Function], points: npt.ArrayLike, tolerance: float | None = None
) -> list[npt.NDArray[Any]]: ...


@overload
def point_values(
    functions: fem.Function, points: npt.ArrayLike, tolerance: float | None = None
) -> npt.NDArray[Any]: ...


def point_values(
    functions: fem.Function | Sequence[fem.Function],
    points: npt.ArrayLike,
    tolerance: float | None = None,
) -> npt.NDArray[Any] | list[npt.NDArray[Any]]:
    """Values of one function, or of several on one mesh, at the same `points` on every rank.

    `points` has the shape (n, 2) or (n, 3) [m]. Every rank gets all values: shape (n,) for a
    scalar, (n, k) for k components; nan at points further than `tolerance` [m] outside the mesh
    (default: 1 % of its extent). Raises InputError for points of another shape.
    """
    several = [functions] if isinstance(functions, fem.Function) else list(functions)
    if not several:
        return []
    where = Points(several[0].function_space.mesh, points, tolerance)
    values = [where.values(function) for function in several]
    return values[0] if isinstance(functions, fem.Function) else values


class Points:
    """Points whose cells are found once, for values again and again; as `point_values`."""

    def __init__(self, mesh: Mesh, points: npt.ArrayLike, tolerance: float | None = None) -> None:
        self.x = _three_columns(points)
        reach = TOLERANCE * _extent(mesh) if tolerance is None else tolerance
        self._cells, self._here, self.found = _owners(mesh, self.x, reach)

    def values(self, function: fem.Function) -> npt.NDArray[Any]:
        """Values at all points on every rank, nan where there is no mesh (collective)."""
        return _evaluated(function, self.x, self._cells, self._here, self.found)


def _count_cells(mesh: Mesh) -> int:
    """Cells of this rank, ghosts included."""
    cells = mesh.topology.index_map(mesh.topology.dim)
    return int(cells.size_local + cells.num_ghosts)


def _extent(mesh: Mesh) -> float:
    """Largest side of the bounding box of a mesh [m]."""
    x = mesh.geometry.x
    lower = x.min(axis=0) if len(x) else np.full(3, np.inf)
    upper = x.max(axis=0) if len(x) else np.full(3, -np.inf)
    mesh.comm.Allreduce(MPI.IN_PLACE, lower, MPI.MIN)
    mesh.comm.Allreduce(MPI.IN_PLACE, upper, MPI.MAX)
    return float((upper - lower).max())


def _three_columns(points: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Points with z = 0 added where it is missing."""
    given = np.asarray(points, dtype=np.float64)
    if given.ndim != 2 or given.shape[1] not in (2, 3):
        raise InputError("points", given.shape, "an array of shape (n, 2) or (n, 3)")
    return np.pad(given, ((0, 0), (0, 3 - given.shape[1])))


def _nearest_cells(
    mesh: Mesh, x: npt.NDArray[np.float64], reach: float
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.float64]]:
    """Nearest cell owned by this rank within `reach` of each point (else -1), and its distance."""
    cells = np.full(len(x), -1, dtype=np.int32)
    nearest = np.full(len(x), np.inf)
    dim = mesh.topology.dim
    owned = np.arange(mesh.topology.index_map(dim).size_local, dtype=np.int32)
    if not (len(owned) and len(x)):
        return cells, nearest
    tree = geometry.bb_tree(mesh, dim, padding=reach, entities=owned)
    candidates = geometry.compute_collisions_points(tree, x)
    rows = np.repeat(np.arange(len(x)), np.diff(candidates.offsets))
    if not len(rows):
        return cells, nearest
    gap = np.sqrt(geometry.squared_distance(mesh, dim, candidates.array, x[rows]))
    # the last write to a row stays, so the nearest comes last; lower indices win ties
    order = np.lexsort((-candidates.array, -gap))
    order = order[gap[order] <= reach]
    cells[rows[order]], nearest[rows[order]] = candidates.array[order], gap[order]
    return cells, nearest


def _owners(
    mesh: Mesh, x: npt.NDArray[np.float64], reach: float
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """Cell of each point on this rank, whether this rank answers for it, whether any does."""
    cells, gap = _nearest_cells(mesh, x, reach)
    gaps = np.array(mesh.comm.allgather(gap))
    found = np.isfinite(gaps.min(axis=0))
    return cells, found & (gaps.argmin(axis=0) == mesh.comm.rank), found


def _evaluated(
    function: fem.Function,
    x: npt.NDArray[np.float64],
    cells: npt.NDArray[np.int32],
    here: npt.NDArray[np.bool_],
    found: npt.NDArray[np.bool_],
) -> npt.NDArray[Any]:
    """Values at all points on every rank."""
    space = function.function_space
    values = np.zeros((len(x), space.value_size), dtype=function.dtype)
    if here.any():
        values[here] = function.eval(x[here], cells[here]).reshape(-1, space.value_size)
    space.mesh.comm.Allreduce(MPI.IN_PLACE, values)
    values[~found] = np.nan
    return values.reshape(-1) if function.ufl_shape == () else values

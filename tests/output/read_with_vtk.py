# SPDX-License-Identifier: LGPL-3.0-or-later
"""Read XDMF series with VTK and store their last step as npz; run as a program.

VTK and DOLFINx bring different HDF5 libraries, so the tests start this in a process of its own.
Arguments: the time to read, then paths without suffix.
"""

from __future__ import annotations

import sys

import numpy as np
import vtk


def read(path: str, time: float) -> vtk.vtkUnstructuredGrid:
    """The one grid of a series at a time; fails where the reader makes several blocks of it."""
    reader = vtk.vtkXdmfReader()
    reader.SetFileName(path)
    reader.UpdateTimeStep(time)
    grid = reader.GetOutputDataObject(0)
    assert grid.GetClassName() == "vtkUnstructuredGrid", grid.GetClassName()
    return grid


def node_error(cell: vtk.vtkCell, points: np.ndarray) -> float:
    """Distance of the nodes of a straight cell from where VTK expects them."""
    count = cell.GetNumberOfPoints()
    flat = cell.GetParametricCoords()
    inside = np.array([flat[i] for i in range(3 * count)]).reshape(count, 3)
    here = points[[cell.GetPointId(i) for i in range(count)]]
    corners = np.column_stack([inside, np.ones(count)])
    affine = np.linalg.lstsq(corners, here, rcond=None)[0]
    return float(np.abs(corners @ affine - here).max())


def contents(grid: vtk.vtkUnstructuredGrid) -> dict[str, np.ndarray]:
    """Points, cells and fields as arrays; fails where VTK would draw a cell twisted."""
    points = np.array(grid.GetPoints().GetData())
    count = grid.GetNumberOfCells()
    assert max(node_error(grid.GetCell(i), points) for i in range(count)) < 1e-12
    cells = np.array(grid.GetCells().GetConnectivityArray()).reshape(count, -1)
    found = {"points": points, "cells": cells}
    for place, data in (("nodal", grid.GetPointData()), ("cellwise", grid.GetCellData())):
        for i in range(data.GetNumberOfArrays()):
            found[f"{place}/{data.GetArrayName(i)}"] = np.array(data.GetArray(i))
    return found


if __name__ == "__main__":
    for stem in sys.argv[2:]:
        np.savez(f"{stem}.npz", **contents(read(f"{stem}.xdmf", float(sys.argv[1]))))

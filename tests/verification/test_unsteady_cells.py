# SPDX-License-Identifier: LGPL-3.0-or-later
"""Operators over cells and faces against the forms that they write out, on hexahedra and tets."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import ufl
from boxes import HEX, TET, box
from dolfinx import fem
from mpi4py import MPI

from fem_tfm.fenics import compile_form
from fem_tfm.solvers.cells import CellMatrix, Cells

LENGTHS, NUMBER = (1.0, 0.8, 2.0), (3, 2, 4)
PARTS = ("inlet", "outlet", "wall", "symmetry")
SHAPES = {"hexahedra": (HEX, 0.0), "sheared": (HEX, 30.0), "tetrahedra": (TET, 0.0)}
SLOPE = np.array([0.3, -1.1, 0.7])


def cells_of(shape: str) -> Cells:
    kind, shear = SHAPES[shape]
    return Cells(box(LENGTHS, NUMBER, "wwssio", kind, shear), PARTS)


@pytest.mark.parametrize("shape", SHAPES)
def test_cells_close_and_fill_the_box(shape: str) -> None:
    cells = cells_of(shape)
    assert cells.total(cells.volume[: cells.owned]) == pytest.approx(np.prod(LENGTHS))
    assert np.abs(cells.sum(cells.area)).max() < 1e-14
    assert cells.total(cells.size[cells.parts["inlet"]]) == pytest.approx(LENGTHS[0] * LENGTHS[1])


@pytest.mark.parametrize("shape", SHAPES)
def test_linear_fields_have_their_gradient_and_their_values_on_faces(shape: str) -> None:
    cells = cells_of(shape)
    values = cells.centre @ SLOPE
    # a tetrahedron in a corner has two neighbours, which do not tell a gradient
    inner = np.arange(cells.faces) < cells.inner
    enough = cells.add(inner.astype(float)) >= 3
    assert enough.any()
    assert np.abs((cells.gradient(values) - SLOPE)[enough]).max() < 1e-12
    if shape != "tetrahedra":
        # centres of tetrahedra are not opposite each other across a face
        face = cells.middle[: cells.inner] @ SLOPE
        assert np.abs(cells.mean(values)[: cells.inner] - face).max() < 1e-12


@pytest.mark.parametrize("shape", SHAPES)
def test_a_uniform_field_is_found_from_its_fluxes(shape: str) -> None:
    cells = cells_of(shape)
    normal = cells.area @ SLOPE / cells.size
    assert np.abs(cells.reconstruction(["inlet"])(normal) - SLOPE).max() < 1e-12


def twin_of(cells: Cells, velocity: Any) -> Any:
    """Upwind transport and difference across faces as a form over interior facets."""
    domain = cells.mesh.mesh
    space = fem.functionspace(domain, ("DG", 0))
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    centre = fem.Function(fem.functionspace(domain, ("DG", 0, (3,))))
    centre.x.array[:] = cells.centre.ravel()
    n = ufl.FacetNormal(domain)
    metadata = {"quadrature_degree": 2}
    dS = ufl.dS(domain, metadata=metadata)
    through = ufl.dot(velocity, n("+"))
    apart = ufl.dot(centre("-") - centre("+"), n("+"))
    upwind = ufl.conditional(ufl.gt(through, 0.0), through * u("+"), through * u("-"))
    flux = upwind - (u("-") - u("+")) / apart
    return compile_form(flux * (v("+") - v("-")) * dS)


@pytest.mark.parametrize("shape", SHAPES)
def test_the_matrix_is_that_of_the_form(shape: str) -> None:
    cells = cells_of(shape)
    velocity = fem.Constant(cells.mesh.mesh, SLOPE)
    inner = slice(0, cells.inner)
    flux = cells.area @ SLOPE
    flux[cells.inner :] = 0.0
    spread = cells.reach.copy()
    spread[cells.inner :] = 0.0
    ahead, back = np.maximum(flux, 0.0), np.maximum(-flux, 0.0)
    matrix = CellMatrix(cells)
    matrix.set(
        [cells.sum_out(ahead, back) + cells.add(spread)],
        [(-(back + spread)[inner], -(ahead + spread)[inner])],
    )
    # unknowns of the lowest discontinuous space are numbered as the cells
    twin = fem.assemble_matrix(twin_of(cells, velocity))
    twin.scatter_reverse()
    wanted = twin.to_scipy()[: cells.owned]
    start, columns, values = matrix.matrix.getValuesCSR()
    found = np.zeros((cells.owned, cells.map.size_global))
    for row in range(cells.owned):
        part = slice(start[row], start[row + 1])
        found[row, columns[part]] += values[part]
    dense = np.zeros_like(found)
    place = cells.map.local_to_global(np.arange(cells.count, dtype=np.int32))
    dense[:, place] = wanted.toarray()
    assert np.abs(found - dense).max() < 1e-12 * np.abs(dense).max()
    matrix.destroy()


def test_ghosts_have_the_values_of_their_owners() -> None:
    cells = cells_of("hexahedra")
    whole = cells.whole(cells.centre[: cells.owned].copy())
    assert np.array_equal(whole, cells.centre)


def test_a_number_that_is_not_finite_is_seen_on_every_rank() -> None:
    cells = cells_of("hexahedra")
    values = np.ones(cells.owned)
    if MPI.COMM_WORLD.rank == 0:
        values[0] = np.nan
    assert not np.isfinite(cells.largest(values))

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
from petsc4py import PETSc

from fem_tfm.fenics import compile_form
from fem_tfm.models.finite_volume.cells.krylov import Krylov
from fem_tfm.models.finite_volume.cells.limiter import limit_flux, limited_increments
from fem_tfm.models.finite_volume.cells.matrix import CellMatrix
from fem_tfm.models.finite_volume.cells.mesh import Cells
from fem_tfm.models.finite_volume.cells.reconstruction import Reconstruction

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
    assert np.abs(cells.net_flux(cells.area)).max() < 1e-14
    assert cells.total(cells.face_area[cells.parts["inlet"]]) == pytest.approx(
        LENGTHS[0] * LENGTHS[1]
    )


@pytest.mark.parametrize("shape", SHAPES)
def test_linear_fields_have_their_gradient_and_their_values_on_faces(shape: str) -> None:
    cells = cells_of(shape)
    values = cells.centre @ SLOPE
    # a tetrahedron in a corner has two neighbours, which do not tell a gradient
    inner = np.arange(cells.face_count) < cells.inner_count
    enough = cells.sum_faces(inner.astype(float)) >= 3
    assert enough.any()
    assert np.abs((cells.gradient(values) - SLOPE)[enough]).max() < 1e-12
    if shape != "tetrahedra":
        # centres of tetrahedra are not opposite each other across a face
        face = cells.face_centre[: cells.inner_count] @ SLOPE
        assert np.abs(cells.to_faces(values)[: cells.inner_count] - face).max() < 1e-12


@pytest.mark.parametrize("shape", SHAPES)
def test_vectors_flow_through_faces_as_their_means_do(shape: str) -> None:
    cells = cells_of(shape)
    vectors = np.sin(cells.centre * SLOPE)
    wanted = np.einsum("ni,ni->n", cells.to_faces(vectors), cells.area)
    assert np.abs(cells.flux(vectors) - wanted).max() < 1e-15


@pytest.mark.parametrize("shape", SHAPES)
def test_a_uniform_field_is_found_from_its_fluxes(shape: str) -> None:
    cells = cells_of(shape)
    normal = cells.area @ SLOPE / cells.face_area
    assert np.abs(Reconstruction(cells, ["inlet"])(normal) - SLOPE).max() < 1e-12


@pytest.mark.parametrize("shape", SHAPES)
def test_linear_fields_have_their_values_on_faces_from_both_sides(shape: str) -> None:
    cells = cells_of(shape)
    values = np.stack([cells.centre @ SLOPE, cells.centre @ SLOPE[::-1]], axis=1)
    gradient = np.broadcast_to(np.stack([SLOPE, SLOPE[::-1]]), (cells.count, 2, 3))
    inner = slice(0, cells.inner_count)
    face = cells.face_centre[inner]
    wanted = np.stack([face @ SLOPE, face @ SLOPE[::-1]], axis=1)
    ahead, back = limited_increments(cells, values, gradient, 0.0)
    assert values[cells.first[inner]] + ahead == pytest.approx(wanted, abs=1e-12)
    assert values[cells.second] + back == pytest.approx(wanted, abs=1e-12)
    alone = limited_increments(cells, values[:, 0], gradient[:, 0], 0.0)
    assert alone[0] == pytest.approx(wanted[:, 0] - values[cells.first[inner], 0], abs=1e-12)


def row_of(number: int) -> tuple[Cells, np.ndarray]:
    """Cells in one row and their places along it."""
    cells = Cells(box((1.0, 1.0, 1.0), (1, 1, number), "ssssio"), PARTS)
    return cells, cells.centre[:, 2]


def test_values_on_faces_of_a_front_stay_between_those_of_their_cells() -> None:
    cells, z = row_of(12)
    values = np.where(z < 0.4, 1.0, 0.0) + np.where(z > 0.7, 0.5, 0.0)
    gradient = cells.ghosted(cells.gradient(values))
    inner = slice(0, cells.inner_count)
    sides = np.stack([values[cells.first[inner]], values[cells.second]])
    for value, rise in zip(sides, limited_increments(cells, values, gradient, 0.0), strict=True):
        assert np.all(value + rise <= sides.max(axis=0) + 1e-12)
        assert np.all(value + rise >= sides.min(axis=0) - 1e-12)


def test_values_on_faces_of_a_wave_are_of_second_order() -> None:
    errors = []
    for number in (16, 32, 64):
        cells, z = row_of(number)
        values = np.sin(2 * np.pi * z)
        gradient = cells.ghosted(cells.gradient(values))
        ahead, _ = limited_increments(cells, values, gradient, number**-1.5)
        inner = slice(0, cells.inner_count)
        face = np.sin(2 * np.pi * cells.face_centre[inner][:, 2])
        wrong = values[cells.first[inner]] + ahead - face
        errors.append(max(MPI.COMM_WORLD.allgather(np.abs(wrong).max(initial=0.0))))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders.min() > 1.8


@pytest.mark.parametrize("shape", SHAPES)
def test_reduced_fluxes_keep_cells_within_bounds_and_the_sum(shape: str) -> None:
    cells = cells_of(shape)
    flux = 5 * np.cos(7 * cells.face_centre @ SLOPE) * np.sign(cells.area @ SLOPE)
    flux[cells.inner_count :] = 0.0
    place = cells.centre[: cells.owned] @ SLOPE
    loss, gain = np.abs(np.sin(place)), np.abs(np.cos(3 * place))
    found = limit_flux(cells, flux, loss, gain)
    change = -cells.net_flux(found)
    assert np.all(change <= gain + 1e-12) and np.all(change >= -loss - 1e-12)
    assert abs(cells.total(change)) < 1e-12
    # some are reduced, none is turned or enlarged, and small ones are left alone
    assert np.all(found * flux >= 0) and np.all(np.abs(found) <= np.abs(flux))
    assert cells.largest(np.abs(found - flux)) > 0.1
    assert np.array_equal(limit_flux(cells, 1e-3 * flux, loss + 1, gain + 1), 1e-3 * flux)


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
    inner = slice(0, cells.inner_count)
    flux = cells.area @ SLOPE
    flux[cells.inner_count :] = 0.0
    spread = cells.face_weight.copy()
    spread[cells.inner_count :] = 0.0
    ahead, back = np.maximum(flux, 0.0), np.maximum(-flux, 0.0)
    matrix = CellMatrix(cells)
    matrix.set(
        [cells.sum_by_side(ahead, back) + cells.sum_faces(spread)],
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
    whole = cells.ghosted(cells.centre[: cells.owned].copy())
    assert np.array_equal(whole, cells.centre)


def test_a_number_that_is_not_finite_is_seen_on_every_rank() -> None:
    cells = cells_of("hexahedra")
    values = np.ones(cells.owned)
    if MPI.COMM_WORLD.rank == 0:
        values[0] = np.nan
    assert not np.isfinite(cells.largest(values))


@pytest.mark.parametrize("method", ["transport", "pressure"])
def test_linear_solvers_follow_the_options_of_the_user(method: str) -> None:
    matrix, table, prefix = (
        CellMatrix(cells_of("hexahedra")),
        PETSc.Options(),
        f"fem_tfm_cells_{method}_",
    )
    loose, tight = Krylov(matrix, method, 1e-4), Krylov(matrix, method, 1e-6)
    usual = table.getString(prefix + "ksp_type")
    assert (loose.ksp.getTolerances()[0], tight.ksp.getTolerances()[0]) == (1e-4, 1e-6)
    assert tight.ksp.getType() == usual == {"transport": "bcgs", "pressure": "cg"}[method]
    for key, value in {"ksp_type": "gmres", "ksp_rtol": 1e-9, "ksp_atol": 1e-7}.items():
        table[prefix + key] = value
    try:
        own = Krylov(matrix, method, 1e-4)
        own.reset()
        assert own.ksp.getType() == "gmres"
        assert own.ksp.getTolerances()[:2] == (1e-9, 1e-7)
    finally:
        table[prefix + "ksp_type"] = usual
        for key in ("ksp_rtol", "ksp_atol"):
            table.delValue(prefix + key)

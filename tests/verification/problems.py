# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the tests of the equations share: sections on one mesh, bare domains, Newton with a load."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh
from mpi4py import MPI

from fem_tfm import Case
from fem_tfm.fenics import compile_form
from fem_tfm.geometry.mesh import Mesh, section_mesh
from fem_tfm.models.two_fluid.forms import Domain, Stabilisation, State
from fem_tfm.models.two_fluid.section import TwoFluidSection
from fem_tfm.scenes.dense import SCHEME, setup_of
from fem_tfm.solvers.nested import QUIET, solve_level
from fem_tfm.solvers.newton import BorderedNewton

DEMO = Path(__file__).parents[2] / "demos" / "dense_pipe" / "algebraic.toml"


def demo(changes: Mapping[str, Any] | None = None) -> Case:
    """The demo's case with dotted keys changed."""
    return Case.load(DEMO).with_values(changes or {})


def mesh_of(case: Case, cell: float) -> Mesh:
    """Mesh of a case; `cell` is the core cell over the hydraulic diameter."""
    physics = case.scene.physics
    size = cell * physics.section.hydraulic_diameter
    return section_mesh(
        physics.section, replace(physics.resolution, mesh_size=size), MPI.COMM_WORLD
    )


def section_of(case: Case, cell: float) -> TwoFluidSection:
    """Section of a case on one mesh."""
    return TwoFluidSection(mesh_of(case, cell), setup_of(case.scene))


def solved(case: Case, cell: float) -> TwoFluidSection:
    """Section of a case at its steady state."""
    found = section_of(case, cell)
    solve_level(found, SCHEME.control(found, 1e-10, 200), None, QUIET, SCHEME)
    return found


def put(found: TwoFluidSection, state: State) -> None:
    """Interpolate a UFL state; what Dirichlet conditions hold is theirs."""
    for i, name in enumerate(found.names):
        space, dofs = found.space.sub(i).collapse()
        value = fem.Function(space)
        value.interpolate(fem.Expression(getattr(state, name), space.element.interpolation_points))
        found.now.x.array[np.asarray(dofs).ravel()] = value.x.array
    for condition in found.newton.bcs:
        condition.set(found.now.x.array)
    found.now.x.scatter_forward()


class LoadedNewton(BorderedNewton):
    """Solves F(W; v) = L(v): a section's own Newton with a load.

    Parameters
    ----------
    section : supplies forms, conditions and constraints
    load : linear form L, assembled once with the present values of its constants
    """

    def __init__(self, section: TwoFluidSection, load: Any) -> None:
        own = section.newton
        super().__init__(own.residual, own.jacobian, own.unknowns, own.bcs, own.borders, own.blocks)
        self.load = self.rhs.duplicate()
        self._assemble(compile_form(load), self.load)

    def assemble_residual(self) -> np.ndarray:
        """Owned part of F - L, zero on Dirichlet rows."""
        super().assemble_residual()
        self.rhs.axpy(-1, self.load)
        return self.rhs.array_r


def newton(system: BorderedNewton, tolerance: float = 1e-7, steps: int = 20) -> int:
    """Iterate to quadratic convergence, so that errors are of the size tolerance^2; steps used."""
    for step in range(1, steps + 1):
        update = system.step()
        if update.length == 1 and update.rest < tolerance:
            return step
    pytest.fail(f"no convergence in {steps} Newton steps: {update}")


def constants(mesh: Any, values: Any) -> Any:
    """A material, a closure set or numerics with its numbers as constants of a mesh."""
    return values.bound(lambda value: fem.Constant(mesh, float(value)))


def square(cells: int, degree: int, kind: dmesh.CellType) -> tuple[Any, Domain]:
    """Unit square with walls on all sides but x = 0, and smooth made-up distances."""
    mesh = dmesh.create_unit_square(MPI.COMM_SELF, cells, cells, kind)
    x, n = ufl.SpatialCoordinate(mesh), ufl.FacetNormal(mesh)
    mesh.topology.create_connectivity(1, 2)
    walls = np.setdiff1d(
        dmesh.exterior_facet_indices(mesh.topology),
        dmesh.locate_entities_boundary(mesh, 1, lambda p: np.isclose(p[0], 0.0)),
    )
    tags = dmesh.meshtags(mesh, 1, walls, np.ones(walls.size, dtype=np.int32))
    metadata = {"quadrature_degree": degree}
    domain = Domain(
        dx=ufl.Measure("dx", mesh, metadata=metadata),
        ds_wall=ufl.Measure("ds", mesh, subdomain_data=tags, metadata=metadata)(1),
        normal=ufl.as_vector((n[0], n[1], 0.0)),
        wall_distance=distance(x),
        wall_offset=fem.Constant(mesh, OFFSET),
        diameter=fem.Constant(mesh, 2 * RADIUS),
        wall_cell=fem.Constant(mesh, WALL_CELL),
        cell_area=fem.Constant(mesh, WALL_CELL**2),
    )
    return mesh, domain


# distances of the unit square: below the radius and within the strip of a wall law, hence smooth
OFFSET, RADIUS, WALL_CELL = 0.5, 2.0, 0.125


def distance(x: Any) -> Any:
    """A smooth stand-in for the wall distance, of UFL or numpy coordinates."""
    return 0.3 + 0.2 * x[0] * x[1] - 0.1 * x[0] ** 2


def plain_numerics(**changes: float) -> Stabilisation:
    """Regularisations of order one, so that every term of the forms weighs."""
    values = {
        "alpha_diffusion": 0.1,
        "capture": 2.0,
        "damping": 3.0,
        "smallest_front_rate": 0.15,
        "smallest_rate": 0.1,
        "theta_floor": 0.01,
        "slip_floor": 0.1,
        "grain_gap": 0.0,
        "k_floor": 0.02,
        "void_fraction": 0.1,
        "max_frictional_viscosity": 1e30,
        "shear_floor": 0.1,
        "wall_penalty": 3.0,
        "wall_speed": 0.5,
        "pressure_shift": 0.05,
        "relaxation": 0.3,
        "residual_fraction": 0.12,
        "theta_free": 0.3,
        "smoothing": 0.2,
    }
    return Stabilisation(**{**values, **changes})

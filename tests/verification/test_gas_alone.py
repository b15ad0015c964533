# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gas alone on the developed section against closed forms and the friction of smooth pipes."""

from __future__ import annotations

import functools
import math
from functools import partial
from typing import Any

import pytest
from mpi4py import MPI
from sections import drive, orders, prandtl_karman, quantities, solve

from fem_tfm import Case
from fem_tfm.geometry.mesh import section_mesh
from fem_tfm.geometry.resolution import Resolution
from fem_tfm.geometry.section import RectangularSection, RoundSection
from fem_tfm.models.two_fluid.quantities import balances

REYNOLDS = [2e4, 5e4, 1e5, 3e5, 1e6]
VELOCITY, DENSITY, SIZE = 3.0, 1.2, 0.05


def gas_case(reynolds: float, **tables: Any) -> Case:
    """Gas in a pipe or square duct of size 0.05 m at a Reynolds number."""
    values = {
        "geometry": {"diameter": SIZE},
        "gas": {"density": DENSITY, "viscosity": DENSITY * VELOCITY * SIZE / reynolds},
        "operation": {"gas_superficial_velocity": VELOCITY},
    }
    return Case.from_dict(values | tables)


def laminar(geometry: dict[str, Any], wall: str = "no-slip") -> Case:
    """Laminar gas at Re = 500."""
    return gas_case(
        500.0, geometry=geometry, closures={"turbulence": "laminar"}, walls={"gas": wall}
    )


def darcy(gradient: float) -> float:
    """f = 2 D G/(rho U^2) [-]."""
    return 2 * SIZE * gradient / (DENSITY * VELOCITY**2)


# -- laminar -----------------------------------------------------------------------------------


def square_duct_constant() -> float:
    """f Re of a square duct, 24/(1 - 192/pi^5 sum tanh(n pi/2)/n^5) over odd n."""
    series = math.fsum(math.tanh(n * math.pi / 2) / n**5 for n in range(1, 99, 2))
    return 24 / (1 - 192 / math.pi**5 * series)


@pytest.mark.parametrize(
    ("given", "geometry", "constant"),
    [
        ({"diameter": SIZE}, RoundSection(SIZE), 64.0),
        ({"shape": "duct", "width": SIZE}, RectangularSection(SIZE, SIZE), square_duct_constant()),
    ],
    ids=["pipe", "square-duct"],
)
def test_laminar_friction_and_its_order(
    given: dict[str, Any], geometry: Any, constant: float
) -> None:
    """f Re = 64 (G = 32 mu U/D^2) and 56.91; P2 gives the flux at order 4."""
    errors = []
    for size in (SIZE / 4, SIZE / 8, SIZE / 16):
        resolution = Resolution(mesh_size=size, wall_grading=1.0)
        mesh = partial(section_mesh, geometry, resolution, MPI.COMM_WORLD)
        gradient = drive(solve(laminar(given), meshes=[mesh]))
        errors.append(abs(darcy(gradient) * 500.0 / constant - 1))
    assert errors[-1] < 5e-5
    assert min(orders(errors)) > 3.5


def test_square_duct_constant() -> None:
    assert square_duct_constant() == pytest.approx(56.908, abs=1e-3)


def test_laminar_velocity_is_the_parabola() -> None:
    """Twice the mean on the axis; nothing across the section."""
    solution = solve(laminar({"diameter": SIZE}))
    u = solution.section.unknown("u_g").x.array.reshape(-1, 3)
    assert u[:, 2].max() == pytest.approx(2 * VELOCITY, rel=1e-4)
    assert abs(u[:, :2]).max() < 1e-9 * VELOCITY
    assert quantities(solution)["gas_mass_flow"] == pytest.approx(
        DENSITY * VELOCITY * math.pi * SIZE**2 / 4, rel=1e-5
    )


@pytest.mark.parametrize("distance", [0.01, 0.02])
def test_the_wall_law_is_exact_in_viscous_flow(distance: float) -> None:
    """Re = 500 lies in the viscous sublayer of the law: f = 64/Re wherever the law is applied."""
    case = laminar({"diameter": SIZE}, "log-law").with_values({"walls.distance": distance * SIZE})
    assert darcy(drive(solve(case))) == pytest.approx(64 / 500, rel=5e-3)


# -- turbulent ---------------------------------------------------------------------------------


@functools.cache
def turbulent(reynolds: float, distance: float = 0.01, level: int = 3) -> Any:
    """Solution with mixing length and log law; `distance` over the diameter."""
    walls = {"distance": distance * SIZE}
    return solve(gas_case(reynolds, walls=walls, numerics={"level": level}))


@pytest.mark.parametrize("reynolds", REYNOLDS)
def test_friction_factor_of_a_smooth_pipe(reynolds: float) -> None:
    """Darcy's f within 3 % of Prandtl-Karman at the default mesh and wall distance."""
    default = gas_case(reynolds)
    assert default.scene.wall_offset == pytest.approx(0.01 * SIZE)
    assert default["numerics.level"] == 3
    f = darcy(drive(turbulent(reynolds)))
    assert f == pytest.approx(prandtl_karman(reynolds), rel=0.03)


@pytest.mark.parametrize("reynolds", [2e4, 1e5, 1e6])
@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_friction_hardly_depends_on_the_wall_distance(reynolds: float, factor: float) -> None:
    """Half or twice the distance changes f by less than 3 %, 3.5 % down to y+ = 5 at Re 2e4."""
    near, default = (drive(turbulent(reynolds, d)) for d in (0.01 * factor, 0.01))
    allowed = 0.035 if (reynolds, factor) == (2e4, 0.5) else 0.03
    assert near == pytest.approx(default, rel=allowed)
    assert near != default


@pytest.mark.parametrize("reynolds", [2e4, 1e6])
def test_turbulent_friction_is_converged_on_the_default_mesh(reynolds: float) -> None:
    """Level 3 within 0.5 % of level 5, whose cells are half as large."""
    assert drive(turbulent(reynolds)) == pytest.approx(
        drive(turbulent(reynolds, level=5)), rel=5e-3
    )


def test_velocity_on_the_axis() -> None:
    """(U_max - U)/u_tau = 4.07, Prandtl's velocity defect of pipes, within 10 %."""
    solution = turbulent(1e5)
    axis = solution.section.unknown("u_g").x.array.reshape(-1, 3)[:, 2].max()
    friction_velocity = math.sqrt(drive(solution) * SIZE / 4 / DENSITY)
    assert (axis - VELOCITY) / friction_velocity == pytest.approx(4.07, rel=0.1)


@pytest.mark.parametrize("wall", ["no-slip", "log-law"])
def test_the_wall_carries_the_pressure_gradient(wall: str) -> None:
    """G A = force of the wall, by the reaction or by the law; the flux is the one asked for."""
    solution = solve(laminar({"diameter": SIZE})) if wall == "no-slip" else turbulent(1e5)
    kept = balances(solution.section)
    assert set(kept) == {"gas_mass", "axial_momentum"}
    assert max(kept.values()) < 1e-10


def test_a_state_that_is_put_back_is_at_rest() -> None:
    """The reaction of a wall without slip holds nothing of a step that was taken back."""
    found = solve(laminar({"diameter": SIZE})).section
    kept = found.stored()
    found.idt.value = 1e5
    found.old.x.array[:] = 1.1 * found.now.x.array
    assert balances(found)["axial_momentum"] > 1e-3
    found.restore(kept)
    assert balances(found)["axial_momentum"] < 1e-10

# SPDX-License-Identifier: LGPL-3.0-or-later
"""A duct's gas: friction, secondary flow, symmetry, meshes, laws, heat and the march to them."""

from __future__ import annotations

import functools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from sections import march, solve

from fem_tfm import Case
from fem_tfm.correlations import gnielinski, jones_friction, smooth_friction
from fem_tfm.errors import InputError, SolverError
from fem_tfm.models.line import Line
from fem_tfm.models.reynolds_stress import initial
from fem_tfm.models.reynolds_stress.section import ReynoldsStressSection
from fem_tfm.scenes import duct
from fem_tfm.solvers import nested
from fem_tfm.study import sweep

BASE = {
    "flow": "duct",
    "geometry": {"shape": "duct", "width": 0.2, "length": 16.0},
    "gas": {"density": 1.2, "viscosity": 1.8e-5},
    "operation": {"gas_superficial_velocity": 22.0},
    "walls": {"distance": 8e-4},
    "numerics": {"mesh_size": 0.0292},
}
# 10 cells a side of the quarter have a core cell of 29 mm; the finest of 40 give these
FINE = {"friction_factor": 0.014034, "secondary_velocity_max": 0.010680, "centre_to_bulk": 1.15682}


def case(**changes: Any) -> Case:
    """The duct of 200 mm with changes; "a__b" stands for the key "a.b"."""
    given = {key.replace("__", "."): value for key, value in changes.items()}
    return Case.from_dict(BASE).with_values(given)


@functools.cache
def solved(**changes: Any) -> nested.Solution:
    return solve(case(**changes))


@functools.cache
def told(**changes: Any) -> dict[str, float]:
    section = solved(**changes).section
    duct.check_realisable(section)
    return duct.quantities(section, 1.2, 16.0)


# -- the developed section ---------------------------------------------------------------------


def test_converges_from_a_cold_start_and_closes_its_balances() -> None:
    solution = solved()
    assert solution.section.mesh.num_cells == 100
    assert solution.levels[-1].history.update <= 1e-9
    assert abs(solution.section.newton.assemble_residual()).max() < 1e-9
    kept = duct.checked_balances(solution.section)
    assert kept["gas_mass"] < 1e-12
    assert kept["axial_momentum"] < 1e-10


@pytest.mark.parametrize("name", list(FINE))
def test_ten_cells_against_forty(name: str) -> None:
    """Within 1.3 %; twenty cells are within 0.4 %."""
    assert told()[name] == pytest.approx(FINE[name], rel=0.013)


@pytest.mark.slow
def test_value_on_the_fine_mesh() -> None:
    """Where `FINE` comes from, and twenty cells within 1 % of it."""
    fine, middle = (told(numerics__mesh_size=0.0292 / n) for n in (4, 2))
    for name, value in FINE.items():
        assert fine[name] == pytest.approx(value, rel=2e-3)
        assert middle[name] == pytest.approx(fine[name], rel=0.01)


def test_secondary_flow_is_prandtls() -> None:
    """Towards the corner along the diagonal, away from it along walls and bisectors."""
    lines = duct.profiles(solved().section)
    outward = lines["diagonal outward/U"]
    assert outward.min() > -1e-4
    assert 0.005 < outward.max() < 0.02
    assert lines["wall along/U"][1:-1].max() < 1e-4
    assert lines["wall along/U"].min() < -0.005
    assert lines["bisector outward/U"].min() < -0.001
    shear = lines["wall shear/mean"]
    assert shear[-1] == pytest.approx(0.59, abs=0.02)
    assert shear[0] == pytest.approx(1.04, abs=0.02)


def test_the_demo_follows_a_slower_gas(root: Path) -> None:
    """At 3 m/s the wall function stands further off, where it holds."""
    slow = ["operation.gas_superficial_velocity=3", "numerics.mesh_size=0.0292"]
    given = Case.load(root / "demos/square_duct/gas.toml", slow)
    assert not given.scene.warnings()
    section = solve(given).section
    friction = duct.quantities(section, 1.2, 16.0)["friction_factor"]
    assert friction == pytest.approx(jones_friction(3 * 0.2 / 1.5e-5, 1, 1), rel=0.05)


def test_symmetric_about_the_diagonal() -> None:
    """u(x, y) = v(y, x) and w(x, y) = w(y, x), though nothing imposes it."""
    section = solved().section
    u = section.unknown("u")
    points = u.function_space.tabulate_dof_coordinates()
    values = u.x.array.reshape(-1, 3)
    mirror = np.linalg.norm(points[:, None, :2] - points[None, :, 1::-1], axis=2).argmin(axis=1)
    away = values - values[mirror][:, [1, 0, 2]]
    assert abs(away).max() < 1e-8 * section.setup.gas_velocity


@pytest.mark.parametrize("symmetry", ["half", "none"])
def test_parts_of_the_section_agree(symmetry: str) -> None:
    """Half and whole sections find the quarter's flow."""
    part, quarter = (
        told(numerics__mesh_size=0.06, geometry__symmetry=s) for s in (symmetry, "quarter")
    )
    for name, value in quarter.items():
        assert part[name] == pytest.approx(value, rel=1e-6), name


@pytest.mark.slow
def test_triangles_agree_with_quadrilaterals() -> None:
    triangles = told(numerics__cells="triangle")
    for name, value in FINE.items():
        assert triangles[name] == pytest.approx(value, rel=0.013)


def test_k_epsilon_has_no_secondary_flow() -> None:
    """The control: an eddy viscosity makes none, to round-off."""
    found = told(closures__reynolds_stress="k-epsilon")
    assert found["secondary_velocity_max"] < 1e-10
    assert found["friction_factor"] == pytest.approx(jones_friction(2.933e5, 1, 1), rel=0.06)


@pytest.mark.slow
def test_ssg_agrees_with_lrr_where_it_must() -> None:
    found = told(closures__reynolds_stress="ssg")
    friction = jones_friction(2.933e5, 1, 1)
    assert found["friction_factor"] == pytest.approx(friction, rel=0.06)
    assert 0.005 < found["secondary_velocity_diagonal"] < 0.02


def test_printed_constants_can_be_chosen() -> None:
    """C_mu = 0.09 in f_z and in the wall function, as printed, moves the friction little."""
    laws = {
        "closures.reynolds_stress": {"model": "lrr", "C_mu": 0.09},
        "walls.function": {"model": "equilibrium", "C_mu": 0.09},
    }
    solution = solve(case().with_values(laws))
    found = duct.quantities(solution.section, 1.2, 16.0)["friction_factor"]
    assert found == pytest.approx(told()["friction_factor"], rel=0.02)
    assert found != pytest.approx(told()["friction_factor"], rel=1e-4)


def test_numbers_change_without_new_forms() -> None:
    """Another speed on the same section gives what a new section gives."""
    faster = {"numerics__mesh_size": 0.06, "operation__gas_superficial_velocity": 26.0}
    section = solve(case(numerics__mesh_size=0.06)).section
    section.update(case(**faster).scene.physics.setup())
    control = duct.SCHEME.control(section, 1e-9, 50)
    nested.march_of(section, nested.QUIET)(control).run(first=control.largest)
    expected = told(**faster)
    for name, value in duct.quantities(section, 1.2, 16.0).items():
        assert value == pytest.approx(expected[name], rel=1e-7), name


@pytest.mark.slow
@pytest.mark.parametrize("aspect", [1.0, 2.0, 4.0])
@pytest.mark.parametrize("reynolds", [2e4, 1e5, 1e6])
def test_cold_start_needs_no_guess(reynolds: float, aspect: float) -> None:
    width = 0.2 * aspect
    speed = reynolds * 1.5e-5 / (2 * width * 0.2 / (width + 0.2))
    given = case(
        geometry__width=width,
        geometry__height=0.2,
        operation__gas_superficial_velocity=speed,
        walls__distance=None,
        numerics__mesh_size=None,
        numerics__level=2,
    )
    solution = solve(given)
    duct.checked_balances(solution.section)
    friction = duct.quantities(solution.section, 1.2, 16.0)["friction_factor"]
    assert friction == pytest.approx(jones_friction(reynolds, width, 0.2), rel=0.12)


@pytest.mark.slow
def test_pipe() -> None:
    """A round pipe has no secondary flow and the friction of a pipe."""
    given = Case.from_dict(
        {**BASE, "geometry": {"shape": "pipe", "diameter": 0.2}, "numerics": {"level": 2}}
    )
    solution = solve(given)
    found = duct.quantities(solution.section, 1.2, 1.0)
    assert found["friction_factor"] == pytest.approx(
        smooth_friction(given.scene.reynolds), rel=0.06
    )
    assert found["secondary_velocity_max"] < 2e-3


def test_a_stress_that_cannot_be_is_no_answer() -> None:
    section = solve(case(numerics__mesh_size=0.06)).section
    assert duct.smallest_stress(section) > 0.1
    r = section.unknown("r")
    # R_xz^2 above R_xx R_zz
    r.x.array[4::6] = 2 * np.sqrt(r.x.array[0::6] * r.x.array[2::6])
    section.set_unknown("r", r)
    with pytest.raises(SolverError, match="Reynolds stress"):
        duct.checked_balances(section)


def test_jacobian_is_the_derivative_of_the_residual() -> None:
    """Differences along a random direction, block by block, at a state off the solution."""
    scene = case(numerics__mesh_size=0.08).scene
    section = ReynoldsStressSection(scene.mesh(), scene.physics.setup())
    initial.cold(section)
    section.idt.value = 3.0
    section.old.x.array[:] = 0.9 * section.now.x.array
    newton, start = section.newton, section.now.x.array.copy()
    newton.factor()
    rng = np.random.default_rng(2)
    for i, name in enumerate(section.names):
        direction = np.zeros_like(start)
        direction[section.owned_dofs[i]] = rng.normal(size=len(section.owned_dofs[i]))
        direction *= 1e-6 * max(abs(start[section.owned_dofs[i]]).max(), 1.0)
        for bc in newton.bcs:
            bc.set(direction, alpha=0.0)
        vector = newton.rhs.duplicate()
        vector.array[:] = direction[: vector.local_size]
        product = newton.rhs.duplicate()
        newton.matrix.mult(vector, product)
        sides = []
        for sign in (1, -1):
            section.now.x.array[:] = start + sign * direction
            sides.append(newton.assemble_residual().copy())
        section.now.x.array[:] = start
        change, expected = (sides[0] - sides[1]) / 2, product.array_r.copy()
        fixed = np.concatenate([bc.dof_indices()[0] for bc in newton.bcs])
        expected[fixed] = change[fixed] = 0.0
        assert abs(expected).max() > 0, name
        assert abs(change - expected).max() < 1e-5 * abs(expected).max(), name


# -- heat --------------------------------------------------------------------------------------


@pytest.mark.parametrize("wall", ["flux", "temperature"])
def test_heat(wall: str) -> None:
    """Balance to round-off, Nu near Gnielinski's, Pr_t of the log layer at the wall."""
    given = case(heat={"wall": wall, "prandtl": 0.71})
    heat, found = duct.developed_heat(given.scene, solved().section)
    assert heat.balance() < 1e-10
    assert found["nusselt"] == pytest.approx(gnielinski(given.scene.reynolds, 0.71), rel=0.12)
    assert found["turbulent_prandtl_wall"] == pytest.approx(0.79, abs=0.15)
    assert 0.3 < found["turbulent_prandtl_axis"] < 0.7


def test_a_wall_of_one_temperature_gives_less_than_one_of_one_flux() -> None:
    section = solved().section
    values = [
        duct.developed_heat(case(heat={"wall": wall}).scene, section)[1]["nusselt"]
        for wall in ("temperature", "flux")
    ]
    assert 0.97 < values[0] / values[1] < 1.0


# -- the march ---------------------------------------------------------------------------------


@functools.cache
def marched(length: float, size: float) -> Line:
    given = case(
        solution="developing",
        geometry__length=length,
        numerics__mesh_size=size,
        inlet={"gas_intensity": 0.05},
        heat={"wall": "temperature", "wall_temperature": 350.0},
    )
    return march(given)


def test_a_march_conserves_mass_momentum_and_heat() -> None:
    line = marched(0.1, 0.06)
    assert len(line.rows) > 8
    kept = line.balances()
    assert kept["gas_mass"] < 1e-12
    assert kept["heat"] < 1e-9
    assert kept["axial_momentum"] < 1e-8
    last = line.rows[-1]
    # the entrance pays for its boundary layers with more than the friction
    assert -last["pressure"] == pytest.approx(last["friction_drop"] + last["flux_drop"], rel=1e-8)
    assert last["flux_drop"] > 0.1 * last["friction_drop"] > 0
    warmth = [row["bulk_temperature"] for row in line.rows]
    assert warmth == sorted(warmth)
    assert line.rows[-1]["friction_factor"] < line.rows[1]["friction_factor"]
    assert min(row["smallest_stress"] for row in line.rows) > 0


@pytest.mark.slow
def test_a_march_ends_on_the_developed_solution() -> None:
    """80 diameters: within 0.5 %, after an overshoot of the centre line."""
    line = marched(16.0, 0.0292)
    found, expected = line.quantities(), told()
    for name in ("friction_factor", "centre_to_bulk", "secondary_velocity_max"):
        assert found[name] == pytest.approx(expected[name], rel=5e-3), name
    assert 1.17 < found["overshoot"] < 1.19
    assert 25 < found["overshoot_diameters"] < 40
    heat = duct.developed_heat(case(heat={"wall": "temperature"}).scene, solved().section)[1]
    assert found["nusselt"] == pytest.approx(heat["nusselt"], rel=5e-3)
    assert max(line.balances().values()) < 1e-9


def test_an_interrupted_march_goes_on(tmp_path: Any) -> None:
    """Stopped by Ctrl-C after some stations and resumed, it ends where it ends alone."""
    given = case(
        solution="developing",
        geometry__length=0.1,
        numerics__mesh_size=0.06,
        heat={"wall": "flux", "wall_flux": 500.0},
    )

    whole = march(given)
    with pytest.raises(KeyboardInterrupt):
        march(given, tmp_path, most=5)
    resumed = march(given, tmp_path, resume=True)
    assert len(resumed.rows) == len(whole.rows)
    for name, value in whole.quantities().items():
        assert resumed.quantities()[name] == pytest.approx(value, rel=1e-7), name


# -- the run -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "solution", ["developed", pytest.param("developing", marks=pytest.mark.slow)]
)
def test_run_writes_its_files(solution: str, tmp_path: Any) -> None:
    out = tmp_path / "out"
    given = case(
        solution=solution,
        geometry__length=0.02,
        numerics__mesh_size=0.06,
        heat={"wall": "flux", "wall_flux": 500.0},
    )
    result = given.scene.run(out)
    assert result.status == {"developed": "converged", "developing": "finished"}[solution]
    files = ["result.json", "profiles.csv", "profiles.png", "section.png", "fields.xdmf"]
    files += ["axis.csv", "axis.png"] if solution == "developing" else []
    if MPI.COMM_WORLD.rank == 0:
        for name in files:
            assert (out / name).stat().st_size > 500, name
    friction = result.quantities["friction_factor"]
    assert "Jones" in friction.source
    assert friction.reference == pytest.approx(0.01421, abs=1e-5)
    assert math.isfinite(result["nusselt"])
    assert result.balances["heat"] < 1e-9


def test_a_sweep_solves_ducts(tmp_path: Any) -> None:
    speeds = [10.0, 20.0]
    given = case(numerics__mesh_size=0.06, walls__distance=None)
    found = sweep.run(given, {"operation.gas_superficial_velocity": speeds}, tmp_path)
    frictions = [point.quantities["friction_factor"] for point in found.points]
    assert frictions[0] > frictions[1] > 0.01
    assert not found.failed


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("solids", {"density": 1000.0, "diameter": 1e-4}),
        ("heat.prandtl", -1.0),
        ("closures.reynolds_stress", "rsm"),
        ("walls.distance", 0.2),
    ],
)
def test_what_does_not_belong_is_refused(key: str, value: Any) -> None:
    with pytest.raises(InputError):
        case().with_values({key: value})


def test_heat_belongs_to_ducts() -> None:
    dense = {**BASE, "flow": "dense", "heat": {}, "numerics": {}}
    with pytest.raises(InputError, match="duct"):
        Case.from_dict(dense)

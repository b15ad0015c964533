# SPDX-License-Identifier: LGPL-3.0-or-later
"""The dense section of the demo: convergence, meshes, symmetry, feeds and the order of the beds."""

from __future__ import annotations

import functools
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sections import DEMO, drive, factorisations, quantities, solve

from fem_tfm import Case
from fem_tfm.closures import names
from fem_tfm.errors import SolverError
from fem_tfm.models.two_fluid import initial
from fem_tfm.models.two_fluid.quantities import balances
from fem_tfm.models.two_fluid.section import TwoFluidSection as Section
from fem_tfm.scenes import dense
from fem_tfm.solvers import easing, nested
from fem_tfm.solvers.easing import MeshTerms
from fem_tfm.solvers.newton import LinearSolveError
from fem_tfm.solvers.pseudo_time import PseudoTime

BASE = Case.load(Path(__file__).parents[2] / DEMO)
# models that the quick tests cover; each of the others costs its compilation and no more
PAPER = ("dartevelle", "srivastava-sundaresan", "berzi")
# the classic pair without a viscosity that grows from zero begins at close packing
FROM_PACKING = {"schaeffer": 0.58, "syamlal": 0.58}
# G of the demo on level 7 (4864 cells) [Pa/m], from the slow test
FINE = 3320.97


@functools.cache
def solved(**changes: Any) -> nested.Solution:
    """Demo with changes; "a__b" stands for the key "a.b"."""
    return solve(BASE.with_values({key.replace("__", "."): v for key, v in changes.items()}))


def friction_case(name: str, level: int = 3) -> dict[str, Any]:
    """Changes that choose a friction model as a user would."""
    given = {"closures__friction": name, "numerics__level": level}
    if name in FROM_PACKING:
        given["solids__friction_limit"] = FROM_PACKING[name]
    return given


# -- friction ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name",
    [n if n in PAPER else pytest.param(n, marks=pytest.mark.slow) for n in names("friction")],
)
def test_every_friction_model_converges_from_the_cold_start(name: str) -> None:
    """Down to an update of 1e-9 on every mesh, with balances closed and alpha_s below packing."""
    solution = solved(**friction_case(name))
    assert len(solution.levels) == len(BASE.scene.physics.meshes())
    assert solution.levels[-1].history.update <= 1e-9
    assert max(balances(solution.section).values()) < 1e-9
    found = quantities(solution)
    assert 0.245 < found["max_solids_fraction"] < 0.63
    assert found["holdup"] == pytest.approx(0.245, rel=1e-9)
    assert drive(solution) == pytest.approx(solution.levels[-2].drive, rel=0.02)


def test_stiffer_friction_makes_a_looser_bed() -> None:
    """Densest point of the bed: Dartevelle < Srivastava-Sundaresan < Berzi; dp the other way."""
    beds = [quantities(solved(**friction_case(n)))["max_solids_fraction"] for n in PAPER]
    assert beds[0] + 0.02 < beds[1]
    assert beds[1] + 0.02 < beds[2]
    assert beds[0] > BASE["solids.friction_limit"]
    gradients = {n: drive(solved(**friction_case(n))) for n in PAPER}
    assert max(gradients, key=gradients.get) == "dartevelle"


@pytest.mark.slow
def test_friction_keeps_the_bed_from_packing() -> None:
    """Without friction the bed falls to the packing limit and the wall lets it slide."""
    free, berzi = (solved(**friction_case(n)) for n in ("none", "berzi"))
    assert quantities(free)["max_solids_fraction"] == pytest.approx(0.63, abs=1e-3)
    assert drive(free) < 0.9 * drive(berzi)


# -- meshes ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("level", "tolerance"), [(1, 0.01), (3, 0.002)])
def test_pressure_gradient_against_a_fine_mesh(level: int, tolerance: float) -> None:
    assert drive(solved(numerics__level=level)) == pytest.approx(FINE, rel=tolerance)


@pytest.mark.parametrize(("grading", "tolerance"), [(0.5, 0.01), (0.1, 0.002)])
def test_pressure_gradient_hardly_depends_on_the_wall_cell(
    grading: float, tolerance: float
) -> None:
    """A wall cell twice as thick changes G by less than 1 %, one 2.5 times thinner by 0.2 %."""
    found = drive(solved(numerics__wall_grading=grading))
    assert found == pytest.approx(FINE, rel=tolerance)
    assert found != drive(solved())


@pytest.mark.slow
def test_value_on_the_fine_mesh() -> None:
    """Where `FINE` comes from."""
    assert drive(solved(numerics__level=7)) == pytest.approx(FINE, rel=1e-5)


@pytest.mark.parametrize("level", [1, 3])
def test_whole_section_equals_half_section(level: int) -> None:
    """The mesh of the whole section is the half and its mirror image: the same G and fluxes."""
    half, whole = (solved(numerics__level=level, geometry__symmetry=s) for s in ("half", "none"))
    assert whole.section.mesh.num_cells == 2 * half.section.mesh.num_cells
    assert drive(whole) == pytest.approx(drive(half), rel=1e-6)
    expected = quantities(half)
    for name, value in quantities(whole).items():
        assert value == pytest.approx(expected[name], rel=1e-6), name


def test_whole_section_is_symmetric() -> None:
    """alpha_s(-x, y) = alpha_s(x, y) though nothing imposes it."""
    section = solved(numerics__level=1, geometry__symmetry="none").section
    alpha = section.fields()["alpha_s"]
    points, values = alpha.function_space.tabulate_dof_coordinates(), alpha.x.array
    distance = np.linalg.norm(points[:, None, :2] * (-1, 1) - points[None, :, :2], axis=2)
    mirror = distance.argmin(axis=1)
    assert distance.min(axis=1).max() < 1e-9
    assert abs(values - values[mirror]).max() < 1e-6
    assert np.ptp(values) > 0.3


# -- feeds and starts --------------------------------------------------------------------------


def test_flux_feed_returns_the_holdup() -> None:
    """A flux equal to that of the hold-up feed gives its hold-up and G back.

    All but 1e-4 of it: the regularisation of voids goes with the hold-up that is likely.
    """
    given = solved(numerics__level=1)
    velocity = quantities(given)["solids_mass_flow"] / (1700.0 * BASE.scene.geometry.area)
    changes = {"solids_fraction": None, "solids_superficial_velocity": velocity}
    case = BASE.with_values({f"operation.{k}": v for k, v in changes.items()})
    found = solve(case.with_values({"numerics.level": 1}))
    assert quantities(found)["holdup"] == pytest.approx(0.245, rel=1e-5)
    assert drive(found) == pytest.approx(drive(given), rel=1e-4)


def test_warm_start_is_cheap() -> None:
    """2 % more gas from the answer at hand: a quarter of the cold factorisations, the same G."""
    case = BASE.with_values({"operation.gas_superficial_velocity": 6.56})
    cold, given = solve(case), solved()
    section = Section(given.section.mesh, case.scene.physics.setup())
    control = dense.SCHEME.control(section, 1e-9, 200)
    history = nested.solve_level(section, control, given.section, nested.QUIET, dense.SCHEME)
    assert history.update <= 1e-9
    assert float(section.drive.value) == pytest.approx(drive(cold), rel=1e-7)
    assert section.newton.factorisations <= sum(factorisations(cold)) / 4


@pytest.mark.parametrize("trials", [2, 3])
def test_a_warm_start_that_loses_its_lead_gives_way(
    trials: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It takes no step below the first one of a cold start, with which it then starts again.

    Where that fails too, a calm state is tried before the third trial, and fails here as well.
    """
    given, step = solved(numerics__level=1), PseudoTime._step
    section = Section(given.section.mesh, given.section.setup)
    astray, tried, starts, calms = [True], list[float](), list[int](), list[int]()

    def fails(march: PseudoTime, dt: float) -> dict[str, float]:
        if astray:
            march._keep()
            tried.append(dt)
            raise LinearSolveError("astray")
        return step(march, dt)

    def warm(found: Section, other: Section) -> None:
        assert other is given.section
        starts.append(len(tried))
        if len(starts) == trials:
            astray.clear()
        dense.SCHEME.warm(found, other)

    def calm(found: Section) -> None:
        calms.append(len(starts))
        initial.calm(found)

    monkeypatch.setattr(PseudoTime, "_step", fails)
    scheme = replace(dense.SCHEME, warm=warm, calm=calm)
    control = dense.SCHEME.control(section, 1e-9, 200)
    nested.solve_level(section, control, given.section, nested.QUIET, scheme)
    assert tried[0] == control.largest
    assert control.first <= tried[starts[1] - 1] < 100 * control.first
    assert tried[starts[1] :][:1] == [control.first] * (trials - 2)
    assert calms == [2] * (trials - 2) and len(starts) == trials
    assert not section.mesh_terms.raised
    assert float(section.drive.value) == pytest.approx(drive(given), rel=1e-7)


def test_a_calm_flow_leads_to_the_same_answer() -> None:
    """From solids that the mesh's terms mix over the section, the branch ends at the cold G."""
    given = solved(numerics__level=1)
    section = Section(given.section.mesh, given.section.setup)
    control = dense.SCHEME.control(section, 1e-9, 100)
    section.ease(MeshTerms(rate=10**easing.CALMEST))
    initial.calm(section)
    easing.Calming(section, nested.march_of(section, nested.QUIET), control, Section.ease).run()
    assert not section.mesh_terms.raised and section.rougher is None
    assert float(section.drive.value) == pytest.approx(drive(given), rel=1e-6)


@pytest.mark.slow
def test_a_calm_start_of_solids_that_the_wall_holds() -> None:
    case = BASE.with_values({"walls.solids": "no-slip", "numerics.level": 1})
    section = Section(case.scene.physics.meshes()[0](), case.scene.physics.setup())
    initial.calm(section)
    alpha, speed = initial.solids_guess(section)
    state = section.state(section.now)
    moved = section.integral("moved", section.model.alpha(state) * state.u_s[2])
    assert moved / section.area == pytest.approx(alpha * speed, rel=0.02)
    at_wall = section.integral("at wall", state.u_s[2] ** 2, section.domain.ds_wall)
    assert at_wall == pytest.approx(0.0, abs=1e-12)


def test_a_calm_flow_without_a_way_on_is_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    given = solved(numerics__level=1)
    section = Section(given.section.mesh, given.section.setup)
    control = dense.SCHEME.control(section, 1e-9, 100)
    section.ease(MeshTerms(rate=10**easing.CALMEST))
    initial.calm(section)
    monkeypatch.setattr(easing, "MOST_POINTS", 2)
    monkeypatch.setattr(easing, "MOST_LEAPS", 0)
    monkeypatch.setattr(easing, "LEAPS", ())
    with pytest.raises(SolverError, match="times the least rate"):
        easing.Calming(section, nested.march_of(section, nested.QUIET), control, Section.ease).run()


def test_gradient_grows_with_holdup() -> None:
    """At one gas flux more solids cost more pressure, and carry more."""
    found = [
        quantities(solved(numerics__level=1, operation__solids_fraction=a))
        for a in (0.1, 0.2, 0.3, 0.4)
    ]
    for name in ("pressure_gradient", "solids_mass_flow", "bed_fraction"):
        values = [f[name] for f in found]
        assert values == sorted(values), name
        assert values[-1] > values[0]


# -- ducts and quadrilaterals ------------------------------------------------------------------


@functools.cache
def duct(cells: str, level: int) -> nested.Solution:
    """The demo in a square duct of the same width."""
    tables = BASE.given
    tables["geometry"] = {"shape": "duct", "width": 0.01}
    tables["numerics"] = {"cells": cells, "level": level}
    return solve(Case.from_dict(tables))


@pytest.mark.slow
def test_square_duct_on_quadrilaterals() -> None:
    solution = duct("quadrilateral", 3)
    assert solution.levels[-1].history.update <= 1e-9
    assert max(balances(solution.section).values()) < 1e-9
    assert quantities(solution)["gas_mass_flow"] == pytest.approx(33.5 * 6.43 * 1e-4, rel=1e-9)
    assert drive(solution) == pytest.approx(drive(duct("quadrilateral", 5)), rel=0.015)
    # the same hydraulic diameter: close to the pipe, and not the pipe
    assert 0.01 < abs(drive(solution) / drive(solved()) - 1) < 0.15


@pytest.mark.slow
def test_triangles_and_quadrilaterals_agree() -> None:
    triangles, quadrilaterals = (duct(c, 5) for c in ("triangle", "quadrilateral"))
    assert drive(triangles) == pytest.approx(drive(quadrilaterals), rel=1e-3)


@pytest.mark.slow
def test_pipe_on_quadrilaterals() -> None:
    found = solved(numerics__cells="quadrilateral")
    assert drive(found) == pytest.approx(drive(solved()), rel=5e-3)

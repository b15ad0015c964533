# SPDX-License-Identifier: LGPL-3.0-or-later
"""Hard cases of the unsteady flow: mass and bounds are kept whatever the step."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from boxes import box, flow
from dolfinx.mesh import CellType

from fem_tfm.bench import stress_unsteady
from fem_tfm.errors import SolverError
from fem_tfm.models.finite_volume import Inflow, StepFailed, UnsteadyFlow, fraction, problem
from fem_tfm.models.finite_volume.cells.mesh import Array, Cells
from fem_tfm.models.finite_volume.momentum import Momentum
from fem_tfm.models.finite_volume.time_levels import Step, implicit_euler

MESH = ((0.01, 0.01, 0.1), (4, 4, 20))
CONVEYING: dict[str, Any] = {
    "gas": {"density": 33.5, "viscosity": 1.8e-5},
    "solids": {"density": 1700.0, "diameter": 1.6e-4, "restitution": 0.7},
    "operation.gas_superficial_velocity": 6.43,
    "operation.gravity": 9.81,
    "closures.drag": "three-zone",
    "closures.friction": "berzi",
    "closures.turbulence": "mixing-length",
    "walls.gas": "log-law",
    "walls.solids": "schneiderbauer",
}
FEED = Inflow(6.43, 0.245, 6.09)
AXIS = np.array([0.0, 0.0, 1.0])


@pytest.fixture(params=[0, 1], ids=["order0", "order1"])
def order(request: pytest.FixtureRequest) -> int:
    return request.param


def conveying(
    order: int,
    changes: dict[str, Any] | None = None,
    shear_deg: float = 0.0,
    kind: CellType = CellType.hexahedron,
) -> UnsteadyFlow:
    """Grains about to be fed into a duct of flowing gas."""
    mesh = box(*MESH, "wwwwio", kind, shear_deg)
    found = flow(mesh, {**CONVEYING, **(changes or {})}, order=order)
    found.initialise(1e-8)
    found.set_velocities(6.09 * AXIS, 6.43 * AXIS)
    return found


def run(found: UnsteadyFlow, dt: float, steps: int, feed: Inflow) -> float:
    """Advance, holding every step to mass and bounds; the largest Courant number."""
    courant = 0.0
    for _ in range(steps):
        report = found.advance(dt, feed)
        alpha = found.now.alpha
        assert alpha.min() > -1e-12
        assert report.max_alpha_s < found.solids.packing_limit
        assert found.now.theta.min() > 0
        assert max(found.balances().values()) < 1e-12
        courant = max(courant, report.courant)
    return courant


@pytest.mark.parametrize("dt", [1e-4, 4e-3])
def test_a_front_enters_an_empty_duct(order: int, dt: float) -> None:
    found = conveying(order)
    courant = run(found, dt, 40, FEED)
    assert dt < 1e-3 or courant > 5
    assert found.now.alpha.max() > 0.2


@pytest.mark.parametrize("friction", ["dartevelle", "srivastava-sundaresan", "johnson-jackson"])
def test_every_friction_carries_a_bed_under_gas(order: int, friction: str) -> None:
    found = conveying(order, {"closures.friction": friction})
    found.initialise(np.where(found.cells.centre[:, 1] < -0.0025, 0.6, 1e-8))
    run(found, 5e-4, 20, Inflow(6.43))


def test_a_plug_is_hit_by_gas(order: int) -> None:
    found = conveying(order)
    z = found.cells.centre[:, 2]
    found.initialise(np.where((z > 0.03) & (z < 0.05), 0.6, 1e-8))
    found.set_velocities(1.0 * AXIS, 6.0 * AXIS)
    run(found, 2e-4, 40, Inflow(6.0))


@pytest.mark.parametrize("gas", ["constant", "ideal"])
@pytest.mark.parametrize(("diameter", "dt"), [(1e-3, 1e-3), (1.6e-4, 4e-3)])
def test_gas_sweeps_a_bed_without_driving_either_phase_out(
    order: int, gas: str, diameter: float, dt: float
) -> None:
    # gas above a bed has little drag to hold it, and grains there little inertia
    speed = 3.0
    air = {"density": 1.2, "viscosity": 1.8e-5}
    if gas == "ideal":
        air = {"gas_constant": 287.0, "pressure": 1e5, "temperature": 293.0, "viscosity": 1.8e-5}
        air["compressible"] = True
    changes = {
        **CONVEYING,
        "solution": "unsteady",
        "numerics.end_time": 1.0,
        "gas": air,
        "solids.diameter": diameter,
        "solids.density": 2500.0,
        "operation.gas_superficial_velocity": speed,
        "operation.solids_velocity": speed,
    }
    found = flow(box((0.02, 0.02, 1.0), (2, 2, 40), "wwwwio"), changes, order=order)
    found.initialise(np.where(found.cells.centre[:, 1] < 0, 0.4, 0.0))
    for _ in range(round(0.3 / dt)):
        run(found, dt, 1, Inflow(speed))
        assert max(np.abs(found.now.u_s).max(), np.abs(found.now.u_g).max()) < 5 * speed


@pytest.mark.parametrize("dt", [pytest.param(2e-4, marks=pytest.mark.slow), 1e-3])
def test_a_blocked_outlet_packs_the_duct(order: int, dt: float) -> None:
    found = conveying(order)
    found.set_velocities(0.6 * AXIS, 0.6 * AXIS)
    run(found, dt, round(0.1 / dt), Inflow(0.6, 0.3, 0.6, blocked=True))
    assert found.now.alpha.max() > 0.5


def test_a_step_of_ten_drag_times_lets_fine_grains_follow_the_gas(order: int) -> None:
    found = conveying(order, {"solids.diameter": 2e-5})
    drag = found.problem.closures.drag
    beta = drag.beta(0.2, 1e-3, found.gas, found.solids)
    dt = 10 * 0.2 * found.solids.density / beta
    run(found, dt, 40, FEED)
    now, far = found.now, found.cells.centre[:, 2] > 0.02
    assert dt > 1e-3 and now.alpha[far].max() > 0.1
    slip = np.linalg.norm(now.u_g - now.u_s, axis=1)[far]
    assert slip.max() < 0.05 * 6.43


def test_what_is_closed_lets_no_solids_pass(order: int) -> None:
    """Neither a feed that stops nor an outlet that is blocked goes on for a step."""
    found = conveying(order)
    found.initialise(0.3)
    found.set_velocities(6.09 * AXIS, 6.43 * AXIS)
    run(found, 1e-4, 4, FEED)
    before = found.quantities()["holdup"]
    run(found, 1e-4, 1, Inflow(6.43, blocked=True))
    assert found.quantities()["holdup"] == pytest.approx(before, rel=1e-12)


def test_nearly_elastic_grains(order: int) -> None:
    run(conveying(order, {"solids.restitution": 0.99}), 2e-4, 40, FEED)


def test_sheared_cells_carry_a_front(order: int) -> None:
    run(conveying(order, shear_deg=30.0), 2e-4, 40, FEED)


def test_tetrahedra_carry_a_front(order: int) -> None:
    found = conveying(order, kind=CellType.tetrahedron)
    run(found, 1e-4, 40, FEED)
    assert found.now.alpha.max() > 0.2


def test_a_failed_step_changes_nothing(order: int) -> None:
    found = conveying(order)
    run(found, 1e-4, 3, FEED)
    now, time = found.now, found.time
    with pytest.raises(StepFailed):
        found.advance(1e-4, Inflow(6.43, 0.245, float("nan")))
    assert found.now is now and found.time == time
    run(found, 1e-4, 1, FEED)


def test_a_restored_state_goes_on_bit_for_bit(order: int) -> None:
    found = conveying(order)
    run(found, 1e-4, 5, FEED)
    state = found.state()
    run(found, 1e-4, 5, FEED)
    other = conveying(order)
    other.restore(state)
    run(other, 1e-4, 5, FEED)
    assert other.time == found.time
    for name, values in found.state().items():
        assert np.array_equal(values, other.state()[name]), name


def fastest(found: UnsteadyFlow) -> float:
    """Largest velocity of either phase in a cell [m/s]."""
    return max(float(np.linalg.norm(u, axis=1).max()) for u in (found.now.u_s, found.now.u_g))


def test_a_void_bears_no_stress_of_the_bed_beside_it(monkeypatch: pytest.MonkeyPatch) -> None:
    # coarse grains, which the gas hardly holds, with a viscous bed beside their void
    case = stress_unsteady.scene(20)
    found = stress_unsteady.solve(case)
    assert found.ended and found.solids < 2 and found.cuts == 0
    monkeypatch.setattr(Cells, "in_series", Cells.to_faces)
    monkeypatch.setattr(stress_unsteady, "MOST_STEPS", 30)
    assert stress_unsteady.solve(case).cuts > 5


def test_an_algebraic_granular_temperature_makes_no_motion() -> None:
    found = stress_unsteady.solve(stress_unsteady.scene(10))
    assert found.ended and max(found.gas, found.solids) < 2


def test_a_pressure_of_a_high_power_does_not_make_newton_leap(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Schaeffer's pressure grows with the tenth power of the fraction
    found = stress_unsteady.solve(stress_unsteady.scene(100))
    assert found.ended and found.cuts == 0
    monkeypatch.setattr(fraction, "MOST_CUTS", 0)
    monkeypatch.setattr(stress_unsteady, "MOST_STEPS", 70)
    assert stress_unsteady.solve(stress_unsteady.scene(100)).cuts > 1


def test_grains_that_nothing_holds_apart_stay_below_packing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # no friction, and a blocked outlet: the barrier alone keeps them off the limit
    found = stress_unsteady.solve(stress_unsteady.scene(168))
    assert found.ended and found.cuts <= 5
    monkeypatch.setattr(problem, "PACKING_PRESSURE", 0.0)
    assert not stress_unsteady.solve(stress_unsteady.scene(168)).ended


def test_eddies_disperse_no_more_than_the_surface_of_a_bed_carries(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    laws = {"turbulence": "k-epsilon", "dispersed": "simonin", "dispersion": "simonin"}
    changes: dict[str, Any] = {f"closures.{family}": name for family, name in laws.items()}
    changes["solids"] = {"density": 2800.0, "diameter": 6e-5, "restitution": 0.7}

    def first_step() -> float:
        found = conveying(0, changes)
        found.initialise(np.where(found.cells.centre[:, 1] < 0, 0.4, 0.0))
        found.advance(0.01, Inflow(0.1))
        return fastest(found)

    kept = Momentum._dispersion_force
    assert first_step() < 0.3

    def of_all(self: Momentum, alpha: Array, coefficient: Array, carried: Array) -> Array:
        return kept(self, alpha, coefficient, self.line.cells.to_faces(alpha))

    monkeypatch.setattr(Momentum, "_dispersion_force", of_all)
    with pytest.raises(StepFailed, match="would reach"):
        first_step()


@pytest.mark.parametrize("values", [(1.0, 1.0), (1.0, 3.0), (1.0, 1e12), (0.0, 0.0), (0.0, 1.0)])
def test_what_conducts_in_series_is_no_better_than_its_worse_half(
    values: tuple[float, float],
) -> None:
    found = conveying(0).cells
    given = np.where(found.centre[:, 2] < 0.05, *values)
    faces = found.in_series(given)[: found.inner_count]
    pair = given[found.first[: found.inner_count]], given[found.second]
    across = pair[0] != pair[1]
    small, large = values
    # equal halves of the way: the harmonic mean
    wanted = 2 * small * large / max(small + large, 1e-300)
    assert faces[across] == pytest.approx(wanted)
    assert faces[~across] == pytest.approx(pair[0][~across])


def test_velocities_that_nothing_can_make_end_a_step() -> None:
    found = conveying(0)
    found.advance(1e-4, FEED)
    before, limit = found.now, found.speed_limit
    feed = Inflow(6.43, 0.245, 6.09)
    step = Step(
        implicit_euler(found.line, before, 1e-4), 1e-4, feed, before, before.alpha, before.alpha
    )
    limit.check(before, step, None)
    work = np.ptp(before.p) / found.gas.density
    most = 2 * (6.43**2 / 0.755**2 + 2 * work) ** 0.5
    for speed, allowed in ((0.9 * most, True), (1.1 * most, False)):
        u_g = before.u_g.copy()
        u_g[3] = [speed, 0.0, 0.0]
        given = replace(step, state=replace(before, u_g=u_g))
        with nullcontext() if allowed else pytest.raises(SolverError, match="the gas would reach"):
            limit.check(before, given, None)


def test_a_step_that_ends_above_a_courant_number_changes_nothing(order: int) -> None:
    found = conveying(order)
    before = found.now
    with pytest.raises(StepFailed, match="Courant number of"):
        found.advance(4e-3, FEED, largest_courant=1.0)
    assert found.now is before and found.time == 0

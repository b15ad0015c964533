# SPDX-License-Identifier: LGPL-3.0-or-later
"""Hard cases of the unsteady flow: mass and bounds are kept whatever the step."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from boxes import box, flow
from dolfinx.mesh import CellType

from fem_tfm.models.finite_volume import Inflow, StepFailed, UnsteadyFlow

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

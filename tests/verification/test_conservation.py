# SPDX-License-Identifier: LGPL-3.0-or-later
"""Conservation on solved sections: forces of the walls, of the phases on each other, and mass.

The integrals are written here from the stated balances; only pointwise closures are the model's.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import problems
import pytest
import ufl
from dolfinx import fem

from fem_tfm.fenics import compile_form
from fem_tfm.models.two_fluid.quantities import balances
from fem_tfm.models.two_fluid.section import TwoFluidSection as Section

EXACT = 1e-10
# horizontal as the demo, uphill and straight down, gas alone; constants alone differ
CASES: dict[str, dict[str, Any]] = {
    "demo": {},
    "uphill": {"geometry.inclination_deg": 30.0},
    "downward": {"geometry.inclination_deg": -90.0, "operation.solids_fraction": 0.1},
}


@cache
def section(which: str) -> Section:
    """A solved section."""
    return problems.solved(problems.demo(CASES[which]), 1 / 8)


def wall(found: Section, integrand: Any) -> float:
    """Integral along the wall."""
    return fem.assemble_scalar(compile_form(integrand * found.domain.ds_wall))


def forces(found: Section) -> dict[str, float]:
    """Axial forces on either phase per length [N/m]: drive, weight, walls and drag."""
    model, state, setup = found.model, found.state(found.now), found.setup
    alpha = model.alpha(state)
    held = found.integral("held", alpha)
    excess = setup.solids.density - setup.gas.density
    slip = state.u_g[2] - state.u_s[2]
    return {
        "drive": float(found.drive.value),
        "area": found.integral("one", ufl.as_ufl(1.0)),
        "held": held,
        "weight": excess * setup.gravity[2] * held,
        "drag": found.integral("drag", model.exchange(state) * slip),
        "gas_wall": wall(found, (1 - alpha) * model.gas_wall_traction(state)[2]),
        "solids_wall": wall(found, model.solids_wall_traction(state)[2]),
    }


@pytest.mark.parametrize("which", CASES)
def test_walls_carry_drive_and_weight(which: str) -> None:
    """G A and the weight along the pipe equal the force of the walls, to 1e-10."""
    f = forces(section(which))
    given = f["drive"] * f["area"] + f["weight"]
    scale = max(abs(f["drive"] * f["area"]), abs(f["weight"]))
    assert abs(given - f["gas_wall"] - f["solids_wall"]) < EXACT * scale
    assert section(which).wall_force() == pytest.approx(f["gas_wall"] + f["solids_wall"], rel=1e-12)
    angle = math.radians(CASES[which].get("geometry.inclination_deg", 0.0))
    buoyant = -(1700.0 - 33.5) * 9.81 * math.sin(angle) * f["held"]
    assert f["weight"] == pytest.approx(buoyant, rel=1e-12, abs=1e-300)


@pytest.mark.parametrize("which", CASES)
def test_each_phase_is_in_balance(which: str) -> None:
    """Gas: G A_g = wall + drag. Solids: G A_s + drag + weight = wall. To 1e-10."""
    f = forces(section(which))
    gas = [f["drive"] * (f["area"] - f["held"]), -f["gas_wall"], -f["drag"]]
    solids = [f["drive"] * f["held"], f["drag"], f["weight"], -f["solids_wall"]]
    for balance in (gas, solids):
        assert abs(sum(balance)) < EXACT * max(map(abs, balance))


def imbalance(found: Section, flux: Any, degree: int) -> float:
    """Largest net flow into a test function, over the flow across the width of its cells."""
    w = ufl.TestFunction(fem.functionspace(found.mesh.mesh, ("Lagrange", degree)))
    size = ufl.sqrt(ufl.inner(flux, flux) / abs(ufl.JacobianDeterminant(found.mesh.mesh)))
    forms = (ufl.inner(flux, ufl.grad(w)), size * w)
    net, passing = (fem.assemble_vector(compile_form(f * found.domain.dx)).array for f in forms)
    return float(np.abs(net).max() / np.abs(passing).max())


@pytest.mark.parametrize("which", CASES)
def test_mass(which: str) -> None:
    """Solids and mixture are conserved by every test function; feeds are met; no source is left."""
    found = section(which)
    state, model = found.state(found.now), found.model
    alpha = model.alpha(state)
    carried = alpha * state.u_s + model.numerical_flux(state)
    solids = ufl.as_vector((carried[0], carried[1]))
    mixture = [alpha * state.u_s[i] + (1 - alpha) * state.u_g[i] for i in range(2)]
    assert imbalance(found, solids, 2) < 1e-8
    # but for the compressibility that fixes the mean pressure
    assert imbalance(found, ufl.as_vector(mixture), 1) < 1e-6
    width, speed = 0.01, 6.43
    assert abs(float(found.source.value)) * width / speed < EXACT
    case = problems.demo(CASES[which])
    held, area = found.integral("held", alpha), math.pi * width**2 / 8
    assert held / found.area == pytest.approx(case["operation.solids_fraction"], rel=EXACT)
    gas = found.integral("gas flux", (1 - alpha) * state.u_g[2])
    assert gas == pytest.approx(speed * area, rel=EXACT)


@pytest.mark.parametrize("which", CASES)
def test_reported_balances(which: str) -> None:
    """What a result tells of its balances is as small as it says."""
    found = balances(section(which))
    assert set(found) == {"gas_mass", "axial_momentum", "solids_mass"}
    assert max(found.values()) < EXACT

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Inclined, vertical and weightless sections: terminal velocity, weights, axial symmetry."""

from __future__ import annotations

import functools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from sections import DEMO, drive, quantities, solve

from fem_tfm import Case
from fem_tfm.models.two_fluid.quantities import balances
from fem_tfm.solvers import nested

BASE = Case.load(Path(__file__).parents[2] / DEMO).with_values({"numerics.level": 1})
GRAVITY = 9.81


@functools.cache
def inclined(angle: float, **changes: Any) -> nested.Solution:
    """Demo on two coarse meshes at an inclination [deg]."""
    given = {key.replace("__", "."): value for key, value in changes.items()}
    return solve(BASE.with_values({"geometry.inclination_deg": angle, **given}))


# -- terminal velocity -------------------------------------------------------------------------


def unbounded(fraction: float, angle: float = 90.0) -> nested.Solution:
    """Vertical suspension between walls that neither phase feels."""
    return inclined(
        angle,
        closures__friction="none",
        walls__gas="free-slip",
        walls__solids="free-slip",
        operation__solids_fraction=fraction,
    )


def terminal_velocity() -> float:
    """Schiller-Naumann: C_D u^2 = (4/3) (rho_s/rho_g - 1) g d, the Wen-Yu drag of one grain."""
    gas, solids = BASE.scene.model.gas, BASE.scene.model.solids
    d = solids.diameter
    weight = 4 / 3 * (solids.density / gas.density - 1) * GRAVITY * d

    def surplus(speed: float) -> float:
        reynolds = gas.density * speed * d / gas.viscosity
        return 24 / reynolds * (1 + 0.15 * reynolds**0.687) * speed**2 - weight

    return brentq(surplus, 1e-4, 10.0)


@pytest.mark.parametrize("angle", [90.0, -90.0])
def test_dilute_slip_is_the_terminal_velocity(angle: float) -> None:
    """The gas runs ahead upwards and falls behind downwards, by u_t within 1 %."""
    slip = quantities(unbounded(1e-4, angle))["slip_velocity"]
    assert slip == pytest.approx(math.copysign(terminal_velocity(), angle), rel=0.01)


def uniform_velocities(fraction: float) -> tuple[float, float]:
    """u_g and u_s [m/s] of beta (u_g - u_s) = alpha_s alpha_g (rho_s - rho_g) g."""
    model = BASE.scene.model
    gas, solids, drag = model.gas, model.solids, model.drag
    weight = fraction * (1 - fraction) * (solids.density - gas.density) * GRAVITY
    slip = brentq(lambda u: float(drag.beta(fraction, u, gas, solids)) * u - weight, 1e-4, 10.0)
    u_g = BASE["operation.gas_superficial_velocity"] / (1 - fraction)
    return u_g, u_g - slip


def test_dilute_suspension_is_uniform_and_carries_its_weight() -> None:
    """G = alpha_s (rho_s - rho_g) g, and the slip of the drag law."""
    solution, fraction = unbounded(1e-3), 1e-3
    assert drive(solution) == pytest.approx(fraction * (1700.0 - 33.5) * GRAVITY, rel=1e-6)
    u_g, u_s = uniform_velocities(fraction)
    assert quantities(solution)["slip_velocity"] == pytest.approx(u_g - u_s, rel=1e-3)


@pytest.mark.parametrize("fraction", [0.05, 0.3])
def test_uniform_suspension_is_an_equilibrium(fraction: float) -> None:
    """A dense uniform suspension is unstable (it forms clusters), and yet no force is left in it.

    The largest entry of the momentum residual, over that of the drag alone.
    """
    section = unbounded(1e-3).section
    kept = section.now.x.array.copy(), float(section.drive.value)
    u_g, u_s = uniform_velocities(fraction)
    section.now.x.array[:] = 0.0
    logit = math.log(fraction / (BASE["solids.packing_limit"] - fraction))
    for i, value in ((0, u_g), (2, u_s), (3, logit), (4, math.log(1e-8))):
        sub = section.space.sub(i)
        sub = sub.sub(2) if i in (0, 2) else sub
        section.now.x.array[sub.collapse()[1]] = value
    section.old.x.array[:] = section.now.x.array
    excess = (1700.0 - 33.5) * GRAVITY

    def largest(drive: float) -> float:
        section.drive.value = drive
        rows = section.newton.assemble_residual()
        return max(abs(rows[section.owned_dofs[i]]).max() for i in (0, 2))

    balanced, without_drive = largest(fraction * excess), largest(0.0)
    section.now.x.array[:], section.drive.value = kept
    assert balanced < 1e-5 * without_drive
    assert without_drive > 0


# -- inclinations ------------------------------------------------------------------------------


@pytest.mark.parametrize("angle", [0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0, -90.0])
def test_every_inclination_converges_and_balances(angle: float) -> None:
    """-dP/dz A = force of the walls + weight of both phases along the axis."""
    solution = inclined(angle)
    section, found = solution.section, quantities(solution)
    assert solution.levels[-1].history.update <= 1e-9
    assert max(balances(section).values()) < 1e-9
    mixture = 1700.0 * 0.245 + 33.5 * (1 - 0.245)
    weight = mixture * GRAVITY * math.sin(math.radians(angle))
    walls = section.wall_force() / section.area
    assert found["pressure_gradient"] == pytest.approx(walls + weight, rel=1e-8)
    assert walls > 0


def test_lifting_solids_costs_pressure() -> None:
    """The gradient grows from downward to horizontal to upward flow."""
    gradients = [quantities(inclined(a))["pressure_gradient"] for a in (-90.0, 0.0, 45.0, 90.0)]
    assert gradients == sorted(gradients)
    assert gradients[0] < 0 < gradients[1]


def spread(solution: nested.Solution) -> float:
    """Largest difference of alpha_s along the wall [-]."""
    alpha = solution.section.fields()["alpha_s"]
    points = alpha.function_space.tabulate_dof_coordinates()
    radius = BASE["geometry.diameter"] / 2
    return float(np.ptp(alpha.x.array[np.hypot(*points.T[:2]) > 0.999 * radius]))


def test_no_gravity_is_axisymmetric() -> None:
    """Without weight, up and down do not exist; with it the bottom of the demo is dense."""
    weightless = inclined(0.0, operation__gravity=0.0)
    assert spread(weightless) < 0.01
    assert spread(inclined(0.0)) > 0.3
    assert max(balances(weightless.section).values()) < 1e-9


def test_vertical_pipe_is_axisymmetric() -> None:
    assert spread(inclined(90.0)) < 0.02


def test_without_gravity_the_inclination_does_not_matter() -> None:
    flat, upright = (inclined(angle, operation__gravity=0.0) for angle in (0.0, 90.0))
    assert drive(flat) == pytest.approx(drive(upright), rel=1e-9)

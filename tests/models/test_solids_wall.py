# SPDX-License-Identifier: LGPL-3.0-or-later
"""The wall law of the solids seen from a cell: both balances across half a cell, and its limits."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from recording import COAL

from fem_tfm import Case
from fem_tfm.closures.walls.solids import WallState
from fem_tfm.models.pointwise import Pointwise
from fem_tfm.models.solids_wall import HalfCell, at_wall

LAWS: dict[str, Any] = {
    "rough": {"model": "johnson-jackson", "specularity": 1.0},
    "smooth": {"model": "johnson-jackson", "specularity": 0.01, "friction_angle_deg": 20.0},
    "schneiderbauer": "schneiderbauer",
    "facets": {"model": "rough", "roughness_deg": 5.0, "roughness_height": 1.0},
    "coulomb": "coulomb",
}
Values = Any


def states(law: str, number: int = 4000) -> tuple[Pointwise, HalfCell, Values, Values]:
    """Laws, random solids at the centre of cells, mu/h and kappa/h."""
    given = {**COAL, "geometry": {"diameter": 0.01, "length": 0.03}, "walls": {"solids": LAWS[law]}}
    point = Case.from_dict(given).scene.problem().pointwise()
    random = np.random.default_rng(3)

    def spread(low: float, high: float) -> Values:
        return 10 ** random.uniform(low, high, number)

    alpha, speed = spread(-3, -0.25), spread(-2, 1)
    # grains much colder than their slip are found at no wall
    theta = spread(-2, 0.5) * speed**2
    rates = spread(2, 6), np.zeros(number)
    at = point.coefficients(alpha, theta, *rates, None)
    velocity = np.stack([speed, 0 * speed, 0 * speed], axis=1)
    centre, height = point.wall_state(alpha, theta, at, velocity), spread(-4, -3)
    half = HalfCell.beside(point, centre, *rates, random.uniform(0.8, 1.25, number))
    return point, half, at.viscosity / height, at.kinetic.conductivity / height


def touching(point: Pointwise, half: HalfCell, theta: Values, slip: Values) -> WallState:
    """The solids at the wall whose pressure is the one given there, by many small steps."""
    state = replace(half.centre, slip=slip)
    for _ in range(200):
        state = half.moved(point, state, theta, half.pressure)
    return state


@pytest.mark.parametrize("law", LAWS)
def test_the_wall_feels_what_the_solids_conduct_and_shear(law: str) -> None:
    """u_w and Theta_w follow from the friction and the heat, and fulfil the law at the wall."""
    point, half, stiffness, conductance = states(law)
    centre = half.centre
    friction, heat = at_wall(point, half, stiffness, conductance)
    share = 1 - friction / stiffness
    seen = touching(point, half, centre.theta + heat / conductance, share * centre.slip)
    wanted = stiffness * point.solids_wall_friction(seen)
    wanted = wanted / (stiffness + point.solids_wall_friction(seen))
    away = np.abs(friction / wanted - 1)
    assert np.quantile(away, 0.99) < 2e-3
    assert away.max() < 0.05
    size = np.abs(point.solids_wall_heat(seen)) + conductance * centre.theta
    away = np.abs(heat - point.solids_wall_heat(seen)) / size
    assert np.quantile(away, 0.99) < 2e-3
    assert away.max() < 0.1


@pytest.mark.parametrize("law", LAWS)
def test_no_wall_is_rougher_than_one_that_holds_the_grains(law: str) -> None:
    point, half, stiffness, conductance = states(law)
    for conducted in (conductance, None):
        friction, _ = at_wall(point, half, stiffness, conducted)
        assert (friction <= stiffness * (1 + 1e-12)).all()
        assert (friction > 0).all()


@pytest.mark.parametrize("law", LAWS)
def test_a_thin_cell_has_the_law_itself(law: str) -> None:
    point, half, stiffness, conductance = states(law)
    centre = half.centre
    half = HalfCell.beside(point, centre, np.full(4000, 1e4), np.zeros(4000), 1.0)
    friction, heat = at_wall(point, half, 1e9 * stiffness, 1e9 * conductance)
    assert friction == pytest.approx(point.solids_wall_friction(centre), rel=1e-3)
    assert heat == pytest.approx(point.solids_wall_heat(centre), rel=1e-2, abs=1e-6)


def test_a_smooth_wall_lets_solids_without_viscosity_pass() -> None:
    given = {
        **COAL,
        "geometry": {"diameter": 0.01, "length": 0.03},
        "walls": {"solids": "free-slip"},
    }
    point, (_, half, stiffness, conductance) = (
        Case.from_dict(given).scene.problem().pointwise(),
        states("rough", 10),
    )
    for stiff in (stiffness, 0 * stiffness):
        friction, heat = at_wall(point, half, stiff, conductance)
        assert not friction.any() and not heat.any()

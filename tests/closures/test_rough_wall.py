# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rough wall beside a Monte Carlo of single impacts, its limits and its budget of energy."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fem_tfm.closures import make
from fem_tfm.closures.walls.rough import Rough
from fem_tfm.closures.walls.solids import WallState
from fem_tfm.materials import Solids

# unit mass hits a second at Theta = 1, and grains small enough to see every facet
GRAINS = Solids(density=1.0, diameter=1e-9)
STATE = WallState(math.sqrt(2 * math.pi), 1.0, 1.0, 0.0, 1.0)
HITS, TILTS = 4000, 61
MATERIALS = {"soft": (0.5, 0.5), "hard": (0.9, 0.2)}


def rough(angle: float, e_w: float = 0.5, mu_w: float = 0.5, **more: Any) -> Rough:
    given = {"restitution": e_w, "friction_coefficient": mu_w, "slip_floor": 1e-6} | more
    law = make("solids-wall", {"model": "rough", "roughness_deg": angle, **given})
    assert isinstance(law, Rough)
    return law


def impacts(angle: float, u: float, e_w: float, mu_w: float, along: float = 0.0) -> Any:
    """Mean loss of momentum, gain of fluctuating energy and energy dissipated, a hit of unit mass.

    angle : of the facets [rad]
    along : standard deviation of the velocities along the wall

    A grain of the Maxwellian's flux meets each of the tilts in its proportion.
    """
    random = np.random.default_rng(5)
    rank = (np.arange(HITS) + random.random(HITS)) / HITS
    c = np.sqrt(-2 * np.log1p(-rank))[:, None]
    x, z = along * random.standard_normal((2, HITS, 1))
    x = u + x
    gamma = angle * np.linspace(-6, 6, TILTS)
    normal = c * np.cos(gamma) + x * np.sin(gamma)
    share = np.exp(-(np.linspace(-6, 6, TILTS) ** 2) / 2) * np.maximum(normal, 0)
    share /= share.sum(axis=1, keepdims=True)
    tangent = x * np.cos(gamma) - c * np.sin(gamma)
    slip = np.hypot(tangent, z)
    impulse = np.minimum(mu_w * (1 + e_w) * normal, 2 / 7 * 1.3 * slip) / slip
    push, rub, aside = (1 + e_w) * normal, impulse * tangent, impulse * z
    loss = push * np.sin(gamma) + rub * np.cos(gamma)
    away = push * np.cos(gamma) - rub * np.sin(gamma)
    change = (x - loss) ** 2 + (c - away) ** 2 + (z - aside) ** 2 - x**2 - c**2 - z**2

    def mean(of: Any) -> float:
        return float((of * share).sum() / HITS)

    return mean(loss), mean(change / 2 + u * loss), mean(-change / 2)


@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize(("angle", "within"), [(0.0, 0.01), (3.0, 0.02), (10.0, 0.035), (15, 0.06)])
@pytest.mark.parametrize("u", [0.1, 0.5, 1.0, 3.0, 10.0, 30.0])
def test_impacts_of_grains_with_fluctuations_across_the_wall(
    material: str, angle: float, within: float, u: float
) -> None:
    law, state = rough(angle, *MATERIALS[material]), replace(STATE, slip=u)
    loss, gain, lost = impacts(math.radians(angle), u, *MATERIALS[material])
    assert law.friction(state, GRAINS) * u == pytest.approx(loss, rel=within)
    # grains of the Monte Carlo have nothing to lose along the wall
    heat = law.heat(state, GRAINS) + along(law, u)
    assert heat == pytest.approx(gain, abs=max(0.03, within) * (u * loss + lost))


def along(law: Rough, u: float) -> float:
    """What the fluctuations along a flat wall lose at Theta = 1."""
    flat = replace(law, roughness_deg=0.0)
    state = replace(STATE, slip=u)
    eta, mu = (1 + law.restitution) / 2, law.friction_coefficient
    b2 = (u * 2 / 7 * 1.3 / (2 * eta * mu)) ** 2 / 2
    across = (2 * eta * mu) ** 2 * (1 - math.exp(-b2)) - 4 * eta * (1 - eta)
    return across - float(flat.heat(state, GRAINS))


@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("u", [0.1, 3.0, 10.0, 30.0])
def test_heat_of_a_flat_wall_is_that_of_a_maxwellian(material: str, u: float) -> None:
    law, state = rough(0.0, *MATERIALS[material]), replace(STATE, slip=u)
    _, gain, lost = impacts(1e-9, u, *MATERIALS[material], along=1.0)
    assert law.heat(state, GRAINS) == pytest.approx(gain, abs=0.06 * (lost + 1))
    printed = make("solids-wall", {"model": "schneiderbauer"}).heat(state, GRAINS)
    assert u < 10 or material != "soft" or (printed > 0 > gain)


@pytest.mark.parametrize("slip", [1e-3, 0.1, 3.0, 100.0])
def test_a_flat_wall_has_the_friction_of_schneiderbauer(coal: Solids, slip: float) -> None:
    state = WallState(0.45, 0.04, 9.0, 6.0, slip)
    flat = make("solids-wall", "schneiderbauer").friction(state, coal)
    law = rough(0.0, slip_floor=1e-2)
    assert law.friction(state, coal) == pytest.approx(flat, rel=1e-8)


@pytest.mark.parametrize("angle", [0.0, 2.0, 15.0])
def test_no_wall_takes_more_than_grains_that_stick(angle: float) -> None:
    """An impact takes k u where the grain sticks, and 4 eta q u for the facet."""
    q = (1 - math.exp(-4 * math.radians(angle) ** 2)) / 4
    most = 2 / 7 * 1.3 + 3 * q
    for slip in np.geomspace(1e-3, 1e3, 30):
        assert rough(angle).friction(replace(STATE, slip=slip), GRAINS) <= most * (1 + 1e-6)


@pytest.mark.parametrize("angle", [0.0, 3.0, 15.0])
def test_heat_is_never_more_than_the_work(angle: float) -> None:
    law = rough(angle)
    for slip in np.geomspace(1e-3, 1e3, 30):
        state = replace(STATE, slip=slip)
        assert law.heat(state, GRAINS) < law.friction(state, GRAINS) * slip**2


def test_a_small_angle_matters_much_in_fast_sliding() -> None:
    state = replace(STATE, slip=60.0)
    flat, tilted = (rough(angle).friction(state, GRAINS) for angle in (0.0, 2.0))
    assert tilted > 2 * flat


def test_large_grains_rest_on_the_peaks() -> None:
    law = rough(5.0, roughness_height=2e-6)
    fine, equal, coarse = (law.tilt(d) for d in (1e-9, 2.6e-4, 2e-2))
    assert fine == pytest.approx(math.radians(5) ** 2, rel=0.02)
    assert equal == pytest.approx(fine / 2, rel=0.02)
    assert coarse == pytest.approx(1e-4, rel=0.02)

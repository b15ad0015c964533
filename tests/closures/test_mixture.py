# SPDX-License-Identifier: LGPL-3.0-or-later
"""Logarithmic layer of a gas whose eddies carry grains: quadrature, limits, heights."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from fem_tfm.closures import make
from fem_tfm.closures.walls.gas import GasWallState
from fem_tfm.closures.walls.mixture import EDGE, KAPPA, Followers, mixed_layer, shared_friction
from fem_tfm.materials import Gas

U_TAU, HEIGHT = 0.6, 5e-4


def quadrature(u_plus: float, loading: float, time: float, slip: float) -> float:
    """u_g over that of the gas alone, by integrating u_e/(kappa y) of the stated density."""
    sublayer = HEIGHT * math.exp(EDGE - KAPPA * u_plus)

    def surplus(rise: float) -> float:
        u_g, w_0, w_p = rise * U_TAU, 1.0, 1.0
        for _ in range(200):
            lag = time * math.sqrt((u_g * w_p) ** 2 + 0.45 * 0.45 * slip**2) / (0.45 * KAPPA)
            edge = sublayer * w_0 / rise
            w_0, w_p = (math.sqrt((y + lag) / ((1 + loading) * y + lag)) for y in (edge, HEIGHT))

        def slope(log: float) -> float:
            y = math.exp(log)
            return math.sqrt((y + lag) / ((1 + loading) * y + lag))

        whole = EDGE * w_0 + quad(slope, math.log(edge), math.log(HEIGHT))[0]
        return rise * whole - KAPPA * u_plus

    return brentq(surplus, 0.3, 30.0)


@pytest.mark.parametrize("loading", [0.3, 3.0, 20.0, 100.0])
@pytest.mark.parametrize("time", [1e-7, 1e-5, 1e-4, 1e-2])
def test_the_closed_form_is_the_integral(loading: float, time: float) -> None:
    of = Followers(loading, time, 0.4, 0.45)
    traction, _ = mixed_layer(15.0, U_TAU, HEIGHT, of, False)
    assert traction == pytest.approx(quadrature(15.0, loading, time, 0.4) ** 2, rel=0.005)


@pytest.mark.parametrize(("name", "k"), [("log-law", None), ("log-law-k", 1.2), ("log-law-k", 0.7)])
def test_tracers_are_a_heavier_gas_and_stones_are_not_there(name: str, k: float | None) -> None:
    """tau_F -> 0: the law of a gas of the mixture's density; tau_F -> infinity: that of the gas.

    With k = 0.7 m2/s2 the gas alone is at y+ = 15, where the blend with the viscous limit counts.
    """
    law, gas, loading = make("gas-wall", name), Gas(density=1.2, viscosity=1.8e-5), 3.0
    state = GasWallState(9.0, HEIGHT, gas, k)
    alone = law.coefficient(state)
    on_gas, on_solids = shared_friction(alone, state, law, Followers(loading, 1e-12, 0.0, 0.45))
    heavy = GasWallState(9.0, HEIGHT, Gas(density=4 * 1.2, viscosity=1.8e-5), k)
    assert on_gas + loading * on_solids == pytest.approx(law.coefficient(heavy), rel=0.02)
    viscous = gas.viscosity / HEIGHT
    assert on_solids == pytest.approx(on_gas - viscous, rel=1e-6)
    on_gas, on_solids = shared_friction(alone, state, law, Followers(loading, 1e6, 0.0, 0.45))
    assert on_gas == pytest.approx(alone, rel=1e-6)
    assert on_solids == pytest.approx(0.0, abs=1e-6 * alone)


@pytest.mark.parametrize("time", [1e-6, 2e-5, 1e-4])
def test_the_traction_does_not_depend_on_the_height(time: float) -> None:
    """With the velocities of one and the same layer the friction velocity is one and the same."""
    law, gas, found = make("gas-wall", "log-law"), Gas(density=1.2, viscosity=1.8e-5), []
    nu = gas.viscosity / gas.density
    for y_plus in (60.0, 120.0, 240.0):
        y = y_plus * nu / U_TAU
        lag, loading = time * U_TAU / (0.45 * KAPPA), 2.0
        w = [1.0, 1.0]
        for _ in range(200):
            heights = 11.5 * nu * w[0] / U_TAU, y
            w = [math.sqrt((h + lag) / ((1 + loading) * h + lag)) for h in heights]
        logs = np.linspace(*np.log(heights), 2001)
        rise = np.trapezoid(np.sqrt((np.exp(logs) + lag) / (3 * np.exp(logs) + lag)), logs)
        speed = U_TAU * (EDGE * w[0] + rise) / KAPPA
        state = GasWallState(speed, y, gas)
        of = Followers(loading, time, 0.0, 0.45)
        on_gas, on_solids = shared_friction(law.coefficient(state), state, law, of)
        found.append((on_gas + loading * on_solids) * speed / gas.density)
    # y_s knows the friction velocity at the height, which falls by up to sqrt(1 + Z)
    assert np.ptp(found) < 0.12 * U_TAU**2
    assert found == pytest.approx([U_TAU**2] * 3, rel=0.12)


def test_no_grains_change_nothing() -> None:
    gas = Gas(density=1.2, viscosity=1.8e-5)
    for name, k in (("log-law", None), ("log-law-k", 1.2)):
        law = make("gas-wall", name)
        state = GasWallState(9.0, HEIGHT, gas, k)
        alone = law.coefficient(state)
        assert shared_friction(alone, state, law, Followers(0.0, 1e-5, 0.1, 0.45))[0] == (
            pytest.approx(alone, rel=1e-9)
        )


@pytest.mark.parametrize("name", ["log-law", "log-law-k"])
def test_a_layer_is_found_at_any_height_and_speed(name: str) -> None:
    """A cell in the sublayer, or whose gas hardly moves, gets finite coefficients that brake."""
    law, gas = make("gas-wall", name), Gas(density=1.2, viscosity=1.8e-5)
    for speed in (1e-6, 1e-3, 0.1, 3.0, 50.0):
        for height in (1e-6, 1e-4, 1e-2):
            for k in (1e-10, 1e-4, 1.0):
                state = GasWallState(speed, height, gas, k if law.needs_k else None)
                for loading in (0.1, 10.0, 1000.0):
                    of = Followers(loading, 1e-3, 0.1, 0.45)
                    found = shared_friction(law.coefficient(state), state, law, of)
                    assert np.all(np.isfinite(found)), (speed, height, k, loading)
                    assert min(found) >= 0, (speed, height, k, loading)

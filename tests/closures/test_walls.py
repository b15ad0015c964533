# SPDX-License-Identifier: LGPL-3.0-or-later
"""Wall laws: printed forms, limits at rest and at high speed, energy, log law."""

import math
from dataclasses import replace

import numpy as np
import pytest

from fem_tfm.closures import make, names
from fem_tfm.closures.walls.gas import GasWallState
from fem_tfm.closures.walls.solids import WallState
from fem_tfm.materials import Gas

SOLIDS_LAWS = names("solids-wall")
GAS_LAWS = names("gas-wall")
STATE = WallState(alpha_s=0.45, theta=0.04, g0=9.0, friction_pressure=6.0, slip=0.8)


def schneiderbauer(**parameters):
    return make("solids-wall", {"model": "schneiderbauer", **parameters})


def part(law, method, solids):
    """Friction or heat of a law as a function of the five numbers of its state."""
    return lambda *values: getattr(law, method)(WallState(*values), solids)


def values(**changes):
    state = replace(STATE, **changes)
    return [state.alpha_s, state.theta, state.g0, state.friction_pressure, state.slip]


@pytest.mark.parametrize("name", SOLIDS_LAWS)
@pytest.mark.parametrize("method", ["friction", "heat"])
def test_finite_and_differentiable_at_the_singular_points(agree, smooth, name, method, coal):
    law = part(make("solids-wall", name), method, coal)
    for slip in (0.0, 0.3, 30.0):
        for theta in (0.0, 1e-2):
            for alpha, pressure in ((1e-9, 0.0), (0.6, 1e4)):
                args = values(alpha_s=alpha, theta=theta, friction_pressure=pressure, slip=slip)
                value = agree(law, *args)
                assert method == "heat" or value >= 0
                smooth(law, args)


@pytest.mark.parametrize("name", [n for n in SOLIDS_LAWS if "-slip" not in n])
@pytest.mark.parametrize("method", ["friction", "heat"])
def test_slopes_match_differences(smooth, name, method, coal):
    smooth(part(make("solids-wall", name), method, coal), values(), difference=True)


@pytest.mark.parametrize("name", SOLIDS_LAWS)
def test_a_wall_without_solids_does_nothing(name, coal):
    law, empty = make("solids-wall", name), WallState(0.0, 0.1, 1.0, 0.0, 0.5)
    assert law.friction(empty, coal) == 0.0
    assert law.heat(empty, coal) == 0.0


def test_which_laws_are_strong():
    strong = {(f, n) for f in ("solids-wall", "gas-wall") for n in names(f) if make(f, n).strong}
    assert strong == {("solids-wall", "no-slip"), ("gas-wall", "no-slip")}


# -- Schneiderbauer ----------------------------------------------------------------------------


def printed_schneiderbauer(state, solids, e_w=0.5, mu_w=0.5, beta_0=0.3):
    """Traction over slip, and -q_w, of equations (24)-(26) as printed."""
    eta, mu_0 = (1 + e_w) / 2, 3.5 * (1 + e_w) / (1 + beta_0) * mu_w
    u, theta = state.slip, state.theta
    ub = u / (math.sqrt(2 * theta) * mu_0)
    flux = state.alpha_s * solids.density * state.g0
    tau = eta * mu_w * flux * theta * math.erf(ub) + mu_w * state.friction_pressure
    first = mu_w * (
        2 * mu_w * u**2 * (2 * eta - mu_0)
        + theta * (14 * mu_w * eta - 4 * mu_0 * (1 + mu_w) - 6 * mu_w * mu_0**2 * eta)
    )
    second = math.sqrt(theta) * (4 * (eta - 1) + 6 * mu_w**2 * eta)
    second -= math.sqrt(2 * math.pi) * mu_w * u * math.erf(ub)
    second *= mu_0**2 * math.sqrt(theta) * math.exp(ub**2)
    scale = flux * eta * math.sqrt(theta) / (math.sqrt(2) * mu_0**2 * math.sqrt(math.pi))
    q_w = -tau * u - scale * math.exp(-(ub**2)) * (first + second)
    return tau / u, -q_w


@pytest.mark.parametrize("slip", [0.01, 0.3, 2.0])
@pytest.mark.parametrize("mu_w", [0.1, 0.5])
def test_schneiderbauer_recovers_the_printed_form(slip, mu_w, coal):
    state = replace(STATE, slip=slip)
    law = schneiderbauer(friction_coefficient=mu_w, slip_floor=1e-9)
    friction, heat = printed_schneiderbauer(state, coal, mu_w=mu_w)
    assert law.friction(state, coal) == pytest.approx(friction, rel=1e-8)
    assert law.heat(state, coal) == pytest.approx(heat, rel=1e-8)


def test_schneiderbauer_at_rest_and_at_high_speed(coal):
    law, flux = schneiderbauer(), 0.45 * 1700 * 9.0
    fast = law.friction(replace(STATE, slip=1e3), coal) * 1e3
    assert fast == pytest.approx(0.5 * (0.75 * flux * 0.04 + 6.0))
    # erf(b)/u -> 2/(sqrt(pi) sqrt(2 Theta) mu_0): sticking collisions, whatever mu_w
    rest = law.friction(replace(STATE, slip=0.0, friction_pressure=0.0), coal)
    c_0 = 3.5 * 1.5 / 1.3
    closed = 0.75 * flux * math.sqrt(0.04 * 2 / math.pi) / c_0
    assert rest == pytest.approx(closed, rel=1e-3)


def test_schneiderbauer_without_wall_friction_only_loses_normal_energy(coal):
    law = schneiderbauer(friction_coefficient=0.0)
    rate = 0.45 * 1700 * 9.0 * 0.75 * math.sqrt(0.04 / (2 * math.pi))
    assert law.friction(STATE, coal) == 0.0
    assert law.heat(STATE, coal) == pytest.approx(rate * 0.04 * 4 * (0.75 - 1))


def test_schneiderbauer_cools_at_rest_and_heats_in_fast_sliding(coal):
    law = schneiderbauer(sliding_heat=0.0)
    rest, fast = (law.heat(replace(STATE, slip=u), coal) for u in (0.0, 5.0))
    assert rest < 0 < fast


def test_share_of_the_sliding_work(coal):
    none, half, full = (schneiderbauer(sliding_heat=s).heat(STATE, coal) for s in (0.0, 0.5, 1.0))
    assert full - none == pytest.approx(0.5 * 6.0 * 0.8, rel=1e-3)
    assert half == pytest.approx((none + full) / 2)


def test_a_cold_bed_feels_only_coulomb_friction(coal):
    cold = replace(STATE, theta=0.0)
    assert schneiderbauer().friction(cold, coal) * 0.8 == pytest.approx(0.5 * 6.0, rel=1e-3)
    assert schneiderbauer().heat(cold, coal) == pytest.approx(0.5 * 6.0 * 0.8, rel=1e-3)


# -- Johnson-Jackson, Coulomb, free and no slip ------------------------------------------------


def test_johnson_jackson_printed_form(agree, coal):
    law = make("solids-wall", {"model": "johnson-jackson", "friction_angle_deg": 20.0})
    mass = 0.45 / 0.63 * 1700 * 9.0
    collisional = math.pi / 6 * math.sqrt(3 * 0.04) * 0.05 * mass
    sliding = 6.0 * math.tan(math.radians(20)) / math.hypot(0.8, 0.01)
    loss = math.sqrt(3) * math.pi / 4 * (1 - 0.9**2) * mass * 0.04**1.5
    friction = agree(part(law, "friction", coal), *values())
    assert friction == pytest.approx(collisional + sliding, rel=1e-9)
    heat = agree(part(law, "heat", coal), *values())
    assert heat == pytest.approx(collisional * 0.64 - loss, rel=1e-9)


def test_johnson_jackson_of_an_elastic_wall_turns_all_work_into_heat(coal):
    law = make("solids-wall", {"model": "johnson-jackson", "restitution": 1.0})
    assert law.heat(STATE, coal) == pytest.approx(law.friction(STATE, coal) * 0.64)
    smooth_wall = replace(law, specularity=0.0)
    assert smooth_wall.friction(STATE, coal) == smooth_wall.heat(STATE, coal) == 0.0


def test_coulomb_traction_is_friction_times_pressure(coal):
    law = make("solids-wall", {"model": "coulomb", "sliding_heat": 1.0, "slip_floor": 1e-6})
    kinetic = 0.45 * 1700 * 0.04 * (1 + 2 * 1.7 * 0.45 * 9.0)
    assert law.friction(STATE, coal) * 0.8 == pytest.approx(0.5 * (6.0 + kinetic))
    assert law.heat(STATE, coal) == pytest.approx(0.5 * (6.0 + kinetic) * 0.8)
    assert make("solids-wall", "coulomb").heat(STATE, coal) == 0.0


@pytest.mark.parametrize("name", ["free-slip", "no-slip"])
def test_walls_without_weak_traction(name, coal):
    law = make("solids-wall", name)
    assert (law.friction(STATE, coal), law.heat(STATE, coal)) == (0.0, 0.0)
    assert make("gas-wall", name).friction(1.0, 1e-3, None) == 0.0


# -- gas ---------------------------------------------------------------------------------------


def wall_units(law, gas, re_p):
    """u+ and y+ found by a gas wall law at Re_p = rho u y/mu."""
    distance = 1e-3
    speed = re_p * gas.viscosity / (gas.density * distance)
    u_tau = math.sqrt(law.friction(speed, distance, gas) * speed / gas.density)
    return speed / u_tau, gas.density * u_tau * distance / gas.viscosity


@pytest.mark.parametrize("re_p", [1e4, 1e5, 1e6, 1e7])
def test_log_law_far_from_the_wall(air, re_p):
    u_plus, y_plus = wall_units(make("gas-wall", "log-law"), air, re_p)
    assert u_plus == pytest.approx(math.log(9.8 * y_plus) / 0.41, rel=1e-3)


@pytest.mark.parametrize("re_p", [1e-6, 1e-3, 1e-2, 0.1, 1.0])
def test_log_law_in_the_viscous_sublayer(air, re_p):
    u_plus, y_plus = wall_units(make("gas-wall", "log-law"), air, re_p)
    assert u_plus == pytest.approx(y_plus, rel=1e-2)


def test_log_law_blend_is_below_both_branches_and_monotonic(air):
    law = make("gas-wall", "log-law")
    speed = np.geomspace(1e-3, 1e4, 400)
    friction = law.friction(speed, 1e-3, air)
    assert np.all(friction >= air.viscosity / 1e-3)
    assert np.all(np.diff(friction) > -1e-15)
    assert np.all(np.diff(friction * speed) > 0)
    # at the crossing of the branches y+ = 11.5 the blend gives 2^(-1/n) of either
    crossing = 11.445
    u_plus, _ = wall_units(law, air, crossing**2)
    assert u_plus == pytest.approx(crossing * 2 ** (-1 / law.n), rel=1e-2)


def test_sharper_blend_is_closer_to_the_branches(air):
    soft, sharp = (make("gas-wall", {"model": "log-law", "n": n}) for n in (4.0, 12.0))
    assert wall_units(soft, air, 131.0)[0] < wall_units(sharp, air, 131.0)[0] < 11.5


@pytest.mark.parametrize("name", GAS_LAWS)
def test_gas_walls_are_finite_and_differentiable(agree, smooth, name, nitrogen):
    law = make("gas-wall", name)

    def friction(speed, distance):
        return law.friction(speed, distance, nitrogen)

    for speed in (0.0, 1e-9, 1e-3, 1.0, 100.0):
        assert agree(friction, speed, 1e-4) >= 0
        smooth(friction, [speed, 1e-4])
    if name == "log-law":
        assert agree(friction, 0.0, 1e-4) == pytest.approx(nitrogen.viscosity / 1e-4)
        assert agree(friction, 7.0, 1e-4) > 0.5


def test_log_law_stretches_the_profile_within_three_distances(agree, smooth):
    law, offset = make("gas-wall", "log-law"), 2e-4

    def height(y):
        return law.stretched(y, offset)[0]

    def slope(y):
        return law.stretched(y, offset)[1]

    assert agree(height, 0.0) == pytest.approx(offset)
    assert agree(slope, 0.0) == pytest.approx(1 / 3)
    for y in (0.0, 1e-4, 3e-4, 5.9e-4):
        step = 1e-9
        assert agree(slope, y) == pytest.approx((height(y + step) - height(y)) / step, rel=1e-4)
    for y in (6e-4, 1e-3, 5e-3):
        assert agree(height, y) == pytest.approx(y, rel=1e-12)
        assert agree(slope, y) == pytest.approx(1.0, rel=1e-12)
    smooth(height, [1e-4], difference=True)


@pytest.mark.parametrize("name", ["no-slip", "free-slip"])
def test_other_gas_walls_leave_the_profile_where_it_is(name):
    law = make("gas-wall", name)
    assert law.stretched(1e-3, 2e-4) == (1e-3, 1.0)


def test_low_reynolds_wall_is_the_sublayer():
    """mu/y at any speed, the slope of the log law's viscous branch."""
    law, gas = make("gas-wall", "low-reynolds"), Gas(1.2, 1.8e-5)
    assert law.friction(3.0, 1e-6, gas) == law.friction(0.0, 1e-6, gas) == pytest.approx(18.0)
    blended = make("gas-wall", "log-law").friction(3.0, 1e-7, gas)
    assert law.friction(3.0, 1e-7, gas) == pytest.approx(blended, rel=1e-3)


def test_height_of_the_log_law_makes_up_for_the_flux_of_the_strip():
    """Flux of ln y' over the strip less that of ln y, times perimeter over area, is ln(y_p/h)."""
    law, offset, diameter = make("gas-wall", "log-law"), 1e-4, 1e-2
    y = (np.arange(200000) + 0.5) / 200000 * 3 * offset
    stretched = np.array(law.stretched(y, offset)[0])
    excess = np.mean(np.log(stretched / y)) * 3 * offset * 4 / diameter
    drop = math.log(offset / law.height(offset, diameter))
    assert drop == pytest.approx(excess, rel=0.15)
    viscous = np.mean(stretched - y) * 3 * offset * 4 / diameter
    assert offset - law.height(offset, diameter) == pytest.approx(viscous, rel=0.25)


# -- log law by the turbulent energy ------------------------------------------------------------


def test_energy_log_law_is_the_log_law_in_equilibrium(nitrogen):
    """k = u_tau^2/0.3 gives tau = rho u_tau^2 where the velocity is u_tau ln(E y+)/kappa."""
    law, u_tau, y = make("gas-wall", "log-law-k"), 0.3, 2e-4
    y_plus = 33.5 * u_tau * y / 1.8e-5
    speed = u_tau * math.log(9.8 * y_plus) / 0.41
    traction = law.coefficient(GasWallState(speed, y, nitrogen, u_tau**2 / 0.3)) * speed
    assert traction == pytest.approx(33.5 * u_tau**2, rel=5e-3)


def test_energy_log_law_without_turbulence_is_viscous(agree, smooth, nitrogen):
    law = make("gas-wall", "log-law-k")

    def coefficient(k, y):
        return law.coefficient(GasWallState(5.0, y, nitrogen, k))

    assert agree(coefficient, 1e-12, 1e-4) == pytest.approx(1.8e-5 / 1e-4)
    smooth(coefficient, [1e-8, 1e-4])
    smooth(coefficient, [0.3, 1e-4], difference=True)
    assert law.height(1e-4, 0.01) == pytest.approx(1e-4 / 1.16)

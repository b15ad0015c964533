# SPDX-License-Identifier: LGPL-3.0-or-later
"""Two-equation laws: equilibrium of the log layer, the layer at the wall, the largest eddies."""

import math
from dataclasses import replace

import pytest

from fem_tfm.closures import make
from fem_tfm.closures.turbulence.gas import Eddies, realizable_slope

LAWS = ("k-epsilon", "realizable")
U_TAU, KAPPA = 0.3, 0.41


def log_layer(gas, y, u_tau=U_TAU):
    """Equilibrium in simple shear: k = u^2/sqrt(C_mu), eps = u^3/(kappa y), S = u/(kappa y)."""
    strain = u_tau / (KAPPA * y)
    k, eps = u_tau**2 / 0.3, u_tau**3 / (KAPPA * y)
    return Eddies(strain, y, gas, 1e6, spin=strain, A_s=realizable_slope(0.0), k=k, eps=eps)


def of(eddies, method, *rest):
    """A method of a law as a function of k, eps, strain, spin and A_s."""

    def function(k, eps, strain, spin, A_s):
        state = replace(eddies, k=k, eps=eps, strain=strain, spin=spin, A_s=A_s)
        return method(state, *rest)

    values = [eddies.k, eddies.eps, eddies.strain, eddies.spin, eddies.A_s]
    return function, values


@pytest.mark.parametrize("name", LAWS)
def test_log_layer_far_from_the_sublayer(agree, nitrogen, name):
    """nu_t = kappa u y, and k is produced as fast as it decays."""
    law, eddies = make("turbulence", name), log_layer(nitrogen, 5e-3)
    assert law.reynolds(eddies) > 1000
    viscosity, values = of(eddies, law.kinematic)
    assert agree(viscosity, *values) == pytest.approx(KAPPA * U_TAU * 5e-3, rel=2e-3)
    rate = law.balances(eddies, 0.0)["ln_k"].rate
    assert rate == pytest.approx(0.0, abs=2e-3 * eddies.eps / eddies.k)
    assert law.viscosity(eddies) == nitrogen.density * law.kinematic(eddies)


def test_standard_rates_in_closed_numbers(agree, nitrogen):
    law, eddies = make("turbulence", "k-epsilon"), log_layer(nitrogen, 5e-3)
    frequency = eddies.eps / eddies.k
    growth, values = of(eddies, law.growth)
    # the smooth cut of oversized eddies leaves 1e-5 here
    assert agree(growth, *values) == pytest.approx((1.44 - 1.92) * frequency, rel=1e-4)
    balance = law.balances(eddies, 7.0)
    assert balance["ln_k"].rate == pytest.approx(7.0, rel=1e-4)
    # eddies are those of the wall, so that nothing pulls
    assert balance["ln_eps"].rate == pytest.approx(-0.48 * frequency + 1.3 * 7.0, rel=1e-3)
    nu, nu_t = 1.8e-5 / 33.5, KAPPA * U_TAU * 5e-3
    assert balance["ln_k"].diffusivity == pytest.approx(nu + nu_t, rel=1e-4)
    assert balance["ln_eps"].diffusivity == pytest.approx(nu + nu_t / 1.3, rel=1e-4)


def test_realizable_coefficients_in_closed_numbers(agree, nitrogen):
    """C_mu = 1/(4.04 + sqrt(6) cos(30 deg) eta) in simple shear, C_1 = 0.43 and eta/(eta + 5)."""
    law, eddies = make("turbulence", "realizable"), log_layer(nitrogen, 5e-3)
    eta = 1 / 0.3
    c_mu, values = of(eddies, law.c_mu)
    shear = 1 / (4.04 + math.sqrt(6) * math.cos(math.pi / 6) * eta)
    assert agree(c_mu, *values) == pytest.approx(shear, rel=1e-9)
    assert shear == pytest.approx(0.09, rel=2e-3)
    # uniaxial strain: acos(1) = 0
    stretched = realizable_slope(1.0)
    assert agree(c_mu, *values[:4], stretched) == pytest.approx(
        1 / (4.04 + math.sqrt(6) * eta), rel=1e-3
    )
    growth, values = of(eddies, law.growth)
    frequency = eddies.eps / eddies.k
    assert agree(growth, *values) == pytest.approx((0.43 * eta - 1.9) * frequency, rel=1e-3)
    strong = replace(eddies, strain=10 * eddies.strain)
    share = 10 * eta / (10 * eta + 5)
    assert law.growth(strong) == pytest.approx((share * 10 * eta - 1.9) * frequency, rel=1e-4)


def test_published_viscous_term(nitrogen):
    eddies = log_layer(nitrogen, 5e-3)
    without, law = (make("turbulence", {"model": "realizable", "viscous": v}) for v in (0.0, 1.0))
    root = math.sqrt(1.8e-5 / 33.5 * eddies.eps)
    slower = 1.9 * eddies.eps * (1 / eddies.k - 1 / (eddies.k + root))
    assert law.growth(eddies) - without.growth(eddies) == pytest.approx(slower)


@pytest.mark.parametrize("name", LAWS)
def test_layer_at_the_wall(agree, nitrogen, name):
    """mu_t = rho 0.09 C_l y sqrt(k) [1 - exp(-Re_y/70)] with eps = k^1.5/l_eps."""
    law = make("turbulence", {"model": name, "kappa": 0.41})
    y, k, c_l = 1e-4, 0.05, 0.41 / 0.09**0.75
    eddies = replace(log_layer(nitrogen, y), k=k)
    re = 33.5 * y * math.sqrt(k) / 1.8e-5
    assert re < 100
    length = c_l * y * (1 - math.exp(-re / (2 * c_l)))
    wall, values = of(eddies, law.wall_dissipation)
    assert agree(wall, *values) == pytest.approx(k**1.5 / length, rel=1e-6)
    eddies = replace(eddies, eps=law.wall_dissipation(eddies))
    damped = 0.09 * c_l * y * math.sqrt(k) * (1 - math.exp(-re / 70))
    # the smooth cut of oversized eddies leaves 5e-6 here
    assert law.kinematic(eddies) == pytest.approx(damped, rel=1e-5)
    assert law.pull(eddies) == pytest.approx(0.0, abs=1e-9)
    assert law.wall_values(eddies) == {"ln_eps": pytest.approx(math.log(eddies.eps))}
    # twice the dissipation is pulled back at `hold` times ln 2
    twice = replace(eddies, eps=2 * eddies.eps)
    assert law.pull(twice) == pytest.approx(-20 * eddies.eps / k * math.log(2), rel=1e-6)


@pytest.mark.parametrize("name", LAWS)
def test_only_oversized_eddies_are_pulled_in_the_core(nitrogen, name):
    law = make("turbulence", {"model": name, "kappa": 0.41})
    eddies = log_layer(nitrogen, 5e-3)
    unit = eddies.eps / eddies.k
    assert abs(law.pull(replace(eddies, eps=2 * eddies.eps))) < 1e-6 * unit
    assert law.pull(replace(eddies, eps=eddies.eps * math.exp(-3))) == pytest.approx(
        20 * unit * 2, rel=1e-3
    )


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("height", [1e-4, 5e-3], ids=["wall layer", "core"])
def test_viscosity_of_oversized_eddies_is_that_of_the_largest(agree, nitrogen, name, height):
    """Where eps vanishes before k, nu_t is that of eddies e times as long as the wall's."""
    law, eddies = make("turbulence", name), log_layer(nitrogen, height)
    wall = law.wall_dissipation(eddies)
    largest = law.kinematic(replace(eddies, eps=wall * math.exp(-1.5)))
    for excess in (5.0, 20.0):
        viscosity, values = of(replace(eddies, eps=wall * math.exp(-excess)), law.kinematic)
        assert agree(viscosity, *values) == pytest.approx(largest, rel=0.01)
    # those of a gas without grains are left alone
    ratio = law.kinematic(replace(eddies, eps=wall / 1.1)) / law.kinematic(
        replace(eddies, eps=wall)
    )
    c_mu = [law.c_mu(replace(eddies, eps=wall / f)) for f in (1.1, 1.0)]
    share = 1.1 * c_mu[0] / c_mu[1] if law.outer(eddies) > 0.5 else 1.1
    assert ratio == pytest.approx(share, rel=1e-4)


@pytest.mark.parametrize("name", LAWS)
def test_slopes_match_differences(smooth, nitrogen, name):
    law = make("turbulence", name)
    for y in (1e-5, 2e-4, 5e-3):
        eddies = replace(log_layer(nitrogen, y), A_s=realizable_slope(0.2))
        for method in (law.kinematic, law.growth, law.pull, law.oversize, law.wall_dissipation):
            function, values = of(eddies, method)
            smooth(function, values, difference=True)


@pytest.mark.parametrize("name", LAWS)
def test_estimate(name):
    law = make("turbulence", name)
    found = law.estimate(6.0, 0.1, 1e-3)
    k = 1.5 * 0.6**2
    assert found["ln_k"] == pytest.approx(math.log(k))
    assert found["ln_eps"] == pytest.approx(math.log(0.09**0.75 * k**1.5 / 1e-3))


def test_slope_of_the_realizable_laws(agree, smooth):
    """A_s = sqrt(6) cos(acos(x)/3): sqrt(6) cos(30 deg) in simple shear, sqrt(6) in stretching."""
    assert agree(realizable_slope, 0.0) == pytest.approx(
        math.sqrt(6) * math.cos(math.pi / 6), rel=1e-3
    )
    assert agree(realizable_slope, 1.0) == pytest.approx(math.sqrt(6), rel=1e-3)
    for x in (-1.0, -0.3, 0.2, 1.0):
        smooth(realizable_slope, [x], difference=True)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Turbulence of the solids and their dispersion: exchange in closed numbers and in balance."""

import math
from dataclasses import replace

import pytest

from fem_tfm.closures import make, names
from fem_tfm.closures.turbulence.dispersed import GasEddies, Grains
from fem_tfm.closures.turbulence.gas import Eddies, realizable_slope

GAS = GasEddies(k=0.3, eps=40.0, nu=0.09 * 0.3**2 / 40.0, density=33.5, floor=0.01)


@pytest.fixture
def grains(coal, nitrogen):
    """A suspension of 20 % that slips at 0.5 m/s."""
    own = Eddies(
        800.0, 1e-3, nitrogen, 5e-3, spin=800.0, A_s=realizable_slope(0.0), k=0.02, eps=1.5
    )
    return Grains(0.2, 0.04, 2.0, 2e4, 0.5, -30.0, coal, viscosity=1e-4, eddies=own)


def times(crossing=0.45, added=0.5):
    """tau_t and tau_F of the suspension."""
    xi2 = 1.5 * 0.5**2 / 0.3
    return 1.5 * GAS.nu / 0.3 / math.sqrt(1 + crossing * xi2), (1700 + added * 33.5) / 2e4


def drift_power(nu_s, sigma):
    return -2e4 * -30.0 * (nu_s + GAS.nu * 0.25) / sigma


def test_no_exchange(grains):
    law = make("dispersed", "none")
    assert law.viscosity(GAS, grains) == law.gain(GAS, grains) == 0.0
    assert law.balances(GAS, grains) == law.estimate(1.0, 1.0, 1.0) == {}


def test_simonin_in_dilute_flow(grains):
    """k_gs = 2 k (b + eta)/(1 + eta), nu_s without collisions = [k_gs tau_t + k_s tau_F]/3."""
    law = make("dispersed", {"model": "simonin", "agitation": 0.0, "drift": 0.0})
    tau_t, tau_f = times()
    eta, b = tau_t / tau_f, 1.5 / (1700 / 33.5 + 0.5)
    k_gs, k_s = 0.6 * (b + eta) / (1 + eta), 0.3 * (b**2 + eta) / (1 + eta)
    assert law.covariance(GAS, grains) == pytest.approx(k_gs)
    cold = replace(grains, theta=0.0)
    assert law.viscosity(GAS, cold) == pytest.approx((k_gs * tau_t + k_s * tau_f) / 3)
    sink = 2e4 * 0.25 / (33.5 * 0.3) * (k_gs - 0.6) * (1 - 0.01 / 0.3)
    assert law.gain(GAS, grains) == pytest.approx(sink)


def test_grains_that_follow(grains):
    """nu_s = nu_g s; tracers move as the gas does and stones not at all."""
    law = make("dispersed", "tchen")
    tau_t, tau_f = times()
    share = tau_t / (tau_t + tau_f)
    assert law.share(GAS, grains) == pytest.approx(share)
    assert law.viscosity(GAS, grains) == pytest.approx(GAS.nu * share)
    assert law.gain(GAS, grains) == 0.0
    assert law.viscosity(GAS, replace(grains, specific=1e15)) == pytest.approx(GAS.nu)
    assert law.viscosity(GAS, replace(grains, specific=1e-9)) == pytest.approx(0.0, abs=1e-12)
    wall = law.at_wall(33.5, grains)
    assert wall.loading == pytest.approx(0.2 * 1700 / (0.8 * 33.5))
    assert wall.relaxation == pytest.approx(tau_f)


def test_collisions_cut_the_path_of_grains(grains):
    law, tau_f = make("dispersed", "simonin"), times()[1]
    collisions = 24 * 0.2 * 2.0 * math.sqrt(0.04 / math.pi) / 1.6e-4
    ratio = law.viscosity(GAS, replace(grains, theta=0.0)) / law.viscosity(GAS, grains)
    assert ratio == pytest.approx(1 + tau_f * collisions * 1.7 * 2.3 / 10)


def test_agitated_grains_feed_the_gas(grains):
    """Where the loading is high the covariance tends to twice the grains' agitation."""
    law = make("dispersed", "simonin")
    dense = replace(grains, alpha=1 - 1e-9, theta=0.5)
    assert law.covariance(GAS, dense) == pytest.approx(2 * 0.75, rel=1e-3)
    assert law.gain(GAS, replace(grains, theta=40.0)) > 0 > law.gain(GAS, grains)


def test_grains_leave_the_floor(grains):
    """At rest they take nothing from the floor; agitated, they give there and below it."""
    law = make("dispersed", {"model": "simonin", "drift": 0.0})
    floor = replace(GAS, k=GAS.floor)
    assert law.gain(floor, replace(grains, theta=0.0)) == pytest.approx(0.0, abs=1e-9)
    for theta in (0.0, 0.04, 40.0):
        agitated = replace(grains, theta=theta)
        gains = [law.gain(replace(GAS, k=f * GAS.floor), agitated) for f in (0.01, 0.1, 0.99)]
        assert gains[0] > gains[1] > gains[2] > 0


@pytest.mark.parametrize("drift", [0.0, 1.0])
def test_exchange_of_four_equations_is_mutual(grains, drift):
    """What one phase gives the other receives; the drift power goes to both."""
    law = make("dispersed", {"model": "k-epsilon", "drift": drift})
    tau_t, tau_f = times()
    eta = tau_t / tau_f
    given = 2 * 0.02 - 2 * eta / (1 + eta) * 0.3
    assert law.exchange(GAS, grains) == pytest.approx(given)
    nu_s = law.viscosity(GAS, grains)
    power = drift * drift_power(nu_s, 1.0)
    to_gas = law.gain(GAS, grains) * 0.8 * 33.5 * 0.3
    assert to_gas == pytest.approx(0.2 * (2e4 * given + power))
    own = grains.eddies
    rate = law.balances(GAS, grains)["ln_k_s"].rate
    to_solids = (rate - nu_s * 800.0**2 / own.k + own.eps / own.k) * 0.2 * 1700 * own.k
    assert to_gas + to_solids == pytest.approx(2 * 0.2 * power, abs=1e-9 * abs(to_gas))


def test_equations_of_the_solids(grains):
    law, own = make("dispersed", "k-epsilon"), grains.eddies
    eta = 800.0 * 0.02 / 1.5
    c_mu = 1 / (4.04 + math.sqrt(6) * math.cos(math.pi / 6) * eta)
    nu_s = c_mu * 0.02**2 / 1.5
    assert law.viscosity(GAS, grains) == pytest.approx(nu_s, rel=1e-9)
    balance = law.balances(GAS, grains)
    assert balance["ln_k_s"].diffusivity == pytest.approx(1e-4 + nu_s)
    assert balance["ln_eps_s"].diffusivity == pytest.approx(1e-4 + nu_s / 1.2)
    gain = balance["ln_k_s"].rate - nu_s * 800.0**2 / own.k + own.eps / own.k
    rate = eta / (eta + 5) * 800.0 - 1.9 * own.eps / own.k + 1.3 * gain
    assert balance["ln_eps_s"].rate == pytest.approx(rate, rel=1e-4)


def test_start_of_the_solids(grains):
    found = make("dispersed", "k-epsilon").estimate(6.0, 0.05, 1e-3)
    k = 1.5 * 0.3**2
    assert found["ln_k_s"] == pytest.approx(math.log(k))
    assert found["ln_eps_s"] == pytest.approx(math.log(0.09**0.75 * k**1.5 / 1e-3))


def test_dispersion(grains):
    assert make("dispersion", "none").diffusivity(GAS, grains, 0.0) == 0.0
    burns = make("dispersion", "burns").diffusivity(GAS, grains, 0.0)
    assert burns == pytest.approx(GAS.nu / 0.9)
    tau_t, tau_f = times()
    eta = tau_t / tau_f
    found = make("dispersion", "simonin").diffusivity(GAS, grains, 0.0)
    assert found == pytest.approx(tau_t / 3 * 0.6 * eta / (1 + eta))


def test_drift_does_the_work_that_the_turbulence_receives(grains):
    """Force -beta D (grad a/a - grad a_g/a_g) times the slip is the drift power of eqs. (5)-(8)."""
    nu_s, sigma = 3e-5, 0.8
    law = make("dispersion", {"model": "drift", "sigma": sigma})
    force_per_gradient = 2e4 * law.diffusivity(GAS, grains, nu_s) / 0.8
    # beta (u_g - u_s).grad a/a = -beta drift, over a
    assert force_per_gradient * 30.0 == pytest.approx(drift_power(nu_s, sigma))


@pytest.mark.parametrize("name", names("dispersed"))
def test_finite_and_differentiable_where_the_solids_vanish(agree, smooth, name, grains):
    law = make("dispersed", name)
    for method in (law.viscosity, law.gain):

        def value(alpha, theta, k, slip, method=method):
            gas = replace(GAS, k=k)
            return method(gas, replace(grains, alpha=alpha, theta=theta, slip=slip))

        for alpha in (1e-9, 0.3, 0.62):
            for slip in (0.0, 2.0):
                agree(value, alpha, 1e-8, 1e-4, slip)
                smooth(value, [alpha, 1e-8, 1e-4, slip])
        smooth(value, [0.2, 0.04, 0.3, 0.5], difference=True)

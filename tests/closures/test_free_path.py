# SPDX-License-Identifier: LGPL-3.0-or-later
"""Viscosity and conductivity that the gas limits: closed numbers, dilute and dense limits."""

import math

import numpy as np
import pytest

from fem_tfm.closures import make, names
from fem_tfm.closures.granular import Kinetic
from fem_tfm.materials import Solids

# p, mu, lambda, kappa, gamma with a = 0.1, Theta = 1, g0 = 2, beta = 25, grains of 2500 kg/m3:
# (a rho_s)^2 g0 Theta = 125000; with mu_d and kappa_d of 1e4 and 1.25e4 2 beta mu_d = 500000 and
# 1.2 beta kappa_d = 375000. Contacts have 300 and 750, flights 7000 and 6000
THETA = 0.04
GIVEN = Kinetic(3.0, 7000.0 + 300.0, 500.0, 6000.0 + 750.0, 7.0)
NUMBERS = {"none": GIVEN, "agrawal": Kinetic(3.0, 1400.0 + 300.0, 500.0, 1500.0 + 750.0, 7.0)}


class Given:
    """A theory of given numbers."""

    def coefficients(self, *_):
        return GIVEN

    def dilute(self, *_):
        return 1e4, 1.25e4


@pytest.mark.parametrize("name", names("free-path"))
def test_closed_numbers(agree, name, beads):
    law = make("free-path", name)
    for i, expected in enumerate(NUMBERS[name]):

        def one(*at, i=i):
            return law.coefficients(Given(), *at, beads, 1.0)[i] + 0 * at[0]

        assert agree(one, 0.1, 1, 2, 25) == pytest.approx(expected, rel=1e-12), Kinetic._fields[i]


@pytest.mark.parametrize("theory", names("granular"))
def test_flights_are_the_dilute_limit_of_a_theory(theory, coal):
    """What contacts leave of mu and kappa tends to mu_d and kappa_d."""
    # a path of a third of the radius, for the theory that it limits
    law, at, width = make("granular", theory), (1e-7, THETA), 1e3
    free = law.coefficients(*at, 1.0, coal, width)
    wanted = free.shear_viscosity, free.conductivity
    assert law.dilute(*at, coal, width) == pytest.approx(wanted, rel=1e-5)


@pytest.mark.parametrize("restitution", [0.1, 0.3, 0.5, 0.7, 0.9, 0.99])
@pytest.mark.parametrize("theory", names("granular"))
def test_it_takes_no_more_than_there_is(theory, restitution):
    """Theories of nearly elastic grains have negative kinetic parts in dense inelastic grains."""
    grains = Solids(density=2500.0, diameter=2e-4, restitution=restitution)
    alpha, theta, beta = np.meshgrid(
        np.linspace(0.01, 0.6, 30), np.logspace(-8, 0, 17), [0, *np.logspace(-2, 5, 15)]
    )
    g0 = make("radial", "savage").g0(alpha, grains)
    law, at = make("granular", theory), (alpha, theta, g0)
    free = law.coefficients(*at, grains, 0.05)
    found = make("free-path", "agrawal").coefficients(law, *at, beta, grains, 0.05)
    for limited, whole in zip(found, free, strict=True):
        assert (limited > 0).all() and (limited <= whole * (1 + 1e-14)).all()


@pytest.mark.parametrize("theory", names("granular"))
def test_dilute_grains_carry_by_their_relaxation_time(theory, coal):
    """mu -> a rho_s tau Theta/2 and kappa -> a rho_s tau Theta/1.2, whatever the theory has."""
    found = limited(theory, 1e-7, 1e-3, coal)
    scale = 1e-7 * coal.density * 1e-3 * THETA
    assert found.shear_viscosity <= scale / 2 * (1 + 1e-3)
    assert found.conductivity <= scale / 1.2 * (1 + 1e-3)
    if theory in ("gidaspow", "lun", "garzo-dufty"):
        # those whose viscosity does not vanish with a
        wanted = scale / 2, scale / 1.2
        assert (found.shear_viscosity, found.conductivity) == pytest.approx(wanted, rel=2e-3)


@pytest.mark.parametrize("theory", names("granular"))
def test_dense_grains_carry_by_their_contacts(theory, coal):
    """Weak drag changes nothing, and strong drag leaves what contacts transmit."""
    free = limited(theory, 0.5, 1e9, coal)
    assert limited(theory, 0.5, 1e3, coal) == pytest.approx(free, rel=1e-4)
    held = limited(theory, 0.5, 1e-9, coal)
    bulk = free.bulk_viscosity
    wanted = 0.6 * bulk, 1.5 * bulk
    assert (held.shear_viscosity, held.conductivity) == pytest.approx(wanted, rel=1e-3)


def limited(theory, alpha, time, coal):
    """Coefficients of a theory with a relaxation time of the grains [s]."""
    g0 = make("radial", "savage").g0(alpha, coal)
    beta, law = alpha * coal.density / time, make("free-path", "agrawal")
    return law.coefficients(make("granular", theory), alpha, THETA, g0, beta, coal, 1e3)


@pytest.mark.parametrize("alpha", [0.0, 1e-9, 0.3])
@pytest.mark.parametrize("theta", [0.0, 1e-8, 1.0])
def test_it_is_finite_everywhere(alpha, theta, coal):
    law = make("free-path", "agrawal")
    for name in names("granular"):
        theory = make("granular", name)
        free = theory.coefficients(alpha, theta, 1.0, coal, 0.05)
        found = law.coefficients(theory, alpha, theta, 1.0, 1e3 * alpha, coal, 0.05)
        for limited, value in zip(found, free, strict=True):
            assert math.isfinite(limited) and 0 <= limited <= value

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Viscosity and conductivity that the gas limits: closed numbers, dilute and dense limits."""

import math

import pytest

from fem_tfm.closures import make, names
from fem_tfm.closures.granular import Kinetic

# p, mu, lambda, kappa, gamma with a = 0.1, Theta = 1, g0 = 2, beta = 25, grains of 2500 kg/m3:
# (a rho_s)^2 g0 Theta = 125000; of the kinetic parts 1e4 and 1.25e4 2 beta mu_k = 500000 and
# 1.2 beta kappa_k = 375000
THETA = 0.04
GIVEN = Kinetic(3.0, 1e4 + 300.0, 500.0, 1.25e4 + 750.0, 7.0)
NUMBERS = {"none": GIVEN, "agrawal": Kinetic(3.0, 2000.0 + 300.0, 500.0, 3125.0 + 750.0, 7.0)}


@pytest.mark.parametrize("name", names("free-path"))
def test_closed_numbers(agree, name, beads):
    law = make("free-path", name)
    for i, expected in enumerate(NUMBERS[name]):
        found = agree(lambda *at, i=i: law.limited(GIVEN, *at, beads)[i] + 0 * at[0], 0.1, 1, 2, 25)
        assert found == pytest.approx(expected, rel=1e-12), Kinetic._fields[i]


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
    free = make("granular", theory).coefficients(alpha, THETA, g0, coal, 1e3)
    beta = alpha * coal.density / time
    return make("free-path", "agrawal").limited(free, alpha, THETA, g0, beta, coal)


@pytest.mark.parametrize("alpha", [0.0, 1e-9, 0.3])
@pytest.mark.parametrize("theta", [0.0, 1e-8, 1.0])
def test_it_is_finite_everywhere(alpha, theta, coal):
    law = make("free-path", "agrawal")
    for name in names("granular"):
        free = make("granular", name).coefficients(alpha, theta, 1.0, coal, 0.05)
        found = law.limited(free, alpha, theta, 1.0, 1e3 * alpha, coal)
        for limited, value in zip(found, free, strict=True):
            assert math.isfinite(limited) and 0 <= limited <= value

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Granular energy from the slip: closed numbers, its bound, its fall with Theta."""

import math

import pytest

from fem_tfm.closures import make, names

# P and -dP/dTheta of the printed formula at a = 0.1, Theta = 1, beta = 25, u^2 = 4 with grains of
# 2500 kg/m3 and 1 mm: v = 1e-3 * 0.1/(4 sqrt(pi)) m/s
NUMBERS = {"none": (0.0, 0.0), "koch": (1.4104739e-3, 7.052369e-4)}
SPEED = 1e-4 / (4 * math.sqrt(math.pi))


@pytest.mark.parametrize("name", names("slip-production"))
def test_closed_numbers(agree, name, beads):
    law = make("slip-production", name)
    for i, expected in enumerate(NUMBERS[name]):
        found = agree(lambda *at, i=i: law.production(*at, beads)[i] + 0.0, 0.1, 1.0, 25.0, 4.0)
        assert found == pytest.approx(expected, rel=1e-6)


def test_it_is_that_of_koch_where_grains_are_agitated(beads):
    """0.25 beta^2 d u^2/(a rho_s sqrt(pi Theta)), to v^2/(2 Theta)."""
    for theta in (1e-6, 1e-3, 1.0):
        power = make("slip-production", "koch").production(0.1, theta, 25.0, 4.0, beads).power
        printed = 0.25 * 25**2 * 1e-3 * 4.0 / (0.1 * 2500 * math.sqrt(math.pi * theta))
        assert power == pytest.approx(printed, rel=SPEED**2 / theta)


def test_no_more_than_the_work_of_the_drag(beads):
    law = make("slip-production", "koch")
    assert law.production(0.1, 0.0, 25.0, 4.0, beads).power == pytest.approx(25 * 4.0)
    for theta in (1e-12, 1e-9, 1e-3):
        assert 0 < law.production(0.1, theta, 25.0, 4.0, beads).power < 25 * 4.0


@pytest.mark.parametrize("theta", [0.0, 1e-10, 1e-4, 1.0])
def test_the_fall_is_the_slope(slope, theta, beads):
    law, at = make("slip-production", "koch"), (0.1, theta, 25.0, 4.0)
    found = slope(lambda *at: law.production(*at, beads).power, at, 1)
    assert -found == pytest.approx(law.production(*at, beads).fall, rel=1e-12)


def test_nothing_without_drag(beads):
    assert make("slip-production", "koch").production(0.1, 0.0, 0.0, 4.0, beads) == (0.0, 0.0)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Drag laws: closed numbers, limits, continuity of the switches, beds at rest."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from fem_tfm.closures import make, names
from fem_tfm.closures.drag import schiller_naumann_factor
from fem_tfm.materials import Gas, Solids

DRAGS = names("drag")

# beta of the printed formulas at alpha_s = 0.05, 0.3, 0.5; air, d = 1 mm, slip 1 m/s
NUMBERS = {
    "beetstra": (80.6330, 907.657, 2503.43),
    "clift-gauvin": (59.7721, 358.633, 597.721),
    "constant": (500.0, 3000.0, 5000.0),
    "di-felice": (72.3233, 699.632, 1990.10),
    "ergun": (112.105, 977.143, 2400.0),
    "gibilaro": (40.0847, 483.470, 1786.37),
    "gidaspow": (66.6825, 977.143, 2400.0),
    "huilin-gidaspow": (67.0496, 974.705, 2401.27),
    "igci": (9.92172, 179.247, 2713.32),
    "koch-hill": (78.2896, 748.355, 2238.10),
    "schiller-naumann": (59.7143, 358.286, 597.143),
    "syamlal-obrien": (79.6092, 891.248, 2147.65),
    "tenneti": (69.5091, 795.576, 2264.45),
    "three-zone": (66.6825, 483.470, 2400.0),
    "wen-yu": (66.6825, 775.967, 2713.32),
}


def at(name, gas, solids, **parameters):
    """beta/alpha_s of a law as a function of alpha_s and slip."""
    law = make("drag", {"model": name, **parameters})
    return lambda alpha, slip: law.specific(alpha, slip, gas, solids)


@pytest.mark.parametrize("name", DRAGS)
def test_closed_numbers(agree, name, air, beads):
    law = make("drag", name)
    for alpha, expected in zip((0.05, 0.3, 0.5), NUMBERS[name], strict=True):
        beta = agree(lambda a, u: law.beta(a, u, air, beads), alpha, 1.0)
        assert beta == pytest.approx(expected, rel=1e-5)


REFERENCE = [
    (0.01, 12.2, 21.3),
    (0.1, 149.9, 240.0),
    (0.2, 386.8, 555.0),
    (0.3, 776.0, 977.0),
    (0.6, 5359.0, 3690.0),
]


@pytest.mark.parametrize(("alpha", "wen_yu", "ergun"), REFERENCE)
def test_reference_table(alpha, wen_yu, ergun, air, beads):
    assert make("drag", "wen-yu").beta(alpha, 1.0, air, beads) == pytest.approx(wen_yu, rel=3e-3)
    assert make("drag", "ergun").beta(alpha, 1.0, air, beads) == pytest.approx(ergun, rel=3e-3)


@pytest.mark.parametrize("name", DRAGS)
@pytest.mark.parametrize("slip", [0.0, 0.3, 50.0])
def test_finite_positive_and_differentiable(agree, smooth, name, slip, nitrogen, coal):
    law = at(name, nitrogen, coal)
    for alpha in (0.0, 1e-9, 0.1, 0.2, 0.4, 0.6299):
        value = agree(law, alpha, slip)
        # Ergun alone vanishes in a dilute gas at rest
        assert value > 0 or (name == "ergun" and alpha == slip == 0)
        smooth(law, [alpha, slip])


@pytest.mark.parametrize("name", DRAGS)
def test_slopes_match_differences(smooth, name, nitrogen, coal):
    for alpha in (0.02, 0.33, 0.55):
        smooth(at(name, nitrogen, coal), [alpha, 0.4], difference=True)


@pytest.mark.parametrize("name", [n for n in DRAGS if n != "constant"])
def test_force_grows_with_slip(name, nitrogen, coal):
    law, slip = at(name, nitrogen, coal), np.geomspace(1e-4, 30, 200)
    for alpha in (0.01, 0.3, 0.6):
        assert np.all(np.diff(law(alpha, slip) * slip) > 0)


@pytest.mark.parametrize("name", DRAGS)
def test_beta_vanishes_with_the_solids(name, nitrogen, coal):
    law = make("drag", name)
    assert law.beta(0.0, 1.0, nitrogen, coal) == 0.0
    assert 0 < law.beta(1e-9, 1.0, nitrogen, coal) < 1e-3


# beta/alpha_s over Stokes' 18 mu/d^2 for a lone grain as the slip vanishes
STOKES = {
    "beetstra": 1.0,
    "clift-gauvin": 1.0,
    "di-felice": 0.96,
    "gibilaro": 17.3 / 18,
    "gidaspow": 1.0,
    "igci": 1 - 2.7 * 1e-8**0.234,
    "koch-hill": 1.0,
    "schiller-naumann": 1.0,
    "syamlal-obrien": 0.96,
    "tenneti": 1.0,
    "three-zone": 1.0,
    "wen-yu": 1.0,
}


@pytest.mark.parametrize("name", STOKES)
def test_lone_grain_obeys_stokes(name, nitrogen, coal):
    stokes = 18 * nitrogen.viscosity / coal.diameter**2
    ratio = at(name, nitrogen, coal)(0.0, 1e-9) / stokes
    assert ratio == pytest.approx(STOKES[name], rel=2e-3)


@pytest.mark.parametrize("name", ["beetstra", "koch-hill"])
def test_dense_creeping_flow_obeys_carman(name, nitrogen, coal):
    carman = 180 * 0.6 * nitrogen.viscosity / (0.4 * coal.diameter**2)
    assert at(name, nitrogen, coal)(0.6, 1e-9) == pytest.approx(carman, rel=0.02)


def test_newton_drag_of_a_fast_lone_grain(air, beads):
    speed = 30.0
    expected = 0.75 * 0.44 * air.density * speed / beads.diameter
    assert at("schiller-naumann", air, beads)(0.0, speed) == pytest.approx(expected)


def test_drag_coefficient_is_smooth_through_its_switch(smooth):
    re = np.linspace(800, 1200, 801)
    factor = schiller_naumann_factor(re)
    printed = np.where(re < 1000, 1 + 0.15 * re**0.687, 0.44 / 24 * re)
    assert factor == pytest.approx(printed, rel=5e-3)
    assert np.all(np.diff(factor) > 0)
    smooth(schiller_naumann_factor, [1003.0], difference=True)


def test_three_zone_branches_are_exact_outside_the_blends(air, beads):
    law = make("drag", "three-zone").specific
    for alpha, name in [(0.42, "ergun"), (0.38, "gibilaro"), (0.12, "gibilaro"), (0.08, "wen-yu")]:
        branch = make("drag", name).specific(alpha, 1.0, air, beads)
        assert law(alpha, 1.0, air, beads) == pytest.approx(branch, rel=1e-14)


def test_three_zone_factor_scales_only_the_middle(air, beads):
    mckeen, full = at("three-zone", air, beads, C=0.25), at("three-zone", air, beads)
    assert mckeen(0.25, 1.0) == pytest.approx(0.25 * full(0.25, 1.0))
    assert mckeen(0.5, 1.0) == full(0.5, 1.0)
    assert mckeen(0.05, 1.0) == full(0.05, 1.0)


@pytest.mark.parametrize(
    ("name", "switch"),
    [("gidaspow", 0.2), ("three-zone", 0.4), ("three-zone", 0.1), ("koch-hill", 0.4)],
)
def test_switches_are_continuous_in_value_and_slope(slope, name, switch, air, beads):
    law = at(name, air, beads)
    for edge in (switch - 0.01, switch, switch + 0.01):
        before, after = (law(edge + s, 1.0) for s in (-1e-9, 1e-9))
        assert before == pytest.approx(after, rel=1e-6)
        left, right = (slope(law, [edge + s, 1.0], 0) for s in (-1e-9, 1e-9))
        assert left == pytest.approx(right, rel=1e-4)


ERGUN_BED = [(0.05, 809.0), (0.1, 1716.0), (0.5, 12516.0), (1.0, 34875.0)]


@pytest.mark.parametrize(("velocity", "gradient"), ERGUN_BED)
def test_pressure_drop_of_a_fixed_bed(velocity, gradient, air, beads):
    slip = velocity / 0.4
    beta = make("drag", "ergun").beta(0.6, slip, air, beads)
    assert beta * slip / 0.4 == pytest.approx(gradient, rel=1e-3)


FLUIDISATION = [
    (2.75e-4, 2500.0, 1.8e-5, 0.0714),
    (2.5e-3, 2526.0, 1.8e-5, 1.228),
    (3.256e-3, 1131.0, 1.8e-5, 0.933),
    (3e-4, 2500.0, 1.84e-5, 0.0827),
    (5e-3, 890.0, 1.8e-5, 1.076),
]


@pytest.mark.parametrize(("diameter", "density", "viscosity", "expected"), FLUIDISATION)
def test_minimum_fluidisation_by_ergun(diameter, density, viscosity, expected):
    gas, solids = Gas(1.2, viscosity), Solids(density, diameter)
    law = make("drag", "ergun")
    weight = 0.6 * (density - gas.density) * 9.81

    def surplus(velocity):
        slip = velocity / 0.4
        return law.beta(0.6, slip, gas, solids) * slip / 0.4 - weight

    assert brentq(surplus, 1e-4, 10) == pytest.approx(expected, rel=0.01)


def test_richardson_zaki_exponents_of_di_felice():
    """Hindered settling U = u_t a_g^n with n = 4.7 in Stokes' regime and 2.4 in Newton's."""
    for diameter, viscosity, n in ((1e-5, 1.0, 4.7), (1e-3, 1e-12, 2.35)):
        law = at("di-felice", Gas(1.2, viscosity), Solids(2500.0, diameter))

        def settling(alpha, law=law):
            # slip where drag carries the weight of the grains in the mixture
            weight = (1 - alpha) * 2500.0 * 9.81
            return brentq(lambda u: law(alpha, u) * u - weight, 1e-12, 1e6) * (1 - alpha)

        measured = math.log(settling(0.2) / settling(1e-6)) / math.log(0.8)
        assert measured == pytest.approx(n, abs=0.05)

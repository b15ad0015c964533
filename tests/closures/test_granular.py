# SPDX-License-Identifier: LGPL-3.0-or-later
"""Kinetic theories: closed numbers, simple shear, Haff's law, limits, scaling with Theta."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from fem_tfm.closures import make, names
from fem_tfm.closures.granular import Kinetic, algebraic_theta, haff
from fem_tfm.materials import Solids

LAWS = names("granular")
DIAMETER = 0.05


def unit(restitution):
    """Grains with rho_s = d = 1, so that coefficients are dimensionless."""
    return SimpleNamespace(density=1.0, diameter=1.0, restitution=restitution)


def starling(alpha):
    return (1 - alpha / 2) / (1 - alpha) ** 3


# p, mu, lambda, kappa, gamma of the printed formulas at a = 0.3, Theta = 4, g0 = 2.5, e = 0.8,
# rho_s = d = 1, pipe diameter 10
NUMBERS = {
    "gidaspow": (4.44, 0.7206108, 0.6093248, 3.026284, 4.387138),
    "syamlal-obrien": (4.44, 0.5070689, 0.6093248, 1.575646, 4.387138),
    "lun": (4.44, 0.6380634, 0.6093248, 1.984077, 4.387138),
    "hrenya-sinclair": (4.44, 0.6285212, 0.6093248, 1.954325, 4.387138),
    "garzo-dufty": (4.44, 0.6605020, 0.6098037, 2.512655, 4.376792),
}


@pytest.mark.parametrize("name", LAWS)
def test_closed_numbers(agree, name):
    law, solids = make("granular", name), unit(0.8)
    for i, expected in enumerate(NUMBERS[name]):
        value = agree(
            lambda a, t, g, i=i: law.coefficients(a, t, g, solids, 10.0)[i], 0.3, 4.0, 2.5
        )
        assert value == pytest.approx(expected, rel=1e-6), Kinetic._fields[i]


@pytest.mark.parametrize("name", LAWS)
def test_the_pressure_alone_is_that_of_the_coefficients(name):
    law, solids = make("granular", name), unit(0.8)
    pressure = law.coefficients(0.3, 4.0, 2.5, solids, 10.0).pressure
    assert law.pressure(0.3, 4.0, 2.5, solids) == pytest.approx(pressure, rel=1e-15)


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("theta", [0.0, 1e-10, 1e-2])
def test_finite_positive_and_differentiable(smooth, name, theta, coal):
    law, radial = make("granular", name), make("radial", "savage")

    def coefficients(a, t):
        return law.coefficients(a, t, radial.g0(a, coal), coal, DIAMETER)

    for alpha in (0.0, 1e-9, 0.2, 0.629):
        for value in coefficients(alpha, theta):
            assert math.isfinite(value) and value >= 0
        smooth(lambda a, t: sum(coefficients(a, t)), [alpha, theta])


@pytest.mark.parametrize("name", LAWS)
def test_slopes_match_differences(smooth, name, coal):
    law, radial = make("granular", name), make("radial", "savage")
    for i in range(5):

        def coefficient(a, t, i=i):
            return law.coefficients(a, t, radial.g0(a, coal), coal, DIAMETER)[i]

        smooth(coefficient, [0.45, 1e-2], difference=True)


@pytest.mark.parametrize("name", LAWS)
def test_powers_of_theta(name, coal):
    law = make("granular", name)
    low, high = (law.coefficients(0.4, t, 5.0, coal, DIAMETER) for t in (0.01, 0.04))
    assert [h / v for h, v in zip(high, low, strict=True)] == pytest.approx([4, 2, 2, 2, 8])


@pytest.mark.parametrize("name", LAWS)
def test_elastic_grains_do_not_dissipate(name):
    assert make("granular", name).coefficients(0.3, 1.0, 2.0, unit(1.0), 10.0).dissipation == 0.0


def test_theories_agree_for_elastic_grains():
    """Gidaspow, Lun and Garzo-Dufty share Enskog's limit."""
    laws = [make("granular", n) for n in ("gidaspow", "lun", "garzo-dufty")]
    rows = np.array([law.coefficients(0.3, 2.0, 3.0, unit(1.0), 10.0) for law in laws])
    assert rows[1:] == pytest.approx(np.tile(rows[0], (2, 1)), rel=1e-12)


def test_dissipation_of_garzo_dufty_tends_to_lun():
    for e in (0.95, 0.999):
        lun, dufty = (
            make("granular", n).coefficients(0.3, 1.0, 2.0, unit(e), 10.0).dissipation
            for n in ("lun", "garzo-dufty")
        )
        assert dufty == pytest.approx(lun, rel=0.1 * (1 - e) + 1e-12)


@pytest.mark.parametrize("name", ["hrenya-sinclair", "syamlal-obrien"])
def test_transport_stops_in_vacuum_where_the_free_path_is_limited(name, coal):
    kinetic = make("granular", name).coefficients(0.0, 1.0, 1.0, coal, DIAMETER)
    assert kinetic == (0, 0, 0, 0, 0)


def test_hrenya_sinclair_is_lun_in_a_wide_pipe_and_less_in_a_narrow_one():
    lun, wide, narrow = (
        make("granular", name).coefficients(0.01, 1.0, 1.0, unit(0.9), length)
        for name, length in (("lun", 1), ("hrenya-sinclair", 1e9), ("hrenya-sinclair", 2))
    )
    assert wide == pytest.approx(lun)
    assert narrow.shear_viscosity < 0.1 * lun.shear_viscosity
    assert narrow.conductivity < 0.1 * lun.conductivity


SHEAR = [
    (0.80, 0.1, 3.829, 0.5625, 0.2380),
    (0.80, 0.3, 0.6598, 0.7277, 0.2913),
    (0.80, 0.5, 0.4657, 2.748, 1.162),
    (0.90, 0.1, 7.052, 1.054, 0.3139),
    (0.90, 0.3, 1.287, 1.477, 0.4188),
    (0.90, 0.5, 0.9261, 5.742, 1.720),
    (0.95, 0.1, 13.56, 2.046, 0.4297),
    (0.95, 0.3, 2.544, 2.976, 0.5973),
    (0.95, 0.5, 1.848, 11.73, 2.487),
]


@pytest.mark.parametrize(("e", "alpha", "theta", "pressure", "stress"), SHEAR)
def test_simple_shear(agree, e, alpha, theta, pressure, stress):
    """Shear rate 1: S:S = 1/2; T*, p* and tau* in closed form."""
    law, solids, g0 = make("granular", "gidaspow"), unit(e), starling(alpha)
    found = agree(lambda s: algebraic_theta(alpha, g0, s, 0.0, law, solids, 1.0), 0.5)
    kinetic = law.coefficients(alpha, found, g0, solids, 1.0)
    values = (found, kinetic.pressure, kinetic.shear_viscosity)
    assert values == pytest.approx((theta, pressure, stress), rel=5e-4)


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("dilation", [-30.0, 0.0, 30.0])
@pytest.mark.parametrize("drag", [0.0, 5e4])
def test_algebraic_theta_balances_production_and_dissipation(name, dilation, drag, coal):
    law, g0, shear = make("granular", name), 8.0, 400.0
    theta = algebraic_theta(0.45, g0, shear, dilation, law, coal, DIAMETER, drag)
    k = law.coefficients(0.45, theta, g0, coal, DIAMETER)
    work = 2 * k.shear_viscosity * shear + k.bulk_viscosity * dilation**2 - k.pressure * dilation
    sink = k.dissipation + 3 * drag * theta
    assert theta > 0
    assert work == pytest.approx(sink, rel=1e-5, abs=1e-12 * k.pressure)


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("dilation", [-30.0, 0.0, 30.0])
def test_algebraic_theta_is_differentiable_at_rest(smooth, name, dilation, coal):
    law, radial = make("granular", name), make("radial", "savage")

    def theta(a, s, d):
        return algebraic_theta(a, radial.g0(a, coal), s, d, law, coal, DIAMETER)

    assert theta(0.45, 0.0, 0.0) < 1e-12
    for shear in (0.0, 1e-6, 1e4):
        smooth(theta, [0.45, shear, dilation])
    smooth(theta, [0.45, 100.0, dilation], difference=True)


def test_drag_bounds_algebraic_theta_of_elastic_grains():
    solids, law = unit(1.0), make("granular", "lun")
    theta = algebraic_theta(0.2, 2.0, 0.5, 0.0, law, solids, 1.0, drag=3.0)
    k = law.coefficients(0.2, theta, 2.0, solids, 1.0)
    assert k.shear_viscosity == pytest.approx(9 * theta)


HAFF = [(0.9, 0.1, 111.8, 0.179), (0.8, 0.3, 1208.0, 0.0166)]


@pytest.mark.parametrize(("e", "alpha", "rate", "tau"), HAFF)
def test_haff_cooling(agree, e, alpha, rate, tau):
    solids, law, g0 = (
        Solids(2500.0, 1e-3, restitution=e),
        make("granular", "gidaspow"),
        starling(alpha),
    )
    cooled = agree(lambda t: haff(0.01, t, alpha, g0, law, solids), tau)
    assert cooled == pytest.approx(0.01 / 4, rel=5e-3)
    closed = 8 * (1 - e**2) * g0 * alpha / (1e-3 * math.sqrt(math.pi))
    assert closed == pytest.approx(rate, rel=1e-3)
    assert haff(0.01, 0.1, alpha, g0, law, solids) == pytest.approx(
        0.01 / (1 + closed * math.sqrt(0.01) * 0.1 / 2) ** 2
    )


@pytest.mark.parametrize("name", LAWS)
def test_haff_solves_its_equation(slope, name, coal):
    law, alpha, g0, t = make("granular", name), 0.3, 4.0, 0.02

    def cooling(time):
        return haff(0.01, time, alpha, g0, law, coal)

    gamma = law.coefficients(alpha, cooling(t), g0, coal, 1.0).dissipation
    rate = slope(cooling, [t], 0)
    assert 1.5 * alpha * coal.density * rate == pytest.approx(-gamma)
    assert haff(0.01, 0.0, alpha, g0, law, coal) == 0.01

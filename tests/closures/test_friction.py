# SPDX-License-Identifier: LGPL-3.0-or-later
"""Frictional stresses: closed numbers, orderings, printed limits, Coulomb's law, limits."""

import math
from dataclasses import fields, replace

import numpy as np
import pytest

from fem_tfm.closures import make, names
from fem_tfm.closures.friction import Frictional
from fem_tfm.materials import Solids

LAWS = names("friction")
ACTIVE = [n for n in LAWS if n != "none"]
SIN = math.sin(math.radians(32))

# p_f at alpha_s = 0.45 and 0.50 for a_min = 0.4, a_max = 0.63
PRESSURES = {
    "berzi": (1.485, 4.112308),
    "dartevelle": (21.43347, 455.1661),
    "johnson-jackson": (0.6615278, 13.46645),
    "mu-i": (0.6615278, 13.46645),
    "none": (0.0, 0.0),
    "pu": (0.6615278, 13.46645),
    "schaeffer": (9.765625e10, 1e14),
    "srivastava-sundaresan": (0.6615278, 13.46645),
    "syamlal": (9.765625e10, 1e14),
}


def sharp(name):
    """The law with an onset and a strain floor that are next to nothing."""
    law = make("friction", name)
    small = {"width": 1e-5, "strain_floor": 1e-12, "switch_width": 1e-9}
    return replace(law, **{f.name: small[f.name] for f in fields(law) if f.name in small})


@pytest.mark.parametrize("name", LAWS)
def test_closed_pressures(agree, name, coal):
    law = sharp(name)
    for alpha, expected in zip((0.45, 0.5), PRESSURES[name], strict=True):
        pressure = agree(lambda a: law.stress(a, 0.01, 400.0, 0.0, coal).pressure, alpha)
        assert pressure == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(
    ("name", "expected"), [("dartevelle", 455.0), ("johnson-jackson", 13.5), ("berzi", 4.1)]
)
def test_pressures_at_one_half_with_the_default_onset(name, expected, coal):
    pressure = make("friction", name).stress(0.5, 0.0, 0.0, 0.0, coal).pressure
    assert pressure == pytest.approx(expected, rel=5e-3)


def pressures(alpha, coal):
    """Dartevelle, Johnson-Jackson and Berzi pressures with the default onset."""
    three = ("dartevelle", "johnson-jackson", "berzi")
    return [make("friction", n).stress(alpha, 0.0, 0.0, 0.0, coal).pressure for n in three]


def test_orderings_of_the_three_pressures(coal):
    low, middle, high = np.linspace(0.41, 0.43), np.linspace(0.43, 0.469), np.linspace(0.472, 0.5)
    for alpha in (low, middle):
        dartevelle, johnson, berzi = pressures(alpha, coal)
        assert np.all(johnson < np.minimum(dartevelle, berzi))
    dartevelle, _, berzi = pressures(low, coal)
    assert berzi[0] > 2 * dartevelle[0]
    assert dartevelle[-1] > 3 * berzi[-1]
    dartevelle, johnson, berzi = pressures(middle, coal)
    assert np.all(dartevelle > 3 * np.maximum(johnson, berzi))
    dartevelle, johnson, berzi = pressures(high, coal)
    assert np.all(berzi < johnson) and np.all(johnson < dartevelle)


def test_johnson_jackson_and_berzi_cross_at_047(coal):
    _, johnson, berzi = pressures(0.47, coal)
    assert (johnson, berzi) == pytest.approx((2.34, 2.34), rel=2e-3)


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("dilation", [-300.0, 0.0, 300.0])
def test_finite_positive_and_differentiable(smooth, name, dilation, coal):
    law = make("friction", name)

    def both(*args):
        return sum(law.stress(*args, coal))

    for alpha in (1e-12, 0.4, 0.629):
        for theta, shear in ((0.0, 0.0), (1e-2, 1.0), (0.0, 1e6)):
            args = [alpha, theta, shear, dilation]
            for value in law.stress(*args, coal):
                assert math.isfinite(value) and value >= 0
            smooth(both, args)


@pytest.mark.parametrize("name", ACTIVE)
def test_slopes_match_differences(agree, smooth, name, coal):
    law = make("friction", name)
    for dilation in (-7.0, 0.4, 7.0):
        for i in range(2):

            def part(a, t, s, d, i=i):
                return law.stress(a, t, s, d, coal)[i]

            args = [0.45, 1e-6, 50.0, dilation]
            assert agree(part, *args) > 0
            smooth(part, args, difference=True)


@pytest.mark.parametrize("name", ACTIVE)
def test_vanishes_below_the_onset_and_grows_above_it(name, coal):
    law = make("friction", name)
    alpha = np.linspace(0.3, 0.629, 200)
    p_f, mu_f = law.stress(alpha, 1e-4, 100.0, 0.0, coal)
    assert np.all(np.diff(p_f) > 0)
    assert np.all(np.diff(mu_f) >= -1e-12 * mu_f[-1])
    assert law.stress(0.3, 1e-4, 100.0, 0.0, coal).pressure < 1e-6
    assert law.stress(0.01, 1e-4, 100.0, 0.0, coal).pressure < 1e-30


def test_no_friction_is_nothing(coal):
    assert make("friction", "none").stress(0.6, 0.0, 0.0, 0.0, coal) == (0.0, 0.0)


@pytest.mark.parametrize(
    "name",
    ["berzi", "dartevelle", "johnson-jackson", "pu", "schaeffer", "srivastava-sundaresan"],
)
@pytest.mark.parametrize("rate", [0.1, 10.0])
def test_coulomb_in_simple_shear(name, rate, coal):
    """|tau| = mu_f (shear rate) = p_f sin(phi), since S:S = rate^2/2."""
    law = sharp(name)
    if name == "pu":
        law = replace(law, max_viscosity=1e9)
    p_f, mu_f = law.stress(0.45, 0.0, rate**2 / 2, 0.0, coal)
    assert mu_f * rate == pytest.approx(p_f * SIN, rel=1e-6)


def printed_srivastava(alpha, theta, shear, dilation, solids):
    """Equations (15)-(17) as printed."""
    r_rate = math.sqrt(shear + theta / solids.diameter**2)
    n = math.sqrt(3) / (2 * SIN) if dilation > 0 else 1.03
    p_c = 0.05 * (alpha - 0.4) ** 2 / (0.63 - alpha) ** 5
    p_f = p_c * (1 - dilation / (math.sqrt(2) * n * SIN * r_rate)) ** (n - 1)
    bracket = n - (n - 1) * (p_f / p_c) ** (1 / (n - 1))
    return p_f, p_f * SIN / (math.sqrt(2) * r_rate) * bracket


@pytest.mark.parametrize("dilation", [-40.0, -3.0, 3.0, 12.0])
def test_srivastava_sundaresan_recovers_the_printed_form(dilation, coal):
    args = (0.52, 1e-6, 200.0, dilation, coal)
    expected = printed_srivastava(*args)
    assert sharp("srivastava-sundaresan").stress(*args) == pytest.approx(expected, rel=1e-5)


def test_srivastava_sundaresan_softens_in_dilation_and_hardens_in_compaction(coal):
    law = make("friction", "srivastava-sundaresan")
    p_f = [law.stress(0.5, 0.0, 100.0, d, coal).pressure for d in (-5.0, 0.0, 5.0, 1e4)]
    assert p_f[0] > p_f[1] > p_f[2] > p_f[3] > 0
    # nothing holds a bed that flies apart
    assert p_f[3] < 1e-3 * p_f[1]


@pytest.mark.parametrize("name", ["berzi", "dartevelle"])
@pytest.mark.parametrize("dilation", [-40.0, 25.0])
def test_dartevelle_viscosity_recovers_the_printed_form(name, dilation, coal):
    theta, shear = 1e-6, 200.0
    p_f, mu_f = sharp(name).stress(0.52, theta, shear, dilation, coal)
    r = shear + theta / coal.diameter**2
    assert mu_f == pytest.approx(p_f * SIN**2 / math.sqrt(2 * SIN**2 * r + dilation**2))


@pytest.mark.parametrize("name", ACTIVE)
def test_the_strain_floor_bounds_the_viscosity_at_rest(name, coal):
    p_f, mu_f = make("friction", name).stress(0.45, 0.0, 0.0, 0.0, coal)
    assert 0 < mu_f <= 0.71 * p_f


@pytest.mark.parametrize("name", ["syamlal", "pu"])
def test_the_cap_of_the_viscosity(name, coal):
    law = make("friction", {"model": name, "max_viscosity": 2.0})
    assert law.stress(0.62, 0.0, 0.0, 0.0, coal).viscosity == pytest.approx(2.0, rel=1e-3)
    assert law.stress(0.42, 0.0, 1e12, 0.0, coal).viscosity < 2.0


def test_fitted_factor_of_pu(coal):
    plain, fitted = (
        make("friction", {"model": "pu", "viscosity_factor": k}).stress(0.5, 0.0, 9.0, 0.0, coal)
        for k in (1.0, 2.5)
    )
    assert fitted == Frictional(plain.pressure, 2.5 * plain.viscosity)


INCLINE = [(22, 0.0284), (24, 0.0934), (26, 0.1974), (28, 0.3909)]


@pytest.mark.parametrize(("angle", "inertial"), INCLINE)
def test_mu_i_on_an_incline(angle, inertial):
    """Bagnold flow: mu(I) = tan(angle) at the tabulated inertial number."""
    solids = Solids(2500.0, 5.3e-4)
    law = sharp("mu-i")
    p_f = law.stress(0.55, 0.0, 0.0, 0.0, solids).pressure
    rate = inertial / (solids.diameter * math.sqrt(solids.density / p_f))
    stress = law.stress(0.55, 0.0, rate**2 / 2, 0.0, solids)
    assert stress.viscosity * rate / p_f == pytest.approx(math.tan(math.radians(angle)), rel=1e-3)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Eddy viscosities: closed numbers, the wall layer, friction of a pipe."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from fem_tfm.closures import make, names
from fem_tfm.closures.turbulence.gas import Eddies
from fem_tfm.materials import Gas

WALL_UNITS = Gas(1.0, 1.0)


def velocity_profile(law, radius, top, stress):
    """u+(y+) from (1 + mu_t) du/dy = stress(y), in wall units."""
    y = np.concatenate([[0.0], np.geomspace(0.02, top, 400)])

    def shear_rate(distance):
        def surplus(rate):
            mu_t = law.eddy_viscosity(rate, distance, WALL_UNITS, radius)
            return (1 + mu_t) * rate - stress(distance)

        return brentq(surplus, 0.0, 2.0)

    rate = np.array([shear_rate(d) for d in y])
    return y, np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) / 2 * np.diff(y))])


@pytest.mark.parametrize("radius", [1e6, 5000.0])
def test_log_law_of_the_wall_layer(radius):
    """u+ = ln(E y+)/kappa within 3.2 % for y+ = 50..500, under constant or pipe-like stress."""
    law = make("turbulence", "mixing-length")
    y, u = velocity_profile(law, radius, 600.0, lambda d: 1 - d / radius)
    log_layer = (y > 50) & (y < 500)
    assert u[log_layer] == pytest.approx(np.log(9.8 * y[log_layer]) / 0.41, rel=0.032)
    sublayer = y < 3
    assert u[sublayer] == pytest.approx(y[sublayer], rel=0.01)


@pytest.mark.parametrize("re_tau", [500.0, 5000.0])
def test_friction_of_a_smooth_pipe(re_tau):
    """Prandtl's 1/sqrt(f) = 2 log10(Re sqrt(f)) - 0.8 within 5 %, from the bulk velocity."""
    law = make("turbulence", "mixing-length")
    y, u = velocity_profile(law, re_tau, re_tau * (1 - 1e-9), lambda d: 1 - d / re_tau)
    bulk = np.trapezoid(2 * u * (re_tau - y), y) / re_tau**2
    f, reynolds = 8 / bulk**2, 2 * re_tau * bulk
    prandtl = brentq(
        lambda x: 1 / math.sqrt(x) - 2 * math.log10(reynolds * math.sqrt(x)) + 0.8, 1e-3, 1
    )
    assert f == pytest.approx(prandtl, rel=0.05)


def test_nikuradse_mixing_length(agree):
    law = make("turbulence", "mixing-length")
    assert agree(law.length, 0.5, 0.5) == pytest.approx(0.07)
    assert agree(law.length, 0.7, 0.5) == pytest.approx(0.07)
    assert agree(law.length, 0.25, 0.5) == pytest.approx(0.5 * (0.14 - 0.08 / 4 - 0.06 / 16))
    # l = 0.4 y near the wall
    assert agree(law.length, 1e-6, 0.5) == pytest.approx(4e-7, rel=1e-4)


def test_eddy_viscosity_far_from_the_wall(agree, air):
    law = make("turbulence", "mixing-length")
    mu_t = agree(lambda s: law.eddy_viscosity(s, 0.25, air, 0.5), 1e4)
    assert mu_t == pytest.approx(1.2 * 0.058125**2 * 1e4, rel=1e-9)


ALGEBRAIC = [n for n in names("turbulence") if not make("turbulence", n).transported]


@pytest.mark.parametrize("name", ALGEBRAIC)
def test_finite_positive_and_differentiable(agree, smooth, name, nitrogen):
    law = make("turbulence", name)

    def viscosity(strain, distance):
        return law.eddy_viscosity(strain, distance, nitrogen, 5e-3)

    for strain in (0.0, 1e-9, 1.0, 1e4):
        for distance in (0.0, 1e-9, 1e-4, 5e-3, 6e-3):
            assert agree(viscosity, strain, distance) >= 0
            smooth(viscosity, [strain, distance])
    smooth(viscosity, [500.0, 1e-3], difference=True)


def test_algebraic_laws_see_strain_and_distance(nitrogen):
    law, eddies = make("turbulence", "mixing-length"), Eddies(500.0, 1e-3, nitrogen, 5e-3)
    assert law.viscosity(eddies) == law.eddy_viscosity(500.0, 1e-3, nitrogen, 5e-3)
    assert law.balances(eddies, 0.0) == law.wall_values(eddies) == law.estimate(1.0, 1.0, 1.0) == {}


def test_laminar_gas_has_no_eddies(air):
    assert make("turbulence", "laminar").eddy_viscosity(100.0, 1e-3, air, 1e-2) == 0.0


def test_eddy_viscosity_grows_with_shear_and_distance(nitrogen):
    law = make("turbulence", "mixing-length")
    shear = law.eddy_viscosity(np.geomspace(1e-3, 1e5, 200), 1e-3, nitrogen, 5e-3)
    distance = law.eddy_viscosity(1e3, np.linspace(0, 5e-3, 200), nitrogen, 5e-3)
    assert np.all(np.diff(shear) > 0)
    assert np.all(np.diff(distance) > 0)

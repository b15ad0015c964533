# SPDX-License-Identifier: LGPL-3.0-or-later
"""Regularised primitives: values, derivatives at the singular point, and UFL against floats."""

import math

import numpy as np
import pytest
import scipy.special
import ufl

from fem_tfm.closures import ops

ELEMENTARY = [
    (ops.sqrt, 2.0, math.sqrt(2.0)),
    (ops.exp, 0.7, math.exp(0.7)),
    (ops.ln, 0.7, math.log(0.7)),
    (ops.erf, 0.7, math.erf(0.7)),
    (ops.tanh, 0.7, math.tanh(0.7)),
    (ops.sin, 0.7, math.sin(0.7)),
    (ops.cos, 0.7, math.cos(0.7)),
    (ops.tan, 0.7, math.tan(0.7)),
    (ops.atan, 0.7, math.atan(0.7)),
    (ops.radians, 180.0, math.pi),
]


@pytest.mark.parametrize(("function", "x", "expected"), ELEMENTARY)
def test_elementary_functions(agree, function, x, expected):
    assert agree(function, x) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize("x", [-2.0, 0.0, 3.0])
def test_maximum_minimum_and_choice(agree, x):
    assert agree(lambda v: ops.maximum(v, 1.0), x) == max(x, 1.0)
    assert agree(lambda v: ops.minimum(v, 1.0), x) == min(x, 1.0)
    assert agree(lambda v: ops.where_greater(v, 0.0, 5.0 + v, -1.0), x) == (5 + x if x > 0 else -1)


def test_plain_results_are_python_floats_that_multiply_ufl():
    root = ops.sqrt(np.float64(2.0))
    assert type(root) is float
    assert float(root * ufl.as_ufl(3.0)) == pytest.approx(3 * math.sqrt(2))


@pytest.mark.parametrize("x", [-1e5, -0.3, 0.0, 0.3, 1e5])
def test_tanh_and_its_slope_never_overflow(agree, slope, x):
    assert agree(ops.tanh, x) == pytest.approx(math.tanh(x), rel=1e-14)
    assert slope(ops.tanh, [x], 0) == pytest.approx(1 - math.tanh(x) ** 2, rel=1e-12)


def test_smooth_norm(agree, slope):
    assert agree(lambda x: ops.smooth_norm(x, 1e-2), 0.0) == 1e-2
    assert slope(lambda x: ops.smooth_norm(x, 1e-2), [0.0], 0) == 0.0
    assert agree(lambda x: ops.smooth_norm(x, 3.0), -4.0) == 5.0


@pytest.mark.parametrize("x", [-1e6, -1.0, -1e-3, 0.0, 1e-3, 1.0, 1e6])
def test_positive_part_is_positive_and_close(agree, smooth, x):
    value = agree(lambda v: ops.positive_part(v, 1e-3), x)
    assert 0 < value - max(x, 0.0) <= 1e-3 or x >= 1.0
    assert value == pytest.approx((x + math.sqrt(x * x + 4e-6)) / 2, rel=1e-6, abs=1e-10)
    smooth(lambda v: ops.positive_part(v, 1e-3), [x])


def test_positive_part_has_half_slope_at_the_corner(slope):
    assert slope(lambda v: ops.positive_part(v, 1e-3), [0.0], 0) == pytest.approx(0.5)


@pytest.mark.parametrize("x", [-30.0, -0.02, 0.0, 0.02, 30.0])
def test_softplus_never_overflows(agree, slope, x):
    width = 5e-3
    expected = np.logaddexp(0.0, x / width) * width
    assert agree(lambda v: ops.softplus(v, width), x) == pytest.approx(
        expected, rel=1e-9, abs=1e-18
    )
    sigmoid = scipy.special.expit(x / width)
    assert slope(lambda v: ops.softplus(v, width), [x], 0) == pytest.approx(sigmoid, abs=1e-15)


def test_softplus_tends_to_the_positive_part():
    x = np.linspace(-1, 1, 41)
    assert ops.softplus(x, 1e-9) == pytest.approx(np.maximum(x, 0), abs=1e-9)


def test_smooth_step_is_exact_outside_its_width(agree, slope):
    def step(x):
        return ops.smooth_step(x, 2.0, 0.5)

    assert agree(step, 1.74) == 0.0
    assert agree(step, 2.26) == 1.0
    assert agree(step, 2.0) == 0.5
    assert slope(step, [1.75], 0) == slope(step, [2.25], 0) == 0.0
    assert slope(step, [2.0], 0) == pytest.approx(1.5 / 0.5)


@pytest.mark.parametrize("n", [1 / 3, 0.5, 0.687])
def test_safe_pow_is_the_power_away_from_zero_and_linear_at_it(agree, slope, n):
    eps = 1e-4

    def power(x):
        return ops.safe_pow(x, n, eps)

    assert agree(power, 2.0) == pytest.approx(2.0**n, rel=1e-8)
    assert agree(power, 0.0) == 0.0
    assert slope(power, [0.0], 0) == pytest.approx(eps ** (n - 1))


@pytest.mark.parametrize(("iterations", "tolerance"), [(1, 3e-9), (2, 1e-14)])
def test_lambert_w_against_scipy(iterations, tolerance):
    x = np.geomspace(1.0, 1e12, 500)
    exact = scipy.special.lambertw(x).real
    assert ops.lambert_w(x, iterations) == pytest.approx(exact, rel=tolerance)


def test_lambert_w_and_its_slope(agree, slope):
    assert agree(ops.lambert_w, math.e) == pytest.approx(1.0, rel=3e-9)
    w = ops.lambert_w(50.0)
    assert slope(ops.lambert_w, [50.0], 0) == pytest.approx(w / (50 * (1 + w)), rel=1e-7)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fixtures of the closure tests: materials, and evaluation through floats, numpy and UFL."""

import math

import numpy as np
import pytest
import ufl
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.algorithms.apply_derivatives import apply_derivatives

from fem_tfm.materials import Gas, Solids


@pytest.fixture
def air():
    """Air at room conditions."""
    return Gas(density=1.2, viscosity=1.8e-5)


@pytest.fixture
def beads():
    """Grains of 1 mm and 2500 kg/m3."""
    return Solids(density=2500.0, diameter=1e-3, restitution=0.9)


@pytest.fixture
def nitrogen():
    """The gas of the dense pipe."""
    return Gas(density=33.5, viscosity=1.8e-5)


@pytest.fixture
def coal():
    """The pulverised coal of the dense pipe."""
    return Solids(density=1700.0, diameter=1.6e-4)


@pytest.fixture
def agree():
    """Value of a law, the same through floats, numpy and UFL."""

    def value(law, *args):
        plain = float(law(*args))
        symbolic = float(law(*(ufl.as_ufl(a) for a in args)))
        arrays = np.asarray(law(*(np.array([a, a]) for a in args)), dtype=float)
        assert math.isfinite(plain)
        assert symbolic == pytest.approx(plain, rel=1e-12, abs=1e-300)
        assert arrays == pytest.approx(plain, rel=1e-12, abs=1e-300)
        return plain

    return value


@pytest.fixture
def slope():
    """Derivative that Newton sees: a law differentiated symbolically in one argument."""

    def derivative(law, args, index):
        symbols = [ufl.as_ufl(a) for a in args]
        variable = symbols[index] = ufl.variable(symbols[index])
        expr = ufl.as_ufl(law(*symbols))
        return float(apply_derivatives(apply_algebra_lowering(ufl.diff(expr, variable))))

    return derivative


@pytest.fixture
def smooth(slope):
    """Assert that every symbolic derivative is finite, and matches differences where asked."""

    def check(law, args, difference=False):
        for i, x in enumerate(args):
            exact = slope(law, args, i)
            assert math.isfinite(exact), f"derivative {i} at {args}"
            if difference:
                h = 1e-6 * max(abs(x), 1e-3)
                up, down = list(args), list(args)
                up[i], down[i] = x + h, x - h
                measured = (float(law(*up)) - float(law(*down))) / (2 * h)
                scale = abs(float(law(*args))) / max(abs(x), 1e-3)
                assert exact == pytest.approx(measured, rel=1e-4, abs=1e-6 * scale)

    return check

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Material properties: defaults, ranges, binding."""

import math

import pytest
import ufl

from fem_tfm.materials import Gas, Solids
from fem_tfm.errors import InputError


def test_defaults_of_the_solids():
    solids = Solids(1700.0, 1.6e-4)
    assert (solids.restitution, solids.packing_limit, solids.friction_limit) == (0.7, 0.63, 0.4)
    assert solids.friction_angle == pytest.approx(math.radians(32))


BAD = [
    ({"density": 0.0}, "density"),
    ({"density": -1.0}, "density"),
    ({"diameter": math.nan}, "diameter"),
    ({"diameter": "1e-4"}, "diameter"),
    ({"restitution": 1.01}, "restitution"),
    ({"restitution": 0.0}, "restitution"),
    ({"packing_limit": 0.8}, "packing_limit"),
    ({"friction_limit": 0.63}, "friction_limit"),
    ({"friction_angle_deg": 92.0}, "solids.friction_angle_deg"),
]


@pytest.mark.parametrize(("change", "key"), BAD)
def test_bad_solids(change, key):
    with pytest.raises(InputError) as error:
        Solids(**{"density": 1700.0, "diameter": 1.6e-4} | change)
    assert error.value.key == key


@pytest.mark.parametrize("change", [{"density": 0.0}, {"viscosity": -1e-5}, {"density": True}])
def test_bad_gas(change):
    with pytest.raises(InputError) as error:
        Gas(**{"density": 1.2, "viscosity": 1.8e-5} | change)
    assert error.value.key == next(iter(change))


def test_bound_keeps_the_values():
    bound = Solids(1700, 1.6e-4).bound(ufl.as_ufl)
    assert float(bound.density) == 1700.0
    assert float(bound.friction_limit / bound.packing_limit) == pytest.approx(0.4 / 0.63)

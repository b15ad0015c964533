# SPDX-License-Identifier: LGPL-3.0-or-later
"""Material properties: defaults, ranges, binding."""

import math

import pytest
import ufl

from fem_tfm.errors import InputError
from fem_tfm.materials import SPECIES, Gas, Solids


def test_defaults_of_the_solids():
    solids = Solids(1700.0, 1.6e-4)
    assert (solids.restitution, solids.packing_limit, solids.friction_limit) == (0.7, 0.63, 0.4)
    assert solids.friction_angle == pytest.approx(math.radians(32))


BAD = [
    ({"density": 0.0}, "solids.density"),
    ({"density": -1.0}, "solids.density"),
    ({"diameter": math.nan}, "solids.diameter"),
    ({"diameter": "1e-4"}, "solids.diameter"),
    ({"restitution": 1.01}, "solids.restitution"),
    ({"restitution": 0.0}, "solids.restitution"),
    ({"packing_limit": 0.8}, "solids.packing_limit"),
    ({"friction_limit": 0.63}, "solids.friction_limit"),
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
    assert error.value.key == f"gas.{next(iter(change))}"


def test_bound_keeps_the_values():
    bound = Solids(1700, 1.6e-4).bound(ufl.as_ufl)
    assert float(bound.density) == 1700.0
    assert float(bound.friction_limit / bound.packing_limit) == pytest.approx(0.4 / 0.63)


TABLE = {
    "air": (287.06, (18.5, 23.1)),
    "Ar": (208.13, (22.7, 28.6)),
    "CO": (296.84, (17.8, 22.1)),
    "CO2": (188.92, (15.0, 19.7)),
    "H2": (4124.5, (8.9, 10.9)),
    "N2": (296.80, (17.9, 22.2)),
    "O2": (259.84, (20.7, 25.8)),
}


def test_every_species_is_in_the_table() -> None:
    assert set(TABLE) == set(SPECIES)


@pytest.mark.parametrize("name", TABLE)
def test_gas_constants(name: str) -> None:
    assert SPECIES[name].gas_constant == pytest.approx(TABLE[name][0], rel=3e-5)


@pytest.mark.parametrize("name", TABLE)
def test_viscosities(name: str) -> None:
    found = [SPECIES[name].viscosity(t) for t in (300.0, 400.0)]
    assert found == pytest.approx([1e-6 * mu for mu in TABLE[name][1]], rel=0.02)

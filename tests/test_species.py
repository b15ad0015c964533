# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gases by name against tabulated properties."""

from __future__ import annotations

import pytest

from fem_tfm.materials import SPECIES

# R [J/kg/K] = 8.314463/M, and viscosity [1e-6 Pa s] at 1 bar and 300, 400 K
# (Huber and Harvey, Viscosity of gases, CRC Handbook of Chemistry and Physics)
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

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Radial distributions: closed numbers, limits, growth."""

import numpy as np
import pytest

from fem_tfm.closures import make, names
from fem_tfm.materials import Solids

# g0 at a = 0.1, 0.3, 0.5 with a_max = 0.63
NUMBERS = {
    "savage": (1.351141, 3.166271, 18.34782),
    "lun-savage": (1.312886, 2.768866, 12.00883),
    "sinclair-jackson": (2.180756, 4.564057, 13.48715),
    "carnahan-starling": (1.303155, 2.478134, 6.0),
    "ma-ahmadi": (1.303957, 2.469126, 6.338212),
}


@pytest.mark.parametrize("name", names("radial"))
def test_closed_numbers(agree, name, coal):
    law = make("radial", name)
    for alpha, expected in zip((0.1, 0.3, 0.5), NUMBERS[name], strict=True):
        assert agree(lambda a: law.g0(a, coal), alpha) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("name", names("radial"))
def test_one_in_vacuum_and_growing(agree, smooth, name, coal):
    law = make("radial", name)
    assert agree(lambda a: law.g0(a, coal), 0.0) == pytest.approx(1.0)
    values = law.g0(np.linspace(0, 0.6299, 400), coal)
    assert np.all(np.isfinite(values))
    assert np.all(np.diff(values) > 0)
    for alpha in (0.0, 1e-9, 0.3, 0.629):
        smooth(lambda a: law.g0(a, coal), [alpha])
    smooth(lambda a: law.g0(a, coal), [0.45], difference=True)


@pytest.mark.parametrize("name", [n for n in names("radial") if n != "carnahan-starling"])
def test_no_bound_at_packing(name, coal):
    assert make("radial", name).g0(0.63 - 1e-9, coal) > 1e4


@pytest.mark.parametrize("name", ["carnahan-starling", "lun-savage", "ma-ahmadi"])
def test_second_virial_coefficient(slope, name):
    law, solids = make("radial", name), Solids(1000.0, 1e-3, packing_limit=0.64356)
    assert slope(lambda a: law.g0(a, solids), [0.0], 0) == pytest.approx(2.5)


@pytest.mark.parametrize(
    ("name", "power"),
    [("savage", 2.0), ("lun-savage", 1.575), ("sinclair-jackson", 1.0), ("ma-ahmadi", 0.67802)],
)
def test_a_gap_that_is_given_keeps_its_digits(name, power, coal):
    law = make("radial", name)
    assert law.g0(0.5, coal, 1 - 0.5 / 0.63) == pytest.approx(law.g0(0.5, coal), rel=1e-12)
    # alpha_s itself has four digits of such a gap
    wide, narrow = (law.g0(0.63 * (1 - gap), coal, gap) for gap in (2e-12, 1e-12))
    assert narrow / wide == pytest.approx(2**power, rel=1e-9)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cross-sections of a stretch: volumes and velocities that were put in."""

from __future__ import annotations

import numpy as np
import pytest

from fem_tfm.geometry.section import RectangularSection, RoundSection
from fem_tfm.models.slug.feed import filled
from fem_tfm.models.slug.grains import Grain, Grains, Walls
from fem_tfm.models.slug.told.cross_sections import Still, layers, picture

DIAMETER = 1.4e-3
TUBE = RoundSection(7e-3, "none")


def sheared(section: RoundSection | RectangularSection) -> Grains:
    """A full tube whose grains are the faster the higher they are."""
    made = Grains(Grain(937.0, DIAMETER), Walls(section), 1e-5)
    made.add(filled(section, made.grain, 0.05)[0])
    y = made.place[:, 1]
    made.set_velocity(np.stack([0 * y, 0 * y, 0.3 + 100 * y], axis=-1))
    return made


def test_layers_hold_the_volume_and_the_shear() -> None:
    made = sheared(TUBE)
    found = layers(made, TUBE, 0.01, 0.03, 10)
    inside = (made.place[:, 2] >= 0.01) & (made.place[:, 2] < 0.03)
    volume = inside.sum() * made.grain.mass / made.grain.density
    assert found.solids.sum() == pytest.approx(volume, rel=1e-9)
    assert found.height == pytest.approx(np.linspace(-3.15e-3, 3.15e-3, 10))
    assert (np.diff(found.velocity) > 0).all()
    # grains reach over several layers
    assert found.velocity[5] == pytest.approx(0.3 + 100 * found.height[5], abs=0.03)
    assert (found.spread > 0).all() and found.spread.max() < 0.1


def test_an_empty_layer_has_no_velocity() -> None:
    made = Grains(Grain(937.0, DIAMETER), Walls(TUBE), 1e-5)
    made.add([[0.0, -2.8e-3, 0.02]], (0.0, 0.0, 0.1))
    found = layers(made, TUBE, 0.01, 0.03, 10)
    assert found.velocity[0] == pytest.approx(0.1) and np.isnan(found.velocity[9])
    assert found.spread[0] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("section", [TUBE, RectangularSection(7e-3, 6e-3, "none")])
def test_a_picture_holds_the_volume_of_the_grains(
    section: RoundSection | RectangularSection,
) -> None:
    made = sheared(section)
    solids, velocity = picture(made, section, 0.014, 0.028, 70)
    layer = len(made.place) // int(0.05 / DIAMETER)
    expected = layer * made.grain.mass / made.grain.density / (section.area * DIAMETER)
    assert np.nanmean(solids) == pytest.approx(expected, rel=0.05)
    outside = np.isnan(solids).mean()
    assert outside == pytest.approx(1 - np.pi / 4 if section is TUBE else 0.0, abs=0.01)
    low, middle, high = (np.nanmean(part) for part in np.array_split(velocity, 3))
    assert high > middle + 0.05 > low + 0.1
    assert np.nanmean(velocity) == pytest.approx(0.3, abs=0.01)


def test_a_picture_of_nothing_is_empty() -> None:
    made = sheared(TUBE)
    solids, velocity = picture(made, TUBE, 0.2, 0.21, 20)
    assert np.nanmax(solids) == 0.0 and np.isnan(velocity).all()


def test_a_still_is_what_reaches_into_a_stretch() -> None:
    made = sheared(TUBE)
    still = Still.of(1.5, made, 0.014, 0.028)
    assert still.time == 1.5 and 0 < len(still.place) < len(made.place)
    for one, all_of in zip(
        picture(still, TUBE, 0.014, 0.028, 30), picture(made, TUBE, 0.014, 0.028, 30), strict=True
    ):
        assert np.array_equal(one, all_of, equal_nan=True)
    a, b = layers(still, TUBE, 0.014, 0.028), layers(made, TUBE, 0.014, 0.028)
    assert a.velocity == pytest.approx(b.velocity, rel=1e-12)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a run tells of slugs that pass: sections, layers, the weight on the wall, their pictures."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from test_slugs import LENGTH, PERIOD, SPEED, samples

import fem_tfm as ft
from fem_tfm.models.slug.feed import filled
from fem_tfm.models.slug.told.cross_sections import Still
from fem_tfm.models.slug.told.slices import SLICE
from fem_tfm.scenes.scene import Answer
from fem_tfm.scenes.slug import told

MIDDLE, DIAMETER = 0.2625, 1.4e-3


def scene(uphill: float = 0.0) -> ft.Slug:
    return ft.Slug(
        ft.DiscreteElements(ft.TubeGas(6.73e-5), ft.Grain(937.0, DIAMETER)),
        ft.Pipe(0.007, length=0.525, inclination_deg=uphill),
        ft.Conveying(1.0, 6.9167e-4),
        numerics=ft.TubeNumerics(end_time=8.0, cells_across=2),
        averages=ft.Averages(begin=2.0, low=0.2, high=0.45),
    )


def stills() -> list[Still]:
    """The middle of the tube at the samples of the last seconds: full while a slug is there."""
    place, radius = filled(ft.Pipe(0.007).section("none"), ft.Grain(937.0, DIAMETER), 0.01)
    place[:, 2] += MIDDLE - 0.005
    made = []
    for n in range(500, 801):
        offset = (SPEED * 0.01 * n - MIDDLE + LENGTH / 2) % (SPEED * PERIOD)
        there = place if offset < LENGTH else place[place[:, 1] < -2.2e-3]
        speed = 0.3 + 20 * there[:, 1] if offset < LENGTH else 0 * there[:, 1]
        velocity = np.stack([0 * speed, 0 * speed, speed], axis=-1)
        made.append(Still(0.01 * n, there, radius[: len(there)], velocity))
    return made


def test_the_last_slug_that_passes_is_in_the_middle_of_its_stills() -> None:
    found = told.passing(samples(), scene(), stills())
    assert len(found) == told.STILLS
    full = [len(still.place) > 60 for still in found]
    assert 9 <= sum(full) <= 12 and not full[0] and not full[-1]
    # slugs pass every half second: none later would be whole
    assert 8.0 - found[-1].time < PERIOD + 0.1
    assert told.passing(samples(), scene(), stills()[:10]) == []


def test_layers_are_those_of_the_slug_alone() -> None:
    found = told.layers(told.passing(samples(), scene(), stills()), scene())
    inside = np.abs(found["height"]) < 2e-3
    assert found["velocity"][inside] == pytest.approx(0.3 + 20 * found["height"][inside], abs=0.01)
    assert (np.diff(found["velocity"]) > 0).all() and (found["spread"] > 0).all()
    assert len(told.layers([], scene())["height"]) == 0


@pytest.mark.parametrize("uphill", [0.0, 60.0, 90.0])
def test_the_weight_on_the_wall_is_that_of_the_grains(uphill: float) -> None:
    found = told.profile(samples(), scene(uphill))
    middle = len(found["offset"]) // 2
    across = 9.81 * np.cos(np.radians(uphill))
    expected = 0.5 * 937.0 * across * 7e-3 / 4
    assert found["weight"][middle] == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_a_filled_tube_is_told() -> None:
    made = samples()
    answer = Answer("finished", {}, {}, "pressure_gradient", errors={}, state=made)
    assert not any("bulk" in text for text in scene().judge(answer))
    for number in range(len(made.time)):
        made.solids[number] = np.full(150, 0.5)
    said = " ".join(scene().judge(answer))
    assert "in 100 % of the samples: bulk, not slugs" in said


def test_tables_and_pictures_are_written(tmp_path: Path) -> None:
    at = np.stack([np.linspace(0, 0.525, 50), np.zeros(50), np.full(50, 7e-4)], axis=-1)
    frames = [(0.01 * n, at, np.linspace(0, 0.4, 50)) for n in (798, 799, 800)]
    told.write(tmp_path, samples(), scene(), told.Seen(frames, stills()))
    for name in ("porosity", "slugs", "sections", "slug"):
        assert (tmp_path / f"{name}.png").stat().st_size > 5000, name
    with (tmp_path / "along.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    low, high = (float(rows[10][f"length {rank} quartile [m]"]) for rank in ("lower", "upper"))
    assert low <= float(rows[10]["length [m]"]) <= high <= LENGTH + SLICE
    with (tmp_path / "layers.csv").open(encoding="utf-8", newline="") as file:
        assert next(csv.reader(file)) == ["height [m]", "velocity [m/s]", "spread [m/s]"]

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Slugs are found, followed and averaged: samples that are made up, with all answers known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fem_tfm.models.slug.told.slices import Samples
from fem_tfm.models.slug.told.slugs import (
    Estimate,
    along,
    bulk,
    follow,
    profile,
    rate,
    sighted,
    statistics,
)

AREA, GRAIN = 3.848e-5, 1.437e-9
SPEED, PERIOD, LENGTH, BED = 0.4, 0.5, 0.042, 0.1


def samples(end: float = 8.0, noise: float = 0.0) -> Samples:
    """A slug of solids fraction 0.5 enters every half second, over a bed of 0.1."""
    edges = np.linspace(0, 0.525, 151)
    made, random = Samples(edges, AREA, GRAIN), np.random.default_rng(0)
    for n in range(1, round(end / 0.01) + 1):
        t, middle = 0.01 * n, made.middle
        offset = (SPEED * t - middle + LENGTH / 2) % (SPEED * PERIOD)
        inside = offset < LENGTH
        solids = np.where(inside, 0.5, BED) + noise * random.normal(size=150)
        made.time.append(t)
        made.solids.append(solids)
        velocity = np.where(inside, 0.3, 0.0)
        made.flux.append(np.stack([0 * solids, 0 * solids, solids * velocity], axis=-1))
        made.square.append(solids * (velocity**2 + 3e-4))
        made.drag.append(solids / GRAIN * 2e-6)
        made.contact.append(-solids / GRAIN * 1e-6)
        made.wall_stress.append(np.where(inside, 40.0, 5.0))
        made.pressure.append(np.zeros(151))
        made.drop.append(525.0 + 10.0 * math.sin(20 * t))
        made.count.append(3000)
    return made


def test_a_sighting_tells_what_is_in_the_slug() -> None:
    seen = sighted(samples(0.6), -1)
    assert len(seen) in (2, 3)
    one = seen[1]
    assert one.length == pytest.approx(LENGTH, abs=3.6e-3)
    assert one.porosity == pytest.approx(0.5) and one.least_porosity == pytest.approx(0.5)
    assert one.velocity == pytest.approx(0.3) and one.top_velocity == pytest.approx(0.3)
    assert one.grains == pytest.approx(0.5 * one.length * AREA / GRAIN)
    assert one.begin < one.centre < one.end


def test_short_runs_are_no_slugs() -> None:
    made = samples(0.6)
    assert len(sighted(made, -1, shortest=0.1)) == 0
    assert len(sighted(made, -1, limit=0.45)) == 0


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_statistics_are_those_that_were_put_in(noise: float) -> None:
    found = statistics(samples(noise=noise), 0.2, 0.45)
    assert found.slug_velocity.value == pytest.approx(SPEED, rel=0.01)
    assert found.slug_rate.value == pytest.approx(1 / PERIOD, rel=0.1)
    assert found.slug_length.value == pytest.approx(LENGTH, rel=0.05)
    assert found.slug_porosity.value == pytest.approx(0.5, abs=0.005)
    assert found.grain_velocity.value == pytest.approx(0.3, rel=0.01)
    assert found.slug_grains.value == pytest.approx(0.5 * LENGTH * AREA / GRAIN, rel=0.05)
    assert found.pressure_gradient.value == pytest.approx(1000.0, rel=2e-3)
    assert found.pressure_gradient.error < 5.0
    assert found.grains_in_tube == Estimate(3000.0, 0.0)
    assert 14 <= found.slugs <= 17


def test_every_slug_is_one_track() -> None:
    tracks = [t for t in follow(samples()) if len(t.sightings) > 10]
    # those that were inside at first, and one every half second
    assert len(tracks) in (17, 18, 19)
    crossings = sorted(t.crossing(0.3) for t in tracks if np.isfinite(t.crossing(0.3)))
    assert np.diff(crossings) == pytest.approx(PERIOD, abs=0.01)
    assert rate(samples(), tracks, 0.3).value == pytest.approx(2.0, rel=0.1)


def test_a_slug_that_is_overtaken_goes_on_as_one() -> None:
    """Two runs that merge: the longer one goes on, the other ends."""
    edges = np.linspace(0, 0.525, 151)
    made = Samples(edges, AREA, GRAIN)
    for n in range(40):
        solids = np.full(150, 0.1)
        first = 20 + n
        solids[first : first + 20] = 0.5
        solids[60:66] = 0.5
        made.time.append(0.01 * n)
        made.solids.append(solids)
        made.flux.append(np.zeros((150, 3)))
    tracks = sorted(follow(made), key=lambda t: -len(t.sightings))
    assert len(tracks[0].sightings) == 40
    assert len(tracks) == 2 and len(tracks[1].sightings) == 20


def test_numbers_along_the_tube() -> None:
    found = along(samples(), bins=7)
    assert [e.value for e in found.rate[1:-1]] == pytest.approx([2.0] * 5, rel=0.1)
    assert [e.value for e in found.length[1:-1]] == pytest.approx([LENGTH] * 5, rel=0.05)
    assert found.quartiles["top_velocity"][:, 3] == pytest.approx([0.3, 0.3])


def test_a_filled_tube_is_no_slug() -> None:
    made = samples(6.0)
    assert bulk(made, 0.25) == 0.0 and bulk(made, 0.03) == 1.0
    for number in range(0, len(made.time), 2):
        made.solids[number] = np.full(150, 0.5)
    assert bulk(made, 0.25) == 0.5
    for number in range(len(made.time)):
        made.solids[number] = np.full(150, 0.5)
    found = statistics(made, 0.2, 0.45)
    assert found.slugs == 0 and math.isnan(found.slug_velocity.value)


def test_the_average_slug() -> None:
    found = profile(samples(), 0.26, 0.06)
    assert 14 <= found.slugs <= 17
    middle = len(found.offset) // 2
    assert found.porosity[0, middle] == pytest.approx(0.5)
    assert found.porosity[0, [0, -1]] == pytest.approx(1 - BED)
    assert found.velocity[0, middle] == pytest.approx(0.3)
    assert found.temperature[0, middle] == pytest.approx(1e-4)
    assert found.drag[0, middle] == pytest.approx(2e-6)
    assert found.contact[0, middle] == pytest.approx(-1e-6)
    assert found.wall_stress[0, middle] == pytest.approx(40.0)
    assert profile(samples(), 0.26, 0.06, lengths=(0.06, 0.08)).slugs == 0


def test_errors_are_those_of_blocks() -> None:
    random, time = np.random.default_rng(0), np.arange(0, 400, 0.01)
    # values that stay for two seconds: two hundred independent ones
    values = np.repeat(random.normal(size=200), 200)
    found = Estimate.in_time(time, values)
    assert found.error == pytest.approx(1 / math.sqrt(200), rel=0.15)
    assert abs(found.value) < 4 * found.error
    assert math.isnan(Estimate.of([]).value) and math.isnan(Estimate.of([1.0]).error)
    assert Estimate.of([1.0, math.nan, 3.0]).value == 2.0

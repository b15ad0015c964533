# SPDX-License-Identifier: LGPL-3.0-or-later
"""Particles as a user states them, and the parcels that enter."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import fem_tfm as ft
from fem_tfm.cloud import parcels
from fem_tfm.errors import InputError
from fem_tfm.geometry.section import RectangularSection, RoundSection

DUCT, PIPE = RectangularSection(0.2, 0.1, "none"), RoundSection(0.1, "none")
POINTS = ((-0.05, 0.0, 1.0), (0.05, 0.0, 3.0))
GAS_FLOW = 2.0


def ash(**more: Any) -> ft.Material:
    return ft.Material("ash", 1800, 1.4e-4, **more)


def cloud(*materials: ft.Material, **more: Any) -> ft.Cloud:
    return ft.Cloud(materials or (ash(mass_flow=0.5),), **more)


def flow(made: ft.Cloud, section: Any = DUCT, number: int = 0) -> float:
    found = parcels(made, number, section, GAS_FLOW)
    return float((found.rate * made.materials[number].mass(found.diameter)).sum())


@pytest.mark.parametrize("section", [DUCT, PIPE])
@pytest.mark.parametrize("profile", ["uniform", "power-law"])
def test_area_feeds_the_whole_section_at_its_mass_flow(section: Any, profile: str) -> None:
    made = cloud(profile=profile, parcels=4000)
    found = parcels(made, 0, section, GAS_FLOW)
    assert flow(made, section) == pytest.approx(0.5, rel=1e-12)
    off_wall = section.wall_distance(np.vstack([found.x, found.y]))
    assert off_wall.min() >= 0.7e-4 * 0.7
    # a Latin hypercube is balanced
    assert abs(np.average(found.x, weights=found.rate)) < 1e-3 * section.size[0]
    near = np.average(off_wall < 0.005, weights=found.rate)
    uniform = 1 - (math.prod(side - 0.01 for side in section.size) / math.prod(section.size))
    assert near == pytest.approx(uniform, abs=0.02) if profile == "uniform" else near < uniform


def test_points_carry_their_mass_flows() -> None:
    made = cloud(ash(), injection="points", points=POINTS, parcels=300)
    found = parcels(made, 0, DUCT, GAS_FLOW)
    mass = found.rate * ash().mass(found.diameter)
    assert np.bincount(found.entry, mass) == pytest.approx([1.0, 3.0], rel=1e-12)
    # spread: each parcel belongs to the point that is nearest to it
    assert (np.sign(found.x) == np.where(found.entry == 0, -1, 1)).all()
    still = parcels(cloud(ash(), injection="points", points=POINTS, spread=False), 0, DUCT, 1.0)
    assert set(still.x) == {-0.05, 0.05}


def test_mass_flow_of_a_material_makes_the_points_shares() -> None:
    made = cloud(ash(mass_flow=0.5), injection="points", points=POINTS)
    assert flow(made) == pytest.approx(0.5, rel=1e-12)
    assert flow(cloud(ash(loading=2.0))) == pytest.approx(4.0, rel=1e-12)
    assert made.loading(GAS_FLOW) == pytest.approx(0.25)


@pytest.mark.parametrize(("size", "spread"), [("lognormal", 1.5), ("rosin-rammler", 3.0)])
def test_sizes_follow_their_distribution_by_mass(size: Any, spread: float) -> None:
    material = ash(mass_flow=0.5, size=size, spread=spread)
    made = cloud(material, parcels=5000)
    found = parcels(made, 0, DUCT, GAS_FLOW)
    assert flow(made) == pytest.approx(0.5, rel=1e-12)
    # every parcel carries the same mass, so its sizes are those of the mass
    finer = float((found.diameter < 1.4e-4).mean())
    assert finer == pytest.approx(0.5 if size == "lognormal" else 1 - math.exp(-1), abs=2e-3)


def test_parcels_depend_on_the_seed_and_the_material_alone() -> None:
    two = cloud(ash(mass_flow=1.0), ft.Material("sand", 2600, 1e-3, mass_flow=1.0))
    again = [parcels(two, number, DUCT, GAS_FLOW).x for number in (0, 0, 1)]
    assert (again[0] == again[1]).all() and (again[0] != again[2]).any()
    other = parcels(cloud(ash(mass_flow=1.0), seed=2), 0, DUCT, GAS_FLOW).x
    assert (again[0] != other).any()


@pytest.mark.parametrize(
    ("make", "key"),
    [
        (lambda: cloud(ash(), ash()), "particles.materials"),
        (lambda: ft.Cloud(()), "particles.materials"),
        (lambda: cloud(ash()), "particles.materials.mass_flow"),
        (lambda: cloud(injection="points"), "particles.points"),
        (lambda: cloud(points=POINTS), "particles.points"),
        (lambda: cloud(injection="points", points=((0, 0, -1.0),)), "particles.points"),
        (lambda: cloud(modulation=True), "particles.modulation"),
        (lambda: cloud(dispersion="langevine"), "particles.dispersion"),
        (lambda: cloud(forces=("drag", "lift")), "particles.forces[1]"),
        (lambda: ft.Material("fly ash", 1800, 1e-4), "materials.name"),
        (lambda: ash(mass_flow=1.0, loading=1.0), "materials.loading"),
        (lambda: ash(size="lognormal"), "materials.spread"),
        (lambda: ash(size="lognormal", spread=0.9), "materials.spread"),
        (lambda: ash(spread=2.0), "materials.spread"),
    ],
)
def test_what_does_not_fit_is_refused_by_its_key(make: Any, key: str) -> None:
    with pytest.raises(InputError) as caught:
        make()
    assert caught.value.key == key

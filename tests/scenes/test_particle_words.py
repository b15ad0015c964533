# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a scene refuses of its particles, what it warns of, and what it says it does without."""

from __future__ import annotations

from typing import Any

import pytest

import fem_tfm as ft
from fem_tfm.case import Case
from fem_tfm.errors import InputError
from fem_tfm.scenes.judged import memory
from fem_tfm.scenes.particles.tracking import following_time
from fem_tfm.scenes.particles.words import parcel_memory
from fem_tfm.scenes.statement import TimeNumerics

DUCT = ft.Duct(width=0.2, length=1.0)
MODEL = ft.ReynoldsStress(ft.Gas(1.2, 1.8e-5), wall_distance=8e-4)


def ash(**more: Any) -> ft.Material:
    given = {"diameter": 1.4e-4, "mass_flow": 0.01, "velocity": 20.0}
    return ft.Material("ash", 1800, **given | more)


def scene(cls: Any = ft.Developed, *, material: ft.Material | None = None, **cloud: Any) -> Any:
    made = ft.Cloud((material or ash(),), **cloud)
    return cls(MODEL, DUCT, ft.Feed(22.0), particles=made)


@pytest.mark.parametrize(
    ("cloud", "material", "key", "words"),
    [
        ({"coupling": "two-way"}, {}, "particles.coupling", "solution = 'developing' couples"),
        ({"injection": "points", "points": ((0.1, 0.0, 1.0),)}, {}, "particles.points", "0.1 m"),
        ({"injection": "points", "points": ((0.3, 0.0, 1.0),)}, {}, "particles.points", "inside"),
        ({}, {"temperature": 350.0}, "materials[0].temperature", "particles.heat = false"),
        (
            {},
            {"diameter": 0.09, "size": "lognormal", "spread": 2.0},
            "materials[0].spread",
            "the coarsest particle of this one has 0.766 m",
        ),
        ({}, {"mass_flow": 4000.0}, "materials[0].mass_flow", "flow = 'dense'"),
        ({}, {"mass_flow": None, "loading": 4000.0}, "materials[0].loading", "flow = 'dense'"),
        ({}, {"mass_flow": 4.0, "velocity": 0.1}, "materials[0].velocity", "flow = 'dense'"),
        (
            {"injection": "points", "points": ((0.0, 0.0, 4000.0),)},
            {"mass_flow": None},
            "particles.points",
            "flow = 'dense'",
        ),
        ({}, {"velocity": 0.0}, "materials[0].velocity", "above 0, or nothing enters"),
    ],
)
def test_a_cloud_that_does_not_fit_is_refused(
    cloud: dict[str, Any], material: dict[str, Any], key: str, words: str
) -> None:
    given = {
        "name": "ash",
        "density": 1800,
        "diameter": 1.4e-4,
        "mass_flow": 0.01,
        "velocity": 20.0,
    }
    with pytest.raises(InputError, match=words) as caught:
        scene(material=ft.Material(**{**given, **material}), **cloud)
    assert caught.value.key.endswith(key)


def test_a_particle_as_wide_as_the_line_is_refused() -> None:
    cloud = ft.Cloud((ash(diameter=0.06),))
    with pytest.raises(InputError, match=r"materials\[0\]\.diameter = 0\.06 .* below 0\.05 m"):
        ft.Developed(MODEL, ft.Duct(width=0.05), ft.Feed(22.0), particles=cloud)


def test_steps_have_a_least_length_and_a_price() -> None:
    with pytest.raises(InputError, match=r"particles\.step = 1e-06 is refused: .* at least 0\.01"):
        ft.Cloud(materials=(ash(),), step=1e-6)
    whole, half = (following_time(scene(step=step)) for step in (1.0, 0.5))
    assert half == pytest.approx(2 * whole)


def test_a_name_where_a_list_belongs_is_told_so() -> None:
    with pytest.raises(InputError, match=r'write particles\.forces = \["gravity"\]$'):
        ft.Cloud(materials=(ash(),), forces="gravity")  # type: ignore[arg-type]


def test_a_march_couples_both_ways() -> None:
    assert scene(ft.Developing, coupling="two-way").particles.coupling == "two-way"


def test_a_loading_that_the_gas_feels_is_told() -> None:
    assert not any("one-way" in text for text in scene().warnings())
    heavy = scene(material=ash(mass_flow=2.0))
    assert any("a loading of 1.89 is not one-way" in text for text in heavy.warnings())
    both = scene(ft.Developing, material=ash(mass_flow=2.0), coupling="two-way", parcels=90000)
    assert not any("one-way" in text for text in both.warnings())


def test_particles_that_meet_each_other_are_told() -> None:
    close = scene(material=ash(mass_flow=1.0, velocity=2.0))
    assert any("collide" in text for text in close.warnings())
    apart = scene(material=ash(mass_flow=0.01))
    assert not any("collide" in text for text in apart.warnings())


def test_few_parcels_of_a_coupled_cloud_are_told() -> None:
    rough = scene(ft.Developing, coupling="two-way", parcels=200)
    assert any("rough force" in text for text in rough.warnings())


def test_a_description_tells_of_the_particles() -> None:
    told = scene().describe()
    assert "ash 0.01 kg/s: 500 parcels each, one-way, loading 0.00947" in told["particles"]
    assert "particle-dispersion: langevin" in told["closures"]
    assert any("weight of the particles" in text for text in told["skipped"])
    without = ft.Developed(MODEL, DUCT, ft.Feed(22.0)).describe()
    assert "particles" not in without
    assert not any("particle" in text for text in without["skipped"])


def test_a_case_file_says_the_same() -> None:
    tables = {
        "flow": "duct",
        "geometry": {"shape": "duct", "width": 0.2, "length": 1.0},
        "gas": {"density": 1.2, "viscosity": 1.8e-5},
        "operation": {"gas_superficial_velocity": 22.0},
        "walls": {"distance": 8e-4},
        "particles": {
            "dispersion": {"model": "langevin", "C_L": 0.3},
            "materials": [{"name": "ash", "density": 1800, "diameter": 1.4e-4, "loading": 0.01}],
        },
    }
    case = Case.from_dict(tables)
    assert case.scene.particles.dispersion == ft.laws.Langevin(C_L=0.3)
    assert Case.from_dict(case.tables) == case
    wrong = tables | {"particles": {"materials": [{"name": "ash", "densty": 1}]}}
    with pytest.raises(InputError) as caught:
        Case.from_dict(wrong)
    assert caught.value.key == "particles.materials[0].densty"
    assert caught.value.suggestion == "density"


def test_particles_that_meet_before_the_gas_turns_them_are_told() -> None:
    thick, thin = scene(material=ash(mass_flow=4.0)), scene(material=ash(mass_flow=1e-4))
    met = scene(material=ash(mass_flow=4.0), collisions="sommerfeld")
    told = [any("meets another every" in text for text in s.warnings()) for s in (thick, thin, met)]
    assert told == [True, False, False]
    assert any("collisions between particles" in text for text in thin.left_out())
    assert not any("collisions between particles" in text for text in met.left_out())


def test_a_law_of_beds_is_told_of() -> None:
    assert any("lone particle" in text for text in scene(drag="ergun").warnings())
    assert not any("lone particle" in text for text in scene(drag="wen-yu").warnings())


def test_points_that_are_shares_are_told() -> None:
    points = {"injection": "points", "points": ((0.0, 0.0, 1.0),)}
    assert any("are shares" in text for text in scene(**points).warnings())


def test_a_steady_gas_knows_no_times() -> None:
    with pytest.raises(InputError, match="solution = 'unsteady' knows times"):
        scene(release="during")


@pytest.mark.parametrize(
    ("more", "word"),
    [
        ({"density": 2.6}, "is particles.materials[0].density = 2.6 in kg/m3, not in g/cm3?"),
        ({"diameter": 0.09}, "grains block such a line; is particles.materials[0].diameter = 0.09"),
        ({"diameter": 5e-7}, "is particles.materials[0].diameter = 5e-07 in m?"),
    ],
)
def test_materials_are_doubted_as_solids_are(more: dict[str, float], word: str) -> None:
    given = {"density": 1800.0, "diameter": 1.4e-4} | more
    made = ft.Material("ash", **given, mass_flow=1e-4, velocity=20.0)
    assert any(word in text for text in scene(material=made).warnings())
    assert not any("ash: " in text for text in scene(material=ash(mass_flow=1e-4)).warnings())


@pytest.mark.parametrize(("speed", "settles"), [(2.0, True), (22.0, False)])
def test_parcels_that_would_settle_are_told(speed: float, settles: bool) -> None:
    cloud = ft.Cloud((ash(diameter=1e-3),), forces=("drag", "gravity"))
    slow = ft.Developed(MODEL, DUCT, ft.Feed(speed), particles=cloud)
    assert any("ash: saltation velocity by Rizk" in text for text in slow.numbers())
    assert any("parcels form no bed" in text for text in slow.warnings()) == settles
    light = ft.Developed(MODEL, DUCT, ft.Feed(speed), particles=ft.Cloud((ash(),)))
    assert not any("parcels form no bed" in text for text in light.warnings())


def test_a_gas_that_lifts_no_particle_is_told() -> None:
    cloud = ft.Cloud((ash(diameter=1e-3),), forces=("drag", "gravity"))
    riser = ft.Pipe(diameter=0.2, length=1.0, inclination_deg=90.0)
    model = ft.TwoFluid(ft.Gas(1.2, 1.8e-5))
    told = ft.Developed(model, riser, ft.Feed(2.0), particles=cloud).warnings()
    assert any("more slowly than a grain falls" in text for text in told)


def test_particles_that_enter_much_faster_than_the_gas_are_told() -> None:
    """150 km/h taken for m/s."""
    told = scene(material=ash(velocity=150.0)).warnings()
    assert any("velocity at the entrance over that of the gas 6.818" in text for text in told)
    assert not any("velocity at the entrance" in text for text in scene().warnings())


@pytest.mark.parametrize(("cls", "bytes_each"), [(ft.Developed, 1600), (ft.Developing, 1600)])
def test_more_parcels_than_the_machine_holds_are_refused(
    cls: Any, bytes_each: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(memory, "machine_memory", lambda: 1000.0)
    most = int(1e9 / bytes_each)
    assert scene(cls, parcels=most - 1).particles.parcels == most - 1
    with pytest.raises(InputError, match=r"particles\.parcels = .* fewer: .* has 1000 MB"):
        scene(cls, parcels=most + 10)


def test_an_unsteady_line_keeps_its_parcels_at_every_place() -> None:
    one = ft.Cloud((ash(),), parcels=1000, stations=60)
    given = ft.TwoFluid(ft.Gas(1.2, 1.8e-5), turbulence="k-epsilon"), DUCT, ft.Feed(22.0)
    line = ft.Unsteady(*given, particles=one, numerics=TimeNumerics(end_time=1.0))
    assert parcel_memory(line) == pytest.approx(1.6 + 0.28 * 61)

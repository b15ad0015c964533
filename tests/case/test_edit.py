# SPDX-License-Identifier: LGPL-3.0-or-later
"""Changed keys of a case: overrides, taken back, in the place of others."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Any

import pytest

from fem_tfm.case import Case
from fem_tfm.case.edit import parse_override, parse_value
from fem_tfm.closures import make
from fem_tfm.errors import InputError


def changed(dense: dict[str, Any], **changes: Any) -> Case:
    """The short case with dotted keys changed (double underscore for the dot)."""
    return Case.from_dict(dense).with_values({k.replace("__", "."): v for k, v in changes.items()})


def test_parameter_of_a_default_law(dense: dict[str, Any]) -> None:
    assert changed(dense, closures__drag__C=0.25).scene.model.drag == make(
        "drag", {"model": "three-zone", "C": 0.25}
    )


def test_parameter_of_a_named_law(dense: dict[str, Any]) -> None:
    dense["closures"] = {"friction": "dartevelle"}
    case = changed(dense, closures__friction__coefficient=500.0)
    assert case.scene.model.friction == make(
        "friction", {"model": "dartevelle", "coefficient": 500.0}
    )


def test_parameters_add_up(dense: dict[str, Any]) -> None:
    case = changed(dense, closures__drag__C=0.25).with_values({"closures.drag.width": 0.01})
    assert (case.scene.model.drag.C, case.scene.model.drag.width) == (0.25, 0.01)


def test_another_law_drops_the_parameters(dense: dict[str, Any]) -> None:
    case = changed(dense, closures__drag__C=0.25).with_values({"closures.drag.model": "wen-yu"})
    assert case.scene.model.drag == make("drag", "wen-yu")


def test_none_takes_a_key_back(dense: dict[str, Any]) -> None:
    case = changed(dense, numerics__level=2).with_values({"numerics.level": None})
    assert case.scene.resolution.level == 3


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("solids.diameter=2e-4", 2e-4),
        ("numerics.level = 2", 2),
        ("closures.drag=wen-yu", "wen-yu"),
        ('closures.drag="wen-yu"', "wen-yu"),
        ("output.pictures=false", False),
        ("closures.drag={model='constant'}", {"model": "constant"}),
        ("title=a = b", "a = b"),
        ("title=1\nflow=2", "1\nflow=2"),
    ],
)
def test_overrides_are_toml_or_text(text: str, value: Any) -> None:
    assert parse_override(text) == (text.partition("=")[0].strip(), value)


@pytest.mark.parametrize("text", ["", "solids.diameter", "=3", "solids.diameter=", " = "])
def test_an_override_needs_key_and_value(text: str) -> None:
    with pytest.raises(InputError, match="key=value"):
        parse_override(text)


def test_parse_value_keeps_what_is_no_toml() -> None:
    assert parse_value("log-law") == "log-law"


def test_load_applies_overrides(root: Path) -> None:
    path = root / "demos/dense_pipe/case3.toml"
    case = Case.load(path, ["solids.diameter=2e-4", "closures.friction=none", "title=other"])
    assert (case.scene.model.solids.diameter, case.scene.title) == (2e-4, "other")
    assert case.scene.model.friction == make("friction", "none")


@pytest.mark.parametrize(("text", "value"), [(".5", 0.5), ("5.", 5.0), ("-.5e-3", -5e-4)])
def test_parse_value_reads_short_numbers(text: str, value: float) -> None:
    assert parse_value(text) == value


@pytest.mark.parametrize(
    ("override", "feed"),
    [
        ("operation.solids_mass_flow=0.194", 0.194 / (1700 * math.pi / 4 * 1e-4)),
        ("operation.solids_superficial_velocity=1.5", 1.5),
    ],
)
def test_a_changed_feed_takes_the_place_of_the_other(
    root: Path, override: str, feed: float
) -> None:
    case = Case.load(root / "demos/dense_pipe/case3.toml", [override])
    assert case.scene.solids_feed == ("flux", pytest.approx(feed))


def test_a_changed_gas_takes_the_place_of_the_density(root: Path) -> None:
    path = root / "demos/dense_pipe/case3.toml"
    case = Case.load(path, ["gas.species=N2", "gas.pressure=2.92e6"])
    assert case.scene.model.gas.density == pytest.approx(33.6, rel=0.01)


@pytest.mark.parametrize("feed", ["solids_mass_flow", "solids_superficial_velocity"])
def test_a_case_has_one_feed(dense: dict[str, Any], feed: str) -> None:
    dense["operation"][feed] = 0.1
    with pytest.raises(InputError, match="exactly one of solids_fraction"):
        Case.from_dict(dense)


def test_two_changed_feeds_contradict_each_other(root: Path) -> None:
    path = root / "demos/dense_pipe/case3.toml"
    changes = ["operation.solids_mass_flow=0.2", "operation.solids_fraction=0.2"]
    with pytest.raises(InputError, match="exactly one of"):
        Case.load(path, changes)


def test_a_velocity_beside_the_fraction_makes_a_flux(root: Path) -> None:
    case = Case.load(root / "demos/dense_pipe/algebraic.toml", ["operation.solids_velocity=6"])
    assert case.scene.solids_feed == ("flux", pytest.approx(0.245 * 6))


def test_the_speed_of_a_feed_of_grains_stays_beside_another_mass_flow(root: Path) -> None:
    """In a slug tube the velocity is that of the layers, not the companion of a fraction."""
    case = Case.load(root / "demos/slug_tube/curves.toml", ["operation.solids_velocity=0.16"])
    changed = case.with_values({"operation.solids_mass_flow": 0.0027})
    assert (changed.scene.feed.solids_velocity, changed.scene.feed.solids_mass_flow) == (
        0.16,
        0.0027,
    )


def test_a_key_is_changed_once(root: Path) -> None:
    with pytest.raises(InputError, match="each key once"):
        Case.load(root / "demos/dense_pipe/case3.toml", ["title=a", "title=b"])


def test_a_species_has_the_viscosity_of_a_changed_temperature(dense: dict[str, Any]) -> None:
    """A case that was written with all defaults holds what was given."""
    dense["gas"] = {"species": "air", "pressure": 1e5}
    written = Case.from_dict(tomllib.loads(Case.from_dict(dense).dump()))
    hot = {"gas.temperature": 400.0}
    assert written.with_values(hot) == Case.from_dict(dense).with_values(hot)
    assert written.with_values(hot).scene.model.gas.viscosity == pytest.approx(23.1e-6, rel=0.02)


MATERIALS = [
    {"name": "ash", "density": 1800, "diameter": 1e-4, "loading": 0.1},
    {"name": "sand", "density": 2600, "diameter": 3e-4, "loading": 0.2},
]


def with_particles(dense: dict[str, Any]) -> Case:
    return Case.from_dict(dense | {"particles": {"materials": MATERIALS}})


@pytest.mark.parametrize(
    "key", ["particles.materials.sand.diameter", "particles.materials.1.diameter"]
)
def test_one_material_by_its_name_or_number(dense: dict[str, Any], key: str) -> None:
    case = with_particles(dense)
    other = case.with_values({key: 5e-4})
    assert [m.diameter for m in other.scene.particles.materials] == [1e-4, 5e-4]
    assert other[key] == 5e-4
    assert case[key] == 3e-4 and MATERIALS[1]["diameter"] == 3e-4


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("particles.materials.snad.diameter", "did you mean 'sand'"),
        ("particles.materials.2.diameter", "a number from 0 to 1"),
        ("particles.materials.sand.diametr", "did you mean 'diameter'"),
        ("particles.materials.diameter", "did you mean 'particles.materials.ash.diameter'"),
    ],
)
def test_a_material_that_is_not_there(dense: dict[str, Any], key: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        with_particles(dense).with_values({key: 1e-4})

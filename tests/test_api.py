# SPDX-License-Identifier: LGPL-3.0-or-later
"""The Python API: objects that print, compare, are checked, and run; TOML builds the same ones."""

from __future__ import annotations

from dataclasses import FrozenInstanceError
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fem_tfm as ft
from fem_tfm.case import Case
from fem_tfm.errors import InputError

PIPE = ft.Pipe(diameter=0.010, length=2.4)
COAL = ft.Solids(density=1700, diameter=1.6e-4)
MODEL = ft.TwoFluid(
    ft.Gas(density=33.5, viscosity=1.8e-5),
    COAL,
    drag=ft.laws.ThreeZone(C=0.5),
    friction=ft.laws.Dartevelle(),
)
FEED = ft.Feed(gas_velocity=6.43, solids_mass_flow=0.194)
AIR = ft.ReynoldsStress(ft.Gas.species("air", pressure=1e5))
CASE = """\
geometry = { diameter = 0.010, length = 2.4 }
gas = { density = 33.5, viscosity = 1.8e-5 }
solids = { density = 1700, diameter = 1.6e-4 }
closures = { drag = { model = "three-zone", C = 0.5 }, friction = "dartevelle" }
operation = { gas_superficial_velocity = 6.43, solids_mass_flow = 0.194 }
numerics.level = 1
"""


def test_a_developed_section_runs_without_a_file() -> None:
    """The fields are arrays on the points of the mesh."""
    answer = ft.Developed(MODEL, PIPE, FEED, resolution=ft.Resolution(level=1)).run()
    assert answer.status == "converged"
    assert answer["pressure_gradient"] > 0
    assert answer["solids_mass_flow"] == pytest.approx(0.194, rel=1e-6)
    alpha = answer.fields["alpha_s"]
    assert isinstance(alpha, np.ndarray)
    assert answer.points.shape == (len(alpha), 3)
    assert 0 < alpha.min() < alpha.max() < 0.63


def test_toml_builds_the_same_objects(tmp_path: Path) -> None:
    path = tmp_path / "case.toml"
    path.write_text(CASE)
    twin = ft.Developed(MODEL, PIPE, FEED, resolution=ft.Resolution(level=1))
    assert ft.load(path) == twin
    assert Case.load(path).scene == twin
    assert ft.load(path, ["numerics.level=2"]) != twin


def test_every_scene_takes_model_line_and_feed() -> None:
    line = ft.Developing(MODEL, PIPE, FEED)
    assert "marched from the inlet" in line.describe()["solved"]
    duct = ft.Developing(AIR, ft.Duct(0.2, length=16), ft.Feed(gas_velocity=22))
    assert duct.section.symmetry == "quarter"
    assert duct.reynolds == pytest.approx(22 * 0.2 * 1.189 / 1.8135e-5, rel=1e-3)
    bend = ft.Bend(0.010, length=2.4, bend_towards="down")
    unsteady = ft.Unsteady(MODEL, bend, FEED, ft.TimeNumerics(end_time=1.0))
    assert unsteady.interval == pytest.approx(0.05)
    assert unsteady.section.symmetry == "half"


def test_objects_print_compare_and_cannot_be_changed() -> None:
    assert ft.Pipe(0.01) == ft.Pipe(diameter=0.01)
    assert ft.Pipe(0.01) != ft.Pipe(0.02)
    scene = ft.Developed(MODEL, PIPE, FEED)
    assert scene == ft.Developed(MODEL, PIPE, FEED)
    assert "ThreeZone(C=0.5" in repr(scene)
    assert "diameter=0.00016" in repr(scene)
    with pytest.raises(FrozenInstanceError):
        scene.feed.gas_velocity = 3.0
    rebuilt = eval(repr(COAL), {"Solids": ft.Solids})
    assert rebuilt == COAL


def test_laws_may_be_objects_names_or_tables() -> None:
    by_object = ft.TwoFluid(MODEL.gas, COAL, drag=ft.laws.ThreeZone(C=0.5))
    by_table: Any = {"model": "three-zone", "C": 0.5}
    assert ft.TwoFluid(MODEL.gas, COAL, drag=by_table) == by_object
    by_name: Any = "wen-yu"
    assert ft.TwoFluid(MODEL.gas, COAL, drag=by_name).drag == ft.laws.WenYu()


def test_an_ideal_gas_has_the_density_of_its_pressure() -> None:
    gas = ft.Gas.species("air", pressure=1e5)
    assert gas.density == pytest.approx(1e5 / (287.06 * 293), rel=1e-4)
    assert ft.Gas.ideal(287.06, 1.8e-5, 1e5).density == pytest.approx(gas.density, rel=1e-4)


WRONG = [
    (lambda: ft.Developed(PIPE, MODEL, FEED), "model = Pipe(", "a TwoFluid or a ReynoldsStress"),
    (lambda: ft.Developed(MODEL, FEED, PIPE), "geometry = Feed(", "a Pipe or a Bend or a Duct"),
    (lambda: ft.Developed(MODEL, PIPE, 6.43), "operation = 6.43", "a Feed"),
    (lambda: ft.TwoFluid("air", COAL), "gas = 'air'", "a Gas"),
    (lambda: ft.TwoFluid(MODEL.gas, "coal"), "solids = 'coal'", "a Solids"),
    (lambda: ft.TwoFluid(MODEL.gas, COAL, drag=3), "closures.drag = 3", "three-zone, wen-yu"),
    (
        lambda: ft.TwoFluid(MODEL.gas, COAL, drag=ft.laws.Berzi()),
        "closures.drag = Berzi(",
        "a law of the family drag",
    ),
    (lambda: ft.laws.ThreeZone(C=-1), "C = -1", "above 0"),
    (lambda: ft.Pipe("10 mm"), "geometry.diameter = '10 mm'", "a number above 0"),
    (lambda: ft.Pipe(0.01, symmetry="quater"), "geometry.symmetry", "did you mean 'quarter'?"),
    (lambda: ft.Gas.species("Air", 1e5), "gas.species = 'Air'", "did you mean 'air'?"),
    (lambda: ft.Gas(1.2, 1.8e-5, pressure=1e5), "gas.pressure", "no pressure beside gas.density"),
    (lambda: ft.Gas(1.2, 1.8e-5, 1e5, name="air"), "gas.density = 1.2", "p/(R T) = 1.18896 kg/m3"),
    (lambda: ft.Feed(6.43, 0.2, solids_mass_flow=0.1), "operation.solids_mass_flow", "exactly one"),
    (
        lambda: ft.Developed(MODEL, PIPE, FEED, numerics=ft.TimeNumerics(1.0)),
        "numerics = TimeNumerics(",
        "a SteadyNumerics",
    ),
    (
        lambda: ft.Developed(MODEL, PIPE, FEED, references=[4260.0]),
        "reference[0] = 4260.0",
        "a list, each a Reference",
    ),
    (
        lambda: ft.Developed(MODEL, ft.Bend(0.01, length=2.4), FEED),
        "geometry.shape = 'bend'",
        "solution = 'unsteady'",
    ),
    (
        lambda: ft.Developed(MODEL, ft.Pipe(0.01, symmetry="quarter"), FEED),
        "geometry.symmetry = 'quarter'",
        "one of auto, half, none",
    ),
    (lambda: ft.Developed(AIR, ft.Duct(0.2), FEED), "solids_mass_flow = 0.194", "no such key"),
    (lambda: ft.Developed(MODEL, PIPE, ft.Feed(6.43)), "solids_fraction is not", "one of solids"),
]


@pytest.mark.parametrize(("make", "received", "allowed"), WRONG, ids=range(len(WRONG)))
def test_wrong_objects_are_refused_in_one_sentence(make: Any, received: str, allowed: str) -> None:
    with pytest.raises(InputError) as refused:
        make()
    sentence = str(refused.value)
    assert received in sentence
    assert allowed in sentence
    assert "\n" not in sentence


def test_a_misspelt_name_has_a_near_one() -> None:
    with pytest.raises(AttributeError, match="did you mean ThreeZone"):
        _ = ft.laws.ThreeZon
    with pytest.raises(AttributeError, match="did you mean 'Developed'"):
        _ = ft.Develope


def test_public_names_are_listed_and_documented() -> None:
    assert set(dir(ft)) == set(ft.__all__)
    for name in ft.__all__:
        assert getattr(ft, name).__doc__, name
    assert "ThreeZone" in dir(ft.laws)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Every key names the scenes that read it; a key that a scene does not read is refused."""

from __future__ import annotations

import copy
import tomllib
from dataclasses import MISSING, replace
from pathlib import Path
from typing import Any

import pytest

import fem_tfm as ft
from fem_tfm.case import Case
from fem_tfm.errors import InputError
from fem_tfm.scenes.kinds import KINDS, keys, known_keys, readers, readers_in_words

GAS = {"density": 1.2, "viscosity": 1.8e-5}
DUCT = {
    "flow": "duct",
    "geometry": {"shape": "duct", "width": 0.2},
    "gas": GAS,
    "operation": {"gas_superficial_velocity": 22.0},
}
PIPE = {
    "geometry": {"diameter": 0.01},
    "gas": GAS,
    "solids": {"density": 1700.0, "diameter": 1.6e-4},
    "operation": {
        "gas_superficial_velocity": 6.43,
        "solids_fraction": 0.2,
        "solids_velocity": 6.0,
    },
}
# a case of each kind of scene
CASES = {
    ("dense", "developed"): PIPE,
    ("dense", "developing"): PIPE | {"solution": "developing"},
    ("dense", "unsteady"): PIPE | {"solution": "unsteady", "numerics": {"end_time": 0.5}},
    ("duct", "developed"): DUCT,
    ("duct", "developing"): DUCT | {"solution": "developing"},
    ("slug", "unsteady"): {
        "flow": "slug",
        "geometry": {"diameter": 0.007, "length": 0.1},
        "gas": {"viscosity": 6.73e-5},
        "solids": {"density": 937.0, "diameter": 1.4e-3},
        "operation": {"gas_superficial_velocity": 1.0, "solids_mass_flow": 6.9e-4},
    },
}
# values of keys that have no default, or one that is no value
VALUES = {"geometry.bend_radius": 0.05, "numerics.end_time": 0.5, "solids.density": 1700.0}


def stated(kind: Any, key: str, value: Any) -> dict[str, Any]:
    """Tables of a case of a kind with one more key."""
    tables = copy.deepcopy(CASES[kind.flow, kind.solution])
    *outer, name = key.split(".")
    table = tables
    for one in outer:
        table = table.setdefault(one, {})
    table[name] = value
    return tables


def unread(kind: Any) -> list[str]:
    """Keys that other kinds read."""
    return [name for name in known_keys() if name not in keys(kind)]


PAIRS = [(kind, name) for kind in KINDS for name in unread(kind)]


def test_there_is_a_case_of_every_kind() -> None:
    assert {(kind.flow, kind.solution) for kind in KINDS} == set(CASES)
    for tables in CASES.values():
        Case.from_dict(tables)


@pytest.mark.parametrize(("kind", "name"), PAIRS, ids=[f"{k}: {n}" for k, n in PAIRS])
def test_an_unread_key_is_refused_with_its_readers(kind: Any, name: str) -> None:
    """Also at its default value."""
    default = known_keys()[name].default
    value = VALUES.get(name, 0.5) if default in (None, MISSING) else default
    with pytest.raises(InputError) as refused:
        Case.from_dict(stated(kind, name, list(value) if isinstance(value, tuple) else value))
    sentence = str(refused.value)
    assert refused.value.key == name
    assert f"no such key for {kind}; {readers_in_words(readers(name))} reads it" in sentence
    assert "\n" not in sentence


IGNORED = {
    ("dense", "unsteady"): [
        "numerics.capture", "numerics.damping", "numerics.alpha_diffusion",
        "numerics.tolerance", "numerics.max_steps", "numerics.quadrature_degree",
        "numerics.axial_step", "numerics.axial_accuracy", "output.stations",
    ],
    ("dense", "developed"): [
        "numerics.order", "numerics.courant", "numerics.end_time", "numerics.time_step",
        "numerics.axial_cells", "initial.state", "inlet.profile", "output.probes",
        "output.sections", "output.stations", "closures.reynolds_stress", "closures.heat_flux",
        "walls.function", "walls.heat", "heat.wall",
    ],
    ("duct", "developed"): [
        "closures.drag", "closures.friction", "closures.turbulence", "solids.density",
        "operation.gravity", "operation.outlet_pressure", "geometry.inclination_deg",
        "heat.wall_temperature",
    ],
    ("duct", "developing"): ["inlet.profile", "inlet.solids_intensity", "numerics.max_steps"],
}  # fmt: skip


@pytest.mark.parametrize("scene", IGNORED, ids=" ".join)
def test_keys_that_were_once_ignored_are_unread(scene: tuple[str, str]) -> None:
    (kind,) = [k for k in KINDS if (k.flow, k.solution) == scene]
    assert set(IGNORED[scene]) <= set(unread(kind))


@pytest.mark.parametrize(
    ("scene", "table"),
    [
        (("dense", "developed"), "inlet"),
        (("dense", "developed"), "heat"),
        (("duct", "developed"), "solids"),
        (("duct", "developing"), "initial"),
    ],
)
def test_an_empty_table_that_is_not_read_is_refused(scene: tuple[str, str], table: str) -> None:
    with pytest.raises(InputError, match=f"^{table} = {{}} is refused: expected no such table for"):
        Case.from_dict(CASES[scene] | {table: {}})


@pytest.mark.parametrize("scene", CASES, ids=" ".join)
def test_every_key_that_is_read_may_stand_at_its_default(scene: tuple[str, str]) -> None:
    case = Case.from_dict(CASES[scene])
    assert Case.from_dict(tomllib.loads(case.dump())) == case
    for name in keys(case.scene.kind):
        if case[name] is not None:
            assert case.with_values({name: case[name]}) == case


def test_every_demo_loads(root: Path) -> None:
    demos = sorted((root / "demos").rglob("*.toml"))
    assert demos
    for demo in demos:
        Case.load(demo)


# -- in Python -------------------------------------------------------------------------------------

COAL = ft.Solids(1700.0, 1.6e-4)
DENSE = ft.TwoFluid(ft.Gas(33.5, 1.8e-5), COAL)
SMOOTH = ft.ReynoldsStress(ft.Gas(1.2, 1.8e-5))
FEED = ft.Feed(6.43, solids_mass_flow=0.194)
TINY = ft.Pipe(0.01)
IDEAL = ft.Gas.species("N2", pressure=2.9e6, compressible=True)
WRONG = [
    (ft.Developed, (DENSE, TINY, replace(FEED, outlet_blocked=((0.0, 1.0),))), {}, "unsteady"),
    (ft.Developed, (replace(DENSE, gas=IDEAL), TINY, FEED), {}, "unsteady"),
    (ft.Developed, (DENSE, TINY, FEED), {"output": ft.Output(probes=[[0, 0, 0]])}, "unsteady"),
    (ft.Developed, (DENSE, TINY, FEED), {"output": ft.Output(stations=3)}, "developing"),
    (ft.Developed, (DENSE, TINY, FEED), {"resolution": ft.Resolution(axial_cells=3)}, "unsteady"),
    (ft.Developed, (SMOOTH, ft.Duct(0.2), ft.Feed(22.0, gravity=0.0)), {}, "dense"),
    (ft.Developed, (SMOOTH, ft.Duct(0.2, inclination_deg=9), ft.Feed(22.0)), {}, "dense"),
    (ft.Developed, (SMOOTH, ft.Duct(0.2), ft.Feed(22.0, outlet_pressure=1e5)), {}, "developing"),
    (
        ft.Developing,
        (SMOOTH, ft.Duct(0.2), ft.Feed(22.0)),
        {"inlet": ft.Inlet("uniform")},
        "dense",
    ),
    (
        ft.Unsteady,
        (replace(DENSE, section_terms=ft.SectionTerms(capture=0.1)), TINY, FEED),
        {"numerics": ft.TimeNumerics(1.0)},
        "developed",
    ),
]


@pytest.mark.parametrize(("scene", "given", "more", "reader"), WRONG, ids=range(len(WRONG)))
def test_python_refuses_what_is_not_read(
    scene: Any, given: tuple[Any, ...], more: dict[str, Any], reader: str
) -> None:
    with pytest.raises(InputError) as refused:
        scene(*given, **more)
    told, _, named = str(refused.value).partition("; ")
    assert "no such key for" in told
    assert repr(reader) in named


@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_unread_keys_belong_to_the_classes(kind: Any) -> None:
    """No name in a list of unread keys is misspelt."""
    assert set(kind.unread) <= set(known_keys())
    assert set(kind.defaults) <= set(keys(kind))

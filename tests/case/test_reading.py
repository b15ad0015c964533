# SPDX-License-Identifier: LGPL-3.0-or-later
"""The case: defaults, derived values, and a sentence for everything that can be wrong."""

from __future__ import annotations

import math
import os
import tomllib
from dataclasses import FrozenInstanceError
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fem_tfm.case import Case, known_keys
from fem_tfm.closures import make, names
from fem_tfm.errors import InputError
from fem_tfm.parameters import kind_of

AREA = math.pi / 4 * 0.01**2


def changed(dense: dict[str, Any], **changes: Any) -> Case:
    """The short case with dotted keys changed (double underscore for the dot)."""
    return Case.from_dict(dense).with_values({k.replace("__", "."): v for k, v in changes.items()})


# --- what a good case gives -----------------------------------------------------------------------


def test_defaults(dense: dict[str, Any]) -> None:
    case = Case.from_dict(dense)
    scene, model = case.scene, case.scene.model
    chosen = (case["flow"], case["solution"], case["geometry.shape"])
    assert chosen == ("dense", "developed", "pipe")
    assert (model.solids.packing_limit, model.solids.friction_limit) == (0.63, 0.4)
    assert model.drag == make("drag", "three-zone")
    assert model.solids_wall == make("solids-wall", "schneiderbauer")
    assert scene.wall_offset == pytest.approx(1e-4)
    assert scene.inferred == ()


def test_demo_loads_and_lists_what_is_inferred(root: Path) -> None:
    scene = Case.load(root / "demos/dense_pipe/case3.toml").scene
    assert scene.solids_feed == ("flux", pytest.approx(0.194 / (1700 * AREA)))
    assert scene.geometry.length == 2.4
    assert {r.value for r in scene.references if r.quantity == "pressure_drop"} == {4260.0, 4090.0}
    keys = [text.partition(":")[0] for text in scene.inferred]
    assert "geometry.diameter" in keys
    assert all(key in known_keys() or key.startswith("closures.") for key in keys)


def test_whole_numbers_are_numbers(dense: dict[str, Any]) -> None:
    assert changed(dense, solids__density=1700)["solids.density"] == 1700.0


def test_numpy_numbers_are_numbers(dense: dict[str, Any]) -> None:
    case = changed(dense, solids__diameter=np.float64(2e-4), numerics__level=np.int64(2))
    assert (case["solids.diameter"], case["numerics.level"]) == (2e-4, 2)


@pytest.mark.parametrize(
    ("feed", "expected"),
    [
        ({"solids_fraction": 0.245}, ("holdup", 0.245)),
        ({"solids_fraction": 0.245, "solids_velocity": 6.09}, ("flux", 0.245 * 6.09)),
        ({"solids_superficial_velocity": 1.4}, ("flux", 1.4)),
        ({"solids_mass_flow": 0.194}, ("flux", 0.194 / (1700 * AREA))),
    ],
)
def test_feeds(dense: dict[str, Any], feed: dict[str, float], expected: tuple[str, float]) -> None:
    dense["operation"] = {"gas_superficial_velocity": 6.43, **feed}
    kind, value = Case.from_dict(dense).scene.solids_feed
    assert (kind, value) == (expected[0], pytest.approx(expected[1]))


def test_gas_alone(dense: dict[str, Any]) -> None:
    case = changed(dense, solids=None, operation__solids_fraction=None)
    assert case.scene.model.solids is None
    assert case.scene.solids_feed is None
    assert case.scene.solids_inlet is None


def test_materials_reach_the_closures(dense: dict[str, Any]) -> None:
    model = changed(dense, solids__friction_angle_deg=30.0).scene.model
    assert model.solids.friction_angle == pytest.approx(math.pi / 6)
    assert model.solids.packing_limit == 0.63
    assert (model.gas.density, model.gas.viscosity) == (33.5, 1.8e-5)


def test_ideal_gas_by_name(dense: dict[str, Any]) -> None:
    dense["gas"] = {"species": "N2", "pressure": 2.92e6}
    gas = Case.from_dict(dense).scene.model.gas
    assert gas.density == pytest.approx(2.92e6 / (296.8 * 293), rel=1e-4)
    assert gas.viscosity == pytest.approx(1.757e-5, rel=2e-3)


def test_ideal_gas_by_constant(dense: dict[str, Any]) -> None:
    dense["gas"] = {
        "gas_constant": 300.0,
        "pressure": 3e5,
        "temperature": 500.0,
        "viscosity": 2e-5,
    }
    gas = Case.from_dict(dense).scene.model.gas
    assert (gas.density, gas.viscosity) == (pytest.approx(2.0), 2e-5)


@pytest.mark.parametrize(
    ("angle", "expected"),
    [(0.0, (0, -9.81, 0)), (90.0, (0, 0, -9.81)), (-90.0, (0, 0, 9.81)), (30.0, None)],
)
def test_gravity_turns_with_the_pipe(
    dense: dict[str, Any], angle: float, expected: tuple[float, ...] | None
) -> None:
    vector = changed(dense, geometry__inclination_deg=angle).scene.gravity
    expected = expected or (0, -9.81 * math.sqrt(3) / 2, -9.81 / 2)
    assert vector == pytest.approx(expected, abs=1e-12)


def test_sections(dense: dict[str, Any]) -> None:
    pipe = Case.from_dict(dense).scene.geometry
    assert (pipe.area, pipe.hydraulic_diameter) == (pytest.approx(AREA), pytest.approx(0.01))
    dense["geometry"] = {"shape": "duct", "width": 0.02, "height": 0.01}
    duct = Case.from_dict(dense).scene.geometry
    assert (duct.area, duct.hydraulic_diameter) == (pytest.approx(2e-4), pytest.approx(0.04 / 3))
    dense["geometry"] = {"shape": "duct", "width": 0.02}
    assert Case.from_dict(dense).scene.geometry.hydraulic_diameter == pytest.approx(0.02)


def test_a_case_cannot_be_changed(dense: dict[str, Any]) -> None:
    case = Case.from_dict(dense)
    with pytest.raises(FrozenInstanceError):
        case.scene.model.solids.diameter = 1.0


def test_the_given_tables_stay_as_they_are(dense: dict[str, Any]) -> None:
    before = repr(dense)
    Case.from_dict(dense).with_values({"solids.diameter": 2e-4})
    assert repr(dense) == before


# --- writing and changing -------------------------------------------------------------------------


@pytest.mark.parametrize("demo", ["short", "demos/dense_pipe/case3.toml"])
def test_dump_reads_back_the_same(dense: dict[str, Any], root: Path, demo: str) -> None:
    case = Case.from_dict(dense) if demo == "short" else Case.load(root / demo)
    assert Case.from_dict(tomllib.loads(case.dump())) == case


def test_dump_holds_every_default(dense: dict[str, Any]) -> None:
    written = tomllib.loads(Case.from_dict(dense).dump())
    assert written["solids"]["restitution"] == 0.7
    assert written["closures"]["drag"]["model"] == "three-zone"
    assert written["closures"]["drag"]["C"] == 1.0
    assert written["numerics"]["max_steps"] == 200


@pytest.mark.parametrize("family", ["drag", "radial", "granular", "friction", "turbulence"])
def test_every_law_can_be_chosen_and_written(dense: dict[str, Any], family: str) -> None:
    for name in names(family):
        case = changed(dense, **{f"closures__{family}": name})
        assert tomllib.loads(case.dump())["closures"][family]["model"] == name


@pytest.mark.parametrize("family", ["dispersed", "dispersion"])
def test_every_law_of_the_solids_turbulence_can_be_chosen(
    dense: dict[str, Any], family: str
) -> None:
    for name in names(family):
        laws = {f"closures__{family}": name, "closures__turbulence": "k-epsilon"}
        assert getattr(changed(dense, **laws).scene.model, family).name == name


def test_four_equations_stand_for_two_laws(dense: dict[str, Any]) -> None:
    laws = changed(dense, closures__turbulence="realizable-4eq").scene.model
    assert (laws.turbulence.name, laws.dispersed.name) == ("realizable", "k-epsilon")
    other = {"closures__turbulence": "realizable-4eq", "closures__dispersed": "simonin"}
    assert changed(dense, **other).scene.model.dispersed.name == "simonin"
    other["closures__dispersed"] = "none"
    assert changed(dense, **other).scene.model.dispersed.name == "none"


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"closures__dispersed": "simonin"}, "closures.dispersed"),
        ({"closures__dispersion": "simonin"}, "closures.dispersion"),
        ({"walls__gas": "log-law-k"}, "walls.gas"),
        ({"closures__turbulence": "realizable", "walls__gas": "no-slip"}, "walls.gas"),
    ],
)
def test_laws_that_do_not_fit_the_turbulence_are_refused(
    dense: dict[str, Any], changes: dict[str, Any], key: str
) -> None:
    with pytest.raises(InputError) as error:
        changed(dense, **changes)
    assert error.value.key == key
    assert "closures.turbulence" in str(error.value)


def test_load_reads_a_byte_order_mark(tmp_path: Path, dense: dict[str, Any]) -> None:
    path = tmp_path / "case.toml"
    path.write_text(Case.from_dict(dense).dump(), encoding="utf-8-sig")
    assert Case.load(path) == Case.from_dict(dense)


def test_every_key_is_documented_and_every_number_bounded() -> None:
    for name, key in known_keys().items():
        assert key.doc, name
        limits = set(key.field.metadata["limits"])
        if kind_of(key.cls, key.field) in (float, float | None, int, int | None):
            assert limits & {"gt", "ge"}, name
            assert limits & {"lt", "le"}, name


# --- what is refused ------------------------------------------------------------------------------

NOT_NUMBERS = [True, "1.6e-4", "", [1.0], {"value": 1.0}, math.nan, math.inf, -math.inf, 1 + 2j]
NUMBERS = [
    "geometry.diameter",
    "geometry.length",
    "gas.density",
    "gas.viscosity",
    "solids.density",
    "solids.restitution",
    "operation.gas_superficial_velocity",
    "operation.gravity",
    "walls.distance",
    "numerics.tolerance",
    "numerics.level",
]


@pytest.mark.parametrize("key", NUMBERS)
@pytest.mark.parametrize("value", NOT_NUMBERS, ids=repr)
def test_only_numbers_are_numbers(dense: dict[str, Any], key: str, value: Any) -> None:
    with pytest.raises(InputError, match="number") as caught:
        Case.from_dict(dense).with_values({key: value})
    assert caught.value.key == key


BAD = [
    # unknown keys and their neighbours
    ("solids.diamter", 1e-4, "did you mean 'solids.diameter'?"),
    ("solid.diameter", 1e-4, "did you mean 'solids.diameter'?"),
    ("gas.gravity", 9.81, "did you mean 'operation.gravity'?"),
    ("inclination_deg", 10.0, "did you mean 'geometry.inclination_deg'?"),
    ("operations", {}, "did you mean 'operation'?"),
    ("numerics.levle", 3, "did you mean 'numerics.level'?"),
    ("foo.bar", 3, "one of the keys title, flow"),
    ("title.text", "x", "did you mean 'title'?"),
    ("closures.darg", "wen-yu", "did you mean 'closures.drag'?"),
    ("closures.drag.D", 1.0, "C, width"),
    # ranges
    ("geometry.diameter", 0, "above 0 and at most 100 [m]"),
    ("geometry.diameter", -0.01, "above 0"),
    ("geometry.length", 0.0, "above 0"),
    ("geometry.inclination_deg", 90.1, "at most 90 [deg]"),
    ("geometry.inclination_deg", -91, "at least -90"),
    ("gas.density", -1.0, "at least 1e-15 and at most 2000 [kg/m3]"),
    ("gas.viscosity", 0.0, "[Pa s]"),
    ("gas.temperature", 0.0, "[K]"),
    ("solids.density", 30000.0, "at most 25000"),
    ("solids.diameter", 160.0, "at most 0.1 [m]"),
    ("solids.restitution", 1.1, "above 0 and at most 1"),
    ("solids.restitution", 0.0, "above 0"),
    ("solids.packing_limit", 0.8, "below 0.7406"),
    ("solids.friction_angle_deg", 90, "below 90"),
    ("operation.gas_superficial_velocity", 0.0, "above 0"),
    ("operation.gas_superficial_velocity", 6430.0, "at most 300 [m/s]"),
    ("operation.solids_fraction", 0.0, "above 0"),
    ("operation.gravity", -9.81, "at least 0"),
    ("operation.outlet_pressure", 0.0, "[Pa]"),
    ("walls.distance", 0.0, "above 0"),
    ("numerics.level", 0, "a whole number at least 1"),
    ("numerics.level", 2.5, "a whole number"),
    ("numerics.max_steps", 0, "a whole number at least 1"),
    ("numerics.tolerance", 1.0, "below 1"),
    ("numerics.theta_floor", -1e-8, "at least 0"),
    ("numerics.wall_grading", 0.0, "at least 0.001"),
    ("numerics.quadrature_degree", 21, "at most 20"),
    ("closures.drag.C", -1.0, "above 0"),
    ("closures.drag.C", "much", "a number"),
    # names
    ("geometry.shape", "pip", "did you mean 'pipe'?"),
    ("geometry.shape", "cone", "one of pipe, duct, bend"),
    ("geometry.shape", "bend", "solution = 'unsteady' beside it"),
    ("geometry.bend_radius", 0.1, "with solution = 'unsteady' reads it"),
    ("operation.gas_schedule", [[0, 0], [1, 1]], "with solution = 'unsteady' reads it"),
    ("geometry.symmetry", "quarter", "one of auto, half, none"),
    ("flow", "slurry", "one of dense"),
    ("solution", "develop", "did you mean 'developed'?"),
    ("gas.species", "n2", "did you mean 'N2'?"),
    ("closures.drag", "wen-yo", "did you mean 'wen-yu'?"),
    ("closures.drag", 3, "one of "),
    ("closures.drag", {"C": 1.0}, "one of "),
    ("closures.theta", "transprt", "did you mean 'transport'?"),
    ("walls.gas", "loglaw", "did you mean 'log-law'?"),
    ("walls.solids", "slip", "one of "),
    ("numerics.cells", "triangles", "did you mean 'triangle'?"),
    ("output.fields", ["alpha"], "out of alpha_s"),
    # kinds
    ("title", 3, "a text"),
    ("inferred", "all", "a list of texts"),
    ("inferred", [1], "a list of texts"),
    ("geometry", 0.01, "a table"),
    ("gas", None, "a table"),
    ("reference", {"value": 1.0}, "a list of tables"),
    ("output.pictures", 1, "true or false"),
    ("output.pictures", "yes", "true or false"),
    ("closures.friction_feeds_theta", "no", "true or false"),
    # values that contradict each other
    ("geometry.shape", "duct", "geometry.width in its place"),
    ("geometry.width", 0.01, "geometry.diameter in its place"),
    ("geometry.diameter", None, "for shape 'pipe'"),
    ("solids.diameter", 0.02, "below 0.01 m"),
    ("walls.distance", 0.005, "below 0.005 m"),
    ("numerics.mesh_size", 0.01, "below 0.01 m"),
    ("solids.friction_limit", 0.63, "below solids.packing_limit = 0.63"),
    ("operation.solids_fraction", 0.63, "below solids.packing_limit = 0.63"),
    ("operation.solids_fraction", None, "one of solids_fraction"),
    ("solids", None, "a table [solids]"),
    ("gas.density", None, "exactly one of density, species, gas_constant"),
    ("gas.species", "N2", "gas.pressure is not given"),
    ("gas.pressure", 1e5, "no pressure beside gas.density"),
    ("gas.compressible", True, "with solution = 'unsteady' reads it"),
    ("gas.viscosity", None, "dynamic viscosity"),
    ("solids.density", None, "density of the particle"),
    ("operation.gas_superficial_velocity", None, "above 0"),
]


@pytest.mark.parametrize(("key", "value", "part"), BAD, ids=[f"{k}={v}" for k, v, _ in BAD])
def test_refused_with_the_remedy(dense: dict[str, Any], key: str, value: Any, part: str) -> None:
    with pytest.raises(InputError) as caught:
        Case.from_dict(dense).with_values({key: value})
    sentence = str(caught.value)
    assert part in sentence
    assert "\n" not in sentence
    assert key.partition(".")[0] in sentence


BAD_TABLES = [
    ({"gas": {"species": "N2"}}, "gas.pressure is not given"),
    ({"gas": {"gas_constant": 287.0, "pressure": 1e5}}, "gas.viscosity is not given"),
    (
        {"gas": {"species": "N2", "pressure": 1e5, "compressible": True}},
        "with solution = 'unsteady' reads it",
    ),
    ({"gas": {"density": 1.2, "viscosity": 1e-5, "mu": 1e-5}}, "gas.mu = 1e-05 is refused"),
    (
        {"operation": {"gas_superficial_velocity": 6.0, "solids_velocity": 6.0}},
        "operation.solids_velocity",
    ),
    ({"reference": [{"quantity": "pressure_drop", "value": 1.0}]}, "reference[0].source"),
    (
        {"reference": [{"quantity": "pressuredrop", "value": 1.0, "source": "x"}]},
        "did you mean 'pressure_drop'?",
    ),
    (
        {"reference": [{"quantity": "holdup", "value": "0.2", "source": "x"}]},
        "reference[0].value = '0.2'",
    ),
    ({"closures": {"drag": {"model": "wen-yu", "C": 1.0}}}, "closures.drag.C"),
    ({"geometry": {"shape": "duct", "height": 0.01}}, "geometry.width is not given"),
    ({"solid": {}}, "did you mean 'solids'?"),
    ({"solids": 3}, "solids = 3 is refused: expected a table (particles; without the table"),
    ({"solids": [{"density": 1.0}]}, "expected a table (particles"),
    ({"closures": "gidaspow"}, "expected a table (laws of the model)"),
    ({"numerics": 3}, "expected a table (mesh and solver)"),
    ({"output": "all"}, "expected a table (files)"),
    ({"title": {"text": "x"}}, "title = {'text': 'x'} is refused: expected a text"),
    ({"solution": {"kind": "developed"}}, "expected one of auto, developed"),
    ({"flow": ["dense"]}, "expected one of dense, duct"),
    ({"numerics": {"level": {"finest": 3}}}, "numerics.level = {'finest': 3} is refused"),
    ({"solids": {"grain": {"density": 1.0}}}, "one of the keys density, diameter"),
    ({"inferred": ["a", 3]}, "inferred[1] = 3 is refused: expected a list of texts"),
    ({"output": {"fields": ["u_g", "u_q"]}}, "output.fields[1] = 'u_q' is refused"),
    ({"reference": [{"quantity": "holdup", "value": 0.2, "source": ""}]}, "reference[0].source"),
]


@pytest.mark.parametrize(("tables", "part"), BAD_TABLES, ids=[p for _, p in BAD_TABLES])
def test_refused_tables(dense: dict[str, Any], tables: dict[str, Any], part: str) -> None:
    with pytest.raises(InputError) as caught:
        Case.from_dict(dense | tables)
    assert part in str(caught.value)


def test_a_misspelt_key_comes_before_what_it_leaves_out(dense: dict[str, Any]) -> None:
    dense["solids"] = {"desnity": 1700.0, "diameter": 1.6e-4}
    with pytest.raises(InputError) as caught:
        Case.from_dict(dense)
    assert caught.value.key == "solids.desnity"
    assert caught.value.suggestion == "solids.density"


def test_python_words_get_the_same_sentences(dense: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=r"solids\.diameter"):
        Case(**{**dense, "solids": {"density": 1700.0, "diameter": -1.0}})


# --- files ----------------------------------------------------------------------------------------


def test_missing_file_names_its_neighbour(root: Path) -> None:
    with pytest.raises(InputError, match=r"did you mean 'case3.toml'\?"):
        Case.load(root / "demos/dense_pipe/case33.toml")


@pytest.mark.parametrize(
    ("content", "part"),
    [
        (b"title = 'a'\ntitle = 'b'\n", "line 2"),
        (b"[geometry\n", "line 1"),
        (b"title = '\xff'\n", r"not \(Latin-1\?\); save it again as UTF-8"),
        ("title = 'a'".encode("utf-16"), "this is UTF-16; save it again"),
        (b"", "it is empty"),
        (b"# words alone\n", "it is empty"),
    ],
)
def test_broken_files(tmp_path: Path, content: bytes, part: str) -> None:
    path = tmp_path / "case.toml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=part):
        Case.load(path)


def test_only_a_file_is_a_case(tmp_path: Path) -> None:
    """A pipe that nobody writes to would be waited for."""
    os.mkfifo(tmp_path / "pipe")
    for path, kind in ((tmp_path, "a directory"), (tmp_path / "pipe", "a pipe")):
        with pytest.raises(InputError, match=f"a regular file, and this is {kind}"):
            Case.load(path)


# -- developing flow ---------------------------------------------------------------------------


def entering(dense: dict[str, Any], **operation: Any) -> Case:
    """A developing case with another feed."""
    given = {"gas_superficial_velocity": 6.43, **operation}
    return Case.from_dict(dense | {"solution": "developing", "operation": given})


def test_what_enters_is_given_or_follows_from_the_feeder(dense: dict[str, Any]) -> None:
    """Table 1, case 3 of the paper: alpha_s = 0.245 and u_s = 6.09 m/s, or the flux of M_s."""
    given = entering(dense, solids_fraction=0.245, solids_velocity=6.09)
    assert given.scene.solids_inlet == (0.245, 6.09)
    found = entering(dense, solids_mass_flow=0.194)
    alpha, speed = found.scene.solids_inlet
    assert alpha * speed == pytest.approx(found.scene.solids_feed[1], rel=1e-12)
    assert speed == pytest.approx(6.09, rel=0.02)
    assert alpha == pytest.approx(0.245, rel=0.05)
    # the flux of momentum with which the grains come in
    spent = 0.194 * speed / found.scene.geometry.area
    assert (
        f"lacks what speeds them up to that, about {spent:.3g} Pa" in found.scene.physics.entering()
    )
    assert "lacks" not in given.scene.physics.entering()


@pytest.mark.parametrize(
    ("solids", "operation", "message"),
    [
        ({}, {"solids_fraction": 0.2}, "operation.solids_velocity is not given: expected the velo"),
        ({"diameter": 8e-3}, {"solids_mass_flow": 0.1}, "operation.solids_mass_flow = 0.1 is ref"),
        (
            {},
            {"solids_superficial_velocity": 4.0},
            "expected less, or operation.solids_fraction with solids_velocity",
        ),
    ],
)
def test_an_inlet_that_is_not_known_is_refused(
    dense: dict[str, Any], solids: dict, operation: dict, message: str
) -> None:
    """A hold-up alone, grains beyond the feeder's correlation, more than packs."""
    dense["solids"] |= solids
    with pytest.raises(InputError) as refused:
        entering(dense, **operation)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_hold_up_alone_does_for_the_developed_section(dense: dict[str, Any]) -> None:
    assert Case.from_dict(dense).scene.solids_feed == ("holdup", 0.245)


def test_gas_alone_may_develop(dense: dict[str, Any]) -> None:
    del dense["solids"]
    assert entering(dense).scene.solids_feed is None


# -- unsteady flow -----------------------------------------------------------------------------


def unsteady(dense: dict[str, Any], changes: dict[str, Any] | None = None) -> Case:
    """An unsteady case of a fed line, with dotted keys changed."""
    dense["operation"] |= {"solids_fraction": 0.245, "solids_velocity": 6.09}
    values = dense | {"solution": "unsteady", "numerics": {"end_time": 0.5}}
    return Case.from_dict(values).with_values(changes or {})


def test_defaults_of_an_unsteady_flow(dense: dict[str, Any]) -> None:
    case = unsteady(dense)
    assert case["numerics.cells"] == "quadrilateral"
    assert (case["numerics.courant"], case["numerics.order"]) == (1.0, 0)
    assert case["initial.state"] == "rest"


def test_a_schedule_is_written_and_read_back(dense: dict[str, Any]) -> None:
    case = unsteady(
        dense,
        {
            "operation.gas_schedule": [[0, 0], [0.1, 1]],
            "operation.outlet_blocked": [[0.2, 0.3]],
            "output.probes": [[0, 0.004, 0.1]],
        },
    )
    assert case.scene.feed.gas_schedule == ((0.0, 0.0), (0.1, 1.0))
    assert Case.from_dict(tomllib.loads(case.dump())) == case


BEND = {
    "geometry.shape": "bend",
    "geometry.diameter": 0.01,
    "geometry.bend_radius": 0.05,
    "geometry.length": 0.2,
}


def test_legs_of_a_bend(dense: dict[str, Any]) -> None:
    geometry = unsteady(dense, BEND).scene.geometry
    arc = 0.05 * math.pi / 2
    straight = (0.2 - arc) / 2
    assert geometry.legs == pytest.approx((straight, arc, straight))
    assert geometry.hydraulic_diameter == 0.01
    geometry = unsteady(dense, BEND | {"geometry.bend_start": 0.0}).scene.geometry
    assert geometry.legs == pytest.approx((0.0, arc, 0.2 - arc))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"numerics.end_time": None}, "numerics.end_time is not given: expected a number above 0"),
        ({"operation.solids_schedule": [[1, 0], [0, 1]]}, "times that grow"),
        ({"operation.solids_schedule": [[0, -1]]}, "factors >= 0"),
        ({"operation.outlet_blocked": [[0.2, 0.1]]}, "pairs [from, to] of times that grow"),
        ({"operation.outlet_blocked": [[0.1, 0.2], [0.15, 0.3]]}, "pairs [from, to] of times"),
        ({"operation.gas_schedule": "ramp"}, "a list of lists of 2 numbers [s, -]"),
        ({"operation.gas_schedule": [[0, 0, 1]]}, "a list of lists of 2 numbers [s, -]"),
        ({"output.probes": [[0.0, 0.1]]}, "a list of lists of 3 numbers [m]"),
        ({"output.sections": [[0.1]]}, "a list of numbers [m]"),
        ({"gas.compressible": True}, "false beside gas.density"),
        ({"geometry.bend_radius": 0.1}, "geometry.shape = 'bend' beside it"),
        ({"geometry.bend_towards": "up"}, "geometry.shape = 'bend' beside it"),
        ({"numerics.order": 2}, "a whole number at least 0 and at most 1"),
        ({"numerics.time_step": 1e-12}, "at least numerics.smallest_time_step = 1e-09 s"),
        (
            {"initial.state": "bed", "initial.bed_fraction": 0.65},
            "a number below solids.packing_limit = 0.63",
        ),
        ({"initial.state": "bed", "initial.bed_start": 1e4}, "a place before the outlet"),
        ({"initial.bed_start": 0.1, "initial.bed_end": 0.1}, "a place behind initial.bed_start"),
        ({"operation.solids_schedule": [[0, 1], [1, 3]]}, "factors below 2.57143, where it packs"),
        (BEND | {"geometry.bend_radius": 0.004}, "a radius above half of geometry.diameter"),
        (
            BEND | {"geometry.bend_start": 0.15},
            "at least the leg before the bend of 0.15 m and its arc",
        ),
        (BEND | {"geometry.bend_towards": "side", "geometry.symmetry": "half"}, "'none' or 'auto'"),
    ],
)
def test_an_unsteady_flow_that_cannot_be_is_refused(
    dense: dict[str, Any], changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError) as refused:
        unsteady(dense, changes)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_duct_is_not_unsteady(dense: dict[str, Any]) -> None:
    del dense["solids"]
    with pytest.raises(InputError, match="flow 'slug' or 'dense' beside it"):
        Case.from_dict(
            {
                **dense,
                "flow": "duct",
                "solution": "unsteady",
                "operation": {"gas_superficial_velocity": 6.0},
            }
        )

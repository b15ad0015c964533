# SPDX-License-Identifier: LGPL-3.0-or-later
"""Before a case is solved: numbers that follow from it, slips of units, memory, and time."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from fem_tfm import Case
from fem_tfm.cli import main
from fem_tfm.closures import names
from fem_tfm.correlations import cunningham, rizk_velocity, sound_speed, terminal_velocity
from fem_tfm.errors import InputError, SolverError
from fem_tfm.materials import Gas, Solids
from fem_tfm.scenes.judged import memory
from fem_tfm.scenes.judged.gas import doubts
from fem_tfm.scenes.judged.memory import section_cells
from fem_tfm.scenes.judged.plausible import derived, out_of_range

RISER: dict[str, Any] = {
    "geometry": {"diameter": 0.05, "length": 10.0, "inclination_deg": 90.0},
    "gas": {"species": "air", "pressure": 1.0e5},
    "solids": {"density": 2500.0, "diameter": 2.0e-4},
    "operation": {"gas_superficial_velocity": 12.0, "solids_mass_flow": 0.1},
}


def riser(**changes: Any) -> Case:
    return Case.from_dict(RISER).with_values({k.replace("__", "."): v for k, v in changes.items()})


def test_a_plausible_case_has_no_doubts() -> None:
    assert doubts(riser().scene.derived()) == []
    told = {number.name: number.value for number in derived(riser().scene)}
    assert told["gas density"] == pytest.approx(1.19, rel=1e-2)
    assert told["loading, solids over gas by mass"] == pytest.approx(3.57, rel=1e-2)
    assert told["solids superficial velocity"] == pytest.approx(
        0.1 / 2500 / (math.pi / 4 * 0.05**2)
    )
    assert told["wall distance in grain diameters"] == pytest.approx(2.5)


@pytest.mark.parametrize(
    ("key", "value", "number"),
    [
        (
            "geometry.diameter",
            50.0,
            "length over diameter 0.2: the line is wider or hardly longer than wide",
        ),
        ("gas.pressure", 1.0, "gas density 1.189e-05 kg/m3: next to a vacuum; is gas.pressure"),
        ("gas.temperature", 20.0, "gas density 17.42 kg/m3: is gas.temperature = 20 in K"),
        ("solids.density", 2.5, "over that of the gas 2.103: is solids.density = 2.5 in kg/m3"),
        ("operation.solids_mass_flow", 360.0, "solids superficial velocity 73.34 m/s: more than"),
        ("operation.solids_mass_flow", 12.0, "solids over gas by mass 428.4: outside of what is"),
        ("operation.gas_superficial_velocity", 120.0, "that of sound 0.3497: its motion alone"),
        ("solids.diameter", 1e-7, "by Cunningham 2.886: the gas slips along grains of 0.1 um"),
        ("operation.gas_superficial_velocity", 1.0, "more slowly than a grain falls: it lifts"),
        ("operation.outlet_pressure", 2e7, "over that of the gas 200: the gas has its density at"),
        ("solids.friction_angle_deg", 0.5585, "friction 0.5585 deg: grains have 15 to 45; is"),
        ("walls.distance", 0.02, "walls.distance = 0.02 m is above a tenth of the hydraulic"),
        ("walls.distance", 5e-7, "inside the sublayer, which needs cells as thin"),
    ],
)
def test_a_slip_of_units_is_told_with_the_number_that_gives_it_away(
    key: str, value: float, number: str
) -> None:
    warnings = Case.from_dict(RISER).with_values({key: value}).scene.warnings()
    assert any(number in text for text in warnings)


AIR = {"density": 1.2, "viscosity": 1.8e-5}
GAS_ALONE = {
    "geometry": {"diameter": 0.1, "length": 10.0},
    "gas": AIR,
    "operation": {"gas_superficial_velocity": 20.0},
}
DUCT = GAS_ALONE | {
    "flow": "duct",
    "geometry": {"shape": "duct", "width": 0.2, "length": 10.0},
    "walls": {"distance": 8e-4},
}
TUBE = {
    "flow": "slug",
    "geometry": {"diameter": 0.007, "length": 0.1},
    "gas": {"viscosity": 6.73e-5},
    "solids": {"density": 937.0, "diameter": 1.4e-3},
    "operation": {"gas_superficial_velocity": 1.0, "solids_mass_flow": 6.9167e-4},
    "averages": {"low": 0.02, "high": 0.09},
}


@pytest.mark.parametrize("tables", [RISER, GAS_ALONE, DUCT, TUBE])
@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"gas.viscosity": 0.018}, "gas viscosity 0.018 Pa s: gases have"),
        ({"gas.viscosity": 1e-12}, "gas viscosity 1e-12 Pa s: gases have"),
        ({"geometry.length": 1e-3}, "the line is wider or hardly longer than wide"),
        ({"operation.gas_superficial_velocity": 290.0}, "over that of sound 0.8"),
    ],
)
def test_every_flow_doubts_its_gas_and_names_a_cause_once(
    tables: dict[str, Any], changes: dict[str, Any], word: str
) -> None:
    scene = Case.from_dict(tables).scene
    assert doubts(scene.derived()) == []
    gas = {"gas.species": None, "gas.pressure": None, "gas.density": 1.2, "gas.viscosity": 1.8e-5}
    more = gas if tables is RISER and "gas.viscosity" in changes else {}
    if tables is TUBE and "geometry.length" in changes:
        more = {"averages.low": 1e-4, "averages.high": 9e-4}
    (told,) = doubts(Case.from_dict(tables).with_values(more | changes).scene.derived())
    assert word in told


@pytest.mark.parametrize(
    ("tables", "key", "value", "word"),
    [
        (DUCT, "gas.density", 1200.0, "that of a liquid"),
        (DUCT, "geometry.width", 100.0, "the line is wider or hardly longer than wide"),
        (DUCT, "operation.gas_superficial_velocity", 1.0, "meant for more than 20000"),
        (TUBE, "gas.reference_pressure", 1.0, "no gas has it at gas.reference_pressure = 1 Pa"),
        (TUBE, "closures.contact.stiffness", 0.1, "in diameters 1.853: such contacts let grains"),
        (GAS_ALONE, "operation.gas_superficial_velocity", 0.3, "closures.turbulence = 'laminar'"),
        (GAS_ALONE, "operation.gas_superficial_velocity", 0.005, "nothing is turbulent there"),
        (
            GAS_ALONE,
            "geometry.length",
            1500.0,
            "0.6049 (that of air of this density): a gas of one",
        ),
        (GAS_ALONE, "gas.temperature", 20.0, "is gas.temperature = 20 in K"),
        (RISER, "gas.temperature", 20.0, "is gas.temperature = 20 in K"),
        (
            GAS_ALONE,
            "operation.outlet_pressure",
            1.0,
            "no gas has it at operation.outlet_pressure = 1 Pa",
        ),
    ],
)
def test_other_flows_than_dense_solids_doubt_their_numbers(
    tables: dict[str, Any], key: str, value: float, word: str
) -> None:
    (told,) = doubts(Case.from_dict(tables).with_values({key: value}).scene.derived())
    assert word in told


LINE = RISER | {"geometry": {"diameter": 0.05, "length": 10.0}}
IN_TIME = LINE | {
    "solution": "unsteady",
    "operation": {
        "gas_superficial_velocity": 12.0,
        "solids_fraction": 0.01,
        "solids_velocity": 6.0,
    },
    "initial": {"state": "inlet"},
    "numerics": {"end_time": 1.0},
}
HOT = DUCT | {"heat": {"wall": "flux", "wall_flux": 1000.0}}


@pytest.mark.parametrize(
    ("tables", "changes", "word"),
    [
        (LINE, {"gas.pressure": 5000.0}, "gas.pressure = 5000 absolute and in Pa, not in bar"),
        (GAS_ALONE, {"gas.density": 0.0012}, "is gas.density in kg/m3, not in g/cm3 or lb/ft3?"),
        (
            GAS_ALONE,
            {"gas.gas_constant": 28.96, "gas.density": None, "gas.pressure": 1e5},
            "is gas.gas_constant = 28.96 in J/kg/K, and not a molar mass?",
        ),
        (
            GAS_ALONE,
            {"gas.density": 0.075, "operation.outlet_pressure": 1e5},
            "no gas has it at operation.outlet_pressure = 100000 Pa",
        ),
        (LINE, {"gas.temperature": 200.0}, "is gas.temperature = 200 in K"),
        (LINE, {"geometry.diameter": 2.0}, "hydraulic diameter 2 m: is the width of the line in m"),
        (LINE, {"geometry.length": 0.1}, "are its width of 0.05 m and geometry.length = 0.1 in m?"),
        (LINE, {"geometry.inclination_deg": 0.79}, "not in radians (45 deg)?"),
        (LINE, {"geometry.inclination_deg": 0.175}, "not in radians (10 deg)?"),
        (LINE, {"solids.diameter": 0.01}, "grains block such a line; is solids.diameter = 0.01"),
        (LINE, {"solids.restitution": 0.009}, "is solids.restitution a fraction of 1?"),
        (LINE, {"solids.friction_limit": 0.004}, "is solids.friction_limit a fraction of 1?"),
        (
            LINE,
            {"walls.solids": {"model": "johnson-jackson", "friction_angle_deg": 0.47}},
            "is walls.solids.friction_angle_deg in degrees",
        ),
        (
            LINE,
            {"operation.gas_superficial_velocity": 0.0236},
            "are operation.gas_superficial_velocity = 0.0236 and operation.solids_mass_flow = 0.1",
        ),
        (IN_TIME, {"operation.solids_velocity": 21.6}, "operation.solids_velocity = 21.6 in m/s"),
        (IN_TIME, {"numerics.end_time": 2000.0}, "is numerics.end_time = 2000 in s, not in ms?"),
        (IN_TIME, {"numerics.end_time": 1e-3}, "is numerics.end_time = 0.001 in s, not in ms?"),
        (IN_TIME, {"output.interval": 5.0}, "nothing is written before the end at 1 s"),
        (
            IN_TIME,
            {"operation.gas_schedule": [[0.0, 0.0], [0.5, 12.0]]},
            "largest factor of operation.gas_schedule 12",
        ),
        (
            IN_TIME,
            {"operation.solids_schedule": [[0.0, 0.0], [5.0, 1.0]]},
            "are the times of operation.solids_schedule in s?",
        ),
        (HOT, {"heat.wall_flux": 1.0}, "is heat.wall_flux = 1 in W/m2, not in kW/m2 or W?"),
        (HOT, {"heat.wall_flux": 1e6}, "is heat.wall_flux = 1e+06 in W/m2"),
        (HOT, {"heat.prandtl": 7.1}, "is heat.prandtl = 7.1 in SI units?"),
        (HOT, {"heat.heat_capacity": 100.0}, "is heat.heat_capacity = 100 in SI units?"),
        (
            HOT,
            {
                "solution": "developing",
                "heat.wall": "temperature",
                "heat.wall_temperature": 120.0,
            },
            "is heat.wall_temperature = 120 in K?",
        ),
        (
            TUBE,
            {"operation.gas_superficial_velocity": 3.85e-5},
            "the gas moves no plug; is operation.gas_superficial_velocity = 3.85e-05 in m/s",
        ),
        (
            TUBE,
            {"walls.contact": {"model": "viscous-coulomb", "stiffness": 1e-2}},
            "is walls.contact.stiffness in N/m, not in N/mm?",
        ),
        (
            TUBE,
            {"closures.contact": {"model": "hertz-mindlin", "young_modulus": 210.0}},
            "is closures.contact.young_modulus in Pa, not in MPa or GPa?",
        ),
    ],
)
def test_one_sentence_tells_a_slip_by_its_key(
    tables: dict[str, Any], changes: dict[str, Any], word: str
) -> None:
    case = Case.from_dict(tables)
    assert doubts(case.scene.derived()) == []
    (told,) = doubts(case.with_values(changes).scene.derived())
    assert word in told


@pytest.mark.parametrize(
    ("tables", "changes", "key", "word"),
    [
        (IN_TIME, {"operation.gas_schedule": [[0.0, 0.0]]}, "operation.gas_schedule", "one above"),
        (
            IN_TIME,
            {"operation.solids_schedule": [[0.0, 0.0], [math.inf, 1.0]]},
            "operation.solids_schedule",
            "times that grow",
        ),
        (LINE, {"solids.packing_limit": 0.37}, "solids.packing_limit", "solids.friction_limit"),
        (LINE, {"gas.pressure": 1e9}, "gas.pressure", "at most 2000"),
        (
            LINE,
            {"closures.friction": {"model": "mu-i", "mu_s": 0.64, "mu_2": 0.38}},
            "closures.friction.mu_2",
            "at least mu_s",
        ),
        (TUBE, {"solids.density": 0.937}, "solids.density", "in kg/m3, not in g/cm3; with it"),
        (TUBE, {"numerics.time_step": 2e-11}, "numerics.time_step", "a contact takes"),
        (LINE, {"geometry.radius": 0.03}, "geometry.radius", "'geometry.diameter'"),
        (
            LINE,
            {"solution": "developing", "numerics.axial_step": 1e3},
            "numerics.axial_step",
            "a step up to geometry.length",
        ),
        (
            LINE,
            {"operation.gas_velocity": 3.0},
            "operation.gas_velocity",
            "'operation.gas_superficial_velocity'",
        ),
    ],
)
def test_what_cannot_be_is_refused_by_its_key(
    tables: dict[str, Any], changes: dict[str, Any], key: str, word: str
) -> None:
    with pytest.raises(InputError, match=word) as caught:
        Case.from_dict(tables).with_values(changes)
    assert caught.value.key == key


def test_a_run_of_days_is_told() -> None:
    scene = Case.from_dict(IN_TIME).scene
    assert scene.describe()["warnings"] == "none"
    slow = Case.from_dict(IN_TIME).with_values({"numerics.largest_time_step": 1e-9}).scene
    assert any("days of CPU time" in text for text in slow.describe()["warnings"])


def test_a_width_takes_the_place_of_a_diameter() -> None:
    case = Case.from_dict(LINE).with_values({"geometry.shape": "duct", "geometry.width": 0.05})
    assert case["geometry.width"] == 0.05


def test_a_slow_gas_is_not_doubted_where_laminar_or_where_solids_decide() -> None:
    slow = {"operation.gas_superficial_velocity": 0.3}
    laminar = {"closures.turbulence": "laminar", "walls.gas": "no-slip"}
    assert Case.from_dict(GAS_ALONE).with_values(slow | laminar).scene.warnings() == []
    solids = {"solids": {"density": 1400.0, "diameter": 1e-3}}
    feed = {"gas_superficial_velocity": 0.3, "solids_fraction": 0.2}
    dense = Case.from_dict(GAS_ALONE | solids | {"operation": feed})
    assert not any("turbulent" in text for text in dense.scene.warnings())


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("gas.viscosity", 1e-300),
        ("gas.pressure", 1e-300),
        ("solids.diameter", 1e-12),
        ("solids.density", 1e-300),
    ],
)
def test_what_no_material_has_is_refused_with_its_key(key: str, value: float) -> None:
    with pytest.raises(InputError) as caught:
        riser().with_values({key: value})
    assert caught.value.key == key


@pytest.mark.parametrize("gravity", [1e-300, 1e-9, 1000.0])
@pytest.mark.parametrize("diameter", [1e-9, 1e-4, 0.04])
@pytest.mark.parametrize("viscosity", [1e-12, 1.8e-5, 1.0])
def test_correlations_have_a_value_within_the_bounds_of_keys(
    gravity: float, diameter: float, viscosity: float
) -> None:
    gas, grain = Gas(density=1.2, viscosity=viscosity), Solids(density=2500.0, diameter=diameter)
    speed = terminal_velocity(gas, grain, gravity)
    assert 0 < speed <= (2500.0 - 1.2) * gravity * diameter**2 / (18 * viscosity) * 1.000001
    assert math.isfinite(rizk_velocity(0.1, 0.05, gas, grain, gravity))
    assert math.isfinite(cunningham(gas, diameter))


def test_check_tells_the_numbers_and_the_slip(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = tmp_path / "case.toml"
    place.write_text(riser().dump())
    assert main(["check", str(place), "--set", "gas.temperature=20"]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "Reynolds number of the gas" in told and "terminal velocity of a grain" in told
    assert "is gas.temperature = 20 in K, not in degrees Celsius?" in told


def test_a_gas_next_to_a_vacuum_in_a_level_line_is_checked(tmp_path: Path) -> None:
    """Its Reynolds number is below what the friction of a turbulent gas is for."""
    place = tmp_path / "case.toml"
    place.write_text(riser(geometry__inclination_deg=0.0).dump())
    assert main(["check", str(place), "--set", "gas.pressure=1"]) == 0


@pytest.mark.parametrize("verb", ["check", "run"])
@pytest.mark.parametrize(
    ("change", "number"),
    [
        ("operation.solids_mass_flow=360", "a superficial velocity of 73.34 m/s beside gas"),
        ("numerics.mesh_size=1e-9", "expected from 2.5e-05 to 0.025 m"),
        ("numerics.level=12", "the machine has 8000 MB"),
    ],
)
def test_check_and_run_refuse_the_same(
    verb: str,
    change: str,
    number: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(memory, "machine_memory", lambda: 8000.0)
    place = tmp_path / "case.toml"
    place.write_text(riser().dump())
    more = ["--out", str(tmp_path / "out")] if verb == "run" else []
    assert main([verb, str(place), "--set", change, *more]) == 2
    assert number in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_an_unsteady_mesh_beyond_the_machine_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "machine_memory", lambda: 2000.0)
    changes = {"solution": "unsteady", "numerics.end_time": 1.0, "numerics.axial_cells": 100}
    riser(**changes).scene.examine()
    with pytest.raises(InputError, match="a line shorter than 200 diameters: it needs about"):
        riser(**changes, numerics__level=8).scene.examine()


@pytest.mark.parametrize("level", [1, 5, 7])
def test_cells_are_foreseen_without_the_mesh(level: int) -> None:
    physics = riser(numerics__level=level).scene.physics
    cells, _ = physics.size
    assert section_cells(physics.section, physics.resolution) == pytest.approx(cells, rel=0.25)


@pytest.mark.parametrize(
    ("density", "diameter", "width", "loading", "speed", "pressure", "published"),
    [
        (1400.0, 1e-3, 0.05, 5.0, 20.0, 1e5, 11.3),
        (1470.0, 7e-5, 0.08, 5.0, 18.0, 1.4e5, 12.1),
        (920.0, 3e-3, 0.10, None, 23.0, 1e5, 16.1),
    ],
)
def test_saltation_velocity(
    density: float,
    diameter: float,
    width: float,
    loading: float | None,
    speed: float,
    pressure: float,
    published: float,
) -> None:
    air = Gas.species("air", pressure)
    flow = 1.0 if loading is None else loading * air.density * math.pi / 4 * width**2 * speed
    found = rizk_velocity(flow, width, air, Solids(density=density, diameter=diameter), 9.81)
    assert found == pytest.approx(published, rel=0.03)


def test_terminal_velocity_of_a_fine_grain_is_that_of_stokes() -> None:
    air, grain = Gas(density=1.2, viscosity=1.8e-5), Solids(density=2500.0, diameter=1e-5)
    stokes = (2500.0 - 1.2) * 9.81 * 1e-10 / (18 * 1.8e-5)
    assert terminal_velocity(air, grain, 9.81) == pytest.approx(stokes, rel=0.01)
    assert terminal_velocity(air, grain, 0.0) == 0.0


@pytest.mark.parametrize(
    ("diameter", "factor"), [(1e-9, 1.657), (1e-5, 1.257), (1.32e-7, 1.257 + 0.4 * math.exp(-1.1))]
)
def test_slip_of_air_along_a_grain(diameter: float, factor: float) -> None:
    """(C - 1)/Kn with a mean free path of 0.066 um in air of 20 C and 1 atm; sound at 343.2 m/s."""
    air = Gas.species("air", 101_325.0)
    slip = cunningham(air, diameter) - 1
    assert slip * diameter / (2 * 0.066e-6) == pytest.approx(factor, rel=0.03)
    assert sound_speed(air) == pytest.approx(343.2, rel=2e-3)
    assert sound_speed(Gas(density=33.2, viscosity=1.7e-5)) == 343.0


@pytest.mark.parametrize(
    ("change", "cured"),
    [
        ({}, True),
        ({"geometry.inclination_deg": 90.0}, False),
        ({"closures.theta": "algebraic"}, False),
        ({"walls.solids": "johnson-jackson"}, False),
    ],
)
def test_the_rough_wall_is_named_where_it_acts(change: dict[str, Any], cured: bool) -> None:
    """A line that rubs too little; in risers, or without heat of the wall, it adds little."""
    scene = riser(geometry__inclination_deg=0.0).with_values(change).scene
    parts = {"drop_gas_friction": 1.0, "drop_solids_friction": 1.0}
    (told,) = out_of_range(scene, {"holdup": 1e-3, "solids_mass_flow": 0.1, **parts})
    assert ("walls.solids = 'rough'" in told) == cured


@pytest.mark.parametrize(
    ("wall", "heats"),
    [(name, name not in ("free-slip", "no-slip")) for name in names("solids-wall")],
)
def test_an_algebraic_theta_is_told_to_have_no_heat_of_the_wall(wall: str, heats: bool) -> None:
    case = riser(closures__theta="algebraic", walls__solids=wall)
    assert any("heat of the wall" in text for text in case.scene.skipped()) == heats
    assert any("its friction alone" in text for text in case.scene.advice()) == (wall == "rough")
    transported = case.with_values({"closures.theta": "transport"}).scene
    told = [*transported.skipped(), *transported.advice()]
    assert not any("heat of the wall" in text or "friction alone" in text for text in told)


# -- time ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("solution", ["developed", "developing", "unsteady"])
def test_a_doubt_is_the_likely_cause_where_there_is_no_answer(
    solution: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    more = {"numerics.end_time": 1.0} if solution == "unsteady" else {}
    feed = {"operation.solids_fraction": 0.01, "operation.solids_velocity": 0.1}
    case = riser(**{"solution": solution, **more, **feed})

    def failing(*given: Any) -> Any:
        raise SolverError("no convergence")

    monkeypatch.setattr(type(case.scene), "solve", failing)
    with pytest.raises(SolverError, match=r"^no convergence$"):
        case.scene.run()
    with pytest.raises(SolverError, match=r"likely cause: terminal .* than a grain falls"):
        case.with_values({"operation.gas_superficial_velocity": 0.5}).scene.run()


@pytest.mark.parametrize(
    "solution", ["developed", pytest.param("developing", marks=pytest.mark.slow), "unsteady"]
)
def test_a_run_ends_at_its_time_limit_and_goes_on(solution: str, tmp_path: Path) -> None:
    changes = {"solution": solution, "numerics.level": 1, "geometry.length": 0.2}
    if solution == "unsteady":
        changes |= {"numerics.end_time": 0.02, "numerics.axial_cells": 10, "output.interval": 0.01}
    case = riser(**{**changes, "output.pictures": False})
    limited = case.with_values({"numerics.time_limit": 1e-6})
    with pytest.raises(
        SolverError, match=r"numerics\.time_limit = 1e-06 s is over; its last state"
    ):
        limited.scene.run(tmp_path / "run")
    told = json.loads((tmp_path / "run" / "result.json").read_text())
    assert told["status"] == "interrupted" and "time_limit" in told["reason"]
    rest = case.scene.run(tmp_path / "run", resume=True)
    whole = case.scene.run()
    assert rest["pressure_drop"] == pytest.approx(whole["pressure_drop"], rel=1e-6)


@pytest.mark.parametrize("tables", [RISER, GAS_ALONE, TUBE])
@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"operation.gravity": 32.2}, "gravity 32.2 m/s2: is operation.gravity in m/s2, not in ft"),
        ({"geometry.inclination_deg": 1.5708}, "in degrees, not in radians (90 deg)?"),
        ({"geometry.inclination_deg": -0.7854}, "in degrees, not in radians (-45 deg)?"),
    ],
)
def test_a_line_doubts_its_angles_and_gravity(
    tables: dict[str, Any], changes: dict[str, Any], word: str
) -> None:
    found = Case.from_dict(tables).with_values(changes).scene.derived()
    assert any(word in text for text in doubts(found))


@pytest.mark.parametrize("tables", [RISER, GAS_ALONE, TUBE])
@pytest.mark.parametrize("angle", [0.0, 1.0, 5.0, 45.0, -90.0])
def test_slopes_in_degrees_are_not_doubted(tables: dict[str, Any], angle: float) -> None:
    found = Case.from_dict(tables).with_values({"geometry.inclination_deg": angle}).scene.derived()
    assert not any("radians" in number.doubt for number in found)


def test_a_wide_or_very_long_line_is_doubted() -> None:
    wide = {"geometry.diameter": 5.0, "geometry.length": 20.0}
    assert any("hydraulic diameter 5 m" in text for text in riser(**wide).scene.warnings())
    tube = Case.from_dict(TUBE).with_values({"geometry.length": 150.0})
    assert any("geometry.length = 150 in m, not in mm?" in t for t in tube.scene.warnings())


def test_a_light_solid_is_named_where_its_flux_is_refused() -> None:
    with pytest.raises(InputError, match=r"solids.density = 1.4 is in kg/m3, not g/cm3"):
        riser(solids__density=1.4, operation__solids_mass_flow=1.0).scene.examine()


def test_grains_beyond_the_memory_of_the_machine_are_refused() -> None:
    with pytest.raises(InputError, match=r"geometry.length.* needs about .* MB of memory"):
        Case.from_dict(TUBE).with_values({"geometry.diameter": 7.0})

# SPDX-License-Identifier: LGPL-3.0-or-later
"""One meaning of the pressure drop in every solution, and the parts that sum to it."""

from __future__ import annotations

import functools
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from boxes import box, flow, immovable
from problems import demo

from fem_tfm import Case
from fem_tfm.errors import InputError
from fem_tfm.models.finite_volume import Inflow, UnsteadyFlow
from fem_tfm.models.two_fluid.split import OMITTED
from fem_tfm.output import split_picture
from fem_tfm.output.result import Result

G, DENSITY = 9.81, 50.0
# of a flow whose solids pressure acts in full
PARTS = [name for name in split_picture.PARTS if name != OMITTED]
# of a smooth pipe, by the section and by Prandtl and von Karman
FRICTION = 28.7
HEAVY_GAS: dict[str, Any] = {
    "geometry": {"diameter": 0.05, "length": 1.0},
    "gas": {"density": DENSITY, "viscosity": 1.8e-5},
    "operation": {"gas_superficial_velocity": 2.0},
    "numerics": {"level": 1},
    "output": {"pictures": False, "xdmf": False},
}
# nearly the same density along the line
IDEAL = {"gas": {"gas_constant": 287.0, "pressure": 4204550.0, "viscosity": 1.8e-5}}
STEPS = {"axial_cells": 20, "end_time": 1.5, "courant": 2.0}


def parts_of(found: Any) -> dict[str, float]:
    """The parts of a drop that an answer tells."""
    return {name: found[name] for name in PARTS if name in found}


@functools.cache
def heavy_gas(solution: str, angle: float, ideal: bool = False) -> Result:
    """Heavy gas in an inclined pipe."""
    given = HEAVY_GAS | {"solution": solution}
    given["geometry"] = given["geometry"] | {"inclination_deg": angle}
    if solution == "unsteady":
        given["numerics"] = given["numerics"] | STEPS
    if ideal:
        given["gas"] = IDEAL["gas"] | ({"compressible": True} if solution == "unsteady" else {})
    return Case.from_dict(given).scene.run()


@pytest.mark.parametrize("solution", ["developed", "developing", "unsteady"])
@pytest.mark.parametrize("angle", [90.0, 30.0, -90.0])
def test_the_drop_holds_the_weight_of_the_gas(solution: str, angle: float) -> None:
    """519.2 Pa/m upwards, -461.8 downwards; friction is less in a short entrance."""
    found, weight = heavy_gas(solution, angle), DENSITY * G * math.sin(math.radians(angle))
    assert found["pressure_drop"] - weight == pytest.approx(FRICTION, rel=0.06)
    assert found["pressure_gradient"] - weight == pytest.approx(FRICTION, rel=0.06)
    parts = parts_of(found)
    assert sum(parts.values()) == pytest.approx(found["pressure_drop"], rel=1e-6)
    assert parts["drop_lift"] == pytest.approx(weight, rel=1e-9)
    assert parts["drop_gas_friction"] == pytest.approx(FRICTION, rel=0.02)


def test_the_drop_of_an_ideal_gas_holds_its_weight() -> None:
    found = heavy_gas("unsteady", 90.0, ideal=True)
    assert found["pressure_drop"] == pytest.approx(
        heavy_gas("unsteady", 90.0)["pressure_drop"], 1e-3
    )
    assert found["drop_lift"] == pytest.approx(DENSITY * G, rel=1e-3)


def test_the_fields_of_an_unsteady_flow_hold_the_weight(tmp_path: Path) -> None:
    """Probes and sections read these fields."""
    given = HEAVY_GAS | {"solution": "unsteady"}
    given["geometry"] = given["geometry"] | {"inclination_deg": 90.0}
    given["numerics"] = given["numerics"] | STEPS
    given["output"] = given["output"] | {"probes": [[0.001, 0, 0.525]], "sections": [0.525]}
    result = Case.from_dict(given).scene.run(tmp_path / "run")
    wanted = result["pressure_drop"] * 0.475
    for name, column in (("probes.csv", "pressure_1 [Pa]"), ("sections.csv", "pressure [Pa]")):
        head, *rows = (tmp_path / "run" / name).read_text().splitlines()
        last = dict(zip(head.split(","), rows[-1].split(","), strict=True))
        assert float(last[column]) == pytest.approx(wanted, rel=2e-3)


def test_the_pressure_of_a_section_is_that_at_its_place(tmp_path: Path) -> None:
    """Not that of the middle of the layer: from the inlet's face to the outlet's it is linear."""
    given = HEAVY_GAS | {"solution": "unsteady"}
    given["geometry"] = given["geometry"] | {"inclination_deg": 90.0}
    given["numerics"] = given["numerics"] | STEPS | {"end_time": 0.3}
    places = [0.0, 0.11, 0.45, 0.9, 1.0]
    given["output"] = given["output"] | {"sections": places}
    result = Case.from_dict(given).scene.run(tmp_path / "run")
    head, *rows = (tmp_path / "run" / "sections.csv").read_text().splitlines()
    column = head.split(",").index("pressure [Pa]")
    found = [float(row.split(",")[column]) for row in rows[-len(places) :]]
    assert found[0] == pytest.approx(result["pressure_drop"], rel=1e-4)
    assert found == pytest.approx([490.5 * (1 - z) for z in places], abs=40.0 * 1.1)
    weightless = [p - 490.5 * (1 - z) for p, z in zip(found, places, strict=True)]
    assert weightless == sorted(weightless, reverse=True)
    assert weightless[-1] == pytest.approx(0.0, abs=0.2)


def test_a_bend_upwards_lifts_the_gas() -> None:
    """The legs rise by the leg behind the bend and the radius of its axis."""
    bend = {"shape": "bend", "diameter": 0.05, "length": 1.0, "bend_radius": 0.15}
    given = HEAVY_GAS | {"solution": "unsteady", "geometry": bend}
    given["numerics"] = given["numerics"] | STEPS | {"axial_cells": 40}
    drops = []
    for gravity in (0.0, G):
        given["operation"] = given["operation"] | {"gravity": gravity}
        drops.append(Case.from_dict(given).scene.run()["pressure_drop"])
    leg = (1.0 - 0.15 * math.pi / 2) / 2
    assert drops[1] - drops[0] == pytest.approx(DENSITY * G * (leg + 0.15), rel=2e-3)


def bed(cells: int, order: int) -> tuple[UnsteadyFlow, float]:
    """A fixed bed that thins out from the inlet on, and its drop by Ergun cell by cell [Pa]."""
    speed, length = 0.5, 0.1
    found = flow(box((0.02, 0.02, length), (1, 1, cells)), order=order)
    found.laws.solids = immovable(found.solids)
    alpha = 0.6 - 2.0 * found.cells.centre[:, 2]
    found.initialise(alpha)
    for _ in range(40):
        found.advance(2e-2, Inflow(speed))
    law, wanted = found.problem.closures.drag, 0.0
    for a in alpha:
        u = speed / (1 - a)
        wanted += law.beta(a, u, found.gas, found.solids) * u / (1 - a) * length / cells
    # the gas leaves slower than it comes in
    inner = found.gas.density * speed**2 * (1 / (1 - alpha.min()) - 1 / (1 - 0.6))
    return found, wanted + inner


@pytest.mark.parametrize("order", [0, 1])
@pytest.mark.parametrize("cells", [8, 32])
def test_the_drop_of_a_bed_at_the_inlet_runs_from_face_to_face(cells: int, order: int) -> None:
    """From the centres of the first cells it would lack 1/(2 cells) and more."""
    found, wanted = bed(cells, order)
    assert found.quantities()["pressure_drop"] == pytest.approx(wanted, rel=4 / cells**2)


def test_the_parts_of_a_developed_section_sum_to_its_drop() -> None:
    """Inclined, with solids; walls that impose a velocity have their force by the balance."""
    for walls in ({}, {"walls.gas": "no-slip", "walls.solids": "no-slip"}):
        changes = {"numerics.level": 1, "geometry.inclination_deg": 40.0} | walls
        found = demo(changes | {"closures.turbulence": "laminar"}).scene.run()
        parts = parts_of(found)
        assert list(parts) == PARTS
        assert sum(parts.values()) == pytest.approx(found["pressure_drop"], rel=1e-6)
        assert min(parts[name] for name in PARTS if name != "drop_acceleration") > 0


@pytest.mark.slow
def test_the_parts_of_a_march_sum_to_its_drop_everywhere(tmp_path: Path) -> None:
    changes = {
        "solution": "developing",
        "numerics.level": 1,
        "numerics.mesh_size": 2.5e-3,
        "geometry.length": 0.1,
        "geometry.inclination_deg": 20.0,
        "operation.solids_fraction": 0.2,
        "operation.solids_velocity": 5.0,
    }
    found = demo(changes).scene.run(tmp_path / "run")
    table = found.sections["axis"]
    total = sum(table[name] for name in PARTS)
    assert total == pytest.approx(table["pressure"][0] - table["pressure"], rel=1e-6, abs=1e-6)
    assert found["drop_acceleration"] == table["drop_acceleration"][-1] > 1000
    # and it is told and drawn
    told = json.loads((tmp_path / "run" / "result.json").read_text())["quantities"]
    assert told.keys() >= set(PARTS)
    assert (tmp_path / "run" / "split.png").stat().st_size > 5000


def test_the_parts_of_an_unsteady_line_are_those_of_the_march() -> None:
    unsteady, march = (parts_of(heavy_gas(s, 90.0)) for s in ("unsteady", "developing"))
    assert unsteady["drop_gas_friction"] == pytest.approx(march["drop_gas_friction"], rel=0.02)
    # the first cells blur the profile of the inlet
    gained = 0.01 * DENSITY * 2.0**2
    assert unsteady["drop_acceleration"] == pytest.approx(
        march["drop_acceleration"], abs=3 * gained
    )


def test_the_impulse_of_the_first_step_is_no_drop(tmp_path: Path) -> None:
    given = HEAVY_GAS | {"solution": "unsteady"}
    given["numerics"] = given["numerics"] | STEPS | {"end_time": 0.02}
    Case.from_dict(given).scene.run(tmp_path / "run")
    head, *rows = (tmp_path / "run" / "monitor.csv").read_text().splitlines()
    column = [row.split(",")[head.split(",").index("pressure_drop [Pa]")] for row in rows]
    assert column[0] == ""
    # impulse over step: 50 kg/m3 * 2 m/s * 1 m / dt
    assert max(float(value) for value in column[1:]) < 0.05 * 100.0 / float(rows[0].split(",")[1])


def test_an_answer_of_one_step_has_no_drop() -> None:
    given = HEAVY_GAS | {"solution": "unsteady"}
    given["numerics"] = given["numerics"] | STEPS | {"end_time": 1e-4, "time_step": 1e-4}
    given["output"] = given["output"] | {"interval": 1e-4}
    found = Case.from_dict(given).scene.run()
    assert math.isnan(found["pressure_drop"]) and math.isnan(found["pressure_gradient"])
    assert np.isfinite(found["gas_mass_flow"])


BEND = {"shape": "bend", "diameter": 0.05, "length": 1.0, "bend_radius": 0.15}


@pytest.mark.parametrize(
    ("key", "value", "geometry"),
    [
        ("output.sections", [0.5, 1.01], {}),
        ("output.sections", [-0.1], {}),
        ("output.probes", [[0.0, 0.0, 1.01]], {}),
        ("output.probes", [[0.03, 0.0, 0.5]], {}),
        ("output.probes", [[-0.01, 0.0, 0.5]], {}),
        ("output.probes", [[0.0, 0.0, 0.9]], BEND),
        ("output.probes", [[0.0, 0.03, 0.5]], {"shape": "duct", "width": 0.05}),
        ("initial.bed_end", 1.01, {}),
        ("initial.bed_height", 0.06, {}),
    ],
)
def test_places_outside_of_the_line_are_refused(key: str, value: Any, geometry: Any) -> None:
    given = HEAVY_GAS | {"solution": "unsteady"}
    given["numerics"] = given["numerics"] | STEPS
    if geometry:
        given["geometry"] = {"length": 1.0} | geometry
    given["solids"] = {"density": 2500.0, "diameter": 1e-3}
    given["operation"] = given["operation"] | {"solids_fraction": 0.1, "solids_velocity": 1.0}
    with pytest.raises(InputError) as refused:
        Case.from_dict(given).with_values({"initial.state": "bed", key: value})
    assert refused.value.key == key


@pytest.mark.parametrize(
    ("key", "value", "geometry"),
    [
        ("output.sections", [0.0, 1.0], {}),
        ("output.probes", [[0.01, -0.01, 0.5]], {}),
        ("output.probes", [[0.0, 0.45, 0.5322]], BEND),
    ],
)
def test_places_in_the_line_are_taken(key: str, value: Any, geometry: Any) -> None:
    given = HEAVY_GAS | {"solution": "unsteady"}
    given["numerics"] = given["numerics"] | STEPS
    if geometry:
        given["geometry"] = geometry
    assert Case.from_dict(given).with_values({key: value})[key] is not None

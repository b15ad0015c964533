# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives by the adjoint against the answers of neighbouring cases."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from fem_tfm.case import Case
from fem_tfm.errors import InputError
from fem_tfm.output.result import Result
from fem_tfm.scenes.judged import inputs
from fem_tfm.scenes.scene import Answer
from fem_tfm.study.sensitivity import Sensitivity, sensitivities


def solved(case: Case, previous: Answer | None = None) -> Answer:
    return case.scene.solve(case.scene.recorder(), previous)


@pytest.fixture
def upward(dense: dict[str, Any]) -> Case:
    """A rising line fed by mass, so that weight and feed depend on the densities too."""
    geometry = {**dense["geometry"], "inclination_deg": 10.0}
    operation = {"gas_superficial_velocity": 6.43, "solids_mass_flow": 0.194}
    walls = {"distance": 1e-4, "solids": {"model": "schneiderbauer", "sliding_heat": 1.0}}
    numerics = {"level": 1, "tolerance": 1e-11}
    return Case.from_dict(
        {**dense, "geometry": geometry, "operation": operation, "walls": walls}
        | {"numerics": numerics, "closures": {"drag": {"model": "three-zone", "C": 1.0}}}
    )


@pytest.mark.mpi
def test_the_adjoint_agrees_with_neighbouring_answers(upward: Case) -> None:
    keys = ("solids.density", "gas.density", "solids.diameter", "closures.drag.C", "walls.distance")
    answer = solved(upward)
    section = answer.state.solution.section
    before, setup = section.now.x.array.copy(), section.setup
    found = sensitivities(upward, answer, keys)
    assert (section.now.x.array == before).all() and section.setup == setup
    for one in found:
        gradients = []
        for factor in (0.998, 1.002):
            case = upward.with_values({one.key: factor * one.value})
            answer = solved(case, answer)
            assert answer.start == "warm"
            gradients.append(answer.quantities["pressure_gradient"])
        measured = (gradients[1] - gradients[0]) / (0.004 * one.gradient)
        assert one.relative == pytest.approx(measured, rel=0.02, abs=1e-4), one.key


def test_a_number_at_the_end_of_its_range_has_a_derivative_too(upward: Case) -> None:
    key = "walls.solids.sliding_heat"
    answer = solved(upward)
    (share,) = sensitivities(upward, answer, [key])
    less = upward.with_values({key: 0.99})
    gradient = solved(less, answer).quantities["pressure_gradient"]
    assert share.change(1.0, 0.99) == pytest.approx(gradient / share.gradient - 1, rel=0.05)


def test_what_is_no_number_or_moves_the_mesh_is_refused(upward: Case) -> None:
    answer = solved(upward)
    with pytest.raises(InputError, match="has a number"):
        sensitivities(upward, answer, ["closures.friction"])
    with pytest.raises(InputError, match="leaves the mesh"):
        sensitivities(upward, answer, ["geometry.diameter"])


def test_a_gas_section_has_sensitivities_too(root: Path) -> None:
    """The density counts in the Reynolds number, and as the factor of the kinematic gradient."""
    case, key = Case.load(root / "demos/square_duct/gas.toml", ["numerics.level=1"]), "gas.density"
    answer = solved(case)
    (density,) = sensitivities(case, answer, [key])
    near = solved(case.with_values({key: 1.2 * 1.002}), answer).quantities["pressure_gradient"]
    assert 0.7 < density.relative < 1.0
    assert density.change(1.2, 1.2 * 1.002) == pytest.approx(near / density.gradient - 1, rel=0.02)


@pytest.mark.parametrize("demo", ["dense_pipe/developing", "dense_pipe/bend90"])
def test_a_scene_without_sensitivities_says_which_has_them(root: Path, demo: str) -> None:
    case = Case.load(root / f"demos/{demo}.toml")
    none = Answer("finished", {}, {}, "pressure_drop")
    with pytest.raises(InputError, match="expected 'developed', the solution that tells"):
        sensitivities(case, none, ["solids.diameter"])


# -- ranges of inputs that are not printed -------------------------------------------------------


FRICTION = "walls.solids.friction_coefficient"
RANGES = [
    {"key": FRICTION, "low": 0.48, "high": 0.51, "reason": "a slope"},
    {"key": "gas.density", "low": 33.0, "high": 33.5, "reason": "a thermometer"},
]


def test_ranges_of_inputs_stand_beside_the_answer(upward: Case, tmp_path: Path) -> None:
    """What they move it by is what neighbouring answers say, in result.json as well."""
    case = Case.from_dict({**upward.given, "uncertain": RANGES, "output": {"pictures": False}})
    result = case.scene.run(tmp_path / "out")
    wall, density = Result.read(tmp_path / "out").inputs
    assert (wall.key, wall.low, wall.high) == (FRICTION, 0.48, 0.51)
    answer = solved(upward)
    gradient = answer.quantities["pressure_gradient"]
    ends = []
    for end in (0.48, 0.51):
        answer = solved(upward.with_values({FRICTION: end}), answer)
        ends.append(answer.quantities["pressure_gradient"] / gradient - 1)
    assert [wall.down, wall.up] == pytest.approx(ends, rel=0.05)
    # the density lies at the upper end of its range
    assert density.down < 0 == density.up
    span = result.input_range("pressure_drop")
    assert span is not None and span[0] < result["pressure_drop"] < span[1]
    drop = math.hypot(wall.down, density.down)
    assert span[0] == pytest.approx(result["pressure_drop"] * (1 - drop))
    assert result.input_range("holdup") is None


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"key": "solids.diametre"}, "uncertain\\[0\\].key = 'solids.diametre'"),
        ({"key": "closures.friction"}, "has a number"),
        ({"key": "geometry.diameter", "low": 0.009, "high": 0.011}, "leaves the mesh"),
        ({"low": 0.52}, "uncertain\\[0\\]"),
        ({"low": 0.505}, "around walls.solids.friction_coefficient = 0.5"),
        ({"reason": ""}, "where the range is from"),
    ],
)
def test_a_range_of_what_is_no_number_is_refused(
    upward: Case, changes: dict[str, Any], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        Case.from_dict({**upward.given, "uncertain": [{**RANGES[0], **changes}]})


@pytest.mark.parametrize("name", ["quartz", "0"])
def test_numbers_of_particles_do_not_move_the_gas(root: Path, name: str) -> None:
    """A key that leads into an array of tables is found, put and told to be of no effect."""
    case = Case.load(root / "demos/square_duct/particles.toml")
    key, scene = f"particles.materials.{name}.density", case.scene
    value = inputs.number(scene, key)
    (changed, *others), (before, *left) = (
        s.particles.materials for s in (inputs.with_number(scene, key, value + 1), scene)
    )
    assert (changed.density, others) == (before.density + 1, left)
    words = "particles leave that of a section as it is"
    with pytest.raises(InputError, match=words):
        inputs.neighbours(scene, key)
    one = {"key": key, "low": value - 100, "high": value + 100, "reason": "another sand"}
    with pytest.raises(InputError, match=rf"uncertain\[0\].key = .*{words}"):
        Case.from_dict({**case.given, "uncertain": [one]})


def test_a_number_that_is_set_has_no_range_any_more(upward: Case) -> None:
    case = Case.from_dict({**upward.given, "uncertain": RANGES})
    (left,) = case.with_values({FRICTION: 0.3}).scene.uncertain
    assert left.key == "gas.density"
    assert len(case.with_values({"walls.solids": "coulomb"}).scene.uncertain) == 1
    both = {FRICTION: 0.3, "gas.density": 30.0}
    assert case.with_values(both).scene.uncertain == ()
    # another solution has no adjoint, and so no ranges
    unsteady = {"solution": "unsteady", "numerics.end_time": 0.1, "numerics.tolerance": None}
    given = {"operation.solids_fraction": 0.2, "operation.solids_velocity": 6.0}
    assert not hasattr(case.with_values({**unsteady, **given}).scene, "uncertain")


def test_a_change_is_relative_to_the_gradient() -> None:
    one = Sensitivity("solids.density", 1700.0, -0.3, 2000.0)
    assert one.relative == pytest.approx(-0.255)
    assert one.change(1700.0, 1500.0) == pytest.approx(0.03)

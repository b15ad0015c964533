# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is no answer is not called one, and an answer says what it does not hold for."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from fem_tfm import Case
from fem_tfm.cli import main
from fem_tfm.errors import SolverError
from fem_tfm.output.summary import MESH_NOTE, error_notes
from fem_tfm.scenes import dense
from fem_tfm.scenes.developed import ONE_MESH
from fem_tfm.scenes.judged import answer as judged
from fem_tfm.scenes.judged import finer
from fem_tfm.scenes.judged.answer import judge, with_expansion
from fem_tfm.solvers.easing import MeshTerms

AIR = {"species": "air", "pressure": 1.2e5}
LINE: dict[str, Any] = {
    "geometry": {"diameter": 0.05, "length": 1000.0},
    "gas": AIR,
    "operation": {"gas_superficial_velocity": 20.0, "outlet_pressure": 1.2e5},
    "numerics": {"level": 1},
}
COAL = {
    "solids": {"density": 1400.0, "diameter": 1.0e-3},
    "operation": LINE["operation"] | {"solids_mass_flow": 0.28},
}


def found(**quantities: float) -> Any:
    """An answer without errors."""
    return SimpleNamespace(quantities=quantities, errors={})


def test_expansion_at_constant_temperature() -> None:
    """148,241 Pa of a gas of one density become 103.6 kPa; from 1.2 bar at the inlet none would."""
    assert with_expansion(148_241.0, 1.2e5, 1.2e5) == pytest.approx(103.6e3, rel=1e-3)
    # a small drop is that of the gas of one density
    assert with_expansion(10.0, 1.2e5, 1.2e5) == pytest.approx(10.0, rel=1e-3)
    assert math.isnan(with_expansion(-148_241.0, 1.2e5, 1.2e5))


def test_a_drop_beyond_the_absolute_pressure_is_no_answer() -> None:
    case = Case.from_dict(LINE | COAL)
    words = r"drop of (\S+) Pa is (\d+) % of the absolute pressure.*about (\S+) Pa"
    with pytest.raises(SolverError, match=words) as refusal:
        case.scene.run()
    drop, share, better = map(float, re.search(words, str(refusal.value)).groups())  # type: ignore[union-attr]
    assert drop == pytest.approx(1.475e5, rel=0.03)
    assert share == pytest.approx(100 * drop / 1.2e5, abs=0.6)
    assert better == pytest.approx(with_expansion(drop, 1.2e5, 1.2e5), rel=1e-3)


def test_a_drop_of_some_percent_of_the_pressure_warns_with_the_error() -> None:
    case = Case.from_dict(LINE | COAL).with_values({"geometry.length": 150.0})
    result = case.scene.run()
    (warning,) = [text for text in result.warnings if "absolute pressure" in text]
    drop = result["pressure_drop"]
    better = with_expansion(drop, 1.2e5, 1.2e5)
    assert f"about {better:.4g} Pa, an error of {drop - better:+.2g} Pa" in warning
    assert 1000.0 < drop - better < 3000.0


@pytest.mark.parametrize(
    ("drop", "warned", "refused"),
    [(0.09, False, False), (0.11, True, False), (0.39, True, False), (0.41, False, True)],
)
def test_the_limits_of_the_drop(drop: float, warned: bool, refused: bool) -> None:
    scene = Case.from_dict(LINE).scene
    given = found(pressure_drop=drop * 1.2e5)
    if refused:
        with pytest.raises(SolverError, match="no answer above 40 %"):
            judge(scene, given)
    else:
        assert bool(judge(scene, given)) == warned


def test_a_gas_by_its_density_has_the_pressure_of_air() -> None:
    """rho R T of 1.2 kg/m3 at 293 K is 100.9 kPa, R of air 287.06 J/kg/K."""
    tables = LINE | {"gas": {"density": 1.2, "viscosity": 1.8e-5}}
    scene = Case.from_dict(tables | {"operation": {"gas_superficial_velocity": 20.0}}).scene
    (told,) = judge(scene, found(pressure_drop=2e4))
    assert "20 % of the absolute pressure 1.009e+05 Pa at the outlet" in told
    assert "(that of air of this density)" in told
    with pytest.raises(SolverError, match="no answer above 40 %"):
        judge(scene, found(pressure_drop=3.97e5))


def test_a_flow_that_still_changes_at_its_outlet_says_so() -> None:
    scene = Case.from_dict(LINE).with_values({"geometry.length": 10.0}).scene
    (warning,) = judge(scene, found(development_length=9.93))
    assert "not developed at the outlet" in warning and "9.93 of 10 m" in warning
    assert judge(scene, found(development_length=8.9)) == []


# -- meshes that disagree --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("quantities", "errors", "doubted"),
    [
        ({"pressure_gradient": 142.5}, {"pressure_gradient": 220.0}, True),
        ({"pressure_gradient": 142.5}, {"pressure_gradient": 28.0}, False),
        ({"pressure_gradient": 142.5}, {"pressure_gradient": math.nan}, True),
        ({"pressure_gradient": 142.5}, {"pressure_gradient": None}, False),
        ({"pressure_gradient": 1.0, "holdup": 0.010}, {"holdup": 0.015}, True),
        # friction and weight that cancel are as exact as they are
        ({"pressure_gradient": 1.0, "drop_lift": -9e5, "drop_gas_friction": 9.01e5},
         {"pressure_gradient": 5.0}, False),
        ({"slip_velocity": 0.1}, {"slip_velocity": 5.0}, False),
    ],
)  # fmt: skip
def test_an_estimate_above_a_fifth_is_doubted(
    quantities: dict[str, float], errors: dict[str, float | None], doubted: bool
) -> None:
    given = SimpleNamespace(quantities=quantities, errors=errors)
    scene = Case.from_dict(LINE).scene
    if doubted:
        with pytest.raises(SolverError, match="the meshes disagree, so there is no answer"):
            judge(scene, given)
    else:
        judge(scene, given)


def test_an_error_that_is_known_is_not_called_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    """One mesh has none, but for that of raised terms of the mesh."""
    short = {"geometry.length": 10.0, "numerics.mesh_size": 0.01}
    case = Case.from_dict(LINE).with_values(short)
    assert case.scene.run().unestimated == ONE_MESH
    estimated = dense.estimated

    def of_terms(*given: Any) -> tuple[dict[str, float], dict[str, float | None]]:
        found, _ = estimated(*given)
        return found, {name: 1e-3 * abs(value) for name, value in found.items()}

    monkeypatch.setattr(dense, "estimated", of_terms)
    result = case.scene.run()
    assert result.unestimated == "" and error_notes(result) == [MESH_NOTE]


@pytest.mark.parametrize("alone", [True, False])
def test_an_error_of_raised_terms_alone_says_so(alone: bool) -> None:
    told = dense.raised_terms(SimpleNamespace(mesh_terms=MeshTerms(4.0)), alone)
    assert ("not the error of the one mesh" in told) == alone


def test_meshes_that_disagree_are_followed_by_finer_ones(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As if the gas alone had to be known to 0.2 %: level 1 does not, a finer mesh does."""
    case = Case.from_dict(LINE).with_values({"geometry.length": 10.0})
    usual = case.scene.run()
    assert usual.quantities["pressure_gradient"].error_estimate > 2e-3 * usual["pressure_gradient"]
    monkeypatch.setattr(judged, "LARGEST_ERROR", 2e-3)
    result = case.scene.run(tmp_path / "run", quiet=False)
    assert result.cells > 3 * usual.cells
    gradient = result.quantities["pressure_gradient"]
    assert gradient.error_estimate < 2e-3 * gradient.value
    assert any("this answer is from a finer one" in text for text in result.notes)
    assert "a finer mesh follows" in capsys.readouterr().out
    # its checkpoint belongs to the finer mesh
    again = case.scene.run(tmp_path / "run", resume=True)
    assert again.cells == result.cells
    assert again["pressure_gradient"] == pytest.approx(gradient.value, rel=1e-8)


@pytest.mark.parametrize(("level", "meshes"), [(1, 2), (2, 3), (3, 3)])
def test_a_mesh_too_coarse_for_a_bed_does_not_tell_the_error_of_another(
    level: int, meshes: int
) -> None:
    """Level 1 is a quick look and says so, level 2 takes a third mesh, level 3 has three."""
    root = Path(__file__).parents[2]
    scene = (
        Case.load(root / "demos/dense_pipe/algebraic.toml")
        .with_values({"numerics.level": level})
        .scene
    )
    answer = scene.solve(scene.recorder())
    assert answer.quantities["bed_fraction"] > 0.1
    assert len(answer.state.solution.levels) == meshes
    said = [text for text in answer.notes if "the coarser of the two meshes is too coarse" in text]
    assert len(said) == (level < 3)
    assert all(("raise numerics.level" in text) == (level == 1) for text in said)
    answer.close()


@pytest.mark.parametrize(
    ("bed", "densest", "holdup", "meshes", "size", "word"),
    [
        (0.1, 0.6, 0.1, 2, 0.1, "10 % of the section is a bed"),
        (0.002, 0.46, 0.01, 2, 0.1, "strand of fraction 0.46"),
        (0.002, 0.46, 0.01, 3, 0.1, ""),
        (0.002, 0.46, 0.01, 2, 0.05, ""),
        (0.0, 0.1, 0.01, 2, 0.1, ""),
        (0.0, 0.5, 0.3, 2, 0.1, ""),
    ],
)
def test_what_two_meshes_do_not_hold(
    bed: float, densest: float, holdup: float, meshes: int, size: float, word: str
) -> None:
    """A bed, or a strand far above the hold-up, where one of two meshes has large cells."""
    physics = SimpleNamespace(
        section=SimpleNamespace(hydraulic_diameter=1.0),
        resolution=SimpleNamespace(core_size=lambda section: size),
    )
    values = {"bed_fraction": bed, "max_solids_fraction": densest, "holdup": holdup}
    solution = SimpleNamespace(levels=[None] * meshes)
    said = finer.unresolved(physics, solution, {"quantities": values})  # type: ignore[arg-type]
    assert (word in said) if word else said == ""


def test_meshes_that_go_on_to_disagree_end_with_status_3(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(judged, "LARGEST_ERROR", 1e-9)
    place = tmp_path / "case.toml"
    place.write_text(Case.from_dict(LINE).with_values({"geometry.length": 10.0}).dump())
    assert main(["run", str(place), "--out", str(tmp_path / "run"), "--quiet"]) == 3
    assert "the meshes disagree, so there is no answer" in capsys.readouterr().err
    told = json.loads((tmp_path / "run" / "result.json").read_text())
    assert told["status"] == "failed" and not told["quantities"]


# -- references ------------------------------------------------------------------------------------

REFERENCE = [{"quantity": "pressure_drop", "value": 4260.0, "source": "experiment"}]


@pytest.mark.parametrize(
    ("key", "value", "kept"),
    [
        ("geometry.length", 0.5, False),
        ("solids.diameter", 2e-4, False),
        ("operation.gas_superficial_velocity", 5.0, False),
        ("gas.density", 30.0, False),
        ("geometry.diameter", 0.01, True),
        ("numerics.level", 1, True),
        ("closures.friction", "dartevelle", True),
        ("title", "the same flow", True),
    ],
)
def test_references_are_kept_while_the_flow_is_theirs(
    dense: dict[str, Any], tmp_path: Path, key: str, value: Any, kept: bool
) -> None:
    case = Case.from_dict(dense | {"reference": REFERENCE})
    assert bool(case.with_values({key: value}).scene.references) == kept
    place = tmp_path / "case.toml"
    place.write_text(case.dump())
    text = f'{key}="{value}"' if isinstance(value, str) else f"{key}={value}"
    assert bool(Case.load(place, [text]).scene.references) == kept


def test_a_reference_that_comes_with_the_change_is_kept(dense: dict[str, Any]) -> None:
    case = Case.from_dict(dense).with_values({"geometry.length": 0.5, "reference": REFERENCE})
    assert len(case.scene.references) == 1


def test_a_wall_law_of_dilute_flow_says_where_a_line_is_dense() -> None:
    scene = Case.from_dict(LINE).with_values({"walls.solids": "rough"}).scene
    (warning,) = judge(scene, found(holdup=0.19))
    assert "meant for a hold-up of up to 0.05, and this line has 0.19" in warning
    assert judge(scene, found(holdup=0.02)) == []
    assert judge(Case.from_dict(LINE).scene, found(holdup=0.19)) == []
    flow = {"operation.solids_mass_flow": None, "operation.solids_fraction": 0.19}
    given = Case.from_dict(LINE | COAL).with_values({"walls.solids": "rough"} | flow).scene
    assert any("this line has 0.19" in text for text in given.advice())
    assert judge(given, found(holdup=0.19)) == []


def test_a_line_of_a_few_diameters_does_not_tell_whether_it_has_developed() -> None:
    scene = Case.from_dict(LINE).with_values({"geometry.length": 0.1}).scene
    (warning,) = judge(scene, found(development_length=0.05))
    assert "2 diameters long, too short to tell" in warning

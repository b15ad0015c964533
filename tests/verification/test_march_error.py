# SPDX-License-Identifier: LGPL-3.0-or-later
"""The error estimate of a march: it bounds the true error, and says why there is none."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from mpi4py import MPI

from fem_tfm import Case
from fem_tfm.errors import SolverError
from fem_tfm.models.line import Line
from fem_tfm.output.result import Result
from fem_tfm.output.summary import STEP_NOTE, error_notes
from fem_tfm.scenes.judged import answer as judged
from fem_tfm.scenes.judged.coarser import unavailable
from fem_tfm.study import sweep

# air that develops over 20 diameters
AIR: dict[str, Any] = {
    "solution": "developing",
    "geometry": {"diameter": 0.05, "length": 1.0},
    "gas": {"density": 1.2, "viscosity": 1.8e-5},
    "operation": {"gas_superficial_velocity": 20.0},
    "numerics": {"level": 1},
    "output": {"pictures": False, "xdmf": False},
}
ASH = {"name": "ash", "density": 1800.0, "diameter": 1.4e-4, "loading": 0.1}
DUCT: dict[str, Any] = {
    "flow": "duct",
    "solution": "developing",
    "geometry": {"shape": "duct", "width": 0.2, "length": 1.0},
    "gas": {"density": 1.2, "viscosity": 1.8e-5},
    "operation": {"gas_superficial_velocity": 22.0},
    "numerics": {"level": 2},
}


def air(**changes: Any) -> Case:
    """The line of air with dotted keys changed."""
    return Case.from_dict(AIR).with_values({k.replace("__", "."): v for k, v in changes.items()})


def test_the_estimate_bounds_the_error() -> None:
    """Against a march with cells and steps half as large; laminar, Re 500."""
    laminar = {"closures__turbulence": "laminar", "walls__gas": "no-slip", "gas__viscosity": 2.4e-3}
    result = air(**laminar).scene.run()
    finer = {"numerics__level": 3, "numerics__axial_step": 1 / 120}
    finer |= {"numerics__axial_accuracy": 0.0075, "numerics__error_estimate": False}
    best = air(**laminar, **finer).scene.run()
    for name in ("pressure_drop", "pressure_gradient", "drop_gas_friction"):
        estimate = result.quantities[name].error_estimate
        assert estimate is not None
        assert abs(best[name] - result[name]) < estimate < 0.05 * result[name], name
    assert result.unestimated == ""
    assert STEP_NOTE in error_notes(result)


def test_a_resumed_run_estimates_the_error_that_its_time_did_not_suffice_for(
    tmp_path: Path,
) -> None:
    whole = air(geometry__length=0.05).scene.run()
    march = air(geometry__length=0.05, numerics__error_estimate=False).scene.run(tmp_path)
    assert march.unestimated == "numerics.error_estimate = false"
    assert error_notes(march) == ["no error estimate: numerics.error_estimate = false"]
    assert march.quantities["pressure_drop"].error_estimate is None
    hasty = air(geometry__length=0.05, numerics__time_limit=1e-3).scene
    words = r"numerics\.time_limit = 0\.001 s is over while the error .* was estimated; its last"
    with pytest.raises(SolverError, match=words):
        hasty.run(tmp_path, resume=True)
    assert Result.read(tmp_path).status == "interrupted"
    rest = air(geometry__length=0.05).scene.run(tmp_path, resume=True)
    for name, quantity in whole.quantities.items():
        found = rest.quantities[name]
        assert found.value == pytest.approx(quantity.value, rel=1e-10, abs=1e-12), name
        expected = pytest.approx(quantity.error_estimate, rel=1e-6, abs=1e-9)
        assert found.error_estimate == expected, name
    assert Result.read(tmp_path).quantities["pressure_drop"].error_estimate is not None


def test_marches_that_disagree_are_no_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(judged, "LARGEST_ERROR", 1e-6)
    words = "the march and one with .* disagree, .*: raise numerics.level or lower numerics.axial_"
    with pytest.raises(SolverError, match=words):
        air(geometry__length=0.05).scene.run(tmp_path)
    assert Result.read(tmp_path).quantities == {}


@pytest.mark.parametrize("begun", [False, True])
def test_a_coarser_march_without_an_answer_is_told(
    begun: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    begin, lines = Line.begin, []

    def stops(line: Line) -> None:
        lines.append(line)
        if begun or len(lines) < 2:
            begin(line)
        if len(lines) == 2:
            raise SolverError("marching ends at z = 0 m")

    monkeypatch.setattr(Line, "begin", stops)
    result = air(geometry__length=0.01).scene.run(tmp_path)
    assert bool(re.search(r"\d stations on", (tmp_path / "run.log").read_text())) == begun
    words = "the march with cells and steps twice as large has no answer: marching ends at z = 0 m"
    assert result.unestimated == words
    assert result.quantities["pressure_drop"].error_estimate is None


def test_the_table_of_a_sweep_has_the_estimates(tmp_path: Path) -> None:
    case = air(geometry__length=0.01)
    vary = {"operation.gas_superficial_velocity": [19.0, 20.0]}
    for point in sweep.run(case, vary, tmp_path).points:
        error = point.errors["pressure_drop"]
        assert error is not None
        assert 0 < error < 0.2 * point.quantities["pressure_drop"]
    head, *rows = (tmp_path / "sweep.csv").read_text().splitlines()
    column = head.split(",").index("pressure_drop error [Pa]")
    assert all(float(row.split(",")[column]) > 0 for row in rows)


@pytest.mark.parametrize(
    ("tables", "changes", "words"),
    [
        (AIR, {}, ""),
        (AIR, {"numerics.mesh_size": 0.015}, "carries no mesh with cells twice as large"),
        (AIR, {"numerics.error_estimate": False}, "numerics.error_estimate = false"),
        (DUCT, {}, ""),
        (DUCT, {"particles.materials": [ASH]}, ""),
        (
            DUCT,
            {"particles.materials": [ASH], "particles.coupling": "two-way"},
            "the gas feels its particles",
        ),
    ],
)
def test_why_there_is_no_estimate(
    tables: dict[str, Any], changes: dict[str, Any], words: str
) -> None:
    said = unavailable(Case.from_dict(tables).with_values(changes).scene)
    assert words in said
    assert bool(words) == bool(said)


@pytest.mark.mpi
def test_ranks_agree_on_the_estimate() -> None:
    case = air(geometry__length=0.003)
    together, alone = case.scene.run(), case.scene.run(comm=MPI.COMM_SELF)
    for name in ("pressure_drop", "pressure_gradient"):
        error = alone.quantities[name].error_estimate
        assert error is not None
        assert together.quantities[name].error_estimate == pytest.approx(error, rel=1e-6), name

# SPDX-License-Identifier: LGPL-3.0-or-later
"""A scene is added by one module: its registration makes it known to TOML, verbs and sweeps."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from poiseuille import KIND, Accuracy, Analytic, LaminarGas

import fem_tfm as ft
from fem_tfm.case import Case
from fem_tfm.cli import main
from fem_tfm.errors import InputError
from fem_tfm.scenes.kinds import KINDS, known_keys, register, unregister
from fem_tfm.study import sweep

TEXT = """\
flow = "laminar"
solution = "analytic"
geometry.diameter = 0.01
gas = { density = 1.2, viscosity = 2e-5 }
operation.gas_superficial_velocity = 1.0
walls.slip_length = 1e-4
numerics.digits = 6
"""
GRADIENT = 32 * 2e-5 / (1e-4 + 8e-6)


@pytest.fixture(autouse=True)
def registered() -> Iterator[None]:
    """The scene is known for the time of a test."""
    register(KIND)
    yield
    unregister(KIND)


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A case file in an empty working directory."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "tube.toml"
    path.write_text(TEXT)
    return path


def test_toml_and_python_state_the_same_scene(file: Path) -> None:
    gas = ft.Gas(1.2, 2e-5)
    twin = Analytic(LaminarGas(gas, 1e-4), ft.Pipe(0.01), ft.Feed(1.0), numerics=Accuracy(6))
    assert ft.load(file) == twin
    assert Case.load(file)["numerics.digits"] == 6
    assert twin.run()["pressure_gradient"] == pytest.approx(GRADIENT, rel=1e-5)
    path = file.with_name("again.toml")
    path.write_text(Case.load(file).dump())
    assert ft.load(path) == twin


@pytest.mark.parametrize(
    ("override", "part"),
    [
        ("numerics.digits=16", "a whole number at least 1 and at most 15"),
        ("numerics.digit=6", "did you mean 'numerics.digits'?"),
        ("numerics.tolerance=1e-3", "no such key for flow = 'laminar' with solution = 'analytic'"),
        ("operation.gravity=9.81", "no such key for flow = 'laminar'"),
        ("geometry.shape=duct", "one of pipe for flow = 'laminar'"),
        ("solution=unsteady", "one of auto, analytic"),
        ("flow=dense", "one of auto, developed, developing, unsteady"),
    ],
)
def test_its_keys_are_checked(file: Path, override: str, part: str) -> None:
    with pytest.raises(InputError) as refused:
        Case.load(file, [override])
    assert part in str(refused.value)


def test_other_scenes_name_it_as_the_reader() -> None:
    with pytest.raises(InputError, match="flow = 'laminar' with solution = 'analytic' reads it"):
        Case.from_dict(
            {
                "geometry": {"diameter": 0.01},
                "gas": {"density": 1.2, "viscosity": 2e-5},
                "operation": {"gas_superficial_velocity": 1.0},
                "walls": {"slip_length": 1e-4},
            }
        )


def test_the_only_solution_of_a_flow_is_its_default(file: Path) -> None:
    file.write_text(TEXT.replace('solution = "analytic"\n', ""))
    assert Case.load(file).scene.kind is KIND


def test_the_verbs_know_it(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "tube.toml"]) == 0
    assert "Poiseuille's law" in capsys.readouterr().out
    assert main(["keys", "walls.slip_length"]) == 0
    out = capsys.readouterr().out
    assert "walls.slip_length [m] = 0.0" in out
    assert "read by flow = 'laminar' with solution = 'analytic'" in out
    assert main(["run", "tube.toml"]) == 0
    assert "pressure_gradient" in capsys.readouterr().out
    assert (file.parent / "results/tube/result.json").exists()
    assert main(["run", "tube.toml", "--quiet", "--set", "gas.viscosity=1e-9", "--overwrite"]) == 3
    assert "turbulent" in capsys.readouterr().err


def test_a_verb_that_it_does_not_support_says_so(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["mesh", "tube.toml", "--out", "tube.vtu"]) == 2
    assert "has none" in capsys.readouterr().err
    assert main(["run", "tube.toml", "--quiet"]) == 0
    assert main(["run", "tube.toml", "--resume", "--out", "results/tube"]) == 2
    assert "a directory that holds a checkpoint" in capsys.readouterr().err


def test_a_sweep_solves_it(file: Path) -> None:
    vary = {"geometry.diameter": [0.01, 0.02], "operation.gas_superficial_velocity": [1.0, 90.0]}
    found = sweep.run(Case.load(file), vary, file.parent / "sweep")
    assert [point.solved for point in found.points] == [True, False, True, False]
    assert found.points[0].quantities["pressure_gradient"] == pytest.approx(GRADIENT, rel=1e-5)
    assert "turbulent" in found.points[1].reason


def test_it_is_gone_when_it_is_taken_back() -> None:
    assert "walls.slip_length" in known_keys()
    unregister(KIND)
    assert KIND not in KINDS
    assert "walls.slip_length" not in known_keys()
    register(KIND)

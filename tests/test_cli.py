# SPDX-License-Identifier: LGPL-3.0-or-later
"""The command line: exit statuses, one sentence per error, and nothing written on bad input."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import meshio
import pytest
import tomli_w
from mpi4py import MPI

import fem_tfm
from fem_tfm.cli import main, parse_variation
from fem_tfm.closures import catalogue, families, names
from fem_tfm.errors import InputError, SolverError
from fem_tfm.scenes.developed import Developed
from fem_tfm.scenes.kinds import known_keys
from fem_tfm.scenes.recorder import Setting
from fem_tfm.scenes.scene import Scene
from fem_tfm.study import sweep as study

RANK = MPI.COMM_WORLD.rank


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, dense: dict[str, Any]) -> Path:
    """An empty working directory with one good case, "good.toml"."""
    monkeypatch.chdir(tmp_path)
    if RANK == 0:
        Path("good.toml").write_text(tomli_w.dumps(dense))
    MPI.COMM_WORLD.barrier()
    return tmp_path


class Solver:
    """Stands in for a scene's work: remembers its arguments and answers or fails as told."""

    def __init__(self, error: BaseException | None = None) -> None:
        self.error = error
        self.calls: list[tuple[Any, ...]] = []

    def __call__(self, scene: Scene, setting: Setting, **options: Any) -> tuple[Any, Any]:
        self.calls.append((scene, setting, options))
        setting.progress.stage("solving")
        if self.error:
            raise self.error
        return "result", SimpleNamespace(close=lambda: None)


@pytest.fixture
def solver(monkeypatch: pytest.MonkeyPatch) -> Solver:
    """The solver that `run` meets."""
    stand_in = Solver()
    monkeypatch.setattr(Scene, "carry_out", lambda *given, **more: stand_in(*given, **more))
    return stand_in


def fem_tfm_command(*arguments: str, **options: Any) -> subprocess.CompletedProcess[str]:
    """Run the command in a process of its own."""
    command = [sys.executable, "-m", "fem_tfm", *arguments]
    return subprocess.run(command, capture_output=True, text=True, **options)


def only_sentence(text: str) -> str:
    """The one line that an error may print."""
    lines = text.splitlines()
    assert len(lines) == 1
    return lines[0]


# --- as a process ---------------------------------------------------------------------------------


def test_version(root: Path) -> None:
    done = fem_tfm_command("--version", cwd=root)
    assert (done.returncode, done.stdout) == (0, f"fem-tfm {fem_tfm.__version__}\n")


def test_bad_input_ends_with_status_2(here: Path, root: Path) -> None:
    environment = os.environ | {"PYTHONPATH": str(root)}
    done = fem_tfm_command("run", "good.toml", "--set", "solids.diamter=1", env=environment)
    assert done.returncode == 2
    assert done.stdout == ""
    assert "did you mean 'solids.diameter'?" in only_sentence(done.stderr)
    assert [p.name for p in here.iterdir()] == ["good.toml"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interruption_ends_with_status_130(here: Path, root: Path, number: int) -> None:
    with subprocess.Popen(
        [sys.executable, "-m", "fem_tfm", "run", "good.toml", "--quiet"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": str(root)},
        # a test run that was started in the background ignores SIGINT and hands that on
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        log = here / "results" / "good" / "run.log"
        while process.poll() is None and not (log.exists() and log.read_text()):
            time.sleep(0.05)
        process.send_signal(number)
        _, errors = process.communicate(timeout=60)
    assert (process.returncode, errors) == (130, "fem-tfm: interrupted\n")
    assert '"interrupted"' in (here / "results" / "good" / "result.json").read_text()


@pytest.mark.parametrize("verb", ["models", "keys"])
def test_output_that_nobody_reads_is_no_error(root: Path, verb: str) -> None:
    command = f"{sys.executable} -m fem_tfm {verb} | head -n 1"
    done = subprocess.run(command, shell=True, capture_output=True, text=True, cwd=root)
    assert done.stdout
    assert done.stderr == ""


# --- run ------------------------------------------------------------------------------------------


def test_run_passes_everything_on(here: Path, solver: Solver) -> None:
    given = ["run", "good.toml", "--set", "solids.diameter=2e-4", "--set", "closures.drag=wen-yu"]
    assert main([*given, "--out", "there", "--overwrite", "--quiet"]) == 0
    scene, setting, options = solver.calls[0]
    assert (scene.model.solids.diameter, scene.model.drag.name) == (2e-4, "wen-yu")
    assert (setting.out, setting.resume) == (Path("there"), False)
    assert options == {"overwrite": True}


def test_results_go_to_a_directory_named_after_the_case(here: Path, solver: Solver) -> None:
    assert main(["run", "good.toml", "--quiet"]) == 0
    assert solver.calls[0][1].out == Path("results/good")


def test_quiet_is_quiet(here: Path, solver: Solver, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "good.toml", "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (SolverError("no steady state after 200 steps"), 3),
        (InputError("solids.diameter", 1.0, "less"), 2),
        (KeyboardInterrupt(), 130),
    ],
)
def test_exit_statuses(
    here: Path,
    solver: Solver,
    capsys: pytest.CaptureFixture[str],
    error: BaseException,
    status: int,
) -> None:
    solver.error = error
    assert main(["run", "good.toml", "--quiet"]) == status
    assert only_sentence(capsys.readouterr().err).endswith(str(error) or "interrupted")


def test_a_defect_shows_its_trace(
    here: Path, solver: Solver, capsys: pytest.CaptureFixture[str]
) -> None:
    solver.error = ZeroDivisionError("defect")
    assert main(["run", "good.toml", "--quiet"]) == 1
    assert "Traceback" in capsys.readouterr().err


BAD = [
    ([], "VERB"),
    (["rnu", "good.toml"], "invalid choice"),
    (["run"], "CASE.toml"),
    (["run", "goood.toml"], "did you mean 'good.toml'?"),
    (["run", "good.toml", "--frobnicate"], "--frobnicate"),
    (["run", "good.toml", "--set", "solids.diameter"], "key=value"),
    (["run", "good.toml", "--set", "solids.diameter=small"], "a number at least 1e-10"),
    (["run", "good.toml", "--set", "closures.drag=wen-yo"], "did you mean 'wen-yu'?"),
    (["run", "good.toml", "--out", "good.toml"], "can be written"),
    (["run", "good.toml", "--out", "."], "--overwrite or --resume"),
    (["run", "good.toml", "--resume"], "a run to resume"),
    (["run", "good.toml", "--resume", "--overwrite"], "either --resume or --overwrite"),
    (["check", "none.toml"], "existing case file"),
    (["mesh", "good.toml"], "--out"),
    (["mesh", "good.toml", "--out", "good.toml"], "a new file, or --overwrite"),
    (["models", "dragg"], "did you mean 'drag'?"),
    (["models", "schneiderbauer"], "did you mean 'solids-wall'?"),
    (["sweep", "good.toml"], "--vary"),
    (["sweep", "good.toml", "--vary", "solids.diameter"], "key=a,b,c"),
    (["sweep", "good.toml", "--vary", "solids.diamter=1e-4,2e-4"], "'solids.diameter'"),
    (["sweep", "good.toml", "--vary", "solids.diameter=1e-4,-1"], "at least 1e-10"),
    (["sweep", "good.toml", "--vary", "solids.diameter=1e-4", "--jobs", "0"], "at least 1"),
    (["sweep", "good.toml", "--vary", "numerics.level=1", "--resume"], "a run to resume"),
    (["sweep", "good.toml", "--vary", "numerics.level=1,2", "--vary", "numerics.level=3"], "once"),
    (["sweep", "good.toml", "--vary", "numerics.level=1,2", "--set", "numerics.level=3"], "--vary"),
    (["run", "good.toml", "--set", "title=a", "--set", "title=b"], "each key once"),
    (["keys", "numeric"], "did you mean 'numerics'?"),
]


@pytest.mark.mpi
@pytest.mark.parametrize(("arguments", "part"), BAD, ids=[" ".join(a) or "nothing" for a, _ in BAD])
def test_bad_input_writes_one_sentence_and_no_file(
    here: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], part: str
) -> None:
    before = (here / "good.toml").read_text()
    assert main(arguments) == 2
    out, errors = capsys.readouterr()
    assert out == ""
    if RANK == 0:
        assert part in only_sentence(errors)
    else:
        assert errors == ""
    assert [p.name for p in here.iterdir()] == ["good.toml"]
    assert (here / "good.toml").read_text() == before


def test_a_sweep_is_checked_as_a_whole(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    limits = ["--vary", "solids.friction_limit=0.3,0.55", "--vary", "solids.packing_limit=0.6,0.5"]
    assert main(["sweep", "good.toml", *limits]) == 2
    assert "below solids.packing_limit = 0.5" in only_sentence(capsys.readouterr().err)


# --- the other verbs ------------------------------------------------------------------------------


@pytest.mark.mpi
def test_help_names_every_verb(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    out, _ = capsys.readouterr()
    verbs = ("run", "check", "mesh", "models", "keys", "sweep", "bench")
    assert all((f"\n    {verb} " in out) == (RANK == 0) for verb in verbs)


def test_mesh_writes_the_section_or_the_line(here: Path) -> None:
    line = ["solution='unsteady'", "numerics.end_time=1.0", "numerics.axial_cells=2"]
    line += ["operation.solids_velocity=6.0", "numerics.cells=quadrilateral"]
    coarse = ["good.toml", "--set", "numerics.level=1"]
    more = [text for setting in line for text in ("--set", setting)]
    assert main(["mesh", *coarse, "--out", "section.vtu"]) == 0
    assert main(["mesh", *coarse, *more, "--out", "line.vtu"]) == 0
    cells = [meshio.read(here / f"{name}.vtu").cells_dict for name in ("section", "line")]
    assert (len(cells[0]["triangle6"]), len(cells[1]["hexahedron"])) == (80, 2 * 40)


@pytest.mark.parametrize("verb", ["run", "check", "mesh", "models", "keys", "sweep", "bench"])
def test_every_verb_has_help(capsys: pytest.CaptureFixture[str], verb: str) -> None:
    assert main([verb, "--help"]) == 0
    assert f"usage: fem-tfm {verb}" in capsys.readouterr().out


def test_models_lists_every_law(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["models"]) == 0
    out = capsys.readouterr().out
    for family in families():
        assert f"[{family}]" in out
        assert all(f"\n{name}: " in out for name in names(family))


def test_models_of_a_family_show_formula_source_and_parameters(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["models", "drag"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    for law in catalogue("drag"):
        assert " ".join(law["formula"].split()) in out
        assert " ".join(law["source"].split()) in out
        assert all(f"{p['name']} = {p['default']}" in out for p in law["parameters"])
    assert "[radial]" not in out


def test_keys_lists_every_key_with_unit_and_default(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["keys"]) == 0
    entries = capsys.readouterr().out.strip().split("\n\n")
    told = {entry.split()[0].rstrip(","): entry for entry in entries}
    assert set(told) == {*known_keys(), "flow", "solution", "geometry.shape"}
    for name, key in known_keys().items():
        text = " ".join(told[name].split())
        assert key.doc in text
        assert not key.unit or f"{name} [{key.unit}]" in text
        assert "read by " in text
    assert told["solids.density"].startswith("solids.density [kg/m3], must be given")
    assert told["closures.drag"].startswith('closures.drag = "three-zone"')
    assert told["numerics.cells"].startswith('numerics.cells = "triangle" or "quadrilateral"')


@pytest.mark.parametrize(("asked", "number"), [("heat", 5), ("heat.wall", 1), ("flow", 1)])
def test_keys_of_a_table_or_one(
    capsys: pytest.CaptureFixture[str], asked: str, number: int
) -> None:
    assert main(["keys", asked]) == 0
    assert capsys.readouterr().out.count("read by") == number


def test_the_key_of_a_law_leads_to_its_parameters(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["keys", "walls.solids"]) == 0
    command = "fem-tfm models solids-wall"
    assert f"walls.solids.NAME: {command})" in " ".join(capsys.readouterr().out.split())
    assert main(command.split()[1:]) == 0
    assert "roughness_deg = 3.0" in capsys.readouterr().out


def test_keys_tells_who_reads(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["keys", "output.stations"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "'dense' with solution = 'developing', or flow = 'duct' with solution = 'dev" in out
    assert main(["keys", "title"]) == 0
    assert "read by every scene" in capsys.readouterr().out


def test_a_sweep_is_told_what_to_resume_and_keep(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []

    def solve(*given: Any) -> Any:
        calls.append(given)
        return SimpleNamespace(failed=[])

    monkeypatch.setattr(study, "run", solve)
    vary = ["sweep", "good.toml", "--vary", "solids.diameter=1e-4,2e-4"]
    (here / "there").mkdir()
    (here / "there" / "sweep.csv").write_text("")
    assert main([*vary, "--out", "there", "--resume", "--keep", "--jobs", "2"]) == 0
    assert calls[0][1:] == ({"solids.diameter": [1e-4, 2e-4]}, Path("there"), 2, True, True)
    assert main([*vary, "--out", "new"]) == 0
    assert calls[1][1:] == ({"solids.diameter": [1e-4, 2e-4]}, Path("new"), 1, False, False)


def test_check_prints_what_the_flow_describes(
    here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    answer = {
        "unknowns": 4900,
        "memory_mb": 412.3456,
        "skipped": ["half: symmetric"],
        "closures": {"drag": "wen-yu"},
        "warnings": [],
    }
    monkeypatch.setattr(Developed, "describe", lambda scene: answer)
    assert main(["check", "good.toml"]) == 0
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert lines == [
        "unknowns 4900",
        "memory mb 412.3",
        "skipped",
        "- half: symmetric",
        "closures",
        "drag wen-yu",
        "warnings none",
    ]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("solids.diameter=1e-4,2e-4", ("solids.diameter", [1e-4, 2e-4])),
        ("closures.drag=wen-yu, ergun", ("closures.drag", ["wen-yu", "ergun"])),
        ("numerics.level=1", ("numerics.level", [1])),
        ("output.pictures=true,false", ("output.pictures", [True, False])),
    ],
)
def test_variations(text: str, expected: tuple[str, list[Any]]) -> None:
    assert parse_variation(text) == expected


@pytest.mark.parametrize("text", ["", "a", "a=", "=1,2", "a=b,,c"])
def test_variations_need_key_and_values(text: str) -> None:
    with pytest.raises(InputError, match="key=a,b,c"):
        parse_variation(text)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Places that cannot be written end in one sentence and status 2, on any number of ranks."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from mpi4py import MPI

from fem_tfm import Case, fenics
from fem_tfm.cli import main
from fem_tfm.errors import InputError
from fem_tfm.output import lock

CASE = """
[geometry]
diameter = 0.05
length = 1.0
[gas]
density = 1.2
viscosity = 1.8e-5
[operation]
gas_superficial_velocity = 10.0
[numerics]
level = 1
[output]
pictures = false
xdmf = false
"""


@pytest.fixture
def case(tmp_path: Path) -> Path:
    if MPI.COMM_WORLD.rank == 0:
        (tmp_path / "case.toml").write_text(CASE)
        (tmp_path / "file").write_text("")
    MPI.COMM_WORLD.barrier()
    return tmp_path / "case.toml"


def refused(case: Path, out: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """The one sentence of a run that ends with status 2."""
    assert main(["run", str(case), "--out", str(out), "--quiet"]) == 2
    MPI.COMM_WORLD.barrier()
    told = capsys.readouterr().err
    if MPI.COMM_WORLD.rank == 0:
        assert told.startswith("fem-tfm: ") and told.count("\n") == 1
    return told


@pytest.mark.mpi
@pytest.mark.parametrize("name", ["file/below", "n" * 300, "short/" + "n" * 300])
def test_a_place_that_cannot_be_written(
    name: str, case: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = refused(case, case.parent / name, capsys)
    if MPI.COMM_WORLD.rank == 0:
        assert "--out" in told and "a directory that can be written" in told


@pytest.mark.mpi
def test_a_place_that_only_looks_as_if_it_could_be_written(
    case: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on a file system that is read-only or full."""

    def full(self: Path, *args: object, **kwargs: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "mkdir", full)
    monkeypatch.setattr(fenics, "check_cache", lambda comm: None)
    monkeypatch.setattr("fem_tfm.scenes.scene.check_cache", lambda comm: None)
    told = refused(case, case.parent / "out", capsys)
    if MPI.COMM_WORLD.rank == 0:
        assert "No space left on device" in told


@pytest.mark.mpi
def test_a_form_cache_that_cannot_be_written(
    case: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    options = {**fenics.JIT_OPTIONS, "cache_dir": str(case.parent / "file" / "fenics")}
    monkeypatch.setattr(fenics, "JIT_OPTIONS", options)
    told = refused(case, case.parent / "out", capsys)
    if MPI.COMM_WORLD.rank == 0:
        assert "XDG_CACHE_HOME" in told and "compiled forms" in told
    assert not (case.parent / "out").exists()


def test_two_runs_in_one_directory(case: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The second is refused while the first is at work, and only so long."""
    out = case.parent / "out"
    out.mkdir()
    hold = (
        "import sys; from pathlib import Path; from fem_tfm.output import lock;"
        " print(lock.hold(Path(sys.argv[1])), flush=True); input()"
    )
    command = [sys.executable, "-c", hold, str(out)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "env": dict(os.environ)}
    with subprocess.Popen(command, **pipes) as other:
        assert other.stdout is not None and other.stdout.readline() == b"True\n"
        scene = Case.load(case).scene
        with pytest.raises(InputError, match="no other run is at work"):
            scene.run(out, overwrite=True)
        assert [path.name for path in out.iterdir()] == [lock.FILE]
        other.communicate(b"\n")
    assert scene.run(out, overwrite=True).status == "converged"
    assert not (out / lock.FILE).exists()

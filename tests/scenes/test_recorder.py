# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where results go, and what the time of a run is booked under."""

from __future__ import annotations

import time
from itertools import count
from pathlib import Path
from types import SimpleNamespace

import pytest

from fem_tfm.case import Case
from fem_tfm.errors import InputError
from fem_tfm.scenes.recorder import results_directory


def test_results_go_to_a_new_or_empty_directory(tmp_path: Path) -> None:
    assert results_directory(None) is None
    assert results_directory(tmp_path) == tmp_path
    assert results_directory(str(tmp_path / "a" / "b")) == tmp_path / "a" / "b"
    assert list(tmp_path.iterdir()) == []


def test_filled_directories_are_safe(tmp_path: Path) -> None:
    (tmp_path / "result.json").write_text("{}")
    with pytest.raises(InputError, match="--overwrite or --resume"):
        results_directory(tmp_path)
    assert results_directory(tmp_path, overwrite=True) == tmp_path
    assert results_directory(tmp_path, resume=True) == tmp_path
    with pytest.raises(InputError, match="either"):
        results_directory(tmp_path, overwrite=True, resume=True)


def test_results_need_a_directory(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for place in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(InputError, match="can be written"):
            results_directory(place)


def test_only_a_run_can_be_resumed(tmp_path: Path) -> None:
    for place in (None, tmp_path, tmp_path / "new"):
        with pytest.raises(InputError, match="resume"):
            results_directory(place, resume=True)


@pytest.mark.mpi
def test_all_ranks_refuse_a_filled_directory(tmp_path: Path) -> None:
    (tmp_path / "result.json").write_text("{}")
    with pytest.raises(InputError, match="--overwrite"):
        results_directory(tmp_path)


def test_time_on_coarse_meshes_is_time_of_solving(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A clock that goes a second a look: the forms of each mesh are not the solves between them."""
    recorder = Case.load(root / "demos/dense_pipe/algebraic.toml").scene.recorder()
    recorder.progress.stage = lambda text: None  # type: ignore[method-assign]
    mesh = SimpleNamespace(mesh=SimpleNamespace(num_cells=1), dofs=1)
    seconds = recorder.seconds
    for level in range(2):
        recorder.compiling("residual, Jacobian and constraints")
        before = dict(seconds)
        recorder.begin(mesh, level, 2)
        assert seconds["compile"] > before["compile"] and seconds["solve"] == before["solve"]
    ticks = count(time.perf_counter() + 100)
    monkeypatch.setattr(time, "perf_counter", lambda: float(next(ticks)))
    recorder.compiling("residual, Jacobian and constraints")
    assert seconds["solve"] > 100 and seconds["compile"] < 100

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where results go."""

from __future__ import annotations

from pathlib import Path

import pytest

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

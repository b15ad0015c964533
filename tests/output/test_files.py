# SPDX-License-Identifier: LGPL-3.0-or-later
"""A file is replaced as a whole, or left as it was."""

from __future__ import annotations

from pathlib import Path

import pytest

from fem_tfm.output.files import replaced, write_text


def test_file_is_replaced_only_when_complete(tmp_path: Path) -> None:
    path = tmp_path / "new" / "file.txt"
    write_text(path, "first")
    with path.open() as reader:
        with replaced(path) as temporary:
            temporary.write_text("second")
            assert path.read_text() == "first"
        # who has the old file open goes on reading it whole
        assert reader.read() == "first"
    assert path.read_text() == "second"


def test_failure_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "file.txt"
    write_text(path, "first")

    def fail() -> None:
        with replaced(path) as temporary:
            temporary.write_text("half")
            raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        fail()
    assert path.read_text() == "first"
    assert list(tmp_path.iterdir()) == [path]

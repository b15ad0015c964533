# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files that are either the old one or the new one, never half of it, and work done by rank 0."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from fem_tfm.errors import FemTfmError


@contextmanager
def replaced(path: str | Path) -> Iterator[Path]:
    """Give a temporary path beside `path`; it takes the name `path` if the block succeeds.

    Renaming is atomic within a directory, so a killed process leaves the previous file (and at
    most a hidden ``.name.part.suffix``). Where the block raises, the temporary file is removed.
    The directory is made if it does not exist.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem}.part{path.suffix}")
    temporary.unlink(missing_ok=True)
    try:
        yield temporary
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: str | Path, text: str) -> None:
    """Write `text` to `path` in one atomic step (UTF-8)."""
    with replaced(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def on_root(comm: Any, action: Callable[[], object]) -> None:
    """Run `action` on rank 0; if it fails there, every rank raises (collective).

    Without it a full disk would stop rank 0 only, and the others would wait for ever. An error that
    is raised on purpose is the same on all ranks.
    """
    error: Exception | None = None
    if comm.rank == 0:
        try:
            action()
        except Exception as caught:
            error = caught
    told = error if isinstance(error, FemTfmError) else None
    told, message = comm.bcast((told, None if error is None else repr(error)), root=0)
    if told is not None:
        raise told
    if error is not None:
        raise error
    if message is not None:
        raise RuntimeError(f"rank 0 failed: {message}")

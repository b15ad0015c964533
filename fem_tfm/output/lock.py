# SPDX-License-Identifier: LGPL-3.0-or-later
"""One run at a time in a results directory."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path
from typing import TextIO

FILE = ".lock"
_held: dict[Path, TextIO] = {}


def hold(directory: Path) -> bool:
    """Take the lock of a directory until `release`, or the end of the process.

    Returns False where another run holds it.
    """
    release(directory)
    place = directory / FILE
    while True:
        file = place.open("a", encoding="utf-8")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.close()
            return False
        # a run that ended meanwhile may have taken the file away
        if place.exists() and os.fstat(file.fileno()).st_ino == place.stat().st_ino:
            _held[directory] = file
            return True
        file.close()


def release(directory: Path) -> None:
    """Give a lock back, if it is held, and remove its file."""
    file = _held.pop(directory, None)
    if file is not None:
        (directory / FILE).unlink(missing_ok=True)
        file.close()

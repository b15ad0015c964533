# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interruption: a request to terminate ends a run as Ctrl-C does, whatever libraries install."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)


def install() -> None:
    """Turn SIGTERM into KeyboardInterrupt; call it before PETSc is loaded."""
    # PETSc would answer SIGTERM itself, with an abort
    options = os.environ.get("PETSC_OPTIONS", "")
    if "-no_signal_handler" not in options:
        os.environ["PETSC_OPTIONS"] = f"{options} -no_signal_handler".strip()
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, _interrupt)


@contextmanager
def kept() -> Iterator[None]:
    """Put Python's signal handlers back after a library has replaced them."""
    handlers = {number: signal.getsignal(number) for number in SIGNALS}
    try:
        yield
    finally:
        if threading.current_thread() is threading.main_thread():
            for number, handler in handlers.items():
                signal.signal(number, handler or signal.SIG_DFL)


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt

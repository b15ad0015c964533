# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interruption: a request to terminate ends a run as Ctrl-C does, whatever libraries install."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from mpi4py import MPI

SIGNALS = (signal.SIGINT, signal.SIGTERM)


def install() -> None:
    """Turn SIGTERM into KeyboardInterrupt; call it before PETSc is loaded."""
    # PETSc would answer SIGTERM itself, with an abort
    options = os.environ.get("PETSC_OPTIONS", "")
    if "-no_signal_handler" not in options:
        os.environ["PETSC_OPTIONS"] = f"{options} -no_signal_handler".strip()
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, _interrupt)


class Request:
    """Whether this process has been asked to stop."""

    def __init__(self) -> None:
        self.made = False

    def on_any(self, comm: Any) -> bool:
        """Whether any rank has been asked; the same answer on all (collective)."""
        return bool(comm.allreduce(int(self.made), MPI.MAX))


@contextmanager
def deferred() -> Iterator[Request]:
    """Take Ctrl-C and SIGTERM as a request, so that work can end where all ranks stand together.

    A second signal interrupts at once. Outside the main thread signals stay as they are.
    """
    request = Request()

    def note(number: int, frame: FrameType | None) -> None:
        if request.made:
            raise KeyboardInterrupt
        request.made = True

    with kept():
        if threading.current_thread() is threading.main_thread():
            for number in SIGNALS:
                signal.signal(number, note)
        yield request


@contextmanager
def together(comm: Any) -> Iterator[None]:
    """Let work that is broken off on one rank end on all of them (collective).

    Raises
    ------
    KeyboardInterrupt
        a rank was interrupted, and none has failed.
    RuntimeError
        another rank has failed; that rank raises what it met.
    """
    broken: BaseException | None = None
    try:
        yield
    except (Exception, KeyboardInterrupt) as error:
        broken = error
    failed = isinstance(broken, Exception)
    worst = comm.allreduce(2 if failed else int(broken is not None), MPI.MAX)
    if worst == 2:
        told = comm.allgather(repr(broken) if failed else "")
        if isinstance(broken, Exception):
            raise broken
        rank = next(n for n, text in enumerate(told) if text)
        raise RuntimeError(f"rank {rank} has failed: {told[rank]}")
    if worst == 1:
        raise KeyboardInterrupt


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

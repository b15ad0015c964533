# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a run says while it works: a bar with the time left on a terminal, plain lines in a file."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import Any, Self

from mpi4py import MPI
from rich.console import Console
from rich.progress import (
    BarColumn,
    SpinnerColumn,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.progress import Progress as Bar

# a plain log is not flooded: at most one line of progress in so many seconds
LOG_INTERVAL = 5.0


class Progress:
    """Reports stages and progress; silent if quiet, and on every rank but 0.

    quiet : say nothing but warnings
    comm : the ranks that work together
    console : where to write, standard output by default

    Use it as a context manager, so that the bar is taken away when the work ends or fails.
    """

    def __init__(
        self, quiet: bool = False, comm: Any = MPI.COMM_WORLD, console: Console | None = None
    ) -> None:
        self.rank = comm.rank
        self.silent = quiet or self.rank > 0
        self.console = console or Console(highlight=False, markup=False)
        self._bar: Bar | None = None
        self._stage = ""
        self._last = -LOG_INTERVAL

    def __enter__(self) -> Self:
        if self.console.is_terminal and not self.silent:
            self._bar = Bar(
                SpinnerColumn(),
                TextColumn("{task.description}", markup=False),
                BarColumn(bar_width=24),
                TaskProgressColumn(),
                TimeElapsedColumn(),
                TextColumn("left", markup=False),
                TimeRemainingColumn(),
                TextColumn("{task.fields[message]}", markup=False),
                console=self.console,
                transient=True,
            )
            self._task = self._bar.add_task("", total=None, message="")
            self._bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Take the bar away."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None

    def stage(self, name: str) -> None:
        """Begin a part of the work that may take a while, such as "compiling the Jacobian"."""
        self._stage = name
        if self._bar is not None:
            self._bar.update(self._task, description=name, message="")
        else:
            self.line(name)

    def update(self, fraction: float | None, message: str = "") -> None:
        """Tell which fraction (0..1) of the whole run is done, None if that is not known."""
        if self._bar is not None:
            done = None if fraction is None else min(max(fraction, 0.0), 1.0)
            total = None if done is None else 1.0
            self._bar.update(self._task, completed=done or 0.0, total=total, message=message)
        elif time.monotonic() - self._last >= LOG_INTERVAL:
            self._last = time.monotonic()
            share = "" if fraction is None else f"{100 * fraction:3.0f} %"
            self.line(" ".join(part for part in (self._stage, share, message) if part))

    def line(self, text: str) -> None:
        """Write one line; it stays above the bar."""
        if not self.silent:
            self.console.print(text, soft_wrap=True)

    def warn(self, text: str) -> None:
        """Write a warning to standard error, even where the run is quiet."""
        if self.rank > 0:
            return
        if self._bar is not None:
            self.console.print(f"warning: {text}", style="yellow", soft_wrap=True)
        else:
            print(f"warning: {text}", file=sys.stderr, flush=True)

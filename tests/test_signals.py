# SPDX-License-Identifier: LGPL-3.0-or-later
"""Python's signal handlers survive the libraries."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator

import pytest
from mpi4py import MPI

from fem_tfm import signals


@pytest.fixture(autouse=True)
def restored(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Leave the handlers and PETSc's options as they were."""
    monkeypatch.setenv("PETSC_OPTIONS", "-log_view")
    with signals.kept():
        yield


def test_termination_interrupts() -> None:
    signals.install()
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGTERM)


def test_petsc_leaves_signals_alone_and_keeps_its_options() -> None:
    signals.install()
    signals.install()
    assert os.environ["PETSC_OPTIONS"] == "-log_view -no_signal_handler"


def test_handlers_come_back() -> None:
    signals.install()
    before = [signal.getsignal(number) for number in signals.SIGNALS]
    with signals.kept():
        for number in signals.SIGNALS:
            signal.signal(number, signal.SIG_IGN)
    assert [signal.getsignal(number) for number in signals.SIGNALS] == before


@pytest.mark.mpi
def test_a_signal_becomes_a_request_on_all_ranks() -> None:
    comm = MPI.COMM_WORLD
    with signals.deferred() as request:
        assert not request.on_any(comm)
        if comm.rank == comm.size - 1:
            signal.raise_signal(signal.SIGTERM)
        assert request.on_any(comm)


def test_a_second_signal_interrupts_at_once() -> None:
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), signals.deferred():
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGTERM)
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.mpi
@pytest.mark.parametrize("broken", [KeyboardInterrupt(), ValueError("cell")])
def test_what_breaks_off_one_rank_ends_all(broken: BaseException) -> None:
    """The last rank alone is broken off, all others reach the end of their work."""
    comm = MPI.COMM_WORLD
    last = comm.size - 1
    expected = type(broken) if comm.rank == last else (KeyboardInterrupt, RuntimeError)
    with pytest.raises(expected) as found, signals.together(comm):
        if comm.rank == last:
            raise broken
    if comm.rank < last and isinstance(broken, ValueError):
        assert str(found.value) == f"rank {last} has failed: ValueError('cell')"
    with signals.together(comm):
        pass

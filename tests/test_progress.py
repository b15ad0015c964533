# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a run says while it works, on a terminal, in a file, when quiet and on other ranks."""

from __future__ import annotations

import io
from types import SimpleNamespace

import pytest
from rich.console import Console

from fem_tfm import progress
from fem_tfm.progress import Progress


def spoken(terminal: bool = False, quiet: bool = False, rank: int = 0) -> str:
    """What one short run writes."""
    text = io.StringIO()
    console = Console(file=text, force_terminal=terminal, width=100, markup=False, highlight=False)
    with Progress(quiet, SimpleNamespace(rank=rank), console) as talk:
        talk.stage("mesh")
        talk.update(0.25, "step 1")
        talk.update(0.5, "step 2")
        talk.line("max alpha_s 0.5 [-]")
        talk.stage("output")
        talk.update(None)
    return text.getvalue()


def test_plain_lines_in_a_file() -> None:
    assert spoken().splitlines() == ["mesh", "mesh  25 % step 1", "max alpha_s 0.5 [-]", "output"]


def test_a_log_is_not_flooded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "LOG_INTERVAL", 0.0)
    assert "mesh  50 % step 2" in spoken()


def test_bar_on_a_terminal() -> None:
    text = spoken(terminal=True)
    assert "max alpha_s 0.5 [-]" in text
    assert "left" in text
    # the bar is taken away at the end
    assert text.endswith("\x1b[2K")


@pytest.mark.parametrize("terminal", [True, False])
def test_silence_when_quiet_and_on_other_ranks(terminal: bool) -> None:
    assert spoken(terminal, quiet=True) == ""
    assert spoken(terminal, rank=1) == ""


def test_fractions_outside_their_range_are_harmless() -> None:
    console = Console(file=io.StringIO(), force_terminal=True)
    with Progress(console=console) as talk:
        talk.update(-1.0)
        talk.update(7.0, "late")
    assert console.file.getvalue()


@pytest.mark.parametrize(("rank", "expected"), [(0, "warning: coarse mesh\n"), (1, "")])
def test_warnings_are_heard_even_when_quiet(
    capsys: pytest.CaptureFixture[str], rank: int, expected: str
) -> None:
    Progress(quiet=True, comm=SimpleNamespace(rank=rank)).warn("coarse mesh")
    assert capsys.readouterr() == ("", expected)

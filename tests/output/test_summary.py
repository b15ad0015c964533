# SPDX-License-Identifier: LGPL-3.0-or-later
"""The summary fits a screen and says what was solved, how well, and against what."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from fem_tfm.output.result import InputRange, Quantity, Reference, Result
from fem_tfm.output.summary import difference, number, print_summary

NAMES = (
    "pressure_gradient", "solids_mass_flow", "gas_mass_flow", "holdup", "max_solids_fraction",
    "bed_fraction", "slip_velocity",
)  # fmt: skip


def printed(terminal: bool = False, **changes: Any) -> str:
    """Summary of a long result."""
    references = (Reference(4090.0, "Ding 2024, mesh D"), Reference(4260.0, "experiment " * 6))
    content: dict[str, Any] = {
        "status": "converged",
        "flow": "dense",
        "solution": "developed",
        "title": "Ding 2024, case 3 [b]",
        "cells": 1632,
        "quantities": {name: Quantity(0.123456, "kg/s", 1.2e-3) for name in NAMES}
        | {"pressure_drop": Quantity(4012.0, "Pa", 12.0, references=references)},
        "seconds": {"setup": 0.2, "solve": 2.05},
        "balances": {"solids_mass": 1.2e-13},
        "skipped": [f"part {i}: " + "a long reason " * 6 for i in range(9)],
        "inferred": [f"input {i}" for i in range(9)],
        "directory": Path("results") / "a-very-long-directory-name" / ("x" * 60),
    }
    out = io.StringIO()
    console = Console(file=out, width=120, force_terminal=terminal, highlight=False)
    print_summary(Result(**(content | changes)), console)
    return out.getvalue()


def test_summary_fits_a_screen() -> None:
    lines = printed().splitlines()
    assert len(lines) <= 40
    directory = [line for line in lines if line.startswith("files")]
    assert len(directory) == 1
    assert directory[0].endswith("x" * 60)
    assert max(len(line) for line in lines if line not in directory) <= 80


def test_summary_is_plain_in_a_file_and_coloured_on_a_terminal() -> None:
    assert "\x1b" not in printed()
    assert "\x1b" in printed(terminal=True)


def test_quantities_stand_beside_their_references() -> None:
    lines = [line.split() for line in printed().splitlines()]
    assert ["pressure_drop", "4012", "12", "Pa"] in lines
    assert ["Ding", "2024,", "mesh", "D", "4090", "Pa", "-1.9", "%"] in lines
    assert any(line[-4:] == ["4260", "Pa", "-5.8", "%"] for line in lines)


def test_an_error_is_said_to_be_that_of_the_mesh() -> None:
    assert "± mesh" in printed() and "inputs carry none" in printed()
    unknown = {"pressure_drop": Quantity(4012.0, "Pa")}
    assert "inputs carry none" not in printed(quantities=unknown)


def test_what_inputs_move_is_told_apart_from_the_mesh() -> None:
    """Changes of 3 and 4 % down and 0.5 % up make 4012 Pa lie between 3811 and 4032 Pa."""
    inputs = [
        InputRange("solids.diameter", 1e-4, 2e-4, -0.03, 0.005, "a sieve"),
        InputRange("gas.density", 30.0, 33.0, -0.04, 0.0, "a thermometer"),
    ]
    text = printed(inputs=inputs, estimates=["a correlation gives 3 Pa/m"])
    lines = [line.split() for line in text.splitlines()]
    assert ["unprinted", "inputs", "3810", "to", "4030", "Pa"] in lines
    assert "mesh alone" in text and "inputs carry none" not in text
    assert "solids.diameter from 0.0001 to 0.0002: -3.0 to +0.5 % (a sieve)" in text
    assert "plausible a correlation gives 3 Pa/m" in text
    assert max(map(len, text.splitlines()[:-1])) <= 80


def test_what_an_answer_says_of_itself_stands_in_full() -> None:
    """However long the list of what was skipped is."""
    notes = [f"the mesh that the case asks for: doubt {i}; this is a finer one" for i in range(5)]
    text = printed(notes=notes)
    assert all(f"note      {note}" in text for note in notes)


@pytest.mark.parametrize(
    "text",
    ["Ding 2024, case 3 [b]", "converged: dense flow, developed", "1 632 cells",
     "solids mass 1.2e-13", "and 6 more, in result.json", "input 2", "setup 0.2 s, solve 2.0 s"],
)  # fmt: skip
def test_summary_says(text: str) -> None:
    assert text in printed()


def test_failure_says_why_and_shows_no_numbers() -> None:
    text = printed(status="failed", reason="no steady state after 200 steps [/]")
    assert "no steady state after 200 steps [/]" in text
    assert "pressure_drop" not in text


@pytest.mark.parametrize(
    ("value", "text"),
    [(0, "0"), (1672.31, "1672"), (0.24512, "0.2451"), (-3.2, "-3.200"), (12345678.0, "1.235e+07"),
     (1.2345e-5, "1.234e-05"), (2e-4, "0.0002000"), (None, "-"), (math.nan, "-")],
)  # fmt: skip
def test_number(value: float | None, text: str) -> None:
    assert number(value) == text


@pytest.mark.parametrize(
    ("value", "reference", "text"),
    [(102.0, 100.0, "+2.0 %"), (98.0, 100.0, "-2.0 %"), (1.0, 0.0, "-"), (math.nan, 1.0, "-")],
)
def test_difference(value: float, reference: float, text: str) -> None:
    assert difference(value, reference) == text

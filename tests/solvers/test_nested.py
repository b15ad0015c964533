# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ways to a steady state: their order, and what a way that failed leaves to the next."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from fem_tfm.scenes.dense import SCHEME
from fem_tfm.solvers import nested
from fem_tfm.solvers.easing import MeshTerms
from fem_tfm.solvers.pseudo_time import PseudoTimeControl


def ways(previous: Any, told: list[Any]) -> tuple[list[Any], list[Any]]:
    """Quick and patient ways of a section of which only its terms are looked at."""
    scheme = replace(
        SCHEME,
        cold=lambda section: told.append("cold"),
        warm=lambda section, other: told.append(("warm", other)),
        calm=lambda section: told.append("calm"),
        ease=lambda section, terms: told.append(terms),
    )
    section = SimpleNamespace(newton=None, old=None, idt=None)
    control = PseudoTimeControl(
        first=1e-3, largest=1e3, smallest=1e-9, tolerance=1e-9, max_steps=200
    )
    return nested._ways(section, control, previous, nested.QUIET, scheme)


@pytest.mark.parametrize(
    ("previous", "first"), [(None, ["cold"]), (7, 2 * [("warm", 7)] + ["cold"])]
)
def test_a_calm_start_ends_the_quick_ways(previous: Any, first: list[Any]) -> None:
    told: list[Any] = []
    quick, _ = ways(previous, told)
    for _, begin in quick:
        begin(None)
    *plain, terms, last = told
    assert plain == first and last == "calm"
    assert terms.strength == 1.0 and terms.rate > 1


def test_a_careful_start_has_the_standard_terms_of_the_mesh() -> None:
    """The calm start before it has raised them."""
    told: list[Any] = []
    _, patient = ways(None, told)
    patient[0][1](None)
    assert told == [MeshTerms(), "cold"]

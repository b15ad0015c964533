# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ways to a steady state: their order, and what a way that failed leaves to the next."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

from fem_tfm.scenes.dense import SCHEME
from fem_tfm.solvers import easing, nested
from fem_tfm.solvers.easing import MeshTerms
from fem_tfm.solvers.pseudo_time import PseudoTimeControl


def ways(previous: Any, told: list[Any]) -> Any:
    """Ways of a section of which only its terms are looked at."""
    scheme = replace(
        SCHEME,
        cold=lambda section: told.append("cold"),
        warm=lambda section, other: told.append(("warm", other)),
        calm=lambda section: told.append("calm"),
        ease=lambda section, terms: told.append(terms),
    )
    section = SimpleNamespace(newton=None, old=None, idt=None, lag=None)
    control = PseudoTimeControl(
        first=1e-3, largest=1e3, smallest=1e-9, tolerance=1e-9, max_steps=200
    )
    return nested._ways(section, control, previous, nested.QUIET, scheme)


def starts(found: list[Any], told: list[Any]) -> list[Any]:
    """What the starts of some ways do to the section."""
    told.clear()
    for _, begin in found:
        begin(None)
    return list(told)


CALM = [MeshTerms(rate=10**easing.CALMEST), "calm"]


def test_a_cold_mesh_starts_with_stronger_terms_then_without_then_calm() -> None:
    told: list[Any] = []
    expected = [MeshTerms(4.0), "cold", MeshTerms(), "cold", *CALM, *CALM]
    assert starts(ways(None, told).quick, told) == expected


def test_a_finer_mesh_starts_from_the_coarser_answer_then_calm_then_both_again() -> None:
    """Each with the standard terms of the mesh: a way before may have raised them."""
    told: list[Any] = []
    warm, cold = [MeshTerms(), ("warm", 7)], [MeshTerms(), "cold"]
    assert starts(ways(7, told).quick, told) == [*warm, *warm, *CALM, *warm, *cold, *CALM]


def test_a_careful_start_has_the_standard_terms_of_the_mesh() -> None:
    """The calm start before it has raised them."""
    told: list[Any] = []
    assert starts(ways(None, told).patient[:1], told) == [MeshTerms(), "cold"]


def test_a_section_without_such_terms_has_the_marches_alone() -> None:
    section = SimpleNamespace(newton=None, old=None, idt=None, lag=None)
    control = PseudoTimeControl(first=1e-3, largest=1e3, smallest=1e-9)
    scheme = replace(SCHEME, ease=None, calm=None)
    found = nested._ways(section, control, None, nested.QUIET, scheme)
    assert len(found.quick) == len(found.patient) == 1

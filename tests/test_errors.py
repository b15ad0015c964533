# SPDX-License-Identifier: LGPL-3.0-or-later
"""The sentences that users read when something is wrong."""

from __future__ import annotations

import pickle

import pytest

from fem_tfm.errors import FemTfmError, InputError, SolverError, nearest


def test_sentence_names_key_value_range_and_neighbour() -> None:
    error = InputError("closures.drag", "wen-yo", "one of ergun, wen-yu", "wen-yu")
    assert str(error) == (
        "closures.drag = 'wen-yo' is refused: "
        "expected one of ergun, wen-yu (did you mean 'wen-yu'?)"
    )


def test_missing_value_reads_as_not_given() -> None:
    error = InputError("gas.viscosity", None, "a number above 0 [Pa s]")
    assert str(error) == "gas.viscosity is not given: expected a number above 0 [Pa s]"


def test_booleans_read_as_in_toml() -> None:
    assert "title = true is refused" in str(InputError("title", True, "a text"))


def test_long_values_are_cut() -> None:
    assert len(str(InputError("title", "x" * 10000, "a short text"))) < 120


def test_errors_travel_between_ranks() -> None:
    error = InputError("solids.diameter", -1, "a number above 0 [m]", "solids.diameter")
    copied = pickle.loads(pickle.dumps(error))
    assert (type(copied), str(copied), copied.key) == (InputError, str(error), error.key)


@pytest.mark.parametrize("kind", [InputError("a", 1, "b"), SolverError("no convergence")])
def test_one_base_catches_all(kind: Exception) -> None:
    assert isinstance(kind, FemTfmError)


@pytest.mark.parametrize(
    ("name", "found"),
    [("diamter", "diameter"), ("DIAMETER", "diameter"), ("xyz", None), (3, None)],
)
def test_nearest(name: object, found: str | None) -> None:
    assert nearest(name, ["density", "diameter"]) == found

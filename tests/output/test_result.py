# SPDX-License-Identifier: LGPL-3.0-or-later
"""result.json has the keys that users' scripts rely on, and nothing that JSON forbids."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

from fem_tfm.output.result import (
    Quantity,
    Reference,
    Result,
    cpu_seconds,
    peak_memory_mb,
    versions,
)

KEYS = {
    "status", "flow", "solution", "cells", "dofs", "ranks", "seconds", "cpu_seconds",
    "peak_memory_mb", "quantities", "balances", "skipped", "inferred", "inputs",
    "estimates",
        "unestimated", "versions",
}  # fmt: skip


def a_result(**changes: Any) -> Result:
    """A complete result."""
    references = (Reference(4090.0, "mesh D"), Reference(4260.0, "experiment"))
    content = {
        "status": "converged",
        "flow": "dense",
        "solution": "developed",
        "title": "a case",
        "cells": np.int32(320),
        "dofs": 6000,
        "seconds": {"setup": 0.5, "solve": 2.0},
        "cpu_seconds": 2.5,
        "peak_memory_mb": 300.0,
        "quantities": {
            "pressure_gradient": Quantity(np.float64(1700.0), "Pa/m", 5.0, 1704.2, "mesh D"),
            "pressure_drop": Quantity(4080.0, "Pa", references=references),
            "holdup": Quantity(math.nan, "-", math.inf),
        },
        "balances": {"solids_mass": 1e-12, "gas_mass": math.nan},
        "skipped": ["heat: not asked for"],
        "inferred": ["diameter"],
        "versions": {"python": "3"},
    }
    return Result(**(content | changes))


def refuse(constant: str) -> None:
    raise AssertionError(f"{constant} is no JSON")


def test_keys_are_those_promised(tmp_path: Path) -> None:
    text = a_result().write(tmp_path).read_text()
    content = json.loads(text, parse_constant=refuse)
    assert set(content) == KEYS | {"title", "reason", "warnings", "notes"}
    assert content["quantities"]["pressure_gradient"] == {
        "value": 1700.0,
        "unit": "Pa/m",
        "error_estimate": 5.0,
        "reference": 1704.2,
        "source": "mesh D",
    }
    assert content["cells"] == 320


def test_several_references_follow_the_first() -> None:
    entry = a_result().as_dict()["quantities"]["pressure_drop"]
    assert (entry["reference"], entry["source"]) == (4090.0, "mesh D")
    assert entry["references"] == [
        {"value": 4090.0, "source": "mesh D"},
        {"value": 4260.0, "source": "experiment"},
    ]
    given = Quantity(4080.0, "Pa", references=entry["references"])
    assert given == a_result().quantities["pressure_drop"]


def test_what_is_not_finite_becomes_null() -> None:
    content = a_result().as_dict()
    holdup = content["quantities"]["holdup"]
    assert holdup["value"] is None
    assert holdup["error_estimate"] is None
    assert content["balances"]["gas_mass"] is None


def test_result_is_read_as_it_was_written(tmp_path: Path) -> None:
    result = a_result(directory=Path("elsewhere"))
    result.write(tmp_path)
    for path in (tmp_path, tmp_path / "result.json"):
        again = Result.read(path)
        assert again.as_dict() == result.as_dict()
        assert again["pressure_gradient"] == 1700.0
        assert again.quantities["pressure_drop"] == result.quantities["pressure_drop"]
        assert math.isnan(again["holdup"])
        assert again.directory == tmp_path


def test_item_is_the_value() -> None:
    result = a_result()
    assert result["pressure_drop"] == 4080.0
    assert "pressure_drop" in result
    assert "nusselt" not in result


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("presure_gradient", "did you mean pressure_gradient"),
        ("zzz", "there are pressure_gradient, pressure_drop, holdup"),
    ],
)
def test_unknown_quantity_names_the_nearest(name: str, hint: str) -> None:
    with pytest.raises(KeyError, match=hint):
        a_result()[name]


def test_failed_result_carries_no_quantities() -> None:
    result = a_result(status="failed", reason="no steady state")
    content = result.as_dict()
    assert content["quantities"] == {}
    assert content["balances"] == {}
    with pytest.raises(KeyError, match="failed without any: no steady state"):
        result["pressure_gradient"]


@pytest.mark.parametrize("change", [{"status": "done"}])
def test_unknown_status_is_refused(change: dict[str, str]) -> None:
    with pytest.raises(ValueError, match="is none of"):
        a_result(**change)


def test_versions_name_what_is_loaded() -> None:
    found = versions()
    assert found["numpy"] == np.__version__
    assert found["python"].count(".") == 2
    assert found["mpi"].isprintable()


@pytest.mark.mpi
def test_costs_are_summed_over_ranks() -> None:
    comm = MPI.COMM_WORLD
    for measure in (cpu_seconds, peak_memory_mb):
        before = measure()
        total = measure(comm)
        assert total >= comm.allreduce(before) > 0
        assert comm.allreduce(total) == pytest.approx(comm.size * total)


def test_cpu_time_grows_with_work() -> None:
    before = cpu_seconds()
    while cpu_seconds() < before + 0.02:
        sum(range(10_000))
    assert cpu_seconds() - before < 1.0
    assert 10 < peak_memory_mb() < 100_000

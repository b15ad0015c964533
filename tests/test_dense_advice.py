# SPDX-License-Identifier: LGPL-3.0-or-later
"""Warnings about cases that were probably not meant, and what `check` tells."""

from pathlib import Path
from typing import Any

import pytest

from fem_tfm.case import Case
from fem_tfm.flows import describe
from fem_tfm.flows.dense import advice


@pytest.fixture
def demo(root: Path) -> Case:
    return Case.load(root / "demos/dense_pipe/case3.toml")


def test_the_demo_needs_no_advice(demo: Case) -> None:
    assert advice(demo) == []


@pytest.mark.parametrize(
    ("changes", "part"),
    [
        ({"closures.friction": "schaeffer"}, "packed fraction"),
        ({"closures.friction": "syamlal"}, "packed fraction"),
        ({"closures.turbulence": "laminar"}, "laminar at a Reynolds number"),
        ({"walls.gas": "no-slip"}, "viscous lengths"),
    ],
)
def test_advice(demo: Case, changes: dict[str, Any], part: str) -> None:
    (sentence,) = advice(demo.with_values(changes))
    assert part in sentence


def test_a_packed_friction_limit_is_fine(demo: Case) -> None:
    changes = {"closures.friction": "schaeffer", "solids.friction_limit": 0.58}
    assert advice(demo.with_values(changes)) == []


def test_describe_tells_what_is_solved_and_skipped(demo: Case) -> None:
    told = describe(demo)
    assert "hold-up 0.245" in told["given"]
    assert "320 cells" in told["finest_mesh"]
    assert any("mirror" in line for line in told["skipped"])
    assert "friction: berzi" in told["closures"]

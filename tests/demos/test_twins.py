# SPDX-License-Identifier: LGPL-3.0-or-later
"""Each demo stands twice, as a case file and in Python, and both are the same scene."""

from __future__ import annotations

import runpy
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import fem_tfm as ft

DEMOS = Path(__file__).parents[2] / "demos"
TWINS = sorted(
    p.with_suffix("")
    for p in DEMOS.rglob("*.toml")
    if p.stem != "study" and p.with_suffix(".py").exists()
)
# what says nothing about the flow
WORDS: dict[str, Any] = {
    "title": "",
    "inferred": (),
    "uncertain": (),
    "references": (),
    "output": ft.Output(),
}


def plain(scene: Any) -> Any:
    """A scene without words."""
    return replace(scene, **{name: v for name, v in WORDS.items() if hasattr(scene, name)})


def built(demo: Path) -> Any:
    """The scene that a twin builds; it is not run."""
    return runpy.run_path(str(demo.with_suffix(".py")))["scene"]


def test_the_demos_have_twins() -> None:
    told = {str(demo.relative_to(DEMOS)) for demo in TWINS}
    dense = ("bend90", "case3", "developing", "dune", "startup", "swept_bed")
    assert {f"dense_pipe/{name}" for name in dense} <= told
    assert {"square_duct/developing", "square_duct/gas"} <= told
    assert {"square_duct/particles", "square_duct/two_way"} <= told
    assert {"dilute/bend", "dilute/pipe"} <= told
    assert {"slug_tube/bend", "slug_tube/slug_tube"} <= told


@pytest.mark.parametrize("demo", TWINS, ids=lambda demo: f"{demo.parent.name}/{demo.name}")
def test_a_twin_builds_the_scene_of_its_case_file(demo: Path) -> None:
    assert plain(built(demo)) == plain(ft.load(f"{demo}.toml"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "quantity"),
    [("dense_pipe/case3", "pressure_drop"), ("square_duct/gas", "friction_factor")],
)
def test_both_give_the_same_number(name: str, quantity: str) -> None:
    demo = DEMOS / name
    found = [scene.run()[quantity] for scene in (built(demo), ft.load(f"{demo}.toml"))]
    assert found[0] == pytest.approx(found[1], rel=1e-12)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""The time that is told before a run: of every kind of scene, and what it depends on."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from fem_tfm.bench import times
from fem_tfm.bench.demo import demo
from fem_tfm.geometry import mesh
from fem_tfm.models.slug.tube import SlugTube
from fem_tfm.scenes.kinds import KINDS


def told(name: str, **changes: Any) -> float:
    """What is told of a demo with dotted keys changed [s]."""
    case = demo(f"{name}.toml", {k.replace("__", "."): v for k, v in changes.items()})
    return case.scene.expected_time()


def test_thirty_cases_of_every_kind_are_timed() -> None:
    cases = times.cases()
    assert len(cases) == 30
    assert len({case.dump() for case in cases.values()}) == 30
    kinds = {(case.scene.kind.flow, case.scene.solution) for case in cases.values()}
    assert kinds == {(kind.flow, kind.solution) for kind in KINDS}
    for name, case in cases.items():
        assert 0.5 < case.scene.expected_time() < 120.0, name


@pytest.mark.parametrize(
    ("name", "more"),
    [
        ("dense_pipe/algebraic", {"numerics__level": 5}),
        ("dense_pipe/developing", {"numerics__level": 3}),
        ("dense_pipe/developing", {"numerics__axial_step": 0.005}),
        ("dense_pipe/developing", {"numerics__axial_accuracy": 0.005}),
        ("square_duct/developing", {"geometry__length": 40.0}),
        ("square_duct/particles", {"particles__parcels": 2000}),
        ("dense_pipe/dune", {"numerics__end_time": 2.0}),
        ("slug_tube/slug_tube", {"numerics__end_time": 60.0}),
    ],
)
def test_more_work_is_told_to_take_longer(name: str, more: dict[str, Any]) -> None:
    assert told(name, **more) > 1.3 * told(name)


def test_lines_that_settle_are_told_to_take_longer() -> None:
    """Bouncing grains more than a riser of as many unknowns, a strand or a bed more than those."""
    found = {name: case.scene.expected_time() for name, case in times.cases().items()}
    bouncing, bedded = found["coal, level"], found["pulverised coal, a bed"]
    assert found["glass, riser"] < bouncing < bedded == found["flour, level"]


@pytest.mark.parametrize("name", ["dense_pipe/developing", "square_duct/developing"])
def test_a_march_is_told_with_that_for_its_error(name: str) -> None:
    alone = told(name, numerics__error_estimate=False)
    assert told(name) == pytest.approx(1.2 * alone)


def test_a_gas_that_feels_its_particles_is_told_without() -> None:
    alone = told("square_duct/two_way", numerics__error_estimate=False)
    assert told("square_duct/two_way") == alone


def test_what_children_take_counts() -> None:
    """The C compiler of new forms is one."""
    busy = "import time\nwhile time.process_time() < 0.4: pass"
    scene = SimpleNamespace(
        expected_time=lambda: 1.0, run=lambda _: subprocess.run([sys.executable, "-c", busy])
    )
    # counted in hundredths of a second
    assert times.measure("busy", SimpleNamespace(scene=scene)).taken >= 0.35


def test_a_time_within_the_factor_is_close() -> None:
    found = [times.Timed("a", 1.0, taken, "answer") for taken in (0.3, 0.34, 2.9, 3.1)]
    assert [one.close for one in found] == [False, True, True, False]
    assert times.summary(found).startswith("2 of 4 within a factor of 3; ratios from 0.30 to 3.10")
    assert math.isclose(found[3].ratio, 3.1)


@pytest.mark.parametrize(
    "name",
    [
        "dense_pipe/case3",
        "dense_pipe/developing",
        "dense_pipe/dune",
        "square_duct/particles",
        "slug_tube/slug_tube",
    ],
)
def test_what_is_described_is_made_once(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    given, made = demo(f"{name}.toml", {}).scene, []

    def counted(make: Any) -> Any:
        def work(*arguments: Any, **more: Any) -> Any:
            made.append(make)
            return make(*arguments, **more)

        return work

    for owner, maker in ((mesh, "_build"), (SlugTube, "__init__")):
        monkeypatch.setattr(owner, maker, counted(getattr(owner, maker)))
    scene = replace(given)
    scene.describe()
    scene.expected_time()
    assert made and len(made) == len(set(made))

# SPDX-License-Identifier: LGPL-3.0-or-later
"""The figures of the slug tube: what is said of points with errors, and the page."""

from __future__ import annotations

import csv
import importlib
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fem_tfm.case import Case
from fem_tfm.study import sweep
from fem_tfm.study.sweep import Point

DEMO = Path(__file__).parents[2] / "demos" / "slug_tube"


@pytest.fixture
def said(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(DEMO))
    return importlib.import_module("figures_said")


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(DEMO))
    return importlib.import_module("figures")


def point(number: int, key: str, value: Any, drop: float, *warnings: str) -> Point:
    found = {"pressure_gradient": drop, "grains_in_tube": 3000.0}
    errors = {"pressure_gradient": 50.0, "grains_in_tube": None}
    return Point(number, {key: value}, "finished", "", "cold", found, errors, 1.0, 0, [*warnings])


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (884.3, 24.0, "884 ± 24"),
        (0.4497, 0.014, "0.450 ± 0.014"),
        (1.33, None, "1.33"),
        (3.0, math.nan, "3"),
        (math.nan, 1.0, "none"),
    ],
)
def test_numbers_have_the_digits_of_their_errors(
    said: Any, value: float, error: float | None, text: str
) -> None:
    assert said.told(value, error) == text


@pytest.mark.parametrize(
    ("drops", "words"),
    [
        ((900, 800, 700), "falls: -200 ± 71"),
        ((700, 800, 900), "rises: +200 ± 71"),
        ((900, 905, 930), "does not change beyond its error: +30 ± 71"),
    ],
)
def test_a_trend_is_a_change_beyond_its_error(said: Any, drops: Any, words: str) -> None:
    (first, *_) = said.trend([(x, y, 50.0) for x, y in zip((1, 2, 4), drops, strict=True)])
    assert words in first


def test_a_tube_is_steady_or_what_it_is_warned_of(said: Any) -> None:
    full = "the tube is full over more than the stretch in 90 % of the samples: bulk, not slugs"
    filling = "the tube is not steady: 100 grains in the first half of what is averaged"
    assert said.regime([]) == said.regime(["few for statistics"]) == "steady"
    assert said.regime([filling]) == "not steady" and said.regime([filling, full]) == "full"


def test_a_peak_stands_out_of_the_errors(said: Any) -> None:
    high = said.trend([(0.0, 100.0, 20.0), (0.1, 200.0, 20.0), (0.2, 110.0, 20.0)])
    low = said.trend([(0.0, 100.0, 20.0), (0.1, 140.0, 20.0), (0.2, 110.0, 20.0)])
    assert any("a peak at 0.1" in text for text in high)
    assert not any("peak" in text for text in low)


def test_proportional_points_lie_on_a_line_through_zero(said: Any) -> None:
    straight = [(x, 350 * x + e, 50.0) for x, e in ((2.5, 20), (5.0, -30), (10.0, 10))]
    (text,) = said.proportional(straight)
    assert text.startswith("proportional") and "350" in text.replace("349.", "350.")
    (bent,) = said.proportional([(x, 100 * x**2, 50.0) for x in (2.5, 5.0, 10.0)])
    assert bent.startswith("not proportional")
    assert said.proportional([(0.0, 1.0, 1.0), (1.0, 2.0, 1.0), (2.0, 3.0, 1.0)]) == []


def test_points_of_several_sweeps_stand_in_the_order_of_the_key(figures: Any) -> None:
    key = figures.FRICTION
    points = {
        "middle": [point(0, figures.GAS, 1.0, 900.0)],
        "friction": [point(0, key, 0.8, 1400.0), point(1, key, 0.1, 200.0), Point(2, {key: 0.2})],
    }
    found = figures.curve(points, key, "middle", "friction")
    assert [(p.values[key], p.quantities["pressure_gradient"]) for p in found] == [
        (0.1, 200.0), (0.5, 900.0), (0.8, 1400.0),
    ]  # fmt: skip


def test_the_page_has_all_figures_beside_the_paper(figures: Any, tmp_path: Path) -> None:
    key = figures.FRICTION
    unsteady = "the tube is not steady: 100 grains in the first half of what is averaged"
    points = {
        "middle": [point(0, figures.GAS, 1.0, 900.0)],
        "friction": [point(0, key, 0.1, 200.0, unsteady)],
        "rolling": [point(0, figures.ROLLING, 0.05, 250.0)],
    }
    figures.write(tmp_path, None, points)
    page = (tmp_path / "figures.html").read_text(encoding="utf-8")
    assert [n for n in range(1, 22) if f"<h2>Figure {n}</h2>" not in page] == []
    assert page.count("The paper: ") == 22
    assert "200 ± 50" in page and "rises: +700 ± 71" in page
    assert (tmp_path / "figure_7.png").stat().st_size > 5000
    assert (tmp_path / "curves.png").stat().st_size > 5000
    with (tmp_path / "curves.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert rows[1]["pressure_gradient error [Pa/m]"] == "50.0" and rows[1]["warnings"] == unsteady


def test_numbers_of_the_figures_are_those_of_the_tables(said: Any) -> None:
    z = np.linspace(0.01, 0.51, 21)
    names = ("rate", "least_porosity", "top_velocity", "length")
    columns = {"place": z} | {name: z + n for n, name in enumerate(names)}
    columns |= {f"{name} error": np.full(21, 0.005) for name in names}
    assert "0.210 ± 0.010 at 20 cm" in said.along(columns)["8"]
    assert "2.310 ± 0.010 at 30 cm" in said.along(columns)["10"]


def test_every_curve_is_a_case(figures: Any) -> None:
    base = Case.load(DEMO / "curves.toml")
    for curve in figures.CURVES.values():
        changed = base.with_values({**curve.settings, curve.key: curve.values[-1]})
        assert changed.scene.begin < changed.scene.numerics.end_time


def test_what_an_older_command_has_solved_is_not_run_again(
    figures: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    curve = figures.CURVES["viscosity"]
    case = Case.load(DEMO / "curves.toml").with_values(curve.settings)
    plan = sweep.Plan(case, tmp_path / "viscosity")
    sweep._prepare(plan, {})
    for number, value in enumerate(curve.values):
        plan.save(point(number, curve.key, value, 900.0 + number))
    monkeypatch.setattr(sweep, "solve", lambda plan, route: iter(()) if not route else 1 / 0)
    found = figures.swept(tmp_path, "viscosity", 1, {})
    assert [p.quantities["pressure_gradient"] for p in found] == [900.0, 901.0]
    assert [p.values[curve.key] for p in found] == list(curve.values)

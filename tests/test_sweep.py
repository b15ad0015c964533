# SPDX-License-Identifier: LGPL-3.0-or-later
"""A sweep: its order, its warm starts, its table, and points that fail."""

from __future__ import annotations

import csv
import itertools
from pathlib import Path
from typing import Any

import pytest

from fem_tfm import sweep
from fem_tfm.case import Case
from fem_tfm.errors import InputError, SolverError
from fem_tfm.flows import dense, developed, section
from fem_tfm.flows.dense import setup_of
from fem_tfm.flows.section import Setup

SPEED, FRACTION = "operation.gas_superficial_velocity", "operation.solids_fraction"


class Silent:
    """An observer of a solve that says nothing."""

    def compiling(self, what: str) -> None: ...
    def begin(self, *place: Any) -> None: ...
    def step(self, row: dict[str, float]) -> None: ...


def coarse(values: dict[str, Any]) -> Case:
    return Case.from_dict({**values, "numerics": {"level": 1}})


def table(out: Path) -> list[dict[str, str]]:
    with (out / sweep.TABLE).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("lengths", [(5,), (2, 3), (3, 2, 4), (1, 1)])
def test_the_tour_visits_all_and_changes_one_value_at_a_time(lengths: tuple[int, ...]) -> None:
    # 1, 0, 3, 2, ...: neighbours in number are not so in place
    vary = {str(k): sorted(range(n), key=lambda i: i ^ 1) for k, n in enumerate(lengths)}
    found = sweep.combinations(vary)
    order = sweep.tour([sweep.in_line(values) for values in vary.values()])
    assert sorted(order) == list(range(len(found)))
    for a, b in itertools.pairwise(order):
        assert sum(abs(found[a][key] - found[b][key]) for key in vary) == 1


def test_names_are_visited_as_they_are_given() -> None:
    assert sweep.in_line(["wen-yu", "ergun"]) == sweep.in_line([True, False]) == [0, 1]


def test_numbers_are_visited_from_the_end_next_to_the_first() -> None:
    assert sweep.in_line([2, 1.5, 3, 4]) == [1, 0, 2, 3]
    assert sweep.in_line([3, 1.5, 2]) == [0, 2, 1]


def test_chunks_keep_the_route_and_share_it_evenly() -> None:
    route = [sweep.Point(i, {}) for i in range(7)]
    parts = sweep.chunks(route, 3)
    assert [p for part in parts for p in part] == route
    assert {len(part) for part in parts} == {2, 3}
    assert len(sweep.chunks(route[:2], 5)) == 2


def test_a_neighbour_costs_a_quarter_and_is_the_cold_answer(
    dense: dict[str, Any], tmp_path: Path
) -> None:
    case = coarse(dense)
    found = sweep.run(case, {SPEED: [6.43, 6.6, 6.8]}, tmp_path)
    first, *others = found.points
    assert not found.failed
    assert [p.start for p in found.points] == ["cold", "warm", "warm"]
    for point in others:
        assert point.factorisations <= first.factorisations / 4
    (alone,) = sweep.solve(case, [sweep.Point(0, others[-1].values)])
    assert alone.start == "cold"
    for name, value in alone.quantities.items():
        assert others[-1].quantities[name] == pytest.approx(value, rel=1e-7)


def test_updated_numbers_are_those_of_a_new_section(dense: dict[str, Any]) -> None:
    """Every kind of number changes at once: gas, grains, law parameters, gravity, wall distance."""
    case = coarse(dense)
    changes = {
        "gas.density": 30.0,
        "solids.density": 1650.0,
        "solids.restitution": 0.72,
        "geometry.inclination_deg": 5.0,
        "walls.distance": 1.2e-4,
        "closures.turbulence.A": 30.0,
        "walls.solids.friction_coefficient": 0.45,
        SPEED: 6.6,
        FRACTION: 0.25,
    }
    points = [sweep.Point(0, {}), sweep.Point(1, changes)]
    warm = list(sweep.solve(case, points))[1]
    (cold,) = sweep.solve(case, [sweep.Point(1, changes)])
    assert (warm.start, cold.start) == ("warm", "cold")
    assert warm.quantities["pressure_gradient"] == pytest.approx(
        cold.quantities["pressure_gradient"], rel=1e-7
    )


def test_a_far_point_is_approached_in_parts(dense: dict[str, Any], monkeypatch) -> None:
    """A point that one step does not reach is followed to, and its answer is the cold one."""
    case, shares = coarse(dense), []

    def between(a: Setup, b: Setup, share: float) -> Setup:
        shares.append(share)
        return section.between(a, b, share)

    monkeypatch.setattr(developed, "between", between)
    far = {SPEED: 2.5, FRACTION: 0.45}
    warm = list(sweep.solve(case, [sweep.Point(0, {}), sweep.Point(1, far)]))[1]
    (cold,) = sweep.solve(case, [sweep.Point(1, far)])
    assert (warm.status, warm.start, cold.start) == ("converged", "warm", "cold")
    assert 0.0 < min(shares) < max(shares) == 1.0
    assert warm.quantities["pressure_gradient"] == pytest.approx(
        cold.quantities["pressure_gradient"], rel=1e-7
    )


def test_numbers_between_two_setups(dense: dict[str, Any]) -> None:
    case = coarse(dense)
    changed = case.with_values({SPEED: 8.43, "solids.restitution": 0.9})
    found = section.between(setup_of(case), setup_of(changed), 0.25)
    assert found.gas_velocity == pytest.approx(6.93)
    assert found.solids.restitution == pytest.approx(0.75)
    assert found.structure == setup_of(case).structure
    assert section.between(setup_of(case), setup_of(changed), 1.0) == setup_of(changed)


def test_another_mesh_starts_cold(dense: dict[str, Any]) -> None:
    case = coarse(dense)
    points = [sweep.Point(i, {"geometry.diameter": d}) for i, d in enumerate((0.010, 0.011))]
    assert [p.start for p in sweep.solve(case, points)] == ["cold", "cold"]


def test_lines_are_swept_too(dense: dict[str, Any]) -> None:
    """Every point of a developing flow starts at its inlet."""
    dense["operation"]["solids_velocity"] = 6.09
    dense["geometry"]["length"] = 1e-3
    case = coarse(dense).with_values({"solution": "developing"})
    points = [sweep.Point(i, {SPEED: speed}) for i, speed in enumerate((6.43, 6.8))]
    found = list(sweep.solve(case, points))
    assert [(p.status, p.start) for p in found] == [("converged", "cold")] * 2
    drops = [p.quantities["pressure_drop"] for p in found]
    assert 0 < drops[0] < drops[1]
    assert all(p.factorisations > 5 for p in found)


def test_a_section_refuses_other_laws(dense: dict[str, Any]) -> None:
    case = Case.from_dict(dense)
    given = _setup(case)
    other = _setup(case.with_values({"closures.drag": "wen-yu"}))
    more = _setup(case.with_values({"closures.friction_feeds_theta": True}))
    same = _setup(case.with_values({"solids.diameter": 2e-4}))
    assert given.structure == same.structure
    assert given.structure not in (other.structure, more.structure)


def _setup(case: Case) -> Any:
    return dense.setup_of(case)


def test_a_failed_point_has_its_reason_and_the_others_go_on(
    dense: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    solve = developed.solve

    def failing(meshes: Any, setup: Any, *rest: Any) -> Any:
        if setup.gas_velocity == 6.6:
            raise SolverError("made to fail")
        return solve(meshes, setup, *rest)

    monkeypatch.setattr(developed, "solve", failing)
    monkeypatch.setattr(developed, "resolve", lambda held, *rest: failing([], *rest))
    case = coarse(dense)
    found = sweep.run(case, {SPEED: [6.6, 6.43]}, tmp_path)
    bad, good = table(tmp_path)
    assert [p.values[SPEED] for p in found.failed] == [6.6]
    assert (bad["status"], bad["reason"]) == ("failed", "made to fail")
    assert bad["pressure_gradient [Pa/m]"] == ""
    assert good["status"] == "converged" and float(good["pressure_gradient [Pa/m]"]) > 0
    assert good["holdup error [-]"] != ""
    assert "made to fail" in str(found)
    assert (tmp_path / sweep.PICTURE).stat().st_size > 0


@pytest.mark.slow
def test_processes_give_the_same_table(dense: dict[str, Any], tmp_path: Path) -> None:
    case = coarse(dense)
    vary = {SPEED: [6.43, 6.6]}
    alone = sweep.run(case, vary, tmp_path / "one", jobs=1)
    shared = sweep.run(case, vary, tmp_path / "two", jobs=2)
    assert [p.start for p in shared.points] == ["cold", "cold"]
    for one, two in zip(alone.points, shared.points, strict=True):
        assert two.values == one.values
        assert two.quantities == pytest.approx(one.quantities, rel=1e-7)


def test_units_stand_in_the_head(dense: dict[str, Any]) -> None:
    found = sweep.units(["solids.diameter", SPEED, "closures.drag"])
    assert found["solids.diameter"] == "m" and found[SPEED] == "m/s"
    assert found["closures.drag"] == ""


def test_a_bad_combination_is_refused_before_anything_is_written(
    dense: dict[str, Any], tmp_path: Path
) -> None:
    with pytest.raises(InputError, match="diameter"):
        sweep.run(Case.from_dict(dense), {"solids.diameter": [1e-4, -1.0]}, tmp_path / "none")
    assert not (tmp_path / "none").exists()

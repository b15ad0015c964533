# SPDX-License-Identifier: LGPL-3.0-or-later
"""A sweep: its order, its warm starts, its table, and points that fail."""

from __future__ import annotations

import csv
import itertools
import json
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from fem_tfm.case import Case
from fem_tfm.errors import InputError, SolverError
from fem_tfm.models.section import between
from fem_tfm.models.two_fluid.section import Setup
from fem_tfm.scenes.dense import SCHEME, Dense, setup_of
from fem_tfm.scenes.developed import Developed
from fem_tfm.solvers.nested import CAREFUL
from fem_tfm.study import sweep
from fem_tfm.study.sweep import Plan, Point

SPEED, FRACTION = "operation.gas_superficial_velocity", "operation.solids_fraction"


def coarse(values: dict[str, Any]) -> Case:
    return Case.from_dict({**values, "numerics": {"level": 1}})


def fails_at(speed: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let developed sections fail at a gas velocity."""
    solve = Developed.solve

    def failing(scene: Developed, *given: Any) -> Any:
        if scene.feed.gas_velocity == speed:
            raise SolverError("made to fail")
        return solve(scene, *given)

    monkeypatch.setattr(Developed, "solve", failing)


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
    route = [Point(i, {}) for i in range(7)]
    parts = sweep.chunks(route, 3)
    assert [p for part in parts for p in part] == route
    assert {len(part) for part in parts} == {2, 3}
    assert len(sweep.chunks(route[:2], 5)) == 2


@pytest.mark.slow
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
    (alone,) = sweep.solve(Plan(case), [Point(0, others[-1].values)])
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
    points = [Point(0, {}), Point(1, changes)]
    warm = list(sweep.solve(Plan(case), points))[1]
    (cold,) = sweep.solve(Plan(case), [Point(1, changes)])
    assert (warm.start, cold.start) == ("warm", "cold")
    assert warm.quantities["pressure_gradient"] == pytest.approx(
        cold.quantities["pressure_gradient"], rel=1e-7
    )


@pytest.mark.slow
def test_a_far_point_is_approached_in_parts(dense: dict[str, Any], monkeypatch) -> None:
    """A point that one step does not reach is followed to, and its answer is the cold one."""
    case, shares = coarse(dense), []

    def told(a: Setup, b: Setup, share: float) -> Setup:
        shares.append(share)
        return between(a, b, share)

    monkeypatch.setattr(Dense, "scheme", replace(SCHEME, between=told))
    far = {SPEED: 3.0, FRACTION: 0.45}
    warm = list(sweep.solve(Plan(case), [Point(0, {}), Point(1, far)]))[1]
    (cold,) = sweep.solve(Plan(case), [Point(1, far)])
    assert (warm.status, warm.start, cold.start) == ("converged", "warm", "cold")
    assert 0.0 < min(shares) < max(shares) == 1.0
    assert warm.quantities["pressure_gradient"] == pytest.approx(
        cold.quantities["pressure_gradient"], rel=1e-7
    )


def test_numbers_between_two_setups(dense: dict[str, Any]) -> None:
    case = coarse(dense)
    changed = case.with_values({SPEED: 8.43, "solids.restitution": 0.9})
    first, last = setup_of(case.scene), setup_of(changed.scene)
    found = between(first, last, 0.25)
    assert found.gas_velocity == pytest.approx(6.93)
    assert found.model.solids.restitution == pytest.approx(0.75)
    assert found.structure == first.structure
    assert between(first, last, 1.0) == last


def test_another_mesh_starts_cold(dense: dict[str, Any]) -> None:
    case = coarse(dense)
    points = [Point(i, {"geometry.diameter": d}) for i, d in enumerate((0.010, 0.011))]
    assert [p.start for p in sweep.solve(Plan(case), points)] == ["cold", "cold"]


@pytest.mark.slow
def test_lines_are_swept_too(dense: dict[str, Any]) -> None:
    """Every point of a developing flow starts at its inlet."""
    dense["operation"]["solids_velocity"] = 6.09
    dense["geometry"]["length"] = 1e-3
    case = coarse(dense).with_values({"solution": "developing"})
    points = [Point(i, {SPEED: speed}) for i, speed in enumerate((6.43, 6.8))]
    found = list(sweep.solve(Plan(case), points))
    assert [(p.status, p.start) for p in found] == [("finished", "cold")] * 2
    drops = [p.quantities["pressure_drop"] for p in found]
    assert 0 < drops[0] < drops[1]
    assert all(p.factorisations > 5 for p in found)


def test_bends_are_swept_too(root: Path, tmp_path: Path) -> None:
    """An unsteady flow in a bend: no developed section stands in for it."""
    changes = [
        "geometry.length=0.02", "geometry.bend_radius=0.008", "geometry.bend_start=0.003",
        "numerics.axial_cells=8", "numerics.end_time=1e-3", "output.interval=1e-3",
        "output.sections=[]",
    ]  # fmt: skip
    case = Case.load(root / "demos/dense_pipe/bend90.toml", changes)
    found = sweep.run(case, {SPEED: [6.0, 8.0]}, tmp_path, keep=True)
    assert [(p.status, p.start) for p in found.points] == [("finished", "cold")] * 2
    slow, fast = (p.quantities["pressure_drop"] for p in found.points)
    assert 0 < slow < fast
    # what is kept is the run of the bend itself
    alone = case.with_values(found.points[1].values).scene.run()
    assert fast == pytest.approx(alone["pressure_drop"], rel=1e-12)
    stored = json.loads((tmp_path / sweep.POINTS / "1" / "result.json").read_text())
    assert stored["solution"] == "unsteady"


def test_a_section_refuses_other_laws(dense: dict[str, Any]) -> None:
    case = Case.from_dict(dense)
    given = setup_of(case.scene)
    other = setup_of(case.with_values({"closures.drag": "wen-yu"}).scene)
    more = setup_of(case.with_values({"closures.friction_feeds_theta": True}).scene)
    same = setup_of(case.with_values({"solids.diameter": 2e-4}).scene)
    assert given.structure == same.structure
    assert given.structure not in (other.structure, more.structure)


def test_a_failed_point_has_its_reason_and_the_others_go_on(
    dense: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fails_at(6.6, monkeypatch)
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


def test_a_point_that_is_refused_late_has_its_reason(
    dense: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refusing(*given: Any) -> Any:
        raise InputError(SPEED, 6.43, "another one")

    monkeypatch.setattr(Developed, "solve", refusing)
    found = sweep.run(coarse(dense), {SPEED: [6.43]}, tmp_path)
    assert found.failed and table(tmp_path)[0]["reason"].startswith(f"{SPEED} = 6.43 is refused")


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


@pytest.mark.parametrize("jobs", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_sweep_that_was_stopped_goes_on(
    dense: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, jobs: int
) -> None:
    """What failed or was not begun is solved, the rest is taken over; the table is the same."""
    case, vary = coarse(dense), {SPEED: [6.43, 6.6, 6.8]}
    whole = sweep.run(case, vary, tmp_path / "whole")
    out = tmp_path / "stopped"
    with monkeypatch.context() as patched:
        fails_at(6.6, patched)
        sweep.run(case, vary, out)
    (out / sweep.POINTS / "2.json").unlink()
    resumed = sweep.run(case, vary, out, jobs=jobs, resume=True)
    first, *others = resumed.points
    stored = json.loads((out / sweep.POINTS / "0.json").read_text())
    assert first == Point(**stored)
    assert not resumed.failed
    assert [p.start for p in others] == (["cold", "warm"] if jobs == 1 else ["cold", "cold"])
    for one, other in zip(whole.points, resumed.points, strict=True):
        assert other.values == one.values
        assert other.quantities == pytest.approx(one.quantities, rel=1e-7)
    names = ("operation.gas_superficial_velocity [m/s]", "status")
    assert [[row[n] for n in names] for row in table(out)] == [
        [row[n] for n in names] for row in table(tmp_path / "whole")
    ]


def test_the_table_is_written_as_each_point_ends(dense: dict[str, Any], tmp_path: Path) -> None:
    """A sweep that is interrupted leaves the points before."""
    case, solve = coarse(dense), Developed.solve

    def interrupted(scene: Developed, *given: Any) -> Any:
        if scene.feed.gas_velocity == 6.6:
            raise KeyboardInterrupt
        return solve(scene, *given)

    with pytest.MonkeyPatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr(Developed, "solve", interrupted)
        sweep.run(case, {SPEED: [6.43, 6.6]}, tmp_path)
    assert [bool(row["pressure_gradient [Pa/m]"]) for row in table(tmp_path)] == [True, False]
    assert (tmp_path / sweep.POINTS / "0.json").exists()


def test_only_a_sweep_of_this_case_is_resumed(dense: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(InputError, match="this very case"):
        sweep.run(coarse(dense), {SPEED: [6.43]}, tmp_path / "none", resume=True)


@pytest.mark.mpi
def test_results_of_a_point_are_kept_if_asked(dense: dict[str, Any], tmp_path: Path) -> None:
    case = coarse(dense).with_values({"output.xdmf": False, "output.pictures": False})
    found = sweep.run(case, {SPEED: [6.43, 6.6]}, tmp_path, keep=True)
    for point in found.points:
        place = tmp_path / sweep.POINTS / str(point.number) / "result.json"
        gradient = json.loads(place.read_text())["quantities"]["pressure_gradient"]["value"]
        assert gradient == point.quantities["pressure_gradient"]


def test_a_warm_point_does_not_depend_on_how_the_one_before_was_found(
    dense: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Careful marches shorten Newton's steps as a whole: that ends with the point that needs it."""
    case = coarse(dense)
    points = [Point(0, {}), Point(1, {SPEED: 6.8})]
    usual = list(sweep.solve(Plan(case), [replace(p) for p in points]))

    def careful(section: Any, tolerance: float, max_steps: int) -> Any:
        return replace(SCHEME.control(section, tolerance, max_steps), **CAREFUL)

    with monkeypatch.context() as patched:
        patched.setattr(Dense, "scheme", replace(SCHEME, control=careful))
        route = sweep.solve(Plan(case), points)
        first = next(route)
    (second,) = route
    assert first.factorisations != usual[0].factorisations
    assert second.factorisations == usual[1].factorisations
    assert second.quantities == pytest.approx(usual[1].quantities, rel=1e-8)


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


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_point_that_cannot_be_solved_is_refused_before_the_first_solve(
    dense: dict[str, Any], tmp_path: Path, jobs: int
) -> None:
    case = coarse(dense).with_values({"operation.solids_mass_flow": 0.1})
    vary = {"operation.solids_mass_flow": [0.1, 5000.0]}
    with pytest.raises(InputError, match=r"solids_mass_flow = 5000"):
        sweep.run(case, vary, tmp_path / "none", jobs)
    assert not (tmp_path / "none").exists()


def test_a_worker_ends_with_its_parent(tmp_path: Path) -> None:
    """The parent is killed, and what watches for it ends the worker; no signal reaches that."""
    worker = "import os,sys,time,threading;from fem_tfm.study import sweep;sweep.LOOK=0.05;"
    worker += "threading.Thread(target=sweep._end_without,args=(int(sys.argv[1]),)).start();"
    worker += "print(os.getpid(),flush=True);time.sleep(60)"
    parent = "import os,subprocess,sys;"
    parent += "subprocess.Popen([sys.executable,'-c',sys.argv[1],str(os.getpid())]).wait()"
    command = [sys.executable, "-c", parent, worker]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as running:
        assert running.stdout is not None
        assert running.stdout.readline().strip().isdigit()
        running.kill()
        # the pipe closes when the last that holds it has ended
        begun = time.monotonic()
        assert running.stdout.read() == ""
    assert time.monotonic() - begun < 20

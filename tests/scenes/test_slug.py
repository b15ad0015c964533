# SPDX-License-Identifier: LGPL-3.0-or-later
"""The scene of a slug tube: case file and Python, files, restart, what is refused and warned of."""

from __future__ import annotations

import csv
import inspect
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
from mpi4py import MPI

import fem_tfm as ft
from fem_tfm.case import Case
from fem_tfm.errors import InputError, SolverError
from fem_tfm.output.result import unit_of
from fem_tfm.output.slug import pictures
from fem_tfm.scenes.slug import told
from fem_tfm.scenes.slug.recorder import TubeRecorder
from fem_tfm.study import sweep


def case(**changes: Any) -> Case:
    tables: dict[str, Any] = {
        "flow": "slug",
        "geometry": {"diameter": 0.007, "length": 0.1},
        "gas": {"viscosity": 6.73e-5},
        "solids": {"density": 937.0, "diameter": 1.4e-3},
        "operation": {"gas_superficial_velocity": 1.0, "solids_mass_flow": 6.9167e-4},
        "numerics": {"end_time": 1.2},
        "averages": {"begin": 0.4, "low": 0.02, "high": 0.09},
        "output": {"interval": 0.2},
    }
    return Case.from_dict(tables).with_values(changes)


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory) -> tuple[ft.Result, Path]:
    out = tmp_path_factory.mktemp("slug") / "run"
    return case().scene.run(out), out


def test_nothing_is_lost_and_slugs_are_told(solved: tuple[ft.Result, Path]) -> None:
    result, _ = solved
    assert result.status == "finished" and result.balances["grains"] == 0
    assert 300 < result["grains_in_tube"] < 700
    assert result["pressure_gradient"] > 100
    assert any("few for statistics" in text for text in result.warnings)


def test_files_open_in_their_readers(solved: tuple[ft.Result, Path]) -> None:
    _, out = solved
    names = {path.name for path in out.iterdir()}
    wanted = {"grains.pvd", "slugs.csv", "along.csv", "profile.csv", "porosity.png", "slugs.png"}
    assert wanted | {"slug.png"} <= names
    assert wanted | {"film.gif", "fields.xdmf", "result.json", "monitor.csv"} <= names
    listed = (out / "grains.pvd").read_text(encoding="utf-8")
    assert listed.count("DataSet") == 7
    grains = meshio.read(out / "grains_0006.vtu")
    assert (grains.point_data["radius"] == 7e-4).all()
    assert grains.points[:, 2].max() <= 0.1
    assert np.hypot(*grains.points[:, :2].T).max() < 3.5e-3 - 6.5e-4


def test_a_run_that_was_cut_short_goes_on_to_the_same_bits(
    solved: tuple[ft.Result, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, step = solved[0], TubeRecorder.step

    def cut(self: TubeRecorder) -> None:
        step(self)
        if self.tube.number == 1100:
            raise KeyboardInterrupt

    monkeypatch.setattr(TubeRecorder, "step", cut)
    with pytest.raises(KeyboardInterrupt):
        case().scene.run(tmp_path)
    monkeypatch.setattr(TubeRecorder, "step", step)
    found = case().scene.run(tmp_path, resume=True)
    for name in whole.quantities:
        assert found[name] == whole[name], name
    tables = [(out / "monitor.csv").read_text() for out in (solved[1], tmp_path)]
    assert tables[0] == tables[1]


def test_a_run_ends_at_its_time_limit_and_goes_on(tmp_path: Path) -> None:
    short = {"numerics.end_time": 0.3, "averages.begin": 0.1, "output.pictures": False}
    with pytest.raises(SolverError, match=r"time_limit = 1e-06 s is over; its last state"):
        case(**short, **{"numerics.time_limit": 1e-6}).scene.run(tmp_path)
    rest, whole = case(**short).scene.run(tmp_path, resume=True), case(**short).scene.run()
    assert rest["pressure_gradient"] == whole["pressure_gradient"]


BEND: dict[str, Any] = {
    "geometry.shape": "bend",
    "geometry.bend_start": 0.02,
    "geometry.bend_radius": 0.02,
    "geometry.length": 0.08,
    "walls.wear": {"model": "finnie", "K": 3.0},
    "initial.state": "filled",
    "numerics.end_time": 0.25,
    "averages.begin": 0.1,
    "averages.high": 0.07,
    "output.interval": 0.09,
    "output.pictures": False,
}


def test_a_bend_tells_its_drop_and_the_wear_of_its_wall_over_a_restart_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, step = tmp_path / "whole", TubeRecorder.step
    whole = case(**BEND).scene.run(out)
    assert 0 < whole["bend_drop"] < whole["pressure_gradient"] * 0.08
    wall = meshio.read(out / "wall.vtu")
    assert wall.cells[0].type == "triangle"
    a, b, c = (wall.points[wall.cells[0].data[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    data = {name: values[0] for name, values in wall.cell_data.items()}
    assert data["impacts"] @ area == pytest.approx(whole["impact_rate"], rel=1e-9)
    assert data["removed"] @ area == pytest.approx(whole["wear"], rel=1e-9)
    mean = (data["impacts"] * area) @ data["angle"] / whole["impact_rate"]
    assert mean == pytest.approx(whole["impact_angle"], rel=1e-9)
    assert 0 < whole["impact_angle"] < 90 and 0 < whole["impact_speed"] < 2

    def cut(self: TubeRecorder) -> None:
        step(self)
        if self.tube.number == 155:
            raise KeyboardInterrupt

    monkeypatch.setattr(TubeRecorder, "step", cut)
    with pytest.raises(KeyboardInterrupt):
        case(**BEND).scene.run(tmp_path / "cut")
    monkeypatch.setattr(TubeRecorder, "step", step)
    found = case(**BEND).scene.run(tmp_path / "cut", resume=True)
    assert {name: found[name] for name in whole.quantities} == {
        name: whole[name] for name in whole.quantities
    }


@pytest.mark.mpi
def test_ranks_share_a_run_and_go_on_with_it(tmp_path: Path) -> None:
    changes = {"initial.state": "filled", "averages.begin": 0.05, "walls.wear": "oka"}
    changes |= {"closures.contact": "cundall-strack", "output.pictures": False}
    first = case(**changes, **{"numerics.end_time": 0.1}).scene.run(tmp_path / "run")
    found = case(**changes, **{"numerics.end_time": 0.2}).scene.run(tmp_path / "run", resume=True)
    assert first.ranks == found.ranks == MPI.COMM_WORLD.size
    for one in (first, found):
        assert one.balances["grains"] == 0 and one["grains_in_tube"] > 500
    rows = (tmp_path / "run" / "monitor.csv").read_text().splitlines()
    assert len(rows) == 21 and {row.rpartition(",")[2] for row in rows[1:]} == {"0"}
    assert any("the law of wear was fitted from 50 m/s on" in text for text in found.warnings)
    samples = found.sections["samples"]
    assert len(samples.time) == 20
    # all ranks tell the same
    values = MPI.COMM_WORLD.allgather({n: q.value for n, q in found.quantities.items()})
    assert all(one == values[0] for one in values) and found["impact_rate"] > 0
    inside = meshio.read(tmp_path / "run" / "grains_0001.vtu")
    assert len(set(inside.point_data["number"])) == len(inside.points) == samples.count[-1]


def test_no_slug_is_told_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    changes = {"operation.solids_mass_flow": 2e-5, "numerics.end_time": 0.3, "averages.begin": 0.1}
    scene = case(**changes).scene
    found = scene.run()
    rate = found.quantities["slug_rate"]
    assert rate.value == 0 and rate.error_estimate is not None and rate.error_estimate > 0
    assert any("no slug was followed between 0.02 and 0.09 m in 0.2 s" in w for w in found.warnings)
    drawn: list[Any] = []
    monkeypatch.setattr(pictures, "save_figure", lambda figure, *more: drawn.append(figure))
    samples = found.sections["samples"].after(0.1)
    columns, average = told.along(samples, scene), told.profile(samples, scene)
    pictures.slugs_picture("no.png", columns, average, seconds=0.2)
    words = [text.get_text() for axes in drawn[0].axes for text in axes.texts]
    assert words == 4 * ["no slug in 0.2 s"] + 5 * ["no slug there in 0.2 s"]


def test_a_law_is_told_once() -> None:
    assert case().scene.describe()["closures"] == [
        "contact: viscous-coulomb",
        "permeability: carman-kozeny",
    ]
    wall = case(**{"walls.contact": {"model": "viscous-coulomb", "friction": 0.1}}).scene
    assert "contact with the wall: viscous-coulomb" in wall.describe()["closures"]


def test_a_slug_tube_takes_no_cloud_of_particles() -> None:
    names = inspect.signature(ft.Slug).parameters
    assert not {"particles", "resolution"} & names.keys()


def test_python_and_a_case_file_state_the_same_scene() -> None:
    made = ft.Slug(
        ft.DiscreteElements(ft.TubeGas(6.73e-5), ft.Grain(937.0, 1.4e-3)),
        ft.Pipe(0.007, length=0.1),
        ft.Conveying(1.0, 6.9167e-4),
        numerics=ft.TubeNumerics(end_time=1.2),
        averages=ft.Averages(begin=0.4, low=0.02, high=0.09),
        output=ft.Output(interval=0.2),
    )
    assert case().scene == made
    assert Case.from_dict(case().tables).scene == made
    words = made.describe()
    assert "pressure of the gas" not in words["solved"] and "514 a second" in words["given"]


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"averages.begin": 2.0}, "averages.begin"),
        ({"averages.high": 0.2}, "averages.high"),
        ({"averages.low": 0.095}, "averages.high"),
        ({"geometry.diameter": 0.001}, "geometry.diameter"),
        ({"numerics.time_step": 1e-3}, "numerics.time_step"),
        ({"operation.solids_mass_flow": 1.0}, "operation.solids_mass_flow"),
        ({"numerics.level": 3}, "numerics.level"),
        ({"particles.coupling": "one-way"}, "particles.coupling"),
        ({"geometry.shape": "bend", "geometry.bend_start": 0.001}, "geometry.bend_start"),
        ({"operation.solids_velocity": 3.0}, "operation.solids_velocity"),
        ({"walls.wear": "archard"}, "walls.wear"),
        ({"averages.wall_size": 1e-3}, "averages.wall_size"),
        ({"averages.wall_size": 1e-6, "walls.wear": "oka"}, "averages.wall_size"),
    ],
)
def test_what_does_not_fit_is_refused_by_its_key(changes: dict[str, Any], key: str) -> None:
    with pytest.raises(InputError) as caught:
        case(**changes)
    assert caught.value.key == key


@pytest.mark.parametrize(
    ("across", "width", "told"), [(2, 1.0, True), (4, 1.0, False), (2, 1.5, False)]
)
def test_a_mesh_too_coarse_for_its_averages_is_warned_of(
    across: int, width: float, told: bool
) -> None:
    changes = {"numerics.cells_across": across, "numerics.averaging_width": width}
    said = [text for text in case(**changes).scene.advice() if "averages over" in text]
    assert bool(said) == told
    assert not told or "1.3 grain diameters" in said[0]
    if told:
        assert "numerics.cells_across = 2 to 4" in said[0]


def test_a_long_tube_is_counted_and_not_made() -> None:
    """The counts are those of the mesh, which 1000 m would take minutes to make."""
    short, bend = case(), {"geometry.shape": "bend", "geometry.bend_start": 0.03}
    for scene in (short.scene, case(**bend, **{"geometry.bend_radius": 0.02}).scene):
        tube = scene.tube()
        assert (scene.extent.nodes, scene.extent.inner_steps) == (
            tube.gas.tube.size,
            tube.inner_steps,
        )
    long = short.with_values({"geometry.length": 1000.0, "averages.high": 900.0}).scene
    assert long.extent.nodes > 9000 * short.scene.extent.nodes


def test_refusals_name_what_was_given() -> None:
    with pytest.raises(InputError, match=r"numerics\.time_step = 1\.0 is refused"):
        case(**{"numerics.time_step": 1.0})
    with pytest.raises(InputError, match=r"solids\.diameter = 1e-05 m"):
        case(**{"solids.diameter": 1e-5})


# -- a sweep ---------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_sweep_tells_the_errors_of_its_points_and_goes_on(tmp_path: Path) -> None:
    """Two processes share the points; a point that is lost alone is solved again."""
    short = {"geometry.length": 0.02, "numerics.end_time": 3.6, "averages.begin": 0.5}
    short |= {"averages.low": 0.005, "averages.high": 0.018, "numerics.cells_across": 2}
    short |= {"closures.contact.stiffness": 25.0}
    key, chosen = "operation.gas_superficial_velocity", case(**short)
    found = sweep.run(chosen, {key: [3.0, 4.0]}, tmp_path, jobs=2)
    assert not found.failed
    with (tmp_path / sweep.TABLE).open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    for row, point in zip(rows, found.points, strict=True):
        assert point.quantities["grains_in_tube"] > 50
        assert set(point.errors) == set(point.quantities)
        for name in ("pressure_gradient", "grains_in_tube", "slug_rate"):
            assert 0 < point.errors[name]
            unit = unit_of(name)
            told = row[f"{name} error [{unit}]" if unit else f"{name} error"]
            assert float(told) == pytest.approx(point.errors[name], rel=1e-9)
    (tmp_path / "points" / "1.json").unlink()
    again = sweep.run(chosen, {key: [3.0, 4.0]}, tmp_path, resume=True)
    assert again.points[0].cpu_seconds == found.points[0].cpu_seconds
    assert again.points[1].quantities == found.points[1].quantities


@pytest.mark.parametrize(
    ("changes", "doubted"),
    [
        ({}, False),
        ({"gas.viscosity": 1.8e-5, "operation.gas_superficial_velocity": 5.0}, True),
        (
            {
                "gas.viscosity": 1.8e-5,
                "operation.gas_superficial_velocity": 5.0,
                "closures.permeability": "ergun",
            },
            False,
        ),
    ],
)
def test_a_gas_too_fast_for_a_resistance_without_inertia_is_told(
    changes: dict[str, Any], doubted: bool
) -> None:
    """Ergun over Carman and Kozeny is 150/180 (1 + 1.75/90 Re) at a porosity of 0.4."""
    told = [text for text in case(**changes).scene.warnings() if "by Ergun as by" in text]
    assert bool(told) == doubted
    if doubted:
        factor = 150 / 180 * (1 + 1.75 / 90 * 1.2 * 5.0 * 1.4e-3 / 1.8e-5)
        assert f"{factor:.2g} times" in told[0] and "'ergun'" in told[0]

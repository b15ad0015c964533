# SPDX-License-Identifier: LGPL-3.0-or-later
"""What drives the unsteady flow: feed over time, start, outputs, interruption and going on."""

from __future__ import annotations

import csv
import os
import re
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

from fem_tfm import Case
from fem_tfm.errors import SolverError
from fem_tfm.models.finite_volume import UnsteadyFlow
from fem_tfm.output import checkpoint
from fem_tfm.output.result import Result
from fem_tfm.scenes import unsteady
from fem_tfm.scenes.scene import Answer
from fem_tfm.scenes.unsteady import Stepped, is_due

BASE = {
    "solution": "unsteady",
    "geometry": {"diameter": 0.01, "length": 0.03},
    "operation": {
        "gas_superficial_velocity": 6.43,
        "solids_fraction": 0.245,
        "solids_velocity": 6.09,
    },
    "numerics": {"level": 1, "mesh_size": 3e-3, "axial_cells": 6, "end_time": 4e-3},
    "output": {"interval": 1e-3, "probes": [[1e-3, 0, 0.01]], "sections": [0.01, 0.02]},
}

# a gas whose density follows the pressure
NITROGEN = {"gas": {"species": "N2", "pressure": 1e5, "compressible": True}}


FOUR_EQUATIONS = {"closures.turbulence": "realizable-4eq", "closures.dispersion": "burns"}


def case_of(dense: dict[str, Any], changes: dict[str, Any] | None = None) -> Case:
    """A short line with few cells, with dotted keys changed."""
    return Case.from_dict(dense | BASE).with_values(changes or {})


def rows(path: Path) -> list[dict[str, str]]:
    """A CSV file, columns without units."""
    with path.open(encoding="utf-8", newline="") as file:
        table = list(csv.DictReader(file))
    return [{name.partition(" [")[0]: value for name, value in row.items()} for row in table]


# -- from the case -----------------------------------------------------------------------------


def test_what_enters_follows_its_schedule(dense: dict[str, Any]) -> None:
    case = case_of(
        dense,
        {
            "operation.gas_schedule": [[0, 0], [1e-3, 1]],
            "operation.solids_schedule": [[1e-3, 1], [2e-3, 0]],
            "operation.outlet_blocked": [[2e-3, 3e-3]],
        },
    )
    feed = case.scene.inflow(5e-4)
    assert feed.gas_velocity == pytest.approx(0.5 * 6.43)
    assert (feed.solids_fraction, feed.solids_velocity) == (0.245, 6.09)
    assert case.scene.inflow(1.5e-3).solids_fraction == pytest.approx(0.5 * 0.245)
    assert case.scene.inflow(9.0).solids_fraction == 0.0
    # of the step that ends at that time
    blocked = [case.scene.inflow(t).blocked for t in (2e-3, 2.5e-3, 3e-3, 3.1e-3)]
    assert blocked == [False, True, True, False]


def test_steps_end_at_outputs_and_corners(dense: dict[str, Any]) -> None:
    case = case_of(
        dense,
        {
            "numerics.end_time": 0.3,
            "output.interval": 0.1,
            "output.checkpoint_interval": 0.25,
            "operation.gas_schedule": [[0, 0], [0.05, 1], [0.7, 1]],
        },
    )
    times = case.scene.milestones()
    assert times == pytest.approx([0.05, 0.1, 0.2, 0.25, 0.3])
    assert times[-1] == 0.3
    due = [time for time in times if is_due(time, 0.1, 0.3)]
    assert due == pytest.approx([0.1, 0.2, 0.3])


def test_steps_as_the_case_wants_them(dense: dict[str, Any]) -> None:
    control = case_of(dense).scene.control()
    assert (control.first, control.largest, control.courant) == pytest.approx((1e-5, 1e-3, 1.0))
    control = case_of(dense, {"numerics.time_step": 1.0, "numerics.courant": 5.0}).scene.control()
    assert (control.first, control.courant) == (1e-3, 5.0)


def test_a_bed_lies_where_the_case_says(dense: dict[str, Any]) -> None:
    given = {"state": "bed", "bed_fraction": 0.5, "bed_height": 0.005, "bed_end": 0.015}
    case = case_of(dense, {f"initial.{key}": value for key, value in given.items()})
    flow = UnsteadyFlow(case.scene.problem(), case.scene.mesh())
    case.scene.start(flow)
    _, y, z = flow.cells.centre.T
    inside = (y < 0) & (z < 0.015)
    assert 0 < inside.sum() < len(y)
    assert np.array_equal(flow.now.alpha, np.where(inside, 0.5, 0.0))
    assert not flow.now.u_g.any()


def test_a_line_filled_with_what_enters_carries_its_flux(dense: dict[str, Any]) -> None:
    case = case_of(dense, {"initial.state": "inlet"})
    flow = UnsteadyFlow(case.scene.problem(), case.scene.mesh())
    case.scene.start(flow)
    found = flow.quantities()
    assert found["holdup"] == pytest.approx(0.245)
    assert flow.now.u_s[:, 2] == pytest.approx(6.09)


def test_what_fills_a_bend_follows_its_axis(dense: dict[str, Any]) -> None:
    bend = {"shape": "bend", "diameter": 0.01, "length": 0.1, "bend_radius": 0.04}
    changes = {f"geometry.{key}": value for key, value in bend.items()}
    case = case_of(dense, {**changes, "initial.state": "inlet", "numerics.axial_cells": 20})
    flow = UnsteadyFlow(case.scene.problem(), case.scene.mesh())
    case.scene.start(flow)
    assert np.linalg.norm(flow.now.u_s, axis=1) == pytest.approx(6.09)
    last = np.argmax(flow.mesh.straightened(flow.cells.centre)[:, 2])
    assert flow.now.u_s[last] == pytest.approx([0, 6.09, 0], abs=1e-9)
    # nothing is far from free of divergence
    rate = np.abs(flow.cells.net_flux(flow.now.solids_flux)) / flow.cells.volume[: flow.cells.owned]
    assert rate.max() < 0.3 * 6.09 / 0.005


# -- runs --------------------------------------------------------------------------------------


@pytest.mark.mpi
def test_a_run_leaves_its_time_series(dense: dict[str, Any], tmp_path: Path) -> None:
    case = case_of(dense)
    result = case.scene.run(tmp_path / "run")
    assert (result.status, result.solution) == ("finished", "unsteady")
    assert max(result.balances.values()) < 1e-12
    assert result["pressure_drop"] > 0
    assert any("not steady at its end" in text for text in result.warnings)
    out = tmp_path / "run"
    if MPI.COMM_WORLD.rank > 0:
        return
    monitor = rows(out / "monitor.csv")
    times = [float(row["time"]) for row in monitor]
    assert {1e-3, 2e-3, 3e-3, 4e-3} <= set(times)
    assert times == sorted(times)
    assert [float(row["time"]) for row in rows(out / "probes.csv")] == times
    assert len(rows(out / "sections.csv")) == 2 * 5
    # the gas fills the line with what enters
    last = rows(out / "sections.csv")[-1]
    flux = sum(float(last[f"{phase}_superficial_velocity"]) for phase in ("gas", "solids"))
    assert flux == pytest.approx(6.43 + 0.245 * 6.09, rel=0.05)
    series = (out / "fields.xdmf").read_text(encoding="utf-8")
    stored = [float(t) for t in re.findall(r'Time Value="([^"]*)"', series)]
    assert stored == pytest.approx([0, 1e-3, 2e-3, 3e-3, 4e-3])
    assert (out / "plane.png").stat().st_size > 10000
    assert "step 1e-05 s at 0 s" in (out / "run.log").read_text(encoding="utf-8")


class Interrupt:
    """Sends a signal to this process behind a step of a run."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, step: int, number: int) -> None:
        advance = Stepped.advance

        def interrupted(section: Stepped, dt: float, time: float) -> float:
            effort = advance(section, dt, time)
            if section.flow.steps == step and MPI.COMM_WORLD.rank == 0:
                os.kill(os.getpid(), number)
            return effort

        monkeypatch.setattr(Stepped, "advance", interrupted)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("number", "order", "changes"),
    [
        (signal.SIGINT, 0, {}),
        (signal.SIGTERM, 0, {}),
        (signal.SIGTERM, 1, {}),
        (signal.SIGTERM, 1, NITROGEN),
        (signal.SIGTERM, 0, FOUR_EQUATIONS),
        (signal.SIGTERM, 1, FOUR_EQUATIONS),
        (signal.SIGTERM, 1, NITROGEN | FOUR_EQUATIONS),
    ],
)
def test_an_interrupted_run_goes_on_bit_for_bit(
    dense: dict[str, Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    number: int,
    order: int,
    changes: dict[str, Any],
) -> None:
    """N steps, a signal, N more: the same as all in one, in every cell and every row."""
    case, comm = case_of(dense, {"numerics.order": order, **changes}), MPI.COMM_WORLD
    whole, halves = tmp_path / "whole", tmp_path / "halves"
    with monkeypatch.context() as patch:
        # the state is written there too, which starts the multigrid anew
        save = patch_saves(patch, step=13)
        case.scene.run(whole)
        assert save
    with monkeypatch.context() as patch:
        Interrupt(patch, 13, number)
        with pytest.raises(KeyboardInterrupt):
            case.scene.run(halves)
    comm.barrier()
    assert Result.read(halves).status == "interrupted"
    assert checkpoint.numbers(halves)["stepping.count"] == 13
    case.scene.run(halves, resume=True)
    comm.barrier()
    for name in ("monitor.csv", "probes.csv", "sections.csv", "fields.xdmf", "plane.png"):
        assert (whole / name).read_bytes() == (halves / name).read_bytes(), name
    mesh = case.scene.mesh().mesh
    expected, found = (checkpoint.load_cells(out, mesh) for out in (whole, halves))
    assert expected[1] == found[1]
    for name, values in expected[0].items():
        assert np.array_equal(values, found[0][name]), name


def patch_saves(patch: pytest.MonkeyPatch, step: int) -> list[int]:
    """Let a run write a checkpoint at a step that has none of its own."""
    tell, done = unsteady.FlowRecorder.step, []

    def told(recorder: unsteady.FlowRecorder) -> None:
        tell(recorder)
        if recorder.stepping.count == step:
            recorder.save()
            done.append(step)

    patch.setattr(unsteady.FlowRecorder, "step", told)
    return done


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("order", "changes"),
    [(0, {}), (1, {}), (0, FOUR_EQUATIONS), (0, NITROGEN), (1, NITROGEN | FOUR_EQUATIONS)],
)
def test_a_state_goes_on_with_another_number_of_ranks(
    dense: dict[str, Any], tmp_path: Path, order: int, changes: dict[str, Any]
) -> None:
    """Five more steps of one rank and of all agree to what the linear solvers leave."""
    case = case_of(dense, {"numerics.order": order, **changes})
    case.scene.run(tmp_path)
    MPI.COMM_WORLD.barrier()
    found = []
    for comm in (MPI.COMM_WORLD, MPI.COMM_SELF):
        flow = UnsteadyFlow(case.scene.problem(), case.scene.mesh(comm))
        flow.restore(merged(tmp_path, flow))
        for _ in range(5):
            flow.advance(1e-4, case.scene.inflow(1.0))
        found.append(flow.quantities())
    assert found[0] == pytest.approx(found[1], rel=1e-4)


def merged(out: Path, flow: UnsteadyFlow) -> dict[str, Any]:
    """Values and numbers of a checkpoint."""
    values, numbers = checkpoint.load_cells(out, flow.mesh.mesh)
    return values | numbers


def test_a_killed_run_goes_on_from_its_last_checkpoint(
    dense: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was written behind the checkpoint is written again, once."""
    case = case_of(dense, {"output.checkpoint_interval": 2e-3})
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    case.scene.run(whole)

    def fail(section: Stepped, dt: float, time: float) -> float:
        if time > 3.2e-3:
            raise MemoryError("killed")
        return advance(section, dt, time)

    with monkeypatch.context() as patch:
        advance = Stepped.advance
        patch.setattr(Stepped, "advance", fail)
        with pytest.raises(MemoryError):
            case.scene.run(killed)
    assert checkpoint.numbers(killed)["time"] == 2e-3
    assert float(rows(killed / "monitor.csv")[-1]["time"]) >= 3e-3
    case.scene.run(killed, resume=True)
    for name in ("monitor.csv", "probes.csv", "sections.csv", "fields.xdmf"):
        assert (whole / name).read_bytes() == (killed / name).read_bytes(), name


def test_a_step_that_never_succeeds_ends_the_run(
    dense: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The state before it is kept, and the reason."""
    case = case_of(dense)
    advance = UnsteadyFlow.advance

    def failing(flow: UnsteadyFlow, dt: float, *given: Any) -> Any:
        if flow.time > 1.5e-3:
            raise SolverError("the solids fraction leaves its bounds")
        return advance(flow, dt, *given)

    monkeypatch.setattr(UnsteadyFlow, "advance", failing)
    with pytest.raises(SolverError, match=r"no step above 1e-09 s succeeds at 0\.001[5-9]"):
        case.scene.run(tmp_path)
    result = Result.read(tmp_path)
    assert result.status == "failed"
    assert "leaves its bounds" in result.reason
    assert 1.5e-3 < checkpoint.numbers(tmp_path)["time"] < 2e-3
    log = (tmp_path / "run.log").read_text(encoding="utf-8")
    assert log.count("taken back: the solids fraction leaves its bounds") > 5


@pytest.mark.parametrize(("share", "told"), [(1.0, False), (0.95, False), (0.5, True)])
def test_solids_that_stay_inside_are_told(dense: dict[str, Any], share: float, told: bool) -> None:
    scene = case_of(dense).scene
    entering = scene.model.solids.density * scene.geometry.area * 0.245 * 6.09
    found = {"solids_mass_flow": share * entering, "pressure_drop": 1.0}
    said = scene.judge(Answer("finished", found, {}, "pressure_drop"))
    assert any("not steady at its end" in text for text in said) == told


def test_gas_alone_is_driven_too(dense: dict[str, Any]) -> None:
    del dense["solids"]
    operation = {"gas_superficial_velocity": 6.43, "gas_schedule": [[0, 0], [1e-3, 1]]}
    case = Case.from_dict(dense | BASE | {"operation": operation})
    result = case.scene.run()
    assert result.status == "finished"
    density, area = case["gas.density"], case.scene.geometry.area
    assert result["gas_mass_flow"] == pytest.approx(density * 6.43 * area, rel=1e-6)


def test_turbulence_is_told_and_kept(dense: dict[str, Any], tmp_path: Path) -> None:
    changes = {"output.pictures": False, "numerics.end_time": 2e-3}
    case_of(dense, {**FOUR_EQUATIONS, **changes}).scene.run(tmp_path)
    assert all(float(row["max_k"]) > 0 for row in rows(tmp_path / "monitor.csv"))
    series = (tmp_path / "fields.xdmf").read_text(encoding="utf-8")
    for name in ("k", "eps", "k_s", "eps_s"):
        assert f'Name="{name}"' in series
        assert all(float(row[f"{name}_1"]) > 0 for row in rows(tmp_path / "probes.csv"))


def test_check_tells_the_size(dense: dict[str, Any]) -> None:
    told = case_of(dense).scene.describe()
    assert "unsteady flow" in told["solved"]
    assert told["meshes"].startswith("6 layers of ")
    assert "starts from state 'rest'" in told["given"]

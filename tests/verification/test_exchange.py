# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gas and particles give to each other what the other takes, slab by slab, without a tracker."""

from __future__ import annotations

import functools
import itertools
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from clouds import StokesCloud, line_of, load, save
from mpi4py import MPI
from scipy.integrate import solve_ivp

from fem_tfm import Case
from fem_tfm.models.reynolds_stress import initial
from fem_tfm.models.reynolds_stress.exchange import DISSIPATION, Exchange
from fem_tfm.models.reynolds_stress.line import ReynoldsStressLine
from fem_tfm.models.reynolds_stress.section import ReynoldsStressSection
from fem_tfm.solvers.newton import LinearSolveError

DUCT = {
    "flow": "duct",
    "solution": "developing",
    "geometry": {"shape": "duct", "width": 0.2, "length": 0.04},
    "gas": {"density": 1.2, "viscosity": 1.8e-5},
    "operation": {"gas_superficial_velocity": 22.0},
    "walls": {"distance": 8e-4},
    "numerics": {"mesh_size": 0.06},
}
# walls that give no heat, so that all of it is the particles'
HEAT = {"heat": {"wall": "flux", "wall_flux": 0.0}}
ROUND_OFF = 1e-10


def duct(**changes: Any) -> Case:
    """The duct of 200 mm on 25 cells; "a__b" stands for the key "a.b"."""
    return Case.from_dict(DUCT).with_values({k.replace("__", "."): v for k, v in changes.items()})


@functools.cache
def marched(order: int = 2, implicit: bool = True, tau: float = 0.05) -> ReynoldsStressLine:
    """A line with a cloud, marched to its end; the cloud is its coupler."""
    line = line_of(duct(), StokesCloud(implicit=implicit, tau=tau))
    line.control = replace(line.control, order=order)
    line.march()
    return line


def felt(line: ReynoldsStressLine) -> float:
    """What the gas of the part solved has lost to the particles, over its density."""
    return line.sums.now["particles"] * line.station.area / line.density


# -- conservation ------------------------------------------------------------------------------


@pytest.mark.mpi
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("implicit", [True, False])
def test_what_the_gas_loses_the_particles_gain(order: int, implicit: bool) -> None:
    """To round-off with what is still owed, which is less than the tolerance of the passes."""
    line = marched(order, implicit)
    gained = line.coupler.gained(line.station)[2]
    if MPI.COMM_WORLD.size > 1:
        gained = MPI.COMM_WORLD.allreduce(gained)
    owed = -line.station.exchange.force.outstanding()[2]
    assert felt(line) + owed == pytest.approx(gained, rel=ROUND_OFF)
    assert abs(owed) < 1e-4 * gained
    # a loading of 3.6 is no small matter: 0.3 kPa in 40 mm
    assert line.rows[-1]["particle_drop"] > 200


def test_what_is_owed_is_made_up_for() -> None:
    """One pass a slab leaves much, and yet nothing is lost."""
    line = line_of(duct(), StokesCloud(tau=0.005))
    line.control = replace(line.control, passes=1)
    told = []
    line.march(lambda line, stop: told.append(stop))
    assert {stop.passes for stop in told} == {1}
    assert max(stop.change for stop in told) > 1e-2
    owed = -line.station.exchange.force.outstanding()[2]
    gained = line.coupler.gained(line.station)[2]
    assert felt(line) + owed == pytest.approx(gained, rel=ROUND_OFF)
    assert 1e-12 * gained < abs(owed) < 1e-3 * gained
    expected = marched(tau=0.005).rows[-1]["particle_drop"]
    assert line.rows[-1]["particle_drop"] == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("order", [1, 2])
def test_the_parts_add_up_to_the_pressure_drop(order: int) -> None:
    line = marched(order)
    assert line.balances()["axial_momentum"] < 1e-8
    for row in line.rows[1:]:
        parts = sum(row[f"{name}_drop"] for name in ("friction", "particle", "flux"))
        assert -row["pressure"] == pytest.approx(parts, rel=1e-8)
    columns = line.columns()
    assert columns["particle_drop"][-1] > 0.9 * (columns["pressure"][0] - columns["pressure"][-1])


def test_the_slope_changes_the_way_and_not_the_answer() -> None:
    """The slope tells what is local within a cell, which hardly matters in the mean."""
    implicit, explicit = marched(), marched(implicit=False)
    drops = [line.rows[-1]["particle_drop"] for line in (implicit, explicit)]
    assert drops[0] == pytest.approx(drops[1], rel=2e-3)
    assert drops[0] != drops[1]
    assert implicit.station.exchange.force.slope.x.array.min() > 0
    assert abs(explicit.station.exchange.force.slope.x.array).max() == 0


def test_a_cloud_against_its_equation() -> None:
    """One-dimensional gas and cloud: the particles' speed at the end within 2 %."""
    line = marched()
    cloud, speed = line.coupler, 22.0
    end = solve_ivp(lambda z, v: (speed - v) / (cloud.tau * v), (0, 0.04), [2.8], rtol=1e-10).y[
        0, -1
    ]
    volumes = line.station.exchange.force.volumes
    mean = volumes @ cloud.begun[:, 2] / volumes.sum()
    # the plane of the wall functions is slower, the core a little faster than U
    assert mean == pytest.approx(end, rel=0.02)


def test_an_exchange_of_nothing_changes_nothing() -> None:
    alone, idle = line_of(duct(), None), line_of(duct(), StokesCloud(flux=0.0))
    for line in (alone, idle):
        line.march()
    assert "particle_drop" not in alone.rows[0]
    assert len(alone.rows) == len(idle.rows)
    for name, value in alone.rows[-1].items():
        assert idle.rows[-1][name] == pytest.approx(value, rel=1e-7, abs=1e-9), name
    assert idle.rows[-1]["particle_drop"] == 0.0


# -- steps that are taken back, and restarts ---------------------------------------------------


class _Stop(Exception):
    """Ends a march."""


def march_to(line: ReynoldsStressLine, stations: int) -> None:
    """March until the table has so many stations behind the inlet."""

    def observe(line: ReynoldsStressLine, stop: Any) -> None:
        if len(line.rows) - 1 == stations:
            raise _Stop

    with pytest.raises(_Stop):
        line.march(observe)


def same(one: ReynoldsStressLine, other: ReynoldsStressLine) -> None:
    """Two lines are at the same place with the same bits."""
    assert one.place == other.place
    assert np.array_equal(one.station.now.x.array, other.station.now.x.array)
    assert np.array_equal(one.coupler.begun, other.coupler.begun)
    functions = other.station.exchange.functions()
    for name, function in one.station.exchange.functions().items():
        assert np.array_equal(function.x.array, functions[name].x.array), name
    for row, expected in zip(one.rows, other.rows, strict=True):
        assert np.array_equal(list(row.values()), list(expected.values()), equal_nan=True)


class _Balks(StokesCloud):
    """Fails once, in the second pass over one slab."""

    slab = 6

    def trace(self, station: ReynoldsStressSection) -> float:
        change = super().trace(station)
        tried, passes = self.calls.count("begin"), len(self.traces)
        if self.calls.count("accept") == self.slab - 1 and not hasattr(self, "first"):
            self.first = passes
        if getattr(self, "first", -1) == passes - 1:
            raise LinearSolveError(f"slab {tried} is refused")
        return change


def test_a_step_taken_back_leaves_no_trace() -> None:
    """After a failure within the passes all goes on as if the smaller step had come first."""
    case = duct(**HEAT)
    balks = line_of(case, _Balks(warmth=80.0, damping=10.0), damping=True)
    reasons = []
    balks.march(retry=lambda step, reason: reasons.append((step, reason)))
    refused = [step for step, reason in reasons if "is refused" in reason]
    assert len(refused) == 1
    straight = line_of(case, StokesCloud(warmth=80.0, damping=10.0), damping=True)
    march_to(straight, _Balks.slab - 1)
    straight.place = replace(straight.place, next=refused[0])
    straight.march()
    same(balks, straight)
    heats = balks.heat, straight.heat
    assert np.array_equal(*(heat.now.x.array for heat in heats))
    calls = balks.coupler.calls
    assert calls.count("begin") == calls.count("accept") + calls.count("reject")


def test_an_interrupt_within_a_slab_leaves_the_last_station() -> None:
    line = line_of(duct(), StokesCloud())
    march_to(line, 4)
    kept = line.coupler.begun.copy()
    before = {n: f.x.array.copy() for n, f in line.station.exchange.functions().items()}

    def interrupt(station: ReynoldsStressSection) -> float:
        StokesCloud.trace(line.coupler, station)
        raise KeyboardInterrupt

    line.coupler.trace = interrupt
    with pytest.raises(KeyboardInterrupt):
        line.march()
    given = line.station.exchange.force.given
    assert not np.array_equal(given.x.array, before["exchange.force.given"])
    line.step_back()
    assert np.array_equal(line.coupler.ended, kept)
    for name, function in line.station.exchange.functions().items():
        assert np.array_equal(function.x.array, before[name]), name


def test_a_restart_gives_the_same_bits(tmp_path: Path) -> None:
    case, given = duct(**HEAT), {"warmth": 80.0, "damping": 10.0}
    whole = line_of(case, StokesCloud(**given), damping=True)
    whole.march()
    part = line_of(case, StokesCloud(**given), damping=True)
    march_to(part, 5)
    save(part, tmp_path)
    resumed = line_of(case, StokesCloud(**given), damping=True)
    load(resumed, tmp_path)
    same(resumed, part)
    resumed.march()
    same(resumed, whole)


# -- heat and eddies ---------------------------------------------------------------------------


def test_particles_warm_the_gas() -> None:
    """Walls give nothing, so the gas has what the particles have lost."""
    line = line_of(duct(**HEAT), StokesCloud(warmth=80.0))
    line.march()
    lost = line.coupler.gained(line.station)[3]
    owed = line.station.exchange.heat.outstanding()[0]
    assert line.sums.now["heat"] + owed == pytest.approx(-lost, rel=1e-9)
    assert line.balances()["heat"] < 1e-9
    assert line.rows[-1]["bulk_temperature"] > line.temperature + 5


def test_particles_calm_the_eddies() -> None:
    """k and eps on the axis of a plug flow against their ordinary differential equations."""
    rate, speed = 60.0, 22.0
    line = line_of(duct(geometry__length=0.1), StokesCloud(flux=0.0, damping=rate), damping=True)
    line.control = replace(line.control, bend=0.005)
    line.march()
    case, last = duct(), line.rows[-1]
    k = 1.5 * (case.scene.inlet.gas_intensity * speed) ** 2
    eps = 0.09**0.75 * k**1.5 / (case.scene.inlet.length_scale * 0.2)
    constant = line.station.setup.law.C_e2

    def rates(z: float, y: np.ndarray, calm: float) -> list[float]:
        k, eps = y
        falling = eps + 2 * calm * k
        return [
            -falling / speed,
            -(constant * eps / k * eps + DISSIPATION * 2 * calm * eps) / speed,
        ]

    told = [
        solve_ivp(rates, (0, 0.1), [k, eps], args=(calm,), rtol=1e-9).y[0, -1]
        for calm in (rate, 0.0)
    ]
    found = last["axis_energy"] * line.station.pressure_gradient * 0.2 / 4
    assert found == pytest.approx(told[0], rel=0.03)
    assert told[0] < 0.7 * told[1]


@pytest.mark.slow
def test_lateral_drag_slows_the_secondary_flow() -> None:
    lines = [line_of(duct(), StokesCloud(tau=0.005), lateral=lateral) for lateral in (False, True)]
    for line in lines:
        line.march()
    free, held = (line.rows[-1]["secondary_velocity_max"] for line in lines)
    assert held < 0.9 * free
    assert abs(lines[0].station.exchange.force.given.x.array[0::3]).max() == 0
    assert abs(lines[1].station.exchange.force.given.x.array[0::3]).max() > 0


# -- terms -------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", ["lrr", "k-epsilon"])
def test_newton_sees_every_term(law: str) -> None:
    """The Jacobian is the derivative of the residual, and changes with each of the fields."""
    scene = duct(closures__reynolds_stress=law, numerics__mesh_size=0.08).scene
    mesh = scene.physics.meshes(MPI.COMM_WORLD)[-1]()
    exchange = Exchange(mesh.mesh, lateral=True, damping=True)
    section = ReynoldsStressSection(mesh, scene.physics.setup(), exchange=exchange)
    initial.cold(section)
    newton, start, rng = section.newton, section.now.x.array.copy(), np.random.default_rng(3)
    direction = rng.normal(size=start.size) * 1e-6
    for bc in newton.bcs:
        bc.set(direction, alpha=0.0)

    def derivative() -> np.ndarray:
        sides = []
        for sign in (1, -1):
            section.now.x.array[:] = start + sign * direction
            sides.append(newton.assemble_residual().copy())
        section.now.x.array[:] = start
        return (sides[0] - sides[1]) / 2

    def product() -> np.ndarray:
        newton.factor()
        vector, result = newton.rhs.duplicate(), newton.rhs.duplicate()
        vector.array[:] = direction
        newton.matrix.mult(vector, result)
        return result.array_r.copy()

    fields = {"force.slope": 40.0, "damping": 30.0}
    names = exchange.functions()
    fixed = np.concatenate([bc.dof_indices()[0] for bc in newton.bcs])
    previous = product()
    for name, size in fields.items():
        values = names[f"exchange.{name}"].x.array
        values[:] = size * rng.uniform(0.5, 1, values.size)
        now, expected = product(), derivative()
        now[fixed] = expected[fixed] = 0.0
        scale = abs(expected).max()
        assert abs(now - expected).max() < 1e-5 * scale, name
        changed = now - previous
        changed[fixed] = 0.0
        # in the eddy viscosity's equations the damping does not depend on the unknowns
        assert (abs(changed).max() > 1e-9 * scale) == (name != "damping" or law == "lrr"), name
        previous = now


def test_the_last_pass_is_told_where_it_does_not_settle() -> None:
    """The cap of the passes ends them, and the stop says by how much the force still moved."""
    line = line_of(duct(geometry__length=0.01), StokesCloud(tau=0.005))
    line.control = replace(line.control, exchange=0.0, passes=3)
    told = []
    line.march(lambda line, stop: told.append(stop))
    assert all(stop.passes == 3 and stop.change > 0 for stop in told)
    for one, two in itertools.pairwise(line.coupler.traces[-3:]):
        assert two < 0.3 * one

# SPDX-License-Identifier: LGPL-3.0-or-later
"""A cloud without a tracker: Stokes particles that stay in their cell and relax to its gas."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from fem_tfm import Case
from fem_tfm.models.reynolds_stress.exchange import Array, Exchange
from fem_tfm.models.reynolds_stress.line import ReynoldsStressLine
from fem_tfm.models.reynolds_stress.section import ReynoldsStressSection
from fem_tfm.output import checkpoint
from fem_tfm.scenes.duct import heat_of


class StokesCloud:
    """Particles that enter everywhere alike, solved exactly in each slab: dv/dt = (u - v)/tau.

    The gas of a cell is the mean of the station at the end of the slab; the temperature follows
    likewise, with the same time.

    flux : mass flux of the particles over the gas density [m/s]
    tau : relaxation time [s]
    speed : at the inlet [m/s]
    warmth : temperature at the inlet above that of the gas [K]
    implicit : whether the gas hears how the force changes with it
    damping : rate at which the eddies are damped [1/s]
    """

    def __init__(
        self,
        flux: float = 80.0,
        tau: float = 0.05,
        speed: float = 2.8,
        warmth: float = 0.0,
        implicit: bool = True,
        damping: float = 0.0,
    ) -> None:
        self.flux, self.tau, self.implicit, self.damping = flux, tau, implicit, damping
        self.inlet = np.array([0.0, 0.0, speed, warmth])
        self.begun: Array | None = None
        self.traces: list[float] = []
        self.calls: list[str] = []

    def enter(self, cells: int) -> None:
        """Stand at the inlet, with velocity and temperature of each cell."""
        self.begun = np.tile(self.inlet, (cells, 1))
        self.ended = self.begun.copy()

    def begin(self, start: float, end: float) -> None:
        self.step = end - start
        self.calls.append("begin")

    def trace(self, station: ReynoldsStressSection) -> float:
        exchange, before = station.exchange, self.begun
        gas = np.column_stack([source.means() for source in exchange.sources.values()])
        count = gas.shape[1]
        away = before[:, :count] - gas
        share = 1 - np.exp(-self.time(gas[:, 2], before[:, 2]) / self.tau)
        self.ended = before.copy()
        self.ended[:, :count] = before[:, :count] - away * share[:, None]
        # sums over the whole section, as a tracker makes them, on the quarter that is solved
        sums = 4 * self.flux * exchange.force.volumes
        given = exchange.force.spread(sums[:, None] * (before - self.ended), 1 / 4)
        slope = exchange.force.spread(sums * share * self.implicit, 1 / 4)
        warm = {"heat": given[:, 3], "heat_slope": slope} if count == 4 else {}
        calm = {"damping": np.full(len(gas), self.damping)} if self.damping else {}
        drive = station.pressure_gradient
        change = exchange.renew(given[:, :3], slope, drive, **warm, **calm)
        self.traces.append(change)
        return change

    def time(self, u: Array, v: Array) -> Array:
        """Time in the slab by Newton: u t + (v - u) tau (1 - exp(-t/tau)) = step."""
        t = self.step / np.minimum(u, v)
        for _ in range(50):
            decay = np.exp(-t / self.tau)
            miss = u * t + (v - u) * self.tau * (1 - decay) - self.step
            t = t - miss / (u + (v - u) * decay)
        return t

    def accept(self) -> None:
        self.begun = self.ended.copy()
        self.calls.append("accept")

    def reject(self) -> None:
        self.ended = self.begun.copy()
        self.calls.append("reject")

    def state(self) -> Mapping[str, np.ndarray]:
        return {"cloud": self.begun}

    def restore(self, arrays: Mapping[str, np.ndarray]) -> None:
        self.begun = arrays["cloud"].copy()
        self.ended = self.begun.copy()

    def gained(self, station: ReynoldsStressSection) -> Array:
        """Momentum and heat that the particles of the part solved have taken from the gas."""
        gain = self.flux * (self.begun - self.inlet)
        return station.exchange.force.volumes @ gain


def line_of(case: Case, cloud: StokesCloud | None, **given: Any) -> ReynoldsStressLine:
    """A line at its inlet with a cloud; `given` goes to the exchange."""
    scene = case.scene
    physics, model = scene.physics, scene.model
    mesh = physics.meshes(MPI.COMM_WORLD)[-1]()
    exchange = None if cloud is None else Exchange(mesh.mesh, heat=model.heat is not None, **given)
    station = ReynoldsStressSection(mesh, physics.setup(), develops=True, exchange=exchange)
    heat = None if model.heat is None else heat_of(scene, station)
    parts = (0.0, model.gas, scene.inlet, heat, model.heat, cloud)
    line = ReynoldsStressLine(station, scene.geometry.length, physics.control(), *parts)
    if cloud is not None:
        cloud.enter(len(exchange.force.cells))
    line.begin()
    return line


def save(line: ReynoldsStressLine, out: Path) -> None:
    """Write a checkpoint."""
    checkpoint.save(out, MPI.COMM_WORLD, *line.state())


def load(line: ReynoldsStressLine, out: Path) -> None:
    """Stand where the checkpoint was written."""
    fields = line.stored_fields() | line.companions()[0]
    numbers = checkpoint.load(out, MPI.COMM_WORLD, fields)
    line.restore(fields, numbers, checkpoint.tables(out), checkpoint.others(out))

# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a run of a tube tells and keeps: progress, monitor.csv, samples, snapshots, checkpoint."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fem_tfm.models.slug.told.cross_sections import Still
from fem_tfm.models.slug.told.slices import SLICE, Sampler, Samples
from fem_tfm.models.slug.tube import SlugTube
from fem_tfm.output import checkpoint
from fem_tfm.output.fields import FieldWriter, snapshot
from fem_tfm.output.files import on_root
from fem_tfm.output.profiles import drop_after
from fem_tfm.output.result import Result
from fem_tfm.output.slug import files
from fem_tfm.output.slug.wear import WallWear
from fem_tfm.scenes.recorder import Recorder, Setting
from fem_tfm.scenes.slug import told

# the last stretch of a run that becomes a film, and that in which sections are looked at [s]
FILM, SECTIONS = 1.5, 4.0
COLUMNS = {
    "step": "",
    "time": "s",
    "grains": "",
    "fed": "",
    "out": "",
    "pressure_drop": "Pa",
    "max_solids_fraction": "",
    "fastest": "m/s",
    "grain_error": "",
}


class Section:
    """The mesh of the pressure, as a run sees it."""

    def __init__(self, tube: SlugTube) -> None:
        self.mesh, self.dofs = tube.gas.tube.mesh, tube.gas.tube.size


class TubeRecorder(Recorder):
    """What a run of a tube tells and keeps.

    Ranks share the grains; samples of all of them are on every rank, and the first one tells.
    """

    def __init__(self, scene: Any, setting: Setting) -> None:
        if setting.resume:
            assert setting.out is not None
            time = checkpoint.numbers(setting.out)["time"]
            monitor = setting.out / "monitor.csv"
            on_root(setting.comm, partial(drop_after, monitor, "time", time))
        super().__init__(scene, setting, COLUMNS)
        self.tube: SlugTube
        self._writer: FieldWriter | None = None
        self._series: files.Series | None = None
        self._frames: list[tuple[float, NDArray[np.float64], NDArray[np.float64]]] = []
        self._stills: list[Still] = []
        # impacts since the last sample
        self._impacts: list[NDArray[np.float64]] = []
        self.wear: WallWear | None = None

    def begin(self, tube: SlugTube) -> None:
        """The tube stands at its start, or where a checkpoint was written."""
        self.tube, numerics = tube, self.scene.numerics
        self._sampler, self.section = Sampler(tube), Section(tube)
        step = numerics.gas_step
        self._sample = max(round(self.scene.averages.interval / step), 1)
        self._output = max(round(self.scene.interval / step), 1)
        self._last = round(numerics.end_time / step)
        if self.scene.model.wear is not None:
            tube.grains.watched = True
            self.wear = WallWear(self.scene.wall_surface())
        if self.resume:
            self.restore()
        self.lap("setup")
        text = f"{tube.gas.tube.size} nodes of the pressure, {tube.inner_steps} steps of the grains"
        self.progress.stage(text)
        self.log(f"{text} in one of the gas; from {tube.time:.4g} s")
        if self.out is not None and self.comm.rank == 0 and self.scene.output.xdmf:
            self._series = files.Series(self.out, self.resume, tube.time)
            mesh, until = self.section.mesh.mesh, tube.time
            self._writer = FieldWriter(self.out / "fields", mesh, append=self.resume, until=until)
        if not self.resume:
            self._keep()

    @property
    def samples(self) -> Samples:
        """Averages over slices so far."""
        return self._sampler.samples

    @property
    def done(self) -> bool:
        """Whether the tube has come to its end."""
        return bool(self.tube.number >= self._last)

    def step(self) -> None:
        """What is due after a step of the gas: a sample, a row, a snapshot, a checkpoint.

        Raises TimeIsUp where the run has used its time.
        """
        tube = self.tube
        if tube.number % self._sample == 0:
            self._sampler(tube)
            self._wear_away()
            self._tell()
            end = self.scene.numerics.end_time
            if tube.time > end - FILM and len(self.samples.time) % 2 == 0:
                self._frames.append(self._frame())
            if tube.time > end - SECTIONS:
                middle = tube.shape.length / 2
                low, high = middle - SLICE / 2, middle + SLICE / 2
                self._stills.append(Still.of(tube.time, self._in_line(), low, high))
        if tube.number % self._output == 0 or self.done:
            self._keep()
            self.log(f"step {tube.number}: {self._warning(self._row())}")
        if not self.done:
            self.check_time()

    def _frame(self) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
        """Grains as the film shows them: from the side, a bend to the side from above."""
        grains = self.tube.grains.everything()
        at = grains.place[:, self.scene.view]
        velocity = self.tube.in_line(grains.place, grains.velocity)[:, 2]
        return self.tube.time, np.column_stack([at, grains.radius]), velocity

    def _in_line(self) -> Still:
        """All grains in the straight line that a bend stands for."""
        grains, arc = self.tube.grains.everything(), self.scene.geometry.arc
        place = grains.place if arc is None else arc.straightened(grains.place)
        velocity = self.tube.in_line(grains.place, grains.velocity)
        return Still(self.tube.time, place, grains.radius, velocity)

    def _wear_away(self) -> None:
        """Enter the impacts since the last sample into the sums of the wall."""
        if self.wear is None:
            return
        # in an order that no restart changes
        rows = np.concatenate([*self._impacts, self.tube.impacts()])
        rows, self._impacts = rows[np.lexsort(rows.T)], []
        if self.tube.time <= self.scene.begin:
            return
        speed, mass, diameter = rows[:, 3], rows[:, 5], 2 * rows[:, 6]
        angle = np.arcsin(np.clip(rows[:, 4] / np.maximum(speed, 1e-300), 0.0, 1.0))
        arc = self.scene.geometry.arc
        straight = rows[:, :3] if arc is None else arc.straightened(rows[:, :3])
        removed = self.scene.model.wear.removed(speed, angle, mass, diameter)
        self.wear.add(self.wear.surface.triangle_at(straight), speed, angle, removed)
        self.wear.seconds += self._sample * self.scene.numerics.gas_step

    def _tell(self) -> None:
        """A row of the monitor and the early-warning line."""
        row = self._row()
        if self.monitor is not None:
            self.monitor.write(row)
        self.progress.update(self.tube.number / self._last, self._warning(row))

    def _row(self) -> dict[str, Any]:
        """What the monitor tells of the tube now; porosities are those of the last sample.

        Collective where processes share the grains.
        """
        tube, solids = self.tube, self.samples.solids
        inside = tube.grains.inside()
        return {
            "step": tube.number,
            "time": tube.time,
            "grains": inside,
            "fed": tube.fed,
            "out": tube.out,
            "pressure_drop": tube.gas.drop,
            "max_solids_fraction": float(solids[-1].max()) if solids else math.nan,
            "fastest": self._sampler.fastest,
            "grain_error": tube.start + tube.fed - inside - tube.out,
        }

    def _warning(self, row: dict[str, Any]) -> str:
        end = self.scene.numerics.end_time
        return (
            f"{row['time']:.4g} of {end:g} s, {row['grains']} grains, drop"
            f" {row['pressure_drop']:.4g} Pa, max alpha_s {row['max_solids_fraction']:.3f},"
            f" fastest {row['fastest']:.3g} m/s, grain error {row['grain_error']}"
        )

    # -- its state -----------------------------------------------------------------------------

    def _keep(self) -> None:
        """A snapshot for ParaView and the checkpoint."""
        tube = self.tube
        grains = tube.grains.everything()
        if self._series is not None:
            place, radius, number = grains.place, grains.radius, grains.number
            self._series.add(tube.time, place, radius, grains.velocity, number)
        if self._writer is not None:
            pressure = tube.gas.tube.function(tube.gas.pressure)
            self._writer.write(tube.time, {"pressure": pressure})
        self.save()

    def save(self) -> None:
        """Write the checkpoint."""
        if self.out is None:
            return
        arrays = {f"tube.{name}": np.asarray(v) for name, v in self.tube.state().items()}
        kept = {f.name: np.array(getattr(self.samples, f.name)) for f in _listed(self.samples)}
        arrays |= {f"samples.{name}": values for name, values in kept.items()}
        if self.wear is not None:
            self._impacts.append(self.tube.impacts())
            arrays |= {f"wear.{name}": values for name, values in self.wear.state().items()}
            arrays["impacts.rows"] = np.concatenate(self._impacts)
        numbers = {"time": self.tube.time}
        checkpoint.save(self.out, self.comm, {}, numbers, others=arrays)

    def restore(self) -> None:
        """Put the checkpoint back."""
        assert self.out is not None
        arrays = checkpoint.others(self.out)
        self.tube.restore({n: _plain(v) for n, v in _part(arrays, "tube").items()})
        for name, values in _part(arrays, "samples").items():
            getattr(self.samples, name)[:] = values.tolist() if values.ndim == 1 else list(values)
        if self.wear is not None:
            self.wear.restore(_part(arrays, "wear"))
            self._impacts = [_part(arrays, "impacts")["rows"]]

    def step_back(self) -> None:
        """Keep the state after the last step."""
        self.save()

    def write_files(self, result: Result) -> None:
        """Tables, pictures and the film of the slugs."""
        tube, scene = self.tube, self.scene
        fields_ = {"pressure": tube.gas.tube.function(tube.gas.pressure)}
        result.take(snapshot(tube.gas.tube.mesh.mesh, fields_))
        result.sections["samples"] = self.samples
        out = self.out
        if out is not None and len(self.samples.time) > 1:
            box = tube.gas.tube.points[:, scene.view]
            seen = told.Seen(self._frames, self._stills, (*box.min(axis=0), *box.max(axis=0)))
            on_root(self.comm, lambda: told.write(out, self.samples, scene, seen, self.wear))

    def close(self) -> None:
        """Close the files."""
        super().close()
        if self._writer is not None:
            self._writer.close()


def _listed(samples: Samples) -> list[Any]:
    """Fields of the samples that are series in time."""
    return [f for f in fields(samples) if isinstance(getattr(samples, f.name), list)]


def _part(arrays: Mapping[str, NDArray[Any]], name: str) -> dict[str, NDArray[Any]]:
    stem = f"{name}."
    return {n.removeprefix(stem): v for n, v in arrays.items() if n.startswith(stem)}


def _plain(value: NDArray[Any]) -> Any:
    """An array, or the text that it holds."""
    return str(value) if value.dtype.kind == "U" else value

# SPDX-License-Identifier: LGPL-3.0-or-later
"""The developing flow: steady, marched from the inlet to the outlet, whatever the model."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from mpi4py import MPI

from fem_tfm.errors import SolverError
from fem_tfm.geometry.mesh import Mesh
from fem_tfm.geometry.shapes import Duct, Pipe
from fem_tfm.models.line import Line
from fem_tfm.models.reynolds_stress.line import ReynoldsStressLine
from fem_tfm.models.reynolds_stress.model import ReynoldsStress
from fem_tfm.models.reynolds_stress.section import ReynoldsStressSection
from fem_tfm.models.two_fluid.line import TwoFluidLine
from fem_tfm.models.two_fluid.model import TwoFluid
from fem_tfm.models.two_fluid.section import TwoFluidSection
from fem_tfm.operation import Inlet
from fem_tfm.output import checkpoint, duct_pictures, pictures
from fem_tfm.output.fields import FieldWriter, snapshot
from fem_tfm.output.files import on_root
from fem_tfm.output.profiles import write_profiles
from fem_tfm.output.result import Result
from fem_tfm.parameters import parameter
from fem_tfm.scenes.dense import Dense
from fem_tfm.scenes.developed import GAS_UNREAD, UNREAD, SectionScene, describe, time_words
from fem_tfm.scenes.duct import DEFAULTS, DuctGas, heat_of
from fem_tfm.scenes.judged.coarser import (
    BOTH_OVER_FIRST,
    LONGER,
    SECOND_WORDS,
    unavailable,
    with_errors,
)
from fem_tfm.scenes.judged.finer import halved_mesh
from fem_tfm.scenes.judged.places import check_step
from fem_tfm.scenes.kinds import Kind, register
from fem_tfm.scenes.particles.tracking import Slabs, exchange_of, following_time, slabs_of
from fem_tfm.scenes.particles.words import parcel_memory
from fem_tfm.scenes.recorder import Recorder, Setting
from fem_tfm.scenes.scene import Answer
from fem_tfm.scenes.statement import MarchNumerics
from fem_tfm.solvers.marching import MarchControl, Stop

# first step in hydraulic diameters
FIRST_STEP = 0.01
# accuracy along the axis at which stations were counted
FOLLOWED = 0.03
# hears of the forms that are prepared
type Compiling = Callable[[str], None]


def unheard(what: str) -> None:
    """Keep to oneself which form is prepared."""


@dataclass(frozen=True)
class Developing(SectionScene["LinePhysics", "LineRecorder"]):
    """A line from its inlet on: what enters is given, the pressure along it is found.

    inlet : how the flow enters
    numerics : how strictly stations are solved, and how far they lie apart

    Raises InputError for values that do not fit each other, or a feed that does not tell what
    enters.
    """

    inlet: Inlet = parameter(doc="what enters a line", factory=Inlet)
    numerics: MarchNumerics = parameter(doc="mesh and solver", factory=MarchNumerics)
    solution: ClassVar[str] = "developing"
    coupled_flows: ClassVar[tuple[str, ...]] = ("duct",)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_step(self.geometry, self.numerics.axial_step)
        # raises where the feed does not tell it
        _ = self.solids_inlet

    @property
    def files(self) -> Sequence[str]:
        """Names of what a run may leave in its directory."""
        return (*super().files, "axis.csv", "axis.png")

    def recorder(self, setting: Setting | None = None) -> LineRecorder:
        """What a run tells and keeps while it works."""
        return LineRecorder(self, setting or Setting())

    def solve(self, recorder: LineRecorder, previous: Answer | None = None) -> Answer:
        """March the line from its inlet, or from a checkpoint, to its outlet.

        Raises
        ------
        SolverError
            the flow turns back somewhere, no step is small enough, or a balance is broken.
        """
        if previous is not None:
            previous.close()
        physics = self.physics
        line = physics.line(recorder.comm, recorder.compiling)
        if recorder.resume:
            recorder.restore(line)
        else:
            line.begin()
        recorder.begin(line)
        line.march(recorder.station, recorder.retry)
        balances = line.balances()
        if isinstance(line.coupler, Slabs):
            balances |= line.coupler.balances(physics.force_on_particles(line))
        physics.check_balances(balances)
        found = with_errors(self, line, recorder)
        return Answer(
            "finished",
            found.quantities,
            balances,
            "pressure_drop",
            errors=found.errors,
            unestimated=found.unestimated,
            references=physics.references(),
            state=March(line),
            factorisations=line.station.newton.factorisations + recorder.second_factorisations,
        )

    def skipped(self) -> list[str]:
        """What the scene did not need, and why."""
        physics = self.physics
        return [
            "upstream influence: stresses are not differentiated along the axis",
            "history: the march along the axis leads straight to the steady state",
            *physics.skipped_of_axis(),
            *physics.skipped(),
        ]

    def expected_time(self) -> float:
        """About the CPU time of a run whose forms are compiled [s]."""
        physics = self.physics
        march = physics.stations() * physics.station_time * physics.size[1]
        return march * (1.0 if unavailable(self) else BOTH_OVER_FIRST) + following_time(self)

    def describe(self) -> dict[str, Any]:
        """What would be solved, what is left out, and what it would take."""
        physics = self.physics
        size = physics.resolution.core_size(physics.section)
        cells, unknowns = physics.size
        cost, stations = physics.cost(unknowns), physics.stations()
        given = f"{physics.entering()}; found: pressure along the line"
        return describe(self, physics.line_words, given) | {
            "meshes": f"{1e3 * size:.3g} mm core cells at every station",
            "stations": f"about {stations}, more where much changes",
            "finest_mesh": f"{cells} cells, about {unknowns} unknowns",
            "error_estimate": f"none: {why}" if (why := unavailable(self)) else SECOND_WORDS,
            "memory": f"about {cost['memory'] + parcel_memory(self):.0f} MB",
            "time": time_words(self.expected_time(), cost["compile"]),
        }


@dataclass
class March:
    """A line that was marched."""

    line: Line

    def close(self) -> None:
        """Free the solver."""
        self.line.station.newton.destroy()


# -- what the models add ---------------------------------------------------------------------------


class Marching(ABC):
    """What the marches of all models have in common.

    first_stations : that follow the development at `FOLLOWED`
    """

    scene: Any
    balance_error: ClassVar[float]
    first_stations: ClassVar[int]

    @abstractmethod
    def control(self) -> MarchControl:
        """Steps of the march."""

    def stations(self) -> int:
        """About how many stations."""
        control, length = self.control(), float(self.scene.geometry.length)
        development = self.first_stations * math.sqrt(FOLLOWED / control.bend)
        return math.ceil(development + length / control.largest)

    def check_balances(self, balances: Mapping[str, float]) -> None:
        """Refuse a line whose books do not agree.

        Raises
        ------
        SolverError
            a balance is broken.
        """
        worst = max(balances, key=lambda name: balances[name])
        if not balances[worst] <= self.balance_error:
            raise SolverError(f"the balance of {worst} is broken by {balances[worst]:.1e}")


def march_control(scene: Any, largest: float, smallest: float, tolerance: float) -> MarchControl:
    """Steps of a march along a scene's line.

    largest : step where the scene gives none [m]
    smallest : in hydraulic diameters
    tolerance : largest update of a station
    """
    given, width = scene.numerics, scene.geometry.hydraulic_diameter
    largest = given.axial_step or largest
    return MarchControl(
        first=min(FIRST_STEP * width, largest),
        largest=largest,
        smallest=smallest * width,
        bend=given.axial_accuracy,
        tolerance=tolerance,
    )


def fineness(physics: LinePhysics, comm: MPI.Comm, coarser: bool) -> tuple[Mesh, MarchControl]:
    """Mesh and steps of a march, or those with cells and steps twice as large."""
    control = physics.control()
    return halved_mesh(physics, comm, -coarser)(), control.coarser(LONGER) if coarser else control


class DenseMarch(Marching, Dense):
    """A march of the two-fluid model."""

    units = TwoFluidLine.units
    line_words = "developing flow by the two-fluid model: steady, marched from the inlet"
    # measured on the demo: stations that follow the development, CPU seconds a station and unknown,
    # and how much more they are for each field of turbulence that is transported
    first_stations, alone_time, more_a_scale, largest_share = 60, 3.5e-5, 0.15, 1 / 60
    smallest_step, tolerance = 1e-5, 1e-10
    monitored = ("pressure_gradient", "holdup", "max_solids_fraction", "max_theta")

    @property
    def station_time(self) -> float:
        """About the CPU time of a station and unknown [s]."""
        return self.alone_time * (1 + self.more_a_scale * len(self.scene.model.scales))

    def control(self) -> MarchControl:
        """Steps in hydraulic diameters and shares of the length."""
        largest = self.largest_share * self.scene.geometry.length
        tolerance = min(self.scene.numerics.tolerance, self.tolerance)
        return march_control(self.scene, largest, self.smallest_step, tolerance)

    def line(
        self, comm: MPI.Comm, compiling: Compiling = unheard, coarser: bool = False
    ) -> TwoFluidLine:
        """The line before its inlet.

        coarser : with cells and steps twice as large
        """
        scene = self.scene
        mesh, control = fineness(self, comm, coarser)
        station = TwoFluidSection(mesh, self.setup(), compiling, develops=True)
        return TwoFluidLine(
            station,
            scene.geometry.length,
            control,
            scene.feed.outlet_pressure or 0.0,
            scene.inlet,
            scene.solids_inlet,
            slabs_of(scene, station, comm),
        )

    def force_on_particles(self, line: Line) -> float:
        """0: the gas feels no particles."""
        return 0.0

    def line_fields(self, line: Line) -> dict[str, Any]:
        """Fields of the station at hand."""
        assert isinstance(line, TwoFluidLine)
        return line.station.fields()

    def write_line(self, line: Line, result: Result, recorder: LineRecorder) -> None:
        """The last section."""
        assert isinstance(line, TwoFluidLine)
        self.write(line.station, result, recorder.out, None)

    def draw_axis(self, path: Any, columns: Mapping[str, Any]) -> None:
        """The picture along the axis."""
        width = self.scene.geometry.hydraulic_diameter
        pictures.axis_picture(path, columns, TwoFluidLine.units, width, self.scene.title)


class DuctMarch(Marching, DuctGas):
    """A march of the Reynolds-stress model."""

    units = ReynoldsStressLine.units
    line_words = "developing gas of a duct by Reynolds stresses: steady, marched from the inlet"
    # measured on the demo: stations that follow the development, CPU seconds a station and unknown
    first_stations, station_time, largest_diameters = 45, 4.5e-5, 2.0
    # a march keeps stations to this relative update; the next one starts from there anyway
    smallest_step, tolerance, balance_error = 1e-6, 1e-8, 1e-6
    monitored = ("friction_factor", "centre_to_bulk", "secondary_velocity_max", "smallest_stress")

    def control(self) -> MarchControl:
        """Steps in hydraulic diameters."""
        largest = self.largest_diameters * self.scene.geometry.hydraulic_diameter
        tolerance = max(self.scene.numerics.tolerance, self.tolerance)
        return march_control(self.scene, largest, self.smallest_step, tolerance)

    def line(
        self, comm: MPI.Comm, compiling: Compiling = unheard, coarser: bool = False
    ) -> ReynoldsStressLine:
        """The line before its inlet.

        coarser : with cells and steps twice as large
        """
        scene, heat = self.scene, None
        mesh, control = fineness(self, comm, coarser)
        exchange = exchange_of(scene, mesh.mesh)
        station = ReynoldsStressSection(
            mesh, self.setup(), compiling, develops=True, exchange=exchange
        )
        if scene.model.heat is not None:
            compiling("heat")
            heat = heat_of(scene, station)
        return ReynoldsStressLine(
            station,
            scene.geometry.length,
            control,
            scene.feed.outlet_pressure or 0.0,
            scene.model.gas,
            scene.inlet,
            heat,
            scene.model.heat,
            slabs_of(scene, station, comm, exchange, heat),
        )

    def force_on_particles(self, line: Line) -> float:
        """Axial force of the gas on the particles, along the whole line [N]."""
        return line.sums.now["particles"] * line.station.area * self.section.area_factor

    def line_fields(self, line: Line) -> dict[str, Any]:
        """Fields of the station at hand, with those of the heat."""
        assert isinstance(line, ReynoldsStressLine)
        return self.fields(line.station, {"heat": line.heat})

    def write_line(self, line: Line, result: Result, recorder: LineRecorder) -> None:
        """The last section; the inlet has no developed heat yet."""
        assert isinstance(line, ReynoldsStressLine)
        heat = line.heat if len(line.rows) > 1 else None
        self.write(line.station, result, recorder.out, {"heat": heat})

    def draw_axis(self, path: Any, columns: Mapping[str, Any]) -> None:
        """The picture along the axis."""
        width = self.scene.geometry.hydraulic_diameter
        duct_pictures.axis_picture(path, columns, width, self.scene.title)


LinePhysics = DenseMarch | DuctMarch

# -- the run ---------------------------------------------------------------------------------------


class LineRecorder(Recorder):
    """What a march tells and keeps: progress, monitor.csv, checkpoint, fields.xdmf."""

    def __init__(self, scene: Developing, setting: Setting) -> None:
        self.physics = scene.physics
        units = {"station": "", "z": "m", "step": "m", "iterations": "", "update": "", "bend": ""}
        units |= {name: self.physics.units[name] for name in self.physics.monitored}
        super().__init__(scene, setting, units)
        self.columns = tuple(units)
        self.line: Line | None = None
        self.second_factorisations = 0
        # share of the first march in the time of the run
        self._first = 1.0 if unavailable(scene) else 1 / BOTH_OVER_FIRST
        self._writer: FieldWriter | None = None

    @property
    def section(self) -> Any:
        """The station at hand, None before there is one."""
        return self.line.station if self.line else None

    def compiling(self, what: str) -> None:
        """Tell which form is prepared."""
        self.lap("setup")
        self.progress.stage(f"forms: {what} (compiled once for each choice of closures)")

    def begin(self, line: Line) -> None:
        """The line stands at its inlet, or where a checkpoint was written."""
        self.lap("compile")
        self.line, mesh = line, line.station.mesh
        assert line.place is not None
        text = f"stations on {mesh.num_cells} cells, {line.station.dofs} unknowns"
        self.progress.stage(text)
        self.log(f"{text}; from z = {line.place.z:.4g} m")
        if self.out is not None and self.scene.output.xdmf:
            self._writer = FieldWriter(self.out / "fields", mesh.mesh, append=self.resume)
        self._due = self._next_due(line.place.z) if self.resume else 0.0
        if isinstance(line.coupler, Slabs):
            self.tracked = line.coupler.tracked
            if not self.resume:
                line.coupler.enter()
        if not self.resume:
            self._keep(line)

    def station(self, line: Line, stop: Stop) -> None:
        """A row of the monitor, the early-warning line and a checkpoint."""
        row, place = line.rows[-1], stop.place
        assert place.last is not None
        values = {name: row[name] for name in self.columns if name in row}
        values |= {"station": len(line.rows) - 1, "step": place.last}
        values |= {name: getattr(stop, name) for name in ("iterations", "update", "bend")}
        if self.monitor is not None:
            self.monitor.write(values)
        told = ", ".join(f"{n} {row[n]:.4g}" for n in self.physics.monitored if n in row)
        message = f"z {place.z:.4g} of {line.length:.4g} m, {told}"
        if isinstance(line.coupler, Slabs):
            message += f"; {line.coupler.warning()}"
        self.progress.update(self._first * self._fraction(place.z), message)
        self.log(f"station {len(line.rows) - 1}: step {place.last:.3g} m, {message}")
        if stop.change > line.control.exchange:
            changed = f"by {stop.change:.1e} in the last of {stop.passes} passes"
            self.log(f"accepted though what particles give to the flow still changed {changed}")
        self._keep(line)
        self.check_time()

    def retry(self, step: float, reason: str) -> None:
        """A line of the log for a step taken back."""
        self.log(f"taken back: {reason}; step {step:.3g} m")

    def second(self) -> None:
        """The line is marched, and a second march tells its error."""
        text = f"error estimate: {SECOND_WORDS}"
        self.progress.stage(text)
        self.log(text)

    def second_station(self, line: Line, stop: Stop) -> None:
        """Progress of the second march."""
        done = self._first + (1 - self._first) * self._fraction(stop.place.z)
        self.progress.update(done, f"z {stop.place.z:.4g} of {line.length:.4g} m")
        self.check_time("while the error of the whole line was estimated")

    def second_ends(self, line: Line) -> None:
        """What the second march has cost."""
        newton = line.station.newton
        if line.rows:
            self.log(f"{len(line.rows) - 1} stations on {line.station.mesh.num_cells} cells")
        self.second_factorisations = newton.factorisations

    def restore(self, line: Line) -> None:
        """Put the checkpoint on a line."""
        assert self.out is not None
        fields = line.stored_fields() | line.companions()[0]
        numbers = checkpoint.load(self.out, self.comm, fields)
        line.restore(fields, numbers, checkpoint.tables(self.out), checkpoint.others(self.out))

    def step_back(self) -> None:
        """Go back to the last accepted station, which is kept already."""
        assert self.line is not None
        self.line.step_back()

    def write_files(self, result: Result) -> None:
        """The table along the axis with its picture, and the last section with its own."""
        line, out = self.line, self.out
        assert line is not None
        result.sections["axis"] = columns = {k: np.array(v) for k, v in line.columns().items()}
        result.take(snapshot(line.station.mesh.mesh, self.physics.line_fields(line)))
        self.physics.write_line(line, result, self)

        def write() -> None:
            assert out is not None
            write_profiles(out / "axis.csv", columns, line.units)
            if self.scene.output.pictures and len(line.rows) > 1:
                self.physics.draw_axis(out / "axis.png", columns)

        if out is not None:
            on_root(self.comm, write)

    def _fraction(self, z: float) -> float:
        """Share of a march's stations behind, which crowd within some diameters of the inlet."""
        unit = 3 * self.scene.geometry.hydraulic_diameter
        return math.log1p(z / unit) / math.log1p(self.scene.geometry.length / unit)

    def _keep(self, line: Line) -> None:
        """Write the checkpoint, and the station to fields.xdmf if it is due."""
        if self.out is not None:
            checkpoint.save(self.out, self.comm, *line.state())
        assert line.place is not None
        z = line.place.z
        if self._writer is not None and (z >= self._due or z >= line.length):
            chosen, fields = self.scene.output.fields, self.physics.line_fields(line)
            self._writer.write(z, {n: f for n, f in fields.items() if n in chosen})
            self._due = self._next_due(z)

    def _next_due(self, z: float) -> float:
        """The next of the evenly spaced places at which a section goes to fields.xdmf [m]."""
        every = self.scene.geometry.length / self.scene.output.stations
        return float((math.floor(z / every + 1e-9) + 1) * every)


register(
    Kind(
        "dense",
        Developing,
        TwoFluid,
        (Pipe, Duct),
        DenseMarch,
        {"numerics.cells": "triangle"},
        UNREAD,
    )
)
register(
    Kind(
        "duct",
        Developing,
        ReynoldsStress,
        (Pipe, Duct),
        DuctMarch,
        DEFAULTS,
        (*UNREAD, *GAS_UNREAD, "inlet.solids_intensity", "inlet.profile"),
    )
)

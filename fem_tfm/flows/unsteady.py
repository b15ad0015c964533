# SPDX-License-Identifier: LGPL-3.0-or-later
"""The unsteady dense flow in three dimensions: from a case to its time series.

What goes in over time, the state at the start, the steps, and what is told and kept while the flow
runs. The flow itself is `models.finite_volume.UnsteadyFlow`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from mpi4py import MPI

from fem_tfm import signals
from fem_tfm.case import Case
from fem_tfm.flows import dense
from fem_tfm.flows.driver import Answer, Scene
from fem_tfm.flows.recorder import Recorder
from fem_tfm.flows.samples import MEANS, Plane, Probes, Sections, Table, columns
from fem_tfm.mesh import axial_layers, geometry_of, line, line_cells
from fem_tfm.models.finite_volume import Inflow, Report, UnsteadyFlow, UnsteadyProblem
from fem_tfm.models.pointwise import ClosureSet
from fem_tfm.output import checkpoint
from fem_tfm.output.fields import FieldWriter
from fem_tfm.output.files import on_root
from fem_tfm.output.profiles import drop_after
from fem_tfm.output.result import Result
from fem_tfm.solvers.time_stepping import StepControl, TimeStepping

if TYPE_CHECKING:
    from fem_tfm.progress import Progress

# without other wishes: outputs in a run, and the first step over the largest
OUTPUTS, FIRST_SHARE = 20, 0.01
# times closer than this, over the end, are the same
SAME_TIME = 1e-9
# iterations of each equation that count as all the effort a step may take
MOST_ITERATIONS = {
    "solids fraction": 25, "theta": 60, "turbulence": 150, "momentum": 100, "pressure": 60,
}  # fmt: skip
# unknowns of a cell besides turbulence: velocities, solids fraction, granular temperature, pressure
UNKNOWNS, GAS_UNKNOWNS = 9, 4


# -- from the case -----------------------------------------------------------------------------


def problem_of(case: Case) -> UnsteadyProblem:
    """The unsteady problem of a case, in SI units."""
    inlet, solids = case.inlet, case.solids_material
    return UnsteadyProblem(
        gas=case.gas_material,
        solids=solids,
        closures=ClosureSet.of(case.closures, case.walls),
        gravity=np.array(case.gravity_vector),
        gas_velocity=case.operation.gas_superficial_velocity,
        diameter=case.geometry.hydraulic_diameter,
        wall_offset=case.wall_distance,
        theta_floor=case.numerics.theta_floor,
        grain_gap=case.walls.grain_gap * (solids.diameter if solids else 0.0),
        inlet_profile=inlet.profile,
        solids_intensity=inlet.solids_intensity,
        gas_intensity=inlet.gas_intensity,
        length_scale=inlet.length_scale,
        second_order=case.numerics.order == 1,
        compressible=case.gas.compressible,
        reference_pressure=case.gas.pressure,
        outlet_pressure=case.operation.outlet_pressure,
    )


def inflow_at(case: Case, time: float) -> Inflow:
    """What enters and leaves at a time [s]."""
    given = case.operation
    gas = given.gas_superficial_velocity * _factor(given.gas_schedule, time)
    blocked = any(begin < time <= end for begin, end in given.outlet_blocked)
    if case.solids is None:
        return Inflow(gas, blocked=blocked)
    fraction, speed = case.solids_inlet
    return Inflow(gas, fraction * _factor(given.solids_schedule, time), speed, blocked)


def _factor(schedule: tuple[tuple[float, float], ...], time: float) -> float:
    """A function of time from its corners, 1 without any [-]."""
    if not schedule:
        return 1.0
    times, factors = zip(*schedule, strict=True)
    return float(np.interp(time, times, factors))


def interval(case: Case) -> float:
    """Time between outputs [s]."""
    return case.output.interval or case.numerics.end_time / OUTPUTS


def milestones(case: Case) -> list[float]:
    """Times that steps end at: outputs, checkpoints, corners of what is fed, and the end [s]."""
    end, given = case.numerics.end_time, case.operation
    spans = (interval(case), case.output.checkpoint_interval or interval(case))
    times = [k * span for span in spans for k in range(1, math.ceil(end / span))]
    times += [
        time for schedule in (given.gas_schedule, given.solids_schedule) for time, _ in schedule
    ]
    times += itertools.chain.from_iterable(given.outlet_blocked)
    found: list[float] = []
    for time in sorted(times):
        if time - (found[-1] if found else 0.0) > SAME_TIME * end and end - time > SAME_TIME * end:
            found.append(time)
    return [*found, end]


def is_due(time: float, span: float, end: float) -> bool:
    """Whether a time is a multiple of `span`, or the end [s]."""
    return time >= end or abs(time - span * round(time / span)) <= SAME_TIME * end


def step_control(case: Case) -> StepControl:
    """Steps as the case wants them."""
    given = case.numerics
    largest = given.largest_time_step or max(interval(case), given.smallest_time_step)
    first = given.time_step or FIRST_SHARE * largest
    return StepControl(
        first=max(min(first, largest), given.smallest_time_step),
        largest=largest,
        smallest=given.smallest_time_step,
        courant=given.courant,
    )


def start(case: Case, flow: UnsteadyFlow) -> None:
    """Put a flow into the initial state of its case."""
    given, cells = case.initial, flow.cells
    if given.state == "rest":
        flow.initialise()
    elif given.state == "bed":
        _, y, s = flow.mesh.straightened(cells.centre).T
        bottom = -case.geometry.size[1] / 2
        top = math.inf if given.bed_height is None else bottom + given.bed_height
        end = math.inf if given.bed_end is None else given.bed_end
        bed = (y < top) & (s >= given.bed_start) & (s < end)
        flow.initialise(np.where(bed, given.bed_fraction, 0.0))
    else:
        inflow = inflow_at(case, 0.0)
        flow.initialise(inflow.solids_fraction)
        axis = flow.mesh.axis(cells.centre)
        gas = inflow.gas_velocity / (1 - inflow.solids_fraction)
        flow.set_velocities(inflow.solids_velocity * axis, gas * axis)


class Stepped:
    """A flow as the steps in time see it, fed by its case.

    Attributes
    ----------
    report : what the last step told
    """

    def __init__(self, case: Case, flow: UnsteadyFlow) -> None:
        self.case, self.flow, self.mesh = case, flow, flow.mesh
        self.report: Report | None = None

    @property
    def dofs(self) -> int:
        """Unknowns on all ranks."""
        return self.mesh.num_cells * unknowns(self.case)

    def advance(self, dt: float, time: float) -> float:
        """Go one step and return its effort."""
        self.report = self.flow.advance(dt, inflow_at(self.case, time))
        self.flow.time = time
        taken = self.report.iterations
        return max(n / MOST_ITERATIONS[name] for name, n in taken.items())

    def rate(self) -> float:
        """Largest Courant number over the step [1/s]."""
        return max(self.flow.courant())


# -- what is told and kept ---------------------------------------------------------------------

FILES = (*dense.FILES, "probes.csv", "sections.csv", "plane.png")
COLUMNS = {
    "step": "",
    "time": "s",
    "dt": "s",
    "iterations": "",
    "courant": "",
    "max_alpha_s": "",
    "max_theta": "m2/s2",
    "max_k": "m2/s2",
    "mass_error": "",
    "pressure_drop": "Pa",
    "holdup": "",
    "solids_mass_flow": "kg/s",
}
TABLES = ("monitor.csv", "probes.csv", "sections.csv")


class FlowRecorder(Recorder):
    """What a run of an unsteady flow tells and keeps: tables, fields.xdmf, checkpoint.

    case, out, progress, resume : as for `Recorder`
    """

    def __init__(self, case: Case, out: Path | None, progress: Progress, resume: bool) -> None:
        self.since = checkpoint.numbers(out)["time"] if resume else 0.0
        if resume:
            # a run that was killed has written rows behind its checkpoint
            on_root(MPI.COMM_WORLD, partial(_drop_rows, out, self.since))
        super().__init__(case, out, progress, resume, COLUMNS)
        self.stepping: TimeStepping | None = None
        self._writer: FieldWriter | None = None
        self._probes: Probes | None = None
        self._sections: Sections | None = None
        self._plane: Plane | None = None
        self._tables = [Table(out / name, resume) for name in TABLES[1:]] if out else []

    def begin(self, section: Stepped, stepping: TimeStepping) -> None:
        """The flow stands at its start, or where a checkpoint was written."""
        self.lap("setup")
        self.section, self.stepping = section, stepping
        flow, given = section.flow, self.case.output
        text = f"{section.mesh.num_cells} cells, {section.dofs} unknowns"
        self.progress.stage(text)
        self.log(f"{text}; from {stepping.time:.6g} s")
        if given.probes:
            self._probes = Probes(section.mesh.mesh, given.probes)
        if given.sections:
            owned = flow.cells.owned
            volume, centre = flow.cells.volume[:owned], flow.cells.centre[:owned]
            self._sections = Sections(
                section.mesh, given.sections, volume, centre, axial_layers(self.case)
            )
        if self.out is not None and given.pictures:
            name = "u_g" if self.case.solids is None else "alpha_s"
            self._plane = Plane(section.mesh, name)
            if self.resume:
                self._plane.restore(checkpoint.tables(self.out))
        if self.out is not None and given.xdmf:
            self._writer = FieldWriter(
                self.out / "fields", section.mesh.mesh, append=self.resume, until=self.since
            )
        if not self.resume:
            self._keep_fields()

    def step(self) -> None:
        """A row of the monitor and of the probes; what is due at this time."""
        stepping, report, flow = self.stepping, self.section.report, self.section.flow
        values: dict[str, float] = {"step": stepping.count, "time": stepping.time}
        values |= {"dt": stepping.step, "iterations": sum(report.iterations.values())}
        values |= {n: getattr(report, n) for n in ("courant", "max_alpha_s", "max_theta", "max_k")}
        values["mass_error"] = report.mass_error
        found = flow.quantities()
        values |= {name: found[name] for name in COLUMNS if name in found}
        if self.monitor is not None:
            self.monitor.write(values)
        end = self.case.numerics.end_time
        warning = (
            f"{stepping.time:.4g} of {end:g} s, dt {stepping.step:.3g} s, max alpha_s"
            f" {report.max_alpha_s:.4f}, max theta {report.max_theta:.3g}, max k"
            f" {report.max_k:.3g}, CFL {report.courant:.2f}, mass error {report.mass_error:.1e}"
        )
        self.progress.update(stepping.time / end, warning)
        if self._probes is not None:
            row = self._probes.row(flow.fields())
            self._tell(0, {"time": stepping.time, **row}, {"time": "s", **columns(row)})
        if is_due(stepping.time, interval(self.case), end):
            self.log(f"step {stepping.count}: {warning}")
            self._keep_fields()
        if is_due(stepping.time, self.case.output.checkpoint_interval or interval(self.case), end):
            self.save()

    def save(self) -> None:
        """Write the checkpoint."""
        if self.out is None:
            return
        state = self.section.flow.state()
        numbers = {name: float(v) for name, v in state.items() if np.ndim(v) == 0}
        values = {name: v for name, v in state.items() if np.ndim(v) > 0}
        numbers |= {f"stepping.{name}": v for name, v in self.stepping.state().items()}
        mesh = self.section.mesh.mesh
        numbers["time"] = self.stepping.time
        tables = self._plane.state() if self._plane else {}
        checkpoint.save_cells(self.out, mesh, values, numbers, tables)

    def draw(self) -> None:
        """The picture of the plane through the axis."""
        if self._plane is not None and self._plane.moments:
            path = self.out / "plane.png"
            on_root(self.comm, lambda: self._plane.draw(path, self.case.title))

    def step_back(self) -> None:
        """Keep the last accepted state."""
        self.save()

    def restore(self, section: Stepped, stepping: TimeStepping) -> None:
        """Put the checkpoint back."""
        values, numbers = checkpoint.load_cells(self.out, section.mesh.mesh)
        own = {name: v for name, v in numbers.items() if name.startswith("stepping.")}
        stepping.restore({name.removeprefix("stepping."): v for name, v in own.items()})
        section.flow.restore({**values, **{k: v for k, v in numbers.items() if k not in own}})
        section.flow.time = stepping.time

    def close(self) -> None:
        """Close the files."""
        super().close()
        for table in self._tables:
            table.close()

    def _keep_fields(self) -> None:
        """The present fields, the plane for the picture, and the means over sections."""
        fields, time = self.section.flow.fields(), self.stepping.time
        if self._sections is not None:
            for row in self._sections.rows(fields):
                self._tell(1, {"time": time, **row}, {"time": "s", "place": "m", **MEANS})
        if self._plane is not None:
            self._plane.take(time, fields)
        if self._writer is not None:
            self._writer.write(time, {n: f for n, f in fields.items() if n in self.chosen})

    @property
    def chosen(self) -> tuple[str, ...]:
        """Names of the fields that the case wants."""
        return self.case.output.fields

    def _tell(self, table: int, row: Mapping[str, float], units: Mapping[str, str]) -> None:
        if self._tables and self.comm.rank == 0:
            self._tables[table].write(row, units)


def _drop_rows(out: Path, time: float) -> None:
    for name in TABLES:
        drop_after(out / name, "time", time)


# -- the run -----------------------------------------------------------------------------------


def solve(case: Case, recorder: FlowRecorder) -> Answer:
    """Take the flow of a case to its end.

    Raises
    ------
    SolverError
        no step above the smallest succeeds.
    KeyboardInterrupt
        the user has asked to stop; all ranks stand behind the same step.
    """
    section = Stepped(case, UnsteadyFlow(problem_of(case), line(case)))
    stepping = TimeStepping(step_control(case), milestones(case), recorder.log)
    if recorder.resume:
        recorder.restore(section, stepping)
    else:
        start(case, section.flow)
    recorder.begin(section, stepping)
    with signals.deferred() as request:
        while not stepping.done:
            stepping.advance(section)
            recorder.step()
            if request.on_any(recorder.comm):
                raise KeyboardInterrupt
    flow = section.flow
    return Answer("finished", flow.quantities(), flow.balances(), "pressure_drop")


def skipped(case: Case) -> list[str]:
    """What the scene did not need, and why."""
    left_out = []
    if geometry_of(case).symmetry == "half":
        left_out.append("left half: mirror image of the right one")
    return left_out + dense.skipped_laws(case)


def write(case: Case, recorder: FlowRecorder, result: Result) -> None:
    """The picture; all else is written along the way."""
    recorder.draw()


SCENE = Scene(FlowRecorder, FILES, dense.advice, skipped, solve, write)

# measured at 6,000 and 9,600 cells: memory [MB] and CPU time of a cell and step [s]
BASE_MEMORY, CELL_MEMORY, CELL_TIME, SCALE_TIME = 220, 0.014, 8e-6, 0.6e-6


def unknowns(case: Case) -> int:
    """Unknowns of a cell."""
    found = GAS_UNKNOWNS if case.solids is None else UNKNOWNS
    return found + dense.transported_scales(case)


def describe(case: Case) -> dict[str, Any]:
    """What would be solved, what is left out, and what it would take."""
    layers, end = axial_layers(case), case.numerics.end_time
    cells = line_cells(case)
    speed = case.operation.gas_superficial_velocity
    steps = end * speed * layers / case.geometry.length / case.numerics.courant
    steps = max(steps, end / step_control(case).largest)
    cell_time = CELL_TIME + SCALE_TIME * dense.transported_scales(case)
    return dense.describe(case) | {
        "solved": f"unsteady flow by the two-fluid model: all of 3D, {end:g} s",
        "given": _given(case),
        "skipped": skipped(case),
        "meshes": f"{layers} layers of {cells // layers} cells",
        "finest_mesh": f"{cells} cells, about {cells * unknowns(case)} unknowns",
        "memory": f"about {BASE_MEMORY + CELL_MEMORY * cells:.0f} MB",
        "time": f"about {cell_time * cells * steps:.0f} s for at least {steps:.0f} steps",
    }


def _given(case: Case) -> str:
    text = f"gas {case.operation.gas_superficial_velocity:g} m/s superficial"
    if case.solids is not None:
        alpha, speed = case.solids_inlet
        text += f", solids enter with fraction {alpha:.4g} at {speed:.4g} m/s"
    return f"{text}; starts from state {case.initial.state!r}"

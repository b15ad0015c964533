# SPDX-License-Identifier: LGPL-3.0-or-later
"""The unsteady dense flow in three dimensions: start-up, bends, blockage, beds that are swept.

What goes in over time, the state at the start, the steps, and what is told and kept while the flow
runs. The flow itself is `models.finite_volume.UnsteadyFlow`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from mpi4py import MPI

from fem_tfm import signals
from fem_tfm.errors import InputError
from fem_tfm.geometry.gmsh import GmshModel
from fem_tfm.geometry.mesh import Mesh, axial_layers, line_cells, line_mesh, line_model
from fem_tfm.geometry.resolution import Resolution
from fem_tfm.geometry.section import Section
from fem_tfm.geometry.shapes import Bend, Duct, Pipe
from fem_tfm.models.carrier import LineCarrier
from fem_tfm.models.finite_volume import Inflow, Report, UnsteadyFlow, UnsteadyProblem
from fem_tfm.models.two_fluid.model import TwoFluid
from fem_tfm.operation import Initial, Inlet
from fem_tfm.output import checkpoint
from fem_tfm.output.fields import FieldWriter, snapshot
from fem_tfm.output.files import on_root
from fem_tfm.output.profiles import drop_after
from fem_tfm.output.result import Result
from fem_tfm.parameters import parameter
from fem_tfm.scenes import dense
from fem_tfm.scenes.developed import describe
from fem_tfm.scenes.judged.gas import Derived
from fem_tfm.scenes.judged.memory import check_memory, section_cells
from fem_tfm.scenes.judged.places import check_places
from fem_tfm.scenes.judged.plausible import check_flux, derived
from fem_tfm.scenes.judged.times import of_the_times
from fem_tfm.scenes.kinds import Kind, register
from fem_tfm.scenes.particles.line import Along, follow_line
from fem_tfm.scenes.particles.tracking import following_time
from fem_tfm.scenes.particles.words import parcel_memory
from fem_tfm.scenes.physics import SECTION_FILES, Physics
from fem_tfm.scenes.recorder import Recorder, Setting
from fem_tfm.scenes.samples import MEANS, Plane, Probes, Sections, Table, columns
from fem_tfm.scenes.scene import Answer, Scene
from fem_tfm.scenes.statement import TimeNumerics
from fem_tfm.solvers.time_stepping import TimeControl, TimeStepping

# without other wishes: outputs in a run, and the first step over the largest
OUTPUTS, FIRST_SHARE = 20, 0.01
# times closer than this, over the end, are the same
SAME_TIME = 1e-9
# Courant number behind a step over that for which it was chosen, above which the step is taken back
SURPRISE = 5.0
# iterations of each equation that count as all the effort a step may take
MOST_ITERATIONS = {
    "solids fraction": 25, "theta": 60, "turbulence": 150, "momentum": 100, "pressure": 60,
}  # fmt: skip
# unknowns of a cell besides turbulence: velocities, solids fraction, granular temperature, pressure
UNKNOWNS, GAS_UNKNOWNS = 9, 4
# measured at 6,000 and 9,600 cells: memory [MB] and CPU time of a cell and step [s]
BASE_MEMORY, CELL_MEMORY, CELL_TIME, SCALE_TIME = 220, 0.014, 8e-6, 0.6e-6
# measured at 400 to 1,000 cells: CPU time of a step whatever its cells, more for each scale [s];
# a step of second order takes this often the time; mesh, first step and files [s]
STEP_TIME, STEP_SCALE_TIME, SECOND_ORDER, START_TIME = 4e-3, 1.5e-3, 2.0, 1.0
# largest velocity in a section over the mean, and steps that random scenes take over those foreseen
PEAK, MORE_STEPS = 1.2, 1.4
# cells that a triangle of the section becomes in a layer
TETRAHEDRA = 3
# share of the mass flow of the solids by which inlet and outlet of a steady flow may differ
CHANGING = 0.1
FILES = (*SECTION_FILES, "probes.csv", "sections.csv", "plane.png")
UNESTIMATED = "an unsteady flow is solved on one mesh; what another numerics.level changes tells it"


class DenseCells(Physics):
    """What an unsteady scene of the two-fluid model tells of its mesh."""

    def __init__(self, scene: Any) -> None:
        super().__init__(scene)
        self.resolution = dense.with_wall_cell(self)

    @property
    def line(self) -> tuple[Any, Section, Resolution]:
        """Shape, section and resolution, from which the mesh is made."""
        return self.scene.geometry, self.section, self.resolution

    @cached_property
    def cells(self) -> int:
        """Cells of the mesh, counted on a section that is made for it."""
        return line_cells(*self.line, MPI.COMM_SELF)

    @property
    def unknowns(self) -> int:
        """Unknowns of a cell."""
        found = GAS_UNKNOWNS if self.scene.model.solids is None else UNKNOWNS
        return found + len(self.scene.model.scales)


@dataclass(frozen=True)
class Unsteady(Scene[DenseCells, "FlowRecorder"]):
    """A flow in time and three dimensions, one value a cell.

    numerics : the end, the order and the steps
    inlet : how the flow enters
    initial : the state from which it starts

    Raises InputError for values that do not fit each other, or a feed that does not tell what
    enters.
    """

    model: TwoFluid
    numerics: TimeNumerics = parameter(doc="mesh and solver")
    inlet: Inlet = parameter(doc="what enters a line", factory=Inlet)
    initial: Initial = parameter(doc="from where an unsteady flow starts", factory=Initial)
    solution: ClassVar[str] = "unsteady"

    @property
    def fixed(self) -> tuple[str, ...]:
        """The end, where parcels enter evenly up to it."""
        during = self.particles is not None and self.particles.release == "during"
        return ("numerics.end_time",) if during else ()

    def __post_init__(self) -> None:
        super().__post_init__()
        entering, solids, start = self.solids_inlet, self.model.solids, self.initial
        check_places(self.geometry, self.output, start)
        if entering is not None and solids is not None:
            most = max((factor for _, factor in self.feed.solids_schedule), default=1.0)
            if entering[0] * most >= solids.packing_limit:
                words = f"factors below {solids.packing_limit / entering[0]:g}, where it packs"
                raise InputError("operation.solids_schedule", most, words)
        if start.state != "bed":
            return
        if solids is None:
            raise InputError("initial.state", start.state, "a table [solids] beside it")
        if start.bed_fraction >= solids.packing_limit:
            words = f"a number below solids.packing_limit = {solids.packing_limit}"
            raise InputError("initial.bed_fraction", start.bed_fraction, words)
        if start.bed_start >= self.geometry.length:
            words = f"a place before the outlet at {self.geometry.length:g} m"
            raise InputError("initial.bed_start", start.bed_start, words)

    # -- what the flow takes -------------------------------------------------------------------

    def problem(self) -> UnsteadyProblem:
        """Numbers and laws of the flow."""
        model, solids, inlet = self.model, self.model.solids, self.inlet
        return UnsteadyProblem(
            gas=model.gas,
            solids=solids,
            closures=model,
            gravity=np.array(self.gravity),
            gas_velocity=self.feed.gas_velocity,
            diameter=self.geometry.hydraulic_diameter,
            wall_offset=self.wall_offset,
            theta_floor=model.section_terms.theta_floor,
            grain_gap=model.grain_gap * (solids.diameter if solids else 0.0),
            inlet_profile=inlet.profile,
            solids_intensity=inlet.solids_intensity,
            gas_intensity=inlet.gas_intensity,
            length_scale=inlet.length_scale,
            second_order=self.numerics.order == 1,
            compressible=model.gas.compressible,
            reference_pressure=model.gas.pressure,
            outlet_pressure=self.feed.outlet_pressure,
        )

    def inflow(self, time: float) -> Inflow:
        """What enters and leaves at a time [s]."""
        gas, solids, blocked = self.feed.factors(time)
        speed, entering = self.feed.gas_velocity * gas, self.solids_inlet
        if entering is None:
            return Inflow(speed, blocked=blocked)
        return Inflow(speed, entering[0] * solids, entering[1], blocked)

    @property
    def interval(self) -> float:
        """Time between outputs [s]."""
        return self.output.interval or self.numerics.end_time / OUTPUTS

    @property
    def checkpoint_interval(self) -> float:
        """Time between checkpoints [s]."""
        return self.output.checkpoint_interval or self.interval

    def milestones(self) -> list[float]:
        """Times that steps end at: outputs, checkpoints, corners of what is fed, the end [s]."""
        end = self.numerics.end_time
        spans = (self.interval, self.checkpoint_interval)
        times = [k * span for span in spans for k in range(1, math.ceil(end / span))]
        found: list[float] = []
        for time in sorted([*times, *self.feed.corners()]):
            before = found[-1] if found else 0.0
            if time - before > SAME_TIME * end and end - time > SAME_TIME * end:
                found.append(time)
        return [*found, end]

    def control(self) -> TimeControl:
        """Steps as the scene wants them."""
        given = self.numerics
        largest = given.largest_time_step or max(self.interval, given.smallest_time_step)
        first = given.time_step or FIRST_SHARE * largest
        return TimeControl(
            first=max(min(first, largest), given.smallest_time_step),
            largest=largest,
            smallest=given.smallest_time_step,
            courant=given.courant,
        )

    def start(self, flow: UnsteadyFlow) -> None:
        """Put a flow into the initial state."""
        given, cells = self.initial, flow.cells
        if given.state == "rest":
            flow.initialise()
        elif given.state == "bed":
            _, y, s = flow.mesh.straightened(cells.centre).T
            bottom = -self.geometry.size[1] / 2
            top = math.inf if given.bed_height is None else bottom + given.bed_height
            end = math.inf if given.bed_end is None else given.bed_end
            bed = (y < top) & (s >= given.bed_start) & (s < end)
            flow.initialise(np.where(bed, given.bed_fraction, 0.0))
        else:
            feed = self.inflow(0.0)
            flow.initialise(feed.solids_fraction)
            axis = flow.mesh.axis(cells.centre)
            gas = feed.gas_velocity / (1 - feed.solids_fraction)
            flow.set_velocities(feed.solids_velocity * axis, gas * axis)

    # -- the scene -----------------------------------------------------------------------------

    @property
    def files(self) -> Sequence[str]:
        """Names of what a run may leave in its directory."""
        return FILES

    def recorder(self, setting: Setting | None = None) -> FlowRecorder:
        """What a run tells and keeps while it works."""
        return FlowRecorder(self, setting or Setting())

    def mesh_model(self) -> GmshModel:
        """The mesh as Gmsh makes it."""
        return line_model(*self.physics.line)

    def mesh(self, comm: MPI.Comm = MPI.COMM_WORLD) -> Mesh:
        """The mesh of the whole line."""
        return line_mesh(*self.physics.line, comm)

    def solve(self, recorder: FlowRecorder, previous: Answer | None = None) -> Answer:
        """Take the flow to its end.

        Raises
        ------
        SolverError
            no step above the smallest succeeds.
        KeyboardInterrupt
            the user has asked to stop; all ranks stand behind the same step, and particles that
            follow later start anew.
        """
        if previous is not None:
            previous.close()
        section = Stepped(self, UnsteadyFlow(self.problem(), self.mesh(recorder.comm)))
        stepping = TimeStepping(self.control(), self.milestones(), recorder.log)
        flow = section.flow
        if recorder.resume:
            recorder.restore(section, stepping)
        else:
            self.start(flow)
        recorder.begin(section, stepping)
        cloud = recorder.cloud = self._cloud(flow, recorder)
        with signals.deferred() as request:
            while not stepping.done:
                begun = stepping.time
                stepping.advance(section)
                if cloud is not None:
                    cloud.step(begun, stepping.time)
                recorder.step()
                if request.on_any(recorder.comm):
                    raise KeyboardInterrupt
            if cloud is not None:
                cloud.tell()
            elif self.particles is not None:
                carrier = LineCarrier(flow, self.particles.dispersion)
                follow_line(self, carrier, recorder, request)
            if request.on_any(recorder.comm):
                raise KeyboardInterrupt
        balances = flow.balances()
        if recorder.tracked is not None:
            balances |= recorder.tracked.balances()
        found = flow.quantities()
        return Answer("finished", found, balances, "pressure_drop", unestimated=UNESTIMATED)

    def _cloud(self, flow: UnsteadyFlow, recorder: FlowRecorder) -> Along | None:
        """Particles that go on with the gas, None where they follow it later or not at all."""
        if self.particles is None or self.particles.release == "after":
            return None
        cloud = Along(self, LineCarrier(flow, self.particles.dispersion), recorder.comm)
        recorder.tracked = cloud.tracked
        if recorder.resume:
            assert recorder.out is not None
            cloud.restore(checkpoint.others(recorder.out))
        return cloud

    def skipped(self) -> list[str]:
        """What the scene did not need, and why."""
        left_out = []
        if self.section.symmetry == "half":
            left_out.append("left half: mirror image of the right one")
        return left_out + dense.skipped_laws(self.model)

    def advice(self) -> list[str]:
        """What the user probably did not mean, one sentence each."""
        return dense.advice(self)

    def judge(self, answer: Answer) -> list[str]:
        """What an answer must say of itself: whether more solids enter than leave, or fewer."""
        said, solids, end = super().judge(answer), self.model.solids, self.numerics.end_time
        if solids is None:
            return said
        fed, leaving = self.inflow(end), answer.quantities["solids_mass_flow"]
        flux = fed.solids_fraction * fed.solids_velocity
        entering = solids.density * self.geometry.area * flux
        if abs(leaving - entering) > CHANGING * max(leaving, entering):
            said.append(
                f"the flow is not steady at its end: {entering:.3g} kg/s of solids enter and"
                f" {leaving:.3g} kg/s leave, so drop and hold-up are those of {end:g} s; a longer"
                " numerics.end_time lets it go on"
            )
        return said

    def derived(self) -> list[Derived]:
        """Numbers of gas and solids, and what they give away."""
        found = derived(self)
        return [*found, *of_the_times(self, any(number.doubt for number in found))]

    def examine(self) -> None:
        """Refuse what cannot be solved, without solving it; raises InputError."""
        check_flux(self)
        shape, section, resolution = self.physics.line
        cells = section_cells(section, resolution) * axial_layers(shape, section, resolution)
        cells *= TETRAHEDRA if resolution.cell_shape == "triangle" else 1
        diameters = shape.length / shape.hydraulic_diameter
        check_memory(BASE_MEMORY + CELL_MEMORY * cells, self.resolution, diameters)

    def expected_time(self) -> float:
        """About the CPU time of a run [s]."""
        cells, scales = self.physics.cells, len(self.model.scales)
        step_time = STEP_TIME + STEP_SCALE_TIME * scales + cells * (CELL_TIME + SCALE_TIME * scales)
        step_time *= SECOND_ORDER if self.numerics.order == 1 else 1.0
        stepping = step_time * self._steps(axial_layers(*self.physics.line))
        return START_TIME + stepping + following_time(self)

    def describe(self) -> dict[str, Any]:
        """What would be solved, what is left out, and what it would take."""
        physics = self.physics
        layers, end = axial_layers(*physics.line), self.numerics.end_time
        cells, steps = physics.cells, self._steps(layers)
        memory = BASE_MEMORY + CELL_MEMORY * cells + parcel_memory(self)
        words = f"unsteady flow by the two-fluid model: all of 3D, {end:g} s"
        given = f"{dense.entering(self)}; starts from state {self.initial.state!r}"
        return describe(self, words, given) | {
            "meshes": f"{layers} layers of {cells // layers} cells",
            "finest_mesh": f"{cells} cells, about {cells * physics.unknowns} unknowns",
            "memory": f"about {memory:.0f} MB",
            "time": f"about {self.expected_time():.0f} s for about {steps:.0f} steps",
        }

    def _steps(self, layers: int) -> float:
        """Number of steps through so many layers, as far as it is known before the flow.

        What the Courant number of the gas that enters or the largest step takes, and the growth
        from the first step on.
        """
        control, end, feed = self.control(), self.numerics.end_time, self.feed
        fraction = self.solids_inlet[0] if self.solids_inlet else 0.0
        if self.initial.state == "bed":
            fraction = max(fraction, self.initial.bed_fraction)
        speed = PEAK * feed.gas_velocity / (1 - fraction)
        speed *= max((factor for _, factor in feed.gas_schedule), default=1.0)
        usual = min(control.largest, control.courant * self.geometry.length / layers / speed)
        growing = math.log(max(usual / control.first, 1.0)) / math.log(control.growth)
        # growing steps cover what 1/(1 - 1/growth) usual ones do
        foreseen = max(end / usual - 1 / (1 - 1 / control.growth), 0.0) + growing + 1
        return MORE_STEPS * foreseen


def is_due(time: float, span: float, end: float) -> bool:
    """Whether a time is a multiple of `span`, or the end [s]."""
    return time >= end or abs(time - span * round(time / span)) <= SAME_TIME * end


class Stepped:
    """A flow as the steps in time see it, fed by its scene.

    Attributes
    ----------
    report : what the last step told
    """

    def __init__(self, scene: Unsteady, flow: UnsteadyFlow) -> None:
        self.scene, self.flow, self.mesh = scene, flow, flow.mesh
        self.report: Report | None = None

    @property
    def dofs(self) -> int:
        """Unknowns on all ranks."""
        return self.mesh.num_cells * self.scene.physics.unknowns

    def advance(self, dt: float, time: float) -> float:
        """Go one step and return its effort."""
        most = SURPRISE * self.scene.numerics.courant
        self.report = self.flow.advance(dt, self.scene.inflow(time), most)
        self.flow.time = time
        taken = self.report.iterations
        return max(n / MOST_ITERATIONS[name] for name, n in taken.items())

    def rate(self) -> float:
        """Largest Courant number over the step [1/s]."""
        return max(self.flow.courant())


# -- what is told and kept ---------------------------------------------------------------------

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
    """What a run of an unsteady flow tells and keeps: tables, fields.xdmf, checkpoint."""

    def __init__(self, scene: Unsteady, setting: Setting) -> None:
        out, resume = setting.out, setting.resume
        self.since = 0.0
        if resume:
            assert out is not None
            self.since = checkpoint.numbers(out)["time"]
            # a run that was killed has written rows behind its checkpoint
            on_root(setting.comm, partial(_drop_rows, out, self.since))
        super().__init__(scene, setting, COLUMNS)
        self.stepping: TimeStepping
        self.cloud: Along | None = None
        self._writer: FieldWriter | None = None
        self._probes: Probes | None = None
        self._sections: Sections | None = None
        self._plane: Plane | None = None
        self._tables = [Table(out / name, resume) for name in TABLES[1:]] if out else []

    def begin(self, section: Stepped, stepping: TimeStepping) -> None:
        """The flow stands at its start, or where a checkpoint was written."""
        self.lap("setup")
        self.section, self.stepping = section, stepping
        flow, given = section.flow, self.scene.output
        text = f"{section.mesh.num_cells} cells, {section.dofs} unknowns"
        self.progress.stage(text)
        self.log(f"{text}; from {stepping.time:.6g} s")
        if given.probes:
            self._probes = Probes(section.mesh.mesh, given.probes)
        if given.sections:
            owned = flow.cells.owned
            volume, centre = flow.cells.volume[:owned], flow.cells.centre[:owned]
            self._sections = Sections(
                section.mesh, given.sections, volume, centre, axial_layers(*self.scene.physics.line)
            )
        if self.out is not None and given.pictures:
            name = "u_g" if self.scene.model.solids is None else "alpha_s"
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
        # behind the first step the drop is that of an impulse, and no number
        known = (name for name in COLUMNS if name in found)
        values |= {name: found[name] for name in known if math.isfinite(found[name])}
        if self.monitor is not None:
            self.monitor.write(values)
        end = self.scene.numerics.end_time
        warning = (
            f"{stepping.time:.4g} of {end:g} s, dt {stepping.step:.3g} s, max alpha_s"
            f" {report.max_alpha_s:.4f}, max theta {report.max_theta:.3g}, max k"
            f" {report.max_k:.3g}, CFL {report.courant:.2f}, mass error {report.mass_error:.1e}"
        )
        self.progress.update(stepping.time / end, warning)
        if self._probes is not None:
            row = self._probes.row(flow.fields())
            self._tell(0, {"time": stepping.time, **row}, {"time": "s", **columns(row)})
        if is_due(stepping.time, self.scene.interval, end):
            self.log(f"step {stepping.count}: {warning}")
            self._keep_fields()
        if is_due(stepping.time, self.scene.output.checkpoint_interval or self.scene.interval, end):
            self.save()
        if not stepping.done:
            self.check_time()

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
        others = self.cloud.state() if self.cloud else {}
        checkpoint.save_cells(self.out, mesh, values, numbers, tables, others)

    def draw(self) -> None:
        """The picture of the plane through the axis."""
        plane, out = self._plane, self.out
        if plane is not None and plane.moments and out is not None:
            on_root(self.comm, lambda: plane.draw(out / "plane.png", self.scene.title))

    def step_back(self) -> None:
        """Keep the last accepted state."""
        self.save()

    def restore(self, section: Stepped, stepping: TimeStepping) -> None:
        """Put the checkpoint back."""
        assert self.out is not None
        values, numbers = checkpoint.load_cells(self.out, section.mesh.mesh)
        own = {name: v for name, v in numbers.items() if name.startswith("stepping.")}
        stepping.restore({name.removeprefix("stepping."): v for name, v in own.items()})
        of_flow = {name: np.array(v) for name, v in numbers.items() if name not in own}
        section.flow.restore({**values, **of_flow})
        section.flow.time = stepping.time

    def write_files(self, result: Result) -> None:
        """The picture and the fields of the answer; all else is written along the way."""
        result.take(snapshot(self.section.mesh.mesh, self.section.flow.fields()))
        self.draw()

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
        chosen: tuple[str, ...] = self.scene.output.fields
        return chosen

    def _tell(self, table: int, row: Mapping[str, float], units: Mapping[str, str]) -> None:
        if self._tables and self.comm.rank == 0:
            self._tables[table].write(row, units)


def _drop_rows(out: Path, time: float) -> None:
    for name in TABLES:
        drop_after(out / name, "time", time)


register(
    Kind(
        "dense",
        Unsteady,
        TwoFluid,
        (Pipe, Duct, Bend),
        DenseCells,
        {"numerics.cells": "quadrilateral"},
        (
            "output.stations",
            "numerics.alpha_diffusion",
            "numerics.capture",
            "numerics.damping",
        ),
    )
)

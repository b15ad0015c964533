# SPDX-License-Identifier: LGPL-3.0-or-later
"""The developing dense flow: from the inlet to the outlet of a line, station by station.

Each station is a section solved with implicit differences to the two before it, so that a line
costs some hundred sections and no three-dimensional mesh. What the stations conserve is told: mass
of each phase, and axial momentum with the pressure and the forces of the walls integrated by the
same differences.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from dolfinx import fem
from mpi4py import MPI

from fem_tfm.case import Case
from fem_tfm.errors import SolverError
from fem_tfm.flows import dense
from fem_tfm.flows.driver import Answer, Scene
from fem_tfm.flows.inlet import Inlet, enter
from fem_tfm.flows.recorder import Recorder
from fem_tfm.flows.station import Station
from fem_tfm.interpolation import point_values
from fem_tfm.output import checkpoint
from fem_tfm.output.fields import FieldWriter
from fem_tfm.output.files import on_root
from fem_tfm.output.pictures import axis_picture
from fem_tfm.output.profiles import write_profiles
from fem_tfm.output.result import Result
from fem_tfm.solvers.marching import March, MarchControl, Place, Stop

if TYPE_CHECKING:
    from fem_tfm.progress import Progress

# in hydraulic diameters
FIRST_STEP, SMALLEST_STEP = 0.01, 1e-5
# largest step over the length of the line, and the tolerance of a station
LARGEST_SHARE, TOLERANCE = 1 / 60, 1e-10
# axial velocity over U_g below which a phase counts as flowing back
BACK_FLOW = -1e-3
# the flow counts as developed where nothing is further from the outlet than this
DEVELOPED = 0.01
BED_POINTS = 101

# columns of axis.csv and their units
COLUMNS = {
    "z": "m",
    "pressure": "Pa",
    "pressure_gradient": "Pa/m",
    "holdup": "-",
    "max_solids_fraction": "-",
    "bed_fraction": "-",
    "bed_height": "m",
    "solids_velocity": "m/s",
    "gas_velocity": "m/s",
    "slip_velocity": "m/s",
    "max_gas_velocity": "m/s",
    "max_theta": "m2/s2",
    "solids_mass_flow": "kg/s",
    "gas_mass_flow": "kg/s",
}
# quantities of the outlet that a result tells
AT_OUTLET = (
    "pressure_gradient", "solids_mass_flow", "gas_mass_flow", "holdup", "max_solids_fraction",
    "bed_fraction", "bed_height", "slip_velocity",
)  # fmt: skip


class Sums:
    """Integrals along the axis by the backward differences of the march itself.

    w_0 Q + w_1 Q_old + w_2 Q_older = rate. A balance of the stations is then one of the integrals,
    to round-off.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.now = dict.fromkeys(names, 0.0)
        self.old = dict(self.now)

    def advance(self, weights: Sequence[float], rates: Mapping[str, float]) -> None:
        """Go to the next station."""
        found = {
            name: (rate - weights[1] * self.now[name] - weights[2] * self.old[name]) / weights[0]
            for name, rate in rates.items()
        }
        self.now, self.old = found, self.now


class Line:
    """A developing flow on its way downstream: the station at hand and the table of all behind it.

    Parameters
    ----------
    case : what is solved
    mesh : the section
    progress : called with a word before each form is compiled
    """

    # what shows whether the flow still changes
    watched: ClassVar[Sequence[str]] = ("pressure_gradient", "holdup", "max_gas_velocity")

    def __init__(self, case: Case, mesh: Any, progress: Any = lambda text: None) -> None:
        station = Station(mesh, dense.setup_of(case), progress)
        self._prepare(case, station, ("head", "driven", "resisted"))

    def _prepare(self, case: Case, station: Any, summed: Sequence[str]) -> None:
        """Tables, and what a checkpoint needs; `summed` names integrals along the axis."""
        self.case = case
        self.station = station
        self.length = case.geometry.length
        self.rows: list[dict[str, float]] = []
        self.sums = Sums(summed)
        self.place: Place | None = None
        spaces = {
            name: self.station.space.sub(i).collapse() for i, name in enumerate(self.station.names)
        }
        self._dofs = {name: np.asarray(dofs).ravel() for name, (_, dofs) in spaces.items()}
        # what a checkpoint holds; made once, for a space takes longer to make than to fill
        self._copies = {
            (key, name): fem.Function(space)
            for key in ("now", "old")
            for name, (space, _) in spaces.items()
        }

    # -- the march -----------------------------------------------------------------------------

    @property
    def control(self) -> MarchControl:
        """Steps in hydraulic diameters and shares of the length."""
        given, width = self.case.numerics, self.case.geometry.hydraulic_diameter
        largest = given.axial_step or LARGEST_SHARE * self.length
        return MarchControl(
            first=min(FIRST_STEP * width, largest),
            largest=largest,
            smallest=SMALLEST_STEP * width,
            bend=given.axial_accuracy,
            tolerance=min(given.tolerance, TOLERANCE),
        )

    def begin(self) -> None:
        """Stand at the inlet."""
        case, given = self.case, self.case.inlet
        solids = case.solids_inlet if case.solids else (None, None)
        scales = given.solids_intensity, given.gas_intensity, given.length_scale
        enter(self.station, Inlet(given.profile, *solids, *scales))
        self.place = Place(0.0, None, self.control.first)
        self._entered = self.momentum()
        self._tell()

    def march(self, observer: Observer) -> None:
        """Go on to the end of the line.

        Raises
        ------
        SolverError
            the flow turns back somewhere, or no step is small enough for Newton.
        """

        def accept(stop: Stop) -> None:
            self._accept(stop)
            observer.station(self, stop)

        station = self.station
        stations, parts = (station.old, station.older), (self.control, self.back_flow)
        march = March(
            station.newton, stations, station.weights, *parts, accept, retry=observer.retry
        )
        march.run(self.length, self.place)

    def _accept(self, stop: Stop) -> None:
        """Enter a station into the table."""
        self.place = stop.place
        weights = [float(w.value) for w in self.station.weights]
        drive = float(self.station.drive.value)
        resisted = self.station.wall_force() - self._weight()
        gradient = dense.pressure_gradient(self.station)
        self.sums.advance(weights, {"head": -gradient, "driven": drive, "resisted": resisted})
        self._tell()

    def _tell(self) -> None:
        self.rows.append(self._row())
        self._remember()

    def _remember(self) -> None:
        """Keep the station at hand, for a step may be cut short."""
        station = self.station
        self._state = station.now.x.array.copy(), station.old.x.array.copy()
        self._passing = self.momentum()

    def back_flow(self) -> str:
        """Which phase flows back, which marching cannot follow; an empty text if none does."""
        for name, phase in (("u_g", "gas"), ("u_s", "solids")):
            if name in self.station.names:
                slowest = self._axial(name, min)
                if slowest < BACK_FLOW * self.station.setup.gas_velocity:
                    return f"the {phase} would flow back at {-slowest:.2g} m/s, against the march"
        return ""

    def step_back(self) -> None:
        """Put the last accepted station back, after a step was cut short."""
        self.station.now.x.array[:], self.station.old.x.array[:] = self._state

    # -- checkpoints ---------------------------------------------------------------------------

    def save(self, directory: Path) -> None:
        """Keep the station at hand, the one before it and the table."""
        place, station = self.place, self.station
        numbers = {
            "z": place.z,
            "last": math.nan if place.last is None else place.last,
            "next": place.next,
            "drive": float(station.drive.value),
            "entered": self._entered,
        }
        tables = {name: [row[name] for row in self.rows] for name in self.rows[0]}
        tables |= {f"sum.{name}": [v, self.sums.old[name]] for name, v in self.sums.now.items()}
        for (key, name), function in self._copies.items():
            source = station.now if key == "now" else station.old
            function.x.array[:] = source.x.array[self._dofs[name]]
        fields = {f"{key}.{name}": function for (key, name), function in self._copies.items()}
        more_fields, more_numbers = self.companions()
        checkpoint.save(
            directory, MPI.COMM_WORLD, fields | more_fields, numbers | more_numbers, tables
        )

    def companions(self) -> tuple[dict[str, fem.Function], dict[str, float]]:
        """Fields and numbers that a checkpoint holds beside the unknowns of two stations."""
        return {}, {}

    def take_companions(
        self, fields: Mapping[str, fem.Function], numbers: Mapping[str, float]
    ) -> None:
        """Put back what `companions` gave."""

    def load(self, directory: Path) -> None:
        """Stand where a checkpoint was written."""
        station = self.station
        fields = {f"{key}.{name}": function for (key, name), function in self._copies.items()}
        more, _ = self.companions()
        numbers = checkpoint.load(directory, MPI.COMM_WORLD, fields | more)
        self.take_companions(more, numbers)
        for (key, name), function in self._copies.items():
            target = station.now if key == "now" else station.old
            target.x.array[self._dofs[name]] = function.x.array
        station.drive.value, self._entered = numbers["drive"], numbers["entered"]
        last = None if math.isnan(numbers["last"]) else numbers["last"]
        self.place = Place(numbers["z"], last, numbers["next"])
        tables = checkpoint.tables(directory)
        for name in self.sums.now:
            self.sums.now[name], self.sums.old[name] = tables.pop(f"sum.{name}")
        rows = zip(*tables.values(), strict=True)
        self.rows = [dict(zip(tables, row, strict=True)) for row in rows]
        self._remember()

    # -- what a station tells ------------------------------------------------------------------

    def _axial(self, name: str, extreme: Any) -> float:
        """Smallest or largest axial velocity of a phase at its nodes [m/s]."""
        station = self.station
        # components of a velocity alternate
        values = station.now.x.array[self._dofs[name][2::3]]
        best = extreme(values, default=math.inf if extreme is min else -math.inf)
        return float(station.mesh.mesh.comm.allreduce(best, MPI.MIN if extreme is min else MPI.MAX))

    def _row(self) -> dict[str, float]:
        """One row of axis.csv."""
        station = self.station
        found = dense.quantities(station, 1.0)
        inlet = not self.rows
        row = {
            "z": self.place.z,
            "pressure": self.sums.now["head"],
            "pressure_gradient": math.nan if inlet else found["pressure_gradient"],
            "gas_mass_flow": found["gas_mass_flow"],
            "max_gas_velocity": self._axial("u_g", max),
        }
        whole = station.mesh.section.area_factor * station.area
        row["gas_velocity"] = found["gas_mass_flow"] / (station.setup.gas.density * whole)
        if station.setup.solids is None:
            return row
        held = found["holdup"]
        flux = found["solids_mass_flow"] / (station.setup.solids.density * whole)
        row["gas_velocity"] /= 1 - held
        kept = ("holdup", "max_solids_fraction", "bed_fraction", "slip_velocity")
        return row | {
            **{name: found[name] for name in (*kept, "solids_mass_flow")},
            "bed_height": self.bed_height(),
            "solids_velocity": flux / held,
            "max_theta": station.extremes()["max_theta"],
        }

    def bed_height(self) -> float:
        """Height up to which the vertical diameter is denser than the onset of friction [m]."""
        station, solids = self.station, self.station.setup.solids
        height = self.case.geometry.size[1]
        y = np.linspace(-0.5, 0.5, BED_POINTS) * height * (1 - 1e-6)
        logit = self._copies["now", "q"]
        logit.x.array[:] = station.now.x.array[self._dofs["q"]]
        q = point_values(logit, np.column_stack([0 * y, y]))
        alpha, limit = solids.packing_limit / (1 + np.exp(-q)), solids.friction_limit
        dense_points = np.flatnonzero(alpha >= limit)
        if not len(dense_points):
            return 0.0
        top = dense_points[-1]
        if top == len(y) - 1:
            return float(height)
        share = (alpha[top] - limit) / (alpha[top] - alpha[top + 1])
        return float(y[top] + share * (y[top + 1] - y[top]) + height / 2)

    def momentum(self) -> float:
        """Axial momentum flux of both phases through the part that is solved [N]."""
        station, setup = self.station, self.station.setup
        state = station.state(station.now)
        alpha = station.model.alpha(state)
        gas = station.integral("gas momentum", (1 - alpha) * state.u_g[2] ** 2)
        if setup.solids is None:
            return setup.gas.density * gas
        solids = station.integral("solids momentum", alpha * state.u_s[2] ** 2)
        return setup.gas.density * gas + setup.solids.density * solids

    def _weight(self) -> float:
        """Axial weight of the solids in the gas per length [N/m]."""
        station, setup = self.station, self.station.setup
        if setup.solids is None:
            return 0.0
        held = station.integral("held", station.model.alpha(station.state(station.now)))
        return (setup.solids.density - setup.gas.density) * setup.gravity[2] * held

    # -- what the line tells -------------------------------------------------------------------

    def columns(self) -> dict[str, list[float]]:
        """The table along the axis; pressure is that above the outlet's, or absolute if given."""
        names = [name for name in COLUMNS if name in self.rows[0]]
        columns = {name: [row[name] for row in self.rows] for name in names}
        level = (self.case.operation.outlet_pressure or 0.0) - columns["pressure"][-1]
        columns["pressure"] = [p + level for p in columns["pressure"]]
        return columns

    def balances(self) -> dict[str, float]:
        """Relative errors of mass and axial momentum from the inlet to the last station.

        Momentum: pressure drop times area + weight = force of the walls + gain of momentum flux.
        """
        first, found = self.rows[0], {}
        for phase in ("gas", "solids"):
            if (name := f"{phase}_mass_flow") in first:
                away = (abs(row[name] / first[name] - 1) for row in self.rows)
                found[f"{phase}_mass"] = max(away)
        driven = self.sums.now["driven"] * self.station.area
        resisted, gain = self.sums.now["resisted"], self._passing - self._entered
        scale = max(abs(driven), abs(resisted), abs(gain))
        return found | {"axial_momentum": abs(driven - resisted - gain) / scale}

    def development_length(self) -> float:
        """Distance from the inlet beyond which nothing watched is 1 % from the outlet's value [m].

        It is the length of the line where the flow has not developed at its end.
        """
        last = self.rows[-1]
        names = [name for name in self.watched if name in last]
        changing = [
            row["z"]
            for row in self.rows
            if not all(abs(row[n] - last[n]) <= DEVELOPED * abs(last[n]) for n in names)
        ]
        return changing[-1] if changing else 0.0

    def quantities(self) -> dict[str, float]:
        """Numbers of the line, in the units of `case.QUANTITIES`."""
        last = self.rows[-1]
        found = {name: last[name] for name in AT_OUTLET if name in last}
        drop = self.rows[0]["pressure"] - last["pressure"]
        entrance = drop - last["pressure_gradient"] * last["z"]
        return {
            "pressure_drop": drop,
            **found,
            "entrance_pressure_drop": entrance,
            "development_length": self.development_length(),
        }


class Observer:
    """What a march tells while it works; this one keeps it to itself."""

    def compiling(self, what: str) -> None:
        """A form is about to be compiled."""

    def begin(self, line: Line) -> None:
        """The line stands at its inlet, or where a checkpoint was written."""

    def station(self, line: Line, stop: Stop) -> None:
        """A station was accepted."""

    def retry(self, step: float, reason: str) -> None:
        """A step was taken back and is tried again with `step` [m]."""


QUIET = Observer()

# -- the run -----------------------------------------------------------------------------------

FILES = (*dense.FILES, "axis.csv", "axis.png")
MONITOR = {
    "station": "",
    "z": "m",
    "step": "m",
    "iterations": "",
    "update": "",
    "bend": "",
    **{name: COLUMNS[name] for name in ("pressure_gradient", "holdup", "max_solids_fraction")},
    "max_theta": COLUMNS["max_theta"],
}
WARNED = ("pressure_gradient", "holdup", "max_solids_fraction", "max_theta")


class LineRecorder(Recorder, Observer):
    """What a march tells and keeps while it works: progress, monitor.csv, checkpoint, fields.xdmf.

    case, out, progress, resume : as for `Recorder`
    """

    columns: ClassVar[Mapping[str, str]] = MONITOR
    warned: ClassVar[Sequence[str]] = WARNED

    def __init__(self, case: Case, out: Path | None, progress: Progress, resume: bool) -> None:
        super().__init__(case, out, progress, resume, self.columns)
        self.line: Line | None = None
        self._writer: FieldWriter | None = None

    @property
    def section(self) -> Station | None:
        """The station at hand."""
        return self.line.station if self.line else None

    def compiling(self, what: str) -> None:
        """Tell which form is prepared."""
        if what == "residual":
            self.lap("setup")
        self.progress.stage(f"forms: {what} (compiled once for each choice of closures)")

    def begin(self, line: Line) -> None:
        """The line stands at its inlet, or where a checkpoint was written."""
        self.lap("compile")
        self.line, mesh = line, line.station.mesh
        text = f"stations on {mesh.num_cells} cells, {line.station.dofs} unknowns"
        self.progress.stage(text)
        self.log(f"{text}; from z = {line.place.z:.4g} m")
        if self.out is not None and self.case.output.xdmf:
            self._writer = FieldWriter(self.out / "fields", mesh.mesh, append=self.resume)
        self._due = self._next_due(line.place.z) if self.resume else 0.0
        if not self.resume:
            self._keep(line)

    def station(self, line: Line, stop: Stop) -> None:
        """A row of the monitor, the early-warning line and a checkpoint."""
        row, place = line.rows[-1], stop.place
        values = {name: row[name] for name in self.columns if name in row}
        values |= {"station": len(line.rows) - 1, "step": place.last}
        values |= {name: getattr(stop, name) for name in ("iterations", "update", "bend")}
        if self.monitor is not None:
            self.monitor.write(values)
        told = ", ".join(f"{name} {row[name]:.4g}" for name in self.warned if name in row)
        message = f"z {place.z:.4g} of {line.length:.4g} m, {told}"
        self.progress.update(self._fraction(place.z), message)
        self.log(f"station {len(line.rows) - 1}: step {place.last:.3g} m, {message}")
        self._keep(line)

    def retry(self, step: float, reason: str) -> None:
        """A line of the log for a step taken back."""
        self.log(f"taken back: {reason}; step {step:.3g} m")

    def step_back(self) -> None:
        """Go back to the last accepted station, which is kept already."""
        self.line.step_back()

    def _fraction(self, z: float) -> float:
        """Share of the stations behind, which crowd within some diameters of the inlet."""
        unit = 3 * self.case.geometry.hydraulic_diameter
        return math.log1p(z / unit) / math.log1p(self.case.geometry.length / unit)

    def _keep(self, line: Line) -> None:
        """Write the checkpoint, and the station to fields.xdmf if it is due."""
        if self.out is not None:
            line.save(self.out)
        z = line.place.z
        if self._writer is not None and (z >= self._due or z >= line.length):
            self._writer.write(z, self._fields(line))
            self._due = self._next_due(z)

    def _fields(self, line: Line) -> dict[str, Any]:
        """What goes to fields.xdmf."""
        return dense.chosen_fields(self.case, line.station)

    def _next_due(self, z: float) -> float:
        """The next of the evenly spaced places at which a section goes to fields.xdmf [m]."""
        every = self.case.geometry.length / self.case.output.stations
        return (math.floor(z / every + 1e-9) + 1) * every


def solve(case: Case, observer: Observer = QUIET, resume: Path | None = None) -> Line:
    """March a line from its inlet, or from the checkpoint in a directory, to its outlet.

    Raises
    ------
    SolverError
        the flow turns back somewhere, no step is small enough, or a balance is broken.
    """
    return travel(Line(case, dense.meshes(case)[-1](), observer.compiling), observer, resume)


def travel(line: Line, observer: Observer, resume: Path | None = None) -> Line:
    """Take a line to its outlet, as `solve` does."""
    if resume is None:
        line.begin()
    else:
        line.load(resume)
    observer.begin(line)
    line.march(observer)
    kept = line.balances()
    worst = max(kept, key=lambda name: kept[name])
    if not kept[worst] <= dense.BALANCE_ERROR:
        raise SolverError(f"the balance of {worst} is broken by {kept[worst]:.1e}")
    return line


def answer(case: Case, recorder: LineRecorder) -> Answer:
    """The line of a case.

    Raises
    ------
    SolverError
        the outlet was not reached.
    """
    line = solve(case, recorder, recorder.out if recorder.resume else None)
    found, kept = line.quantities(), line.balances()
    return Answer("finished", found, kept, "pressure_drop")


def _write(case: Case, recorder: LineRecorder, result: Result) -> None:
    """The table along the axis with its picture, and the last section with its own."""
    line, out = recorder.line, recorder.out
    result.sections["axis"] = columns = {k: np.array(v) for k, v in line.columns().items()}
    dense.write_section(case, line.station, result, out)

    def write() -> None:
        write_profiles(out / "axis.csv", columns, COLUMNS)
        if case.output.pictures and len(line.rows) > 1:
            width = case.geometry.hydraulic_diameter
            axis_picture(out / "axis.png", columns, COLUMNS, width, case.title)

    if out is not None:
        on_root(recorder.comm, write)


SCENE = Scene(LineRecorder, FILES, dense.advice, dense.skipped, answer, _write)


def describe(case: Case) -> dict[str, Any]:
    """What would be solved, what is left out, and what it would take."""
    told = dense.describe(case)
    size = dense.mesh_sizes(case)[-1]
    _, unknowns = dense.size_of(case)
    stations = math.ceil(FIRST_STATIONS + 1 / LARGEST_SHARE)
    seconds = stations * STATION_TIME * unknowns
    return told | {
        "solved": "developing flow by the two-fluid model: steady, marched from the inlet",
        "given": _given(case),
        "meshes": f"{1e3 * size:.3g} mm core cells at about {stations} stations, more where much "
        "changes",
        "time": f"about {seconds:.0f} s, and {dense.compile_time(case)} s more to "
        "compile the forms if these closures are new on this machine",
    }


# measured on the demo: stations that follow the development, CPU seconds per station and unknown
FIRST_STATIONS, STATION_TIME = 60, 3.5e-5


def _given(case: Case) -> str:
    gas = f"gas {case.operation.gas_superficial_velocity:g} m/s superficial"
    found = "found: pressure along the line"
    if case.solids is None:
        return f"{gas}; {found}"
    alpha, speed = case.solids_inlet
    return f"{gas}, solids enter with fraction {alpha:.4g} at {speed:.4g} m/s; {found} and hold-up"

# SPDX-License-Identifier: LGPL-3.0-or-later
"""A duct's gas that develops: marched from a uniform inlet to the outlet, station by station.

Heat is carried along, one linear system a station. What the stations conserve is told: mass and
heat to round-off, axial momentum to the error of the mesh.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from dolfinx import fem
from mpi4py import MPI

from fem_tfm.case import Case
from fem_tfm.flows import developing, duct, duct_start
from fem_tfm.flows.driver import Answer, Scene
from fem_tfm.flows.duct_heat import DuctHeat
from fem_tfm.flows.duct_section import DuctStation
from fem_tfm.interpolation import point_values
from fem_tfm.output.duct_pictures import axis_picture
from fem_tfm.output.files import on_root
from fem_tfm.output.profiles import write_profiles
from fem_tfm.output.result import Result
from fem_tfm.solvers.marching import MarchControl, Place, Stop

# in hydraulic diameters
FIRST_STEP, SMALLEST_STEP, LARGEST_STEP = 0.01, 1e-6, 2.0
# a march keeps stations to this relative update; the next one starts from there anyway
TOLERANCE = 1e-8
# columns of axis.csv and their units
COLUMNS = {
    "z": "m",
    "pressure": "Pa",
    "pressure_gradient": "Pa/m",
    "friction_factor": "-",
    "centre_to_bulk": "-",
    "max_to_bulk": "-",
    "secondary_velocity_max": "-",
    "axis_energy": "-",
    "smallest_stress": "-",
    "gas_mass_flow": "kg/s",
    "bulk_temperature": "K",
    "wall_temperature": "K",
    "wall_flux": "W/m2",
    "nusselt": "-",
}
# quantities of the outlet that a result tells
AT_OUTLET = (
    "pressure_gradient", "friction_factor", "gas_mass_flow", "centre_to_bulk",
    "secondary_velocity_max", "axis_energy", "smallest_stress", "nusselt",
)  # fmt: skip
# what shows whether the flow still changes
WATCHED = ("friction_factor", "centre_to_bulk")


class DuctLine(developing.Line):
    """A developing gas on its way downstream: the station at hand and the table of those behind."""

    watched = WATCHED

    def __init__(self, case: Case, mesh: Any, progress: Any = lambda text: None) -> None:
        summed = ("head",) if case.heat is None else ("head", "heat")
        self._prepare(case, DuctStation(mesh, duct.setup_of(case), progress), summed)
        self.density = case.gas_material.density
        self.heat: DuctHeat | None = None
        if case.heat is not None:
            progress("heat")
            self.heat = duct.heat_of(case, self.station)

    @property
    def control(self) -> MarchControl:
        """Steps in hydraulic diameters."""
        given, width = self.case.numerics, self.case.geometry.hydraulic_diameter
        largest = given.axial_step or LARGEST_STEP * width
        return MarchControl(
            first=min(FIRST_STEP * width, largest),
            largest=largest,
            smallest=SMALLEST_STEP * width,
            bend=given.axial_accuracy,
            tolerance=max(given.tolerance, TOLERANCE),
        )

    def begin(self) -> None:
        """Stand at the inlet."""
        case, given = self.case, self.case.inlet
        length = given.length_scale * case.geometry.hydraulic_diameter
        duct_start.enter(self.station, given.gas_intensity, length)
        if self.heat is not None:
            excess = case.heat.wall_temperature - case.gas.temperature
            self.heat.enter(0.0, excess if case.heat.wall == "temperature" else 0.0)
        self.place = Place(0.0, None, self.control.first)
        self._entered = self.momentum()
        self._tell()

    def _accept(self, stop: Stop) -> None:
        """Enter a station into the table, and carry the heat to it."""
        self.place = stop.place
        weights = [float(w.value) for w in self.station.weights]
        rates = {"head": -self.density * self.station.pressure_gradient}
        if self.heat is not None:
            self.heat.keep()
            self.heat.step(self._wall_flux())
            rates["heat"] = -self.heat.lost()
        self.sums.advance(weights, rates)
        self._tell()

    def _wall_flux(self) -> float | None:
        """Heat flux of the wall over rho c_p [K m/s], None where its temperature is given."""
        given = self.case.heat
        if given.wall == "temperature":
            return None
        return given.wall_flux / (self.density * given.heat_capacity)

    def back_flow(self) -> str:
        """Why a station is no answer: back-flow or a stress that cannot be."""
        slowest = float(self.station.now.x.array[self._dofs["u"][2::3]].min(initial=math.inf))
        slowest = self.station.mesh.mesh.comm.allreduce(slowest, MPI.MIN)
        if slowest < 0:
            return f"the gas would flow back at {-slowest:.2g} m/s, against the march"
        smallest = duct.smallest_stress(self.station)
        if not smallest > 0:
            return f"a principal Reynolds stress is {smallest:.2g} k, which cannot be"
        return ""

    def momentum(self) -> float:
        """Axial momentum flux over the density through the part that is solved [m4/s2]."""
        state = self.station.state(self.station.now)
        return self.station.integral("momentum", state.u[2] ** 2)

    # -- what a station tells ------------------------------------------------------------------

    def _row(self) -> dict[str, float]:
        """One row of axis.csv."""
        station, inlet = self.station, not self.rows
        setup, geometry = station.setup, station.mesh.section
        width, speed, drive = geometry.hydraulic_diameter, setup.velocity, station.pressure_gradient
        transported = setup.law.transported
        sampled = [station.unknown(name) for name in ("u", "r" if transported else "q")]
        u, r = (values[0] for values in point_values(sampled, np.zeros((1, 2))))
        k = float(r[:3].sum()) / 2 if transported else math.exp(float(r))
        axial = station.now.x.array[self._dofs["u"][2::3]].max(initial=-math.inf)
        axial = station.mesh.mesh.comm.allreduce(float(axial), MPI.MAX)
        u_tau2 = math.nan if inlet else drive * width / 4
        row = {
            "z": self.place.z,
            "pressure": self.sums.now["head"],
            "pressure_gradient": math.nan if inlet else self.density * drive,
            "friction_factor": math.nan if inlet else 2 * drive * width / speed**2,
            "centre_to_bulk": float(u[2]) / speed,
            "max_to_bulk": axial / speed,
            "secondary_velocity_max": duct.secondary(station),
            "axis_energy": k / u_tau2,
            "smallest_stress": duct.smallest_stress(station),
            "gas_mass_flow": self.density * geometry.area_factor * station.flux(),
        }
        return row if self.heat is None else row | self._heat_row(inlet)

    def _heat_row(self, inlet: bool) -> dict[str, float]:
        """Temperatures, flux and Nusselt number; the inlet has no wall yet."""
        heat, given, base = self.heat, self.case.heat, self.case.gas.temperature
        capacity = self.density * given.heat_capacity
        wall = base + heat.wall_temperature
        return {
            "bulk_temperature": base if inlet else base + heat.bulk(),
            "wall_temperature": math.nan if inlet else wall,
            "wall_flux": math.nan if inlet else capacity * heat.flux(),
            "nusselt": math.nan if inlet else heat.nusselt(),
        }

    # -- checkpoints ---------------------------------------------------------------------------

    def companions(self) -> tuple[dict[str, fem.Function], dict[str, float]]:
        """The temperature of two stations and of their walls."""
        if self.heat is None:
            return {}, {}
        walls = {f"wall{i}": float(wall.value) for i, wall in enumerate(self.heat.walls)}
        return self.heat.copies(), walls | {"imposed": self.heat.imposed}

    def take_companions(
        self, fields: Mapping[str, fem.Function], numbers: Mapping[str, float]
    ) -> None:
        """Put back what `companions` gave."""
        if self.heat is not None:
            self.heat.restore(fields)
            self.heat.imposed = numbers["imposed"]
            for i, wall in enumerate(self.heat.walls):
                wall.value = numbers[f"wall{i}"]

    def _remember(self) -> None:
        super()._remember()
        if self.heat is not None:
            parts = (self.heat.now, self.heat.old, self.heat.older)
            walls = [float(wall.value) for wall in self.heat.walls]
            self._warmth = [part.x.array.copy() for part in parts], walls

    def step_back(self) -> None:
        """Put the last accepted station back, after a step was cut short."""
        super().step_back()
        if self.heat is not None:
            parts = (self.heat.now, self.heat.old, self.heat.older)
            for part, values in zip(parts, self._warmth[0], strict=True):
                part.x.array[:] = values
            for wall, value in zip(self.heat.walls, self._warmth[1], strict=True):
                wall.value = value

    # -- what the line tells -------------------------------------------------------------------

    def columns(self) -> dict[str, list[float]]:
        """The table along the axis; pressure is that above the outlet's, or absolute if given."""
        names = [name for name in COLUMNS if name in self.rows[0]]
        columns = {name: [row[name] for row in self.rows] for name in names}
        level = (self.case.operation.outlet_pressure or 0.0) - columns["pressure"][-1]
        columns["pressure"] = [p + level for p in columns["pressure"]]
        return columns

    def balances(self) -> dict[str, float]:
        """Relative errors of mass and heat from the inlet to the last station."""
        first = self.rows[0]["gas_mass_flow"]
        found = {"gas_mass": max(abs(row["gas_mass_flow"] / first - 1) for row in self.rows)}
        if self.heat is not None:
            gained, given = self.heat.bulk() * self.station.flux(), self.sums.now["heat"]
            found["heat"] = abs(gained - given) / abs(given) if given else 0.0
        return found

    def quantities(self) -> dict[str, float]:
        """Numbers of the line, in the units of `case.QUANTITIES`."""
        last, width = self.rows[-1], self.case.geometry.hydraulic_diameter
        peak = max(self.rows, key=lambda row: row["centre_to_bulk"])
        found = {
            "pressure_drop": self.rows[0]["pressure"] - last["pressure"],
            **{name: last[name] for name in AT_OUTLET if name in last},
            "overshoot": peak["centre_to_bulk"],
            "overshoot_position": peak["z"],
            "overshoot_diameters": peak["z"] / width,
            "development_length": self.development_length(),
        }
        if self.heat is not None:
            found["outlet_temperature"] = last["bulk_temperature"]
        return found


# -- the run -----------------------------------------------------------------------------------

FILES = (*duct.FILES, "axis.csv", "axis.png")
MONITOR = {
    "station": "",
    "z": "m",
    "step": "m",
    "iterations": "",
    "update": "",
    "bend": "",
    **{name: COLUMNS[name] for name in ("friction_factor", "centre_to_bulk")},
    **{name: COLUMNS[name] for name in ("secondary_velocity_max", "smallest_stress")},
}


class DuctLineRecorder(developing.LineRecorder):
    """What a march of a duct's gas tells and keeps."""

    columns = MONITOR
    warned = ("friction_factor", "centre_to_bulk", "secondary_velocity_max", "smallest_stress")

    def _fields(self, line: DuctLine) -> dict[str, Any]:
        fields = line.station.fields()
        if line.heat is not None:
            fields |= line.heat.fields()
        return duct.chosen_fields(self.case, fields)


def solve(
    case: Case, observer: developing.Observer = developing.QUIET, resume: Path | None = None
) -> DuctLine:
    """March a duct from its inlet, or from the checkpoint in a directory, to its outlet.

    Raises
    ------
    SolverError
        the flow turns back somewhere, or no step is small enough.
    """
    line = DuctLine(case, duct.meshes(case)[-1](), observer.compiling)
    return developing.travel(line, observer, resume)


def answer(case: Case, recorder: DuctLineRecorder) -> Answer:
    """The line of a case.

    Raises
    ------
    SolverError
        the outlet was not reached.
    """
    line = solve(case, recorder, recorder.out if recorder.resume else None)
    found, kept = line.quantities(), line.balances()
    return Answer("finished", found, kept, "pressure_drop", references=duct.references(case))


def _write(case: Case, recorder: DuctLineRecorder, result: Result) -> None:
    """The table along the axis with its picture, and the last section with its own."""
    line, out = recorder.line, recorder.out
    result.sections["axis"] = columns = {k: np.array(v) for k, v in line.columns().items()}
    heat = line.heat if len(line.rows) > 1 else None
    duct.write_section(case, line.station, result, out, heat)

    def write() -> None:
        write_profiles(out / "axis.csv", columns, COLUMNS)
        if case.output.pictures and len(line.rows) > 1:
            width = case.geometry.hydraulic_diameter
            axis_picture(out / "axis.png", columns, width, case.title)

    if out is not None:
        on_root(recorder.comm, write)


SCENE = Scene(DuctLineRecorder, FILES, duct.advice, duct.skipped, answer, _write)


def describe(case: Case) -> dict[str, Any]:
    """What would be solved, what is left out, and what it would take."""
    told = duct.describe(case)
    size, (_, unknowns) = duct.mesh_sizes(case)[-1], duct.size_of(case)
    width, length = case.geometry.hydraulic_diameter, case.geometry.length
    stations = math.ceil(FIRST_STATIONS + length / (LARGEST_STEP * width))
    return told | {
        "solved": "developing gas of a duct by Reynolds stresses: steady, marched from the inlet",
        "given": f"{told['given']} along the line",
        "meshes": f"{1e3 * size:.3g} mm core cells at every station",
        "stations": f"about {stations} over {length:g} m, more where much changes",
        "time": f"about {stations * STATION_TIME * unknowns:.0f} s, and {duct.COMPILE_TIME} s more "
        "to compile the forms if these closures are new on this machine",
    }


# measured on the demo: stations that follow the development, CPU seconds per station and unknown
FIRST_STATIONS, STATION_TIME = 45, 4.5e-5

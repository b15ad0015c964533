# SPDX-License-Identifier: LGPL-3.0-or-later
"""Turbulent gas in a straight duct or pipe by Reynolds stresses: from a case to its results."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from fem_tfm.case import Case
from fem_tfm.correlations import gnielinski, jones_friction, smooth_friction
from fem_tfm.errors import SolverError
from fem_tfm.flows import developed, duct_start
from fem_tfm.flows.case_geometry import geometry_of, resolution_of
from fem_tfm.flows.driver import Answer, Scene
from fem_tfm.flows.duct_heat import DuctHeat
from fem_tfm.flows.duct_section import DuctSection, DuctSetup
from fem_tfm.flows.section_recorder import SectionRecorder
from fem_tfm.geometry.mesh import section_mesh
from fem_tfm.geometry.section import RectangularSection
from fem_tfm.interpolation import point_values
from fem_tfm.models.reynolds_stress import GasNumbers
from fem_tfm.output.duct_pictures import duct_picture, lines_picture
from fem_tfm.output.fields import FieldWriter, snapshot
from fem_tfm.output.files import on_root
from fem_tfm.output.pictures import SectionView
from fem_tfm.output.profiles import write_profiles
from fem_tfm.output.result import Reference, Result
from fem_tfm.solvers.pseudo_time import StepControl

# coarsest mesh of the nested iteration, core cell over the hydraulic diameter
COARSEST = 0.31
# the EVSS viscosity, the condition on eps at the plane, and the compressibility times U D
STABILISATION, WALL_PENALTY, PRESSURE_SHIFT = 0.09, 200.0, 1e-6
# pseudo-time in units of D/U
FIRST_STEP, SMALLEST_STEP, LARGEST_STEP, GROWTH = 3.0, 1e-5, 1e7, 3.0
# a state that misses the flux by more is no answer; momentum, which is not conservative, by more
FLUX_ERROR, MOMENTUM_ERROR = 1e-6, 0.05
LINE_POINTS = 61
# points on a boundary are taken a hair inside, so that round-off loses none
INSIDE = 1e-9


def setup_of(case: Case) -> DuctSetup:
    """Numbers of the problem that a case describes, with the constants that laws leave open."""
    speed, width = case.operation.gas_superficial_velocity, case.geometry.hydraulic_diameter
    law, function = case.closures.reynolds_stress.resolved(), case.walls.function
    if not function.C_mu:
        function = replace(function, C_mu=law.log_layer().C_mu)
    gas = case.gas_material
    numbers = GasNumbers(
        viscosity=gas.viscosity / gas.density,
        stabilisation=STABILISATION,
        wall_penalty=WALL_PENALTY,
        pressure_shift=PRESSURE_SHIFT / (speed * width),
        wall_offset=case.wall_distance,
    )
    return DuctSetup(law, function, numbers, speed, case.numerics.quadrature_degree)


def step_control(setup: DuctSetup, width: float, tolerance: float, max_steps: int) -> StepControl:
    """Pseudo-time steps scaled by the residence time D/U."""
    unit = width / setup.velocity
    return StepControl(
        first=FIRST_STEP * unit,
        smallest=SMALLEST_STEP * unit,
        largest=LARGEST_STEP * unit,
        growth=GROWTH,
        tolerance=tolerance,
        max_steps=max_steps,
    )


SCHEME = developed.Scheme(DuctSection, duct_start.cold, duct_start.warm, step_control)


def mesh_sizes(case: Case) -> list[float]:
    """Core cell sizes of the nested iteration, coarse to fine, each half the one before [m]."""
    return resolution_of(case).nested_sizes(geometry_of(case), COARSEST)


def meshes(case: Case, comm: MPI.Comm = MPI.COMM_WORLD) -> list[Any]:
    """Makers of the meshes of the nested iteration."""
    part = geometry_of(case)
    levels = resolution_of(case).nested(part, COARSEST)
    return [partial(section_mesh, part, level, comm) for level in levels]


def solve(
    case: Case, observer: developed.Observer = developed.QUIET, restart: Any = None
) -> developed.Solution:
    """Developed section of a case on its meshes, coarse to fine.

    Raises
    ------
    SolverError
        no steady state was reached.
    """
    limits = case.numerics.tolerance, case.numerics.max_steps
    return developed.solve(meshes(case), setup_of(case), *limits, observer, restart, SCHEME)


# -- quantities --------------------------------------------------------------------------------


def eigenvalues(found: DuctSection) -> NDArray[np.float64]:
    """Eigenvalues of R over k at the nodes of this rank, ascending, shape (n, 3) [-]."""
    if not found.setup.law.transported:
        stress = found.fields()["reynolds_stress"].x.array.reshape(-1, 3, 3)
    else:
        r = found.unknown("r").x.array.reshape(-1, 6)
        rows = ((0, 3, 4), (3, 1, 5), (4, 5, 2))
        stress = r[:, np.array(rows)]
    energy = np.trace(stress, axis1=1, axis2=2)[:, None] / 2
    return np.linalg.eigvalsh(stress) / energy


def smallest_stress(found: DuctSection) -> float:
    """Smallest principal Reynolds stress over k [-]; positive where stresses are realisable.

    Positive principal stresses mean positive normal stresses and Schwarz's inequality for all axes.
    """
    values = eigenvalues(found)
    return found.mesh.mesh.comm.allreduce(float(values.min(initial=math.inf)), MPI.MIN)


def check_realisable(found: DuctSection) -> float:
    """`smallest_stress` of an answer.

    Raises
    ------
    SolverError
        a principal stress is negative, so that the state is no answer.
    """
    smallest = smallest_stress(found)
    if not smallest > 0:
        raise SolverError(f"a principal Reynolds stress is {smallest:.2g} k, which cannot be")
    return smallest


def secondary(found: DuctSection) -> float:
    """Largest velocity across the axis over the bulk velocity [-]."""
    u = found.unknown("u").x.array.reshape(-1, 3)
    peak = float(np.hypot(u[:, 0], u[:, 1]).max(initial=0.0))
    return found.mesh.mesh.comm.allreduce(peak, MPI.MAX) / found.setup.velocity


def corner(found: DuctSection) -> tuple[float, float]:
    """Furthest point of the mesh along x and y [m]."""
    geometry = found.mesh.section
    offset = float(found.setup.numbers.wall_offset)
    if isinstance(geometry, RectangularSection):
        return geometry.width / 2 - offset, geometry.height / 2 - offset
    return geometry.radius - offset, 0.0


def quantities(found: DuctSection, density: float, length: float) -> dict[str, float]:
    """Numbers of a developed section, in the units of `case.QUANTITIES`; whole section."""
    setup, geometry = found.setup, found.mesh.section
    width, speed = geometry.hydraulic_diameter, setup.velocity
    gradient = density * found.pressure_gradient
    u_tau = math.sqrt(found.pressure_gradient * width / 4)
    lines = profiles(found)
    told = {
        "pressure_gradient": gradient,
        "pressure_drop": gradient * length,
        "gas_mass_flow": density * geometry.area_factor * found.flux(),
        "friction_factor": 2 * found.pressure_gradient * width / speed**2,
        "secondary_velocity_max": secondary(found),
        "centre_to_bulk": float(lines["bisector u_z/U"][0]),
        "axis_energy": float(lines["bisector k/u_tau2"][0]),
        "smallest_stress": smallest_stress(found),
        "wall_distance_plus": float(setup.numbers.wall_offset) * u_tau / setup.numbers.viscosity,
    }
    if isinstance(geometry, RectangularSection):
        outward = lines["diagonal outward/U"]
        told["secondary_velocity_diagonal"] = float(outward[np.abs(outward).argmax()])
        told["corner_wall_shear"] = float(lines["wall shear/mean"][-1])
    return told


def profiles(found: DuctSection) -> dict[str, NDArray[np.float64]]:
    """Columns along the wall bisector, the diagonal and the wall, from the centre outward.

    s is the share of the way from the centre to the wall (bisector, along x), to the corner
    (diagonal) or from the bisector to the corner (wall, at the top). Velocities over U, stresses
    over u_tau^2 = G D_h/(4 rho), wall shear over its mean.
    """
    setup, geometry = found.setup, found.mesh.section
    u_tau2 = found.pressure_gradient * geometry.hydraulic_diameter / 4
    s = np.linspace(0.0, 1.0, LINE_POINTS)
    across, up = corner(found)
    fields = found.fields()
    sampled = [fields[name] for name in ("u_g", "k", "reynolds_stress")]

    def at(x: NDArray[np.float64], y: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        return point_values(sampled, np.column_stack([x, y]) * (1 - INSIDE))

    u, k, r = at(s * across, 0 * s)
    columns = {
        "s": s,
        "bisector u_z/U": u[:, 2] / setup.velocity,
        "bisector outward/U": u[:, 0] / setup.velocity,
        "bisector k/u_tau2": k / u_tau2,
        "bisector (R_yy - R_xx)/u_tau2": (r[:, 4] - r[:, 0]) / u_tau2,
        "bisector R_xz/u_tau2": r[:, 2] / u_tau2,
    }
    if not isinstance(geometry, RectangularSection):
        return columns
    u, k, r = at(s * across, s * up)
    direction = np.array([across, up]) / math.hypot(across, up)
    columns |= {
        "diagonal u_z/U": u[:, 2] / setup.velocity,
        "diagonal outward/U": u[:, :2] @ direction / setup.velocity,
        "diagonal k/u_tau2": k / u_tau2,
        "diagonal (R_yy - R_xx)/u_tau2": (r[:, 4] - r[:, 0]) / u_tau2,
    }
    u, k, _ = at(s * across, up + 0 * s)
    offset, nu = float(setup.numbers.wall_offset), setup.numbers.viscosity
    shear = setup.function.friction(k, offset, nu) * u[:, 2]
    mean = found.wall_force() / found.wall_length()
    return columns | {
        "wall shear/mean": shear / mean,
        "wall u_z/U": u[:, 2] / setup.velocity,
        "wall along/U": u[:, 0] / setup.velocity,
    }


def balances(found: DuctSection) -> dict[str, float]:
    """Relative errors of the flux imposed and of axial momentum, G A = force of the walls.

    Momentum is not conservative; what it misses is the error of the mesh.
    """
    target = float(found.newton.borders[0].target.value)
    driven, resisted = found.pressure_gradient * found.area, found.wall_force()
    return {
        "gas_mass": abs(found.newton.constraint_errors()[0] / target),
        "axial_momentum": abs(driven - resisted) / abs(driven),
    }


def checked_balances(found: DuctSection) -> dict[str, float]:
    """The balances of an answer.

    Raises
    ------
    SolverError
        one of them is broken, or a stress is not realisable, so that the state is no answer.
    """
    check_realisable(found)
    kept = balances(found)
    limits = {"gas_mass": FLUX_ERROR, "axial_momentum": MOMENTUM_ERROR}
    for name, limit in limits.items():
        if not kept[name] <= limit:
            raise SolverError(f"the balance of {name} is broken by {kept[name]:.1e}")
    return kept


def references(case: Case) -> dict[str, list[Reference]]:
    """Published values that belong to a case's Reynolds number and section."""
    reynolds, geometry = case.reynolds, geometry_of(case)
    if isinstance(geometry, RectangularSection):
        friction = jones_friction(reynolds, geometry.width, geometry.height)
        source = "smooth rectangular duct, Jones (1976), J. Fluids Eng. 98"
    else:
        friction, source = smooth_friction(reynolds), "smooth pipe, Prandtl and von Karman"
    known = {"friction_factor": [Reference(friction, source)]}
    if isinstance(geometry, RectangularSection) and geometry.width == geometry.height:
        known["secondary_velocity_max"] = [
            Reference(0.019, "DNS at Re 4410, Gavrilakis (1992), J. Fluid Mech. 244"),
            Reference(0.015, "middle of 1 to 2 %, Pirozzoli et al. (2018), J. Fluid Mech. 840"),
        ]
    if case.heat is not None:
        value = gnielinski(reynolds, case.heat.prandtl)
        known["nusselt"] = [Reference(value, "Gnielinski (1976), Int. Chem. Eng. 16")]
    return known


def skipped(case: Case) -> list[str]:
    """What the scene did not need, and why."""
    geometry, law = geometry_of(case), case.closures.reynolds_stress
    developing = case.solution == "developing"
    left_out = ["axial direction: a developed section has d/dz = 0"]
    if developing:
        left_out = ["upstream influence: stresses are not differentiated along the axis"]
    if geometry.symmetry != "none":
        mirrored = {"half": "half", "quarter": "three quarters"}[geometry.symmetry]
        left_out.append(f"{mirrored} of the section: mirror images of the part solved")
    way = "the march along the axis" if developing else "pseudo-time"
    left_out.append(f"history: {way} leads straight to the steady state")
    left_out.append("weight: the gas has one density")
    if not law.transported:
        left_out.append(f"transport of each stress: closures.reynolds_stress = {law.name}")
    if case.heat is None:
        left_out.append("temperature and heat fluxes: no table [heat]")
    return left_out


# wall functions need a log layer, and the demo's model was measured up to this aspect ratio
LOWEST_REYNOLDS, LARGEST_ASPECT, LOG_LAYER = 2e4, 4.0, (30.0, 300.0)


def advice(case: Case) -> list[str]:
    """What a user probably did not mean, one sentence each."""
    said, (width, height) = [], case.geometry.size
    if case.reynolds < LOWEST_REYNOLDS:
        said.append(
            f"wall functions leave no room at a Reynolds number of {case.reynolds:.3g}; they are"
            f" meant for more than {LOWEST_REYNOLDS:g}"
        )
    if max(width, height) > LARGEST_ASPECT * min(width, height):
        said.append(f"sections with sides above {LARGEST_ASPECT:g} to 1 have not been tried")
    diameter, viscosity = case.geometry.hydraulic_diameter, setup_of(case).numbers.viscosity
    speed = case.operation.gas_superficial_velocity
    u_tau = speed * math.sqrt(smooth_friction(case.reynolds) / 8)
    y_plus, (low, high) = case.wall_distance * u_tau / viscosity, LOG_LAYER
    if not low <= y_plus <= high or case.wall_distance > 0.1 * diameter:
        said.append(
            f"walls.distance = {case.wall_distance:.3g} m is y+ = {y_plus:.0f}; wall functions hold"
            f" from {low:g} to {high:g} and below a tenth of the hydraulic diameter"
        )
    return said


# -- the run -----------------------------------------------------------------------------------

FILES = (
    "result.json", "report.html", "monitor.csv", "run.log", "profiles.csv", "profiles.png",
    "section.png", "fields.xdmf", "fields.h5",
)  # fmt: skip
COLUMNS = {
    "step": "",
    "level": "",
    "dt": "s",
    "iterations": "",
    "update": "",
    "pressure_gradient": "Pa/m",
    "secondary_velocity_max": "",
    "smallest_stress": "",
}
WARNED = ("update", "pressure_gradient", "secondary_velocity_max", "smallest_stress")


class DuctRecorder(SectionRecorder):
    """What a run of a duct's gas tells and keeps."""

    columns, warned = COLUMNS, WARNED
    heat: DuctHeat | None = None

    def signs(self, section: DuctSection) -> dict[str, float]:
        """The early warning: gradient [Pa/m], secondary flow and realisability."""
        return {
            "pressure_gradient": self.case.gas_material.density * section.pressure_gradient,
            "secondary_velocity_max": secondary(section),
            "smallest_stress": smallest_stress(section),
        }

    def multipliers(self, section: DuctSection) -> dict[str, Any]:
        """Constants that belong to the state."""
        return {"drive": section.drive}


def heat_of(case: Case, found: DuctSection) -> DuctHeat:
    """Temperature with the laws of a case on a section that is solved, not solved itself yet."""
    given = case.heat
    return DuctHeat(found, case.closures.heat_flux, case.walls.heat, given.prandtl)


def developed_heat(case: Case, found: DuctSection) -> tuple[DuctHeat | None, dict[str, float]]:
    """Developed temperature of a section and its quantities; None where no heat is asked for."""
    if case.heat is None:
        return None, {}
    heat, given = heat_of(case, found), case.heat
    if given.wall == "flux":
        heat.constant_flux()
        # the solution cools by 1 K/m
        capacity = case.gas_material.density * given.heat_capacity
        heat.scale = given.wall_flux / (capacity * heat.flux())
    else:
        heat.constant_temperature()
        heat.scale = 1 / heat.bulk()
    told = {"nusselt": heat.nusselt()}
    if (prandtl := heat.profiles(points(found)).get("bisector Pr_t")) is not None:
        told |= {"turbulent_prandtl_axis": float(prandtl[1])}
        told |= {"turbulent_prandtl_wall": float(prandtl[-1])}
    return heat, told


def estimated(
    case: Case, solution: developed.Solution
) -> tuple[dict[str, float], dict[str, float | None], DuctHeat | None]:
    """Quantities on the finest mesh, the change of each since the mesh before, and the heat."""
    found, density, heat = [], case.gas_material.density, None
    for level in solution.levels[-2:]:
        heat, more = developed_heat(case, level.section)
        found.append(quantities(level.section, density, case.geometry.length) | more)
    return *developed.with_changes(found), heat


def points(found: DuctSection) -> dict[str, NDArray[np.float64]]:
    """Points along the bisector and the diagonal, from the centre outward, shape (n, 2) [m]."""
    s = np.linspace(0.0, 1.0, LINE_POINTS) * (1 - INSIDE)
    across, up = corner(found)
    lines = {"bisector": np.column_stack([s * across, 0 * s])}
    if isinstance(found.mesh.section, RectangularSection):
        lines["diagonal"] = np.column_stack([s * across, s * up])
    return lines


def answer(case: Case, recorder: DuctRecorder) -> Answer:
    """The developed section of a case, and its temperature.

    Raises
    ------
    SolverError
        no steady state was reached, a stress is not realisable or a balance is broken.
    """
    solution = solve(case, recorder, recorder.restart() if recorder.resume else None)
    kept = checked_balances(solution.section)
    found, errors, recorder.heat = estimated(case, solution)
    if recorder.heat is not None:
        kept["heat"] = recorder.heat.balance()
    return Answer("converged", found, kept, "friction_factor", errors, references(case))


def _write(case: Case, recorder: DuctRecorder, result: Result) -> None:
    write_section(case, recorder.section, result, recorder.out, recorder.heat)


SCENE = Scene(DuctRecorder, FILES, advice, skipped, answer, _write)


def write_section(
    case: Case,
    found: DuctSection,
    result: Result,
    out: Path | None,
    heat: DuctHeat | None = None,
) -> None:
    """XDMF, profiles and pictures of one section."""
    mesh, fields, lines = found.mesh.mesh, found.fields(), profiles(found)
    if heat is not None:
        fields |= heat.fields()
        lines |= heat.profiles(points(found))
    moment = snapshot(mesh, fields)
    result.sections["lines"] = lines
    if out is not None and case.output.xdmf and case.solution != "developing":
        with FieldWriter(out / "fields", mesh) as writer:
            writer.write(0.0, chosen_fields(case, fields))

    def draw() -> None:
        symmetry = found.mesh.section.symmetry
        view = SectionView.of_cells(moment.points, moment.cells, moment.kind, symmetry)
        write_profiles(out / "profiles.csv", lines, {"s": "-"})
        if case.output.pictures:
            duct_picture(out / "section.png", view, moment.nodal, case.title)
            lines_picture(out / "profiles.png", lines, case.title)

    if out is not None:
        on_root(mesh.comm, draw)


def chosen_fields(case: Case, fields: Mapping[str, Any]) -> dict[str, Any]:
    """The fields that a case wants in fields.xdmf."""
    return {n: f for n, f in fields.items() if n in case.output.fields}


def describe(case: Case) -> dict[str, Any]:
    """What would be solved, what is left out, and what it would take."""
    sizes = mesh_sizes(case)
    cells, unknowns = size_of(case)
    laws = [case.closures.reynolds_stress, case.walls.function]
    laws += [case.closures.heat_flux, case.walls.heat] if case.heat else []
    speed = case.operation.gas_superficial_velocity
    return {
        "title": case.title or "untitled",
        "solved": "developed section of a duct's gas by Reynolds stresses: steady, d/dz = 0",
        "given": f"bulk velocity {speed:g} m/s, Re {case.reynolds:.4g}; found: pressure gradient",
        "closures": [f"{law.family}: {law.name}" for law in laws],
        "skipped": skipped(case),
        "wall_distance": f"{1e3 * case.wall_distance:.3g} mm, where the mesh begins",
        "meshes": ", ".join(f"{1e3 * size:.3g} mm" for size in sizes) + " core cells in turn",
        "finest_mesh": f"{cells} cells, about {unknowns} unknowns",
        "memory": f"about {BASE_MEMORY + MEMORY_PER_UNKNOWN * unknowns:.0f} MB",
        "time": f"about {TIME_PER_UNKNOWN * unknowns + 1:.0f} s, and {COMPILE_TIME} s more to "
        "compile the forms if these closures are new on this machine",
        "inferred": list(case.inferred) or "nothing",
        "warnings": advice(case) or "none",
    }


def size_of(case: Case) -> tuple[int, int]:
    """Cells of the finest mesh, and about how many unknowns."""
    cells, transported = meshes(case)[-1]().num_cells, case.closures.reynolds_stress.transported
    return cells, round(cells * (UNKNOWNS_PER_CELL if transported else EDDY_UNKNOWNS_PER_CELL))


# measured on the demo: unknowns of Q2/Q1 quadrilaterals, memory and CPU time of a cold run
UNKNOWNS_PER_CELL, EDDY_UNKNOWNS_PER_CELL = 60, 22
BASE_MEMORY, MEMORY_PER_UNKNOWN, TIME_PER_UNKNOWN, COMPILE_TIME = 170, 0.016, 2.0e-4, 25

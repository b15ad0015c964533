# SPDX-License-Identifier: LGPL-3.0-or-later
"""Dense gas-solid flow by the two-fluid model: from a case to its results."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import ufl
from mpi4py import MPI

from fem_tfm.case import Case
from fem_tfm.errors import SolverError
from fem_tfm.flows import developed
from fem_tfm.flows.driver import Answer, Scene
from fem_tfm.flows.section import Section, Setup
from fem_tfm.flows.section_recorder import SectionRecorder
from fem_tfm.mesh import geometry_of, resolution_of, section
from fem_tfm.models.two_fluid import ClosureSet, Stabilisation
from fem_tfm.output.fields import FieldWriter, snapshot
from fem_tfm.output.files import on_root
from fem_tfm.output.pictures import SectionView, section_picture, vertical_profile
from fem_tfm.output.profiles import write_profiles
from fem_tfm.output.result import Result

# coarsest mesh of the nested iteration, core cell over the hydraulic diameter
COARSEST = 0.25
# regularisations in units of U_g and D; their effect on the pressure gradient is in docs/dense.md
ALPHA_DIFFUSION, WALL_SPEED, PRESSURE_SHIFT = 1.5e-7, 0.1, 1e-8
WALL_PENALTY, SMOOTHING, SMALLEST_RATE = 200.0, 0.05, 1e-4
# a state that breaks a balance by more is no answer
BALANCE_ERROR = 1e-6
# and one whose gradient the raised terms of the mesh change by a larger share is none either
LARGEST_CHANGE = 0.5


def setup_of(case: Case) -> Setup:
    """Numbers of the developed problem that a case describes."""
    speed, width = case.operation.gas_superficial_velocity, case.geometry.hydraulic_diameter
    gas, given = case.gas_material, case.numerics
    diffusion = given.alpha_diffusion
    numerics = Stabilisation.scaled(
        speed,
        width,
        case.solids_material,
        given.theta_floor,
        case.walls.grain_gap * (case.solids.diameter if case.solids else 0.0),
        alpha_diffusion=ALPHA_DIFFUSION * speed * width if diffusion is None else diffusion,
        capture=given.capture,
        damping=given.damping,
        smallest_rate=SMALLEST_RATE * speed / width,
        wall_penalty=WALL_PENALTY,
        wall_speed=WALL_SPEED * speed,
        pressure_shift=PRESSURE_SHIFT / (width * gas.density * speed),
        relaxation=width / speed,
        smoothing=SMOOTHING * width,
    )
    return Setup(
        gas=gas,
        solids=case.solids_material,
        closures=ClosureSet.of(case.closures, case.walls),
        numerics=numerics,
        gravity=case.gravity_vector,
        wall_offset=case.wall_distance,
        gas_velocity=speed,
        feed=case.solids_feed,
        quadrature_degree=given.quadrature_degree,
    )


def mesh_sizes(case: Case) -> list[float]:
    """Core cell sizes of the nested iteration, coarse to fine, each half the one before [m]."""
    geometry, given = geometry_of(case), case.numerics
    size = given.mesh_size or geometry.level_size / 2 ** ((given.level - 1) / 2)
    sizes = [size]
    while sizes[0] * 2 <= COARSEST * geometry.hydraulic_diameter * 1.001:
        sizes.insert(0, sizes[0] * 2)
    return sizes


def meshes(case: Case, comm: MPI.Comm = MPI.COMM_WORLD) -> list[Any]:
    """Makers of the meshes of the nested iteration."""
    make = partial(section, geometry_of(case), comm=comm, **_resolution(case))
    return [partial(make, size=size) for size in mesh_sizes(case)]


def _resolution(case: Case) -> dict[str, Any]:
    """Shape and grading of the cells, without their size."""
    given = resolution_of(case)
    return {key: given[key] for key in ("wall_ratio", "cells")}


# -- quantities --------------------------------------------------------------------------------


def pressure_gradient(section: Section) -> float:
    """-dP/dz with the weight of the gas, from P = p + rho_g g.x - G z [Pa/m]."""
    setup = section.setup
    return float(section.drive.value) - setup.gas.density * setup.gravity[2]


def quantities(section: Section, length: float) -> dict[str, float]:
    """Numbers of a developed section, in the units of `case.QUANTITIES`; whole section."""
    model, state, setup = section.model, section.state(section.now), section.setup
    alpha, whole = model.alpha(state), section.mesh.geometry.area_factor
    gradient = pressure_gradient(section)
    gas = section.integral("gas flux", (1 - alpha) * state.u_g[2])
    found = {
        "pressure_gradient": gradient,
        "pressure_drop": gradient * length,
        "gas_mass_flow": whole * setup.gas.density * gas,
    }
    if setup.solids is None:
        return found
    solids = section.integral("solids flux", alpha * state.u_s[2])
    held = section.integral("held", alpha)
    in_bed = ufl.conditional(ufl.gt(alpha, model.solids.friction_limit), 1.0, 0.0)
    return found | {
        "solids_mass_flow": whole * setup.solids.density * solids,
        "holdup": held / section.area,
        "max_solids_fraction": section.extremes()["max_alpha_s"],
        "bed_fraction": section.integral("bed", in_bed) / section.area,
        "slip_velocity": gas / (section.area - held) - solids / held,
    }


def estimated(
    solution: developed.Solution, length: float
) -> tuple[dict[str, float], dict[str, float | None]]:
    """Quantities on the finest mesh, and the change of each since the mesh before.

    Where the terms of the mesh had to be raised, the change by as much again of them is added.

    Raises
    ------
    SolverError
        it changes the gradient so much that they decide it.
    """
    found, errors = developed.with_changes(
        [quantities(level.section, length) for level in solution.levels[-2:]]
    )
    section = solution.section
    if section.rougher is None:
        return found, errors
    state, share = section.stored(), 1 / (section.rougher.ratio - 1)
    section.restore(section.rougher.state)
    rougher = quantities(section, length)
    section.restore(state)
    changes = {name: share * abs(rougher[name] - found[name]) for name in found}
    change, gradient = changes["pressure_gradient"], abs(found["pressure_gradient"])
    if change > LARGEST_CHANGE * gradient:
        raise SolverError(
            f"a steady state was found only with {terms_of_mesh(section)}, which decide it:"
            f" as much again of them changes {gradient:.3g} Pa/m by {change:.3g}"
        )
    return found, {name: (errors[name] or 0.0) + changes[name] for name in found}


def balances(section: Section) -> dict[str, float]:
    """Relative errors of the balances of mass and axial momentum.

    Momentum: G A + axial weight of the solids in the gas = force of the walls. Mass: error of the
    imposed flux or hold-up, and for the solids the source that the steady state must not need.
    """
    setup, model, state = section.setup, section.model, section.state(section.now)
    errors = [
        abs(error / float(border.target.value))
        for error, border in zip(
            section.newton.constraint_errors(), section.newton.borders, strict=True
        )
    ]
    drive = float(section.drive.value) * section.area
    weight = 0.0
    if setup.solids is not None:
        excess = setup.solids.density - setup.gas.density
        weight = excess * setup.gravity[2] * section.integral("held", model.alpha(state))
    force = section.wall_force()
    scale = max(abs(drive), abs(weight), abs(force))
    found = {"gas_mass": errors[0], "axial_momentum": abs(drive + weight - force) / scale}
    if setup.solids is not None:
        turnover = section.mesh.geometry.hydraulic_diameter / setup.gas_velocity
        found["solids_mass"] = max(errors[1], abs(float(section.source.value)) * turnover)
    return found


def checked_balances(section: Section) -> dict[str, float]:
    """The balances of an answer.

    Raises
    ------
    SolverError
        one of them is broken, so that the state is no answer.
    """
    kept = balances(section)
    worst = max(kept, key=lambda name: kept[name])
    if not kept[worst] <= BALANCE_ERROR:
        raise SolverError(f"the balance of {worst} is broken by {kept[worst]:.1e}")
    return kept


def skipped(case: Case) -> list[str]:
    """What the scene did not need, and why."""
    developing = case.solution == "developing"
    left_out = ["axial direction: a developed section has d/dz = 0"]
    if developing:
        left_out = ["upstream influence: stresses are not differentiated along the axis"]
    if geometry_of(case).symmetry == "half":
        left_out.append("left half: mirror image of the right one")
    way = "the march along the axis" if developing else "pseudo-time"
    left_out.append(f"history: {way} leads straight to the steady state")
    if case.operation.outlet_pressure is not None:
        left_out.append("compressibility: the gas has one density along the line")
    return left_out + skipped_laws(case)


def skipped_laws(case: Case) -> list[str]:
    """Laws that the case does without."""
    laws, left_out = case.closures, []
    if case.solids is None:
        left_out.append("solids, granular temperature, drag: no table [solids]")
    else:
        if laws.theta == "algebraic":
            left_out.append("transport of granular temperature: closures.theta = algebraic")
        if laws.friction.name == "none":
            left_out.append("frictional stress: closures.friction = none")
        if laws.dispersed.name == "none":
            left_out.append("turbulence of the solids: closures.dispersed = none")
        if laws.dispersion.name == "none":
            left_out.append("turbulent dispersion of the solids: closures.dispersion = none")
    if laws.turbulence.name == "laminar":
        left_out.append("gas turbulence: closures.turbulence = laminar")
    elif not laws.turbulence.transported:
        left_out.append(f"transport of k and eps: closures.turbulence = {laws.turbulence.name}")
    return left_out


def terms_of_mesh(section: Section) -> str:
    """The raised terms of the mesh in words."""
    terms, said = section.mesh_terms, []
    if terms.strength > 1:
        said.append(f"{terms.strength:g} times numerics.capture and numerics.damping")
    if terms.rate > 1:
        rate = terms.rate * SMALLEST_RATE
        said.append(f"a least rate of {rate:.2g} U_g/D in the mesh's diffusion and damping")
    return " and ".join(said)


def raised_terms(section: Section) -> str:
    """What an answer with raised terms of the mesh must say."""
    return (
        f"standard terms of the mesh: a steady state was found with {terms_of_mesh(section)} and"
        " not with less; error_estimate holds the effect"
    )


# a plastic law with a friction limit below this was hardly meant; a gas with Re above is turbulent
PACKED, TURBULENT = 0.5, 4000.0


def advice(case: Case) -> list[str]:
    """What a user probably did not mean, one sentence each."""
    said, laws, solids = [], case.closures, case.solids
    if solids and laws.friction.name in ("schaeffer", "syamlal") and solids.friction_limit < PACKED:
        said.append(
            f"friction {laws.friction.name!r} makes the bed incompressible above"
            f" solids.friction_limit = {solids.friction_limit:g}; set it to the packed fraction,"
            " such as 0.58"
        )
    gas, width = case.gas_material, case.geometry.hydraulic_diameter
    reynolds = gas.density * case.operation.gas_superficial_velocity * width / gas.viscosity
    if laws.turbulence.name == "laminar" and reynolds > TURBULENT:
        said.append(f"the gas is taken as laminar at a Reynolds number of {reynolds:.3g}")
    if laws.turbulence.name != "laminar" and case.walls.gas.name == "no-slip":
        said.append(
            "a turbulent gas with walls.gas = 'no-slip' needs cells of a few viscous lengths at the"
            " wall; 'low-reynolds' makes them and 'log-law' does without"
        )
    return said


# -- the run -----------------------------------------------------------------------------------

FILES = (
    "result.json", "report.html", "monitor.csv", "run.log", "profiles.csv", "section.png",
    "fields.xdmf", "fields.h5",
)  # fmt: skip
COLUMNS = {
    "step": "",
    "level": "",
    "dt": "s",
    "iterations": "",
    "update": "",
    "pressure_gradient": "Pa/m",
    "max_alpha_s": "",
    "max_theta": "m2/s2",
}
WARNED = ("update", "pressure_gradient", "max_alpha_s", "max_theta")


class DenseRecorder(SectionRecorder):
    """What a run of the dense flow tells and keeps."""

    columns, warned = COLUMNS, WARNED

    def signs(self, section: Section) -> dict[str, float]:
        """The early warning: gradient [Pa/m] and extremes of the solids."""
        return {"pressure_gradient": pressure_gradient(section), **section.extremes()}

    def multipliers(self, section: Section) -> dict[str, Any]:
        """Constants that belong to the state."""
        return {"drive": section.drive, "source": section.source}


def solve(case: Case, recorder: DenseRecorder) -> Answer:
    """The developed section of a case.

    Raises
    ------
    SolverError
        no steady state was reached, or a balance is broken.
    """
    limits = case.numerics.tolerance, case.numerics.max_steps
    restart = recorder.restart() if recorder.resume else None
    solution = developed.solve(meshes(case), setup_of(case), *limits, recorder, restart)
    kept = checked_balances(solution.section)
    found, errors = estimated(solution, case.geometry.length)
    section = solution.section
    notes = [raised_terms(section)] if section.mesh_terms.raised else []
    return Answer("converged", found, kept, "pressure_gradient", errors, notes=notes)


def _write(case: Case, recorder: DenseRecorder, result: Result) -> None:
    """XDMF, profiles along the vertical diameter and pictures."""
    section = recorder.section
    if recorder.out is not None and case.output.xdmf:
        with FieldWriter(recorder.out / "fields", section.mesh.mesh) as writer:
            writer.write(0.0, chosen_fields(case, section))
    write_section(case, section, result, recorder.out)


SCENE = Scene(DenseRecorder, FILES, advice, skipped, solve, _write)


def chosen_fields(case: Case, section: Section) -> dict[str, Any]:
    """The fields that a case wants in fields.xdmf."""
    return {n: f for n, f in section.fields().items() if n in case.output.fields}


def write_section(case: Case, section: Section, result: Result, out: Path | None) -> None:
    """Profiles along the vertical diameter, for the result and the files, and the picture."""
    mesh = section.mesh.mesh
    moment = snapshot(mesh, section.fields())

    def draw() -> None:
        view = SectionView.of_cells(
            moment.points, moment.cells, moment.kind, section.mesh.geometry.symmetry
        )
        values = dict(moment.nodal)
        if "theta" in values:
            values["Theta"] = values.pop("theta")
        result.sections["vertical"] = profile = vertical_profile(view, values)
        if out is None:
            return
        write_profiles(out / "profiles.csv", profile, PROFILE_UNITS)
        if case.output.pictures:
            section_picture(out / "section.png", view, values, case.title)

    on_root(mesh.comm, draw)


PROFILE_UNITS = {
    "y": "m",
    "y/D": "-",
    "alpha_s": "-",
    "u_s": "m/s",
    "u_g": "m/s",
    "Theta": "m2/s2",
    "pressure": "Pa",
    "k": "m2/s2",
    "eps": "m2/s3",
    "k_s": "m2/s2",
    "eps_s": "m2/s3",
}


def describe(case: Case) -> dict[str, Any]:
    """What would be solved, what is left out, and what it would take."""
    sizes = mesh_sizes(case)
    cells, unknowns = size_of(case)
    laws = case.closures
    chosen = [laws.drag, laws.radial, laws.granular, laws.friction] if case.solids else []
    chosen += [laws.turbulence, case.walls.gas]
    chosen += [laws.dispersed, laws.dispersion, case.walls.solids] if case.solids else []
    return {
        "title": case.title or "untitled",
        "solved": "developed section by the two-fluid model: steady, d/dz = 0",
        "given": _given(case),
        "closures": [f"{law.family}: {law.name}" for law in chosen],
        "skipped": skipped(case),
        "meshes": ", ".join(f"{1e3 * size:.3g} mm" for size in sizes) + " core cells in turn",
        "finest_mesh": f"{cells} cells, about {unknowns} unknowns",
        "memory": f"about {BASE_MEMORY + MEMORY_PER_UNKNOWN * unknowns:.0f} MB",
        "time": f"about {solve_time(case, unknowns):.0f} s, and {compile_time(case)} s more to "
        "compile the forms if these closures are new on this machine",
        "inferred": list(case.inferred) or "nothing",
        "warnings": advice(case) or "none",
    }


def size_of(case: Case) -> tuple[int, int]:
    """Cells of the finest mesh, and about how many unknowns."""
    mesh = section(geometry_of(case), size=mesh_sizes(case)[-1], **_resolution(case))
    per_cell = UNKNOWNS_PER_CELL if case.solids else GAS_UNKNOWNS_PER_CELL
    scales = transported_scales(case) * UNKNOWNS_PER_SCALE
    return mesh.num_cells, round(mesh.num_cells * (per_cell + scales))


def transported_scales(case: Case) -> int:
    """How many scales of turbulence are unknowns."""
    laws = case.closures
    found = len(laws.turbulence.transported)
    return found + len(laws.dispersed.transported) if case.solids else found


def solve_time(case: Case, unknowns: int) -> float:
    """About the CPU time of a cold run [s]."""
    transported = TRANSPORT_FACTOR if transported_scales(case) else 1
    return transported * TIME_PER_UNKNOWN * unknowns + 1


def compile_time(case: Case) -> int:
    """About the CPU time of compiling the forms [s]."""
    return COMPILE_TIME + COMPILE_TIME_PER_SCALE * transported_scales(case)


# measured on the demo: unknowns of P2/P1 triangles, memory and CPU time of a cold run, and how much
# more of it an unknown takes where turbulence is transported (2 to 11 times)
UNKNOWNS_PER_CELL, GAS_UNKNOWNS_PER_CELL, UNKNOWNS_PER_SCALE = 17.5, 6.8, 2.1
BASE_MEMORY, MEMORY_PER_UNKNOWN, TIME_PER_UNKNOWN, TRANSPORT_FACTOR = 170, 0.012, 2.5e-4, 4
COMPILE_TIME, COMPILE_TIME_PER_SCALE = 15, 11


def _given(case: Case) -> str:
    gas = f"gas {case.operation.gas_superficial_velocity:g} m/s superficial"
    if case.solids is None:
        return gas
    kind, value = case.solids_feed
    if kind == "holdup":
        return f"{gas}, hold-up {value:g}; found: pressure gradient and solids flux"
    return f"{gas}, solids {value:.4g} m/s superficial; found: pressure gradient and hold-up"

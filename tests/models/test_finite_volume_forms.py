# SPDX-License-Identifier: LGPL-3.0-or-later
"""The arrays of one unsteady step against its DG0 forms in UFL, assembled by DOLFINx."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sparse
import ufl
from dolfinx import fem
from recording import FLOWS, SHAPES, TURBULENT, RecordedStep, recorded_step

from fem_tfm.closures.turbulence.gas import Eddies
from fem_tfm.fenics import compile_form
from fem_tfm.models.finite_volume import Inflow, UnsteadyFlow
from fem_tfm.models.finite_volume.cells.mesh import Array
from fem_tfm.models.finite_volume.ideal_gas import STILL
from fem_tfm.models.finite_volume.specification.body_force import (
    cell_force,
    cell_response,
    face_force,
    face_inertia,
    face_response,
)
from fem_tfm.models.finite_volume.specification.coefficients import (
    drag_coefficients,
    gas_viscosity,
    gas_wall,
    solids_coefficients,
    solids_pressure,
    solids_wall,
    wall_centre,
    wall_rise,
)
from fem_tfm.models.finite_volume.specification.data import (
    density_fields,
    gas_fields,
    level_fields,
    phase_fields,
    present,
    turbulence_fields,
)
from fem_tfm.models.finite_volume.specification.facets import PARTS, Face
from fem_tfm.models.finite_volume.specification.fraction import (
    acceleration_share,
    dispersion_response,
    predicted_flux,
    pressure_rise,
    solids_flux,
    solids_fraction,
)
from fem_tfm.models.finite_volume.specification.momentum import (
    dispersion_force,
    drag,
    implicit_correction,
    momentum,
    momentum_source,
    on_faces,
    viscous_force,
)
from fem_tfm.models.finite_volume.specification.pressure import (
    follow,
    ideal_gas_terms,
    phase_fluxes,
    pressure,
    pressure_source,
    responses,
    rise_to_outlet,
    total_of,
    upwind_density,
)
from fem_tfm.models.finite_volume.specification.temperature import (
    energy_dilation,
    temperature_sources,
    wall_heat,
)
from fem_tfm.models.finite_volume.specification.transport import transport, transport_source
from fem_tfm.models.finite_volume.specification.turbulence import (
    dispersed_solids,
    mirrored,
    turbulence_step,
    wall_eddies,
    wall_tractions,
)
from fem_tfm.models.finite_volume.state import SMALLEST_FRACTION, Density, State
from fem_tfm.models.pointwise import Invariants
from fem_tfm.models.solids_wall import HalfCell

# largest difference over the largest entry
CLOSE = 1e-12


@pytest.fixture(params=SHAPES)
def shape(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(params=FLOWS)
def recorded(shape: str, request: pytest.FixtureRequest) -> RecordedStep:
    return recorded_step(shape, request.param)


def assert_close(found: Array, wanted: Array, largest: float = 0.0) -> None:
    """Equal within round-off of the largest entry, or of one given."""
    largest = max(largest, np.abs(wanted).max())
    assert largest > 0
    wrong = np.abs(found - wanted).max() / largest
    print(f"{wrong:.1e}", end=" ")
    assert wrong <= CLOSE


def matrix_of(form: ufl.Form) -> sparse.csr_array:
    """Matrix of a bilinear form of values of cells."""
    return fem.assemble_matrix(compile_form(form)).to_scipy()


def assert_same_matrix(form: ufl.Form, wanted: sparse.csr_array) -> None:
    difference = matrix_of(form) - wanted
    wrong = np.abs(difference.data).max() / np.abs(wanted.data).max()
    print(f"{wrong:.1e}", end=" ")
    assert wrong <= CLOSE


# -- geometry -------------------------------------------------------------------------------------


def test_geometry_of_faces_is_that_of_the_forms(shape: str) -> None:
    recorded = recorded_step(shape, "mixing length")
    on, cells = recorded.on, recorded.cells
    inner = slice(0, cells.inner_count)
    assert_close(on.values(on.weight) * cells.face_area, cells.face_weight)
    for i in range(3):
        normal = Face.of(lambda n, i=i: n[i], on.normal)
        assert_close(on.values(normal) * cells.face_area, cells.area[:, i], cells.face_area.max())
    q = cells.centre @ np.array([0.3, -1.1, 0.7])
    mean = on.values(on.mean(on.cell(q)))
    assert_close(mean, cells.to_faces(q))
    assert np.abs(cells.interpolation_weight - 0.5).max() > 0.01 or shape == "sheared"
    flux = np.cos(np.arange(cells.face_count))
    w = ufl.TestFunction(on.scalars)
    assert_close(on.assembled(on.out(on.density(flux), w, *PARTS)), cells.net_flux(flux))
    assert_close(on.assembled(on.both(on.density(flux), w, *PARTS)), cells.sum_faces(flux))
    assert inner.stop > 100


def test_gradients_and_reconstructed_vectors_solve_their_least_squares(shape: str) -> None:
    recorded = recorded_step(shape, "mixing length")
    on, cells, line = recorded.on, recorded.cells, recorded.line
    v = ufl.TestFunction(on.vectors)
    q = np.sin(cells.centre @ np.array([300.0, 200.0, -100.0]))
    wanted = on.assembled(on.gradient_of(on.cell(q), v))
    assert_close(on.assembled(on.gradient(on.cell(cells.gradient(q)), v)), wanted)
    normal = np.cos(np.arange(cells.face_count))
    wanted = on.assembled(on.least_squares_of(on.face(normal), v, *PARTS[1:]))
    found = on.cell(line.reconstruct(normal))
    assert_close(on.assembled(on.least_squares(found, v)), wanted)


def test_gradients_beside_walls_are_those_of_the_form(shape: str) -> None:
    recorded = recorded_step(shape, "mixing length")
    on, cells, line = recorded.on, recorded.cells, recorded.line
    v = ufl.TestFunction(on.tensors)
    x, waves = cells.centre, np.array([[300.0, 200.0, -100.0], [50.0, 400.0, 0.0], [0, 90.0, 80.0]])
    gradient = cells.gradient(np.sin(x @ waves.T))
    face, side = line.opposite
    assert face.size > 100
    flags = np.zeros((2, cells.face_count))
    flags[side, face] = 1.0
    opposite = tuple(on.face(one).inner for one in flags)
    found = on.assembled(on.at_sides(on.cell(gradient), opposite, v)).reshape(-1, 3, 3)
    assert_close(gradient + found, line.at_sides(gradient))


# -- solids fraction ------------------------------------------------------------------------------


def normal_stress(recorded: RecordedStep, step: Any) -> Array:
    """What eddies add to p_s/(alpha_s rho_s) in all cells [m2/s2]."""
    turbulence = step.turbulence
    found = np.zeros(recorded.cells.count)
    if turbulence is None or turbulence.normal_stress is None:
        return found
    return found + turbulence.normal_stress["k_s"]


def acceleration_shares(recorded: RecordedStep, given: SimpleNamespace, spread: Face) -> Face:
    """Share of the acceleration of inner faces that is carried on, from sums over faces in UFL."""
    on, cells, laws = recorded.on, recorded.cells, recorded.flow.laws
    w, limit = ufl.TestFunction(on.scalars), laws.solids.packing_limit
    pressures = recorded.recorder.calls["fraction: solids_pressure"]
    rho_s, stress = laws.solids.density, normal_stress(recorded, given.step)
    (alpha, p_s), (beyond, risen) = ((call["alpha"], found) for call, found in pressures[:2])
    # in the order of the arrays, for a difference over 1e-7 feels round-off
    p_s, risen = p_s + alpha * rho_s * stress, risen + beyond * rho_s * stress
    odds = alpha / (limit - alpha)
    slope = np.maximum((risen - p_s) / (1e-7 * (1 + odds)), 0.0)
    rate, levels = cells.volume / given.step.dt, given.step.levels
    push = on.face(levels.flux_weight * given.response) * on.weight
    sound = on.assembled(on.both(push, w)) / rate * slope * alpha * (1 + odds) ** 2 / limit
    sound, wide = on.cell(sound), on.cell(on.assembled(on.both(spread, w)) / rate)
    return acceleration_share(sound, wide, on.face(levels.acceleration_share))


def test_residual_of_the_solids_fraction_is_that_of_the_form(recorded: RecordedStep) -> None:
    on, w = recorded.on, ufl.TestFunction(recorded.on.scalars)
    given, found = recorded.part("fraction")
    step, (found, _) = given.step, found
    levels = level_fields(on, step.levels)
    turbulence = turbulence_fields(on, step.turbulence)
    alpha, span = levels.now.alpha, levels.span_faces
    spread = dispersion_response(on, recorded.point, alpha, turbulence, span)
    share = acceleration_shares(recorded, given, spread)
    flux = predicted_flux(on, levels, share, spread)
    pressures = recorded.recorder.calls["fraction: solids_pressure"]
    beyond = recorded.recorder.calls.get("fraction: limit_flux", [])
    systems = recorded.recorder.systems["fraction"]
    theta, deformation = levels.predicted.theta, on.fields(step.deformation)
    lift = on.cell(normal_stress(recorded, step))
    assert len(systems) > 1
    for i, (_, rhs, _) in enumerate(systems):
        alpha = on.cell(pressures[2 * i][0]["alpha"])
        p_s = solids_pressure(recorded.point, alpha, theta, deformation, lift)
        more = beyond[min(i, len(beyond) - 1)][1] if beyond else np.zeros(recorded.cells.face_count)
        push = pressure_rise(on, recorded.point, alpha, theta, p_s)
        through = solids_flux(on, flux, alpha, push, on.face(given.response), spread)
        form = solids_fraction(
            on, w, alpha, through, on.constant(step.dt), levels, recorded.inflow, on.density(more)
        )
        assert_close(on.assembled(form), -rhs, recorded.cells.volume.max() / step.dt)
    if found.thermal_rise is not None:
        alpha = on.cell(pressures[2 * len(systems)][0]["alpha"])
        p_s = on.cell(found.pressure)
        push = pressure_rise(on, recorded.point, alpha, theta, p_s)
        assert_close(on.values(on.rise(p_s) - push), found.thermal_rise)
    # the answer is what these fluxes leave, whatever Newton's method has left of the residual
    passed = on.out(on.density(found.step_flux), w, *PARTS) - on.cell(found.step_source) * w * on.dx
    change = (on.cell(found.alpha) - levels.start.alpha) / on.constant(step.dt) * w * on.dx
    assert_close(on.assembled(change), -on.assembled(passed))


# -- granular temperature and turbulence ----------------------------------------------------------


def test_equation_of_the_granular_temperature_is_that_of_the_form(recorded: RecordedStep) -> None:
    on, point = recorded.on, recorded.point
    x, w = ufl.TrialFunction(on.scalars), ufl.TestFunction(on.scalars)
    given, _ = recorded.part("temperature")
    step = given.step
    levels, beta = level_fields(on, step.levels), on.cell(step.beta)
    moved, old, start = on.fields(step.solids), on.fields(step.state), levels.start
    deformation = on.fields(step.deformation)
    dilation = energy_dilation(moved, deformation, levels)
    deformation = SimpleNamespace(shear=deformation.shear, dilation=dilation)
    laws = solids_coefficients(point, moved.alpha, old.theta, deformation, beta)
    alpha, slip = present(old.alpha), old.u_g - old.u_s
    energy = point.granular_energy(laws, alpha, old.theta, deformation.shear, dilation, beta, slip)
    more, density = recorded.inflow.sources.energy, on.constant(point.solids.density)
    sink, gain = temperature_sources(
        energy, density, start.alpha, old.theta, start.theta, levels.span, more
    )
    eddies = 0.0 if step.turbulence is None else step.turbulence.nu_s
    heat = wall_of(recorded, step, moved.alpha, old.theta, laws, old.u_s, eddies)[1]
    falls, comes = wall_heat(on, old.theta, heat, x, w)
    flux = 1.5 * density * moved.flux
    form = transport(on, x, w, flux, laws.kinetic.conductivity, sink, on.constant(1.0)) + falls
    entering = (
        on.constant(recorded.flow.problem.solids_intensity) * recorded.inflow.solids_velocity
    ) ** 2
    side = on.assembled(transport_source(on, w, flux, gain, entering) + comes)
    assert_systems(recorded, "temperature", form, side)


def wall_of(
    recorded: RecordedStep, step: Any, alpha: Any, theta: Any, laws: Any, u: Any, nu_s: Any
) -> tuple[Any, Any]:
    """Friction and heat of the wall on the solids, in UFL of values of cells."""
    on, point = recorded.on, recorded.point
    a, theta = (np.maximum(on.cell_values(alpha), 0), on.cell(on.cell_values(theta)))
    viscosity = on.cell_values(laws.viscosity) + a * point.solids.density * nu_s
    conductivity = on.cell(on.cell_values(laws.kinetic.conductivity))
    known = SimpleNamespace(g0=on.cell(on.cell_values(laws.g0)), p_f=laws.p_f)
    if not isinstance(laws.p_f, float):
        known.p_f = on.cell(on.cell_values(laws.p_f))
    centre = wall_centre(on, point, on.cell(a), theta, known, u)
    solids, rates = step.solids, on.fields(step.deformation)
    slope = on.cell(recorded.cells.gradient(solids.pressure))
    rise = wall_rise(on, on.cell(solids.pressure), slope)
    half = HalfCell.beside(point, centre, rates.shear, rates.dilation, rise)
    return solids_wall(on, point, half, on.cell(viscosity), conductivity)


def assert_systems(
    recorded: RecordedStep, name: str, form: ufl.Form, side: Array, first: int = 0, free: Any = 1
) -> None:
    """The matrix of a transport, and its side less what linear values in the cells carry."""
    name = f"{name}: solve"
    limited = recorded.recorder.calls.get(f"{name}: limit_flux")
    count = 2 if limited else 1
    for i in range(first * count, (first + 1) * count):
        matrix, rhs, _ = recorded.recorder.systems[name][i]
        assert_same_matrix(form, matrix)
        on = recorded.on
        w = ufl.TestFunction(on.scalars)
        beyond = (
            on.assembled(on.out(on.density(limited[i][1]), free * w, "outlet")) if limited else 0.0
        )
        assert_close(side - beyond, rhs)


@pytest.mark.parametrize("kind", TURBULENT)
def test_equations_of_the_turbulence_are_those_of_the_forms(shape: str, kind: str) -> None:
    recorded = recorded_step(shape, kind)
    on, flow = recorded.on, recorded.flow
    x, w = ufl.TrialFunction(on.scalars), ufl.TestFunction(on.scalars)
    given, found = recorded.part("turbulence")
    step, (found, _) = given.step, found
    levels = level_fields(on, step.levels)
    start, at, moved = levels.start, on.fields(step.state), on.fields(step.solids)
    coefficients = turbulence_fields(on, step.turbulence)
    assert list(found)
    for i, name in enumerate(found):
        solids = name.endswith("_s")
        before, after = (s.alpha if solids else 1 - s.alpha for s in (start, at))
        flux = moved.flux if solids else at.total_flux - moved.flux
        density, relative = Density.constant(1.0), on.cell(np.ones(recorded.cells.count))
        if not solids:
            relative = coefficients.relative_density
            if step.gas is not None:
                density = step.gas.density.relative_to(flow.gas.density)
        density = density_fields(on, density)
        held = recorded.recorder.calls["turbulence: solve"][i][0]["prescribed"]
        free, value = np.ones(recorded.cells.count), np.ones(recorded.cells.count)
        if held is not None:
            free[held[0]], value[held[0]] = 0.0, held[1]
        free, value = on.cell(free), on.cell(value)
        sink, gain = turbulence_step(
            coefficients.rate[name],
            coefficients.stiffness[name],
            levels.span,
            start.scales[name],
            levels.predicted.scales[name] if step.levels.previous else None,
        )
        inertia = density.start * present(before)
        spread = present(after) * relative * coefficients.diffusivity[name]
        flux, sink, gain = density.upwind * flux, inertia * sink, inertia * gain
        form = transport(on, x, w, flux, spread, sink, free)
        enters = on.constant(entering(flow, name, recorded.given))
        side = transport_source(on, free * w, flux, gain, enters)
        side += transport(on, (1 - free) * value, w, flux, spread, sink, on.constant(0.0))
        assert_systems(recorded, "turbulence", form, on.assembled(side), i, free)


def entering(flow: UnsteadyFlow, name: str, feed: Inflow) -> float:
    """A scale of what enters."""
    laws, given = flow.problem.closures, flow.problem
    law, phase = (laws.dispersed, "solids") if name.endswith("_s") else (laws.turbulence, "gas")
    intensity = given.solids_intensity if phase == "solids" else given.gas_intensity
    length = given.length_scale * given.diameter
    return float(np.exp(law.estimate(feed.mean_velocity(phase), intensity, length)[f"ln_{name}"]))


# -- momentum -------------------------------------------------------------------------------------


def phases_of(recorded: RecordedStep) -> list[SimpleNamespace]:
    return [phase_fields(recorded.on, phase) for phase in recorded.part("momentum: phases")[1]]


def assert_open_faces(recorded: RecordedStep, found: Array, wanted: Array) -> None:
    """Values of inner faces and of the outlet."""
    where = recorded.line.open > 0
    assert_close(found[where], wanted[where])


def test_forces_on_faces_and_in_cells_are_those_of_the_forms(recorded: RecordedStep) -> None:
    on, v = recorded.on, ufl.TestFunction(recorded.on.vectors)
    given, (gaps, accelerated) = recorded.part("momentum: forces")
    step = given.step
    levels, p = level_fields(on, step.levels), on.cell(step.state.p)
    beta = on.cell(step.drag)
    gravity = on.constant(recorded.flow.problem.gravity)
    ideal = recorded.flow.ideal_gas
    lifted = on.constant(ideal.hydrostatic_density if ideal else recorded.flow.gas.density)
    opened = recorded.line.open > 0
    for phase, gap, a in zip(phases_of(recorded), gaps, accelerated, strict=True):
        force = face_force(on, phase, p, gravity, lifted, recorded.inflow)
        inertia = face_inertia(on, phase, beta, levels.span_faces)
        wanted = on.assembled(face_response(on, v, force, inertia, phase))
        found = on.cell(a)
        form = cell_response(on, found, v, phase, beta, levels.span)
        assert_close(on.assembled(form), wanted)
        if phase.name == "gas":
            mass = phase.density.cells * present(phase.fraction)
            found = found / (1 / levels.span + beta / mass)
        cell = cell_force(on, phase, found, inertia)
        # the gap is a small difference of both
        largest = np.abs(on.values(force)).max()
        assert_close(on.values(force - cell)[opened], gap[opened], largest)


def test_momentum_of_both_phases_is_that_of_the_forms(recorded: RecordedStep) -> None:
    on, cells, w = recorded.on, recorded.cells, ufl.TestFunction(recorded.on.vectors)
    given, _ = recorded.part("momentum: solve")
    step, phases = given.step, phases_of(recorded)
    levels, beta = level_fields(on, step.levels), on.cell(step.drag)
    dragged, sources = on.cell(step.explicit_drag), recorded.inflow.sources
    arrays = np.random.default_rng(2).standard_normal((2, cells.count, 3))
    actions, sides = np.empty_like(arrays), np.empty_like(arrays)
    for k, phase in enumerate(phases):
        u, other = on.cell(arrays[k]), on.cell(arrays[1 - k])
        form = momentum(on, u, w, phase, levels.span, recorded.inflow)
        actions[k] = on.assembled(form + drag(on, u, other, w, beta))
        force = sources.force_s - dragged if phase.name == "solids" else sources.force_g + dragged
        a = on.cell(given.accelerations[k])
        form = momentum_source(on, w, phase, a, force, levels.span, recorded.inflow)
        sides[k] = on.assembled(form)
    known = [(phase.velocity_now, phase.gradient) for phase in given.phases]
    for solve in solves_of(recorded):
        wanted = sides + [lagging(recorded, given, k, *known[k]) for k in range(2)]
        answer = np.empty_like(arrays)
        for components, (matrix, rhs, found) in solve:
            parts = (values[:, :, components].transpose(1, 2, 0) for values in (arrays, actions))
            x, action = (part.ravel() for part in parts)
            assert_close(action, matrix @ x)
            assert_close(wanted[:, :, components].transpose(1, 2, 0).ravel(), rhs)
            answer[:, :, components] = found.reshape(-1, len(components), 2).transpose(2, 0, 1)
        known = [(u, cells.gradient(u)) for u in answer]


def solves_of(recorded: RecordedStep) -> list[list[tuple[list[int], Any]]]:
    """Linear systems of the momentum with their components, for each time that it is solved."""
    normal = recorded.line.normal[recorded.line.impermeable]
    tied = np.abs(normal[:, :, None] * normal[:, None, :]).max(axis=0) > 1e-9
    number, group = sparse.csgraph.connected_components(tied)
    parts = sorted((np.flatnonzero(group == i).tolist() for i in range(number)), key=len)
    systems, rows = recorded.recorder.systems["momentum: solve"], 2 * recorded.cells.owned
    assert [matrix.shape[0] for matrix, *_ in systems[:number]] == [rows * len(p) for p in parts]
    ends = range(0, len(systems), number)
    return [list(zip(parts, systems[i : i + number], strict=True)) for i in ends]


def lagging(
    recorded: RecordedStep, given: SimpleNamespace, k: int, u: Array, gradient: Array
) -> Array:
    """Force on the cells that the matrix does not hold, of a known velocity."""
    on, line, w = recorded.on, recorded.line, ufl.TestFunction(recorded.on.vectors)
    phase = given.phases[k]
    fields = phase_fields(on, phase)
    found = on.assembled(viscous_force(on, w, fields, on.cell(u), on.cell(gradient)))
    flux = given.step.levels.second_order_faces * phase.density.upwind * phase.flux
    beyond = recorded.correction(flux, u, line.velocity_scale, gradient)
    found -= on.assembled(on.out(on.density(beyond), w, "outlet"))
    return found


# -- pressure -------------------------------------------------------------------------------------


def test_projection_is_that_of_the_forms(recorded: RecordedStep) -> None:
    on, x = recorded.on, ufl.TrialFunction(recorded.on.scalars)
    w, v = ufl.TestFunction(on.scalars), ufl.TestFunction(on.vectors)
    given, found = recorded.part("pressure")
    step, (found, _) = given.step, found
    levels, beta = level_fields(on, step.levels), on.cell(step.drag)
    alpha, span = on.cell(step.state.alpha), levels.span_faces
    phases = phases_of(recorded)
    gas = gas_fields(on, step.gas, recorded.given.sources)
    solids, density = phases[0].density.faces, phases[1].density.faces
    response = responses(on, alpha, beta, span, solids, density)
    gaps = [on.face(gap) for gap in given.face_forces]
    guess = [on.cell(u) for u in given.velocities]
    order = on.constant(float(recorded.flow.scheme.solves - 1)) * levels.second_order_faces
    rises = [
        rise_to_outlet(on, u, on.cell(recorded.cells.gradient(array)), order)
        for u, array in zip(guess, given.velocities, strict=True)
    ]
    fluxes = phase_fluxes(on, phases, guess, gaps, response, recorded.inflow, rises)
    followed = follow(on, phases, response, recorded.inflow)
    stiffness = total_of(phases, followed)
    matrix, rhs, change = recorded.recorder.systems["pressure"][-1]
    assert_same_matrix(pressure(on, x, w, stiffness, gas), matrix)
    total = total_of(phases, fluxes)
    form = pressure_source(on, w, total, phases, recorded.inflow, gas)
    assert_close(on.assembled(form), rhs)
    # what the change of the pressure does to fluxes and velocities
    rise = on.rise(on.cell(change), 0)
    flux = on.values(fluxes[0] - followed[0] * rise) * recorded.cells.face_area
    assert_open_faces(recorded, flux, found.solids_flux)
    inner = slice(0, recorded.cells.inner_count)
    flux = on.values(total - stiffness * rise) * recorded.cells.face_area
    assert_close(flux[inner], found.total_flux[inner])
    for u, u_star, part in zip((found.u_s, found.u_g), guess, followed, strict=True):
        wanted = on.assembled(on.least_squares_of(-part * rise, v, "outlet"))
        assert_close(on.assembled(on.least_squares(on.cell(u) - u_star, v)), wanted)
    push = on.rise(on.cell(given.phases[0].pressure)) - phases[0].thermal_rise
    pushed = -response[0][0] * on.weight * push
    assert_close(on.values(pushed) * recorded.cells.face_area, found.pressure_flux)
    assert_close(on.values(response[0][0]), found.response)
    gained = Face.of(ufl.dot, on.mean(on.cell(found.u_s - step.levels.start.u_s)), on.normal) / span
    assert_close(on.values(gained) * recorded.cells.face_area, found.flux_acceleration)


@pytest.mark.parametrize("kind", [kind for kind in FLOWS if kind.startswith("ideal")])
def test_mass_of_an_ideal_gas_is_that_of_the_forms(shape: str, kind: str) -> None:
    recorded = recorded_step(shape, kind)
    on, w, cells = recorded.on, ufl.TestFunction(recorded.on.scalars), recorded.cells
    given, found = recorded.part("ideal gas")
    step, relative = given.step, given.relative
    dt, gas = on.constant(step.dt), recorded.flow.ideal_gas
    now, alpha = on.cell(relative.now), on.cell(step.solids.alpha)
    before = on.cell(step.levels.now.alpha)
    terms = ideal_gas_terms(alpha, before, now, dt, on.constant(gas.reference))
    assert_close(on.assembled(terms[0] * w * on.dx), found.compressibility)
    assert_close(on.assembled(terms[1] * w * on.dx), found.mass_growth)
    outlet = on.face(on.on_part("outlet", gas.outlet_relative_density)).edge
    flux = step.levels.predicted.total_flux - step.solids.step_flux
    still = on.constant(STILL * recorded.line.velocity_scale)
    upwind = upwind_density(on, on.cell(relative.end), on.density(flux), still, outlet)
    scale, toward = cells.to_faces(relative.end)[recorded.line.inner], np.sign(flux)
    beyond = toward * recorded.correction(toward, relative.end, scale)
    # the pressure there is given, and the density with it
    beyond[recorded.line.outlet] = 0.0
    found_density = on.values((upwind + on.face(beyond)) * gas.density)
    assert_open_faces(recorded, found_density, found.density.upwind)


def test_the_pressure_left_out_is_told_as_the_form_has_it() -> None:
    """-sum over the faces of mean(p/Theta) rise(Theta) (S.e)/A [Pa]."""
    recorded = recorded_step("pipe", "four equations")
    on, flow, cells = recorded.on, recorded.flow, recorded.cells
    rise = phases_of(recorded)[0].thermal_rise
    along = Face.of(lambda n: n[2], on.normal)
    form = compile_form((rise * along).inner * on.dS)
    force = cells.comm.allreduce(fem.assemble_scalar(form))
    area = cells.total(recorded.line.volume) / flow.mesh.length
    found = flow.quantities()
    assert found["drop_omitted_pressure"] == pytest.approx(-force / area, rel=1e-10)
    parts = [value for name, value in found.items() if name.startswith("drop_")]
    assert sum(parts) == pytest.approx(found["pressure_drop"], rel=1e-12)
    assert "drop_omitted_pressure" not in recorded_step("pipe", "ideal gas").flow.quantities()


# -- coefficients ---------------------------------------------------------------------------------


def test_coefficients_of_the_solids_are_those_of_the_laws_in_ufl(recorded: RecordedStep) -> None:
    on, point, cells = recorded.on, recorded.point, recorded.cells
    given, (solids, _) = recorded.part("momentum: phases")
    step = given.step
    at, deformation = on.fields(step.state), on.fields(step.deformation)
    laws = solids_coefficients(point, at.alpha, at.theta, deformation, on.cell(step.beta))
    nu_s = 0.0 if step.turbulence is None else step.turbulence.nu_s
    eddies = np.maximum(step.state.alpha, 0) * point.solids.density * nu_s
    assert_close(on.cell_values(laws.viscosity) + eddies, solids.viscosity)
    assert_close(on.cell_values(laws.kinetic.bulk_viscosity), solids.bulk_viscosity)
    friction = wall_of(recorded, step, at.alpha, at.theta, laws, at.u_s, nu_s)[0]
    wall = recorded.line.wall
    height = on.face(on.on_part("wall", recorded.line.wall_height)).edge
    friction += gas_wall(on, recorded.local_point, at, height)[1]
    found = on.values(Face(0, friction), "wall") * cells.face_area
    assert_close(found[wall], solids.wall_friction)


def test_drag_is_that_of_the_law_in_ufl(recorded: RecordedStep) -> None:
    on, point = recorded.on, recorded.local_point
    given, _ = recorded.part("momentum: solve")
    at, (height, _) = on.fields(given.step.state), recorded.profile
    beta, growth = drag_coefficients(point, at.alpha, at.u_g - at.u_s, height)
    assert_close(on.cell_values(beta + growth), given.step.drag)
    slip = at.u_g - at.u_s
    for i in range(3):
        assert_close(on.cell_values(growth * slip[i]), given.step.explicit_drag[:, i])


def test_friction_of_the_gas_is_that_of_the_laws_in_ufl(recorded: RecordedStep) -> None:
    on, line = recorded.on, recorded.line
    given, (_, gas) = recorded.part("momentum: phases")
    at = on.fields(given.step.state)
    height = on.face(on.on_part("wall", line.wall_height)).edge
    friction = (1 - at.alpha) * gas_wall(on, recorded.local_point, at, height)[0]
    found = on.values(Face(0, friction), "wall") * recorded.cells.face_area
    assert_close(found[line.wall], gas.wall_friction)


@pytest.mark.parametrize("kind", [kind for kind in FLOWS if kind not in TURBULENT])
def test_viscosity_of_a_mixing_length_is_that_of_the_law_in_ufl(shape: str, kind: str) -> None:
    recorded = recorded_step(shape, kind)
    on, cells = recorded.on, recorded.cells
    given, (_, gas) = recorded.part("momentum: phases")
    levels, found = given.step.levels, []
    for at in (levels.now, levels.previous or levels.now):
        gradient = on.cell(cells.gradient(at.u_g))
        found.append(on.cell_values(gas_viscosity(recorded.point, gradient, recorded.profile)))
    viscosity = levels.extrapolate(*found) if levels.previous else found[0]
    assert_close((1 - given.step.state.alpha) * viscosity, gas.viscosity)


def test_corrections_of_the_momentum_are_those_of_the_forms(recorded: RecordedStep) -> None:
    on, point, cells = recorded.on, recorded.point, recorded.cells
    given, phases = recorded.part("momentum: phases")
    step = given.step
    levels, volume = level_fields(on, step.levels), on.cell(cells.volume)
    void, inner = 1 - step.state.alpha, slice(0, cells.inner_count)
    viscosity = phases[1].viscosity - void * point.gas.viscosity
    lagging = phases[0].bulk_viscosity, np.maximum(viscosity, 0.0)
    masses = (
        point.solids.density * np.maximum(step.levels.start.alpha, SMALLEST_FRACTION),
        void * point.gas.density,
    )
    for phase, viscosity, mass in zip(phases, lagging, masses, strict=True):
        if phase.implicit_correction is not None:
            span = levels.span_faces
            args = on_faces(on, phase, on.cell(viscosity)), on.cell(mass), volume, span
            found = on.values(implicit_correction(on, *args)) * cells.face_area
            assert_close(found[inner], phase.implicit_correction[inner])
    if phases[1].dispersion_force is not None:
        alpha = on.cell(step.state.alpha)
        carried = on.face(phases[0].face_fraction)
        force = dispersion_force(on, on.cell(step.turbulence.dispersion), alpha, carried)
        found = on.values(force)
        assert_close(found, phases[1].dispersion_force)
        assert_close(-found, phases[0].dispersion_force)


# -- turbulence of a state ------------------------------------------------------------------------


@pytest.mark.parametrize("kind", TURBULENT)
def test_turbulence_of_a_state_is_that_of_the_laws_in_ufl(shape: str, kind: str) -> None:
    recorded = recorded_step(shape, kind)
    on, cells, line, point = recorded.on, recorded.cells, recorded.line, recorded.local_point
    given, found = recorded.part("eddies")
    at, (height, slope) = on.fields(given.levels.predicted), recorded.profile
    eddies = wall_eddies_of(recorded, at, given.levels.predicted)
    gas = point.gas_eddies(eddies)
    of_solids = None
    if "k_s" in found.rate:
        gradient = mirrored_gradient(recorded, cells.gradient(given.levels.predicted.u_s))
        scales = at.scales["k_s"], at.scales["eps_s"]
        distance = on.cell(line.wall_distance)
        of_solids = point.eddies(Invariants(gradient), distance, 1.0, *scales)
    crowding = on.cell(cells.gradient(given.levels.predicted.alpha))
    size = on.cell(cells.volume ** (1 / 3))
    grains = dispersed_solids(point, at, crowding, size, height, of_solids)
    law = point.closures.dispersed
    nu_s = point.solids_eddy_viscosity(gas, grains, slope)
    wanted = {"mu_t": found.mu_t, "nu_s": found.nu_s}
    values = {"mu_t": gas.nu * point.gas.density, "nu_s": nu_s}
    if found.dispersion is not None:
        values["dispersion"] = point.dispersion(gas, grains, nu_s)
        values["drag"] = grains.specific * grains.alpha
        wanted |= {"dispersion": found.dispersion, "drag": found.drag}
    balances = point.gas_balances(eddies, gas, grains) | law.balances(gas, grains)
    for logarithm, balance in balances.items():
        name = logarithm.removeprefix("ln_")
        stretch = 1.0 if name.endswith("_s") else slope
        values[f"rate {name}"] = balance.rate * stretch
        values[f"diffusivity {name}"] = balance.diffusivity / stretch
        wanted |= {
            f"rate {name}": found.rate[name],
            f"diffusivity {name}": found.diffusivity[name],
        }
    names = list(wanted)
    for i in range(0, len(names), 3):
        chosen = (names[i : i + 3] * 3)[:3]
        together = on.cell_values(ufl.as_vector([values[name] for name in chosen]))
        for k, name in enumerate(chosen):
            assert_close(together[:, k], np.broadcast_to(wanted[name], cells.count))


def mirrored_gradient(recorded: RecordedStep, gradient: Array) -> Any:
    """Gradient of a velocity beside planes of symmetry, in UFL."""
    on = recorded.on
    lost = on.assembled(mirrored(on, on.cell(gradient), ufl.TestFunction(on.tensors)))
    return on.cell(gradient - lost.reshape(-1, 3, 3))


def wall_eddies_of(recorded: RecordedStep, at: SimpleNamespace, predicted: State) -> Eddies:
    """Eddies of the gas, in cells of the wall with its traction."""
    on, line, point = recorded.on, recorded.line, recorded.local_point
    gradient = mirrored_gradient(recorded, recorded.cells.gradient(predicted.u_g))
    scales = at.scales["k"], at.scales["eps"]
    eddies = point.eddies(Invariants(gradient), *recorded.profile, *scales)
    slip = point.speed(at.u_g - at.u_s)
    eddies = point.laden(eddies, present(at.alpha), slip, recorded.profile[0])
    height = on.face(on.on_part("wall", line.wall_height)).edge
    friction, _ = gas_wall(on, point, at, height)
    w = ufl.TestFunction(on.scalars)
    squares = on.assembled(wall_tractions(on, friction, at.u_g, point, w))
    traction = on.cell(np.sqrt(squares))
    strain = on.cell(on.cell_values(eddies.strain))
    spin, slope = (on.cell(on.cell_values(value)) for value in (eddies.spin, eddies.A_s))
    eddies = replace(eddies, strain=strain, spin=spin, A_s=slope)
    inner = wall_eddies(point, eddies, traction)
    strain = ufl.conditional(ufl.gt(traction, 0), inner.strain, strain)
    strain = on.cell(on.cell_values(strain))
    return replace(eddies, strain=strain, spin=spin * strain / eddies.strain)

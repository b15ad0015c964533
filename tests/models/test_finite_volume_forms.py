# SPDX-License-Identifier: LGPL-3.0-or-later
"""The arrays of one unsteady step against its DG0 forms in UFL, assembled by DOLFINx."""

from __future__ import annotations

import inspect
import math
from dataclasses import dataclass, field, replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sparse
import ufl
from dolfinx import fem

from fem_tfm import Case
from fem_tfm.closures.turbulence.gas import Eddies
from fem_tfm.fenics import compile_form
from fem_tfm.models.finite_volume import Inflow, UnsteadyFlow, fraction
from fem_tfm.models.finite_volume.cells import transport
from fem_tfm.models.finite_volume.cells.krylov import Krylov
from fem_tfm.models.finite_volume.cells.mesh import Array
from fem_tfm.models.finite_volume.specification import forms
from fem_tfm.models.finite_volume.specification.facets import PARTS, Face, FacetForms
from fem_tfm.models.finite_volume.state import (
    SMALLEST_FRACTION,
    Density,
    Sources,
    State,
)
from fem_tfm.models.pointwise import Invariants, Pointwise

# largest difference over the largest entry
CLOSE = 1e-12
DT = 2e-4

COAL = {
    "gas": {"density": 33.5, "viscosity": 1.8e-5},
    "solids": {"density": 1700.0, "diameter": 1.6e-4, "restitution": 0.7},
    "operation": {
        "gas_superficial_velocity": 6.43,
        "solids_fraction": 0.2,
        "solids_velocity": 6.0,
    },
    "solution": "unsteady",
    "closures": {"drag": "three-zone", "friction": "berzi", "turbulence": "mixing-length"},
    "walls": {"gas": "log-law", "solids": "schneiderbauer"},
    "inlet": {"profile": "power-law"},
    "numerics": {"end_time": 1.0},
}
SHAPES: dict[str, dict[str, Any]] = {
    "pipe": {"shape": "pipe", "diameter": 0.01, "length": 0.03},
    "bend": {
        "shape": "bend",
        "diameter": 0.01,
        "length": 0.147,
        "bend_radius": 0.03,
        "bend_angle_deg": 90.0,
        "bend_start": 0.05,
        "bend_towards": "up",
    },
    "sheared": {"shape": "duct", "width": 0.01, "height": 0.01, "length": 0.03},
}
FLOWS: dict[str, dict[str, Any]] = {
    "mixing length": {"numerics.order": 0},
    "mixing length, blocked outlet": {"numerics.order": 1},
    "four equations": {
        "numerics.order": 1,
        "closures.turbulence": "realizable",
        "closures.dispersed": {"model": "k-epsilon", "normal_stress": 1.0},
        "closures.dispersion": "burns",
        "walls.gas": "log-law-k",
    },
    "ideal gas": {
        "numerics.order": 1,
        "gas": {"species": "N2", "pressure": 2.92e6, "viscosity": 1.8e-5, "compressible": True},
        "closures.turbulence": "k-epsilon",
        "closures.dispersed": "simonin",
    },
    "ideal gas, first order": {
        "numerics.order": 0,
        "gas": {"species": "N2", "pressure": 2.92e6, "viscosity": 1.8e-5, "compressible": True},
        "closures.turbulence": "k-epsilon",
        "closures.dispersed": "simonin",
    },
}
TURBULENT = [kind for kind, changes in FLOWS.items() if "closures.turbulence" in changes]


@dataclass
class Recorder:
    """What the parts of a step were given and have given back, and their linear systems.

    calls : arguments and result of each call of a method, by a name
    systems : matrix, right-hand side and solution of each linear solve within it
    """

    calls: dict[str, list[tuple[dict[str, Any], Any]]] = field(default_factory=dict)
    systems: dict[str, list[tuple[sparse.csr_array, Array, Array]]] = field(default_factory=dict)
    _within: list[str] = field(default_factory=list)

    def watch(self, patch: pytest.MonkeyPatch, owner: Any, method: str, name: str = "") -> None:
        """Keep the calls of a function; without a name by that of the part that calls it."""
        run, signature = getattr(owner, method), inspect.signature(getattr(owner, method))

        def watched(*args: Any, **kwargs: Any) -> Any:
            self._within.append(name or f"{self._within[-1]}: {method}")
            found = run(*args, **kwargs)
            given = dict(signature.bind(*args, **kwargs).arguments)
            self.calls.setdefault(self._within.pop(), []).append((given, found))
            return found

        patch.setattr(owner, method, watched)

    def watch_solvers(self, patch: pytest.MonkeyPatch) -> None:
        """Keep all linear systems."""
        solve = Krylov.solve

        def watched(krylov: Krylov, rhs: Array, *args: Any) -> Array:
            start, columns, values = krylov.matrix.matrix.getValuesCSR()
            matrix = sparse.csr_array((values.copy(), columns, start))
            found = solve(krylov, rhs, *args)
            self.systems.setdefault(self._within[-1], []).append((matrix, rhs.copy(), found))
            return found

        patch.setattr(Krylov, "solve", watched)


class Observed:
    """A flow on a mesh, and all that one of its steps has handed on, as arrays and in UFL."""

    def __init__(self, shape: str, kind: str) -> None:
        self.flow = flow = flowing(shape, kind)
        self.line, self.cells, self.on = flow.line, flow.cells, FacetForms(flow.cells)
        given = Inflow(6.43, 0.2, 6.0, sources=sources(flow))
        for _ in range(2):
            flow.advance(DT, given)
        feed = replace(given, blocked="blocked" in kind)
        self.recorder = recorder = Recorder()
        with pytest.MonkeyPatch.context() as patch:
            recorder.watch_solvers(patch)
            for part in ("fraction", "temperature", "turbulence"):
                if getattr(flow, part):
                    recorder.watch(patch, getattr(flow, part), "solve", part)
            for method in ("phases", "forces", "solve"):
                recorder.watch(patch, flow.momentum, method, f"momentum: {method}")
            for part in (flow.temperature, flow.turbulence):
                if part:
                    recorder.watch(patch, part.transport, "solve")
            if flow.turbulence:
                recorder.watch(patch, flow.turbulence, "coefficients", "eddies")
            recorder.watch(patch, flow.pressure, "project", "pressure")
            recorder.watch(patch, flow.laws, "solids_pressure")
            for module in (fraction, transport):
                recorder.watch(patch, module, "limit_flux")
            if flow.ideal_gas:
                recorder.watch(patch, flow.ideal_gas, "balance", "ideal gas")
            flow.advance(DT, feed)
        self.point = flow.problem.pointwise()
        self.feed, self.inflow = feed, forms.inflow_fields(self.on, feed, flow.line)

    def call(self, name: str) -> tuple[SimpleNamespace, Any]:
        """Arguments and result of the last call of a part."""
        given, found = self.recorder.calls[name][-1]
        return SimpleNamespace(**given), found

    @property
    def profile(self) -> tuple[Any, Any]:
        """Height of the gas's profile and its stretching, in UFL."""
        height, slope = (self.on.cell(values) for values in self.line.gas_profile)
        return height, slope

    @property
    def local_point(self) -> Pointwise:
        """The laws at a point, with the density of the gas of the step."""
        if not self.flow.ideal_gas:
            return self.point
        return self.point.with_density(self.on.cell(self.call("ideal gas")[1].relative_density))


def flowing(shape: str, kind: str) -> UnsteadyFlow:
    """A flow with smooth random fields."""
    axial = {"pipe": 8, "bend": 12, "sheared": 8}[shape]
    changes = {"numerics.axial_cells": axial, "numerics.level": 1}
    given = Case.from_dict({**COAL, "geometry": SHAPES[shape]}).with_values(changes | FLOWS[kind])
    mesh = given.scene.mesh()
    if shape == "sheared":
        x = mesh.mesh.geometry.x
        x[:, 1] += math.tan(math.radians(30.0)) * x[:, 2]
    flow = UnsteadyFlow(given.scene.problem(), mesh)
    random = np.random.default_rng(1)
    place = flow.cells.centre / 0.01

    def smooth(*shape: int) -> Array:
        """Waves of random directions, between -1 and 1."""
        found = np.zeros((flow.cells.count, *shape))
        for index in np.ndindex(*shape):
            found[:, *index] = np.sin(place @ random.uniform(-1, 1, 3) * 3 + random.uniform(0, 6))
        return found

    flow.initialise(0.3 + 0.25 * smooth(), 0.05 * np.exp(smooth()), 500 * smooth())
    axis = flow.mesh.axis(flow.cells.centre)
    flow.set_velocities(4.0 * axis + smooth(3), 6.0 * axis + 2.0 * smooth(3))
    return flow


def sources(flow: UnsteadyFlow) -> Sources:
    """Volumes, forces and energy that come into every cell."""
    owned = flow.cells.owned
    wave = np.sin(np.arange(owned))
    force = 50 * np.stack([wave, wave**2, 1 - wave], axis=1)
    return Sources(0.1 * wave, 0.2 * wave**2, force, -force, 100 * wave)


observed = cache(Observed)


@pytest.fixture(params=SHAPES)
def shape(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(params=FLOWS)
def step(shape: str, request: pytest.FixtureRequest) -> Observed:
    return observed(shape, request.param)


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


def open_faces(step: Observed) -> Array:
    """Inner faces and those of the outlet."""
    return step.line.open > 0


# -- geometry -------------------------------------------------------------------------------------


def test_geometry_of_faces_is_that_of_the_forms(shape: str) -> None:
    step = observed(shape, "mixing length")
    on, cells = step.on, step.cells
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
    step = observed(shape, "mixing length")
    on, cells, line = step.on, step.cells, step.line
    v = ufl.TestFunction(on.vectors)
    q = np.sin(cells.centre @ np.array([300.0, 200.0, -100.0]))
    wanted = on.assembled(on.gradient_of(on.cell(q), v))
    assert_close(on.assembled(on.gradient(on.cell(cells.gradient(q)), v)), wanted)
    normal = np.cos(np.arange(cells.face_count))
    wanted = on.assembled(on.least_squares_of(on.face(normal), v, *PARTS[1:]))
    found = on.cell(line.reconstruct(normal))
    assert_close(on.assembled(on.least_squares(found, v)), wanted)


# -- solids fraction ------------------------------------------------------------------------------


def acceleration_shares(step: Observed, given: SimpleNamespace, spread: Face) -> Face:
    """Share of the acceleration of inner faces that is carried on, from sums over faces in UFL."""
    on, cells, laws = step.on, step.cells, step.flow.laws
    w, limit = ufl.TestFunction(on.scalars), laws.solids.packing_limit
    pressures = step.recorder.calls["fraction: solids_pressure"]
    alpha, p_s, risen = pressures[0][0]["alpha"], pressures[0][1], pressures[1][1]
    odds = alpha / (limit - alpha)
    slope = np.maximum((risen - p_s) / (1e-7 * (1 + odds)), 0.0)
    rate = cells.volume / given.dt
    push = on.face(given.levels.flux_weight * given.response) * on.weight
    sound = on.assembled(on.both(push, w)) / rate * slope * alpha * (1 + odds) ** 2 / limit
    sound, wide = on.cell(sound), on.cell(on.assembled(on.both(spread, w)) / rate)
    return forms.acceleration_share(sound, wide, on.face(given.levels.acceleration_share))


def test_residual_of_the_solids_fraction_is_that_of_the_form(step: Observed) -> None:
    on, w = step.on, ufl.TestFunction(step.on.scalars)
    given, found = step.call("fraction")
    levels = forms.level_fields(on, given.levels)
    turbulence = forms.turbulence_fields(on, given.coefficients)
    alpha, span = levels.now.alpha, levels.span_faces
    spread = forms.dispersion_response(on, step.point, alpha, turbulence, span)
    share = acceleration_shares(step, given, spread)
    flux = forms.predicted_flux(on, levels, share, spread)
    pressures = step.recorder.calls["fraction: solids_pressure"]
    beyond = step.recorder.calls.get("fraction: limit_flux", [])
    systems = step.recorder.systems["fraction"]
    theta, deformation = levels.predicted.theta, on.fields(given.deformation)
    lift = on.cell(pressures[0][0].get("lift", 0.0) + np.zeros(step.cells.count))
    assert len(systems) > 1
    for i, (_, rhs, _) in enumerate(systems):
        alpha = on.cell(pressures[2 * i][0]["alpha"])
        p_s = forms.solids_pressure(step.point, alpha, theta, deformation, lift)
        more = beyond[min(i, len(beyond) - 1)][1] if beyond else np.zeros(step.cells.face_count)
        through = forms.solids_flux(on, flux, alpha, p_s, on.face(given.response), spread)
        form = forms.solids_fraction(
            on, w, alpha, through, on.constant(given.dt), levels, step.inflow, on.density(more)
        )
        assert_close(on.assembled(form), -rhs, step.cells.volume.max() / given.dt)
    # the answer is what these fluxes leave, whatever Newton's method has left of the residual
    passed = on.out(on.density(found.step_flux), w, *PARTS) - on.cell(found.step_source) * w * on.dx
    change = (on.cell(found.alpha) - levels.start.alpha) / on.constant(given.dt) * w * on.dx
    assert_close(on.assembled(change), -on.assembled(passed))


# -- granular temperature and turbulence ----------------------------------------------------------


def test_equation_of_the_granular_temperature_is_that_of_the_form(step: Observed) -> None:
    on, point = step.on, step.point
    x, w = ufl.TrialFunction(on.scalars), ufl.TestFunction(on.scalars)
    given, _ = step.call("temperature")
    levels, beta = forms.level_fields(on, given.levels), on.cell(given.beta)
    moved, old = on.fields(given.transported), on.fields(given.old)
    start, deformation = on.fields(given.start), on.fields(given.deformation)
    dilation = forms.energy_dilation(moved, deformation, levels, step.line.order)
    deformation = SimpleNamespace(shear=deformation.shear, dilation=dilation)
    laws = forms.solids_coefficients(point, moved.alpha, old.theta, deformation)
    energy = point.granular_energy(laws, old.theta, deformation.shear, dilation, beta)
    more, density = step.inflow.sources.energy, on.constant(point.solids.density)
    sink, gain = forms.temperature_sources(
        energy, density, start.alpha, old.theta, start.theta, levels.span, more
    )
    heat = forms.solids_wall(on, point, moved.alpha, old.theta, laws, old.u_s)[1]
    falls, comes = forms.wall_heat(on, old.theta, heat, x, w)
    flux = 1.5 * density * moved.flux
    form = (
        forms.transport(on, x, w, flux, laws.kinetic.conductivity, sink, on.constant(1.0)) + falls
    )
    entering = (on.constant(step.flow.problem.solids_intensity) * step.inflow.solids_velocity) ** 2
    side = on.assembled(forms.transport_source(on, w, flux, gain, entering) + comes)
    assert_systems(step, "temperature", form, side)


def assert_systems(
    step: Observed, name: str, form: ufl.Form, side: Array, first: int = 0, free: Any = 1
) -> None:
    """The matrix of a transport, and its side less what linear values in the cells carry."""
    name = f"{name}: solve"
    limited = step.recorder.calls.get(f"{name}: limit_flux")
    count = 2 if limited else 1
    for i in range(first * count, (first + 1) * count):
        matrix, rhs, _ = step.recorder.systems[name][i]
        assert_same_matrix(form, matrix)
        on = step.on
        w = ufl.TestFunction(on.scalars)
        beyond = on.assembled(on.out(on.density(limited[i][1]), free * w)) if limited else 0.0
        assert_close(side - beyond, rhs)


@pytest.mark.parametrize("kind", TURBULENT)
def test_equations_of_the_turbulence_are_those_of_the_forms(shape: str, kind: str) -> None:
    step = observed(shape, kind)
    on, flow = step.on, step.flow
    x, w = ufl.TrialFunction(on.scalars), ufl.TestFunction(on.scalars)
    given, found = step.call("turbulence")
    levels = forms.level_fields(on, given.levels)
    start, at, moved = on.fields(given.start), on.fields(given.at), on.fields(given.transported)
    coefficients = forms.turbulence_fields(on, given.coefficients)
    assert list(found)
    for i, name in enumerate(found):
        solids = name.endswith("_s")
        before, after = (s.alpha if solids else 1 - s.alpha for s in (start, at))
        flux = moved.flux if solids else at.total_flux - moved.flux
        density, relative = Density.constant(1.0), on.cell(np.ones(step.cells.count))
        if not solids:
            relative = coefficients.relative_density
            if given.gas_balance is not None:
                density = given.gas_balance.density.relative_to(flow.gas.density)
        density = forms.density_fields(on, density)
        held = step.recorder.calls["turbulence: solve"][i][0]["held"]
        free, value = np.ones(step.cells.count), np.ones(step.cells.count)
        if held is not None:
            free[held[0]], value[held[0]] = 0.0, held[1]
        free, value = on.cell(free), on.cell(value)
        sink, gain = forms.turbulence_step(
            coefficients.rate[name],
            coefficients.stiffness[name],
            levels.span,
            start.scales[name],
            levels.predicted.scales[name] if given.levels.previous else None,
        )
        inertia = density.start * forms.present(before)
        spread = forms.present(after) * relative * coefficients.diffusivity[name]
        flux, sink, gain = density.upwind * flux, inertia * sink, inertia * gain
        form = forms.transport(on, x, w, flux, spread, sink, free)
        enters = on.constant(entering(flow, name, step.feed))
        side = forms.transport_source(on, free * w, flux, gain, enters)
        side += forms.transport(on, (1 - free) * value, w, flux, spread, sink, on.constant(0.0))
        assert_systems(step, "turbulence", form, on.assembled(side), i, free)


def entering(flow: UnsteadyFlow, name: str, feed: Inflow) -> float:
    """A scale of what enters."""
    laws, given = flow.problem.closures, flow.problem
    law, phase = (laws.dispersed, "solids") if name.endswith("_s") else (laws.turbulence, "gas")
    intensity = given.solids_intensity if phase == "solids" else given.gas_intensity
    length = given.length_scale * given.diameter
    return float(np.exp(law.estimate(feed.mean_velocity(phase), intensity, length)[f"ln_{name}"]))


# -- momentum -------------------------------------------------------------------------------------


def phases_of(step: Observed) -> list[SimpleNamespace]:
    return [forms.phase_fields(step.on, phase) for phase in step.call("momentum: phases")[1]]


def assert_open_faces(step: Observed, found: Array, wanted: Array) -> None:
    """Values of inner faces and of the outlet."""
    where = step.line.open > 0
    assert_close(found[where], wanted[where])


def test_forces_on_faces_and_in_cells_are_those_of_the_forms(step: Observed) -> None:
    on, v = step.on, ufl.TestFunction(step.on.vectors)
    given, (gaps, accelerated) = step.call("momentum: forces")
    levels, p, beta = (
        forms.level_fields(on, given.levels),
        on.cell(given.at.p),
        on.cell(given.beta),
    )
    gravity = on.constant(step.flow.problem.gravity)
    ideal = step.flow.ideal_gas
    lifted = on.constant(ideal.hydrostatic_density if ideal else step.flow.gas.density)
    opened = step.line.open > 0
    for phase, gap, a in zip(phases_of(step), gaps, accelerated, strict=True):
        force = forms.face_force(on, phase, p, gravity, lifted, step.inflow)
        inertia = forms.face_inertia(on, phase, beta, levels.span_faces)
        wanted = on.assembled(forms.face_response(on, v, force, inertia, phase))
        found = on.cell(a)
        form = forms.cell_response(on, found, v, phase, beta, levels.span)
        assert_close(on.assembled(form), wanted)
        if phase.name == "gas":
            mass = phase.density.cells * forms.present(phase.fraction)
            found = found / (1 / levels.span + beta / mass)
        cell = forms.cell_force(on, phase, found, inertia)
        # the gap is a small difference of both
        largest = np.abs(on.values(force)).max()
        assert_close(on.values(force - cell)[opened], gap[opened], largest)


def test_momentum_of_both_phases_is_that_of_the_forms(step: Observed) -> None:
    on, cells, w = step.on, step.cells, ufl.TestFunction(step.on.vectors)
    given, _ = step.call("momentum: solve")
    levels, beta = forms.level_fields(on, given.levels), on.cell(given.beta)
    dragged, sources, phases = on.cell(given.dragged), step.inflow.sources, phases_of(step)
    arrays = np.random.default_rng(2).standard_normal((2, cells.count, 3))
    actions, sides = np.empty_like(arrays), np.empty_like(arrays)
    for k, phase in enumerate(phases):
        u, other = on.cell(arrays[k]), on.cell(arrays[1 - k])
        form = forms.momentum(on, u, w, phase, levels.span, step.inflow)
        actions[k] = on.assembled(form + forms.drag(on, u, other, w, beta))
        force = sources.force_s - dragged if phase.name == "solids" else sources.force_g + dragged
        a = on.cell(given.accelerated[k])
        form = forms.momentum_source(on, w, phase, a, force, levels.span, step.inflow)
        sides[k] = on.assembled(form)
    known = [(phase.velocity_now, phase.gradient) for phase in given.phases]
    for solve in solves_of(step):
        wanted = sides + [lagging(step, given, k, *known[k]) for k in range(2)]
        answer = np.empty_like(arrays)
        for components, (matrix, rhs, found) in solve:
            parts = (values[:, :, components].transpose(1, 2, 0) for values in (arrays, actions))
            x, action = (part.ravel() for part in parts)
            assert_close(action, matrix @ x)
            assert_close(wanted[:, :, components].transpose(1, 2, 0).ravel(), rhs)
            answer[:, :, components] = found.reshape(-1, len(components), 2).transpose(2, 0, 1)
        known = [(u, cells.gradient(u)) for u in answer]


def solves_of(step: Observed) -> list[list[tuple[list[int], Any]]]:
    """Linear systems of the momentum with their components, for each time that it is solved."""
    normal = step.line.normal[step.line.impermeable]
    tied = np.abs(normal[:, :, None] * normal[:, None, :]).max(axis=0) > 1e-9
    number, group = sparse.csgraph.connected_components(tied)
    parts = sorted((np.flatnonzero(group == i).tolist() for i in range(number)), key=len)
    systems, rows = step.recorder.systems["momentum: solve"], 2 * step.cells.owned
    assert [matrix.shape[0] for matrix, *_ in systems[:number]] == [rows * len(p) for p in parts]
    ends = range(0, len(systems), number)
    return [list(zip(parts, systems[i : i + number], strict=True)) for i in ends]


def lagging(step: Observed, given: SimpleNamespace, k: int, u: Array, gradient: Array) -> Array:
    """Force on the cells that the matrix does not hold, of a known velocity."""
    on, line, w = step.on, step.line, ufl.TestFunction(step.on.vectors)
    phase = given.phases[k]
    fields = forms.phase_fields(on, phase)
    found = on.assembled(forms.viscous_force(on, w, fields, on.cell(u), on.cell(gradient)))
    if line.order:
        flux = given.levels.second_order_faces * phase.density.upwind * phase.flux
        beyond = line.second_order_flux(flux, u, line.velocity_scale, gradient)
        found -= on.assembled(on.out(on.density(beyond), w))
    return found


# -- pressure -------------------------------------------------------------------------------------


def test_projection_is_that_of_the_forms(step: Observed) -> None:
    on, x = step.on, ufl.TrialFunction(step.on.scalars)
    w, v = ufl.TestFunction(on.scalars), ufl.TestFunction(on.vectors)
    given, found = step.call("pressure")
    span = on.face(np.broadcast_to(given.dt, step.cells.face_count))
    alpha, beta = on.cell(given.at.alpha), on.cell(given.beta)
    phases = phases_of(step)
    gas = forms.gas_fields(on, given.gas_balance, step.feed.sources)
    solids, density = phases[0].density.faces, phases[1].density.faces
    response = forms.responses(on, alpha, beta, span, solids, density)
    gaps, guess = [on.face(gap) for gap in given.gaps], [on.cell(u) for u in given.guess]
    fluxes = forms.phase_fluxes(on, phases, guess, gaps, response, step.inflow)
    follow = forms.follow(on, phases, response, step.inflow)
    stiffness = forms.total_of(phases, follow)
    matrix, rhs, change = step.recorder.systems["pressure"][-1]
    assert_same_matrix(forms.pressure(on, x, w, stiffness, gas), matrix)
    total = forms.total_of(phases, fluxes)
    form = forms.pressure_source(on, w, total, phases, step.inflow, gas)
    assert_close(on.assembled(form), rhs)
    # what the change of the pressure does to fluxes and velocities
    rise = on.rise(on.cell(change), 0)
    flux = on.values(fluxes[0] - follow[0] * rise) * step.cells.face_area
    assert_open_faces(step, flux, found.solids_flux)
    inner = slice(0, step.cells.inner_count)
    flux = on.values(total - stiffness * rise) * step.cells.face_area
    assert_close(flux[inner], found.total_flux[inner])
    for u, u_star, part in zip((found.u_s, found.u_g), guess, follow, strict=True):
        wanted = on.assembled(on.least_squares_of(-part * rise, v, "outlet"))
        assert_close(on.assembled(on.least_squares(on.cell(u) - u_star, v)), wanted)
    p_s = given.phases[0].pressure
    pushed = -response[0][0] * on.weight * on.rise(on.cell(p_s))
    assert_close(on.values(pushed) * step.cells.face_area, found.pressure_flux)
    assert_close(on.values(response[0][0]), found.response)
    gained = Face.of(ufl.dot, on.mean(on.cell(found.u_s - given.at.u_s)), on.normal) / span
    assert_close(on.values(gained) * step.cells.face_area, found.flux_acceleration)


@pytest.mark.parametrize("kind", [kind for kind in FLOWS if kind.startswith("ideal")])
def test_mass_of_an_ideal_gas_is_that_of_the_forms(shape: str, kind: str) -> None:
    step = observed(shape, kind)
    on, w, cells = step.on, ufl.TestFunction(step.on.scalars), step.cells
    given, found = step.call("ideal gas")
    dt, gas = on.constant(given.dt), step.flow.ideal_gas
    now, alpha = on.cell(given.relative_density.now), on.cell(given.transported.alpha)
    before = on.cell(given.levels.now.alpha)
    terms = forms.ideal_gas_terms(alpha, before, now, dt, on.constant(gas.reference))
    assert_close(on.assembled(terms[0] * w * on.dx), found.compressibility)
    assert_close(on.assembled(terms[1] * w * on.dx), found.mass_growth)
    end, outlet = (
        on.cell(given.relative_density.end),
        on.face(on.on_part("outlet", gas.outlet_relative_density)),
    )
    flux = given.levels.predicted.total_flux - given.transported.step_flux
    still = on.constant(1e-12 * step.line.velocity_scale)
    upwind = forms.upwind_density(on, end, on.density(flux), still, outlet.edge)
    beyond = np.zeros(cells.face_count)
    if step.line.order:
        values, gradient = given.relative_density.end, cells.gradient(given.relative_density.end)
        scale = cells.to_faces(values)[step.line.inner]
        toward = np.sign(flux)
        beyond = toward * step.line.second_order_flux(toward, values, scale, gradient)
    found_density = on.values((upwind + on.face(beyond)) * gas.density)
    assert_open_faces(step, found_density, found.density.upwind)


# -- coefficients ---------------------------------------------------------------------------------


def test_coefficients_of_the_solids_are_those_of_the_laws_in_ufl(step: Observed) -> None:
    on, point, cells = step.on, step.point, step.cells
    given, (solids, _) = step.call("momentum: phases")
    at, deformation = on.fields(given.at), on.fields(given.deformation)
    laws = forms.solids_coefficients(point, at.alpha, at.theta, deformation)
    nu_s = 0.0 if given.coefficients is None else given.coefficients.nu_s
    eddies = np.maximum(given.at.alpha, 0) * point.solids.density * nu_s
    assert_close(on.cell_values(laws.viscosity) + eddies, solids.viscosity)
    assert_close(on.cell_values(laws.kinetic.bulk_viscosity), solids.bulk_viscosity)
    friction = forms.solids_wall(on, point, at.alpha, at.theta, laws, at.u_s)[0]
    wall = step.line.wall
    found = on.values(Face(0, friction), "wall") * cells.face_area
    assert_close(found[wall], solids.wall_friction)


def test_drag_is_that_of_the_law_in_ufl(step: Observed) -> None:
    on, point = step.on, step.local_point
    given, _ = step.call("momentum: solve")
    at, (height, _) = on.fields(step.call("momentum: phases")[0].at), step.profile
    beta, growth = forms.drag_coefficients(point, at.alpha, at.u_g - at.u_s, height)
    assert_close(on.cell_values(beta + growth), given.beta)
    slip = at.u_g - at.u_s
    for i in range(3):
        assert_close(on.cell_values(growth * slip[i]), given.dragged[:, i])


def test_friction_of_the_gas_is_that_of_the_laws_in_ufl(step: Observed) -> None:
    on, line = step.on, step.line
    given, (_, gas) = step.call("momentum: phases")
    at = on.fields(given.at)
    height = on.face(on.on_part("wall", line.wall_height)).edge
    k = at.scales.get("k")
    friction = forms.gas_wall(on, step.local_point, 1 - at.alpha, at.u_g, height, k)
    found = on.values(Face(0, friction), "wall") * step.cells.face_area
    assert_close(found[line.wall], gas.wall_friction)


@pytest.mark.parametrize("kind", [kind for kind in FLOWS if kind not in TURBULENT])
def test_viscosity_of_a_mixing_length_is_that_of_the_law_in_ufl(shape: str, kind: str) -> None:
    step = observed(shape, kind)
    on, cells = step.on, step.cells
    given, (_, gas) = step.call("momentum: phases")
    levels, found = given.levels, []
    for at in (levels.now, levels.previous or levels.now):
        gradient = on.cell(cells.gradient(at.u_g))
        found.append(on.cell_values(forms.gas_viscosity(step.point, gradient, step.profile)))
    viscosity = levels.extrapolate(*found) if levels.previous else found[0]
    assert_close((1 - given.at.alpha) * viscosity, gas.viscosity)


def test_corrections_of_the_momentum_are_those_of_the_forms(step: Observed) -> None:
    on, point, cells = step.on, step.point, step.cells
    given, phases = step.call("momentum: phases")
    levels, volume = forms.level_fields(on, given.levels), on.cell(cells.volume)
    void, inner = 1 - given.at.alpha, slice(0, cells.inner_count)
    viscosity = phases[1].viscosity - void * point.gas.viscosity
    lagging = phases[0].bulk_viscosity, np.maximum(viscosity, 0.0)
    masses = (
        point.solids.density * np.maximum(given.start.alpha, SMALLEST_FRACTION),
        void * point.gas.density,
    )
    for phase, viscosity, mass in zip(phases, lagging, masses, strict=True):
        if phase.implicit_correction is not None:
            span = levels.span_faces
            args = on.cell(viscosity), on.cell(mass), volume, span
            found = on.values(forms.implicit_correction(on, *args)) * cells.face_area
            assert_close(found[inner], phase.implicit_correction[inner])
    if phases[1].dispersion_force is not None:
        alpha = on.cell(given.at.alpha)
        force = forms.dispersion_force(on, on.cell(given.coefficients.dispersion), alpha)
        found = on.values(force)
        assert_close(found, phases[1].dispersion_force)
        assert_close(-found, phases[0].dispersion_force)


# -- turbulence of a state ------------------------------------------------------------------------


@pytest.mark.parametrize("kind", TURBULENT)
def test_turbulence_of_a_state_is_that_of_the_laws_in_ufl(shape: str, kind: str) -> None:
    step = observed(shape, kind)
    on, cells, line, point = step.on, step.cells, step.line, step.local_point
    given, found = step.call("eddies")
    at, (height, slope) = on.fields(given.levels.predicted), step.profile
    eddies = wall_eddies_of(step, at, given.levels.predicted)
    gas = point.gas_eddies(eddies)
    of_solids = None
    if "k_s" in found.rate:
        gradient = mirrored_gradient(step, cells.gradient(given.levels.predicted.u_s))
        scales = at.scales["k_s"], at.scales["eps_s"]
        distance = on.cell(line.wall_distance)
        of_solids = point.eddies(Invariants(gradient), distance, 1.0, *scales)
    crowding = on.cell(cells.gradient(given.levels.predicted.alpha))
    size = on.cell(cells.volume ** (1 / 3))
    grains = forms.dispersed_solids(point, at, crowding, size, height, of_solids)
    law = point.closures.dispersed
    nu_s = law.viscosity(gas, grains)
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


def mirrored_gradient(step: Observed, gradient: Array) -> Any:
    """Gradient of a velocity beside planes of symmetry, in UFL."""
    on = step.on
    lost = on.assembled(forms.mirrored(on, on.cell(gradient), ufl.TestFunction(on.tensors)))
    return on.cell(gradient - lost.reshape(-1, 3, 3))


def wall_eddies_of(step: Observed, at: SimpleNamespace, predicted: State) -> Eddies:
    """Eddies of the gas, in cells of the wall with its traction."""
    on, line, point = step.on, step.line, step.local_point
    gradient = mirrored_gradient(step, step.cells.gradient(predicted.u_g))
    scales = at.scales["k"], at.scales["eps"]
    eddies = point.eddies(Invariants(gradient), *step.profile, *scales)
    height = on.face(on.on_part("wall", line.wall_height)).edge
    friction = forms.gas_wall(on, point, 1.0, at.u_g, height, at.scales["k"])
    w = ufl.TestFunction(on.scalars)
    squares = on.assembled(forms.wall_tractions(on, friction, at.u_g, point, w))
    traction = on.cell(np.sqrt(squares))
    strain = on.cell(on.cell_values(eddies.strain))
    spin, slope = (on.cell(on.cell_values(value)) for value in (eddies.spin, eddies.A_s))
    eddies = replace(eddies, strain=strain, spin=spin, A_s=slope)
    inner = forms.wall_eddies(point, eddies, traction)
    strain = ufl.conditional(ufl.gt(traction, 0), inner.strain, strain)
    strain = on.cell(on.cell_values(strain))
    return replace(eddies, strain=strain, spin=spin * strain / eddies.strain)

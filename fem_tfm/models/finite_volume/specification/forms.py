# SPDX-License-Identifier: LGPL-3.0-or-later
"""The equations of one unsteady step as DG0 forms in UFL: the specification of the arrays.

The solver evaluates a step on flat arrays. This module states the same equations in UFL; the tests
assemble them with DOLFINx and compare both. Nothing here runs in a simulation.

`on` is the mesh in UFL (`cells.facets`), w a test function of one value a cell, or of one vector.
`point` are the laws at a point. The other arguments are the data that the parts of a step exchange,
with UFL in place of their arrays (`FacetForms.fields` and the functions `..._fields` below). Fluxes
are densities, per area of a face. `rise` is the difference q(-) - q(+) across a face.
"""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import ufl

from fem_tfm.closures.turbulence.dispersed import Grains
from fem_tfm.closures.turbulence.gas import Eddies
from fem_tfm.closures.walls.solids import WallState
from fem_tfm.models.finite_volume.cells.line import LineMesh
from fem_tfm.models.finite_volume.specification.facets import PARTS, Face, FacetForms, larger
from fem_tfm.models.finite_volume.state import (
    SMALLEST_FRACTION,
    Density,
    Inflow,
    Phase,
    Sources,
    TurbulenceCoefficients,
)
from fem_tfm.models.finite_volume.time_levels import GasBalance, TimeLevels
from fem_tfm.models.finite_volume.turbulence import LARGEST_STEP, SMALLEST_CHANGE
from fem_tfm.models.pointwise import (
    GranularEnergy,
    Invariants,
    Pointwise,
    SolidsCoefficients,
    tangential,
)

IMPERMEABLE = ("wall", "symmetry")
BUT_INLET = ("outlet", *IMPERMEABLE)


# -- data of a step -------------------------------------------------------------------------------


def level_fields(on: FacetForms, levels: TimeLevels) -> SimpleNamespace:
    """The levels in time of a step in UFL: spans are fields whatever the order."""
    span = np.broadcast_to(levels.span, on.cells.owned)
    faces = np.broadcast_to(levels.span_faces, on.cells.face_count)
    return on.fields(dataclasses.replace(levels, previous=None, span=span, span_faces=faces))


def density_fields(on: FacetForms, density: Density) -> SimpleNamespace:
    """A density in UFL: fields, also where it is constant."""
    cells = on.cells
    sizes = {"start": cells.owned, "cells": cells.owned}
    sizes |= {"faces": cells.face_count, "upwind": cells.face_count}
    spread: dict[str, Any] = {
        name: np.broadcast_to(getattr(density, name), n) for name, n in sizes.items()
    }
    return on.fields(dataclasses.replace(density, **spread))


def phase_fields(on: FacetForms, phase: Phase) -> SimpleNamespace:
    """A phase in UFL, with zeros for the terms that it does not have.

    Instead of `support` it has `counts`, how much the sides "+" and "-" of a face follow it, and
    `shifted`, the fraction of either side that the face bears beyond interpolation.
    """
    cells, support = on.cells, phase.support
    sizes = {"pressure": cells.count}
    sizes |= dict.fromkeys(("dispersion_force", "implicit_correction"), cells.face_count)
    absent: dict[str, Any] = {n: np.zeros(m) for n, m in sizes.items() if getattr(phase, n) is None}
    absent |= {"support": None, "wall_friction": 0.0}
    found = on.fields(dataclasses.replace(phase, **absent))
    found.density = density_fields(on, phase.density)
    found.wall_friction = on.density(on.on_part("wall", phase.wall_friction))
    if support is None:
        return found
    counts, shifted = np.ones((2, cells.face_count)), np.zeros((2, cells.face_count))
    face, side, count = support.partial_faces
    counts[side, face] = count
    face, cell, part = support.shifted
    np.add.at(shifted, (np.where(cells.first[face] == cell, 0, 1), face), part)
    found.counts = tuple(on.face(values).inner for values in counts)
    found.shifted = tuple(on.face(values).inner for values in shifted)
    return found


def inflow_fields(on: FacetForms, inflow: Inflow, line: LineMesh) -> SimpleNamespace:
    """What enters, in UFL, with its `profile` on faces, and `passes`, 0 at a blocked outlet."""
    found = on.fields(inflow)
    found.profile = on.face(on.on_part("inlet", line.inlet_profile))
    found.passes = on.constant(0.0 if inflow.blocked else 1.0)
    return found


def turbulence_fields(
    on: FacetForms, coefficients: TurbulenceCoefficients | None
) -> SimpleNamespace:
    """Coefficients of the turbulence in UFL, with zeros where there is none."""
    zero = np.zeros(on.cells.count)
    values = {} if coefficients is None else vars(coefficients)
    found = {name: values.get(name) for name in ("dispersion", "drag", "nu_s", "relative_density")}
    if found["relative_density"] is None:
        found["relative_density"] = zero + 1
    found = {name: zero if value is None else zero + value for name, value in found.items()}
    return SimpleNamespace(**on.fields({**values, **found}))


def gas_fields(on: FacetForms, balance: GasBalance | None, sources: Sources) -> SimpleNamespace:
    """Balance of the gas per volume in UFL; of a constant density that of both phases' volume."""
    cells, volume = on.cells, on.cells.volume[: on.cells.owned]
    if balance is not None:
        names = ("compressibility", "mass_growth")
        return on.fields(
            dataclasses.replace(
                balance, **{name: getattr(balance, name) / volume for name in names}
            )
        )
    none, owned = np.zeros(cells.face_count), np.zeros(cells.owned)
    found = {"solids_flux": none, "flux_weight": none + 1, "previous_flux": none}
    found |= {"compressibility": owned, "mass_growth": owned}
    found |= {"source": owned + sources.solids + sources.gas}
    return SimpleNamespace(**on.fields(found))


def _entering(inflow: SimpleNamespace, phase: str) -> tuple[Any, Any]:
    """Fraction and mean velocity of a phase that enters."""
    alpha = inflow.solids_fraction
    if phase == "solids":
        return alpha, inflow.solids_velocity
    return 1 - alpha, inflow.gas_velocity / (1 - alpha)


def present(fraction: Any) -> Any:
    """A fraction, no less than that of a phase which is not there."""
    if isinstance(fraction, Face):
        return larger(fraction, SMALLEST_FRACTION)
    return ufl.max_value(fraction, SMALLEST_FRACTION)


def _vector(value: Any) -> Any:
    """A vector, of three equal components if a number is given."""
    return value if value.ufl_shape else ufl.as_vector([value] * 3)


# -- coefficients ---------------------------------------------------------------------------------


def solids_pressure(point: Pointwise, alpha: Any, theta: Any, deformation: Any, lift: Any) -> Any:
    """p_s of kinetic theory, friction and a normal stress `lift` of eddies over a rho_s [Pa]."""
    alpha = ufl.max_value(alpha, 0)
    found = point.solids_pressure(alpha, theta, deformation.shear, deformation.dilation)
    return found + alpha * point.solids.density * lift


def solids_coefficients(
    point: Pointwise, alpha: Any, theta: Any, deformation: Any
) -> SolidsCoefficients:
    """Coefficients of kinetic theory and friction."""
    alpha = ufl.max_value(alpha, 0)
    return point.coefficients(alpha, theta, deformation.shear, deformation.dilation)


def drag_coefficients(point: Pointwise, alpha: Any, slip: Any, height: Any) -> tuple[Any, Any]:
    """beta and |u| d(beta)/d|u| at the slip velocity u = u_g - u_s [kg/m3/s]."""
    return point.drag_and_growth(present(alpha), point.speed(slip), height)


def gas_viscosity(point: Pointwise, gradient: Any, profile: tuple[Any, Any]) -> Any:
    """mu_g + mu_t of an algebraic law at height y' of a profile stretched by dy'/dy [Pa s]."""
    return point.gas_viscosity(point.eddies(Invariants(gradient), *profile), profile[1])


def solids_wall(
    on: FacetForms, point: Pointwise, alpha: Any, theta: Any, at: SolidsCoefficients, u: Any
) -> tuple[Any, Any]:
    """Friction c of the traction -c u of a wall [Pa s/m], and its heat into Theta [W/m2]."""
    slip = point.speed(tangential(u, on.normal.edge))
    state = WallState(ufl.max_value(alpha, 0), theta, at.g0, at.p_f, slip)
    return point.solids_wall_friction(state), point.solids_wall_heat(state)


def gas_wall(on: FacetForms, point: Pointwise, void: Any, u: Any, height: Any, k: Any) -> Any:
    """Friction c of the traction -c u of a wall on the gas [Pa s/m]."""
    slip = point.speed(tangential(u, on.normal.edge))
    return void * point.gas_wall_friction(slip, height, k)


# -- turbulence of a state ------------------------------------------------------------------------


def mirrored(on: FacetForms, gradient: Any, v: Any) -> ufl.Form:
    """What the gradient of a velocity loses beside planes of symmetry, a tensor of each cell [1/s].

    Half of the slope (grad u) n of what runs along the plane: the gradient half a cell further in.
    """
    n = on.normal.edge
    slope = tangential(ufl.dot(gradient, n), n) / 2
    return ufl.inner(ufl.outer(slope, n), v) / on.face_area.edge * on.ds("symmetry")


def wall_tractions(on: FacetForms, friction: Any, u: Any, point: Pointwise, w: Any) -> ufl.Form:
    """Sum of the squares of the tractions c |u_t| of a wall on each cell [Pa2]."""
    traction = friction * point.speed(tangential(u, on.normal.edge))
    return traction**2 / on.face_area.edge * w * on.ds("wall")


def wall_eddies(point: Pointwise, eddies: Eddies, traction: Any) -> Eddies:
    """Eddies of a cell at a wall, whose shear S knows of the wall's traction.

        S = min(S_w/2 + S_g, max(S_w, S_g)),   traction = (mu + mu_t(S_w)) S_w

    S_g is that of the gradient; S_w is found by two iterations from it and Aitken's extrapolation.
    """
    gradient = eddies.strain

    def sheared(strain: Any) -> Any:
        inner = _strained(eddies, strain)
        return traction / (point.gas.viscosity + point.closures.turbulence.viscosity(inner))

    one = sheared(gradient)
    two = sheared(one)
    change = one - gradient
    change = ufl.conditional(ufl.gt(abs(change), SMALLEST_CHANGE), change, 1)
    ratio = ufl.min_value((two - one) / change, 0.9)
    wall = one + (two - one) / (1 - ratio)
    return _strained(eddies, ufl.min_value(wall / 2 + gradient, ufl.max_value(wall, gradient)))


def _strained(eddies: Eddies, strain: Any) -> Eddies:
    """The same eddies at another shear, which turns as much more as it strains."""
    spin = eddies.spin * strain / eddies.strain
    return dataclasses.replace(eddies, strain=strain, spin=spin)


def dispersed_solids(
    point: Pointwise,
    at: SimpleNamespace,
    crowding: Any,
    size: Any,
    height: Any,
    eddies: Eddies | None,
) -> Grains:
    """What the laws of dispersed turbulence see of the solids of a state.

    crowding : grad(alpha_s), which is no steeper than alpha_s over half the `size` of a cell [1/m]
    """
    alpha, slip = present(at.alpha), at.u_g - at.u_s
    g0, kinetic = point.kinetic(alpha, at.theta)
    steep = ufl.sqrt(alpha**2 + ufl.dot(crowding, crowding) * size**2 / 4)
    drift = -ufl.dot(slip, crowding) / steep
    speed = point.speed(slip)
    viscosity = kinetic.shear_viscosity
    return point.grains(alpha, at.theta, g0, viscosity, speed, height, drift, eddies)


# -- solids fraction ------------------------------------------------------------------------------


def dispersion_response(
    on: FacetForms, point: Pointwise, alpha: Any, turbulence: Any, span: Any
) -> Face:
    """E: the solids follow dispersion by the volume flux -E rise(alpha_s) [m/s].

    E = a_g c/(n.d)/(a_s a_g (rho_s a_g + rho_g a_s)/dt + beta)

    """
    solids = point.solids.density
    gas = point.gas.density * on.mean(turbulence.relative_density)
    alpha = on.mean(alpha)
    void = 1 - alpha
    hold = alpha * void * (solids * void + gas * alpha) / span + on.mean(turbulence.drag)
    return void / hold * on.mean(turbulence.dispersion) * on.weight


def acceleration_share(sound: Any, wide: Any, share: Face) -> Face:
    """Share of the acceleration of inner faces that their predicted flux takes.

    sound : of each cell, square of the step over that in which a wave of p_s crosses it
    wide : of each cell, the step over that in which dispersion crosses it
    share : where neither counts
    """
    sound, wide = (ufl.max_value(q("+"), q("-")) for q in (sound, wide))
    return Face(ufl.max_value(sound / (1 + sound), share.inner / (1 + wide**2)), 0)


def predicted_flux(on: FacetForms, levels: Any, share: Face, spread: Face) -> Face:
    """Volume flux F of the solids before their new pressure acts [m/s].

        F = u_s.n - (what p_s drives of it) + f dt a + E rise(alpha_0)

    share : f, part of the acceleration a of the faces that is carried on
    """
    start = levels.start
    flux = start.solids_flux - start.pressure_flux
    flux = flux + share * levels.span_faces * start.flux_acceleration
    return flux + spread * on.rise(start.alpha)


def solids_flux(
    on: FacetForms, flux: Face, alpha: Any, p_s: Any, response: Face, spread: Face
) -> Face:
    """Volume flux of the solids at an iterate: F - R_ss rise(p_s)/(n.d) - E rise(alpha_s) [m/s]."""
    return flux - response * on.weight * on.rise(p_s) - spread * on.rise(alpha)


def solids_fraction(
    on: FacetForms,
    w: Any,
    alpha: Any,
    flux: Face,
    dt: Any,
    levels: Any,
    inflow: SimpleNamespace,
    beyond: Face,
) -> ufl.Form:
    """Residual of the solids fraction.

        (alpha_s - alpha_0)/dt + div(s F alpha_upwind + F_before + F_beyond) = source

    flux : F, that of an iterate inside
    levels : s and F_before, the weights of this step's flux and what the last one's adds
    beyond : what linear values of the cells add to the upwind flux
    """
    weight, known = levels.flux_weight, levels.previous_flux + beyond
    upwind = ufl.conditional(ufl.gt(flux.inner, 0), alpha("+"), alpha("-"))
    leaving = ufl.max_value(flux.edge, 0) * alpha
    fraction, velocity = _entering(inflow, "solids")
    source = levels.span / dt * inflow.sources.solids + levels.previous_source
    found = ((alpha - levels.start.alpha) / dt - source) * w * on.dx
    through = weight * Face(flux.inner * upwind, leaving) + known
    found += on.out(through, w, *IMPERMEABLE)
    found += (weight.edge * inflow.passes * leaving + known.edge) * w * on.ds("outlet")
    entering = fraction * velocity * inflow.profile.edge
    return found + (known.edge - weight.edge * entering) * w * on.ds("inlet")


# -- transport of Theta and of the scales of turbulence -------------------------------------------


def _transported(
    on: FacetForms, x: Any, w: Any, flux: Face, spread: Face, free: Any, *parts: str
) -> ufl.Form:
    """Sum over inflow of F (X - X_upwind), and of D (X - X_beyond)/(n.d) over inner faces.

    free : 0 in cells that feel no neighbour, else 1
    parts : of the boundary, through which nothing but X = 0 enters
    """
    ahead, back = larger(flux, 0), larger(-flux, 0)
    plus, minus = x("+") - free("+") * x("-"), x("-") - free("-") * x("+")
    found = (back.inner + spread.inner) * ufl.inner(plus, w("+")) * on.dS
    found += (ahead.inner + spread.inner) * ufl.inner(minus, w("-")) * on.dS
    return found + back.edge * ufl.inner(x, w) * on.ds(*parts)


def transport(
    on: FacetForms, x: Any, w: Any, flux: Face, diffusivity: Any, sink: Any, free: Any
) -> ufl.Form:
    """Operator of a scale X: sink X + sum_in F (X - X_upwind) + sum D (X - X_beyond)/(n.d).

    flux : F, of mass [kg/m2/s], or over a density [m/s]
    free : 0 in cells whose value is given, which feel no neighbour, else 1
    """
    spread = on.mean(diffusivity) * on.weight
    return sink * x * w * on.dx + _transported(on, x, w, flux, spread, free, *PARTS)


def transport_source(on: FacetForms, w: Any, flux: Face, gain: Any, entering: Any) -> ufl.Form:
    """Right-hand side of `transport`: gain per volume, and X that enters with the flux."""
    return gain * w * on.dx + ufl.max_value(-flux.edge, 0) * entering * w * on.ds("inlet")


def energy_dilation(moved: Any, deformation: Any, levels: Any) -> Any:
    """div u_s of the granular energy: the slower of two compressions at first order [1/s].

    What the velocities of the step and the predicted ones both compress is, as far as the step is
    of second order, compressed as by those of the step; so is what they expand.
    """
    later, now = moved.dilation, deformation.dilation
    larger = ufl.max_value(later, now)
    both = ufl.And(ufl.lt(later, 0), ufl.lt(now, 0))
    agreed = ufl.conditional(ufl.Or(both, ufl.gt(later, 0)), levels.second_order, 0)
    return larger + agreed * (later - larger)


def temperature_sources(
    energy: GranularEnergy, density: Any, alpha: Any, theta: Any, start: Any, span: Any, more: Any
) -> tuple[Any, Any]:
    """Sink over Theta [kg/m3/s] and gain [W/m3] of the granular energy per volume.

        3/2 a rho_s (Theta - Theta_0)/dt = production - compression - decay Theta + more

    A compression that takes energy, p div u > 0, is in the sink by the Theta of its coefficients.

    alpha, start : fraction and Theta from which the step starts
    theta : of the coefficients
    more : what comes in from elsewhere [W/m3]
    """
    inertia = 1.5 * density * present(alpha) / span
    sink = inertia + energy.decay + ufl.max_value(energy.compression, 0) / theta
    gain = inertia * start + energy.production + ufl.max_value(-energy.compression, 0)
    return sink + ufl.max_value(-more, 0) / theta, gain + ufl.max_value(more, 0)


def wall_heat(on: FacetForms, theta: Any, heat: Any, x: Any, w: Any) -> tuple[ufl.Form, ufl.Form]:
    """Heat of the wall into the granular energy [W/m2]: what falls with Theta, and what comes."""
    sink = ufl.max_value(-heat, 0) / theta * x * w * on.ds("wall")
    return sink, ufl.max_value(heat, 0) * w * on.ds("wall")


def turbulence_step(
    rate: Any, stiffness: Any, span: Any, start: Any, predicted: Any | None
) -> tuple[Any, Any]:
    """Sink over a X, and gain over a, of a scale X of turbulence [1/s].

    predicted : X at the end of a step of second order, None in one of the first
    """
    rise, stiff = span * rate, span * stiffness
    if predicted is not None:
        kept = ufl.sqrt(1 + ufl.max_value(rise, 0) ** 2)
        return (kept - rise + stiff) / span, (kept * start + stiff * predicted) / span
    step = ufl.max_value(ufl.min_value(rise / (1 + stiff), LARGEST_STEP), -LARGEST_STEP)
    small = ufl.lt(abs(step), SMALLEST_CHANGE)
    step = ufl.conditional(small, SMALLEST_CHANGE, step)
    # exp(q) - 1, without the difference
    grown = 2 * ufl.exp(step / 2) * ufl.sinh(step / 2)
    fitted = ufl.conditional(small, 1 + stiff, rise / grown) / span
    return fitted, fitted * ufl.exp(step) * start


# -- momentum -------------------------------------------------------------------------------------


def momentum(
    on: FacetForms, u: Any, w: Any, phase: SimpleNamespace, span: Any, inflow: SimpleNamespace
) -> ufl.Form:
    """Operator of the momentum of one phase without drag, on its velocity u.

    a_0 rho u/dt + sum_in F (u - u_upwind) + sum mu (u - u_beyond)/(n.d) + c_wall u
        + (4/3 mu + bulk) (u.n) n/(n.d) on sides

    """
    density, n = phase.density, on.normal.edge
    spread = on.mean(phase.viscosity) * on.weight + phase.implicit_correction
    inertia = density.start * present(phase.fraction_start) / span
    found = inertia * ufl.inner(u, w) * on.dx
    flux, free = density.upwind * phase.flux, on.constant(1.0)
    found += _transported(on, u, w, flux, spread, free, *BUT_INLET)
    found += _mass_inflow(phase, inflow) * ufl.inner(u, w) * on.ds("inlet")
    friction = phase.wall_friction.edge
    found += friction * ufl.inner(u, w) * on.ds("wall")
    pull = (phase.bulk_viscosity + 4 / 3 * phase.viscosity) * on.weight.edge
    across = ufl.dot(u, n) * ufl.dot(w, n)
    found += ufl.max_value(pull - friction, 0) * across * on.ds("wall")
    return found + ufl.max_value(pull, 0) * across * on.ds("symmetry")


def drag(on: FacetForms, u: Any, other: Any, w: Any, beta: Any) -> ufl.Form:
    """Operator of the drag on a phase: beta (u - u_other)."""
    return beta * ufl.inner(u - other, w) * on.dx


def _mass_inflow(phase: SimpleNamespace, inflow: SimpleNamespace) -> Any:
    """Mass of a phase that enters through the inlet [kg/m2/s]."""
    fraction, velocity = _entering(inflow, phase.name)
    return phase.density.inflow * fraction * velocity * inflow.profile.edge


def _inlet_velocity(phase: SimpleNamespace, inflow: SimpleNamespace) -> Any:
    """Normal velocity with which a phase enters, at its density there [m/s]."""
    expansion = phase.density.inflow / phase.density.upwind.edge
    return _entering(inflow, phase.name)[1] * expansion * inflow.profile.edge


def momentum_source(
    on: FacetForms,
    w: Any,
    phase: SimpleNamespace,
    acceleration: Any,
    force: Any,
    span: Any,
    inflow: SimpleNamespace,
) -> ufl.Form:
    """Right-hand side of the momentum of one phase, without `viscous_force`.

    acceleration : by pressures and weight [m/s2]
    force : on the phase from elsewhere [N/m3]
    """
    density = phase.density
    inertia = density.start * present(phase.fraction_start) / span
    found = inertia * ufl.inner(phase.velocity_start, w) * on.dx
    found += density.cells * present(phase.fraction) * ufl.inner(acceleration, w) * on.dx
    found += ufl.inner(_vector(force), w) * on.dx
    entering = -_mass_inflow(phase, inflow) * _inlet_velocity(phase, inflow)
    return found + entering * ufl.dot(on.normal.edge, w) * on.ds("inlet")


def viscous_force(
    on: FacetForms, w: Any, phase: SimpleNamespace, u: Any, gradient: Any
) -> ufl.Form:
    """What the operator of the momentum leaves of the viscous force of a velocity u.

        div(mu (grad u)^T + mu grad u (n - d/(n.d)) + (bulk - 2/3 mu) (div u) n)

    on inner faces, by the gradient (i, j) -> du_i/dx_j; on sides what spreads along them.
    """
    n, rate = on.normal, on.mean(gradient)
    mu = on.mean(phase.viscosity)
    bulk = on.mean(phase.bulk_viscosity) - 2 / 3 * mu
    stress = mu * Face.of(lambda g, n: ufl.dot(n, g), rate, n)
    stress = stress + mu * Face.of(ufl.dot, rate, n - on.delta * on.weight)
    stress = stress + bulk * Face.of(ufl.tr, rate) * n
    stress = stress - phase.implicit_correction * on.rise(u)
    along = ufl.tr(gradient) - ufl.dot(n.edge, ufl.dot(gradient, n.edge))
    lateral = (phase.bulk_viscosity - 2 / 3 * phase.viscosity) * along
    found = on.out(stress, w)
    return found + lateral * ufl.dot(n.edge, w) * on.ds(*IMPERMEABLE)


def implicit_correction(on: FacetForms, viscosity: Any, mass: Any, volume: Any, span: Face) -> Face:
    """What the operator of the momentum holds of a stress that lags a step behind [kg/m2/s].

        D^2/(D + min(m V)/dt),   D = mean(viscosity) |S|^2/(S.d)

    viscosity : of that stress [Pa s]; mass : of the phase [kg/m3]
    """
    lagging = (on.mean(viscosity) * on.weight * on.face_area).inner
    held = mass * volume
    inertia = ufl.min_value(held("+"), held("-")) / span.inner
    return Face(lagging**2 / (lagging + inertia) / on.face_area.inner, 0)


def dispersion_force(on: FacetForms, dispersion: Any, alpha: Any) -> Face:
    """Force on the gas by which eddies spread the solids, mean(c) rise(alpha_s)/(n.d) [N/m3]."""
    return on.mean(dispersion) * on.rise(alpha) * on.weight


# -- forces on faces ------------------------------------------------------------------------------


def face_force(
    on: FacetForms,
    phase: SimpleNamespace,
    p: Any,
    gravity: Any,
    lifted: Any,
    inflow: SimpleNamespace,
) -> Face:
    """Force along the normals of inner faces and the outlet [N/m3].

        f = a (rho - rho_lifted) g.n - a rise(p)/(n.d) - rise(p_s)/(n.d) + dispersion

    a : fraction that the face bears; p vanishes outside of the outlet, p_s does not change there
    """
    weight = Face.of(ufl.dot, on.normal, gravity) * (phase.density.faces - lifted)
    force = phase.face_fraction * (weight - on.rise(p, 0) * on.weight) + phase.dispersion_force
    force = force - on.rise(phase.pressure) * on.weight
    return force if phase.name == "gas" else Face(force.inner, inflow.passes * force.edge)


def face_inertia(on: FacetForms, phase: SimpleNamespace, beta: Any, span: Any) -> Face:
    """What holds a force of a face: m for the solids [kg/m3], m/dt + beta for the gas [kg/m3/s]."""
    mass = phase.density.faces * present(phase.face_fraction)
    return mass if phase.name == "solids" else mass / span + on.mean(beta)


def cell_response(
    on: FacetForms, a: Any, v: Any, phase: SimpleNamespace, beta: Any, span: Any
) -> ufl.Form:
    """Left-hand side for the acceleration a of the cells of a phase, of `face_response`.

    Gas: a is 1/dt + beta/m of the velocity that the forces of its faces make.
    """
    if phase.name == "solids":
        return on.least_squares(a, v, phase.counts)
    mass = phase.density.cells * present(phase.fraction)
    return on.least_squares(a / (1 / span + beta / mass), v)


def face_response(on: FacetForms, v: Any, force: Face, inertia: Face, phase: Any) -> ufl.Form:
    """Right-hand side for the acceleration of the cells of a phase: force over inertia of faces."""
    counts = phase.counts if phase.name == "solids" else (1, 1)
    return on.least_squares_of(force / inertia, v, "outlet", counts=counts)


def cell_force(on: FacetForms, phase: SimpleNamespace, vector: Any, inertia: Face) -> Face:
    """Force of the cells on inner faces and the outlet, which `face_force` exceeds by a gap [N/m3].

    vector : of `least_squares` in the cells, by force over inertia
    """
    n = on.normal
    if phase.name == "gas":
        return inertia * Face.of(ufl.dot, on.mean(vector), n)
    ahead, back = phase.shifted
    found = Face.of(ufl.dot, on.mean(present(phase.fraction) * vector), n)
    shifted = ahead * ufl.dot(vector("+"), n.inner) + back * ufl.dot(vector("-"), n.inner)
    return phase.density.faces * Face(found.inner + shifted, found.edge)


# -- pressure -------------------------------------------------------------------------------------


def responses(
    on: FacetForms, alpha: Any, beta: Any, span: Any, solids: Any, gas: Any
) -> list[list[Face]]:
    """R = [[m_s/dt + beta, -beta], [-beta, m_g/dt + beta]]^-1 on faces [m3 s/kg]."""
    alpha, beta = on.mean(alpha), on.mean(beta)
    m_s, m_g = solids * present(alpha) / span, gas * present(1 - alpha) / span
    determinant = m_g * m_s + beta * (m_g + m_s)
    between = beta / determinant
    return [[(m_g + beta) / determinant, between], [between, (m_s + beta) / determinant]]


def _passes(phase: SimpleNamespace, inflow: SimpleNamespace, flux: Face) -> Face:
    """A flux that is held at an outlet which is blocked for its phase."""
    return flux if phase.name == "gas" else Face(flux.inner, inflow.passes * flux.edge)


def phase_fluxes(
    on: FacetForms,
    phases: list[SimpleNamespace],
    velocities: list[Any],
    gaps: list[Face],
    response: list[list[Face]],
    inflow: SimpleNamespace,
) -> list[Face]:
    """Volume fluxes before the projection on inner faces and the outlet: u.n + sum R gap [m/s]."""
    found = []
    for phase, u, row in zip(phases, velocities, response, strict=True):
        flux = Face.of(ufl.dot, on.mean(u), on.normal)
        for r, gap in zip(row, gaps, strict=True):
            flux = flux + r * gap
        found.append(_passes(phase, inflow, flux))
    return found


def follow(
    on: FacetForms, phases: list[Any], response: list[list[Face]], inflow: SimpleNamespace
) -> list[Face]:
    """Fluxes of the phases over -rise(p): sum over the phases l of R_kl a_l/(n.d)."""
    found = []
    for phase, row in zip(phases, response, strict=True):
        sums = [r * other.face_fraction for r, other in zip(row, phases, strict=True)]
        found.append(_passes(phase, inflow, sum(sums[1:], sums[0]) * on.weight))
    return found


def total_of(phases: list[SimpleNamespace], parts: list[Face]) -> Face:
    """Sum over the phases of a times a flux."""
    sums = [phase.face_fraction * part for phase, part in zip(phases, parts, strict=True)]
    return sum(sums[1:], sums[0])


def pressure(on: FacetForms, p: Any, w: Any, stiffness: Face, gas: SimpleNamespace) -> ufl.Form:
    """Operator of the change of the pressure p.

        a_g p/(dt p_ref) - div(d sum_kl a_k R_kl a_l grad p)

    stiffness : flux of both phases over -rise(p)
    gas : d and the first term, which a constant density does not have
    """
    flux = -gas.flux_weight * stiffness * on.rise(p, 0)
    return on.out(flux, w, "outlet") + gas.compressibility * p * w * on.dx


def pressure_source(
    on: FacetForms,
    w: Any,
    total: Face,
    phases: list[SimpleNamespace],
    inflow: SimpleNamespace,
    gas: SimpleNamespace,
) -> ufl.Form:
    """Right-hand side of `pressure`: what the flux of both phases lacks of the gas's balance.

        source - d (a_s,before - a_s)/dt - div(d (F - F_solids) + F_before)

    total : F on inner faces and the outlet; what enters is that of the inflow
    """
    enters = 0.0
    for phase in phases:
        fraction = _entering(inflow, phase.name)[0]
        enters = enters - fraction * _inlet_velocity(phase, inflow)
    weight, kept = gas.flux_weight, gas.previous_flux
    found = (gas.source - gas.mass_growth) * w * on.dx
    found -= on.out(weight * (total - gas.solids_flux) + kept, w, "outlet")
    found -= (weight.edge * (enters - gas.solids_flux.edge) + kept.edge) * w * on.ds("inlet")
    return found - (kept - weight * gas.solids_flux).edge * w * on.ds(*IMPERMEABLE)


def ideal_gas_terms(
    alpha: Any, alpha_before: Any, relative: Any, dt: Any, reference: Any
) -> tuple[Any, Any]:
    """Growth of the gas of a volume with the pressure [1/s/Pa], and at that of now [1/s].

    a_g p/(dt p_ref),   d (a_s,before - a_s)/dt
    """
    return (1 - alpha) / (dt * reference), relative * (alpha_before - alpha) / dt


def upwind_density(on: FacetForms, relative: Any, flux: Face, still: Any, outlet: Any) -> Face:
    """Relative density upwind of a flux, interpolated where it is smaller than `still` [m/s]."""
    upwind = ufl.conditional(ufl.lt(flux.inner, 0), relative("-"), relative("+"))
    moving = ufl.ge(abs(flux.inner), still)
    return Face(ufl.conditional(moving, upwind, on.mean(relative).inner), outlet)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""The momentum of both phases of a step: operator, right-hand side and lagging stresses."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import ufl

from fem_tfm.models.finite_volume.cells.mesh import SMALLEST
from fem_tfm.models.finite_volume.specification.data import entering_flow, present
from fem_tfm.models.finite_volume.specification.facets import IMPERMEABLE, Face, FacetForms
from fem_tfm.models.finite_volume.specification.transport import transported

BUT_INLET = ("outlet", *IMPERMEABLE)


def momentum(
    on: FacetForms, u: Any, w: Any, phase: SimpleNamespace, span: Any, inflow: SimpleNamespace
) -> ufl.Form:
    """Operator of the momentum of one phase without drag, on its velocity u.

    a_0 rho u/dt + sum_in F (u - u_upwind) + sum mu (u - u_beyond)/(n.d) + c_wall u
        + (4/3 mu + bulk) (u.n) n/(n.d) on sides

    """
    density, n = phase.density, on.normal.edge
    spread = on_faces(on, phase, phase.viscosity) * on.weight + phase.implicit_correction
    inertia = density.start * present(phase.fraction_start) / span
    found = inertia * ufl.inner(u, w) * on.dx
    flux, free = density.upwind * phase.flux, on.constant(1.0)
    found += transported(on, u, w, flux, spread, free, *BUT_INLET)
    found += _mass_inflow(phase, inflow) * ufl.inner(u, w) * on.ds("inlet")
    friction = phase.wall_friction.edge
    found += friction * ufl.inner(u, w) * on.ds("wall")
    pull = (phase.bulk_viscosity + 4 / 3 * phase.viscosity) * on.weight.edge
    across = ufl.dot(u, n) * ufl.dot(w, n)
    found += ufl.max_value(pull - friction, 0) * across * on.ds("wall")
    return found + ufl.max_value(pull, 0) * across * on.ds("symmetry")


def on_faces(on: FacetForms, phase: SimpleNamespace, viscosity: Any) -> Face:
    """A viscosity of a phase on faces: of the solids both halves in series, of the gas the mean."""
    return on.in_series(viscosity) if phase.name == "solids" else on.mean(viscosity)


def drag(on: FacetForms, u: Any, other: Any, w: Any, beta: Any) -> ufl.Form:
    """Operator of the drag on a phase: beta (u - u_other)."""
    return beta * ufl.inner(u - other, w) * on.dx


def _mass_inflow(phase: SimpleNamespace, inflow: SimpleNamespace) -> Any:
    """Mass of a phase that enters through the inlet [kg/m2/s]."""
    fraction, velocity = entering_flow(inflow, phase.name)
    return phase.density.inflow * fraction * velocity * inflow.profile.edge


def inlet_velocity(phase: SimpleNamespace, inflow: SimpleNamespace) -> Any:
    """Normal velocity with which a phase enters, at its density there [m/s]."""
    expansion = phase.density.inflow / phase.density.upwind.edge
    return entering_flow(inflow, phase.name)[1] * expansion * inflow.profile.edge


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
    entering = -_mass_inflow(phase, inflow) * inlet_velocity(phase, inflow)
    return found + entering * ufl.dot(on.normal.edge, w) * on.ds("inlet")


def _vector(value: Any) -> Any:
    """A vector, of three equal components if a number is given."""
    return value if value.ufl_shape else ufl.as_vector([value] * 3)


def viscous_force(
    on: FacetForms, w: Any, phase: SimpleNamespace, u: Any, gradient: Any
) -> ufl.Form:
    """What the operator of the momentum leaves of the viscous force of a velocity u.

        div(mu (grad u)^T + mu grad u (n - d/(n.d)) + (bulk - 2/3 mu) (div u) n)

    on inner faces, by the gradient (i, j) -> du_i/dx_j; on sides what spreads along them.
    """
    n, rate = on.normal, on.mean(gradient)
    mu = on_faces(on, phase, phase.viscosity)
    bulk = on_faces(on, phase, phase.bulk_viscosity) - 2 / 3 * mu
    stress = mu * Face.of(lambda g, n: ufl.dot(n, g), rate, n)
    stress = stress + mu * Face.of(ufl.dot, rate, n - on.delta * on.weight)
    stress = stress + bulk * Face.of(ufl.tr, rate) * n
    stress = stress - phase.implicit_correction * on.rise(u)
    along = ufl.tr(gradient) - ufl.dot(n.edge, ufl.dot(gradient, n.edge))
    lateral = (phase.bulk_viscosity - 2 / 3 * phase.viscosity) * along
    found = on.out(stress, w)
    return found + lateral * ufl.dot(n.edge, w) * on.ds(*IMPERMEABLE)


def implicit_correction(
    on: FacetForms, viscosity: Face, mass: Any, volume: Any, span: Face
) -> Face:
    """What the operator of the momentum holds of a stress that lags a step behind [kg/m2/s].

        D^2/(D + min(m V)/dt),   D = viscosity |S|^2/(S.d)

    viscosity : of that stress, on faces [Pa s]; mass : of the phase [kg/m3]
    """
    lagging = (viscosity * on.weight * on.face_area).inner
    held = mass * volume
    inertia = ufl.min_value(held("+"), held("-")) / span.inner
    return Face(lagging**2 / (lagging + inertia) / on.face_area.inner, 0)


def dispersion_force(on: FacetForms, dispersion: Any, alpha: Any, carried: Face) -> Face:
    """Force on the gas by which eddies spread the solids that a face carries [N/m3].

    mean(c) rise(alpha_s)/(n.d) min(carried/mean(alpha_s), 1)
    """
    share = Face.of(
        lambda part, mean: ufl.min_value(part / ufl.max_value(mean, SMALLEST), 1),
        carried,
        on.mean(alpha),
    )
    return on.mean(dispersion) * on.rise(alpha) * on.weight * share

# SPDX-License-Identifier: LGPL-3.0-or-later
"""The projection of a step: fluxes of the phases, pressure, and the mass of an ideal gas."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import ufl

from fem_tfm.models.finite_volume.cells.line import MOST_OUTWARD
from fem_tfm.models.finite_volume.cells.mesh import SMALLEST
from fem_tfm.models.finite_volume.specification.data import entering_flow, present
from fem_tfm.models.finite_volume.specification.facets import IMPERMEABLE, Face, FacetForms
from fem_tfm.models.finite_volume.specification.momentum import inlet_velocity


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
    rises: list[Any],
) -> list[Face]:
    """Volume fluxes before the projection on inner faces and the outlet: u.n + sum R gap [m/s].

    rises : of the velocities u from the cells to the outlet
    """
    found = []
    for phase, u, row, rise in zip(phases, velocities, response, rises, strict=True):
        flux = Face.of(ufl.dot, on.mean(u) + Face(0 * u("+"), rise), on.normal)
        for r, gap in zip(row, gaps, strict=True):
            flux = flux + r * gap
        found.append(_passes(phase, inflow, flux))
    return found


def rise_to_outlet(on: FacetForms, u: Any, gradient: Any, share: Face) -> Any:
    """Rise of a velocity from the cells to the outlet by its gradient, at most half of |u| [m/s].

    share : of the second order
    """
    rise = ufl.dot(gradient, on.delta.edge)
    size, most = (ufl.sqrt(ufl.dot(q, q)) for q in (rise, u))
    least = ufl.min_value(1, MOST_OUTWARD * most / ufl.max_value(size, SMALLEST))
    return share.edge * least * rise


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
        fraction = entering_flow(inflow, phase.name)[0]
        enters = enters - fraction * inlet_velocity(phase, inflow)
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

# SPDX-License-Identifier: LGPL-3.0-or-later
"""The solids fraction equation of a step, and the flux that it moves the solids by."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import ufl

from fem_tfm.models.finite_volume.specification.data import entering_flow
from fem_tfm.models.finite_volume.specification.facets import IMPERMEABLE, Face, FacetForms
from fem_tfm.models.pointwise import Pointwise


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
    on: FacetForms, flux: Face, alpha: Any, push: Face, response: Face, spread: Face
) -> Face:
    """Volume flux of the solids at an iterate: F - R_ss push/(n.d) - E rise(alpha_s) [m/s].

    push : `pressure_rise` [Pa]
    """
    return flux - response * on.weight * push - spread * on.rise(alpha)


def pressure_rise(on: FacetForms, point: Pointwise, alpha: Any, theta: Any, p_s: Any) -> Face:
    """Rise of p_s across faces that exerts a force [Pa].

    rise(p_s), without mean(p/Theta) rise(Theta) where the force is (dp/dalpha) grad(alpha)
    """
    found = on.rise(p_s)
    if point.feels_theta:
        return found
    per_theta = point.pressure_per_theta(ufl.max_value(alpha, 0), theta)
    return found - on.mean(per_theta) * on.rise(theta)


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
    fraction, velocity = entering_flow(inflow, "solids")
    source = levels.span / dt * inflow.sources.solids + levels.previous_source
    found = ((alpha - levels.start.alpha) / dt - source) * w * on.dx
    through = weight * Face(flux.inner * upwind, leaving) + known
    found += on.out(through, w, *IMPERMEABLE)
    found += (weight.edge * inflow.passes * leaving + known.edge) * w * on.ds("outlet")
    entering = fraction * velocity * inflow.profile.edge
    return found + (known.edge - weight.edge * entering) * w * on.ds("inlet")

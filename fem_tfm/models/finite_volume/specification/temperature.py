# SPDX-License-Identifier: LGPL-3.0-or-later
"""The sources of the granular energy equation of a step."""

from __future__ import annotations

from typing import Any

import ufl

from fem_tfm.models.finite_volume.specification.data import present
from fem_tfm.models.finite_volume.specification.facets import FacetForms
from fem_tfm.models.pointwise import GranularEnergy


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

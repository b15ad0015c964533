# SPDX-License-Identifier: LGPL-3.0-or-later
"""Implicit upwind transport of a scale, for Theta, turbulence and the momentum."""

from __future__ import annotations

from typing import Any

import ufl

from fem_tfm.models.finite_volume.specification.facets import PARTS, Face, FacetForms, larger


def transported(
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
    return sink * x * w * on.dx + transported(on, x, w, flux, spread, free, *PARTS)


def transport_source(on: FacetForms, w: Any, flux: Face, gain: Any, entering: Any) -> ufl.Form:
    """Right-hand side of `transport`: gain per volume, and X that enters with the flux."""
    return gain * w * on.dx + ufl.max_value(-flux.edge, 0) * entering * w * on.ds("inlet")

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Eddies of a state at walls and planes of symmetry, and a step of the scales of turbulence."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any

import ufl

from fem_tfm.closures.turbulence.dispersed import Grains
from fem_tfm.closures.turbulence.gas import Eddies
from fem_tfm.models.finite_volume.specification.data import present
from fem_tfm.models.finite_volume.specification.facets import FacetForms
from fem_tfm.models.finite_volume.turbulence import LARGEST_STEP, SMALLEST_CHANGE
from fem_tfm.models.pointwise import Pointwise, tangential


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
    speed = point.speed(slip)
    g0, kinetic = point.kinetic(alpha, at.theta, point.drag(alpha, speed, height))
    steep = ufl.sqrt(alpha**2 + ufl.dot(crowding, crowding) * size**2 / 4)
    drift = -ufl.dot(slip, crowding) / steep
    viscosity = kinetic.shear_viscosity
    return point.grains(alpha, at.theta, g0, viscosity, speed, height, drift, eddies)


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

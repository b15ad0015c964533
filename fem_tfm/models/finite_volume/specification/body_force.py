# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forces on faces, which balance pressure and weight there, and what the cells take of them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import ufl

from fem_tfm.models.finite_volume.specification.data import present
from fem_tfm.models.finite_volume.specification.facets import Face, FacetForms


def face_force(
    on: FacetForms,
    phase: SimpleNamespace,
    p: Any,
    gravity: Any,
    lifted: Any,
    inflow: SimpleNamespace,
) -> Face:
    """Force along the normals of inner faces and the outlet [N/m3].

        f = a (rho - rho_lifted) g.n - a rise(p)/(n.d) - push/(n.d) + dispersion

    a : fraction that the face bears; p vanishes outside of the outlet, p_s does not change there
    push : rise(p_s) of the solids without `thermal_rise`, rise of the pressure of the gas's eddies
    """
    weight = Face.of(ufl.dot, on.normal, gravity) * (phase.density.faces - lifted)
    force = phase.face_fraction * (weight - on.rise(p, 0) * on.weight) + phase.dispersion_force
    force = force - (on.rise(phase.pressure) - phase.thermal_rise) * on.weight
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

# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the parts of a step exchange, in UFL: fields and constants in place of their arrays."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import ufl

from fem_tfm.models.finite_volume.cells.line import LineMesh
from fem_tfm.models.finite_volume.specification.facets import Face, FacetForms, larger
from fem_tfm.models.finite_volume.state import (
    SMALLEST_FRACTION,
    Density,
    Inflow,
    Phase,
    Sources,
    TurbulenceCoefficients,
)
from fem_tfm.models.finite_volume.time_levels import GasBalance, TimeLevels


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
    of_faces = "dispersion_force", "implicit_correction", "thermal_rise"
    sizes |= dict.fromkeys(of_faces, cells.face_count)
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


def entering_flow(inflow: SimpleNamespace, phase: str) -> tuple[Any, Any]:
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

# SPDX-License-Identifier: LGPL-3.0-or-later
"""The unsteady flow converges to a manufactured solution that feels every term."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from boxes import HEX, box, flow
from unsteady_strong import Exact, Strong

from fem_tfm.mesh import Mesh
from fem_tfm.models.unsteady import Feed, Flow3D

# a box of 1 m, flows of 1 m/s, and numbers for which every term counts
SCENE: dict[str, Any] = {
    "gas": {"density": 2.0, "viscosity": 0.01},
    "solids": {
        "density": 20.0,
        "diameter": 0.02,
        "restitution": 0.9,
        "friction_limit": 0.3,
    },
    "closures.drag": "wen-yu",
    "closures.radial": "carnahan-starling",
    "closures.friction": {"model": "dartevelle", "coefficient": 20.0, "width": 0.05},
    "operation.gas_superficial_velocity": 1.0,
}
FIELDS = ("alpha", "theta", "u_s", "u_g", "p")


def waves(x: np.ndarray, t: float) -> tuple[np.ndarray, ...]:
    """Cosines even about both ends of y and z, their sines, and a swing in time."""
    y, z = np.pi * (x[1] + 0.5), np.pi * x[2]
    return np.cos(y), np.sin(y), np.cos(z), np.sin(z), np.cos(2 * t + 0.3), np.sin(2 * t)


def alpha(x: np.ndarray, t: float) -> np.ndarray:
    cy, _, cz, _, c, s = waves(x, t)
    return 0.3 + 0.1 * c * cy * cz + 0.05 * s * cz


def theta(x: np.ndarray, t: float) -> np.ndarray:
    cy, _, cz, _, c, s = waves(x, t)
    return 0.1 * (1 + 0.3 * c * cz - 0.3 * s * cy * cz)


def pressure(x: np.ndarray, t: float) -> np.ndarray:
    cy, _, cz, _, c, _ = waves(x, t)
    return 5.0 * c * cy + 3.0 * cy * cz


def solids_velocity(x: np.ndarray, t: float) -> np.ndarray:
    cy, sy, cz, sz, c, s = waves(x, t)
    return np.stack([0 * cy, c * sy**3 * sz**2 * cz, 0.8 * (1 + 0.5 * s) * sz**3 * sy**2])


def gas_velocity(x: np.ndarray, t: float) -> np.ndarray:
    cy, sy, cz, sz, c, s = waves(x, t)
    return np.stack([0 * cy, (1 - 0.5 * s) * sy**3 * sz**2, 1.3 * c * sz**3 * sy**2 * cy])


EXACT = Exact(alpha, theta, pressure, solids_velocity, gas_velocity)


def errors(mesh: Mesh, order: int, dt: float, end: float, wanted: Any = None) -> dict[str, float]:
    """L2 errors of all fields over their size, at the end of a run from the exact state."""
    found = flow(mesh, {**SCENE, "numerics.order": order})
    return difference(found, *march(found, dt, end))


def march(found: Flow3D, dt: float, end: float) -> None:
    """Run from the exact state at time 0 to `end`."""
    strong, x = Strong(found.case, EXACT), found.cells.centre.T
    found.start(alpha(x, 0.0))
    found.now = replace(found.now, theta=theta(x, 0.0), p=pressure(x, 0.0))
    found.move(solids_velocity(x, 0.0).T, gas_velocity(x, 0.0).T)
    own = x[:, : found.cells.owned]
    for k in range(round(end / dt)):
        found.advance(dt, Feed(1.0, inside=strong.sources(own, (k + 1) * dt)))


def wrong(found: Flow3D) -> dict[str, float]:
    """L2 errors of the fields over their size; the pressure is known but for a constant."""
    cells, t = found.cells, found.time
    x, volume = cells.centre.T[:, : cells.owned], cells.volume[: cells.owned]
    result = {}
    for name in FIELDS:
        exact = getattr(EXACT, name)(x, t).T
        error = getattr(found.now, name)[: cells.owned] - exact
        if name == "p":
            error = error - cells.total(error * volume) / cells.total(volume)
        weight = volume if error.ndim == 1 else volume[:, None]
        size = cells.total(weight * exact**2)
        result[name] = (cells.total(weight * error**2) / size) ** 0.5
    return result

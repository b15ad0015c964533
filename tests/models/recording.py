# SPDX-License-Identifier: LGPL-3.0-or-later
"""One step of unsteady flows on small curved meshes with all that its equations have exchanged."""

from __future__ import annotations

import inspect
import math
from dataclasses import dataclass, field, replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sparse

from fem_tfm import Case
from fem_tfm.models.finite_volume import Inflow, UnsteadyFlow, scheme
from fem_tfm.models.finite_volume.cells.krylov import Krylov
from fem_tfm.models.finite_volume.cells.mesh import Array
from fem_tfm.models.finite_volume.specification.data import inflow_fields
from fem_tfm.models.finite_volume.specification.facets import FacetForms
from fem_tfm.models.finite_volume.state import Sources
from fem_tfm.models.pointwise import Pointwise

DT = 2e-4

COAL = {
    "gas": {"density": 33.5, "viscosity": 1.8e-5},
    "solids": {"density": 1700.0, "diameter": 1.6e-4, "restitution": 0.7},
    "operation": {
        "gas_superficial_velocity": 6.43,
        "solids_fraction": 0.2,
        "solids_velocity": 6.0,
    },
    "solution": "unsteady",
    "closures": {
        "drag": "three-zone",
        "friction": "berzi",
        "turbulence": "mixing-length",
        "dispersed": "none",
        "dispersion": "none",
    },
    "walls": {"gas": "log-law", "solids": "schneiderbauer"},
    "inlet": {"profile": "power-law"},
    "numerics": {"end_time": 1.0},
}
SHAPES: dict[str, dict[str, Any]] = {
    "pipe": {"shape": "pipe", "diameter": 0.01, "length": 0.03},
    "bend": {
        "shape": "bend",
        "diameter": 0.01,
        "length": 0.147,
        "bend_radius": 0.03,
        "bend_angle_deg": 90.0,
        "bend_start": 0.05,
        "bend_towards": "up",
    },
    "sheared": {"shape": "duct", "width": 0.01, "height": 0.01, "length": 0.03},
}
FLOWS: dict[str, dict[str, Any]] = {
    "mixing length": {"numerics.order": 0},
    "mixing length, blocked outlet": {
        "numerics.order": 1,
        "closures.slip_production": "koch",
        "walls.solids": {"model": "johnson-jackson", "restitution": 0.5},
    },
    "four equations": {
        "numerics.order": 1,
        "closures.pressure_force": "alpha",
        "closures.slip_production": "koch",
        "closures.free_path": "agrawal",
        "closures.turbulence": "realizable",
        "closures.dispersed": {"model": "k-epsilon", "normal_stress": 1.0},
        "closures.dispersion": "burns",
        "walls.gas": "log-law-k",
    },
    "ideal gas": {
        "numerics.order": 1,
        "gas": {"species": "N2", "pressure": 2.92e6, "viscosity": 1.8e-5, "compressible": True},
        "closures.turbulence": "k-epsilon",
        "closures.dispersed": "simonin",
    },
    "ideal gas, first order": {
        "numerics.order": 0,
        "gas": {"species": "N2", "pressure": 2.92e6, "viscosity": 1.8e-5, "compressible": True},
        "closures.turbulence": "k-epsilon",
        "closures.dispersed": "tchen",
    },
}
TURBULENT = [kind for kind, changes in FLOWS.items() if "closures.turbulence" in changes]


@dataclass
class Recorder:
    """What the parts of a step were given and have given back, and their linear systems.

    calls : arguments and result of each call of a method, by a name
    systems : matrix, right-hand side and solution of each linear solve within it
    """

    calls: dict[str, list[tuple[dict[str, Any], Any]]] = field(default_factory=dict)
    systems: dict[str, list[tuple[sparse.csr_array, Array, Array]]] = field(default_factory=dict)
    _within: list[str] = field(default_factory=list)

    def watch(self, patch: pytest.MonkeyPatch, owner: Any, method: str, name: str = "") -> None:
        """Keep the calls of a function; without a name by that of the part that calls it."""
        run, signature = getattr(owner, method), inspect.signature(getattr(owner, method))

        def watched(*args: Any, **kwargs: Any) -> Any:
            self._within.append(name or f"{self._within[-1]}: {method}")
            found = run(*args, **kwargs)
            given = dict(signature.bind(*args, **kwargs).arguments)
            self.calls.setdefault(self._within.pop(), []).append((given, found))
            return found

        patch.setattr(owner, method, watched)

    def watch_solvers(self, patch: pytest.MonkeyPatch) -> None:
        """Keep all linear systems."""
        solve = Krylov.solve

        def watched(krylov: Krylov, rhs: Array, *args: Any) -> Array:
            start, columns, values = krylov.matrix.matrix.getValuesCSR()
            matrix = sparse.csr_array((values.copy(), columns, start))
            found = solve(krylov, rhs, *args)
            self.systems.setdefault(self._within[-1], []).append((matrix, rhs.copy(), found))
            return found

        patch.setattr(Krylov, "solve", watched)


class RecordedStep:
    """A step of a flow: its equations as arrays, and the mesh, the laws and the inflow in UFL.

    flow, line, cells, on : the flow, its mesh as arrays and in UFL
    recorder : calls and linear systems of the step
    point, inflow : laws at a point, and what enters in UFL
    given : what enters, as numbers and arrays
    """

    def __init__(self, shape: str, kind: str) -> None:
        self.flow = flow = flowing(shape, kind)
        self.line, self.cells, self.on = flow.line, flow.cells, FacetForms(flow.cells)
        given = Inflow(6.43, 0.2, 6.0, sources=sources(flow))
        for _ in range(2):
            flow.advance(DT, given)
        feed = replace(given, blocked="blocked" in kind)
        self.recorder = recorder = Recorder()
        with pytest.MonkeyPatch.context() as patch:
            recorder.watch_solvers(patch)
            for part in ("fraction", "temperature", "turbulence"):
                if getattr(flow, part):
                    recorder.watch(patch, getattr(flow, part), "solve", part)
            for method in ("phases", "forces", "solve"):
                recorder.watch(patch, flow.momentum, method, f"momentum: {method}")
            recorder.watch(patch, flow.temperature.transport, "solve")
            if flow.turbulence:
                recorder.watch(patch, flow.turbulence, "coefficients", "eddies")
            recorder.watch(patch, flow.pressure, "project", "pressure")
            recorder.watch(patch, flow.laws, "solids_pressure")
            recorder.watch(patch, scheme, "limit_flux")
            if flow.ideal_gas:
                recorder.watch(patch, flow.ideal_gas, "balance", "ideal gas")
            flow.advance(DT, feed)
        self.point = flow.problem.pointwise()
        self.given, self.inflow = feed, inflow_fields(self.on, feed, flow.line)

    def part(self, name: str) -> tuple[SimpleNamespace, Any]:
        """Arguments and result of the last call of a part; its argument `step` is what it knows."""
        given, found = self.recorder.calls[name][-1]
        return SimpleNamespace(**given), found

    def correction(
        self, flux: Array, values: Array, scale: Array | float, gradient: Array | None = None
    ) -> Array:
        """Flux of the scheme's values on faces less that of upwind ones."""
        shape = self.cells.face_count, *values.shape[1:]
        return np.zeros(shape) + self.flow.scheme.correction(flux, values, scale, gradient)

    @property
    def profile(self) -> tuple[Any, Any]:
        """Height of the gas's profile and its stretching, in UFL."""
        height, slope = (self.on.cell(values) for values in self.line.gas_profile)
        return height, slope

    @property
    def local_point(self) -> Pointwise:
        """The laws at a point, with the density of the gas of the step."""
        if not self.flow.ideal_gas:
            return self.point
        return self.point.with_density(self.on.cell(self.part("ideal gas")[1].relative_density))


def flowing(shape: str, kind: str) -> UnsteadyFlow:
    """A flow with smooth random fields."""
    axial = {"pipe": 8, "bend": 12, "sheared": 8}[shape]
    changes = {"numerics.axial_cells": axial, "numerics.level": 1}
    given = Case.from_dict({**COAL, "geometry": SHAPES[shape]}).with_values(changes | FLOWS[kind])
    mesh = given.scene.mesh()
    if shape == "sheared":
        x = mesh.mesh.geometry.x
        x[:, 1] += math.tan(math.radians(30.0)) * x[:, 2]
    flow = UnsteadyFlow(given.scene.problem(), mesh)
    random = np.random.default_rng(1)
    place = flow.cells.centre / 0.01

    def smooth(*shape: int) -> Array:
        """Waves of random directions, between -1 and 1."""
        found = np.zeros((flow.cells.count, *shape))
        for index in np.ndindex(*shape):
            found[:, *index] = np.sin(place @ random.uniform(-1, 1, 3) * 3 + random.uniform(0, 6))
        return found

    flow.initialise(0.3 + 0.25 * smooth(), 0.05 * np.exp(smooth()), 500 * smooth())
    axis = flow.mesh.axis(flow.cells.centre)
    flow.set_velocities(4.0 * axis + smooth(3), 6.0 * axis + 2.0 * smooth(3))
    return flow


def sources(flow: UnsteadyFlow) -> Sources:
    """Volumes, forces and energy that come into every cell."""
    owned = flow.cells.owned
    wave = np.sin(np.arange(owned))
    force = 50 * np.stack([wave, wave**2, 1 - wave], axis=1)
    return Sources(0.1 * wave, 0.2 * wave**2, force, -force, 100 * wave)


recorded_step = cache(RecordedStep)

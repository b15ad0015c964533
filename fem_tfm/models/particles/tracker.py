# SPDX-License-Identifier: LGPL-3.0-or-later
"""The tracker: moves parcels through the field of a gas.

    dx/dt = v,   dv/dt = a + B (U + u' - v),   B = 18 mu f(Re)/(rho_p d^2),  f = C_D Re/24

The kernel is told everything in numbers here; the laws are those of the registry.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

import fem_tfm._kernel as _kernel
from fem_tfm import signals
from fem_tfm.closures.base import Closure, law
from fem_tfm.closures.drag import Drag, stokes
from fem_tfm.closures.particles.dispersion import ParticleDispersion
from fem_tfm.closures.particles.impact import ImpactLaw
from fem_tfm.errors import InputError
from fem_tfm.materials import Fluid, Gas, Solids
from fem_tfm.models.particles import migration
from fem_tfm.models.particles.cloud import INSIDE, OUT, Parcels
from fem_tfm.models.particles.encounters import Encounters
from fem_tfm.models.particles.field import Field
from fem_tfm.models.particles.migration import Moving
from fem_tfm.models.particles.sinks import Sinks
from fem_tfm.parameters import Parameters, parameter

# the kernel comes back after this time, so that a run can be stopped [s]
PATIENCE = 0.5
# a law of drag depends on the Reynolds number alone if its factor does to this share
ALONE = 1e-6
# largest number of steps that the kernel counts
COUNTED = 2_000_000_000
DISPERSION = {"none": 0, "langevin": 1, "eddies": 2}
IMPACT = {"elastic": 0, "restitution": 1, "stick": 2}


@dataclass(frozen=True)
class Steps(Parameters):
    """Length of a step: the least of the first four, but never below the last.

    Eddies and relaxation are shares of T_L and of the time in which drag acts; a step crosses no
    more than one cell.
    """

    eddies: float = parameter(1.0, "-", "largest step over the life of an eddy", gt=0, le=2)
    relaxation: float = parameter(1.0, "-", "largest step over the relaxation time", gt=0, le=100)
    per_cell: float = parameter(1.0, "-", "least number of steps across a cell", ge=1, le=100)
    largest: float | None = parameter(
        None, "s", "largest step, default 0.4 diameters at the gas's largest speed", gt=0, le=10
    )
    smallest: float = parameter(1e-7, "s", "smallest step", gt=0, le=1)
    max_steps: int = parameter(
        1_000_000, "-", "steps after which a parcel is stuck", ge=1, le=COUNTED
    )
    table: ClassVar[str] = "particles.steps"


@dataclass(frozen=True)
class Forces(Parameters):
    """Forces on particles beside those of walls."""

    drag: Drag = law("drag", "clift-gauvin", "drag of a particle", "particles.drag")
    gravity: tuple[float, float, float] = parameter(
        (0.0, 0.0, 0.0), "m/s2", "acceleration of gravity along x, y, z"
    )
    buoyancy: bool = parameter(True, doc="weight less that of the gas displaced")
    pressure_gradient: bool = parameter(False, doc="force of the gas's pressure gradient")
    saffman: bool = parameter(False, doc="lift in a shear flow")
    magnus: bool = parameter(False, doc="lift and drag of rotation")
    added_mass: float = parameter(
        0.0, "-", "coefficient of the added mass, 0.5 for spheres", ge=0, le=10
    )
    heat: bool = parameter(False, doc="heat exchange with the gas")
    table: ClassVar[str] = "particles"


@dataclass(frozen=True)
class Report:
    """What an advance did: steps, impacts, places that had to be searched for, collisions."""

    steps: int
    bounces: int
    strays: int
    collisions: int


class Impacts:
    """Impacts on walls, collected by `Tracker.advance`."""

    def __init__(self) -> None:
        self.kernel = _kernel.Impacts()

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """All of this rank so far by id and step: id, step, x, v before, normal out, time."""
        rows = self.kernel.sorted()
        return {
            "id": rows[:, 0].astype(np.int64),
            "step": rows[:, 1].astype(np.int64),
            "x": rows[:, 3:6],
            "v": rows[:, 6:9],
            "normal": rows[:, 9:12],
            "time": rows[:, 12],
        }


class Tracker:
    """Moves parcels of given materials.

    Parameters
    ----------
    materials : by their number in `Parcels.material`
    forces, dispersion, impact, steps : laws and step lengths
    seed : of all random numbers
    threads : of this process
    variant : of the kernel, "avx512", "avx2" or "plain"; the best by default

    Raises
    ------
    InputError
        a value is out of range.
    """

    def __init__(
        self,
        materials: Sequence[Solids],
        forces: Forces | None = None,
        dispersion: Closure | str = "none",
        impact: Closure | str = "elastic",
        steps: Steps | None = None,
        *,
        seed: int = 0,
        threads: int = 1,
        variant: str | None = None,
        heat_capacity: Sequence[float] | None = None,
    ) -> None:
        from fem_tfm.closures.base import make

        if not materials:
            raise InputError("particles.materials", 0, "at least one material")
        if not 0 <= seed < 2**63:
            raise InputError("particles.seed", seed, "a whole number from 0 to 2^63 - 1")
        if threads < 1:
            raise InputError("particles.threads", threads, "a whole number of at least 1")
        self.materials, self.forces, self.steps = (
            list(materials),
            forces or Forces(),
            steps or Steps(),
        )
        self.seed, self.threads = seed, threads
        self.variant = variant or _kernel.VARIANT
        found = make("particle-dispersion", dispersion, "particles.dispersion")
        assert isinstance(found, ParticleDispersion)
        self.dispersion = found
        hit = make("impact", impact, "particles.impact")
        assert isinstance(hit, ImpactLaw)
        self.impact = hit
        self.heat_capacity = np.array(heat_capacity or [1000.0] * len(materials), dtype=float)
        self._tables: dict[tuple[float, float], tuple[npt.NDArray[np.float32], bool]] = {}

    def advance(
        self,
        parcels: Parcels,
        field: Field,
        *,
        until_z: float | None = None,
        until_time: float | None = None,
        sinks: Sinks | None = None,
        impacts: Impacts | None = None,
        encounters: Encounters | None = None,
        leave: bool = False,
        progress: Callable[[float], None] | None = None,
        request: signals.Request | None = None,
    ) -> Report:
        """Move every parcel inside to a plane z [m], or to a time of its clock [s].

        The last step ends there but for a small miss, which stays. With `leave` those that arrive
        are out. With `encounters` particles collide with what it holds, and it is told what they
        do. `progress` hears the share done, at least once a second, and `request` is looked at as
        often. Where other ranks hold parts of
        the field's grid, all move their parcels at once, and each ends with those in its cells
        (collective).

        Raises
        ------
        KeyboardInterrupt
            a rank was asked to stop; all raise it, with parcels on their way.
        RuntimeError
            another rank has failed.
        InputError
            not exactly one end is given, or sizes differ from those of a material whose drag is no
            function of the Reynolds number alone.
        """
        if (until_z is None) == (until_time is None):
            raise InputError("particles.until", until_z, "either until_z or until_time")
        end = until_z if until_z is not None else until_time
        options = self._options(field, parcels)
        options |= {"until_time": until_time is not None, "end": float(end)}  # type: ignore[arg-type]
        sums = ({} if sinks is None else sinks.for_kernel()) | (
            {} if encounters is None else encounters.for_kernel()
        )
        migration.locate(parcels, field.grid)
        queue, arrived = Moving.of(parcels, field.grid), list[Moving]()
        most = migration.portion(parcels, field.grid)
        totals = np.zeros(4, dtype=np.int64)
        while True:
            moving, waiting = queue.turn(most)
            with signals.together(field.grid.comm):
                totals += self._run(moving, field, options, sums, impacts, progress, request)
            more = migration.handed_over(moving, field.grid, sum(len(w.parcels) for w in waiting))
            if more is None:
                break
            arrived.append(moving.select(moving.parcels.status != _kernel.AWAY))
            queue, progress = migration.joined([more, *waiting]), None
        if arrived:
            migration.put_in_order([*arrived, moving], parcels)
        if leave:
            parcels.status[parcels.status == INSIDE] = OUT
        return Report(*(int(n) for n in totals))

    def _run(
        self,
        moving: Moving,
        field: Field,
        options: dict[str, Any],
        sums: dict[str, Any],
        impacts: Impacts | None,
        progress: Callable[[float], None] | None,
        request: signals.Request | None,
    ) -> npt.NDArray[np.int64]:
        """Move parcels to the end or out of this rank's cells; the numbers of `Report`."""
        given = (
            field.grid.kernel,
            field.grid.walls.for_kernel(),
            field.for_kernel(),
            options,
            moving.arrays(),
            sums,
            None if impacts is None else impacts.kernel,
            self.variant,
            self.threads,
        )
        chunk, totals, count = 0, np.zeros(4, dtype=np.int64), len(moving.parcels)
        while chunk >= 0:
            if request is not None and request.made:
                raise KeyboardInterrupt
            chunk, *counts = _kernel.advance(*given, chunk, PATIENCE)
            totals += counts
            if progress is not None and chunk >= 0:
                progress(min(chunk * _kernel.CHUNK / max(count, 1), 1.0))
        return totals

    # -- numbers of the kernel -----------------------------------------------------------------

    def _options(self, field: Field, parcels: Parcels) -> dict[str, Any]:
        forces, steps = self.forces, self.steps
        largest = steps.largest
        if largest is None:
            largest = 0.4 * field.grid.width / max(field.fastest(), 1e-300)
        return {
            "seed": self.seed,
            "gravity": list(forces.gravity),
            "buoyancy": forces.buoyancy,
            "pressure": forces.pressure_gradient,
            "saffman": forces.saffman,
            "magnus": forces.magnus,
            "heat": forces.heat,
            "added_mass": forces.added_mass,
            "drag": self._drag(field, parcels),
            "particle_heat_capacity": self.heat_capacity,
            "eddies": steps.eddies,
            "relaxation": steps.relaxation,
            # impacts on facets are looked for among those beside the cell of a step's middle
            "cells": max(steps.per_cell, 2.0)
            if field.grid.walls.kind == "planes"
            else steps.per_cell,
            "largest": min(largest, 1e6),
            "smallest": steps.smallest,
            "max_steps": steps.max_steps,
            **self.dispersion.numbers(),
            **self.impact.numbers(),
        }

    def _drag(self, field: Field, parcels: Parcels) -> npt.NDArray[np.float32]:
        """Tables of all materials; they are made once for a gas."""
        key = field.density, field.viscosity
        if key not in self._tables:
            gas = Gas(*key)
            made = [drag_table(self.forces.drag, gas, solids) for solids in self.materials]
            alone = all(depends_on_reynolds(self.forces.drag, gas, s) for s in self.materials)
            self._tables[key] = np.concatenate(made), alone
        tables, alone = self._tables[key]
        if not alone:
            sizes = np.array([s.diameter for s in self.materials])[parcels.material]
            moves = parcels.diameter > 0
            fit = np.allclose(parcels.diameter[moves], sizes[moves], rtol=1e-12, atol=0)
            if not field.grid.comm.allreduce(fit, MPI.LAND):
                words = "a law of the Reynolds number alone for particles of several sizes"
                raise InputError("particles.drag", self.forces.drag.name, words)
        return tables


def drag_factor(
    law: Drag, reynolds: npt.NDArray[np.float64], gas: Fluid, solids: Solids
) -> npt.NDArray[np.float64]:
    """C_D Re/24 of a lone grain: beta/alpha_s at alpha_s = 0 over that of Stokes."""
    slip = reynolds * gas.viscosity / (gas.density * solids.diameter)
    values = law.specific(0.0, slip, gas, solids) / stokes(gas, solids)
    return np.broadcast_to(np.asarray(values, dtype=float), reynolds.shape)


def depends_on_reynolds(law: Drag, gas: Fluid, solids: Solids) -> bool:
    """Whether the factor is a function of the Reynolds number alone."""
    from dataclasses import replace

    reynolds = np.logspace(-3, 4, 40)
    twice = replace(solids, diameter=min(2 * solids.diameter, 0.1))
    half = replace(solids, diameter=solids.diameter / 2)
    one, other = (drag_factor(law, reynolds, gas, s) for s in (half, twice))
    return bool(np.allclose(one, other, rtol=ALONE, atol=0))


def drag_table(law: Drag, gas: Fluid, solids: Solids) -> npt.NDArray[np.float32]:
    """Coefficients of a cubic in each piece of the Reynolds number, (pieces, 4).

    Sixteen pieces an octave; the cubic goes through the law at Chebyshev's points, which leaves an
    error below 1e-6.
    """
    pieces, octaves = _kernel.DRAG_PIECES, _kernel.DRAG_OCTAVES
    x = (1 - np.cos(np.pi * (np.arange(4) + 0.5) / 4)) / 2 / pieces
    lows = 1 + np.arange(pieces) / pieces
    scale = 2.0 ** (_kernel.DRAG_FIRST + np.arange(octaves))
    reynolds = scale[:, None, None] * (lows[:, None] + x)
    values = drag_factor(law, reynolds.ravel(), gas, solids).reshape(-1, 4)
    # x in units of the mantissa
    inverse = np.linalg.inv(np.vander(x, 4, increasing=True))
    return np.ascontiguousarray((values @ inverse.T).astype(np.float32))

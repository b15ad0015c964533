# SPDX-License-Identifier: LGPL-3.0-or-later
"""The error of a march: what a second one with cells and steps twice as large changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from mpi4py import MPI

from fem_tfm.errors import InputError, SolverError
from fem_tfm.models.line import Line
from fem_tfm.scenes.judged.finer import halved_mesh
from fem_tfm.solvers import nested

# steps of the coarser march over those of the march; its cells are twice as large, too
LONGER = 2.0
SECOND_WORDS = "the line again with cells and steps twice as large"
# time of both marches over that of the first, measured on lines of both models
BOTH_OVER_FIRST = 1.2


@dataclass(frozen=True)
class Estimated:
    """What was found with a line, and how well it is known.

    quantities : by name
    errors : estimated error of each, empty where there is none
    unestimated : why there is none
    """

    quantities: Mapping[str, float]
    errors: Mapping[str, float | None] = field(default_factory=dict)
    unestimated: str = ""


def with_errors(scene: Any, line: Line, recorder: Any) -> Estimated:
    """Quantities of a line that was marched, and their errors by a second march.

    The second march goes without the particles, which a gas that does not feel them does not need.

    Raises
    ------
    InputError
        Gmsh makes no mesh with cells twice as large.
    TimeIsUp
        the time of the run is over.
    """
    found = line.quantities()
    if why := unavailable(scene):
        return Estimated(found, unestimated=why)
    physics = replace(scene, particles=None).physics
    recorder.second()
    coarse = physics.line(recorder.comm, coarser=True)
    try:
        coarse.begin()
        coarse.march(recorder.second_station, recorder.retry)
        physics.check_balances(coarse.balances())
        changed = nested.with_changes([coarse.quantities(), found])
    except SolverError as error:
        recorder.log(f"second march: {error}")
        why = f"the march with cells and steps twice as large has no answer: {error}"
        return Estimated(found, unestimated=why)
    finally:
        recorder.second_ends(coarse)
        coarse.station.newton.destroy()
    return Estimated(*changed)


def unavailable(scene: Any) -> str:
    """Why there is no error estimate of a march, an empty text where there is one."""
    if not scene.numerics.error_estimate:
        return "numerics.error_estimate = false"
    cloud = scene.particles
    if cloud is not None and cloud.coupling != "one-way":
        return "the gas feels its particles, and these are followed through one march alone"
    try:
        halved_mesh(scene.physics, MPI.COMM_SELF, -1)
    except InputError:
        return "the section carries no mesh with cells twice as large"
    return ""

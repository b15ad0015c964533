# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes with halved and doubled cells, and answers on finer ones where meshes disagree."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from mpi4py import MPI

from fem_tfm.errors import InputError, SolverError
from fem_tfm.geometry.mesh import Mesh, section_mesh
from fem_tfm.scenes.judged.answer import doubtful
from fem_tfm.solvers import nested

# core cells over the hydraulic diameter of a mesh that holds no bed well, and of one that is for a
# quick look; share of the section that is packed from which there is a bed
HOLDS_NO_BED, QUICK_LOOK, LEAST_BED = 0.15, 0.11, 0.02
# largest solids fraction from which grains run in a strand, and how much it is above the hold-up
STRAND, GATHERED = 0.2, 4.0
# meshes beyond the finest that the scene asks for, each with half its cells' size, and their budget
MOST_MESHES, MOST_UNKNOWNS = 2, 60_000


def halved_mesh(physics: Any, comm: MPI.Comm, number: int) -> Callable[[], Mesh]:
    """Maker of a mesh whose cells are so often half as large as on the finest mesh of a scene.

    number : below zero for cells that are twice as large

    Raises
    ------
    InputError
        the section carries no such mesh.
    """
    section, size = physics.section, physics.resolution.core_size(physics.section) / 2**number
    resolution = replace(physics.resolution, mesh_size=size)
    resolution.core_size(section)
    return partial(section_mesh, section, resolution, comm)


def trusted(
    scene: Any, solution: nested.Solution, limits: tuple[float, int], recorder: Any
) -> dict[str, Any]:
    """What the answer is made of, on finer meshes where those of the scene disagree.

    Where the only other mesh is too coarse for the bed or strand of the answer, the two may agree
    by chance: a finer mesh follows, or a note where the mesh is for a quick look.

    limits : tolerance and largest number of steps

    Raises
    ------
    SolverError
        a state is no answer, or a finer mesh has none.
    """
    physics, found = scene.physics, recorder.take(solution)
    bedded = unresolved(physics, solution, found)
    if bedded and physics.resolution.core_size(physics.section) > QUICK_LOOK * _width(physics):
        found["notes"] = [*found.get("notes", ()), f"{bedded}: raise numerics.level"]
        bedded = ""
    for number in range(1, MOST_MESHES + 1):
        doubt = doubtful(scene, found["quantities"], found["errors"]) or bedded
        if not doubt or 4 * solution.section.dofs > MOST_UNKNOWNS:
            break
        recorder.tell(f"{doubt}; a finer mesh follows")
        try:
            mesh = halved_mesh(physics, recorder.comm, number)
            nested.refine(solution, mesh, physics.setup(), *limits, recorder, physics.scheme)
        except InputError:
            # the section carries no finer mesh
            break
        except SolverError as error:
            if doubt == bedded:
                found["notes"] = [*found.get("notes", ()), f"{bedded}; a finer mesh has no answer"]
                break
            raise SolverError(f"{doubt}, and a finer mesh has no answer: {error}") from error
        bedded = ""
        found = recorder.take(solution, number)
        note = f"the mesh that the case asks for: {doubt}; this answer is from a finer one"
        found["notes"] = [*found.get("notes", ()), note]
    return dict(found)


def _width(physics: Any) -> float:
    return float(physics.section.hydraulic_diameter)


def unresolved(physics: Any, solution: nested.Solution, found: Mapping[str, Any]) -> str:
    """Why two meshes tell too little of the error of a bed or strand; empty where they do not."""
    coarse = 2 * physics.resolution.core_size(physics.section)
    if len(solution.levels) != 2 or coarse < HOLDS_NO_BED * _width(physics):
        return ""
    values = found["quantities"]
    bed, densest = values.get("bed_fraction", 0.0), values.get("max_solids_fraction", 0.0)
    if bed >= LEAST_BED:
        what = f"{100 * bed:.0f} % of the section is a bed"
    elif densest >= max(STRAND, GATHERED * values.get("holdup", 0.0)):
        what = f"the solids gather in a strand of fraction {densest:.2g}"
    else:
        return ""
    return (
        f"{what}, for which the coarser of the two meshes is too coarse, so that the error may be"
        " larger than its estimate"
    )

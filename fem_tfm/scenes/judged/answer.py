# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is no answer, and what an answer must say of itself."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from fem_tfm.errors import SolverError
from fem_tfm.output.split_picture import PARTS
from fem_tfm.scenes.judged.gas import absolute_pressure
from fem_tfm.scenes.judged.plausible import LARGEST_DROP, crowded

# an estimated error above this share of its quantity tells that meshes disagree
LARGEST_ERROR = 0.2
# quantities whose estimate must be below it
TRUSTED = ("pressure_gradient", "pressure_drop", "holdup", "friction_factor")
# what disagrees: the meshes of a section, and a march with a coarser one
DISAGREE = (
    "the meshes disagree, so there is no answer",
    "the march and one with cells and steps twice as large disagree, so there is no answer: raise"
    " numerics.level or lower numerics.axial_accuracy",
)
# drop over the absolute pressure from which a gas of one density is wrong
NOTICED_DROP = 0.1
# below this length over the diameter nothing tells whether a march has developed
SHORT = 20.0
# a march whose quantities still change beyond this share of the line has not developed
DEVELOPED_AT = 0.9


def judge(scene: Any, answer: Any) -> list[str]:
    """What an answer must say of itself, one sentence each.

    Raises
    ------
    SolverError
        it is no answer: its meshes disagree, or the gas expands far too much for one density.
    """
    if doubt := doubtful(scene, answer.quantities, answer.errors):
        raise SolverError(f"{doubt}; {DISAGREE[scene.solution == 'developing']}")
    found = answer.quantities
    said = [*_expansion(scene, found), *_development(scene, found)]
    wall = getattr(scene.model, "solids_wall", None)
    # what is given was judged before
    if wall is not None and not crowded(wall, scene.feed.solids_fraction):
        said += crowded(wall, found.get("holdup"))
    return said


def doubtful(scene: Any, found: Mapping[str, float], errors: Mapping[str, float | None]) -> str:
    """Why the meshes disagree, an empty text where they do not."""
    lengths = {"pressure_gradient": scene.geometry.length, "pressure_drop": 1.0}
    for name in TRUSTED:
        error = errors.get(name)
        if error is None or name not in found:
            continue
        size = abs(found[name])
        if name in lengths:
            # a drop in which weight and friction cancel is as exact as its parts
            size = max(size, sum(abs(found.get(part, 0.0)) for part in PARTS) / lengths[name])
        if not error <= LARGEST_ERROR * size:
            words = name.replace("_", " ")
            return (
                f"{words} {found[name]:.4g} has an estimated error of {error:.2g}, above"
                f" {100 * LARGEST_ERROR:.0f} % of it"
            )
    return ""


def with_expansion(drop: float, density_at: float, outlet: float) -> float:
    """Drop of a gas that expands at constant temperature [Pa]; nan where none is possible.

        p_in^2 - p_out^2 = 2 p_density drop

    drop : of the gas of one density
    density_at, outlet : absolute pressure of that density, and at the outlet [Pa]
    """
    square = outlet**2 + 2 * density_at * drop
    return math.sqrt(square) - outlet if square > 0 else math.nan


def _expansion(scene: Any, found: Mapping[str, float]) -> list[str]:
    """How far a gas of one density is wrong; raises SolverError where it is very wrong."""
    drop = found.get("pressure_drop", math.nan)
    if scene.model.gas.compressible or not math.isfinite(drop):
        return []
    pressure, guessed = absolute_pressure(scene)
    outlet = scene.feed.outlet_pressure or pressure
    share = abs(drop) / outlet
    if share <= NOTICED_DROP:
        return []
    better = with_expansion(drop, pressure, outlet)
    told = (
        f"the pressure drop of {drop:.4g} Pa is {100 * share:.0f} % of the absolute pressure"
        f" {outlet:.4g} Pa at the outlet{f' ({guessed})' if guessed else ''}, and the gas has one"
        " density"
    )
    if share > LARGEST_DROP:
        raise SolverError(
            f"{told}; no answer above {100 * LARGEST_DROP:.0f} %. With isothermal expansion the"
            f" drop would be about {better:.4g} Pa: shorten the line, or solve it in parts"
        )
    return [
        f"{told}: with isothermal expansion it would be about {better:.4g} Pa,"
        f" an error of {drop - better:+.2g} Pa"
    ]


def _development(scene: Any, found: Mapping[str, float]) -> list[str]:
    """Whether a march still develops at its outlet."""
    place, length = found.get("development_length"), scene.geometry.length
    if place is None:
        return []
    diameters = length / scene.geometry.hydraulic_diameter
    if place <= DEVELOPED_AT * length and diameters < SHORT:
        return [
            f"the line is {diameters:.2g} diameters long, too short to tell whether its flow has"
            " developed; solution = 'developed' gives the gradient far downstream"
        ]
    if place <= DEVELOPED_AT * length:
        return []
    return [
        f"the flow is not developed at the outlet: it changes by more than 1 % up to"
        f" {place:.4g} of {length:.4g} m, so pressure_gradient and entrance_pressure_drop are"
        " those of this length"
    ]

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Numbers of the grains of any scene, one size at a time, and what they give away."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from fem_tfm.correlations import cunningham, rizk_velocity, terminal_velocity
from fem_tfm.scenes.judged.gas import Derived

# density [kg/m3] and its ratio to that of the gas below which grains were hardly meant
LIGHT_GRAINS, LIGHT_RATIO = 20.0, 3.0
# the smallest grain that a gas carries as a continuum [m], the factor by which it may slip along
# it, and the least width of a line in grains
SMALLEST_GRAIN, LARGEST_SLIP = 1e-6, 1.15
# discrete grains in a tube, and grains that are followed or averaged as a phase
NARROWEST, NARROWEST_PHASE = 3.0, 8.0
# lines steeper than this do not let grains settle [deg]
STEEP = 45.0


def of_the_grains(scene: Any, grains: Any, key: str, blamed: bool) -> Iterator[Derived]:
    """Density, slip and size of the grains of a scene.

    grains : with a density and a diameter
    key : of their table
    blamed : whether the gas is doubted, from which ratios to it follow
    """
    gas, width = scene.model.gas, scene.geometry.hydraulic_diameter
    ratio, doubt = grains.density / gas.density, ""
    if grains.density < LIGHT_GRAINS or (ratio < LIGHT_RATIO and not blamed):
        doubt = f"is {key}.density = {grains.density:g} in kg/m3, not in g/cm3?"
    yield Derived("solids density over that of the gas", ratio, "", doubt)
    slip, doubt = cunningham(gas, grains.diameter), ""
    if grains.diameter < SMALLEST_GRAIN or (slip > LARGEST_SLIP and not blamed):
        doubt = (
            f"the gas slips along grains of {1e6 * grains.diameter:g} um, Brownian motion spreads"
            f" them and adhesion holds them, which no law here knows; is {key}.diameter ="
            f" {grains.diameter:g} in m?"
        )
    yield Derived("slip of the gas along a grain, by Cunningham", slip, "", doubt)
    across, doubt = width / grains.diameter, ""
    if across < (NARROWEST if scene.model.flow == "slug" else NARROWEST_PHASE):
        doubt = f"grains block such a line; is {key}.diameter = {grains.diameter:g} in m?"
    yield Derived("width of the line in grain diameters", across, "", doubt)


def of_falling(scene: Any, grains: Any) -> Derived:
    """Terminal velocity, and whether the gas of a rising line lifts a grain."""
    falling, doubt = terminal_velocity(scene.model.gas, grains, scene.feed.gravity), ""
    inclination, speed = scene.geometry.inclination_deg, scene.feed.gas_velocity
    if is_steep(scene) and speed < falling * math.sin(math.radians(inclination)):
        doubt = (
            f"the gas rises at {speed:g} m/s, more slowly than a grain falls: it lifts"
            " none but a dense plug"
        )
    return Derived("terminal velocity of a grain", falling, "m/s", doubt)


def of_saltation(scene: Any, grains: Any, mass_flow: float, doubt: str = "") -> Derived:
    """Rizk's saltation velocity of a level line.

    mass_flow : of the grains [kg/s]
    doubt : what to say where the gas is slower
    """
    speed = saltation_velocity(scene, grains, mass_flow)
    below = bool(scene.feed.gas_velocity < speed)
    words = "below: a bed is to be expected" if below else "above: no bed is to be expected"
    unit = f"m/s (the gas is {words})"
    return Derived("saltation velocity by Rizk", speed, unit, doubt if below else "")


def saltation_velocity(scene: Any, grains: Any, mass_flow: float) -> float:
    """Superficial velocity of the gas below which grains begin to settle, by Rizk [m/s].

    mass_flow : of the grains [kg/s]
    """
    width, gravity = scene.geometry.hydraulic_diameter, scene.feed.gravity
    return float(rizk_velocity(mass_flow, width, scene.model.gas, grains, gravity))


def is_steep(scene: Any) -> bool:
    """Whether grains fall along a line and not to its bottom."""
    return bool(abs(scene.geometry.inclination_deg) > STEEP)

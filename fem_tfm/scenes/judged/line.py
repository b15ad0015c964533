# SPDX-License-Identifier: LGPL-3.0-or-later
"""Numbers of the line of any scene, as they are given, and what they give away."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from fem_tfm.scenes.judged.gas import SHORTEST_LINE, Derived

# a line that is wider [m] or longer over its diameter was hardly meant, nor such a gravity [m/s2]
WIDEST, LONGEST, HEAVIEST = 1.0, 2e4, 20.0
# the longest line with a bend over its diameter: bends are solved in time, all of them
LONGEST_BEND = 1000.0
# angles that are usual in degrees, looked for in radians, and how closely: rounded to two digits
USUAL, CLOSE = (10.0, 15.0, 20.0, 30.0, 45.0, 60.0, 90.0, 180.0), 5.5e-3
# pressure at the outlet over that of the gas, outside of which one of them is wrong
LIKE_GAS, LIKE_COMPRESSIBLE = (0.5, 2.0), (0.05, 20.0)


def of_the_line(scene: Any) -> Iterator[Derived]:
    """Width, length, angles and gravity of a line; those alone that give something away."""
    geometry, feed = scene.geometry, scene.feed
    width = geometry.hydraulic_diameter
    if width > WIDEST and geometry.length >= SHORTEST_LINE * width:
        doubt = "is the width of the line in m, not in cm, mm or inches?"
        yield Derived("hydraulic diameter", width, "m", doubt)
    if geometry.length > (LONGEST if geometry.arc is None else LONGEST_BEND) * width:
        doubt = f"is geometry.length = {geometry.length:g} in m, not in mm?"
        yield Derived("line longer than usual, in diameters", geometry.length / width, "", doubt)
    for name in ("inclination_deg", "bend_angle_deg"):
        angle = getattr(geometry, name, 0.0)
        if in_radians(angle):
            doubt = (
                f"is geometry.{name} in degrees, not in radians ({math.degrees(angle):.0f} deg)?"
            )
            yield Derived("angle of the line", angle, "deg", doubt)
    if feed.gravity > HEAVIEST:
        doubt = "is operation.gravity in m/s2, not in ft/s2?"
        yield Derived("gravity", feed.gravity, "m/s2", doubt)


def of_the_pressures(scene: Any) -> Iterator[Derived]:
    """Whether the pressure at the outlet is that of another gas."""
    feed, gas = scene.feed, scene.model.gas
    if feed.outlet_pressure and gas.pressure:
        low, high = LIKE_GAS if not gas.compressible else LIKE_COMPRESSIBLE
        share = feed.outlet_pressure / gas.pressure
        if not low <= share <= high:
            doubt = (
                f"the gas has its density at gas.pressure = {gas.pressure:g} Pa, and leaves at"
                f" operation.outlet_pressure = {feed.outlet_pressure:g} Pa; which one is meant?"
            )
            yield Derived("pressure at the outlet over that of the gas", share, "", doubt)


def in_radians(angle: float) -> bool:
    """Whether an angle in degrees is a usual one in radians."""
    return any(abs(abs(angle) - math.radians(usual)) <= CLOSE for usual in USUAL)

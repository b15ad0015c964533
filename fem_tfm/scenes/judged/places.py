# SPDX-License-Identifier: LGPL-3.0-or-later
"""Places that a scene names must lie in its line."""

from __future__ import annotations

from typing import Any

import numpy as np

from fem_tfm.errors import InputError
from fem_tfm.geometry.section import RoundSection
from fem_tfm.geometry.shapes import Shape


def check_places(geometry: Shape, output: Any, initial: Any) -> None:
    """Refuse sections, probes and beds outside of the line.

    Raises InputError with the place and the bounds of the line.
    """
    length, height = geometry.length, geometry.size[1]
    for place in output.sections:
        if not 0 <= place <= length:
            words = f"places from 0 to geometry.length = {length:g} m"
            raise InputError("output.sections", place, words)
    for point in output.probes:
        if not _inside(geometry, point):
            raise InputError("output.probes", list(point), _bounds(geometry))
    if initial.bed_end is not None and initial.bed_end > length:
        words = f"a place up to geometry.length = {length:g} m"
        raise InputError("initial.bed_end", initial.bed_end, words)
    if initial.bed_height is not None and initial.bed_height > height:
        words = f"a height up to that of the section, {height:g} m"
        raise InputError("initial.bed_height", initial.bed_height, words)


def check_step(geometry: Shape, step: float | None) -> None:
    """Refuse a largest step of a march that is longer than its line.

    Raises InputError with the step and the length of the line.
    """
    if step is not None and step > geometry.length:
        words = f"a step up to geometry.length = {geometry.length:g} m"
        raise InputError("numerics.axial_step", step, words)


def _inside(geometry: Shape, point: tuple[float, ...]) -> bool:
    """Whether a point lies in the part of the line that is solved."""
    at = np.array([point], dtype=float)
    x, y, s = (at if geometry.arc is None else geometry.arc.straightened(at))[0]
    section = geometry.section()
    if section.symmetry != "none" and x < 0:
        return False
    width, height = section.size
    if isinstance(section, RoundSection):
        across = bool(np.hypot(x, y) <= width / 2)
    else:
        across = abs(x) <= width / 2 and abs(y) <= height / 2
    return across and 0 <= s <= geometry.length


def _bounds(geometry: Shape) -> str:
    """Where probes may stand, in words."""
    (width, height), where = geometry.size, ""
    if geometry.arc is None:
        where = f", z from 0 to {geometry.length:g} m"
    part = "" if geometry.section().symmetry == "none" else ", x >= 0 (the rest is a mirror image)"
    return f"points [x, y, z] inside the line, {width:g} by {height:g} m across{where}{part}"

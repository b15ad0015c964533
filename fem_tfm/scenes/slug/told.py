# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tables and pictures of the slugs of a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fem_tfm.models.slug.told import cross_sections, slugs
from fem_tfm.models.slug.told.cross_sections import Still
from fem_tfm.models.slug.told.slices import SLICE, Samples
from fem_tfm.output.profiles import write_profiles
from fem_tfm.output.slug import pictures
from fem_tfm.output.slug.wear import WallWear

type Floats = NDArray[np.float64]
BINS = 21
# half width of the average slug [m]
REACH = 0.08
UNITS = {
    "place": "m", "rate": "1/s", "top_velocity": "m/s", "length": "m", "offset": "m",
    "velocity": "m/s", "temperature": "m2/s2", "drag": "N", "contact": "N", "wall_stress": "Pa",
    "weight": "Pa", "height": "m", "spread": "m/s", "first": "s", "last": "s", "from": "m",
    "to": "m", "speed": "m/s",
}  # fmt: skip
# sections of a slug, and the part of the tube around one that is drawn [m]
STILLS, PART = 20, 0.113
PROFILE = ("porosity", "velocity", "temperature", "drag", "contact", "wall_stress")


@dataclass
class Seen:
    """Grains at the end of a run.

    frames : time, (across, up, radius) as a film shows them and velocity along the tube of all
        grains
    stills : grains in the middle of the tube at every sample
    box : that holds the frames: left, bottom, right, top [m]
    """

    frames: Sequence[tuple[float, Floats, Floats]] = field(default_factory=list)
    stills: Sequence[Still] = field(default_factory=list)
    box: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0)


def write(
    out: Path, samples: Samples, scene: Any, seen: Seen, wear: WallWear | None = None
) -> None:
    """Tables of the slugs, their pictures and the film, and the wear of the wall."""
    if wear is not None and wear.seconds > 0:
        wear.write(out, scene.title, scene.output.pictures)
    chosen = samples.after(scene.begin)
    if len(chosen.time) < 2:
        chosen = samples
    columns, average = along(chosen, scene), profile(chosen, scene)
    _table(out / "slugs.csv", tracks(chosen, scene))
    _table(out / "along.csv", columns)
    _table(out / "profile.csv", average)
    stills = passing(samples, scene, seen.stills)
    sheared = layers(stills, scene)
    if stills:
        _table(out / "layers.csv", sheared)
    if not scene.output.pictures:
        return
    porosity = 1 - np.array(samples.solids)
    place, time = samples.middle, np.array(samples.time)
    pictures.porosity_picture(out / "porosity.png", time, place, porosity, scene.title)
    seconds = chosen.time[-1] - chosen.time[0]
    pictures.slugs_picture(out / "slugs.png", columns, average, scene.title, seconds)
    if stills:
        section, (low, high) = scene.geometry.section("none"), _middle(scene)
        made = [cross_sections.picture(still, section, low, high) for still in stills]
        pictures.sections_picture(out / "sections.png", made, sheared, scene.title)
    if len(seen.frames) > 1:
        bent = scene.geometry.arc is not None
        pictures.film(out / "film.gif", seen.frames, seen.box, bent)
        if not bent:
            _draw_longest(out / "slug.png", samples, scene, seen.frames)


def _draw_longest(
    path: Path, samples: Samples, scene: Any, frames: Sequence[tuple[float, Floats, Floats]]
) -> None:
    """The longest slug of the film that is whole in the tube's stretch."""
    low, high = scene.stretch
    found, times = [], {frame[0]: frame for frame in frames}
    for track in slugs.follow(samples, scene.averages.porosity, scene.averages.shortest):
        found += [s for s in track.within(low, high).sightings if s.time in times]
    if found:
        best = max(found, key=lambda s: (s.length, s.time))
        low = min(max(best.centre - PART / 2, 0.0), max(scene.geometry.length - PART, 0.0))
        pictures.side_picture(path, times[best.time], low, low + PART, scene.geometry.size[1])


def _middle(scene: Any) -> tuple[float, float]:
    """The slice in the middle of the tube [m]."""
    middle = scene.geometry.length / 2
    return middle - SLICE / 2, middle + SLICE / 2


def passing(samples: Samples, scene: Any, stills: Sequence[Still]) -> list[Still]:
    """The stills around the time at which the last slug passes the middle; empty if none does."""
    found = slugs.follow(samples, scene.averages.porosity, scene.averages.shortest)
    times = np.array([still.time for still in stills])
    for at in sorted((t.crossing(scene.geometry.length / 2) for t in found), reverse=True):
        first = int(np.searchsorted(times, at)) - STILLS // 2 if np.isfinite(at) else -1
        if 0 <= first <= len(stills) - STILLS:
            return list(stills[first : first + STILLS])
    return []


def layers(stills: Sequence[Still], scene: Any) -> dict[str, Floats]:
    """Velocity over the height in a slug that passes the middle, and its spread."""
    section, (low, high) = scene.geometry.section("none"), _middle(scene)
    limit = (1 - scene.averages.porosity) * section.area * (high - low)
    found = [cross_sections.layers(still, section, low, high) for still in stills]
    found = [one for one in found if one.solids.sum() > limit]
    if not found:
        return {name: np.empty(0) for name in ("height", "velocity", "spread")}
    weight = np.array([one.solids for one in found])
    some = np.where(weight.sum(axis=0) > 0, weight.sum(axis=0), np.nan)
    v, sd = (np.nan_to_num([getattr(one, n) for one in found]) for n in ("velocity", "spread"))
    mean = (weight * v).sum(axis=0) / some
    square = (weight * (sd**2 + v**2)).sum(axis=0) / some
    spread = np.sqrt(np.maximum(square - mean**2, 0.0))
    return {"height": found[0].height, "velocity": mean, "spread": spread}


def _table(path: Path, columns: dict[str, Floats]) -> None:
    stems = {name: name.partition(" ")[0] for name in columns}
    write_profiles(path, columns, {n: UNITS[s] for n, s in stems.items() if s in UNITS})


def tracks(samples: Samples, scene: Any) -> dict[str, Floats]:
    """A row for each slug that was followed for some samples."""
    given = scene.averages
    found = [
        t
        for t in slugs.follow(samples, given.porosity, given.shortest)
        if len(t.sightings) >= slugs.LEAST
    ]

    def mean(name: str) -> Floats:
        return np.array([np.mean([getattr(s, name) for s in t.sightings]) for t in found])

    return {
        "first": np.array([t.time[0] for t in found]),
        "last": np.array([t.time[-1] for t in found]),
        "from": np.array([t.centre[0] for t in found]),
        "to": np.array([t.centre[-1] for t in found]),
        "speed": np.array([t.speed() for t in found]),
        "length": mean("length"),
        "porosity": mean("porosity"),
        "least_porosity": mean("least_porosity"),
        "velocity": mean("velocity"),
        "grains": mean("grains"),
    }


def along(samples: Samples, scene: Any) -> dict[str, Floats]:
    """Numbers of the slugs by their place, with standard errors and quartiles."""
    given = scene.averages
    found = slugs.along(samples, BINS, given.porosity, given.shortest)
    columns = {"place": found.place}
    for name in ("rate", "least_porosity", "top_velocity", "length"):
        estimates = getattr(found, name)
        columns[name] = np.array([e.value for e in estimates])
        columns[f"{name} error"] = np.array([e.error for e in estimates])
        for rank, values in zip(("lower", "upper"), found.quartiles.get(name, ()), strict=False):
            columns[f"{name} {rank} quartile"] = values
    return columns


def profile(samples: Samples, scene: Any) -> dict[str, Floats]:
    """The average slug in the middle of the stretch, with standard errors."""
    low, high = scene.stretch
    reach = min(REACH, scene.geometry.length / 4)
    found = slugs.profile(samples, (low + high) / 2, reach, (0.0, np.inf), (0.0, np.inf))
    columns = {"offset": found.offset}
    for name in PROFILE:
        mean, error = getattr(found, name)
        columns |= {name: mean, f"{name} error": error}
    # what grains at rest press on the wall, shared by its whole circumference
    section, pull = (
        scene.geometry.section("none"),
        scene.geometry.gravity_vector(scene.feed.gravity),
    )
    across = scene.model.solids.density * float(np.hypot(*pull[:2]))
    columns["weight"] = (1 - found.porosity[0]) * across * section.area / section.perimeter
    return columns

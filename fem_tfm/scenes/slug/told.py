# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tables and pictures of the slugs of a run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fem_tfm.models.slug import slugs
from fem_tfm.models.slug.slices import Samples
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
    "first": "s", "last": "s", "from": "m", "to": "m", "speed": "m/s",
}  # fmt: skip
PROFILE = ("porosity", "velocity", "temperature", "drag", "contact", "wall_stress")


class Film(NamedTuple):
    """Grains as a film shows them, and the box that holds them: left, bottom, right, top [m]."""

    frames: Sequence[tuple[float, Floats, Floats]]
    box: tuple[float, float, float, float]


def write(
    out: Path, samples: Samples, scene: Any, film: Film, wear: WallWear | None = None
) -> None:
    """Tables of the slugs, their pictures and the film, and the wear of the wall."""
    if wear is not None and wear.seconds > 0:
        wear.write(out, scene.title, scene.output.pictures)
    chosen = samples.after(scene.begin)
    if len(chosen.time) < 2:
        chosen = samples
    columns, average = along(chosen), profile(chosen, scene)
    _table(out / "slugs.csv", tracks(chosen, scene))
    _table(out / "along.csv", columns)
    _table(out / "profile.csv", average)
    if not scene.output.pictures:
        return
    porosity = 1 - np.array(samples.solids)
    place, time = samples.middle, np.array(samples.time)
    pictures.porosity_picture(out / "porosity.png", time, place, porosity, scene.title)
    seconds = chosen.time[-1] - chosen.time[0]
    pictures.slugs_picture(out / "slugs.png", columns, average, scene.title, seconds)
    if len(film.frames) > 1:
        pictures.film(out / "film.gif", film.frames, film.box, scene.geometry.arc is not None)


def _table(path: Path, columns: dict[str, Floats]) -> None:
    stems = {name: name.removesuffix(" error") for name in columns}
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


def along(samples: Samples) -> dict[str, Floats]:
    """Numbers of the slugs by their place, with standard errors."""
    found = slugs.along(samples, BINS)
    columns = {"place": found.place}
    for name in ("rate", "least_porosity", "top_velocity", "length"):
        estimates = getattr(found, name)
        columns[name] = np.array([e.value for e in estimates])
        columns[f"{name} error"] = np.array([e.error for e in estimates])
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
    return columns

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Slugs in samples of a tube: found by their porosity, followed in time, counted and averaged.

A slug is a run of slices whose porosity is below 0.6. It is as long as its slices together; slopes
at its ends that are more porous do not belong to it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from fem_tfm.models.slug.told.slices import Samples

Array = npt.NDArray[np.float64]
# porosity that bounds a slug, and the shortest run that counts as one [m]
POROSITY, SHORTEST = 0.6, 0.01
# length of the blocks whose means tell a statistical error [s]
BLOCK = 2.0
# samples that a track has at least where its speed is measured
LEAST = 5


@dataclass(frozen=True)
class Sighting:
    """One slug in one sample.

    begin, end, centre : along the tube, the centre that of mass [m]
    porosity, least_porosity : mean and minimum over its slices
    velocity, top_velocity : mean and maximum of the grains' velocity [m/s]
    grains : number of grains in it
    """

    time: float
    begin: float
    end: float
    centre: float
    porosity: float
    least_porosity: float
    velocity: float
    top_velocity: float
    grains: float

    @property
    def length(self) -> float:
        """[m]."""
        return self.end - self.begin


@dataclass
class Track:
    """One slug from its first to its last sighting."""

    sightings: list[Sighting] = field(default_factory=list)

    @property
    def time(self) -> Array:
        """Times of the sightings [s]."""
        return np.array([s.time for s in self.sightings])

    @property
    def centre(self) -> Array:
        """Centres of mass [m]."""
        return np.array([s.centre for s in self.sightings])

    def within(self, low: float, high: float) -> Track:
        """The sightings whose centre is between two places [m]."""
        return Track([s for s in self.sightings if low <= s.centre <= high])

    def speed(self) -> float:
        """Slope of a line through the centres in time [m/s]; no number for a short track."""
        if len(self.sightings) < LEAST:
            return float("nan")
        return float(np.polyfit(self.time, self.centre, 1)[0])

    def crossing(self, z: float) -> float:
        """Time at which the centre passes a place for the first time [s]; no number if never."""
        c = self.centre
        passed = np.flatnonzero((c[:-1] < z) & (c[1:] >= z))
        if not len(passed):
            return float("nan")
        n = int(passed[0])
        t = self.time
        return float(t[n] + (z - c[n]) / (c[n + 1] - c[n]) * (t[n + 1] - t[n]))


def sighted(
    samples: Samples, number: int, limit: float = POROSITY, shortest: float = SHORTEST
) -> list[Sighting]:
    """Slugs in one sample, upstream first."""
    solids, flux = samples.solids[number], samples.flux[number][:, 2]
    dense = np.concatenate([[False], 1 - solids < limit, [False]])
    change = np.flatnonzero(dense[1:] != dense[:-1])
    width = samples.edges[1] - samples.edges[0]
    found = []
    for first, last in zip(change[::2], change[1::2], strict=True):
        if (last - first) * width < shortest * (1 - 1e-9):
            continue
        part, moved = solids[first:last], flux[first:last]
        found.append(
            Sighting(
                samples.time[number],
                float(samples.edges[first]),
                float(samples.edges[last]),
                float((part * samples.middle[first:last]).sum() / part.sum()),
                float(1 - part.mean()),
                float(1 - part.max()),
                float(moved.sum() / part.sum()),
                float((moved / part).max()),
                float(part.sum() * width * samples.area / samples.grain_volume),
            )
        )
    return found


def follow(samples: Samples, limit: float = POROSITY, shortest: float = SHORTEST) -> list[Track]:
    """Tracks of all slugs.

    A slug is the one of the sample before with which it shares most of its length; where two have
    merged, the one that shares more goes on.
    """
    tracks: list[Track] = []
    present: list[Track] = []
    for number in range(len(samples.time)):
        seen = sighted(samples, number, limit, shortest)
        pairs = sorted(
            (
                (min(s.end, t.sightings[-1].end) - max(s.begin, t.sightings[-1].begin), a, b)
                for a, t in enumerate(present)
                for b, s in enumerate(seen)
            ),
            key=lambda pair: (-pair[0], pair[1], pair[2]),
        )
        taken_tracks, taken_slugs, going = set(), set(), []
        for shared, a, b in pairs:
            if shared <= 0 or a in taken_tracks or b in taken_slugs:
                continue
            taken_tracks.add(a)
            taken_slugs.add(b)
            present[a].sightings.append(seen[b])
            going.append(present[a])
        for b, s in enumerate(seen):
            if b not in taken_slugs:
                tracks.append(Track([s]))
                going.append(tracks[-1])
        present = going
    return tracks


@dataclass(frozen=True)
class Estimate:
    """A mean and its standard error."""

    value: float
    error: float

    @classmethod
    def of(cls, values: npt.ArrayLike) -> Estimate:
        """Mean of independent values, without those that are no number."""
        x = np.asarray(values, dtype=float)
        x = x[np.isfinite(x)]
        if not len(x):
            return cls(float("nan"), float("nan"))
        error = x.std(ddof=1) / np.sqrt(len(x)) if len(x) > 1 else float("nan")
        return cls(float(x.mean()), float(error))

    @classmethod
    def in_time(cls, time: npt.ArrayLike, values: npt.ArrayLike, block: float = BLOCK) -> Estimate:
        """Mean of a time series; its error is that of the means over blocks of time [s]."""
        t, x = np.asarray(time, dtype=float), np.asarray(values, dtype=float)
        if not len(x):
            return cls(float("nan"), float("nan"))
        number = max(int((t[-1] - t[0]) / block + 0.5), 1)
        means = [part.mean() for part in np.array_split(x, number) if len(part)]
        return cls(float(x.mean()), cls.of(means).error)

    def __str__(self) -> str:
        return f"{self.value:.4g} +- {self.error:.2g}"


@dataclass(frozen=True)
class SlugStatistics:
    """Numbers of the slugs in a stretch of the tube; a slug's own are means over its sightings.

    pressure_gradient [Pa/m], grains_in_tube : over time
    slug_velocity, slug_length, slug_porosity, least_porosity, grain_velocity, top_grain_velocity,
    slug_grains : over the slugs
    slug_rate : slugs that pass the middle of the stretch [1/s], its error that of a count
    slugs : number of slugs that have been followed there
    """

    pressure_gradient: Estimate
    grains_in_tube: Estimate
    slug_velocity: Estimate
    slug_length: Estimate
    slug_porosity: Estimate
    least_porosity: Estimate
    grain_velocity: Estimate
    top_grain_velocity: Estimate
    slug_grains: Estimate
    slug_rate: Estimate
    slugs: int


def statistics(
    samples: Samples, low: float, high: float, limit: float = POROSITY, shortest: float = SHORTEST
) -> SlugStatistics:
    """Statistics of the slugs whose centres are between two places [m].

    What is longer than this stretch is no slug but a filled tube, which `bulk` tells.
    """
    tracks = follow(samples, limit, shortest)
    short = [Track([s for s in t.sightings if s.length < high - low]) for t in tracks]
    inside = [t for t in (t.within(low, high) for t in short) if len(t.sightings) >= LEAST]

    def mean(name: str) -> Estimate:
        return Estimate.of([np.mean([getattr(s, name) for s in t.sightings]) for t in inside])

    length = samples.edges[-1] - samples.edges[0]
    return SlugStatistics(
        Estimate.in_time(samples.time, np.asarray(samples.drop) / length),
        Estimate.in_time(samples.time, samples.count),
        Estimate.of([t.speed() for t in inside]),
        mean("length"),
        mean("porosity"),
        mean("least_porosity"),
        mean("velocity"),
        mean("top_velocity"),
        mean("grains"),
        rate(samples, tracks, (low + high) / 2),
        len(inside),
    )


def bulk(samples: Samples, length: float, limit: float = POROSITY) -> float:
    """Share of the samples in which grains fill the tube over more than a length [m]."""
    found = [
        any(s.length >= length for s in sighted(samples, number, limit, length))
        for number in range(len(samples.time))
    ]
    return float(np.mean(found)) if found else 0.0


def rate(samples: Samples, tracks: list[Track], z: float) -> Estimate:
    """Slugs that pass a place in a second [1/s].

    The error is that of a count, sqrt(n), and of one slug where none has passed.
    """
    number = int(np.isfinite([t.crossing(z) for t in tracks]).sum())
    duration = samples.time[-1] - samples.time[0]
    return Estimate(number / duration, float(np.sqrt(max(number, 1))) / duration)


@dataclass(frozen=True)
class Along:
    """Numbers of the slugs by their place, the counterpart of figures 8 to 11 of the paper.

    place : middles of the bins [m]
    rate : slugs that pass [1/s]
    least_porosity, top_velocity, length : means (bins,) and their errors
    quartiles : of these three, (2, bins)
    """

    place: Array
    rate: list[Estimate]
    least_porosity: list[Estimate]
    top_velocity: list[Estimate]
    length: list[Estimate]
    quartiles: dict[str, Array]


def along(
    samples: Samples, bins: int = 21, limit: float = POROSITY, shortest: float = SHORTEST
) -> Along:
    """Numbers of the slugs in bins along the tube; a slug counts once in every bin."""
    edges = np.linspace(samples.edges[0], samples.edges[-1], bins + 1)
    tracks, names = follow(samples, limit, shortest), ("least_porosity", "top_velocity", "length")
    means: dict[str, list[Estimate]] = {name: [] for name in names}
    spread: dict[str, list[Array]] = {name: [] for name in names}
    for low, high in pairwise(edges):
        inside = [t for t in (t.within(low, high) for t in tracks) if t.sightings]
        for name in names:
            values = [np.mean([getattr(s, name) for s in t.sightings]) for t in inside]
            means[name].append(Estimate.of(values))
            nothing = np.full(2, np.nan)
            spread[name].append(np.quantile(values, [0.25, 0.75]) if values else nothing)
    middle = (edges[1:] + edges[:-1]) / 2
    rates = [rate(samples, tracks, z) for z in middle]
    return Along(
        middle,
        rates,
        means["least_porosity"],
        means["top_velocity"],
        means["length"],
        {name: np.array(values).T for name, values in spread.items()},
    )


@dataclass(frozen=True)
class Profile:
    """The average slug at a place, the counterpart of figures 12 to 16 of the paper.

    offset : from the centre of mass, downstream positive [m]
    porosity; velocity of the grains [m/s]; temperature, a third of the mean square of the
    velocity's fluctuation in a slice [m2/s2]; drag and contact force on a grain along the tube [N];
    wall stress [Pa]: means and standard errors (2, n)
    """

    offset: Array
    porosity: Array
    velocity: Array
    temperature: Array
    drag: Array
    contact: Array
    wall_stress: Array
    slugs: int


def profile(
    samples: Samples,
    place: float,
    reach: float,
    lengths: tuple[float, float] = (0.02, 0.08),
    velocities: tuple[float, float] = (0.19, 0.39),
) -> Profile:
    """Average of the slugs that pass a place, whose length and grain velocity are in a range."""
    width = samples.edges[1] - samples.edges[0]
    number = int(reach / width)
    offset = width * np.arange(-number, number + 1)
    rows: dict[str, list[Array]] = {name: [] for name in _PROFILES}
    for track in follow(samples):
        at = track.crossing(place)
        if not np.isfinite(at):
            continue
        seen = min(track.sightings, key=lambda s: abs(s.time - at))
        fits = lengths[0] <= seen.length <= lengths[1]
        if not (fits and velocities[0] <= seen.top_velocity <= velocities[1]):
            continue
        fields = _fields(samples, samples.time.index(seen.time))
        for name, values in fields.items():
            z = seen.centre + offset
            rows[name].append(np.interp(z, samples.middle, values, np.nan, np.nan))
    count = len(rows["porosity"])

    def mean(name: str) -> Array:
        columns = np.array(rows[name]).T if count else np.empty((len(offset), 0))
        estimates = [Estimate.of(column) for column in columns]
        return np.array([[e.value for e in estimates], [e.error for e in estimates]])

    return Profile(offset, **{name: mean(name) for name in _PROFILES}, slugs=count)


_PROFILES = ("porosity", "velocity", "temperature", "drag", "contact", "wall_stress")


def _fields(samples: Samples, n: int) -> dict[str, Array]:
    """Fields of one sample over the slices."""
    solids = np.maximum(samples.solids[n], 1e-300)
    velocity = samples.flux[n] / solids[:, None]
    square = samples.square[n] / solids
    per_grain = samples.grain_volume / solids
    return {
        "porosity": 1 - samples.solids[n],
        "velocity": velocity[:, 2],
        "temperature": np.maximum(square - (velocity**2).sum(axis=1), 0.0) / 3,
        "drag": samples.drag[n] * per_grain,
        "contact": samples.contact[n] * per_grain,
        "wall_stress": samples.wall_stress[n],
    }

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Averages over slices along the axis of the tube, sampled in time."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from fem_tfm.models.slug.tube import SlugTube

Array = npt.NDArray[np.float64]
# length of a slice [m]
SLICE = 3.5e-3


def volume_below(height: Array, radius: Array) -> Array:
    """Volume of spheres below a plane at a height over their centres [m3]."""
    h = np.clip(height, -radius, radius)
    return np.asarray(np.pi * (2 * radius**3 / 3 + radius**2 * h - h**3 / 3))


def shares(z: Array, radius: Array, edges: Array) -> tuple[npt.NDArray[np.int64], Array]:
    """Slices that each sphere reaches and its volume in them, both (n, m)."""
    width = edges[1] - edges[0]
    most = int(np.ceil(2 * radius.max(initial=0.0) / width)) + 1
    first = np.floor((z - radius - edges[0]) / width).astype(np.int64)
    number = first[:, None] + np.arange(most)
    low = edges[0] + width * number - z[:, None]
    r = radius[:, None]
    volume = volume_below(low + width, r) - volume_below(low, r)
    volume[(number < 0) | (number >= len(edges) - 1)] = 0.0
    return np.clip(number, 0, len(edges) - 2), volume


@dataclass
class Samples:
    """Time series over slices, one row a sample.

    area : of the section [m2], grain_volume : mean volume of a grain [m3]
    solids : volume fraction of the grains
    flux : of grain volume (slices, 3), across and along the tube [m/s]; over `solids` it is their
        velocity
    square : solids times the mean square of the grains' velocity [m2/s2]
    drag : force of the gas on the grains along the tube, per volume of the tube [N/m3]
    contact : force of grains and walls on the grains along the tube [N/m3]
    wall_stress : normal force on the wall per its area [Pa]
    pressure : P' at the planes of the mesh [Pa]
    drop, count : pressure drop [Pa], grains inside
    """

    edges: Array
    area: float
    grain_volume: float
    time: list[float] = field(default_factory=list)
    solids: list[Array] = field(default_factory=list)
    flux: list[Array] = field(default_factory=list)
    square: list[Array] = field(default_factory=list)
    drag: list[Array] = field(default_factory=list)
    contact: list[Array] = field(default_factory=list)
    wall_stress: list[Array] = field(default_factory=list)
    pressure: list[Array] = field(default_factory=list)
    drop: list[float] = field(default_factory=list)
    count: list[int] = field(default_factory=list)

    @property
    def middle(self) -> Array:
        """Middles of the slices [m]."""
        return (self.edges[1:] + self.edges[:-1]) / 2

    def close(self) -> None:
        """Nothing to free."""

    def after(self, time: float) -> Samples:
        """The samples after a time [s]."""
        keep = [n for n, t in enumerate(self.time) if t > time]
        chosen: dict[str, Any] = {
            f.name: [getattr(self, f.name)[n] for n in keep]
            for f in fields(self)
            if isinstance(getattr(self, f.name), list)
        }
        return replace(self, **chosen)


class Sampler:
    """Takes samples of a tube: `tube.run(31.0, sampler)`.

    slice_length : of the slices [m], made to fit the tube

    fastest : speed of the fastest grain in the last sample [m/s]
    """

    def __init__(self, tube: SlugTube, slice_length: float = SLICE) -> None:
        length = tube.shape.length
        number = max(round(length / slice_length), 1)
        volume = tube.grains.grain.mean_mass / tube.grains.grain.density
        self.fastest = 0.0
        self.samples = Samples(np.linspace(0.0, length, number + 1), tube.section.area, volume)

    def __call__(self, tube: SlugTube) -> None:
        """Take one sample."""
        s, grains = self.samples, tube.grains.everything()
        along, radius = grains.straight[:, 2], grains.radius
        velocity = tube.in_line(grains.place, grains.velocity)
        number, volume = shares(along, radius, s.edges)
        width, size = s.edges[1] - s.edges[0], len(s.edges) - 1
        part = volume / (4 / 3 * np.pi * radius[:, None] ** 3)

        def total(weights: Array, values: Array) -> Array:
            """Sum over the slices per their volume."""
            given = (weights * values[:, None]).ravel()
            return np.bincount(number.ravel(), given, minlength=size) / (s.area * width)

        s.time.append(tube.time)
        s.solids.append(total(volume, np.ones(len(radius))))
        s.flux.append(np.stack([total(volume, velocity[:, d]) for d in range(3)], axis=-1))
        s.square.append(total(volume, (velocity**2).sum(axis=1)))
        drag = tube.in_line(grains.place, grains.gas_force)
        contact = tube.in_line(grains.place, grains.grain_force + grains.wall_force)
        s.drag.append(total(part, drag[:, 2]))
        s.contact.append(total(part, contact[:, 2]))
        pressing = total(part, grains.wall_pressing)
        s.wall_stress.append(pressing * s.area / tube.section.perimeter)
        s.pressure.append(tube.gas.along())
        s.drop.append(tube.gas.drop)
        s.count.append(grains.count)
        self.fastest = float(np.linalg.norm(velocity, axis=1).max(initial=0.0))

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cross-sections of a stretch of the tube at one time: figures 17 to 19 of the paper."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from fem_tfm.geometry.section import RoundSection, Section
from fem_tfm.models.slug.grains import Grains
from fem_tfm.models.slug.told.slices import shares

Array = npt.NDArray[np.float64]
# planes across a stretch in which pixels are looked at
PLANES = 8


@dataclass(frozen=True)
class Still:
    """Grains of a stretch at one time.

    time : [s]
    place, velocity : (n, 3) [m], [m/s]
    radius : (n,) [m]
    """

    time: float
    place: Array
    radius: Array
    velocity: Array

    @classmethod
    def of(cls, time: float, grains: Grains | Still, low: float, high: float) -> Still:
        """The grains that reach into a stretch between two places [m]."""
        place, radius = grains.place, grains.radius
        near = (place[:, 2] > low - radius) & (place[:, 2] < high + radius)
        return cls(time, place[near], radius[near], grains.velocity[near])


@dataclass(frozen=True)
class Layers:
    """Horizontal layers of a stretch, from the bottom.

    height : of their middles over the axis [m]
    solids : volume of grains in them [m3]
    velocity, spread : mean of the grains' velocity along the tube and its standard deviation,
        weighted by volume [m/s]; no number in an empty layer
    """

    height: Array
    solids: Array
    velocity: Array
    spread: Array


def layers(
    grains: Grains | Still, section: Section, low: float, high: float, number: int = 10
) -> Layers:
    """Layers of the grains whose centres are between two places [m]."""
    place, radius, velocity = grains.place, grains.radius, grains.velocity
    inside = (place[:, 2] >= low) & (place[:, 2] < high)
    y, radius, v = place[inside, 1], radius[inside], velocity[inside, 2]
    edges = np.linspace(-section.size[1] / 2, section.size[1] / 2, number + 1)
    layer, volume = shares(y, radius, edges)

    def total(values: Array) -> Array:
        return np.bincount(layer.ravel(), (volume * values[:, None]).ravel(), minlength=number)

    solids = total(np.ones(len(y)))
    some = np.where(solids > 1e-12 * solids.max(initial=0.0), solids, np.nan)
    mean = total(v) / some
    spread = np.sqrt(np.maximum(total(v**2) / some - mean**2, 0.0))
    return Layers((edges[1:] + edges[:-1]) / 2, solids, mean, spread)


def picture(
    grains: Grains | Still, section: Section, low: float, high: float, pixels: int = 60
) -> tuple[Array, Array]:
    """Fraction of solids and mean velocity along the tube [m/s] in pixels of the section.

    Rows from the bottom, columns from the left; no number outside the section, and no velocity
    where there is no grain. Every pixel is looked at in some planes between two places [m].
    """
    width, height = section.size
    x = (np.arange(pixels) + 0.5) / pixels * width - width / 2
    y = (np.arange(pixels) + 0.5) / pixels * height - height / 2
    z = low + (np.arange(PLANES) + 0.5) / PLANES * (high - low)
    points = np.stack(np.meshgrid(y, x, z, indexing="ij"), axis=-1)[..., [1, 0, 2]].reshape(-1, 3)
    place, radius, velocity = grains.place, grains.radius, grains.velocity[:, 2]
    near = (place[:, 2] > low - radius.max(initial=0.0)) & (
        place[:, 2] < high + radius.max(initial=0)
    )
    covered, speed = np.zeros(len(points)), np.zeros(len(points))
    if near.any():
        place, radius, velocity = place[near], radius[near], velocity[near]
        # a point is in a grain of any size, hence some neighbours are looked at
        count = min(4, len(place))
        distance, which = cKDTree(place).query(points, k=count)
        distance, which = distance.reshape(-1, count), which.reshape(-1, count)
        hit = distance < radius[which]
        first = np.argmax(hit, axis=1)
        covered = hit.any(axis=1).astype(float)
        speed = covered * velocity[which[np.arange(len(points)), first]]
    solids = covered.reshape(pixels, pixels, PLANES).mean(axis=2)
    flux = speed.reshape(pixels, pixels, PLANES).mean(axis=2)
    if isinstance(section, RoundSection):
        outside = np.hypot(x[None], y[:, None]) > section.diameter / 2
        solids[outside] = np.nan
    return solids, np.where(solids > 0, flux / np.maximum(solids, 1e-300), np.nan)

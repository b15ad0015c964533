# SPDX-License-Identifier: LGPL-3.0-or-later
"""Feed of grains: layers that are pushed through the inlet at a given speed and mass flow."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from fem_tfm.errors import InputError
from fem_tfm.geometry.arc import Arc
from fem_tfm.geometry.section import RectangularSection, RoundSection, Section
from fem_tfm.models.slug.grains import Grain, Grains

Array = npt.NDArray[np.float64]
# a packing may be this much tighter than its circles allow, by round-off of the sizes given
SLACK = 1e-9


def sites(section: Section, diameter: float) -> Array:
    """Centres of circles of a diameter that fit into a section, (n, 2) [m].

    Rings from the wall inwards in a round section: 12, 6 and 1 where the tube is 5 diameters wide.
    Rows and columns in a rectangular one.
    """
    if isinstance(section, RectangularSection):
        counts = [int(side / diameter * (1 + SLACK)) for side in section.size]
        rows = [
            (np.arange(n) + 0.5 - n / 2) * side / n
            for n, side in zip(counts, section.size, strict=True)
        ]
        return np.stack(np.meshgrid(*rows), axis=-1).reshape(-1, 2)
    assert isinstance(section, RoundSection)
    found, ring = [], (section.diameter - diameter) / 2
    while ring > -SLACK * diameter:
        fits = diameter / (2 * ring) if ring > diameter / 2 else 2.0
        number = int(math.pi / math.asin(fits) * (1 + SLACK)) if fits <= 1 else 1
        if number == 1:
            found.append(np.zeros((1, 2)))
            break
        angle = 2 * math.pi / number * np.arange(number)
        found.append(ring * np.stack([np.cos(angle), np.sin(angle)], axis=-1))
        ring -= diameter
    return np.concatenate(found)


@dataclass(frozen=True)
class Feed:
    """Layers of grains that move at a speed until they are past the inlet, z = 0.

    mass_flow : of the grains [kg/s]; as many sites of a layer are left empty as it asks for
    speed : of the layers [m/s]
    fastest : speed that layers may have [m/s]

    Raises InputError for a mass flow that full layers at this speed do not reach.
    """

    section: Section
    grain: Grain
    mass_flow: float
    speed: float
    fastest: float = math.inf

    def __post_init__(self) -> None:
        most = len(sites(self.section, self.grain.largest_diameter)) * self.grain.mean_mass
        most /= self.interval
        if self.mass_flow > most:
            speed = self.speed * self.mass_flow / most
            words = f"at most {most:g} kg/s, which full layers have at {self.speed:g} m/s"
            if speed <= self.fastest:
                words += f"; raise operation.solids_velocity to {speed:.3g} m/s"
            else:
                reached = most * self.fastest / self.speed
                words += (
                    f"; not even the fastest feed, {self.fastest:.3g} m/s, brings in more than"
                    f" {reached:.3g} kg/s"
                )
            raise InputError("operation.solids_mass_flow", self.mass_flow, words)

    @property
    def interval(self) -> float:
        """Time between two layers [s]."""
        return self.grain.largest_diameter / self.speed

    @property
    def release(self) -> float:
        """Height z where grains become free [m]."""
        return self.grain.largest_diameter / 2


class Feeder:
    """Adds the layers of a feed in time.

    The mass that has been fed differs from the mass that is due by half a grain at most at the time
    of a layer, however long a run is; where a layer is full of small grains, the next ones make up.
    """

    def __init__(self, feed: Feed, seed: int = 0) -> None:
        self.feed = feed
        self._sites = sites(feed.section, feed.grain.largest_diameter)
        self._random = np.random.default_rng(seed)
        self.layers, self.count, self.mass = 0, 0, 0.0

    def advance(self, grains: Grains, time: float) -> int:
        """Add the layers that are due at a time [s]; returns the number of grains."""
        before, feed = self.count, self.feed
        while self.layers * feed.interval <= time * (1 + 1e-12):
            begin = self.layers * feed.interval
            self._layer(grains, -feed.release + feed.speed * (time - begin))
        return self.count - before

    def _layer(self, grains: Grains, z: float) -> None:
        feed, random = self.feed, self._random
        self.layers += 1
        due = self.layers * feed.interval * feed.mass_flow - self.mass
        radius = feed.grain.radii(len(self._sites), random)
        total = np.cumsum(feed.grain.masses(radius))
        number = int(np.searchsorted(total - feed.grain.masses(radius) / 2, due))
        chosen = np.sort(random.permutation(len(self._sites))[:number])
        turned = self._turned(random) if isinstance(feed.section, RoundSection) else self._sites
        if number == 0:
            return
        place = np.column_stack([turned[chosen], np.full(number, z)])
        grains.add(place, (0.0, 0.0, feed.speed), radius[:number], held=True)
        self.count, self.mass = self.count + number, self.mass + float(total[number - 1])

    def _turned(self, random: np.random.Generator) -> Array:
        angle = 2 * math.pi * random.random()
        c, s = math.cos(angle), math.sin(angle)
        return self._sites @ np.array([[c, s], [-s, c]])

    def state(self) -> dict[str, Any]:
        """What the next layers depend on; the generator's state as a text."""
        import json

        numbers = np.array([self.layers, self.count], dtype=np.int64)
        text = json.dumps(self._random.bit_generator.state)
        return {"numbers": numbers, "mass": np.array([self.mass]), "random": text}

    def restore(self, state: dict[str, Any]) -> None:
        """Put back what `state` gave."""
        import json

        self.layers, self.count = (int(n) for n in state["numbers"])
        self.mass = float(state["mass"][0])
        self._random.bit_generator.state = json.loads(str(state["random"]))


def filled(
    section: Section,
    grain: Grain,
    length: float,
    seed: int = 0,
    *,
    arc: Arc | None = None,
    begin: float = 0.0,
) -> tuple[Array, Array]:
    """Places (n, 3) and radii of grains that fill a length of a tube with full layers.

    Layers are a diameter apart, in an arc on its inner side. The first one begins at a place [m].
    """
    random, size = np.random.default_rng(seed), grain.largest_diameter
    flat = sites(section, size)
    along = _layers(section, size, begin, begin + length, arc)
    layers = len(along)
    turn = (
        random.uniform(0, 2 * math.pi, layers)
        if isinstance(section, RoundSection)
        else np.zeros(layers)
    )
    c, s = np.cos(turn)[:, None], np.sin(turn)[:, None]
    x, y = c * flat[:, 0] - s * flat[:, 1], s * flat[:, 0] + c * flat[:, 1]
    z = np.broadcast_to(along[:, None], x.shape)
    place: Array = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    return place if arc is None else arc.bent(place), grain.radii(len(place), random)


def _layers(section: Section, size: float, begin: float, end: float, arc: Arc | None) -> Array:
    """Middles of full layers of grains of a size along the axis [m]."""
    if arc is None:
        number = int((end - begin) / size * (1 + SLACK))
        return np.array([begin + (k + 0.5) * size for k in range(number)])
    # the chord between two grains of the inner side is a diameter
    inner = arc.radius - (section.size[0] - size) / 2
    apart = 2 * arc.radius * math.asin(min(size / (2 * inner), 1.0))
    found, place = list[float](), begin + size / 2
    while place + size / 2 <= end:
        found.append(place)
        place += apart if arc.before < place + apart and place < arc.end else size
    return np.array(found)

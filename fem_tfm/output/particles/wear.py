# SPDX-License-Identifier: LGPL-3.0-or-later
"""Impacts of particles on the walls of a line, and what they take from them, along and around.

wear.csv   a row for each stretch of the line and each sector around its axis
wear.png   the same as a map
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from fem_tfm.output.pictures import save_figure
from fem_tfm.output.profiles import write_profiles

SECTORS = 72
# what is summed in a sector: impacts a second, and those weighted
SUMS = ("count", "speed", "angle", "removed")


@dataclass
class WearMap:
    """Sums over impacts in stretches of a line and sectors around its axis.

    perimeter : of the section [m]

    Attributes
    ----------
    edges : ends of the stretches [m]
    sums : one array (sectors, 4) a stretch: impacts [1/s], those times speed [m/s] and angle to the
        wall [rad], and mass that is removed [kg/s]
    """

    perimeter: float
    edges: list[float] = field(default_factory=lambda: [0.0])
    sums: list[NDArray[np.float64]] = field(default_factory=list)

    @staticmethod
    def summed(
        x: NDArray[np.float64],
        speed: NDArray[np.float64],
        angle: NDArray[np.float64],
        rate: NDArray[np.float64],
        removed: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Sums of impacts at places (n, 3), each of which stands for `rate` a second."""
        around = np.arctan2(x[:, 1], x[:, 0]) % (2 * math.pi)
        sector = np.minimum((around / (2 * math.pi) * SECTORS).astype(int), SECTORS - 1)
        columns = (rate, rate * speed, rate * angle, rate * removed)
        return np.stack([np.bincount(sector, c, SECTORS) for c in columns], axis=1)

    def add(self, end: float, sums: NDArray[np.float64]) -> None:
        """Enter a stretch that ends at a place [m]."""
        self.edges.append(end)
        self.sums.append(sums)

    @property
    def total(self) -> float:
        """Mass that all walls lose [kg/s]."""
        return float(sum(sums[:, 3].sum() for sums in self.sums))

    @property
    def worst(self) -> tuple[float, float]:
        """Largest loss of a patch of the map [kg/m2/s], and its place along the line [m]."""
        table = self.columns()
        at = int(np.argmax(table["removed"]))
        return float(table["removed"][at]), float(table["z"][at])

    def columns(self) -> dict[str, NDArray[np.float64]]:
        """A row for each stretch and sector."""
        lengths = np.diff(self.edges)
        area = np.repeat(lengths, SECTORS) * self.perimeter / SECTORS
        sums = np.concatenate(self.sums)
        middle = (np.array(self.edges[1:]) + np.array(self.edges[:-1])) / 2
        with np.errstate(invalid="ignore"):
            means = sums[:, 1:3] / sums[:, :1]
        return {
            "z": np.repeat(middle, SECTORS),
            "around": np.tile((np.arange(SECTORS) + 0.5) * 360 / SECTORS, len(lengths)),
            "impacts": sums[:, 0] / area,
            "speed": means[:, 0],
            "angle": np.degrees(means[:, 1]),
            "removed": sums[:, 3] / area,
        }

    # -- state and files -----------------------------------------------------------------------

    def state(self) -> dict[str, NDArray[Any]]:
        """Arrays from which `restore` goes on."""
        shape = (-1, SECTORS, len(SUMS))
        return {"edges": np.array(self.edges), "sums": np.array(self.sums).reshape(shape)}

    def restore(self, arrays: dict[str, NDArray[Any]]) -> None:
        """Put back what `state` gave."""
        self.edges, self.sums = arrays["edges"].tolist(), list(arrays["sums"])

    def write(self, out: Path, title: str, pictures: bool) -> None:
        """wear.csv and wear.png."""
        units = {
            "z": "m", "around": "deg", "impacts": "1/s/m2", "speed": "m/s", "angle": "deg",
            "removed": "kg/s/m2",
        }  # fmt: skip
        write_profiles(out / "wear.csv", self.columns(), units)
        if pictures:
            table = self.columns()["removed"].reshape(-1, SECTORS)
            around = np.linspace(0, 1, SECTORS + 1)
            wear_picture(out / "wear.png", self.edges, around, table, title)


def wear_picture(
    path: str | Path,
    edges: Sequence[float] | NDArray[np.float64],
    around: NDArray[np.float64],
    removed: NDArray[np.float64],
    title: str = "",
) -> None:
    """Draw what the walls lose over the way and around the axis, counted from the right (+x).

    edges, around : of the stretches [m], and of the sectors as a share of the perimeter
    removed : of stretches and sectors [kg/s/m2]
    """
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    axes = figure.subplots()
    image = axes.pcolormesh(edges, 360 * around, removed.T, cmap="inferno", shading="flat")
    bar = figure.colorbar(image, ax=axes)
    bar.set_label("wear [kg/s/m²]", fontsize=9)
    axes.set_yticks((0, 90, 180, 270, 360), ("right", "top", "left", "bottom", "right"))
    axes.set_xlabel("z [m]", fontsize=9)
    axes.tick_params(labelsize=8)
    save_figure(figure, path, title)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pictures of particles: trajectories, the entrance, the outlet, velocities along the line."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from fem_tfm.output.particles.tracked import FATES, Tracked, trajectories
from fem_tfm.output.pictures import save_figure

POINTS = 4000
# groups of entries by their place: core, along a wall, near a corner
GROUPS = ("core", "near a wall", "near a corner")
COLOURS, STYLES = ("#1f5fa8", "#d1782b", "#3b8f4d"), ("-", "--", ":")


def groups(
    places: NDArray[np.float64], size: Sequence[float], round_section: bool = False
) -> NDArray[np.int64]:
    """Which group of `GROUPS` each place across the section belongs to, shape (n,).

    A place is near a wall in the outer third of the half width; a round section has no corner.

    places : shape (n, 2) [m]
    size : width and height of the section [m]
    """
    outward = np.abs(places) / (np.asarray(size) / 2)
    if round_section:
        return np.asarray(np.hypot(*outward.T) > 2 / 3, dtype=np.int64)
    return np.asarray((outward > 2 / 3).sum(axis=1))


def particle_picture(
    path: str | Path,
    tracked: Tracked,
    size: Sequence[float],
    title: str = "",
    round_section: bool = False,
) -> None:
    """Draw one row a material: trajectories, entrance, outlet, velocity along the line.

    size : width and height of the section [m]
    """
    count = len(tracked.materials)
    figure = Figure(figsize=(13.0, 3.2 * count + 0.5), layout="constrained")
    grid = figure.subplots(count, 4, squeeze=False, width_ratios=(1.6, 1, 1.15, 1.5))
    for row, name in zip(grid, tracked.materials, strict=True):
        _trajectories(row[0], tracked, name, size)
        _entrance(row[1], tracked, name, size)
        _outlet(row[2], tracked, name, size)
        _along(row[3], tracked, name, size, round_section)
    for axes in grid.ravel():
        axes.tick_params(labelsize=7)
        axes.spines[["top", "right"]].set_visible(False)
    save_figure(figure, path, title)


def _trajectories(axes: Any, tracked: Tracked, name: str, size: Sequence[float]) -> None:
    """Height over the way, coloured by the speed."""
    chosen, image = tracked.of(name), None
    for number, line in trajectories(tracked):
        if chosen[number] and len(line) > 1:
            axes.plot(line[:, 3], 1e3 * line[:, 2], color="#bbbbbb", linewidth=0.5, zorder=1)
            image = axes.scatter(
                line[:, 3],
                1e3 * line[:, 2],
                c=np.linalg.norm(line[:, 4:], axis=1),
                s=2,
                cmap="viridis",
                zorder=2,
            )
    if image is not None:
        image.set_clim(0, max(float(tracked.column(name, "fastest").max()), 1e-9))
    low, high = axes.get_ylim()
    # a line that bends leaves the height of its inlet
    axes.set_ylim(min(low, -500 * size[1]), max(high, 500 * size[1]))
    axes.set_xlabel("z [m]", fontsize=8)
    axes.set_ylabel("y [mm]", fontsize=8)
    axes.set_title(f"{name}: trajectories, bright where fast", fontsize=9)


def _section(axes: Any, size: Sequence[float]) -> None:
    axes.set_aspect("equal")
    axes.set_xlim(-500 * size[0], 500 * size[0])
    axes.set_ylim(-500 * size[1], 500 * size[1])
    axes.set_xlabel("x [mm]", fontsize=8)
    axes.set_ylabel("y [mm]", fontsize=8)


def _some(chosen: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Numbers of at most so many of the chosen parcels, evenly taken."""
    numbers = np.flatnonzero(chosen)
    return numbers[:: max(len(numbers) // POINTS, 1)]


def _entrance(axes: Any, tracked: Tracked, name: str, size: Sequence[float]) -> None:
    """Where parcels enter, coloured by their entry."""
    assert tracked.first is not None
    some = _some(tracked.of(name))
    at = 1e3 * tracked.first.across[some]
    axes.scatter(at[:, 0], at[:, 1], c=tracked.entry[some] % 20, s=2, cmap="tab20", linewidths=0)
    _section(axes, size)
    axes.set_title("entrance, by entry", fontsize=9)


def _outlet(axes: Any, tracked: Tracked, name: str, size: Sequence[float]) -> None:
    """Where parcels leave, coloured by their axial velocity."""
    assert tracked.last is not None
    some = _some(tracked.of(name) & tracked.last.inside)
    at = 1e3 * tracked.last.across[some]
    image = axes.scatter(
        at[:, 0], at[:, 1], c=tracked.last.along[some], s=2, cmap="viridis", linewidths=0
    )
    _section(axes, size)
    if len(some):
        bar = axes.figure.colorbar(image, ax=axes, shrink=0.8)
        bar.ax.tick_params(labelsize=7)
    else:
        axes.text(0.5, 0.5, "nothing arrives", transform=axes.transAxes, ha="center", fontsize=8)
    axes.set_title("outlet, axial velocity [m/s]", fontsize=9)


def _along(
    axes: Any, tracked: Tracked, name: str, size: Sequence[float], round_section: bool
) -> None:
    """Mean axial velocity along the line, by where particles entered."""
    assert tracked.first is not None
    chosen, z = tracked.of(name), tracked.z
    entries = np.unique(tracked.entry[chosen])
    if len(entries) > 1:
        # the middle of what belongs to an entry
        at = np.array(
            [tracked.first.across[chosen & (tracked.entry == one)].mean(axis=0) for one in entries]
        )
        group = groups(at, size, round_section)
        means = np.array(tracked.by_entry[name])[:, entries]
        for number in np.unique(group):
            with np.errstate(invalid="ignore"):
                w = np.nanmean(means[:, group == number], axis=1)
            axes.plot(z, w, STYLES[number], color=COLOURS[number], label=GROUPS[number])
    else:
        w, spread = tracked.column(name, "velocity"), tracked.column(name, "velocity_sd")
        axes.plot(z, w, color=COLOURS[0], label="mean")
        axes.fill_between(z, w - spread, w + spread, color=COLOURS[0], alpha=0.2, linewidth=0)
    axes.set_xlim(0, z[-1])
    axes.set_ylim(bottom=0)
    axes.set_xlabel("z [m]", fontsize=8)
    axes.set_ylabel("axial velocity [m/s]", fontsize=8)
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.legend(fontsize=7, frameon=False, loc="lower right")
    axes.set_title("along the line, by where they entered", fontsize=9)


def deposition_picture(path: str | Path, tracked: Tracked, title: str = "") -> None:
    """Draw where parcels stay on the wall, seen from the side and from above."""
    assert tracked.last is not None
    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    stays = _some(tracked.status == FATES.index("deposited"))
    for axes, across in zip(figure.subplots(2, 1, sharex=True), (1, 0), strict=True):
        at = tracked.last.x[stays]
        colours = np.array(COLOURS)[tracked.material[stays] % len(COLOURS)]
        axes.scatter(at[:, 2], 1e3 * at[:, across], c=colours, s=2, linewidths=0)
        axes.set_ylabel(f"{'xy'[across]} [mm]", fontsize=9)
        axes.tick_params(labelsize=8)
    axes.set_xlabel("z [m]", fontsize=9)
    save_figure(figure, path, title)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pictures of slugs: porosity over place and time, numbers along the tube, a slug, a film."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from fem_tfm.output.files import replaced
from fem_tfm.output.pictures import save_figure

type Floats = NDArray[np.float64]
# most samples that a picture shows, and the film's frames a second
MOST, FRAMES = 1500, 20
PANELS = (
    ("rate", "slugs that pass [1/s]"),
    ("least_porosity", "least porosity"),
    ("top_velocity", "fastest grains [m/s]"),
    ("length", "length [m]"),
)
SLUG_PANELS = (
    ("porosity", "porosity"),
    ("velocity", "grain velocity [m/s]"),
    ("temperature", "granular temperature [m²/s²]"),
    ("drag", "force on a grain [N]"),
    ("wall_stress", "wall stress [Pa]"),
)


def porosity_picture(
    path: str | Path, time: Floats, place: Floats, porosity: Floats, title: str = ""
) -> None:
    """Draw porosity (samples, slices) over place [m] and time [s]; slugs are dark stripes."""
    last = slice(max(len(time) - MOST, 0), None)
    figure = Figure(figsize=(7.0, 8.0), layout="constrained")
    axes = figure.subplots()
    image = axes.pcolormesh(
        100 * place, time[last], porosity[last], cmap="bone", vmin=0.4, vmax=1.0, shading="nearest"
    )
    figure.colorbar(image, ax=axes, shrink=0.7).set_label("porosity", fontsize=9)
    axes.set_xlabel("z [cm]", fontsize=9)
    axes.set_ylabel("time [s]", fontsize=9)
    axes.tick_params(labelsize=8)
    save_figure(figure, path, title)


def slugs_picture(
    path: str | Path,
    along: Mapping[str, Floats],
    profile: Mapping[str, Floats],
    title: str = "",
    seconds: float = 0.0,
) -> None:
    """Draw numbers of the slugs by their place and the average slug, with standard errors.

    Panels of a time [s] in which there was no slug say so. Dotted are the quartiles of the slugs,
    and the wall stress that their weight alone makes.

    along : "place" [m], and a column with "<name> error" for each of `PANELS`
    profile : "offset" [m], and likewise for each of `SLUG_PANELS`
    """
    figure = Figure(figsize=(12.0, 6.4), layout="constrained")
    grid = figure.subplots(2, 5)
    rows = (
        ("place", "z [cm]", along, PANELS),
        ("offset", "from the centre [cm]", profile, SLUG_PANELS),
    )
    for axes_row, (at, label, columns, panels) in zip(grid, rows, strict=True):
        for axes, (name, what) in zip(axes_row, panels, strict=False):
            if np.nansum(np.abs(columns["rate" if at == "place" else name])) == 0:
                words = f"no slug{' there' if at == 'offset' else ''} in {seconds:.3g} s"
                axes.text(0.5, 0.5, words, ha="center", fontsize=8, transform=axes.transAxes)
                axes.set_axis_off()
            else:
                _curve(axes, 100 * columns[at], columns, name)
            axes.set_xlabel(label, fontsize=8)
            axes.set_title(what, fontsize=9)
            for rank in ("lower", "upper"):
                if f"{name} {rank} quartile" in columns:
                    values = columns[f"{name} {rank} quartile"]
                    axes.plot(100 * columns[at], values, ":", color="#1f5fa8", linewidth=0.9)
    if "contact" in profile and np.isfinite(profile["contact"]).any():
        _curve(grid[1, 3], 100 * profile["offset"], profile, "contact", "#d1782b")
    if "weight" in profile:
        grid[1, 4].plot(100 * profile["offset"], profile["weight"], ":", color="#333333")
    grid[0, 4].set_axis_off()
    save_figure(figure, path, title)


def _curve(
    axes: Any, x: Floats, columns: Mapping[str, Floats], name: str, colour: str = "#1f5fa8"
) -> None:
    y, error = columns[name], np.nan_to_num(columns[f"{name} error"])
    axes.plot(x, y, color=colour, linewidth=1.4, label=name.replace("_", " "))
    axes.fill_between(x, y - error, y + error, color=colour, alpha=0.25, linewidth=0)
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.tick_params(labelsize=7)
    axes.spines[["top", "right"]].set_visible(False)


def film(
    path: str | Path,
    frames: Sequence[tuple[float, Floats, Floats]],
    box: tuple[float, float, float, float],
    bent: bool = False,
) -> None:
    """A GIF of the grains in a plane, coloured by their speed along the tube.

    frames : time [s]; places in the plane and radius (n, 3) [m]; velocity (n,) [m/s]
    box : left, bottom, right and top of the tube [m]
    bent : whether both directions have the same scale
    """
    fastest = max(max((float(v.max(initial=0.0)) for _, _, v in frames), default=0.0), 1e-9)
    figure = Figure(figsize=(6.5, 6.5) if bent else (10.0, 1.3), dpi=90)
    axes = figure.add_axes((0.05, 0.1, 0.93, 0.83) if bent else (0.05, 0.38, 0.93, 0.42))
    left, bottom, right, top = (100 * side for side in box)

    def draw(number: int) -> list[Any]:
        time, at, v = frames[number]
        axes.clear()
        size = 200 * at[:, 2]
        circles = EllipseCollection(
            size, size, np.zeros(len(at)), units="xy", offsets=100 * at[:, :2],
            transOffset=axes.transData, array=v, cmap="viridis", linewidths=0,
        )  # fmt: skip
        circles.set_clim(0, fastest)
        axes.add_collection(circles)
        axes.set_xlim(left, right)
        axes.set_ylim(bottom, top)
        if bent:
            axes.set_aspect("equal")
        axes.set_yticks(())
        axes.tick_params(labelsize=7)
        axes.set_xlabel("z [cm]", fontsize=8)
        axes.set_title(f"{time:.2f} s, grains up to {fastest:.2g} m/s", fontsize=8)
        return [circles]

    with replaced(path) as temporary:
        made = FuncAnimation(figure, draw, frames=len(frames))
        made.save(temporary, writer=PillowWriter(fps=FRAMES))


def side_picture(
    path: str | Path, frame: tuple[float, Floats, Floats], low: float, high: float, height: float
) -> None:
    """The grains between two places [m] from the side; `frame` and `height` as in `film`."""
    _, at, v = frame
    figure = Figure(figsize=(10.0, 1.6), dpi=120, layout="constrained")
    axes = figure.subplots()
    size = 200 * at[:, 2]
    circles = EllipseCollection(
        size, size, np.zeros(len(at)), units="xy", offsets=100 * at[:, :2],
        transOffset=axes.transData, array=v, cmap="viridis", linewidths=0.3, edgecolors="k",
    )  # fmt: skip
    inside = (at[:, 0] > low) & (at[:, 0] < high)
    circles.set_clim(0, max(float(v[inside].max(initial=0.0)), 1e-9))
    axes.add_collection(circles)
    figure.colorbar(circles, ax=axes).set_label("grain velocity [m/s]", fontsize=8)
    axes.set_xlim(100 * low, 100 * high)
    axes.set_ylim(-50 * height, 50 * height)
    axes.set_aspect("equal")
    axes.set_yticks(())
    axes.tick_params(labelsize=8)
    axes.set_xlabel("z [cm]", fontsize=8)
    save_figure(figure, path, "")


def sections_picture(
    path: str | Path,
    stills: Sequence[tuple[Floats, Floats]],
    layers: Mapping[str, Floats],
    title: str = "",
) -> None:
    """Draw sections of a slug that passes: solids and velocity, and velocity over the height.

    stills : fraction of solids and velocity along the tube [m/s] in pixels, in turn
    layers : "height" [m], "velocity" and its "spread" [m/s]
    """
    figure = Figure(figsize=(14.0, 3.2), layout="constrained")
    left, right = np.ravel(figure.subfigures(1, 2, width_ratios=(5.0, 1.2), squeeze=False))
    fastest = max((float(np.nanmax(v, initial=0.0)) for _, v in stills), default=0.0)
    looks: Any = (("Greys", 0.0, 1.0), ("viridis", 0.0, max(fastest, 1e-9)))
    grid = left.subplots(2, len(stills), squeeze=False)
    for row, (name, low, high) in enumerate(looks):
        for axes, still in zip(grid[row], stills, strict=True):
            image = axes.imshow(still[row], cmap=name, vmin=low, vmax=high, origin="lower")
            axes.set_axis_off()
        label = ("solids fraction", "grain velocity [m/s]")[row]
        left.colorbar(image, ax=grid[row], pad=0.01).set_label(label, fontsize=7)
    axes = right.subplots()
    y, v, spread = 1000 * layers["height"], layers["velocity"], layers["spread"]
    axes.plot(v, y, color="#1f5fa8", linewidth=1.4)
    axes.fill_betweenx(y, v - spread, v + spread, color="#1f5fa8", alpha=0.25, linewidth=0)
    axes.set_xlabel("grain velocity [m/s]", fontsize=8)
    axes.set_ylabel("y [mm]", fontsize=8)
    axes.tick_params(labelsize=7)
    axes.grid(color="#dddddd", linewidth=0.6)
    save_figure(figure, path, title)

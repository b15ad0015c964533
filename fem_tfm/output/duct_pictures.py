# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pictures of a duct's gas: the section with its secondary flow, and profiles along its lines."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.tri import LinearTriInterpolator
from numpy.typing import ArrayLike, NDArray

from fem_tfm.output.pictures import STYLE, SectionView, save_figure

# quantity, label and colour map of the two maps
MAPS = (("u_g", "axial velocity [m/s]", "viridis"), ("k", "turbulent energy k [m²/s²]", "magma"))
ARROWS = 23
LEVELS = 12
# lines on one set of axes, with the label of their ordinate
PANELS = (
    ("axial velocity/U", ("bisector u_z/U", "diagonal u_z/U", "wall u_z/U")),
    ("secondary velocity/U", ("bisector outward/U", "diagonal outward/U", "wall along/U")),
    (r"$k/u_\tau^2$", ("bisector k/u_tau2", "diagonal k/u_tau2")),
    (
        r"$(R_{yy} - R_{xx})/u_\tau^2$",
        ("bisector (R_yy - R_xx)/u_tau2", "diagonal (R_yy - R_xx)/u_tau2"),
    ),
    ("wall shear/mean", ("wall shear/mean",)),
    (r"$R_{xz}/u_\tau^2$", ("bisector R_xz/u_tau2",)),
    (
        r"$(T - T_w)/(T_b - T_w)$",
        ("bisector (T - T_w)/(T_b - T_w)", "diagonal (T - T_w)/(T_b - T_w)"),
    ),
    ("turbulent Prandtl number", ("bisector Pr_t",)),
)


def duct_picture(
    path: str | Path, view: SectionView, fields: Mapping[str, ArrayLike], title: str = ""
) -> None:
    """Draw axial velocity and k over the whole section, with arrows of the secondary flow.

    path : of the PNG, replaced in one step
    fields : nodal values by name; "u_g" (n, 3) and "k" (n,)
    """
    shown = [entry for entry in MAPS if entry[0] in fields]
    height = 1.2 + 4.2 * min(view.height / view.width, 2.0)
    figure = Figure(figsize=(4.6 * len(shown) + 0.4, height), layout="constrained")
    for axes, (name, label, colours) in zip(
        figure.subplots(1, len(shown), squeeze=False)[0], shown, strict=True
    ):
        values = np.asarray(fields[name], dtype=float)
        values = values if values.ndim == 1 else values[:, 2]
        _map(axes, view, values, label, colours)
        if name == "u_g":
            _arrows(axes, view, np.asarray(fields[name])[:, :2])
    save_figure(figure, path, title)


def _map(
    axes: Any, view: SectionView, values: NDArray[np.float64], label: str, colours: str
) -> None:
    limits = {"vmin": float(values.min()), "vmax": float(values.max())}
    # levels of a field that is uniform would coincide
    spread = limits["vmax"] - limits["vmin"] > 1e-12 * abs(limits["vmax"])
    for copy in view.copies():
        copy.x, copy.y = 1e3 * copy.x, 1e3 * copy.y
        image = axes.tripcolor(copy, values, shading="gouraud", cmap=colours, **limits)
        if spread:
            levels = np.linspace(limits["vmin"], limits["vmax"], LEVELS)[1:-1]
            axes.tricontour(copy, values, levels, colors="white", linewidths=0.5, alpha=0.7)
    axes.set_aspect("equal")
    axes.set_xlabel("x [mm]", fontsize=9)
    axes.set_ylabel("y [mm]", fontsize=9)
    axes.tick_params(labelsize=STYLE["labelsize"], length=0)
    axes.spines[:].set_visible(False)
    bar = axes.figure.colorbar(image, ax=axes, location="top", shrink=0.85, aspect=22, pad=0.03)
    bar.set_label(label, fontsize=10)
    bar.ax.tick_params(**STYLE)
    bar.outline.set_visible(False)


def _arrows(axes: Any, view: SectionView, velocity: NDArray[np.float64]) -> None:
    """Arrows of the secondary flow on an even grid; none where there is no such flow."""
    peak = float(np.hypot(*velocity.T).max(initial=0.0))
    if peak <= 0.0:
        return
    first = view.copies()[0]
    step = max(view.width, view.height) / ARROWS
    x, y = (np.arange(low + step / 2, high, step) for low, high in _ranges(first))
    x, y = (grid.ravel() for grid in np.meshgrid(x, y))
    parts = [LinearTriInterpolator(first, velocity[:, i])(x, y).filled(np.nan) for i in (0, 1)]
    for copy in view.copies():
        # a mirror turns a component with its coordinate
        sx, sy = (np.sign((c * f).sum()) for c, f in ((copy.x, first.x), (copy.y, first.y)))
        axes.quiver(
            1e3 * sx * x, 1e3 * sy * y, sx * parts[0], sy * parts[1], color="black",
            scale=peak * ARROWS / 2.2, width=0.003,
        )  # fmt: skip
    axes.set_title(f"longest arrow {peak:.3g} m/s", fontsize=8)


def _ranges(part: Any) -> tuple[tuple[float, float], tuple[float, float]]:
    return (part.x.min(), part.x.max()), (part.y.min(), part.y.max())


def lines_picture(path: str | Path, lines: Mapping[str, ArrayLike], title: str = "") -> None:
    """Draw profiles along bisector, diagonal and wall; columns that are not there are left out.

    lines : column "s" and those named in `PANELS`
    """
    panels = [(label, [n for n in names if n in lines]) for label, names in PANELS]
    panels = [(label, names) for label, names in panels if names]
    rows = -(-len(panels) // 3)
    figure = Figure(figsize=(10.5, 2.8 * rows + 0.4), layout="constrained")
    grid = figure.subplots(rows, 3, squeeze=False).ravel()
    for axes, (label, names) in zip(grid, panels, strict=False):
        for name in names:
            axes.plot(lines["s"], lines[name], linewidth=1.5, label=name.partition(" ")[0])
        axes.set_xlabel("share of the way from the centre", fontsize=9)
        axes.set_ylabel(label, fontsize=9)
        axes.set_xlim(0, 1)
        axes.grid(color="#dddddd", linewidth=0.6)
        axes.tick_params(**STYLE)
        axes.spines[["top", "right"]].set_visible(False)
        if len(names) > 1:
            axes.legend(fontsize=8, frameon=False)
    for axes in grid[len(panels) :]:
        axes.set_axis_off()
    save_figure(figure, path, title)


# columns along the axis on one set of axes, with the label of their ordinate
AXIS_PANELS = (
    ("velocity/U", ("centre_to_bulk", "max_to_bulk")),
    ("friction factor", ("friction_factor",)),
    ("secondary velocity, largest/U", ("secondary_velocity_max",)),
    (r"$k/u_\tau^2$ on the axis", ("axis_energy",)),
    ("pressure [Pa]", ("pressure",)),
    ("Nusselt number", ("nusselt",)),
    ("temperature [K]", ("bulk_temperature", "wall_temperature")),
)


def axis_picture(
    path: str | Path, columns: Mapping[str, ArrayLike], width: float, title: str = ""
) -> None:
    """Draw how the gas develops along its axis; columns that are not there are left out.

    columns : "z" [m] and those of `AXIS_PANELS`
    width : hydraulic diameter, the unit of the abscissa [m]
    """
    panels = [(label, [n for n in names if n in columns]) for label, names in AXIS_PANELS]
    panels = [(label, names) for label, names in panels if names]
    rows = -(-len(panels) // 2)
    figure = Figure(figsize=(9.0, 2.5 * rows + 0.5), layout="constrained")
    grid = figure.subplots(rows, 2, squeeze=False).ravel()
    at = np.asarray(columns["z"]) / width
    for axes, (label, names) in zip(grid, panels, strict=False):
        for name in names:
            axes.plot(at, columns[name], linewidth=1.5, label=name.replace("_", " "))
        if names[0] in ("friction_factor", "nusselt"):
            # an entrance is far above the rest
            axes.set_yscale("log")
        if len(names) > 1:
            axes.legend(fontsize=8, frameon=False)
        axes.set_xlabel("z/D", fontsize=9)
        axes.set_ylabel(label, fontsize=9)
        axes.set_xlim(at[0], at[-1])
        axes.grid(color="#dddddd", linewidth=0.6)
        axes.tick_params(**STYLE)
        axes.spines[["top", "right"]].set_visible(False)
    for axes in grid[len(panels) :]:
        axes.set_axis_off()
    save_figure(figure, path, title)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pictures of a section, of profiles and of sweeps, drawn by matplotlib without a display.

Everything here takes plain arrays, so that a picture can be drawn from files as well as from a run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import LinearTriInterpolator, Triangulation
from numpy.typing import ArrayLike, NDArray

from fem_tfm.output.files import replaced

# linear triangles in each cell, nodes in VTK's order
TRIANGLES = {
    "triangle": ((0, 1, 2),),
    "triangle6": ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
    "quad": ((0, 1, 2), (0, 2, 3)),
    "quad9": (
        (0, 4, 8), (0, 8, 7), (4, 1, 5), (4, 5, 8), (8, 5, 2), (8, 2, 6), (7, 8, 6), (7, 6, 3),
    ),
}  # fmt: skip
MIRRORS = {"none": "", "half": "x", "quarter": "xy"}
DPI = 160
LINE_POINTS = 201


@dataclass(frozen=True)
class Look:
    """How a quantity is drawn: symbol, unit, colour map, colour of its line, logarithmic axis."""

    symbol: str
    unit: str
    map: str = "viridis"
    line: str = "#333333"
    log: bool = False

    @property
    def label(self) -> str:
        """Axis label "symbol [unit]", or the symbol alone for a pure number."""
        return f"{self.symbol} [{self.unit}]" if self.unit else self.symbol


LOOKS = {
    "alpha_s": Look(r"solids fraction $\alpha_s$", "", "cividis", "#6b4c1e"),
    "u_s": Look(r"solids velocity $u_{s,z}$", "m/s", "viridis", "#c2571a"),
    "u_g": Look(r"gas velocity $u_{g,z}$", "m/s", "viridis", "#1f5fa8"),
    "Theta": Look(r"granular temperature $\Theta$", "m²/s²", "magma", "#7a2178", log=True),
    "k": Look(r"turbulent energy $k$", "m²/s²", "magma", "#2c7a4b", log=True),
}
# quantities on one set of axes, with the label they share
PANELS = (
    (("alpha_s",), LOOKS["alpha_s"].label),
    (("u_s", "u_g"), "axial velocity [m/s]"),
    (("Theta", "k"), None),
)
MAPS = ("alpha_s", "u_s", "u_g")
STYLE: dict[str, Any] = {"labelsize": 8, "length": 3}


@dataclass(frozen=True)
class SectionView:
    """A section as linear triangles.

    points : node coordinates, shape (n, 2) or (n, 3) [m]
    triangles : node numbers, shape (m, 3)
    symmetry : "none", "half" (x >= 0 is given) or "quarter" (x >= 0 and y >= 0)
    """

    points: NDArray[np.float64]
    triangles: NDArray[np.int64]
    symmetry: str = "none"

    @classmethod
    def of_cells(
        cls, points: ArrayLike, cells: ArrayLike, kind: str, symmetry: str = "none"
    ) -> SectionView:
        """View of cells in VTK's node order; quadratic cells are split so that all nodes count.

        kind : "triangle", "triangle6", "quad" or "quad9"
        """
        split = np.array(TRIANGLES[kind])
        return cls(np.asarray(points), np.asarray(cells)[:, split].reshape(-1, 3), symmetry)

    @property
    def height(self) -> float:
        """Extent of the whole section along y, the D of y/D [m]."""
        return self._extent("y")

    @property
    def width(self) -> float:
        """Extent of the whole section along x [m]."""
        return self._extent("x")

    def _extent(self, axis: str) -> float:
        x = self.points[:, "xy".index(axis)]
        return 2 * float(x.max()) if axis in MIRRORS[self.symmetry] else float(np.ptp(x))

    def copies(self) -> list[Triangulation]:
        """The part given and its mirror images, which make up the whole section."""
        mirrors = MIRRORS[self.symmetry]
        signs = [
            (sx, sy)
            for sx in ((1, -1) if "x" in mirrors else (1,))
            for sy in ((1, -1) if "y" in mirrors else (1,))
        ]
        x, y = self.points[:, 0], self.points[:, 1]
        return [Triangulation(sx * x, sy * y, self.triangles) for sx, sy in signs]

    def wall(self) -> NDArray[np.int64]:
        """Edges on the boundary of the whole section: once in the part, not on a mirror plane."""
        edges = np.sort(self.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        edges, count = np.unique(edges, axis=0, return_counts=True)
        edges = edges[count == 1]
        near = 1e-9 * np.ptp(self.points[:, :2])
        for axis in MIRRORS[self.symmetry]:
            on_plane = np.abs(self.points[edges, "xy".index(axis)]).max(axis=1) < near
            edges = edges[~on_plane]
        return edges


def axial(values: ArrayLike) -> NDArray[np.float64]:
    """The axial component of a vector field (n, 3), or a scalar field as it is."""
    values = np.asarray(values, dtype=float)
    return values if values.ndim == 1 else values[:, 2]


def vertical_profile(view: SectionView, fields: Mapping[str, ArrayLike]) -> dict[str, NDArray]:
    """Fields along the vertical diameter x = 0, from bottom to top.

    Returns columns "y" [m], "y/D" [-] and one of each field (the axial component of vectors). Node
    values are taken as they are where nodes lie on the line, as on a symmetry plane; else the
    fields are interpolated at 201 points, linearly in the triangles.
    """
    x, y = view.points[:, 0], view.points[:, 1]
    line = np.flatnonzero(np.abs(x) < 1e-9 * view.height)
    if len(line) and np.ptp(y[line]) > 0.999 * np.ptp(y):
        line = line[np.argsort(y[line])]
        at, columns = y[line], {name: axial(values)[line] for name, values in fields.items()}
    else:
        at = np.linspace(y.min(), y.max(), LINE_POINTS)
        mesh = Triangulation(x, y, view.triangles)
        columns = {
            name: LinearTriInterpolator(mesh, axial(values))(0 * at, at).filled(np.nan)
            for name, values in fields.items()
        }
    columns = {"y": at, "y/D": at / view.height, **columns}
    if "y" not in MIRRORS[view.symmetry]:
        return columns
    odd = {"y": -1, "y/D": -1}
    return {
        name: np.concatenate([odd.get(name, 1) * column[:0:-1], column])
        for name, column in columns.items()
    }


def section_picture(
    path: str | Path, view: SectionView, fields: Mapping[str, ArrayLike], title: str = ""
) -> None:
    """Draw alpha_s and the axial velocities over the whole section, with their profiles.

    path : of the PNG, replaced in one step
    fields : nodal values by name; "alpha_s", "u_s" and "u_g" are mapped over the section, these
        and "Theta" and "k" are drawn along the vertical diameter; others are left out
    """
    maps = [name for name in MAPS if name in fields]
    profile = vertical_profile(view, {name: fields[name] for name in LOOKS if name in fields})
    panels = _panels(profile)
    columns = max(len(maps), len(panels), 1)
    # colour bar and labels above and below a map take about an inch
    heights = (1.1 + 2.7 * min(view.height / view.width, 2.0), 3.3)
    figure = Figure(figsize=(3.3 * columns + 0.4, sum(heights)), layout="constrained")
    halves: Any = figure.subfigures(2, 1, height_ratios=heights)
    upper, lower = halves
    values = {name: axial(fields[name]) for name in maps}
    for axes, name in zip(_row(upper, len(maps)), maps, strict=True):
        _map(axes, view, values[name], LOOKS[name], _limits(name, values))
        axes.set_ylabel("y [mm]" if name == maps[0] else "", fontsize=9)
    _profiles(_row(lower, len(panels)), profile, panels)
    save_figure(figure, path, title)


# quantities along an axis on one set of axes, and the label that they share
AXIS_PANELS = (
    (("pressure",), "pressure above the outlet's"),
    (("pressure_gradient",), "pressure gradient"),
    (
        ("drop_gas_friction", "drop_solids_friction", "drop_lift", "drop_acceleration"),
        "drop from the inlet on",
    ),
    (("holdup", "max_solids_fraction", "bed_fraction"), "solids"),
    (("bed_height",), "bed height"),
    (("gas_velocity", "solids_velocity", "max_gas_velocity"), "axial velocity"),
    (("max_theta",), "granular temperature, largest"),
)


def axis_picture(
    path: str | Path,
    columns: Mapping[str, ArrayLike],
    units: Mapping[str, str],
    width: float,
    title: str = "",
) -> None:
    """Draw how a flow develops along its axis.

    path : of the PNG, replaced in one step
    columns : "z" [m] and quantities of equal length; those of `AXIS_PANELS` are drawn
    units : of the columns
    width : hydraulic diameter, the unit of the abscissa [m]
    """
    panels = [([n for n in names if n in columns], label) for names, label in AXIS_PANELS]
    panels = [(names, label) for names, label in panels if names]
    rows = -(-len(panels) // 2)
    figure = Figure(figsize=(9.0, 2.5 * rows + 0.5), layout="constrained")
    grid = figure.subplots(rows, 2, squeeze=False, sharex=True).ravel()
    at = np.asarray(columns["z"]) / width
    for axes, (names, label) in zip(grid, panels, strict=False):
        for name in names:
            values = np.asarray(columns[name])
            values = values - values[-1] if name == "pressure" else values
            axes.plot(at, values, linewidth=1.5, label=name.replace("_", " "))
        unit = units.get(names[0], "").replace("2", "²")
        axes.set_ylabel(f"{label} [{unit}]" if unit not in ("", "-") else label, fontsize=9)
        if names[0] in ("pressure_gradient", "max_theta"):
            # an entrance is far above the rest
            axes.set_yscale("log" if np.nanmin(np.asarray(columns[names[0]])) > 0 else "symlog")
        if len(names) > 1:
            axes.legend(fontsize=8, frameon=False)
        axes.grid(color="#dddddd", linewidth=0.6)
        axes.tick_params(which="both", **STYLE)
        axes.spines[["top", "right"]].set_visible(False)
        axes.set_xlim(at[0], at[-1])
        axes.set_xlabel("z/D", fontsize=9)
    for axes in grid[len(panels) :]:
        axes.set_axis_off()
    save_figure(figure, path, title)


# a plane longer than this over its height is drawn stretched, one below the other
LONGEST_PLANE = 8.0


def plane_picture(
    path: str | Path,
    points: NDArray[np.float64],
    moments: Mapping[float, NDArray[np.float64]],
    title: str = "",
    name: str = "alpha_s",
) -> None:
    """Draw a quantity in a plane at several times, with one scale of colours.

    path : of the PNG, replaced in one step
    points : coordinates along and up of a grid in the plane, shape (rows, columns, 2), two
        rows and columns at least [m]
    moments : values of each time [s], shape (rows, columns); nan is left blank
    name : of the quantity, one of `LOOKS`
    """
    length, height = np.ptp(points.reshape(-1, 2), axis=0)
    stretched = length > LONGEST_PLANE * height
    across = min(1 + int(height > 0.3 * length) + int(height > 0.6 * length), len(moments))
    down = -(-len(moments) // across)
    tall = 1.0 if stretched else 9.0 / across * height / length
    figure = Figure(figsize=(9.6, 0.9 + down * (0.55 + tall)), layout="constrained")
    grid = figure.subplots(down, across, squeeze=False, sharex=True, sharey=True).ravel()
    low, high = _limits(name, {name: np.concatenate([v.ravel() for v in moments.values()])})
    look, corners = LOOKS[name], 1e3 * np.moveaxis(_corners(points), -1, 0)
    for axes, (time, values) in zip(grid, moments.items(), strict=False):
        image = axes.pcolormesh(
            *corners, values, shading="flat", cmap=look.map, vmin=low, vmax=high, rasterized=True
        )
        axes.set_title(f"{time:.4g} s", fontsize=9, loc="left", pad=2)
        axes.set_aspect("auto" if stretched else "equal")
        axes.tick_params(**STYLE)
        axes.spines[["top", "right"]].set_visible(False)
    for axes in grid[len(moments) :]:
        axes.set_axis_off()
    figure.supxlabel("z [mm]", fontsize=9)
    figure.supylabel("y [mm]", fontsize=9)
    bar = figure.colorbar(image, ax=list(grid), location="top", shrink=0.5, aspect=40, pad=0.02)
    bar.set_label(look.label, fontsize=10)
    bar.ax.tick_params(**STYLE)
    bar.outline.set_visible(False)
    save_figure(figure, path, title)


def _corners(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Corners of the cells around the points of a grid, one row and column more."""
    wide = np.pad(points, ((1, 1), (1, 1), (0, 0)), mode="reflect", reflect_type="odd")
    return (wide[:-1, :-1] + wide[1:, :-1] + wide[:-1, 1:] + wide[1:, 1:]) / 4


def sweep_picture(
    path: str | Path,
    table: Mapping[str, Sequence[Any]],
    varied: Sequence[str] | None = None,
    units: Mapping[str, str] | None = None,
    title: str = "",
    errors: Mapping[str, Sequence[float | None]] | None = None,
) -> None:
    """Draw every quantity of a sweep against the varied parameter.

    table : columns of equal length
    varied : names of the varied columns, by default the first; the first is the abscissa, each
        combination of the others is a line
    units : of the columns
    errors : of the quantities that have some, drawn as bars; None where there is none
    """
    units, errors = units or {}, errors or {}
    varied = list(varied or list(table)[:1])
    shown = [name for name in table if name not in varied and _numeric(table[name])]
    columns = min(3, max(len(shown), 1))
    rows = -(-max(len(shown), 1) // columns)
    figure = Figure(figsize=(3.9 * columns, 3.0 * rows + 0.5), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, name in zip(grid, shown, strict=False):
        plot_lines(axes, table, varied, name, errors.get(name))
        axes.set_xlabel(_with_unit(varied[0], units), fontsize=9)
        axes.set_ylabel(_with_unit(name, units), fontsize=9)
    for axes in grid[len(shown) :]:
        axes.set_axis_off()
    if len(varied) > 1 and shown:
        key = ", ".join(_with_unit(name, units) for name in varied[1:])
        grid[0].legend(fontsize=7, frameon=False, title=key, title_fontsize=7)
    save_figure(figure, path, title)


def _row(figure: Any, number: int) -> NDArray[Any]:
    return figure.subplots(1, number, squeeze=False)[0] if number else np.array([])


def _panels(columns: Mapping[str, ArrayLike]) -> list[tuple[list[str], str]]:
    """Names on each set of axes, and its label; sets without a name are left out."""
    found = []
    for names, label in PANELS:
        present = [name for name in names if name in columns]
        if present:
            found.append((present, label or _shared_label(present)))
    return found


def _shared_label(names: Sequence[str]) -> str:
    looks = [LOOKS[name] for name in names]
    if len(looks) == 1:
        return looks[0].label
    return ", ".join(look.symbol.split()[-1] for look in looks) + f" [{looks[0].unit}]"


def _limits(name: str, values: Mapping[str, NDArray[np.float64]]) -> tuple[float, float]:
    """Colour limits at round numbers and with zero; velocities share one, so that slip is seen."""
    shared = [name] if name == "alpha_s" else [other for other in values if other != "alpha_s"]
    together = np.concatenate([[0.0], *(values[other] for other in shared)])
    low, high = float(np.nanmin(together)), float(np.nanmax(together))
    ticks = MaxNLocator(10, steps=[1, 2, 5, 10]).tick_values(low, high if high > low else low + 1)
    return float(ticks[0]), float(ticks[-1])


def _map(
    axes: Axes,
    view: SectionView,
    values: NDArray[np.float64],
    look: Look,
    limits: tuple[float, float],
) -> None:
    low, high = limits
    levels = np.asarray(MaxNLocator(5).tick_values(low, high))
    levels = levels[(levels > np.nanmin(values)) & (levels < np.nanmax(values))]
    wall = view.wall()
    for copy in view.copies():
        copy.x, copy.y = 1e3 * copy.x, 1e3 * copy.y
        image = axes.tripcolor(
            copy, values, shading="gouraud", cmap=look.map, vmin=low, vmax=high, rasterized=True
        )
        if len(levels) and np.isfinite(values).all():
            axes.tricontour(copy, values, levels, colors="white", linewidths=0.5, alpha=0.6)
        ends = np.stack([copy.x[wall], copy.y[wall]], axis=-1)
        axes.add_collection(LineCollection(list(ends), colors="#222222", linewidths=1.0))
    # contours set limits that would cut the line of the wall in half
    axes.use_sticky_edges = False
    axes.margins(0.02)
    axes.set_aspect("equal")
    axes.set_xlabel("x [mm]", fontsize=9)
    axes.tick_params(labelsize=STYLE["labelsize"], length=0)
    axes.spines[:].set_visible(False)
    bar = axes.figure.colorbar(image, ax=axes, location="top", shrink=0.85, aspect=22, pad=0.03)
    bar.set_label(look.label, fontsize=10)
    bar.ax.tick_params(**STYLE)
    bar.outline.set_visible(False)
    bar.locator = MaxNLocator(5)
    bar.update_ticks()


def _profiles(
    row: NDArray[Any], columns: Mapping[str, ArrayLike], panels: Sequence[tuple[list[str], str]]
) -> None:
    height = np.asarray(columns["y/D"])
    for i, (axes, (names, label)) in enumerate(zip(row, panels, strict=True)):
        for name in names:
            look = LOOKS[name]
            symbol = look.symbol.split()[-1]
            axes.plot(axial(columns[name]), height, color=look.line, linewidth=1.6, label=symbol)
        log = all(LOOKS[name].log and np.nanmin(np.asarray(columns[name])) > 0 for name in names)
        if log:
            axes.set_xscale("log")
        else:
            axes.set_xlim(left=min(0.0, axes.get_xlim()[0]))
        axes.set_ylim(height.min(), height.max())
        axes.set_xlabel(label, fontsize=10)
        axes.set_ylabel("y/D" if i == 0 else "", fontsize=10)
        axes.grid(color="#dddddd", linewidth=0.6)
        axes.tick_params(**STYLE)
        axes.spines[["top", "right"]].set_visible(False)
        if len(names) > 1:
            axes.legend(fontsize=9, frameon=False)


def _numeric(column: ArrayLike) -> bool:
    return np.asarray(column).dtype.kind in "iuf"


def _with_unit(name: str, units: Mapping[str, str]) -> str:
    words = name.replace("_", " ")
    return f"{words} [{units[name]}]" if units.get(name) else words


def plot_lines(
    axes: Axes,
    table: Mapping[str, Sequence[Any]],
    varied: list[str],
    name: str,
    errors: Sequence[float | None] | None = None,
) -> None:
    """One line for each combination of the other varied values; only markers for names.

    errors : half lengths of the bars; none where it is None
    """
    x, y = np.asarray(table[varied[0]]), np.asarray(table[name], dtype=float)
    bars = np.zeros(len(y)) if errors is None else np.nan_to_num(np.asarray(errors, dtype=float))
    others = [[str(v) for v in table[other]] for other in varied[1:]]
    groups = [", ".join(parts) for parts in zip(*others, strict=True)] or [""] * len(y)
    for group in dict.fromkeys(groups):
        rows = np.flatnonzero(np.array(groups) == group)
        if _numeric(x):
            rows = rows[np.argsort(x[rows], kind="stable")]
        style = "o-" if _numeric(x) else "o"
        (line,) = axes.plot(x[rows], y[rows], style, markersize=5, linewidth=1.4, label=group)
        if bars[rows].any():
            colour = line.get_color()
            axes.errorbar(x[rows], y[rows], bars[rows], fmt="none", ecolor=colour, capsize=2)
    if not _numeric(x):
        axes.margins(x=0.15)
        axes.tick_params(axis="x", rotation=20 if max(map(len, map(str, x))) > 8 else 0)
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.tick_params(**STYLE)
    axes.spines[["top", "right"]].set_visible(False)


def save_figure(figure: Figure, path: str | Path, title: str) -> None:
    """Write a figure under its title as PNG, replaced in one step."""
    if title:
        figure.suptitle(title, fontsize=12)
    with replaced(path) as temporary:
        figure.savefig(temporary, dpi=DPI, format="png")

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Counterparts of figures 3 to 10 of Ding et al. (2024), each drawn from plain arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray
from study_findings import CASES, EXPERIMENT, FRICTIONS, SCATTER

from fem_tfm.output.pictures import SectionView

COLOURS = dict(zip(FRICTIONS, ("#c2571a", "#1f5fa8", "#2c7a4b"), strict=True))
LABELS = {
    "u_g": "gas velocity [m/s]",
    "u_s": "solids velocity [m/s]",
    "k": "gas turbulence k [m²/s²]",
    "k_s": "solids turbulence k_p [m²/s²]",
    "Theta": "granular temperature [m²/s²]",
    "alpha_s": "solids fraction",
    "p_f": "frictional pressure [Pa]",
    "tau_f": "frictional shear stress [Pa]",
}
Profile = Mapping[str, NDArray[np.float64]]


def _plain(axes: Axes, x: str, y: str) -> None:
    axes.set_xlabel(x, fontsize=9)
    axes.set_ylabel(y, fontsize=9)
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)


def drops(gas: Sequence[float], rows: Mapping[str, Mapping[str, Mapping[int, float]]]) -> Figure:
    """Figure 3: pressure drop over supplementary gas.

    gas : Q_s of the cases [m3/h]
    rows : drop [Pa] by feed, law of friction and case
    """
    figure = Figure(figsize=(4.4 * len(rows), 3.6), layout="constrained")
    panels = figure.subplots(1, len(rows), sharey=True, squeeze=False)[0]
    at = dict(zip(CASES, gas, strict=True))
    for axes, (feed, laws) in zip(panels, rows.items(), strict=True):
        for law, values in laws.items():
            cases = sorted(values)
            drop = [values[c] / 1e3 for c in cases]
            axes.plot([at[c] for c in cases], drop, "o-", color=COLOURS[law], label=law)
        for case, value in EXPERIMENT.items():
            bars = [[-SCATTER[0] * value / 1e3], [SCATTER[1] * value / 1e3]]
            label = "experiment, with the errors of the paper's models"
            axes.errorbar(at[case], value / 1e3, bars, fmt="ks", capsize=4, label=label)
        _plain(axes, "supplementary gas Q_s [m³/h]", "pressure drop over 2.4 m [kPa]")
        axes.set_title(f"feed: {feed}", fontsize=10)
    panels[0].legend(fontsize=7, frameon=False)
    return figure


def stations(profiles: Mapping[float, Profile]) -> Figure:
    """Figure 4: axial velocities along the height at several z/D."""
    figure = Figure(figsize=(8.4, 3.6), layout="constrained")
    for axes, name in zip(figure.subplots(1, 2, sharey=True), ("u_g", "u_s"), strict=True):
        shades = np.linspace(0.85, 0.0, len(profiles))
        for shade, (z, profile) in zip(shades, profiles.items(), strict=True):
            axes.plot(profile[name], profile["y/D"], color=str(shade), label=f"{z:.0f} D")
        _plain(axes, LABELS[name], "y/D")
    figure.axes[0].legend(fontsize=7, frameon=False)
    return figure


def maps(
    views: Mapping[tuple[str, int], tuple[SectionView, NDArray[np.float64]]], label: str
) -> Figure:
    """Figures 5, 8 and 9: one quantity over the sections, a row for each law of friction."""
    figure = Figure(figsize=(9.0, 6.0), layout="constrained")
    grid = figure.subplots(len(FRICTIONS), len(CASES), squeeze=False)
    top = max((values.max() for _, values in views.values()), default=1.0)
    image = None
    for row, law in zip(grid, FRICTIONS, strict=True):
        for axes, case in zip(row, CASES, strict=True):
            axes.set_axis_off()
            axes.set_aspect("equal")
            if law == FRICTIONS[0]:
                axes.set_title(f"case {case}", fontsize=9)
            if case == CASES[0]:
                axes.text(-0.1, 0.5, law, rotation=90, va="center", ha="right", fontsize=9,
                          transform=axes.transAxes)  # fmt: skip
            if (law, case) not in views:
                axes.text(0.5, 0.5, "failed", ha="center", transform=axes.transAxes)
                continue
            view, values = views[law, case]
            for copy in view.copies():
                image = axes.tripcolor(
                    copy, values, shading="gouraud", cmap="cividis", vmin=0.0, vmax=top
                )
    if image is not None:
        figure.colorbar(image, ax=grid, shrink=0.7, label=label)
    return figure


def heights(profiles: Mapping[tuple[str, int], Profile], gas: Sequence[float]) -> Figure:
    """Figure 6: solids fraction along the height, a panel for each law of friction."""
    figure = Figure(figsize=(9.6, 3.6), layout="constrained")
    panels = figure.subplots(1, len(FRICTIONS), sharey=True, sharex=True)
    for axes, law in zip(panels, FRICTIONS, strict=True):
        for case, q in zip(CASES, gas, strict=True):
            if (law, case) in profiles:
                profile = profiles[law, case]
                axes.plot(profile["alpha_s"], profile["y/D"], label=f"Q_s = {q:.1f} m³/h")
        axes.set_title(law, fontsize=10)
        _plain(axes, LABELS["alpha_s"], "y/D" if law == FRICTIONS[0] else "")
    for axes in [axes for axes in panels if axes.lines][:1]:
        axes.legend(fontsize=7, frameon=False)
    return figure


def pressures(alpha: NDArray[np.float64], curves: Mapping[str, NDArray[np.float64]]) -> Figure:
    """Figure 7: frictional pressure [Pa] over solids fraction."""
    figure = Figure(figsize=(4.8, 3.6), layout="constrained")
    axes = figure.subplots()
    for law, values in curves.items():
        axes.semilogy(alpha, values, color=COLOURS[law], label=law)
    axes.set_ylim(1e-3, 1e3)
    _plain(axes, LABELS["alpha_s"], LABELS["p_f"])
    axes.legend(fontsize=8, frameon=False)
    return figure


def laws(profiles: Mapping[str, Profile]) -> Figure:
    """Figure 10: everything along the height of one case, by law of friction."""
    names = [n for n in LABELS if any(n in p for p in profiles.values())][:6]
    figure = Figure(figsize=(9.6, 6.2), layout="constrained")
    grid: Any = figure.subplots(2, 3, sharey=True, squeeze=False).ravel()
    for axes, name in zip(grid, names, strict=False):
        for law, profile in profiles.items():
            if name in profile:
                axes.plot(profile[name], profile["y/D"], color=COLOURS[law], label=law)
        if name == "Theta":
            axes.set_xscale("log")
        else:
            axes.xaxis.set_major_locator(MaxNLocator(5))
        _plain(axes, LABELS[name], "y/D")
    grid[0].legend(fontsize=7, frameon=False)
    return figure

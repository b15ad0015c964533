# SPDX-License-Identifier: LGPL-3.0-or-later
"""The picture of what a pressure drop is spent on."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from fem_tfm.output.files import on_root, replaced
from fem_tfm.output.result import Result

FILE = "split.png"
# parts by their names, with words and colours
PARTS = {
    "drop_gas_friction": ("friction of the gas", "#1f5fa8"),
    "drop_solids_friction": ("friction of the solids", "#c2571a"),
    "drop_lift": ("lift of both phases", "#6b4c1e"),
    "drop_acceleration": ("acceleration", "#2c7a4b"),
    "drop_omitted_pressure": ("solids pressure left out", "#8a3a7a"),
}
DPI = 160


def split_picture(path: str | Path, values: Mapping[str, float], title: str = "") -> None:
    """Draw the parts of a pressure drop one after another, and the drop that they sum to.

    path : of the PNG, replaced in one step
    values : "pressure_drop" and its parts [Pa]
    """
    names = [name for name in PARTS if name in values]
    figure = Figure(figsize=(7.2, 0.9 + 0.42 * (len(names) + 1)), layout="constrained")
    axes = figure.subplots()
    ends = list(itertools.accumulate((values[name] for name in names), initial=0.0))
    drop = values["pressure_drop"]
    for row, (name, begin) in enumerate(zip(names, ends, strict=False)):
        axes.barh(row, values[name], left=begin, height=0.6, color=PARTS[name][1])
    axes.barh(len(names), drop, height=0.6, color="#333333")
    parts = [(PARTS[name][0], values[name]) for name in names]
    labels = [f"{words}  {value:.4g} Pa" for words, value in [*parts, ("pressure drop", drop)]]
    axes.set_yticks(range(len(labels)), labels, fontsize=9)
    axes.invert_yaxis()
    axes.axvline(0.0, color="#222222", linewidth=0.8)
    axes.set_xlabel("pressure [Pa]", fontsize=9)
    axes.tick_params(labelsize=8, length=2)
    axes.grid(axis="x", color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right", "left"]].set_visible(False)
    if title:
        figure.suptitle(title, fontsize=12)
    with replaced(path) as temporary:
        figure.savefig(temporary, dpi=DPI, format="png")


def draw_split(result: Result, out: Path | None, wanted: bool, comm: Any) -> None:
    """Draw the split of a result into a directory, where it has one (collective)."""
    values = {name: quantity.value for name, quantity in result.quantities.items()}
    known = [values[name] for name in ("pressure_drop", *PARTS) if name in values]
    if out is None or not wanted or not PARTS.keys() & values.keys():
        return
    if all(math.isfinite(value) for value in known):
        on_root(comm, lambda: split_picture(out / FILE, values, result.title))

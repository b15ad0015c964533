# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the paper says of its figures, and what can be said of points with errors."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from fem_tfm.output.report import items, table
from fem_tfm.output.result import Result
from fem_tfm.study.sweep import Point

Columns = Mapping[str, np.ndarray]

# figures in the order of the page
PAPER = {
    "1": (
        "slugs form at the inlet and many dissolve on their way (4 s are shown); 3200 "
        "grains, 1000 Pa/m"
    ),
    "2": "a slug of about 470 grains on a stretch of 11.3 cm",
    "3": (
        "the drop falls with the gas velocity; the tube is full below 0.25 m/s at 2.49 "
        "kg/h, slugs go up to 4 m/s"
    ),
    "4": (
        "at 4 m/s the tube is almost empty, with small slugs and single grains; 1400 "
        "grains, 1000 Pa/m"
    ),
    "5": "the drop rises linearly with the mass flow, since there are more slugs",
    "6": "the drop falls with the viscosity",
    "pressure": (
        "a change of P_0 at the same flow leaves the drop unchanged, for both terms of "
        "eq. (5) are proportional to it"
    ),
    "7": (
        "the drop peaks at mu = 0.1, where a sliding layer becomes slugs, falls up to "
        "0.15 and rises from there; it is small below 0.1"
    ),
    "8": ("many small slugs at the inlet, most of them gone by 0.3 m, then a stable number"),
    "9": "least porosity 0.57 at the inlet, 0.47 from 0.2 to 0.45 m, more at the end",
    "10": ("fastest grains 0.04 m/s at the inlet, 0.3 m/s from 0.2 to 0.45 m, faster at the end"),
    "11": "the length grows up to 0.3 m and is stable from there",
    "12": (
        "porosity falls from 0.85 to 0.5 at the front, is constant inside and rises at the back"
    ),
    "13": "grains rest before the slug and behind it and have a constant velocity inside",
    "14": ("drag and contact forces balance inside; contact forces fluctuate most at the front"),
    "15": "the wall stress inside is far above the weight, and equals it outside",
    "16": (
        "granular temperature rises quickly at the front, falls along the slug and is "
        "zero far behind"
    ),
    "17": (
        "grains fill the section in the middle of a slug and lie at the bottom before and after"
    ),
    "18": "grains rest before the slug, move in it and come to rest behind it",
    "19": "lower layers are slower than upper ones",
    "20": (
        "level slugs dissolve and are swept up, upright plugs merge and are slower: "
        "grains at 0.17 against 0.3 m/s"
    ),
    "21": ("upright the drop is about four times the level one and rises with mu throughout"),
}
# the default case: what the paper prints
PRINTED = {
    "pressure_gradient": "1000",
    "grains_in_tube": "3200",
    "slug_velocity": "0.42",
    "slug_rate": "1.2",
    "slug_length": "0.04 to 0.08",
    "slug_grains": "470",
    "least_porosity": "0.47 to 0.50",
    "top_grain_velocity": "0.3",
}
STEADY, UNSTEADY, BULK = "steady", "not steady", "full"


def told(value: float, error: float | None) -> str:
    """A number with as many digits as its error leaves."""
    if not math.isfinite(value):
        return "none"
    if error is None or not math.isfinite(error) or error <= 0:
        return f"{value:.3g}"
    digits = max(1 - math.floor(math.log10(error)), 0)
    return f"{value:.{digits}f} ± {error:.{digits}f}"


def regime(warnings: Iterable[str]) -> str:
    """Whether the tube was full, still filling or emptying, or steady."""
    texts = " ".join(warnings)
    if "bulk, not slugs" in texts:
        return BULK
    return UNSTEADY if UNSTEADY in texts else STEADY


def trend(points: Sequence[tuple[float, float, float]]) -> list[str]:
    """What can be said of (x, y, error): the change from end to end, and a peak.

    Errors are twice the standard ones; a change counts where it exceeds that of the difference.
    """
    if len(points) < 2:
        return []
    (a, low, first), (b, high, last) = points[0], points[-1]
    change, error = high - low, math.hypot(first, last)
    if not math.isfinite(error):
        return [f"from {a:.4g} to {b:.4g} the drop changes by {change:.0f} Pa/m, errors unknown"]
    word = "does not change beyond its error"
    if abs(change) > error:
        word = "rises" if change > 0 else "falls"
    said = [f"from {a:.4g} to {b:.4g} the drop {word}: {change:+.0f} ± {error:.0f} Pa/m"]
    inner = [p for p in points[1:-1] if math.isfinite(p[2])]
    for x, y, e in inner:
        if y - e > max(low + first, high + last):
            said.append(f"there is a peak at {x:.4g}")
    return said


def proportional(points: Sequence[tuple[float, float, float]]) -> list[str]:
    """The best multiple of x, and how many errors the points lie off it at most."""
    x, y, error = np.array(points, dtype=float).T
    if len(x) < 3 or not np.isfinite(error).all() or (error <= 0).any() or (x <= 0).any():
        return []
    slope = float((x * y / error**2).sum() / (x**2 / error**2).sum())
    off = np.abs(y - slope * x) / error
    words = "proportional within the errors" if off.max() <= 1 else "not proportional"
    return [f"{words}: {slope:.4g} x, the points lie up to {off.max():.1f} errors off it"]


def at(columns: Columns, x: float, name: str) -> str:
    """A column at the place nearest to x, with twice its standard error."""
    first = next(iter(columns))
    row = int(np.nanargmin(np.abs(columns[first] - x)))
    error = columns.get(f"{name} error", np.full(row + 1, np.nan))[row]
    return told(float(columns[name][row]), 2 * float(error))


def along(columns: Columns) -> dict[str, str]:
    """Figures 8 to 11 in numbers, from along.csv."""
    places = (0.05, 0.2, 0.3, 0.4, 0.51)
    names = {"8": "rate", "9": "least_porosity", "10": "top_velocity", "11": "length"}
    units = {"8": "1/s", "9": "", "10": "m/s", "11": "m"}
    return {
        number: "; ".join(f"{at(columns, z, name)} at {100 * z:.0f} cm" for z in places)
        + (f" [{units[number]}]" if units[number] else "")
        for number, name in names.items()
    }


def average(columns: Columns) -> dict[str, str]:
    """Figures 12 to 16 in numbers, from profile.csv; none where no slug has passed."""
    if not np.isfinite(columns["contact error"]).any():
        return {}
    places = {"6 cm behind": -0.06, "2 cm behind": -0.02, "centre": 0.0, "2 cm ahead": 0.02,
              "6 cm ahead": 0.06}  # fmt: skip
    names = {"12": ("porosity", ""), "13": ("velocity", "m/s"), "15": ("wall_stress", "Pa"),
             "16": ("temperature", "m2/s2")}  # fmt: skip
    found = {
        number: "; ".join(f"{at(columns, z, name)} {where}" for where, z in places.items())
        + (f" [{unit}]" if unit else "")
        for number, (name, unit) in names.items()
    }
    found["15"] += f"; the weight alone {at(columns, 0.0, 'weight')} at the centre"
    inside = np.abs(columns["offset"]) < 0.01
    drag, contact = (float(np.nanmean(columns[n][inside])) for n in ("drag", "contact"))
    rough = columns["offset"][int(np.nanargmax(columns["contact error"]))]
    found["14"] = (
        f"inside drag {drag:.3g} N, contact {contact:.3g} N; contact forces are least certain"
        f" {100 * rough:+.1f} cm from the centre"
    )
    return found


def sheared(columns: Columns) -> dict[str, str]:
    """Figure 19 in numbers, from layers.csv."""
    v = columns["velocity"][np.isfinite(columns["velocity"])]
    if not len(v):
        return {}
    return {"19": f"bottom layer {v[0]:.3g} m/s, middle {v[len(v) // 2]:.3g}, top {v[-1]:.3g}"}


def beside(result: Result) -> list[str]:
    """Table of the default case beside the printed numbers."""
    rows = [
        [name.replace("_", " "), told(result[name], q.error_estimate), PRINTED.get(name, "")]
        for name, q in result.quantities.items()
    ]
    return [*table(["quantity", "here", "paper"], rows), *items(result.warnings)]


def around(points: Sequence[Point], name: str) -> list[str]:
    """Other choices at one friction."""
    return table(
        ["choice", "drop [Pa/m]", "tube"],
        [
            [
                ", ".join(f"{key} = {value}" for key, value in p.values.items()),
                told(p.quantities.get(name, math.nan), p.errors.get(name)),
                regime(p.warnings),
            ]
            for p in points
        ],
    )

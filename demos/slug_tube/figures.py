# SPDX-License-Identifier: LGPL-3.0-or-later
"""Everything that Strauss, McNamara and Herrmann show of the slug tube, in one command.

    python demos/slug_tube/figures.py [--out DIR] [--jobs N] [--only NAME]... [--set KEY=VALUE]...

runs slug_tube.toml, then curves.toml over gas velocity, mass flow, viscosity, pressure, friction
and orientation, N points at once. Counterparts of figures 1 to 21, each beside what the paper says
of it, go to DIR/figures.html, the curves to DIR/curves.png and DIR/curves.csv. A command that was
stopped goes on where it was; what has been run already is not run again.
"""

from __future__ import annotations

import argparse
import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

import figures_said as said
from matplotlib.figure import Figure

from fem_tfm.case import Case
from fem_tfm.cli import parse_variation
from fem_tfm.output.files import write_text
from fem_tfm.output.pictures import save_figure
from fem_tfm.output.report import document, image, items, read_monitor, section, table
from fem_tfm.output.result import FILE, Result
from fem_tfm.progress import Progress
from fem_tfm.scenes.recorder import Setting
from fem_tfm.study import sweep
from fem_tfm.study.sweep import Point

HERE = Path(__file__).parent
OUT = Path("results") / "slug_figures"
GAS, FLOW, FRICTION = (
    "operation.gas_superficial_velocity",
    "operation.solids_mass_flow",
    "closures.contact.friction",
)
ETA, LEVEL, TURN = "gas.viscosity", "gas.reference_pressure", "geometry.inclination_deg"
ROLLING, LAW, START = "closures.contact.rolling_friction", "closures.contact", "initial.state"
# kg/h in kg/s
HOURLY = 1 / 3600
DROP = "pressure_gradient"


@dataclass(frozen=True)
class Curve:
    """One sweep of curves.toml.

    values : of the key that varies
    settings : what else differs from curves.toml
    keep : whether the points leave pictures
    """

    key: str
    values: tuple[Any, ...]
    settings: dict[str, Any] = field(default_factory=dict)
    keep: bool = False


LONGER = {"numerics.end_time": 22.0, "averages.begin": 15.0}
UPRIGHT = {TURN: 90.0}
# four times the feed fills the tube sooner
SHORTER = {"numerics.end_time": 9.0, "averages.begin": 5.0}
# layers that are pushed in at 0.04 m/s hold 2.6 kg/h at most
FAST = {"operation.solids_velocity": 0.16}
CURVES = {
    "middle": Curve(GAS, (1.0,)),
    "velocity": Curve(GAS, (2.0, 4.0), keep=True),
    "slow": Curve(GAS, (0.5, 0.25), LONGER),
    "velocity_9.95": Curve(GAS, (2.0, 4.0), FAST | SHORTER | {FLOW: 0.00276389}),
    "mass_flow": Curve(FLOW, (0.00138333, 0.00276389), FAST | SHORTER),
    "viscosity": Curve(ETA, (4.5e-5, 8.5e-5)),
    "pressure": Curve(LEVEL, (50662.5, 202650.0)),
    "friction": Curve(FRICTION, (0.02, 0.05, 0.1, 0.15, 0.3, 0.8)),
    "upright": Curve(TURN, (90.0,), keep=True),
    "upright_friction": Curve(FRICTION, (0.1, 0.3, 0.8), UPRIGHT),
    "rolling": Curve(ROLLING, (0.05,), {FRICTION: 0.1}),
    "filled": Curve(START, ("filled",), {FRICTION: 0.1}),
    "history": Curve(LAW, ({"model": "cundall-strack", "stiffness": 25.0, "friction": 0.1},)),
}


# -- running ---------------------------------------------------------------------------------------


def tube(out: Path, changes: Mapping[str, Any]) -> Result:
    """The default case, from where it was stopped."""
    place = out / "tube"
    case = Case.load(HERE / "slug_tube.toml").with_values(changes)
    if (place / FILE).is_file() and Result.read(place).status == "finished":
        return Result.read(place)
    resume = (place / "checkpoint").exists()
    setting = Setting(place, Progress(quiet=False), resume=resume)
    return case.scene.carry_out(setting, overwrite=not resume)[0]


def swept(out: Path, name: str, jobs: int, changes: Mapping[str, Any]) -> list[Point]:
    """Points of a curve; those that an older command has solved are taken over."""
    curve, place = CURVES[name], out / name
    case = Case.load(HERE / "curves.toml").with_values({**curve.settings, **changes})
    vary, known = {curve.key: list(curve.values)}, (place / sweep.CASE).is_file()
    found = sweep.run(case, vary, place, jobs, resume=known, keep=curve.keep)
    return [Point(p.number, {**curve.settings, **p.values}, **_rest(p)) for p in found.points]


def _rest(point: Point) -> dict[str, Any]:
    kept = ("status", "reason", "quantities", "errors", "cpu_seconds", "warnings")
    return {name: getattr(point, name) for name in kept}


# -- curves ----------------------------------------------------------------------------------------


def curve(points: Mapping[str, Sequence[Point]], key: str, *names: str) -> list[Point]:
    """Points of some sweeps in the order of a key; `middle` has the default of all keys."""
    base = Case.load(HERE / "curves.toml")
    found = []
    for name in names:
        for p in points.get(name, ()):
            if p.solved:
                value = p.values.get(key, _default(base, key))
                found.append(Point(p.number, {key: value}, **_rest(p)))
    return sorted(found, key=lambda p: float(p.values[key]))


def _default(case: Case, key: str) -> float:
    """The number of curves.toml, or that of the law where it has none."""
    if key == FRICTION:
        return float(case.scene.model.solids.contact.friction)
    return 0.0 if key == TURN else float(case[key])


def draw(
    axes: Any, lines: Mapping[str, Sequence[Point]], key: str, label: str, factor: float
) -> None:
    """Pressure drop over a key, a line each, with errors; open where the tube is not steady."""
    for name, points in lines.items():
        x = [factor * p.values[key] for p in points]
        y, bars = [p.quantities[DROP] for p in points], [p.errors.get(DROP) or 0 for p in points]
        (line,) = axes.plot(x, y, "-", linewidth=1.2, label=name)
        for a, b, bar, p in zip(x, y, bars, points, strict=True):
            fill = line.get_color() if said.regime(p.warnings) == said.STEADY else "none"
            axes.errorbar(a, b, bar, fmt="o", color=line.get_color(), mfc=fill, capsize=2)
    axes.set_xlabel(label, fontsize=9)
    axes.set_ylabel("pressure drop [Pa/m]", fontsize=9)
    axes.set_ylim(bottom=0)
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.tick_params(labelsize=8)
    if len(lines) > 1:
        axes.legend(fontsize=8, frameon=False)


def listed(points: Sequence[Point], key: str, head: str, factor: float) -> list[str]:
    """A table of a curve with the errors of its numbers."""
    names = (DROP, "grains_in_tube", "slug_velocity", "slug_rate")
    heads = [head, "drop [Pa/m]", "grains", "slug speed [m/s]", "slugs [1/s]", "tube"]
    rows = [
        [
            f"{factor * p.values[key]:.4g}",
            *(said.told(p.quantities.get(n, math.nan), p.errors.get(n)) for n in names),
            said.regime(p.warnings),
        ]
        for p in points
    ]
    return table(heads, rows)


# -- the page --------------------------------------------------------------------------------------


# number of a figure, key, label, factor to its unit, and sweeps of each line
PLANS: tuple[tuple[str, str, str, float, dict[str, tuple[str, ...]]], ...] = (
    ("3", GAS, "superficial gas velocity [m/s]", 1.0,
     {"2.49 kg/h": ("middle", "velocity", "slow"), "9.95 kg/h": ("velocity_9.95",)}),
    ("5", FLOW, "mass flow [kg/h]", 3600.0, {"1 m/s": ("middle", "mass_flow")}),
    ("6", ETA, "viscosity [cP]", 1000.0, {"1 m/s": ("middle", "viscosity")}),
    ("pressure", LEVEL, "P_0 [hPa]", 0.01, {"1 m/s": ("middle", "pressure")}),
    ("7", FRICTION, "Coulomb coefficient", 1.0, {"level": ("middle", "friction")}),
    ("21", FRICTION, "Coulomb coefficient", 1.0,
     {"level": ("middle", "friction"), "upright": ("upright", "upright_friction")}),
)  # fmt: skip


def curves(out: Path, points: Mapping[str, Sequence[Point]]) -> Iterator[tuple[str, list[str]]]:
    """Figures 3, 5 to 7 and 21: number of the figure, and its picture, table and trend."""
    together = Figure(figsize=(12.0, 6.6), layout="constrained")
    grid = together.subplots(2, 3).ravel()
    for axes, (number, key, label, factor, wanted) in zip(grid, PLANS, strict=True):
        lines = {name: curve(points, key, *names) for name, names in wanted.items()}
        lines = {name: found for name, found in lines.items() if found}
        if not lines:
            continue
        alone = Figure(figsize=(5.2, 3.6), layout="constrained")
        for there in (axes, alone.subplots()):
            draw(there, lines, key, label, factor)
        path = out / f"figure_{number}.png"
        save_figure(alone, path, "")
        parts = [image(path.read_bytes(), path.stem)]
        for name, found in lines.items():
            told = [(factor * p.values[key], *_drop(p)) for p in found]
            parts += [f"<p>{escape(name)}</p>", *listed(found, key, label, factor)]
            parts += items([*said.trend(told), *(said.proportional(told) if key == FLOW else [])])
        yield number, parts
    save_figure(together, out / "curves.png", "")


def _drop(point: Point) -> tuple[float, float]:
    return point.quantities[DROP], point.errors.get(DROP) or math.nan


def pictures(out: Path) -> dict[str, list[str]]:
    """Figures that runs have drawn themselves, and their numbers."""
    upright, fast = out / "upright" / "points" / "0", out / "velocity" / "points" / "1"
    home, found = out / "tube", dict[str, list[str]]()
    for number, paths in {
        "1": (home / "porosity.png",),
        "2": (home / "slug.png",),
        "4": (fast / "porosity.png",),
        "8": (home / "slugs.png",),
        "17": (home / "sections.png",),
        "20": (home / "porosity.png", upright / "porosity.png"),
    }.items():
        if all(path.is_file() for path in paths):
            found[number] = [image(path.read_bytes(), f"figure {number}") for path in paths]
    for drawn_at, others in {"8": range(9, 17), "17": (18, 19)}.items():
        if drawn_at in found:
            found |= {str(n): [f"<p>drawn at figure {drawn_at}</p>"] for n in others}
    known = {"along.csv": said.along, "profile.csv": said.average, "layers.csv": said.sheared}
    for name, numbers in known.items():
        if (home / name).is_file():
            for number, text in numbers(_columns(home / name)).items():
                found.setdefault(number, []).insert(0, f"<p>Here: {escape(text)}</p>")
    return found


def _columns(path: Path) -> dict[str, Any]:
    return {head.partition(" [")[0]: values for head, values in read_monitor(path).items()}


def page(out: Path, result: Result | None, points: Mapping[str, Sequence[Point]]) -> str:
    """All figures in the order of the paper, each beside what it says of it."""
    found = pictures(out) | dict(curves(out, points))
    parts = ["<h1>Figures of Strauss, McNamara and Herrmann</h1>"]
    if result is not None:
        parts += section("Default case", said.beside(result))
    for number, words in said.PAPER.items():
        head = f"Figure {number}" if number.isdigit() else f"Over {number}"
        body = found.get(number, ["<p>not run</p>"])
        parts += section(head, [f"<p>The paper: {escape(words)}</p>", *body])
    extra = [p for name in ("rolling", "filled", "history") for p in points.get(name, ())]
    if extra:
        parts += section("Around the peak, friction 0.1", said.around(extra, DROP))
    return document("Figures of the slug tube", parts)


def write(out: Path, result: Result | None, points: Mapping[str, Sequence[Point]]) -> None:
    """figures.html and curves.csv."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    names = sorted({n for group in points.values() for p in group for n in p.quantities})
    units = sweep.units(names)
    heads = [f"{n} [{units[n]}]" for n in names]
    errors = [f"{n} error [{units[n]}]" for n in names]
    rows.writerow(["curve", "values", *heads, *errors, "status", "warnings"])
    for name, group in points.items():
        for p in group:
            values = [p.quantities.get(n, "") for n in names]
            bars = [p.errors.get(n) or "" for n in names]
            rows.writerow([name, p.values, *values, *bars, p.status, "; ".join(p.warnings)])
    write_text(out / "curves.csv", text.getvalue())
    write_text(out / "figures.html", page(out, result, points))


def main(arguments: Sequence[str] | None = None) -> None:
    """Run what has not been run yet, and write the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--only", action="append", choices=["tube", *CURVES], default=[])
    parser.add_argument("--set", action="append", default=[], dest="settings")
    given = parser.parse_args(arguments)
    changes = {key: values[0] for key, values in map(parse_variation, given.settings)}
    chosen = given.only or ["tube", *CURVES]
    result = tube(given.out, changes) if "tube" in chosen else None
    points: dict[str, list[Point]] = {}
    for name in CURVES:
        if name in chosen:
            points[name] = swept(given.out, name, given.jobs, changes)
            write(given.out, result, points)
    write(given.out, result, points)
    print(f"figures in {given.out / 'figures.html'}")


if __name__ == "__main__":
    main()

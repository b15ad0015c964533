# SPDX-License-Identifier: LGPL-3.0-or-later
"""A run as one HTML page that needs nothing beside it: answer, pictures, course and case.

The page is made from the files of a run alone, so it can be made while the run works, after it
failed, and on another machine.
"""

from __future__ import annotations

import base64
import csv
import math
import tomllib
from collections.abc import Iterable, Sequence
from html import escape
from io import BytesIO
from pathlib import Path
from string import Template

import numpy as np
from matplotlib.figure import Figure

from fem_tfm.errors import InputError
from fem_tfm.output import result as results
from fem_tfm.output.files import write_text
from fem_tfm.output.result import Result
from fem_tfm.output.summary import MESH_ERROR, difference, error_notes, number

FILE = "report.html"
CASE, MONITOR, LOG = "case.toml", "monitor.csv", "run.log"
# pictures in this order, then any other
PICTURES = ("split.png", "section.png", "axis.png", "plane.png")
# columns of the monitor that only count, and the range from which an axis is logarithmic
COUNTERS = ("step", "station", "level", "z", "time", "iterations")
DECADES = 2
LOG_LINES = 20

PAGE = Template("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>$title</title>
<style>
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 62rem; margin: 2rem auto;
  padding: 0 1rem; }
h1 { font-size: 1.5rem; margin-bottom: 0; }
h2 { font-size: 1.1rem; margin: 2rem 0 .5rem; border-bottom: 1px solid #ddd; }
table { border-collapse: collapse; }
th, td { padding: .15rem .9rem .15rem 0; text-align: left; vertical-align: top; }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
tr.reference td { color: #666; }
img { max-width: 100%; }
pre { background: #f6f6f4; padding: .8rem; overflow-x: auto; font-size: 13px; }
.status { font-weight: 600; }
.converged, .finished { color: #1a7f37; }
.failed { color: #b42318; }
.interrupted, .unfinished { color: #9a6700; }
</style>
</head>
<body>
$body
</body>
</html>
""")


def write_report(directory: str | Path) -> Path:
    """Write `directory`/report.html from the files of a run and return its path.

    A run without result.json is still at work, or was killed; what there is is shown.

    Raises
    ------
    InputError
        the directory holds no run, or a file in it cannot be read.
    """
    directory = Path(directory)
    if not (directory / CASE).is_file():
        raise InputError("DIR", str(directory), "a directory with the results of a run")
    try:
        text = page(directory)
    except (OSError, ValueError, KeyError) as error:
        allowed = f"the files of a run as fem-tfm writes them ({error})"
        raise InputError("DIR", str(directory), allowed) from error
    write_text(directory / FILE, text)
    return directory / FILE


def page(directory: Path) -> str:
    """The page as HTML."""
    case = (directory / CASE).read_text(encoding="utf-8")
    result = Result.read(directory) if (directory / results.FILE).is_file() else None
    title = (result.title if result else tomllib.loads(case).get("title")) or directory.name
    parts = [f"<h1>{escape(title)}</h1>", *_head(result)]
    if result is not None:
        parts += section("Warnings", items(result.warnings))
        parts += section("What the answer says of itself", items(result.notes))
        parts += section("Quantities", _quantities(result))
        parts += section("What unprinted inputs move", items(map(str, result.inputs)))
        parts += section("Published correlations for the same line", items(result.estimates))
        parts += section("Balances", _balances(result))
    for path in _pictures(directory):
        parts += section(path.stem.capitalize(), [image(path.read_bytes(), path.stem)])
    parts += section("Course of the run", _course(directory / MONITOR))
    if result is not None:
        parts += section("Left out, and why", items(result.skipped))
        parts += section("Inputs that the source does not print", items(result.inferred))
        parts += section("Cost", _cost(result))
    parts += section("Case", [f"<pre>{escape(case)}</pre>"])
    parts += section("End of the log", _log(directory / LOG))
    return document(title, parts)


def document(title: str, parts: Iterable[str]) -> str:
    """A whole page out of pieces of HTML."""
    return PAGE.substitute(title=escape(title), body="\n".join(parts))


def section(head: str, lines: Sequence[str]) -> list[str]:
    """A heading over its lines, or nothing where there are none."""
    return [f"<h2>{escape(head)}</h2>", *lines] if lines else []


def _head(result: Result | None) -> list[str]:
    """Status, what was solved, and why it stopped."""
    if result is None:
        return ['<p><span class="status unfinished">unfinished</span>: at work, or killed</p>']
    text = (
        f'<p><span class="status {result.status}">{result.status}</span>: {escape(result.flow)} '
        f"flow, {escape(result.solution)} solution; {result.cells:,} cells, {result.dofs:,} "
        f"unknowns, {result.ranks} rank{'s' if result.ranks > 1 else ''}</p>"
    )
    return [text, f"<p>{escape(result.reason)}</p>"] if result.reason else [text]


def _quantities(result: Result) -> list[str]:
    """A row for each quantity and for each of its references."""
    quantities = result.quantities
    if not quantities:
        return []
    head = ["quantity", "value", MESH_ERROR, "unit", "difference"]
    rows = ["<tr>" + _cells(head, "th") + "</tr>"]
    for name, q in quantities.items():
        cells = [name.replace("_", " "), number(q.value), number(q.error_estimate, 2), q.unit, ""]
        rows.append(f"<tr>{_cells(cells)}</tr>")
        for reference in q.references:
            off = difference(q.value, reference.value)
            cells = [reference.source or "reference", number(reference.value), "", q.unit, off]
            rows.append(f'<tr class="reference">{_cells(cells)}</tr>')
    notes = (f"<p>{escape(text)}</p>" for text in error_notes(result))
    return ["<table>", *rows, "</table>", *notes]


def _cells(values: Sequence[str], tag: str = "td") -> str:
    """Cells of a row of quantities; the second, third and fifth are numbers."""
    marks = ("", ' class="n"', ' class="n"', "", ' class="n"')
    pairs = zip(marks, values, strict=True)
    return "".join(f"<{tag}{mark}>{escape(value)}</{tag}>" for mark, value in pairs)


def _balances(result: Result) -> list[str]:
    rows = [
        f'<tr><td>{escape(name.replace("_", " "))}</td><td class="n">{value:.1e}</td></tr>'
        for name, value in result.balances.items()
    ]
    return ["<table>", *rows, "</table>"] if rows else []


def items(texts: Iterable[str]) -> list[str]:
    """A list of texts, or nothing where there are none."""
    rows = [f"<li>{escape(text)}</li>" for text in texts]
    return ["<ul>", *rows, "</ul>"] if rows else []


def _cost(result: Result) -> list[str]:
    seconds = ", ".join(f"{name} {value:.1f} s" for name, value in result.seconds.items())
    versions = ", ".join(f"{name} {value}" for name, value in result.versions.items())
    told = [f"wall time: {seconds}"] if seconds else []
    if math.isfinite(result.cpu_seconds):
        told.append(f"CPU: {result.cpu_seconds:.1f} s")
    if math.isfinite(result.peak_memory_mb):
        told.append(f"memory: {result.peak_memory_mb:.0f} MB")
    return items([*told, versions])


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """A table of texts, all columns but the first one set as numbers."""
    marks = ["", *[' class="n"'] * (len(head) - 1)]

    def row(tag: str, cells: Sequence[str]) -> str:
        told = zip(marks, cells, strict=True)
        return "<tr>" + "".join(f"<{tag}{m}>{escape(c)}</{tag}>" for m, c in told) + "</tr>"

    return ["<table>", row("th", head), *(row("td", cells) for cells in rows), "</table>"]


def _pictures(directory: Path) -> list[Path]:
    known = [directory / name for name in PICTURES if (directory / name).is_file()]
    return known + [path for path in sorted(directory.glob("[!.]*.png")) if path not in known]


def image(data: bytes, name: str) -> str:
    """A PNG picture inside the page."""
    text = base64.b64encode(data).decode("ascii")
    return f'<img alt="{escape(name)}" src="data:image/png;base64,{text}">'


def _log(path: Path) -> list[str]:
    if not path.is_file():
        return []
    lines = path.read_text(encoding="utf-8").splitlines()[-LOG_LINES:]
    return [f"<pre>{escape(chr(10).join(lines))}</pre>"] if lines else []


# -- the monitor -------------------------------------------------------------------------------


def _course(path: Path) -> list[str]:
    """Curves of monitor.csv over its rows, or over z or the time where it has one."""
    columns = read_monitor(path)
    if not columns or not len(next(iter(columns.values()))):
        return []
    heads = {head.partition(" [")[0]: head for head in columns}
    abscissa = heads.get("z") or heads.get("time")
    x = columns[abscissa] if abscissa else np.arange(1, len(next(iter(columns.values()))) + 1)
    drawn = [name for name in heads if name not in COUNTERS]
    drawn = [name for name in drawn if np.isfinite(columns[heads[name]]).any()]
    rows = -(-len(drawn) // 3)
    figure = Figure(figsize=(10.5, 2.3 * rows), layout="constrained")
    grid = figure.subplots(rows, 3, squeeze=False).ravel()
    for axes, name in zip(grid, drawn, strict=False):
        values = columns[heads[name]]
        axes.plot(x, values, linewidth=1.3, color="#1f5fa8", marker="." if len(x) < 3 else "")
        known = values[np.isfinite(values)]
        if known.min() > 0 and known.max() / known.min() > 10**DECADES:
            axes.set_yscale("log")
        axes.set_title(heads[name].replace("_", " "), fontsize=9)
        axes.set_xlabel(abscissa or "step", fontsize=8)
        axes.tick_params(labelsize=7)
        axes.grid(color="#dddddd", linewidth=0.6)
    for axes in grid[len(drawn) :]:
        axes.set_axis_off()
    data = BytesIO()
    figure.savefig(data, dpi=110, format="png")
    return [image(data.getvalue(), "monitor")]


def read_monitor(path: Path) -> dict[str, np.ndarray]:
    """Columns of a monitor by their heads; an empty cell, and a row cut short, is nan."""
    if not path.is_file():
        return {}
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    if not rows:
        return {}
    head, *body = rows
    whole = (row + [""] * (len(head) - len(row)) for row in body)
    table = np.array([[_number(cell) for cell in row] for row in whole]).reshape(-1, len(head))
    return {name: table[:, i] for i, name in enumerate(head)}


def _number(text: str) -> float:
    """A number, or nan where a cell is empty or half of one."""
    try:
        return float(text)
    except ValueError:
        return math.nan

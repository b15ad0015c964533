# SPDX-License-Identifier: LGPL-3.0-or-later
"""The answer on one screen: quantities beside their references, balances, and what it cost."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich.console import Console, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from fem_tfm.output.result import Quantity, Reference, Result

# lines of each list; what is left out is in result.json
LISTED = 4
# head of the column of errors, and what it means
MESH_ERROR = "± mesh"
MESH_NOTE = "± mesh: estimated error of the mesh alone; inputs carry none"
INPUT_NOTE = (
    "± mesh: estimated error of the mesh alone; unprinted inputs: where the ranges below put the"
    " quantity, to first order and as if independent"
)
STEP_NOTE = "± mesh: change since a march with cells and steps twice as large; inputs carry none"
SAMPLE_NOTE = "± of particles: twice the standard error of the parcels"
TIME_NOTE = "±: twice the standard error of means over time and slugs; inputs carry none"
COLOURS = {"converged": "green", "finished": "green", "failed": "red", "interrupted": "yellow"}


def print_summary(result: Result, console: Console | None = None) -> None:
    """Print a result; in colour on a terminal, plain elsewhere, at most 80 columns wide."""
    console = console or Console(highlight=False)
    width = min(console.width, 80)
    console.print(Text(result.title or "untitled", style="bold"), width=width)
    console.print(_headline(result), width=width)
    if result.reason:
        console.print(Text(result.reason, style="red"), width=width)
    if result.quantities:
        console.print(_quantities(result), width=width)
    for note in error_notes(result):
        console.print(Text(note, style="dim"), width=width)
    if result.balances:
        console.print(_balances(result), width=width)
    for warning in result.warnings:
        console.print(Text(f"warning   {warning}", style="yellow"), width=width)
    for note in result.notes:
        console.print(Text(f"note      {note}"), width=width)
    lists = (
        ("inputs", [str(one) for one in result.inputs]),
        ("plausible", result.estimates),
        ("skipped", result.skipped),
        ("inferred", result.inferred),
    )
    for head, lines in lists:
        if lines:
            console.print(_listing(head, lines), width=width)
    console.print(_cost(result), width=width)
    if result.directory:
        # a path is left whole, so that it can be copied
        console.print(Text(f"files     {result.directory}"), soft_wrap=True)


def error_notes(result: Result) -> list[str]:
    """What the errors of the quantities of a result mean, where they have any."""
    quantities = result.quantities
    known = {name for name, quantity in quantities.items() if quantity.error_estimate is not None}
    if result.flow == "slug":
        return [TIME_NOTE] * bool(known)
    sampled = {name for name in known if name.startswith("particle_exit")}
    note = STEP_NOTE if result.solution == "developing" else MESH_NOTE
    note = INPUT_NOTE if result.inputs else note
    notes = [note] * bool(known - sampled) + [SAMPLE_NOTE] * bool(sampled)
    return notes + [f"no error estimate: {result.unestimated}"] * bool(result.unestimated)


def number(value: float | None, digits: int = 4) -> str:
    """A number with so many significant digits, without exponent from 1e-4 to 1e6."""
    if value is None or not math.isfinite(value):
        return "-"
    if value == 0 or not 1e-4 <= abs(value) < 1e6:
        return f"{value:.{digits - 1}e}" if value else "0"
    decimals = digits - 1 - math.floor(math.log10(abs(value)))
    return f"{round(value, decimals):.{max(decimals, 0)}f}"


def difference(value: float, reference: float) -> str:
    """Relative difference from a reference, "-1.9 %", or a dash where there is none."""
    if not (math.isfinite(value) and math.isfinite(reference)) or reference == 0:
        return "-"
    # adding zero turns -0.0 into 0.0
    return f"{round(100 * (value / reference - 1), 1) + 0.0:+.1f} %"


def _headline(result: Result) -> Text:
    ranks = "1 rank" if result.ranks == 1 else f"{result.ranks} ranks"
    return Text.assemble(
        (result.status, COLOURS[result.status]),
        f": {result.flow} flow, {result.solution} solution; "
        f"{_grouped(result.cells)} cells, {_grouped(result.dofs)} unknowns, {ranks}",
    )


def _grouped(count: int) -> str:
    return f"{count:,}".replace(",", " ")


def _quantities(result: Result) -> Table:
    """Quantities, each with its references on the lines below it."""
    table = Table(box=None, pad_edge=False, header_style="underline")
    table.add_column("quantity", overflow="fold")
    for head in ("value", MESH_ERROR):
        table.add_column(head, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    table.add_column("difference", justify="right", no_wrap=True)
    for name, quantity in result.quantities.items():
        error = number(quantity.error_estimate, 2)
        table.add_row(Text(name, style="bold"), number(quantity.value), error, quantity.unit)
        if (span := result.input_range(name)) is not None:
            words = Padding.indent(Text("unprinted inputs"), 2)
            table.add_row(words, " to ".join(number(end, 3) for end in span), "", quantity.unit)
        for reference in quantity.references:
            table.add_row(*_comparison(quantity, reference), style="dim")
    return table


def _comparison(quantity: Quantity, reference: Reference) -> tuple[RenderableType, ...]:
    source = Padding.indent(Text(reference.source or "reference"), 2)
    off = difference(quantity.value, reference.value)
    return source, number(reference.value), "", quantity.unit, off


def _balances(result: Result) -> Text:
    parts = (f"{name.replace('_', ' ')} {v:.1e}" for name, v in result.balances.items())
    return Text("balances  " + ", ".join(parts))


def _listing(head: str, lines: Sequence[str]) -> Table:
    """Short list behind its head; the rest is counted."""
    table = Table(box=None, show_header=False, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column(width=9, no_wrap=True)
    table.add_column()
    shown = list(lines[:LISTED])
    if len(lines) > LISTED:
        shown[-1:] = [f"and {len(lines) - LISTED + 1} more, in result.json"]
    for i, line in enumerate(shown):
        table.add_row(head if i == 0 else "", Text(line))
    return table


def _cost(result: Result) -> Table:
    stages = ", ".join(f"{name} {seconds:.1f} s" for name, seconds in result.seconds.items())
    totals = []
    if math.isfinite(result.cpu_seconds):
        totals.append(f"CPU {result.cpu_seconds:.1f} s")
    if math.isfinite(result.peak_memory_mb):
        totals.append(f"memory {result.peak_memory_mb:.0f} MB")
    return _listing("time", ["; ".join([stages or "-", *totals])])

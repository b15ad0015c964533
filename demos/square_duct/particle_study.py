# SPDX-License-Identifier: LGPL-3.0-or-later
"""Quartz, ash and flour in a square duct, one-way and coupled both ways, beside what is published.

    python demos/square_duct/particle_study.py [DIRECTORY]

It solves particles.toml, and two_way.toml with each material, writes each run with its files and
pictures (the counterparts of figures 6 to 8 of Milanovic et al. 2018), and puts table.csv and
findings.txt beside them.
"""

from __future__ import annotations

import csv
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from fem_tfm import Case, Result, Tracked
from fem_tfm.output.particles.pictures import groups

HERE = Path(__file__).parent
COLUMNS = (
    "material", "drop one-way [Pa]", "drop [Pa]", "friction [Pa]", "particles [Pa]", "flux [Pa]",
    "unclosed", "exit one-way [m/s]", "exit [m/s]", "error [m/s]", "CPU [s]",
)  # fmt: skip


def coupled(material: dict[str, Any], out: Path) -> Result:
    """One material that the gas feels."""
    title = f"Milanovic 2018: {material['name']} in a square duct of 200 mm, coupled both ways"
    case = Case.load(HERE / "two_way.toml")
    case = case.with_values({"particles.materials": [material], "title": title})
    return case.scene.run(out, overwrite=True, quiet=False)


def row(name: str, one_way: Result, both: Result, spent: float) -> list[Any]:
    """One line of the table; CPU time of the coupled run [s]."""
    parts = [both[f"{part}_drop"] for part in ("friction", "particle", "flux")]
    unclosed = abs(sum(parts) / both["pressure_drop"] - 1)
    key = f"particle_exit_velocity_{name}"
    numbers = [one_way["pressure_drop"], both["pressure_drop"], *parts]
    exits = [one_way[key], both[key], both.quantities[key].error_estimate]
    told = [f"{value:.5g}" for value in (*numbers, unclosed, *exits)]
    return [name, *told, f"{spent:.3g}"]


def by_group(tracked: Tracked, name: str, size: tuple[float, float]) -> dict[int, np.ndarray]:
    """Mean velocity along the line of particles that entered in the core, at walls and corners."""
    assert tracked.first is not None
    chosen = tracked.of(name)
    entries = np.unique(tracked.entry[chosen])
    at = [tracked.first.x[chosen & (tracked.entry == one), :2].mean(axis=0) for one in entries]
    group, means = groups(np.array(at), size), np.array(tracked.by_entry[name])
    return {number: means[:, entries[group == number]].mean(axis=1) for number in range(3)}


def findings(tracked: Tracked, name: str, size: tuple[float, float]) -> list[tuple[str, bool]]:
    """What the paper says of a material, and whether it is found."""
    z, velocity = tracked.z, tracked.column(name, "velocity")
    core, wall, corner = by_group(tracked, name, size).values()
    first = (z > 0.2) & (z <= 2.0)
    early = velocity[z <= 1.0]
    assert tracked.last is not None
    at = np.abs(tracked.last.x[tracked.of(name), :2])
    filled = bool((np.histogramdd(at, (4, 4), [(0, s / 2) for s in size])[0] > 0).all())
    return [
        ("it accelerates from 2.8 m/s", bool((np.diff(early) > 0).all() and early[0] < 3)),
        ("in the first 2 m the core is faster than the walls", bool((core > wall)[first].all())),
        ("and the walls are faster than the corners", bool((wall > corner)[first].all())),
        ("nothing is deposited", tracked.counts(name)["out"] == int(tracked.of(name).sum())),
        ("particles fill the section up to the outlet", filled),
    ]


def distance(tracked: Tracked, name: str) -> float:
    """Where particles have reached nine tenths of their largest mean velocity [m]."""
    velocity = tracked.column(name, "velocity")
    return float(tracked.z[np.argmax(velocity >= 0.9 * velocity.max())])


def main(directory: str = "results/particle_study") -> None:
    out = Path(directory)
    case = Case.load(HERE / "particles.toml")
    size = case.scene.geometry.size
    alone = case.scene.run(out / "one_way", overwrite=True, quiet=False)
    table, told, reached = [], [], {}
    for material in case.given["particles"]["materials"]:
        name = material["name"]
        since = time.process_time()
        both = coupled(material, out / name)
        table.append(row(name, alone, both, time.process_time() - since))
        for kind, answer in (("one-way", alone), ("both ways", both)):
            assert answer.tracked is not None
            for sentence, found in findings(answer.tracked, name, size):
                told.append(f"{'yes' if found else 'NO ':3}  {name}, {kind}: {sentence}")
        assert both.tracked is not None
        reached[name] = distance(both.tracked, name)
    sooner = max(reached["ash"], reached["flour"]) < reached["quartz"]
    where = ", ".join(f"{name} {z:.2g} m" for name, z in reached.items())
    told.append(f"{'yes' if sooner else 'NO ':3}  ash and flour are fast sooner: {where}")
    with (out / "table.csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([COLUMNS, *table])
    (out / "findings.txt").write_text("\n".join(told) + "\n", encoding="utf-8")
    print("\n".join(["  ".join(map(str, line)) for line in (COLUMNS, *table)] + told))


if __name__ == "__main__":
    main(*sys.argv[1:])

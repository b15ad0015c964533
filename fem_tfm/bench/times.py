# SPDX-License-Identifier: LGPL-3.0-or-later
"""The time that `fem-tfm check` tells against what ordinary cases take, one of each kind and more.

Each case is run as a user runs it, with its files, in this process. Forms that are new on this
machine are compiled on the way, which counts here and not in what is told: run it twice.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fem_tfm.bench.demo import demo
from fem_tfm.bench.error import tell
from fem_tfm.case import Case
from fem_tfm.errors import SolverError
from fem_tfm.output.result import cpu_seconds

# the factor within which the time is to be told
FACTOR = 3.0
# demos with what makes them short, and with other laws and meshes
DEMOS: dict[str, tuple[str, dict[str, Any]]] = {
    "dense section, four equations": ("dense_pipe/case3.toml", {}),
    "dense section, mixing length": ("dense_pipe/algebraic.toml", {}),
    "the same on level 5": ("dense_pipe/algebraic.toml", {"numerics.level": 5}),
    "dense section, k-epsilon": (
        "dense_pipe/algebraic.toml",
        {"closures.turbulence": "k-epsilon", "numerics.level": 2},
    ),
    "dense march, four equations": ("dense_pipe/developing.toml", {"geometry.length": 0.4}),
    "dense march, mixing length": (
        "dense_pipe/algebraic.toml",
        {
            "solution": "developing",
            "operation.solids_velocity": 6.09,
            "numerics.level": 2,
            "geometry.length": 0.6,
        },
    ),
    "duct section with heat": ("square_duct/gas.toml", {"numerics.level": 3}),
    "the same on level 4": ("square_duct/gas.toml", {}),
    "duct section, k-epsilon": (
        "square_duct/gas.toml",
        {"closures.reynolds_stress": "k-epsilon", "heat": None},
    ),
    "duct march with heat": ("square_duct/developing.toml", {"geometry.length": 6.0}),
    "particles, one-way": ("square_duct/particles.toml", {"numerics.level": 3}),
    "particles, two-way": (
        "square_duct/two_way.toml",
        {"geometry.length": 2.0, "particles.parcels": 500},
    ),
    "particles with weight and wear": ("dilute/pipe.toml", {}),
    "particles in a bend": ("dilute/bend.toml", {"numerics.end_time": 0.05}),
    "pipe filled from rest": ("dense_pipe/startup.toml", {"numerics.end_time": 0.02}),
    "bed swept from rest": ("dense_pipe/swept_bed.toml", {"numerics.end_time": 0.05}),
    "dune": ("dense_pipe/dune.toml", {"numerics.end_time": 0.1}),
    "bend": ("dense_pipe/bend90.toml", {"numerics.end_time": 0.03}),
    "slugs": (
        "slug_tube/slug_tube.toml",
        {"numerics.end_time": 2.0, "averages.begin": 1.0},
    ),
    "slugs in a bend": ("slug_tube/bend.toml", {"numerics.end_time": 1.0, "averages.begin": 0.5}),
}
AIR, GLASS = {"species": "air", "pressure": 1e5}, {"density": 2500.0, "diameter": 2e-4}
COARSE = {"level": 2}


def pipe(
    diameter: float, length: float, speed: float, flow: float, solids: Mapping[str, float]
) -> dict[str, Any]:
    """A line in air with default laws; m, m, m/s, kg/s."""
    return {
        "geometry": {"diameter": diameter, "length": length},
        "gas": AIR,
        "solids": dict(solids),
        "operation": {"gas_superficial_velocity": speed, "solids_mass_flow": flow},
        "numerics": COARSE,
    }


def lines() -> dict[str, dict[str, Any]]:
    """Conveying lines with default laws."""
    riser = pipe(0.05, 10.0, 12.0, 0.1, GLASS)
    riser["geometry"]["inclination_deg"] = 90.0
    column = {
        "geometry": {"diameter": 0.05, "length": 1.0, "inclination_deg": 90.0},
        "gas": {"density": 50.0, "viscosity": 1.8e-5},
        "operation": {"gas_superficial_velocity": 2.0},
        "numerics": {"level": 1},
    }
    powder = {"density": 1400.0, "diameter": 4e-5}
    return {
        "polyethylene, level": pipe(0.1, 50.0, 23.0, 1.0, {"density": 920.0, "diameter": 3e-3}),
        "coal, level": pipe(0.05, 50.0, 20.0, 0.28, {"density": 1400.0, "diameter": 1e-3}),
        "flour, level": pipe(0.08, 50.0, 18.0, 0.75, {"density": 1470.0, "diameter": 7e-5}),
        "pulverised coal, a bed": pipe(
            0.05, 20.0, 10.0, 0.5, {"density": 1400.0, "diameter": 1e-4}
        ),
        "fine powder": pipe(0.05, 10.0, 12.0, 0.05, powder),
        "glass, riser": riser,
        "glass, riser, march": riser | {"solution": "developing"},
        "gas alone, march": column | {"solution": "developing"},
        "gas alone, unsteady": column
        | {"solution": "unsteady", "numerics": {"level": 1, "axial_cells": 20, "end_time": 1.0}},
        "line of the README": pipe(0.05, 30.0, 12.0, 1.0, {"density": 1400.0, "diameter": 2e-4}),
    }


def cases() -> dict[str, Case]:
    """All cases by name.

    Raises
    ------
    InputError
        there is no checkout of the repository with its demos.
    """
    found = {name: demo(*parts) for name, parts in DEMOS.items()}
    return found | {name: Case.from_dict(tables) for name, tables in lines().items()}


@dataclass(frozen=True)
class Timed:
    """What was told of a case and what it took, CPU seconds."""

    name: str
    told: float
    taken: float
    status: str

    @property
    def ratio(self) -> float:
        """Time taken over the time told [-]."""
        return self.taken / self.told

    @property
    def close(self) -> bool:
        """Whether the time was told within the factor."""
        return 1 / FACTOR <= self.ratio <= FACTOR

    def __str__(self) -> str:
        mark = "" if self.close else "  outside"
        return (
            f"{self.name:<32} {self.told:7.1f} {self.taken:7.1f} {self.ratio:6.2f}"
            f"  {self.status}{mark}"
        )


def measure(name: str, case: Case) -> Timed:
    """Run one case in a directory that is thrown away."""
    told, status, began = case.scene.expected_time(), "answer", cpu_seconds()
    with tempfile.TemporaryDirectory() as folder:
        try:
            case.scene.run(Path(folder) / "run")
        except SolverError as error:
            status = f"no answer ({error})"
    return Timed(name, told, cpu_seconds() - began, status)


def table(chosen: Mapping[str, Case]) -> Iterator[Timed]:
    """Measure cases one after another and print a line for each."""
    tell(f"{'case':<32} {'told':>7} {'taken':>7} {'ratio':>6}")
    for name, case in chosen.items():
        found = measure(name, case)
        tell(str(found))
        yield found


def summary(found: Sequence[Timed]) -> str:
    """How many of the times were told within the factor."""
    close = sum(one.close for one in found)
    total = sum(one.taken for one in found)
    return (
        f"{close} of {len(found)} within a factor of {FACTOR:g}; ratios from"
        f" {min(one.ratio for one in found):.2f} to {max(one.ratio for one in found):.2f};"
        f" {total:.0f} CPU s in all"
    )


def run() -> str:
    """Measure every case."""
    return summary(list(table(cases())))

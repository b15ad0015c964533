# SPDX-License-Identifier: LGPL-3.0-or-later
"""What became of the particles of a run: velocities along the line, trajectories, where they end.

Files of a run, written on rank 0:

    particles.csv      means at each place along the line, by material
    entries.csv        mean axial velocity at each place, by material and entry
    trajectories.vtu   some trajectories as lines (ParaView, VTK, meshio)
    cloud.vtu          every parcel where it left the line or stayed
    deposits.csv       parcels that stay on the wall
    particle_fields.vtu  concentration and velocity of each material in every cell, if asked for
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import meshio
import numpy as np
from numpy.typing import NDArray

from fem_tfm.output.files import replaced
from fem_tfm.output.particles.lattice import Lattice
from fem_tfm.output.particles.wear import WearMap
from fem_tfm.output.profiles import write_profiles

FILES = (
    "particles.csv", "entries.csv", "trajectories.vtu", "cloud.vtu", "deposits.csv", "wear.csv",
    "particles.png", "deposition.png", "wear.png", "particle_fields.vtu",
)  # fmt: skip
# what may become of a parcel, in the order of its status
FATES = ("inside", "out", "deposited", "lost", "stuck")
# collisions that change by more between two passes are told
UNSETTLED = 0.05
UNITS = {
    "z": "m",
    "time": "s",
    "velocity": "m/s",
    "velocity_sd": "m/s",
    "slowest": "m/s",
    "fastest": "m/s",
    "across": "m/s",
    "alpha_p": "-",
    "share": "-",
}


@dataclass
class Moment:
    """All parcels at one place along the line.

    z : the place [m]
    time : since each of them entered, shape (n,) [s]
    x, v : places (n, 3) [m] and velocities (n, 3) [m/s]
    inside : which parcels are there, shape (n,)
    along : speed along the axis, shape (n,) [m/s]; default that along z
    across : coordinates across the axis, shape (n, 2) [m]; default x and y
    """

    z: float
    time: NDArray[np.float64]
    x: NDArray[np.float64]
    v: NDArray[np.float64]
    inside: NDArray[np.bool_]
    along: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    across: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        if not self.along.size:
            self.along = self.v[:, 2]
        if not self.across.size:
            self.across = self.x[:, :2]


@dataclass
class Tracked:
    """Particles that were followed; whole on rank 0.

    Parameters
    ----------
    materials : names
    area : of the section [m2]
    material, entry : of each parcel, shape (n,)
    diameter, mass, rate : of each parcel, shape (n,) [m, kg, 1/s]
    traced : numbers of the parcels whose trajectories are kept

    Attributes
    ----------
    rows : means at each place, by material
    by_entry : mean axial velocity at each place, by material, shape (entries,) [m/s]
    lines : time, place and velocity of the traced parcels at each place, shape (traced, 7)
    first, last : all parcels at the entrance and at the last place
    status : what became of each parcel, an index of `FATES`
    wear : impacts on the walls, None without a law of wear
    met : collisions a second and number of particles by material, shape (materials, 2), in the
        stretch before each place but the first, or of the whole line; empty without a law of
        collisions
    lattice : concentration and velocity in every cell, None unless asked for
    unsettled : largest relative change of the collisions between the last two passes of a stretch
    """

    materials: Sequence[str]
    area: float
    material: NDArray[np.int32]
    entry: NDArray[np.int32]
    diameter: NDArray[np.float64]
    mass: NDArray[np.float64]
    rate: NDArray[np.float64]
    traced: NDArray[np.int64]
    rows: dict[str, list[dict[str, float]]] = field(init=False)
    by_entry: dict[str, list[NDArray[np.float64]]] = field(init=False)
    lines: list[NDArray[np.float64]] = field(default_factory=list)
    first: Moment | None = None
    last: Moment | None = None
    wear: WearMap | None = None
    status: NDArray[np.int8] = field(init=False)
    met: list[NDArray[np.float64]] = field(default_factory=list)
    unsettled: float = 0.0
    lattice: Lattice | None = None

    def __post_init__(self) -> None:
        self.rows = {name: [] for name in self.materials}
        self.by_entry = {name: [] for name in self.materials}
        self.status = np.zeros(len(self.material), dtype=np.int8)

    def of(self, name: str) -> NDArray[np.bool_]:
        """Which parcels are of a material; raises KeyError for a name that there is not."""
        if name not in self.materials:
            raise KeyError(f"no material {name!r}; there are {', '.join(self.materials)}")
        return np.asarray(self.material == self.materials.index(name))

    def take(self, moment: Moment, status: NDArray[np.int8]) -> None:
        """Keep what is told of one place."""
        if self.first is None:
            self.first = moment
        self.last, self.status = moment, status.copy()
        for name in self.materials:
            self.rows[name].append(self._row(moment, self.of(name)))
            self.by_entry[name].append(self._entries(moment, self.of(name)))
        kept = self.traced
        line = np.column_stack([moment.time[kept], moment.x[kept], moment.v[kept]])
        line[~moment.inside[kept]] = math.nan
        self.lines.append(line)

    def meet(
        self, collisions: NDArray[np.float64], number: NDArray[np.float64], change: float
    ) -> None:
        """Keep the collisions of the stretch before a place, by material."""
        self.met.append(np.column_stack([collisions, number]))
        self.unsettled = max(self.unsettled, change)

    def _row(self, moment: Moment, chosen: NDArray[np.bool_]) -> dict[str, float]:
        """Means over the parcels of a material, each counted by its mass flow."""
        entered = float((self.mass * self.rate)[chosen].sum())
        here = chosen & moment.inside
        flow, w = (self.mass * self.rate)[here], moment.along[here]
        if not len(w):
            return {"z": moment.z, "share": 0.0} | dict.fromkeys(list(UNITS)[1:-1], math.nan)
        mean = float(np.average(w, weights=flow))
        volume = (self.rate * math.pi / 6 * self.diameter**3)[here]
        return {
            "z": moment.z,
            "time": float(np.average(moment.time[here], weights=flow)),
            "velocity": mean,
            "velocity_sd": float(np.sqrt(np.average((w - mean) ** 2, weights=flow))),
            "slowest": float(w.min()),
            "fastest": float(w.max()),
            "across": float(np.average(self._across(moment, here), weights=flow)),
            # what passes stays for 1/w on every metre
            "alpha_p": float((volume / np.maximum(w, 1e-9)).sum()) / self.area,
            "share": float(flow.sum()) / entered,
        }

    @staticmethod
    def _across(moment: Moment, here: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Speed across the axis [m/s]."""
        square = (moment.v[here] ** 2).sum(axis=1) - moment.along[here] ** 2
        return np.asarray(np.sqrt(np.maximum(square, 0.0)))

    def _entries(self, moment: Moment, chosen: NDArray[np.bool_]) -> NDArray[np.float64]:
        here = chosen & moment.inside
        flow, count = (self.mass * self.rate)[here], int(self.entry.max(initial=0)) + 1
        total = np.bincount(self.entry[here], flow, count)
        moved = np.bincount(self.entry[here], flow * moment.along[here], count)
        with np.errstate(invalid="ignore"):
            return np.asarray(moved / total)

    # -- its state -----------------------------------------------------------------------------

    def state(self) -> dict[str, NDArray[Any]]:
        """Arrays of what was told so far, from which `restore` goes on."""
        found: dict[str, NDArray[Any]] = {
            "status": self.status,
            "lines": np.array(self.lines),
            "met": np.array(self.met),
            "unsettled": np.array(self.unsettled),
        }
        for name in self.materials:
            table = [[row[what] for what in UNITS] for row in self.rows[name]]
            found |= {
                f"rows.{name}": np.array(table),
                f"entries.{name}": np.array(self.by_entry[name]),
            }
        for key in ("first", "last"):
            if (moment := getattr(self, key)) is not None:
                parts = {f.name: np.asarray(getattr(moment, f.name)) for f in fields(Moment)}
                found |= {f"{key}.{name}": value for name, value in parts.items()}
        if self.lattice is not None:
            found |= {f"lattice.{name}": value for name, value in self.lattice.state().items()}
        if self.wear is not None:
            found |= {f"wear.{name}": value for name, value in self.wear.state().items()}
        return found

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Put back what `state` gave."""
        self.status, self.lines = arrays["status"].astype(np.int8), list(arrays["lines"])
        self.met, self.unsettled = list(arrays["met"]), float(arrays["unsettled"])
        for name in self.materials:
            rows = arrays[f"rows.{name}"]
            self.rows[name] = [dict(zip(UNITS, map(float, row), strict=True)) for row in rows]
            self.by_entry[name] = list(arrays[f"entries.{name}"])
        for key in ("first", "last"):
            parts = {f.name: arrays[f"{key}.{f.name}"] for f in fields(Moment)}
            place = float(parts.pop("z"))
            setattr(self, key, Moment(place, **parts))
        if self.lattice is not None:
            self.lattice.restore({name: arrays[f"lattice.{name}"] for name in ("edges", "fields")})
        if self.wear is not None:
            self.wear.restore({name: arrays[f"wear.{name}"] for name in ("edges", "sums")})

    # -- what it tells -------------------------------------------------------------------------

    @property
    def z(self) -> NDArray[np.float64]:
        """Places along the line [m]."""
        return np.array([row["z"] for row in self.rows[self.materials[0]]])

    def column(self, name: str, what: str) -> NDArray[np.float64]:
        """One column of the table of a material, a value a place."""
        return np.array([row[what] for row in self.rows[name]])

    def counts(self, name: str | None = None) -> dict[str, int]:
        """How many parcels had each fate; their sum is what entered."""
        status = self.status if name is None else self.status[self.of(name)]
        return {fate: int((status == n).sum()) for n, fate in enumerate(FATES)}

    def warnings(self) -> list[str]:
        """What a reader should doubt, one sentence each.

        Materials of which parcels neither arrive nor stay on the wall, and collisions that did not
        settle.
        """
        said = []
        if self.unsettled > UNSETTLED:
            said.append(
                f"the collisions of a stretch still changed by {100 * self.unsettled:.2g} % between"
                " its last two passes; more particles.parcels or particles.stations calm them"
            )
        for name in self.materials:
            counts = self.counts(name)
            gone = {f: counts[f] for f in ("lost", "stuck") if counts[f]}
            if counts["inside"]:
                said.append(
                    f"of {sum(counts.values())} parcels of {name} {counts['inside']} are still on"
                    " their way at the end: deposition counts what has stayed so far, and a longer"
                    " run tells more"
                )
            if gone:
                told = ", ".join(f"{number} {fate}" for fate, number in gone.items())
                said.append(
                    f"of {sum(counts.values())} parcels of {name} {counts['out']} arrive at the"
                    f" outlet; the others: {told} (stuck: no way made, lost: left the line)"
                )
        return said

    def balances(self) -> dict[str, float]:
        """Share of the mass flow that has entered and has no fate [-]."""
        flow = self.mass * self.rate
        found = sum(float(flow[self.status == n].sum()) for n in range(len(FATES)))
        return {"particle_mass": abs(found / float(flow.sum()) - 1)}

    def exit_velocity(self, name: str) -> tuple[float, float]:
        """Mean axial velocity at the last place, and its standard error [m/s].

        Parcels count by their mass flow; the error is that of independent parcels, sd/sqrt(n) with
        n = (sum of flows)^2/sum of squares. nan where nothing arrives.
        """
        assert self.last is not None
        here = self.of(name) & self.last.inside
        row, flow = self.rows[name][-1], (self.mass * self.rate)[here]
        if not len(flow):
            return math.nan, math.nan
        return row["velocity"], row["velocity_sd"] / math.sqrt(_independent(flow))

    def collision_frequency(self, name: str) -> float:
        """Collisions of a particle a second, mean over the line [1/s]; raises KeyError as `of`."""
        self.of(name)
        sums = np.array(self.met)[:, list(self.materials).index(name)].sum(axis=0)
        return float(sums[0] / sums[1]) if sums[1] > 0 else math.nan

    def residence_time(self, name: str) -> tuple[float, float]:
        """Mean time from the entrance to the last place, and its standard error [s]."""
        assert self.last is not None
        here = self.of(name) & self.last.inside
        mean, flow = self.rows[name][-1]["time"], (self.mass * self.rate)[here]
        if not len(flow):
            return math.nan, math.nan
        spread = float(np.average((self.last.time[here] - mean) ** 2, weights=flow))
        return mean, math.sqrt(spread / _independent(flow))

    def deposited(self, name: str) -> tuple[float, float]:
        """Share of the mass flow that stays on the wall, and its standard error [-].

        The error is that of n independent parcels, sqrt((p + 1/n) (1 - p + 1/n)/n), which does not
        vanish where none of them or all of them stay.
        """
        chosen, flow = self.of(name), self.mass * self.rate
        stays = chosen & (self.status == FATES.index("deposited"))
        share, few = float(flow[stays].sum() / flow[chosen].sum()), 1 / _independent(flow[chosen])
        return share, math.sqrt((share + few) * (1 - share + few) * few)

    def quantities(self) -> dict[str, float]:
        """Numbers of each material, named for it."""
        found = {}
        for name in self.materials:
            found[f"particle_exit_velocity_{name}"] = self.exit_velocity(name)[0]
            found[f"particle_residence_time_{name}"] = self.residence_time(name)[0]
            found[f"particle_deposition_{name}"] = self.deposited(name)[0]
            if self.met:
                found[f"particle_collision_frequency_{name}"] = self.collision_frequency(name)
        if self.wear is not None:
            found["wear"] = self.wear.total
            found["wear_largest"], found["wear_position"] = self.wear.worst
        return found

    def errors(self) -> dict[str, float]:
        """Twice the standard error of each number of the sample, where it is known."""
        found = {}
        for name in self.materials:
            found[f"particle_exit_velocity_{name}"] = 2 * self.exit_velocity(name)[1]
            found[f"particle_residence_time_{name}"] = 2 * self.residence_time(name)[1]
            found[f"particle_deposition_{name}"] = 2 * self.deposited(name)[1]
        return found


def _independent(flow: NDArray[np.float64]) -> float:
    """Number of equal parcels that tell as much, (sum of flows)^2/sum of squares."""
    return float(flow.sum() ** 2 / (flow**2).sum())


# -- files -----------------------------------------------------------------------------------------


def write_tables(out: Path, tracked: Tracked) -> None:
    """particles.csv, entries.csv and, where something stays on the wall, deposits.csv."""
    columns: dict[str, NDArray[np.float64]] = {"z": tracked.z}
    units = {"z": "m"}
    for name in tracked.materials:
        for what in list(UNITS)[1:]:
            columns[f"{name} {what}"] = tracked.column(name, what)
            units[f"{name} {what}"] = UNITS[what]
        if len(tracked.met) == len(tracked.z) - 1:
            sums = np.array(tracked.met)[:, list(tracked.materials).index(name)]
            with np.errstate(invalid="ignore", divide="ignore"):
                rate = np.append(math.nan, sums[:, 0] / sums[:, 1])
            columns[f"{name} collisions"], units[f"{name} collisions"] = rate, "1/s"
    write_profiles(out / "particles.csv", columns, units)
    entries = {"z": tracked.z} | {
        f"{name} {number}": np.array([row[number] for row in tracked.by_entry[name]])
        for name in tracked.materials
        for number in range(len(tracked.by_entry[name][0]))
    }
    write_profiles(out / "entries.csv", entries, {n: "m" if n == "z" else "m/s" for n in entries})
    stays = tracked.status == FATES.index("deposited")
    if stays.any() and tracked.last is not None:
        x, units = tracked.last.x[stays], dict(zip("xyz", "mmm", strict=True))
        table = dict(zip("xyz", x.T, strict=True))
        table["material"] = tracked.material[stays].astype(float)
        table["mass_flow"] = (tracked.mass * tracked.rate)[stays]
        write_profiles(out / "deposits.csv", table, {**units, "material": "-", "mass_flow": "kg/s"})


def trajectories(tracked: Tracked) -> Iterator[tuple[int, NDArray[np.float64]]]:
    """Number of each traced parcel and its time, place and velocity, shape (places, 7)."""
    lines = np.array(tracked.lines)
    for n, number in enumerate(tracked.traced):
        line = lines[:, n]
        yield int(number), line[np.isfinite(line[:, 0])]


def write_trajectories(out: Path, tracked: Tracked) -> None:
    """trajectories.vtu: lines with time, velocity, material, entry and diameter."""
    points, links = list[NDArray[np.float64]](), list[NDArray[np.int64]]()
    data, first = list[tuple[int, NDArray[np.float64]]](), 0
    for number, line in trajectories(tracked):
        if len(line) < 2:
            continue
        links.append(np.column_stack([np.arange(len(line) - 1), np.arange(1, len(line))]) + first)
        first += len(line)
        points.append(line[:, 1:4])
        data.append((number, line))
    if not data:
        return
    numbers = np.concatenate([np.full(len(line), number) for number, line in data])
    fields = _labels(tracked, numbers) | {
        "time": np.concatenate([line[:, 0] for _, line in data]),
        "velocity": np.concatenate([line[:, 4:] for _, line in data]),
    }
    _write(
        out / "trajectories.vtu", np.concatenate(points), ("line", np.concatenate(links)), fields
    )


def write_cloud(out: Path, tracked: Tracked) -> None:
    """cloud.vtu: every parcel where it was last, with its velocity and what became of it."""
    last = tracked.last
    assert last is not None
    numbers = np.arange(len(tracked.material))
    fields = _labels(tracked, numbers) | {
        "time": last.time,
        "velocity": last.v,
        "status": tracked.status.astype(np.int32),
    }
    _write(out / "cloud.vtu", last.x, ("vertex", numbers[:, None]), fields)


def _labels(tracked: Tracked, numbers: NDArray[np.int64]) -> dict[str, NDArray[Any]]:
    return {
        "id": numbers.astype(np.int64),
        "material": tracked.material[numbers],
        "entry": tracked.entry[numbers],
        "diameter": tracked.diameter[numbers],
        "rate": tracked.rate[numbers],
    }


def _write(
    path: Path,
    points: NDArray[np.float64],
    cells: tuple[str, NDArray[np.int64]],
    fields: Mapping[str, NDArray[Any]],
) -> None:
    mesh = meshio.Mesh(points, [cells], point_data=dict(fields))
    with replaced(path) as temporary:
        meshio.write(temporary, mesh, file_format="vtu")

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Samples of an unsteady flow while it runs: values at points, means over sections, tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI

from fem_tfm.errors import InputError
from fem_tfm.geometry.mesh import Mesh
from fem_tfm.interpolation import Points
from fem_tfm.output.pictures import plane_picture
from fem_tfm.output.profiles import Monitor

UNITS = {
    "alpha_s": "-",
    "u_s": "m/s",
    "u_g": "m/s",
    "pressure": "Pa",
    "theta": "m2/s2",
    "k": "m2/s2",
    "eps": "m2/s3",
}
# grid of the picture, moments kept for it and drawn
ROWS, COLUMNS, MOMENTS, SHOWN = 40, 240, 40, 6
# a place this close to a face between layers, over a layer, lies behind it
ROUNDING = 1e-9
MEANS = {
    "holdup": "-",
    "max_solids_fraction": "-",
    "pressure": "Pa",
    "solids_superficial_velocity": "m/s",
    "gas_superficial_velocity": "m/s",
}


class Probes:
    """Values of fields at points: a table with a row a time and columns "field_1", "u_s_x_1".

    Parameters
    ----------
    mesh : where the fields live
    points : (n, 3) [m]

    Raises
    ------
    InputError
        a point lies outside the mesh.
    """

    def __init__(self, mesh: Any, points: Sequence[Sequence[float]]) -> None:
        self.points = Points(mesh, np.asarray(points, dtype=float))
        for point, found in zip(points, self.points.found, strict=True):
            if not found:
                raise InputError("output.probes", list(point), "points inside the line")

    def row(self, fields: Mapping[str, fem.Function]) -> dict[str, float]:
        """Values of all fields at all points (collective)."""
        found = {}
        for name, function in fields.items():
            for number, value in enumerate(self.points.values(function), start=1):
                for suffix, component in zip(_suffixes(value), np.atleast_1d(value), strict=True):
                    found[f"{name}{suffix}_{number}"] = float(component)
        return found


def columns(row: Mapping[str, float]) -> dict[str, str]:
    """Units of the columns of a probe's row."""
    units = {}
    for column in row:
        name = next((n for n in UNITS if column.startswith((f"{n}_", n))), "")
        units[column] = UNITS.get(name, "")
    return units


def _suffixes(value: npt.NDArray[Any]) -> tuple[str, ...]:
    return ("",) if np.ndim(value) == 0 else ("_x", "_y", "_z")


class Sections:
    """Means over the layers of cells that hold given places along a line.

    A layer stands for its length, but the pressure is that at the place: it changes within a layer
    by as much as from one to the next.

    Parameters
    ----------
    mesh : made of layers of equal length along the axis
    places : along the axis [m]
    volume : of the owned cells [m3]
    centre : of the owned cells (cells, 3) [m]
    layers : cells along the axis
    """

    def __init__(
        self,
        mesh: Mesh,
        places: Sequence[float],
        volume: npt.NDArray[np.float64],
        centre: npt.NDArray[np.float64],
        layers: int,
    ) -> None:
        assert mesh.length is not None
        self.comm, self.places = mesh.mesh.comm, tuple(places)
        straight = mesh.straightened(centre)
        number = np.floor(straight[:, 2] / mesh.length * layers)
        at = np.array(self.places) / mesh.length * layers
        wanted = np.clip(np.floor(at + ROUNDING), 0, layers - 1)
        self._cells = [np.flatnonzero(number == layer) for layer in wanted]
        # the layer on the other side of the place, and its share
        beside = np.where((at > wanted + 0.5) & (wanted < layers - 1), wanted + 1, wanted - 1)
        beside = np.where(beside < 0, min(1, layers - 1), beside)
        self._beside = [np.flatnonzero(number == layer) for layer in beside]
        apart = np.where(beside == wanted, 1.0, beside - wanted)
        self._share = np.where(beside == wanted, 0.0, (at - wanted - 0.5) / apart)
        self._volume = volume
        self._axis = mesh.axis(centre)

    def rows(self, fields: Mapping[str, fem.Function]) -> list[dict[str, float]]:
        """A row of means for each place (collective)."""
        owned = len(self._volume)
        values = {
            name: f.x.array.reshape(-1, f.function_space.value_size)[:owned]
            for name, f in fields.items()
        }
        alpha = values["alpha_s"][:, 0] if "alpha_s" in values else np.zeros(owned)
        flux = {
            "pressure": values["pressure"][:, 0],
            "holdup": alpha,
            "gas_superficial_velocity": (1 - alpha) * self._along(values["u_g"]),
        }
        if "u_s" in values:
            flux["solids_superficial_velocity"] = alpha * self._along(values["u_s"])
        rows = []
        parts = zip(self.places, self._cells, self._beside, self._share, strict=True)
        for place, cells, beside, share in parts:
            row = {"place": place} | {n: self._mean(v, cells) for n, v in flux.items()}
            other = self._mean(flux["pressure"], beside)
            row["pressure"] += share * (other - row["pressure"])
            most = self.comm.allreduce(alpha[cells].max(initial=0.0), MPI.MAX)
            rows.append(row | {"max_solids_fraction": most})
        return rows

    def _mean(self, values: npt.NDArray[np.float64], cells: npt.NDArray[Any]) -> float:
        """Mean over cells of all ranks (collective)."""
        volume = self._volume[cells]
        whole = self.comm.allreduce(volume.sum())
        return float(self.comm.allreduce(volume @ values[cells]) / whole)

    def _along(self, velocity: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        along: npt.NDArray[np.float64] = np.einsum("ni,ni->n", velocity, self._axis)
        return along


class Plane:
    """Values in the vertical plane through the axis at some times, for a picture.

    Parameters
    ----------
    mesh : of a line
    name : of the field; of a velocity its component along the axis is taken

    Attributes
    ----------
    moments : values (rows, columns) of each time [s], kept at even distances, at most `MOMENTS`
    """

    def __init__(self, mesh: Mesh, name: str) -> None:
        points, self.drawn = mesh.plane(ROWS, COLUMNS)
        flat = points.reshape(-1, 3)
        self.name, self._axis = name, mesh.axis(flat)
        self._points = Points(mesh.mesh, flat)
        self.moments: dict[float, npt.NDArray[np.float64]] = {}

    def take(self, time: float, fields: Mapping[str, fem.Function]) -> None:
        """Keep the values of this time (collective)."""
        values = self._points.values(fields[self.name])
        if values.ndim > 1:
            values = np.einsum("ni,ni->n", values, self._axis)
        if len(self.moments) == MOMENTS:
            self.moments = dict(list(self.moments.items())[::2])
        self.moments[time] = values.reshape(ROWS, COLUMNS)

    def state(self) -> dict[str, npt.NDArray[np.float64]]:
        """Arrays for a checkpoint."""
        values = np.array(list(self.moments.values())).reshape(-1, ROWS, COLUMNS)
        return {"plane.times": np.array(list(self.moments)), "plane.values": values}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take over what `state` gave."""
        values = np.asarray(state["plane.values"]).reshape(-1, ROWS, COLUMNS)
        self.moments = dict(zip(state["plane.times"], values, strict=True))

    def draw(self, path: Path, title: str) -> None:
        """The picture of the plane at a few times, the last among them."""
        times = list(self.moments)
        shown = np.unique(np.linspace(0, len(times) - 1, SHOWN).round().astype(int)[1:])
        moments = {times[i]: self.moments[times[i]] for i in shown}
        plane_picture(path, self.drawn, moments, title, self.name)


class Table:
    """A Monitor on rank 0 that begins with its first row."""

    def __init__(self, path: Path, append: bool) -> None:
        self.path, self.append = path, append
        self._monitor: Monitor | None = None

    def write(self, row: Mapping[str, float], units: Mapping[str, str]) -> None:
        """Add a row; `units` name the columns."""
        if self._monitor is None:
            self._monitor = Monitor(self.path, units, self.append)
        self._monitor.write(row)

    def close(self) -> None:
        """Close the file."""
        if self._monitor is not None:
            self._monitor.close()

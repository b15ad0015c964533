# SPDX-License-Identifier: LGPL-3.0-or-later
"""The state of a cloud: arrays over parcels, each a stream of equal particles."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from fem_tfm.errors import InputError
from fem_tfm.materials import Solids

# what has become of a parcel
INSIDE, OUT, DEPOSITED, LOST, STUCK = range(5)
STATUS = ("inside", "out", "deposited", "lost", "stuck")
# type and further dimension of each array
KINDS: dict[str, tuple[Any, int]] = {
    "id": (np.int64, 0),
    "material": (np.int32, 0),
    "x": (np.float64, 3),
    "v": (np.float64, 3),
    "omega": (np.float64, 3),
    "xi": (np.float32, 3),
    "temperature": (np.float64, 0),
    "time": (np.float64, 0),
    "cell": (np.int32, 0),
    "step": (np.uint32, 0),
    "status": (np.int8, 0),
    "rate": (np.float64, 0),
    "diameter": (np.float64, 0),
    "density": (np.float64, 0),
    "bounces": (np.uint32, 0),
    "memory": (np.float32, 5),
}


@dataclass(eq=False)
class Parcels:
    """Parcels by number. Random numbers follow from id and step alone, whatever the order.

    id : differs between all parcels of all ranks
    material : number in the tracker's list of materials
    x, v, omega : place [m], velocity [m/s] and rotation [1/s], (n, 3)
    xi : normalised fluctuation of the gas that is seen, (n, 3)
    temperature : [K];  time : clock of the parcel [s]
    cell : where it is, -1 for not looked up yet;  step : steps so far
    status : 0 inside, 1 out, 2 deposited, 3 lost, 4 stuck
    rate : particles per second that a parcel stands for (steady flow), or their number
    diameter, density : [m], [kg/m3];  bounces : impacts so far
    memory : (n, 5) of the last step: gas velocity seen, drag rate, next step
    carried : further arrays over the parcels, which go where these go
    """

    id: npt.NDArray[np.int64]
    material: npt.NDArray[np.int32]
    x: npt.NDArray[np.float64]
    v: npt.NDArray[np.float64]
    omega: npt.NDArray[np.float64]
    xi: npt.NDArray[np.float32]
    temperature: npt.NDArray[np.float64]
    time: npt.NDArray[np.float64]
    cell: npt.NDArray[np.int32]
    step: npt.NDArray[np.uint32]
    status: npt.NDArray[np.int8]
    rate: npt.NDArray[np.float64]
    diameter: npt.NDArray[np.float64]
    density: npt.NDArray[np.float64]
    bounces: npt.NDArray[np.uint32]
    memory: npt.NDArray[np.float32]
    carried: dict[str, npt.NDArray[Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, (kind, width) in KINDS.items():
            shape = (len(self.id), width) if width else (len(self.id),)
            array = np.ascontiguousarray(getattr(self, name), dtype=kind)
            if array.shape != shape:
                raise InputError(f"parcels.{name}", array.shape, f"an array of the shape {shape}")
            setattr(self, name, array)

    @classmethod
    def release(
        cls,
        x: npt.ArrayLike,
        v: npt.ArrayLike,
        material: Solids,
        *,
        rate: npt.ArrayLike = 1.0,
        number: int = 0,
        diameter: npt.ArrayLike | None = None,
        temperature: npt.ArrayLike = 293.0,
        time: npt.ArrayLike = 0.0,
        first_id: int = 0,
    ) -> Self:
        """New parcels of a material at places x (n, 3), with velocities v (n, 3) or one for all.

        rate : particles per second each, or one for all
        number : of the material in the tracker's list
        diameter : of each, that of the material if absent; 0 for points that follow the gas
        first_id : ids run from here on

        Raises
        ------
        InputError
            shapes do not fit, or a value is not finite or out of range.
        """
        place = np.array(x, dtype=float).reshape(-1, 3)
        n = len(place)

        def filled(name: str, value: npt.ArrayLike, least: float) -> npt.NDArray[np.float64]:
            given = np.asarray(value, dtype=float)
            if given.shape not in ((), (n,)):
                raise InputError(f"parcels.{name}", given.shape, f"a number, or {n} of them")
            found = np.broadcast_to(given, (n,)).copy()
            if not (np.isfinite(found).all() and (found >= least).all()):
                raise InputError(f"parcels.{name}", found.min(), f"numbers of at least {least:g}")
            return found

        velocity = np.asarray(v, dtype=float)
        if velocity.shape not in ((3,), (n, 3)):
            raise InputError("parcels.v", velocity.shape, f"an array of the shape (3,) or ({n}, 3)")
        if not (np.isfinite(place).all() and np.isfinite(velocity).all()):
            raise InputError("parcels.x", None, "finite places and velocities")
        size = material.diameter if diameter is None else diameter
        zeros = {
            name: np.zeros((n, width) if width else n, kind)
            for name, (kind, width) in KINDS.items()
        }
        given = {
            "id": np.arange(first_id, first_id + n),
            "material": np.full(n, number),
            "x": place,
            "v": np.broadcast_to(velocity, (n, 3)).copy(),
            "temperature": filled("temperature", temperature, 0.0),
            "time": filled("time", time, -np.inf),
            "cell": np.full(n, -1),
            "rate": filled("rate", rate, 0.0),
            "diameter": filled("diameter", size, 0.0),
            "density": np.full(n, material.density, dtype=float),
        }
        return cls(**(zeros | given))

    def __len__(self) -> int:
        return len(self.id)

    @classmethod
    def concatenate(cls, parts: Iterable[Parcels]) -> Self:
        """All parcels of several clouds."""
        clouds = list(parts)
        arrays = {name: np.concatenate([getattr(c, name) for c in clouds]) for name in KINDS}
        more = clouds[0].carried
        carried = {name: np.concatenate([c.carried[name] for c in clouds]) for name in more}
        return cls(**arrays, carried=carried)

    def select(self, chosen: Any) -> Self:
        """A copy of some parcels, by mask or numbers."""
        carried = {name: values[chosen].copy() for name, values in self.carried.items()}
        arrays = {name: getattr(self, name)[chosen].copy() for name in KINDS}
        return type(self)(**arrays, carried=carried)

    def copy(self) -> Self:
        """A copy of all."""
        return self.select(slice(None))

    def replace(self, other: Parcels) -> None:
        """Become another cloud, whose arrays are taken over."""
        for name in (*KINDS, "carried"):
            setattr(self, name, getattr(other, name))

    def assign(self, other: Parcels) -> None:
        """Become a copy of another cloud."""
        self.replace(other.copy())

    # -- ranks and files -----------------------------------------------------------------------

    def share(self, comm: MPI.Comm) -> Self:
        """Those of a cloud that all ranks have that this rank of `comm` begins with, by id."""
        return self.select(self.id % comm.size == comm.rank)

    def gather(self, comm: MPI.Comm) -> Self | None:
        """All parcels of all ranks by id on rank 0, None elsewhere (collective)."""
        parts = comm.gather(self.arrays(), root=0)
        if parts is None:
            return None
        whole = self.concatenate(self.from_arrays(part) for part in parts)
        return whole.select(np.argsort(whole.id, kind="stable"))

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Everything that the next step needs for the same bits, to be stored."""
        return {name: getattr(self, name) for name in KINDS}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> Self:
        """What `arrays` gave.

        Raises
        ------
        InputError
            an array is missing or has the wrong shape.
        """
        for name in KINDS:
            if name not in arrays:
                raise InputError(f"parcels.{name}", None, "an array over the parcels")
        copies: dict[str, Any] = {name: np.array(arrays[name]) for name in KINDS}
        return cls(**copies)

    # -- what others read ----------------------------------------------------------------------

    @property
    def mass(self) -> npt.NDArray[np.float64]:
        """Mass of a particle of each parcel [kg]."""
        return np.pi / 6 * self.density * self.diameter**3

    @property
    def mass_flow(self) -> npt.NDArray[np.float64]:
        """rate m [kg/s]."""
        return self.rate * self.mass

    def counts(self, comm: MPI.Comm | None = None) -> dict[str, int]:
        """Parcels by their status, on all ranks of `comm` (collective) or on this one."""
        found = np.bincount(self.status, minlength=len(STATUS))
        if comm is not None:
            found = comm.allreduce(found)
        return dict(zip(STATUS, (int(n) for n in found), strict=True))

    def leave(self, z: float) -> None:
        """Parcels inside at or beyond z [m], but for the last step's miss, are out."""
        self.status[(self.status == INSIDE) & (self.x[:, 2] >= z)] = OUT


def sizes(materials: Sequence[Solids]) -> list[float]:
    """Diameters of materials [m]."""
    return [float(m.diameter) for m in materials]

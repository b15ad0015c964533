# SPDX-License-Identifier: LGPL-3.0-or-later
"""Particles in the gas of a line in three dimensions, straight or bent, as it is at one time.

They go on in time; what is told at a place along the axis is interpolated on the way of each.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fem_tfm.geometry.mesh import Mesh
from fem_tfm.models.carrier import LineCarrier
from fem_tfm.models.particles import migration
from fem_tfm.models.particles.cloud import INSIDE, OUT, Parcels
from fem_tfm.models.particles.tracker import Impacts
from fem_tfm.output.particles.tracked import Moment
from fem_tfm.output.particles.wear import WearMap
from fem_tfm.scenes.particles.tracking import COLLISION_CHANGE, MOST_PASSES, Tracking
from fem_tfm.signals import Request

# stretches of time in which the gas goes from one place that is told to the next, and the longest
# time that particles are followed, in units of the gas's passage
PER_PLACE, LONGEST = 2, 30.0


class Crossings:
    """When and where each parcel first comes to places along the line.

    What is found is kept where it happens; how far a parcel has come goes with it to other ranks.

    places : along the axis, ascending [m]
    parcels : of this rank, at the inlet
    """

    def __init__(self, places: NDArray[np.float64], parcels: Parcels, mesh: Mesh) -> None:
        self.places, self.mesh = places, mesh
        self._found: list[tuple[NDArray[Any], ...]] = []
        parcels.carried = {"passed": np.zeros(len(parcels), dtype=np.int64)}
        self._stand(parcels)
        self.take(parcels)

    def restore(self, arrays: Mapping[str, NDArray[Any]], parcels: Parcels, first: bool) -> None:
        """Put back what `whole` gave; the parcels stand where they stood.

        arrays : time (parcels, places), x and v (parcels, places, 3)
        first : whether this rank keeps what was found
        """
        came = np.isfinite(arrays["time"])
        parcels.carried = {"passed": came.sum(axis=1)[parcels.id]}
        self._stand(parcels)
        number, place = np.nonzero(came)
        parts = (arrays[n][came] for n in ("time", "x", "v"))
        self._found = [(number, place, *parts)] if first else []

    def _stand(self, parcels: Parcels) -> None:
        """Remember where the parcels stand."""
        along, *others = self._state(parcels)
        parcels.carried |= {"along": along, "before": np.column_stack(others)}

    def _state(self, parcels: Parcels) -> tuple[NDArray[np.float64], ...]:
        along = self.mesh.straightened(parcels.x)[:, 2].copy()
        # what is out has passed the last place
        along[parcels.status == OUT] = self.places[-1]
        return along, parcels.time, parcels.x, parcels.v

    def take(self, parcels: Parcels) -> None:
        """Enter what was crossed since the last call."""
        now, *others = self._state(parcels)
        after = np.column_stack(others)
        passed, along, before = (parcels.carried[n] for n in ("passed", "along", "before"))
        while True:
            place = np.minimum(passed, len(self.places) - 1)
            crossing = (passed < len(self.places)) & (now >= self.places[place])
            if not crossing.any():
                break
            at, step = place[crossing], now[crossing] - along[crossing]
            share = (self.places[at] - along[crossing]) / np.where(step > 0, step, 1.0)
            share = np.clip(np.where(step > 0, share, 1.0), 0.0, 1.0)[:, None]
            rows = (1 - share) * before[crossing] + share * after[crossing]
            self._found.append((parcels.id[crossing], at, rows[:, 0], rows[:, 1:4], rows[:, 4:]))
            passed[crossing] += 1
        self._stand(parcels)

    def whole(self, comm: Any, count: int) -> dict[str, NDArray[Any]] | None:
        """All that was found on rank 0, None elsewhere: time (count, places), x, v (collective).

        What never came to a place is nan there.
        """
        parts = comm.gather(self._found)
        if parts is None:
            return None
        shape = count, len(self.places)
        arrays = {"time": np.full(shape, np.nan)}
        arrays |= {name: np.full((*shape, 3), np.nan) for name in "xv"}
        for number, place, *values in (found for part in parts for found in part):
            for array, value in zip(arrays.values(), values, strict=True):
                array[number, place] = value
        return arrays


def follow_line(scene: Any, carrier: LineCarrier, recorder: Any, request: Request) -> None:
    """Particles of a scene through the gas that its line holds now.

    The recorder keeps what is told of them. Raises KeyboardInterrupt on all ranks where a request
    to stop was made on any.
    """
    carrier.update()
    tracking = _OnLine(scene, carrier, recorder.comm)
    recorder.tracked = tracking.tracked
    passes = 1 if scene.particles.collisions is None else MOST_PASSES
    for number in range(passes):
        recorder.progress.stage(f"following {len(tracking.tracked.material)} parcels")
        message = tracking.pass_through(recorder.progress, request)
        if tracking.settled:
            break
        if number < passes - 1:
            tracking.begin_again()
    tracking.tell()
    recorder.log(f"particles: {message}; {tracking.warning()}")


class _OnLine(Tracking):
    """Parcels on their way through a line."""

    carrier: LineCarrier

    def __init__(self, scene: Any, carrier: LineCarrier, comm: Any) -> None:
        super().__init__(scene, carrier, comm)
        self._entering = self.parcels.copy()
        self.begin_again()

    def begin_again(self) -> None:
        """Put all parcels back to where they enter."""
        scene = self.scene
        self.parcels.assign(self._entering)
        places = np.linspace(0.0, scene.geometry.length, scene.particles.stations + 1)
        self.crossings = Crossings(places, self.parcels, self.carrier.mesh)
        self.impacts = None if self.wear is None else Impacts()
        self.worn: Any = np.zeros((len(places) - 1, 1, 1))

    def pass_through(self, progress: Any, request: Request) -> str:
        """Follow all parcels until they are out, and the cloud that they leave; how it ended."""
        scene = self.scene
        passage = scene.geometry.length / scene.feed.gas_velocity
        step = passage / scene.particles.stations / PER_PLACE
        message = ""
        if self.encounters is not None:
            self.encounters.clear()
        for time in np.arange(1, int(LONGEST * passage / step) + 1) * step:
            left = self.go_on(float(time), request)
            message = f"{time:.4g} s, {left} parcels inside"
            progress.update(1 - left / len(self.tracked.material), message)
            if not left:
                break
        if self.encounters is not None:
            self._change = self.encounters.renew(self.volumes)
        return message

    @property
    def settled(self) -> bool:
        """Whether the last pass left the collisions as they were."""
        met = self.encounters
        return met is None or met.law is None or self._change < COLLISION_CHANGE

    def go_on(self, time: float, request: Request | None = None) -> int:
        """Follow all parcels to a time [s]; how many are still inside (collective)."""
        self.tracker.advance(
            self.parcels,
            self.carrier.field,
            until_time=time,
            impacts=self.impacts,
            encounters=self.encounters,
            request=request,
        )
        self.crossings.take(self.parcels)
        return int(self.comm.allreduce(int((self.parcels.status == INSIDE).sum())))

    def tell(self) -> None:
        """What was found at every place (collective)."""
        whole = self.parcels.gather(self.comm)
        found = self.crossings.whole(self.comm, len(self.released))
        told = None if whole is None else (whole.status, whole.x, found)
        status, last, arrays = self.comm.bcast(told)
        time, x, v = (arrays[name].swapaxes(0, 1) for name in ("time", "x", "v"))
        time = time - self.released
        mesh = self.carrier.mesh
        for n, z in enumerate(self.crossings.places):
            inside = np.isfinite(time[n])
            # what never comes here is told where it stays
            at, speed = np.where(inside[:, None], x[n], last), np.nan_to_num(v[n])
            along = np.einsum("ij,ij->i", speed, mesh.axis(at))
            across = mesh.straightened(at)[:, :2]
            clock = np.nan_to_num(time[n])
            self.tracked.take(Moment(float(z), clock, at, speed, inside, along, across), status)
        self.count(0.0, self.scene.geometry.length)
        if self.wear is not None:
            self.book()
            for z, sums in zip(self.crossings.places[1:], self.worn, strict=True):
                self.wear.add(float(z), self.comm.allreduce(sums))

    def book(self) -> None:
        """Add the impacts so far to the sums of the stretches between two places."""
        if self.impacts is None:
            return
        hits, speed, angle, removed = self.hits(self.impacts)
        x, rate = self.carrier.mesh.straightened(hits["x"]), self.tracked.rate[hits["id"]]
        places = self.crossings.places
        stretch = np.clip(np.searchsorted(places, x[:, 2]) - 1, 0, len(places) - 2)
        parts = (x, speed, angle, rate, removed)
        here = (stretch == n for n in range(len(places) - 1))
        self.worn = self.worn + [WearMap.summed(*(p[h] for p in parts)) for h in here]
        self.impacts = Impacts()


class Along(_OnLine):
    """Parcels that go on with a gas that changes, each from the time at which it enters.

    Parameters
    ----------
    scene : of an unsteady flow, with particles.release = "during"
    carrier : its gas, which stands at the start or where a checkpoint was written
    """

    def __init__(self, scene: Any, carrier: LineCarrier, comm: Any) -> None:
        super().__init__(scene, carrier, comm)
        carrier.update()

    def step(self, start: float, end: float) -> None:
        """Follow the parcels over a step of the gas, which stands at its end [s] (collective)."""
        self.carrier.field.keep(start, end)
        self.carrier.update()
        self.go_on(end)

    def state(self) -> dict[str, NDArray[Any]]:
        """Whole arrays over all parcels, from which `restore` goes on (collective)."""
        self.book()
        whole = migration.numbered(self.parcels, self.carrier.grid).gather(self.comm)
        crossings = self.crossings.whole(self.comm, len(self.released))
        worn = np.asarray(self.comm.allreduce(np.asarray(self.worn)))
        if whole is None or crossings is None:
            return {}
        found = {f"parcels.{n}": v for n, v in whole.arrays().items()}
        return found | {f"crossings.{n}": v for n, v in crossings.items()} | {"worn": worn}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Put back what `state` gave."""

        def part(stem: str) -> dict[str, NDArray[Any]]:
            return {n.removeprefix(stem): v for n, v in arrays.items() if n.startswith(stem)}

        first, whole = self.comm.rank == 0, Parcels.from_arrays(part("parcels."))
        self.parcels = migration.dealt_by_cell(whole, self.carrier.grid)
        self.crossings.restore(part("crossings."), self.parcels, first)
        if first:
            self.worn = arrays["worn"]
        self.carrier.update()

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
from fem_tfm.models.particles.cloud import INSIDE, OUT, Parcels
from fem_tfm.models.particles.tracker import Impacts
from fem_tfm.output.particles.tracked import Moment
from fem_tfm.output.particles.wear import WearMap
from fem_tfm.scenes.particles.tracking import COLLISION_CHANGE, MOST_PASSES, Tracking

# stretches of time in which the gas goes from one place that is told to the next, and the longest
# time that particles are followed, in units of the gas's passage
PER_PLACE, LONGEST = 2, 30.0


class Crossings:
    """When and where each parcel of this rank first comes to places along the line.

    places : along the axis, ascending [m]
    parcels : of this rank, at the inlet
    """

    def __init__(self, places: NDArray[np.float64], parcels: Parcels, mesh: Mesh) -> None:
        shape = len(places), len(parcels)
        self.places, self.mesh = places, mesh
        self.time = np.full(shape, np.nan)
        self.x, self.v = np.full((*shape, 3), np.nan), np.full((*shape, 3), np.nan)
        self._level = np.zeros(len(parcels), dtype=int)
        self._before = self._state(parcels)
        self.take(parcels)

    def state(self) -> dict[str, NDArray[Any]]:
        """Arrays over the parcels of this rank, from which `restore` goes on."""
        return {"time": self.time.T, "x": self.x.swapaxes(0, 1), "v": self.v.swapaxes(0, 1)}

    def restore(self, arrays: Mapping[str, NDArray[Any]], parcels: Parcels) -> None:
        """Put back what `state` gave; the parcels stand where they stood."""
        self.time = np.ascontiguousarray(arrays["time"].T)
        self.x, self.v = (np.ascontiguousarray(arrays[n].swapaxes(0, 1)) for n in "xv")
        self._level = np.isfinite(self.time).sum(axis=0)
        self._before = self._state(parcels)

    def _state(self, parcels: Parcels) -> tuple[NDArray[np.float64], ...]:
        along = self.mesh.straightened(parcels.x)[:, 2].copy()
        # what is out has passed the last place
        along[parcels.status == OUT] = self.places[-1]
        return along, parcels.time.copy(), parcels.x.copy(), parcels.v.copy()

    def take(self, parcels: Parcels) -> None:
        """Enter what was crossed since the last call."""
        now = self._state(parcels)
        while True:
            level = np.minimum(self._level, len(self.places) - 1)
            passed = (self._level < len(self.places)) & (now[0] >= self.places[level])
            if not passed.any():
                break
            at, numbers = level[passed], np.flatnonzero(passed)
            step = now[0][passed] - self._before[0][passed]
            share = (self.places[at] - self._before[0][passed]) / np.where(step > 0, step, 1.0)
            share = np.clip(np.where(step > 0, share, 1.0), 0.0, 1.0)
            parts = zip((self.time, self.x, self.v), self._before[1:], now[1:], strict=True)
            for kept, first, last in parts:
                s = share if first.ndim == 1 else share[:, None]
                kept[at, numbers] = (1 - s) * first[passed] + s * last[passed]
            self._level[passed] += 1
        self._before = now


def follow_line(scene: Any, carrier: LineCarrier, recorder: Any) -> None:
    """Particles of a scene through the gas that its line holds now.

    The recorder keeps what is told of them.
    """
    carrier.update()
    tracking = _OnLine(scene, carrier, recorder.comm)
    recorder.tracked = tracking.tracked
    passes = 1 if scene.particles.collisions is None else MOST_PASSES
    for number in range(passes):
        recorder.progress.stage(f"following {len(tracking.tracked.material)} parcels")
        message = tracking.pass_through(recorder.progress)
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
        self._released = self.parcels.time.copy()
        self.worn: Any = np.zeros((len(places) - 1, 1, 1))

    def pass_through(self, progress: Any) -> str:
        """Follow all parcels until they are out, and the cloud that they leave; how it ended."""
        scene = self.scene
        passage = scene.geometry.length / scene.feed.gas_velocity
        step = passage / scene.particles.stations / PER_PLACE
        message = ""
        if self.encounters is not None:
            self.encounters.clear()
        for time in np.arange(1, int(LONGEST * passage / step) + 1) * step:
            left = self.go_on(float(time))
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

    def go_on(self, time: float) -> int:
        """Follow all parcels to a time [s]; how many are still inside (collective)."""
        self.tracker.advance(
            self.parcels,
            self.carrier.field,
            until_time=time,
            impacts=self.impacts,
            encounters=self.encounters,
        )
        self.crossings.take(self.parcels)
        return int(self.comm.allreduce(int((self.parcels.status == INSIDE).sum())))

    def tell(self) -> None:
        """What was found at every place (collective)."""
        whole = self.parcels.gather(self.comm)
        released = self.crossings.time - self._released, *self._arrays()[1:]
        parts = self.comm.gather((self.parcels.id, *released))
        found = None
        if parts is not None and whole is not None:
            order = np.argsort(np.concatenate([part[0] for part in parts]), kind="stable")
            arrays = [np.concatenate([p[n] for p in parts], axis=1)[:, order] for n in (1, 2, 3)]
            found = whole.status, whole.x, arrays
        status, last, (time, x, v) = self.comm.bcast(found)
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

    def _arrays(self) -> tuple[NDArray[np.float64], ...]:
        return self.crossings.time, self.crossings.x, self.crossings.v

    def book(self) -> None:
        """Add the impacts so far to the sums of the stretches between two places."""
        if self.impacts is None:
            return
        hits, speed, angle, removed = self.hits(self.impacts)
        x, rate = self.carrier.mesh.straightened(hits["x"]), self.parcels.rate[hits["index"]]
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
        self._released = self.parcels.time.copy()
        carrier.update()

    def step(self, start: float, end: float) -> None:
        """Follow the parcels over a step of the gas, which stands at its end [s] (collective)."""
        self.carrier.field.keep(start, end)
        self.carrier.update()
        self.go_on(end)

    def state(self) -> dict[str, NDArray[Any]]:
        """Whole arrays over all parcels, from which `restore` goes on (collective)."""
        self.book()
        whole = self.parcels.gather(self.comm)
        parts = self.comm.gather((self.parcels.id, self.crossings.state()))
        worn = np.asarray(self.comm.allreduce(np.asarray(self.worn)))
        if whole is None or parts is None:
            return {}
        order = np.argsort(np.concatenate([part[0] for part in parts]), kind="stable")
        found = {f"parcels.{n}": v for n, v in whole.arrays().items()}
        for name in parts[0][1]:
            array = np.concatenate([part[1][name] for part in parts])[order]
            found[f"crossings.{name}"] = array
        return found | {"worn": worn}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Put back what `state` gave."""

        def part(stem: str) -> dict[str, NDArray[Any]]:
            return {n.removeprefix(stem): v for n, v in arrays.items() if n.startswith(stem)}

        whole = Parcels.from_arrays(part("parcels."))
        mine = whole.id % self.comm.size == self.comm.rank
        self.parcels = whole.share(self.comm)
        self.crossings.restore({n: v[mine] for n, v in part("crossings.").items()}, self.parcels)
        if self.comm.rank == 0:
            self.worn = arrays["worn"]
        self.carrier.update()

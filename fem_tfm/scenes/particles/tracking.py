# SPDX-License-Identifier: LGPL-3.0-or-later
"""Particles of a scene on their way through its gas: one section all along, or slab by slab."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from fem_tfm.cloud import Cloud, parcels
from fem_tfm.materials import Solids
from fem_tfm.models.carrier import Carrier, ReynoldsStressCarrier, SectionCarrier
from fem_tfm.models.particles.cloud import INSIDE, OUT, Parcels
from fem_tfm.models.particles.encounters import Encounters
from fem_tfm.models.particles.field import TIME
from fem_tfm.models.particles.grid import Grid
from fem_tfm.models.particles.sinks import Sinks
from fem_tfm.models.particles.tracker import COUNTED, Forces, Impacts, Steps, Tracker
from fem_tfm.models.reynolds_stress.exchange import Exchange
from fem_tfm.models.reynolds_stress.heat import GasHeat
from fem_tfm.output.particles.lattice import Lattice
from fem_tfm.output.particles.tracked import Moment, Tracked
from fem_tfm.output.particles.wear import WearMap
from fem_tfm.scenes.particles.words import gas_flow

type Floats = NDArray[np.float64]
ADDED_MASS = 0.5
# steps after which a parcel counts as stuck; ash takes 7 on every diameter of the published duct
MOST_STEPS, STEPS_A_DIAMETER = 2000, 200
# measured on the published duct and the dilute pipe: CPU time of a parcel over a diameter with
# particles.step = 1 [s], and how often a slab is crossed where the gas feels them or they collide
PARCEL_TIME, CROSSINGS = 4e-6, 2.5
# a stretch is followed again until its collisions change by less, but no more often
COLLISION_CHANGE, MOST_PASSES = 0.01, 5


def following_time(scene: Any) -> float:
    """About the CPU time that the particles of a scene take along its line [s]."""
    cloud: Cloud | None = scene.particles
    if cloud is None:
        return 0.0
    places = len(cloud.points) if cloud.injection == "points" else 1
    count = cloud.parcels * places * len(cloud.materials)
    diameters = scene.geometry.length / scene.geometry.hydraulic_diameter
    again = cloud.coupling != "one-way" or cloud.collisions is not None
    steps = diameters / min(cloud.step, 1.0)
    return float(PARCEL_TIME * count * steps * (CROSSINGS if again else 1.0))


def forces_of(scene: Any) -> Forces:
    """Forces on the particles of a scene."""
    cloud: Cloud = scene.particles
    wanted = set(cloud.forces)
    still = (0.0, 0.0, 0.0)
    return Forces(
        drag=cloud.drag,
        gravity=scene.gravity if "gravity" in wanted else still,
        pressure_gradient="pressure-gradient" in wanted,
        saffman="saffman" in wanted,
        magnus="magnus" in wanted,
        added_mass=ADDED_MASS if "added-mass" in wanted else 0.0,
        heat=cloud.heat,
    )


def carrier_of(scene: Any, section: Any, heat: GasHeat | None = None) -> Carrier:
    """The gas of a section as the particles of a scene see it, with its temperature."""
    carrier = SectionCarrier(section, scene.model.gas, scene.particles.dispersion)
    if heat is not None and isinstance(carrier, ReynoldsStressCarrier):
        carrier.warm(heat, scene.model.heat.heat_capacity)
    return carrier


def lattice_of(grid: Grid) -> Lattice:
    """The cells of a grid as files know them, on the rank that writes (collective)."""
    points, nodes = grid.whole()
    return Lattice(points, nodes[:, grid.cell.vertices], grid.folds)


def release_times(scene: Any, number: int, count: int) -> Floats:
    """When the parcels of a material enter [s]: at once, or evenly over an unsteady flow."""
    cloud: Cloud = scene.particles
    if cloud.release == "after":
        return np.zeros(count)
    draws = np.random.default_rng([cloud.seed, number, count])
    return np.asarray(scene.numerics.end_time * (draws.permutation(count) + 0.5) / count)


def entering(scene: Any) -> tuple[Parcels, NDArray[np.int32]]:
    """All parcels of a scene as they enter, by material, and the entry of each."""
    cloud: Cloud = scene.particles
    section, made, entries, count = scene.geometry.section("none"), [], [], 0
    for number, material in enumerate(cloud.materials):
        feed = parcels(cloud, number, section, gas_flow(scene))
        speed = scene.feed.gas_velocity if material.velocity is None else material.velocity
        warmth = material.temperature
        made.append(
            Parcels.release(
                np.column_stack([feed.x, feed.y, np.zeros_like(feed.x)]),
                np.array([0.0, 0.0, speed]),
                Solids(material.density, material.diameter),
                rate=feed.rate,
                number=number,
                diameter=feed.diameter,
                temperature=scene.model.gas.temperature if warmth is None else warmth,
                time=release_times(scene, number, len(feed.x)),
                first_id=count,
            )
        )
        entries.append(feed.entry)
        count += len(feed.x)
    return Parcels.concatenate(made), np.concatenate(entries)


class Tracking:
    """The parcels of a scene, dealt out to the ranks, which hand them over as they move.

    Attributes
    ----------
    tracked : what is told of them, the same on every rank
    released : when each enters, by id [s]
    """

    def __init__(self, scene: Any, carrier: Carrier, comm: MPI.Comm) -> None:
        cloud: Cloud = scene.particles
        self.scene, self.carrier, self.comm = scene, carrier, comm
        self.tracker = Tracker(
            [Solids(one.density, one.diameter) for one in cloud.materials],
            forces_of(scene),
            cloud.dispersion,
            cloud.impact,
            Steps(eddies=cloud.step, max_steps=self._most_steps(scene)),
            seed=cloud.seed,
            heat_capacity=[one.heat_capacity for one in cloud.materials],
        )
        whole, entry = entering(scene)
        self.parcels, self.released = whole.share(comm), whole.time
        per_material = max(len(whole) // len(cloud.materials), 1)
        wanted = min(cloud.traced, per_material)
        places = np.linspace(0, per_material - 1, wanted, dtype=np.int64)
        traced = [places + n * per_material for n in range(len(cloud.materials))]
        self.tracked = Tracked(
            materials=[one.name for one in cloud.materials],
            area=scene.geometry.area,
            material=whole.material,
            entry=entry,
            diameter=whole.diameter,
            mass=whole.mass,
            rate=whole.rate,
            traced=np.concatenate(traced),
            lattice=lattice_of(carrier.grid) if cloud.fields else None,
        )
        self.encounters: Encounters | None = None
        if cloud.collisions is not None or cloud.fields:
            grid, count = carrier.grid, len(cloud.materials)
            self.encounters = Encounters(cloud.collisions, grid, self.parcels, count, comm)
        # where the parcels stand [m], and how much the last pass changed the collisions
        self._stands = self._change = 0.0
        self.wear = WearMap(scene.geometry.section("none").perimeter) if cloud.wear else None
        self.tracked.wear = self.wear
        self.impacts: Impacts | None = None

    @staticmethod
    def _most_steps(scene: Any) -> int:
        """Steps after which a parcel is stuck."""
        diameters = scene.geometry.length / scene.geometry.hydraulic_diameter
        steps = MOST_STEPS + STEPS_A_DIAMETER * diameters
        return min(round(float(steps) / min(float(scene.particles.step), 1.0)), COUNTED)

    def to(
        self,
        z: float,
        sinks: Sinks | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> None:
        """Move every parcel inside to a place along the line [m] (collective with collisions)."""
        self.impacts = None if self.wear is None else Impacts()
        self.tracker.advance(
            self.parcels,
            self.carrier.field,
            until_z=z,
            sinks=sinks,
            impacts=self.impacts,
            encounters=self.encounters,
            progress=progress,
        )
        if self.encounters is not None:
            self._change = self.encounters.renew(self.volumes * (z - self._stands))

    @property
    def volumes(self) -> Floats:
        """Area of each cell with its mirror images [m2]; its volume in three dimensions [m3]."""
        carrier = self.carrier
        return np.asarray(carrier.grid.sizes * carrier.mesh.section.area_factor)

    def again(self, z: float) -> None:
        """`to`, until collisions are those of the cloud that they leave (collective)."""
        if self.encounters is None or self.encounters.law is None:
            if self.encounters is not None:
                self.encounters.clear()
            self.to(z)
            return
        begun = self.parcels.copy()
        for _ in range(MOST_PASSES):
            self.parcels.assign(begun)
            self.encounters.clear()
            self.to(z)
            if self._change < COLLISION_CHANGE:
                break

    def sample(self, z: float) -> None:
        """Tell what is at a place (collective)."""
        whole, moment = self.parcels.gather(self.comm), None
        if whole is not None:
            inside = (whole.status == INSIDE) | (whole.status == OUT)
            moment = Moment(z, whole.time, whole.x, whole.v, inside), whole.status
        self.tracked.take(*self.comm.bcast(moment))
        if z > self._stands:
            self.count(self._stands, z)
        self._stands = z
        if self.impacts is not None:
            self._enter_impacts(z)

    def count(self, start: float, end: float) -> None:
        """Tell what was in each cell of a stretch [m], and how often it collided."""
        met = self.encounters
        if met is None:
            return
        if met.law is not None:
            self.tracked.meet(met.collisions, met.residence, self._change)
        if self.tracked.lattice is not None:
            fields = self.carrier.grid.collect(met.fields, axis=1)
            if fields is not None:
                self.tracked.lattice.take(start, end, fields)

    def _enter_impacts(self, end: float) -> None:
        """Put the impacts of the last stretch on the map of wear (collective)."""
        assert self.impacts is not None and self.wear is not None
        hits, speed, angle, removed = self.hits(self.impacts)
        rate = self.tracked.rate[hits["id"]]
        sums = WearMap.summed(hits["x"], speed, angle, rate, removed)
        self.wear.add(end, self.comm.allreduce(sums))
        self.impacts = None

    def hits(self, impacts: Impacts) -> tuple[dict[str, NDArray[Any]], Floats, Floats, Floats]:
        """Impacts, their speeds [m/s], angles to the wall [rad] and what each removes [kg]."""
        hits, all_of_them = impacts.arrays(), self.tracked
        number, v = hits["id"], hits["v"]
        speed = np.linalg.norm(v, axis=1)
        across = np.abs((v * hits["normal"]).sum(axis=1))
        angle = np.arcsin(np.clip(across / np.maximum(speed, 1e-30), 0.0, 1.0))
        law = self.scene.particles.wear
        mass, diameter = all_of_them.mass[number], all_of_them.diameter[number]
        return hits, speed, angle, law.removed(speed, angle, mass, diameter)

    def leave(self) -> None:
        """What is inside has come to the end of the line and is out."""
        status = self.parcels.status
        status[status == INSIDE] = OUT

    def warning(self) -> str:
        """The early-warning line: mean velocities, and what is no longer inside."""
        speeds = (f"{n} {self.tracked.rows[n][-1]['velocity']:.3g} m/s" for n in self.tracked.rows)
        lost = {k: v for k, v in self.tracked.counts().items() if v and k not in ("inside", "out")}
        gone = "".join(f", {number} {fate}" for fate, number in lost.items())
        return f"{', '.join(speeds)}{gone}"


def follow(scene: Any, carrier: Carrier, recorder: Any) -> None:
    """Particles of a scene whose gas is the same all along the line.

    The recorder keeps what is told of them, as they go.
    """
    carrier.update()
    tracking = Tracking(scene, carrier, recorder.comm)
    recorder.tracked = tracking.tracked
    length, stations = scene.geometry.length, scene.particles.stations
    recorder.progress.stage(f"following {len(tracking.tracked.material)} parcels")
    tracking.sample(0.0)
    for z in np.linspace(0.0, length, stations + 1)[1:]:
        tracking.again(float(z))
        if z == length:
            tracking.leave()
        tracking.sample(float(z))
        message = f"z {z:.4g} of {length:.4g} m, {tracking.warning()}"
        recorder.progress.update(float(z / length), message)
    recorder.log(f"particles: {message}")


def exchange_of(scene: Any, mesh: Any) -> Exchange | None:
    """What the gas of a march gets from its particles, None where it feels nothing."""
    cloud: Cloud | None = scene.particles
    if cloud is None or cloud.coupling == "one-way":
        return None
    return Exchange(mesh, lateral=cloud.lateral, heat=cloud.heat, damping=cloud.modulation)


def slabs_of(
    scene: Any,
    station: Any,
    comm: MPI.Comm,
    exchange: Exchange | None = None,
    heat: GasHeat | None = None,
) -> Slabs | None:
    """The particles of a march, None without any."""
    if scene.particles is None:
        return None
    return Slabs(scene, carrier_of(scene, station, heat), comm, exchange)


class Slabs(Tracking):
    """Particles that go down a line with its gas, slab by slab between two stations.

    exchange : what the gas of the station gets from them, None where it feels nothing
    """

    def __init__(
        self, scene: Any, carrier: Carrier, comm: MPI.Comm, exchange: Exchange | None
    ) -> None:
        super().__init__(scene, carrier, comm)
        self.exchange = exchange
        heat = max(one.heat_capacity for one in scene.particles.materials)
        self.sinks = None
        if exchange is not None:
            warms = heat if exchange.heat is not None else None
            self.sinks = Sinks.of(carrier.grid, self.parcels, comm, warms)
        self._begun = self.parcels.copy()
        # momentum and heat that the gas has given so far
        self.given = self.warmed = 0.0
        self._entered = float(comm.allreduce(float(self.parcels.mass_flow @ self._enthalpy())))

    def enter(self) -> None:
        """Stand at the inlet, whose state the station holds."""
        self.carrier.update()
        self.sample(0.0)

    # -- what a line asks of its coupler -------------------------------------------------------

    def begin(self, start: float, end: float) -> None:
        """A slab is tried [m]."""
        self.span = start, end
        self.carrier.field.keep(start, end)

    def trace(self, station: Any) -> float:
        """Cross the slab with the gas at hand; the relative change of what the gas gets."""
        start, end = self.span
        self.carrier.update()
        self.parcels.assign(self._begun)
        if self.sinks is None or self.exchange is None:
            self.again(end)
            return 0.0
        sinks = self.sinks
        sinks.clear()
        if self.encounters is not None:
            self.encounters.clear()
        self.to(end, sinks)
        sinks.reduce(self.comm)
        return self._renew(station, end - start)

    def _renew(self, station: Any, step: float) -> float:
        """Tell the station what the particles have taken over a step [m]."""
        assert self.exchange is not None and self.sinks is not None
        carrier, sinks = self.carrier, self.sinks
        own = carrier.grid.owned
        # mass of the gas in the mirror images of each cell, over the step
        mass = (carrier.field.density * self.volumes * step)[own]
        warm: dict[str, Any] = {}
        if self.exchange.heat is not None:
            capacity = mass * carrier.field.heat_capacity
            warm["heat"] = -sinks.heat[own] / capacity
            warm["heat_slope"] = sinks.heat_slope[own] / capacity
        force = -sinks.impulse[own] / mass[:, None]
        slope = sinks.slope[own] / mass
        if self.exchange.damping is not None:
            warm["damping"] = self._damping(slope)
        return self.exchange.renew(force, slope, station.pressure_gradient, **warm)

    def _damping(self, slope: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rate at which particles that do not follow the eddies damp them, in each cell [1/s].

        gamma = beta tau_p/(tau_p + T_L), with tau_p the mean of the particles in the cell
        """
        assert self.sinks is not None
        grid, rows = self.carrier.grid, self.carrier.field.rows_ahead
        assert rows is not None
        own, drag = grid.owned, self.sinks.slope
        relaxation = self.sinks.residence / np.where(drag > 0, drag, np.inf)
        life = rows[grid.nodes, TIME].mean(axis=1)
        return np.asarray(slope * (relaxation / (relaxation + life))[own])

    def accept(self) -> None:
        """The slab counts as it was crossed last."""
        end = self.span[1]
        if self.sinks is not None:
            self.given += float(self.sinks.impulse[:, 2].sum())
            if self.sinks.heat_sums is not None:
                self.warmed += float(self.sinks.heat.sum())
        self.carrier.update()
        self.carrier.field.settle()
        if end >= self.scene.geometry.length * (1 - 1e-9):
            self.leave()
        self._begun = self.parcels.copy()
        self.sample(end)

    def reject(self) -> None:
        """Back to the beginning of the slab."""
        self.parcels.assign(self._begun)
        self.carrier.field.forget()

    def state(self) -> Mapping[str, NDArray[Any]]:
        """Whole arrays from which `restore` goes on (collective)."""
        whole = self.parcels.gather(self.comm)
        own = {} if whole is None else {f"parcels.{n}": v for n, v in whole.arrays().items()}
        told = {f"tracked.{n}": v for n, v in self.tracked.state().items()}
        met = {} if self.encounters is None else {"partners": self.encounters.partners}
        return own | told | met | {"given": np.array([self.given, self.warmed])}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Put back what `state` gave; the station holds its gas already."""

        def part(name: str) -> dict[str, NDArray[Any]]:
            stem = f"{name}."
            return {n.removeprefix(stem): v for n, v in arrays.items() if n.startswith(stem)}

        self.parcels = Parcels.from_arrays(part("parcels")).share(self.comm)
        self._begun = self.parcels.copy()
        self.tracked.restore(part("tracked"))
        self.given, self.warmed = map(float, arrays["given"])
        self._stands = float(self.tracked.z[-1])
        if self.encounters is not None:
            self.encounters.partners[:] = arrays["partners"]
        self.carrier.update()

    # -- balances ------------------------------------------------------------------------------

    def balances(self, lost: float) -> dict[str, float]:
        """Relative errors: of the mass flow, and of axial momentum between gas and particles.

        lost : axial force of the gas on the particles by the books of the line [N]
        """
        found = self.tracked.balances()
        if self.exchange is not None and self.given:
            station = self.scene.section
            owed = float(self.exchange.force.outstanding()[2])
            owed *= self.carrier.field.density * station.area_factor
            found["particle_momentum"] = abs(lost - owed - self.given) / abs(self.given)
        if self.exchange is not None and self.exchange.heat is not None and self.warmed:
            gained = float(self.comm.allreduce(float(self.parcels.mass_flow @ self._enthalpy())))
            found["particle_heat"] = abs(gained - self._entered - self.warmed) / abs(self.warmed)
        return found

    def _enthalpy(self) -> NDArray[np.float64]:
        """c_p T of each parcel [J/kg]."""
        return np.asarray(
            self.tracker.heat_capacity[self.parcels.material] * self.parcels.temperature
        )

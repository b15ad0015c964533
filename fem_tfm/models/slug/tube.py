# SPDX-License-Identifier: LGPL-3.0-or-later
"""A tube through which gas conveys grains: feed, grains, gas and outlet in time."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import MISSING, dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from fem_tfm.errors import InputError
from fem_tfm.geometry.section import Section
from fem_tfm.geometry.shapes import Bend, Shape
from fem_tfm.models.slug.feed import Feed, Feeder, filled
from fem_tfm.models.slug.gas import TubeGas
from fem_tfm.models.slug.grains import STEPS_PER_CONTACT, Grain, Grains, Walls
from fem_tfm.models.slug.mesh import LEAST_VOLUME, LEAST_WIDTH, TubeMesh, layers_along, tube_mesh
from fem_tfm.models.slug.pressure import GasPressure
from fem_tfm.models.slug.ranks import SharedGrains
from fem_tfm.parameters import Parameters, parameter

# a time step that is not given is this share of the longest one
EASY = 0.78


@dataclass(frozen=True)
class Conveying(Parameters):
    """What is conveyed: gas and grains that come in.

    gas_velocity : superficial velocity of the gas at the reference pressure
    solids_mass_flow : of the grains
    solids_velocity : at which the layers of grains are pushed in
    """

    gas_velocity: float = parameter(
        MISSING,
        "m/s",
        "superficial gas velocity",
        key="operation.gas_superficial_velocity",
        ge=0,
        le=1000,
    )
    solids_mass_flow: float = parameter(MISSING, "kg/s", "mass flow of the grains", ge=0, le=1e4)
    solids_velocity: float = parameter(0.04, "m/s", "speed of the feed", gt=0, le=100)
    gravity: float = parameter(9.81, "m/s2", "gravity", ge=0, le=1000)
    table: ClassVar[str] = "operation"


@dataclass(frozen=True)
class Steps(Parameters):
    """Steps in time, and the mesh of the gas.

    time_step : of the grains, by default 0.78 of the longest one; shortened so that a gas
        step is a whole number of them
    gas_step : of the pressure
    cells_across, cells_along : of the pressure's mesh, along by default twice as long as wide
    averaging_width : standard deviation of the averages of the grains that the gas sees, over
        their diameter; a mesh that is too coarse for it averages by itself
    skin : of the neighbour list over the grains' diameter; it has no influence on the result
    threads : that share the grains; they have no influence on the result
    """

    time_step: float | None = parameter(None, "s", "time step of the grains", gt=0, le=1)
    gas_step: float = parameter(1e-3, "s", "time step of the gas pressure", gt=0, le=10)
    cells_across: int = parameter(4, doc="cells of the pressure's mesh across", ge=1, le=100)
    cells_along: int | None = parameter(None, doc="cells along the tube", ge=1, le=1000000)
    averaging_width: float = parameter(
        1.0, doc="standard deviation of the averages of the grains over their diameter", ge=0, le=10
    )
    skin: float = parameter(0.2, doc="skin of the neighbour list over the diameter", gt=0, le=2)
    threads: int = parameter(1, doc="threads that share the grains", ge=1, le=1024)
    table: ClassVar[str] = "numerics"

    def grain_steps(self, grain: Grain) -> int:
        """Time steps of the grains in one of the gas."""
        step = self.time_step
        if step is None:
            small = grain.diameter / 2 * (1 - grain.spread)
            mass = float(grain.masses(np.array([small]))[0])
            longest = grain.contact.contact_time(mass / 2, small / 2) / STEPS_PER_CONTACT
            step = EASY * longest
        return max(math.ceil(self.gas_step / step * (1 - 1e-9)), 1)


class SlugTube:
    """The tube in time.

    time : [s]
    fed, out, start : grains fed so far, out at the end, inside at the beginning; always
        start + fed = inside + out

    comm : processes that share the grains; each of them solves for the whole gas

    A bend is a round tube with an arc in its axis: places "along" are then along the axis.

    Raises InputError where grains do not fit into the tube, the bend or the feed, and for a time
    step that cannot follow a contact.
    """

    def __init__(
        self,
        shape: Shape,
        gas: TubeGas,
        grain: Grain,
        conveying: Conveying,
        steps: Steps | None = None,
        *,
        full: bool = False,
        seed: int = 0,
        comm: MPI.Comm = MPI.COMM_SELF,
    ) -> None:
        self.shape, self.conveying = shape, conveying
        self.steps = steps or Steps()
        self.section: Section = shape.section("none")
        feed = checked_feed(shape, grain, conveying, self.steps)
        walls = Walls(self.section, low=0.0, arc=shape.arc)
        self.feeder = Feeder(feed, seed)
        self.inner_steps = self.steps.grain_steps(grain)
        given: dict[str, Any] = {
            "skin": self.steps.skin,
            "release": feed.release,
            "threads": self.steps.threads,
        }
        moved = (grain, walls, self.steps.gas_step / self.inner_steps)
        gravity = shape.gravity_vector(conveying.gravity)
        if comm.size > 1:
            self.grains: Grains = SharedGrains(
                *moved, gravity, comm=comm, length=shape.length, **given
            )
        else:
            self.grains = Grains(*moved, gravity, **given)
        across, along = self.steps.cells_across, self.steps.cells_along
        mesh = TubeMesh(tube_mesh(self.section, shape.length, across, along, shape.arc))
        width = self.steps.averaging_width * grain.diameter
        self.gas = GasPressure(mesh, gas, grain.diameter, width)
        self.number, self.out, self.start = 0, 0, 0
        if full:
            self._fill(grain, seed)

    def _fill(self, grain: Grain, seed: int) -> None:
        # the first layer that is fed touches the first one inside
        room = self.shape.length - grain.largest_diameter
        begin, arc = grain.largest_diameter / 2, self.shape.arc
        place, radius = filled(self.section, grain, room, seed + 1, arc=arc, begin=begin)
        ahead = np.array([0.0, 0.0, 1.0]) if arc is None else arc.axis(place)
        self.grains.add(place, self.conveying.solids_velocity * ahead, radius)
        self.start = len(place)

    @property
    def time(self) -> float:
        """Time [s]."""
        return self.number * self.steps.gas_step

    @property
    def fed(self) -> int:
        """Grains fed so far."""
        return self.feeder.count

    @property
    def inflow(self) -> float:
        """Volume of gas and grains that comes in through an area [m/s]."""
        c = self.conveying
        solids = c.solids_mass_flow / (self.grains.grain.density * self.section.area)
        return c.gas_velocity + solids

    def impacts(self) -> npt.NDArray[np.float64]:
        """Impacts on the walls since the last call, as Grains.impacts has them."""
        return self.grains.impacts()

    def in_line(
        self, place: npt.NDArray[np.float64], vectors: npt.NDArray[np.float64]
    ) -> npt.NDArray[np.float64]:
        """Vectors (n, 3) at places (n, 3) [m] by their components across and along the tube."""
        arc = self.shape.arc
        return vectors if arc is None else arc.straightened_vectors(place, vectors)

    def step(self) -> None:
        """Take one step of the gas and its steps of the grains.

        Raises
        ------
        SolverError
            a field or a place is no longer finite.
        """
        self.feeder.advance(self.grains, self.time)
        self.grains.run(self.inner_steps - 1)
        self.grains.record()
        self.number += 1
        self.out += self.grains.remove_beyond(self.shape.length)
        self._give()
        self.gas.step(self.steps.gas_step, self.inflow)
        self.gas.push(self.grains)

    def _give(self) -> None:
        """Give the gas porosity and velocity of all grains."""
        self.gas.average_over(*self.grains.total(*self.gas.tube.spread(self.grains)))

    def run(
        self,
        end: float,
        sample: Callable[[SlugTube], None] | None = None,
        interval: float = 0.01,
    ) -> None:
        """Step on to a time [s]; `sample` is called at multiples of an interval [s].

        Raises
        ------
        SolverError
            a field or a place is no longer finite.
        """
        every = max(round(interval / self.steps.gas_step), 1)
        last = round(end / self.steps.gas_step)
        while self.number < last:
            self.step()
            if sample is not None and self.number % every == 0:
                sample(self)

    # -- restart -----------------------------------------------------------------------------------

    def state(self) -> dict[str, Any]:
        """Everything that the next step depends on: a flat dictionary of arrays and one text."""
        found: dict[str, Any] = {}
        for name, part in self._parts().items():
            found |= {f"{name}.{key}": value for key, value in part.state().items()}
        return found | {"tube.numbers": np.array([self.number, self.out, self.start])}

    def _parts(self) -> dict[str, Any]:
        return {"grains": self.grains, "gas": self.gas, "feed": self.feeder}

    def restore(self, state: dict[str, Any]) -> None:
        """Put back what `state` gave; the steps that follow have the same bits."""
        for name, part in self._parts().items():
            own = {k.partition(".")[2]: v for k, v in state.items() if k.startswith(f"{name}.")}
            part.restore(own)
        self.number, self.out, self.start = (int(n) for n in state["tube.numbers"])
        self._give()


def _check_bend(bend: Bend, diameter: float) -> None:
    """Raise InputError for a bend through which layers and grains of a diameter [m] do not go."""
    if bend.legs[0] < diameter:
        words = f"at least {diameter:g} m, a grain's diameter: layers are pushed in straight"
        raise InputError("geometry.bend_start", bend.legs[0], words)
    least = bend.diameter / 2 + diameter
    if bend.axis_radius < least:
        words = f"at least {least:g} m, half the tube's diameter and a grain's"
        raise InputError("geometry.bend_radius", bend.axis_radius, words)


def checked_feed(shape: Shape, grain: Grain, conveying: Conveying, steps: Steps) -> Feed:
    """The feed of a tube, without the tube.

    Raises InputError where `SlugTube` does.
    """
    section = shape.section("none")
    Walls(section, low=0.0, arc=shape.arc).check(grain.largest_diameter)
    if isinstance(shape, Bend):
        _check_bend(shape, grain.largest_diameter)
    fastest = _fastest_feed(conveying, steps, grain)
    flow, speed = conveying.solids_mass_flow, conveying.solids_velocity
    feed = Feed(section, grain, flow, speed, fastest)
    _check_step(steps, grain)
    _check_nodes(shape, steps, grain.diameter)
    return feed


def _check_step(steps: Steps, grain: Grain) -> None:
    """Refuse a step of the grains that cannot follow a contact, as it is given."""
    try:
        grain.check_step(steps.gas_step / steps.grain_steps(grain))
    except InputError as error:
        raise InputError(error.key, steps.time_step or error.value, error.allowed) from None


@dataclass(frozen=True)
class Count:
    """Numbers of the pressure's mesh, told by one of its layers.

    layers : along the tube
    nodes : of the pressure
    average : standard deviation that the mesh alone has over the section [m]
    least : volume of the least node [m3]
    """

    layers: int
    nodes: int
    average: float
    least: float


def counted(shape: Shape, across: int, along: int | None) -> Count:
    """Count the mesh of a tube without making it.

    Nodes at the ends have half a layer; those at the inner wall of a bend have 1 - r/R of one.
    Raises InputError for a number of cells across that the section cannot have.
    """
    section = shape.section("none")
    layers = along or layers_along(section, shape.length, across)
    one = TubeMesh(tube_mesh(section, shape.length / layers, across, 1))
    average = math.sqrt(one.area / len(one.cells) / 3)
    least = float(one.volumes.min())
    if shape.arc is not None:
        least *= min(1.0, 2 * (1 - max(section.size) / (2 * shape.arc.radius)))
    return Count(layers, one.per_plane * (layers + 1), average, least)


def _check_nodes(shape: Shape, steps: Steps, diameter: float) -> None:
    """Raise InputError for cells of the pressure hardly larger than a grain."""
    if steps.averaging_width >= LEAST_WIDTH:
        return
    grain = LEAST_VOLUME * math.pi / 6 * diameter**3

    def least(across: int) -> float:
        return counted(shape, across, steps.cells_along).least

    if least(steps.cells_across) >= grain:
        return
    reason = (
        f"or numerics.averaging_width from {LEAST_WIDTH}, for a node of the gas's mesh would have"
        f" less than the volume of {LEAST_VOLUME} grains"
    )
    for across in range(steps.cells_across - 2, 1, -2):
        if least(across) >= grain:
            raise InputError("numerics.cells_across", steps.cells_across, f"{across}, {reason}")
    # volumes of nodes are as cells are long
    across, beside = steps.cells_across, ""
    if across > 2:
        across, beside = 2, " with numerics.cells_across = 2"
    count = counted(shape, across, steps.cells_along)
    most = int(count.layers * count.least / grain)
    if most < 1:
        words = f"smaller grains or a wider tube, {reason}"
        raise InputError("solids.diameter", diameter, words)
    raise InputError("numerics.cells_along", count.layers, f"at most {most}{beside}, {reason}")


def _fastest_feed(conveying: Conveying, steps: Steps, grain: Grain) -> float:
    """Speed that layers may have [m/s]; raises InputError where they are faster."""
    speed, most = conveying.solids_velocity, grain.largest_diameter / steps.gas_step
    if speed > most:
        words = (
            f"at most {most:.3g} m/s, a grain's diameter (solids.diameter ="
            f" {grain.diameter:g} m) in a step of the gas (numerics.gas_step ="
            f" {steps.gas_step:g} s), or layers would appear inside each other"
        )
        raise InputError("operation.solids_velocity", speed, words)
    return most

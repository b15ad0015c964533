# SPDX-License-Identifier: LGPL-3.0-or-later
"""A tube of grains and gas in time: what is stated, what is run, what is told of the slugs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import MISSING, dataclass, fields
from functools import cached_property
from typing import Any, ClassVar, Literal

import numpy as np
from mpi4py import MPI

from fem_tfm import signals
from fem_tfm.closures.permeability import ErgunPermeability
from fem_tfm.errors import InputError
from fem_tfm.geometry.resolution import Resolution
from fem_tfm.geometry.shapes import Bend, Duct, Pipe
from fem_tfm.geometry.surface import WallSurface
from fem_tfm.models.slug.model import DiscreteElements
from fem_tfm.models.slug.told.slices import Samples
from fem_tfm.models.slug.told.slugs import POROSITY, SHORTEST, Estimate, bulk, statistics
from fem_tfm.models.slug.tube import Conveying, Count, SlugTube, Steps, checked_feed, counted
from fem_tfm.output.result import unit_of
from fem_tfm.output.slug.files import FILES
from fem_tfm.parameters import Parameters, parameter
from fem_tfm.scenes.judged.gas import Derived, is_doubted, of_the_gas
from fem_tfm.scenes.judged.grains import LIGHT_GRAINS, of_the_grains
from fem_tfm.scenes.judged.line import of_the_line
from fem_tfm.scenes.judged.memory import refuse_beyond
from fem_tfm.scenes.judged.times import of_the_times, too_long
from fem_tfm.scenes.kinds import Kind, register
from fem_tfm.scenes.physics import Physics
from fem_tfm.scenes.recorder import Setting
from fem_tfm.scenes.scene import Answer, Scene
from fem_tfm.scenes.slug.recorder import TubeRecorder
from fem_tfm.scenes.statement import wall_time_limit

# measured on the demo: CPU time of a grain and step [s], of a gas step and node [s], memory [MB];
# on packed grains: memory of a grain with its neighbours [MB]
GRAIN_TIME, GAS_TIME, MEMORY, GRAIN_MEMORY = 5e-8, 1.1e-6, 350, 1.6e-3
# share of the tube that is told of without other wishes
STRETCH = (0.38, 0.86)
OUTPUTS = 20
# how much wider a mesh may average than is asked for, and the most cells across that are proposed
COARSE, FINEST = 1.25, 20
# porosity of a packed bed, and how much more it may resist by Ergun
PACKED, TOO_WEAK = 0.4, 2.0
# overlap of two grains over their diameter that was hardly meant
SOFTEST = 0.5
# push of the gas on a packed plug over its weight that moves nothing
WEAKEST = 0.05
# share of the samples with a filled tube that is told
FULL = 0.1
# most triangles of a wall
TRIANGLES = 1000000
# an error above this share of its value is told, and a change of the grains in the tube
UNCERTAIN, FILLING = 0.2, 0.1


@dataclass(frozen=True)
class TubeNumerics(Steps):
    """Steps in time, the mesh of the gas and the end."""

    end_time: float = parameter(31.0, "s", "end of the run", gt=0, le=1e5)
    seed: int = parameter(0, doc="of the random numbers of the feed", ge=0, le=2**32 - 1)
    time_limit: float | None = wall_time_limit()


@dataclass(frozen=True)
class TubeStart(Parameters):
    """The tube at the start."""

    state: Literal["empty", "filled"] = parameter("empty", doc="grains in the tube at the start")
    table: ClassVar[str] = "initial"


@dataclass(frozen=True)
class Averages(Parameters):
    """Where and when slugs are counted.

    Raises InputError where the stretch is empty.
    """

    begin: float | None = parameter(
        None, "s", "time from which is averaged, default 2/7 of the end", ge=0, le=1e5
    )
    low: float | None = parameter(
        None, "m", "beginning of the stretch, default 0.38 of the length", ge=0, le=1e4
    )
    high: float | None = parameter(
        None, "m", "end of the stretch, default 0.86 of the length", gt=0, le=1e4
    )
    porosity: float = parameter(POROSITY, "-", "porosity below which a slice is slug", gt=0, lt=1)
    shortest: float = parameter(SHORTEST, "m", "shortest run that counts as a slug", gt=0, le=10)
    interval: float = parameter(0.01, "s", "time between samples", gt=0, le=10)
    wall_size: float | None = parameter(
        None, "m", "edge of the wall's triangles, default a sixth of the width", gt=0, le=10
    )
    table: ClassVar[str] = "averages"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.low is not None and self.high is not None and self.high <= self.low:
            words = f"a place behind averages.low = {self.low:g} m"
            raise InputError("averages.high", self.high, words)


@dataclass(frozen=True)
class Extent:
    """Numbers of a tube that tell how much there is to do.

    nodes : of the pressure
    inner_steps : of the grains in a step of the gas
    average : least width over which the gas averages [m]
    """

    nodes: int
    inner_steps: int
    average: float


@dataclass(frozen=True)
class Slug(Scene[Physics, TubeRecorder]):
    """Grains and gas in a tube, in time.

    numerics : the end, the steps, the mesh of the gas
    initial : the tube at the start
    averages : where and when slugs are counted, and the triangles of the wall on which impacts are

    Raises InputError for values that do not fit each other.
    """

    model: DiscreteElements
    feed: Conveying = parameter(  # type: ignore[assignment]
        MISSING, doc="gas and grains that come in", key="operation"
    )
    numerics: TubeNumerics = parameter(doc="mesh and solver", factory=TubeNumerics)
    initial: TubeStart = parameter(doc="the tube at the start", factory=TubeStart)
    averages: Averages = parameter(doc="where and when slugs are counted", factory=Averages)
    solution: ClassVar[str] = "unsteady"
    # the mesh of the gas is one of `numerics`, and grains are no cloud of particles
    resolution: ClassVar[Resolution] = Resolution()  # type: ignore[misc]
    particles: ClassVar[None] = None  # type: ignore[misc]

    def __post_init__(self) -> None:
        super().__post_init__()
        begin, low, high = self.begin, *self.stretch
        if begin >= self.numerics.end_time:
            words = f"a time before numerics.end_time = {self.numerics.end_time:g} s"
            raise InputError("averages.begin", begin, words)
        for key, place in (("low", low), ("high", high)):
            if not 0 <= place <= self.geometry.length:
                words = f"a place in the tube, which is {self.geometry.length:g} m long"
                raise InputError(f"averages.{key}", place, words)
        if low >= high:
            raise InputError("averages.low", low, f"a place before averages.high = {high:g} m")
        self._check_wall()
        # what does not fit is refused before anything is written
        try:
            checked_feed(self.geometry, self.model.solids, self.feed, self.numerics)
        except InputError as error:
            density = self.model.solids.density
            if density < LIGHT_GRAINS:
                # the likely cause of grains that are too many, or too light for a step
                words = f"one in kg/m3, not in g/cm3; with it, {error}"
                raise InputError("solids.density", density, words) from None
            raise
        assert self.extent.nodes > 0
        words = "a smaller tube, or larger grains: what is inside"
        refuse_beyond(self.expected_memory, "geometry.length", self.geometry.length, words)

    def _check_wall(self) -> None:
        """The triangles of the wall belong to a law of wear, and are not too many."""
        size = self.averages.wall_size
        if size is None:
            return
        if self.model.wear is None:
            raise InputError("averages.wall_size", size, "a law walls.wear beside it")
        least = math.sqrt(2 * self.geometry.perimeter * self.geometry.length / TRIANGLES)
        if size < least:
            words = f"at least {least:.2g} m, or the wall has more than {TRIANGLES} triangles"
            raise InputError("averages.wall_size", size, words)

    def _check_feed(self) -> None:
        """The feed of a tube is checked where the tube is made."""

    def _check_sizes(self) -> None:
        """Likewise."""

    # -- derived numbers -----------------------------------------------------------------------

    @property
    def begin(self) -> float:
        """Time from which is averaged [s]."""
        given = self.averages.begin
        return 2 / 7 * self.numerics.end_time if given is None else given

    @property
    def stretch(self) -> tuple[float, float]:
        """Places between which slugs are counted [m]."""
        length, given = self.geometry.length, (self.averages.low, self.averages.high)
        low, high = (s * length if g is None else g for g, s in zip(given, STRETCH, strict=True))
        return low, high

    @property
    def interval(self) -> float:
        """Time between outputs [s]."""
        return self.output.interval or self.numerics.end_time / OUTPUTS

    @property
    def view(self) -> list[int]:
        """Coordinates of a picture: from the side, or from above where a bend turns to the side."""
        arc = self.geometry.arc
        return [2, 0] if arc is not None and arc.towards == "side" else [2, 1]

    def wall_surface(self) -> WallSurface:
        """The wall as triangles on which impacts are counted."""
        section = self.geometry.section("none")
        size = self.averages.wall_size or min(section.size) / 6
        return WallSurface(section, self.geometry.length, size, self.geometry.arc)

    def tube(self, comm: MPI.Comm = MPI.COMM_SELF) -> SlugTube:
        """The tube at its start, whose grains processes share."""
        return SlugTube(
            self.geometry,
            self.model.gas,
            self.model.solids,
            self.feed,
            self.numerics,
            full=self.initial.state == "filled",
            seed=self.numerics.seed,
            comm=comm,
        )

    def count(self, across: int) -> Count:
        """The mesh of the pressure with a number of cells across, counted without making it."""
        return counted(self.geometry, across, self.numerics.cells_along)

    @cached_property
    def extent(self) -> Extent:
        """How large the tube is, without making it."""
        found = self.count(self.numerics.cells_across)
        steps = self.numerics.grain_steps(self.model.solids)
        return Extent(found.nodes, steps, found.average)

    # -- the scene -----------------------------------------------------------------------------

    @property
    def files(self) -> Sequence[str]:
        """Names of what a run may leave in its directory."""
        return FILES

    def recorder(self, setting: Setting | None = None) -> TubeRecorder:
        """What a run tells and keeps while it works."""
        return TubeRecorder(self, setting or Setting())

    def solve(self, recorder: TubeRecorder, previous: Answer | None = None) -> Answer:
        """Take the tube to its end.

        Raises
        ------
        SolverError
            grains fly apart, or the pressure has no solution.
        KeyboardInterrupt
            the user has asked to stop; the tube stands behind a step.
        """
        if previous is not None:
            previous.close()
        tube = self.tube(recorder.comm)
        recorder.begin(tube)
        with signals.deferred() as request:
            while not recorder.done:
                tube.step()
                recorder.step()
                if request.on_any(recorder.comm):
                    raise KeyboardInterrupt
        missing = tube.start + tube.fed - tube.grains.inside() - tube.out
        found, errors = self.told(recorder)
        balances = {"grains": abs(missing) / max(tube.start + tube.fed, 1)}
        kept = recorder.samples.after(self.begin)
        return Answer("finished", found, balances, "pressure_gradient", errors=errors, state=kept)

    def judge(self, answer: Answer) -> list[str]:
        """What is uncertain: statistics of few slugs, a tube that is full or still fills."""
        said = [
            f"{name.replace('_', ' ')} {answer.quantities[name]:.3g} has a statistical error of"
            f" {error:.2g}; a longer numerics.end_time makes it smaller"
            for name, error in answer.errors.items()
            if error is not None and error > UNCERTAIN * abs(answer.quantities[name])
        ]
        samples: Samples = answer.state
        low, high = self.stretch
        if "slug_velocity" not in answer.quantities:
            said.append(
                f"no slug was followed between {low:.3g} and {high:.3g} m in"
                f" {samples.time[-1] - self.begin:.3g} s"
            )
        share = bulk(samples, high - low, self.averages.porosity)
        if share > FULL:
            said.append(
                f"the tube is full over more than the stretch of {high - low:.3g} m in"
                f" {100 * share:.0f} % of the samples: bulk, not slugs"
            )
        law, speed = self.model.wear, answer.quantities.get("impact_speed", math.inf)
        if law is not None and speed < law.slowest:
            said.append(
                f"impacts are at {speed:.2g} m/s on average, the law of wear was fitted from"
                f" {law.slowest:g} m/s on: it tells where the wall wears, not how fast"
            )
        counts = np.array(samples.count, dtype=float)
        if len(counts) >= 4:
            first, last = (float(part.mean()) for part in np.array_split(counts, 2))
            if abs(last - first) > FILLING * max(last, 1.0):
                said.append(
                    f"the tube is not steady: {first:.0f} grains in the first half of what is"
                    f" averaged, {last:.0f} in the second"
                )
        return said

    def told(self, recorder: TubeRecorder) -> tuple[dict[str, float], dict[str, float | None]]:
        """Means of the slugs and twice their standard errors."""
        samples = recorder.samples.after(self.begin)
        given = self.averages
        found = statistics(samples, *self.stretch, given.porosity, given.shortest)
        values, errors = {}, dict[str, float | None]()
        for f in fields(found):
            if unit_of(f.name) is None:
                continue
            estimate = getattr(found, f.name)
            if math.isfinite(estimate.value):
                values[f.name] = estimate.value
                errors[f.name] = 2 * estimate.error if math.isfinite(estimate.error) else None
        if (arc := self.geometry.arc) is not None:
            planes = np.linspace(0.0, self.geometry.length, len(samples.pressure[-1]))
            ends = np.array([[np.interp(z, planes, p) for z in (arc.before, arc.end)]
                             for p in samples.pressure])  # fmt: skip
            drop = Estimate.in_time(samples.time, ends[:, 0] - ends[:, 1])
            values["bend_drop"], errors["bend_drop"] = drop.value, 2 * drop.error
        if recorder.wear is not None:
            values |= recorder.wear.quantities()
        return values, errors

    def skipped(self) -> list[str]:
        """What the scene did not need, and why."""
        left_out = [
            "inertia and turbulence of the gas: its pressure diffuses through the bed",
            "heat, electric charges and humidity",
        ]
        if self.model.wear is None:
            left_out.append("wear of the walls: walls.wear")
        else:
            left_out.append("wear by grains that slide or roll: impacts alone are counted")
        if self.model.gas.permeability.name == "carman-kozeny":
            left_out.append("inertial resistance of the bed: closures.permeability")
        return left_out

    def derived(self) -> list[Derived]:
        """Numbers of gas and grains, and what they give away."""
        found = [*of_the_gas(self), *of_the_line(self)]
        found += of_the_times(self, any(number.doubt for number in found))
        blamed = is_doubted(found)
        found += of_the_grains(self, self.model.solids, "solids", blamed)
        blamed = any(number.doubt for number in found)
        return [*found, *self._overlaps(blamed), self._push(blamed), self._inertia(blamed)]

    def _push(self, blamed: bool) -> Derived:
        """Force of the gas on a packed plug over the weight of the plug.

        blamed : whether another number is doubted, from which this follows
        """
        gas, grains, speed = self.model.gas, self.model.solids, self.feed.gas_velocity
        a, b = gas.permeability.resistance(PACKED, gas, grains.diameter)
        weight, doubt = grains.density * (1 - PACKED) * self.feed.gravity, ""
        push = (a + b * speed) * speed / weight if weight > 0 else math.inf
        if push < WEAKEST and not blamed:
            doubt = (
                "the gas moves no plug; is operation.gas_superficial_velocity ="
                f" {speed:g} in m/s, not in m3/s or kg/s?"
            )
        return Derived("push of the gas on a packed plug over its weight", push, "", doubt)

    def _overlaps(self, blamed: bool) -> Iterator[Derived]:
        """Whether contacts are so soft that grains pass through each other or through the wall.

        Two grains that meet at the velocity of the gas overlap by about v t_c/pi, with the time
        t_c of the contact; exactly so with a linear spring.

        blamed : whether another number is doubted, from which this follows
        """
        grains = self.model.solids
        pairs = [("closures.contact", grains.contact, 0.5, "meet")]
        if grains.wall is not None:
            pairs.append(("walls.contact", grains.wall, 1.0, "meet the wall"))
        for key, contact, share, words in pairs:
            touching = contact.contact_time(share * grains.mean_mass, share * grains.diameter / 2)
            overlap = self.feed.gas_velocity * touching / math.pi / grains.diameter
            doubt, linear = "", hasattr(contact, "stiffness")
            if overlap > SOFTEST and not blamed:
                name = "stiffness" if linear else "young_modulus"
                units = "N/m, not in N/mm" if linear else "Pa, not in MPa or GPa"
                doubt = f"such contacts let grains pass through; is {key}.{name} in {units}?"
            yield Derived(f"overlap of grains that {words}, in diameters", overlap, "", doubt)

    def _inertia(self, blamed: bool) -> Derived:
        """Whether the gas is too fast for a law of resistance without inertia, by Ergun's.

        blamed : whether another number is doubted, from which this follows
        """
        gas, diameter, speed = self.model.gas, self.model.solids.diameter, self.feed.gas_velocity
        reynolds, doubt = gas.density * speed * diameter / gas.viscosity, ""
        (a, b), (viscous, inertial) = (
            law.resistance(PACKED, gas, diameter) for law in (gas.permeability, ErgunPermeability())
        )
        factor = (viscous + inertial * speed) / (a + b * speed)
        if factor > TOO_WEAK and not blamed:
            doubt = (
                f"a packed bed resists such a gas {factor:.2g} times as much by Ergun as by"
                f" closures.permeability = {gas.permeability.name!r}, which is for small Reynolds"
                " numbers; 'ergun' has the inertial part, so that the pressure drop is not too"
                " small"
            )
        return Derived("Reynolds number of a grain in the gas", reynolds, "", doubt)

    def advice(self) -> list[str]:
        """What the user probably did not mean, one sentence each."""
        said, numerics = [], self.numerics
        width, diameter = numerics.averaging_width, self.model.solids.diameter
        least = self.extent.average / diameter
        if least > COARSE * width:
            said.append(
                f"the mesh of the gas averages over {least:.2g} grain diameters, more than"
                f" numerics.averaging_width = {width:g}; {self._finer(COARSE * width * diameter)},"
                " or the gas finds no way over the bed"
            )
        if numerics.gas_step > 1e-3:
            said.append(
                f"numerics.gas_step = {numerics.gas_step:g} s is long; up to 1e-3 s it has no"
                " influence on the slugs of 1.4 mm grains"
            )
        if numerics.end_time - self.begin < 4.0:
            said.append(
                f"{numerics.end_time - self.begin:.3g} s are few for statistics of slugs; errors"
                " come from blocks of 2 s"
            )
        return said

    def _finer(self, average: float) -> str:
        """Words that tell the cells across which average over a width [m]."""
        across = self.numerics.cells_across
        for finer in range(across + across % 2, FINEST + 1, 2):
            if self.count(finer).average <= average:
                return f"raise numerics.cells_across = {across} to {finer}"
        return f"raise numerics.averaging_width, for {FINEST} cells across are too few"

    @property
    def expected_grains(self) -> float:
        """About how many grains are inside when slugs form: a fifth of the volume."""
        grain = self.model.solids.mean_mass / self.model.solids.density
        return float(0.2 * self.geometry.length * self.geometry.area / grain)

    @property
    def expected_memory(self) -> float:
        """About the memory of a run [MB]."""
        return MEMORY + GRAIN_MEMORY * self.expected_grains

    def expected_time(self) -> float:
        """About the CPU time of a run [s]."""
        extent, steps = self.extent, self.numerics.end_time / self.numerics.gas_step
        grains = extent.inner_steps * self.expected_grains
        return float(steps * (GAS_TIME * extent.nodes + grains * GRAIN_TIME))

    def describe(self) -> dict[str, Any]:
        """What would be solved, what is left out, and what it would take."""
        extent, feed, model, grains = self.extent, self.feed, self.model, self.expected_grains
        per_second = feed.solids_mass_flow / model.solids.mean_mass
        return {
            "title": self.title or "untitled",
            "solved": "slug conveying by discrete elements in the pressure field of the gas",
            "line": self.geometry.words,
            "given": (
                f"gas {feed.gas_velocity:g} m/s, grains {feed.solids_mass_flow:g} kg/s"
                f" ({per_second:.0f} a second); found: pressure drop, slugs"
            ),
            "closures": [
                f"{law.family}{' with the wall' if law is model.solids.wall else ''}: {law.name}"
                for law in model.laws()
            ],
            "skipped": self.left_out(),
            "inferred": list(self.inferred) or "nothing",
            "numbers": self.numbers() or "none",
            "warnings": [*self.warnings(), *too_long(self)] or "none",
            "meshes": f"{extent.nodes} nodes of the pressure",
            "steps": (
                f"{self.numerics.gas_step:g} s for the gas, {extent.inner_steps} times shorter for"
                " the grains"
            ),
            "averages": (
                f"from {self.begin:.3g} s, between {self.stretch[0]:.3g} and"
                f" {self.stretch[1]:.3g} m"
            ),
            "memory": f"about {self.expected_memory:.0f} MB",
            "time": f"about {self.expected_time():.0f} s, if {grains:.0f} grains are inside",
        }


UNREAD = (
    "output.stations", "output.probes", "output.sections", "output.fields",
    "geometry.symmetry",
)  # fmt: skip
register(Kind("slug", Slug, DiscreteElements, (Pipe, Duct, Bend), Physics, {}, UNREAD))

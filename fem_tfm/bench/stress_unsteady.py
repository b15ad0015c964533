# SPDX-License-Identifier: LGPL-3.0-or-later
"""Random unsteady scenes: the share that reaches its end, its largest velocities and mass errors.

Every scene is drawn from a seed of its own number, so that one can be run again alone, and two
versions of the scheme face the same ones. Shapes, inclinations, materials, laws, turbulence, order,
Courant number, start, schedules and blocked spells are all drawn. A scene must be possible: what a
blocked outlet holds and what lies in the line at the start fill at most a part of it, and the gas
that must pass through packed grains drops a pressure that such a line may have.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI

from fem_tfm.bench.stress import (
    LARGEST_GRAIN,
    LEFT_OUT,
    PACKED_FRACTION,
    PLASTIC,
    nested,
    without_numbers,
)
from fem_tfm.case import Case
from fem_tfm.closures import make, names
from fem_tfm.closures.drag import Ergun
from fem_tfm.correlations import terminal_velocity
from fem_tfm.errors import InputError, SolverError
from fem_tfm.materials import Gas, Solids
from fem_tfm.scenes.recorder import Setting
from fem_tfm.scenes.unsteady import FlowRecorder, Unsteady

SEED, SCENES = 2026, 200
# ranges of the numbers: low, high, and whether the logarithm is uniform
RANGES = {
    "geometry.diameter": (8e-3, 0.1, True),
    "solids.diameter": (5e-5, 3e-3, True),
    "solids.density": (700.0, 3000.0, False),
    "solids.restitution": (0.5, 0.99, False),
    "gas.density": (1.0, 40.0, True),
    "operation.gas_superficial_velocity": (1.0, 25.0, True),
    "operation.solids_fraction": (0.005, 0.45, True),
    "numerics.courant": (1.0, 5.0, False),
}
PACKING = 0.63
# shares of the scenes, of each shape, angle and start in turn
SHAPES = {"pipe": 0.5, "duct": 0.25, "bend": 0.25}
LEVEL, UPRIGHT = 0.3, 0.25
STARTS = {"rest": 0.35, "bed": 0.35, "inlet": 0.3}
BLOCKED, SCHEDULED, COMPRESSIBLE, TRANSPORTED, ALGEBRAIC, FEEDING = 0.25, 0.4, 0.15, 0.4, 0.15, 0.2
# length over diameter, slices, velocity of the grains over that of the gas, fillings of the line
# by the gas from start to end
SLENDERNESS, SLICES, SLIP, PASSES = (6.0, 15.0), (10, 20), (0.3, 1.0), (1.0, 2.5)
# largest share of the line that a bed and what a blocked outlet holds may fill together, and the
# largest drop of the gas through them [Pa]
FILLED, LARGEST_DROP = 0.5, 3e5
GAS_TEMPERATURE, GAS_CONSTANT, VISCOSITY = 293.0, 296.8, 1.8e-5
# a gas above this share of the terminal velocity carries its grains; else what is fed and what lies
# there at the start fill at most this share of the line
CARRYING, HELD, G = 2.0, 0.8, 9.81
# steps after which a scene counts as stuck
MOST_STEPS = 3000
# velocity over the largest that is fed from which a scene is told apart
FAST = 20.0


@dataclass(frozen=True)
class Outcome:
    """What became of one scene; `reason` is empty where it ended.

    reached : time over the end
    steps, cuts : steps taken, and taken back
    gas, solids : largest velocity of a phase in a cell over the largest that is fed
    mass_error : relative, the larger of both phases
    """

    number: int
    reason: str
    reached: float
    steps: int
    cuts: int
    cpu_seconds: float
    gas: float
    solids: float
    mass_error: float

    @property
    def ended(self) -> bool:
        """Whether the end was reached."""
        return not self.reason

    @property
    def cause(self) -> str:
        """The reason without its numbers, so that equal ones can be counted."""
        return without_numbers(self.reason)


class Watch(FlowRecorder):
    """A recorder that writes nothing and keeps extremes.

    gas, solids : largest velocities of the phases [m/s]
    mass_error : the largest
    cuts : steps that were taken back
    """

    def __init__(self, scene: Unsteady) -> None:
        self.gas = self.solids = self.mass_error = 0.0
        self.cuts = 0
        super().__init__(scene, Setting())

    def log(self, text: str) -> None:
        """Count what was taken back."""
        self.cuts += "taken back" in text

    def step(self) -> None:
        """Keep the extremes of a step.

        Raises
        ------
        SolverError
            there were too many steps.
        """
        super().step()
        now, cells = self.section.flow.now, self.section.flow.cells
        own = slice(0, cells.owned)
        of_gas, of_solids = (
            cells.largest(np.linalg.norm(u[own], axis=1)) for u in (now.u_g, now.u_s)
        )
        self.gas, self.solids = max(self.gas, of_gas), max(self.solids, of_solids)
        self.mass_error = max(self.mass_error, self.section.report.mass_error)
        if self.stepping.count >= MOST_STEPS:
            raise SolverError(f"{MOST_STEPS} steps have not reached the end")


# -- the scenes --------------------------------------------------------------------------------


def _number(rng: np.random.Generator, low: float, high: float, logarithmic: bool = False) -> float:
    if logarithmic:
        return math.exp(rng.uniform(math.log(low), math.log(high)))
    return float(rng.uniform(low, high))


def _choice(rng: np.random.Generator, shares: dict[str, float]) -> str:
    return str(rng.choice(list(shares), p=list(shares.values())))


def _known(family: str, transported: bool) -> list[str]:
    """Names of a family that fit a gas with or without transported turbulence."""
    laws: dict[str, Any] = {n: make(family, n) for n in names(family) if n not in LEFT_OUT}
    return [n for n, law in laws.items() if transported or not getattr(law, "needs_k", False)]


def _laws(rng: np.random.Generator) -> dict[str, Any]:
    """One law of each family, which go together."""
    transported = rng.uniform() < TRANSPORTED

    def of(family: str, *but: str) -> str:
        known = [name for name in _known(family, transported) if name not in but]
        return str(rng.choice(known))

    turbulences: dict[str, Any] = {name: make("turbulence", name) for name in names("turbulence")}
    fitting = [n for n, law in turbulences.items() if bool(law.transported) == transported]
    found: dict[str, Any] = {
        "closures.drag": of("drag", "constant"),
        "closures.radial": of("radial"),
        "closures.granular": of("granular"),
        "closures.friction": of("friction"),
        "closures.turbulence": str(rng.choice(fitting)),
        "walls.solids": of("solids-wall"),
    }
    if found["closures.radial"] == "carnahan-starling" and found["closures.friction"] == "none":
        # nothing would keep the grains apart
        found["closures.radial"] = "savage"
    # a turbulence with a wall law needs one
    found["walls.gas"] = "log-law" if transported else of("gas-wall")
    if transported:
        found |= {f"closures.{name}": of(name) for name in ("dispersed", "dispersion")}
    found["closures.theta"] = "algebraic" if rng.uniform() < ALGEBRAIC else "transport"
    found["closures.friction_feeds_theta"] = bool(rng.uniform() < FEEDING)
    if found["closures.friction"] in PLASTIC:
        found["solids.friction_limit"] = PACKED_FRACTION
    return found


def _line(rng: np.random.Generator, size: float) -> dict[str, Any]:
    """Shape, angle and slices of a line of a width [m]."""
    shape, length = _choice(rng, SHAPES), size * _number(rng, *SLENDERNESS)
    share, angle = rng.uniform(), _number(rng, -90, 90)
    if share < LEVEL + UPRIGHT:
        angle = 0.0 if share < LEVEL else 90.0
    found: dict[str, Any] = {
        "geometry.shape": shape,
        "geometry.length": length,
        "geometry.inclination_deg": angle,
        "numerics.level": 1,
        "numerics.wall_grading": 0.25,
        "numerics.axial_cells": int(rng.integers(*SLICES, endpoint=True)),
    }
    if shape == "duct":
        found |= {"geometry.width": size, "geometry.height": size * _number(rng, 0.5, 2.0)}
        return found
    found["geometry.diameter"] = size
    if shape == "bend":
        bend = math.radians(_number(rng, 30, 120))
        radius = _number(rng, 0.3, 0.7) * length / bend
        found |= {
            "geometry.bend_angle_deg": math.degrees(bend),
            "geometry.bend_radius": max(radius, size),
            "geometry.length": max(length, 1.6 * size * bend),
            "geometry.bend_towards": str(rng.choice(["up", "down", "side"])),
        }
    return found


def _start(rng: np.random.Generator, line: dict[str, Any]) -> tuple[dict[str, Any], float]:
    """Initial state, and the share of the line that it would fill if it were packed."""
    state, length = _choice(rng, STARTS), line["geometry.length"]
    found: dict[str, Any] = {"initial.state": state}
    if state != "bed":
        held = line["operation.solids_fraction"] if state == "inlet" else 0.0
        return found, held / PACKED_FRACTION
    size = "geometry.height" if "geometry.height" in line else "geometry.diameter"
    height: float = line[size]
    begin, extent = _number(rng, 0, 0.5), _number(rng, 0.1, FILLED)
    found |= {
        "initial.bed_fraction": _number(rng, 0.2, 0.6),
        "initial.bed_start": begin * length if rng.uniform() < 0.7 else 0.0,
    }
    if rng.uniform() < 0.5:
        found["initial.bed_height"] = height * _number(rng, 0.2, 0.9)
    if rng.uniform() < 0.7 or "initial.bed_height" not in found:
        found["initial.bed_end"] = found["initial.bed_start"] + extent * length
    end = found.get("initial.bed_end", length)
    return found, (min(end, length) - found["initial.bed_start"]) / length


def _spells(rng: np.random.Generator, values: dict[str, Any], packed: float, end: float) -> None:
    """Add schedules and blocked spells until the end [s] to the values of a scene.

    packed : share of the line that is packed at the start
    """
    if rng.uniform() < SCHEDULED:
        times = np.sort(rng.uniform(0, end, 3))
        for phase in ("gas", "solids"):
            low = 0.3 if phase == "gas" else 0.0
            factors = rng.uniform(low, 1.3, 3)
            if rng.uniform() < 0.5:
                pairs = zip(times, factors, strict=True)
                values[f"operation.{phase}_schedule"] = [[float(t), float(f)] for t, f in pairs]
    if rng.uniform() < BLOCKED:
        fraction, speed = (values[f"operation.solids_{key}"] for key in ("fraction", "velocity"))
        room = max(FILLED - packed, 0.1) * PACKED_FRACTION * values["geometry.length"]
        length = min(_number(rng, 0.2, 0.7) * end, room / (1.3 * fraction * speed))
        begin = rng.uniform() * (end - length)
        values["operation.outlet_blocked"] = [[begin, begin + length]]


def _slowest(values: dict[str, Any], packed: float) -> float:
    """Gas velocity at which the packed share of the line drops no more than it may [m/s]."""
    length, void = packed * values["geometry.length"], 1 - PACKED_FRACTION
    gas = Gas(density=values["gas.density"], viscosity=VISCOSITY)
    grains = Solids(density=values["solids.density"], diameter=values["solids.diameter"])
    speed, law = values["operation.gas_superficial_velocity"], Ergun()
    while (
        law.specific(PACKED_FRACTION, speed / void, gas, grains)
        * (PACKED_FRACTION * speed / void**2 * length)
        > LARGEST_DROP
    ):
        speed *= 0.8
    return float(speed)


def _held(values: dict[str, Any], packed: float, end: float) -> float:
    """Fraction fed until the end [s] that finds room in the line if no gas carries it away [-]."""
    fraction, speed = (values[f"operation.solids_{key}"] for key in ("fraction", "velocity"))
    gas = Gas(density=values["gas.density"], viscosity=VISCOSITY)
    grains = Solids(density=values["solids.density"], diameter=values["solids.diameter"])
    if values["operation.gas_superficial_velocity"] > CARRYING * terminal_velocity(gas, grains, G):
        return float(fraction)
    room = max(HELD - packed, 0.1) * PACKED_FRACTION * values["geometry.length"]
    return float(min(fraction, room / (1.3 * speed * end)))


def scene(number: int, seed: int = SEED) -> Case:
    """The scene of a number, from 1 on."""
    rng = np.random.default_rng([seed, number])
    values: dict[str, Any] = {}
    for key, (low, high, logarithmic) in RANGES.items():
        if key == "solids.diameter":
            high = min(high, LARGEST_GRAIN * values["geometry.diameter"])
        values[key] = _number(rng, low, high, logarithmic)
    values |= _laws(rng) | _line(rng, values.pop("geometry.diameter"))
    start, packed = _start(rng, values)
    values |= start
    values["operation.gas_superficial_velocity"] = _slowest(values, max(packed, FILLED))
    gas = values["operation.gas_superficial_velocity"]
    slip = _number(rng, *SLIP)
    values["operation.solids_velocity"] = slip * gas / (1 - values["operation.solids_fraction"])
    end = _number(rng, *PASSES) * values["geometry.length"] / gas
    values["operation.solids_fraction"] = _held(values, packed, end)
    _spells(rng, values, packed, end)
    if rng.uniform() < COMPRESSIBLE:
        pressure = values.pop("gas.density") * GAS_CONSTANT * GAS_TEMPERATURE
        values |= {
            "gas.pressure": pressure,
            "gas.temperature": GAS_TEMPERATURE,
            "gas.gas_constant": GAS_CONSTANT,
            "gas.compressible": True,
        }
    values |= {
        "gas.viscosity": VISCOSITY,
        "solids.packing_limit": PACKING,
        "numerics.order": int(rng.integers(2)),
        "numerics.end_time": end,
    }
    return Case.from_dict({"solution": "unsteady"} | nested(values))


# -- running them ------------------------------------------------------------------------------


def solve(case: Case, number: int = 0) -> Outcome:
    """Take one scene to its end."""
    given, began, reason = case.scene, time.process_time(), ""
    assert isinstance(given, Unsteady)
    watch = Watch(given)
    try:
        given.solve(watch).close()
    except SolverError as error:
        reason = str(error)
    except (ArithmeticError, RuntimeError, ValueError) as error:
        reason = f"not a SolverError but {type(error).__name__}: {error}"
    stepping = watch.stepping
    fed = max(
        max(flow.mean_velocity("gas"), flow.solids_velocity)
        for flow in map(given.inflow, [0.0, *given.feed.corners(), given.numerics.end_time])
    )
    return Outcome(
        number,
        reason,
        stepping.time / given.numerics.end_time,
        stepping.count,
        watch.cuts,
        time.process_time() - began,
        watch.gas / fed,
        watch.solids / fed,
        watch.mass_error,
    )


def describe(case: Case) -> str:
    """A scene in a few lines."""
    given = case.scene
    assert isinstance(given, Unsteady)
    model, numerics, feed = given.model, given.numerics, given.feed
    laws = [case[f"closures.{key}.model"] for key in ("drag", "radial", "granular", "friction")]
    laws += [case[f"closures.{key}.model"] for key in ("turbulence", "dispersed", "dispersion")]
    laws += [case["walls.gas.model"], case["walls.solids.model"], case["closures.theta"]]
    solids, start, shape = model.solids, given.initial, given.geometry
    assert solids is not None
    spells = [
        key for key in ("gas_schedule", "solids_schedule", "outlet_blocked") if getattr(feed, key)
    ]
    return "\n".join(
        (
            f"  {', '.join(laws)}",
            f"  {type(shape).__name__} {shape.hydraulic_diameter:.3g} m, {shape.length:.3g} m,"
            f" {shape.inclination_deg:.0f} deg; gas {model.gas.density:.3g} kg/m3"
            f"{' ideal' * model.gas.compressible}, {feed.gas_velocity:.3g} m/s; grains"
            f" {solids.diameter:.3g} m, {solids.density:.4g} kg/m3, {feed.solids_fraction:.3g} at"
            f" {feed.solids_velocity:.3g} m/s",
            f"  order {numerics.order}, Courant {numerics.courant:.2g}, {numerics.end_time:.3g} s,"
            f" start {start.state}"
            + (f" of {start.bed_fraction:.2g}" if start.state == "bed" else "")
            + "".join(f", {key}" for key in spells),
        )
    )


def solve_all(numbers: Iterable[int]) -> Iterator[Outcome]:
    """Solve scenes one after another and print how each of them ended."""
    for number in numbers:
        case = scene(number)
        outcome = solve(case, number)
        ended = "ended" if outcome.ended else f"FAILED at {outcome.reached:.3f} of its time"
        _tell(
            f"{number:4d}  {ended:<8} {outcome.steps:5d} steps, {outcome.cuts:3d} taken back, gas"
            f" {outcome.gas:.3g}, solids {outcome.solids:.3g}, mass {outcome.mass_error:.1e},"
            f" {outcome.cpu_seconds:5.1f} CPU s"
        )
        if not outcome.ended:
            _tell(f"  {outcome.reason}")
        if not outcome.ended or max(outcome.gas, outcome.solids) > FAST:
            _tell(describe(case))
        yield outcome


def summary(outcomes: list[Outcome]) -> str:
    """Share that ended, extremes, and a table of the causes of the rest."""
    done = [o for o in outcomes if o.ended]
    lines = [
        f"stress-unsteady: {len(done)} of {len(outcomes)} scenes ended"
        f" ({100 * len(done) / len(outcomes):.1f} %), {sum(o.cpu_seconds for o in outcomes):.0f}"
        f" CPU s, {sum(o.steps for o in outcomes)} steps, {sum(o.cuts for o in outcomes)} of them"
        " taken back"
    ]
    if done:
        for phase in ("gas", "solids"):
            middle, high, most = np.percentile([getattr(o, phase) for o in done], [50, 95, 100])
            lines.append(
                f"largest velocity of the {phase} over the one fed: median {middle:.2g}, 95 %"
                f" below {high:.3g}, largest {most:.3g}"
            )
        lines.append(f"largest mass error: {max(o.mass_error for o in done):.1e}")
    causes = Counter(o.cause for o in outcomes if not o.ended)
    lines += [f"{count:4d}  {cause}" for cause, count in causes.most_common()]
    return "\n".join(lines)


def numbers(text: str) -> tuple[int, int]:
    """First and last number of scenes given as "7" or "1-50"; raises InputError for others."""
    first, _, last = text.partition("-")
    try:
        found = int(first), int(last or first)
    except ValueError:
        found = 0, 0
    if not 1 <= found[0] <= found[1]:
        raise InputError("--scenes", text, "numbers from 1 on, as 7 or 1-50")
    return found


def run(first: int = 1, last: int = SCENES) -> str:
    """Solve the scenes from one number to another, print each, and return the summary."""
    return summary(list(solve_all(range(first, last + 1))))


def _tell(text: str) -> None:
    if MPI.COMM_WORLD.rank == 0:
        print(text, flush=True)

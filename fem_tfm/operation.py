# SPDX-License-Identifier: LGPL-3.0-or-later
"""How a line is driven: what is fed, how it enters, and from which state it starts. SI units."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, dataclass
from itertools import pairwise
from typing import Any, ClassVar, Literal

import numpy as np

from fem_tfm.correlations import feed_velocity
from fem_tfm.errors import InputError
from fem_tfm.materials import Gas, Solids
from fem_tfm.parameters import Parameters, parameter

# ways to state the feed of solids, of which one is given
FEEDS = ("solids_fraction", "solids_superficial_velocity", "solids_mass_flow")
Pairs = tuple[tuple[float, float], ...]


def _function_of_time(points: Any, key: str) -> Any:
    """Refuse a schedule whose times do not grow, or whose factors flow backwards or not at all."""
    if _is_pairs(points) and points:
        times = [time for time, _ in points]
        grow = all(a < b for a, b in pairwise(times))
        sound = all(0 <= time < np.inf and 0 <= factor < np.inf for time, factor in points)
        if not (grow and sound and any(factor > 0 for _, factor in points)):
            words = (
                "pairs [time, factor] with times that grow from 0 s or later, factors >= 0, and one"
                " above 0"
            )
            raise InputError(key, points, words)
    return points


def _intervals(points: Any, key: str) -> Any:
    """Refuse intervals that run backwards, overlap or begin before the start."""
    if _is_pairs(points):
        flat = [time for pair in points for time in pair]
        if any(a < 0 for a in flat) or any(a >= b for a, b in pairwise(flat)):
            raise InputError(key, points, "pairs [from, to] of times that grow from 0 s or later")
    return points


def _is_pairs(points: Any) -> bool:
    """Whether a value has the shape of a list of pairs of numbers; others are refused by kind."""
    return isinstance(points, list | tuple) and all(
        isinstance(pair, list | tuple)
        and len(pair) == 2
        and all(isinstance(number, int | float) for number in pair)
        for pair in points
    )


def _schedule(unit: str, doc: str, convert: Callable[[Any, str], Any]) -> Any:
    return parameter((), unit, doc, convert=convert)


@dataclass(frozen=True)
class Feed(Parameters):
    """What is fed: the flux of gas, and the hold-up or the flux of solids.

    An unsteady flow may change with time: a schedule lists [time, factor], linear between them and
    constant before the first and after the last.

    Raises InputError for a number out of range, or several feeds of solids.
    """

    gas_velocity: float = parameter(
        MISSING,
        "m/s",
        "gas volume flow over the area of the section",
        key="operation.gas_superficial_velocity",
        gt=0,
        le=300,
    )
    solids_fraction: float | None = parameter(
        None, "-", "mean solids fraction of the section (hold-up)", gt=0, lt=0.7406
    )
    solids_velocity: float | None = parameter(
        None, "m/s", "with solids_fraction: their product is the solids flux", gt=0, le=300
    )
    solids_superficial_velocity: float | None = parameter(
        None, "m/s", "solids volume flow over the area of the section", gt=0, le=300
    )
    solids_mass_flow: float | None = parameter(None, "kg/s", "mass flow of solids", gt=0, le=1e5)
    outlet_pressure: float | None = parameter(None, "Pa", "absolute outlet pressure", gt=0, le=1e9)
    gravity: float = parameter(9.81, "m/s2", "acceleration of gravity", ge=0, le=1000)
    gas_schedule: Pairs = _schedule(
        "s, -", "gas velocity over time, over the one given", _function_of_time
    )
    solids_schedule: Pairs = _schedule(
        "s, -", "solids that enter over time, over what is given", _function_of_time
    )
    outlet_blocked: Pairs = _schedule(
        "s", "times [from, to] in which the outlet holds the solids", _intervals
    )
    table: ClassVar[str] = "operation"

    def __post_init__(self) -> None:
        super().__post_init__()
        given = [name for name in FEEDS if getattr(self, name) is not None]
        if len(given) > 1:
            key = f"operation.{given[-1]}"
            words = f"exactly one of {', '.join(FEEDS)}"
            raise InputError(key, getattr(self, given[-1]), words)
        if self.solids_velocity is not None and self.solids_fraction is None:
            words = "operation.solids_fraction beside it"
            raise InputError("operation.solids_velocity", self.solids_velocity, words)

    @property
    def solids_key(self) -> str | None:
        """Name of the feed of solids that is given, None for the gas alone."""
        return next((name for name in FEEDS if getattr(self, name) is not None), None)

    def solids(self, area: float, density: float) -> tuple[Literal["holdup", "flux"], float]:
        """("holdup", mean alpha_s), or ("flux", superficial solids velocity j_s [m/s]).

        j_s = alpha_s u_s, or j_s = M_s/(rho_s A) for a mass flow M_s.

        area : A of the section [m2]
        density : rho_s of the grains [kg/m3]
        """
        if self.solids_mass_flow is not None:
            return "flux", self.solids_mass_flow / (density * area)
        if self.solids_superficial_velocity is not None:
            return "flux", self.solids_superficial_velocity
        assert self.solids_fraction is not None
        if self.solids_velocity is not None:
            return "flux", self.solids_fraction * self.solids_velocity
        return "holdup", self.solids_fraction

    def entering(
        self, gas: Gas, solids: Solids, area: float, diameter: float
    ) -> tuple[float, float]:
        """alpha_s [-] and mean velocity u_s [m/s] of the solids that enter a line.

        As given, or u_s from the correlation of the feeder and alpha_s = j_s/u_s.

        diameter : hydraulic diameter of the section [m]

        Raises
        ------
        InputError
            the feed does not tell them.
        """
        if self.solids_fraction is not None:
            if self.solids_velocity is None:
                words = "the velocity at which the solids enter, beside solids_fraction"
                raise InputError("operation.solids_velocity", None, words)
            return self.solids_fraction, self.solids_velocity
        _, flux = self.solids(area, solids.density)
        speed = feed_velocity(self.gas_velocity, diameter, gas, solids)
        if speed <= 0 or flux / speed >= solids.packing_limit:
            words = (
                "less, or operation.solids_fraction with solids_velocity in its place: at"
                f" {speed:.3g} m/s, at which a feeder lets grains in by correlation, this flux of"
                f" {flux:.3g} m/s superficial would be packed"
            )
            key = self.solids_key
            raise InputError(f"operation.{key}", getattr(self, str(key)), words)
        return flux / speed, speed

    def factors(self, time: float) -> tuple[float, float, bool]:
        """Factors on gas and solids at a time [s], and whether the outlet is blocked."""
        blocked = any(begin < time <= end for begin, end in self.outlet_blocked)
        return _factor(self.gas_schedule, time), _factor(self.solids_schedule, time), blocked

    def corners(self) -> list[float]:
        """Times at which something that is fed changes its course [s]."""
        schedules = (self.gas_schedule, self.solids_schedule)
        times = [time for schedule in schedules for time, _ in schedule]
        return times + [time for pair in self.outlet_blocked for time in pair]


def _factor(schedule: Pairs, time: float) -> float:
    """A function of time from its corners, 1 without any [-]."""
    if not schedule:
        return 1.0
    times, factors = zip(*schedule, strict=True)
    return float(np.interp(time, times, factors))


@dataclass(frozen=True)
class Inlet(Parameters):
    """How the flow enters a line whose development is solved.

    A gas by Reynolds stresses enters uniformly, whatever the profile.
    """

    profile: Literal["power-law", "uniform"] = parameter(
        "power-law", doc="velocities of both phases at the inlet, power 1/7 or uniform"
    )
    solids_intensity: float = parameter(
        0.05, "-", "agitation and turbulence of the solids over their mean velocity", gt=0, le=1
    )
    gas_intensity: float = parameter(
        0.1, "-", "turbulence of the gas over its mean velocity", gt=0, le=1
    )
    length_scale: float = parameter(
        0.07, "-", "length of the eddies over the hydraulic diameter", gt=0, le=1
    )
    table: ClassVar[str] = "inlet"


@dataclass(frozen=True)
class Initial(Parameters):
    """The flow from which an unsteady solution starts; nothing moves but with state = 'inlet'."""

    state: Literal["rest", "bed", "inlet"] = parameter(
        "rest", doc="gas alone, a bed of solids, or the whole line filled with what enters"
    )
    bed_fraction: float = parameter(0.55, "-", "solids fraction of the bed", gt=0, lt=0.7406)
    bed_height: float | None = parameter(
        None, "m", "height of the bed above the lowest wall, default all of it", gt=0, le=100
    )
    bed_start: float = parameter(0.0, "m", "where along the line the bed begins", ge=0, le=1e5)
    bed_end: float | None = parameter(
        None, "m", "where along the line the bed ends, default the outlet", gt=0, le=1e5
    )
    table: ClassVar[str] = "initial"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.bed_end is not None and self.bed_end <= self.bed_start:
            words = f"a place behind initial.bed_start = {self.bed_start:g} m"
            raise InputError("initial.bed_end", self.bed_end, words)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""A flow on its way downstream: the station at hand and the table of all behind it.

Each station is a section solved with implicit differences to the two before it, so that a line
costs some hundred sections and no three-dimensional mesh. What the stations conserve is told: mass
of each phase, and what is integrated along the axis by the same differences. Particles may go along
and give the flow what they take from it, slab by slab.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, Protocol

import numpy as np
from dolfinx import fem
from mpi4py import MPI

from fem_tfm.models.section import Section
from fem_tfm.solvers.marching import March, MarchControl, Place, Stop

# the flow counts as developed where nothing is further from the outlet than this
DEVELOPED = 0.01


class Sums:
    """Integrals along the axis by the backward differences of the march itself.

    w_0 Q + w_1 Q_old + w_2 Q_older = rate. A balance of the stations is then one of the integrals,
    to round-off.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.now = dict.fromkeys(names, 0.0)
        self.old = dict(self.now)

    def advance(self, weights: Sequence[float], rates: Mapping[str, float]) -> None:
        """Go to the next station."""
        found = {
            name: (rate - weights[1] * self.now[name] - weights[2] * self.old[name]) / weights[0]
            for name, rate in rates.items()
        }
        self.now, self.old = found, self.now


class Coupler(Protocol):
    """What goes down the line beside the flow and exchanges something with it, such as particles.

    A slab between two stations is crossed again and again, each time from the same state at its
    beginning, until it is accepted or rejected.
    """

    def begin(self, start: float, end: float) -> None:
        """A slab is tried, from the last accepted station to a new one [m]."""
        ...

    def trace(self, station: Any) -> float:
        """Cross the slab with the flow at hand and tell its station what that gives to the flow.

        Returns the relative change of what it gives. May raise LinearSolveError, upon which the
        slab is tried again with a smaller step.
        """
        ...

    def accept(self) -> None:
        """The slab counts as it was crossed last."""
        ...

    def reject(self) -> None:
        """Back to the beginning of the slab; may be called when no slab is tried."""
        ...

    def state(self) -> Mapping[str, np.ndarray]:
        """Whole arrays from which `restore` goes on, on rank 0 at least (collective)."""
        ...

    def restore(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Put back what `state` gave, whole on every rank."""
        ...


class _Slab:
    """A line with its coupler, as the march sees them."""

    def __init__(self, line: Line, coupler: Coupler) -> None:
        self.line, self.coupler = line, coupler

    def begin(self, start: float, end: float) -> None:
        self.line.slab_begins(end - start)
        self.coupler.begin(start, end)

    def trace(self) -> float:
        self.line.carry()
        return self.coupler.trace(self.line.station)

    def accept(self) -> None:
        self.coupler.accept()
        self.line.slab_accepted()

    def reject(self) -> None:
        self.coupler.reject()
        self.line.slab_rejected()


class Line(ABC):
    """A developing flow: subclasses tell what a station of their model adds to the table.

    Parameters
    ----------
    station : section that develops
    length : of the line [m]
    control : steps of the march
    outlet_pressure : absolute [Pa], 0 where pressures are told above the outlet's
    summed : names of integrals along the axis
    coupler : what goes along with the flow, None for a flow alone

    Attributes
    ----------
    rows : the table, a row a station
    place : where the march is, None before it begins
    """

    # units of the table's columns, what shows whether the flow still changes, and what is told of
    # the outlet
    units: ClassVar[Mapping[str, str]]
    watched: ClassVar[Sequence[str]]
    at_outlet: ClassVar[Sequence[str]]

    def __init__(
        self,
        station: Section,
        length: float,
        control: MarchControl,
        outlet_pressure: float,
        summed: Sequence[str],
        coupler: Coupler | None = None,
    ) -> None:
        self.station, self.length, self.control = station, length, control
        self.coupler = coupler
        self.outlet_pressure = outlet_pressure
        self.rows: list[dict[str, float]] = []
        self.sums = Sums(summed)
        self.place: Place | None = None
        spaces = {name: station.space.sub(i).collapse() for i, name in enumerate(station.names)}
        self._dofs = {name: np.asarray(dofs).ravel() for name, (_, dofs) in spaces.items()}
        # what a checkpoint holds; made once, for a space takes longer to make than to fill
        self._copies = {
            (key, name): fem.Function(space)
            for key in ("now", "old")
            for name, (space, _) in spaces.items()
        }

    # -- what a model gives --------------------------------------------------------------------

    @abstractmethod
    def enter(self) -> None:
        """Put the state of the inlet on the station."""

    @abstractmethod
    def rates(self) -> dict[str, float]:
        """Rates of the integrals along the axis at the station at hand."""

    @abstractmethod
    def back_flow(self) -> str:
        """Why a station is no answer, such as a phase that flows back; an empty text if it is."""

    @abstractmethod
    def momentum(self) -> float:
        """Axial momentum flux through the part that is solved."""

    @abstractmethod
    def row(self) -> dict[str, float]:
        """One row of the table."""

    @abstractmethod
    def balances(self) -> dict[str, float]:
        """Relative errors from the inlet to the last station."""

    def companions(self) -> tuple[dict[str, fem.Function], dict[str, float]]:
        """Fields and numbers that belong to a state beside the unknowns of two stations."""
        return {}, {}

    def take_companions(  # noqa: B027
        self, fields: Mapping[str, fem.Function], numbers: Mapping[str, float]
    ) -> None:
        """Put back what `companions` gave; a model without any does nothing."""

    def slab_begins(self, step: float) -> None:  # noqa: B027
        """A slab with a coupler is tried; a flow without particles does nothing here and below."""

    def carry(self) -> None:  # noqa: B027
        """Solve what the flow carries before the coupler sees it, such as heat."""

    def slab_accepted(self) -> None:  # noqa: B027
        """The slab is accepted; the station is not in the table yet."""

    def slab_rejected(self) -> None:  # noqa: B027
        """Back to what belongs to the last accepted station beside the unknowns."""

    @property
    def z(self) -> float:
        """Where the station at hand stands [m]."""
        assert self.place is not None
        return self.place.z

    # -- the march -----------------------------------------------------------------------------

    def begin(self) -> None:
        """Stand at the inlet."""
        self.enter()
        self.place = Place(0.0, None, self.control.first)
        self.entered = self.momentum()
        self._tell()

    def march(
        self,
        observe: Callable[[Line, Stop], None] = lambda line, stop: None,
        retry: Callable[[float, str], None] = lambda step, reason: None,
    ) -> None:
        """Go on to the end of the line.

        observe : told each accepted station
        retry : told the new step [m] and the reason when a step is taken back

        Raises
        ------
        SolverError
            the flow turns back somewhere, or no step is small enough for Newton.
        """

        def accept(stop: Stop) -> None:
            self._accept(stop)
            observe(self, stop)

        station = self.station
        stations, parts = (station.old, station.older), (self.control, self.back_flow)
        slab = None if self.coupler is None else _Slab(self, self.coupler)
        march = March(station.newton, stations, station.weights, *parts, accept, retry, slab)
        march.run(self.length, self.place)

    def _accept(self, stop: Stop) -> None:
        """Enter a station into the table."""
        self.place = stop.place
        weights = [float(w.value) for w in self.station.weights]
        self.sums.advance(weights, self.rates())
        self._tell()

    def _tell(self) -> None:
        self.rows.append(self.row())
        self.remember()

    def remember(self) -> None:
        """Keep the station at hand, for a step may be cut short."""
        station = self.station
        self._state = station.now.x.array.copy(), station.old.x.array.copy()
        self.passing = self.momentum()

    def step_back(self) -> None:
        """Put the last accepted station back, after a step was cut short."""
        self.station.now.x.array[:], self.station.old.x.array[:] = self._state
        if self.coupler is not None:
            self.coupler.reject()
            self.slab_rejected()

    def extreme(self, name: str, largest: bool) -> float:
        """Smallest or largest axial velocity of a phase at its nodes [m/s]."""
        # components of a velocity alternate
        values = self.station.now.x.array[self._dofs[name][2::3]]
        best = values.max(initial=-math.inf) if largest else values.min(initial=math.inf)
        comm = self.station.mesh.mesh.comm
        return float(comm.allreduce(float(best), MPI.MAX if largest else MPI.MIN))

    # -- its state -----------------------------------------------------------------------------

    def state(
        self,
    ) -> tuple[
        dict[str, fem.Function],
        dict[str, float],
        dict[str, list[float]],
        dict[str, np.ndarray],
    ]:
        """Fields, numbers, tables and the coupler's arrays from which `restore` goes on."""
        place, station = self.place, self.station
        assert place is not None
        numbers = {
            "z": place.z,
            "last": math.nan if place.last is None else place.last,
            "next": place.next,
            "drive": float(station.drive.value),
            "entered": self.entered,
        }
        tables = {name: [row[name] for row in self.rows] for name in self.rows[0]}
        tables |= {f"sum.{name}": [v, self.sums.old[name]] for name, v in self.sums.now.items()}
        for (key, name), function in self._copies.items():
            source = station.now if key == "now" else station.old
            function.x.array[:] = source.x.array[self._dofs[name]]
        more_fields, more_numbers = self.companions()
        others = {} if self.coupler is None else dict(self.coupler.state())
        return self.stored_fields() | more_fields, numbers | more_numbers, tables, others

    def stored_fields(self) -> dict[str, fem.Function]:
        """The functions that hold a stored state, by name."""
        return {f"{key}.{name}": function for (key, name), function in self._copies.items()}

    def restore(
        self,
        fields: Mapping[str, fem.Function],
        numbers: Mapping[str, float],
        tables: Mapping[str, Sequence[float]],
        others: Mapping[str, np.ndarray] | None = None,
    ) -> None:
        """Stand where `state` was taken; `fields` are `stored_fields` and those of companions."""
        station = self.station
        self.take_companions(
            {n: f for n, f in fields.items() if n not in self.stored_fields()}, numbers
        )
        for (key, name), function in self._copies.items():
            target = station.now if key == "now" else station.old
            target.x.array[self._dofs[name]] = function.x.array
        station.drive.value, self.entered = numbers["drive"], numbers["entered"]
        last = None if math.isnan(numbers["last"]) else numbers["last"]
        self.place = Place(numbers["z"], last, numbers["next"])
        kept = dict(tables)
        for name in self.sums.now:
            self.sums.now[name], self.sums.old[name] = kept.pop(f"sum.{name}")
        rows = zip(*kept.values(), strict=True)
        self.rows = [dict(zip(kept, row, strict=True)) for row in rows]
        if self.coupler is not None:
            self.coupler.restore(others or {})
        self.remember()

    # -- what the line tells -------------------------------------------------------------------

    def columns(self) -> dict[str, list[float]]:
        """The table along the axis; pressure is that above the outlet's, or absolute if given."""
        names = [name for name in self.units if name in self.rows[0]]
        columns = {name: [row[name] for row in self.rows] for name in names}
        level = self.outlet_pressure - columns["pressure"][-1]
        columns["pressure"] = [p + level for p in columns["pressure"]]
        return columns

    def development_length(self) -> float:
        """Distance from the inlet beyond which nothing watched is 1 % from the outlet's value [m].

        It is the length of the line where the flow has not developed at its end.
        """
        last = self.rows[-1]
        names = [name for name in self.watched if name in last]
        changing = [
            row["z"]
            for row in self.rows
            if not all(abs(row[n] - last[n]) <= DEVELOPED * abs(last[n]) for n in names)
        ]
        return changing[-1] if changing else 0.0

    def quantities(self) -> dict[str, float]:
        """Numbers of the line, in the units of `output.result.QUANTITIES`."""
        last = self.rows[-1]
        return {
            "pressure_drop": self.rows[0]["pressure"] - last["pressure"],
            **{name: last[name] for name in self.at_outlet if name in last},
            "development_length": self.development_length(),
        }

# SPDX-License-Identifier: LGPL-3.0-or-later
"""A developing two-fluid flow: what a station adds to the table along the axis."""

from __future__ import annotations

import math

import numpy as np

from fem_tfm.interpolation import point_values
from fem_tfm.models.line import Coupler, Line
from fem_tfm.models.two_fluid.inlet import enter
from fem_tfm.models.two_fluid.quantities import pressure_gradient, quantities
from fem_tfm.models.two_fluid.section import TwoFluidSection
from fem_tfm.models.two_fluid.split import ACCELERATION, GAS, LIFT, SOLIDS, split
from fem_tfm.operation import Inlet
from fem_tfm.solvers.marching import MarchControl

# axial velocity over U_g below which a phase counts as flowing back
BACK_FLOW = -1e-3
BED_POINTS = 101

# columns of axis.csv and their units
UNITS = {
    "z": "m",
    "pressure": "Pa",
    GAS: "Pa",
    SOLIDS: "Pa",
    LIFT: "Pa",
    ACCELERATION: "Pa",
    "pressure_gradient": "Pa/m",
    "holdup": "-",
    "max_solids_fraction": "-",
    "bed_fraction": "-",
    "bed_height": "m",
    "solids_velocity": "m/s",
    "gas_velocity": "m/s",
    "slip_velocity": "m/s",
    "max_gas_velocity": "m/s",
    "max_theta": "m2/s2",
    "solids_mass_flow": "kg/s",
    "gas_mass_flow": "kg/s",
}
# quantities of the outlet that a result tells
AT_OUTLET = (
    GAS, SOLIDS, LIFT, ACCELERATION, "pressure_gradient", "solids_mass_flow", "gas_mass_flow",
    "holdup", "max_solids_fraction", "bed_fraction", "bed_height", "slip_velocity",
)  # fmt: skip


class TwoFluidLine(Line):
    """A dense flow on its way downstream.

    Momentum: pressure drop times area + weight = force of the walls + gain of momentum flux.

    inlet, solids : what enters, with alpha_s [-] and u_s [m/s] of the solids, None for gas alone
    parts : names of the parts of the pressure drop that are integrated along the axis
    others : as for `Line`
    """

    station: TwoFluidSection
    units = UNITS
    watched = ("pressure_gradient", "holdup", "max_gas_velocity")
    at_outlet = AT_OUTLET

    def __init__(
        self,
        station: TwoFluidSection,
        length: float,
        control: MarchControl,
        outlet_pressure: float,
        inlet: Inlet,
        solids: tuple[float, float] | None,
        coupler: Coupler | None = None,
    ) -> None:
        self.parts = (GAS, LIFT) if station.setup.solids is None else (GAS, SOLIDS, LIFT)
        summed = ("head", "driven", "resisted", *self.parts)
        super().__init__(station, length, control, outlet_pressure, summed, coupler)
        self.inlet, self.solids = inlet, solids

    def enter(self) -> None:
        """Put the state of the inlet on the station."""
        enter(self.station, self.inlet, self.solids)

    def rates(self) -> dict[str, float]:
        """Pressure gradient, drive, resistance and the parts of the gradient."""
        return split(self.station) | {
            "head": -pressure_gradient(self.station),
            "driven": float(self.station.drive.value),
            "resisted": self.station.wall_force() - self._weight(),
        }

    def back_flow(self) -> str:
        """Which phase flows back, which marching cannot follow; an empty text if none does."""
        for name, phase in (("u_g", "gas"), ("u_s", "solids")):
            if name in self.station.names:
                slowest = self.extreme(name, largest=False)
                if slowest < BACK_FLOW * self.station.setup.gas_velocity:
                    return f"the {phase} would flow back at {-slowest:.2g} m/s, against the march"
        return ""

    def row(self) -> dict[str, float]:
        """One row of the table."""
        station = self.station
        found = quantities(station, 1.0)
        inlet = not self.rows
        row = {
            "z": self.z,
            "pressure": self.sums.now["head"],
            **self.split(),
            "pressure_gradient": math.nan if inlet else found["pressure_gradient"],
            "gas_mass_flow": found["gas_mass_flow"],
            "max_gas_velocity": self.extreme("u_g", largest=True),
        }
        whole = station.mesh.section.area_factor * station.area
        row["gas_velocity"] = found["gas_mass_flow"] / (station.setup.gas.density * whole)
        if station.setup.solids is None:
            return row
        held = found["holdup"]
        flux = found["solids_mass_flow"] / (station.setup.solids.density * whole)
        row["gas_velocity"] /= 1 - held
        kept = ("holdup", "max_solids_fraction", "bed_fraction", "slip_velocity")
        return row | {
            **{name: found[name] for name in (*kept, "solids_mass_flow")},
            "bed_height": self.bed_height(),
            "solids_velocity": flux / held,
            "max_theta": station.extremes()["max_theta"],
        }

    def split(self) -> dict[str, float]:
        """Parts of the pressure drop from the inlet to the station at hand [Pa]."""
        gain = self.momentum() - self.entered
        found = {name: self.sums.now[name] for name in self.parts}
        return found | {ACCELERATION: gain / self.station.area}

    def bed_height(self) -> float:
        """Height up to which the vertical diameter is denser than the onset of friction [m]."""
        station, solids = self.station, self.station.setup.solids
        assert solids is not None
        height = station.mesh.section.size[1]
        y = np.linspace(-0.5, 0.5, BED_POINTS) * height * (1 - 1e-6)
        logit = self._copies["now", "q"]
        logit.x.array[:] = station.now.x.array[self._dofs["q"]]
        q = point_values(logit, np.column_stack([0 * y, y]))
        alpha, limit = solids.packing_limit / (1 + np.exp(-q)), solids.friction_limit
        dense_points = np.flatnonzero(alpha >= limit)
        if not len(dense_points):
            return 0.0
        top = dense_points[-1]
        if top == len(y) - 1:
            return float(height)
        share = (alpha[top] - limit) / (alpha[top] - alpha[top + 1])
        return float(y[top] + share * (y[top + 1] - y[top]) + height / 2)

    def momentum(self) -> float:
        """Axial momentum flux of both phases through the part that is solved [N]."""
        station, setup = self.station, self.station.setup
        state = station.state(station.now)
        alpha = station.model.alpha(state)
        gas = station.integral("gas momentum", (1 - alpha) * state.u_g[2] ** 2)
        if setup.solids is None:
            return setup.gas.density * gas
        solids = station.integral("solids momentum", alpha * state.u_s[2] ** 2)
        return setup.gas.density * gas + setup.solids.density * solids

    def _weight(self) -> float:
        """Axial weight of the solids in the gas per length [N/m]."""
        station, setup = self.station, self.station.setup
        if setup.solids is None:
            return 0.0
        held = station.integral("held", station.model.alpha(station.state(station.now)))
        return (setup.solids.density - setup.gas.density) * setup.gravity[2] * held

    def balances(self) -> dict[str, float]:
        """Relative errors of mass and axial momentum from the inlet to the last station."""
        first, found = self.rows[0], {}
        for phase in ("gas", "solids"):
            if (name := f"{phase}_mass_flow") in first:
                away = (abs(row[name] / first[name] - 1) for row in self.rows)
                found[f"{phase}_mass"] = max(away)
        driven = self.sums.now["driven"] * self.station.area
        resisted, gain = self.sums.now["resisted"], self.passing - self.entered
        scale = max(abs(driven), abs(resisted), abs(gain))
        return found | {"axial_momentum": abs(driven - resisted - gain) / scale}

    def quantities(self) -> dict[str, float]:
        """Numbers of the line, and the drop beyond that of the outlet's gradient."""
        found, last = super().quantities(), self.rows[-1]
        entrance = found["pressure_drop"] - last["pressure_gradient"] * last["z"]
        return found | {"entrance_pressure_drop": entrance}

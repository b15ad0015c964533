# SPDX-License-Identifier: LGPL-3.0-or-later
"""A turbulent gas that develops: what a station adds to the table along the axis.

Heat is carried along, one linear system a station. What the stations conserve is told: mass, axial
momentum and heat, all to round-off. The pressure drop is told in its parts: what the walls take,
and what goes into the momentum flux of the part solved and of the strip at the wall.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from dolfinx import fem

from fem_tfm.interpolation import point_values
from fem_tfm.materials import Gas
from fem_tfm.models.line import Coupler, Line
from fem_tfm.models.reynolds_stress import initial
from fem_tfm.models.reynolds_stress.heat import GasHeat
from fem_tfm.models.reynolds_stress.model import Heat
from fem_tfm.models.reynolds_stress.quantities import secondary, smallest_stress
from fem_tfm.models.reynolds_stress.section import ReynoldsStressSection
from fem_tfm.operation import Inlet
from fem_tfm.solvers.marching import MarchControl

# columns of axis.csv and their units
UNITS = {
    "z": "m",
    "pressure": "Pa",
    "friction_drop": "Pa",
    "particle_drop": "Pa",
    "flux_drop": "Pa",
    "pressure_gradient": "Pa/m",
    "friction_factor": "-",
    "centre_to_bulk": "-",
    "max_to_bulk": "-",
    "secondary_velocity_max": "-",
    "axis_energy": "-",
    "smallest_stress": "-",
    "gas_mass_flow": "kg/s",
    "bulk_temperature": "K",
    "wall_temperature": "K",
    "wall_flux": "W/m2",
    "nusselt": "-",
}
# quantities of the outlet that a result tells
AT_OUTLET = (
    "friction_drop", "particle_drop", "flux_drop",
    "pressure_gradient", "friction_factor", "gas_mass_flow", "centre_to_bulk",
    "secondary_velocity_max", "axis_energy", "smallest_stress", "nusselt",
)  # fmt: skip
# what shows whether the flow still changes
WATCHED = ("friction_factor", "centre_to_bulk")


class ReynoldsStressLine(Line):
    """A gas on its way downstream.

    gas : its density, and its temperature at the inlet
    inlet : what enters
    heat, given : temperature on the station and what the walls give, None without heat
    coupler : particles that go along, whose exchange the station holds
    others : as for `Line`
    """

    station: ReynoldsStressSection
    units = UNITS
    watched = WATCHED
    at_outlet = AT_OUTLET

    def __init__(
        self,
        station: ReynoldsStressSection,
        length: float,
        control: MarchControl,
        outlet_pressure: float,
        gas: Gas,
        inlet: Inlet,
        heat: GasHeat | None = None,
        given: Heat | None = None,
        coupler: Coupler | None = None,
    ) -> None:
        summed = ["head", "friction", "strip", "particles"] + (["heat"] if heat else [])
        super().__init__(station, length, control, outlet_pressure, summed, coupler)
        self.density, self.temperature = gas.density, gas.temperature
        self.inlet, self.heat, self.given = inlet, heat, given

    def enter(self) -> None:
        """Put the state of the inlet on the station."""
        length = self.inlet.length_scale * self.station.mesh.section.hydraulic_diameter
        initial.enter(self.station, self.inlet.gas_intensity, length)
        if self.heat is not None and self.given is not None:
            excess = self.given.wall_temperature - self.temperature
            self.heat.enter(0.0, excess if self.given.wall == "temperature" else 0.0)

    def rates(self) -> dict[str, float]:
        """Gradients of the pressure and of its parts, and the heat that the walls give.

        The heat is carried to the station.
        """
        station, share = self.station, self.density / self.station.area
        rates = {
            "head": -self.density * station.pressure_gradient,
            "friction": share * station.wall_force(),
            "strip": share * station.strip_momentum(),
            "particles": -share * station.particle_force(),
        }
        if self.heat is not None:
            if self.coupler is None:
                self.heat.keep()
                self.carry()
            rates["heat"] = self.heat.warmed() - self.heat.lost()
        return rates

    def slab_begins(self, step: float) -> None:
        """Particles are about to cross a slab."""
        if self.heat is not None:
            self.heat.keep()
        if (exchange := self.station.exchange) is not None:
            exchange.begin([float(w.value) for w in self.station.weights], step)

    def carry(self) -> None:
        """Temperature of the station at hand."""
        if self.heat is not None:
            self.heat.step(self._wall_flux())

    def slab_accepted(self) -> None:
        """What the gas has got from the particles is entered, with the heat at hand."""
        self.carry()
        if self.station.exchange is not None:
            self.station.exchange.accept()

    def slab_rejected(self) -> None:
        """Back to what the last accepted station has got from the particles."""
        self._cool()
        if self.station.exchange is not None:
            self.station.exchange.put_back()

    def _wall_flux(self) -> float | None:
        """Heat flux of the wall over rho c_p [K m/s], None where its temperature is given."""
        given = self.given
        assert given is not None
        if given.wall == "temperature":
            return None
        return given.wall_flux / (self.density * given.heat_capacity)

    def back_flow(self) -> str:
        """Why a station is no answer: back-flow or a stress that cannot be."""
        slowest = self.extreme("u", largest=False)
        if slowest < 0:
            return f"the gas would flow back at {-slowest:.2g} m/s, against the march"
        smallest = smallest_stress(self.station)
        if not smallest > 0:
            return f"a principal Reynolds stress is {smallest:.2g} k, which cannot be"
        return ""

    def momentum(self) -> float:
        """Axial momentum flux over the density through the part that is solved [m4/s2]."""
        state = self.station.state(self.station.now)
        return self.station.integral("momentum", state.u[2] ** 2)

    def drops(self) -> dict[str, float]:
        """Parts of the pressure drop from the inlet on [Pa]."""
        gained = (self.momentum() - self.entered) * self.density / self.station.area
        drops = {
            "friction_drop": self.sums.now["friction"],
            "flux_drop": gained + self.sums.now["strip"],
        }
        if self.station.exchange is not None:
            drops["particle_drop"] = self.sums.now["particles"]
        return drops

    def row(self) -> dict[str, float]:
        """One row of the table."""
        station, inlet = self.station, not self.rows
        setup, geometry = station.setup, station.mesh.section
        width, speed, drive = (
            geometry.hydraulic_diameter,
            setup.gas_velocity,
            station.pressure_gradient,
        )
        # particles take a part of the drive, which is no friction
        braking = drive
        if station.exchange is not None:
            braking += station.particle_force() / station.area
        transported = setup.law.transported
        sampled = [station.unknown(name) for name in ("u", "r" if transported else "q")]
        u, r = (values[0] for values in point_values(sampled, np.zeros((1, 2))))
        k = float(r[:3].sum()) / 2 if transported else math.exp(float(r))
        u_tau2 = math.nan if inlet else drive * width / 4
        row = {
            "z": self.z,
            "pressure": self.sums.now["head"],
            **self.drops(),
            "pressure_gradient": math.nan if inlet else self.density * drive,
            "friction_factor": math.nan if inlet else 2 * braking * width / speed**2,
            "centre_to_bulk": float(u[2]) / speed,
            "max_to_bulk": self.extreme("u", largest=True) / speed,
            "secondary_velocity_max": secondary(station),
            "axis_energy": k / u_tau2,
            "smallest_stress": smallest_stress(station),
            "gas_mass_flow": self.density * geometry.area_factor * station.flux(),
        }
        return row if self.heat is None else row | self._heat_row(inlet)

    def _heat_row(self, inlet: bool) -> dict[str, float]:
        """Temperatures, flux and Nusselt number; the inlet has no wall yet."""
        heat, given, base = self.heat, self.given, self.temperature
        assert heat is not None and given is not None
        capacity = self.density * given.heat_capacity
        wall = base + heat.wall_temperature
        return {
            "bulk_temperature": base if inlet else base + heat.bulk(),
            "wall_temperature": math.nan if inlet else wall,
            "wall_flux": math.nan if inlet else capacity * heat.flux(),
            "nusselt": math.nan if inlet else heat.nusselt(),
        }

    def companions(self) -> tuple[dict[str, fem.Function], dict[str, float]]:
        """What was exchanged with particles, the temperature of two stations and of their walls."""
        exchange = self.station.exchange
        fields: dict[str, fem.Function] = {}
        if exchange is not None:
            fields |= exchange.functions()
        if self.heat is None:
            return fields, {}
        walls = {f"wall{i}": float(wall.value) for i, wall in enumerate(self.heat.walls)}
        return fields | self.heat.copies(), walls | {"imposed": self.heat.imposed}

    def take_companions(
        self, fields: Mapping[str, fem.Function], numbers: Mapping[str, float]
    ) -> None:
        """Put back what `companions` gave."""
        if (exchange := self.station.exchange) is not None:
            for name, function in exchange.functions().items():
                function.x.array[:] = fields[name].x.array
            exchange.keep()
        if self.heat is not None:
            self.heat.restore({n: f for n, f in fields.items() if not n.startswith("exchange.")})
            self.heat.imposed = numbers["imposed"]
            for i, wall in enumerate(self.heat.walls):
                wall.value = numbers[f"wall{i}"]

    def remember(self) -> None:
        """Keep the station at hand, and its temperature."""
        super().remember()
        if self.heat is not None:
            parts = (self.heat.now, self.heat.old, self.heat.older)
            walls = [float(wall.value) for wall in self.heat.walls]
            self._warmth = [part.x.array.copy() for part in parts], walls

    def step_back(self) -> None:
        """Put the last accepted station back, after a step was cut short."""
        super().step_back()
        self._cool()

    def _cool(self) -> None:
        """The temperature of the last accepted station."""
        if self.heat is not None:
            parts = (self.heat.now, self.heat.old, self.heat.older)
            for part, values in zip(parts, self._warmth[0], strict=True):
                part.x.array[:] = values
            for wall, value in zip(self.heat.walls, self._warmth[1], strict=True):
                wall.value = value

    def balances(self) -> dict[str, float]:
        """Relative errors of mass, axial momentum and heat from the inlet to the last station.

        Momentum over the largest of the pressure drop and its parts.
        """
        first = self.rows[0]["gas_mass_flow"]
        found = {"gas_mass": max(abs(row["gas_mass_flow"] / first - 1) for row in self.rows)}
        parts = [-self.sums.now["head"], *(-drop for drop in self.drops().values())]
        found["axial_momentum"] = abs(sum(parts)) / (max(map(abs, parts)) or 1.0)
        if self.heat is not None:
            gained, given = self.heat.bulk() * self.station.flux(), self.sums.now["heat"]
            found["heat"] = abs(gained - given) / abs(given) if given else 0.0
        return found

    def quantities(self) -> dict[str, float]:
        """Numbers of the line, with the overshoot of the centre and the heat at the outlet."""
        last, width = self.rows[-1], self.station.mesh.section.hydraulic_diameter
        peak = max(self.rows, key=lambda row: row["centre_to_bulk"])
        found = super().quantities() | {
            "overshoot": peak["centre_to_bulk"],
            "overshoot_position": peak["z"],
            "overshoot_diameters": peak["z"] / width,
        }
        if self.heat is not None:
            found["outlet_temperature"] = last["bulk_temperature"]
        return found

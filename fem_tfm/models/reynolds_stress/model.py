# SPDX-License-Identifier: LGPL-3.0-or-later
"""A turbulent gas by Reynolds stresses as a user states it: gas, laws, walls and heat."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import MISSING, dataclass, replace
from typing import ClassVar, Literal

from fem_tfm.closures.base import Closure, law, wall_distance_field
from fem_tfm.closures.turbulence.heat_flux import HeatFlux
from fem_tfm.closures.turbulence.reynolds_stress import StressLaw
from fem_tfm.closures.walls.functions import Equilibrium, ThermalWall, WallFunction
from fem_tfm.correlations import friction_velocity
from fem_tfm.materials import Gas
from fem_tfm.parameters import Parameters, parameter

# default distance of the wall function in wall units, and its least share of the diameter
WALL_PLUS, SMALLEST_DISTANCE = 40.0, 0.004
# the least Reynolds number that the distance is made for, and that of wall functions
SLOWEST, LEAST_REYNOLDS = 4e3, 2e4


@dataclass(frozen=True)
class Heat(Parameters):
    """Heat from the walls of a duct to its gas; it does not act on the flow."""

    wall: Literal["flux", "temperature"] = parameter("flux", doc="what is constant along the walls")
    prandtl: float = parameter(0.71, "-", "Prandtl number of the gas", gt=0.1, le=1e4)
    heat_capacity: float = parameter(1006.0, "J/kg/K", "at constant pressure", ge=50, le=1e5)
    wall_flux: float = parameter(1000.0, "W/m2", "heat flux with wall = 'flux'", ge=-1e9, le=1e9)
    wall_temperature: float = parameter(
        350.0, "K", "temperature with wall = 'temperature'", ge=100, le=5000
    )
    table: ClassVar[str] = "heat"


@dataclass(frozen=True)
class ReynoldsStress(Parameters):
    """A gas alone with a transport equation for each Reynolds stress, and its heat where asked.

    Each law is an object of `fem_tfm.laws`, its name, or a table
    { model = name, parameter = value }.

    Raises InputError for a value out of range.
    """

    gas: Gas = parameter(MISSING, doc="gas", key="gas")
    stress: StressLaw = law(
        "reynolds-stress", "lrr", "Reynolds stresses of a duct's gas", "closures.reynolds_stress"
    )
    heat_flux: HeatFlux = law(
        "heat-flux", "launder", "turbulent heat fluxes of a duct's gas", "closures.heat_flux"
    )
    wall_function: WallFunction = law(
        "wall-function", "equilibrium", "wall function of a duct's gas", "walls.function"
    )
    thermal_wall: ThermalWall = law(
        "thermal-wall", "jayatilleke", "wall function of the temperature", "walls.heat"
    )
    wall_distance: float | None = wall_distance_field()
    heat: Heat | None = parameter(
        None, doc="heat from the walls; without the table there is none", key="heat"
    )
    flow: ClassVar[str] = "duct"
    # smallest part of a section that stands for the whole
    symmetry: ClassVar[str] = "quarter"
    solids: ClassVar[None] = None

    def laws(self) -> Iterator[Closure]:
        """The laws that are used."""
        yield from (self.stress, self.wall_function)
        if self.heat is not None:
            yield from (self.heat_flux, self.thermal_wall)

    def resolved(self) -> tuple[StressLaw, WallFunction]:
        """Stress law and wall function with the constants that they leave to each other."""
        stress, function = self.stress.resolved(), self.wall_function
        if isinstance(function, Equilibrium) and not function.C_mu:
            function = replace(function, C_mu=stress.log_layer().C_mu)
        return stress, function

    @property
    def turbulent_from(self) -> tuple[float, str]:
        """Least Reynolds number of the laws of turbulence [-], and what to say below it."""
        return LEAST_REYNOLDS, f"wall functions are meant for more than {LEAST_REYNOLDS:g}"

    def wall_offset(self, speed: float, diameter: float) -> float:
        """Distance y_p at which the wall function holds [m].

        y+ = 40, and at least 0.4 % of the diameter, unless it is given.

        speed : bulk velocity [m/s]
        diameter : hydraulic diameter [m]
        """
        if self.wall_distance is not None:
            return self.wall_distance
        viscosity = self.gas.viscosity / self.gas.density
        fast = max(speed, SLOWEST * viscosity / diameter)
        unit = viscosity / friction_velocity(fast, diameter, viscosity)
        return max(WALL_PLUS * unit, SMALLEST_DISTANCE * diameter)

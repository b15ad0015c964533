# SPDX-License-Identifier: LGPL-3.0-or-later
"""Numbers of the gas of any scene, and what they give away: slips of units, laws out of range."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from fem_tfm.correlations import friction_velocity, gnielinski, sound_speed
from fem_tfm.materials import SPECIES

# bounds outside of which a number was hardly meant: densities [kg/m3], temperature [K], viscosities
# of gases [Pa s], length over diameter, and the density over that of air of the same pressure
THIN_GAS, HEAVY_GAS, COLD_GAS, SHORTEST_LINE = 0.08, 200.0, 230.0, 3.0
GAS_VISCOSITY, LIKE_AIR = (5e-6, 1e-4), (0.066, 7.0)
# an absolute pressure of a gas below which nothing is conveyed [Pa]
LEAST_PRESSURE = 2e4
# velocity of the gas over that of sound up to which it keeps its density
LARGEST_MACH = 0.3
# Reynolds number below which nothing is turbulent, and the least of a turbulent gas
SLOWEST, TURBULENT = 50.0, 4000.0
# loading from which the solids decide on the friction of a line, not the gas
SOLIDS_DECIDE = 1.0
# Prandtl number and heat capacity of gases [J/kg/K], temperature of a wall or a particle over that
# of the gas, and rise of a heated wall above the gas [K], outside of which they were hardly meant
GAS_HEAT = {"prandtl": (0.3, 2.0), "heat_capacity": (400.0, 16000.0)}
WARM, WALL_RISE = (0.6, 1.7), (0.05, 500.0)
DENSITY, VISCOSITY = "gas density", "gas viscosity"


@dataclass(frozen=True)
class Derived:
    """A number that follows from a scene.

    doubt : the slip that it gives away, empty where there is none
    """

    name: str
    value: float
    unit: str
    doubt: str = ""

    def __str__(self) -> str:
        return f"{self.name} {self.value:.4g} {self.unit}".rstrip()


def doubts(numbers: Iterable[Derived]) -> list[str]:
    """What a user probably did not mean, with the number that gives it away."""
    return [f"{number}: {number.doubt}" for number in numbers if number.doubt]


def is_doubted(numbers: Iterable[Derived]) -> bool:
    """Whether density or viscosity of the gas are doubted, from which other numbers follow."""
    return any(one.doubt for one in numbers if one.name in (DENSITY, VISCOSITY))


def loading(scene: Any) -> float:
    """Mass flow of the solids over that of the gas [-]; 0 of a gas alone."""
    if scene.solids_feed is None:
        return 0.0
    mass = scene.model.solids.density * solids_flux(scene)
    return float(mass / (scene.model.gas.density * scene.feed.gas_velocity))


def solids_flux(scene: Any) -> float:
    """Superficial velocity of the solids, about, where their hold-up is given [m/s]."""
    if scene.solids_feed is None:
        return 0.0
    kind, value = scene.solids_feed
    return float(value if kind == "flux" else value * scene.feed.gas_velocity)


def air_pressure(gas: Any) -> float:
    """Pressure rho R T of air of the density and temperature of a gas [Pa]."""
    return float(gas.density * SPECIES["air"].gas_constant * gas.temperature)


def absolute_pressure(scene: Any) -> tuple[float, str]:
    """Absolute pressure at which the gas has its density [Pa], and words where it is guessed.

    That of the gas or of the outlet; where the case has none, that of air of this density.
    """
    gas, feed = scene.model.gas, scene.feed
    known = gas.pressure or feed.outlet_pressure
    if known is not None:
        return float(known), ""
    return air_pressure(gas), "that of air of this density"


def of_the_gas(scene: Any) -> Iterator[Derived]:
    """The numbers of the gas of a scene; a cause is named once.

    The model has a gas of density, viscosity and pressure, and tells from which Reynolds number on
    its laws of turbulence hold.
    """
    gas = scene.model.gas
    density = Derived(DENSITY, gas.density, "kg/m3", _doubt_of_density(scene))
    yield density
    viscosity, (low, high) = Derived(VISCOSITY, gas.viscosity, "Pa s"), GAS_VISCOSITY
    # Sutherland's viscosity is small where the temperature is, which is doubted already
    cold = gas.viscosity < low and gas.temperature < COLD_GAS
    if not low <= gas.viscosity <= high and not cold:
        doubt = f"gases have {low:g} to {high:g}; is gas.viscosity in Pa s, not in cP?"
        viscosity = replace(viscosity, doubt=doubt)
    yield viscosity
    width, doubt = scene.geometry.hydraulic_diameter, ""
    ratio = scene.geometry.length / width
    if ratio < SHORTEST_LINE:
        doubt = (
            f"the line is wider or hardly longer than wide; are its width of {width:g} m and"
            f" geometry.length = {scene.geometry.length:g} in m?"
        )
    yield Derived("length over diameter", ratio, "", doubt)
    blamed = is_doubted((density, viscosity))
    yield from _of_the_speed(scene, blamed)
    if getattr(scene.model, "heat", None) is not None:
        yield from _of_the_heat(scene, blamed)


def _of_the_heat(scene: Any, blamed: bool) -> Iterator[Derived]:
    """Temperature of the walls, or their rise above the gas by Gnielinski, and what they need.

    blamed : whether density or viscosity are doubted, from which the rise follows
    """
    gas, heat = scene.model.gas, scene.model.heat
    for name, (low, high) in GAS_HEAT.items():
        value = getattr(heat, name)
        if not low <= value <= high:
            doubt = f"gases have {low:g} to {high:g}; is heat.{name} = {value:g} in SI units?"
            yield Derived(name.replace("_", " "), value, "", doubt)
    if heat.wall == "temperature":
        ratio, doubt = heat.wall_temperature / gas.temperature, ""
        if not WARM[0] <= ratio <= WARM[1]:
            doubt = (
                f"is heat.wall_temperature = {heat.wall_temperature:g} in K? The properties of the"
                f" gas are those at {gas.temperature:g} K"
            )
        yield Derived("temperature of the wall over that of the gas", ratio, "", doubt)
    elif scene.reynolds > TURBULENT and not blamed:
        conductivity = heat.heat_capacity * gas.viscosity / heat.prandtl
        nusselt = gnielinski(scene.reynolds, heat.prandtl)
        rise = heat.wall_flux * scene.geometry.hydraulic_diameter / (conductivity * nusselt)
        doubt, (low, high) = "", WALL_RISE
        if heat.wall_flux and not low <= abs(rise) <= high:
            doubt = f"is heat.wall_flux = {heat.wall_flux:g} in W/m2, not in kW/m2 or W?"
        yield Derived("wall above the gas by Gnielinski", rise, "K", doubt)


def _doubt_of_density(scene: Any) -> str:
    """Whether a density was hardly meant, or does not belong to the pressure beside it."""
    gas, (low, high) = scene.model.gas, LIKE_AIR
    if gas.temperature < COLD_GAS:
        return f"is gas.temperature = {gas.temperature:g} in K, not in degrees Celsius?"
    stated, outlet = gas.pressure, getattr(scene.feed, "outlet_pressure", None)
    constant = getattr(gas, "gas_constant", None)
    if constant is not None and not low <= SPECIES["air"].gas_constant / constant <= high:
        return f"is gas.gas_constant = {constant:g} in J/kg/K, and not a molar mass?"
    # the density of an ideal gas follows from its pressure, which is then the one to doubt
    follows = constant is not None or getattr(gas, "name", None) is not None
    beside = outlet if stated is None else None if follows else stated
    key = "gas.pressure" if hasattr(gas, "name") else "gas.reference_pressure"
    if beside is not None and not low <= air_pressure(gas) / beside <= high:
        where = f"{'operation.outlet_pressure' if stated is None else key} = {beside:g}"
        return f"no gas has it at {where} Pa; is that in Pa, not in bar, and the density in kg/m3?"
    if stated is not None and stated < LEAST_PRESSURE:
        return f"next to a vacuum; is {key} = {stated:g} absolute and in Pa, not in bar or mbar?"
    if gas.density < THIN_GAS:
        return "next to a vacuum; is gas.density in kg/m3, not in g/cm3 or lb/ft3?"
    if gas.density > HEAVY_GAS:
        return "that of a liquid; is the density or pressure of the gas in SI units?"
    return ""


def _of_the_speed(scene: Any, blamed: bool) -> Iterator[Derived]:
    """Reynolds number, Mach number and y+.

    blamed : whether density or viscosity are doubted, from which these follow
    """
    gas, speed = scene.model.gas, scene.feed.gas_velocity
    reynolds, doubt = scene.reynolds, ""
    least, cure = scene.model.turbulent_from
    if reynolds < least and not blamed:
        if reynolds < SLOWEST:
            doubt = f"nothing is turbulent there; are gas and line in SI units? Else {cure}"
        elif loading(scene) < SOLIDS_DECIDE:
            doubt = cure
    yield Derived("Reynolds number of the gas", reynolds, "", doubt)
    mach, doubt = speed / sound_speed(gas), ""
    if mach > LARGEST_MACH and not blamed:
        doubt = (
            "its motion alone changes the density of the gas;"
            f" is operation.gas_superficial_velocity = {speed:g} in m/s, not in km/h?"
        )
    yield Derived("gas velocity over that of sound", mach, "", doubt)
    if reynolds > TURBULENT and scene.wall_offset > 0:
        yield Derived("wall distance y+", y_plus(scene), "")


def y_plus(scene: Any) -> float:
    """Distance of the wall law in viscous lengths, y_p u_tau/nu of the gas alone [-]."""
    gas, width = scene.model.gas, scene.geometry.hydraulic_diameter
    nu = gas.viscosity / gas.density
    return float(scene.wall_offset * friction_velocity(scene.feed.gas_velocity, width, nu) / nu)

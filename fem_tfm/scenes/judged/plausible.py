# SPDX-License-Identifier: LGPL-3.0-or-later
"""Numbers that follow from a dense scene, and what they give away: slips of units, settling."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from fem_tfm.closures.walls.solids import SolidsWall
from fem_tfm.correlations import (
    cunningham,
    friction_velocity,
    konno_saito,
    rizk_velocity,
    smooth_friction,
    sound_speed,
    terminal_velocity,
)
from fem_tfm.errors import InputError

# bounds outside of which a number was hardly meant
THIN_GAS, COLD_GAS, LIGHT_GRAINS, LIGHT_RATIO = 0.02, 150.0, 20.0, 3.0
LEAST_LOADING, LARGEST_LOADING, SHORTEST_LINE, SLOWEST = 1e-4, 300.0, 1.0, 50.0
# velocity of the gas over that of sound up to which it keeps its density, the smallest grain that
# a continuum carries [m], and the factor by which the gas may slip along it
LARGEST_MACH, SMALLEST_GRAIN, LARGEST_SLIP = 0.3, 1e-6, 1.15
# a flux of solids needs a velocity beyond these over and above that of the gas [-], [m/s]
FAST, FASTER_BY = 3.0, 10.0
# Rouse numbers below and above which grains stay up and settle, and von Karman's constant
SUSPENDED, SETTLED, KARMAN = 0.3, 1.0, 0.41
# grains that correlations were made for [m], hold-up of dilute flow, and the least share of the
# friction that they give
KONNO_SAITO_GRAINS, RIZK_GRAINS = (5e-5, 3e-3), (1e-4, 2e-3)
DILUTE, LEAST_FRICTION = 0.01, 0.5
# g D/v_t^2 from which grains move in clusters, and the loading below which they do not
CLUSTERED, CLUSTER_LOADING = 4.0, 0.5
# lines steeper than this do not let grains settle [deg], and the least Re of a turbulent gas
STEEP, TURBULENT = 45.0, 4000.0


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


def doubts(scene: Any) -> list[str]:
    """What a user probably did not mean, with the number that gives it away."""
    return [f"{number}: {number.doubt}" for number in derived(scene) if number.doubt]


def derived(scene: Any) -> list[Derived]:
    """The numbers of a dense scene."""
    found = [*_of_the_gas(scene)]
    if scene.model.solids is not None and scene.solids_feed is not None:
        found += _of_the_solids(scene)
    return found


def _of_the_gas(scene: Any) -> Iterator[Derived]:
    gas, geometry = scene.model.gas, scene.geometry
    width, reynolds = geometry.hydraulic_diameter, scene.reynolds
    doubt = ""
    if gas.density < THIN_GAS:
        doubt = "next to a vacuum"
        if gas.pressure is not None:
            doubt += f"; is gas.pressure = {gas.pressure:g} in Pa, not in bar?"
    elif gas.pressure is not None and gas.temperature < COLD_GAS:
        doubt = f"is gas.temperature = {gas.temperature:g} in K, not in degrees Celsius?"
    yield Derived("gas density", gas.density, "kg/m3", doubt)
    ratio = geometry.length / width
    doubt = ""
    if ratio < SHORTEST_LINE:
        doubt = f"the line is wider than long; is its diameter of {width:g} m in metres?"
    yield Derived("length over diameter", ratio, "", doubt)
    doubt = ""
    if reynolds < SLOWEST and scene.model.turbulence.name != "laminar":
        doubt = f"nothing is turbulent there; is gas.viscosity = {gas.viscosity:g} in Pa s?"
    yield Derived("Reynolds number of the gas", reynolds, "", doubt)
    speed, doubt = scene.feed.gas_velocity, ""
    mach = speed / sound_speed(gas)
    if mach > LARGEST_MACH:
        doubt = (
            "its motion alone changes the density of the gas;"
            f" is operation.gas_superficial_velocity = {speed:g} in m/s, not in km/h?"
        )
    yield Derived("gas velocity over that of sound", mach, "", doubt)
    if reynolds > TURBULENT:
        nu = gas.viscosity / gas.density
        y_plus = scene.wall_offset * friction_velocity(scene.feed.gas_velocity, width, nu) / nu
        yield Derived("wall distance y+", y_plus, "")


def solids_flux(scene: Any) -> float:
    """Superficial velocity of the solids, about, where their hold-up is given [m/s]."""
    kind, value = scene.solids_feed
    return float(value if kind == "flux" else value * scene.feed.gas_velocity)


def loading(scene: Any) -> float:
    """Mass flow of the solids over that of the gas [-]."""
    mass = scene.model.solids.density * solids_flux(scene)
    return float(mass / (scene.model.gas.density * scene.feed.gas_velocity))


def _of_the_solids(scene: Any) -> Iterator[Derived]:
    gas, solids, feed = scene.model.gas, scene.model.solids, scene.feed
    ratio, doubt = solids.density / gas.density, ""
    if solids.density < LIGHT_GRAINS or ratio < LIGHT_RATIO:
        doubt = f"is solids.density = {solids.density:g} in kg/m3, not in g/cm3?"
    yield Derived("solids density over that of the gas", ratio, "", doubt)
    slip, doubt = cunningham(gas, solids.diameter), ""
    if slip > LARGEST_SLIP or solids.diameter < SMALLEST_GRAIN:
        doubt = (
            f"the gas slips along grains of {1e6 * solids.diameter:g} um, Brownian motion spreads"
            " them and adhesion holds them, which no law here knows; is solids.diameter ="
            f" {solids.diameter:g} in m?"
        )
    yield Derived("slip of the gas along a grain, by Cunningham", slip, "", doubt)
    (kind, _), flux = scene.solids_feed, solids_flux(scene)
    if kind == "flux":
        doubt = ""
        if flux > solids.packing_limit * feed.gas_velocity:
            doubt = (
                f"more than the gas at {feed.gas_velocity:g} m/s could carry;"
                f" is operation.{feed.solids_key} = {getattr(feed, feed.solids_key):g} in SI units?"
            )
        yield Derived("solids superficial velocity", flux, "m/s", doubt)
    doubt = ""
    if not LEAST_LOADING <= loading(scene) <= LARGEST_LOADING:
        doubt = "outside of what is conveyed; are feed and diameter in SI units?"
    yield Derived("loading, solids over gas by mass", loading(scene), "", doubt)
    yield Derived("wall distance in grain diameters", scene.wall_offset / solids.diameter, "")
    if feed.gravity > 0:
        yield from _of_settling(scene)
    yield from _of_the_drop(scene, solids.density * flux)


def rouse_number(scene: Any) -> float:
    """w_t/(kappa u_tau) of the grains [-]."""
    gas, feed, width = scene.model.gas, scene.feed, scene.geometry.hydraulic_diameter
    falling = terminal_velocity(gas, scene.model.solids, feed.gravity)
    u_tau = friction_velocity(feed.gas_velocity, width, gas.viscosity / gas.density)
    return float(falling / (KARMAN * u_tau))


def saltation_velocity(scene: Any) -> float:
    """Superficial velocity of the gas below which grains begin to settle, by Rizk [m/s]."""
    solids, width = scene.model.solids, scene.geometry.hydraulic_diameter
    flow = solids.density * solids_flux(scene) * scene.geometry.area
    return float(rizk_velocity(flow, width, scene.model.gas, solids, scene.feed.gravity))


def expects_bed(scene: Any) -> bool:
    """Whether grains settle in a line by Rizk, level or nearly so."""
    if scene.model.solids is None or not scene.feed.gravity > 0:
        return False
    level = abs(scene.geometry.inclination_deg) <= STEEP
    return level and bool(scene.feed.gas_velocity < saltation_velocity(scene))


def lifts(scene: Any) -> bool:
    """Whether the eddies of the gas lift its grains, by Rouse."""
    return bool(scene.reynolds > TURBULENT and rouse_number(scene) < SETTLED)


def _of_settling(scene: Any) -> Iterator[Derived]:
    """Whether grains stay up; told, not doubted: beds are what the model is for."""
    gas, solids, feed = scene.model.gas, scene.model.solids, scene.feed
    falling, doubt = terminal_velocity(gas, solids, feed.gravity), ""
    against = falling * math.sin(math.radians(scene.geometry.inclination_deg))
    if abs(scene.geometry.inclination_deg) > STEEP and feed.gas_velocity < against:
        doubt = (
            f"the gas rises at {feed.gas_velocity:g} m/s, more slowly than a grain falls: it lifts"
            " none but a dense plug"
        )
    yield Derived("terminal velocity of a grain", falling, "m/s", doubt)
    if abs(scene.geometry.inclination_deg) > STEEP:
        yield _of_clusters(scene, falling)
        return
    if scene.reynolds > TURBULENT:
        rouse = rouse_number(scene)
        words = "between"
        if not SUSPENDED <= rouse <= SETTLED:
            words = "suspended" if rouse < SUSPENDED else "settles or bounces"
        yield Derived("Rouse number", rouse, f"({words})")
    rizk = saltation_velocity(scene)
    words = "above: no bed is to be expected"
    if feed.gas_velocity < rizk:
        words = "below: a bed is to be expected"
    yield Derived("saltation velocity by Rizk", rizk, f"m/s (the gas is {words})")


def _of_clusters(scene: Any, falling: float) -> Derived:
    """Whether grains of a rising line move in clusters, which a steady section averages over."""
    width = scene.geometry.hydraulic_diameter
    size = scene.feed.gravity * width / falling**2 if falling > 0 else math.inf
    doubt, uniform = "", not scene.model.drag.filtered
    if size > CLUSTERED and loading(scene) > CLUSTER_LOADING and uniform:
        doubt = (
            "such grains rise in clusters, which are not resolved: slip and hold-up come out too"
            " small with the drag of a uniform suspension; closures.drag = 'igci' accounts for them"
            " and walls.solids = 'johnson-jackson' for the bounce off the wall"
        )
    return Derived("diameter over the length to reach terminal velocity", size, "", doubt)


def _of_the_drop(scene: Any, flux: float) -> Iterator[Derived]:
    """The drop by correlations over the absolute pressure, where something tells that.

    Friction of the gas alone, Konno and Saito's 0.057 G sqrt(g/D) of the solids, and lift.
    """
    gas, feed, geometry = scene.model.gas, scene.feed, scene.geometry
    pressure = feed.outlet_pressure or gas.pressure
    if pressure is None or scene.reynolds < TURBULENT:
        return
    rise = math.sin(math.radians(geometry.inclination_deg))
    gradient = sum(friction_estimate(scene, flux))
    gradient += feed.gravity * rise * (gas.density + flux / feed.gas_velocity)
    share = abs(gradient) * geometry.length / pressure
    yield Derived("pressure drop by correlations over the pressure", share, "")


def friction_estimate(scene: Any, flux: float) -> tuple[float, float]:
    """Friction of the gas alone, and of the solids by Konno and Saito [Pa/m].

    flux : of the solids [kg/m2/s]
    """
    gas, speed = scene.model.gas, scene.feed.gas_velocity
    width = scene.geometry.hydraulic_diameter
    alone = smooth_friction(scene.reynolds) / 2 * gas.density * speed**2 / width
    return alone, konno_saito(flux, width, scene.feed.gravity)


# -- beside an answer ------------------------------------------------------------------------------


def estimates(scene: Any, found: Mapping[str, float]) -> list[str]:
    """What published correlations give for the line of an answer, one sentence each."""
    solids, feed = scene.model.solids, scene.feed
    if solids is None or scene.reynolds < TURBULENT or not feed.gravity > 0:
        return []
    flow, said = found["solids_mass_flow"], []
    alone, grains = friction_estimate(scene, flow / scene.geometry.area)
    said.append(
        f"friction by Prandtl and Karman with Konno and Saito: {alone:.3g} + {grains:.3g} Pa/m;"
        f" answer {_friction(scene, found):.3g} Pa/m"
        f"{_outside(solids.diameter, KONNO_SAITO_GRAINS, found['holdup'])}"
    )
    if abs(scene.geometry.inclination_deg) <= STEEP:
        width = scene.geometry.hydraulic_diameter
        rizk = rizk_velocity(flow, width, scene.model.gas, solids, feed.gravity)
        said.append(
            f"grains begin to settle below {rizk:.3g} m/s by Rizk; gas {feed.gas_velocity:g} m/s"
            f"{_outside(solids.diameter, RIZK_GRAINS, found['holdup'])}"
        )
    return said


def out_of_range(scene: Any, found: Mapping[str, float]) -> list[str]:
    """Whether a dilute line rubs much less or more than conveying lines were measured to do."""
    solids = scene.model.solids
    if solids is None or scene.reynolds < TURBULENT or not scene.feed.gravity > 0:
        return []
    if not found["holdup"] < DILUTE or not _inside(solids.diameter, KONNO_SAITO_GRAINS):
        return []
    expected = sum(friction_estimate(scene, found["solids_mass_flow"] / scene.geometry.area))
    got = _friction(scene, found)
    if LEAST_FRICTION * expected <= got <= expected / LEAST_FRICTION:
        return []
    cure, model = "", scene.model
    level = abs(scene.geometry.inclination_deg) <= STEEP
    # it acts by its heat, in level lines
    if got < expected and level and model.solids_wall.flat and model.theta == "transport":
        cure = "; walls.solids = 'rough' throws grains off the wall and brings such lines nearer"
    return [
        f"friction of {got:.3g} Pa/m is {got / expected:.2g} times the {expected:.3g} Pa/m of"
        " Prandtl and Karman with Konno and Saito, which measured lines keep within a factor of"
        f" two: the closures leave their range here{cure}"
    ]


def crowded(wall: SolidsWall, held: float | None) -> list[str]:
    """Whether a wall law of the solids is met by more of them than it is meant for."""
    if held is None or held <= wall.densest:
        return []
    return [
        f"walls.solids = {wall.name!r} is meant for a hold-up of up to {wall.densest:g}, and this"
        f" line has {held:.2g}: the law heats the grains too much there, and the drop is too large"
    ]


def _friction(scene: Any, found: Mapping[str, float]) -> float:
    """Gradient by friction of both phases [Pa/m]."""
    drop = found["drop_gas_friction"] + found["drop_solids_friction"]
    return float(drop / scene.geometry.length)


def _inside(size: float, bounds: tuple[float, float]) -> bool:
    return bounds[0] <= size <= bounds[1]


def _outside(size: float, bounds: tuple[float, float], holdup: float) -> str:
    """What an estimate must say of itself."""
    said = []
    if not _inside(size, bounds):
        said.append(f"grains of {1e3 * bounds[0]:g} to {1e3 * bounds[1]:g} mm")
    if not holdup < DILUTE:
        said.append("dilute flow")
    return f" (made for {' and '.join(said)})" if said else ""


# -- what is refused -------------------------------------------------------------------------------


def check_flux(scene: Any) -> None:
    """Refuse solids that would have to outrun any gas.

    Raises InputError with the velocity that gives it away.
    """
    if scene.model.solids is None or scene.solids_feed is None:
        return
    (kind, flux), gas, limit = scene.solids_feed, scene.feed.gas_velocity, scene.model.solids
    most = limit.packing_limit * max(FAST * gas, gas + FASTER_BY)
    if kind == "flux" and flux > most:
        key = scene.feed.solids_key
        words = (
            f"less: it is a superficial velocity of {flux:.4g} m/s beside gas at {gas:g} m/s,"
            f" and packed grains at {FAST:g} times that carry {most:.4g} m/s; units are SI"
        )
        raise InputError(f"operation.{key}", getattr(scene.feed, key), words)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Numbers that follow from a scene, and what they give away: slips of units, settling, a drop."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from fem_tfm.closures.walls.solids import SolidsWall
from fem_tfm.correlations import (
    friction_velocity,
    konno_saito,
    smooth_friction,
    terminal_velocity,
)
from fem_tfm.errors import InputError
from fem_tfm.scenes.judged.gas import (
    TURBULENT,
    Derived,
    absolute_pressure,
    is_doubted,
    loading,
    of_the_gas,
    solids_flux,
)
from fem_tfm.scenes.judged.grains import (
    LIGHT_GRAINS,
    is_steep,
    of_falling,
    of_saltation,
    of_the_grains,
    saltation_velocity,
)
from fem_tfm.scenes.judged.line import of_the_line, of_the_pressures

# angles of friction of grains and walls [deg], restitution, and packing from which grains rub,
# beyond which they were hardly meant
ANGLES, LEAST_RESTITUTION, LEAST_PACKING = (5.0, 60.0), 0.1, 0.1
# loadings outside of which nothing is conveyed
LEAST_LOADING, LARGEST_LOADING = 1e-4, 300.0
# a flux of solids needs a velocity beyond these over and above that of the gas [-], [m/s]
FAST, FASTER_BY = 3.0, 10.0
# velocity at which solids enter over that of the gas between them, from which it was hardly meant
OUTRUN = 1.3
# Rouse numbers below and above which grains stay up and settle, and von Karman's constant
SUSPENDED, SETTLED, KARMAN = 0.3, 1.0, 0.41
# grains that correlations were made for [m], hold-up of dilute flow, and the least share of the
# friction that they give
KONNO_SAITO_GRAINS, RIZK_GRAINS = (5e-5, 3e-3), (1e-4, 2e-3)
DILUTE, LEAST_FRICTION = 0.01, 0.5
# g D/v_t^2 from which grains move in clusters, and the loading below which they do not
CLUSTERED, CLUSTER_LOADING = 4.0, 0.5
# drop over the absolute pressure from which a gas of one density is no answer, and a pressure at
# the outlet that was hardly meant [Pa]
LARGEST_DROP, LEAST_OUTLET = 0.4, 2e4


def derived(scene: Any) -> list[Derived]:
    """The numbers of a line that is fed with gas, and with solids where it has any."""
    found = [*of_the_gas(scene), *of_the_line(scene), *of_the_pressures(scene)]
    if scene.model.solids is not None and scene.solids_feed is not None:
        found += _of_the_solids(scene, is_doubted(found))
    return [*found, *_of_the_drop(scene, any(number.doubt for number in found))]


def _of_the_solids(scene: Any, blamed: bool) -> Iterator[Derived]:
    solids, feed = scene.model.solids, scene.feed
    yield from of_the_grains(scene, solids, "solids", blamed)
    yield from _of_the_properties(scene)
    (kind, _), flux = scene.solids_feed, solids_flux(scene)
    if kind == "flux":
        doubt = ""
        if flux > solids.packing_limit * feed.gas_velocity:
            key = feed_key(scene)
            doubt = (
                "more than the gas could carry; are operation.gas_superficial_velocity ="
                f" {feed.gas_velocity:g} and operation.{key} = {getattr(feed, key):g} in SI units?"
            )
        elif outruns(scene):
            doubt = (
                f"the solids enter faster than the gas at {feed.gas_velocity:g} m/s; is"
                f" operation.solids_velocity = {feed.solids_velocity:g} in m/s, not in km/h?"
            )
        blamed = blamed or bool(doubt)
        yield Derived("solids superficial velocity", flux, "m/s", doubt)
    doubt = ""
    if not LEAST_LOADING <= loading(scene) <= LARGEST_LOADING and not blamed:
        doubt = "outside of what is conveyed; are feed, gas velocity and diameter in SI units?"
    yield Derived("loading, solids over gas by mass", loading(scene), "", doubt)
    yield Derived("wall distance in grain diameters", scene.wall_offset / solids.diameter, "")
    if feed.gravity > 0:
        yield from _of_settling(scene, blamed)


def _of_the_properties(scene: Any) -> Iterator[Derived]:
    """Properties of grains and walls that are given in other units; those alone that are."""
    solids, wall = scene.model.solids, scene.model.solids_wall
    low, high = ANGLES
    angles = [("solids.friction_angle_deg", solids.friction_angle_deg)]
    if (angle := getattr(wall, "friction_angle_deg", None)) is not None:
        angles.append(("walls.solids.friction_angle_deg", angle))
    for key, angle in angles:
        if angle < low or angle > high:
            doubt = f"grains have 15 to 45; is {key} in degrees, not in radians?"
            yield Derived("angle of friction", angle, "deg", doubt)
    shares = [("solids.restitution", solids.restitution, LEAST_RESTITUTION)]
    shares.append(("solids.friction_limit", solids.friction_limit, LEAST_PACKING))
    for key, share, least in shares:
        if share < least:
            doubt = f"is {key} a fraction of 1? Grains have more than {least:g}"
            yield Derived(key, share, "", doubt)


def outruns(scene: Any) -> bool:
    """Whether the solids are said to enter faster than the gas between them."""
    feed = scene.feed
    if feed.solids_velocity is None:
        return False
    gas = feed.gas_velocity / (1 - min(feed.solids_fraction, 0.9))
    return bool(feed.solids_velocity > OUTRUN * gas)


def feed_key(scene: Any) -> str:
    """Name of the number of the feed of solids that is most likely wrong where it is too large."""
    return "solids_velocity" if outruns(scene) else str(scene.feed.solids_key)


def rouse_number(scene: Any, grains: Any) -> float:
    """w_t/(kappa u_tau) of grains [-]."""
    gas, feed, width = scene.model.gas, scene.feed, scene.geometry.hydraulic_diameter
    falling = terminal_velocity(gas, grains, feed.gravity)
    u_tau = friction_velocity(feed.gas_velocity, width, gas.viscosity / gas.density)
    return float(falling / (KARMAN * u_tau))


def expects_bed(scene: Any) -> bool:
    """Whether grains settle in a line by Rizk, level or nearly so."""
    if scene.model.solids is None or not scene.feed.gravity > 0 or is_steep(scene):
        return False
    rizk = saltation_velocity(scene, scene.model.solids, _solids_flow(scene))
    return bool(scene.feed.gas_velocity < rizk)


def level_rouse(scene: Any) -> float:
    """Rouse number of the grains of a turbulent level line; 0 where nothing settles [-]."""
    solids = scene.model.solids
    level = solids is not None and scene.feed.gravity > 0 and not is_steep(scene)
    return rouse_number(scene, solids) if level and scene.reynolds > TURBULENT else 0.0


def lifts(scene: Any, grains: Any) -> bool:
    """Whether the eddies of the gas lift grains, by Rouse."""
    return bool(scene.reynolds > TURBULENT and rouse_number(scene, grains) < SETTLED)


def _solids_flow(scene: Any) -> float:
    """Mass flow of the solids, about, where their hold-up is given [kg/s]."""
    return float(scene.model.solids.density * solids_flux(scene) * scene.geometry.area)


def _of_settling(scene: Any, blamed: bool) -> Iterator[Derived]:
    """Whether grains stay up; told, not doubted: beds are what the model is for."""
    solids = scene.model.solids
    falling = of_falling(scene, solids)
    yield falling
    if is_steep(scene):
        yield _of_clusters(scene, falling.value, blamed)
        return
    if scene.reynolds > TURBULENT:
        rouse = rouse_number(scene, solids)
        words = "between"
        if not SUSPENDED <= rouse <= SETTLED:
            words = "suspended" if rouse < SUSPENDED else "settles or bounces"
        yield Derived("Rouse number", rouse, f"({words})")
    yield of_saltation(scene, solids, _solids_flow(scene))


def _of_clusters(scene: Any, falling: float, blamed: bool) -> Derived:
    """Whether grains of a rising line move in clusters, which a steady section averages over."""
    width, square = scene.geometry.hydraulic_diameter, falling * falling
    size = scene.feed.gravity * width / square if square > 0 else math.inf
    doubt, certain = "", not blamed and not scene.model.drag.filtered
    if size > CLUSTERED and loading(scene) > CLUSTER_LOADING and certain:
        doubt = (
            "such grains rise in clusters, which are not resolved: slip and hold-up come out too"
            " small with the drag of a uniform suspension; closures.drag = 'igci' accounts for them"
            " and walls.solids = 'johnson-jackson' for the bounce off the wall"
        )
    return Derived("diameter over the length to reach terminal velocity", size, "", doubt)


def _of_the_drop(scene: Any, blamed: bool) -> Iterator[Derived]:
    """The drop by correlations over the absolute pressure at the outlet.

    Friction of the gas alone, Konno and Saito's 0.057 G sqrt(g/D) of the solids, and lift.

    blamed : whether another number is doubted, from which the drop follows
    """
    gas, feed, geometry = scene.model.gas, scene.feed, scene.geometry
    if scene.reynolds < TURBULENT:
        return
    flux = 0.0 if scene.model.solids is None else scene.model.solids.density * solids_flux(scene)
    pressure, guessed = absolute_pressure(scene)
    pressure = feed.outlet_pressure or pressure
    rise = math.sin(math.radians(geometry.inclination_deg))
    gradient = sum(friction_estimate(scene, flux))
    gradient += feed.gravity * rise * (gas.density + flux / feed.gas_velocity)
    share, doubt = abs(gradient) * geometry.length / pressure, ""
    if share > LARGEST_DROP and not gas.compressible and not blamed:
        doubt = (
            f"a gas of one density has no answer above {LARGEST_DROP:g}; shorten the line, or solve"
            f" it in parts, if feed and pressure of {pressure:g} Pa are in SI units"
        )
        if pressure < LEAST_OUTLET:
            doubt = f"is operation.outlet_pressure = {pressure:g} absolute and in Pa, not in bar?"
    name, unit = (
        "pressure drop by correlations over the pressure",
        f"({guessed})" if guessed else "",
    )
    yield Derived(name, share, unit, doubt)


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
    if not is_steep(scene):
        rizk = saltation_velocity(scene, solids, flow)
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
    level = not is_steep(scene)
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
        key, light = feed_key(scene), scene.model.solids.density < LIGHT_GRAINS
        words = (
            f"less: it is a superficial velocity of {flux:.4g} m/s beside gas at {gas:g} m/s,"
            f" and packed grains at {FAST:g} times that carry {most:.4g} m/s; units are SI"
        )
        if light:
            words += f" (solids.density = {scene.model.solids.density:g} is in kg/m3, not g/cm3)"
        raise InputError(f"operation.{key}", getattr(scene.feed, key), words)

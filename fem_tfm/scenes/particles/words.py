# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a scene says of its particles: what it refuses, warns of, and does without."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from fem_tfm.closures.turbulence.gas import Laminar
from fem_tfm.cloud import Cloud, Material
from fem_tfm.errors import InputError
from fem_tfm.materials import Solids
from fem_tfm.models.particles.tracker import drag_factor
from fem_tfm.scenes.judged.gas import WARM, Derived
from fem_tfm.scenes.judged.grains import is_steep, of_falling, of_saltation, of_the_grains
from fem_tfm.scenes.judged.memory import refuse_beyond
from fem_tfm.scenes.judged.plausible import lifts

# above this loading the gas feels the particles
ONE_WAY_LOADING = 0.05
# speed between neighbours over that of the gas; relaxation over time between collisions told of
RELATIVE, MEETING = 0.03, 0.3
# Reynolds number at which a law of lone particles is near Stokes's, and how far it may be
CREEPING, BED_LAW = 0.01, 0.5
# velocity of particles at the entrance over that of the gas that was hardly meant
FASTEST = 1.5
# beyond this fraction a cloud of parcels is no model
DENSE = 0.1
# measured: steps of a parcel over a line in units of its eddies, CPU time of a step [s]
STEP_TIME, SLAB_TRACES = 9e-8, 4.0
# measured with a million parcels: memory of a parcel, and of what an unsteady line keeps of it at
# each place [MB]
PARCEL_MEMORY, PLACE_MEMORY = 1.6e-3, 2.8e-4


def gas_flow(scene: Any) -> float:
    """Mass flow of the gas of a scene [kg/s]."""
    area, density = scene.geometry.area, scene.model.gas.density
    return float(scene.feed.gas_velocity * area * density)


def entrance_fraction(scene: Any, material: Material) -> float:
    """Volume fraction of a material where it enters [-]."""
    flow = scene.particles.mass_flow(material, gas_flow(scene))
    speed = scene.feed.gas_velocity if material.velocity is None else material.velocity
    if speed <= 0:
        return math.inf
    return float(flow / (material.density * scene.geometry.area * speed))


def parcel_memory(scene: Any) -> float:
    """About the memory that the particles of a scene take [MB]."""
    cloud: Cloud | None = scene.particles
    if cloud is None:
        return 0.0
    places = cloud.stations + 1 if scene.solution == "unsteady" else 0
    count = cloud.parcels * cloud.entries * len(cloud.materials)
    return count * (PARCEL_MEMORY + PLACE_MEMORY * places)


def check(scene: Any, two_way: bool) -> None:
    """Refuse a cloud that does not fit a scene.

    two_way : whether the kind of scene couples both ways

    Raises
    ------
    InputError
        a particle or a point lies outside the section, coupling that the scene cannot do, or more
        particles than a cloud of parcels can stand for.
    """
    cloud: Cloud = scene.particles
    width, height = scene.geometry.size
    if cloud.coupling == "two-way" and not two_way:
        words = (
            f"'one-way' for {scene.kind}; flow = 'duct' with solution = 'developing' couples both"
            " ways"
        )
        raise InputError("particles.coupling", cloud.coupling, words)
    if cloud.release == "during" and scene.solution != "unsteady":
        words = f"'after' for {scene.kind}, whose gas is steady; solution = 'unsteady' knows times"
        raise InputError("particles.release", cloud.release, words)
    if cloud.heat and getattr(scene.model, "heat", None) is None:
        words = "false without a table [heat], for the gas has no temperature of its own"
        raise InputError("particles.heat", True, words)
    if cloud.heat and not two_way:
        words = f"false for {scene.kind}, where the temperature of the gas has no origin"
        raise InputError("particles.heat", True, words)
    if cloud.modulation and not cloud.dispersion.turbulent:
        words = "false with particles.dispersion = 'none', which knows no eddies"
        raise InputError("particles.modulation", True, words)
    section = scene.geometry.section("none")
    for point in cloud.points:
        x, y = point[:2]
        outside = abs(x) > width / 2 or abs(y) > height / 2
        if outside or float(np.min(section.wall_distance(np.array([[x], [y]])))) < 1e-6 * width:
            words = f"points inside the section, which reaches {width / 2:g} m from the axis"
            raise InputError("particles.points", point, words)
    words = "fewer: what is kept of them"
    refuse_beyond(parcel_memory(scene), "particles.parcels", cloud.parcels, words)
    for number, material in enumerate(cloud.materials):
        key = f"particles.materials[{number}]"
        _check_size(material, key, min(width, height))
        if material.temperature is not None and not cloud.heat:
            words = "none with particles.heat = false, where no particle has a temperature"
            raise InputError(f"{key}.temperature", material.temperature, words)
        if material.velocity == 0:
            words = "a velocity above 0, or nothing enters"
            raise InputError(f"{key}.velocity", material.velocity, words)
        _check_fraction(scene, material, key)


def _check_size(material: Material, key: str, room: float) -> None:
    """Refuse particles that do not fit into a section [m]; raises InputError for their table."""
    largest = float(material.sizes(np.ones(1))[0])
    if material.diameter >= room:
        words = f"a diameter below {room:g} m, to fit in the section"
        raise InputError(f"{key}.diameter", material.diameter, words)
    if largest >= room:
        words = (
            f"a distribution that fits in the section, {room:g} m; the coarsest particle of this"
            f" one has {largest:.3g} m, and a spread has no unit"
        )
        raise InputError(f"{key}.spread", material.spread, words)


def _check_fraction(scene: Any, material: Material, key: str) -> None:
    """Refuse more particles than a cloud of parcels can stand for; raises InputError."""
    fraction = entrance_fraction(scene, material)
    if fraction < DENSE:
        return
    cloud, own = scene.particles, material.velocity
    words = (
        f"one at which less than {DENSE:g} of the volume is particles (here {fraction:.2g});"
        " flow = 'dense' solves more"
    )
    if own is not None and fraction * own < DENSE * scene.feed.gas_velocity:
        # as fast as the gas they would be few enough
        raise InputError(f"{key}.velocity", own, words)
    for name in ("mass_flow", "loading"):
        if getattr(material, name) is not None:
            raise InputError(f"{key}.{name}", getattr(material, name), words)
    raise InputError("particles.points", list(cloud.points[0]), words)


def advice(scene: Any) -> list[str]:
    """What the user probably did not mean, one sentence each."""
    cloud: Cloud = scene.particles
    said, loading = [], cloud.loading(gas_flow(scene))
    # materials of a cloud that is not coupled do not share the gas
    heaviest = max(cloud.mass_flow(m, gas_flow(scene)) for m in cloud.materials)
    one_way = cloud.coupling == "one-way"
    alone = heaviest / gas_flow(scene)
    if one_way and alone > ONE_WAY_LOADING:
        said.append(
            f"a loading of {alone:.3g} is not one-way: the gas gives its momentum to the particles,"
            " and its pressure drop and velocities are not those of the gas alone;"
            " particles.coupling = 'two-way' with solution = 'developing' solves both"
        )
    said += _meetings(scene) + _drag_of_one(scene)
    if cloud.points and any(m.mass_flow or m.loading for m in cloud.materials):
        said.append(
            "the mass flows of particles.points are shares, for a material gives its own mass flow"
        )
    if not one_way and loading > 0 and cloud.parcels * cloud.entries < 5000:
        said.append(
            f"{cloud.parcels * cloud.entries} parcels make a rough force on the gas; some 500 a"
            " point are needed, 2000 a point are good"
        )
    return said


def derived(scene: Any, blamed: bool) -> list[Derived]:
    """Numbers of the materials, and what they give away.

    blamed : whether the gas is doubted
    """
    found = []
    for at, material in enumerate(scene.particles.materials):
        numbers = _of_a_material(scene, material, at, blamed)
        found += [replace(one, name=f"{material.name}: {one.name}") for one in numbers]
    return found


def _of_a_material(scene: Any, material: Material, at: int, blamed: bool) -> Iterator[Derived]:
    """What a grain of a material gives away; parcels form no bed."""
    grains = Solids(material.density, material.diameter)
    yield from of_the_grains(scene, grains, f"particles.materials[{at}]", blamed)
    if material.velocity is not None and material.velocity > FASTEST * scene.feed.gas_velocity:
        ratio = material.velocity / scene.feed.gas_velocity
        doubt = (
            f"is particles.materials[{at}].velocity = {material.velocity:g} in m/s, not in km/h?"
        )
        yield Derived("velocity at the entrance over that of the gas", ratio, "", doubt)
    if material.temperature is not None:
        ratio, doubt = material.temperature / scene.model.gas.temperature, ""
        if not WARM[0] <= ratio <= WARM[1]:
            given = f"particles.materials[{at}].temperature = {material.temperature:g}"
            doubt = f"is {given} in K, not in degrees Celsius?"
        yield Derived("temperature at the entrance over that of the gas", ratio, "", doubt)
    if "gravity" not in scene.particles.forces or not scene.feed.gravity > 0:
        return
    yield of_falling(scene, grains)
    if not is_steep(scene):
        doubt = (
            "parcels form no bed: what would settle is carried on; flow = 'dense' with [solids]"
            " solves beds"
        )
        flow = scene.particles.mass_flow(material, gas_flow(scene))
        yield of_saltation(scene, grains, flow, "" if lifts(scene, grains) else doubt)


def _meetings(scene: Any) -> list[str]:
    """Whether particles meet each other before the gas has turned them.

    tau_p f with f = 6 alpha_p v/d, v 3 % of the gas velocity between neighbours: far below one
    the gas alone moves a particle, above it collisions do (Crowe et al., Multiphase Flows with
    Droplets and Particles, 2011, section 2.5).
    """
    cloud, gas = scene.particles, scene.model.gas
    if cloud.collisions is not None:
        return []
    said = []
    for material in cloud.materials:
        speed = scene.feed.gas_velocity
        flow = cloud.mass_flow(material, gas_flow(scene))
        fraction = flow / (material.density * scene.geometry.area * speed)
        slip = RELATIVE * speed
        reynolds = gas.density * slip * material.diameter / gas.viscosity
        factor = 1 + 0.15 * reynolds**0.687
        relaxation = material.density * material.diameter**2 / (18 * gas.viscosity * factor)
        between = material.diameter / (6 * fraction * slip)
        if relaxation > MEETING * between:
            said.append(
                f"{material.name}: a particle meets another every {between:.2g} s or so, and the"
                f" gas takes {relaxation:.2g} s to turn it; particles.collisions = 'sommerfeld'"
                " lets them collide, which is left out"
            )
    return said


def _drag_of_one(scene: Any) -> list[str]:
    """Whether a law of drag is one of beds: far from Stokes at a small Reynolds number."""
    cloud = scene.particles
    one = Solids(cloud.materials[0].density, cloud.materials[0].diameter)
    factor = float(drag_factor(cloud.drag, np.array([CREEPING]), scene.model.gas, one)[0])
    if abs(factor - 1) < BED_LAW:
        return []
    return [
        f"particles.drag = {cloud.drag.name!r} pulls a lone particle {factor:.3g} times as much as"
        f" Stokes's law at Re = {CREEPING:g}, so that it is outside its range;"
        " particles.drag = 'clift-gauvin' is a law of lone particles"
    ]


def skipped(scene: Any) -> list[str]:
    """What the particles are followed without, and why."""
    cloud, left_out = scene.particles, []
    if scene.solution == "unsteady" and cloud.release == "after":
        words = "they see its last state; particles.release = after"
        left_out.append(f"change of the gas while particles pass: {words}")
    if cloud.dispersion.turbulent and isinstance(getattr(scene.model, "turbulence", None), Laminar):
        left_out.append("scattering by turbulence: the gas is laminar")
    if cloud.coupling == "one-way":
        left_out.append("force of the particles on the gas: particles.coupling = one-way")
    if "gravity" not in cloud.forces:
        left_out.append("weight of the particles: not in particles.forces")
    if cloud.collisions is None:
        left_out.append("collisions between particles: no particles.collisions")
    if not cloud.heat:
        left_out.append("heat of the particles: particles.heat = false")
    return left_out


def words(scene: Any) -> str:
    """What is followed and what it takes."""
    cloud: Cloud = scene.particles
    count = cloud.parcels * cloud.entries
    loading = cloud.loading(gas_flow(scene))
    flow = gas_flow(scene)
    names = ", ".join(f"{m.name} {cloud.mass_flow(m, flow):.3g} kg/s" for m in cloud.materials)
    total = count * len(cloud.materials)
    # eddies live for some 0.2 k/eps, about a twentieth of the time to cross the section
    eddies = 20 * scene.geometry.length / scene.geometry.hydraulic_diameter
    steps = total * eddies / cloud.step
    time = STEP_TIME * steps * (SLAB_TRACES if cloud.coupling == "two-way" else 1.0)
    return (
        f"{names}: {count} parcels each, {cloud.coupling}, loading {loading:.3g}; about"
        f" {time:.1g} s to follow them"
    )

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Particles that a gas carries, as a user states them: materials, where they enter, their laws.

A cloud is followed parcel by parcel; a parcel stands for a number of equal particles a second.
"""

from __future__ import annotations

import math
from dataclasses import MISSING, dataclass
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from fem_tfm.closures.base import Closure, law, optional_law
from fem_tfm.closures.drag import Drag
from fem_tfm.closures.particles.collisions import ParticleCollisions
from fem_tfm.closures.particles.dispersion import ParticleDispersion
from fem_tfm.closures.particles.impact import ImpactLaw
from fem_tfm.closures.particles.wear import Wear
from fem_tfm.errors import InputError
from fem_tfm.geometry.section import RectangularSection, Section
from fem_tfm.parameters import Parameters, parameter

Force = Literal["drag", "gravity", "pressure-gradient", "saffman", "magnus", "added-mass"]
# exponent of the velocity profile that a fed section follows
POWER = 1 / 7
# the finest and the coarsest share of the mass that a size distribution keeps
TAILS = (1e-3, 1 - 1e-3)
# the widest distribution of Rosin and Rammler that is spread over decades alone
LEAST_EXPONENT = 0.3


@dataclass(frozen=True)
class Material(Parameters):
    """Spheres of one material: what they are, how much of them enters, and how fast.

    size : distribution of the mass over the diameter. "lognormal" has the median `diameter` and the
        geometric standard deviation `spread`; "rosin-rammler" is R = exp(-(d/diameter)^spread), the
        share of the mass that is coarser than d.

    Raises InputError for a number out of range, or a spread that does not fit the distribution.
    """

    name: str = parameter(MISSING, doc="name of the material")
    density: float = parameter(MISSING, "kg/m3", "density of a particle", ge=1e-3, le=25000)
    diameter: float = parameter(MISSING, "m", "diameter of a particle", ge=1e-9, le=0.1)
    mass_flow: float | None = parameter(
        None, "kg/s", "mass flow, default the sum over the points", gt=0, le=1e6
    )
    loading: float | None = parameter(
        None, "-", "mass flow over that of the gas, in place of mass_flow", gt=0, le=1e4
    )
    velocity: float | None = parameter(
        None, "m/s", "axial velocity at the entrance, default that of the gas", ge=0, le=1000
    )
    size: Literal["uniform", "lognormal", "rosin-rammler"] = parameter(
        "uniform", doc="distribution of the mass over the diameter"
    )
    spread: float | None = parameter(
        None, "-", "geometric standard deviation, or exponent of Rosin and Rammler", gt=0, le=100
    )
    temperature: float | None = parameter(
        None, "K", "temperature at the entrance, default that of the gas", ge=100, le=5000
    )
    heat_capacity: float = parameter(800.0, "J/kg/K", "heat capacity", ge=100, le=1e5)
    table: ClassVar[str] = "materials"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.name.isidentifier():
            words = "a name of letters, digits and underscores, for quantities carry it"
            raise InputError("materials.name", self.name, words)
        if self.mass_flow is not None and self.loading is not None:
            raise InputError("materials.loading", self.loading, "no loading beside mass_flow")
        least = {"uniform": None, "lognormal": 1.0, "rosin-rammler": LEAST_EXPONENT}[self.size]
        if (self.spread is None) != (least is None):
            words = f"{'no' if least is None else 'a'} spread beside size = {self.size!r}"
            raise InputError("materials.spread", self.spread, words)
        if least is not None and self.spread is not None and self.spread <= least:
            words = f"a number above {least:g} with size = {self.size!r}"
            raise InputError("materials.spread", self.spread, words)

    def sizes(self, shares: NDArray[np.float64]) -> NDArray[np.float64]:
        """Diameters below which these shares of the mass are [m]; the tails are cut.

        Lognormal: d = diameter spread^N^-1(share). Rosin and Rammler:
        d = diameter (-ln(1 - share))^(1/spread).
        """
        if self.spread is None:
            return np.full_like(shares, self.diameter)
        low, high = TAILS
        share = low + (high - low) * shares
        if self.size == "lognormal":
            return self.diameter * np.asarray(self.spread ** ndtri(share))
        return self.diameter * np.asarray((-np.log1p(-share)) ** (1 / self.spread))

    def mass(self, diameter: NDArray[np.float64]) -> NDArray[np.float64]:
        """rho pi d^3/6 of a particle [kg]."""
        return np.asarray(self.density * math.pi / 6 * diameter**3)


@dataclass(frozen=True)
class Cloud(Parameters):
    """Particles that a gas carries.

    injection : "area" feeds the whole section, in proportion to the velocity with profile =
        "power-law"; "points" feeds points [x, y, mass flow] from the axis [m, kg/s]. Where a
        material gives its mass flow, the third number is a share.
    spread : parcels of a point are spread over the part of the section that is nearest to it; the
        share of a point in a uniform feed, without which a coupled gas is torn by jets.
    parcels : of each point, or of the whole area, for each material
    release : "after" follows all parcels through the last gas of an unsteady flow; "during" lets
        them enter evenly over the time of the run, and each sees the gas of its time. Every other
        gas is steady.
    step : a mixed cloud of points is off by 3 % at walls and 4 % in corners with a step of one
        T_L, and within a sampling error of 1 % with a half; the error goes with its square.

    Raises InputError for values that do not fit each other.
    """

    materials: tuple[Material, ...] = parameter(MISSING, doc="materials that enter")
    coupling: Literal["one-way", "two-way"] = parameter(
        "one-way", doc="whether the gas feels the particles"
    )
    injection: Literal["area", "points"] = parameter("area", doc="where particles enter")
    points: tuple[tuple[float, float, float], ...] = parameter(
        (), doc="points [x, y, mass flow] from the axis [m, m, kg/s]"
    )
    spread: bool = parameter(True, doc="spread the parcels of a point over its share of the area")
    profile: Literal["uniform", "power-law"] = parameter(
        "uniform", doc="mass flux over the area of an injection"
    )
    parcels: int = parameter(500, doc="parcels of each point, or of the area", ge=1, le=10**7)
    seed: int = parameter(1, doc="of the random numbers", ge=0, le=2**32 - 1)
    forces: tuple[Force, ...] = parameter(
        ("drag",), doc="forces on a particle; the drag acts in any case"
    )
    drag: Drag = law("drag", "clift-gauvin", "drag of a particle", "particles.drag")
    dispersion: ParticleDispersion = law(
        "particle-dispersion", "langevin", "scattering by turbulence", "particles.dispersion"
    )
    step: float = parameter(
        1.0, "-", "largest step of a parcel over the life of an eddy", ge=0.01, le=2
    )
    impact: ImpactLaw = law("impact", "elastic", "impact on a wall", "particles.impact")
    wear: Wear | None = parameter(
        None, doc="wear of the walls, none without a law", convert=optional_law("wear")
    )
    collisions: ParticleCollisions | None = parameter(
        None,
        doc="collisions between particles, none without a law",
        convert=optional_law("particle-collisions"),
    )
    release: Literal["after", "during"] = parameter(
        "after", doc="particles see the last gas of an unsteady flow, or the gas of their time"
    )
    heat: bool = parameter(False, doc="particles exchange heat with the gas")
    modulation: bool = parameter(False, doc="particles damp the turbulence of the gas")
    lateral: bool = parameter(False, doc="particles push the gas across the axis too")
    stations: int = parameter(
        60, doc="places along the line where particles are told", ge=2, le=10**5
    )
    fields: bool = parameter(
        False, doc="concentration and velocity of each material in every cell, for ParaView"
    )
    traced: int = parameter(
        50, doc="trajectories of each material that are written", ge=0, le=10**5
    )
    table: ClassVar[str] = "particles"

    def __post_init__(self) -> None:
        super().__post_init__()
        names = [material.name for material in self.materials]
        if not names:
            raise InputError(
                "particles.materials", (), "at least one table [[particles.materials]]"
            )
        if len(set(names)) < len(names):
            raise InputError("particles.materials", names, "materials with different names")
        if (self.injection == "points") != bool(self.points):
            words = "points [x, y, mass flow] with injection = 'points', and none with 'area'"
            raise InputError("particles.points", self.points, words)
        if any(not flow > 0 for _, _, flow in self.points):
            raise InputError("particles.points", self.points, "mass flows above 0")
        if self.release == "during" and (self.collisions is not None or self.fields):
            name = "fields" if self.collisions is None else "collisions"
            words = f"'after' with particles.{name}, which need the cloud of a steady gas"
            raise InputError("particles.release", self.release, words)
        if self.coupling == "one-way":
            for name in ("modulation", "lateral"):
                if getattr(self, name):
                    words = "false with particles.coupling = 'one-way'"
                    raise InputError(f"particles.{name}", True, words)
        for material in self.materials:
            if not self.points and material.mass_flow is None and material.loading is None:
                words = "mass_flow or loading, for injection = 'area' has no mass flows of points"
                raise InputError("particles.materials.mass_flow", None, words)

    def laws(self) -> list[Closure]:
        """The laws that are used."""
        options = [law for law in (self.wear, self.collisions) if law is not None]
        return [self.drag, self.dispersion, self.impact, *options]

    def mass_flow(self, material: Material, gas_flow: float) -> float:
        """Mass flow of a material [kg/s] beside that of the gas [kg/s]."""
        if material.mass_flow is not None:
            return material.mass_flow
        if material.loading is not None:
            return material.loading * gas_flow
        return sum(flow for _, _, flow in self.points)

    def loading(self, gas_flow: float) -> float:
        """Mass flow of all materials over that of the gas [-]."""
        return sum(self.mass_flow(one, gas_flow) for one in self.materials) / gas_flow

    @property
    def entries(self) -> int:
        """Points that feed, or 1 for an area."""
        return max(len(self.points), 1)


@dataclass(frozen=True)
class Entering:
    """Parcels of one material at the entrance, n of them.

    x, y : places from the axis [m]
    diameter : [m]
    rate : particles a second that a parcel stands for [1/s]
    entry : number of its point, 0 for an area
    """

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    diameter: NDArray[np.float64]
    rate: NDArray[np.float64]
    entry: NDArray[np.int32]


def parcels(cloud: Cloud, number: int, section: Section, gas_flow: float) -> Entering:
    """Parcels of the material of a number as they enter a section.

    They are spread evenly over their area and their sizes by a Latin hypercube; each parcel of a
    point carries the same mass.

    gas_flow : mass flow of the gas [kg/s]
    """
    # imported here, as it takes half a second and most cases draw none
    from scipy.stats import qmc

    material = cloud.materials[number]
    count = cloud.parcels * cloud.entries
    draws = qmc.LatinHypercube(d=3, rng=np.random.default_rng([cloud.seed, number])).random(count)
    diameter = material.sizes(draws[:, 2])
    x, y = _spread(section, draws[:, 0], draws[:, 1], diameter)
    total = cloud.mass_flow(material, gas_flow)
    if cloud.injection == "area":
        entry = np.zeros(count, dtype=np.int32)
        weight = _flux(section, x, y) if cloud.profile == "power-law" else np.ones(count)
    else:
        at, shares = np.array(cloud.points)[:, :2], np.array(cloud.points)[:, 2]
        entry = _entries(at, x, y, cloud)
        x, y = (x, y) if cloud.spread else (at[entry, 0], at[entry, 1])
        weight = (shares / np.bincount(entry, minlength=len(at)))[entry]
    flow = total * weight / weight.sum()
    return Entering(x, y, diameter, flow / material.mass(diameter), entry)


def _spread(
    section: Section,
    first: NDArray[np.float64],
    second: NDArray[np.float64],
    diameter: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Places spread evenly over a section, a radius of the particle off its wall [m]."""
    width, height = section.size
    if isinstance(section, RectangularSection):
        return (width - diameter) * (first - 0.5), (height - diameter) * (second - 0.5)
    r, angle = (width - diameter) / 2 * np.sqrt(first), 2 * math.pi * second
    return r * np.cos(angle), r * np.sin(angle)


def _flux(section: Section, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """(wall distance/radius)^(1/7) [-]."""
    distance = np.asarray(section.wall_distance(np.vstack([x, y])))
    return np.asarray((distance / section.radius) ** POWER)


def _entries(
    at: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64], cloud: Cloud
) -> NDArray[np.int32]:
    """Numbers of the points that parcels belong to: the nearest, or in turn without spread."""
    if not cloud.spread:
        return np.repeat(np.arange(len(at), dtype=np.int32), cloud.parcels)
    gap = (x[:, None] - at[:, 0]) ** 2 + (y[:, None] - at[:, 1]) ** 2
    entry = gap.argmin(axis=1).astype(np.int32)
    for point in np.setdiff1d(np.arange(len(at)), entry):
        # a point whose share holds no parcel takes the one that is nearest to it
        entry[gap[:, point].argmin()] = point
    return entry

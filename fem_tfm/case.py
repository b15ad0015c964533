# SPDX-License-Identifier: LGPL-3.0-or-later
"""The case: what to solve, with units, defaults and ranges.

A case is a TOML file or a dictionary of the same shape; SI units. Every key is declared once
here, with its default, unit, meaning and range. A new key is one line in its table; a new
kind of flow is one line in `FLOWS`. Whatever is wrong raises `InputError`; nothing is written.
"""

from __future__ import annotations

import math
import os
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, get_args, get_origin

import tomli_w
from mpi4py import MPI
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    field_serializer,
    field_validator,
    model_validator,
)
from pydantic.fields import FieldInfo

from fem_tfm.errors import InputError, nearest
from fem_tfm.materials import SPECIES

if TYPE_CHECKING:
    from fem_tfm.closures.base import Closure
    from fem_tfm.materials import Gas as GasMaterial
    from fem_tfm.materials import Solids as SolidsMaterial
    from fem_tfm.output.result import Result

FLOWS = {"dense": "fem_tfm.flows.dense", "duct": "fem_tfm.flows.duct"}
# defaults of keys that depend on the kind of flow
FLOW_DEFAULTS: dict[str, dict[str, dict[str, Any]]] = {
    "duct": {
        "numerics": {"cells": "quadrilateral", "wall_grading": 0.0625},
        "inlet": {"profile": "uniform"},
    },
}
# solutions that have a module of their own, for each flow that has the solution
SOLUTIONS = {
    "developing": {
        "dense": "fem_tfm.flows.developing",
        "duct": "fem_tfm.flows.duct_developing",
    },
    "unsteady": {"dense": "fem_tfm.flows.unsteady"},
}
# defaults of keys that depend on the solution
SOLUTION_DEFAULTS: dict[str, dict[str, dict[str, Any]]] = {
    "unsteady": {"numerics": {"cells": "quadrilateral"}},
}

QUANTITIES = {
    "pressure_gradient": "Pa/m",
    "pressure_drop": "Pa",
    "solids_mass_flow": "kg/s",
    "gas_mass_flow": "kg/s",
    "holdup": "-",
    "max_solids_fraction": "-",
    "bed_fraction": "-",
    "slip_velocity": "m/s",
    "friction_factor": "-",
    "secondary_velocity_max": "-",
    "secondary_velocity_diagonal": "-",
    "centre_to_bulk": "-",
    "axis_energy": "-",
    "corner_wall_shear": "-",
    "smallest_stress": "-",
    "wall_distance_plus": "-",
    "overshoot": "-",
    "overshoot_position": "m",
    "overshoot_diameters": "-",
    "development_length": "m",
    "nusselt": "-",
    "turbulent_prandtl_axis": "-",
    "turbulent_prandtl_wall": "-",
    "outlet_temperature": "K",
    "bed_height": "m",
    "entrance_pressure_drop": "Pa",
}

FIELDS = (
    "alpha_s", "u_s", "u_g", "theta", "pressure", "k", "eps", "k_s", "eps_s", "reynolds_stress",
    "temperature", "heat_flux",
)  # fmt: skip

# names that stand for laws of two families
FOUR_EQUATION = "realizable-4eq"

FEEDS = ("solids_fraction", "solids_superficial_velocity", "solids_mass_flow")

# ways to give one thing, each a key with its companions: a changed key replaces the other ways
INSTEAD = {
    "operation": {**dict.fromkeys(FEEDS, ()), "solids_fraction": ("solids_velocity",)},
    "gas": {"density": (), "species": ("pressure",), "gas_constant": ("pressure",)},
}


def _key(default: Any, unit: str, doc: str, **bounds: float) -> Any:
    """Declare a key: default (... = required), unit, meaning and range (gt, ge, lt, le)."""
    return Field(default, description=doc, json_schema_extra={"unit": unit}, **bounds)


class Table(BaseModel):
    """A table of the case file: immutable, no unknown keys, no silent conversions."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, validate_default=True
    )


class Geometry(Table):
    """The conveying line; its section lies in x, y with y up, z downstream.

    A bend is a pipe that turns by an angle; its length is that of the axis, legs and arc together.
    """

    shape: Literal["pipe", "duct", "bend"] = _key("pipe", "", "shape of the line")
    diameter: float | None = _key(None, "m", "inner diameter of a pipe or bend", gt=0, le=100)
    width: float | None = _key(None, "m", "inner width of a duct", gt=0, le=100)
    height: float | None = _key(None, "m", "inner height of a duct, default width", gt=0, le=100)
    length: float = _key(1.0, "m", "length over which the pressure drop is told", gt=0, le=1e5)
    inclination_deg: float = _key(
        0.0, "deg", "angle of the inlet's axis above the horizontal", ge=-90, le=90
    )
    bend_radius: float | None = _key(
        None, "m", "radius of the axis of a bend, default 3 diameters", gt=0, le=1e4
    )
    bend_angle_deg: float = _key(90.0, "deg", "angle by which a bend turns", gt=0, le=180)
    bend_start: float | None = _key(
        None, "m", "straight leg before a bend, default half the straight length", ge=0, le=1e5
    )
    bend_towards: Literal["up", "down", "side"] = _key("up", "", "to where a bend turns")
    symmetry: Literal["auto", "quarter", "half", "none"] = _key(
        "auto", "", "part of the section solved"
    )

    @model_validator(mode="after")
    def _sizes_of_the_shape(self) -> Self:
        """A pipe and a bend have a diameter, a duct a width; neither has the other's."""
        needed, foreign = ("diameter", ("width", "height"))
        if self.shape == "duct":
            needed, foreign = ("width", ("diameter",))
        for name in foreign:
            if getattr(self, name) is not None:
                allowed = f"geometry.{needed} in its place for shape {self.shape!r}"
                raise InputError(f"geometry.{name}", getattr(self, name), allowed)
        if getattr(self, needed) is None:
            allowed = f"{_allowed(Geometry.model_fields[needed])} for shape {self.shape!r}"
            raise InputError(f"geometry.{needed}", None, allowed)
        return self

    @model_validator(mode="after")
    def _bend_fits(self) -> Self:
        """A bend turns about a point outside the pipe; legs and arc make up its length."""
        if self.shape != "bend":
            for name in ("bend_radius", "bend_start"):
                if getattr(self, name) is not None:
                    value = getattr(self, name)
                    raise InputError(f"geometry.{name}", value, "geometry.shape = 'bend' beside it")
            return self
        if self.axis_radius <= self.diameter / 2:
            allowed = f"a radius above half the diameter, {self.diameter / 2:g} m"
            raise InputError("geometry.bend_radius", self.bend_radius, allowed)
        before, arc, _ = self.legs
        if before + arc > self.length * (1 + 1e-9):
            allowed = f"at least the leg before the bend and its arc, {before + arc:g} m"
            raise InputError("geometry.length", self.length, allowed)
        if self.bend_towards == "side" and self.symmetry == "half":
            allowed = "'none' or 'auto' where the bend turns to the side"
            raise InputError("geometry.symmetry", self.symmetry, allowed)
        return self

    @property
    def axis_radius(self) -> float:
        """Radius of the axis of a bend [m]."""
        return self.bend_radius or 3 * self.diameter

    @property
    def legs(self) -> tuple[float, float, float]:
        """Lengths along the axis before, in and behind the arc of a bend [m]."""
        arc = self.axis_radius * math.radians(self.bend_angle_deg)
        straight = max(self.length - arc, 0.0)
        before = straight / 2 if self.bend_start is None else self.bend_start
        return before, arc, max(straight - before, 0.0)

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the section [m]."""
        if self.shape == "duct":
            return self.width, self.height or self.width
        return self.diameter, self.diameter

    @property
    def area(self) -> float:
        """Area A of the whole section [m2]."""
        width, height = self.size
        return width * height * (1 if self.shape == "duct" else math.pi / 4)

    @property
    def hydraulic_diameter(self) -> float:
        """D_h = 4 A/perimeter [m]."""
        width, height = self.size
        return 2 * width * height / (width + height)


class Gas(Table):
    """The gas: its density, or an ideal gas at a pressure and temperature."""

    density: float | None = _key(None, "kg/m3", "density", gt=0, le=2000)
    species: str | None = _key(None, "", "an ideal gas by its name")
    gas_constant: float | None = _key(None, "J/kg/K", "an ideal gas by R", gt=0, le=5000)
    pressure: float | None = _key(None, "Pa", "absolute pressure of an ideal gas", gt=0, le=1e9)
    temperature: float = _key(293.0, "K", "temperature", gt=0, le=5000)
    viscosity: float | None = _key(
        None, "Pa s", "dynamic viscosity, default that of the species", gt=0, le=1
    )
    compressible: bool = _key(
        False, "", "density of an ideal gas that follows the pressure of an unsteady flow"
    )

    @field_validator("species")
    @classmethod
    def _known_species(cls, name: str | None) -> str | None:
        if name is not None and name not in SPECIES:
            raise InputError("gas.species", name, _one_of(SPECIES), nearest(name, SPECIES))
        return name

    @model_validator(mode="after")
    def _one_density(self) -> Self:
        """Exactly one of density, species and gas_constant; a viscosity or a species."""
        _exactly_one(self, "gas", ("density", "species", "gas_constant"))
        if self.density is not None and self.pressure is not None:
            allowed = "no pressure beside gas.density; give gas.species for an ideal gas"
            raise InputError("gas.pressure", self.pressure, allowed)
        if self.density is not None and self.compressible:
            allowed = "false beside gas.density; give gas.species or gas.gas_constant in its place"
            raise InputError("gas.compressible", True, allowed)
        if self.density is None and self.pressure is None:
            raise InputError("gas.pressure", None, _allowed(Gas.model_fields["pressure"]))
        if self.viscosity is None and self.species is None:
            raise InputError("gas.viscosity", None, _allowed(Gas.model_fields["viscosity"]))
        return self

    @property
    def gas_density(self) -> float:
        """The density given, or rho = p/(R T) [kg/m3]."""
        if self.density is not None:
            return self.density
        constant = self.gas_constant or SPECIES[self.species].gas_constant
        return self.pressure / (constant * self.temperature)

    @property
    def gas_viscosity(self) -> float:
        """The viscosity given, or that of the species at the temperature [Pa s]."""
        return self.viscosity or SPECIES[self.species].viscosity(self.temperature)


class Solids(Table):
    """The particles: spheres of one size."""

    density: float = _key(..., "kg/m3", "density of the particle", gt=0, le=25000)
    diameter: float = _key(..., "m", "diameter of the particle", gt=0, le=0.1)
    restitution: float = _key(0.7, "", "particle-particle restitution", gt=0, le=1)
    packing_limit: float = _key(0.63, "", "largest solids fraction", gt=0, lt=0.7406)
    friction_limit: float = _key(0.4, "", "solids fraction where friction begins", gt=0, lt=0.7406)
    friction_angle_deg: float = _key(32.0, "deg", "angle of internal friction", gt=0, lt=90)

    @model_validator(mode="after")
    def _ordered_limits(self) -> Self:
        if self.friction_limit >= self.packing_limit:
            allowed = f"a number below solids.packing_limit = {self.packing_limit}"
            raise InputError("solids.friction_limit", self.friction_limit, allowed)
        return self


# pairs of numbers: points of a function of time, or intervals
Pairs = Annotated[
    tuple[Annotated[tuple[float, float], Field(strict=False)], ...], Field(strict=False)
]


class Operation(Table):
    """How the line is driven: the flux of gas, and the hold-up or the flux of solids.

    An unsteady flow may change with time: a schedule lists [time, factor], linear between them and
    constant before the first and after the last.
    """

    gas_superficial_velocity: float = _key(
        ..., "m/s", "gas volume flow over the area of the section", gt=0, le=300
    )
    solids_fraction: float | None = _key(
        None, "", "mean solids fraction of the section (hold-up)", gt=0, lt=0.7406
    )
    solids_velocity: float | None = _key(
        None, "m/s", "with solids_fraction: their product is the solids flux", gt=0, le=300
    )
    solids_superficial_velocity: float | None = _key(
        None, "m/s", "solids volume flow over the area of the section", gt=0, le=300
    )
    solids_mass_flow: float | None = _key(None, "kg/s", "mass flow of solids", gt=0, le=1e5)
    outlet_pressure: float | None = _key(None, "Pa", "absolute outlet pressure", gt=0, le=1e9)
    gravity: float = _key(9.81, "m/s2", "acceleration of gravity", ge=0, le=1000)
    gas_schedule: Pairs = _key((), "s, -", "gas velocity over time, over the one given")
    solids_schedule: Pairs = _key((), "s, -", "solids that enter over time, over what is given")
    outlet_blocked: Pairs = _key((), "s", "times [from, to] in which the outlet holds the solids")

    @field_validator("gas_schedule", "solids_schedule")
    @classmethod
    def _a_function_of_time(cls, points: tuple, info: ValidationInfo) -> tuple:
        """Times grow, factors are no flow backwards."""
        times = [time for time, _ in points]
        grow = all(a < b for a, b in pairwise(times))
        if not (grow and all(time >= 0 and factor >= 0 for time, factor in points)):
            allowed = "pairs [time, factor] with times that grow from 0 s or later, factors >= 0"
            raise InputError(f"operation.{info.field_name}", _plain(points), allowed)
        return points

    @field_validator("outlet_blocked")
    @classmethod
    def _intervals(cls, spans: tuple) -> tuple:
        ends = [time for span in spans for time in span]
        if not all(a < b for a, b in pairwise([-1e-300, *ends])):
            allowed = "pairs [from, to] of times that grow from 0 s or later"
            raise InputError("operation.outlet_blocked", _plain(spans), allowed)
        return spans

    @model_validator(mode="after")
    def _one_feed(self) -> Self:
        if any(getattr(self, name) is not None for name in FEEDS):
            _exactly_one(self, "operation", FEEDS)
        if self.solids_velocity is not None and self.solids_fraction is None:
            allowed = "operation.solids_fraction beside it"
            raise InputError("operation.solids_velocity", self.solids_velocity, allowed)
        return self


class Inlet(Table):
    """How the flow enters a line whose development is solved."""

    profile: Literal["power-law", "uniform"] = _key(
        "power-law", "", "velocities of both phases at the inlet, power 1/7 or uniform"
    )
    solids_intensity: float = _key(
        0.05, "", "agitation and turbulence of the solids over their mean velocity", gt=0, le=1
    )
    gas_intensity: float = _key(0.1, "", "turbulence of the gas over its mean velocity", gt=0, le=1)
    length_scale: float = _key(
        0.07, "", "length of the eddies over the hydraulic diameter", gt=0, le=1
    )


class Initial(Table):
    """The flow from which an unsteady solution starts; nothing moves but with state = 'inlet'."""

    state: Literal["rest", "bed", "inlet"] = _key(
        "rest", "", "gas alone, a bed of solids, or the whole line filled with what enters"
    )
    bed_fraction: float = _key(0.55, "", "solids fraction of the bed", gt=0, lt=0.7406)
    bed_height: float | None = _key(
        None,
        "m",
        "height of the bed above the lowest wall, default all of it",
        gt=0,
        le=100,
    )
    bed_start: float = _key(0.0, "m", "where along the line the bed begins", ge=0, le=1e5)
    bed_end: float | None = _key(
        None, "m", "where along the line the bed ends, default the outlet", gt=0, le=1e5
    )

    @model_validator(mode="after")
    def _bed_has_a_length(self) -> Self:
        if self.bed_end is not None and self.bed_end <= self.bed_start:
            allowed = f"a place behind initial.bed_start = {self.bed_start:g} m"
            raise InputError("initial.bed_end", self.bed_end, allowed)
        return self


KINDS = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "a text",
}

# default distance of a duct's wall function in wall units, and its least share of D_h
WALL_PLUS, SMALLEST_DISTANCE = 40.0, 0.004
# the same of a wall that the mesh resolves, and the least Reynolds number that it is made for
SUBLAYER_PLUS, SLOWEST = 2.0, 4e3

LIMITS = {"gt": "above", "ge": "at least", "lt": "below", "le": "at most"}

LAWS = (
    "drag", "radial", "granular", "friction", "turbulence", "dispersed", "dispersion",
    "reynolds_stress", "heat_flux",
)  # fmt: skip


# keys of the laws at walls and the families they come from
WALL_LAWS = {
    "gas": "gas-wall",
    "solids": "solids-wall",
    "function": "wall-function",
    "heat": "thermal-wall",
}


class Closures(Table):
    """The laws of the model: each a name, or a table { model = name, parameter = value }."""

    drag: Any = _key("three-zone", "", "gas-solids drag")
    radial: Any = _key("savage", "", "radial distribution at contact")
    granular: Any = _key("gidaspow", "", "kinetic theory of granular flow")
    theta: Literal["transport", "algebraic"] = _key("transport", "", "granular temperature")
    friction: Any = _key("berzi", "", "frictional stress of the solids")
    turbulence: Any = _key("mixing-length", "", "turbulence of the gas")
    dispersed: Any = _key("none", "", "turbulence of the solids")
    dispersion: Any = _key("none", "", "turbulent dispersion of the solids")
    friction_feeds_theta: bool = _key(False, "", "frictional work becomes granular temperature")
    reynolds_stress: Any = _key("lrr", "", "Reynolds stresses of a duct's gas")
    heat_flux: Any = _key("launder", "", "turbulent heat fluxes of a duct's gas")

    @model_validator(mode="before")
    @classmethod
    def _four_equations(cls, values: Any) -> Any:
        """turbulence = "realizable-4eq" stands for two equations in each phase."""
        if isinstance(values, Mapping) and values.get("turbulence") == FOUR_EQUATION:
            return {"dispersed": "k-epsilon", **values, "turbulence": "realizable"}
        return values

    @field_validator(*LAWS, mode="before")
    @classmethod
    def _law(cls, spec: Any, info: ValidationInfo) -> Closure:
        family = info.field_name.replace("_", "-")
        return _make_law(family, spec, f"closures.{info.field_name}")

    @field_serializer(*LAWS)
    def _table(self, law: Closure) -> dict[str, Any]:
        return _law_table(law)


class Walls(Table):
    """The laws at the wall, and the distance from it at which the gas law holds.

    `gas` and `solids` belong to dense flow, `function` and `heat` to a duct's gas.
    """

    gas: Any = _key("log-law", "", "gas at the wall")
    solids: Any = _key("schneiderbauer", "", "solids at the wall")
    function: Any = _key("equilibrium", "", "wall function of a duct's gas")
    heat: Any = _key("jayatilleke", "", "wall function of the temperature")
    distance: float | None = _key(
        None, "m", "distance of the wall law, default that of the flow", gt=0, le=10
    )
    grain_gap: float = _key(
        0.0, "", "height over which the drag fades to the wall, in grain diameters", ge=0, le=10
    )

    @field_validator(*WALL_LAWS, mode="before")
    @classmethod
    def _law(cls, spec: Any, info: ValidationInfo) -> Closure:
        return _make_law(WALL_LAWS[info.field_name], spec, f"walls.{info.field_name}")

    @field_serializer(*WALL_LAWS)
    def _table(self, law: Closure) -> dict[str, Any]:
        return _law_table(law)


LAW_DEFAULTS = {
    **{f"closures.{name}": Closures.model_fields[name].default for name in LAWS},
    **{f"walls.{name}": Walls.model_fields[name].default for name in WALL_LAWS},
}


class Numerics(Table):
    """How finely and how strictly to solve."""

    level: int = _key(3, "", "finest mesh level, 1 = coarsest", ge=1, le=12)
    mesh_size: float | None = _key(None, "m", "mesh size in place of the level", gt=0, le=100)
    wall_grading: float | None = _key(
        None, "", "wall cell over core cell, default that of the mesh", gt=0, le=1
    )
    cells: Literal["triangle", "quadrilateral"] = _key("triangle", "", "shape of the cells")
    tolerance: float = _key(1e-9, "", "largest update that counts as steady", gt=0, lt=1)
    max_steps: int = _key(200, "", "largest number of pseudo-time steps", ge=1, le=1000000)
    alpha_diffusion: float | None = _key(
        None, "m2/s", "diffusion of logit(alpha_s), default that of the flow", ge=0, le=1
    )
    capture: float = _key(0.02, "", "diffusion of fronts that the mesh cannot carry", ge=0, le=1)
    damping: float = _key(0.02, "", "viscosity of the mesh in the secondary flow", ge=0, le=1)
    theta_floor: float = _key(1e-8, "m2/s2", "smallest granular temperature", ge=0, le=1)
    quadrature_degree: int = _key(5, "", "degree of the quadrature", ge=1, le=20)
    axial_step: float | None = _key(
        None, "m", "largest step along a developing flow, default 1/60 of its length", gt=0, le=1e5
    )
    axial_accuracy: float = _key(
        0.03, "", "how far a station may lie off the line through the two before it", gt=0, le=1
    )
    axial_cells: int | None = _key(
        None, "", "cells along an unsteady flow, default twice as long as wide", ge=1, le=1000000
    )
    order: int = _key(
        0,
        "",
        "of an unsteady flow, 0: upwind and implicit Euler, 1: second order in space and time",
        ge=0,
        le=1,
    )
    end_time: float | None = _key(None, "s", "end of an unsteady flow", gt=0, le=1e6)
    courant: float = _key(
        1.0, "", "largest Courant number of an unsteady flow's steps", gt=0, le=1000
    )
    time_step: float | None = _key(
        None, "s", "first step in time, default 1/100 of the largest", gt=0, le=1e6
    )
    largest_time_step: float | None = _key(
        None, "s", "largest step in time, default the interval of the output", gt=0, le=1e6
    )
    smallest_time_step: float = _key(
        1e-9, "s", "smallest step in time; the run ends below it", gt=0, le=1
    )


class Heat(Table):
    """Heat from the walls of a duct to its gas; it does not act on the flow."""

    wall: Literal["flux", "temperature"] = _key("flux", "", "what is constant along the walls")
    prandtl: float = _key(0.71, "", "Prandtl number of the gas", gt=0.1, le=1e4)
    heat_capacity: float = _key(1006.0, "J/kg/K", "at constant pressure", gt=0, le=1e5)
    wall_flux: float = _key(1000.0, "W/m2", "heat flux with wall = 'flux'", ge=-1e9, le=1e9)
    wall_temperature: float = _key(
        350.0, "K", "temperature with wall = 'temperature'", gt=0, le=5000
    )


class Output(Table):
    """What is written beside the answer."""

    fields: Annotated[tuple[Literal[FIELDS], ...], Field(strict=False)] = _key(
        FIELDS, "", "fields in fields.xdmf"
    )
    pictures: bool = _key(True, "", "write pictures")
    xdmf: bool = _key(True, "", "write fields.xdmf")
    stations: int = _key(24, "", "sections of a developing flow in fields.xdmf", ge=1, le=10000)
    interval: float | None = _key(
        None, "s", "time between the fields of an unsteady flow, default 1/20 of all", gt=0, le=1e6
    )
    checkpoint_interval: float | None = _key(
        None, "s", "time between the checkpoints, default the interval", gt=0, le=1e6
    )
    probes: Annotated[
        tuple[Annotated[tuple[float, float, float], Field(strict=False)], ...], Field(strict=False)
    ] = _key((), "m", "points [x, y, z] of an unsteady flow, one row a step in probes.csv")
    sections: Annotated[tuple[float, ...], Field(strict=False)] = _key(
        (), "m", "places along an unsteady flow, one row an interval in sections.csv"
    )


class Reference(Table):
    """A published value, printed beside the answer."""

    quantity: Literal[tuple(QUANTITIES)] = _key(..., "", "quantity of the result")
    value: float = _key(..., "", "published value in the quantity's SI unit")
    source: str = _key(..., "", "where it is published", min_length=1)


class Case(Table):
    """One problem. `Case.load(path)`, `Case.from_dict(d)` or `Case(geometry={...}, ...)`.

    Raises `InputError` for an unknown key, a value of the wrong type or outside its range, and for
    values that contradict each other.
    """

    title: str = _key("", "", "one line about the case")
    flow: Literal[tuple(FLOWS)] = _key("dense", "", "kind of flow")
    solution: Literal["auto", "developed", "developing", "unsteady"] = _key(
        "auto", "", "how the axis is treated; auto is developed"
    )
    inferred: Annotated[tuple[str, ...], Field(strict=False)] = _key(
        (), "", "inputs that the source does not print"
    )
    geometry: Geometry = _key(..., "", "conveying line")
    gas: Gas = _key(..., "", "gas")
    solids: Solids | None = _key(None, "", "particles; without the table the gas flows alone")
    operation: Operation = _key(..., "", "fluxes, hold-up, gravity")
    inlet: Inlet = Field(default_factory=Inlet, description="what enters a line")
    initial: Initial = Field(
        default_factory=Initial, description="from where an unsteady flow starts"
    )
    closures: Closures = Field(default_factory=Closures, description="laws of the model")
    walls: Walls = Field(default_factory=Walls, description="laws at the wall")
    heat: Heat | None = _key(None, "", "heat from the walls; without the table there is none")
    numerics: Numerics = Field(default_factory=Numerics, description="mesh and solver")
    output: Output = Field(default_factory=Output, description="files")
    reference: Annotated[tuple[Reference, ...], Field(strict=False)] = _key(
        (), "", "published values"
    )

    def __init__(self, **values: Any) -> None:
        try:
            super().__init__(**_plain(values))
        except ValidationError as error:
            raise _input_error(error) from None

    @model_validator(mode="before")
    @classmethod
    def _defaults_of_the_kind(cls, values: Any) -> Any:
        """Give the keys that are not given the defaults of the kind of flow and solution."""
        for key, kinds in (("solution", SOLUTION_DEFAULTS), ("flow", FLOW_DEFAULTS)):
            kind = values.get(key) if isinstance(values, dict) else None
            for table, defaults in kinds.get(kind, {}).items() if _is_name(kind) else ():
                given = values.get(table, {})
                if isinstance(given, Mapping):
                    values[table] = {**defaults, **given}
        return values

    @model_validator(mode="after")
    def _keys_of_the_flow(self) -> Self:
        """Refuse what belongs to another kind of flow."""
        if self.flow == "duct":
            absent = "no table [solids], which flow 'dense' has"
            wrong = {"solids": (self.solids, self.solids is not None, absent)}
        else:
            absent, symmetry = "no table [heat], which flow 'duct' has", self.geometry.symmetry
            wrong = {
                "heat": (self.heat, self.heat is not None, absent),
                "geometry.symmetry": (symmetry, symmetry == "quarter", "one of auto, half, none"),
            }
        for key, (value, refused, allowed) in wrong.items():
            if refused:
                raise InputError(key, value, f"{allowed} for flow {self.flow!r}")
        return self

    @model_validator(mode="after")
    def _keys_of_the_solution(self) -> Self:
        """An unsteady flow has an end; what only it can solve is refused to the others."""
        if self.solution == "unsteady":
            if self.flow not in SOLUTIONS["unsteady"]:
                raise InputError("solution", self.solution, "flow 'dense' beside it")
            if self.numerics.end_time is None:
                allowed = _allowed(Numerics.model_fields["end_time"])
                raise InputError("numerics.end_time", None, allowed)
            return self
        allowed, feed = "solution = 'unsteady' beside it", self.operation
        if self.geometry.shape == "bend":
            raise InputError("geometry.shape", "bend", allowed)
        if self.gas.compressible:
            raise InputError("gas.compressible", True, allowed)
        for name in ("gas_schedule", "solids_schedule", "outlet_blocked"):
            if getattr(feed, name):
                raise InputError(f"operation.{name}", _plain(getattr(feed, name)), allowed)
        return self

    @model_validator(mode="after")
    def _initial_state_fits(self) -> Self:
        """A bed has solids below their packing, in the line; steps in time are in order."""
        if self.solution != "unsteady":
            return self
        start, given = self.initial, self.numerics
        if start.state == "bed":
            if self.solids is None:
                raise InputError("initial.state", start.state, "a table [solids] beside it")
            if start.bed_fraction >= self.solids.packing_limit:
                allowed = f"a number below solids.packing_limit = {self.solids.packing_limit}"
                raise InputError("initial.bed_fraction", start.bed_fraction, allowed)
            if start.bed_start >= self.geometry.length:
                allowed = f"a place before the outlet at {self.geometry.length:g} m"
                raise InputError("initial.bed_start", start.bed_start, allowed)
        for name in ("time_step", "largest_time_step"):
            step = getattr(given, name)
            if step is not None and step < given.smallest_time_step:
                allowed = f"at least numerics.smallest_time_step = {given.smallest_time_step:g} s"
                raise InputError(f"numerics.{name}", step, allowed)
        return self

    @model_validator(mode="after")
    def _feed_and_solids_agree(self) -> Self:
        """Solids need a feed and a feed needs solids; a hold-up lies below packing."""
        feeds = [name for name in FEEDS if getattr(self.operation, name) is not None]
        if self.solids is None and feeds:
            value = getattr(self.operation, feeds[0])
            raise InputError(f"operation.{feeds[0]}", value, "a table [solids] beside it")
        if self.solids is None:
            return self
        if not feeds:
            raise InputError(f"operation.{FEEDS[0]}", None, f"one of {', '.join(FEEDS)}")
        fraction, limit = self.operation.solids_fraction, self.solids.packing_limit
        if fraction is not None and fraction >= limit:
            allowed = f"a number below solids.packing_limit = {limit}"
            raise InputError("operation.solids_fraction", fraction, allowed)
        return self

    @model_validator(mode="after")
    def _turbulence_fits(self) -> Self:
        """Laws that use k have one that transports it, and that one a wall law."""
        laws, walls = self.closures, self.walls
        using = {
            "closures.dispersed": laws.dispersed,
            "closures.dispersion": laws.dispersion,
            "walls.gas": walls.gas,
        }
        if not laws.turbulence.transported:
            for key, law in using.items():
                if law.needs_k:
                    allowed = "a law without k, or closures.turbulence = 'realizable' beside it"
                    raise InputError(key, law.name, allowed)
        elif walls.gas.strong:
            allowed = (
                f"'log-law', 'log-law-k' or 'low-reynolds' with closures.turbulence ="
                f" {laws.turbulence.name!r}"
            )
            raise InputError("walls.gas", walls.gas.name, allowed)
        return self

    @model_validator(mode="after")
    def _inlet_is_known(self) -> Self:
        """What enters a line must be known, which a hold-up alone does not tell."""
        if self.solution in SOLUTIONS and self.solids is not None:
            # raises where the feed does not tell it
            fraction, _ = self.solids_inlet
            most = max((factor for _, factor in self.operation.solids_schedule), default=1.0)
            if fraction * most >= self.solids.packing_limit:
                allowed = f"factors below {self.solids.packing_limit / fraction:g}, where it packs"
                raise InputError("operation.solids_schedule", most, allowed)
        return self

    @model_validator(mode="after")
    def _sizes_fit(self) -> Self:
        """Particles, wall distance and mesh are smaller than the section."""
        width = self.geometry.hydraulic_diameter
        sizes = {
            "solids.diameter": (self.solids and self.solids.diameter, width),
            "walls.distance": (self.walls.distance, width / 2),
            "numerics.mesh_size": (self.numerics.mesh_size, width),
        }
        for key, (size, limit) in sizes.items():
            if size is not None and size >= limit:
                raise InputError(key, size, f"a length below {limit:g} m, to fit in the section")
        return self

    @classmethod
    def load(cls, path: str | Path, overrides: Iterable[str] = ()) -> Case:
        """Read a TOML file; `overrides` are texts "key=value" as given to --set."""
        values = _read(Path(path))
        changes = dict(map(parse_override, overrides))
        _give_way(values, changes)
        for key, value in changes.items():
            _set(values, key, value)
        return cls.from_dict(values)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Case:
        """Build a case from nested tables."""
        return cls(**values)

    def with_values(self, changes: Mapping[str, Any]) -> Case:
        """Return a case with dotted keys changed; None takes a key back to its default."""
        values = self.model_dump(exclude_unset=True)
        _give_way(values, changes)
        for key, value in changes.items():
            _set(values, key, value)
        return Case.from_dict(values)

    def dump(self) -> str:
        """Return the case as TOML with every default written out."""
        return tomli_w.dumps(_plain(self.model_dump(exclude_none=True)))

    @property
    def gas_material(self) -> GasMaterial:
        """Density and viscosity of the gas, as the closures take them."""
        from fem_tfm.materials import Gas as GasMaterial

        return GasMaterial(density=self.gas.gas_density, viscosity=self.gas.gas_viscosity)

    @property
    def solids_material(self) -> SolidsMaterial | None:
        """The solids as the closures take them (friction angle in rad); None for gas alone."""
        from fem_tfm.materials import Solids as SolidsMaterial

        if self.solids is None:
            return None
        values = self.solids.model_dump()
        return SolidsMaterial(**values)

    @property
    def solids_feed(self) -> tuple[Literal["holdup", "flux"], float] | None:
        """("holdup", mean alpha_s), or ("flux", superficial solids velocity j_s [m/s]), or None.

        j_s = alpha_s u_s, or j_s = M_s/(rho_s A) for a mass flow M_s.
        """
        feed = self.operation
        if self.solids is None:
            return None
        if feed.solids_mass_flow is not None:
            return "flux", feed.solids_mass_flow / (self.solids.density * self.geometry.area)
        if feed.solids_superficial_velocity is not None:
            return "flux", feed.solids_superficial_velocity
        if feed.solids_velocity is not None:
            return "flux", feed.solids_fraction * feed.solids_velocity
        return "holdup", feed.solids_fraction

    @property
    def solids_inlet(self) -> tuple[float, float]:
        """alpha_s [-] and mean velocity u_s [m/s] of the solids that enter a line.

        As given, or u_s from the correlation of the feeder and alpha_s = j_s/u_s. Raises
        `InputError` where the feed does not tell them.
        """
        from fem_tfm.correlations import feed_velocity

        feed = self.operation
        if feed.solids_fraction is not None:
            if feed.solids_velocity is None:
                allowed = "the velocity at which the solids enter, beside solids_fraction"
                raise InputError("operation.solids_velocity", None, allowed)
            return feed.solids_fraction, feed.solids_velocity
        flux, width = self.solids_feed[1], self.geometry.hydraulic_diameter
        key = next(name for name in FEEDS if getattr(feed, name) is not None)
        speed = feed_velocity(
            feed.gas_superficial_velocity, width, self.gas_material, self.solids_material
        )
        if speed <= 0 or flux / speed >= self.solids.packing_limit:
            allowed = "solids_fraction with solids_velocity, for the feeder's correlation fails"
            raise InputError(f"operation.{key}", getattr(feed, key), allowed)
        return flux / speed, speed

    @property
    def gravity_vector(self) -> tuple[float, float, float]:
        """g (0, -cos theta, -sin theta), theta the inclination above the horizontal [m/s2]."""
        theta, g = math.radians(self.geometry.inclination_deg), self.operation.gravity
        return 0.0, -g * math.cos(theta), -g * math.sin(theta)

    @property
    def wall_distance(self) -> float:
        """Distance y_p at which the wall law of the gas holds [m].

        1 % of the hydraulic diameter by default; y+ = 2 where the mesh resolves the sublayer; for a
        duct y+ = 40, and at least 0.4 % of the diameter.
        """
        if self.walls.distance:
            return self.walls.distance
        width = self.geometry.hydraulic_diameter
        if self.flow == "dense" and not self.walls.gas.resolved:
            return 0.01 * width
        from fem_tfm.correlations import friction_velocity

        viscosity = self.gas.gas_viscosity / self.gas.gas_density
        speed = max(self.operation.gas_superficial_velocity, SLOWEST * viscosity / width)
        unit = viscosity / friction_velocity(speed, width, viscosity)
        if self.flow == "dense":
            return SUBLAYER_PLUS * unit
        return max(WALL_PLUS * unit, SMALLEST_DISTANCE * width)

    @property
    def reynolds(self) -> float:
        """U D_h/nu of the gas [-]."""
        speed, width = self.operation.gas_superficial_velocity, self.geometry.hydraulic_diameter
        return speed * width * self.gas.gas_density / self.gas.gas_viscosity

    def run(
        self,
        out: str | Path | None = None,
        overwrite: bool = False,
        resume: bool = False,
        quiet: bool = True,
    ) -> Result:
        """Solve the case; with `out` the results are written to that directory.

        Raises `InputError` before anything is written, `SolverError` if no answer was reached.
        """
        from fem_tfm.flows import run
        from fem_tfm.progress import Progress

        directory = results_directory(out, overwrite, resume)
        with Progress(quiet) as progress:
            return run(self, directory, resume=resume, overwrite=overwrite, progress=progress)


def results_directory(
    out: str | Path | None,
    overwrite: bool = False,
    resume: bool = False,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> Path | None:
    """Check where results are to go; nothing is made or changed.

    Rank 0 looks and all ranks hear the same answer, so that none sees what another wrote meanwhile.
    Raises `InputError` if the place holds something and neither overwrite nor resume is asked.
    """
    found: Path | InputError | None = None
    if comm.rank == 0:
        try:
            found = _free_directory(out, overwrite, resume)
        except InputError as error:
            found = error
    found = comm.bcast(found)
    if isinstance(found, InputError):
        raise found
    return found


def _free_directory(out: str | Path | None, overwrite: bool, resume: bool) -> Path | None:
    if overwrite and resume:
        raise InputError("--resume", True, "either --resume or --overwrite")
    if out is None:
        if resume:
            raise InputError("--resume", True, "--out with the directory of the run to resume")
        return None
    path = Path(out)
    ancestor = next(p for p in (path, *path.absolute().parents) if p.exists())
    if not (ancestor.is_dir() and os.access(ancestor, os.W_OK)):
        raise InputError("--out", str(out), f"a directory that can be written, unlike {ancestor}")
    filled = path.is_dir() and any(path.iterdir())
    if resume and not filled:
        raise InputError("--resume", str(out), "a directory with a run to resume")
    if filled and not (overwrite or resume):
        raise InputError("--out", str(out), "a new directory, or --overwrite or --resume")
    return path


def parse_override(text: str) -> tuple[str, Any]:
    """Split "key=value"; the value is read as TOML, or else taken as a string."""
    key, equals, value = text.partition("=")
    if not (equals and key.strip() and value.strip()):
        raise InputError("--set", text, "key=value, such as solids.diameter=1e-4")
    return key.strip(), parse_value(value.strip())


def parse_value(text: str) -> Any:
    """Read one TOML value; numbers may also be written as .5 or 5., all else is a text."""
    try:
        values = tomllib.loads(f"value = {text}")
    except tomllib.TOMLDecodeError:
        return float(text) if re.fullmatch(r"[+-]?(\d+\.|\.\d+)(e[+-]?\d+)?", text, re.I) else text
    return values["value"] if len(values) == 1 else text


def known_keys() -> list[str]:
    """Return every dotted key that a case may have."""
    return list(_walk(Case))


def _walk(table: type[Table], prefix: str = "") -> Iterator[str]:
    for name, info in table.model_fields.items():
        yield prefix + name
        inner = _table_of(info)
        if inner is not None and inner is not Reference:
            yield from _walk(inner, f"{prefix}{name}.")


def _table_of(info: FieldInfo | None) -> type[Table] | None:
    """Return the table that a key holds (or lists), None for a plain value."""
    pending = [info.annotation] if info else []
    while pending:
        kind = pending.pop()
        if isinstance(kind, type) and issubclass(kind, Table):
            return kind
        pending.extend(get_args(kind))
    return None


def _make_law(family: str, spec: Any, key: str) -> Closure:
    """Build a closure from a name or a table; one that is built already passes."""
    from fem_tfm.closures import make

    return make(family, spec, key)


def _law_table(law: Closure) -> dict[str, Any]:
    """Return a closure as the table it would have in a case file."""
    return {"model": law.name, **{f.name: getattr(law, f.name) for f in fields(law)}}


def _plain(value: Any) -> Any:
    """Return nested values without numpy scalars and tuples, so that they can be written."""
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items() if v is not None}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return value.item() if hasattr(value, "item") and not hasattr(value, "__len__") else value


def _read(path: Path) -> dict[str, Any]:
    """Read a TOML file; a byte-order mark is allowed."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (FileNotFoundError, NotADirectoryError):
        beside = [p.name for p in path.parent.glob("*.toml")]
        allowed = "the name of an existing case file"
        raise InputError("case file", str(path), allowed, nearest(path.name, beside)) from None
    except OSError as error:
        allowed = f"a readable file ({error.strerror})"
        raise InputError("case file", str(path), allowed) from None
    except ValueError as error:
        raise InputError("case file", str(path), f"valid TOML in UTF-8 ({error})") from None


def _set(values: dict[str, Any], key: str, value: Any) -> None:
    """Set a dotted key in nested tables; a closure keeps its name when a parameter is set."""
    *tables, name = key.split(".")
    law = ".".join(tables)
    if key not in known_keys() and law not in LAW_DEFAULTS:
        raise _unknown_key(key, value)
    if law in LAW_DEFAULTS and name == "model":
        # another law has other parameters, so those given are dropped
        *tables, name = tables
        value = {"model": value}
    table = values
    for depth, part in enumerate(tables, start=1):
        table[part] = _as_table(table.get(part), ".".join(tables[:depth]))
        table = table[part]
    table[name] = value


def _give_way(values: dict[str, Any], changes: Mapping[str, Any]) -> None:
    """Take back the keys of a table that a changed one replaces, unless they are changed too."""
    for table, ways in INSTEAD.items():
        changed = {name for name in ways if f"{table}.{name}" in changes}
        group = {*ways, *(companion for names in ways.values() for companion in names)}
        kept = changed | {companion for name in changed for companion in ways[name]}
        if changed and isinstance(values.get(table), Mapping):
            values[table] = {k: v for k, v in values[table].items() if k not in group - kept}


def _as_table(value: Any, key: str) -> dict[str, Any]:
    """Return what stands at `key` as a table of its own: a law's name becomes its model."""
    if value is None or isinstance(value, str):
        model = value or LAW_DEFAULTS.get(key)
        return {"model": model} if key in LAW_DEFAULTS else {}
    if not isinstance(value, Mapping):
        raise InputError(key, value, "a table")
    return dict(value)


def _input_error(error: ValidationError) -> InputError:
    """Translate what pydantic found; a misspelt key comes first, for it explains the rest."""
    found = sorted(error.errors(), key=lambda e: e["type"] != "extra_forbidden")[0]
    inner = found.get("ctx", {}).get("error")
    if isinstance(inner, InputError):
        return inner
    key = "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in found["loc"]).lstrip(".")
    value = None if found["type"] == "missing" else found["input"]
    if found["type"] == "extra_forbidden":
        return _unknown_key(key, value)
    info = _field_at(found["loc"])
    choices = _choices(info.annotation)
    near = nearest(value, choices) if isinstance(value, str) else None
    return InputError(key, value, _allowed(info), near)


def _unknown_key(key: str, value: Any) -> InputError:
    """Name the keys of the table, and the nearest of them or where else a key of that name is."""
    table, _, name = key.rpartition(".")
    known = known_keys()
    beside = [k for k in known if k.rpartition(".")[0] == table]
    namesakes = [k for k in known if k.endswith(f".{name}")]
    near = nearest(key, namesakes) or (namesakes or [None])[0]
    if near is None:
        leaves = {k.rpartition(".")[2]: k for k in beside}
        near = leaves.get(nearest(name, leaves)) or nearest(key, known)
    keys = ", ".join(k.rpartition(".")[2] for k in beside) or ", ".join(Case.model_fields)
    return InputError(key, value, f"one of the keys {keys}", near)


def _field_at(loc: tuple[int | str, ...]) -> FieldInfo:
    """Return the declaration of the deepest key that a location names."""
    table, info = Case, None
    for part in loc:
        if table is not None and part in table.model_fields:
            info = table.model_fields[part]
            table = _table_of(info)
    return info


def _is_name(value: Any) -> bool:
    return isinstance(value, str)


def _choices(annotation: Any) -> list[str]:
    """Return the names a key may have, if its values are names."""
    if get_origin(annotation) is Literal:
        return [a for a in get_args(annotation) if isinstance(a, str)]
    return [name for inner in get_args(annotation) for name in _choices(inner)]


def _allowed(info: FieldInfo) -> str:
    """Say in words what a key may be: kind, range, unit, meaning."""
    names, several = _choices(info.annotation), _holds(info.annotation, tuple)
    if _table_of(info):
        kind = "a list of tables" if several else "a table"
    elif names:
        kind = "a list of names out of " + ", ".join(names) if several else _one_of(names)
    elif several and _holds(info.annotation, float):
        kind = "a list of numbers, or of lists of them"
    elif several:
        kind = "a list of texts"
    else:
        kind = next(text for base, text in KINDS.items() if _holds(info.annotation, base))
    bounds = [(words, getattr(m, b, None)) for m in info.metadata for b, words in LIMITS.items()]
    limits = [f"{words} {bound:g}" for words, bound in bounds if bound is not None]
    unit = (info.json_schema_extra or {}).get("unit")
    words = kind + (f" {' and '.join(limits)}" if limits else "") + (f" [{unit}]" if unit else "")
    return f"{words} ({info.description})" if info.description else words


def _holds(annotation: Any, base: type) -> bool:
    """Whether a type is, lists or may be `base`."""
    inner = get_args(annotation) if get_origin(annotation) is not Literal else ()
    return base in (annotation, get_origin(annotation)) or any(_holds(a, base) for a in inner)


def _one_of(names: Iterable[str]) -> str:
    return "one of " + ", ".join(names)


def _exactly_one(table: Table, name: str, keys: tuple[str, ...]) -> None:
    """Refuse none or several of the keys."""
    given = [key for key in keys if getattr(table, key) is not None]
    if len(given) != 1:
        key = f"{name}.{given[-1] if given else keys[0]}"
        value = getattr(table, given[-1]) if given else None
        raise InputError(key, value, f"exactly one of {', '.join(keys)}")

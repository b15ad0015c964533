# SPDX-License-Identifier: LGPL-3.0-or-later
"""Materials of the two phases: the gas, common gases by name, and the grains. SI units."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, fields, replace
from typing import Any, ClassVar, Protocol, Self

from ufl.core.expr import Expr

from fem_tfm.errors import InputError, nearest
from fem_tfm.parameters import Parameters, allowed, checked, key_of, parameter

MOLAR_GAS_CONSTANT = 8.314462618


@dataclass(frozen=True)
class Species:
    """Ideal gas with Sutherland viscosity.

    R = R_u/M,   mu(T) = mu_0 (T/T_0)^{3/2} (T_0 + S)/(T + S)

    molar_mass : M [kg/mol]
    viscosity_0 : mu_0 at T_0 = 273 K and 1 bar [Pa s]
    sutherland : S [K]

    Valid at low pressure: within 2 % from 273 to 400 K and 4 % up to 600 K, compared with Huber
    and Harvey, CRC Handbook of Chemistry and Physics.
    Source: F. M. White, Viscous Fluid Flow, 3rd ed. 2006, table 1-2.
    """

    molar_mass: float
    viscosity_0: float
    sutherland: float

    @property
    def gas_constant(self) -> float:
        """R = R_u/M [J/kg/K]."""
        return MOLAR_GAS_CONSTANT / self.molar_mass

    def viscosity(self, temperature: float) -> float:
        """Sutherland's mu(T) [Pa s] at a temperature [K]."""
        t0, s = 273.0, self.sutherland
        return float(self.viscosity_0 * (temperature / t0) ** 1.5 * (t0 + s) / (temperature + s))


SPECIES = {
    "air": Species(28.9647e-3, 1.716e-5, 111.0),
    "Ar": Species(39.948e-3, 2.125e-5, 144.0),
    "CO": Species(28.0101e-3, 1.657e-5, 136.0),
    "CO2": Species(44.0095e-3, 1.370e-5, 222.0),
    "H2": Species(2.01588e-3, 8.411e-6, 97.0),
    "N2": Species(28.0134e-3, 1.663e-5, 107.0),
    "O2": Species(31.9988e-3, 1.919e-5, 139.0),
}
# ways to state the density, of which a case file gives one
DENSITIES = ("density", "species", "gas_constant")


class Fluid(Protocol):
    """What the laws see of a gas, whose density [kg/m3] may differ from point to point."""

    @property
    def density(self) -> Any: ...
    @property
    def viscosity(self) -> Any: ...


@dataclass(frozen=True)
class Gas(Parameters):
    """The gas: `Gas(density, viscosity)`, or an ideal gas by `Gas.species` or `Gas.ideal`.

    Pressure, name and gas constant belong to an ideal gas, rho = p/(R T). `compressible` lets its
    density follow the pressure of an unsteady flow.

    Raises InputError for a number out of range, a pressure or compressibility of a gas that is not
    ideal, and a density that is not p/(R T) of one that is.
    """

    density: float = parameter(MISSING, "kg/m3", "density", ge=1e-15, le=2000)
    viscosity: float = parameter(
        MISSING, "Pa s", "dynamic viscosity, default that of the species", ge=1e-25, le=1
    )
    pressure: float | None = parameter(
        None, "Pa", "absolute pressure of an ideal gas", ge=0.01, le=1e9
    )
    temperature: float = parameter(293.0, "K", "temperature", ge=1, le=5000)
    compressible: bool = parameter(
        False, doc="density of an ideal gas that follows the pressure of an unsteady flow"
    )
    name: str | None = parameter(None, doc="an ideal gas by its name", key="gas.species")
    gas_constant: float | None = parameter(None, "J/kg/K", "an ideal gas by R", ge=10, le=5000)
    table: ClassVar[str] = "gas"

    def __post_init__(self) -> None:
        super().__post_init__()
        constant = self._constant()
        if constant is None:
            if self.pressure is not None:
                words = "no pressure beside gas.density; give gas.species for an ideal gas"
                raise InputError("gas.pressure", self.pressure, words)
            if self.compressible:
                words = (
                    "false beside gas.density; give gas.species or gas.gas_constant in its place"
                )
                raise InputError("gas.compressible", True, words)
            return
        if self.pressure is None:
            raise InputError("gas.pressure", None, _allowed(type(self), "pressure"))
        ideal = self.pressure / (constant * self.temperature)
        if not isinstance(self.density, Expr) and not math.isclose(self.density, ideal):
            words = f"p/(R T) = {ideal:g} kg/m3, which Gas.species and Gas.ideal find"
            raise InputError("gas.density", self.density, words)

    def _constant(self) -> float | None:
        """R of an ideal gas [J/kg/K], None for a gas by its density."""
        if self.name is None:
            return self.gas_constant
        if self.gas_constant is not None:
            words = f"exactly one of {', '.join(DENSITIES)}"
            raise InputError("gas.gas_constant", self.gas_constant, words)
        return _species(self.name).gas_constant

    @classmethod
    def species(cls, name: str, pressure: float, temperature: float = 293.0, **more: Any) -> Self:
        """An ideal gas by its name, with rho = p/(R T) and Sutherland's viscosity.

        pressure : absolute [Pa]
        temperature : [K]

        Raises InputError for a name that is not known.
        """
        given = {"species": name, "pressure": pressure, "temperature": temperature}
        return cls.from_table(given | more)

    @classmethod
    def ideal(
        cls, gas_constant: float, viscosity: float, pressure: float, temperature: float = 293.0
    ) -> Self:
        """An ideal gas by R [J/kg/K], viscosity [Pa s], pressure [Pa] and temperature [K]."""
        return cls.from_table(
            {
                "gas_constant": gas_constant,
                "viscosity": viscosity,
                "pressure": pressure,
                "temperature": temperature,
            }
        )

    @classmethod
    def from_table(cls, values: Mapping[str, Any]) -> Self:
        """The gas of a table [gas]: exactly one of density, species and gas_constant.

        Raises InputError.
        """
        given = dict(values)
        for field in fields(cls):
            name = key_of(cls, field).removeprefix("gas.")
            if given.get(name) is None:
                given.pop(name, None)
            else:
                given[name] = checked(cls, field, given[name])
        stated = [name for name in DENSITIES if name in given]
        if len(stated) != 1:
            key = stated[-1] if stated else DENSITIES[0]
            raise InputError(f"gas.{key}", given.get(key), f"exactly one of {', '.join(DENSITIES)}")
        if stated != ["density"]:
            cls._fill_ideal(given)
        if "viscosity" not in given:
            raise InputError("gas.viscosity", None, _allowed(cls, "viscosity"))
        return cls(**{"name" if key == "species" else key: value for key, value in given.items()})

    @classmethod
    def _fill_ideal(cls, given: dict[str, Any]) -> None:
        """Density and viscosity of an ideal gas."""
        name, temperature = given.get("species"), given.get("temperature", 293.0)
        known = None if name is None else _species(name)
        if "pressure" not in given:
            raise InputError("gas.pressure", None, _allowed(cls, "pressure"))
        constant = known.gas_constant if known else given["gas_constant"]
        given["density"] = given["pressure"] / (constant * temperature)
        most = next(f for f in fields(cls) if f.name == "density").metadata["limits"]["le"]
        if given["density"] > most:
            words = f"one at which p/(R T) = {given['density']:.4g} kg/m3 is at most {most:g}"
            raise InputError("gas.pressure", given["pressure"], words)
        if known:
            given.setdefault("viscosity", known.viscosity(temperature))

    def to_table(self) -> dict[str, Any]:
        """The table [gas] from which `from_table` makes the same gas, without what follows."""
        found = {
            key_of(type(self), f).removeprefix("gas."): getattr(self, f.name) for f in fields(self)
        }
        if self.name is not None or self.gas_constant is not None:
            del found["density"]
        if self.name is not None and self.viscosity == _species(self.name).viscosity(
            self.temperature
        ):
            del found["viscosity"]
        return found

    def bound(self, wrap: Callable[[float], Any]) -> Self:
        """The same gas with density and viscosity wrapped, the numbers that forms hold."""
        return replace(self, density=wrap(self.density), viscosity=wrap(self.viscosity))


def _species(name: str) -> Species:
    """An ideal gas by its name; raises InputError."""
    if name not in SPECIES:
        words = "one of " + ", ".join(SPECIES)
        raise InputError("gas.species", name, words, nearest(name, SPECIES))
    return SPECIES[name]


def _allowed(cls: type[Parameters], name: str) -> str:
    return allowed(cls, next(f for f in fields(cls) if f.name == name))


@dataclass(frozen=True)
class Solids(Parameters):
    """The grains: spheres of one size.

    Raises InputError for a number out of range, or a friction limit not below the packing limit.
    """

    density: float = parameter(MISSING, "kg/m3", "density of the particle", ge=1e-3, le=25000)
    diameter: float = parameter(MISSING, "m", "diameter of the particle", ge=1e-10, le=0.1)
    restitution: float = parameter(0.7, "-", "particle-particle restitution", gt=0, le=1)
    packing_limit: float = parameter(0.63, "-", "largest solids fraction", gt=0, lt=0.7406)
    friction_limit: float = parameter(
        0.4, "-", "solids fraction where friction begins", gt=0, lt=0.7406
    )
    friction_angle_deg: float = parameter(32.0, "deg", "angle of internal friction", gt=0, lt=90)
    table: ClassVar[str] = "solids"

    def __post_init__(self) -> None:
        super().__post_init__()
        low, high = self.friction_limit, self.packing_limit
        if not isinstance(low, Expr) and not isinstance(high, Expr) and low >= high:
            limits = {f.name: f.default for f in fields(type(self))}
            if low == limits["friction_limit"]:
                # the other one was given
                words = f"a number above solids.friction_limit = {low}"
                raise InputError("solids.packing_limit", high, words)
            words = f"a number below solids.packing_limit = {high}"
            raise InputError("solids.friction_limit", low, words)

    @property
    def friction_angle(self) -> Any:
        """Angle of internal friction phi [rad]."""
        return self.friction_angle_deg * (math.pi / 180)

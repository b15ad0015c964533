# SPDX-License-Identifier: LGPL-3.0-or-later
"""The two-fluid model as a user states it: materials, one law of each family, and the walls."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, dataclass, fields, replace
from typing import Any, ClassVar, Literal, Self

from fem_tfm.closures.base import Closure, law, wall_distance_field
from fem_tfm.closures.drag import Drag
from fem_tfm.closures.free_path import FreePath
from fem_tfm.closures.friction import Friction
from fem_tfm.closures.granular import Granular
from fem_tfm.closures.radial import Radial
from fem_tfm.closures.slip_production import SlipProduction
from fem_tfm.closures.turbulence.dispersed import Dispersed
from fem_tfm.closures.turbulence.dispersion import Dispersion
from fem_tfm.closures.turbulence.gas import Turbulence
from fem_tfm.closures.walls.gas import GasWall
from fem_tfm.closures.walls.solids import SolidsWall
from fem_tfm.correlations import friction_velocity
from fem_tfm.errors import InputError
from fem_tfm.materials import Gas, Solids
from fem_tfm.parameters import Parameters, parameter

# the wall law of the gas holds at this share of the hydraulic diameter
WALL_SHARE = 0.01
# wall distance in wall units where the mesh resolves the sublayer, and the least Reynolds number
# that it is made for
SUBLAYER_PLUS, SLOWEST = 2.0, 4e3
# the least Reynolds number of a gas that laws of turbulence are for
LEAST_REYNOLDS = 3e3
# a name that stands for laws of two families
FOUR_EQUATION = "realizable-4eq"


def _name_of(given: Any) -> Any:
    """Name of a law that is given as an object, a name or a table."""
    return given.get("model") if isinstance(given, Mapping) else getattr(given, "name", given)


class _Unstated(str):
    """Name of a default law, told apart from the same name given by the user."""

    __slots__ = ()


# turbulence of a gas with solids unless the case says otherwise; a laminar gas has none of it
FOLLOWING, SPREADING = _Unstated("tchen"), _Unstated("burns")


@dataclass(frozen=True)
class SectionTerms(Parameters):
    """Small stated terms of a two-fluid section, without which its mesh carries no front."""

    alpha_diffusion: float | None = parameter(
        None,
        "m2/s",
        "diffusion of logit(alpha_s), default that of the flow",
        ge=0,
        le=1,
    )
    capture: float = parameter(
        0.02, "-", "diffusion of fronts that the mesh cannot carry", ge=0, le=1
    )
    damping: float = parameter(0.02, "-", "viscosity of the mesh in the secondary flow", ge=0, le=1)
    theta_floor: float = parameter(1e-8, "m2/s2", "smallest granular temperature", ge=0, le=1)
    table: ClassVar[str] = "numerics"


@dataclass(frozen=True)
class TwoFluid(Parameters):
    """Gas and solids as two interpenetrating phases, or the gas alone without `solids`.

    Each law is an object of `fem_tfm.laws`, its name, or a table
    { model = name, parameter = value }.
    `turbulence = "realizable-4eq"` stands for two equations in each phase. In a laminar gas nothing
    is dispersed unless a law for it is named.

    Raises InputError for laws that do not fit each other.
    """

    gas: Gas = parameter(MISSING, doc="gas", key="gas")
    solids: Solids | None = parameter(
        None, doc="particles; without the table the gas flows alone", key="solids"
    )
    drag: Drag = law("drag", "three-zone", "gas-solids drag", "closures.drag")
    radial: Radial = law("radial", "savage", "radial distribution at contact", "closures.radial")
    granular: Granular = law(
        "granular", "gidaspow", "kinetic theory of granular flow", "closures.granular"
    )
    theta: Literal["transport", "algebraic"] = parameter(
        "transport", doc="granular temperature", key="closures.theta"
    )
    friction: Friction = law(
        "friction", "berzi", "frictional stress of the solids", "closures.friction"
    )
    turbulence: Turbulence = law(
        "turbulence", "mixing-length", "turbulence of the gas", "closures.turbulence"
    )
    dispersed: Dispersed = law(
        "dispersed", FOLLOWING, "turbulence of the solids", "closures.dispersed"
    )
    dispersion: Dispersion = law(
        "dispersion", SPREADING, "turbulent dispersion of the solids", "closures.dispersion"
    )
    friction_feeds_theta: bool = parameter(
        False,
        doc="frictional work becomes granular temperature",
        key="closures.friction_feeds_theta",
    )
    slip_production: SlipProduction = law(
        "slip-production",
        "none",
        "granular energy that the slip between the phases makes",
        "closures.slip_production",
    )
    free_path: FreePath = law(
        "free-path",
        "none",
        "limit of the grains' viscosity and conduction by the gas",
        "closures.free_path",
    )
    pressure_force: Literal["full", "alpha"] = parameter(
        "full",
        doc="force of the kinetic solids pressure: its whole gradient, or"
        " (dp/dalpha_s) grad(alpha_s) alone as in OpenFOAM",
        key="closures.pressure_force",
    )
    gas_wall: GasWall = law("gas-wall", "log-law", "gas at the wall", "walls.gas")
    solids_wall: SolidsWall = law(
        "solids-wall", "schneiderbauer", "solids at the wall", "walls.solids"
    )
    wall_distance: float | None = wall_distance_field()
    grain_gap: float = parameter(
        0.0,
        "-",
        "height over which the drag fades to the wall, in grain diameters",
        key="walls.grain_gap",
        ge=0,
        le=10,
    )
    section_terms: SectionTerms = parameter(
        doc="small terms of a section's mesh", factory=SectionTerms
    )
    flow: ClassVar[str] = "dense"
    # smallest part of a section that stands for the whole: gravity leaves the vertical plane
    symmetry: ClassVar[str] = "half"

    def __post_init__(self) -> None:
        given: Any = self.turbulence
        if given == FOUR_EQUATION:
            object.__setattr__(self, "turbulence", "realizable")
            if isinstance(self.dispersed, _Unstated):
                object.__setattr__(self, "dispersed", "k-epsilon")
        if _name_of(given) == "laminar":
            for name in ("dispersed", "dispersion"):
                if isinstance(getattr(self, name), _Unstated):
                    object.__setattr__(self, name, "none")
        super().__post_init__()
        self._check_turbulence()
        self._check_theta()

    def _check_theta(self) -> None:
        """Laws that an algebraic granular temperature cannot have."""
        if self.theta != "algebraic":
            return
        for key, used in (
            ("closures.slip_production", self.slip_production),
            ("closures.free_path", self.free_path),
        ):
            if not used.absent:
                words = "'none', or closures.theta = 'transport' beside it"
                raise InputError(key, used.name, words)

    def _check_turbulence(self) -> None:
        """Laws that use k need one that transports it, and that one needs a wall law."""
        if not self.turbulence.transported:
            using: dict[str, Any] = {
                "closures.dispersed": self.dispersed,
                "closures.dispersion": self.dispersion,
                "walls.gas": self.gas_wall,
            }
            for key, used in using.items():
                if used.needs_k:
                    words = "a law without k, or closures.turbulence = 'realizable' beside it"
                    raise InputError(key, used.name, words)
        elif self.gas_wall.strong:
            words = (
                "'log-law', 'log-law-k' or 'low-reynolds' with closures.turbulence ="
                f" {self.turbulence.name!r}"
            )
            raise InputError("walls.gas", self.gas_wall.name, words)

    def bound(self, wrap: Callable[[float], Any]) -> Self:
        """The same laws with every parameter wrapped, so that a change recompiles no form."""
        laws = {f.name: getattr(self, f.name) for f in fields(self)}
        bound: dict[str, Any] = {
            name: one.bound(wrap) for name, one in laws.items() if isinstance(one, Closure)
        }
        return replace(self, **bound)

    def laws(self) -> Iterator[Closure]:
        """The laws that are used: those of the gas, and those of the solids where there are any."""
        of_gas = {"turbulence", "gas_wall"}
        for f in fields(self):
            value = getattr(self, f.name)
            if isinstance(value, Closure) and (self.solids is not None or f.name in of_gas):
                yield value

    @property
    def turbulent_from(self) -> tuple[float, str]:
        """Least Reynolds number of the law of turbulence [-], and what to say below it."""
        if self.turbulence.name == "laminar":
            return 0.0, ""
        return LEAST_REYNOLDS, (
            f"a gas is turbulent above {LEAST_REYNOLDS:g} or so, and its friction comes out too"
            " large below; closures.turbulence = 'laminar' with walls.gas = 'no-slip' solves a"
            " laminar one"
        )

    @property
    def scales(self) -> tuple[str, ...]:
        """Names of the logarithms of turbulence that the laws transport."""
        if self.solids is None:
            return self.turbulence.transported
        return self.turbulence.transported + self.dispersed.transported

    def wall_offset(self, speed: float, diameter: float) -> float:
        """Distance y_p at which the wall law of the gas holds [m].

        1 % of the hydraulic diameter by default; y+ = 2 where the mesh resolves the sublayer.

        speed : superficial velocity of the gas [m/s]
        diameter : hydraulic diameter [m]
        """
        if self.wall_distance is not None:
            return self.wall_distance
        if not self.gas_wall.resolved:
            return WALL_SHARE * diameter
        return self._sublayer(speed, diameter)

    def wall_cell(self, speed: float, diameter: float) -> float | None:
        """Height of the cell at the wall that the gas asks for [m], None where it asks for none.

        A mesh that carries a turbulent gas down to a wall that holds it must resolve the sublayer.

        speed : superficial velocity of the gas [m/s]
        diameter : hydraulic diameter [m]
        """
        if self.gas_wall.resolved:
            return self.wall_offset(speed, diameter)
        reynolds = self.gas.density * speed * diameter / self.gas.viscosity
        turbulent = self.turbulence.name != "laminar" and reynolds > LEAST_REYNOLDS
        return self._sublayer(speed, diameter) if turbulent and self.gas_wall.strong else None

    def _sublayer(self, speed: float, diameter: float) -> float:
        """Distance from the wall of y+ = 2 of the gas alone [m]."""
        viscosity = self.gas.viscosity / self.gas.density
        fast = max(speed, SLOWEST * viscosity / diameter)
        return SUBLAYER_PLUS * viscosity / friction_velocity(fast, diameter, viscosity)

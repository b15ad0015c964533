# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the parts of a step of the unsteady flow hand on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from fem_tfm.errors import SolverError
from fem_tfm.solvers.cells import Array

type Places = npt.NDArray[np.intp]

# a phase that is not there moves as one of this fraction; a void has this granular temperature
SMALLEST_FRACTION, SMALLEST_THETA = 1e-9, 1e-12
# times that an equation is solved to find its slopes
SLOPES = 2
# grains below this fraction are not faster than the gas
LONELY_FRACTION = 1e-6
# residual of the linear systems of transport over the right-hand side
TRANSPORT_TOLERANCE = 1e-6


class StepFailed(SolverError):
    """A time step has no acceptable result; the state is the one before it."""


@dataclass(frozen=True)
class Sources:
    """What is given to every volume at the end of a step: numbers, or arrays over owned cells.

    solids, gas : volume of a phase, which comes with the velocity and Theta that are there; that of
        a gas which follows the pressure at the density of the case [1/s]
    force_s, force_g : (3,) or (cells, 3) [N/m3]
    energy : granular energy, or what is taken of it [W/m3]
    """

    solids: Array | float = 0.0
    gas: Array | float = 0.0
    force_s: Array | float = 0.0
    force_g: Array | float = 0.0
    energy: Array | float = 0.0

    def force(self, phase: str) -> Array | float:
        """On a phase [N/m3]."""
        return self.force_s if phase == "solids" else self.force_g


@dataclass(frozen=True)
class Feed:
    """What enters and leaves at the end of a step.

    gas_velocity : superficial, at the density of the case [m/s]
    solids_fraction, solids_velocity : of what enters [-], [m/s]
    blocked : the outlet lets the gas pass and holds the solids
    inside : what comes into the cells without passing the boundary
    """

    gas_velocity: float
    solids_fraction: float = 0.0
    solids_velocity: float = 0.0
    blocked: bool = False
    inside: Sources = Sources()

    def mean_velocity(self, phase: str) -> float:
        """Mean velocity with which a phase enters [m/s]."""
        if phase == "solids":
            return self.solids_velocity
        return self.gas_velocity / (1 - self.solids_fraction)

    def fraction(self, phase: str) -> float:
        """Volume fraction of a phase in what enters [-]."""
        return self.solids_fraction if phase == "solids" else 1 - self.solids_fraction


@dataclass(frozen=True)
class Report:
    """What a step took and where it led: effort, early warning.

    iterations : of each equation
    courant : largest share of a cell that leaves it in the step [-]
    mass_error : relative errors of the masses of solids and gas since the start
    max_k : turbulent energy of the gas [m2/s2], 0 where no law transports it
    """

    iterations: Mapping[str, int]
    max_alpha_s: float
    max_theta: float
    courant: float
    mass_error: float
    max_k: float = 0.0


@dataclass(frozen=True)
class Moment:
    """The state at one time; its arrays are replaced, never changed.

    alpha, theta, p : solids fraction [-], granular temperature [m2/s2], pressure [Pa] in cells
    u_s, u_g : velocities (cells, 3) [m/s]
    total : volume flux of both phases through faces [m3/s]
    carried : volume flux of the solids by u_s.S, its share that their pressure pushes is `pushed`
    response : R_ss on faces, [m3 s/kg]
    gained : what u_s of the cells has gained on faces in the last step, in a second [m3/s2]
    scales : of the turbulence that laws transport, in cells: k [m2/s2], eps [m2/s3], k_s, eps_s
    """

    alpha: Array
    theta: Array
    p: Array
    u_s: Array
    u_g: Array
    total: Array
    carried: Array
    pushed: Array
    response: Array
    gained: Array
    scales: Mapping[str, Array] = field(default_factory=dict)


# names in a Moment, and whether a value on faces has their direction
OF_CELLS = ("alpha", "theta", "p", "u_s", "u_g")
OF_FACES = {"total": True, "carried": True, "pushed": True, "response": False, "gained": True}


@dataclass
class Masses:
    """What has entered and left, for the balances [m3]."""

    solids: float = 0.0
    solids_in: float = 0.0
    solids_net: float = 0.0
    gas: float = 0.0
    gas_in: float = 0.0
    gas_net: float = 0.0


@dataclass(frozen=True)
class Rates:
    """How the solids deform: gradient of u_s (cells, 3, 3), S:S and div u_s [1/s]."""

    gradient: Array
    shear: Array
    dilation: Array


@dataclass(frozen=True)
class Moved:
    """Solids moved by a step: what their fraction hands on.

    alpha : solids fraction [-]
    flux : volume flux of the solids through faces [m3/s]
    passed, added : fluxes [m3/s] and sources [1/s] that have changed the fraction in the step
    pressure : p_s that has moved them [Pa]
    dilation : div u_s of the velocities behind the flux [1/s]
    """

    alpha: Array
    flux: Array
    passed: Array
    added: Array
    pressure: Array
    dilation: Array


@dataclass(frozen=True)
class Density:
    """Density of a phase, a number where it is constant [kg/m3].

    start, cells (owned) : where the step starts, and foreseen for its end
    faces, carried (faces) : interpolated, and upwind
    fed : at which the velocity of the feed holds
    """

    start: Array | float
    cells: Array | float
    faces: Array | float
    carried: Array | float
    fed: float

    @classmethod
    def constant(cls, value: float) -> Density:
        """The same everywhere."""
        return cls(value, value, value, value, value)

    def over(self, unit: float) -> Density:
        """The same in another unit."""
        return Density(**{name: value / unit for name, value in vars(self).items()})

    def thinning(self, inlet: slice) -> Array | float:
        """Volume of what enters over that at the density of the feed [-]."""
        carried = self.carried
        return self.fed / (carried[inlet] if isinstance(carried, np.ndarray) else carried)


@dataclass(frozen=True)
class Stirred:
    """What the turbulence of a state does to both phases; arrays over all cells.

    gradient : of u_g [1/s]
    mu_t : eddy viscosity of the gas [Pa s]
    nu_s : of the solids [m2/s]
    dispersion : c of the force c grad alpha_s by which eddies spread the solids, on the gas, and
        the opposite on them [Pa]; None without any
    drag : beta [kg/m3/s], where there is dispersion
    normal : normal stress of the eddies over a rho, of "k" and "k_s" [m2/s2]; None without any
    spread, rate, stiffness : of each scale X that is transported: diffusivity [m2/s], sources over
        X [1/s], and how fast they fall with ln X [1/s]
    relative : density of the gas over that of the case [-], None where it is constant
    """

    gradient: Array
    mu_t: Array
    nu_s: Array | float
    dispersion: Array | None
    drag: Array | None
    normal: Mapping[str, Array] | None
    spread: Mapping[str, Array]
    rate: Mapping[str, Array]
    stiffness: Mapping[str, Array]
    relative: Array | None = None


@dataclass(frozen=True)
class Bearing:
    """How faces bear the solids of their two cells.

    share (faces) : solids fraction that they bear [-]
    counts : faces that do not count in full for one of their cells, on which side it is, 0 for the
        first cell, and how much they count
    moved : faces, cells and the fraction of these that the faces bear beyond interpolation
    """

    share: Array
    counts: tuple[Places, Places, Array]
    moved: tuple[Places, Places, Array]


@dataclass(frozen=True)
class Phase:
    """One phase in a step; arrays over all cells unless said otherwise.

    fraction, before : alpha after and before the step
    velocity, present : from which the step starts, and of now [m/s]
    flux : volume flux (faces) [m3/s]
    gradient : of `present` [1/s]
    viscosity, bulk : of the whole phase [Pa s]
    traction : friction of the faces of the wall [kg/s]
    pressure : p_s, or that of the gas's eddies [Pa]; None where the phase has none of its own
    share (faces) : fraction that faces bear
    bearing : how faces bear the solids, None for the gas
    dispersed : force by which eddies spread the solids, along normals of faces [N/m3], or None
    steeper (faces) : of the stress beyond viscosity, what the matrix must hold [kg/s], or None
    """

    name: str
    density: Density
    fraction: Array
    before: Array
    velocity: Array
    present: Array
    flux: Array
    viscosity: Array
    bulk: Array
    gradient: Array
    traction: Array
    pressure: Array | None
    share: Array
    bearing: Bearing | None
    dispersed: Array | None = None
    steeper: Array | None = None

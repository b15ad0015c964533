# SPDX-License-Identifier: LGPL-3.0-or-later
"""The state of the unsteady flow and the values that the equations of a step pass to each other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from fem_tfm.errors import SolverError
from fem_tfm.models.finite_volume.cells.mesh import Array

type Indices = npt.NDArray[np.intp]

# a phase that is absent moves as one of this fraction
SMALLEST_FRACTION = 1e-9
# grains below this fraction are not faster than the gas
LONELY_FRACTION = 1e-6
# relative residual of the linear systems of the transport equations
TRANSPORT_TOLERANCE = 1e-6


class StepFailed(SolverError):
    """A time step has no acceptable result; the state is the one before the step."""


@dataclass(frozen=True)
class Sources:
    """Volume sources at the end of a step: numbers, or arrays over the owned cells.

    solids, gas : volume of a phase [1/s]; it enters with the local velocity and granular
        temperature, that of a compressible gas at the reference density
    force_s, force_g : body force on each phase, (3,) or (cells, 3) [N/m3]
    energy : source of granular energy [W/m3]
    """

    solids: Array | float = 0.0
    gas: Array | float = 0.0
    force_s: Array | float = 0.0
    force_g: Array | float = 0.0
    energy: Array | float = 0.0

    def force(self, phase: str) -> Array | float:
        """Body force on a phase [N/m3]."""
        return self.force_s if phase == "solids" else self.force_g


@dataclass(frozen=True)
class Inflow:
    """Boundary values and sources at the end of a step.

    gas_velocity : superficial velocity of the gas at the reference density [m/s]
    solids_fraction, solids_velocity : of the solids at the inlet [-], [m/s]
    blocked : the outlet holds the solids and lets the gas pass
    sources : volume sources inside the domain
    """

    gas_velocity: float
    solids_fraction: float = 0.0
    solids_velocity: float = 0.0
    blocked: bool = False
    sources: Sources = Sources()

    def mean_velocity(self, phase: str) -> float:
        """Mean velocity of a phase at the inlet [m/s]."""
        if phase == "solids":
            return self.solids_velocity
        return self.gas_velocity / (1 - self.solids_fraction)

    def fraction(self, phase: str) -> float:
        """Volume fraction of a phase at the inlet [-]."""
        return self.solids_fraction if phase == "solids" else 1 - self.solids_fraction


@dataclass(frozen=True)
class Report:
    """Effort and extreme values of a step.

    iterations : of each equation
    max_alpha_s : largest solids fraction [-]
    max_theta : largest granular temperature [m2/s2]
    courant : largest share of a cell's phase volume that leaves the cell in the step [-]
    mass_error : relative error of the masses of solids and gas since the start
    max_k : largest turbulent energy of the gas [m2/s2], 0 without a transport equation for it
    """

    iterations: Mapping[str, int]
    max_alpha_s: float
    max_theta: float
    courant: float
    mass_error: float
    max_k: float = 0.0


@dataclass(frozen=True)
class State:
    """State at one time. Its arrays are replaced, never changed.

    In all cells:
    alpha, theta, p : solids fraction [-], granular temperature [m2/s2], pressure [Pa]
    u_s, u_g : velocities (cells, 3) [m/s]
    scales : transported scales of turbulence by name: k [m2/s2], eps [m2/s3], k_s, eps_s

    On all faces:
    total_flux : volume flux of both phases, (alpha_s u_s + alpha_g u_g).S [m3/s]
    solids_flux : u_s.S [m3/s]
    pressure_flux : the part of `solids_flux` that the solids pressure drives [m3/s]
    response : R_ss, velocity of the solids per pressure gradient on them [m3 s/kg]
    flux_acceleration : change of u_s.S, interpolated from the cells, per second of the last step
        [m3/s2]
    """

    alpha: Array
    theta: Array
    p: Array
    u_s: Array
    u_g: Array
    total_flux: Array
    solids_flux: Array
    pressure_flux: Array
    response: Array
    flux_acceleration: Array
    scales: Mapping[str, Array] = field(default_factory=dict)


# names in a State, and whether a value on faces changes sign with the direction of the face
CELL_FIELDS = ("alpha", "theta", "p", "u_s", "u_g")
FACE_FIELDS = {
    "total_flux": True,
    "solids_flux": True,
    "pressure_flux": True,
    "response": False,
    "flux_acceleration": True,
}


@dataclass
class Masses:
    """Volumes of solids and of gas at the reference density, for the mass balances [m3].

    solids, gas : at the start
    *_in : entered since then
    *_net : entered less what has left
    """

    solids: float = 0.0
    solids_in: float = 0.0
    solids_net: float = 0.0
    gas: float = 0.0
    gas_in: float = 0.0
    gas_net: float = 0.0


@dataclass(frozen=True)
class SolidsDeformation:
    """Deformation of the solids in all cells.

    gradient : grad u_s (cells, 3, 3) [1/s]
    shear : S:S of its deviatoric symmetric part [1/s2]
    dilation : div u_s [1/s]
    """

    gradient: Array
    shear: Array
    dilation: Array

    @property
    def rates(self) -> tuple[Array, Array]:
        """S:S and div u_s."""
        return self.shear, self.dilation

    def at(self, cells: Indices) -> tuple[Array, Array]:
        """S:S and div u_s of some cells."""
        return self.shear[cells], self.dilation[cells]


@dataclass(frozen=True)
class SolidsTransport:
    """Result of the solids fraction equation.

    alpha : solids fraction in all cells [-]
    flux : alpha_s u_s.S at the end of the step [m3/s]
    step_flux, step_source : mean flux [m3/s] and source [1/s] of the step, by which alpha changed
    pressure : solids pressure in all cells that the fluxes contain [Pa]
    wall_rise : that pressure at the faces of the wall, over that of the cells there [-]
    dilation : div u_s of the fluxes in all cells [1/s]
    thermal_rise : share of the rise of `pressure` across faces, by that of Theta, which exerts no
        force [Pa]; None where all of it does
    """

    alpha: Array
    flux: Array
    step_flux: Array
    step_source: Array
    pressure: Array
    wall_rise: Array
    dilation: Array
    thermal_rise: Array | None = None


@dataclass(frozen=True)
class Density:
    """Density of a phase [kg/m3]; numbers where it is constant.

    start, cells (owned) : at the start level of the step, and predicted for its end
    faces, upwind (faces) : predicted, interpolated and upwind
    inflow : at which the inflow's velocity is given
    """

    start: Array | float
    cells: Array | float
    faces: Array | float
    upwind: Array | float
    inflow: float

    @classmethod
    def constant(cls, value: float) -> Density:
        """The same value everywhere."""
        return cls(value, value, value, value, value)

    def relative_to(self, reference: float) -> Density:
        """Density over a reference density [-]."""
        return Density(**{name: value / reference for name, value in vars(self).items()})

    def inlet_expansion(self, inlet: slice) -> Array | float:
        """Volume of the inflow at the inlet's density over that at its own [-]."""
        upwind = self.upwind
        return self.inflow / (upwind[inlet] if isinstance(upwind, np.ndarray) else upwind)


@dataclass(frozen=True)
class TurbulenceCoefficients:
    """Effect of the turbulence on both phases, and the coefficients of its own equations.

    Arrays over all cells:
    gradient : grad u_g of the present state [1/s]
    mu_t : eddy viscosity of the gas [Pa s]
    nu_s : eddy viscosity of the solids [m2/s]
    dispersion : c of the dispersion force c grad(alpha_s) on the gas, opposite on the solids [Pa];
        None without dispersion
    drag : beta where there is dispersion [kg/m3/s]
    normal_stress : 2/3 k of the gas ("k") and of the solids ("k_s") that acts as a pressure
        [m2/s2]; None without
    diffusivity, rate, stiffness : of each transported scale X: diffusivity [m2/s], source over X
        [1/s], and the decrease of that rate with ln X [1/s]
    relative_density : density of the gas over the reference [-], None where it is constant
    laden_viscosity : mu_g of eddies that carry grains [Pa s], None where they carry none
    """

    gradient: Array
    mu_t: Array
    nu_s: Array | float
    dispersion: Array | None
    drag: Array | None
    normal_stress: Mapping[str, Array] | None
    diffusivity: Mapping[str, Array]
    rate: Mapping[str, Array]
    stiffness: Mapping[str, Array]
    relative_density: Array | None = None
    laden_viscosity: Array | None = None


@dataclass(frozen=True)
class FaceSupport:
    """Solids fraction whose weight each face carries.

    fraction (faces) : that fraction [-]
    partial_faces : faces with reduced weight in the reconstruction of one of their cells: face,
        side of the cell (0 for the first), weight [-]
    shifted : faces, cells, and the fraction of these cells that the face carries beyond the
        interpolated one [-]
    """

    fraction: Array
    partial_faces: tuple[Indices, Indices, Array]
    shifted: tuple[Indices, Indices, Array]


@dataclass(frozen=True)
class Phase:
    """Coefficients of the momentum equation of one phase in a step.

    In all cells:
    fraction, fraction_start : volume fraction at the end and at the start level of the step [-]
    velocity_start, velocity_now : at the start level, and of the present state [m/s]
    gradient : of `velocity_now` [1/s]
    viscosity, bulk_viscosity : of the whole phase, fraction included [Pa s]
    pressure : solids pressure, or that of the gas's eddies [Pa]; None without

    On faces:
    flux : volume flux of the phase [m3/s]
    wall_friction : tangential force over velocity on the wall's faces [kg/s]
    face_viscosity, face_bulk_viscosity : on faces [Pa s]; those of the solids of both halves of the
        way in series, so that a void holds no stress of a bed
    face_fraction : fraction on which the forces act [-]
    support : how faces carry the weight of the solids, None for the gas
    dispersion_force : along the normals [N/m3], None without
    implicit_correction : stiffness of stresses beyond the viscosity that need the matrix [kg/s],
        None without
    thermal_rise : share of the rise of `pressure` that exerts no force [Pa], None without
    """

    name: str
    density: Density
    fraction: Array
    fraction_start: Array
    velocity_start: Array
    velocity_now: Array
    flux: Array
    viscosity: Array
    bulk_viscosity: Array
    face_viscosity: Array
    face_bulk_viscosity: Array
    gradient: Array
    wall_friction: Array
    pressure: Array | None
    face_fraction: Array
    support: FaceSupport | None
    dispersion_force: Array | None = None
    implicit_correction: Array | None = None
    thermal_rise: Array | None = None

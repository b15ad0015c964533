# SPDX-License-Identifier: LGPL-3.0-or-later
"""Numbers, profiles and balances of a turbulent gas in a section."""

from __future__ import annotations

import math

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from fem_tfm.geometry.section import RectangularSection
from fem_tfm.interpolation import point_values
from fem_tfm.models.reynolds_stress.section import ReynoldsStressSection

LINE_POINTS = 61
# points on a boundary are taken a hair inside, so that round-off loses none
INSIDE = 1e-9


def eigenvalues(found: ReynoldsStressSection) -> NDArray[np.float64]:
    """Eigenvalues of R over k at the nodes of this rank, ascending, shape (n, 3) [-]."""
    if not found.setup.law.transported:
        stress = found.fields()["reynolds_stress"].x.array.reshape(-1, 3, 3)
    else:
        r = found.unknown("r").x.array.reshape(-1, 6)
        rows = ((0, 3, 4), (3, 1, 5), (4, 5, 2))
        stress = r[:, np.array(rows)]
    energy = np.trace(stress, axis1=1, axis2=2)[:, None] / 2
    return np.linalg.eigvalsh(stress) / energy


def smallest_stress(found: ReynoldsStressSection) -> float:
    """Smallest principal Reynolds stress over k [-]; positive where stresses are realisable.

    Positive principal stresses mean positive normal stresses and Schwarz's inequality for all axes.
    """
    values = eigenvalues(found)
    return found.mesh.mesh.comm.allreduce(float(values.min(initial=math.inf)), MPI.MIN)


def secondary(found: ReynoldsStressSection) -> float:
    """Largest velocity across the axis over the bulk velocity [-]."""
    u = found.unknown("u").x.array.reshape(-1, 3)
    peak = float(np.hypot(u[:, 0], u[:, 1]).max(initial=0.0))
    return found.mesh.mesh.comm.allreduce(peak, MPI.MAX) / found.setup.gas_velocity


def corner(found: ReynoldsStressSection) -> tuple[float, float]:
    """Furthest point of the mesh along x and y [m]."""
    geometry = found.mesh.section
    offset = float(found.setup.numbers.wall_offset)
    if isinstance(geometry, RectangularSection):
        return geometry.width / 2 - offset, geometry.height / 2 - offset
    return geometry.radius - offset, 0.0


def quantities(found: ReynoldsStressSection, density: float, length: float) -> dict[str, float]:
    """Numbers of a developed section, in the units of `QUANTITIES`; whole section."""
    setup, geometry = found.setup, found.mesh.section
    width, speed = geometry.hydraulic_diameter, setup.gas_velocity
    gradient = density * found.pressure_gradient
    u_tau = math.sqrt(found.pressure_gradient * width / 4)
    lines = profiles(found)
    told = {
        "pressure_gradient": gradient,
        "pressure_drop": gradient * length,
        "gas_mass_flow": density * geometry.area_factor * found.flux(),
        "friction_factor": 2 * found.pressure_gradient * width / speed**2,
        "secondary_velocity_max": secondary(found),
        "centre_to_bulk": float(lines["bisector u_z/U"][0]),
        "axis_energy": float(lines["bisector k/u_tau2"][0]),
        "smallest_stress": smallest_stress(found),
        "wall_distance_plus": float(setup.numbers.wall_offset) * u_tau / setup.numbers.viscosity,
    }
    if isinstance(geometry, RectangularSection):
        outward = lines["diagonal outward/U"]
        told["secondary_velocity_diagonal"] = float(outward[np.abs(outward).argmax()])
        told["corner_wall_shear"] = float(lines["wall shear/mean"][-1])
    return told


def profiles(found: ReynoldsStressSection) -> dict[str, NDArray[np.float64]]:
    """Columns along the wall bisector, the diagonal and the wall, from the centre outward.

    s is the share of the way from the centre to the wall (bisector, along x), to the corner
    (diagonal) or from the bisector to the corner (wall, at the top). Velocities over U, stresses
    over u_tau^2 = G D_h/(4 rho), wall shear over its mean.
    """
    setup, geometry = found.setup, found.mesh.section
    u_tau2 = found.pressure_gradient * geometry.hydraulic_diameter / 4
    s = np.linspace(0.0, 1.0, LINE_POINTS)
    across, up = corner(found)
    fields = found.fields()
    sampled = [fields[name] for name in ("u_g", "k", "reynolds_stress")]

    def at(x: NDArray[np.float64], y: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        return point_values(sampled, np.column_stack([x, y]) * (1 - INSIDE))

    u, k, r = at(s * across, 0 * s)
    columns = {
        "s": s,
        "bisector u_z/U": u[:, 2] / setup.gas_velocity,
        "bisector outward/U": u[:, 0] / setup.gas_velocity,
        "bisector k/u_tau2": k / u_tau2,
        "bisector (R_yy - R_xx)/u_tau2": (r[:, 4] - r[:, 0]) / u_tau2,
        "bisector R_xz/u_tau2": r[:, 2] / u_tau2,
    }
    if not isinstance(geometry, RectangularSection):
        return columns
    u, k, r = at(s * across, s * up)
    direction = np.array([across, up]) / math.hypot(across, up)
    columns |= {
        "diagonal u_z/U": u[:, 2] / setup.gas_velocity,
        "diagonal outward/U": u[:, :2] @ direction / setup.gas_velocity,
        "diagonal k/u_tau2": k / u_tau2,
        "diagonal (R_yy - R_xx)/u_tau2": (r[:, 4] - r[:, 0]) / u_tau2,
    }
    u, k, _ = at(s * across, up + 0 * s)
    offset, nu = float(setup.numbers.wall_offset), setup.numbers.viscosity
    shear = setup.function.friction(k, offset, nu) * u[:, 2]
    mean = found.wall_force() / found.wall_length()
    return columns | {
        "wall shear/mean": shear / mean,
        "wall u_z/U": u[:, 2] / setup.gas_velocity,
        "wall along/U": u[:, 0] / setup.gas_velocity,
    }


def balances(found: ReynoldsStressSection) -> dict[str, float]:
    """Relative errors of the flux imposed and of axial momentum, G A = force of the walls."""
    target = float(found.newton.borders[0].target.value)
    driven, resisted = found.pressure_gradient * found.area, found.wall_force()
    return {
        "gas_mass": abs(found.newton.constraint_errors()[0] / target),
        "axial_momentum": abs(driven - resisted) / abs(driven),
    }


def points(found: ReynoldsStressSection) -> dict[str, NDArray[np.float64]]:
    """Points along the bisector and the diagonal, from the centre outward, shape (n, 2) [m]."""
    s = np.linspace(0.0, 1.0, LINE_POINTS) * (1 - INSIDE)
    across, up = corner(found)
    lines = {"bisector": np.column_stack([s * across, 0 * s])}
    if isinstance(found.mesh.section, RectangularSection):
        lines["diagonal"] = np.column_stack([s * across, s * up])
    return lines

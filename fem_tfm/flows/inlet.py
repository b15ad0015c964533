# SPDX-License-Identifier: LGPL-3.0-or-later
"""The inlet of a developing flow: what enters, and how it is spread over the section."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem

from fem_tfm.correlations import power_law
from fem_tfm.flows.section import Section
from fem_tfm.flows.start import set_turbulence


@dataclass(frozen=True)
class Inlet:
    """What enters.

    profile : "power-law" (1/7) or "uniform" velocities
    solids_fraction : alpha_s, uniform [-]; None for the gas alone
    solids_velocity : mean velocity of the solids [m/s]
    solids_intensity : I_s of the solids' agitation and turbulence, uniform [-]
    gas_intensity : I_g of the gas's turbulence, uniform [-]
    length_scale : l of the eddies over the hydraulic diameter, uniform [-]
    """

    profile: str
    solids_fraction: float | None = None
    solids_velocity: float | None = None
    solids_intensity: float = 0.05
    gas_intensity: float = 0.1
    length_scale: float = 0.07


def enter(section: Section, inlet: Inlet) -> None:
    """Put the state of the inlet on a section.

    Velocities are axial, u = (mean) (60/49) (1 - 2r/D)^{1/7} or uniform, and carry exactly the
    fluxes of the feed. Where a wall law asks for rest there is rest. alpha_s is uniform, and with
    the mean velocities

        Theta = (I_s u_s)^2,  k = 3/2 (I u)^2,  eps = C_mu^0.75 k^1.5/l
    """
    section.drive.value = section.source.value = 0.0
    section.now.x.array[:] = 0.0
    shape = _shape(section, inlet.profile)
    alpha = inlet.solids_fraction or 0.0
    gas_velocity = section.setup.gas_velocity / (1 - alpha)
    _spread(section, "u_g", shape, gas_velocity)
    length = fem.Constant(
        section.mesh.mesh, inlet.length_scale * section.mesh.section.hydraulic_diameter
    )
    gas = gas_velocity, inlet.gas_intensity
    set_turbulence(section, length, gas, (inlet.solids_velocity, inlet.solids_intensity))
    if section.setup.solids is None:
        return
    _spread(section, "u_s", shape, inlet.solids_velocity)
    limit = section.setup.solids.packing_limit
    agitation = inlet.solids_intensity * inlet.solids_velocity
    for name, value in (("q", np.log(alpha / (limit - alpha))), ("c", agitation)):
        section.now.x.array[section.space.sub(section.names.index(name)).collapse()[1]] = value
    section.now.x.scatter_forward()


def _shape(section: Section, profile: str) -> fem.Function:
    """Axial profile at the nodes of the velocity, not yet scaled [-]."""
    space = fem.functionspace(section.mesh.mesh, ("Lagrange", 2))
    shape = fem.Function(space)
    shape.x.array[:] = 1.0
    if profile == "power-law":
        geometry = section.mesh.section
        distance = geometry.wall_distance(ufl.SpatialCoordinate(section.mesh.mesh))
        power = power_law(distance, geometry.hydraulic_diameter / 2)
        shape.interpolate(fem.Expression(power, space.element.interpolation_points))
    return shape


def _spread(section: Section, name: str, shape: fem.Function, mean: float) -> None:
    """Give a phase the profile with the mean velocity over the true section."""
    number = section.names.index(name)
    dofs = np.asarray(section.space.sub(number).sub(2).collapse()[1]).ravel()
    x = section.now.x.array
    x[dofs] = shape.x.array
    for condition in section.newton.bcs:
        condition.set(x)
    section.now.x.scatter_forward()
    flux = section.integral(f"axial {name}", ufl.split(section.now)[number][2])
    x[dofs] *= mean * section.mesh.section.meshed_area / flux

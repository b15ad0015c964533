# SPDX-License-Identifier: LGPL-3.0-or-later
"""The inlet of a developing flow: what enters, and how it is spread over the section."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem

from fem_tfm.flows.section import Section

# the power law ends short of the wall, over half the hydraulic diameter
NEAREST = 0.01


@dataclass(frozen=True)
class Inlet:
    """What enters.

    profile : "power-law" (1/7) or "uniform" velocities
    solids_fraction : alpha_s, uniform [-]; None for the gas alone
    solids_velocity : mean velocity of the solids [m/s]
    intensity : I of the solids' agitation, Theta = (I u_s)^2 with the mean u_s, uniform [-]
    """

    profile: str
    solids_fraction: float | None = None
    solids_velocity: float | None = None
    intensity: float = 0.05


def enter(section: Section, inlet: Inlet) -> None:
    """Put the state of the inlet on a section.

    Velocities are axial, u = (mean) (60/49) (1 - 2r/D)^{1/7} or uniform, and carry exactly the
    fluxes of the feed; alpha_s and Theta are uniform. Where a wall law asks for rest there is rest.
    """
    section.drive.value = section.source.value = 0.0
    section.now.x.array[:] = 0.0
    shape = _shape(section, inlet.profile)
    alpha = inlet.solids_fraction or 0.0
    _spread(section, "u_g", shape, section.setup.gas_velocity / (1 - alpha))
    if section.setup.solids is None:
        return
    _spread(section, "u_s", shape, inlet.solids_velocity)
    limit = section.setup.solids.packing_limit
    agitation = inlet.intensity * inlet.solids_velocity
    for name, value in (("q", np.log(alpha / (limit - alpha))), ("c", agitation)):
        section.now.x.array[section.space.sub(section.names.index(name)).collapse()[1]] = value
    section.now.x.scatter_forward()


def _shape(section: Section, profile: str) -> fem.Function:
    """Axial profile at the nodes of the velocity, not yet scaled [-]."""
    space = fem.functionspace(section.mesh.mesh, ("Lagrange", 2))
    shape = fem.Function(space)
    shape.x.array[:] = 1.0
    if profile == "power-law":
        geometry = section.mesh.geometry
        distance = geometry.wall_distance(ufl.SpatialCoordinate(section.mesh.mesh))
        height = ufl.max_value(distance / (geometry.hydraulic_diameter / 2), NEAREST)
        power = height ** (1 / 7)
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
    x[dofs] *= mean * section.mesh.geometry.meshed_area / flux

# SPDX-License-Identifier: LGPL-3.0-or-later
"""The inlet of a developing flow: what enters, and how it is spread over the section."""

from __future__ import annotations

import numpy as np
import ufl
from dolfinx import fem

from fem_tfm.correlations import power_law
from fem_tfm.fenics import compile_expression
from fem_tfm.models.two_fluid.initial import set_turbulence
from fem_tfm.models.two_fluid.section import TwoFluidSection as Section
from fem_tfm.operation import Inlet


def enter(section: Section, inlet: Inlet, solids: tuple[float, float] | None) -> None:
    """Put the state of the inlet on a section.

    inlet : profile, intensities and length scale
    solids : alpha_s [-] and mean velocity u_s [m/s] of the solids that enter, None without any

    Velocities are axial, u = (mean) (60/49) (1 - 2r/D)^{1/7} or uniform, and carry exactly the
    fluxes of the feed. Where a wall law asks for rest there is rest. alpha_s is uniform, and with
    the mean velocities

        Theta = (I_s u_s)^2,  k = 3/2 (I u)^2,  eps = C_mu^0.75 k^1.5/l
    """
    section.drive.value = section.source.value = 0.0
    section.now.x.array[:] = 0.0
    shape = _shape(section, inlet.profile)
    alpha, speed = solids or (0.0, 0.0)
    gas_velocity = section.setup.gas_velocity / (1 - alpha)
    _spread(section, "u_g", shape, gas_velocity)
    length = fem.Constant(
        section.mesh.mesh, inlet.length_scale * section.mesh.section.hydraulic_diameter
    )
    gas = gas_velocity, inlet.gas_intensity
    set_turbulence(section, length, gas, (speed, inlet.solids_intensity))
    if section.setup.solids is None:
        return
    _spread(section, "u_s", shape, speed)
    limit = section.setup.solids.packing_limit
    agitation = inlet.solids_intensity * speed
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
        shape.interpolate(compile_expression(power, space.element.interpolation_points))
    return shape


def _spread(section: Section, name: str, shape: fem.Function, mean: float) -> None:
    """Give a phase the profile with the mean velocity over the true section."""
    number = section.names.index(name)
    dofs = np.asarray(section.space.sub(number).sub(2).collapse()[1]).ravel()
    x = section.now.x.array
    x[dofs] = shape.x.array
    section.fulfil()
    flux = section.integral(f"axial {name}", ufl.split(section.now)[number][2])
    x[dofs] *= mean * section.mesh.section.meshed_area / flux

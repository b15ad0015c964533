# SPDX-License-Identifier: LGPL-3.0-or-later
"""Starting states of a two-fluid section without another one's answer."""

from __future__ import annotations

from typing import Any

import numpy as np
import ufl
from dolfinx import fem

from fem_tfm.closures.turbulence.gas import nikuradse
from fem_tfm.fenics import compile_expression, compile_form
from fem_tfm.models.two_fluid.section import TwoFluidSection as Section

# measured: a cold start is fastest with a fluctuation speed of about this fraction of U_g
AGITATION_START = 0.016
SOLIDS_START = 1.0
# turbulence of gas and solids over U_g
GAS_INTENSITY, SOLIDS_INTENSITY = 0.1, 0.05


def _profile(section: Section, laminar: bool) -> fem.Function:
    """Axial shape with mean one: parabola for a laminar flow, 1/7 power otherwise [-]."""
    space = fem.functionspace(section.mesh.mesh, ("Lagrange", 2))
    geometry = section.mesh.section
    distance = geometry.wall_distance(ufl.SpatialCoordinate(section.mesh.mesh))
    s = distance / (geometry.hydraulic_diameter / 2)
    bounded = ufl.max_value(s, 0.01)
    shape = s * (2 - s) if laminar else bounded ** (1 / 7)
    profile = fem.Function(space)
    profile.interpolate(compile_expression(shape, space.element.interpolation_points))
    comm = section.mesh.mesh.comm
    mean = comm.allreduce(fem.assemble_scalar(compile_form(profile * ufl.dx))) / section.area
    profile.x.array[:] /= mean
    return profile


def solids_guess(section: Section) -> tuple[float, float]:
    """Hold-up [-] and mean solids velocity [m/s] to start from."""
    setup = section.setup
    assert setup.feed is not None and setup.solids is not None
    kind, value = setup.feed
    limit = 0.9 * setup.solids.packing_limit
    if kind == "holdup":
        alpha = value
        return alpha, SOLIDS_START * setup.gas_velocity / (1 - alpha)
    # flux = alpha u_s with u_s = 0.8 U_g/(1 - alpha)
    speed = SOLIDS_START * setup.gas_velocity
    alpha = min(value / (speed + value), limit)
    return alpha, value / alpha


def cold(section: Section) -> None:
    """Uniform alpha_s and Theta, 1/7-power (or parabolic) velocities, rest across the section."""
    setup = section.setup
    section.drive.value = section.source.value = 0.0
    laminar = setup.model.turbulence.name == "laminar"
    profile = _profile(section, laminar).x.array
    section.now.x.array[:] = 0.0
    alpha, u_s = (0.0, 0.0) if setup.solids is None else solids_guess(section)
    _set_axial(section, 0, profile * setup.gas_velocity / (1 - alpha))
    if setup.solids is not None:
        _set_axial(section, 2, np.full_like(profile, u_s))
        logit = float(np.log(alpha / (setup.solids.packing_limit - alpha)))
        for i, value in ((3, logit), (4, AGITATION_START * setup.gas_velocity)):
            section.now.x.array[section.space.sub(i).collapse()[1]] = value
    length = nikuradse(section.model.stretch()[0], section.model.domain.diameter / 2)
    speed = setup.gas_velocity
    set_turbulence(section, length, (speed, GAS_INTENSITY), (speed, SOLIDS_INTENSITY))
    section.fulfil()


def calm(section: Section) -> None:
    """The cold start with a parabola of the solids where their wall holds them."""
    cold(section)
    setup = section.setup
    if setup.solids is not None and setup.model.solids_wall.strong:
        _set_axial(section, 2, _profile(section, laminar=True).x.array * solids_guess(section)[1])
        section.fulfil()


def set_turbulence(
    section: Section, length: Any, gas: tuple[float, float], solids: tuple[float, float]
) -> None:
    """Give the transported turbulence its estimates from a length of the eddies [m].

    gas, solids : mean velocity [m/s] and intensity [-]
    """

    def numbers(values: tuple[float, float]) -> tuple[fem.Constant, fem.Constant]:
        speed, intensity = (fem.Constant(section.mesh.mesh, value) for value in values)
        return speed, intensity

    laws = section.model.closures
    guess = laws.turbulence.estimate(*numbers(gas), length)
    if section.setup.solids is not None:
        guess |= laws.dispersed.estimate(*numbers(solids), length)
    for name, value in guess.items():
        space, dofs = section.space.sub(section.names.index(name)).collapse()
        found = fem.Function(space)
        found.interpolate(compile_expression(value, space.element.interpolation_points))
        section.now.x.array[dofs] = found.x.array


def _set_axial(section: Section, i: int, values: np.ndarray) -> None:
    dofs = section.space.sub(i).sub(2).collapse()[1]
    section.now.x.array[np.asarray(dofs).ravel()] = values

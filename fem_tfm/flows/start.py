# SPDX-License-Identifier: LGPL-3.0-or-later
"""Starting states of a developed section: a cold guess, or another section's answer."""

from __future__ import annotations

from typing import Any

import numpy as np
import ufl
from dolfinx import fem

from fem_tfm.closures.turbulence import nikuradse
from fem_tfm.fenics import compile_form
from fem_tfm.flows.discretisation import Discretisation
from fem_tfm.flows.section import Section
from fem_tfm.interpolation import Transfer

# measured: a cold start is fastest with a fluctuation speed of about this fraction of U_g
AGITATION_START = 0.016
SOLIDS_START = 1.0
# turbulence of gas and solids over U_g
GAS_INTENSITY, SOLIDS_INTENSITY = 0.1, 0.05


def _profile(section: Section, laminar: bool) -> fem.Function:
    """Axial shape with mean one: parabola for a laminar flow, 1/7 power otherwise [-]."""
    space = fem.functionspace(section.mesh.mesh, ("Lagrange", 2))
    geometry = section.mesh.geometry
    distance = geometry.wall_distance(ufl.SpatialCoordinate(section.mesh.mesh))
    s = distance / (geometry.hydraulic_diameter / 2)
    bounded = ufl.max_value(s, 0.01)
    shape = s * (2 - s) if laminar else bounded ** (1 / 7)
    profile = fem.Function(space)
    profile.interpolate(fem.Expression(shape, space.element.interpolation_points))
    comm = section.mesh.mesh.comm
    mean = comm.allreduce(fem.assemble_scalar(compile_form(profile * ufl.dx))) / section.area
    profile.x.array[:] /= mean
    return profile


def solids_guess(section: Section) -> tuple[float, float]:
    """Hold-up [-] and mean solids velocity [m/s] to start from."""
    setup = section.setup
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
    laminar = setup.closures.turbulence.name == "laminar"
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
    _strong_zero(section)


def calm(section: Section) -> None:
    """The cold start with a parabola of the solids where their wall holds them."""
    cold(section)
    setup = section.setup
    if setup.solids is not None and setup.closures.solids_wall.strong:
        _set_axial(section, 2, _profile(section, laminar=True).x.array * solids_guess(section)[1])
        _strong_zero(section)


def set_turbulence(
    section: Section, length: Any, gas: tuple[float, float], solids: tuple[float, float]
) -> None:
    """Give the transported turbulence its estimates from a length of the eddies [m].

    gas, solids : mean velocity [m/s] and intensity [-]
    """

    def numbers(values: tuple[float, float]) -> list[fem.Constant]:
        return [fem.Constant(section.mesh.mesh, value) for value in values]

    laws = section.model.closures
    guess = laws.turbulence.estimate(*numbers(gas), length)
    if section.setup.solids is not None:
        guess |= laws.dispersed.estimate(*numbers(solids), length)
    for name, value in guess.items():
        space, dofs = section.space.sub(section.names.index(name)).collapse()
        found = fem.Function(space)
        found.interpolate(fem.Expression(value, space.element.interpolation_points))
        section.now.x.array[dofs] = found.x.array


def _set_axial(section: Section, i: int, values: np.ndarray) -> None:
    dofs = section.space.sub(i).sub(2).collapse()[1]
    section.now.x.array[np.asarray(dofs).ravel()] = values


def _strong_zero(section: Section) -> None:
    for bc in section.newton.bcs:
        bc.set(section.now.x.array)
    section.now.x.scatter_forward()


def warm(section: Section, source: Section) -> None:
    """The answer of another mesh of the same problem, with its multipliers."""
    transfer_fields(source, section)
    section.drive.value = float(source.drive.value)
    section.source.value = float(source.source.value)
    _strong_zero(section)


def follow(section: Section, source: Section, before: np.ndarray) -> None:
    """Add to a section's state how the state of a coarser one has changed since `before`.

    The difference of two meshes hardly depends on the numbers of the problem, so that this start is
    far closer than either mesh's own state.
    """
    after = source.now.x.array.copy()
    state = section.now.x.array.copy()
    for carrier in carriers(source, section):
        carrier.carry(after - before, section.now.x.array)
    section.now.x.array[:] += state
    section.drive.value = float(source.drive.value)
    section.source.value = float(source.source.value)
    _strong_zero(section)


class Carrier:
    """Carries one unknown from a section to another mesh; what the meshes fix is found once."""

    def __init__(
        self, source: Discretisation, target: Discretisation, i: int, known: dict[bytes, Transfer]
    ) -> None:
        given, self._from = source.space.sub(i).collapse()
        found, self._to = target.space.sub(i).collapse()
        self._from, self._to = np.asarray(self._from).ravel(), np.asarray(self._to).ravel()
        self._given, self._found = fem.Function(given), fem.Function(found)
        self._transfer = Transfer(given, found, known)

    def carry(self, source: np.ndarray, target: np.ndarray) -> None:
        """From all unknowns of the source to those of the target."""
        self._given.x.array[:] = source[self._from]
        self._transfer.carry(self._given, self._found)
        target[self._to] = self._found.x.array


def carriers(source: Discretisation, target: Discretisation) -> list[Carrier]:
    """One for each unknown, kept with the target; those of equal elements share what they find."""
    if source not in target.carriers:
        known: dict[bytes, Transfer] = {}
        numbers = range(len(target.names))
        target.carriers[source] = [Carrier(source, target, i, known) for i in numbers]
    return target.carriers[source]


def transfer_fields(source: Discretisation, target: Discretisation) -> None:
    """Carry all unknowns from one mesh to another."""
    for carrier in carriers(source, target):
        carrier.carry(source.now.x.array, target.now.x.array)

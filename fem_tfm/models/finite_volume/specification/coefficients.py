# SPDX-License-Identifier: LGPL-3.0-or-later
"""Coefficients of the laws at the state of a step, cell by cell and at walls."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import ufl

from fem_tfm.closures.walls.solids import WallState
from fem_tfm.models.finite_volume.cells.line import RISES
from fem_tfm.models.finite_volume.cells.mesh import SMALLEST
from fem_tfm.models.finite_volume.specification.data import present
from fem_tfm.models.finite_volume.specification.facets import FacetForms
from fem_tfm.models.pointwise import Invariants, Pointwise, SolidsCoefficients, tangential
from fem_tfm.models.solids_wall import HalfCell, at_wall


def solids_pressure(point: Pointwise, alpha: Any, theta: Any, deformation: Any, lift: Any) -> Any:
    """p_s of kinetic theory, friction and a normal stress `lift` of eddies over a rho_s [Pa]."""
    alpha = ufl.max_value(alpha, 0)
    found = point.solids_pressure(alpha, theta, deformation.shear, deformation.dilation)
    return found + alpha * point.solids.density * lift


def solids_coefficients(
    point: Pointwise, alpha: Any, theta: Any, deformation: Any, beta: Any
) -> SolidsCoefficients:
    """Coefficients of kinetic theory, as far as drag limits them by beta, and of friction."""
    alpha = ufl.max_value(alpha, 0)
    return point.coefficients(alpha, theta, deformation.shear, deformation.dilation, beta)


def drag_coefficients(point: Pointwise, alpha: Any, slip: Any, height: Any) -> tuple[Any, Any]:
    """beta and |u| d(beta)/d|u| at the slip velocity u = u_g - u_s [kg/m3/s]."""
    return point.drag_and_growth(present(alpha), point.speed(slip), height)


def gas_viscosity(point: Pointwise, gradient: Any, profile: tuple[Any, Any]) -> Any:
    """mu_g + mu_t of an algebraic law at height y' of a profile stretched by dy'/dy [Pa s]."""
    return point.gas_viscosity(point.eddies(Invariants(gradient), *profile), profile[1])


def solids_wall(
    on: FacetForms, point: Pointwise, half: HalfCell, viscosity: Any, conductivity: Any
) -> tuple[Any, Any]:
    """Friction c of the traction -c u of a wall on a cell [Pa s/m], its heat into Theta [W/m2].

    The law holds at the wall, half a cell away from the centre, where the state is known:

        c = c_w/(1 + c_w (n.d)/mu),   kappa (Theta_w - Theta)/(n.d) = heat(u_w, Theta_w),
        p_s(a_w, Theta_w) = p_s,w
    """
    near = on.weight.edge
    return at_wall(point, half, viscosity * near, conductivity * near)


def wall_rise(on: FacetForms, p_s: Any, gradient: Any) -> Any:
    """p_s on the faces of the wall, by its gradient in the cells there, over that of the cells."""
    low, high = RISES
    there = p_s + ufl.dot(gradient, on.delta.edge)
    found = (there + SMALLEST) / (p_s + SMALLEST)
    return ufl.max_value(low, ufl.min_value(high, found))


def wall_centre(
    on: FacetForms, point: Pointwise, alpha: Any, theta: Any, at: SolidsCoefficients, u: Any
) -> WallState:
    """The solids at the centre of a cell beside the wall."""
    slip = point.speed(tangential(u, on.normal.edge))
    return WallState(ufl.max_value(alpha, 0), theta, at.g0, at.p_f, slip)


def gas_wall(on: FacetForms, point: Pointwise, at: SimpleNamespace, height: Any) -> tuple[Any, Any]:
    """Friction c of the tractions -c u [Pa s/m]: of a wall on pure gas, of its eddies on solids."""
    speed = point.speed(tangential(at.u_g, on.normal.edge))
    beside = present(at.alpha), point.speed(at.u_g - at.u_s)
    return point.wall_friction(speed, height, at.scales.get("k"), beside)

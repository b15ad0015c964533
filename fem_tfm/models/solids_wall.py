# SPDX-License-Identifier: LGPL-3.0-or-later
"""A wall law of the solids at the wall, seen from the centre of a cell beside it.

A law holds for the velocity and the granular temperature of the grains that touch the wall. What a
cell knows lies at its centre, a distance h away. Between them the solids shear and conduct,

    c(u_w, Theta_w) u_w = (mu/h) (u - u_w),     (kappa/h) (Theta_w - Theta) = heat(u_w, Theta_w)

so that the wall brakes the cell by c/(1 + c h/mu), less than a wall that holds the grains does.

Symbols: u = |u_t| [m/s], Theta granular temperature [m2/s2], c friction of the law [Pa s/m].
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fem_tfm.closures.ops import Value, is_expr, maximum, minimum
from fem_tfm.closures.walls.solids import WallState
from fem_tfm.models.pointwise import Pointwise

# iterations, and the relative change of u_w and Theta_w for slopes
ITERATIONS, RISE = 6, 1e-3
# u_w lies between this share of the velocity at the centre and all of it; Theta_w falls by at most
# the second factor in an iteration
LEAST_SLIP, LEAST_SHARE = 1e-4, 0.1
# relative change of arrays that counts as none
STILL = 1e-14
# stands for no viscosity and no conduction
NOTHING = 1e-300


def at_wall(
    point: Pointwise, centre: WallState, stiffness: Value, conductance: Value | None
) -> tuple[Value, Value]:
    """Friction over the velocity at the centre [Pa s/m], and heat into the energy [W/m2].

    centre : solids with velocity and Theta at the centre of the cell
    stiffness, conductance : mu/h [Pa s/m] and kappa/h [kg/m2/s]; without the second Theta_w is
        that of the centre, as for an algebraic law

    Newton's method: in u_w at the Theta_w at hand, then in Theta_w with the u_w that belongs to it.
    """
    stiffness, theta, slip = stiffness + NOTHING, centre.theta, centre.slip

    def traction(theta: Value, slip: Value) -> Value:
        return point.solids_wall_friction(replace(centre, theta=theta, slip=slip)) * slip

    def heat(theta: Value, slip: Value) -> Value:
        return point.solids_wall_heat(replace(centre, theta=theta, slip=slip))

    def stiffening(theta: Value, slip: Value) -> tuple[Value, Value]:
        """Traction, and its growth with u_w of a law that grows."""
        pull = traction(theta, slip)
        rise = traction(theta, (1 + RISE) * slip) - pull
        return pull, maximum(rise / (RISE * slip), 0.0)

    def slid(pull: Value, slip: Value, stiff: Value) -> Value:
        """u_w after a step of Newton's method."""
        found = (stiffness * centre.slip - pull + stiff * slip) / (stiffness + stiff)
        return minimum(maximum(found, LEAST_SLIP * centre.slip), centre.slip)

    for _ in range(ITERATIONS):
        (pull, stiff), before = stiffening(theta, slip), slip
        slip, kept = slid(pull, before, stiff), theta
        if conductance is not None:
            later, given = (1 + RISE) * theta, heat(theta, slip)
            risen = heat(later, slid(traction(later, before), before, stiff))
            slope = minimum((risen - given) / (RISE * theta), 0.0)
            hot = conductance * centre.theta + given - slope * theta
            hot = hot / (conductance - slope + NOTHING)
            # sliding cannot heat the grains by more than it has
            theta = maximum(minimum(hot, centre.theta + centre.slip**2), LEAST_SHARE * theta)
        if _still(slip, before) and _still(theta, kept):
            break
    pull, stiff = stiffening(theta, slip)
    slip = slid(pull, slip, stiff)
    friction = traction(theta, slip) / slip
    return stiffness * friction / (friction + stiffness), heat(theta, slip)


def _still(now: Value, before: Value) -> bool:
    """Whether nothing has changed; an expression never tells."""
    if is_expr(now, before):
        return False
    return bool((np.abs(now - before) <= STILL * before).all())

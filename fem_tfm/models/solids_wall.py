# SPDX-License-Identifier: LGPL-3.0-or-later
"""A wall law of the solids at the wall, seen from the centre of a cell beside it.

A law holds for the velocity, the granular temperature and the fraction of the grains that touch the
wall. What a cell knows lies at its centre, a distance h away. Between them the solids shear and
conduct, and their pressure rises by what the flow tells,

    c(a_w, u_w, Theta_w) u_w = (mu/h) (u - u_w)
    (kappa/h) (Theta_w - Theta) = heat(a_w, u_w, Theta_w)
    p_s(a_w, Theta_w) = p_s,w

so that the wall brakes the cell by c/(1 + c h/mu), less than a wall that holds the grains does, and
grains that are hot at the wall are few there. The last is solved by steps of ln w with the growth
of both pressures with ln w at the centre, w = a/(a_max - a): that of kinetic theory grows nearly
like w in a void and in dense solids.

Symbols: a = alpha_s, u = |u_t| [m/s], Theta granular temperature [m2/s2], c friction of the law
[Pa s/m], p and p_f pressure of kinetic theory and of friction, p_s both [Pa].
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fem_tfm.closures.ops import Value, exp, is_expr, ln, maximum, minimum
from fem_tfm.closures.walls.solids import WallState
from fem_tfm.materials import Solids
from fem_tfm.models.pointwise import Pointwise

# iterations, and the relative changes of u_w and Theta_w, and of w, for slopes
ITERATIONS, RISE, WIDER = 6, 1e-3, 2e-2
# u_w lies between this share of the velocity at the centre and all of it; Theta_w falls by at most
# the second factor in an iteration
LEAST_SLIP, LEAST_SHARE = 1e-4, 0.1
# bounds of m_k and m_f, and the largest factor from w to w_w or back
LEAST_GROWTH, LARGEST_GROWTH, LARGEST_FACTOR = 0.5, 5.0, 10.0
# largest p_f at the wall over that at the centre: near its onset its growth tells little
MOST_FRICTION = 2.0
# relative change of arrays that counts as none
STILL = 1e-12
# stands for no viscosity, no conduction and no pressure
NOTHING = 1e-300


@dataclass(frozen=True)
class HalfCell:
    """The solids between the centre of a cell and the wall.

    centre : with velocity and Theta at the centre
    pressure : p_s at the wall [Pa]
    growth, friction_growth : m_k = d(ln p)/d(ln w) and m_f = d(ln p_f)/d(ln w) at the centre [-]
    """

    centre: WallState
    pressure: Value
    growth: Value
    friction_growth: Value

    @classmethod
    def beside(
        cls, point: Pointwise, centre: WallState, square: Value, dilation: Value, rise: Value
    ) -> HalfCell:
        """The half cell beside a wall, with S:S [1/s2] and D [1/s] at the centre.

        rise : p_s at the wall over that at the centre [-]
        """
        alpha, theta, solids = centre.alpha_s, centre.theta, point.grain
        kinetic, p_f = point.closures.granular.pressure, centre.friction_pressure
        pressure = kinetic(alpha, theta, centre.g0, solids) + p_f
        above = _fraction((1 + WIDER) * _ratio(alpha, solids), solids)
        g0 = point.closures.radial.g0(above, solids)
        friction = point.closures.friction.stress(above, theta, square, dilation, solids).pressure

        def growth(now: Value, risen: Value, least: float) -> Value:
            found = (risen / (now + NOTHING) - 1) / WIDER
            return minimum(maximum(found, least), LARGEST_GROWTH)

        risen = kinetic(above, theta, g0, solids)
        return cls(
            centre,
            rise * pressure,
            growth(kinetic(alpha, theta, centre.g0, solids), risen, LEAST_GROWTH),
            growth(p_f, friction, 0.0),
        )

    def moved(
        self, point: Pointwise, state: WallState, theta: Value, target: Value | None = None
    ) -> WallState:
        """The solids of a state at another Theta, after a step towards a p_s [Pa] or at its own.

        ln(w/w_state) = ln(target/p_s)/m,   m = (m_k p + m_f p_f)/p_s
        """
        solids, ratio = point.grain, _ratio(self.centre.alpha_s, point.grain)
        before, p_f = _ratio(state.alpha_s, solids), state.friction_pressure
        kinetic = point.closures.granular.pressure(state.alpha_s, theta, state.g0, solids)
        there = kinetic + p_f + NOTHING
        if target is None:
            # p ~ Theta
            target = kinetic * (state.theta / theta) + p_f
        growth = (self.growth * kinetic + self.friction_growth * p_f) / there
        found = before * exp(ln((target + NOTHING) / there) / maximum(growth, LEAST_GROWTH))
        found = minimum(maximum(found, ratio / LARGEST_FACTOR), ratio * LARGEST_FACTOR)
        p_f = p_f * ((found + NOTHING) / (before + NOTHING)) ** self.friction_growth
        alpha = _fraction(found, solids)
        g0 = point.closures.radial.g0(alpha, solids)
        most = MOST_FRICTION * self.centre.friction_pressure
        return WallState(alpha, theta, g0, minimum(p_f, most), state.slip)


def _ratio(alpha: Value, solids: Solids) -> Value:
    """w = a/(a_max - a)."""
    return alpha / (solids.packing_limit - alpha)


def _fraction(ratio: Value, solids: Solids) -> Value:
    """a = a_max w/(1 + w)."""
    return solids.packing_limit * ratio / (1 + ratio)


def at_wall(
    point: Pointwise, half: HalfCell, stiffness: Value, conductance: Value | None
) -> tuple[Value, Value]:
    """Friction over the velocity at the centre [Pa s/m], and heat into the energy [W/m2].

    stiffness, conductance : mu/h [Pa s/m] and kappa/h [kg/m2/s]; without the second Theta_w is
        that of the centre, as for an algebraic law

    Newton's method: in u_w at the Theta_w at hand, then in Theta_w with the u_w that belongs to it.
    """
    stiffness, centre = stiffness + NOTHING, half.centre
    theta, slip = centre.theta, centre.slip
    state = half.moved(point, centre, theta, half.pressure)

    def traction(state: WallState, slip: Value) -> Value:
        return point.solids_wall_friction(replace(state, slip=slip)) * slip

    def heat(state: WallState, slip: Value) -> Value:
        return point.solids_wall_heat(replace(state, slip=slip))

    def stiffening(state: WallState, slip: Value) -> tuple[Value, Value]:
        """Traction, and its growth with u_w of a law that grows."""
        pull = traction(state, slip)
        rise = traction(state, (1 + RISE) * slip) - pull
        return pull, maximum(rise / (RISE * slip), 0.0)

    def slid(pull: Value, slip: Value, stiff: Value) -> Value:
        """u_w after a step of Newton's method."""
        found = (stiffness * centre.slip - pull + stiff * slip) / (stiffness + stiff)
        return minimum(maximum(found, LEAST_SLIP * centre.slip), centre.slip)

    for _ in range(ITERATIONS):
        (pull, stiff), before = stiffening(state, slip), slip
        slip, kept = slid(pull, before, stiff), theta
        if conductance is not None:
            later, given = half.moved(point, state, (1 + RISE) * theta), heat(state, slip)
            risen = heat(later, slid(traction(later, before), before, stiff))
            slope = minimum((risen - given) / (RISE * theta), 0.0)
            hot = conductance * centre.theta + given - slope * theta
            hot = hot / (conductance - slope + NOTHING)
            # a wall takes like sqrt(Theta) at one p_s, so that cooling is a step of sqrt(Theta)
            colder = minimum(hot / theta - 1, 0.0)
            hot = maximum(hot + theta * colder**2 / 4, LEAST_SHARE * theta)
            # sliding cannot heat the grains by more than it has
            theta = minimum(hot, centre.theta + centre.slip**2)
        state = half.moved(point, state, theta, half.pressure)
        if _still(slip, before) and _still(theta, kept):
            break
    pull, stiff = stiffening(state, slip)
    slip = slid(pull, slip, stiff)
    friction = traction(state, slip) / slip
    return stiffness * friction / (friction + stiffness), heat(state, slip)


def _still(now: Value, before: Value) -> bool:
    """Whether nothing has changed; an expression never tells."""
    if is_expr(now, before):
        return False
    return bool((np.abs(now - before) <= STILL * before).all())

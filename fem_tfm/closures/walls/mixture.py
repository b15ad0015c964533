# SPDX-License-Identifier: LGPL-3.0-or-later
"""Logarithmic layer of a gas whose eddies carry grains along.

Grains that follow the eddies give them their mass. Below a height y the layer has the density

    rho_e = rho_g (1 + Z s),   s = y/(y + y_s),   y_s = tau_F sqrt(u_p^2 + c u^2)/(0.45 kappa)

for an eddy at y lasts 0.45 kappa y/u_p in a layer in equilibrium, k = u_p^2/sqrt(C_mu). With the
traction tau = rho_g u_g^2 of the wall the velocity rises by tau/mu_g in the sublayer, up to
y_0 = 11.5 nu_g w_0/u_g, and from there to y_p by the integral of u_e/(kappa y), u_e = u_g w::

    U = u_g {11.5 w_0 + [F(w_0) - F(w_p)]/kappa},   w^2 = rho_g/rho_e = (y + y_s)/(a y + y_s)
    F(w) = ln[(1 + w)/(1 - w)] + ln[(sqrt(a) w - 1)/(sqrt(a) w + 1)]/sqrt(a),   a = 1 + Z

Hence the traction does not depend on the height at which it is evaluated, however much of the layer
the grains follow in.

Symbols: Z = a rho_s/(a_g rho_g) loading, tau_F relaxation time of a grain [s], u slip between the
phases [m/s], c = 0.45 C_beta crossing of trajectories, u_p friction velocity at y_p [m/s].
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from fem_tfm.closures.ops import Value, exp, ln, maximum, sqrt
from fem_tfm.closures.walls.gas import GasWallState, LogLaw

# tau_t y_p over y_p/u_p in equilibrium: 3/2 nu/k with nu = kappa u y and k = u^2/0.3
EDDY_TIME = 0.45
# iterations for u_g, and within each for w: they leave 0.1 % of the traction for Z < 20
ITERATIONS, INNER = 3, 2
# von Karman's constant, and kappa y+ at the edge of the sublayer, y+ = ln(9.8 y+)/kappa
KAPPA, EDGE = 0.41, 4.73
# least kappa U/u_g of the gas alone. Below EDGE the whole layer is viscous, and the traction of the
# eddies has no share in it; the sum of the logarithms would vanish there
LEAST_LOG = 1.0
# keeps a law without traction finite
_TINY = 1e-30


@dataclass(frozen=True)
class Followers:
    """Grains that follow the eddies of a gas at a wall.

    loading : Z [-]
    relaxation : tau_F [s]
    slip : |u_g - u_s| [m/s]
    crossing : C_beta of the crossing trajectories [-]
    """

    loading: Any
    relaxation: Any
    slip: Any
    crossing: Any


def mixed_layer(
    u_plus: Value, speed: Value, distance: Value, followers: Followers, given: bool
) -> tuple[Value, Value]:
    """Traction over that of the gas alone, and s at y_p.

    u_plus : velocity over the friction velocity of the gas alone [-]
    speed : friction velocity of the gas alone [m/s]
    distance : y_p [m]
    given : `speed` is u_p, known from k, in place of u_g of the gas alone

    Newton's method in u_g, with w_0 and w_p that follow.
    """
    a, log = 1 + followers.loading, maximum(KAPPA * u_plus, LEAST_LOG)
    lag = followers.relaxation / (EDDY_TIME * KAPPA * distance)
    slip2 = EDDY_TIME * followers.crossing * followers.slip**2
    # rise = u_g over that of the gas alone; heights are over y_p
    rise: Value = 1.0
    w_0: Value = 1.0
    w_p: Value = 1.0
    whole, y_s = log, lag
    for _ in range(ITERATIONS):
        for _ in range(INNER):
            y_s = lag * sqrt((speed if given else rise * speed * w_p) ** 2 + slip2)
            y_0 = exp(EDGE - log) * w_0 / rise
            w_0, w_p = sqrt((y_0 + y_s) / (a * y_0 + y_s)), sqrt((1 + y_s) / (a + y_s))
            rise = 1 / w_p if given else rise
        local2 = (speed if given else rise * speed * w_p) ** 2
        y_s, y_0 = lag * sqrt(local2 + slip2), exp(EDGE - log) * w_0 / rise
        whole = _whole(log, rise, a, (y_0, y_s), (w_0, w_p))
        if not given:
            slope = _slope(a, (y_0, y_s), (w_0, w_p), local2 / (local2 + slip2))
            rise = rise * (1 + (log / (rise * whole) - 1) / (1 + slope / whole))
    mixed = rise * log / whole if given else rise**2
    return mixed, 1 / (1 + lag * sqrt((speed if given else rise * speed * w_p) ** 2 + slip2))


def _whole(
    log: Value, rise: Value, a: Value, heights: tuple[Value, Value], w: tuple[Value, Value]
) -> Value:
    """kappa U/u_g, without the differences of F that vanish for Z = 0 and for y_s = 0 [-]."""
    (y_0, y_s), (w_0, w_p), root = heights, w, sqrt(a)
    span = ln((a + y_s) / (a * y_0 + y_s))
    inner = span + 2 * ln((root * w_p + 1) / (root * w_0 + 1))
    outer = log - EDGE + ln(rise / w_0) - span + 2 * ln((1 + w_0) / (1 + w_p))
    return EDGE * w_0 + outer + inner / root


def _slope(a: Value, heights: tuple[Value, Value], w: tuple[Value, Value], share: Value) -> Value:
    """d(kappa U/u_g)/d(ln u_g), where y_s grows with u_p by a share [-]."""
    (y_0, y_s), (w_0, w_p) = heights, w
    # -d(ln w)/d(ln y) at both ends, and the growth of ln y_s and of ln w_0
    at_0, at_p = ((a - 1) * y * y_s / (2 * (y + y_s) * (a * y + y_s)) for y in (y_0, 1.0))
    lagging = share / (1 - share * at_p)
    edge = at_0 * (1 + lagging) / (1 + at_0)
    return EDGE * w_0 * edge + w_0 * (1 - edge) + lagging * (w_0 - w_p)


def shared_friction(
    friction: Value, state: GasWallState, law: LogLaw, of: Followers
) -> tuple[Value, Value]:
    """Coefficients c [Pa s/m] of the tractions on the gas and, over Z, on the grains.

    friction : c of the law for the gas alone [Pa s/m]

    The viscous part mu_g/y acts on the gas alone. The rest belongs to the eddies, which the gas and
    the grains carry in the proportion 1 : Z s.
    """
    density, viscous = state.gas.density, state.gas.viscosity / state.distance
    alone = law.friction_velocity(state, friction) + _TINY
    u_plus = density * alone / (friction + _TINY) if law.needs_k else state.speed / alone
    mixed, share = mixed_layer(u_plus, alone, state.distance, of, law.needs_k)
    # the logarithmic part grows by `mixed`, in the blend of the law with its viscous limit
    m = law.sharpness
    viscous_part = (viscous / friction) ** m
    power = mixed**m * (1 - viscous_part) + viscous_part
    eddies = (friction * power ** (1 / m) - viscous) / (1 + of.loading * share)
    return viscous + eddies, share * eddies

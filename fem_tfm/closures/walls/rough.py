# SPDX-License-Identifier: LGPL-3.0-or-later
"""Wall law of solids that bounce off a rough wall.

A rough wall is made of facets, which are tilted along the stream by normally distributed angles. A
grain that comes with the velocities c_n towards the wall and u along it meets a facet of the angle
gamma in the proportion of c_n cos(gamma) + u sin(gamma), and none from behind. Every grain that
comes hits one facet, with the impulse of Schneiderbauer's flat wall, by sliding or sticking.

Symbols: a = alpha_s, g0 radial distribution, Theta granular temperature [m2/s2], p_f frictional
pressure [Pa], rho_s [kg/m3], u = |u_t| [m/s], d grain diameter [m], e_w restitution at the wall,
mu_w wall friction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from fem_tfm.closures.base import parameter, register
from fem_tfm.closures.ops import Value, atan, erf, exp, radians, smooth_norm, sqrt, tan
from fem_tfm.closures.walls.solids import Schneiderbauer, WallState
from fem_tfm.materials import Solids

_TINY_THETA = 1e-12
_TINY_RATIO = 1e-12
# of sqrt(Theta) and of sqrt(q) u, by which facets that face the stream are hit before the others
SLOW, FAST = 1.2, 1.15


class Impacts(NamedTuple):
    """What the impacts on a rough wall have in common.

    flux : mass that hits, m [kg/m2/s]
    slip : u regularised [m/s]
    tilt : q, about the mean square sine of the wall's facets, whose mean push is 4 eta q u [-]
    normal : Theta', half the mean square speed of impact on a facet [m2/s2]
    """

    flux: Value
    slip: Value
    tilt: Value
    normal: Value


@register("solids-wall", "rough")
@dataclass(frozen=True)
class Rough(Schneiderbauer):
    """Sliding and sticking collisions with a rough wall, plus Coulomb friction of the bed.

        c      = m [4 eta q + (1 - q) J(Theta', u)] + mu_w p_f/u
        heat   = m {4 eta q u^2 + (2 eta mu_w)^2 Theta' [1 - exp(-b'^2)] - 4 eta (1 - eta) Theta'
                    - (1 + q) Theta [J(Theta, v) + k (1 - k) exp(-b^2)]} + share mu_w p_f u
        J(T,u) = 2 eta mu_w sqrt(pi T/2) erf(b)/u,  b(T, u) = u/(sqrt(2 T) mu_0)
        Theta' = (1 - q) Theta + q u^2 {1 + sqrt(Theta)/[1.2 sqrt(Theta) + 1.15 sqrt(q) u]}
        q      = [1 - exp(-4 sigma^2)]/4,  cot(sigma)^2 = cot(sigma_0)^2 + d/H
        m      = a rho_s g0 sqrt(Theta/(2 pi)),  eta = (1 + e_w)/2,  k = (2/7)(1 + beta_0),
        mu_0   = 2 eta mu_w/k,  b' = b(Theta', u),  b = b(Theta, v),  v^2 = u^2 + Theta

    The facets turn motion along the wall into fluctuations: q u^2 is much beside Theta in a dilute
    line, however small q. The heat is the work of the traction less what the impacts dissipate, of
    grains that come without spin. With sigma_0 = 0 the friction is that of `schneiderbauer` and the
    heat a corrected one.

    Beside a Monte Carlo of impacts of grains that fluctuate across the wall, c is within 3 % up to
    10 degrees and 5 % at 15, for u/sqrt(Theta) of 0.1 to 30. Fluctuations along the wall lower c
    where u < 3 sqrt(Theta): by 12 % for e_w = mu_w = 0.5, by a third for e_w = 0.9, mu_w = 0.2.
    With them the heat is within 3 % of work and dissipation from u = sqrt(Theta) on, 8 % below.
    Second hits on the way out are left out; they add up to 5 %.

    A large grain rests on the highest peaks, a distance of sqrt(H d) apart, and sees flanks of
    sqrt(H/d); the sum of the squares of the cotangents is an estimate. sigma_0 and H are fitted to
    Konno and Saito's level lines of 70 um to 3 mm with the default e_w and mu_w.

    Validity: dilute flow of spheres, sigma up to 15 degrees; in a dense bed it heats too much, and
    a pipe of hold-up 0.19 loses more than twice its pressure.
    Source: facets of Sommerfeld and Huber (1999), Int. J. Multiphase Flow 25, 1457-1489, impacts of
    Schneiderbauer et al. (2012), Int. J. Multiphase Flow 43, 149-156; integrated here.
    """

    flat: ClassVar[bool] = False
    densest: ClassVar[float] = 0.05
    roughness_deg: float = parameter(
        3.0, "deg", "standard deviation sigma_0 of the tilt of the wall", ge=0, le=30
    )
    roughness_height: float = parameter(
        6e-7, "m", "height H of the peaks, on which larger grains rest", gt=0
    )

    def tilt(self, diameter: Value) -> Value:
        """q [-] for grains of a diameter [m]."""
        slope = tan(radians(self.roughness_deg))
        seen = atan(slope / sqrt(1 + slope**2 * diameter / self.roughness_height))
        return (1 - exp(-4 * seen * seen)) / 4

    def impacts(self, state: WallState, solids: Solids) -> Impacts:
        """Mass that hits, and how fast."""
        theta, slip = state.theta + _TINY_THETA, smooth_norm(state.slip, self.slip_floor)
        tilt, speed = self.tilt(solids.diameter), sqrt(theta)
        faced = 1 + speed / (SLOW * speed + FAST * sqrt(tilt) * slip)
        flux = state.alpha_s * solids.density * state.g0 * speed / math.sqrt(2 * math.pi)
        normal = (1 - tilt) * theta + tilt * state.slip**2 * faced
        return Impacts(flux, slip, tilt, normal)

    def _constants(self) -> tuple[Value, Value]:
        """2 eta mu_w and k."""
        impulse = (1 + self.restitution) * self.friction_coefficient
        return impulse, 2 / 7 * (1 + self.tangential_restitution)

    def _ratio(self, slip: Value, theta: Value) -> Value:
        """u/(sqrt(2 T) mu_0) at T [m2/s2]."""
        impulse, held = self._constants()
        return held * slip / (sqrt(2 * theta) * impulse + _TINY_RATIO)

    def _impulse(self, slip: Value, theta: Value) -> Value:
        """J [-] at T [m2/s2]."""
        sliding = self._constants()[0] * sqrt(math.pi * theta / 2)
        return sliding * erf(self._ratio(slip, theta)) / slip

    def friction(self, state: WallState, solids: Solids) -> Value:
        """Coefficient c [Pa s/m] of the traction -c u_t."""
        flux, slip, tilt, normal = self.impacts(state, solids)
        sliding = (1 - tilt) * self._impulse(slip, normal)
        bed = self.friction_coefficient * state.friction_pressure / slip
        return flux * (2 * (1 + self.restitution) * tilt + sliding) + bed

    def heat(self, state: WallState, solids: Solids) -> Value:
        """Flux into the granular energy [W/m2]."""
        flux, slip, tilt, normal = self.impacts(state, solids)
        theta, slip2, (impulse, held) = state.theta, state.slip**2, self._constants()
        thrown = 2 * (1 + self.restitution) * tilt * slip2
        lost = (1 - self.restitution**2) * normal
        slid = impulse**2 * normal * (1 - exp(-(self._ratio(slip, normal) ** 2)))
        fluctuating = theta + _TINY_THETA
        swept = smooth_norm(slip, sqrt(fluctuating))
        stuck = held * (1 - held) * exp(-(self._ratio(swept, fluctuating) ** 2))
        along = (1 + tilt) * theta * (self._impulse(swept, fluctuating) + stuck)
        bed = self.sliding_heat * self.friction_coefficient * state.friction_pressure * slip2 / slip
        return flux * (thrown + slid - lost - along) + bed

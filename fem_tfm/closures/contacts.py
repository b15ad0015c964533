# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts of grains, treated one by one: forces between two grains, or a grain and a wall.

A law gives the coefficients that the compiled kernel works with, and the same force as a formula on
arrays, with which the kernel is compared. Two grains overlap by d, n is the unit normal towards the
first one, v_n its speed along n against the second, v_t the velocity of the surfaces against each
other:

    F_n = max(S_n - g_n v_n, 0),  never attractive

The dashpot g_n is calibrated so that a collision of two free grains, followed with the time step at
hand, has the restitution asked for. The closed formula of a dashpot that may pull would give 0.54
where 0.5 is asked.

Symbols: d overlap [m], m reduced mass [kg], R reduced radius [m], v_n, v_t [m/s], xi spring of a
contact's tangential motion [m], mu friction, F_n normal and F_t tangential force [N], w relative
spin [1/s].
"""

from __future__ import annotations

import functools
import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from scipy.optimize import brentq

from fem_tfm.closures.base import Closure, parameter, register

# phases of a step at which a calibrated collision may begin, and the step over the root of
# mass/stiffness where the time step is to have no influence
_PHASES, _SMALL_STEP = 32, 0.01
# largest ratio of damping that is tried
_MOST_DAMPING = 20.0


class Coefficients(NamedTuple):
    """What the kernel needs of a law.

    stiffness : k of S_n = k d [N/m], or k sqrt(R) d^{3/2} [N/m2]
    damping : c of g_n = c sqrt(m dS_n/dd)
    shear_stiffness : k_t [N/m], or k_t/sqrt(R d) [N/m2], of the tangential spring
    shear_damping : c of g_t = c sqrt(m k_t), or c sqrt(m k) where there is no spring
    friction, rolling_friction : mu and mu_r
    rolling_damping : c of the torque c sqrt(m dS_n/dd) R^2 w that mu_r R F_n limits
    """

    stiffness: float
    damping: float
    shear_stiffness: float
    shear_damping: float
    friction: float
    rolling_friction: float
    rolling_damping: float


class Touch(NamedTuple):
    """Contacts as arrays: (n,) or, for vectors, (n, 3).

    velocity : of the first centre against the second
    surface : sum of radius times spin of both
    mass, radius : reduced ones
    """

    overlap: Any
    normal: Any
    velocity: Any
    surface: Any
    mass: Any
    radius: Any


@dataclass(frozen=True)
class Contact(Closure):
    """Interface of a contact law.

    kind : number of the law in the kernel
    """

    kind: ClassVar[int]

    @abstractmethod
    def coefficients(self, mass: float, time_step: float) -> Coefficients:
        """Coefficients for contacts of a reduced mass [kg], followed with a time step [s]."""

    @abstractmethod
    def contact_time(self, mass: float, radius: float) -> float:
        """Time that an undamped collision takes [s], of a reduced mass [kg] and radius [m]."""

    @abstractmethod
    def stiffnesses(self, touch: Touch, c: Coefficients) -> tuple[Any, Any, Any]:
        """S_n [N], dS_n/dd [N/m] and k_t [N/m] of contacts."""

    def force(
        self, touch: Touch, c: Coefficients, spring: Any, time_step: float
    ) -> tuple[Any, Any, Any, Any]:
        """Force on the first grain (n, 3), n x F_t (n, 3), F_n (n,), and the spring afterwards."""
        n = touch.normal
        elastic, slope, shear = self.stiffnesses(touch, c)
        speed = np.sum(touch.velocity * n, axis=1)
        damping = c.damping * np.sqrt(touch.mass * slope)
        normal = np.maximum(elastic - damping * speed, 0.0)
        slip = touch.velocity - speed[:, None] * n - np.cross(touch.surface, n)
        limit = c.friction * normal
        if c.shear_stiffness == 0.0:
            size = np.linalg.norm(slip, axis=1) + 1e-150
            g = np.minimum(c.shear_damping * np.sqrt(touch.mass * slope), limit / size)
            tangential = -g[:, None] * slip
        else:
            g = c.shear_damping * np.sqrt(touch.mass * shear)
            spring = spring + time_step * slip
            spring = spring - np.sum(spring * n, axis=1)[:, None] * n
            tried = -shear[:, None] * spring - g[:, None] * slip
            size = np.linalg.norm(tried, axis=1) + 1e-150
            slides = size > limit
            tangential = tried * np.where(slides, limit / size, 1.0)[:, None]
            held = -(tangential + g[:, None] * slip) / np.maximum(shear, 1e-300)[:, None]
            spring = np.where(slides[:, None], held, spring)
        total = normal[:, None] * n + tangential
        return total, -np.cross(n, tangential), normal, spring

    def rolling_torque(self, touch: Touch, c: Coefficients, spin: Any, normal: Any) -> Any:
        """Torque of rolling friction on the first grain (n, 3), against the relative spin w."""
        if c.rolling_friction == 0.0:
            return 0.0 * spin
        _, slope, _ = self.stiffnesses(touch, c)
        size = np.linalg.norm(spin, axis=1) + 1e-150
        viscous = c.rolling_damping * np.sqrt(touch.mass * slope) * touch.radius**2
        g = np.minimum(viscous, c.rolling_friction * normal * touch.radius / size)
        return -g[:, None] * spin


@dataclass(frozen=True)
class _Linear(Contact):
    """What the laws with S_n = k d share."""

    stiffness: float = parameter(100.0, "N/m", "stiffness of a contact", gt=0, le=1e9)

    def contact_time(self, mass: float, radius: float) -> float:
        """pi sqrt(m/k) [s]."""
        return math.pi * math.sqrt(mass / self.stiffness)

    def stiffnesses(self, touch: Touch, c: Coefficients) -> tuple[Any, Any, Any]:
        """k d, k and k_t."""
        one = np.ones_like(touch.overlap)
        return c.stiffness * touch.overlap, c.stiffness * one, c.shear_stiffness * one


@register("contact", "viscous-coulomb")
@dataclass(frozen=True)
class ViscousCoulomb(_Linear):
    """Linear spring and dashpot, sliding friction that is viscous at small slip.

        S_n = k d,   g_n = c sqrt(m k), c from the restitution
        F_t = -min(mu F_n, g_t |v_t|) v_t/|v_t|,   g_t = c_t sqrt(m k)
        torque of rolling friction: at most mu_r R F_n

    Grains at rest creep slowly, since nothing holds them at zero slip.

    Validity: stiffness so high that grains overlap by some per cent of a radius at most.
    Source: Strauss, McNamara and Herrmann, Plug conveying in a horizontal tube, section 2.2;
    Cundall and Strack (1979), Geotechnique 29, 47-65.
    """

    restitution: float = parameter(0.5, "-", "normal restitution", ge=0.05, le=1)
    friction: float = parameter(0.5, "-", "Coulomb coefficient mu", ge=0, le=10)
    tangential_damping: float = parameter(
        0.9, "-", "c_t, tangential damping over sqrt(m k)", ge=0, le=10
    )
    rolling_friction: float = parameter(0.0, "-", "rolling friction mu_r", ge=0, le=1)
    kind: ClassVar[int] = 0

    def coefficients(self, mass: float, time_step: float) -> Coefficients:
        """Coefficients of the kernel."""
        damping = linear_damping(self.restitution, time_step * math.sqrt(self.stiffness / mass))
        sliding, rolling = self.tangential_damping, self.rolling_friction
        return Coefficients(self.stiffness, damping, 0.0, sliding, self.friction, rolling, _ROLLING)


@register("contact", "cundall-strack")
@dataclass(frozen=True)
class CundallStrack(_Linear):
    """Linear spring and dashpot, tangential spring with memory, cut by Coulomb's limit.

        S_n = k d,   g_n = c sqrt(m k), c from the restitution
        F_t = -k_t xi - g_t v_t,  |F_t| <= mu F_n,  xi' = v_t while it holds
        torque of rolling friction: at most mu_r R F_n

    Grains come to rest on slopes.

    Validity: stiffness so high that grains overlap by some per cent of a radius at most.
    Source: Cundall and Strack (1979), Geotechnique 29, 47-65.
    """

    restitution: float = parameter(0.5, "-", "normal restitution", ge=0.05, le=1)
    friction: float = parameter(0.5, "-", "Coulomb coefficient mu", ge=0, le=10)
    stiffness_ratio: float = parameter(2 / 7, "-", "k_t over k", gt=0, le=1)
    tangential_damping: float = parameter(
        0.4, "-", "tangential damping over sqrt(m k_t)", ge=0, le=10
    )
    rolling_friction: float = parameter(0.0, "-", "rolling friction mu_r", ge=0, le=1)
    kind: ClassVar[int] = 1

    def coefficients(self, mass: float, time_step: float) -> Coefficients:
        """Coefficients of the kernel."""
        damping = linear_damping(self.restitution, time_step * math.sqrt(self.stiffness / mass))
        shear = self.stiffness * self.stiffness_ratio
        return Coefficients(
            self.stiffness,
            damping,
            shear,
            self.tangential_damping,
            self.friction,
            self.rolling_friction,
            _ROLLING,
        )


@register("contact", "hertz-mindlin")
@dataclass(frozen=True)
class HertzMindlin(Contact):
    """Hertz's elastic spheres with Mindlin's tangential stiffness, both of one material.

        S_n = (4/3) E* sqrt(R) d^{3/2},   E* = E/(2 (1 - nu^2))
        F_t = -k_t xi - g_t v_t,  k_t = 8 G* sqrt(R d),  G* = E/(4 (1 + nu) (2 - nu))
        g_n = c sqrt(m dS_n/dd), c from the restitution, at any speed

    Validity: small overlaps; a Young's modulus below that of the material keeps the time step large
    and hardly changes a flow as long as grains overlap by some per cent of a radius at most.
    Source: Mindlin and Deresiewicz (1953), J. Appl. Mech. 20, 327-344; damping of Tsuji, Tanaka and
    Ishida (1992), Powder Technol. 71, 239-250.
    """

    young_modulus: float = parameter(2e6, "Pa", "Young's modulus E", gt=0, le=1e12)
    poisson_ratio: float = parameter(0.3, "-", "Poisson's ratio nu", ge=0, le=0.5)
    restitution: float = parameter(0.5, "-", "normal restitution", ge=0.05, le=1)
    friction: float = parameter(0.5, "-", "Coulomb coefficient mu", ge=0, le=10)
    tangential_damping: float = parameter(
        0.4, "-", "tangential damping over sqrt(m k_t)", ge=0, le=10
    )
    rolling_friction: float = parameter(0.0, "-", "rolling friction mu_r", ge=0, le=1)
    impact_speed: float = parameter(
        0.5, "m/s", "speed of an impact for which the time step is judged", gt=0, le=1000
    )
    kind: ClassVar[int] = 2

    def coefficients(self, mass: float, time_step: float) -> Coefficients:
        """Coefficients of the kernel."""
        stiffness = 4 / 3 * self._modulus
        shear = 8 * self.young_modulus / (4 * (1 + self.poisson_ratio) * (2 - self.poisson_ratio))
        return Coefficients(
            stiffness,
            hertz_damping(self.restitution),
            shear,
            self.tangential_damping,
            self.friction,
            self.rolling_friction,
            _ROLLING,
        )

    @property
    def _modulus(self) -> float:
        return self.young_modulus / (2 * (1 - self.poisson_ratio**2))

    def contact_time(self, mass: float, radius: float) -> float:
        """2.868 (m^2/(R E*^2 v))^{1/5} [s] at the impact speed v."""
        stiff = radius * self._modulus**2 * self.impact_speed
        return float(2.868 * (mass**2 / stiff) ** 0.2)

    def stiffnesses(self, touch: Touch, c: Coefficients) -> tuple[Any, Any, Any]:
        """S_n, its slope, and k_t."""
        width = np.sqrt(touch.radius * touch.overlap)
        elastic = c.stiffness * width * touch.overlap
        return elastic, 1.5 * c.stiffness * width, c.shear_stiffness * width


# damping of rolling friction over sqrt(m dS_n/dd): grains stop within some contact times
_ROLLING = 0.9


def collide(damping: float, step: float, exponent: float) -> float:
    """Restitution of a collision, the mean over the phases of the steps at which it begins.

    Mass and stiffness are one; F = max(x^a - c sqrt(a x^{a-1}) x', 0), followed as the kernel does.
    """
    speed = np.ones(_PHASES)
    overlap = (np.arange(_PHASES) + 0.5) / _PHASES * step
    touching = np.ones(_PHASES, dtype=bool)
    while touching.any():
        x = np.maximum(overlap, 0.0)
        slope = exponent * x ** (exponent - 1)
        push = np.maximum(x**exponent + damping * np.sqrt(slope) * speed, 0.0)
        speed = np.where(touching, speed - step * push, speed)
        overlap = overlap + step * speed
        touching &= overlap > 0
    return float(-speed.mean())


def _calibrated(restitution: float, step: float, exponent: float) -> float:
    """The damping at which a collision has a restitution."""
    if restitution >= collide(0.0, step, exponent):
        return 0.0

    def miss(damping: float) -> float:
        return collide(damping, step, exponent) - restitution

    # a step that is too long for a strong damping turns a grain back at once
    most = min(_MOST_DAMPING, 0.9 / step)
    if miss(most) > 0:
        return most
    return float(brentq(miss, 0.0, most, xtol=1e-10))


@functools.cache
def linear_damping(restitution: float, step: float) -> float:
    """c of a linear spring; step is the time step over sqrt(m/k)."""
    return _calibrated(restitution, step, 1.0)


@functools.cache
def hertz_damping(restitution: float) -> float:
    """c of Hertz's law, at a small time step; the speed does not matter."""
    return _calibrated(restitution, _SMALL_STEP, 1.5)

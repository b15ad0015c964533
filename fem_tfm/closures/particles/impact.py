# SPDX-License-Identifier: LGPL-3.0-or-later
"""Impact of a particle on a wall.

Symbols: v velocity, n normal out of the flow, v_n = v.n > 0 before the impact, v_s slip of the
point that touches [m/s], omega rotation [1/s], r radius [m].
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Any

from fem_tfm.closures.base import Closure, parameter, register


class ImpactLaw(Closure):
    """Interface of an impact."""

    @abstractmethod
    def numbers(self) -> dict[str, Any]:
        """Numbers of the kernel."""


def _numbers(kind: int, **more: float) -> dict[str, Any]:
    none = {"restitution": 1.0, "friction": 0.0, "roughness": 0.0, "stick_speed": 0.0}
    return {"impact": kind} | none | more


@register("impact", "elastic")
@dataclass(frozen=True)
class Elastic(ImpactLaw):
    """Elastic impact on a smooth wall.

        v' = v - 2 v_n n

    Validity: hard, smooth surfaces.
    Source: definition.
    """

    def numbers(self) -> dict[str, Any]:
        """Numbers of the kernel."""
        return _numbers(0)


@register("impact", "restitution")
@dataclass(frozen=True)
class Restitution(ImpactLaw):
    """Impact with restitution, friction and roughness; a sphere slides or rolls.

        v'     = v - (1 + e) v_n n - s v_s,   s = min(mu (1 + e) v_n/|v_s|, 2/7)
        omega' = omega - 5/(2 r) s n x v_s

    The normal of a rough wall is tilted by normally distributed angles along and across the path;
    flanks are met in the proportion of sin(angle of approach + tilt), and never from behind.

    Validity: spheres; angles up to about 15 degrees.
    Source: Sommerfeld and Huber (1999), Int. J. Multiphase Flow 25, 1457-1489.
    """

    e: float = parameter(0.9, "-", "restitution of the normal velocity", ge=0, le=1)
    mu: float = parameter(0.0, "-", "friction", ge=0, le=2)
    roughness_deg: float = parameter(0.0, "deg", "standard deviation of the tilt", ge=0, le=30)

    def numbers(self) -> dict[str, Any]:
        """Numbers of the kernel."""
        tilt = math.radians(self.roughness_deg)
        return _numbers(1, restitution=self.e, friction=self.mu, roughness=tilt)


@register("impact", "stick")
@dataclass(frozen=True)
class Stick(ImpactLaw):
    """Particles stay where they touch, unless they come fast.

        deposited if v_n < v_c or v_c = 0, elastic otherwise

    Validity: fine or wet particles.
    Source: definition.
    """

    speed: float = parameter(
        0.0, "m/s", "normal speed v_c from which a particle rebounds; 0: none does", ge=0
    )

    def numbers(self) -> dict[str, Any]:
        """Numbers of the kernel."""
        return _numbers(2, stick_speed=self.speed or math.inf)

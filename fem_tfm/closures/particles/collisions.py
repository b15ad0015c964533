# SPDX-License-Identifier: LGPL-3.0-or-later
"""Collisions between particles, each with a fictitious one that is drawn from the cloud around it.

Symbols: n number of particles a volume [1/m3], d diameter [m], v velocity and V its mean [m/s],
sigma its standard deviation [m/s], tau_p relaxation time [s], T_L life of an eddy [s].
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any

from fem_tfm.closures.base import Closure, parameter, register


class ParticleCollisions(Closure):
    """Interface of a law of collisions."""

    @abstractmethod
    def numbers(self) -> dict[str, float]:
        """Numbers of the kernel."""

    @staticmethod
    def frequency(number: Any, diameter: Any, relative: Any) -> Any:
        """Collisions of a particle with others of its kind a second [1/s].

        f = pi d^2 |v_1 - v_2| n
        """
        return 3.141592653589793 * diameter**2 * relative * number


@register("particle-collisions", "sommerfeld")
@dataclass(frozen=True)
class Sommerfeld(ParticleCollisions):
    """Stochastic collisions with partners that are correlated by the eddies.

        v_2 = V + R (v_1 - V) + sigma sqrt(1 - R^2) N(0, 1),   R = exp(-C (tau_p/T_L)^0.4)
        p   = pi/4 (d_1 + d_2)^2 |v_1 - v_2| n dt
        impact of spheres with restitution e and Coulomb friction mu, at a place that is evenly
        distributed over the cross-section of both

    Validity: pairs only, so alpha_p below about 0.1; numbers, means and deviations are those of a
    cell; sizes of partners are those of the whole cloud of their material.
    Source: Sommerfeld (2001), Int. J. Multiphase Flow 27, 1829-1858.
    """

    e: float = parameter(0.9, "-", "restitution between particles", ge=0, le=1)
    mu: float = parameter(0.4, "-", "friction between particles", ge=0, le=2)
    C: float = parameter(0.55, "-", "how soon inertia undoes the correlation", gt=0, le=100)
    share: float = parameter(
        0.2, "-", "largest step over the mean time between two collisions", gt=0, le=0.5
    )

    def numbers(self) -> dict[str, float]:
        """Numbers of the kernel."""
        return {
            "pair_restitution": self.e,
            "pair_friction": self.mu,
            "pair_correlation": self.C,
            "pair_share": self.share,
        }

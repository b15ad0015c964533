# SPDX-License-Identifier: LGPL-3.0-or-later
"""Wear: what an impact takes from a wall.

Symbols: v speed of the impact [m/s], gamma angle between path and wall [rad], m mass and d diameter
of the particle [kg], [m], rho_w density of the wall [kg/m3]. Numpy arrays or numbers alike.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from fem_tfm.closures.base import Closure, parameter, register

type Array = npt.NDArray[np.float64]


class Wear(Closure):
    """Interface of a law of wear.

    slowest : speed of the slowest impacts in the tests behind it [m/s], 0 where none is told
    """

    slowest: ClassVar[float] = 0.0

    @abstractmethod
    def removed(self, speed: Array, angle: Array, mass: Array, diameter: Array) -> Array:
        """Mass of the wall that impacts remove [kg]."""


@register("wear", "finnie")
@dataclass(frozen=True)
class Finnie(Wear):
    """Cutting of a ductile wall by hard grains.

        rho_w C m v^2/(p psi K) [sin(2 gamma) - 6/K sin^2(gamma)]   for tan(gamma) <= K/6
        rho_w C m v^2/(p psi K) K/6 cos^2(gamma)                    above

    Validity: ductile metals, gamma below about 60 degrees; no wear at right angles.
    Source: Finnie (1960), Wear 3, 87-103.
    """

    p: float = parameter(1.5e9, "Pa", "flow stress of the wall", ge=1e6, le=1e11)
    psi: float = parameter(2.0, "-", "depth of contact over depth of cut", gt=0)
    K: float = parameter(2.0, "-", "vertical over horizontal force", gt=0, le=100)
    C: float = parameter(0.5, "-", "share of grains that cut", gt=0, le=1)
    rho_w: float = parameter(7800.0, "kg/m3", "density of the wall", ge=100, le=25000)

    def removed(self, speed: Array, angle: Array, mass: Array, diameter: Array) -> Array:
        """Mass of the wall that impacts remove [kg]."""
        scale = self.rho_w * self.C * mass * speed**2 / (self.p * self.psi * self.K)
        flat = np.sin(2 * angle) - 6 / self.K * np.sin(angle) ** 2
        steep = self.K / 6 * np.cos(angle) ** 2
        return np.asarray(scale * np.where(np.tan(angle) <= self.K / 6, flat, steep))


@register("wear", "oka")
@dataclass(frozen=True)
class Oka(Wear):
    """Correlation of erosion tests, cutting and deformation together.

        1e-9 rho_w m E_90 sin^n1(gamma) [1 + H (1 - sin(gamma))]^n2
        E_90 = K H^k1 (v/104 m/s)^k2 (d/326 um)^k3 in mm3/kg,   k2 = 2.3 H^0.038
        n1 = s1 H^q1,  n2 = s2 H^q2

    H is the Vickers hardness in GPa; the constants are those of quartz sand.

    Validity: metals of 0.05 < H < 8 GPa, 50 < v < 170 m/s in the tests.
    Source: Oka, Okamura and Yoshida (2005), Wear 259, 95-101; Oka and Yoshida (2005), Wear 259,
    102-109.
    """

    H: float = parameter(1.2, "GPa", "Vickers hardness of the wall", ge=0.01, le=20)
    K: float = parameter(65.0, "-", "kind of the particle", gt=0)
    k1: float = parameter(-0.12, "-", "exponent of the hardness")
    k3: float = parameter(0.19, "-", "exponent of the diameter", ge=-2, le=2)
    s1: float = parameter(0.71, "-", "factor of n1", gt=0)
    q1: float = parameter(0.14, "-", "exponent of the hardness in n1")
    s2: float = parameter(2.4, "-", "factor of n2", gt=0)
    q2: float = parameter(-0.94, "-", "exponent of the hardness in n2")
    rho_w: float = parameter(7800.0, "kg/m3", "density of the wall", ge=100, le=25000)
    slowest: ClassVar[float] = 50.0

    def removed(self, speed: Array, angle: Array, mass: Array, diameter: Array) -> Array:
        """Mass of the wall that impacts remove [kg]."""
        n1, n2 = self.s1 * self.H**self.q1, self.s2 * self.H**self.q2
        sine = np.sin(angle)
        shape = sine**n1 * (1 + self.H * (1 - sine)) ** n2
        straight = self.K * self.H**self.k1 * (speed / 104.0) ** (2.3 * self.H**0.038)
        straight = straight * (diameter / 326e-6) ** self.k3
        return np.asarray(1e-9 * self.rho_w * mass * straight * shape)

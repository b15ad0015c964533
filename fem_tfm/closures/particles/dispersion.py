# SPDX-License-Identifier: LGPL-3.0-or-later
"""How turbulence scatters particles: the gas velocity that a particle sees.

    u = U + L xi,  R = L L^T,  L the lower Cholesky factor of the Reynolds stresses

xi is normally distributed. Both laws have the autocorrelation exp(-t/T_L) and keep a uniform cloud
of points that follow the gas uniform, whatever R and T_L, because of the drift d_i L_ij.

Symbols: T_L = C_L k/eps life of an eddy [s], tau_p relaxation time of the particle [s], w slip
between particle and mean gas [m/s], sigma^2 = 2 k/3.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

from fem_tfm.closures.base import Closure, parameter, register


class ParticleDispersion(Closure):
    """Interface of a law of dispersion.

    turbulent : whether it needs the turbulence of the gas
    """

    turbulent: ClassVar[bool] = True

    @abstractmethod
    def numbers(self) -> dict[str, Any]:
        """Numbers of the kernel."""

    def life(self, k: Any, eps: Any) -> Any:
        """T_L [s] of k [m2/s2] and eps [m2/s3]."""
        return 0.0 * k


@register("particle-dispersion", "none")
@dataclass(frozen=True)
class MeanFlow(ParticleDispersion):
    """Particles see the mean velocity of the gas.

        u = U

    Validity: tau_p far above T_L, or a laminar gas.
    Source: definition.
    """

    turbulent: ClassVar[bool] = False

    def numbers(self) -> dict[str, Any]:
        """Numbers of the kernel."""
        return {"dispersion": 0, "crossing": 0.0, "inertia": 0.0}


@dataclass(frozen=True)
class _Scattered(ParticleDispersion):
    """What both laws share."""

    C_L: float = parameter(0.21, "-", "life of an eddy, T_L eps/k", gt=0, le=2)
    crossing: float = parameter(
        0.0, "-", "beta of crossing trajectories, 0 for none, about 1 with it", ge=0, le=10
    )
    inertia: float = parameter(
        1.0, "-", "c of the drift of a particle, which fades as 1/(1 + c tau_p/T_L)", ge=0, le=10
    )

    number: ClassVar[int] = 0

    def numbers(self) -> dict[str, Any]:
        """Numbers of the kernel."""
        return {"dispersion": self.number, "crossing": self.crossing, "inertia": self.inertia}

    def life(self, k: Any, eps: Any) -> Any:
        """T_L [s] of k [m2/s2] and eps [m2/s3]."""
        return self.C_L * k / eps


@register("particle-dispersion", "langevin")
@dataclass(frozen=True)
class Langevin(_Scattered):
    """Normalised Langevin equation with the drift that keeps a mixed cloud mixed.

        d xi_j = -xi_j dt/T + d_i L_ij dt/(1 + c tau_p/T_L) + sqrt(2/T) dW_j
        T      = T_L/sqrt(1 + (beta w/sigma)^2) along w, T_L/sqrt(1 + (2 beta w/sigma)^2) across

    Validity: homogeneous turbulence and wall layers; sub-grid structures are not resolved.
    Source: Thomson (1987), J. Fluid Mech. 180, 529-556, for the well-mixed condition; Csanady
    (1963), J. Atmos. Sci. 20, 201-208, for crossing trajectories; the factor of inertia after
    Bocksell and Loth (2006), Int. J. Multiphase Flow 32, 1234-1253.
    """

    number: ClassVar[int] = 1


@register("particle-dispersion", "eddies")
@dataclass(frozen=True)
class Eddies(_Scattered):
    """Discrete eddies of random life with the drift that keeps a mixed cloud mixed.

        xi is drawn anew at the rate 1/T;   between draws d xi_j = d_i L_ij dt/(1 + c tau_p/T_L)
        T as for the Langevin equation

    Validity: as for the Langevin equation.
    Source: Gosman and Ioannides (1983), J. Energy 7, 482-490, with lives that are exponentially
    distributed; the drift from the well-mixed condition of Thomson (1987), J. Fluid Mech. 180,
    529-556.
    """

    number: ClassVar[int] = 2

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reynolds stresses of the gas: how pressure redistributes them, and the control without it.

    u.grad R_ij = d_k (C_s k/eps R_kn d_n R_ij) + P_ij + Phi_ij - 2/3 eps delta_ij
    P_ij = -R_ik d_k U_j - R_jk d_k U_i

A law gives Phi; a wall reflects pressure fluctuations by its normal n and the function

    f_z = C_mu^(3/4) k^(3/2)/(kappa eps x_n)

summed over the walls, x_n the distance to each. In a log layer where production is dissipation,
f_z is one if C_mu is the model's own (-uv/k)^2; `C_mu = 0` asks for that value, which `resolved`
fills in. The 0.09 of an eddy-viscosity model makes f_z = 1.66 instead with the constants of `lrr`.

Symbols: R_ij = <u_i u_j> [m2/s2], k = R_kk/2, eps dissipation [m2/s3], L_ij = d_j U_i [1/s],
b = R/(2k) - delta/3, S and W symmetric and antisymmetric parts of L, P = P_kk/2.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
from scipy.optimize import fsolve

from fem_tfm.closures.base import Closure, parameter, register
from fem_tfm.closures.ops import (
    Tensor,
    Value,
    deviator,
    dot,
    identity,
    outer,
    safe_pow,
    sqrt,
    symmetric,
    trace,
    transpose,
)

_TINY_ANISOTROPY = 1e-12


@dataclass(frozen=True)
class Wall:
    """A wall as a point of the flow sees it.

    normal : unit vector, shape (3,)
    nearness : 1/x_n [1/m]
    """

    normal: Any
    nearness: Any


@dataclass(frozen=True)
class LogLayer:
    """Equilibrium of a stress law in the log layer of a plane wall.

    stress : R/k, shape (3, 3), axes along the flow, off the wall and across [-]
    C_mu : (-uv/k)^2 = (u_tau^2/k)^2 [-]
    kappa : slope that the equation of eps implies [-]
    reflection : f_z [-]
    """

    stress: np.ndarray
    C_mu: float
    kappa: float
    reflection: float


def production(stress: Tensor, gradient: Tensor) -> Tensor:
    """P_ij = -R_ik d_k U_j - R_jk d_k U_i [m2/s3], of R and L_ij = d_j U_i."""
    work = dot(stress, transpose(gradient))
    return -(work + transpose(work))


class StressLaw(Closure):
    """Interface of the Reynolds stresses.

    transported : whether R_ij is an unknown; else it is that of an eddy viscosity
    C_e1, C_e2 : production and dissipation of eps [-]
    """

    transported: ClassVar[bool] = True
    C_e1: float
    C_e2: float

    @abstractmethod
    def log_layer(self) -> LogLayer:
        """Equilibrium in the log layer, for plain numbers."""

    def resolved(self) -> Self:
        """The same law with `C_mu = 0` replaced by that of its log layer."""
        return self


class Transported(StressLaw):
    """What the laws with a transport equation for each stress share.

    C_s, C_eps : diffusion of the stresses and of eps [-]
    """

    C_s: float
    C_eps: float

    @abstractmethod
    def redistribution(
        self, stress: Tensor, gradient: Tensor, k: Value, eps: Value, walls: Sequence[Wall]
    ) -> Tensor:
        """Phi_ij [m2/s3]."""

    def stress_diffusivity(self, stress: Tensor, k: Value, eps: Value) -> Tensor:
        """C_s k/eps R of Daly and Harlow [m2/s]."""
        return self.C_s * k / eps * stress

    def eps_diffusivity(self, stress: Tensor, k: Value, eps: Value) -> Tensor:
        """C_eps k/eps R [m2/s]."""
        return self.C_eps * k / eps * stress

    def reflection(self, k: Value, eps: Value, wall: Wall) -> Value:
        """f_z [-]; no reflection unless a law has some."""
        return 0.0

    def log_layer(self) -> LogLayer:
        """Equilibrium P = eps of the law's own stress equation in simple shear, k = eps = 1."""
        unit = np.array([0.0, 1.0, 0.0])

        def state(x: np.ndarray) -> tuple[np.ndarray, np.ndarray, Wall]:
            along, off, shear = x
            stress = np.diag([along, off, 2 - along - off])
            stress[0, 1] = stress[1, 0] = -shear
            wall = Wall(unit, self.nearness_in_equilibrium(shear))
            return stress, np.outer([1.0, 0.0, 0.0], unit) / shear, wall

        def balance(x: np.ndarray) -> list[float]:
            stress, gradient, wall = state(x)
            change = production(stress, gradient) - 2 / 3 * np.eye(3)
            change = change + self.redistribution(stress, gradient, 1.0, 1.0, [wall])
            return [change[0, 0], change[1, 1], change[0, 1]]

        found = fsolve(balance, [1.0, 0.3, 0.27], xtol=1e-13)
        stress, _, wall = state(found)
        c_mu = found[2] ** 2
        kappa = np.sqrt((self.C_e2 - self.C_e1) * c_mu * found[2] / (self.C_eps * found[1]))
        return LogLayer(stress, float(c_mu), float(kappa), float(self.reflection(1.0, 1.0, wall)))

    def nearness_in_equilibrium(self, shear: float) -> float:
        """1/x_n of eps = u_tau^3/(kappa x_n) = 1 at u_tau^2 = `shear`; nothing without walls."""
        return 0.0


@register("reynolds-stress", "lrr")
@dataclass(frozen=True)
class LRR(Transported):
    """Quasi-isotropic law of Launder, Reece and Rodi with reflection by walls.

        Phi_1   = -C_1 eps/k (R - 2/3 k delta)
        Phi_2   = -alpha (P_ij - 2/3 P delta) - beta k (L_ij + L_ji) - gamma (D_ij - 2/3 P delta)
        Phi_w1  = C_z1 eps/k [R_km n_k n_m delta_ij - 3/2 R_ki n_k n_j - 3/2 R_kj n_k n_i] f_z
        Phi_w2  = C_z2 [Phi_2,km n_k n_m delta_ij - 3/2 Phi_2,ki n_k n_j - 3/2 Phi_2,kj n_k n_i] f_z
        alpha = (C_2 + 8)/11, beta = (30 C_2 - 2)/55, gamma = (8 C_2 - 2)/11
        D_ij = -R_ik d_j U_k - R_jk d_i U_k

    The reflection is that of Gibson and Launder (1978), J. Fluid Mech. 86, 491-511.

    Validity: attached flow at high Reynolds number, walls with wall functions.
    Source: Launder, Reece and Rodi (1975), J. Fluid Mech. 68, 537-566; constants as printed in
    Milanovic et al. (2018), Thermal Science 22.
    """

    C_1: float = parameter(1.5, "-", "return to isotropy", gt=0)
    C_2: float = parameter(0.4, "-", "rapid redistribution")
    C_z1: float = parameter(0.5, "-", "reflection of the return to isotropy", ge=0)
    C_z2: float = parameter(0.06, "-", "reflection of the rapid part", ge=0)
    C_mu: float = parameter(0.0, "-", "C_mu of f_z; 0 takes that of the log layer", ge=0)
    kappa: float = parameter(0.41, "-", "von Karman constant of f_z", gt=0)
    C_s: float = parameter(0.21, "-", "diffusion of the stresses", gt=0)
    C_eps: float = parameter(0.15, "-", "diffusion of eps", gt=0)
    C_e1: float = parameter(1.44, "-", "production of eps", gt=0)
    C_e2: float = parameter(1.9, "-", "dissipation of eps", gt=0)

    def nearness_in_equilibrium(self, shear: float) -> float:
        """1/x_n where eps = u_tau^3/(kappa x_n) = 1 at u_tau^2 = `shear`."""
        return self.kappa / shear**1.5

    def redistribution(
        self, stress: Tensor, gradient: Tensor, k: Value, eps: Value, walls: Sequence[Wall]
    ) -> Tensor:
        """Phi_ij [m2/s3]."""
        slow = -self.C_1 * eps / k * deviator(stress)
        rapid = self.rapid(stress, gradient, k)
        total = slow + rapid
        for wall in walls:
            f = self.reflection(k, eps, wall)
            total = total + self.C_z1 * f * eps / k * reflected(stress, wall.normal)
            total = total + self.C_z2 * f * reflected(rapid, wall.normal)
        return total

    def rapid(self, stress: Tensor, gradient: Tensor, k: Value) -> Tensor:
        """Phi_2 [m2/s3]."""
        alpha, beta = (self.C_2 + 8) / 11, (30 * self.C_2 - 2) / 55
        gamma = (8 * self.C_2 - 2) / 11
        across = dot(stress, gradient)
        across = -(across + transpose(across))
        return (
            -alpha * deviator(production(stress, gradient))
            - 2 * beta * k * symmetric(gradient)
            - gamma * deviator(across)
        )

    def reflection(self, k: Value, eps: Value, wall: Wall) -> Value:
        """f_z [-]."""
        return self.C_mu**0.75 * k * sqrt(k) / (self.kappa * eps) * wall.nearness

    def resolved(self) -> Self:
        """The same law with `C_mu = 0` replaced by the value that makes f_z one."""
        if self.C_mu:
            return self
        # with f_z = 1 whatever k, the balance gives C_mu
        return replace(self, C_mu=_UnitReflection.of(self).log_layer().C_mu)

    def log_layer(self) -> LogLayer:
        """Equilibrium in the log layer; with `C_mu = 0` that of f_z = 1."""
        return super().log_layer() if self.C_mu else self.resolved().log_layer()


class _UnitReflection(LRR):
    """The law with f_z = 1."""

    @classmethod
    def of(cls, law: LRR) -> Self:
        return cls(**{**law.__dict__, "C_mu": 1.0})

    def reflection(self, k: Value, eps: Value, wall: Wall) -> Value:
        return 1.0


def reflected(tensor: Tensor, normal: Tensor) -> Tensor:
    """t_km n_k n_m delta_ij - 3/2 (t_ki n_k n_j + t_kj n_k n_i), of a symmetric t."""
    along = dot(tensor, normal)
    mixed = outer(along, normal)
    return dot(along, normal) * identity(tensor) - 1.5 * (mixed + transpose(mixed))


@register("reynolds-stress", "ssg")
@dataclass(frozen=True)
class SSG(Transported):
    """Law of Speziale, Sarkar and Gatski, quadratic in the anisotropy, without reflection.

        Phi = -(C_1 eps + C_1s P) b + C_2 eps (b b - tr(b b) delta/3) + (C_3 - C_3s sqrt(b:b)) k S
              + C_4 k (b S + S b - 2/3 tr(b S) delta) + C_5 k (W b - b W)

    Validity: attached flow at high Reynolds number; no distance to walls is needed.
    Source: Speziale, Sarkar and Gatski (1991), J. Fluid Mech. 227, 245-272.
    """

    C_1: float = parameter(3.4, "-", "return to isotropy", gt=0)
    C_1s: float = parameter(1.8, "-", "return to isotropy with production", ge=0)
    C_2: float = parameter(4.2, "-", "quadratic return to isotropy")
    C_3: float = parameter(0.8, "-", "isotropic rapid part")
    C_3s: float = parameter(1.3, "-", "its reduction by anisotropy")
    C_4: float = parameter(1.25, "-", "rapid part with the strain rate")
    C_5: float = parameter(0.4, "-", "rapid part with the rotation rate")
    C_s: float = parameter(0.22, "-", "diffusion of the stresses", gt=0)
    C_eps: float = parameter(0.183, "-", "diffusion of eps", gt=0)
    C_e1: float = parameter(1.44, "-", "production of eps", gt=0)
    C_e2: float = parameter(1.83, "-", "dissipation of eps", gt=0)

    def redistribution(
        self, stress: Tensor, gradient: Tensor, k: Value, eps: Value, walls: Sequence[Wall]
    ) -> Tensor:
        """Phi_ij [m2/s3]."""
        b = deviator(stress) / (2 * k)
        strain = symmetric(gradient)
        rotation = gradient - strain
        bb, bs = dot(b, b), dot(b, strain)
        work = -trace(dot(stress, gradient))
        size = safe_pow(trace(bb), 0.5, _TINY_ANISOTROPY)
        turned = dot(rotation, b)
        return (
            -(self.C_1 * eps + self.C_1s * work) * b
            + self.C_2 * eps * deviator(bb)
            + (self.C_3 - self.C_3s * size) * k * strain
            + self.C_4 * k * deviator(bs + transpose(bs))
            + self.C_5 * k * (turned + transpose(turned))
        )


@register("reynolds-stress", "k-epsilon")
@dataclass(frozen=True)
class EddyViscosity(StressLaw):
    """Standard k-epsilon: stresses of an eddy viscosity, without secondary flow in a straight duct.

        R = 2/3 k delta - nu_t (L_ij + L_ji),   nu_t = C_mu k^2/eps

    Validity: the control beside the laws that have normal stresses of their own.
    Source: Launder and Spalding (1974), Comput. Methods Appl. Mech. Eng. 3, 269-289.
    """

    transported: ClassVar[bool] = False

    C_mu: float = parameter(0.09, "-", "eddy viscosity", gt=0)
    sigma_k: float = parameter(1.0, "-", "turbulent Prandtl number of k", gt=0)
    sigma_eps: float = parameter(1.3, "-", "turbulent Prandtl number of eps", gt=0)
    C_e1: float = parameter(1.44, "-", "production of eps", gt=0)
    C_e2: float = parameter(1.92, "-", "dissipation of eps", gt=0)

    def eddy_viscosity(self, k: Value, eps: Value) -> Value:
        """nu_t [m2/s]."""
        return self.C_mu * k * k / eps

    def stress(self, gradient: Tensor, k: Value, eps: Value) -> Tensor:
        """R [m2/s2]."""
        strain = 2 * self.eddy_viscosity(k, eps) * symmetric(gradient)
        return 2 / 3 * k * identity(gradient) - strain

    def log_layer(self) -> LogLayer:
        """Isotropic normal stresses, uv = -sqrt(C_mu) k."""
        stress = 2 / 3 * np.eye(3)
        stress[0, 1] = stress[1, 0] = -np.sqrt(self.C_mu)
        kappa = np.sqrt((self.C_e2 - self.C_e1) * self.sigma_eps * np.sqrt(self.C_mu))
        return LogLayer(stress, self.C_mu, float(kappa), 0.0)

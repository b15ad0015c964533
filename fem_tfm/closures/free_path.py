# SPDX-License-Identifier: LGPL-3.0-or-later
"""Viscosity and conductivity of grains that the gas brakes before they meet each other.

The kinetic theory knows collisions alone, so that grains of a dilute suspension carry momentum and
energy over mean free paths longer than a pipe is wide. The gas brakes them within the relaxation
time, however few they are.

Symbols: a = alpha_s, beta drag coefficient [kg/m3/s], g0 radial distribution, Theta granular
temperature [m2/s2], mu viscosity [Pa s] and kappa conductivity [kg/m/s] of the kinetic theory.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from fem_tfm.closures.base import Closure, register
from fem_tfm.closures.granular import Kinetic
from fem_tfm.closures.ops import Value
from fem_tfm.materials import Solids

# keeps a void without grains finite
_TINY = 1e-100


class FreePath(Closure):
    """Interface of a limit of the mean free path by the gas.

    absent : there is none
    """

    absent: ClassVar[bool] = False

    @abstractmethod
    def limited(
        self, kinetic: Kinetic, alpha_s: Value, theta: Value, g0: Value, beta: Value, solids: Solids
    ) -> Kinetic:
        """The coefficients of grains in a gas with the drag coefficient beta [kg/m3/s]."""


@register("free-path", "none")
@dataclass(frozen=True)
class Unlimited(FreePath):
    """Collisions alone limit the mean free path.

        mu, kappa of the kinetic theory

    Validity: grains that meet within their relaxation time.
    Source: definition.
    """

    absent: ClassVar[bool] = True

    def limited(
        self, kinetic: Kinetic, alpha_s: Value, theta: Value, g0: Value, beta: Value, solids: Solids
    ) -> Kinetic:
        """The same."""
        return kinetic


@register("free-path", "agrawal")
@dataclass(frozen=True)
class Agrawal(FreePath):
    """Drag limits the mean free path (Agrawal).

        mu    = mu_c + mu_k/[1 + 2 beta mu_k/((a rho_s)^2 g0 Theta)],  mu_c = (3/5) lambda
        kappa = kappa_c + kappa_k/[1 + (6/5) beta kappa_k/((a rho_s)^2 g0 Theta)],
        kappa_c = (3/2) lambda

    mu_k and kappa_k are the kinetic parts of any theory. mu_c and kappa_c are those of contacts,
    which need no path and stay as do lambda, the pressure and the dissipation. For a -> 0 mu and
    kappa tend to a rho_s tau Theta/2 and a rho_s tau Theta/1.2 with the relaxation time
    tau = a rho_s/beta of a grain: proportional to a and without the mean free path.

    Validity: any kinetic theory of grains in a gas, dilute to dense.
    Source: Agrawal, Loezos, Syamlal and Sundaresan (2001), J. Fluid Mech. 445, 151-185; Syamlal,
    Rogers and O'Brien (1993), MFIX Documentation: Theory Guide.
    """

    def limited(
        self, kinetic: Kinetic, alpha_s: Value, theta: Value, g0: Value, beta: Value, solids: Solids
    ) -> Kinetic:
        """The coefficients of grains in a gas with the drag coefficient beta [kg/m3/s]."""
        held = (alpha_s * solids.density) ** 2 * g0 * theta

        def braked(whole: Value, contact: float, factor: float) -> Value:
            of_contacts = contact * kinetic.bulk_viscosity
            free = whole - of_contacts
            return of_contacts + free * held / (held + factor * beta * free + _TINY)

        return kinetic._replace(
            shear_viscosity=braked(kinetic.shear_viscosity, 0.6, 2.0),
            conductivity=braked(kinetic.conductivity, 1.5, 1.2),
        )

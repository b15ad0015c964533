# SPDX-License-Identifier: LGPL-3.0-or-later
"""Viscosity and conductivity of grains that the gas brakes before they meet each other.

The kinetic theory knows collisions alone, so that grains of a dilute suspension carry momentum and
energy over mean free paths longer than a pipe is wide. The gas brakes them within the relaxation
time, however few they are.

Symbols: a = alpha_s, beta drag coefficient [kg/m3/s], g0 radial distribution, Theta granular
temperature [m2/s2], mu viscosity [Pa s] and kappa conductivity [kg/m/s] of the kinetic theory.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from fem_tfm.closures.base import Closure, register
from fem_tfm.closures.granular import Granular, Kinetic
from fem_tfm.closures.ops import Value, minimum
from fem_tfm.materials import Solids

# keeps a void without grains finite
_TINY = 1e-100


class FreePath(Closure):
    """Interface of a limit of the mean free path by the gas.

    absent : there is none
    """

    absent: ClassVar[bool] = False

    def coefficients(
        self,
        theory: Granular,
        alpha_s: Value,
        theta: Value,
        g0: Value,
        beta: Value,
        solids: Solids,
        length: Value,
    ) -> Kinetic:
        """Coefficients of the kinetic theory of grains in a gas, in the units of `Kinetic`.

        Those of the theory itself, unless a law limits them.

        alpha_s [-], theta [m2/s2], g0 [-] : fields of one shape, or UFL expressions
        beta : drag coefficient [kg/m3/s]
        length : pipe diameter [m], as for the theory
        """
        return theory.coefficients(alpha_s, theta, g0, solids, length)


@register("free-path", "none")
@dataclass(frozen=True)
class Unlimited(FreePath):
    """Collisions alone limit the mean free path.

        mu, kappa of the kinetic theory

    Validity: grains that meet within their relaxation time.
    Source: definition.
    """

    absent: ClassVar[bool] = True


@register("free-path", "agrawal")
@dataclass(frozen=True)
class Agrawal(FreePath):
    """Drag limits the mean free path (Agrawal).

        mu    = mu_c + mu_k/[1 + 2 beta mu_d/((a rho_s)^2 g0 Theta)],  mu_c = (3/5) lambda
        kappa = kappa_c + kappa_k/[1 + (6/5) beta kappa_d/((a rho_s)^2 g0 Theta)],
        kappa_c = (3/2) lambda

    mu_c and kappa_c are those of contacts, which need no path and stay as do lambda, the pressure
    and the dissipation; mu_k and kappa_k are the rest of any theory. mu_d and kappa_d are the
    theory's coefficients of dilute grains, so that the brackets hold the time between collisions
    over the relaxation time tau = a rho_s/beta of a grain. For a -> 0 mu and kappa tend to
    a rho_s tau Theta/2 and a rho_s tau Theta/1.2: proportional to a and without the mean free path.

    Dense grains of e < 0.5 get less than mu_c or kappa_c from theories of nearly elastic grains;
    there is nothing to brake then, and the theory's value stays. Hence 0 < mu' <= mu of the theory.

    Validity: any kinetic theory of grains in a gas, dilute to dense.
    Source: Agrawal, Loezos, Syamlal and Sundaresan (2001), J. Fluid Mech. 445, 151-185; Syamlal,
    Rogers and O'Brien (1993), MFIX Documentation: Theory Guide.
    """

    def coefficients(
        self,
        theory: Granular,
        alpha_s: Value,
        theta: Value,
        g0: Value,
        beta: Value,
        solids: Solids,
        length: Value,
    ) -> Kinetic:
        """Those of the theory, with what flights carry held back by the drag."""
        found = super().coefficients(theory, alpha_s, theta, g0, beta, solids, length)
        viscosity, conductivity = theory.dilute(alpha_s, theta, solids, length)
        held = (alpha_s * solids.density) ** 2 * g0 * theta

        def braked(whole: Value, of_contacts: Value, braking: Value) -> Value:
            contact = minimum(whole, of_contacts)
            return contact + (whole - contact) * held / (held + beta * braking + _TINY)

        bulk = found.bulk_viscosity
        return found._replace(
            shear_viscosity=braked(found.shear_viscosity, 0.6 * bulk, 2 * viscosity),
            conductivity=braked(found.conductivity, 1.5 * bulk, 1.2 * conductivity),
        )

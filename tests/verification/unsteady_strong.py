# SPDX-License-Identifier: LGPL-3.0-or-later
"""The equations of the unsteady two-fluid flow in their strong form, in numpy.

Written from the stated balances, as a second opinion on the scheme of cells and faces. Derivatives
are central differences of sixth order; x = (x, y, z) arrays, vectors are stacked in front.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from strong import STEP, WEIGHTS, derivative

from fem_tfm.models.finite_volume import UnsteadyProblem
from fem_tfm.models.finite_volume.state import Sources
from fem_tfm.models.pointwise import SLIP_FLOOR, VOID_FRACTION

Field = Callable[[np.ndarray], np.ndarray]
FieldInTime = Callable[[np.ndarray, float], np.ndarray]


def rate(f: FieldInTime, x: np.ndarray, t: float) -> np.ndarray:
    """df/dt."""
    parts = (w * (f(x, t + k * STEP) - f(x, t - k * STEP)) for k, w in WEIGHTS.items())
    return sum(parts) / STEP


@dataclass(frozen=True)
class Exact:
    """A flow as functions of place and time; velocities of shape (3, n).

    axes : directions in which it varies
    """

    alpha: FieldInTime
    theta: FieldInTime
    p: FieldInTime
    u_s: FieldInTime
    u_g: FieldInTime
    axes: tuple[int, ...] = (0, 1, 2)


class Strong:
    """Sources with which a given flow solves the equations of a problem without gravity.

    d(a_k)/dt + div(a_k u_k) = volume source
    a_k rho_k (du_k/dt + u_k.grad u_k)
        = -a_k grad p - grad p_s + div tau_k +- beta (u_g - u_s) + force
    3/2 a_s rho_s (dTheta/dt + u_s.grad Theta)
        = (tau_kin - p_kin I):grad u_s + div(kappa grad Theta) - gamma - 3 beta Theta + energy
    """

    def __init__(self, problem: UnsteadyProblem, exact: Exact) -> None:
        self.gas, self.solids = problem.gas, problem.solids
        self.laws, self.exact = problem.closures, exact
        self.floor = SLIP_FLOOR * problem.gas_velocity
        self.width = problem.diameter

    def gradient(self, f: Field, x: np.ndarray) -> np.ndarray:
        """Derivatives of f along x, y, z, stacked behind its components: shape (..., 3, n)."""
        zero = np.zeros_like(f(x))
        parts = [derivative(f, x, j) if j in self.exact.axes else zero for j in range(3)]
        return np.stack(parts, axis=-2)

    def divergence(self, flux: Field, x: np.ndarray) -> np.ndarray:
        """d flux_j/dx_j of a field of shape (..., 3, n)."""
        return sum(derivative(lambda p, j=j: flux(p)[..., j, :], x, j) for j in self.exact.axes)

    def sources(self, x: np.ndarray, t: float) -> Sources:
        """What has to be given at places x (3, n) and the time t."""
        e = self.exact
        slip = e.u_g(x, t) - e.u_s(x, t)
        drag = self.drag(x, t) * slip
        return Sources(
            solids=self.volume(e.alpha, e.u_s, x, t),
            gas=self.volume(lambda x, t: 1 - e.alpha(x, t), e.u_g, x, t),
            force_s=(self.force_on_solids(x, t) - drag).T,
            force_g=(self.force_on_gas(x, t) + drag).T,
            energy=self.energy(x, t),
        )

    def volume(self, share: FieldInTime, u: FieldInTime, x: np.ndarray, t: float) -> np.ndarray:
        """Volume of a phase [1/s]."""
        return rate(share, x, t) + self.divergence(lambda p: share(p, t) * u(p, t), x)

    def carried(self, f: FieldInTime, u: FieldInTime, x: np.ndarray, t: float) -> np.ndarray:
        """df/dt + u.grad f."""
        slope = self.gradient(lambda p: f(p, t), x)
        return rate(f, x, t) + np.einsum("jn,...jn->...n", u(x, t), slope)

    def drag(self, x: np.ndarray, t: float) -> np.ndarray:
        """beta [kg/m3/s]."""
        e = self.exact
        slip = e.u_g(x, t) - e.u_s(x, t)
        speed = np.sqrt((slip**2).sum(axis=0) + self.floor**2)
        return self.laws.drag.beta(e.alpha(x, t), speed, self.gas, self.solids)

    def kinetic(self, x: np.ndarray, t: float) -> Any:
        """Coefficients of kinetic theory, those of transport faded out in a void."""
        alpha, theta = self.exact.alpha(x, t), self.exact.theta(x, t)
        g0 = self.laws.radial.g0(alpha, self.solids)
        found = self.laws.granular.coefficients(alpha, theta, g0, self.solids, self.width)
        fade = alpha**2 / (alpha**2 + VOID_FRACTION**2)
        return found._replace(
            shear_viscosity=fade * found.shear_viscosity, conductivity=fade * found.conductivity
        )

    def strain(self, u: FieldInTime, x: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        """dev sym grad u (3, 3, n) and div u."""
        slope = self.gradient(lambda p: u(p, t), x)
        trace = np.einsum("iin->n", slope)
        sym = (slope + np.swapaxes(slope, 0, 1)) / 2
        return sym - trace / 3 * np.eye(3)[:, :, None], trace

    def friction(self, x: np.ndarray, t: float) -> Any:
        """Frictional pressure and viscosity."""
        e = self.exact
        s, trace = self.strain(e.u_s, x, t)
        shear = np.einsum("ijn,ijn->n", s, s)
        return self.laws.friction.stress(e.alpha(x, t), e.theta(x, t), shear, trace, self.solids)

    def solids_stress(self, x: np.ndarray, t: float) -> np.ndarray:
        """tau_s - p_s I (3, 3, n)."""
        s, trace = self.strain(self.exact.u_s, x, t)
        kinetic, friction = self.kinetic(x, t), self.friction(x, t)
        mu = kinetic.shear_viscosity + friction.viscosity
        normal = kinetic.bulk_viscosity * trace - kinetic.pressure - friction.pressure
        return 2 * mu * s + normal * np.eye(3)[:, :, None]

    def gas_stress(self, x: np.ndarray, t: float) -> np.ndarray:
        """tau_g (3, 3, n)."""
        s, _ = self.strain(self.exact.u_g, x, t)
        return 2 * (1 - self.exact.alpha(x, t)) * self.gas.viscosity * s

    def force_on_solids(self, x: np.ndarray, t: float) -> np.ndarray:
        """Force without drag (3, n)."""
        e = self.exact
        alpha, push = e.alpha(x, t), self.gradient(lambda p: e.p(p, t), x)
        inertia = alpha * self.solids.density * self.carried(e.u_s, e.u_s, x, t)
        return inertia + alpha * push - self.divergence(lambda p: self.solids_stress(p, t), x)

    def force_on_gas(self, x: np.ndarray, t: float) -> np.ndarray:
        """Force without drag (3, n)."""
        e = self.exact
        void, push = 1 - e.alpha(x, t), self.gradient(lambda p: e.p(p, t), x)
        inertia = void * self.gas.density * self.carried(e.u_g, e.u_g, x, t)
        return inertia + void * push - self.divergence(lambda p: self.gas_stress(p, t), x)

    def energy(self, x: np.ndarray, t: float) -> np.ndarray:
        """Granular energy [W/m3]."""
        e, k = self.exact, self.kinetic(x, t)
        s, trace = self.strain(e.u_s, x, t)
        viscosity = k.shear_viscosity
        if self.laws.friction_feeds_theta:
            viscosity = viscosity + self.friction(x, t).viscosity
        work = 2 * viscosity * np.einsum("ijn,ijn->n", s, s)
        work += k.bulk_viscosity * trace**2 - k.pressure * trace

        def conduction(p: np.ndarray) -> np.ndarray:
            return self.kinetic(p, t).conductivity * self.gradient(lambda q: e.theta(q, t), p)

        inertia = 1.5 * e.alpha(x, t) * self.solids.density * self.carried(e.theta, e.u_s, x, t)
        lost = k.dissipation + 3 * self.drag(x, t) * e.theta(x, t)
        return inertia - work - self.divergence(conduction, x) + lost

# SPDX-License-Identifier: LGPL-3.0-or-later
"""The equations of the two-fluid model in their strong form, in numpy and without UFL.

Written from the stated balances, as a second opinion on the weak forms. Derivatives are central
differences of sixth order; x = (x, y) arrays, vectors are lists of three, d/dz = 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from fem_tfm.closures.walls.solids import WallState
from fem_tfm.materials import Gas, Solids
from fem_tfm.models.two_fluid.forms import Stabilisation
from fem_tfm.models.two_fluid.model import TwoFluid

STEP = 1e-2
WEIGHTS = {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}

Field = Callable[[np.ndarray], np.ndarray]


def derivative(f: Field, x: np.ndarray, j: int) -> np.ndarray:
    """df/dx_j of a field of any shape."""
    shift = np.zeros_like(x)
    shift[j] = STEP
    parts = (w * (f(x + k * shift) - f(x - k * shift)) for k, w in WEIGHTS.items())
    return sum(parts) / STEP


def gradient(f: Field, x: np.ndarray) -> np.ndarray:
    """Derivatives along x, y, z, stacked behind the components of f: shape (..., 3, n)."""
    across = [derivative(f, x, j) for j in range(2)]
    return np.stack([*across, np.zeros_like(across[0])], axis=-2)


def bounded(square: np.ndarray, least: float) -> np.ndarray:
    """Root of the square of a rate."""
    return np.sqrt(square + least**2)


def over_speed(source: np.ndarray, c: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """A gain over the root of Theta, a loss over Theta/c."""
    return np.where(source > 0, source / np.sqrt(theta), source * c / theta)


def divergence(flux: Field, x: np.ndarray) -> np.ndarray:
    """d flux_j/dx_j of a field of shape (..., 3, n)."""
    return sum(derivative(lambda p, j=j: flux(p)[..., j, :], x, j) for j in range(2))


@dataclass(frozen=True)
class Exact:
    """A state as numpy functions of x."""

    u_g: Field
    p: Field
    u_s: Field
    q: Field
    c: Field


@dataclass(frozen=True)
class Strong:
    """The equations, with plain numbers in place of constants."""

    gas: Gas
    solids: Solids
    closures: TwoFluid
    numerics: Stabilisation
    gravity: np.ndarray
    distance: Field
    offset: float
    radius: float
    wall_cell: float
    cell_area: float
    drive: float
    source: float
    idt: float

    # -- pointwise -----------------------------------------------------------------------------

    def alpha(self, s: Exact, x: np.ndarray) -> np.ndarray:
        """Solids fraction."""
        return self.solids.packing_limit / (1 + np.exp(-s.q(x)))

    def theta(self, s: Exact, x: np.ndarray) -> np.ndarray:
        """Granular temperature."""
        return self.numerics.theta_floor + s.c(x) ** 2

    def strain(self, u: Field, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Deviator of the strain rate and the dilation."""
        rate = gradient(u, x)
        dilation = rate[0, 0] + rate[1, 1]
        sym = (rate + rate.transpose(1, 0, 2)) / 2
        return sym - np.eye(3)[:, :, None] * dilation / 3, dilation

    def beta(self, s: Exact, x: np.ndarray) -> np.ndarray:
        """Drag coefficient of the balances."""
        slip = s.u_g(x) - s.u_s(x)
        speed = np.sqrt((slip**2).sum(0) + self.numerics.slip_floor**2)
        alpha = self.alpha(s, x)
        residual = np.sqrt(1 + (self.numerics.residual_fraction / alpha) ** 2)
        return residual * self.closures.drag.beta(alpha, speed, self.gas, self.solids)

    def coefficients(self, s: Exact, x: np.ndarray) -> tuple[Any, Any, Any]:
        """Kinetic coefficients, friction and g0."""
        alpha, theta = self.alpha(s, x), self.theta(s, x)
        strain, dilation = self.strain(s.u_s, x)
        g0 = self.closures.radial.g0(alpha, self.solids)
        kinetic = self.closures.granular.coefficients(
            alpha, theta, g0, self.solids, 2 * self.radius
        )
        fade = alpha**2 / (alpha**2 + self.numerics.void_fraction**2)
        kinetic = kinetic._replace(
            shear_viscosity=fade * kinetic.shear_viscosity,
            conductivity=fade * kinetic.conductivity,
        )
        shear = (strain**2).sum((0, 1))
        friction = self.closures.friction.stress(alpha, theta, shear, dilation, self.solids)
        return kinetic, friction, g0

    def solids_stress(self, s: Exact, x: np.ndarray) -> np.ndarray:
        """Kinetic and frictional stress, and that of the mesh."""
        strain, dilation = self.strain(s.u_s, x)
        k, f, _ = self.coefficients(s, x)
        bulk = k.bulk_viscosity * dilation - k.pressure - f.pressure
        viscosity = k.shear_viscosity + f.viscosity + self.solids_grid(s, x)
        return np.eye(3)[:, :, None] * bulk + 2 * viscosity * strain

    def solids_grid(self, s: Exact, x: np.ndarray) -> np.ndarray:
        """Viscosity of the mesh in the solids."""
        return self.solids.density * self.alpha(s, x) * self.grid(s.u_s, x)

    def grid(self, u: Field, x: np.ndarray) -> np.ndarray:
        """Kinematic viscosity of the mesh."""
        across = (gradient(u, x)[:2, :2] ** 2).sum((0, 1))
        return self.numerics.damping * self.cell_area * bounded(across, self.numerics.smallest_rate)

    def gas_viscosity(self, s: Exact, x: np.ndarray) -> np.ndarray:
        """Molecular and turbulent viscosity, and that of the mesh."""
        strain, _ = self.strain(s.u_g, x)
        shear = np.sqrt(2 * (strain**2).sum((0, 1)) + self.numerics.shear_floor**2)
        height, slope = self.closures.gas_wall.stretched(self.distance(x), self.offset)
        turbulent = self.closures.turbulence.eddy_viscosity(
            shear / slope, height, self.gas, self.radius
        )
        own = (self.gas.viscosity + turbulent) / slope
        return own + self.gas.density * self.grid(s.u_g, x)

    def gas_stress(self, s: Exact, x: np.ndarray) -> np.ndarray:
        """Viscous stress of the gas phase."""
        strain, _ = self.strain(s.u_g, x)
        return 2 * (1 - self.alpha(s, x)) * self.gas_viscosity(s, x) * strain

    # -- fluxes, which the divergence acts on ---------------------------------------------------

    def numerical(self, s: Exact, x: np.ndarray) -> np.ndarray:
        """Diffusion of logit(alpha_s), with the share of the mesh."""
        rate = divergence(lambda p: self.alpha(s, p) * s.u_s(p), x)
        speed = bounded(rate**2, self.numerics.smallest_front_rate)
        capture = self.numerics.capture * self.cell_area * speed
        return -(self.numerics.alpha_diffusion + capture) * gradient(s.q, x)

    def solids_volume(self, s: Exact, x: np.ndarray) -> np.ndarray:
        """Volume flux of the solids."""
        return self.alpha(s, x) * s.u_s(x) + self.numerical(s, x)

    def gas_volume(self, s: Exact, x: np.ndarray) -> np.ndarray:
        """Volume flux of the gas, which gives way to the diffusion."""
        return (1 - self.alpha(s, x)) * s.u_g(x) - self.numerical(s, x)

    def fluxes(self, s: Exact) -> dict[str, Field]:
        """What each balance transports; the last axis but one is the direction."""
        rho_s, rho_g = self.solids.density, self.gas.density

        def solids(x: np.ndarray) -> np.ndarray:
            carried = s.u_s(x)[:, None] * self.solids_volume(s, x)[None]
            return rho_s * carried - self.solids_stress(s, x)

        def gas(x: np.ndarray) -> np.ndarray:
            carried = s.u_g(x)[:, None] * self.gas_volume(s, x)[None]
            return rho_g * carried - self.gas_stress(s, x)

        def energy(x: np.ndarray) -> np.ndarray:
            return -2 * self.coefficients(s, x)[0].conductivity * gradient(s.c, x)

        return {
            "u_g": gas,
            "p": lambda x: self.solids_volume(s, x) + self.gas_volume(s, x),
            "u_s": solids,
            "q": lambda x: self.solids_volume(s, x),
            "c": energy,
        }

    # -- balances ------------------------------------------------------------------------------

    def rest(self, s: Exact, old: Exact, x: np.ndarray) -> dict[str, np.ndarray]:
        """Everything but the divergence of the fluxes, on the left-hand side."""
        a, a0 = self.alpha(s, x), self.alpha(old, x)
        rho_s, rho_g, up = self.solids.density, self.gas.density, np.array([0.0, 0.0, 1.0])
        exchange = self.beta(s, x) * (s.u_g(x) - s.u_s(x))
        push = gradient(s.p, x) - self.drive * up[:, None]
        k, f, _ = self.coefficients(s, x)
        strain, dilation = self.strain(s.u_s, x)
        speed, slope = np.sqrt(self.theta(s, x)), gradient(s.c, x)
        work = 2 * k.shear_viscosity * (strain**2).sum((0, 1)) + k.bulk_viscosity * dilation**2
        if self.closures.friction_feeds_theta:
            work += 2 * f.viscosity * (strain**2).sum((0, 1))
        loss = (k.dissipation / speed**2 + 3 * self.beta(s, x)) * s.c(x)
        gain = (work + 2 * k.conductivity * (slope**2).sum(0)) / speed
        gain += over_speed(-k.pressure * dilation, s.c(x), speed**2)
        carried = self.idt * a * (s.c(x) - old.c(x)) + (self.solids_volume(s, x) * slope).sum(0)
        return {
            "u_g": rho_g * self.idt * ((1 - a) * s.u_g(x) - (1 - a0) * old.u_g(x))
            + (1 - a) * push
            + exchange,
            "p": -self.numerics.pressure_shift * s.p(x),
            "u_s": rho_s * self.idt * (a * s.u_s(x) - a0 * old.u_s(x))
            + a * push
            - a * (rho_s - rho_g) * self.gravity[:, None]
            - exchange,
            "q": self.idt * (a - a0) - self.source * a,
            "c": 3 * rho_s * carried - gain + loss,
        }

    def wall(self, s: Exact, x: np.ndarray, n: np.ndarray) -> dict[str, np.ndarray]:
        """What the weak forms put at a wall of outward normal n, beside the fluxes they drop."""
        a, theta = self.alpha(s, x), self.theta(s, x)
        k, f, g0 = self.coefficients(s, x)
        normal = n[:, None] * np.ones_like(a)
        ties = {}
        slip_s = s.u_s(x) - (s.u_s(x) * normal).sum(0) * normal
        slip_g = s.u_g(x) - (s.u_g(x) * normal).sum(0) * normal
        speed_s, speed_g = (
            np.sqrt((u**2).sum(0) + self.numerics.slip_floor**2) for u in (slip_s, slip_g)
        )
        state = WallState(a, theta, g0, f.pressure, speed_s)
        drag_s = self.closures.solids_wall.friction(state, self.solids) * slip_s
        law, height = self.closures.gas_wall, self.closures.gas_wall.height
        at = height(self.offset, 2 * self.radius)
        drag_g = (1 - a) * law.friction(speed_g, at, self.gas) * slip_g
        stiff_s = k.shear_viscosity + f.viscosity + k.bulk_viscosity + self.solids_grid(s, x)
        stiff_g = (1 - a) * self.gas_viscosity(s, x)
        cases = {
            "u_s": (s.u_s, drag_s, self.solids_stress(s, x), stiff_s, self.solids.density * a),
            "u_g": (s.u_g, drag_g, self.gas_stress(s, x), stiff_g, self.gas.density * (1 - a)),
        }
        for name, (u, drag, stress, viscosity, density) in cases.items():
            traction = np.einsum("ijn,jn->in", stress, normal)
            held = (traction * normal).sum(0)
            stiff = viscosity / self.wall_cell + density * self.numerics.wall_speed
            through = (u(x) * normal).sum(0)
            ties[name] = drag + normal * (self.numerics.wall_penalty * stiff * through - held)
        heat = self.closures.solids_wall.heat(state, self.solids)
        ties["c"] = -over_speed(heat, s.c(x), theta)
        return ties

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Starting states of a duct's gas: log layers on every wall, or an inlet."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fem_tfm.correlations import friction_velocity
from fem_tfm.models.reynolds_stress.forms import COMPONENTS
from fem_tfm.models.reynolds_stress.section import ReynoldsStressSection

# turbulent energy on the axis over u_tau^2; that at the wall is the log layer's
AXIS_ENERGY = 1.2
# distance over which profiles are differenced, in half hydraulic diameters
DIFFERENCE = 1e-4


class _LogLayers:
    """Log law, mixing length and anisotropy of the log layer, by the distance to the wall."""

    def __init__(self, section: ReynoldsStressSection) -> None:
        setup, self.geometry = section.setup, section.mesh.section
        self.radius = self.geometry.hydraulic_diameter / 2
        self.nu = setup.numbers.viscosity
        self.layer = setup.law.log_layer()
        self.u_tau = friction_velocity(setup.gas_velocity, 2 * self.radius, self.nu)
        self.function = setup.function
        self.scale = 1.0

    def distance(self, x: np.ndarray) -> np.ndarray:
        """Distance to the wall [m]."""
        return self.geometry.wall_distance(x)

    def velocity(self, x: np.ndarray) -> np.ndarray:
        """Axial velocity [m/s]."""
        y_plus = np.maximum(self.distance(x) * self.u_tau / self.nu, 1.0)
        log = np.log(self.function.E * y_plus) / self.function.kappa
        return self.scale * self.u_tau * log

    def energy(self, x: np.ndarray) -> np.ndarray:
        """k [m2/s2]."""
        s = np.minimum(self.distance(x) / self.radius, 1.0)
        wall = 1 / np.sqrt(self.layer.C_mu)
        return self.u_tau**2 * (wall + (AXIS_ENERGY - wall) * s)

    def eps(self, x: np.ndarray) -> np.ndarray:
        """Dissipation by Nikuradse's mixing length [m2/s3]."""
        eta2 = (1 - np.minimum(self.distance(x) / self.radius, 1.0)) ** 2
        length = self.radius * (0.14 - 0.08 * eta2 - 0.06 * eta2**2)
        return self.layer.C_mu**0.75 * self.energy(x) ** 1.5 / length

    def slope(self, f: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
        """Gradient across, shape (2, n)."""
        h = DIFFERENCE * self.radius
        steps = h * np.eye(len(x))[:2]
        return np.array([(f(x + s[:, None]) - f(x - s[:, None])) / (2 * h) for s in steps])

    def stress(self, x: np.ndarray) -> np.ndarray:
        """R_xx, R_yy, R_zz, R_xy, R_xz, R_yz: normal stresses of the log layer, eddy viscosity."""
        normal = self.slope(self.distance, x)
        normal = normal / np.maximum(np.linalg.norm(normal, axis=0), 1e-3)
        ratio, k = self.layer.stress, self.energy(x)
        off, across, along = ratio[1, 1], ratio[2, 2], ratio[0, 0]
        viscosity = self.layer.C_mu * k**2 / self.eps(x)
        shear = -viscosity * self.slope(self.velocity, x)
        zero = np.zeros_like(k)
        plane = across * np.eye(2)[:, :, None] + (off - across) * normal[:, None] * normal[None]
        full = [[k * plane[0, 0], k * plane[0, 1], shear[0]]]
        full += [[k * plane[1, 0], k * plane[1, 1], shear[1]], [zero, zero, k * along]]
        return np.array([full[min(i, j)][max(i, j)] for i, j in COMPONENTS])


def cold(section: ReynoldsStressSection) -> None:
    """Log layers on every wall, scaled to the flux, and rest across the section."""
    guess, values = _LogLayers(section), section.now.x.array
    target = section.newton.borders[0].target
    values[:] = 0.0
    section.drive.value = 2 * guess.u_tau**2 / guess.radius
    _put(section, "e", lambda x: np.log(guess.eps(x)))
    if section.setup.law.transported:
        _put(section, "r", guess.stress)
        _put(section, "d", lambda x: np.vstack([guess.slope(guess.velocity, x), 0 * x[:2]]))
    else:
        _put(section, "q", lambda x: np.log(guess.energy(x)))
    axial = lambda x: np.vstack([0 * x[:2], guess.velocity(x)])  # noqa: E731
    _put(section, "u", axial)
    excess = section.newton.constraint_errors()[0] + float(target.value)
    guess.scale = float(target.value) / excess
    _put(section, "u", axial)
    _put(section, "m", guess.velocity)
    section.fulfil()


def enter(section: ReynoldsStressSection, intensity: float, length: float) -> None:
    """Uniform velocity with isotropic turbulence of an intensity [-] and length scale [m].

    k = 3/2 (intensity U)^2 and eps = 0.09^(3/4) k^(3/2)/length, as for the dense flow's inlet.
    """
    speed, values = section.setup.gas_velocity, section.now.x.array
    k = 1.5 * (intensity * speed) ** 2
    eps = 0.09**0.75 * k**1.5 / length
    values[:] = 0.0
    section.drive.value = 0.0
    _put(section, "e", lambda x: np.full(x.shape[1], np.log(eps)))
    if section.setup.law.transported:
        isotropic = 2 / 3 * k * np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
        _put(section, "r", lambda x: np.repeat(isotropic[:, None], x.shape[1], axis=1))
    else:
        _put(section, "q", lambda x: np.full(x.shape[1], np.log(k)))
    _put(section, "u", lambda x: np.vstack([0 * x[:2], speed + 0 * x[:1]]))
    # the strip at the wall carries less than its share
    geometry = section.mesh.section
    wanted = speed * geometry.area / geometry.area_factor
    share = wanted / section.flux()
    _put(section, "u", lambda x: np.vstack([0 * x[:2], share * speed + 0 * x[:1]]))
    _put(section, "m", lambda x: np.full(x.shape[1], share * speed))


def _put(section: ReynoldsStressSection, name: str, f: Callable[[np.ndarray], np.ndarray]) -> None:
    """Interpolate values f(x) into one unknown."""
    function = section.unknown(name)
    function.interpolate(f)
    section.set_unknown(name, function)

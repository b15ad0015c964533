# SPDX-License-Identifier: LGPL-3.0-or-later
"""Walls and outlets of the unsteady flow are of second order."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from boxes import box, flow

from fem_tfm.models.finite_volume import Inflow, UnsteadyFlow
from fem_tfm.models.finite_volume.state import Sources

HEIGHT, LENGTH = 0.02, 1.0
# grains that a wall of specularity 0.1 heats, so that they are few there
GRAINS: dict[str, Any] = {
    "gas": {"density": 2.0, "viscosity": 0.002},
    "solids": {"density": 1000.0, "diameter": 2e-3, "restitution": 0.98},
    "closures.drag": "wen-yu",
    "walls.solids": {"model": "johnson-jackson", "specularity": 0.1, "restitution": 0.9},
}


def sheared(layers: int) -> np.ndarray:
    """Mean velocity, flux and Theta of grains that are pushed along between two plates.

    The flow is developed: one cell so long that its ends do not count.
    """
    found = flow(box((HEIGHT, HEIGHT, 100.0), (1, layers, 1), "sswwss"), GRAINS)
    found.initialise(0.3, theta=0.05)
    push = Sources(force_s=np.array([0.0, 0.0, 2000.0]))
    for _ in range(200):
        found.advance(0.07, Inflow(1.0, sources=push))
    now, u = found.now, found.now.u_s[:, 2]
    return np.array([u.mean(), (now.alpha * u).mean(), now.theta.mean()])


def test_sliding_grains_between_plates_are_of_second_order() -> None:
    """Half of the velocity is slip. With the fraction of the centre there the order is 0.5."""
    coarse, medium, fine = (sheared(n) for n in (8, 16, 32))
    assert np.log2(np.abs((medium - coarse) / (fine - medium))).min() > 1.9
    assert coarse == pytest.approx(fine, rel=0.015)


def growing(layers: int) -> tuple[UnsteadyFlow, np.ndarray]:
    """A gas that comes out of the whole duct and speeds up; errors of its velocity and pressure.

    u = U + s z,  p = rho (u_end^2 - u^2)/2
    """
    speed, source = 1.0, 1.0
    gas = {"gas": {"density": 1.2, "viscosity": 1e-5}}
    found = flow(box((1.0, 1.0, LENGTH), (1, 1, layers)), gas, alone=True, order=1)
    found.set_velocities(np.zeros(3), np.array([0.0, 0.0, speed]))
    for _ in range(4 * layers):
        found.advance(1.0 / layers, Inflow(speed, sources=Sources(gas=source)))
    order = np.argsort(found.cells.centre[:, 2])
    z, u, p = found.cells.centre[order, 2], found.now.u_g[order, 2], found.now.p[order]
    wanted, end = speed + source * z, speed + source * LENGTH
    off = u - wanted, p - 1.2 * (end**2 - wanted**2) / 2
    return found, np.array(
        [np.sqrt((off[i] ** 2).mean()) for i in (0, 1)]
        + [abs(off[0][-1]), abs(off[1][-1]), abs(off[1][0])]
    )


@pytest.mark.parametrize("layers", [8, 16])
def test_a_stream_that_speeds_up_leaves_with_second_order(layers: int) -> None:
    """With the values of the last cell at the outlet the pressure is of first order everywhere."""
    coarse, fine = (growing(n)[1] for n in (layers, 2 * layers))
    assert np.log2(coarse / fine).min() > 1.9
    assert max(growing(layers)[0].balances().values()) < 1e-12

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Collisions between particles: kinetic theory of a gas of spheres."""

from __future__ import annotations

import math

import numpy as np
import pytest
from grids import box, gas

from fem_tfm.closures.particles.collisions import Sommerfeld
from fem_tfm.materials import Solids
from fem_tfm.models.particles.cloud import Parcels
from fem_tfm.models.particles.encounters import Encounters
from fem_tfm.models.particles.field import Field
from fem_tfm.models.particles.grid import Grid, Walls
from fem_tfm.models.particles.tracker import Steps, Tracker

BEADS = Solids(density=2500.0, diameter=1e-3)
SIDE, COUNT, NUMBER = 0.1, 20000, 4e6


def vacuum() -> Field:
    """A box of one cell without a gas that is felt."""
    kind, nodes, points = box((1, 1, 1), (SIDE,) * 3, "hexahedron")
    grid = Grid(kind, nodes, points, Walls("planes", (SIDE, SIDE)))
    field = gas(grid)
    field.viscosity = 1e-12
    return field


def cloud(sd: tuple[float, float, float], seed: int = 3) -> Parcels:
    """Beads spread over the box, with normally distributed velocities."""
    draws = np.random.default_rng(seed)
    x = draws.uniform(0.02, 0.98, (COUNT, 3)) * SIDE
    v = draws.normal(size=(COUNT, 3)) * sd
    v -= v.mean(axis=0)
    rate = NUMBER * SIDE**3 / COUNT
    return Parcels.release(x, v, BEADS, rate=rate)


def goes_on(law: Sommerfeld, parcels: Parcels, end: float, slabs: int) -> tuple[int, list[float]]:
    """Collisions of all parcels and the granular temperature after each slab of time.

    Each slab is followed twice, the second time among what the first has left.
    """
    field = vacuum()
    tracker = Tracker([BEADS], steps=Steps(largest=1.0))
    met = Encounters(law, field.grid, parcels, 1)
    count, theta = 0, []
    for number in range(slabs):
        begun, time = parcels.copy(), end * (number + 1) / slabs
        for last in (False, True):
            parcels.assign(begun)
            met.clear()
            report = tracker.advance(parcels, field, until_time=time, encounters=met)
            if not last:
                met.renew(field.grid.sizes * end / slabs)
        count += report.collisions
        theta.append(float(parcels.v.var(axis=0).mean()))
    return count, theta


def test_spheres_collide_as_often_as_in_a_maxwellian_gas() -> None:
    """f = 4 sqrt(pi theta) d^2 n, and an elastic gas keeps its temperature."""
    theta = 0.04
    frequency = 4 * math.sqrt(math.pi * theta) * BEADS.diameter**2 * NUMBER
    end = 1.5 / frequency
    count, found = goes_on(Sommerfeld(e=1.0, mu=0.0), cloud((0.2,) * 3), end, 5)
    assert count / COUNT == pytest.approx(1.5, rel=0.025)
    assert found[-1] == pytest.approx(theta, rel=0.03)


def test_rough_inelastic_spheres_cool_as_haff_says() -> None:
    """d theta/dt = -8 (1 - e^2)/sqrt(pi) alpha theta^(3/2)/d without friction."""
    e, theta = 0.8, 0.04
    alpha = NUMBER * math.pi / 6 * BEADS.diameter**3
    rate = 4 * (1 - e**2) / math.sqrt(math.pi) * alpha * math.sqrt(theta) / BEADS.diameter
    end = 1.0 / rate
    _, found = goes_on(Sommerfeld(e=e, mu=0.0), cloud((0.2,) * 3), end, 25)
    assert found[-1] == pytest.approx(theta / 4, rel=0.05)
    _, rough = goes_on(Sommerfeld(e=e, mu=0.4), cloud((0.2,) * 3), end, 25)
    assert rough[-1] < found[-1] * 0.95


def test_collisions_make_fluctuations_isotropic() -> None:
    """Deviations from the mean decay at about 4/5 of the frequency times (1 + e)/2 (3 - e)/2."""
    parcels = cloud((0.3, 0.15, 0.15))
    frequency = 4 * math.sqrt(math.pi * 0.045) * BEADS.diameter**2 * NUMBER
    before = parcels.v.var(axis=0)
    goes_on(Sommerfeld(e=1.0, mu=0.0), parcels, 1.25 / frequency, 8)
    after = parcels.v.var(axis=0)
    kept = (after[0] - after.mean()) / (before[0] - before.mean())
    # the relaxation of the second moment of a Maxwellian gas: 4/5 of the frequency
    assert kept == pytest.approx(math.exp(-1.25 * 0.8), abs=0.05)
    assert after.mean() == pytest.approx(before.mean(), rel=0.03)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Turbulent dispersion: a mixed cloud stays mixed, Taylor's spreading, Csanady's limit."""

from __future__ import annotations

import numpy as np
import pytest
from grids import duct, gas

from fem_tfm.closures.drag import ConstantDrag
from fem_tfm.closures.particles.dispersion import Eddies, Langevin
from fem_tfm.materials import Solids
from fem_tfm.models.particles.cloud import Parcels
from fem_tfm.models.particles.tracker import Forces, Steps, Tracker

ASH = Solids(density=1800.0, diameter=1.4e-4)
HALF = 0.1
EDGES = 1e-3 * np.array([0, 0.4, 0.8, 1.6, 3.2, 6.4, 12.8, 25.6, 100])


def stress(x: np.ndarray) -> np.ndarray:
    """Stresses that fall to the walls, with shear along them and in the corner."""
    a, b = 1 - np.abs(x[:, 0]) / HALF, 1 - np.abs(x[:, 1]) / HALF
    r = np.zeros((len(x), 3, 3))
    r[:, 0, 0] = 0.2 + 0.8 * np.tanh(8 * a) * (1 + 0.3 * a)
    r[:, 1, 1] = 0.2 + 0.8 * np.tanh(8 * b) + 0.2 * b
    r[:, 2, 2] = 3 - np.tanh(4 * a) * np.tanh(4 * b)
    r[:, 0, 1] = 0.1 * x[:, 0] * x[:, 1] / HALF**2
    r[:, 0, 2], r[:, 1, 2] = 0.6 * x[:, 0] / HALF, 0.6 * x[:, 1] / HALF
    for i, j in ((0, 1), (0, 2), (1, 2)):
        r[:, j, i] = r[:, i, j]
    return r


def velocity(x: np.ndarray) -> np.ndarray:
    """A secondary flow without divergence, along the walls and the planes of symmetry."""
    k = np.pi / HALF
    u = 0.3 * np.sin(k * x[:, 0]) * np.cos(k * x[:, 1])
    v = -0.3 * np.cos(k * x[:, 0]) * np.sin(k * x[:, 1])
    return np.stack([u, v, np.full(len(x), 20.0)], axis=1)


def life(x: np.ndarray) -> np.ndarray:
    y = HALF - np.abs(x[:, :2]).max(axis=1)
    return 1e-3 + 8e-3 * np.tanh(y / 0.03)


def profile(law: object, share: float, n: int, times: int, **grid: object) -> np.ndarray:
    """Concentration over its mean by wall distance, and in the corners."""
    field = gas(duct(**grid), velocity=velocity, stress=stress, time=life, strip=1 / 6)
    x = np.zeros((n, 3))
    x[:, :2] = np.random.default_rng(2).uniform(-HALF, HALF, (n, 2))
    parcels = Parcels.release(x, [0, 0, 20.0], ASH, diameter=0.0)
    tracker = Tracker([ASH], dispersion=law, steps=Steps(eddies=share, largest=1.0))
    found = np.zeros(len(EDGES))
    for k in range(times):
        tracker.advance(parcels, field, until_time=0.3 + 0.04 * k)
        a, b = HALF - np.abs(parcels.x[:, 0]), HALF - np.abs(parcels.x[:, 1])
        found[:-1] += np.histogram(np.minimum(a, b), EDGES)[0]
        found[-1] += np.count_nonzero((a < 0.01) & (b < 0.01))
    inner = (1 - EDGES / HALF) ** 2
    return found / (n * times) / np.append(inner[:-1] - inner[1:], 0.01)


@pytest.mark.parametrize(
    ("law", "share", "grid"),
    [
        (Langevin(), 1.0, {"cells": 16, "folds": 2, "strip": 8e-4}),
        (Eddies(), 0.5, {"cells": 12, "folds": 1, "strip": 0.0, "triangles": True}),
    ],
)
def test_a_mixed_cloud_stays_mixed(law: object, share: float, grid: dict[str, object]) -> None:
    """Without the drift, or with a wrong middle of a step, walls gather a quarter more or less."""
    found = profile(law, share, 8000, 12, **grid)
    assert found == pytest.approx(1.0, abs=0.12)
    assert found[4:-1] == pytest.approx(1.0, abs=0.06)


@pytest.mark.slow
@pytest.mark.parametrize("law", [Langevin(), Eddies()])
@pytest.mark.parametrize(
    ("share", "beside_walls", "in_corners"),
    [(1.0, 0.035, 0.05), (0.5, 0.02, 0.03), (0.25, 0.02, 0.03)],
)
@pytest.mark.parametrize("strip", [0.0, 8e-4])
def test_a_mixed_cloud_stays_mixed_within_little(
    law: object, share: float, beside_walls: float, in_corners: float, strip: float
) -> None:
    """From steps of half an eddy on what is left is the sampling error, about 1 % a bin."""
    found = profile(law, share, 60000, 60, cells=16, folds=2, strip=strip)
    assert found[:-1] == pytest.approx(1.0, abs=beside_walls)
    assert found[-1] == pytest.approx(1.0, abs=in_corners)


def cloud(law: object, n: int, seconds: list[float], forces: Forces | None = None, **more: object):
    """Variances of the displacement of points at times, in homogeneous turbulence."""
    r = np.array([[1.0, 0.3, -0.4], [0.3, 0.6, 0.1], [-0.4, 0.1, 2.0]])
    field = gas(duct(1, half=(1e3, 1e3)), velocity=[0, 0, 1.0], stress=more.get("r", r), time=0.01)
    size = more.get("diameter", 0.0)
    parcels = Parcels.release(np.zeros((n, 3)), more.get("v", [0, 0, 1.0]), ASH, diameter=size)
    steps = Steps(eddies=more.get("share", 0.25), largest=1.0, relaxation=100.0)
    tracker = Tracker([ASH], forces, law, steps=steps)
    found = []
    for t in seconds:
        tracker.advance(parcels, field, until_time=t)
        found.append(np.cov(parcels.x.T))
    return np.array(found), r


@pytest.mark.parametrize("law", [Langevin(), Eddies()])
def test_taylor_spreading(law: object) -> None:
    """<x_i x_j> = 2 R_ij T^2 (t/T - 1 + e^(-t/T)) at all times, anisotropic."""
    n, times = 40000, [0.002, 0.01, 0.03, 0.1, 0.3]
    found, r = cloud(law, n, times, share=0.1)
    for t, covariance in zip(times, found, strict=True):
        h = t / 0.01
        exact = 2 * r * 0.01**2 * (h - 1 + np.exp(-h))
        size = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
        assert np.abs((covariance - exact) / size).max() < 0.02, t


def test_diffusivity_is_exact_for_steps_of_an_eddy() -> None:
    found, r = cloud(Langevin(), 40000, [0.6], share=1.0)
    size = np.sqrt(np.outer(np.diag(r), np.diag(r)))
    exact = 2 * r * 0.01 * 0.59
    assert np.abs((found[0] - exact) / size / (2 * 0.01 * 0.59)).max() < 0.02


@pytest.mark.parametrize("law", [Langevin(crossing=1.0), Eddies(crossing=1.0)])
def test_crossing_trajectories(law: object) -> None:
    """Heavy particles at a slip w far above sigma lose eddies at w/(T sigma), twice that across.

    The gas that they see spreads them by sigma^2 T_i t each way.
    """
    r, slip, n = np.eye(3), 20.0, 8000
    # the drag is linear and slow: the fluctuation of v is small beside the slip
    beads = Solids(density=1800.0, diameter=1e-4)
    from fem_tfm.closures.drag import ConstantDrag

    forces = Forces(
        drag=ConstantDrag(value=1800 * 2.0), gravity=(0.0, 0.0, -2.0 * slip), buoyancy=False
    )
    field = gas(duct(1, half=(1e3, 1e3)), velocity=[0, 0, 0], stress=r, time=0.05)
    parcels = Parcels.release(np.zeros((n, 3)), [0, 0, -slip], beads)
    tracker = Tracker([beads], forces, law, steps=Steps(eddies=0.02, largest=1.0))
    tracker.advance(parcels, field, until_time=1.5)
    # stationary fluctuation of v by a force of correlation time T_i: sigma^2 B T_i/(1 + B T_i)
    along, across = 0.05 / np.sqrt(1 + slip**2), 0.05 / np.sqrt(1 + 4 * slip**2)
    exact = [2 * t / (1 + 2 * t) * (1 - np.exp(-2 * 2 * 1.5)) for t in (across, across, along)]
    assert parcels.v.var(axis=0) == pytest.approx(exact, rel=0.09)


def test_no_dispersion_without_turbulence() -> None:
    field = gas(duct(), velocity=[0, 0, 20.0])
    parcels = Parcels.release(np.zeros((10, 3)), [0, 0, 20.0], ASH)
    Tracker([ASH], dispersion="langevin").advance(parcels, field, until_z=1.0)
    assert np.abs(parcels.x[:, :2]).max() == 0


def rouse_exponent(rouse: float, parcels: int, law: object) -> float:
    """Exponent that heavy particles settle into in a flow with a parabolic eddy diffusivity.

    Their relaxation time is a tenth of the shortest T_L: Rouse's particles have no inertia.
    """
    height, kappa, friction = 2 * HALF, 0.41, 1.0
    sigma, tau = 1.2 * friction, 1e-4
    settling = rouse * kappa * friction

    def life_of(x: np.ndarray) -> np.ndarray:
        y = np.clip(x[:, 1] / height + 0.5, 0.02, 0.98)
        return kappa * friction * height * y * (1 - y) / sigma**2

    field = gas(duct(cells=32), velocity=[0, 0, 20.0], stress=np.eye(3) * sigma**2, time=life_of)
    dust = Solids(1000.0, 5e-5)
    x = np.zeros((parcels, 3))
    x[:, :2] = np.random.default_rng(1).uniform(-0.099, 0.099, (parcels, 2))
    cloud = Parcels.release(x, [0, 0, 20.0], dust)
    weight = (0.0, -settling / tau, 0.0)
    forces = Forces(drag=ConstantDrag(value=1000.0 / tau), gravity=weight, buoyancy=False)
    tracker = Tracker([dust], forces, law, steps=Steps(largest=1.0))
    edges, count = np.linspace(0.05, 0.95, 10), np.zeros(9)
    for k in range(30):
        tracker.advance(cloud, field, until_time=4.0 + 0.2 * k)
        count += np.histogram(cloud.x[:, 1] / height + 0.5, edges)[0]
    middle = (edges[1:] + edges[:-1]) / 2
    slope = np.log(1 / middle - 1)
    return float(np.polyfit(slope, np.log(count), 1, w=np.sqrt(count))[0])


@pytest.mark.slow
@pytest.mark.parametrize("rouse", [0.25, 0.5, 1.0])
def test_heavy_particles_settle_into_rouse_profiles(rouse: float) -> None:
    """C ~ ((h - y)/y)^(w_s/(kappa u*)) with nu_t = kappa u* y (1 - y/h)."""
    assert rouse_exponent(rouse, 3000, Langevin()) == pytest.approx(rouse, rel=0.06, abs=0.02)


def test_a_rouse_profile_of_one_half() -> None:
    assert rouse_exponent(0.5, 600, Langevin()) == pytest.approx(0.5, abs=0.08)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""A gas whose density follows the pressure: closed forms, its mass, and what it tends to."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from boxes import box, case, flow
from mpi4py import MPI
from scipy.optimize import brentq

from fem_tfm.models.unsteady import Feed, Flow3D
from fem_tfm.models.unsteady.state import Sources

R, T = 296.8, 293.0
SOUND = math.sqrt(R * T)


def nitrogen(pressure: float, **changes: Any) -> dict[str, Any]:
    """An ideal gas that has the density of `pressure` [Pa]."""
    gas = {"gas_constant": R, "pressure": pressure, "temperature": T, "viscosity": 1.8e-5}
    return {
        "solution": "unsteady",
        "numerics.end_time": 1.0,
        "gas": {"compressible": True, **gas, **changes},
    }


def column(found: Flow3D, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places and values of a line of one cell's width, along it."""
    comm, own = MPI.COMM_WORLD, slice(0, found.cells.owned)
    z, values = (
        np.concatenate(comm.allgather(x[own])) for x in (found.cells.centre[:, 2], values)
    )
    order = np.argsort(z)
    return z[order], values[order]


@pytest.fixture(params=[0, 1], ids=["order0", "order1"])
def order(request: pytest.FixtureRequest) -> int:
    return request.param


@pytest.mark.parametrize("way", ["inlet", "inside"])
def test_gas_fed_to_a_closed_volume_raises_its_pressure(way: str, order: int) -> None:
    """dp/dt = m R T/V, that of all the gas to round-off."""
    pressure, speed, length = 1e5, 0.5, 0.2
    mesh = box((0.02, 0.02, length), (2, 2, 10), "ssss" + ("is" if way == "inlet" else "ss"))
    found = flow(mesh, nitrogen(pressure), alone=True, order=order)
    feed = Feed(speed) if way == "inlet" else Feed(0.0, inside=Sources(gas=speed / length))
    rise, steps, dt = pressure * speed / length, 20, 1e-2
    for _ in range(steps):
        found.advance(dt, feed)
    p = found.cells.total(found.now.p[: found.cells.owned] * found.line.volume)
    p /= found.cells.total(found.line.volume)
    assert p == pytest.approx(rise * steps * dt, rel=1e-10)
    assert np.abs(found.now.p - p).max() < 1e-4 * p
    assert found.balances()["gas_mass"] < 1e-12


def frequency(cells: int) -> float:
    """Of the standing wave in a closed tube, over c/(2L), by the zeros of its amplitude."""
    pressure, length = 1e5, 1.0
    found = flow(
        box((0.1, 0.1, length), (1, 1, cells), "ssssss"), nitrogen(pressure), alone=True, order=1
    )
    shape = np.cos(math.pi * found.cells.centre[:, 2] / length)
    found.start(p=10.0 * shape)
    dt = length / cells / SOUND / 2
    weight = shape[: found.cells.owned] * found.line.volume
    times, swings = [0.0], [1.0]
    while times[-1] < 3.4 * length / SOUND:
        found.advance(dt, Feed(0.0))
        times.append(found.time)
        swings.append(found.cells.total(weight * found.now.p[: found.cells.owned]))
    assert found.balances()["gas_mass"] < 1e-12
    swings, times = np.array(swings), np.array(times)
    turn = np.flatnonzero(swings[:-1] * swings[1:] < 0)
    zeros = times[turn] + dt * swings[turn] / (swings[turn] - swings[turn + 1])
    # half a period lies between two of them
    return 1 / (2 * np.diff(zeros).mean()) / (SOUND / (2 * length))


def test_a_closed_tube_sounds_at_its_frequency() -> None:
    coarse, fine = (abs(frequency(n) - 1) for n in (20, 40))
    assert fine < 0.01
    assert fine < 0.4 * coarse


@pytest.mark.parametrize("ratio", [1.0, 0.5])
def test_gas_expands_along_a_fixed_bed(ratio: float, order: int) -> None:
    """Ergun's law and Boyle's: p_in^2 - p_out^2 = 2 R T L m (A + B m), m = rho u.

    ratio : pressure at which the velocity is given over that at the outlet
    """
    outlet, speed, length, n, alpha = 1e5, 1.5 / ratio, 1.0, 40, 0.6
    fed = {"operation.solids_velocity": 1.0, "operation.outlet_pressure": outlet}
    mesh = box((0.02, 0.02, length), (1, 1, n))
    found = flow(mesh, nitrogen(outlet * ratio) | fed, order=order)
    # grains that nothing moves
    found.laws.solids = replace(found.solids, density=1e12)
    found.start(alpha)
    for _ in range(40):
        found.advance(2e-2, Feed(speed))
    z, p = column(found, found.now.p)
    flux = found.gas.density * speed
    diameter, mu = found.solids.diameter, found.gas.viscosity
    linear = 150 * mu * alpha**2 / ((1 - alpha) ** 3 * diameter**2)
    square = 1.75 * alpha / ((1 - alpha) ** 3 * diameter)
    fall = 2 * R * T * flux * (linear + square * flux)
    exact = np.sqrt(outlet**2 + fall * (length - z)) - outlet
    assert exact[0] > 0.3 * outlet
    assert p == pytest.approx(exact, rel=5e-3)
    area = mesh.geometry.area_factor * 0.02**2
    assert found.quantities()["gas_mass_flow"] == pytest.approx(flux * area, rel=1e-3)

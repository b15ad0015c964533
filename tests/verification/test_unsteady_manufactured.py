# SPDX-License-Identifier: LGPL-3.0-or-later
"""The unsteady flow converges to a manufactured solution that feels every term."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from boxes import box, flow
from unsteady_strong import Exact, Strong

from fem_tfm.models.finite_volume import Inflow, UnsteadyFlow

# a box of 1 m, flows of 1 m/s, and numbers for which every term counts
SCENE: dict[str, Any] = {
    "gas": {"density": 2.0, "viscosity": 0.01},
    "solids": {
        "density": 20.0,
        "diameter": 0.02,
        "restitution": 0.9,
        "friction_limit": 0.3,
    },
    "closures.drag": "wen-yu",
    "closures.radial": "carnahan-starling",
    "closures.friction": {"model": "dartevelle", "coefficient": 20.0, "width": 0.05},
    "operation.gas_superficial_velocity": 1.0,
}
END = 0.25
FIELDS = ("alpha", "theta", "u_s", "u_g", "p")


def exact(axes: tuple[int, ...]) -> Exact:
    """A flow that varies along y and z, or along all three axes.

    Fields are even about every side and velocities through it odd, which is what symmetry asks for;
    velocities and their stresses vanish there.
    """
    deep = 0 in axes

    def waves(x: np.ndarray, t: float) -> tuple[Any, ...]:
        """Cosines and sines along the axes, and a swing in time."""
        a, y, z = (np.pi * (x[0] + 0.5) if deep else np.pi / 2), np.pi * (x[1] + 0.5), np.pi * x[2]
        along = (np.cos(a) if deep else 0.0, np.sin(a), np.cos(y), np.sin(y), np.cos(z), np.sin(z))
        return *along, np.cos(2 * t + 0.3), np.sin(2 * t)

    def alpha(x: np.ndarray, t: float) -> np.ndarray:
        cx, _, cy, _, cz, _, c, s = waves(x, t)
        return 0.3 + 0.1 * c * cy * cz + 0.05 * s * cz + 0.03 * cx * cz

    def theta(x: np.ndarray, t: float) -> np.ndarray:
        cx, _, cy, _, cz, _, c, s = waves(x, t)
        return 0.1 * (1 + 0.3 * c * cz - 0.3 * s * cy * cz + 0.2 * cx * cy)

    def p(x: np.ndarray, t: float) -> np.ndarray:
        cx, _, cy, _, cz, _, c, _ = waves(x, t)
        return 5.0 * c * cy + 3.0 * cy * cz + 2.0 * cx

    def u_s(x: np.ndarray, t: float) -> np.ndarray:
        _, sx, _, sy, cz, sz, c, s = waves(x, t)
        across = deep * 0.5 * c * sx**3 * sy**2 * sz**2
        up, along = c * sy**3 * sz**2 * cz, 0.8 * (1 + 0.5 * s) * sz**3 * sy**2
        return np.stack([across, sx**2 * up, sx**2 * along])

    def u_g(x: np.ndarray, t: float) -> np.ndarray:
        _, sx, cy, sy, _, sz, c, s = waves(x, t)
        across = deep * 0.7 * (1 - s) * sx**3 * sy**2 * sz**2
        up, along = (1 - 0.5 * s) * sy**3 * sz**2, 1.3 * c * sz**3 * sy**2 * cy
        return np.stack([across, sx**2 * up, sx**2 * along])

    return Exact(alpha, theta, p, u_s, u_g, axes)


FLAT, DEEP = exact((1, 2)), exact((0, 1, 2))


def run(wanted: Exact, number: int, steps: int, order: int = 1) -> UnsteadyFlow:
    """From the exact state at time 0 to `END` in a closed box, with the sources that it takes."""
    across = number if 0 in wanted.axes else 1
    lengths = (1.0, 1.0, 1.0) if across > 1 else (1 / number, 1.0, 1.0)
    found = flow(box(lengths, (across, number, number), "ssssss"), SCENE, order=order)
    strong, x = Strong(found.problem, wanted), found.cells.centre.T
    found.initialise(wanted.alpha(x, 0.0))
    found.now = replace(found.now, theta=wanted.theta(x, 0.0), p=wanted.p(x, 0.0))
    found.set_velocities(wanted.u_s(x, 0.0).T, wanted.u_g(x, 0.0).T)
    own, dt = x[:, : found.cells.owned], END / steps
    for k in range(steps):
        found.advance(dt, Inflow(1.0, sources=strong.sources(own, (k + 1) * dt)))
    assert max(found.balances().values()) < 1e-12
    return found


def size(found: UnsteadyFlow, values: np.ndarray) -> float:
    """L2 norm over the box."""
    volume = found.line.volume
    weight = volume if values.ndim == 1 else volume[:, None]
    return found.cells.total(weight * values**2) ** 0.5


def fields(found: UnsteadyFlow) -> dict[str, np.ndarray]:
    """Fields over the owned cells; the pressure is known but for a constant."""
    cells = found.cells
    values = {name: getattr(found.now, name)[: cells.owned] for name in FIELDS}
    mean = cells.total(values["p"] * found.line.volume) / cells.total(found.line.volume)
    return values | {"p": values["p"] - mean}


def errors(found: UnsteadyFlow, wanted: Exact) -> dict[str, float]:
    """L2 errors over the size of each field."""
    x = found.cells.centre.T[:, : found.cells.owned]
    result = {}
    for name, values in fields(found).items():
        there = getattr(wanted, name)(x, END).T
        result[name] = size(found, values - there) / size(found, there)
    return result


def orders(coarse: dict[str, float], fine: dict[str, float]) -> dict[str, float]:
    """Observed orders when cells or steps are halved."""
    return {name: float(np.log2(coarse[name] / fine[name])) for name in FIELDS}


def test_space_and_time_together_are_of_second_order() -> None:
    """Cells and steps are halved, at a Courant number of a half."""
    coarse, fine = (errors(run(FLAT, n, n // 2), FLAT) for n in (16, 32))
    assert min(orders(coarse, fine).values()) > 1.8


def test_upwind_and_euler_are_of_first_order() -> None:
    coarse, fine = (errors(run(FLAT, n, n // 2, order=0), FLAT) for n in (16, 32))
    found = orders(coarse, fine).values()
    assert 0.9 < min(found) and max(found) < 1.5


@pytest.mark.slow
def test_space_is_of_second_order() -> None:
    """Cells are halved with steps so small that they do not count."""
    coarse, fine = (errors(run(FLAT, n, 64), FLAT) for n in (16, 32))
    assert min(orders(coarse, fine).values()) > 1.8


@pytest.mark.slow
def test_time_is_of_second_order() -> None:
    """Steps are halved on one mesh: the differences between runs fall as their squares."""
    found = [run(FLAT, 32, steps) for steps in (8, 16, 32, 64)]
    values = [fields(one) for one in found]
    changes = [
        {name: size(found[0], a[name] - b[name]) for name in FIELDS} for a, b in pairwise(values)
    ]
    assert min(orders(*changes[-2:]).values()) > 1.8


@pytest.mark.slow
def test_three_dimensions_are_of_second_order() -> None:
    """The pressure gets there last: its error is that of the steps on these meshes."""
    coarse, fine = (errors(run(DEEP, n, n // 2), DEEP) for n in (12, 24))
    found = orders(coarse, fine)
    assert found.pop("p") > 1.5
    assert min(found.values()) > 1.8

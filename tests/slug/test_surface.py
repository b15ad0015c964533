# SPDX-License-Identifier: LGPL-3.0-or-later
"""Walls of triangles: planes, tubes and bends against the walls they stand for."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from fem_tfm.closures.contacts import CundallStrack, ViscousCoulomb
from fem_tfm.geometry.arc import Arc
from fem_tfm.geometry.section import RectangularSection, RoundSection
from fem_tfm.models.slug.grains import Grain, Grains, Walls

DIAMETER, STEP, RADIUS = 1.4e-3, 1e-5, 3.5e-3


def sheet(points: np.ndarray) -> np.ndarray:
    """Triangles of a grid of points (n, m, 3)."""
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[:-1, 1:], points[1:, 1:]
    halves = [np.stack(three, axis=2) for three in ((a, b, c), (d, c, b))]
    return np.concatenate([half.reshape(-1, 3, 3) for half in halves])


def plane(size: float, height: float, number: int = 10) -> np.ndarray:
    line = np.linspace(-size, size, number)
    x, z = np.meshgrid(line, line, indexing="ij")
    return sheet(np.stack([x, np.full_like(x, height), z], axis=-1))


def tube(length: float, sides: int, slices: int, arc: Arc | None = None) -> np.ndarray:
    angle, z = np.linspace(0, 2 * math.pi, sides + 1), np.linspace(0, length, slices + 1)
    a, s = np.meshgrid(angle, z, indexing="ij")
    # as far outside as the circle is on average
    radius = RADIUS / math.cos(math.pi / sides) ** 0.5
    points = np.stack([radius * np.cos(a), radius * np.sin(a), s], axis=-1)
    return sheet(points if arc is None else arc.bent(points.reshape(-1, 3)).reshape(points.shape))


def grains(law: Any, walls: Walls, gravity: tuple[float, float, float]) -> Grains:
    return Grains(Grain(937.0, DIAMETER, contact=law), walls, STEP, gravity)


@pytest.mark.parametrize("law", [ViscousCoulomb(), CundallStrack()], ids=["viscous", "springs"])
def test_a_grain_rolls_over_the_edges_of_a_plane(law: Any) -> None:
    slope = math.radians(20.0)
    gravity = (0.0, -9.81 * math.cos(slope), 9.81 * math.sin(slope))
    found = []
    for walls in (
        Walls(RectangularSection(1.0, 0.1, "none")),
        Walls(surface=plane(0.3, -0.05, 40)),
    ):
        made = grains(law, walls, gravity)
        made.add([[1e-4, -0.05 + DIAMETER / 2, 0.0]])
        made.run(15000)
        found.append((made.place[0], made.velocity[0], made.spin[0]))
    # it has passed ten edges or more
    assert found[0][0][2] > 0.025
    for exact, pieces in zip(*found, strict=True):
        assert pieces == pytest.approx(exact, rel=1e-6, abs=1e-6)


def test_a_corner_pushes_a_grain_straight_away() -> None:
    made = grains(
        ViscousCoulomb(restitution=1.0), Walls(surface=plane(DIAMETER, 0.0, 2)), (0, 0, 0)
    )
    corner = np.array([DIAMETER, 0.0, DIAMETER])
    way = np.array([1.0, 2.0, 1.5]) / math.sqrt(1 + 4 + 2.25)
    made.add([corner + 0.505 * DIAMETER * way], -0.1 * way)
    made.run(400)
    assert made.velocity[0] == pytest.approx(0.1 * way, rel=5e-3)


def test_a_tube_of_triangles_is_a_tube() -> None:
    law = CundallStrack(tangential_damping=0.8)
    heights = []
    for walls in (Walls(RoundSection(2 * RADIUS, "none")), Walls(surface=tube(0.04, 60, 30))):
        made = grains(law, walls, (0.0, -9.81, 0.0))
        z = 1.05 * DIAMETER * np.arange(20) + 5e-3
        made.add(np.stack([0 * z + 1e-4, 0 * z, z], axis=-1))
        made.run(12000)
        made.record()
        weight = 9.81 * made.mass
        assert np.abs(made.wall_force[:, 1].mean() / weight.mean() - 1) < 0.15
        heights.append(made.place[:, 1].mean())
    assert heights[0] == pytest.approx(-RADIUS + DIAMETER / 2, abs=0.1 * DIAMETER)
    assert heights[0] == pytest.approx(heights[1], abs=0.03 * DIAMETER)


def test_a_grain_slides_through_a_smooth_bend() -> None:
    """Without friction and gravity it leaves the bend as fast as it came, along the new axis."""
    arc = Arc(0.02, math.pi / 2, 0.01, "up")
    length = 0.01 + 0.02 * math.pi / 2 + 0.02
    walls = Walls(surface=tube(length, 120, 400, arc))
    law = ViscousCoulomb(friction=0.0, restitution=0.05)
    made = grains(law, walls, (0.0, 0.0, 0.0))
    made.add([[0.0, -RADIUS + DIAMETER / 2, 2e-3]], (0.0, 0.0, 0.3))
    made.run(20000)
    straight = arc.straightened(made.place)[0]
    assert 0.01 + 0.02 * math.pi / 2 < straight[2] < length
    speed = np.linalg.norm(made.velocity[0])
    assert speed == pytest.approx(0.3, rel=0.05)
    assert abs(made.velocity[0] @ arc.axis(made.place)[0]) == pytest.approx(speed, rel=0.02)


def test_threads_and_restarts_keep_the_bits() -> None:
    states = []
    for threads in (1, 2):
        walls = Walls(surface=tube(0.06, 24, 30))
        grain = Grain(937.0, DIAMETER, contact=CundallStrack())
        made = Grains(grain, walls, STEP, (0.0, -9.81, 1.0), threads=threads)
        line = 1.02 * DIAMETER * np.arange(-1, 2)
        z = 1.02 * DIAMETER * np.arange(1, 38)
        made.add(np.stack(np.meshgrid(line, line, z), axis=-1).reshape(-1, 3))
        made.run(80)
        middle = made.state()
        made.run(80)
        again = Grains(grain, walls, STEP, (0.0, -9.81, 1.0))
        again.restore(middle)
        again.run(80)
        states += [made.state(), again.state()]
    for one in states[1:]:
        assert all(np.array_equal(states[0][k], one[k]) for k in one)

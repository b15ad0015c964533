# SPDX-License-Identifier: LGPL-3.0-or-later
"""Arcs: points move there and back, the axis has its length and direction."""

from __future__ import annotations

import math

import numpy as np
import pytest
from measures import (
    RADIUS,
)

from fem_tfm.geometry.arc import Arc

TURNS = [("up", 30.0), ("up", 90.0), ("down", 90.0), ("side", 120.0), ("down", 180.0)]


def bend(towards: str, degrees: float) -> Arc:
    return Arc(4 * RADIUS, math.radians(degrees), RADIUS, towards)


@pytest.mark.parametrize(("towards", "degrees"), TURNS)
def test_a_bend_moves_points_there_and_back(towards: str, degrees: float) -> None:
    arc = bend(towards, degrees)
    x = np.random.default_rng(1).uniform(-RADIUS, RADIUS, (200, 3))
    x[:, 2] = np.linspace(0, arc.end + 3 * RADIUS, len(x))
    there = arc.bent(x)
    np.testing.assert_allclose(arc.straightened(there), x, atol=1e-15)
    before = x[:, 2] <= arc.before
    np.testing.assert_allclose(there[before], x[before], atol=1e-17)
    # distances along the normal of the axis's plane, and to the axis, are kept
    binormal = np.cross(arc.normal, [0, 0, 1])
    np.testing.assert_allclose(there @ binormal, x @ binormal, atol=1e-17)
    axis = arc.bent(x * [0, 0, 1])
    assert np.linalg.norm(there - axis, axis=1) == pytest.approx(np.hypot(*x[:, :2].T), abs=1e-15)


@pytest.mark.parametrize(("towards", "degrees"), TURNS)
def test_the_axis_of_a_bend_has_its_length_and_direction(towards: str, degrees: float) -> None:
    arc, step = bend(towards, degrees), 1e-7
    s = np.linspace(0, arc.end + 3 * RADIUS, 7)
    x = arc.bent(np.column_stack([0 * s, 0 * s, s]))
    ahead = arc.bent(np.column_stack([0 * s, 0 * s, s + step]))
    np.testing.assert_allclose((ahead - x) / step, arc.axis(x), atol=1e-5)
    last = arc.axis(x[-1:])[0]
    assert last @ [0, 0, 1] == pytest.approx(math.cos(math.radians(degrees)))
    assert last @ arc.normal == pytest.approx(math.sin(math.radians(degrees)))


@pytest.mark.parametrize(("towards", "degrees"), TURNS)
def test_vectors_turn_with_the_axis(towards: str, degrees: float) -> None:
    """A vector of the straight line, carried along with the axis, comes back as it was."""
    arc, random = bend(towards, degrees), np.random.default_rng(2)
    x = random.uniform(-RADIUS, RADIUS, (50, 3))
    x[:, 2] = np.linspace(0, arc.end + 3 * RADIUS, len(x))
    v, there = random.normal(size=x.shape), arc.bent(x)
    # across the axis a bend moves points as a rigid body does; along it goes the axis
    across = v * [1, 1, 0]
    carried = arc.bent(x + across) - there + v[:, 2:] * arc.axis(there)
    np.testing.assert_allclose(arc.straightened_vectors(there, carried), v, atol=1e-12)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sections: the distance to the wall, in arrays and in forms; bad input."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from dolfinx import fem
from measures import (
    DUCT,
    PIPE,
    RADIUS,
    section,
)

from fem_tfm.errors import InputError
from fem_tfm.geometry.section import RectangularSection, RoundSection, Section


def test_wall_distance_of_a_pipe() -> None:
    x = np.array([[0, 0.001, -0.003, RADIUS, 1.01 * RADIUS], [0, 0.002, 0.004 - 1e-6, 0, 0]])
    exact = RADIUS - np.hypot(*x)
    found = PIPE.wall_distance(x)
    np.testing.assert_allclose(found[1:3], exact[1:3], atol=1e-6 * RADIUS)
    assert found[0] == pytest.approx(RADIUS, rel=2e-6)
    assert np.all(found[3:] > 0) and np.all(found[3:] < 1e-8 * RADIUS)


def test_wall_distance_of_a_duct() -> None:
    square = RectangularSection(0.02, 0.02, "none")
    near = 0.01 - np.array([1e-6, 1e-4, 1e-3])
    for x in ([near, 0 * near], [0 * near, -near], [near, 0 * near + 2e-3]):
        np.testing.assert_allclose(square.wall_distance(np.array(x)), 0.01 - near, rtol=1e-3)
    assert square.wall_distance(np.zeros((2, 1))) == pytest.approx(0.01 / 2**0.25, rel=3e-3)
    corner = square.wall_distance(np.full((2, 1), 0.01))
    assert 0 < corner[0] < 1e-8
    line = np.array([[0.004] * 5, [0.006, 0.0062, 0.0064, 0.0066, 0.0068]])
    assert np.all(np.diff(square.wall_distance(line)) < 0)


@pytest.mark.parametrize("geometry", [PIPE, DUCT])
def test_wall_distance_in_forms_is_that_of_arrays(geometry: Section) -> None:
    mesh = section(geometry, 2)
    space = fem.functionspace(mesh.mesh, ("Lagrange", 2))
    found = fem.Function(space)
    found.interpolate(fem.Expression(mesh.wall_distance(), space.element.interpolation_points))
    expected = geometry.wall_distance(space.tabulate_dof_coordinates().T)
    np.testing.assert_allclose(found.x.array, expected, rtol=1e-10, atol=1e-12)
    assert found.x.array.min() > 0


def test_lengths_are_no_literals_in_forms() -> None:
    distances = [section(RoundSection(d), 1).wall_distance() for d in (0.01, 0.02)]
    literals = [{float(v) for v in _literals(d)} for d in distances]
    assert literals[0] == literals[1]


def _literals(expression: Any) -> list[Any]:
    """Numbers written into a UFL expression."""
    from ufl.constantvalue import ScalarValue
    from ufl.corealg.traversal import unique_pre_traversal

    return [node for node in unique_pre_traversal(expression) if isinstance(node, ScalarValue)]


@pytest.mark.parametrize("part", [PIPE, DUCT, RoundSection(0.01, "quarter", 1e-3)])
def test_the_hydraulic_diameter_is_four_areas_over_the_perimeter(part: Section) -> None:
    assert part.hydraulic_diameter == pytest.approx(4 * part.area / part.perimeter)
    assert part.radius == pytest.approx(part.hydraulic_diameter / 2)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: RoundSection(0.01, "haf"), "did you mean 'half'"),
        (lambda: RoundSection(0.01, "auto"), "geometry.symmetry = 'auto'"),
        (lambda: RectangularSection(0.01, 0.01, "half", 0.005), "wall_offset = 0.005"),
        (lambda: RectangularSection(0.01, 0.01, "half", -1e-3), "wall_offset = -0.001"),
        (lambda: RoundSection(0.01, "half", float("nan")), "wall_offset = nan"),
    ],
)
def test_bad_input_is_refused(make: Any, text: str) -> None:
    with pytest.raises(InputError) as caught:
        make()
    assert text in str(caught.value)

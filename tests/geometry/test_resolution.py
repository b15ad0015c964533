# SPDX-License-Identifier: LGPL-3.0-or-later
"""Resolution: core cell sizes of levels, the nested iteration, grading at walls, bad input."""

from __future__ import annotations

from typing import Any

import pytest

from fem_tfm.errors import InputError
from fem_tfm.geometry.resolution import Resolution
from fem_tfm.geometry.section import RectangularSection, RoundSection

PIPE = RoundSection(0.01)


def test_levels_divide_the_core_size_by_the_root_of_two() -> None:
    sizes = [Resolution(level=level).core_size(PIPE) for level in (1, 2, 3)]
    assert sizes == pytest.approx([0.01 / 8, 0.01 / 8 / 2**0.5, 0.01 / 16])
    assert Resolution(level=1).core_size(RectangularSection(0.2, 0.1)) == pytest.approx(0.023)


def test_a_mesh_size_replaces_the_level() -> None:
    assert Resolution(level=5, mesh_size=1e-3).core_size(PIPE) == 1e-3


def test_nested_sizes_halve_from_the_coarsest_to_the_one_asked_for() -> None:
    finest = Resolution(level=5).core_size(PIPE)
    sizes = Resolution(level=5).nested_sizes(PIPE, 0.125)
    assert sizes == pytest.approx([4 * finest, 2 * finest, finest])
    assert [r.mesh_size for r in Resolution(level=5).nested(PIPE, 0.125)] == sizes


def test_a_mesh_above_the_coarsest_is_alone() -> None:
    assert Resolution(mesh_size=2e-3).nested_sizes(PIPE, 0.125) == [2e-3]


def test_the_coarsest_mesh_may_miss_its_size_by_round_off() -> None:
    assert len(Resolution(mesh_size=0.01 / 24).nested_sizes(PIPE, 1 / 3 - 1e-9)) == 4


def test_wall_cells_and_cell_shape_have_defaults_of_the_mesh() -> None:
    assert (Resolution().wall_ratio, Resolution().cell_shape) == (0.25, "triangle")
    given = Resolution(wall_grading=0.1, cells="quadrilateral")
    assert (given.wall_ratio, given.cell_shape) == (0.1, "quadrilateral")


def test_a_wall_cell_is_as_thin_as_it_must_be() -> None:
    core = Resolution().core_size(PIPE)
    assert Resolution().with_wall_cell(PIPE, 0.1 * core).wall_ratio == pytest.approx(0.1)
    assert Resolution().with_wall_cell(PIPE, core).wall_ratio == 0.25
    assert Resolution().with_wall_cell(PIPE, 1e-9 * core).wall_ratio == 1e-3
    assert Resolution(wall_grading=0.5).with_wall_cell(PIPE, 0.1 * core).wall_ratio == 0.5


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: Resolution(level=0), "numerics.level = 0"),
        (lambda: Resolution(level=13), "at least 1 and at most 12"),
        (lambda: Resolution(level=2.5), "numerics.level = 2.5"),  # type: ignore[arg-type]
        (lambda: Resolution(level=True), "numerics.level = true"),
        (lambda: Resolution(mesh_size=0.0), "numerics.mesh_size = 0.0"),
        (lambda: Resolution(mesh_size=101), "at most 100 [m] (mesh size in place of the level)"),
        (lambda: Resolution(mesh_size=1e-9).core_size(PIPE), "from 5e-06 to 0.005 m"),
        (lambda: Resolution(mesh_size=1.0).core_size(PIPE), "numerics.mesh_size = 1.0"),
        (lambda: Resolution(wall_grading=1.5), "numerics.wall_grading = 1.5"),
        (lambda: Resolution(wall_grading=1e-4), "at least 0.001 and at most 1"),
        (lambda: Resolution(cells="triangles"), "did you mean 'triangle'"),  # type: ignore
        (lambda: Resolution(axial_cells=0), "numerics.axial_cells = 0"),
        (lambda: Resolution(axial_cells=10**6 + 1), "at most 1e+06"),
    ],
)
def test_bad_input_is_refused(make: Any, text: str) -> None:
    with pytest.raises(InputError) as caught:
        make()
    assert text in str(caught.value)

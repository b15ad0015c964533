# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shapes: sizes against formulas, the part of the section that is solved, rules of their keys."""

from __future__ import annotations

import math
from typing import Any

import pytest

from fem_tfm.errors import InputError
from fem_tfm.geometry.section import RectangularSection, RoundSection
from fem_tfm.geometry.shapes import Bend, Duct, Pipe, Shape

PIPE, DUCT, BEND = {"diameter": 0.01}, {"shape": "duct", "width": 0.2}, {"shape": "bend"}
BEND |= {"diameter": 0.01, "bend_radius": 0.05, "length": 0.2}


def bend(**given: Any) -> Bend:
    return Bend(0.01, length=0.2, bend_radius=0.05, **given)


def test_a_pipe_has_the_sizes_of_its_circle() -> None:
    pipe = Pipe(0.010, length=2.4)
    assert (pipe.shape, pipe.length, pipe.size) == ("pipe", 2.4, (0.01, 0.01))
    assert pipe.area == pytest.approx(math.pi * 25e-6)
    assert pipe.perimeter == pytest.approx(math.pi * 0.01)
    assert pipe.hydraulic_diameter == 0.01
    assert pipe.arc is None


def test_a_duct_has_the_sizes_of_its_rectangle() -> None:
    duct = Duct(0.2, 0.1, length=16)
    assert (duct.shape, duct.length, duct.size) == ("duct", 16.0, (0.2, 0.1))
    assert duct.area == pytest.approx(0.02)
    assert duct.perimeter == pytest.approx(0.6)
    assert duct.hydraulic_diameter == pytest.approx(4 * 0.02 / 0.6)


def test_a_duct_without_a_height_is_square() -> None:
    assert Duct(0.2).size == (0.2, 0.2)
    assert Duct(0.2).hydraulic_diameter == pytest.approx(0.2)


def test_the_legs_of_a_bend_and_its_arc_make_up_its_length() -> None:
    arc = 0.05 * math.pi / 2
    straight = (0.2 - arc) / 2
    assert bend().legs == pytest.approx((straight, arc, straight))
    assert bend(bend_start=0.0).legs == pytest.approx((0.0, arc, 0.2 - arc))
    assert bend().hydraulic_diameter == 0.01
    assert bend().arc.end == pytest.approx(straight + arc)
    assert (bend().arc.radius, bend().arc.angle) == pytest.approx((0.05, math.pi / 2))


def test_a_bend_has_a_radius_of_three_diameters_by_default() -> None:
    assert Bend(0.01, length=0.2).axis_radius == pytest.approx(0.03)


@pytest.mark.parametrize(
    ("angle", "expected"), [(0.0, (0, -9.81, 0)), (90.0, (0, 0, -9.81)), (-90.0, (0, 0, 9.81))]
)
def test_gravity_leans_with_the_line(angle: float, expected: tuple[float, ...]) -> None:
    found = Pipe(0.01, inclination_deg=angle).gravity_vector(9.81)
    assert found == pytest.approx(expected, abs=1e-14)


# -- the part that is solved -------------------------------------------------------------------


@pytest.mark.parametrize("part", ["none", "half", "quarter"])
def test_symmetry_auto_takes_the_part_asked_for(part: str) -> None:
    assert Pipe(0.01).section(part) == RoundSection(0.01, part)
    assert Duct(0.03, 0.01).section(part, 1e-3) == RectangularSection(0.03, 0.01, part, 1e-3)


def test_a_symmetry_that_is_given_is_kept() -> None:
    assert Pipe(0.01, symmetry="none").section("half") == RoundSection(0.01, "none")
    assert Duct(0.03, symmetry="half").section("quarter").symmetry == "half"


@pytest.mark.parametrize(
    ("towards", "part", "solved"),
    [
        ("up", "half", "half"),
        ("down", "none", "none"),
        ("down", "quarter", "half"),
        ("side", "half", "none"),
        ("side", "quarter", "none"),
    ],
)
def test_a_bend_keeps_at_most_its_plane_of_symmetry(towards: Any, part: str, solved: str) -> None:
    assert bend(bend_towards=towards).section(part) == RoundSection(0.01, solved)


def test_a_section_does_not_depend_on_length_and_inclination() -> None:
    assert Pipe(0.01).section() == Pipe(0.01, length=3.0, inclination_deg=5.0).section()


# -- rules -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (
            lambda: Pipe(0),
            "geometry.diameter = 0 is refused: expected a number above 0 and at most",
        ),
        (lambda: Pipe(-0.01), "geometry.diameter = -0.01"),
        (lambda: Pipe(float("nan")), "geometry.diameter = nan"),
        (lambda: Pipe("1"), "geometry.diameter = '1'"),  # type: ignore[arg-type]
        (lambda: Pipe(101), "at most 100 [m] (inner diameter of a pipe or bend)"),
        (lambda: Pipe(0.01, length=0.0), "geometry.length = 0.0"),
        (lambda: Pipe(0.01, length=2e5), "at most 100000 [m]"),
        (lambda: Pipe(0.01, inclination_deg=90.1), "at most 90 [deg]"),
        (lambda: Pipe(0.01, inclination_deg=-91), "at least -90"),
        (lambda: Pipe(0.01, symmetry="haf"), "did you mean 'half'"),
        (lambda: Duct(0), "geometry.width = 0"),
        (lambda: Duct(0.01, -1), "geometry.height = -1"),
        (lambda: Duct(0.01, 101), "geometry.height = 101"),
        (lambda: bend(bend_angle_deg=0.0), "geometry.bend_angle_deg = 0.0"),
        (lambda: bend(bend_angle_deg=181), "at most 180 [deg]"),
        (lambda: bend(bend_start=-1.0), "geometry.bend_start = -1.0"),
        (lambda: bend(bend_towards="left"), "one of up, down, side"),
        (lambda: Bend(0.01, bend_radius=0), "geometry.bend_radius = 0"),
        (
            lambda: Bend(0.01, bend_radius=0.004),
            "a radius above half of geometry.diameter, 0.005 m",
        ),
        (
            lambda: bend(bend_start=0.15),
            "the bend of 0.15 m and its arc of 0.0785398 m, whose radius is 0.05 m",
        ),
        (lambda: Bend(0.1, length=0.4), "geometry.length = 0.4"),
        (lambda: bend(bend_towards="side", symmetry="half"), "'none' or 'auto' where the bend"),
        (lambda: bend(bend_towards="side", symmetry="quarter"), "'none' or 'auto' where the bend"),
        (lambda: bend(symmetry="quarter"), "'half', 'none' or 'auto' where the line bends"),
        (lambda: Pipe(0.01).section("third"), "geometry.symmetry = 'third'"),
        (lambda: Pipe(0.01).section("half", 0.005), "from 0 to below 0.005 m"),
    ],
)
def test_bad_input_is_refused(make: Any, text: str) -> None:
    with pytest.raises(InputError) as caught:
        make()
    assert text in str(caught.value)


# -- tables ------------------------------------------------------------------------------------


def test_a_table_makes_the_shape_that_it_names() -> None:
    assert Shape.from_table(PIPE) == Pipe(0.01)
    assert Shape.from_table(DUCT | {"height": None}) == Duct(0.2)
    assert Shape.from_table(BEND) == bend()


@pytest.mark.parametrize("shape", [Pipe(0.01, symmetry="none"), Duct(0.2, 0.1, length=2), bend()])
def test_a_shape_is_made_again_from_its_table(shape: Shape) -> None:
    assert Shape.from_table(shape.to_table()) == shape


@pytest.mark.parametrize(
    ("table", "text"),
    [
        (PIPE | {"shape": "pip"}, "did you mean 'pipe'?"),
        (PIPE | {"shape": "cone"}, "one of pipe, duct, bend"),
        (PIPE | {"shape": ["pipe"]}, "one of pipe, duct, bend"),
        (PIPE | {"shape": "duct"}, "geometry.width in its place for shape 'duct'"),
        (PIPE | {"width": 0.01}, "geometry.diameter in its place for shape 'pipe'"),
        (BEND | {"height": 0.01}, "geometry.diameter in its place for shape 'bend'"),
        ({}, "geometry.diameter is not given: expected a number above 0 and at most 100 [m]"),
        ({"diameter": None}, "for shape 'pipe'"),
        ({"shape": "duct", "height": 0.01}, "geometry.width is not given"),
        (PIPE | {"bend_radius": 0.1}, "geometry.shape = 'bend' beside it"),
        (PIPE | {"bend_start": 0.0}, "geometry.shape = 'bend' beside it"),
        (DUCT | {"bend_angle_deg": 45.0}, "geometry.shape = 'bend' beside it"),
        (PIPE | {"bend_towards": "up"}, "geometry.shape = 'bend' beside it"),
        (DUCT | {"bend_towards": "down"}, "geometry.shape = 'bend' beside it"),
    ],
)
def test_bad_tables_are_refused(table: dict[str, Any], text: str) -> None:
    with pytest.raises(InputError) as caught:
        Shape.from_table(table)
    assert text in str(caught.value)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""A tube that bends: its analytic wall, the gas on its mesh, grains through it, impacts on it."""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np
import pytest
from tables import check_tables

from fem_tfm.closures.contacts import CundallStrack, ViscousCoulomb
from fem_tfm.errors import InputError
from fem_tfm.geometry.arc import Arc
from fem_tfm.geometry.section import RectangularSection, RoundSection
from fem_tfm.geometry.shapes import Bend
from fem_tfm.geometry.surface import WallSurface
from fem_tfm.models.slug.feed import filled
from fem_tfm.models.slug.gas import TubeGas
from fem_tfm.models.slug.grains import Grain, Grains, Walls
from fem_tfm.models.slug.mesh import TubeMesh, tube_mesh
from fem_tfm.models.slug.pressure import GasPressure
from fem_tfm.models.slug.told.slices import Sampler, shares
from fem_tfm.models.slug.tube import Conveying, SlugTube

DIAMETER, STEP, RADIUS = 1.4e-3, 1e-5, 3.5e-3
TUBE, GRAIN = RoundSection(2 * RADIUS, "none"), Grain(937.0, DIAMETER)
FLOW = 2.49 / 3600
ARCS = [
    Arc(0.02, math.pi / 2, 0.01, "up"),
    Arc(0.0105, math.pi, 0.01, "side"),
    Arc(0.05, math.radians(20), 0.015, "down"),
    Arc(0.015, math.radians(135), 0.005, "up"),
]
NAMES = [f"{arc.towards}-{math.degrees(arc.angle):.0f}" for arc in ARCS]


def scattered(arc: Arc, count: int = 400) -> np.ndarray:
    """Places (x, y, s) in the straight line of a bent tube, legs included."""
    random = np.random.default_rng(1)
    angle, rho = random.uniform(0, 2 * math.pi, count), RADIUS * np.sqrt(random.random(count))
    s = random.uniform(0.0, arc.end + 0.02, count)
    return np.stack([rho * np.cos(angle), rho * np.sin(angle), s], axis=-1)


def grains(arc: Arc | None, law: Any = None, **more: Any) -> Grains:
    grain = Grain(937.0, DIAMETER, contact=law or ViscousCoulomb())
    given = {"gravity": (0.0, 0.0, 0.0)} | more
    return Grains(grain, Walls(TUBE, arc=arc), STEP, **given)


# -- the wall --------------------------------------------------------------------------------------


@pytest.mark.parametrize("arc", ARCS, ids=NAMES)
def test_the_kernel_straightens_as_the_geometry_does(arc: Arc) -> None:
    made, straight = grains(arc), scattered(arc)
    for x in arc.bent(straight):
        made.add(x)
    assert np.abs(made.straight - straight).max() < 1e-15


@pytest.mark.parametrize("arc", ARCS, ids=NAMES)
def test_the_wall_of_a_bend_is_a_torus_between_cylinders(arc: Arc) -> None:
    """Force k d along the normal, where d is what a grain reaches beyond the tube's radius."""
    straight = scattered(arc)
    straight[:, :2] *= ((RADIUS - 0.49 * DIAMETER) / np.hypot(*straight[:, :2].T))[:, None]
    for x, place in zip(arc.bent(straight), straight, strict=True):
        made = grains(arc, ViscousCoulomb(restitution=1.0))
        made.add(x)
        made.record()
        outwards = arc.bent(np.array([[1.5 * place[0], 1.5 * place[1], place[2]]]))[0] - x
        expected = -100.0 * 0.01 * DIAMETER * outwards / np.linalg.norm(outwards)
        assert made.wall_force[0] == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_a_grain_slides_through_a_smooth_bend_at_its_speed() -> None:
    arc = ARCS[0]
    made = grains(arc, ViscousCoulomb(friction=0.0, restitution=0.05))
    made.add([[0.0, -RADIUS + DIAMETER / 2, 2e-3]], (0.0, 0.0, 0.3))
    made.run(20000)
    assert made.straight[0, 2] > arc.end
    speed = np.linalg.norm(made.velocity[0])
    # on a wall of 120 x 400 pairs of triangles it loses up to a twentieth
    assert speed == pytest.approx(0.3, rel=5e-3)
    assert made.velocity[0] @ arc.axis(made.place)[0] == pytest.approx(speed, rel=0.02)


@pytest.mark.parametrize("arc", [ARCS[0], ARCS[1]], ids=NAMES[:2])
def test_neighbours_in_a_bend_are_those_of_a_search(arc: Arc) -> None:
    from scipy.spatial import cKDTree

    place, radius = filled(TUBE, GRAIN, arc.end + 0.01, arc=arc, begin=DIAMETER / 2)
    made = grains(arc)
    made.add(place, (0.0, 0.0, 0.0), radius)
    made.set_velocity(np.random.default_rng(0).normal(size=place.shape) * 0.2)
    made.run(3000)
    pairs = cKDTree(made.place).query_pairs(DIAMETER, output_type="ndarray")
    before = made.core.contacts
    made.run(1)
    assert made.core.contacts - before == len(pairs) > 10


def test_full_layers_fit_into_a_bend() -> None:
    arc = ARCS[1]
    place, _ = filled(TUBE, GRAIN, arc.end + 0.02, arc=arc)
    made = grains(arc)
    made.add(place)  # raises where grains overlap
    solids = made.mass.sum() / 937.0 / (TUBE.area * (arc.end + 0.02))
    assert 0.3 < solids < 0.55
    assert np.hypot(*made.straight[:, :2].T).max() < RADIUS - DIAMETER / 2 + 1e-9


@pytest.mark.parametrize("law", [ViscousCoulomb(), CundallStrack()], ids=["viscous", "springs"])
def test_threads_and_restarts_keep_the_bits(law: Any) -> None:
    arc, states = ARCS[0], []
    for threads in (1, 2):
        made = grains(arc, law, gravity=(0.0, -9.81, 1.0), threads=threads)
        made.add(filled(TUBE, GRAIN, 0.06, arc=arc)[0])
        made.watched = True
        made.run(80)
        middle = made.state()
        made.run(80)
        again = grains(arc, law, gravity=(0.0, -9.81, 1.0))
        again.restore(middle)
        again.watched = True
        again.run(80)
        assert made.count > 512
        states += [made.state(), again.state()]
    for one in states[1:]:
        assert all(np.array_equal(states[0][k], one[k]) for k in one)


# -- impacts ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", ["round", "rectangular", "surface"])
def test_an_impact_has_the_speed_and_angle_of_the_grain(shape: str) -> None:
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * 0.1
    flat = np.stack([corners[:, 0], np.full(4, -RADIUS), corners[:, 1]], axis=-1)
    walls = {
        "round": Walls(TUBE),
        "rectangular": Walls(RectangularSection(0.1, 2 * RADIUS, "none")),
        "surface": Walls(surface=flat[[[0, 1, 2], [0, 2, 3]]]),
    }[shape]
    made = Grains(GRAIN, walls, STEP, (0.0, 0.0, 0.0))
    made.watched = True
    made.add([[0.0, -1e-3, 0.0]], (0.0, -0.3, 0.4))
    made.run(1500)
    (row,) = made.impacts()
    assert row[0] == pytest.approx(0.0, abs=1e-12)
    assert row[1] == pytest.approx(-RADIUS, abs=1e-12)
    # 1.8 mm of fall at 0.3 m/s, and 0.4 m/s along
    assert row[2] == pytest.approx(0.4 * (RADIUS - 1e-3 - DIAMETER / 2) / 0.3, abs=0.8 * STEP)
    assert row[3:5] == pytest.approx([0.5, 0.3], rel=1e-12)
    assert row[5:8] == pytest.approx([GRAIN.mass, DIAMETER / 2, 0])
    # the rebound ends the contact, and nothing is told twice
    made.run(1000)
    assert len(made.impacts()) == 0


def test_a_bouncing_grain_makes_as_many_impacts_as_it_turns() -> None:
    law = ViscousCoulomb(restitution=1.0, friction=0.0)
    made = Grains(Grain(937.0, DIAMETER, contact=law), Walls(TUBE), STEP, (0.0, 0.0, 0.0))
    made.watched = True
    made.add([[0.0, 0.0, 0.0]], (0.0, 0.2, 0.0))
    turns, speed = 0, made.velocity[0, 1]
    for _ in range(2000):
        made.run(20)
        turns += speed * made.velocity[0, 1] < 0
        speed = made.velocity[0, 1] or speed
    assert len(made.impacts()) == turns > 5


def test_held_grains_and_the_plane_of_the_inlet_make_no_impact() -> None:
    made = Grains(GRAIN, Walls(TUBE, 0.0), STEP, (0.0, 0.0, -9.81), release=DIAMETER / 2)
    made.watched = True
    made.add([[0.0, 0.0, 0.5]], (0.0, 0.0, 0.0))
    made.add([[0.0, -RADIUS + 0.499 * DIAMETER, -0.5 * DIAMETER]], (0.0, 0.0, 0.05), held=True)
    made.run(1000)
    assert len(made.impacts()) == 0


# -- triangles of the wall -------------------------------------------------------------------------


@pytest.mark.parametrize(
    "section", [TUBE, RectangularSection(6e-3, 9e-3, "none")], ids=["round", "rectangular"]
)
@pytest.mark.parametrize("arc", [None, ARCS[0]], ids=["straight", "bent"])
def test_triangles_cover_the_wall_and_points_find_theirs(section: Any, arc: Arc | None) -> None:
    length = 0.07
    surface = WallSurface(section, length, 5e-4, arc)
    assert surface.areas.sum() == pytest.approx(section.perimeter * length, rel=3e-3)
    # middles of the triangles, in the straight line
    middle = surface.points[surface.triangles].mean(axis=1)
    straight = middle if arc is None else arc.straightened(middle)
    assert (surface.triangle_at(straight) == np.arange(len(middle))).all()


def test_impacts_are_on_the_triangle_where_they_happen() -> None:
    arc = ARCS[0]
    surface = WallSurface(TUBE, arc.end + 0.02, 1e-3, arc)
    made = grains(arc)
    made.watched = True
    # straight on to the outer wall of the bend
    made.add([[0.0, 0.0, 2e-3]], (0.0, 0.0, 0.5))
    made.run(6000)
    row = made.impacts()[:1]
    outer = math.acos((0.02 - 0.0) / (0.02 + RADIUS - DIAMETER / 2))
    assert math.asin(row[0, 4] / row[0, 3]) == pytest.approx(outer, abs=2e-3)
    triangle = surface.triangle_at(arc.straightened(row[:, :3]))[0]
    corners = surface.points[surface.triangles[triangle]]
    assert np.linalg.norm(corners - row[0, :3], axis=1).max() < 2e-3


# -- the gas ---------------------------------------------------------------------------------------


@functools.cache
def gas(balance: str, law: str) -> GasPressure:
    arc = ARCS[0]
    tube = TubeMesh(tube_mesh(TUBE, arc.end + 0.02, 2, 12, arc))
    given = {"viscosity": 6.73e-5, "balance": balance, "permeability": law}
    return GasPressure(tube, TubeGas(**given), DIAMETER)


@pytest.mark.parametrize(("balance", "law"), [("linear", "carman-kozeny"), ("full", "ergun")])
def test_matrices_by_values_are_those_that_dolfinx_assembles(balance: str, law: str) -> None:
    check_tables(gas(balance, law))


def test_the_mesh_of_a_bend_has_the_volume_of_the_tube() -> None:
    tube = gas("linear", "carman-kozeny").tube
    # chords cut off sin(a)/a of a layer that turns by a
    arc, layer = ARCS[0], tube.length / 12
    lost = TUBE.area * arc.radius * arc.angle * (layer / arc.radius) ** 2 / 6
    assert tube.volumes.sum() == pytest.approx(TUBE.area * tube.length - lost, rel=1e-3)
    assert tube.length == pytest.approx(ARCS[0].end + 0.02)


@pytest.mark.parametrize("radius", [pytest.param(0.02, marks=pytest.mark.slow), 0.05])
def test_gas_through_an_even_bed_in_a_bend_loses_what_the_axis_says(radius: float) -> None:
    """Darcy between two planes that meet: G = q r ln-mean of the radii, below that of the axis."""
    arc, layers = Arc(radius, math.pi / 2, 0.01, "up"), 60
    length = arc.end + 0.01
    tube = TubeMesh(tube_mesh(TUBE, length, 8, layers, arc))
    field = GasPressure(tube, TubeGas(viscosity=6.73e-5, density=1.2), DIAMETER)
    field.set_grains(0.5 * tube.volumes, np.zeros((tube.size, 3)))
    for _ in range(40):
        field.step(1.0, 0.2)
    k = DIAMETER**2 * 0.5**3 / (180 * 0.5**2)
    gradient = 0.2 * (6.73e-5 / k + 8 * 6.73e-5 / RADIUS**2)
    along = field.along()
    arcs = [np.interp(z, tube.planes, along) for z in (arc.before + 0.01, arc.end - 0.01)]
    # the flow keeps to the inner side: mean of 1/r over the section is 1/R (1 + a^2/(4 R^2) + ...)
    ratio = 2 * radius / RADIUS**2 * (radius - math.sqrt(radius**2 - RADIUS**2))
    expected = gradient * (radius * math.pi / 2 - 0.02) / ratio
    assert arcs[0] - arcs[1] == pytest.approx(expected, rel=4e-3)


# -- the tube --------------------------------------------------------------------------------------


@pytest.mark.parametrize("towards", ["up", "side"])
def test_no_grain_is_lost_in_a_bend(towards: str) -> None:
    shape = Bend(2 * RADIUS, length=0.07, bend_radius=0.02, bend_start=0.01, bend_towards=towards)
    made = SlugTube(shape, TubeGas(6.73e-5), GRAIN, Conveying(3.0, FLOW, 0.08), full=True)
    sampler = Sampler(made)
    for _ in range(4):
        made.run(made.time + 0.05, sampler)
        assert made.start + made.fed == made.grains.count + made.out
    assert made.out > 300
    straight = made.grains.straight
    assert np.hypot(*straight[:, :2].T).max() < RADIUS - 0.47 * DIAMETER
    assert straight[:, 2].max() <= 0.07
    # what the gas loses the grains gain, of the share that they bear
    given = made.gas.nodal_force()
    held = made.gas.solids > 0
    assert made.grains.gas_force.sum(axis=0) == pytest.approx(given[held].sum(axis=0), rel=1e-9)
    s = sampler.samples
    volume = (s.edges[1] - s.edges[0]) * s.area
    inside = s.solids[-1].sum() * volume / s.grain_volume
    assert made.grains.count - 12 <= inside <= made.grains.count + 1
    # momentum along the axis, of the part of each grain that is inside
    full = GRAIN.mass / GRAIN.density
    part = shares(straight[:, 2], made.grains.radius, s.edges)[1].sum(axis=1) / full
    along = (made.grains.velocity * shape.arc.axis(made.grains.place)).sum(axis=1)
    assert s.flux[-1][:, 2].sum() * volume == pytest.approx(full * part @ along, rel=1e-9)


def test_grains_in_a_torus_of_triangles_fare_alike() -> None:
    """A bed falls back in a bend: the analytic wall against triangles of 0.4 mm."""
    arc, found = ARCS[0], []
    surface = WallSurface(TUBE, 0.09, 4e-4, arc)
    points = surface.points[surface.triangles]
    for walls in (Walls(TUBE, arc=arc), Walls(surface=points)):
        made = Grains(GRAIN, walls, STEP, (0.0, -9.81, 0.0))
        place = filled(TUBE, GRAIN, 0.02, arc=arc, begin=0.035)[0]
        made.add(place)
        made.run(4000)
        found.append(arc.straightened(made.place)[:, 2])
    assert found[0].mean() < 0.04
    assert found[0].mean() == pytest.approx(found[1].mean(), abs=0.5 * DIAMETER)
    assert found[0].std() == pytest.approx(found[1].std(), rel=0.1)


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"bend_start": 1e-3}, "geometry.bend_start"),
        ({"bend_radius": 4e-3, "bend_start": 0.01}, "geometry.bend_radius"),
    ],
)
def test_a_bend_that_grains_do_not_pass_is_refused(changes: dict[str, float], key: str) -> None:
    shape = Bend(2 * RADIUS, length=0.1, **changes)
    with pytest.raises(InputError) as caught:
        SlugTube(shape, TubeGas(6.73e-5), GRAIN, Conveying(1.0, FLOW))
    assert caught.value.key == key

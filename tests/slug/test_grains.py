# SPDX-License-Identifier: LGPL-3.0-or-later
"""Many grains: conservation, rest, piles, columns; the same bits whatever the threads."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from fem_tfm.closures.contacts import CundallStrack, HertzMindlin, ViscousCoulomb
from fem_tfm.errors import InputError, SolverError
from fem_tfm.geometry.section import RectangularSection, RoundSection
from fem_tfm.models.slug.feed import filled
from fem_tfm.models.slug.grains import Grain, Grains, Walls

DIAMETER, STEP = 1.4e-3, 1e-5
TUBE = RoundSection(7e-3, "none")
LAWS = [ViscousCoulomb(), CundallStrack(), HertzMindlin()]
NAMES = [law.name for law in LAWS]


def tube(
    law: Any,
    length: float,
    *,
    gravity: tuple[float, float, float] = (0.0, -9.81, 0.0),
    spread: float = 0.0,
    threads: int = 1,
    closed: bool = True,
    section: Any = TUBE,
) -> Grains:
    """A tube full of layers of grains, closed at both ends."""
    grain = Grain(937.0, DIAMETER, contact=law, spread=spread)
    walls = Walls(section, 0.0, length if closed else None)
    made = Grains(grain, walls, STEP, gravity, threads=threads)
    place, radius = filled(section, grain, length)
    made.add(place, (0.0, 0.0, 0.0), radius)
    return made


def same(a: Grains, b: Grains) -> bool:
    one, other = a.state(), b.state()
    keys = ("place", "motion", "number", "pairs", "shear", "spring_0", "spring_2")
    return all(np.array_equal(one[k], other[k]) for k in keys if k in one or k in other)


# -- the same bits ---------------------------------------------------------------------------------


@pytest.mark.parametrize("law", LAWS, ids=NAMES)
@pytest.mark.parametrize("spread", [0.0, 0.2])
def test_threads_do_not_change_a_bit(law: Any, spread: float) -> None:
    made = [tube(law, 0.1, spread=spread, threads=n) for n in (1, 2, 3)]
    for one in made:
        assert one.count > 2 * 256
        one.set_velocity(np.random.default_rng(0).normal(size=(one.count, 3)) * 0.1)
        one.run(150)
    assert made[0].core.rebuilds > 1
    assert same(made[0], made[1]) and same(made[0], made[2])


@pytest.mark.parametrize("law", LAWS, ids=NAMES)
@pytest.mark.parametrize("after", [150, 163])
def test_a_restart_does_not_change_a_bit(law: Any, after: int) -> None:
    made = tube(law, 0.06)
    made.run(after)
    state = made.state()
    made.run(400)
    again = tube(law, 0.06)
    again.restore(state)
    again.run(400)
    assert same(made, again)
    assert made.core.rebuilds == again.core.rebuilds


def test_the_skin_of_the_list_changes_round_off_alone() -> None:
    grain = Grain(937.0, DIAMETER)
    found, rebuilds = [], []
    for skin in (0.1, 0.4):
        made = Grains(grain, Walls(TUBE, 0.0, 0.05), STEP, skin=skin)
        made.add(filled(TUBE, grain, 0.05)[0])
        made.run(800)
        found.append(made.place[np.argsort(made.number)])
        rebuilds.append(made.core.rebuilds)
    assert rebuilds[0] > rebuilds[1]
    assert np.abs(found[0] - found[1]).max() < 1e-9


def test_a_wide_box_lists_the_same_pairs_as_a_search() -> None:
    from scipy.spatial import cKDTree

    section = RectangularSection(0.02, 0.02, "none")
    made = tube(ViscousCoulomb(), 0.04, section=section, spread=0.2)
    made.run(4000)
    made.core.set_motion(STEP, [0.0, 0.0, 0.0], 0.19 * DIAMETER, math.inf)
    x, r, count = made.place, made.radius, made.core.contacts
    pairs = cKDTree(x).query_pairs(2 * r.max(), output_type="ndarray")
    gap = np.linalg.norm(x[pairs[:, 0]] - x[pairs[:, 1]], axis=1) - r[pairs].sum(axis=1)
    made.run(1)
    assert made.count > 2000
    assert made.core.contacts - count == (gap < 0).sum() > 1000


# -- conservation ----------------------------------------------------------------------------------


def elastic_box(steps: int, count: int) -> np.ndarray:
    """Energies of a gas of elastic grains in a box."""
    side = 6 * DIAMETER
    law = ViscousCoulomb(restitution=1.0, friction=0.0, stiffness=1000.0)
    grain = Grain(937.0, DIAMETER, contact=law)
    walls = Walls(RectangularSection(side, side, "none"), 0.0, side)
    made = Grains(grain, walls, 4e-6, (0.0, 0.0, 0.0))
    n = round(count ** (1 / 3))
    line = (np.arange(n) + 0.5) / n * side
    place = np.stack(np.meshgrid(line - side / 2, line - side / 2, line), axis=-1).reshape(-1, 3)
    random = np.random.default_rng(0)
    made.add(place)
    made.set_velocity(random.normal(size=(n**3, 3)) * 0.05)
    energies = []
    for _ in range(200):
        made.run(steps // 200)
        energies.append(made.kinetic_energy())
    return np.array(energies)


def test_an_elastic_box_keeps_its_energy() -> None:
    energy = elastic_box(100000, 27)
    # a part is in the springs at any time
    assert energy[:50].mean() == pytest.approx(energy[-50:].mean(), rel=0.01)


@pytest.mark.slow
def test_an_elastic_box_keeps_its_energy_over_a_million_steps() -> None:
    energy = elastic_box(1000000, 64)
    assert energy[:50].mean() == pytest.approx(energy[-50:].mean(), rel=0.005)


def test_grains_alone_keep_momentum_to_round_off() -> None:
    made = Grains(Grain(937.0, DIAMETER, spread=0.3), Walls(), STEP, (0.0, 0.0, 0.0))
    random = np.random.default_rng(3)
    place = np.stack(np.meshgrid(*3 * [np.arange(6) * 1.32 * DIAMETER]), axis=-1).reshape(-1, 3)
    made.add(place, (0, 0, 0), made.grain.radii(len(place), random))
    made.set_velocity(-30 * (made.place - place.mean(axis=0)), random.normal(size=place.shape) * 50)
    before, size = made.mass @ made.velocity, made.mass @ np.abs(made.velocity)
    made.run(1000)
    assert made.core.contacts > 1000
    assert np.abs(made.mass @ made.velocity - before).max() < 1e-13 * size.max()


# -- rest ------------------------------------------------------------------------------------------


def test_the_walls_bear_the_weight_of_a_bed() -> None:
    made = tube(CundallStrack(tangential_damping=0.8), 0.02)
    for _ in range(60):
        made.run(2000)
        made.set_velocity(0.5 * made.velocity, 0.5 * made.spin)
    made.record()
    weight = made.mass.sum() * 9.81
    assert made.wall_force[:, 1].sum() == pytest.approx(weight, rel=1e-6)


def column(layers: int, friction: float) -> Grains:
    """Grains in a standing tube whose floor sinks slowly, so that walls bear all they can."""
    law = CundallStrack(friction=friction, restitution=0.3)
    made = tube(law, layers * DIAMETER, gravity=(0.0, 0.0, -9.81), closed=False)
    made.run(6000)
    for step in range(100):
        Walls(TUBE, -5e-6 * step).apply(made.core)
        made.run(100)
    return made


def stress_on_floor(made: Grains) -> float:
    """Mean vertical stress three diameters above the floor while it sinks on [Pa]."""
    found = []
    for step in range(100, 130):
        Walls(TUBE, -5e-6 * step).apply(made.core)
        made.run(99)
        made.record()
        # of the tube alone: the plane is above the grains that touch the floor
        above = made.place[:, 2] > 3 * DIAMETER
        found.append((made.mass * 9.81 - made.wall_force[:, 2])[above].sum() / TUBE.area)
    return float(np.mean(found))


def test_standing_columns_follow_janssen() -> None:
    """The wall bears what the floor does not: stress = s (1 - exp(-y/l)), s = rho g l."""
    bottom, weight = [], []
    for layers in (60, 90):
        made = column(layers, 0.5)
        weight.append(made.mass.sum() * 9.81 / TUBE.area)
        bottom.append(stress_on_floor(made))
        # l = D/(4 mu K) for a ratio K of horizontal to vertical stress
        length = bottom[-1] / (weight[-1] / made.place[:, 2].max())
        assert 0.15 < TUBE.diameter / (4 * 0.5 * length) < 1.0
    assert weight[1] > 1.4 * weight[0] > 4.0 * bottom[0]
    assert bottom[1] == pytest.approx(bottom[0], rel=0.3)


def test_a_smooth_tube_bears_nothing() -> None:
    made = column(30, 0.0)
    made.record()
    tube_alone = made.place[:, 2] > 3 * DIAMETER
    assert np.abs(made.wall_force[tube_alone, 2]).max() == 0.0
    weight = made.mass.sum() * 9.81 / TUBE.area
    assert stress_on_floor(made) == pytest.approx(weight, rel=0.15)


def slope_of_pile(friction: float) -> float:
    """Angle of what stays of a dam of grains after its gate has gone, in a trough [deg]."""
    section = RectangularSection(6 * DIAMETER, 0.03, "none")
    law = CundallStrack(friction=friction, rolling_friction=0.05)
    grain = Grain(937.0, DIAMETER, contact=law, spread=0.1)
    length = 12 * DIAMETER
    made = Grains(grain, Walls(section, 0.0, length), STEP)
    place, radius = filled(RectangularSection(6 * DIAMETER, 0.02, "none"), grain, length)
    made.add(place, (0.0, 0.0, 0.0), radius)
    # columns of grains would stand on each other for ever
    made.set_velocity(np.random.default_rng(0).normal(size=place.shape) * 0.2)
    made.run(10000)
    Walls(section, 0.0).apply(made.core)
    made.run(30000)
    x = made.place
    bins = np.arange(0, x[:, 2].max(), 2 * DIAMETER)
    top = [x[(x[:, 2] >= b) & (x[:, 2] < b + 2 * DIAMETER), 1].max(initial=-1.0) for b in bins]
    heap = np.array(top) > -0.015 + 2 * DIAMETER
    number = int(np.argmin(heap)) if not heap.all() else len(heap)
    line = np.polyfit(bins[1:number], np.array(top)[1:number], 1)
    return math.degrees(math.atan(-line[0]))


@pytest.mark.slow
def test_a_pile_is_steeper_with_more_friction() -> None:
    angles = np.array([slope_of_pile(friction) for friction in (0.02, 0.1, 0.2, 0.4)])
    assert (np.diff(angles) > 3).all()
    assert angles[0] < 5 and 20 < angles[-1] < 40


# -- coming and going ------------------------------------------------------------------------------


def test_held_grains_push_and_are_released_behind_the_inlet() -> None:
    made = Grains(Grain(937.0, DIAMETER), Walls(TUBE, 0.0), STEP, (0, 0, 0), release=DIAMETER / 2)
    made.add([[0.0, 0.0, 0.5 * DIAMETER]])
    made.add([[0.0, 0.0, -0.5 * DIAMETER]], (0.0, 0.0, 0.05), held=True)
    made.run(2000)
    order = np.argsort(made.number)
    assert list(made.free[order]) == [True, False]
    # the held one has kept its speed and pushed the other
    assert made.velocity[order][1] == pytest.approx([0.0, 0.0, 0.05], abs=1e-15)
    assert made.velocity[order][0, 2] > 0.0499
    made.run(1000)
    assert made.free.all()


def test_grains_that_leave_are_counted_and_the_others_stay() -> None:
    made = tube(CundallStrack(), 0.05)
    made.run(100)
    before = {n: tuple(x) for n, x in zip(made.number, made.place, strict=True)}
    gone = made.remove_beyond(0.03)
    assert gone == sum(x[2] > 0.03 for x in before.values()) > 100
    assert made.count == len(before) - gone
    assert all(before[n] == tuple(x) for n, x in zip(made.number, made.place, strict=True))
    made.run(200)
    assert made.count == len(before) - gone


def test_springs_survive_when_other_grains_come_and_go() -> None:
    """A bed at rest stays at rest; without its springs it would slide anew."""
    found = []
    for disturb in (False, True):
        made = tube(CundallStrack(), 0.03)
        made.run(20000)
        if disturb:
            made.add([[0.0, 0.0, 0.4]])
            made.run(1)
            made.remove_beyond(0.3)
        else:
            made.run(1)
        made.run(200)
        found.append(made.place[np.argsort(made.number)])
    assert np.abs(found[0] - found[1]).max() < 1e-12


def test_grains_that_fly_apart_are_told() -> None:
    made = Grains(Grain(937.0, DIAMETER), Walls(), STEP)
    made.add([[0, 0, 0], [0, 0, 1]])
    made.set_velocity([[math.nan, 0, 0], [0, 0, 0]])
    with pytest.raises(SolverError, match="time_step"):
        made.run(2)


def test_bad_numbers_are_refused() -> None:
    grain = Grain(937.0, DIAMETER)
    with pytest.raises(InputError, match=r"numerics.skin"):
        Grains(grain, Walls(), STEP, skin=0.0)
    with pytest.raises(InputError, match=r"numerics.threads"):
        Grains(grain, Walls(), STEP, threads=0)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Grains that processes share: as one process alone, whatever the number of processes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

from fem_tfm.closures.contacts import CundallStrack, HertzMindlin, ViscousCoulomb
from fem_tfm.errors import SolverError
from fem_tfm.geometry.arc import Arc
from fem_tfm.geometry.section import RoundSection
from fem_tfm.geometry.shapes import Bend, Pipe
from fem_tfm.models.slug.feed import filled
from fem_tfm.models.slug.gas import TubeGas
from fem_tfm.models.slug.grains import Grain, Grains, Walls
from fem_tfm.models.slug.ranks import SharedGrains, as_rows
from fem_tfm.models.slug.told.slices import Sampler
from fem_tfm.models.slug.tube import Conveying, SlugTube

DIAMETER, STEP, LENGTH = 1.4e-3, 1e-5, 0.06
TUBE, WORLD = RoundSection(7e-3, "none"), MPI.COMM_WORLD
ARC = Arc(0.02, math.pi / 2, 0.01, "up")
LAWS = [ViscousCoulomb(), CundallStrack(), HertzMindlin(rolling_friction=0.1)]
pytestmark = pytest.mark.mpi


def both(law: Any, arc: Arc | None = None, spread: float = 0.1) -> tuple[SharedGrains, Grains]:
    """A tube of grains in motion, shared by all processes, and by each alone."""
    grain = Grain(937.0, DIAMETER, contact=law, spread=spread)
    given = (grain, Walls(TUBE, 0.0, None if arc else LENGTH, arc=arc), STEP, (0.0, -9.81, 2.0))
    place, radius = filled(TUBE, grain, 0.9 * LENGTH, arc=arc)
    velocity = np.random.default_rng(0).normal(size=place.shape) * 0.1
    made = SharedGrains(*given, comm=WORLD, length=LENGTH), Grains(*given)
    for one in made:
        one.watched = True
        one.add(place, velocity, radius)
    return made


def sorted_by_number(grains: Any) -> np.ndarray:
    order = np.argsort(grains.number)
    return np.column_stack([grains.number, grains.place, grains.radius])[order]


@pytest.mark.parametrize("law", LAWS, ids=[law.name for law in LAWS])
@pytest.mark.parametrize("arc", [None, ARC], ids=["straight", "bent"])
def test_shared_grains_go_where_they_go_alone(law: Any, arc: Arc | None) -> None:
    shared, alone = both(law, arc)
    for _ in range(4):
        shared.run(100)
        alone.run(100)
        assert shared.inside() == alone.count
    assert shared.core.rebuilds > 3
    found, expected = sorted_by_number(shared.everything()), sorted_by_number(alone)
    # rounding grows in collisions
    assert np.abs(found - expected).max() < 1e-9
    assert len(shared.impacts()) == len(alone.impacts()) > 100


def test_each_process_has_its_share_and_knows_its_neighbours() -> None:
    shared, _ = both(ViscousCoulomb(), spread=0.0)
    shared.run(200)
    own = shared._own()
    shares = WORLD.allgather(int(own.sum()))
    assert sum(shares) == shared.inside()
    assert max(shares) <= 1.1 * sum(shares) / WORLD.size
    numbers = np.concatenate(WORLD.allgather(shared.number[own]))
    assert len(set(numbers)) == len(numbers) == sum(shares)
    # two slabs meet in some layers of grains
    ghosts = WORLD.allgather(int((~own).sum()))
    assert (min(ghosts) > 19) == (WORLD.size > 1)


def test_forces_of_one_step_are_those_of_one_process() -> None:
    shared, alone = both(CundallStrack())
    for one in (shared, alone):
        one.run(49)
        one.record()
    every = shared.everything()
    for name in ("wall_force", "grain_force"):
        found = getattr(every, name)[np.argsort(every.number)]
        expected = getattr(alone, name)[np.argsort(alone.number)]
        assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()


def test_sums_have_the_same_bits_on_every_process() -> None:
    shared, _ = both(ViscousCoulomb())
    values = np.random.default_rng(WORLD.rank).normal(size=(7, 3))
    (first, second) = shared.total(values, 2 * values[:, 0])
    expected = sum(np.random.default_rng(r).normal(size=(7, 3)) for r in range(WORLD.size))
    assert first == pytest.approx(expected) and second == pytest.approx(2 * expected[:, 0])
    assert len(set(WORLD.allgather(first.tobytes()))) == 1


@pytest.mark.parametrize("law", [ViscousCoulomb(), CundallStrack()], ids=["viscous", "springs"])
def test_any_number_of_processes_goes_on_with_a_state(law: Any) -> None:
    shared, alone = both(law)
    shared.run(150)
    alone.run(150)
    kept = [shared.state(), alone.state()]
    again, other = both(law)
    other.restore(kept[0])
    again.restore(kept[1])
    for one in (alone, again, other):
        one.run(150)
    expected = sorted_by_number(alone)
    for found in (again.everything(), other):
        assert np.abs(sorted_by_number(found) - expected).max() < 1e-9


def test_springs_of_a_state_are_those_of_the_list() -> None:
    _, alone = both(CundallStrack())
    alone.run(150)
    # with a list and, after a grain has come, without
    for _ in range(2):
        rows, state = alone.core.rows(), as_rows(alone.state())
        order = [np.lexsort(r["pairs"].T) for r in (rows, state)]
        assert len(order[0]) > 20
        for name in ("pairs", "shear"):
            assert np.array_equal(rows[name][order[0]], state[name][order[1]])
        alone.add([[0.0, 0.0, 1.0]])


def test_grains_that_fly_apart_stop_every_process() -> None:
    shared, _ = both(ViscousCoulomb())
    shared.run(10)
    if WORLD.rank == WORLD.size - 1:
        shared.core.motion[np.flatnonzero(shared._own())[0], 0] = math.nan
    with pytest.raises(SolverError, match="time_step"):
        shared.run(200)


@pytest.mark.parametrize(
    "shape",
    [Pipe(7e-3, length=0.08), Bend(7e-3, length=0.08, bend_radius=0.02, bend_start=0.02)],
    ids=["straight", "bent"],
)
def test_nothing_is_lost_and_statistics_agree(shape: Any) -> None:
    grain, drops, counts = Grain(937.0, DIAMETER), [], []
    for comm in (WORLD, MPI.COMM_SELF):
        conveying = Conveying(2.0, 2.49 / 3600, 0.08)
        made = SlugTube(shape, TubeGas(6.73e-5), grain, conveying, full=True, comm=comm)
        sampler = Sampler(made)
        for _ in range(3):
            made.run(made.time + 0.04, sampler)
            assert made.start + made.fed == made.grains.inside() + made.out
        assert made.out > 100
        drops.append(np.mean(sampler.samples.drop))
        counts.append(np.mean(sampler.samples.count))
    assert drops[0] == pytest.approx(drops[1], rel=0.1)
    assert counts[0] == pytest.approx(counts[1], rel=0.05)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""The same bits whatever the order, threads, ranks, restarts and interruptions."""

from __future__ import annotations

import numpy as np
import pytest
from grids import duct, gas
from mpi4py import MPI
from test_scatter import life, stress, velocity

import fem_tfm._kernel as _kernel
from fem_tfm.closures.particles.impact import Restitution
from fem_tfm.materials import Solids
from fem_tfm.models.particles import tracker as module
from fem_tfm.models.particles.cloud import KINDS, Parcels
from fem_tfm.models.particles.field import Field
from fem_tfm.models.particles.sinks import Sinks
from fem_tfm.models.particles.tracker import Impacts, Tracker

ASH, FLOUR = Solids(density=1800.0, diameter=1.4e-4), Solids(density=1410.0, diameter=2e-4)
WALL = Restitution(e=0.9, mu=0.3, roughness_deg=3.0)


def field() -> Field:
    return gas(
        duct(8, folds=2, strip=8e-4), velocity=velocity, stress=stress, time=life, strip=1 / 6
    )


def cloud(n: int = 3000) -> Parcels:
    rng = np.random.default_rng(5)
    x = np.zeros((n, 3))
    x[:, :2] = rng.uniform(-0.09, 0.09, (n, 2))
    half = n // 2
    return Parcels.concatenate(
        [
            Parcels.release(x[:half], [0, 0, 2.8], ASH),
            Parcels.release(x[half:], [0, 0, 2.8], FLOUR, number=1, first_id=half),
        ]
    )


def mover(threads: int = 1, seed: int = 7) -> Tracker:
    return Tracker([ASH, FLOUR], dispersion="langevin", impact=WALL, seed=seed, threads=threads)


def moved(threads: int = 1, seed: int = 7) -> tuple[Parcels, Sinks, Impacts]:
    gas_field, parcels, impacts = field(), cloud(), Impacts()
    sinks = Sinks.of(gas_field.grid, parcels)
    mover(threads, seed).advance(parcels, gas_field, until_z=0.7, sinks=sinks, impacts=impacts)
    return parcels, sinks, impacts


@pytest.fixture(scope="module")
def reference() -> tuple[Parcels, Sinks, Impacts]:
    """A cloud after 0.7 m."""
    return moved()


def same(one: Parcels, other: Parcels) -> None:
    for name in KINDS:
        assert np.array_equal(getattr(one, name), getattr(other, name)), name


def test_threads(reference: tuple[Parcels, Sinks, Impacts]) -> None:
    parcels, sinks, impacts = moved(threads=2)
    same(parcels, reference[0])
    assert np.array_equal(sinks.sums, reference[1].sums)
    for name, values in reference[2].arrays().items():
        assert np.array_equal(impacts.arrays()[name], values), name
    assert len(impacts.arrays()["id"]) == parcels.bounces.sum() > 100


def test_instruction_sets(reference: tuple[Parcels, Sinks, Impacts]) -> None:
    """The same lanes with twice the registers."""
    if _kernel.VARIANT != "avx512":
        pytest.skip("a processor with one kind of vectors")
    gas_field, parcels = field(), cloud()
    sinks = Sinks.of(gas_field.grid, parcels)
    other = Tracker([ASH, FLOUR], dispersion="langevin", impact=WALL, seed=7, variant="avx2")
    other.advance(parcels, gas_field, until_z=0.7, sinks=sinks)
    same(parcels, reference[0])
    assert np.array_equal(sinks.sums, reference[1].sums)


def test_order(reference: tuple[Parcels, Sinks, Impacts]) -> None:
    order = np.random.default_rng(0).permutation(3000)
    gas_field, parcels = field(), cloud().select(order)
    sinks = Sinks.of(gas_field.grid, parcels)
    mover().advance(parcels, gas_field, until_z=0.7, sinks=sinks)
    same(parcels, reference[0].select(order))
    assert np.array_equal(sinks.sums, reference[1].sums)


def test_interruption(
    reference: tuple[Parcels, Sinks, Impacts], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The kernel comes back after every chunk."""
    monkeypatch.setattr(module, "PATIENCE", 0.0)
    gas_field, parcels, shares = field(), cloud(), []
    mover().advance(parcels, gas_field, until_z=0.7, progress=shares.append)
    same(parcels, reference[0])
    assert shares == sorted(shares) and len(shares) == 2


def test_restart_from_stored_arrays(reference: tuple[Parcels, Sinks, Impacts]) -> None:
    """A march in slabs that is stored and read in between."""
    gas_field, straight, parcels = field(), cloud(), cloud()
    for z in (0.2, 0.4, 0.7):
        mover().advance(straight, gas_field, until_z=z)
    for z in (0.2, 0.4, 0.7):
        stored = {name: values.copy() for name, values in parcels.arrays().items()}
        parcels = Parcels.from_arrays(stored)
        mover().advance(parcels, field(), until_z=z)
    same(parcels, straight)
    # slabs end steps early, so the bits differ from those of one slab
    assert not np.array_equal(parcels.x, reference[0].x)


def test_the_seed_matters(reference: tuple[Parcels, Sinks, Impacts]) -> None:
    other, _, _ = moved(seed=8)
    assert not np.array_equal(other.x, reference[0].x)
    assert other.v[:, 2].mean() == pytest.approx(reference[0].v[:, 2].mean(), rel=0.02)


@pytest.mark.mpi
def test_ranks(reference: tuple[Parcels, Sinks, Impacts]) -> None:
    comm = MPI.COMM_WORLD
    gas_field, mine = field(), cloud().share(comm)
    sinks = Sinks.of(gas_field.grid, mine, comm)
    # the scale of the sums is a bound that all ranks share
    whole = Sinks.of(gas_field.grid, cloud())
    assert sinks.quanta == whole.quanta
    mover().advance(mine, gas_field, until_z=0.7, sinks=sinks)
    sinks.reduce(comm)
    assert np.array_equal(sinks.sums, reference[1].sums)
    found = mine.gather(comm)
    assert mine.counts(comm) == reference[0].counts()
    if comm.rank == 0:
        assert found is not None
        same(found, reference[0])
    else:
        assert found is None


def test_copies_are_independent() -> None:
    parcels = cloud(10)
    kept = parcels.copy()
    parcels.x[:] = 1.0
    assert not (kept.x == 1.0).any()
    parcels.assign(kept)
    same(parcels, kept)

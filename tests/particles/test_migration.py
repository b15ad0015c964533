# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lines in parts: parcels go to the ranks of their cells, and find there what one rank finds."""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np
import pytest
from grids import gas
from mpi4py import MPI

from fem_tfm.closures.particles.collisions import Sommerfeld
from fem_tfm.closures.particles.impact import Restitution
from fem_tfm.geometry.arc import Arc
from fem_tfm.geometry.mesh import Mesh, extruded_mesh
from fem_tfm.geometry.resolution import Resolution
from fem_tfm.geometry.section import RectangularSection, RoundSection
from fem_tfm.materials import Solids
from fem_tfm.models.particles.cloud import KINDS, Parcels
from fem_tfm.models.particles.encounters import Encounters
from fem_tfm.models.particles.field import Field
from fem_tfm.models.particles.grid import Grid, Walls
from fem_tfm.models.particles.migration import dealt_by_cell, numbered
from fem_tfm.models.particles.partition import Partition
from fem_tfm.models.particles.sinks import Sinks
from fem_tfm.models.particles.tracker import Impacts, Tracker

WORLD, SELF = MPI.COMM_WORLD, MPI.COMM_SELF
ASH = Solids(density=1800.0, diameter=1.4e-4)
WALL = Restitution(e=0.9, mu=0.3, roughness_deg=3.0)
COUNT = 1500
LINES = [
    ("straight", "triangle"),
    ("straight", "quadrilateral"),
    ("bent", "triangle"),
    ("bent", "quadrilateral"),
]


def line(shape: str, cells: str, comm: MPI.Comm) -> Mesh:
    """Half a duct, or half a pipe that bends."""
    resolution = Resolution(level=1, cells=cells)
    if shape == "straight":
        duct = RectangularSection(0.1, 0.08, symmetry="half")
        return extruded_mesh(duct, resolution, 0.8, 16, comm, order=1)
    arc = Arc(0.2, math.pi / 2, 0.1, "up")
    pipe = RoundSection(0.1, symmetry="half")
    return extruded_mesh(pipe, resolution, arc.end + 0.2, 24, comm, arc=arc, order=1, fills=True)


def stirred(mesh: Mesh, grid: Grid) -> Field:
    """A gas that flows along the axis and across it, faster and calmer in the middle."""

    def near(x: np.ndarray) -> np.ndarray:
        return (mesh.straightened(x)[:, :2] ** 2).sum(axis=1) / 0.0025

    def velocity(x: np.ndarray) -> np.ndarray:
        across = 8.0 * np.stack([x[:, 1], -x[:, 0], 0 * x[:, 0]], axis=1)
        return (10 - 4 * near(x))[:, None] * mesh.axis(x) + across

    return gas(
        grid,
        velocity=velocity,
        stress=lambda x: (0.5 + 0.5 * near(x))[:, None, None] * np.diag([1.0, 1.0, 2.0]),
        time=lambda x: 5e-3 - 3e-3 * np.clip(near(x), 0, 1),
        pressure_gradient=lambda x: mesh.axis(x) * -30.0,
    )


def cloud() -> Parcels:
    rng = np.random.default_rng(5)
    x = np.zeros((COUNT, 3))
    x[:, :2] = rng.uniform(-0.033, 0.033, (COUNT, 2))
    return Parcels.release(x, [0, 0, 8.0], ASH, rate=rng.uniform(1e5, 1e6, COUNT))


def followed(shape: str, cells: str, comm: MPI.Comm) -> dict[str, Any]:
    """All that a cloud leaves in two passes, the second with collisions; on every rank."""
    mesh = line(shape, cells, comm)
    grid = Partition.of(mesh).grid
    field, impacts = stirred(mesh, grid), Impacts()
    tracker = Tracker([ASH], dispersion="langevin", impact=WALL, seed=3)
    parcels = cloud().share(comm)
    met = Encounters(Sommerfeld(), grid, parcels, 1, comm)
    volumes, changes = grid.sizes * 2, []
    for number in range(2):
        parcels = cloud().share(comm)
        sinks = Sinks.of(grid, parcels, comm)
        met.clear()
        for time in (0.02, 0.03, 0.2):
            told = impacts if number else None
            tracker.advance(
                parcels, field, until_time=time, sinks=sinks, impacts=told, encounters=met
            )
            assert sum(parcels.counts(comm).values()) == COUNT
        sinks.reduce(comm)
        changes.append(met.renew(volumes))
    whole = numbered(parcels, grid).gather(comm)
    hits = comm.gather(impacts.arrays())
    found: dict[str, Any] = {
        "sums": grid.collect(sinks.sums),
        "pairs": grid.collect(met.sums, axis=1),
        "fields": grid.collect(met.fields, axis=1),
        "changes": np.array(changes),
        "collisions": met.collisions,
        "residence": met.residence,
    }
    if whole is not None and hits is not None:
        found |= whole.arrays()
        order = np.lexsort(
            [np.concatenate([h[name] for h in hits]) for name in ("time", "step", "id")]
        )
        found |= {f"hit {n}": np.concatenate([h[n] for h in hits])[order] for n in hits[0]}
    return dict(comm.bcast(found))


@functools.cache
def alone(shape: str, cells: str) -> dict[str, Any]:
    return followed(shape, cells, SELF)


@pytest.mark.mpi
@pytest.mark.parametrize(("shape", "cells"), LINES)
def test_the_same_bits_on_any_number_of_ranks(shape: str, cells: str) -> None:
    found, one = followed(shape, cells, WORLD), alone(shape, cells)
    assert one["bounces"].sum() > 100 and one["collisions"][0] > 0
    assert one["changes"][1] > 0
    assert set(found) == set(one)
    for name, values in one.items():
        assert np.array_equal(found[name], values), name


@pytest.mark.mpi
@pytest.mark.parametrize("cells", ["triangle", "quadrilateral"])
def test_a_rank_holds_its_part(cells: str) -> None:
    parts, mesh = Partition.of(line("bent", cells, WORLD)), line("bent", cells, SELF)
    own, whole = parts.grid, Partition.of(mesh).grid
    assert WORLD.allreduce(own.count) == whole.count
    assert own.count < 0.7 * whole.count or WORLD.size == 1
    assert np.array_equal(whole.global_number, np.arange(whole.count))
    for name in ("map", "curved"):
        assert np.array_equal(own.arrays[name], whole.arrays[name][own.global_number]), name
    # what lies across a facet is what lies there in the whole
    beside, there = own.arrays["neighbour"], whole.arrays["neighbour"][own.global_number]
    assert np.array_equal(beside == -1, there == -1)
    inner, away = beside >= 0, beside < -1
    assert np.array_equal(own.global_number[beside[inner]], there[inner])
    assert np.array_equal(own.ghosts[-2 - beside[away], 1], there[away])
    assert np.array_equal(own.points[own.nodes], whole.points[whole.nodes[own.global_number]])
    points, nodes = own.whole()
    if WORLD.rank == 0:
        assert np.array_equal(points, whole.points) and np.array_equal(nodes, whole.nodes)
    else:
        assert len(nodes) == 0


@pytest.mark.mpi
@pytest.mark.parametrize(("shape", "cells"), LINES[:3])
def test_values_of_nodes_need_the_cells_around(shape: str, cells: str) -> None:
    """A node's mean is that of all cells that touch it, whoever holds them, in the same bits."""
    found = []
    for comm in (WORLD, SELF):
        mesh = line(shape, cells, comm)
        part = Partition.of(mesh)
        grid = part.grid
        values = np.random.default_rng(2).uniform(-1, 1, (WORLD.allreduce(0) + 100_000, 2))
        own = np.empty((grid.count, 2))
        # in the order of the mesh
        own[:] = values[grid.global_number][grid.owned]
        found.append((grid, part.at_nodes(own)))
    (grid, mine), (whole, exact) = found
    assert np.array_equal(mine[grid.nodes], exact[whole.nodes[grid.global_number]])
    one = exact[whole.nodes[0, 0]]
    touching = (whole.nodes == whole.nodes[0, 0]).any(axis=1)
    assert one == pytest.approx(
        np.average(values[: whole.count][touching], 0, whole.sizes[touching])
    )


@pytest.mark.mpi
def test_what_was_stored_goes_on_with_another_number_of_ranks() -> None:
    """Half of the way on all ranks, the other half on each alone."""
    both = []
    for first in (WORLD, SELF):
        stored: Parcels | None = None
        for comm, time in ((first, 0.03), (SELF, 0.06)):
            mesh = line("bent", "triangle", comm)
            grid = Partition.of(mesh).grid
            parcels = cloud().share(comm) if stored is None else dealt_by_cell(stored, grid)
            tracker = Tracker([ASH], dispersion="langevin", impact=WALL, seed=3)
            tracker.advance(parcels, stirred(mesh, grid), until_time=time)
            whole = numbered(parcels, grid).gather(comm)
            arrays = comm.bcast(None if whole is None else whole.arrays())
            stored = Parcels.from_arrays(arrays)
        assert stored is not None
        both.append(stored)
    assert both[0].counts()["inside"] > 100
    for name in KINDS:
        assert np.array_equal(getattr(both[0], name), getattr(both[1], name)), name


@pytest.mark.mpi
def test_strays_are_found_by_the_rank_that_has_them() -> None:
    """A walk through more cells than it may take begins again at the nearest centre."""
    duct = RectangularSection(0.1, 0.1, symmetry="none")
    ends = []
    for comm in (WORLD, SELF):
        mesh = extruded_mesh(
            duct, Resolution(level=1, cells="quadrilateral"), 9.0, 600, comm, order=1
        )
        grid = Partition.of(mesh).grid
        x = np.tile([[0.013, 0.021, 8.9]], (10, 1))
        parcels = Parcels.release(x, [0, 0, 1.0], ASH)
        parcels.cell[:] = grid.local(np.zeros(10, dtype=np.int64))
        parcels = parcels.select(parcels.cell == 0)
        report = Tracker([ASH]).advance(parcels, gas(grid, velocity=[0, 0, 1.0]), until_time=0.05)
        assert comm.allreduce(report.strays) == 10
        assert comm.allreduce(len(parcels)) == 10 and parcels.counts(comm)["inside"] == 10
        assert (np.abs(grid.points[grid.nodes[parcels.cell]].mean(axis=1) - parcels.x) < 0.05).all()
        whole = numbered(parcels, grid).gather(comm)
        ends.append(comm.bcast(None if whole is None else whole.arrays()))
    for name in KINDS:
        assert np.array_equal(ends[0][name], ends[1][name]), name


@pytest.mark.mpi
@pytest.mark.parametrize(("shape", "cells"), LINES)
def test_walls_of_facets_are_the_same_in_parts(shape: str, cells: str) -> None:
    """Their ends are open, their sides hold what comes, on any number of ranks in the same bits."""
    ends = []
    for comm in (WORLD, SELF):
        mesh = line(shape, cells, comm)
        grid = Partition.of(mesh, Walls("planes")).grid
        parcels = cloud().share(comm)
        tracker = Tracker([ASH], dispersion="langevin", impact=WALL, seed=3)
        report = tracker.advance(parcels, stirred(mesh, grid), until_time=0.1)
        assert comm.allreduce(report.bounces) > 150
        counts = parcels.counts(comm)
        assert counts["out"] > 100 and counts["inside"] > 100
        assert counts["out"] + counts["inside"] == COUNT
        whole = numbered(parcels, grid).gather(comm)
        ends.append(comm.bcast(None if whole is None else whole.arrays()))
    for name in KINDS:
        assert np.array_equal(ends[0][name], ends[1][name]), name

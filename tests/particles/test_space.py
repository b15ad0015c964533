# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lines in space: fields, walls of facets, bends, ends, and the gas of an unsteady flow."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from grids import box, gas
from mpi4py import MPI

from fem_tfm import Case
from fem_tfm.closures.drag import ConstantDrag
from fem_tfm.closures.particles.dispersion import Langevin
from fem_tfm.geometry.arc import Arc
from fem_tfm.geometry.mesh import extruded_mesh, line_mesh
from fem_tfm.geometry.resolution import Resolution
from fem_tfm.geometry.section import RectangularSection, RoundSection
from fem_tfm.geometry.shapes import Duct
from fem_tfm.materials import Solids
from fem_tfm.models.carrier import LineCarrier
from fem_tfm.models.finite_volume import UnsteadyFlow
from fem_tfm.models.particles.cloud import Parcels
from fem_tfm.models.particles.grid import Grid, Walls
from fem_tfm.models.particles.partition import Partition
from fem_tfm.models.particles.tracker import Forces, Impacts, Steps, Tracker

ASH = Solids(density=1800.0, diameter=1.4e-4)
HEAVY = Solids(density=25000.0, diameter=0.01)
FREE = Forces(drag=ConstantDrag(value=1e-30))
SIZE = (0.2, 0.3, 1.0)
KINDS = ("tetrahedron", "hexahedron")


def brick(kind: str, walls: str = "rectangle", open_ends: bool = False) -> Grid:
    """A box about the axis with disturbed inner nodes."""
    cell, nodes, points = box((4, 5, 8), SIZE, kind)
    inner = ((points > 1e-9) & (points < np.array(SIZE) - 1e-9)).all(axis=1)
    noise = np.random.default_rng(3).uniform(-0.006, 0.006, points.shape)
    points = points + inner[:, None] * noise
    points[:, :2] -= np.array(SIZE[:2]) / 2
    sides = Walls(walls, (SIZE[0] / 2, SIZE[1] / 2), length=0.0 if walls == "planes" else SIZE[2])
    grid = Grid(cell, nodes, points, sides)
    if not open_ends:
        return grid
    ends = [
        (c, f)
        for c, f in np.argwhere(grid.arrays["neighbour"] < 0)
        if np.ptp(points[nodes[c][list(cell.facets[f])], 2]) < 1e-9
    ]
    return Grid(cell, nodes, points, sides, open=np.array(ends))


def inside(n: int, margin: float = 0.01, seed: int = 1) -> np.ndarray:
    low = np.array([-SIZE[0] / 2, -SIZE[1] / 2, 0]) + margin
    high = np.array([SIZE[0] / 2, SIZE[1] / 2, SIZE[2]]) - margin
    return np.random.default_rng(seed).uniform(low, high, (n, 3))


@pytest.mark.parametrize("kind", KINDS)
def test_linear_fields_are_exact(kind: str) -> None:
    field = gas(brick(kind), velocity=lambda x: np.stack([x[:, 1], 2 - x[:, 2], 9 + x[:, 0]], 1))
    x = inside(3000)
    parcels = Parcels.release(x, [0, 0, 0], ASH, diameter=0.0)
    tracker = Tracker([ASH], steps=Steps(largest=1e-12, smallest=1e-13))
    report = tracker.advance(parcels, field, until_time=1e-12)
    assert report.strays == 0
    exact = np.stack([x[:, 1], 2 - x[:, 2], 9 + x[:, 0]], axis=1)
    assert parcels.memory[:, :3] == pytest.approx(exact, abs=3e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_closed_box_of_facets_is_a_box_of_mirrors(kind: str) -> None:
    n, seconds = 64, 20.0
    x = inside(n)
    v = np.random.default_rng(4).normal(0, 3, (n, 3))
    parcels = Parcels.release(x, v, HEAVY)
    tracker = Tracker([HEAVY], FREE, steps=Steps(largest=0.05))
    report = tracker.advance(parcels, gas(brick(kind, "planes")), until_time=seconds)
    assert report.bounces > 20000
    assert parcels.counts()["inside"] == n
    assert (parcels.v**2).sum(axis=1) == pytest.approx((v**2).sum(axis=1), rel=1e-10)
    r = HEAVY.diameter / 2
    low = np.array([-SIZE[0] / 2, -SIZE[1] / 2, 0]) + r
    wide = np.array(SIZE) - 2 * r
    way = (x + seconds * v - low) % (2 * wide)
    assert parcels.x == pytest.approx(low + np.minimum(way, 2 * wide - way), abs=1e-4)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("walls", ["planes", "rectangle"])
def test_parcels_leave_through_the_ends(kind: str, walls: str) -> None:
    grid = brick(kind, walls, open_ends=walls == "planes")
    parcels = Parcels.release(inside(200), [0, 0, 5.0], ASH)
    parcels.v[:20, 2] = -5.0
    tracker = Tracker([ASH], FREE, steps=Steps(largest=0.01))
    tracker.advance(parcels, gas(grid, velocity=[0, 0, 0]), until_time=10.0)
    assert parcels.counts()["out"] == 200
    assert (parcels.x[:20, 2] <= 1e-12).all() and (parcels.x[20:, 2] >= 1 - 1e-12).all()


@pytest.mark.parametrize("kind", KINDS)
def test_a_mixed_cloud_stays_mixed_in_space(kind: str) -> None:
    def stress(x: np.ndarray) -> np.ndarray:
        a = 1 - np.abs(x[:, 1]) / 0.15
        r = np.zeros((len(x), 3, 3))
        r[:, 0, 0], r[:, 1, 1] = 1.0, 0.1 + 0.9 * a
        r[:, 2, 2] = 1 + x[:, 2]
        r[:, 1, 2] = r[:, 2, 1] = 0.2
        return r

    field = gas(brick(kind, "planes"), stress=stress, time=0.02)
    n, found = 20000, np.zeros(10)
    parcels = Parcels.release(inside(n, 0.0), [0, 0, 0], ASH, diameter=0.0)
    tracker = Tracker([ASH], dispersion=Langevin(), steps=Steps(eddies=0.25, largest=1.0))
    for k in range(4):
        tracker.advance(parcels, field, until_time=0.4 + 0.1 * k)
        assert parcels.counts()["inside"] == n
        found[:5] += np.histogram(np.abs(parcels.x[:, 1]), 5, (0, 0.15))[0]
        found[5:] += np.histogram(parcels.x[:, 2], 5, (0, 1))[0]
    assert found * 5 / (4 * n) == pytest.approx(1.0, abs=0.06)


# -- bends -------------------------------------------------------------------------------------


def bend(kind: str, towards: str, angle: float = math.pi / 2) -> Grid:
    """A box of cells around a whole bend, since walls alone matter here."""
    cell, nodes, points = box((2, 2, 2), (6.0, 6.0, 6.0), "hexahedron")
    x, y = {"up": (0.0, 1.0), "down": (0.0, -1.0), "side": (1.0, 0.0)}[towards]
    walls = Walls(f"bent {kind}", (0.1, 0.1), arc=(0.5, 1.0, angle, x, y))
    return Grid(cell, nodes, points - np.array([3.0, 3.0, 2.0]), walls)


@pytest.mark.parametrize("kind", ["rectangle", "circle"])
@pytest.mark.parametrize("towards", ["up", "down", "side"])
def test_a_particle_skips_along_the_outer_wall_of_a_bend(kind: str, towards: str) -> None:
    """Chords of equal length: every impact turns the path by the same angle."""
    grid = bend(kind, towards)
    arc = Arc(1.0, math.pi / 2, 0.5, towards)
    normal = arc.normal
    start = -0.05 * normal
    parcels = Parcels.release(start[None, :], [0, 0, 1.0], HEAVY, diameter=0.0)
    parcels.diameter[:] = 0.02
    impacts = Impacts()
    tracker = Tracker([HEAVY], FREE, steps=Steps(largest=0.02))
    tracker._tables.clear()
    tracker.forces = Forces(drag="clift-gauvin")
    still = gas(grid)
    still.viscosity = 1e-12
    tracker.advance(parcels, still, until_time=2.3, impacts=impacts)
    found = impacts.arrays()
    outer, lever = 1.1 - 0.01, 1.05
    first, half = math.acos(lever / outer), math.acos(lever / outer)
    turned = first + 2 * half * np.arange(len(found["time"]))
    assert len(turned) == 3
    place = np.outer(1.0 - outer * np.cos(turned), normal)
    place[:, 2] = 0.5 + outer * np.sin(turned)
    assert found["x"] == pytest.approx(place, abs=1e-9)
    out = np.outer(-np.cos(turned), normal)
    out[:, 2] = np.sin(turned)
    assert found["normal"] == pytest.approx(out, abs=1e-9)
    assert np.linalg.norm(parcels.v[0]) == pytest.approx(1.0, abs=1e-7)


@pytest.mark.parametrize("kind", ["rectangle", "circle"])
@pytest.mark.parametrize("angle", [0.7, math.pi / 2, math.pi])
def test_nothing_gets_through_the_walls_of_a_bend(kind: str, angle: float) -> None:
    grid = bend(kind, "up", angle)
    arc = Arc(1.0, angle, 0.5, "up")
    rng = np.random.default_rng(6)
    n = 500
    straight = np.column_stack([rng.uniform(-0.06, 0.06, (n, 2)), rng.uniform(-0.5, 1.5, n)])
    parcels = Parcels.release(arc.bent(straight), rng.normal(0, 1, (n, 3)), ASH, diameter=1e-3)
    speed = np.linalg.norm(parcels.v, axis=1)
    still = gas(grid)
    still.viscosity = 1e-15
    tracker = Tracker([ASH], steps=Steps(largest=0.05))
    tracker.advance(parcels, still, until_time=1.0)
    assert parcels.bounces.sum() > n
    across = np.abs(arc.straightened(parcels.x)[:, :2])
    reach = across.max(axis=1) if kind == "rectangle" else np.hypot(*across.T)
    assert reach.max() < 0.1 - 5e-4 + 1e-9
    assert np.linalg.norm(parcels.v, axis=1) == pytest.approx(speed, rel=1e-4)


@pytest.mark.mpi
@pytest.mark.parametrize("cells", ["triangle", "quadrilateral"])
def test_walls_of_a_meshed_bend(cells: str) -> None:
    """A gas along the axis carries points through a pipe bend to its end."""
    section = RoundSection(0.1, symmetry="half")
    arc = Arc(0.4, math.pi / 2, 0.2, "up")
    length = arc.end + 0.2
    mesh = extruded_mesh(
        section, Resolution(level=1, cells=cells), length, 30, MPI.COMM_WORLD, arc=arc, order=1
    )
    grid = Partition.of(mesh).grid
    assert (grid.walls.kind, grid.folds, grid.walls.length) == ("bent circle", 1, length)
    field = gas(grid, velocity=lambda x: 10 * arc.axis(x))
    x = np.zeros((400, 3))
    x[:, :2] = np.random.default_rng(1).uniform(-0.03, 0.03, (400, 2))
    parcels = Parcels.release(x, [0, 0, 10.0], ASH, diameter=0.0).share(MPI.COMM_WORLD)
    report = Tracker([ASH], steps=Steps(largest=1e-3)).advance(parcels, field, until_time=1.0)
    assert parcels.counts(MPI.COMM_WORLD)["out"] == 400
    assert report.strays < 5
    end = arc.straightened(parcels.x)
    assert end[:, 2] == pytest.approx(length, abs=0.011)
    assert end[:, :2] == pytest.approx(x[parcels.id, :2], abs=2e-3)


# -- the gas of an unsteady flow ---------------------------------------------------------------


def unsteady(turbulence: str, comm: MPI.Comm) -> UnsteadyFlow:
    case = Case.from_dict(
        {
            "solution": "unsteady",
            "numerics": {"end_time": 1.0},
            "geometry": {
                "shape": "duct", "width": 0.1, "height": 0.1, "length": 0.5, "symmetry": "none",
            },
            "gas": {"density": 1.2, "viscosity": 1.8e-5},
            "operation": {"gas_superficial_velocity": 5.0, "gravity": 0.0},
            "closures": {"turbulence": turbulence},
        }
    )  # fmt: skip
    section = RectangularSection(0.1, 0.1, "none")
    shape = Duct(width=0.1, height=0.1, length=0.5)
    resolution = Resolution(level=1, cells="quadrilateral")
    return UnsteadyFlow(case.scene.problem(), line_mesh(shape, section, resolution, comm))


@pytest.mark.mpi
@pytest.mark.parametrize("turbulence", ["laminar", "mixing-length", "k-epsilon"])
def test_carrier_of_an_unsteady_flow(turbulence: str) -> None:
    flow = unsteady(turbulence, MPI.COMM_WORLD)
    centres = flow.cells.centre
    flow.now.u_g[:] = np.stack([0 * centres[:, 0], 0 * centres[:, 0], 5 + 20 * centres[:, 1]], 1)
    flow.now.p[:] = 7 - 30 * centres[:, 2]
    carrier = LineCarrier(flow, Langevin())
    carrier.update()
    rows: Any = carrier.field.rows
    points = carrier.grid.points
    inner = (np.abs(points[:, :2]) < 0.02).all(axis=1) & (np.abs(points[:, 2] - 0.25) < 0.2)
    # cells grow towards the axis, and the mean by volume leans towards the larger ones
    assert rows[inner, 2] == pytest.approx(5 + 20 * points[inner, 1], abs=0.2)
    assert rows[inner, 15] == pytest.approx(-30 / 1.2, rel=1e-4)
    if turbulence == "laminar":
        assert not rows[:, 5:11].any()
    else:
        assert (rows[:, 5] > 0).all() and (rows[:, 4] < 1).all()
    carrier.keep(0.0, 0.1)
    flow.now.u_g[:] *= 2
    carrier.update()
    assert carrier.field.rows_ahead is not None
    assert carrier.field.rows_ahead[inner, 2] == pytest.approx(2 * rows[inner, 2], rel=1e-6)


def test_time_between_two_fields() -> None:
    """A gas that speeds up: W = 1 + t between two times; a point goes t + t^2/2."""
    grid = brick("hexahedron")
    field = gas(grid, velocity=[0, 0, 1.0])
    field.keep(0.0, 0.5)
    field.fill(velocity=np.tile([0, 0, 1.5], (len(grid.points), 1)))
    parcels = Parcels.release(np.zeros((3, 3)), [0, 0, 1.0], ASH, diameter=0.0)
    Tracker([ASH], steps=Steps(largest=0.01)).advance(parcels, field, until_time=0.5)
    assert parcels.x[:, 2] == pytest.approx(0.5 + 0.125, rel=1e-5)

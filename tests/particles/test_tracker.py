# SPDX-License-Identifier: LGPL-3.0-or-later
"""The tracker against closed forms: drag, weight, walls, order in time, sums, bad input."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from grids import AIR, duct, gas
from scipy.optimize import brentq

from fem_tfm.closures import names
from fem_tfm.closures.base import make
from fem_tfm.closures.drag import ConstantDrag, Drag
from fem_tfm.closures.particles.impact import Restitution, Stick
from fem_tfm.errors import InputError
from fem_tfm.materials import Gas, Solids
from fem_tfm.models.particles.cloud import Parcels
from fem_tfm.models.particles.grid import Walls
from fem_tfm.models.particles.sinks import Sinks
from fem_tfm.models.particles.tracker import (
    Forces,
    Impacts,
    Steps,
    Tracker,
    drag_factor,
    drag_table,
)

ASH = Solids(density=1800.0, diameter=1.4e-4)
GAS = Gas(**AIR)
# a particle that the gas does not move
HEAVY = Solids(density=25000.0, diameter=0.1)
FREE = Forces(drag=ConstantDrag(value=1e-25))


def spread(n: int, half: float = 0.09, seed: int = 1) -> np.ndarray:
    """Places over the section at z = 0."""
    x = np.zeros((n, 3))
    x[:, :2] = np.random.default_rng(seed).uniform(-half, half, (n, 2))
    return x


# -- drag and weight ---------------------------------------------------------------------------


@pytest.mark.parametrize("name", names("drag"))
def test_table_of_a_drag_law_is_exact(name: str) -> None:
    law = make("drag", name)
    assert isinstance(law, Drag)
    table = drag_table(law, GAS, ASH).astype(float)
    reynolds = np.geomspace(1e-3, 1e5, 4001).astype(np.float32)
    bits = reynolds.view(np.int32)
    row, t = (bits >> 19) - ((127 - 20) << 4), (bits & 0x7FFFF) / 2.0**23
    found = sum(table[row, k] * t**k for k in range(4))
    exact = drag_factor(law, reynolds.astype(float), GAS, ASH)
    # Schiller and Naumann's branches are joined within a twentieth of an octave
    joined = (reynolds > 850) & (reynolds < 1150)
    np.testing.assert_allclose(found[~joined], exact[~joined], rtol=1e-6)
    np.testing.assert_allclose(found[joined], exact[joined], rtol=1e-4)


def test_relaxation_in_a_uniform_gas() -> None:
    rate = 1000 / ASH.density
    field = gas(duct(), velocity=[0, 0, 22.0])
    parcels = Parcels.release(np.zeros((3, 3)), [0, 1.0, 2.8], ASH)
    tracker = Tracker([ASH], Forces(drag=ConstantDrag(value=1000.0)), steps=Steps(largest=7e-3))
    tracker.advance(parcels, field, until_time=0.05)
    decay = math.exp(-rate * 0.05)
    assert parcels.v[0] == pytest.approx([0, decay, 22 - 19.2 * decay], rel=1e-6)
    way = (1 - decay) / rate
    assert parcels.x[0] == pytest.approx([0, way, 22 * 0.05 - 19.2 * way], rel=1e-6)
    assert parcels.time == pytest.approx(0.05, rel=1e-12)


@pytest.mark.parametrize("variant", ["plain", None])
def test_terminal_velocity_with_buoyancy(variant: str | None) -> None:
    forces = Forces(gravity=(0.0, -9.81, 0.0))
    field = gas(duct(half=(10.0, 10.0)))
    parcels = Parcels.release(np.zeros((1, 3)), [0, 0, 0], ASH)
    tracker = Tracker([ASH], forces, steps=Steps(largest=4e-3), variant=variant)
    tracker.advance(parcels, field, until_time=3.0)

    def excess(speed: float) -> float:
        reynolds = GAS.density * ASH.diameter * speed / GAS.viscosity
        c_d = 24 / reynolds * (1 + 0.15 * reynolds**0.687)
        c_d += 0.42 / (1 + 4.25e4 * reynolds**-1.16)
        drag = 0.75 * c_d * GAS.density * speed**2 / ASH.diameter
        return float(drag - (ASH.density - GAS.density) * 9.81)

    assert parcels.v[0] == pytest.approx([0, -brentq(excess, 1e-3, 10), 0], rel=1e-6)


def test_second_order_in_time() -> None:
    """In a shear flow with secondary motion; errors against steps an eighth of the least."""

    def velocity(x: np.ndarray) -> np.ndarray:
        k = np.pi / 0.1
        u, v = np.sin(k * x[:, 0]) * np.cos(k * x[:, 1]), np.cos(k * x[:, 0]) * np.sin(k * x[:, 1])
        return np.stack([u, -v, 15 - 500 * (x[:, 0] ** 2 + x[:, 1] ** 2)], axis=1)

    field = gas(duct(cells=24), velocity=velocity)

    def end(step: float) -> np.ndarray:
        parcels = Parcels.release(spread(64, 0.05), [0, 0, 2.8], ASH)
        steps = Steps(largest=step, relaxation=100.0)
        Tracker([ASH], steps=steps).advance(parcels, field, until_time=0.064)
        return np.concatenate([parcels.x, 0.05 * parcels.v], axis=1)

    steps = [8e-3, 4e-3, 2e-3]
    exact = end(2.5e-4)
    errors = [np.abs(end(step) - exact).mean() for step in steps]
    found = [math.log2(a / b) for a, b in itertools.pairwise(errors)]
    assert all(1.8 < order < 2.7 for order in found), found


def test_lands_on_the_plane() -> None:
    field = gas(duct(), velocity=[0, 0, 22.0])
    parcels = Parcels.release(spread(100), [0, 0, 2.8], ASH)
    tracker = Tracker([ASH])
    # the drag rate of the step before predicts the way in the last one
    for z, miss in ((0.013, 3e-4), (0.5, 5e-5)):
        tracker.advance(parcels, field, until_z=z)
        assert parcels.x[:, 2] == pytest.approx(z, abs=miss)
    before = parcels.x.copy()
    tracker.advance(parcels, field, until_z=0.49)
    assert np.array_equal(parcels.x, before)


def test_march_in_slabs_sees_the_gas_between_stations() -> None:
    """W = 10 + 2 z, linear between two stations: slabs differ from one by their last steps only."""
    grid = duct()

    def trace(ends: list[float]) -> Parcels:
        field = gas(grid, velocity=[0, 0, 10.0])
        parcels = Parcels.release(np.zeros((1, 3)), [0, 0, 10.0], ASH, diameter=0.0)
        start = 0.0
        for end in ends:
            field.keep(start, end)
            field.fill(velocity=np.tile([0, 0, 10 + 2 * end], (len(grid.points), 1)))
            Tracker([ASH], steps=Steps(largest=1e-3)).advance(parcels, field, until_z=end)
            start = end
        return parcels

    for ends in ([2.0], [0.3, 0.9, 2.0]):
        assert trace(ends).time[0] == pytest.approx(math.log(14 / 10) / 2, rel=1e-5)


# -- walls -------------------------------------------------------------------------------------


def test_elastic_box_keeps_energy_over_a_million_bounces() -> None:
    n, dt = 512, 0.02
    rng = np.random.default_rng(3)
    velocity = rng.normal(0, 10, (n, 3))
    x = spread(n, 0.04)
    parcels = Parcels.release(x, velocity, HEAVY)
    tracker = Tracker([HEAVY], FREE, steps=Steps(largest=dt))
    report = tracker.advance(parcels, gas(duct()), until_time=60.0)
    assert report.bounces > 1e6
    assert np.abs(np.abs(parcels.v) - np.abs(velocity)).max() < 1e-12
    energy, start = (parcels.v**2).sum(), (velocity**2).sum()
    assert energy == pytest.approx(start, rel=1e-12)
    # where straight flight between mirrors ends
    way = (x[:, :2] + 60 * velocity[:, :2] + 0.05) % 0.2
    assert parcels.x[:, :2] == pytest.approx(np.minimum(way, 0.2 - way) - 0.05, abs=1e-5)


def test_reflections_in_a_circle_are_exact() -> None:
    """A chord comes back turned by twice the angle of incidence, for ever."""
    grid = duct(half=(0.1, 0.1))
    grid.walls = Walls("circle", (0.1, 0.1))
    angle, speed, radius = 0.4, 3.0, 0.05
    inward = np.array([-math.cos(angle), math.sin(angle), 0.0])
    parcels = Parcels.release(np.array([[radius, 0, 0.0]]), speed * inward, HEAVY)
    chord = 2 * radius * math.cos(angle)
    hits = 1000
    time = (hits + 0.5) * chord / speed
    impacts = Impacts()
    tracker = Tracker([HEAVY], Forces(drag=ConstantDrag(value=1e-30)), steps=Steps(largest=0.2))
    tracker.advance(parcels, gas(grid), until_time=time, impacts=impacts)
    found = impacts.arrays()
    assert parcels.bounces[0] == hits == len(found["time"])
    turned = np.arange(1, hits + 1) * (math.pi - 2 * angle)
    place = radius * np.stack([np.cos(turned), np.sin(turned)], axis=1)
    assert found["x"][:, :2] == pytest.approx(place, abs=1e-10)
    assert found["normal"][:, :2] == pytest.approx(place / radius, abs=1e-9)
    assert found["time"] == pytest.approx(np.arange(1, hits + 1) * chord / speed, abs=1e-7)
    assert np.linalg.norm(parcels.v[0]) == pytest.approx(speed, rel=1e-12)


def fall(law: Any, velocity: list[float], omega: float = 0.0) -> Parcels:
    """One impact on the floor y = -0.1."""
    beads = Solids(density=2500.0, diameter=1e-3)
    parcels = Parcels.release(np.array([[0.0, -0.0990, 0.0]]), velocity, beads)
    parcels.omega[0, 0] = omega
    forces = Forces(drag=ConstantDrag(value=1e-9))
    Tracker([beads], forces, impact=law).advance(parcels, gas(duct()), until_time=2e-3)
    return parcels


def test_impact_slides_or_rolls() -> None:
    e, mu, r = 0.8, 0.3, 5e-4
    steep = fall(Restitution(e=e, mu=mu), [0, -2.0, 1.0])
    assert steep.bounces[0] == 1
    # rolling: the point that touches comes to rest
    assert steep.v[0] == pytest.approx([0, 1.6, 5 / 7], rel=1e-6)
    assert steep.omega[0] == pytest.approx([5 / 7 / r, 0, 0], rel=1e-6)
    flat = fall(Restitution(e=e, mu=mu), [0, -0.6, 5.0])
    lost = mu * (1 + e) * 0.6
    assert flat.v[0] == pytest.approx([0, 0.48, 5 - lost], rel=1e-6)
    assert flat.omega[0] == pytest.approx([2.5 * lost / r, 0, 0], rel=1e-6)
    # one that rolls already keeps its speed
    rolling = fall(Restitution(e=e, mu=mu), [0, -0.6, 5.0], omega=5 / r)
    assert rolling.v[0] == pytest.approx([0, 0.48, 5.0], rel=1e-6)


def test_rough_walls_scatter_and_lift_flat_paths() -> None:
    """Flanks that face the particle are met more often, so a flat path leaves steeper."""
    n = 4000
    x = np.tile([0.0, -0.0999, 0.0], (n, 1))
    dust = Solids(density=1800.0, diameter=1e-9)
    parcels = Parcels.release(x, [0, -0.1, 2.0], dust)
    tracker = Tracker([dust], FREE, impact=Restitution(e=1.0, roughness_deg=3.0))
    tracker.advance(parcels, gas(duct()), until_time=2e-3)
    assert (parcels.bounces == 1).all()
    assert (parcels.v[:, 1] > 0).all()
    assert np.linalg.norm(parcels.v, axis=1) == pytest.approx(math.hypot(0.1, 2.0), rel=1e-6)
    rise = np.degrees(np.arctan2(parcels.v[:, 1], parcels.v[:, 2]))
    tilt = (rise - math.degrees(math.atan2(0.1, 2.0))) / 2
    assert 1.0 < tilt.mean() < 3.0
    # across the path the tilt is even
    sideways = np.degrees(np.arctan2(parcels.v[:, 0], parcels.v[:, 2]))
    assert abs(sideways.mean()) < 4 * sideways.std() / math.sqrt(n)


@pytest.mark.parametrize(("speed", "stuck"), [(0.0, True), (0.5, False), (2.5, True)])
def test_sticking(speed: float, stuck: bool) -> None:
    parcels = fall(Stick(speed=speed), [0, -2.0, 1.0])
    assert parcels.status[0] == (2 if stuck else 0)
    if stuck:
        assert parcels.x[0, 1] == pytest.approx(-0.0995, rel=1e-12)
        assert not parcels.v.any()


# -- sums --------------------------------------------------------------------------------------


@pytest.mark.parametrize("folds", [0, 1, 2])
def test_what_the_gas_gives_is_what_particles_gain(folds: int) -> None:
    """With weight, which is not the gas's, and walls, which take no axial momentum."""
    field = gas(duct(folds=folds), velocity=lambda x: 20 + 30 * x[:, [0, 1, 0]])
    parcels = Parcels.release(spread(300), [0, 0, 2.8], ASH, rate=np.linspace(1, 5, 300))
    before = parcels.copy()
    tracker = Tracker([ASH], Forces(gravity=(0.0, 0.0, 3.0)))
    sinks = Sinks.of(field.grid, parcels)
    tracker.advance(parcels, field, until_time=0.3, sinks=sinks)
    flow = parcels.mass_flow
    weight = 3 * (1 - 1.2 / 1800) * 0.3
    gain = (flow * (parcels.v[:, 2] - before.v[:, 2] - weight)).sum()
    assert sinks.impulse[:, 2].sum() == pytest.approx(gain, rel=1e-8)
    assert sinks.residence.sum() == pytest.approx((flow * 0.3).sum(), rel=1e-9)
    way = (flow * parcels.x[:, 2]).sum()
    assert sinks.moment[:, 2].sum() == pytest.approx(way, rel=1e-9)


def test_axial_impulse_without_weight_closes() -> None:
    field = gas(duct(), velocity=[0, 0, 22.0])
    parcels = Parcels.release(spread(1000), [0, 0, 2.8], ASH)
    sinks = Sinks.of(field.grid, parcels)
    Tracker([ASH]).advance(parcels, field, until_z=5.0, sinks=sinks)
    gain = (parcels.mass_flow * (parcels.v[:, 2] - 2.8)).sum()
    assert sinks.impulse[:, 2].sum() == pytest.approx(gain, rel=1e-10)
    # the slope: how the impulse grows with the velocity of the gas, at fixed drag rate
    assert 0 < sinks.slope.sum() < parcels.mass_flow.sum() * 1e3


def test_slope_is_the_growth_of_the_impulse() -> None:
    """Of one step, with a linear drag: d(impulse)/dW."""

    def after(speed: float) -> Sinks:
        field = gas(duct(), velocity=[0, 0, speed])
        parcels = Parcels.release(spread(50), [0, 0, 2.8], ASH)
        sinks = Sinks.of(field.grid, parcels)
        tracker = Tracker([ASH], Forces(drag=ConstantDrag(value=5e4)), steps=Steps(largest=0.01))
        tracker.advance(parcels, field, until_time=0.01, sinks=sinks)
        return sinks

    low, high = after(20.0), after(21.0)
    growth = (high.impulse - low.impulse)[:, 2].sum()
    assert low.slope.sum() == pytest.approx(growth, rel=1e-5)


def test_mean_velocity_and_place_of_a_folded_cloud() -> None:
    """A quarter folds four quadrants onto one: the impulse away from the axis is positive."""
    field = gas(
        duct(folds=2), velocity=lambda x: np.stack([5 * x[:, 0], 0 * x[:, 0], 0 * x[:, 0]], 1)
    )
    x = np.array([[s * 0.05, t * 0.03, 0.0] for s in (-1, 1) for t in (-1, 1)])
    parcels = Parcels.release(x, [0, 0, 0], ASH)
    sinks = Sinks.of(field.grid, parcels)
    Tracker([ASH]).advance(parcels, field, until_time=0.01, sinks=sinks)
    assert np.count_nonzero(sinks.residence) == 1
    gain = (parcels.mass_flow * np.abs(parcels.v[:, 0])).sum()
    assert sinks.impulse[:, 0].sum() == pytest.approx(gain, rel=1e-8)
    assert (np.sign(parcels.v[:, 0]) == np.sign(x[:, 0])).all()


# -- the end of a parcel ------------------------------------------------------------------------


def test_every_parcel_is_accounted_for() -> None:
    field = gas(duct(), velocity=[0, 0, 5.0])
    parcels = Parcels.release(spread(400), [0, 0, 5.0], ASH)
    parcels.v[:5] = np.nan
    tracker = Tracker(
        [ASH], Forces(gravity=(0.0, -9.81, 0.0)), impact=Stick(), steps=Steps(max_steps=300)
    )
    tracker.advance(parcels, field, until_z=1.0, leave=True)
    counts = parcels.counts()
    assert counts["inside"] == 0
    assert counts["lost"] == 5
    assert counts["out"] > 50 and counts["deposited"] > 50
    assert sum(counts.values()) == 400


def test_a_parcel_that_gets_nowhere_is_stuck() -> None:
    parcels = Parcels.release(np.zeros((3, 3)), [0, 0, 0], ASH)
    tracker = Tracker([ASH], steps=Steps(max_steps=10, largest=1e-3))
    report = tracker.advance(parcels, gas(duct()), until_z=1.0)
    assert report.steps == 30
    assert parcels.counts()["stuck"] == 3


# -- bad input ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make_it", "key"),
    [
        (lambda: Tracker([]), "particles.materials"),
        (lambda: Tracker([ASH], seed=-1), "particles.seed"),
        (lambda: Tracker([ASH], threads=0), "particles.threads"),
        (lambda: Tracker([ASH], dispersion="langewin"), "particles.dispersion"),
        (lambda: Tracker([ASH], impact={"model": "restitution", "e": 1.1}), "particles.impact.e"),
        (lambda: Steps(eddies=0.0), "particles.steps.eddies"),
        (lambda: Forces(drag="stoke"), "particles.drag"),
        (lambda: Parcels.release(np.zeros((2, 3)), [0, 0], ASH), "parcels.v"),
        (lambda: Parcels.release(np.zeros((2, 3)), [0, 0, 0], ASH, rate=-1), "parcels.rate"),
        (
            lambda: Parcels.release(np.zeros((2, 3)), [0, 0, 0], ASH, diameter=[1e-4]),
            "parcels.diameter",
        ),
        (lambda: Parcels.release(np.full((2, 3), np.nan), [0, 0, 0], ASH), "parcels.x"),
        (lambda: Parcels.from_arrays({}), "parcels.id"),
    ],
)  # fmt: skip
def test_bad_input_is_refused(make_it: Any, key: str) -> None:
    with pytest.raises(InputError) as caught:
        make_it()
    assert caught.value.key == key


def test_needs_one_end_and_one_size_for_odd_drag() -> None:
    field = gas(duct())
    parcels = Parcels.release(np.zeros((2, 3)), [0, 0, 1.0], ASH, diameter=[1e-4, 2e-4])
    with pytest.raises(InputError, match="until"):
        Tracker([ASH]).advance(parcels, field)
    with pytest.raises(InputError, match="several sizes"):
        Tracker([ASH], Forces(drag=ConstantDrag())).advance(parcels, field, until_z=1.0)

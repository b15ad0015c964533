# SPDX-License-Identifier: LGPL-3.0-or-later
"""The tube in time: feed, outlet, balance of the grains, restart, limits."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from fem_tfm.errors import InputError
from fem_tfm.geometry.section import RectangularSection, RoundSection
from fem_tfm.geometry.shapes import Duct, Pipe
from fem_tfm.models.slug.feed import Feed, Feeder, filled, sites
from fem_tfm.models.slug.gas import TubeGas
from fem_tfm.models.slug.grains import Grain, Grains, Walls
from fem_tfm.models.slug.told.slices import Sampler, shares, volume_below
from fem_tfm.models.slug.tube import Conveying, SlugTube, Steps

GAS, GRAIN, TUBE = TubeGas(viscosity=6.73e-5), Grain(937.0, 1.4e-3), RoundSection(7e-3, "none")
FLOW = 2.49 / 3600


def tube(length: float = 0.06, **more: Any) -> SlugTube:
    shape = more.pop("shape", Pipe(7e-3, length=length))
    given = {"gas": GAS, "grain": GRAIN, "conveying": Conveying(1.0, FLOW)} | more
    return SlugTube(shape, **given)


# -- feed ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("section", "number"),
    [(TUBE, 19), (RoundSection(4.2e-3, "none"), 7), (RoundSection(2e-3, "none"), 1)],
)
def test_sites_are_rings_that_do_not_overlap(section: RoundSection, number: int) -> None:
    found = sites(section, 1.4e-3)
    assert len(found) == number
    assert np.hypot(*found.T).max() <= (section.diameter - 1.4e-3) / 2 * (1 + 1e-12)
    apart = np.linalg.norm(found[:, None] - found[None], axis=-1) + np.eye(number)
    assert apart.min() >= 1.4e-3 * (1 - 1e-9)


@pytest.mark.parametrize("size", [(7e-3, 9e-3), (1.5e-3, 1.5e-3), (20e-3, 3e-3)])
def test_sites_of_a_duct_are_rows(size: tuple[float, float]) -> None:
    found = sites(RectangularSection(*size, "none"), 1.4e-3)
    assert len(found) == int(size[0] / 1.4e-3) * int(size[1] / 1.4e-3)
    assert (np.abs(found) <= (np.array(size) - 1.4e-3) / 2 + 1e-12).all()


@pytest.mark.parametrize("section", [TUBE, RectangularSection(8e-3, 6e-3, "none")])
@pytest.mark.parametrize("spread", [0.0, 0.2])
@pytest.mark.parametrize("flow", [FLOW, 0.3 * FLOW, 0.001 * FLOW])
def test_the_feed_has_the_mass_flow(section: Any, spread: float, flow: float) -> None:
    grain = Grain(937.0, 1.4e-3, spread=spread)
    feeder = Feeder(Feed(section, grain, flow, 0.08), seed=3)
    made = Grains(grain, Walls(section, 0.0), 1e-5, release=feeder.feed.release)
    end = 200 * feeder.feed.interval
    for time in np.linspace(0, end, 333, endpoint=False):
        made.core.clear()
        feeder.advance(made, time)
        due = flow * feeder.layers * feeder.feed.interval
        # full layers of small grains leave something to the next ones
        assert abs(feeder.mass - due) <= (0.51 + 10 * spread) * grain.mass
    assert feeder.layers == 200 and feeder.count == made._next


def test_layers_are_a_diameter_apart_whatever_the_steps() -> None:
    feeder = Feeder(Feed(TUBE, GRAIN, FLOW, 0.04))
    made = Grains(GRAIN, Walls(TUBE, 0.0), 1e-5, (0, 0, 0), release=1.0)
    for step in range(300):
        feeder.advance(made, step * 5e-4)
        made.run(50)
    z = np.unique(np.round(made.place[:, 2], 9))
    assert len(z) == feeder.layers == 5
    assert np.diff(z) == pytest.approx(1.4e-3, rel=1e-6)
    assert not made.free.any()


def test_a_feed_that_would_overlap_is_refused() -> None:
    with pytest.raises(
        InputError, match=r"solids_mass_flow.*at most 0.00073.*raise operation.solids_velocity"
    ) as e:
        tube(conveying=Conveying(1.0, 4 * FLOW))
    # the remedy is one
    speed = float(str(e.value).rpartition("to ")[2].split()[0])
    assert tube(conveying=Conveying(1.0, 4 * FLOW, 1.01 * speed)).feeder.count == 0


def test_a_feed_that_no_speed_brings_in_is_told_so() -> None:
    with pytest.raises(InputError, match=r"not even the fastest feed, 1\.4 m/s") as caught:
        tube(conveying=Conveying(1.0, 1.0))
    most = float(str(caught.value).rpartition("than ")[2].split()[0])
    assert tube(conveying=Conveying(1.0, 0.99 * most, 1.399)).fed == 0
    with pytest.raises(InputError, match=r"solids_velocity.*at most 1\.4 m/s.*gas_step"):
        tube(conveying=Conveying(1.0, FLOW, 50.0))


@pytest.mark.parametrize(
    ("diameter", "steps", "key"),
    [
        (1.4e-3, {"cells_across": 6}, "cells_across"),
        (1.4e-3, {"cells_along": 200}, "cells_along"),
        (3e-3, {}, "cells_along"),
        (6e-3, {"cells_across": 4}, "cells_along"),
    ],
)
def test_cells_hardly_larger_than_a_grain_are_refused_with_the_remedy(
    diameter: float, steps: dict[str, int], key: str
) -> None:
    grain, steps = Grain(937.0, diameter), {"cells_across": 2, "averaging_width": 0.0} | steps
    with pytest.raises(InputError) as caught:
        tube(grain=grain, conveying=Conveying(1.0, 1e-5), steps=Steps(**steps))
    assert caught.value.key == f"numerics.{key}"
    number = caught.value.allowed.removeprefix("at most ").partition(",")[0].partition(" ")[0]
    # what is told can be done
    done = steps | {key: int(number)} | ({"cells_across": 2} if key == "cells_along" else {})
    tube(grain=grain, conveying=Conveying(1.0, 1e-5), steps=Steps(**done))


def test_a_filled_tube_is_full_of_layers() -> None:
    place, radius = filled(TUBE, GRAIN, 0.05)
    assert len(place) == 19 * 35 == len(radius)
    solids = len(place) * GRAIN.mass / GRAIN.density / (TUBE.area * 0.05)
    assert 0.45 < solids < 0.55


# -- the tube --------------------------------------------------------------------------------------


@pytest.mark.parametrize("full", [False, True])
def test_no_grain_is_lost(full: bool) -> None:
    made = tube(0.03, full=full, conveying=Conveying(3.0, FLOW, 0.08))
    counts = []
    for _ in range(12):
        made.run(made.time + 0.05)
        assert made.start + made.fed == made.grains.count + made.out
        counts.append(made.out)
    assert counts[-1] > 50 and (made.start > 0) == full
    number = made.grains.number
    assert len(set(number)) == len(number) and number.max() < made.start + made.fed


def test_grains_stay_in_the_tube() -> None:
    made = tube(0.03)
    made.run(0.5)
    x = made.grains.place
    assert np.hypot(x[:, 0], x[:, 1]).max() < (7e-3 - 1.4e-3) / 2 + 0.02 * 1.4e-3
    assert x[:, 2].min() > -0.71e-3 and x[:, 2].max() <= 0.03


@pytest.mark.parametrize("contact", ["viscous-coulomb", "cundall-strack"])
def test_a_restart_has_the_same_bits(contact: str, tmp_path: Any) -> None:
    grain = Grain(937.0, 1.4e-3, contact=contact, spread=0.1)
    given = {"grain": grain, "conveying": Conveying(2.0, 0.5 * FLOW)}
    made, again = tube(0.03, **given), tube(0.03, **given, seed=9)
    made.run(0.2)
    np.savez(tmp_path / "state.npz", **made.state())
    made.run(0.4)
    with np.load(tmp_path / "state.npz") as state:
        again.restore(dict(state))
    again.run(0.4)
    one, other = made.state(), again.state()
    assert one.keys() == other.keys() and made.out == again.out > 0
    assert all(np.array_equal(one[k], other[k]) for k in one)


def test_threads_do_not_change_a_bit() -> None:
    states = []
    for threads in (1, 2):
        made = tube(0.06, full=True, steps=Steps(threads=threads))
        made.run(0.01)
        assert made.grains.count > 512
        states.append(made.state())
    assert all(np.array_equal(states[0][k], states[1][k]) for k in states[0])


def fluidised(velocity: float, law: str) -> float:
    """Weight of a standing bed that its floor still bears, over the weight."""
    gas = TubeGas(viscosity=1.8e-5, density=1.2, permeability=law)
    # the feed is off: gas alone comes in through the floor
    made = tube(
        0.1,
        shape=Pipe(7e-3, length=0.1, inclination_deg=90.0),
        gas=gas,
        grain=Grain(
            937.0,
            1.4e-3,
            contact="viscous-coulomb",
            wall={"model": "viscous-coulomb", "friction": 0.0},
        ),
        conveying=Conveying(velocity, 0.0),
    )
    place, radius = filled(TUBE, GRAIN, 0.03)
    made.grains.add(place, (0.0, 0.0, 0.0), radius)
    made.start = len(place)
    made.run(0.35)
    borne = []
    for _ in range(100):
        made.step()
        borne.append(made.grains.wall_force[:, 2].sum())
    return float(np.mean(borne) / (made.grains.mass.sum() * 9.81))


def test_a_bed_is_fluidised_at_the_velocity_of_ergun() -> None:
    """(rho_s) (1 - f) g = 150 eta (1-f)^2 U/(d^2 f^3) + 1.75 rho (1-f) U^2/(d f^3)."""
    made = tube(
        0.1, conveying=Conveying(0.0, 0.0), shape=Pipe(7e-3, length=0.1, inclination_deg=90)
    )
    place, radius = filled(TUBE, GRAIN, 0.03)
    made.grains.add(place, (0.0, 0.0, 0.0), radius)
    made.run(0.2)
    top = np.sort(made.grains.place[:, 2])[-20:].mean() + 0.7e-3
    f = 1 - len(place) * GRAIN.mass / GRAIN.density / (TUBE.area * top)
    a = 150 * (1 - f) * 1.8e-5 / (1.4e-3**2 * f**3)
    b = 1.75 * 1.2 / (1.4e-3 * f**3)
    velocity = (-a + math.sqrt(a**2 + 4 * b * 937.0 * 9.81)) / (2 * b)
    # what the gas carries grows as Ergun's pressure drop does
    half = (a * velocity / 2 + b * velocity**2 / 4) / (937.0 * 9.81)
    assert fluidised(velocity / 2, "ergun") == pytest.approx(1 - half, abs=0.12)
    assert fluidised(1.3 * velocity, "ergun") < 0.08


def test_the_pressure_drop_does_not_depend_on_the_reference_pressure() -> None:
    """Means over runs that differ by a last digit of the viscosity, which scatter by 2 %."""
    drops = []
    for reference in (101325.0, 405300.0):
        for digit in range(5):
            gas = TubeGas(viscosity=6.73e-5 * (1 + 1e-9 * digit), reference_pressure=reference)
            made = tube(0.03, gas=gas)
            sampler = Sampler(made)
            made.run(0.4, sampler)
            drops.append(np.mean(sampler.samples.drop))
    assert np.mean(drops[:5]) == pytest.approx(np.mean(drops[5:]), rel=0.04)


def test_a_duct_conveys_too() -> None:
    made = tube(shape=Duct(7e-3, 6e-3, length=0.03, inclination_deg=30.0))
    made.run(0.15)
    assert made.grains.count + made.out == made.fed > 50
    assert made.gas.drop > 0


# -- samples ---------------------------------------------------------------------------------------


def test_slices_share_the_volume_of_a_sphere() -> None:
    radius = np.array([0.7e-3, 0.7e-3, 2e-3])
    z = np.array([1.75e-3, 3.5e-3, 5.1e-3])
    edges = np.linspace(0.0, 10.5e-3, 4)
    number, volume = shares(z, radius, edges)
    full = 4 / 3 * np.pi * radius**3
    assert volume.sum(axis=1) == pytest.approx(full, rel=1e-12)
    assert volume[0].max() == pytest.approx(full[0])
    assert np.bincount(number[1], volume[1])[:2] == pytest.approx(full[1] / 2)
    assert volume_below(np.array([0.0]), np.array([1.0]))[0] == pytest.approx(2 * np.pi / 3)


def test_samples_hold_all_grains_and_all_forces() -> None:
    made = tube(0.0595)
    sampler = Sampler(made)
    made.run(0.3, sampler)
    s = sampler.samples
    assert len(s.time) == 30 and s.time[-1] == pytest.approx(0.3)
    width = s.edges[1] - s.edges[0]
    inside = s.solids[-1].sum() * width * s.area / s.grain_volume
    # the layer at the inlet is half outside
    assert made.grains.count - 10 <= inside <= made.grains.count
    # the part of each grain that is in the tube
    full = GRAIN.mass / GRAIN.density
    part = shares(made.grains.place[:, 2], made.grains.radius, s.edges)[1].sum(axis=1) / full
    volume = width * s.area
    momentum = part @ made.grains.velocity * full
    assert s.flux[-1].sum(axis=0) * volume == pytest.approx(momentum, rel=1e-9, abs=1e-20)
    pressing = part @ made.grains.wall_pressing
    assert s.wall_stress[-1].sum() * width * TUBE.perimeter == pytest.approx(pressing, rel=1e-9)
    drag = part @ made.grains.gas_force[:, 2]
    assert s.drag[-1].sum() * volume == pytest.approx(drag, rel=1e-9) != 0.0


# -- bad input -------------------------------------------------------------------------------------


def test_a_tube_that_is_too_narrow_is_refused() -> None:
    with pytest.raises(InputError, match="largest grain's diameter"):
        tube(shape=Pipe(1.4e-3, length=0.1))


def test_a_time_step_that_is_too_long_is_refused() -> None:
    with pytest.raises(InputError, match=r"numerics\.time_step"):
        tube(steps=Steps(time_step=1e-4))


def test_the_step_fits_the_gas_step() -> None:
    made = tube(steps=Steps(time_step=1.9e-5, gas_step=4e-4))
    assert made.inner_steps == 22
    assert made.grains.time_step == pytest.approx(4e-4 / 22)

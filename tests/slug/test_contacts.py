# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts of grains: the kernel against the laws' formulas, and against closed forms."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fem_tfm import closures
from fem_tfm._kernel import grains as kernel
from fem_tfm.closures.contacts import CundallStrack, HertzMindlin, Touch, ViscousCoulomb
from fem_tfm.errors import InputError
from fem_tfm.geometry.section import RectangularSection, RoundSection
from fem_tfm.models.slug.grains import Grain, Grains, Walls

LAWS = [ViscousCoulomb(), CundallStrack(), HertzMindlin()]
NAMES = [law.name for law in LAWS]
DIAMETER, DENSITY, STEP = 1.4e-3, 937.0, 1e-5
FREE = (0.0, 0.0, 0.0)


def grain(law: Any, **more: Any) -> Grain:
    return Grain(DENSITY, DIAMETER, contact=law, **more)


@pytest.fixture(params=kernel.instruction_sets())
def instructions(request: pytest.FixtureRequest) -> Any:
    """Each instruction set of this machine in turn."""
    before = kernel.instruction_set()
    kernel.use_instruction_set(request.param)
    yield request.param
    kernel.use_instruction_set(before)


# -- the kernel computes what the laws say ---------------------------------------------------------


def cloud(law: Any, spread: float, count: int = 40) -> Grains:
    """Pairs of overlapping grains in all directions, with velocities and spins."""
    random = np.random.default_rng(5)
    made = Grains(grain(law, spread=spread), Walls(), STEP, FREE)
    radius = made.grain.radii(2 * count, random).reshape(count, 2)
    place = np.zeros((count, 2, 3))
    place[:, 0, 2] = 5 * DIAMETER * np.arange(count)
    way = random.normal(size=(count, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    apart = radius.sum(axis=1) - DIAMETER * random.uniform(0.005, 0.02, count)
    place[:, 1] = place[:, 0] + apart[:, None] * way
    made.add(place.reshape(-1, 3), FREE, radius.ravel())
    made.set_velocity(
        random.normal(size=(2 * count, 3)) * 0.05, random.normal(size=(2 * count, 3)) * 100
    )
    return made


def by_number(made: Grains, values: np.ndarray) -> np.ndarray:
    return values[np.argsort(made.number)].reshape(-1, 2, *values.shape[1:])


@pytest.mark.parametrize("rolling", [0.0, 0.3])
@pytest.mark.parametrize("spread", [0.0, 0.3])
@pytest.mark.parametrize("law", LAWS, ids=NAMES)
def test_pairs_move_as_the_law_says(
    law: Any, spread: float, rolling: float, instructions: str
) -> None:
    law = replace(law, rolling_friction=rolling)
    made = cloud(law, spread)
    mass, radius = by_number(made, made.mass), by_number(made, made.radius)
    springs = np.zeros((len(mass), 3))
    # the second step finds springs that the first one has loaded
    for _ in range(2):
        x, v = by_number(made, made.place), by_number(made, made.velocity)
        w = by_number(made, made.spin)
        away = x[:, 0] - x[:, 1]
        distance = np.linalg.norm(away, axis=1)
        touch = Touch(
            radius.sum(axis=1) - distance,
            away / distance[:, None],
            v[:, 0] - v[:, 1],
            (radius[:, :, None] * w).sum(axis=1),
            mass.prod(axis=1) / mass.sum(axis=1),
            radius.prod(axis=1) / radius.sum(axis=1),
        )
        c = made.coefficients
        force, turn, normal, springs = law.force(touch, c, springs, STEP)
        torque = law.rolling_torque(touch, c, w[:, 0] - w[:, 1], normal)
        made.run(1)
        after, spun = by_number(made, made.velocity), by_number(made, made.spin)
        assert np.allclose(
            (after[:, 0] - v[:, 0]) * mass[:, :1], STEP * force, rtol=1e-11, atol=1e-22
        )
        assert np.allclose(
            (after[:, 1] - v[:, 1]) * mass[:, 1:], -STEP * force, rtol=1e-11, atol=1e-22
        )
        inertia = 0.4 * mass * radius**2
        for k, sign in ((0, 1), (1, -1)):
            moment = radius[:, k, None] * turn + sign * torque
            change = (spun[:, k] - w[:, k]) * inertia[:, k, None]
            assert np.allclose(change, STEP * moment, rtol=1e-9, atol=1e-25)


@pytest.mark.parametrize("law", LAWS, ids=NAMES)
def test_walls_push_as_the_law_says(law: Any, instructions: str) -> None:
    tube = RoundSection(7e-3, "none")
    made = Grains(grain(law), Walls(tube), STEP, FREE)
    random = np.random.default_rng(1)
    angle = random.uniform(0, 2 * math.pi, 30)
    reach = 7e-3 / 2 - DIAMETER / 2 + DIAMETER * random.uniform(0.001, 0.01, 30)
    z = 2 * DIAMETER * np.arange(30)
    x = np.stack([reach * np.cos(angle), reach * np.sin(angle), z], axis=-1)
    made.add(x)
    v, w = random.normal(size=(30, 3)) * 0.05, random.normal(size=(30, 3)) * 100
    made.set_velocity(v, w)
    order = made.number
    x, v, w = x[order], v[order], w[order]
    rho = np.hypot(x[:, 0], x[:, 1])
    inward = np.stack([-x[:, 0] / rho, -x[:, 1] / rho, 0 * rho], axis=-1)
    r, mass = np.full(30, DIAMETER / 2), made.mass
    touch = Touch(rho + r - 7e-3 / 2, inward, v, r[:, None] * w, mass, r)
    c = law.coefficients(made.grain.mass, STEP)
    force, _, normal, _ = law.force(touch, c, np.zeros((30, 3)), STEP)
    made.record()
    assert (made.number == order).all()
    assert np.allclose(made.wall_force, force, rtol=1e-10, atol=1e-18)
    assert np.allclose(made.wall_pressing, normal, rtol=1e-10, atol=1e-18)
    assert np.allclose(made.velocity - v, STEP * force / mass[:, None], rtol=1e-9, atol=1e-15)


# -- collisions ------------------------------------------------------------------------------------


def bounce(law: Any, speed: float, step: float, phases: int = 16) -> float:
    """Restitution of head-on collisions, the mean over the phases of a step."""
    made = Grains(grain(law), Walls(), step, FREE)
    z = 10 * DIAMETER * np.arange(phases)
    gap = 2 * speed * step * (np.arange(phases) + 0.5) / phases
    low = np.stack([0 * z, 0 * z, z], axis=-1)
    high = low + np.array([0, 0, DIAMETER]) + gap[:, None] * np.array([0, 0, 1])
    made.add(low, (0, 0, speed))
    made.add(high, (0, 0, -speed))
    made.run(int(4 * law.contact_time(made.grain.mass / 2, DIAMETER / 4) / step))
    return float(np.abs(made.velocity[:, 2]).mean() / speed)


@pytest.mark.parametrize("asked", [0.1, 0.3, 0.5, 0.7, 0.9, 0.99])
@pytest.mark.parametrize("step", [1e-5, 2e-5])
def test_restitution_is_the_one_asked_for(asked: float, step: float) -> None:
    law = ViscousCoulomb(restitution=asked)
    assert bounce(law, 0.05, step) == pytest.approx(asked, abs=1e-3)


@pytest.mark.parametrize("asked", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("speed", [0.02, 0.2])
def test_restitution_of_hertz_does_not_depend_on_the_speed(asked: float, speed: float) -> None:
    law = HertzMindlin(restitution=asked)
    assert bounce(law, speed, 2e-6) == pytest.approx(asked, abs=4e-3)


def test_a_collision_takes_the_time_that_the_law_tells() -> None:
    for law in (ViscousCoulomb(restitution=1.0), HertzMindlin(restitution=1.0, impact_speed=0.1)):
        step = 1e-6
        made = Grains(grain(law), Walls(), step, FREE)
        made.add([[0, 0, 0], [0, 0, DIAMETER]])
        made.set_velocity([[0, 0, 0.05], [0, 0, -0.05]])
        made.run(1)
        steps = 1
        while np.ptp(made.place[:, 2]) < DIAMETER:
            made.run(1)
            steps += 1
        told = law.contact_time(made.grain.mass / 2, DIAMETER / 4)
        assert steps * step == pytest.approx(told, rel=0.01)


# -- one grain on a plane --------------------------------------------------------------------------

PLANE = Walls(RectangularSection(1.0, 0.1, "none"))


def on_plane(law: Any, slope_deg: float, speed: float = 0.0) -> Grains:
    """A grain on the floor, with gravity tilted towards z."""
    slope = math.radians(slope_deg)
    gravity = (0.0, -9.81 * math.cos(slope), 9.81 * math.sin(slope))
    made = Grains(grain(law), PLANE, STEP, gravity)
    sunk = made.grain.mass * 9.81 * math.cos(slope) / 100.0
    made.add([[0.0, -0.05 + DIAMETER / 2 - sunk, 0.0]], (0.0, 0.0, speed))
    return made


@pytest.mark.parametrize("law", [LAWS[0], LAWS[1]], ids=NAMES[:2])
def test_a_grain_rolls_down_a_gentle_slope(law: Any) -> None:
    made = on_plane(replace(law, friction=0.5), 20.0)
    made.run(5000)
    expected = 5 / 7 * 9.81 * math.sin(math.radians(20.0)) * 5000 * STEP
    assert made.velocity[0, 2] == pytest.approx(expected, rel=2e-3)
    assert made.spin[0, 0] * DIAMETER / 2 == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("law", LAWS, ids=NAMES)
def test_a_grain_slides_down_a_steep_slope(law: Any) -> None:
    made = on_plane(replace(law, friction=0.1), 50.0)
    made.run(5000)
    slope = math.radians(50.0)
    expected = 9.81 * (math.sin(slope) - 0.1 * math.cos(slope)) * 5000 * STEP
    assert made.velocity[0, 2] == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("law", [LAWS[0], LAWS[1]], ids=NAMES[:2])
def test_a_sliding_grain_begins_to_roll(law: Any) -> None:
    made = on_plane(replace(law, friction=0.3), 0.0, speed=0.2)
    until = 2 * 0.2 / (7 * 0.3 * 9.81)
    made.run(int(0.5 * until / STEP))
    assert made.velocity[0, 2] == pytest.approx(0.2 - 0.3 * 9.81 * 0.5 * until, rel=2e-3)
    made.run(int(1.0 * until / STEP))
    assert made.velocity[0, 2] == pytest.approx(5 / 7 * 0.2, rel=2e-3)


@pytest.mark.parametrize("law", [LAWS[0], LAWS[1]], ids=NAMES[:2])
def test_rolling_friction_stops_a_grain(law: Any) -> None:
    made = on_plane(replace(law, friction=0.5, rolling_friction=0.05), 0.0, speed=0.1)
    made.set_velocity([[0, 0, 0.1]], [[0.1 / (DIAMETER / 2), 0, 0]])
    made.run(5000)
    assert made.velocity[0, 2] == pytest.approx(0.1 - 0.05 * 9.81 / 1.4 * 0.05, rel=5e-3)
    made.run(40000)
    assert abs(made.velocity[0, 2]) < 1e-4


def test_a_grain_with_rolling_friction_creeps_down_a_gentle_slope() -> None:
    """Rolling friction is viscous below its limit, so that the speed balances the weight."""
    law = CundallStrack(friction=0.5, rolling_friction=0.5)
    made = on_plane(law, 15.0)
    made.run(20000)
    mass = made.grain.mass
    damping = law.coefficients(mass, STEP).rolling_damping * math.sqrt(mass * law.stiffness)
    expected = mass * 9.81 * math.sin(math.radians(15.0)) / damping
    assert made.velocity[0, 2] == pytest.approx(expected, rel=0.02)
    assert made.velocity[0, 2] < 1e-3


# -- bad input -------------------------------------------------------------------------------------


def test_a_time_step_beyond_the_contact_time_is_refused() -> None:
    with pytest.raises(
        InputError, match=r"numerics.time_step = 0.0001 .*contact's time of 0.00025"
    ):
        Grains(grain("viscous-coulomb"), Walls(), 1e-4, FREE)
    stiff = grain(ViscousCoulomb(stiffness=1e4))
    with pytest.raises(InputError, match="softer contact"):
        Grains(stiff, Walls(), 1e-5, FREE)


def test_a_step_at_which_friction_is_unstable_is_refused() -> None:
    with pytest.raises(InputError, match="tangential damping"):
        Grains(grain(ViscousCoulomb(tangential_damping=5.0)), Walls(), 1e-5, FREE)


def test_a_tube_narrower_than_a_grain_is_refused() -> None:
    for section in (RoundSection(1.4e-3, "none"), RectangularSection(7e-3, 1e-3, "none")):
        with pytest.raises(InputError, match="largest grain"):
            Grains(grain("viscous-coulomb"), Walls(section), STEP)


def test_overlapping_grains_are_refused() -> None:
    made = Grains(grain("viscous-coulomb"), Walls(), STEP)
    with pytest.raises(InputError, match="leave more room"):
        made.add([[0, 0, 0], [0, 0, 0.9 * DIAMETER]])


def test_wall_and_grains_share_a_law() -> None:
    with pytest.raises(InputError, match="the same law as between grains"):
        Grain(DENSITY, DIAMETER, wall="cundall-strack")


def test_every_law_of_contact_is_tested() -> None:
    assert set(closures.names("contact")) == set(NAMES)
    assert len(set(itertools.chain(law.kind for law in LAWS))) == len(LAWS)

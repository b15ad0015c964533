# SPDX-License-Identifier: LGPL-3.0-or-later
"""Averages of the grains: what they keep, how far they reach, and that the mesh does not matter."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest

from fem_tfm.geometry.section import RectangularSection, RoundSection, Section
from fem_tfm.models.slug.averaging import Averaging
from fem_tfm.models.slug.feed import filled
from fem_tfm.models.slug.gas import TubeGas
from fem_tfm.models.slug.grains import Grain, Grains, Walls
from fem_tfm.models.slug.mesh import TubeMesh, tube_mesh
from fem_tfm.models.slug.pressure import GasPressure

DIAMETER, VISCOSITY, LENGTH = 1.4e-3, 6.73e-5, 0.07
TUBE, DUCT = RoundSection(7e-3, "none"), RectangularSection(6e-3, 8e-3, "none")


@functools.cache
def mesh(section: Section, across: int, layers: int) -> TubeMesh:
    return TubeMesh(tube_mesh(section, LENGTH, across, layers))


@pytest.mark.parametrize("section", [TUBE, DUCT])
@pytest.mark.parametrize("width", [0.8, 1.0, 3.0])
def test_an_average_keeps_the_volume_and_a_uniform_bed(section: Section, width: float) -> None:
    tube = mesh(section, 4, 40)
    average = Averaging(tube, width * DIAMETER)
    amount = np.random.default_rng(0).random((tube.size, 4))
    assert np.allclose(average.spread(amount).sum(axis=0), amount.sum(axis=0), rtol=1e-12)
    assert np.allclose(average(np.full(tube.size, 0.4)), 0.4, rtol=1e-12)
    # what grains give and what they take have the same weights
    a, b = amount.T[:2]
    assert average(a) @ b == pytest.approx(a @ average.spread(b), rel=1e-12)
    rough = np.std(amount[:, 0] / tube.volumes)
    assert np.std(average(amount[:, 0] / tube.volumes)) < 0.9 * rough


@pytest.mark.parametrize(("across", "layers"), [(8, 32), (12, 40), (8, 48)])
def test_one_grain_is_seen_as_wide_as_is_asked_for(across: int, layers: int) -> None:
    """Mean second moments of what grains become, away from walls in a duct wide enough for it."""
    tube, width = mesh(RectangularSection(0.02, 0.02, "none"), across, layers), 2.2e-3
    average, second = Averaging(tube, width), []
    at = np.stack([tube.value(x) for x in tube.points.T], axis=-1)
    for x in np.random.default_rng(0).uniform(-1, 1, (200, 3)) * (1.25e-3, 1.25e-3, 0.01):
        made = Grains(Grain(937.0, DIAMETER), Walls(), 1e-5)
        made.add(x + np.array([0.0, 0.0, LENGTH / 2]))
        volume = average.spread(tube.spread(made)[0])
        # of the field, not of its nodal values
        share = tube.value(volume / tube.volumes) * tube.weights / made.mass[0] * 937.0
        assert np.einsum("cqp,cqpd->d", share, at) == pytest.approx(made.place[0], abs=2e-5)
        second.append(np.einsum("cqp,cqpd->d", share, (at - made.place[0]) ** 2))
    assert np.sqrt(np.mean(second, axis=0)) == pytest.approx(width, rel=0.02)


def test_a_mesh_too_coarse_for_a_width_is_left_as_it_is() -> None:
    tube = mesh(TUBE, 2, 20)
    amount = np.random.default_rng(0).random(tube.size)
    assert np.allclose(Averaging(tube, 0.5 * DIAMETER).spread(amount), amount, rtol=1e-14)


@functools.cache
def bed() -> Grains:
    """Half a tube: layers of grains below a slope."""
    place, radius = filled(TUBE, Grain(937.0, DIAMETER), LENGTH - DIAMETER, 1)
    place[:, 2] += DIAMETER / 2
    kept = place[:, 1] < 3e-3 * np.cos(2 * math.pi * place[:, 2] / LENGTH) + 1e-3
    made = Grains(Grain(937.0, DIAMETER), Walls(TUBE), 1e-5)
    made.add(place[kept], (0.0, 0.0, 0.1), radius[kept])
    return made


def drop(across: int, layers: int, width: float) -> float:
    gas = TubeGas(viscosity=VISCOSITY)
    field = GasPressure(mesh(TUBE, across, layers), gas, DIAMETER, width * DIAMETER)
    field.take(bed())
    for _ in range(4):
        field.step(1.0, 1.0)
    return field.drop


def test_the_drop_over_a_bed_does_not_depend_on_the_mesh() -> None:
    fine = drop(6, 60, 1.25)
    assert drop(4, 20, 1.25) == pytest.approx(fine, rel=0.06)
    assert drop(4, 40, 1.25) == pytest.approx(fine, rel=0.02)


def test_without_an_average_gas_slips_between_grains_on_a_fine_mesh() -> None:
    assert drop(6, 60, 0.0) < 0.5 * drop(2, 20, 0.0)


def test_the_forces_of_averages_are_exchanged_without_loss() -> None:
    gas = TubeGas(viscosity=VISCOSITY)
    field = GasPressure(mesh(TUBE, 4, 40), gas, DIAMETER, 1.0 * DIAMETER)
    made = bed()
    for _ in range(2):
        field.take(made)
        field.step(5e-4, 1.0)
    field.push(made)
    gained, lost = made.gas_force.sum(axis=0), field.nodal_force()[field.solids > 0].sum(axis=0)
    assert lost[2] > 0
    assert np.abs(gained - lost).max() < 1e-12 * lost[2]

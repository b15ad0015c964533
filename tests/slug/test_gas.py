# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pressure of the gas: tables against UFL, exact solutions, exchange with the grains."""

from __future__ import annotations

import functools
import itertools
import math
from typing import Any

import numpy as np
import pytest
from dolfinx import geometry
from tables import check_tables

from fem_tfm.closures.drag import Ergun
from fem_tfm.closures.permeability import CarmanKozeny, ErgunPermeability
from fem_tfm.errors import InputError
from fem_tfm.geometry.section import RectangularSection, RoundSection, Section
from fem_tfm.materials import Gas, Solids
from fem_tfm.models.slug.gas import TubeGas
from fem_tfm.models.slug.grains import Grain, Grains, Walls
from fem_tfm.models.slug.mesh import TubeMesh, tube_mesh
from fem_tfm.models.slug.pressure import GasPressure

DIAMETER, VISCOSITY, LENGTH = 1.4e-3, 6.73e-5, 0.07
TUBE, DUCT = RoundSection(7e-3, "none"), RectangularSection(6e-3, 8e-3, "none")


@functools.cache
def mesh(section: Section, across: int = 2, layers: int = 20) -> TubeMesh:
    return TubeMesh(tube_mesh(section, LENGTH, across, layers))


def pressure(section: Section = TUBE, across: int = 2, layers: int = 20, **gas: Any) -> GasPressure:
    return GasPressure(mesh(section, across, layers), TubeGas(viscosity=VISCOSITY, **gas), DIAMETER)


def packed(field: GasPressure, solids: Any, velocity: float = 0.0) -> None:
    """Give the nodes a fraction of solids and a velocity of the grains along the tube."""
    volume = solids * field.tube.volumes
    momentum = np.zeros((len(volume), 3))
    momentum[:, 2] = velocity * volume
    field.set_grains(volume, momentum)


def scatter(section: Section, count: int = 300) -> Grains:
    """Grains anywhere in the tube, some before its inlet."""
    random = np.random.default_rng(2)
    made = Grains(Grain(937.0, DIAMETER, spread=0.2), Walls(section), 1e-5)
    size = min(section.size) / 2 - DIAMETER
    angle, rho = random.uniform(0, 2 * math.pi, count), size * np.sqrt(random.random(count))
    z = random.uniform(-DIAMETER / 2, LENGTH, count)
    x = np.stack([rho * np.cos(angle), rho * np.sin(angle), z], axis=-1)
    for place, radius in zip(x, made.grain.radii(count, random), strict=True):
        made.add(place, random.normal(size=3), radius)
    return made


# -- the mesh --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("section", "across"), [(TUBE, 1), (TUBE, 2), (TUBE, 4), (DUCT, 2), (DUCT, 4)]
)
def test_the_mesh_has_the_volume_of_the_tube(section: Section, across: int) -> None:
    tube = mesh(section, across)
    assert tube.volumes.sum() == pytest.approx(section.area * LENGTH, rel=1e-12)
    assert tube.size == 21 * (across + 1) ** 2 or section is not TUBE
    assert tube.length == pytest.approx(LENGTH)


@pytest.mark.parametrize(("section", "across"), [(TUBE, 1), (TUBE, 2), (TUBE, 4), (DUCT, 2)])
def test_weights_are_the_basis_functions(section: Section, across: int) -> None:
    tube, made = mesh(section, across), scatter(section)
    tube.tents.locate(made.core)
    node, weight = tube.tents.weights()
    random = np.random.default_rng(0)
    values = random.normal(size=tube.size)
    function, x = tube.function(values), made.place
    inside = x[:, 2] >= 0
    assert 0 < inside.sum() < len(x)
    assert (node[~inside] == -1).all() and (weight[~inside] == 0).all()
    x, node, weight = x[inside], node[inside], weight[inside]
    mesh_ = tube.mesh.mesh
    tree = geometry.bb_tree(mesh_, 3)
    found = geometry.compute_colliding_cells(mesh_, geometry.compute_collisions_points(tree, x), x)
    cells = np.array([found.links(n)[0] for n in range(len(x))])
    expected = function.eval(x, cells)[:, 0]
    assert np.allclose((weight * values[node]).sum(axis=1), expected, atol=1e-12)
    assert np.allclose(weight.sum(axis=1), 1.0, atol=1e-14)


def test_grains_give_their_volume_and_momentum_to_the_nodes() -> None:
    tube, made = mesh(TUBE), scatter(TUBE)
    volume, momentum = tube.spread(made)
    inside = made.place[:, 2] >= 0
    own = 4 / 3 * math.pi * made.radius[inside] ** 3
    assert volume.sum() == pytest.approx(own.sum(), rel=1e-13)
    expected = (own[:, None] * made.velocity[inside]).sum(axis=0)
    assert np.allclose(momentum.sum(axis=0), expected, rtol=1e-12)


# -- the tables are the forms ----------------------------------------------------------------------


@pytest.mark.parametrize("law", ["carman-kozeny", "ergun"])
@pytest.mark.parametrize("balance", ["linear", "full"])
@pytest.mark.parametrize(("section", "across"), [(TUBE, 1), (TUBE, 2), (TUBE, 4), (DUCT, 2)])
def test_matrices_by_values_are_those_that_dolfinx_assembles(
    section: Section, across: int, balance: str, law: str
) -> None:
    field = pressure(section, across, 5, balance=balance, permeability=law)
    check_tables(field)
    assert field._inlet.sum() == pytest.approx(section.area, rel=1e-12)


# -- exact solutions -------------------------------------------------------------------------------


def settle(field: GasPressure, inflow: float, step: float = 1.0) -> None:
    for _ in range(30):
        field.step(step, inflow)


@pytest.mark.parametrize("section", [TUBE, DUCT])
def test_a_plug_at_rest_resists_as_carman_and_kozeny_say(section: Section) -> None:
    field = pressure(section)
    packed(field, 0.55)
    settle(field, 0.1)
    kappa = DIAMETER**2 * 0.45**3 / (180 * 0.55**2)
    wall = 8 * VISCOSITY / (section.hydraulic_diameter / 2) ** 2
    assert field.drop == pytest.approx((VISCOSITY / kappa + wall) * 0.1 * LENGTH, rel=1e-6)
    # the wall of the tube bears 1 % of it
    assert field.drop == pytest.approx(VISCOSITY / kappa * 0.1 * LENGTH, rel=0.02)


def test_the_empty_tube_resists_as_poiseuille_says() -> None:
    field = pressure()
    settle(field, 2.0)
    assert field.drop == pytest.approx(8 * VISCOSITY / 3.5e-3**2 * 2.0 * LENGTH, rel=1e-9)


def test_a_plug_that_moves_with_the_gas_has_no_pressure_drop() -> None:
    field = pressure()
    packed(field, 0.55, velocity=0.3)
    settle(field, 0.3)
    at_rest = pressure()
    packed(at_rest, 0.55)
    settle(at_rest, 0.3)
    assert abs(field.drop) < 1e-9 * at_rest.drop


def test_the_inertial_part_is_that_of_ergun() -> None:
    field = pressure(permeability="ergun", density=1.2)
    packed(field, 0.6)
    settle(field, 1.5)
    viscous = 150 * 0.6**2 * VISCOSITY / (0.4**3 * DIAMETER**2)
    inertial = 1.75 * 1.2 * 0.6 / (0.4**3 * DIAMETER)
    wall = 8 * VISCOSITY / 3.5e-3**2
    expected = (viscous + wall + inertial * 1.5) * 1.5 * LENGTH
    assert inertial * 1.5 > 0.5 * viscous
    assert field.drop == pytest.approx(expected, rel=1e-6)


def test_the_bed_resists_as_ergun_drag_does() -> None:
    """-f grad P = beta (v_g - u) and q = f (v_g - u) give the resistance beta/f^2."""
    gas, beads = Gas(1.2, VISCOSITY), Solids(937.0, DIAMETER)
    for porosity in (0.4, 0.5, 0.7):
        a, b = ErgunPermeability().resistance(porosity, gas, DIAMETER)
        slip = 0.8
        beta = Ergun().beta(1 - porosity, slip, gas, beads)
        assert a + b * porosity * slip == pytest.approx(beta / porosity**2, rel=1e-12)


def test_carman_kozeny_is_the_printed_permeability() -> None:
    gas = Gas(1.2, VISCOSITY)
    a, b = CarmanKozeny().resistance(0.5, gas, DIAMETER)
    assert VISCOSITY / a == pytest.approx(DIAMETER**2 * 0.5**3 / (180 * 0.5**2)) and b == 0


def diffused(layers: int, step: float, end: float = 6e-4) -> float:
    """Error of a mode that decays in a packed tube, closed at the inlet, over its amplitude."""
    field = pressure(layers=layers)
    packed(field, 0.55)
    wave = math.pi / (2 * LENGTH)
    field.pressure = np.cos(wave * field.tube.points[:, 2])
    field.pressure[field.band.unknowns :] = 0.0
    steps = round(end / step)
    for _ in range(steps):
        field.step(step, 0.0)
    mobility = field.coefficients(field.pressure)[0][0, 0, 0]
    rate = mobility / 0.45 * wave**2
    expected = math.exp(-rate * steps * step) * np.cos(wave * field.tube.points[:, 2])
    return float(np.abs(field.pressure - expected).max())


def test_diffusion_is_of_second_order_in_time() -> None:
    errors = [diffused(160, step) for step in (4e-5, 2e-5, 1e-5)]
    assert errors[0] > 1e-4
    for coarse, fine in itertools.pairwise(errors):
        assert math.log2(coarse / fine) > 1.75


def test_diffusion_is_of_second_order_in_space() -> None:
    errors = [diffused(layers, 1e-6) for layers in (3, 6, 12)]
    for coarse, fine in itertools.pairwise(errors):
        assert math.log2(coarse / fine) > 1.9


def test_steps_are_l_stable() -> None:
    """A jump at the scale of a cell is gone after one huge step."""
    field = pressure()
    packed(field, 0.55)
    field.pressure = np.where(field.tube.points[:, 2] < LENGTH / 2, 1000.0, 0.0)
    field.step(1.0, 0.0)
    field.step(1.0, 0.0)
    assert np.abs(field.pressure).max() < 1e-3 * 1000.0


def test_the_full_balance_makes_gas_expand_along_the_plug() -> None:
    """In steady flow P^2 falls linearly: P dP/dz is constant."""
    field = pressure(layers=80, balance="full", reference_pressure=2000.0)
    packed(field, 0.6)
    for _ in range(400):
        field.step(2e-3, 0.5)
    inlet = 2000.0 + field.along()[0]
    assert inlet > 3000.0
    # the inflow is a volume at the pressure of the inlet
    level, mobility = 2000.0 + field.pressure, field.coefficients(field.pressure)[0]
    slope = field.tube.value(level)[0, 0, 0] / mobility[0, 0, 0] * 0.5 * inlet
    expected = np.sqrt(2000.0**2 + 2 * slope * (LENGTH - field.tube.planes))
    assert np.allclose(2000.0 + field.along(), expected, rtol=2e-3)


# -- exchange --------------------------------------------------------------------------------------


@pytest.mark.parametrize("section", [TUBE, DUCT])
@pytest.mark.parametrize("law", ["carman-kozeny", "ergun"])
def test_what_the_gas_loses_is_what_the_grains_gain(section: Section, law: str) -> None:
    field, made = pressure(section, permeability=law), scatter(section)
    for _ in range(3):
        field.take(made)
        field.step(5e-4, 1.0)
    field.push(made)
    gained, lost = made.gas_force.sum(axis=0), field.nodal_force()[field.solids > 0].sum(axis=0)
    assert lost[2] > 0
    assert np.abs(gained - lost).max() < 1e-12 * lost[2]


def test_grains_in_a_packed_tube_bear_all_but_the_share_of_the_wall() -> None:
    field = pressure()
    packed(field, 0.55)
    settle(field, 0.1)
    total = field.nodal_force()[:, 2].sum()
    wall = 8 * VISCOSITY / 3.5e-3**2 * 0.1 * LENGTH * TUBE.area
    assert total + wall == pytest.approx(field.drop * TUBE.area, rel=1e-9)


# -- bad input -------------------------------------------------------------------------------------


def test_an_odd_number_of_cells_is_refused() -> None:
    with pytest.raises(InputError, match="even number"):
        tube_mesh(TUBE, LENGTH, 3)

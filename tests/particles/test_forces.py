# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forces beside drag and weight, rotation, heat, wear: closed forms and signs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from grids import AIR, duct, gas

from fem_tfm.closures.drag import ConstantDrag
from fem_tfm.closures.particles.wear import Finnie, Oka
from fem_tfm.materials import Solids
from fem_tfm.models.particles.cloud import Parcels
from fem_tfm.models.particles.field import Field
from fem_tfm.models.particles.sinks import Sinks
from fem_tfm.models.particles.tracker import Forces, Steps, Tracker

BEAD = Solids(density=1000.0, diameter=1e-3)
SLOW = ConstantDrag(value=1e-6)
NU = AIR["viscosity"] / AIR["density"]


def moved(
    field: Field,
    seconds: float,
    x: list[float],
    v: list[float],
    spin: float = 0.0,
    **forces: object,
) -> Parcels:
    """A bead after a time, by forces beside a vanishing drag, in one short step after another."""
    parcels = Parcels.release(np.array([x]), v, BEAD)
    parcels.omega[0, 0] = spin
    tracker = Tracker([BEAD], Forces(drag=SLOW, **forces), steps=Steps(largest=seconds / 50))
    tracker.advance(parcels, field, until_time=seconds)
    return parcels


def shear(folds: int = 0) -> Field:
    """W = 10 + 100 y, even about the planes of symmetry of a folded section."""
    return gas(
        duct(folds=folds, half=(0.1, 0.1)),
        velocity=lambda x: np.outer(10 + 100 * np.abs(x[:, 1]), [0, 0, 1.0]),
    )


def mei(re: float, turn: float) -> float:
    beta = turn * BEAD.diameter**2 / NU / (2 * re)
    return (1 - 0.3314 * beta**0.5) * math.exp(-re / 10) + 0.3314 * beta**0.5


@pytest.mark.parametrize(("folds", "y"), [(0, 0.05), (2, 0.05), (2, -0.05)])
def test_saffman_lifts_towards_the_faster_gas(folds: int, y: float) -> None:
    """A lagging particle is lifted up the shear, at a slip of 0.3 m/s."""
    parcels = moved(shear(folds), 1e-4, [0.02, y, 0], [0, 0, 14.7], saffman=True)
    re, turn = 0.3 * BEAD.diameter / NU, 100.0
    force = 1.615 * BEAD.diameter**2 * math.sqrt(AIR["density"] * AIR["viscosity"] / turn)
    mass = BEAD.density * math.pi / 6 * BEAD.diameter**3
    lift = force * mei(re, turn) * 0.3 * turn / mass
    assert parcels.v[0, 1] * np.sign(y) == pytest.approx(lift * 1e-4, rel=1e-3)
    assert abs(parcels.v[0, 0]) < 1e-9


def test_magnus_and_the_decay_of_rotation() -> None:
    """Rubinow and Keller's force of a slow rotation; backspin lifts."""
    field = gas(duct(), velocity=[0, 0, 0.001])
    spin = 0.5
    parcels = moved(field, 1e-3, [0, 0, 0], [0, 0, 0], spin, magnus=True)
    # the gas comes along z, the bead turns about x: omega_p x v with v = -slip
    exact = 0.75 * AIR["density"] / BEAD.density * spin * -0.001 * -1e-3
    assert abs(parcels.v[0, 1]) == pytest.approx(abs(exact), rel=0.02)
    assert parcels.v[0, 1] > 0
    # torque of Stokes: pi mu d^3 omega on the inertia m d^2/10
    still = moved(gas(duct()), 0.5, [0, 0, 0], [0, 0, 0], spin, magnus=True)
    rate = 60 * AIR["viscosity"] / (BEAD.density * BEAD.diameter**2)
    assert still.omega[0, 0] == pytest.approx(spin * math.exp(-rate * 0.5), rel=1e-4)
    # without Magnus rotation stays
    assert moved(gas(duct()), 0.5, [0, 0, 0], [0, 0, 0], spin).omega[0, 0] == spin


def test_a_bead_takes_up_the_rotation_of_the_gas() -> None:
    parcels = moved(shear(2), 20.0, [0.02, -0.05, 0], [0, 0, 15.0], magnus=True)
    # rot U = (dW/dy, 0, 0) and dW/dy = -100 below the axis
    assert parcels.omega[0] == pytest.approx([-50.0, 0, 0], abs=1.0)


def test_pressure_gradient_and_added_mass() -> None:
    field = gas(duct(), pressure_gradient=np.array([0, 0, -20.0]))
    kappa = AIR["density"] / BEAD.density
    plain = moved(field, 0.1, [0, 0, 0], [0, 0, 0], pressure_gradient=True)
    assert plain.v[0, 2] == pytest.approx(20 * kappa * 0.1, rel=1e-5)
    more = {"pressure_gradient": True, "added_mass": 0.5, "gravity": (0.0, -9.81, 0.0)}
    both = moved(field, 0.1, [0, 0, 0], [0, 0, 0], **more)
    inertia = 1 + 0.5 * kappa
    assert both.v[0, 2] == pytest.approx(1.5 * 20 * kappa * 0.1 / inertia, rel=1e-5)
    assert both.v[0, 1] == pytest.approx(-9.81 * (1 - kappa) * 0.1 / inertia, rel=1e-5)


def test_added_mass_slows_relaxation() -> None:
    light = Solids(density=2.0, diameter=1e-3)
    forces = Forces(drag=ConstantDrag(value=10.0), added_mass=0.5)
    parcels = Parcels.release(np.zeros((1, 3)), [0, 0, 0], light)
    tracker = Tracker([light], forces, steps=Steps(largest=1e-3))
    tracker.advance(parcels, gas(duct(), velocity=[0, 0, 1.0]), until_time=0.2)
    rate = 10 / (2.0 + 0.5 * AIR["density"])
    assert parcels.v[0, 2] == pytest.approx(1 - math.exp(-rate * 0.2), rel=1e-5)


@pytest.mark.parametrize("slip", [0.0, 2.0])
def test_heat_exchange(slip: float) -> None:
    """Ranz and Marshall at a constant slip, and the heat that the gas loses."""
    field = gas(duct(), velocity=[0, 0, slip], temperature=350.0)
    field.conductivity, field.heat_capacity = 0.026, 1006.0
    parcels = Parcels.release(np.zeros((1, 3)), [0, 0, 0], BEAD, temperature=293.0, rate=7.0)
    sinks = Sinks.of(field.grid, parcels, heat_capacity=840.0)
    forces = Forces(drag=ConstantDrag(value=1e-9), heat=True)
    tracker = Tracker([BEAD], forces, steps=Steps(largest=0.01), heat_capacity=[840.0])
    tracker.advance(parcels, field, until_time=1.0, sinks=sinks)
    prandtl = AIR["viscosity"] * 1006 / 0.026
    nusselt = 2 + 0.6 * math.sqrt(slip * BEAD.diameter / NU) * prandtl ** (1 / 3)
    rate = 6 * nusselt * 0.026 / (BEAD.density * 840 * BEAD.diameter**2)
    exact = 350 - 57 * math.exp(-rate)
    assert parcels.temperature[0] == pytest.approx(exact, rel=1e-6)
    capacity = parcels.mass_flow[0] * 840
    assert sinks.heat.sum() == pytest.approx(capacity * (parcels.temperature[0] - 293), rel=1e-9)
    # slope: heat per kelvin of the gas, at the temperatures before each step
    assert sinks.heat_slope.sum() == pytest.approx(
        capacity * 100 * (1 - math.exp(-rate / 100)), rel=1e-4
    )


# -- wear --------------------------------------------------------------------------------------


def test_finnie() -> None:
    law, mass = Finnie(), np.array([1e-6])
    angles = np.radians([5.0, 18.4349488, 30.0, 90.0])
    found = law.removed(np.array(30.0), angles, mass, np.array(1e-4))
    scale = 7800 * 0.5 * 1e-6 * 900 / (1.5e9 * 4)
    exact = [
        scale * (math.sin(angles[0] * 2) - 3 * math.sin(angles[0]) ** 2),
        scale * 0.3,
        scale * 0.25,
        0.0,
    ]
    assert found == pytest.approx(exact, rel=1e-6, abs=1e-25)


def test_oka() -> None:
    """At right angles E_90 alone, 104 m/s and 326 um: K H^-0.12 mm3/kg."""
    law = Oka(H=1.0)
    one = np.array(1.0)
    found = law.removed(104 * one, math.pi / 2 * one, one, 326e-6 * one)
    assert found == pytest.approx(65e-9 * 7800)
    faster = law.removed(208 * one, math.pi / 2 * one, one, 326e-6 * one)
    assert faster / found == pytest.approx(2**2.3)
    flat = law.removed(104 * one, math.radians(30) * one, one, 326e-6 * one)
    assert flat / found == pytest.approx(0.5**0.71 * 1.5**2.4)

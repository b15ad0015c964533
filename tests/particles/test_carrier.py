# SPDX-License-Identifier: LGPL-3.0-or-later
"""The gas of a solved section as particles see it, and what they give back to its mesh."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import pytest
from dolfinx import fem
from mpi4py import MPI

from fem_tfm import Case
from fem_tfm.closures.particles.dispersion import Langevin, MeanFlow
from fem_tfm.errors import InputError
from fem_tfm.interpolation import point_values
from fem_tfm.materials import Gas, Solids
from fem_tfm.models.carrier import SectionCarrier
from fem_tfm.models.particles import field as rows
from fem_tfm.models.particles.cloud import Parcels
from fem_tfm.models.particles.sinks import Sinks
from fem_tfm.models.particles.tracker import Tracker
from fem_tfm.solvers import nested

AIR = Gas(1.2, 1.8e-5)
ASH = Solids(density=1800.0, diameter=1.4e-4)
DUCT = {
    "flow": "duct",
    "geometry": {"shape": "duct", "width": 0.2, "length": 16.0},
    "gas": {"density": 1.2, "viscosity": 1.8e-5},
    "operation": {"gas_superficial_velocity": 22.0},
    "walls": {"distance": 8e-4},
    "numerics": {"mesh_size": 0.0292},
}
PIPE = {
    "geometry": {"diameter": 0.05},
    "gas": {"density": 1.2, "viscosity": 1.8e-5},
    "operation": {"gas_superficial_velocity": 3.0},
}


@functools.cache
def section(kind: str, *changes: tuple[str, Any]) -> Any:
    case = Case.from_dict(DUCT if kind == "duct" else PIPE).with_values(dict(changes))
    scene = case.scene
    physics, given = scene.physics, scene.numerics
    meshes, limits = physics.meshes(MPI.COMM_WORLD), (given.tolerance, given.max_steps)
    return nested.solve(meshes, physics.setup(), *limits, nested.Observer(), physics.scheme).section


@pytest.mark.mpi
def test_rows_of_a_duct_are_its_fields() -> None:
    found = section("duct")
    carrier = SectionCarrier(found, AIR, Langevin())
    carrier.update()
    field, points = carrier.field, carrier.grid.points
    fields = found.fields()
    inner = np.flatnonzero((points[:, 0] < 0.099) & (points[:, 1] < 0.099))[::7]
    names = ("u_g", "k", "eps", "reynolds_stress")
    u, k, eps, stress = point_values([fields[n] for n in names], points[inner])
    assert field.rows[inner, rows.VELOCITY] == pytest.approx(u, rel=1e-6, abs=1e-6)
    assert field.rows[inner, rows.TIME] == pytest.approx(0.21 * (k / eps).ravel(), rel=1e-5)
    factor = np.zeros((len(inner), 3, 3))
    factor[:, rows.LOWER[0], rows.LOWER[1]] = field.rows[inner, rows.FACTOR]
    product = factor @ factor.transpose(0, 2, 1)
    assert product.reshape(-1, 9) == pytest.approx(stress.reshape(-1, 9), abs=2e-6)
    assert field.clipped == 0
    # the strip carries what the wall function says
    assert ((field.rows[:, rows.STRIP] > 0.1) & (field.rows[:, rows.STRIP] < 0.2)).all()
    assert field.rows[0, 15] == pytest.approx(-found.pressure_gradient)


def test_an_eddy_viscosity_gives_its_stresses() -> None:
    found = section("duct", ("closures.reynolds_stress", "k-epsilon"))
    carrier = SectionCarrier(found, AIR, Langevin())
    carrier.update()
    energy = (carrier.field.rows[:, rows.FACTOR].astype(float) ** 2).sum(axis=1) / 2
    ln_k = carrier.nodal("q")[:, 0]
    assert energy == pytest.approx(np.exp(ln_k), rel=1e-2)


@pytest.mark.parametrize("turbulence", ["laminar", "mixing-length"])
def test_rows_of_a_two_fluid_section(turbulence: str) -> None:
    found = section("pipe", ("closures.turbulence", turbulence))
    carrier = SectionCarrier(found, AIR, Langevin())
    carrier.update()
    table, points = carrier.field.rows, carrier.grid.points
    u = point_values([found.fields()["u_g"]], 0.9 * points[::11])[0]
    near = np.flatnonzero(np.hypot(*points.T) < 1e-6)
    assert table[near, 2].max() >= u[:, 2].max() * (1 - 1e-6)
    if turbulence == "laminar":
        assert not table[:, rows.FACTOR].any()
        return
    # production is dissipation: u_tau^2 = sqrt(C_mu) k in the log layer
    r = np.hypot(*points.T)
    layer = (r > 0.8 * 0.025) & (r < 0.9 * 0.025)
    k = (table[layer, rows.FACTOR].astype(float) ** 2).sum(axis=1) / 2
    drop = float(found.drive.value)
    u_tau2 = drop * 0.05 / 4 / 1.2
    assert (0.3 * k / u_tau2).mean() == pytest.approx(0.85, abs=0.12)
    assert (table[:, rows.TIME] > 0).all() and table[:, rows.TIME].max() < 0.2


def test_calm_particles_need_no_turbulence() -> None:
    carrier = SectionCarrier(section("duct"), AIR, MeanFlow())
    carrier.update()
    assert not carrier.field.rows[:, rows.FACTOR].any()


@pytest.mark.mpi
def test_what_particles_take_arrives_on_the_mesh() -> None:
    comm = MPI.COMM_WORLD
    found = section("duct")
    carrier = SectionCarrier(found, AIR, Langevin())
    carrier.update()
    x = np.zeros((500, 3))
    x[:, :2] = np.random.default_rng(1).uniform(-0.098, 0.098, (500, 2))
    parcels = Parcels.release(x, [0, 0, 2.8], ASH, rate=1e6).share(comm)
    sinks = Sinks.of(carrier.grid, parcels, comm)
    Tracker([ASH], dispersion=Langevin()).advance(parcels, carrier.field, until_z=0.5, sinks=sinks)
    gain = comm.allreduce((parcels.mass_flow * (parcels.v[:, 2] - 2.8)).sum())
    sinks.reduce(comm)
    deposit = carrier.deposit(sinks, length=0.5)
    for name, width in (("impulse", 3), ("slope", 1), ("residence", 1), ("moment", 3)):
        assert deposit[name].function_space.dofmap.bs == width
    force = deposit["impulse"][2] * found.dx
    total = comm.allreduce(fem.assemble_scalar(fem.form(force))) * 4 * 0.5
    assert total == pytest.approx(gain, rel=1e-9)


def test_a_march_keeps_the_station_behind() -> None:
    carrier = SectionCarrier(section("duct"), AIR, Langevin())
    carrier.update()
    before = carrier.field.rows.copy()
    carrier.keep(1.0, 1.5)
    carrier.update()
    assert carrier.field.span == (1.0, 1.5)
    assert carrier.field.rows_ahead is not None
    assert np.array_equal(carrier.field.rows, before)
    assert np.array_equal(carrier.field.rows_ahead, before)
    carrier.field.rows_ahead[:] += 1
    carrier.keep(1.5, 2.0)
    assert np.array_equal(carrier.field.rows, before + 1)


def test_other_models_are_refused() -> None:
    with pytest.raises(InputError, match=r"particles\.carrier"):
        SectionCarrier("gas", AIR, Langevin())  # type: ignore[arg-type]

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Particles: CPU time against the error of their mean exit velocity, and steps a CPU second.

Ash enters the developed gas of the square duct at 2.8 m/s and is followed over 16 m, one way. The
error is against steps a quarter as long. Speeds are those of a formula's gas in meshes of each kind
of cell, on one thread; other processes only make them slower.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

import fem_tfm._kernel as _kernel
from fem_tfm.bench.demo import demo
from fem_tfm.bench.error import tell
from fem_tfm.closures.particles.dispersion import Eddies, Langevin, MeanFlow, ParticleDispersion
from fem_tfm.geometry.mesh import Mesh, extruded_mesh, section_mesh
from fem_tfm.geometry.resolution import Resolution
from fem_tfm.geometry.section import RectangularSection, RoundSection, Section
from fem_tfm.materials import Gas, Solids
from fem_tfm.models.carrier import SectionCarrier
from fem_tfm.models.particles.cloud import Parcels
from fem_tfm.models.particles.field import Field
from fem_tfm.models.particles.grid import Floats, Gathered
from fem_tfm.models.particles.migration import locate
from fem_tfm.models.particles.partition import Partition
from fem_tfm.models.particles.tracker import Steps, Tracker
from fem_tfm.scenes.developed import Developed
from fem_tfm.solvers import nested

ASH = Solids(density=1800.0, diameter=1.4e-4)
AIR = Gas(1.2, 1.8e-5)
LENGTH, ENTRY = 16.0, 2.8
# trajectories, and shares of T_L of the longest step with the reference last
COUNT, SHARES = 100_000, (1.0, 0.5, 0.25)
# particles and seconds of a measurement of speed
CROWD, SECONDS = 32768, 0.5


@dataclass(frozen=True)
class Exit:
    """Mean exit velocity [m/s] with its standard error, steps a trajectory, CPU time of all [s]."""

    mean: float
    noise: float
    steps: float
    cpu: float


def gas_of_the_duct() -> nested.Solution:
    """The developed gas of the demo on a mesh of 100 cells."""
    scene = demo("square_duct/gas.toml", {"heat": None, "numerics.mesh_size": 0.0292}).scene
    assert isinstance(scene, Developed)
    physics, given = scene.physics, scene.numerics
    limits = given.tolerance, given.max_steps
    meshes = physics.meshes(MPI.COMM_SELF)
    return nested.solve(meshes, physics.setup(), *limits, nested.Observer(), physics.scheme)


def exit_velocity(field: Field, law: ParticleDispersion, share: float, count: int = COUNT) -> Exit:
    """Ash over the length of the duct."""
    rng = np.random.default_rng(1)
    x = np.zeros((count, 3))
    x[:, :2] = rng.uniform(-0.097, 0.097, (count, 2))
    parcels = Parcels.release(x, [0, 0, ENTRY], ASH)
    longest = 4e-3 * min(share, 1.0) if isinstance(law, MeanFlow) else 4e-3
    tracker = Tracker([ASH], dispersion=law, steps=Steps(eddies=share, largest=longest))
    start = time.process_time()
    report = tracker.advance(parcels, field, until_z=LENGTH)
    cpu = time.process_time() - start
    v = parcels.v[:, 2]
    return Exit(float(v.mean()), float(v.std() / np.sqrt(count)), report.steps / count, cpu)


def accuracy(count: int = COUNT) -> list[str]:
    """Lines of the table of errors."""
    section = gas_of_the_duct().section
    lines = ["law        step/T_L  steps  exit [m/s]        error  trajectories a CPU second"]
    for law in (MeanFlow(), Langevin(), Eddies()):
        carrier = SectionCarrier(section, AIR, law)
        carrier.update()
        found = [exit_velocity(carrier.field, law, share, count) for share in SHARES]
        for share, one in zip(SHARES, found, strict=True):
            error = 100 * (one.mean / found[-1].mean - 1)
            lines.append(
                f"{law.name:10} {share:8.2f} {one.steps:6.0f}  {one.mean:.3f} +- {one.noise:.3f}"
                f" {error:9.3f} % {count / one.cpu:8.0f}"
            )
    return lines


def meshes() -> dict[str, Mesh]:
    """A mesh of each kind of cell, and a round one whose wall cells are curved."""
    duct = RectangularSection(0.2, 0.2, symmetry="quarter", wall_offset=8e-4)
    pipe = RoundSection(0.2, symmetry="half")
    comm = MPI.COMM_SELF
    found = {}
    for cells in ("quadrilateral", "triangle"):
        fine = Resolution(level=4, cells=cells)
        found[cells] = section_mesh(duct, fine, comm)
        found[f"{cells}, pipe"] = section_mesh(pipe, fine, comm)
        line: Section = RectangularSection(0.2, 0.2, symmetry="half")
        name = "hexahedron" if cells == "quadrilateral" else "tetrahedron"
        found[name] = extruded_mesh(line, fine, 3.0, 100, comm, order=1)
    return found


def _field(mesh: Mesh) -> Field:
    """A gas faster and calmer at the axis."""
    grid = (Gathered if mesh.length is None else Partition).of(mesh).grid
    x = grid.points[:, :2]
    near = np.clip((x**2).sum(axis=1) / 0.01, 0, 1)
    velocity: Floats = np.zeros((len(x), 3))
    velocity[:, 2] = 24 - 8 * near
    stress = (0.5 + 0.5 * near)[:, None, None] * np.diag([1.0, 1.0, 2.0])
    field = Field(grid, AIR.density, AIR.viscosity)
    field.fill(velocity, stress, 5e-3 - 3e-3 * near, strip=1 / 6)
    return field


def speed(mesh: Mesh, law: ParticleDispersion) -> float:
    """Millions of steps a CPU second, without the search for the first cells."""
    field = _field(mesh)
    rng = np.random.default_rng(1)
    x = np.zeros((CROWD, 3))
    x[:, :2] = rng.uniform(-0.068, 0.068, (CROWD, 2))
    length = mesh.length
    if length is not None:
        x[:, 2] = np.sort(rng.uniform(0, 0.9 * length, CROWD))
    tracker = Tracker([ASH], dispersion=law, steps=Steps(largest=4e-3))
    tracker.advance(Parcels.release(x[:8], [0, 0, 20.0], ASH), field, until_time=1e-3)
    steps, cpu, best = 0, 0.0, 0.0
    entering = Parcels.release(x, [0, 0, 20.0], ASH)
    locate(entering, field.grid)
    while cpu < SECONDS:
        parcels = entering.copy()
        start = time.process_time()
        steps = tracker.advance(parcels, field, until_time=0.2).steps
        taken = time.process_time() - start
        cpu, best = cpu + taken, max(best, steps / taken)
    return best / 1e6


def speeds() -> list[str]:
    """Lines of the table of speeds."""
    lines = [f"million steps a CPU second, variant {_kernel.VARIANT}    mean flow   langevin"]
    for name, mesh in meshes().items():
        calm, scattered = (speed(mesh, law) for law in (MeanFlow(), Langevin()))
        lines.append(f"{name:22} {mesh.num_cells:8} cells {calm:16.1f} {scattered:10.1f}")
    return lines


def run() -> str:
    """Measure, print as it goes, and return both tables."""
    tables = []
    for part in (speeds, accuracy):
        tables.append("\n".join(part()))
        tell(tables[-1])
    return "\n\n".join(tables)

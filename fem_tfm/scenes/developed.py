# SPDX-License-Identifier: LGPL-3.0-or-later
"""The developed section of a line: steady, d/dz = 0, whatever the model."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from mpi4py import MPI

from fem_tfm.errors import InputError, SolverError
from fem_tfm.geometry.gmsh import GmshModel
from fem_tfm.geometry.mesh import Mesh
from fem_tfm.geometry.shapes import Duct, Pipe
from fem_tfm.models.reynolds_stress.model import ReynoldsStress
from fem_tfm.models.two_fluid.model import TwoFluid
from fem_tfm.output import checkpoint
from fem_tfm.output.fields import FieldWriter, snapshot
from fem_tfm.output.result import Result
from fem_tfm.parameters import parameter
from fem_tfm.scenes.dense import Dense
from fem_tfm.scenes.duct import DEFAULTS, DuctGas
from fem_tfm.scenes.judged.finer import halved_mesh, trusted
from fem_tfm.scenes.judged.gas import Derived
from fem_tfm.scenes.judged.inputs import Uncertain, check_ranges, input_ranges
from fem_tfm.scenes.judged.plausible import derived, estimates, out_of_range
from fem_tfm.scenes.judged.times import too_long
from fem_tfm.scenes.kinds import Kind, register
from fem_tfm.scenes.particles import words as cloud_words
from fem_tfm.scenes.particles.tracking import carrier_of, follow, following_time
from fem_tfm.scenes.physics import LARGEST_STEP, SectionPhysics
from fem_tfm.scenes.recorder import Recorder, Setting
from fem_tfm.scenes.scene import Answer, Scene
from fem_tfm.scenes.statement import SteadyNumerics
from fem_tfm.solvers import nested
from fem_tfm.solvers.nested import Observer
from fem_tfm.solvers.newton import LinearSolveError


@dataclass(frozen=True)
class SectionScene[P: SectionPhysics, R: Recorder](Scene[P, R]):
    """A scene whose mesh is that of a section."""

    model: TwoFluid | ReynoldsStress

    @property
    def files(self) -> Sequence[str]:
        """Names of what a run may leave in its directory."""
        return self.physics.files

    def derived(self) -> list[Derived]:
        """Numbers of gas and solids, and what they give away."""
        return derived(self)

    def advice(self) -> list[str]:
        """What the user probably did not mean, one sentence each."""
        return self.physics.advice()

    def estimates(self, answer: Answer) -> list[str]:
        """What published correlations give for the same line, in words."""
        return estimates(self, answer.quantities) if isinstance(self.model, TwoFluid) else []

    def judge(self, answer: Answer) -> list[str]:
        """What an answer must say of itself; raises SolverError where it is none."""
        said = super().judge(answer)
        if isinstance(self.model, TwoFluid):
            said += out_of_range(self, answer.quantities)
        return said

    def examine(self) -> None:
        """Refuse what cannot be solved, without solving it; raises InputError."""
        self.physics.examine()

    def mesh_model(self) -> GmshModel:
        """The mesh as Gmsh makes it."""
        return GmshModel(self.physics.section, self.physics.resolution)

    def mesh(self, comm: MPI.Comm = MPI.COMM_WORLD) -> Mesh:
        """The finest mesh of the section."""
        return self.physics.meshes(comm)[-1]()


@dataclass(frozen=True)
class Developed(SectionScene[SectionPhysics, "SectionRecorder"]):
    """The developed section: hold-up or flux is given, the pressure gradient is found.

    numerics : how strictly it is solved
    uncertain : numbers that the source does not print; the answer tells what they move it by

    Raises InputError for values that do not fit each other.
    """

    numerics: SteadyNumerics = parameter(doc="mesh and solver", factory=SteadyNumerics)
    uncertain: tuple[Uncertain, ...] = parameter(
        (), doc="numbers that the source does not print, with their ranges", key="uncertain"
    )
    solution: ClassVar[str] = "developed"
    differentiable: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        check_ranges(self, self.uncertain)

    def recorder(self, setting: Setting | None = None) -> SectionRecorder:
        """What a run tells and keeps while it works."""
        return SectionRecorder(self, setting or Setting())

    def solve(self, recorder: SectionRecorder, previous: Answer | None = None) -> Answer:
        """The developed section on nested meshes, coarse to fine.

        Where `previous` differs in numbers alone, its last two meshes go on from their states.

        Raises
        ------
        SolverError
            no steady state was reached, or a balance is broken.
        """
        physics, limits = self.physics, (self.numerics.tolerance, self.numerics.max_steps)
        setup, scheme = physics.setup(), physics.scheme
        kept = previous.state if previous is not None else None
        solution, start, spent = None, "cold", 0
        if isinstance(kept, Kept) and kept.leads_to(self):
            before = kept.factorisations()
            with suppress(SolverError):
                start = "warm"
                solution = nested.resolve(kept.solution, setup, *limits, recorder, scheme)
            spent += kept.factorisations() - before
        if solution is None:
            if previous is not None:
                previous.close()
            start, meshes = "cold", physics.meshes(recorder.comm)
            restart = recorder.restart() if recorder.resume else None
            beyond = restart[0] + 1 - len(meshes) if restart else 0
            meshes += [halved_mesh(physics, recorder.comm, n + 1) for n in range(beyond)]
            solution = nested.solve(meshes, setup, *limits, recorder, scheme, restart)
            spent += recorder.factorisations
        found = trusted(self, solution, limits, recorder)
        if self.particles is not None:
            follow(self, carrier_of(self, solution.section), recorder)
        told = {name: found[name] for name in ANSWERED if name in found}
        state = Kept(self, solution)
        if recorder.tracked is not None:
            told["balances"] = {**told["balances"], **recorder.tracked.balances()}
        answer = Answer(
            "converged",
            headline=physics.headline,
            unestimated=ONE_MESH,
            state=state,
            factorisations=spent,
            start=start,
            **told,
        )
        # a singular Jacobian has an answer, but no adjoint
        with suppress(LinearSolveError):
            answer.inputs = input_ranges(self, answer, self.uncertain)
        return answer

    def skipped(self) -> list[str]:
        """What the scene did not need, and why."""
        physics = self.physics
        return [
            "axial direction: a developed section has d/dz = 0",
            "history: pseudo-time leads straight to the steady state",
            *physics.skipped_of_axis(),
            *physics.skipped(),
        ]

    def expected_time(self) -> float:
        """About the CPU time of a run whose forms are compiled [s]."""
        physics = self.physics
        return physics.cost(physics.size[1])["solve"] + following_time(self)

    def describe(self) -> dict[str, Any]:
        """What would be solved, what is left out, and what it would take."""
        physics = self.physics
        sizes = physics.resolution.nested_sizes(physics.section, physics.coarsest)
        cells, unknowns = physics.size
        cost = physics.cost(unknowns)
        return describe(self, physics.solved_words, physics.given()) | {
            "meshes": (
                ", ".join(f"{1e3 * size:.3g} mm" for size in sizes)
                + " core cells in turn; finer ones follow if they disagree"
            ),
            "finest_mesh": f"{cells} cells, about {unknowns} unknowns",
            "memory": f"about {cost['memory'] + cloud_words.parcel_memory(self):.0f} MB",
            "time": time_words(self.expected_time(), cost["compile"]),
        }


ANSWERED = ("quantities", "errors", "balances", "notes", "references")
ONE_MESH = "one mesh alone has an answer; a higher numerics.level has two"


def describe(scene: Scene[Any, Any], solved: str, given: str) -> dict[str, Any]:
    """What every description begins and ends with; cost goes between."""
    laws = [f"{law.family}: {law.name}" for law in scene.model.laws()]
    cloud = scene.particles
    if cloud is not None:
        laws += [f"{law.family}: {law.name}" for law in cloud.laws()]
    return {
        "title": scene.title or "untitled",
        "solved": solved,
        "line": scene.geometry.words,
        "given": given,
        "closures": laws,
        **({"particles": cloud_words.words(scene)} if cloud is not None else {}),
        "skipped": scene.left_out(),
        "wall_distance": f"{1e3 * scene.wall_offset:.3g} mm",
        "inferred": list(scene.inferred) or "nothing",
        "numbers": scene.numbers(),
        "warnings": [*scene.warnings(), *too_long(scene)] or "none",
    }


def time_words(solve: float, compiled: float) -> str:
    """Time of solving and of compiling [s], in words."""
    return (
        f"about {solve:.0f} s, and {compiled:.0f} s more to compile the forms if these closures"
        " are new on this machine"
    )


@dataclass
class Kept:
    """A solution that a neighbouring scene may go on from."""

    scene: Developed
    solution: nested.Solution
    meshes: Any = field(init=False)

    def __post_init__(self) -> None:
        self.meshes = mesh_key(self.scene)

    def leads_to(self, scene: Developed) -> bool:
        """Whether another scene differs from this one in numbers alone."""
        setup = self.solution.section.setup
        same = self.meshes == mesh_key(scene) and type(scene.model) is type(self.scene.model)
        return same and setup.structure == scene.physics.setup().structure

    def adjoint(self) -> tuple[np.ndarray, np.ndarray]:
        """Adjoint of G, which is linear in its multiplier, such as G/rho_g.

        Raises LinearSolveError where the Jacobian is singular.
        """
        section, physics = self.solution.section, self.scene.physics
        found, drive = section.newton.adjoint(0), section.drive
        value, before = float(drive.value), physics.signs(section)["pressure_gradient"]
        drive.value = value + 1.0
        rate = physics.signs(section)["pressure_gradient"] - before
        drive.value = value
        return rate * found[0], rate * found[1]

    def lagrangian(self, scene: Developed, adjoint: tuple[np.ndarray, np.ndarray]) -> float:
        """G - v.F - w.c of the finest section under the numbers of a neighbouring scene [Pa/m].

        Raises InputError for a scene with other meshes or laws.
        """
        if not self.leads_to(scene):
            raise InputError("sensitivity", scene.title, "a scene that differs in numbers alone")
        section, physics, (forms, borders) = self.solution.section, scene.physics, adjoint
        with numbers_of(section, physics.setup(), physics.scheme):
            own = float(forms @ section.newton.assemble_residual())
            missed = float(borders @ np.array(section.newton.constraint_errors()))
            gradient = physics.signs(section)["pressure_gradient"]
        return gradient - float(section.mesh.mesh.comm.allreduce(own)) - missed

    def factorisations(self) -> int:
        """Factorisations of the last two meshes so far."""
        return sum(level.section.newton.factorisations for level in self.solution.levels[-2:])

    def close(self) -> None:
        """Free the solvers."""
        for level in self.solution.levels:
            level.section.newton.destroy()


@contextmanager
def numbers_of(section: Any, setup: Any, scheme: nested.Scheme) -> Iterator[None]:
    """Let a section have other numbers for a while; its terms of the mesh stay raised."""
    given, terms = section.setup, getattr(section, "mesh_terms", None)
    rougher = getattr(section, "rougher", None)

    def take(wanted: Any) -> None:
        section.update(wanted)
        if terms is not None and scheme.ease is not None:
            scheme.ease(section, terms)
            section.rougher = rougher

    take(setup)
    try:
        yield
    finally:
        take(given)


def mesh_key(scene: Developed) -> tuple[Any, ...]:
    """What the meshes of a scene depend on."""
    physics = scene.physics
    return physics.section, physics.resolution


class SectionRecorder(Recorder, Observer):
    """What a run of nested sections tells and keeps: progress, monitor.csv, checkpoint.

    Attributes
    ----------
    told : what the answer is made of, None before there is one
    begun : sections that were begun
    """

    def __init__(self, scene: Developed, setting: Setting) -> None:
        self.physics = scene.physics
        super().__init__(scene, setting, self.physics.columns)
        self.level = self.steps = 0
        self.told: dict[str, Any] | None = None
        self.begun: list[Any] = []
        self._levels, self._share = 1, 0.0

    def compiling(self, what: str) -> None:
        """Tell which form is prepared, on the first mesh: later ones find it in the cache."""
        self.lap("solve" if self.begun else "setup")
        if not self.begun:
            self.progress.stage(f"forms: {what} (compiled once for each choice of closures)")

    def begin(self, section: Any, level: int, levels: int) -> None:
        """A mesh is ready."""
        self.lap("compile")
        self.begun.append(section)
        self._begun_level, self._levels, self._share = level, levels, 0.0
        text = (
            f"mesh {level + 1} of {levels}: {section.mesh.num_cells} cells, {section.dofs} unknowns"
        )
        self.progress.stage(text)
        self.log(text)

    def step(self, row: dict[str, float]) -> None:
        """A row of the monitor and the early-warning line."""
        if self.begun:
            # only now does the new mesh hold a state worth keeping
            self.section, self.level = self.begun[-1], self._begun_level
        self.steps += 1
        values = {name: row[name] for name in ("dt", "iterations", "update")}
        values |= {"step": self.steps, "level": self.level + 1}
        if self.section is not None:
            values |= self.physics.signs(self.section)
        if self.monitor is not None:
            self.monitor.write(values)
        warning = ", ".join(f"{n} {values[n]:.4g}" for n in self.physics.warned if n in values)
        self.progress.update(self._fraction(row["dt"]), warning)
        self.log(f"step {self.steps}: dt {row['dt']:.3g} s, {warning}")
        self.check_time()

    @property
    def factorisations(self) -> int:
        """Factorisations on all meshes that were begun, those of a mesh that failed too."""
        return sum(section.newton.factorisations for section in self.begun)

    def tell(self, text: str) -> None:
        """A line of progress and of the log."""
        self.progress.line(text)
        self.log(text)

    def take(self, solution: nested.Solution, finer: int = 0) -> dict[str, Any]:
        """The solution whose finest section is written; what the answer is made of.

        finer : meshes beyond those of the scene
        """
        meshes = len(self.physics.meshes(self.comm)) + finer
        self.section, self.level = solution.section, meshes - 1
        self.told = found = self.physics.told(solution)
        return found

    def retry(self, dt: float, reason: str) -> None:
        """A line of the log for a step taken back."""
        self.log(f"taken back: {reason}; dt {dt:.3g} s")

    def _fraction(self, dt: float) -> float:
        """Share of the work done, from the decades of dt that are behind on this mesh."""
        unit = self.scene.geometry.hydraulic_diameter / self.scene.feed.gas_velocity
        bounds = self.physics.first_step, LARGEST_STEP
        first, last = (math.log(bound * unit) for bound in bounds)
        share = min(max((math.log(dt) - first) / (last - first), 0.0), 1.0)
        # a start that failed is followed by another, whose first steps are short again
        self._share = max(self._share, share)
        return (self.level + 0.9 * self._share) / self._levels

    def step_back(self) -> None:
        """Go back to the last accepted state and keep it."""
        section = self.section
        section.now.x.array[:] = section.old.x.array
        self.save_final()

    def save_final(self) -> None:
        """Keep the present state."""
        section = self.section
        if self.out is None:
            return
        numbers = {"level": self.level, "steps": self.steps}
        numbers |= {f"multiplier{k}": value for k, value in enumerate(section.stored()[1])}
        fields = {name: section.unknown(name) for name in section.names}
        checkpoint.save(self.out, self.comm, fields, numbers)

    def restart(self) -> tuple[int, Callable[[Any], None]]:
        """Mesh to go on with and how to put the stored state on it."""
        out = self.out
        assert out is not None
        numbers = checkpoint.numbers(out)
        self.steps = int(numbers["steps"])

        def restore(section: Any) -> None:
            fields = {name: section.unknown(name) for name in section.names}
            checkpoint.load(out, self.comm, fields)
            for name, function in fields.items():
                section.set_unknown(name, function)
            for k, border in enumerate(section.newton.borders):
                border.multiplier.value = numbers[f"multiplier{k}"]

        return int(numbers["level"]), restore

    def write_files(self, result: Result) -> None:
        """XDMF, profiles and pictures."""
        section, output = self.section, self.scene.output
        fields = self.physics.fields(section, self.told)
        result.take(snapshot(section.mesh.mesh, fields))
        if self.out is not None and output.xdmf:
            with FieldWriter(self.out / "fields", section.mesh.mesh) as writer:
                writer.write(0.0, {n: f for n, f in fields.items() if n in output.fields})
        self.physics.write(section, result, self.out, self.told)


FEED_IN_TIME = tuple(
    f"operation.{name}" for name in ("gas_schedule", "solids_schedule", "outlet_blocked")
)
OUTPUT_IN_TIME = tuple(
    f"output.{name}" for name in ("interval", "checkpoint_interval", "probes", "sections")
)
UNREAD = (
    *FEED_IN_TIME, *OUTPUT_IN_TIME, "gas.compressible", "numerics.axial_cells",
)  # fmt: skip
GAS_UNREAD = (
    "operation.gravity", "geometry.inclination_deg",
    "operation.solids_fraction", "operation.solids_velocity",
    "operation.solids_superficial_velocity", "operation.solids_mass_flow",
)  # fmt: skip
register(
    Kind(
        "dense",
        Developed,
        TwoFluid,
        (Pipe, Duct),
        Dense,
        {"numerics.cells": "triangle"},
        (*UNREAD, "output.stations"),
    )
)
register(
    Kind(
        "duct",
        Developed,
        ReynoldsStress,
        (Pipe, Duct),
        DuctGas,
        DEFAULTS,
        (
            *UNREAD,
            *GAS_UNREAD,
            "output.stations",
            "operation.outlet_pressure",
            "heat.wall_temperature",
        ),
    )
)

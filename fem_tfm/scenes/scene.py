# SPDX-License-Identifier: LGPL-3.0-or-later
"""A scene: a model in a line with its feed, solved in one way. What all scenes have in common.

A scene is stated in Python, or built from a case file, which holds the same words. It runs,
describes itself, warns, and leaves an answer. A new kind of scene is one file of this folder: a
subclass of `Scene`, and one `register` for each model that it can solve.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, MISSING, dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Protocol

import numpy as np
from mpi4py import MPI

from fem_tfm.cloud import Cloud
from fem_tfm.errors import InputError, SolverError, TimeIsUp
from fem_tfm.fenics import check_cache
from fem_tfm.geometry.gmsh import GmshModel
from fem_tfm.geometry.mesh import Mesh
from fem_tfm.geometry.resolution import Resolution
from fem_tfm.geometry.section import Section
from fem_tfm.geometry.shapes import Shape
from fem_tfm.operation import Feed
from fem_tfm.output.result import InputRange, Quantity, Result, unit_of, versions
from fem_tfm.output.result import Reference as Published
from fem_tfm.output.split_picture import draw_split
from fem_tfm.parameters import Parameters, key_of, parameter
from fem_tfm.progress import Progress
from fem_tfm.scenes.judged.answer import judge
from fem_tfm.scenes.judged.gas import Derived, doubts, is_doubted
from fem_tfm.scenes.kinds import KINDS, Kind, check_shape, unread_words
from fem_tfm.scenes.particles import words as cloud_words
from fem_tfm.scenes.physics import Physics
from fem_tfm.scenes.recorder import Recorder, Setting, prepare, results_directory
from fem_tfm.scenes.statement import Output, Reference


@dataclass(frozen=True)
class Scene[P: Physics, R: Recorder](Parameters, ABC):
    """A model in a line with its feed.

    P is what only its model tells, R what a run tells and keeps while it works.

    Raises InputError for values that do not fit each other, and for those that this kind of scene
    does not read.
    """

    model: Any = parameter(MISSING, doc="materials and laws")
    geometry: Shape = parameter(MISSING, doc="conveying line", key="geometry")
    feed: Feed = parameter(MISSING, doc="fluxes, hold-up, gravity", key="operation")
    _: KW_ONLY
    resolution: Resolution = parameter(doc="mesh and solver", factory=Resolution)
    particles: Cloud | None = parameter(
        None,
        doc="particles that the gas carries, none without the table",
        key="particles",
    )
    output: Output = parameter(doc="files", factory=Output)
    title: str = parameter("", doc="one line about the case", key="title")
    inferred: tuple[str, ...] = parameter(
        (), doc="inputs that the source does not print", key="inferred"
    )
    references: tuple[Reference, ...] = parameter((), doc="published values", key="reference")
    solution: ClassVar[str]
    # whether the state of an answer is Differentiable
    differentiable: ClassVar[bool] = False
    # flows of which this way to solve lets the gas feel its particles
    coupled_flows: ClassVar[tuple[str, ...]] = ()

    @property
    def fixed(self) -> tuple[str, ...]:
        """Keys that a resumed run of this scene may not change, while others may."""
        return ()

    def __post_init__(self) -> None:
        super().__post_init__()
        kind = self.kind
        self._take_defaults(kind.defaults)
        for key, value in _changed(self, kind.unread):
            raise InputError(key, value, unread_words(key, kind))
        self._check_shape(kind)
        self._check_feed()
        self._check_sizes()
        if self.particles is not None:
            cloud_words.check(self, kind.flow in self.coupled_flows)

    @property
    def kind(self) -> Kind:
        """The kind of this scene; raises InputError for a model that it cannot solve."""
        known = [kind for kind in KINDS if type(self) is kind.scene]
        for kind in known:
            if isinstance(self.model, kind.model):
                return kind
        words = " or ".join(f"a {kind.model.__name__}" for kind in known)
        raise InputError("model", self.model, f"{words}, which {type(self).__name__} can solve")

    # -- rules ---------------------------------------------------------------------------------

    def _take_defaults(self, defaults: Mapping[str, Any]) -> None:
        """Fill in what is None and has a default that depends on the kind."""
        for f in fields(self):
            part = getattr(self, f.name)
            if isinstance(part, Parameters):
                for inner in fields(part):
                    key = key_of(type(part), inner)
                    if key in defaults and getattr(part, inner.name) is None:
                        part = replace(part, **{inner.name: defaults[key]})
                object.__setattr__(self, f.name, part)

    def _check_shape(self, kind: Kind) -> None:
        """The shape is one of the kind, and a quarter does where the model is symmetric enough."""
        check_shape(self.geometry.shape, kind)
        symmetry = self.geometry.symmetry
        if symmetry == "quarter" and kind.model.symmetry != "quarter":
            words = f"one of auto, half, none for flow {kind.flow!r}, whose weight acts downwards"
            raise InputError("geometry.symmetry", symmetry, words)

    def _check_feed(self) -> None:
        """Solids need a feed and a feed needs solids; a hold-up lies below packing."""
        key, solids = self.feed.solids_key, self.model.solids
        if solids is None:
            if key is not None:
                value = getattr(self.feed, key)
                raise InputError(f"operation.{key}", value, "a table [solids] beside it")
            return
        if key is None:
            words = "one of solids_fraction, solids_superficial_velocity, solids_mass_flow"
            raise InputError("operation.solids_fraction", None, words)
        fraction, limit = self.feed.solids_fraction, solids.packing_limit
        if fraction is not None and fraction >= limit:
            words = f"a number below solids.packing_limit = {limit}"
            raise InputError("operation.solids_fraction", fraction, words)

    def _check_sizes(self) -> None:
        """Particles, wall distance and mesh are smaller than the section."""
        width, solids = self.geometry.hydraulic_diameter, self.model.solids
        sizes = {
            "solids.diameter": (solids and solids.diameter, width),
            "walls.distance": (self.model.wall_distance, width / 2),
            "numerics.mesh_size": (self.resolution.mesh_size, width),
        }
        for key, (size, limit) in sizes.items():
            if size is not None and size >= limit:
                raise InputError(key, size, f"a length below {limit:g} m, to fit in the section")

    # -- derived numbers -----------------------------------------------------------------------

    @cached_property
    def physics(self) -> P:
        """What only the model of this scene tells."""
        found: P = self.kind.physics(self)
        return found

    @property
    def wall_offset(self) -> float:
        """Distance y_p at which the wall law of the gas holds [m]."""
        width = self.geometry.hydraulic_diameter
        return float(self.model.wall_offset(self.feed.gas_velocity, width))

    @property
    def section(self) -> Section:
        """The part of the section that is solved."""
        return self.physics.section

    @property
    def reynolds(self) -> float:
        """U D_h/nu of the gas [-]."""
        gas, width = self.model.gas, self.geometry.hydraulic_diameter
        return float(self.feed.gas_velocity * width * gas.density / gas.viscosity)

    @property
    def gravity(self) -> tuple[float, float, float]:
        """Acceleration of gravity in the axes of the section [m/s2]."""
        return self.geometry.gravity_vector(self.feed.gravity)

    @property
    def solids_feed(self) -> tuple[str, float] | None:
        """("holdup", alpha_s) or ("flux", superficial velocity [m/s]); None for the gas alone."""
        if self.model.solids is None:
            return None
        return self.feed.solids(self.geometry.area, self.model.solids.density)

    @property
    def solids_inlet(self) -> tuple[float, float] | None:
        """alpha_s [-] and u_s [m/s] of the solids that enter; None for the gas alone."""
        if self.model.solids is None:
            return None
        sizes = self.geometry.area, self.geometry.hydraulic_diameter
        return self.feed.entering(self.model.gas, self.model.solids, *sizes)

    # -- what a scene gives --------------------------------------------------------------------

    @property
    @abstractmethod
    def files(self) -> Sequence[str]:
        """Names of what a run may leave in its directory."""

    @abstractmethod
    def recorder(self, setting: Setting | None = None) -> R:
        """What a run tells and keeps while it works."""

    @abstractmethod
    def solve(self, recorder: R, previous: Answer | None = None) -> Answer:
        """The answer; it goes on from a checkpoint where the recorder says so.

        previous : answer of a neighbouring scene to start from, which is used up

        Raises
        ------
        SolverError
            no answer was reached.
        """

    @abstractmethod
    def describe(self) -> dict[str, Any]:
        """What would be solved, what is left out and why, and what it would take."""

    def expected_time(self) -> float:
        """About the CPU time of a run whose forms are compiled [s], nan where nothing tells it."""
        return math.nan

    @abstractmethod
    def skipped(self) -> list[str]:
        """What the scene did not need, and why."""

    @abstractmethod
    def advice(self) -> list[str]:
        """What the user probably did not mean, one sentence each."""

    def judge(self, answer: Answer) -> list[str]:
        """What an answer must say of itself; raises SolverError where it is none."""
        return judge(self, answer)

    def estimates(self, answer: Answer) -> list[str]:
        """What published correlations give for the same line, in words."""
        return []

    def warnings(self) -> list[str]:
        """`advice`, doubted numbers, and what is to be said of the particles."""
        said = self.advice() + doubts(self._judged())
        return said + (cloud_words.advice(self) if self.particles is not None else [])

    def left_out(self) -> list[str]:
        """`skipped`, and what the particles are followed without."""
        return self.skipped() + (cloud_words.skipped(self) if self.particles is not None else [])

    def derived(self) -> list[Derived]:
        """Numbers that follow from the scene, and what they give away."""
        return []

    def _judged(self) -> list[Derived]:
        """`derived`, and the numbers of the particles."""
        found = self.derived()
        if self.particles is None:
            return found
        return found + cloud_words.derived(self, is_doubted(found))

    def numbers(self) -> list[str]:
        """Numbers that follow from the scene, in words."""
        return [*map(str, self._judged())]

    def examine(self) -> None:
        """Refuse what cannot be solved, without solving it; raises InputError."""

    def mesh_model(self) -> GmshModel:
        """The mesh as Gmsh makes it (the finest, where there are several).

        Raises InputError for a scene that has no mesh.
        """
        raise self._without_mesh()

    def mesh(self, comm: MPI.Comm = MPI.COMM_WORLD) -> Mesh:
        """The mesh (the finest, where there are several); collective.

        Raises InputError for a scene that has no mesh.
        """
        raise self._without_mesh()

    def _without_mesh(self) -> InputError:
        return InputError("solution", self.solution, f"a scene with a mesh; {self.kind} has none")

    def run(
        self,
        out: str | Path | None = None,
        *,
        overwrite: bool = False,
        resume: bool = False,
        quiet: bool = True,
        comm: MPI.Comm = MPI.COMM_WORLD,
    ) -> Result:
        """Solve the scene; with `out` the results are written to that directory.

        Raises
        ------
        InputError
            the place is taken, or `resume` finds no checkpoint of this scene; nothing is written.
        SolverError
            no answer was reached; the last good state and the reason are in `out`.
        """
        place = results_directory(out, overwrite, resume, comm)
        with Progress(quiet, comm) as progress:
            setting = Setting(place, progress, resume, comm)
            result, answer = self.carry_out(setting, overwrite=overwrite)
        answer.close()
        return result

    def carry_out(
        self, setting: Setting, previous: Answer | None = None, overwrite: bool = False
    ) -> tuple[Result, Answer]:
        """Solve the scene, write its results and return them with what a neighbour may start from.

        previous : answer of a neighbouring scene, which is used up

        Raises InputError and SolverError as `run` does.
        """
        self.examine()
        check_cache(setting.comm)
        if setting.out is not None:
            prepare(self, setting, overwrite)
        for sentence in self.warnings():
            setting.progress.warn(sentence)
        # last, for from here on an interruption leaves a result
        recorder = self.recorder(setting)
        return _drive(self, recorder, previous)


def _changed(part: Parameters, keys: Iterable[str]) -> Iterable[tuple[str, Any]]:
    """Those of the keys that are not at their default, in an object and in those that it holds."""
    for inner in fields(part):
        key, value = key_of(type(part), inner), getattr(part, inner.name)
        if isinstance(value, Parameters):
            yield from _changed(value, keys)
        elif key in keys and value != inner.default:
            yield key, value


class Differentiable(Protocol):
    """State of an answer that tells how its pressure gradient G depends on the scene's numbers."""

    def adjoint(self) -> tuple[np.ndarray, np.ndarray]:
        """Adjoint (v, w) of G: v on the unknowns that this rank owns, w on the constraints."""

    def lagrangian(self, scene: Any, adjoint: tuple[np.ndarray, np.ndarray]) -> float:
        """G - v.F - w.c of this state under the numbers of a neighbouring scene [Pa/m].

        F is the residual and c are the constraints. The state stays as it is.
        Raises InputError for a scene that differs in more than numbers.
        """


@dataclass
class Answer:
    """What a scene that was solved tells.

    status : "converged" or "finished"
    quantities : by name, in the units of `output.result.unit_of`
    balances : relative errors [-]
    headline : the quantity that the last line of the log tells
    errors : estimated errors of quantities, where they are known
    unestimated : why they are not known where none is
    references : published values that belong to the flow
    notes : what this answer says of itself: terms of the mesh that were raised, finer meshes
    inputs : what the inputs that the source does not print move the pressure gradient by
    state : what the scene may start a neighbour from
    """

    status: str
    quantities: Mapping[str, float]
    balances: Mapping[str, float]
    headline: str
    errors: Mapping[str, float | None] = field(default_factory=dict)
    unestimated: str = ""
    references: Mapping[str, Sequence[Published]] = field(default_factory=dict)
    notes: Sequence[str] = ()
    inputs: Sequence[InputRange] = ()
    state: Any = None
    factorisations: int = 0
    start: str = "cold"

    def close(self) -> None:
        """Free what the state holds."""
        if self.state is not None:
            self.state.close()
            self.state = None


def _drive[R: Recorder](
    scene: Scene[Any, R], recorder: R, previous: Answer | None
) -> tuple[Result, Answer]:
    """Solve a scene and write its results."""
    try:
        answer = _solved(scene, recorder, previous)
        return _finish(scene, answer, recorder), answer
    except SolverError as stop:
        _keep(scene, recorder, "failed", str(stop))
        raise SolverError(f"{stop}{_whereabouts(recorder)}") from stop
    except TimeIsUp as stop:
        _keep(scene, recorder, "interrupted", str(stop))
        raise SolverError(f"{stop}{_whereabouts(recorder)}") from stop
    except KeyboardInterrupt:
        _keep(scene, recorder, "interrupted", "interrupted by the user")
        raise
    finally:
        recorder.close()


def _solved[R: Recorder](scene: Scene[Any, R], recorder: R, previous: Answer | None) -> Answer:
    """The answer; where there is none, what made the scene doubtful is told as the likely cause."""
    try:
        return scene.solve(recorder, previous)
    except SolverError as stop:
        if not (said := doubts(scene._judged())):
            raise
        raise SolverError(f"{stop}; likely cause: {'; '.join(said)}") from stop


def _whereabouts(recorder: Recorder) -> str:
    """Where an unfinished run has left its last state, in words."""
    out = recorder.out
    return f"; its last state is in {out} (fields.xdmf, --resume)" if out is not None else ""


def _finish(scene: Scene[Any, Any], answer: Answer, recorder: Recorder) -> Result:
    """Quantities with their errors, balances and files of an answer."""
    recorder.lap("solve")
    warnings = scene.judge(answer)
    for sentence in warnings:
        recorder.progress.warn(sentence)
        recorder.log(f"warning: {sentence}")
    result = _result(scene, answer.status, recorder)
    result.warnings += warnings
    told, known = dict(answer.quantities), dict(answer.errors)
    if (tracked := recorder.tracked) is not None:
        told |= tracked.quantities()
        known |= tracked.errors()
        for sentence in tracked.warnings():
            recorder.progress.warn(sentence)
            result.warnings.append(sentence)
    errors = dict.fromkeys(told) | known
    result.quantities = with_references(scene, told, errors, answer.references)
    result.balances = dict(answer.balances)
    estimated = any(error is not None for error in answer.errors.values())
    result.unestimated = "" if estimated else answer.unestimated
    result.notes = list(answer.notes)
    result.inputs = list(answer.inputs)
    result.estimates = scene.estimates(answer)
    recorder.write_all(result)
    draw_split(result, recorder.out, scene.output.pictures, recorder.comm)
    recorder.save_final()
    recorder.lap("output")
    recorder.write(result)
    name, unit = answer.headline, (unit_of(answer.headline) or "").strip("-")
    sentence = f"{name.replace('_', ' ')} {result[name]:.6g} {unit}".rstrip()
    recorder.log(f"{answer.status}: {sentence}")
    return result


def _keep(scene: Scene[Any, Any], recorder: Recorder, status: str, reason: str) -> None:
    """Write what an unfinished run has: its last accepted state and why it stopped."""
    result = _result(scene, status, recorder, reason)
    recorder.log(f"{status}: {reason}")
    if recorder.section is not None:
        recorder.step_back()
        recorder.write_all(result)
    recorder.write(result)


def _result(scene: Scene[Any, Any], status: str, recorder: Recorder, reason: str = "") -> Result:
    """A result without numbers yet."""
    solved = recorder.section
    return Result(
        status=status,
        flow=scene.kind.flow,
        solution=scene.solution,
        title=scene.title,
        cells=solved.mesh.num_cells if solved else 0,
        dofs=solved.dofs if solved else 0,
        ranks=recorder.comm.size,
        seconds=recorder.seconds,
        skipped=scene.left_out(),
        warnings=scene.warnings(),
        inferred=list(scene.inferred),
        versions=versions(),
        reason=reason,
        directory=recorder.out,
    )


def with_references(
    scene: Scene[Any, Any],
    found: Mapping[str, float],
    errors: Mapping[str, float | None],
    known: Mapping[str, Sequence[Published]],
) -> dict[str, Quantity]:
    """Quantities with their errors, the references of the scene and those that are `known`."""
    references: dict[str, list[Published]] = {}
    for given in scene.references:
        references.setdefault(given.quantity, []).append(Published(given.value, given.source))
    for name, more in known.items():
        references.setdefault(name, []).extend(more)
    return {
        name: Quantity(
            value, unit_of(name) or "-", errors[name], references=tuple(references.get(name, ()))
        )
        for name, value in found.items()
    }

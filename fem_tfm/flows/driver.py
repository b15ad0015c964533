# SPDX-License-Identifier: LGPL-3.0-or-later
"""From a case to the files of its results, whatever the kind of flow."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

from fem_tfm.case import QUANTITIES, Case
from fem_tfm.errors import SolverError
from fem_tfm.flows.recorder import Recorder, check_resumable, prepare, with_references
from fem_tfm.output.files import on_root
from fem_tfm.output.result import Reference, Result, versions

if TYPE_CHECKING:
    from fem_tfm.progress import Progress


@dataclass(frozen=True)
class Answer:
    """What a flow that was solved tells.

    status : "converged" or "finished"
    quantities : by name, in the units of `case.QUANTITIES`
    balances : relative errors [-]
    headline : the quantity that the last line of the log tells
    errors : estimated errors of quantities, where they are known
    references : published values that belong to the flow
    notes : what this answer does without, beside what the scene skips
    """

    status: str
    quantities: Mapping[str, float]
    balances: Mapping[str, float]
    headline: str
    errors: Mapping[str, float | None] = field(default_factory=dict)
    references: Mapping[str, Sequence[Reference]] = field(default_factory=dict)
    notes: Sequence[str] = ()


@dataclass(frozen=True)
class Scene:
    """What a kind of flow brings to a run.

    recorder : makes what the run tells and keeps, from case, directory, progress and resume
    files : what a run may leave in its directory
    advice : what the user probably did not mean
    skipped : what the scene did not need
    solve : the answer to a case; it goes on from a checkpoint where the recorder says so
    write : fields, tables and pictures of the state that the recorder holds, whether it is an
        answer or not
    """

    recorder: Callable[[Case, Path | None, Progress, bool], Recorder]
    files: Sequence[str]
    advice: Callable[[Case], list[str]]
    skipped: Callable[[Case], list[str]]
    solve: Callable[[Case, Any], Answer]
    write: Callable[[Case, Any, Result], None]


def drive(
    scene: Scene,
    case: Case,
    out: Path | None,
    *,
    resume: bool,
    overwrite: bool,
    progress: Progress,
) -> Result:
    """Solve a case and write its results to `out` (nothing is written when it is None).

    Raises
    ------
    InputError
        `resume` finds no checkpoint, or one of another case.
    SolverError
        no answer was reached; the last good state and the reason are in `out`.
    """
    if resume:
        check_resumable(case, out)
    if out is not None:
        on_root(MPI.COMM_WORLD, lambda: prepare(case, out, overwrite, scene.files))
    recorder = scene.recorder(case, out, progress, resume)
    for sentence in scene.advice(case):
        progress.warn(sentence)
    try:
        return _finish(scene, case, scene.solve(case, recorder), recorder)
    except SolverError as stop:
        _keep(scene, case, recorder, "failed", str(stop))
        hint = f"; its last state is in {out} (fields.xdmf, --resume)" if out is not None else ""
        raise SolverError(f"{stop}{hint}") from stop
    except KeyboardInterrupt:
        _keep(scene, case, recorder, "interrupted", "interrupted by the user")
        raise
    finally:
        recorder.close()


def _finish(scene: Scene, case: Case, answer: Answer, recorder: Recorder) -> Result:
    """Quantities with their errors, balances and files of an answer."""
    recorder.lap("solve")
    result = _result(scene, case, answer.status, recorder)
    errors = dict.fromkeys(answer.quantities) | dict(answer.errors)
    result.quantities = with_references(case, answer.quantities, errors, answer.references)
    result.balances = dict(answer.balances)
    result.skipped += answer.notes
    scene.write(case, recorder, result)
    recorder.save_final()
    recorder.lap("output")
    recorder.write(result)
    name, unit = answer.headline, QUANTITIES[answer.headline].strip("-")
    told = f"{name.replace('_', ' ')} {result[name]:.6g} {unit}".rstrip()
    recorder.log(f"{answer.status}: {told}")
    return result


def _keep(scene: Scene, case: Case, recorder: Recorder, status: str, reason: str) -> None:
    """Write what an unfinished run has: its last accepted state and why it stopped."""
    result = _result(scene, case, status, recorder, reason)
    recorder.log(f"{status}: {reason}")
    if recorder.section is not None:
        recorder.step_back()
        scene.write(case, recorder, result)
    recorder.write(result)


def _result(scene: Scene, case: Case, status: str, recorder: Recorder, reason: str = "") -> Result:
    """A result without numbers yet."""
    solved = recorder.section
    return Result(
        status=status,
        flow=case.flow,
        solution="developed" if case.solution == "auto" else case.solution,
        title=case.title,
        cells=solved.mesh.num_cells if solved else 0,
        dofs=solved.dofs if solved else 0,
        ranks=recorder.comm.size,
        seconds=recorder.seconds,
        skipped=scene.skipped(case),
        inferred=list(case.inferred),
        versions=versions(),
        reason=reason,
        directory=recorder.out,
    )

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nested iteration: a steady section solved from a coarse mesh to a fine one.

The cold start costs tens of factorisations, so it is made where they are cheap; each finer mesh
starts from the coarser answer and needs a handful. The last two meshes give the error estimate.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

from fem_tfm.errors import SolverError
from fem_tfm.solvers import easing
from fem_tfm.solvers.easing import MeshTerms
from fem_tfm.solvers.pseudo_time import History, PseudoTime, PseudoTimeControl

# update at which a mesh is left for a finer one
COARSE_TOLERANCE = 1e-3
# update of a coarser mesh that only leads the finest one and tells its error
GUIDE_TOLERANCE = 1e-6
# shares of the largest number of steps: for one way to start, for a warm start, which needs a
# handful of steps or never ends, for its second trial, and for lowering the mesh's terms
PATIENCE, WARM_PATIENCE, SECOND_PATIENCE, FOLLOWING = 0.5, 0.2, 0.15, 0.3
# smallest step of that trial over its first one: those that get there take steps of half the first
SECOND_SMALLEST = 0.1
# share of a correction that a full Newton step of a warm start has to remove: shorter steps do not
# leave the neighbourhood of the answer
WARM_DECREASE = 0.6
# steps of a careful march end closer to their solution and grow slower
CAREFUL: dict[str, Any] = {"loose": 0.1, "max_iterations": 15, "growth": 1.5, "saturate": False}
# a neighbouring problem is approached in up to two to the power of this many parts, each of which
# ends at this update; a part whose steps have to shrink below a share of the largest is halved
HALVINGS, PART_TOLERANCE, LEAST_SHARE = 4, 5e-2, 0.5
# strengths of the terms of the mesh, tried where the standard ones lead to no steady state; the
# first of them also starts a cold mesh
RAISED = (4.0, 16.0)


@dataclass
class Level:
    """One mesh with its answer and what it cost."""

    section: Any
    history: History
    drive: float
    compile_seconds: float
    cpu_seconds: float


@dataclass
class Solution:
    """Answers on a sequence of meshes, coarse to fine."""

    levels: list[Level] = field(default_factory=list)

    @property
    def section(self) -> Any:
        """The finest section."""
        return self.levels[-1].section


class Observer:
    """What a solve tells while it works; this one keeps it to itself."""

    def compiling(self, what: str) -> None:
        """A form is about to be compiled."""

    def begin(self, section: Any, level: int, levels: int) -> None:
        """Mesh number `level` of `levels` is ready to be solved on."""

    def step(self, row: dict[str, float]) -> None:
        """A pseudo-time step was accepted."""

    def retry(self, dt: float, reason: str) -> None:
        """A step was taken back and is tried again with `dt` [s]."""


QUIET = Observer()
# what leads to a steady state, and what puts the section at its start
Start = Callable[[Any], None]
Way = tuple[Callable[[], History], Start]
Ease = Callable[[Any, MeshTerms], None]


@dataclass(frozen=True)
class Scheme:
    """How the sections of one kind of flow are made, started and stepped.

    section : makes one from a mesh, a setup and what hears of its forms
    cold : puts a section at a start of its own
    warm : puts it at the answer of another mesh
    follow : adds to it how a coarser one has changed since an older state
    control : steps of a section at a tolerance and a largest number of steps
    between : a setup between two
    ease : multiplies the terms of the mesh by factors; None where a section has none
    calm : starts a section with a large least rate of these terms
    """

    section: Callable[..., Any]
    cold: Callable[[Any], None]
    warm: Callable[[Any, Any], None]
    follow: Callable[..., None]
    control: Callable[[Any, float, int], PseudoTimeControl]
    between: Callable[[Any, Any, float], Any]
    ease: Ease | None = None
    calm: Start | None = None


def solve_level(
    section: Any,
    control: PseudoTimeControl,
    previous: Any,
    observer: Observer,
    scheme: Scheme,
) -> History:
    """Steady state of one section from a cold start, or from another mesh's answer.

    A warm start takes the largest step at once. Where it falls back to steps below the first one
    of a cold start, or wanders, it is made again with that first step; then a calm state is
    followed to the stated one; then the warm start has more steps, and then the mesh starts cold.
    A cold start goes over a state that stronger terms of the mesh hold up, and then without it.
    Then a calm state is followed to the stated one as far as may be, and the section tells how far
    that was. What still fails starts cold and careful, and then with more of the mesh's terms,
    which are lowered as far as the solution follows.

    Raises
    ------
    SolverError
        nothing led to a steady state.
    """
    ways = _ways(section, control, previous, observer, scheme)
    return _first_of([*ways.quick, *ways.patient], section, control, observer)


class _Ways(NamedTuple):
    """Ways to a steady state: quick ones, and patient ones for where these fail."""

    quick: list[Way]
    patient: list[Way]


def _ways(
    section: Any, control: PseudoTimeControl, previous: Any, observer: Observer, scheme: Scheme
) -> _Ways:
    """Ways from a cold start, or from the answer of another mesh.

    On a finer mesh a march from the coarser answer leads first, if it is short: one that gets there
    takes a few dozen factorisations, following a branch some hundred, and a march that fails
    several hundred.
    """
    patient = replace(control, max_steps=math.ceil(PATIENCE * control.max_steps))
    march, careful = (_march(section, c, observer) for c in (patient, replace(patient, **CAREFUL)))
    eased = _eased_ways(section, patient, observer, scheme)
    direct, calm, eased = eased[:1], eased[1:2], eased[2:]
    cold = _standard(scheme, scheme.cold)
    quick: list[Way] = []
    if previous is not None:
        warm = _standard(scheme, partial(_from, previous, scheme))
        few = math.ceil(SECOND_PATIENCE * control.max_steps)
        some = replace(control, max_steps=few, smallest=SECOND_SMALLEST * control.first)
        near, again = (_march(section, c, observer) for c in (_near(control), some))
        quick = [(partial(near.run, control.largest), warm), (again.run, warm), *direct]
        quick += [(march.run, warm), (march.run, cold), *calm]
    else:
        if scheme.ease is not None:
            quick.append(_braced(section, control, observer, scheme.ease, scheme.cold))
        quick += [(march.run, cold), *direct, *calm]
    return _Ways(quick, [(careful.run, cold), *eased])


def _near(control: PseudoTimeControl) -> PseudoTimeControl:
    """Steps from a start that is near the answer."""
    few = math.ceil(WARM_PATIENCE * control.max_steps)
    return replace(control, smallest=control.first, max_steps=few, decrease=WARM_DECREASE)


def _from(previous: Any, scheme: Scheme, section: Any) -> None:
    """Start from the answer of another mesh."""
    scheme.warm(section, previous)


def _standard(scheme: Scheme, begin: Start) -> Start:
    """Start with the standard terms of the mesh: a start that failed may leave raised ones."""
    return begin if scheme.ease is None else partial(_eased, scheme.ease, MeshTerms(), begin)


def _braced(
    section: Any, control: PseudoTimeControl, observer: Observer, ease: Ease, cold: Start
) -> Way:
    """The cold way over a state that stronger terms of the mesh hold up.

    A coarse mesh has several steady states, and those of the standard terms that a cold start
    finds differ by a factor of two; the one that continues the held-up state lies near the answer
    of finer meshes.
    """
    few = math.ceil(WARM_PATIENCE * control.max_steps)
    rough = replace(control, tolerance=max(control.tolerance, COARSE_TOLERANCE), max_steps=few)

    def run() -> History:
        _march(section, rough, observer).run()
        ease(section, MeshTerms())
        return _march(section, _near(control), observer).run(control.largest)

    return run, partial(_eased, ease, MeshTerms(RAISED[0]), cold)


def _first_of(
    ways: Sequence[Way], section: Any, control: PseudoTimeControl, observer: Observer
) -> History:
    """Take the first way that leads to a steady state; the last one's SolverError goes out."""
    for run, begin in ways[:-1]:
        begin(section)
        try:
            return run()
        except SolverError as error:
            observer.retry(control.first, f"{error}; another start")
    run, begin = ways[-1]
    begin(section)
    return run()


def _eased_ways(
    section: Any, control: PseudoTimeControl, observer: Observer, scheme: Scheme
) -> list[Way]:
    """Ways that start with raised terms of the mesh: calm ones, then cold marches."""
    ease, calm = scheme.ease, scheme.calm
    if ease is None or calm is None:
        return []
    steps = math.ceil(FOLLOWING * control.max_steps)
    march, rate = march_of(section, observer), 10**easing.CALMEST
    follower = march(replace(control, max_steps=steps))
    starts: list[tuple[Callable[[], History], MeshTerms, Start]] = []
    for strength, direct in ((1.0, True), (1.0, False), (RAISED[-1], False)):
        calming = easing.Calming(section, march, control, ease, strength, direct)
        starts.append((calming.run, MeshTerms(strength, rate), calm))
    starts += [(march(control).run, MeshTerms(strength), scheme.cold) for strength in RAISED]
    return [
        (
            partial(easing.lowered, section, run, follower, ease),
            partial(_eased, ease, terms, begin),
        )
        for run, terms, begin in starts
    ]


def _eased(ease: Ease, terms: MeshTerms, begin: Start, section: Any) -> None:
    """Start with other terms of the mesh."""
    ease(section, terms)
    begin(section)


def march_of(section: Any, observer: Observer) -> Callable[[PseudoTimeControl], PseudoTime]:
    """What makes the driver of a section for a step control."""
    return lambda control: _march(section, control, observer)


def _march(section: Any, control: PseudoTimeControl, observer: Observer) -> PseudoTime:
    parts = section.newton, section.old, section.idt
    return PseudoTime(*parts, control, observer.step, observer.retry, section.lag)


def solve(
    meshes: Sequence[Callable[[], Any]],
    setup: Any,
    tolerance: float,
    max_steps: int,
    observer: Observer,
    scheme: Scheme,
    restart: tuple[int, Callable[[Any], None]] | None = None,
) -> Solution:
    """Solve on each mesh in turn, coarse to fine.

    scheme : the kind of section
    restart : number of a mesh and what puts a stored state on it; the mesh before it is solved
        again from that state, so that there is an error estimate

    Raises
    ------
    SolverError
        when the finest mesh does not reach its steady state.
    """
    solution, stored, built = Solution(), None, {}
    if restart is not None:
        built[restart[0]] = stored = scheme.section(meshes[restart[0]](), setup, observer.compiling)
        restart[1](stored)
    for i in range(max(restart[0] - 1, 0) if restart else 0, len(meshes)):
        began = time.perf_counter()
        section = built.get(i) or scheme.section(meshes[i](), setup, observer.compiling)
        compiled, cpu = time.perf_counter() - began, time.process_time()
        control = scheme.control(section, tolerance, max_steps)
        if i < len(meshes) - 2:
            control = replace(control, tolerance=max(tolerance, COARSE_TOLERANCE))
        observer.begin(section, i, len(meshes))
        previous = solution.levels[-1].section if solution.levels else stored
        try:
            if section is stored:
                history = _march(section, control, observer).run()
            else:
                history = solve_level(section, control, previous, observer, scheme)
        except SolverError:
            # a coarse mesh is only a help: a flow it cannot hold may well be steady on a finer one
            if i == len(meshes) - 1:
                raise
            section.newton.destroy()
            continue
        cpu = time.process_time() - cpu
        level = Level(section, history, float(section.drive.value), compiled, cpu)
        solution.levels.append(level)
    return solution


def refine(
    solution: Solution,
    mesh: Callable[[], Any],
    setup: Any,
    tolerance: float,
    max_steps: int,
    observer: Observer,
    scheme: Scheme,
) -> None:
    """Solve on one more mesh, from the answer on the finest one, and add it to the solution.

    It takes the quick ways alone: the patient ones would take many minutes on a fine mesh.

    Raises
    ------
    SolverError
        when the mesh does not reach its steady state.
    """
    began, count = time.perf_counter(), len(solution.levels)
    section = scheme.section(mesh(), setup, observer.compiling)
    compiled, cpu = time.perf_counter() - began, time.process_time()
    observer.begin(section, count, count + 1)
    control = scheme.control(section, tolerance, max_steps)
    ways = _ways(section, control, solution.section, observer, scheme)
    history = _first_of(ways.quick, section, control, observer)
    cpu = time.process_time() - cpu
    solution.levels.append(Level(section, history, float(section.drive.value), compiled, cpu))


def resolve(
    solution: Solution,
    setup: Any,
    tolerance: float,
    max_steps: int,
    observer: Observer,
    scheme: Scheme,
) -> Solution:
    """Solve a neighbouring problem on the last two meshes of a solution, which is used up.

    The setup has the structure of the old one and differs in numbers. The coarser mesh starts from
    its old state, the finer one from its old state and the change of the coarser. What is too far
    away for that is approached in parts.

    Raises
    ------
    SolverError
        when a mesh does not reach its steady state from there; the solution is lost then.
    """
    found, coarser = Solution(), None
    for old in solution.levels[-2:]:
        section, cpu = old.section, time.process_time()
        given, before = section.setup, section.stored()
        section.update(setup)
        if coarser is not None:
            scheme.follow(section, *coarser)
        enough = max(tolerance, GUIDE_TOLERANCE) if old is not solution.levels[-1] else tolerance
        control = scheme.control(section, enough, max_steps)
        # only here do the factors at hand belong to a solved neighbour
        _march(section, control, observer).approach()
        try:
            history = _direct(section, control, observer)
        except SolverError:
            section.restore(before)
            history = _by_parts(section, given, setup, control, observer, scheme)
        coarser = section, before[0]
        drive, cpu = float(section.drive.value), time.process_time() - cpu
        found.levels.append(Level(section, history, drive, 0.0, cpu))
    return found


def _direct(section: Any, control: PseudoTimeControl, observer: Observer) -> History:
    """Steps of about the largest size alone; SolverError where they have to shrink."""
    control = replace(control, smallest=LEAST_SHARE * control.largest)
    return _march(section, control, observer).run(first=control.largest)


def _by_parts(
    section: Any,
    given: Any,
    wanted: Any,
    control: PseudoTimeControl,
    observer: Observer,
    scheme: Scheme,
) -> History:
    """Follow the steady state from one setup to another; where that fails, march to it."""
    rough, done, part = replace(control, tolerance=PART_TOLERANCE), 0.0, 0.5
    while part >= 0.5**HALVINGS:
        kept, share = section.stored(), min(done + part, 1.0)
        section.update(scheme.between(given, wanted, share))
        try:
            if share == 1.0:
                return _direct(section, control, observer)
            _direct(section, rough, observer)
        except SolverError:
            section.restore(kept)
            part /= 2
        else:
            done = share
    section.update(wanted)
    return _march(section, control, observer).run(first=control.largest)


def with_changes(
    found: Sequence[dict[str, float]],
) -> tuple[dict[str, float], dict[str, float | None]]:
    """Quantities on the last of several meshes, and the change of each since the mesh before.

    The change bounds the error: at order 2 and halved cells the error is a third of it. It is None
    where only one mesh was solved.
    """
    if len(found) == 1:
        return found[0], dict.fromkeys(found[0])
    before, last = found[-2:]
    return last, {name: abs(last[name] - before[name]) for name in last}

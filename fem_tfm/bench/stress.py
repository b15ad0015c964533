# SPDX-License-Identifier: LGPL-3.0-or-later
"""Random dense-phase cases over every law: the share that reaches a steady state.

The cases are drawn with a fixed seed, so that two versions of the solver face the same ones. The
laws are drawn as a few sets, since each new set costs a compilation; each name of each family
stands in several sets. The gas is turbulent by the default law, which is laminar where the flow is:
a laminar gas at a high Reynolds number is no steady flow. The constant drag law has no default that
fits every scene: its constant is drawn around Ergun's and Stokes's size of the case. Every case is
solved on the two coarsest meshes of the nested iteration, and on finer ones where these disagree.
An answer must be steady to the tolerance of the case, close its balances and have an estimated
error below that of any answer; one that needs raised terms of the mesh says so, and its error holds
their effect.
"""

from __future__ import annotations

import math
import re
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from mpi4py import MPI

from fem_tfm.case import Case
from fem_tfm.closures import make, names
from fem_tfm.errors import SolverError
from fem_tfm.scenes.judged.answer import doubtful
from fem_tfm.solvers.easing import MeshTerms

SEED, CASES, SETS = 2024, 200, 26
# ranges of the numbers: low, high, and whether the logarithm is uniform
RANGES = {
    "operation.solids_fraction": (0.02, 0.55, False),
    "operation.gas_superficial_velocity": (1.0, 30.0, True),
    "geometry.diameter": (4e-3, 0.2, True),
    "solids.diameter": (3e-5, 2e-3, True),
    "solids.density": (500.0, 4000.0, False),
    "solids.restitution": (0.5, 0.99, False),
    "gas.density": (1.0, 40.0, True),
}
LARGEST_GRAIN = 0.1  # of the pipe diameter
VISCOSITY = 1.8e-5
CONSTANT_DRAG = (0.3, 3.0)  # factor on the size of the case, its logarithm uniform
LEVEL_PIPES = UPRIGHT_PIPES = 0.25  # shares at exactly 0 and 90 degrees, the rest in between
FAMILIES = {
    "closures.drag": "drag",
    "closures.radial": "radial",
    "closures.granular": "granular",
    "closures.friction": "friction",
    "walls.gas": "gas-wall",
    "walls.solids": "solids-wall",
}
# hardly another law than that of Schiller and Naumann, clusters of dilute risers, walls of dilute
# lines: none is meant for dense flow
LEFT_OUT = {"clift-gauvin", "igci", "rough"}
# with transported turbulence; the other laws are those of the cases without
TURBULENCE = {
    "closures.turbulence": "turbulence",
    "closures.dispersed": "dispersed",
    "closures.dispersion": "dispersion",
}
ALGEBRAIC_SHARE = FEEDING_SHARE = 0.25
# these laws hold the grains at their friction_limit, which is the packed fraction
PLASTIC, PACKED_FRACTION = ("schaeffer", "syamlal"), 0.58


@dataclass(frozen=True)
class Outcome:
    """What became of one case; `reason` is empty where it converged.

    error : estimate of the error of the gradient [Pa/m]
    mesh_terms : terms of the mesh that the answer needed
    """

    number: int
    reason: str
    factorisations: int
    cpu_seconds: float
    gradient: float = math.nan
    error: float = math.nan
    mesh_terms: MeshTerms = field(default_factory=MeshTerms)

    @property
    def converged(self) -> bool:
        """Whether there is an answer."""
        return not self.reason

    @property
    def cause(self) -> str:
        """The reason without its numbers, so that equal ones can be counted."""
        return without_numbers(self.reason)


def without_numbers(reason: str) -> str:
    """A sentence with # for each number."""
    return re.sub(r"-?\d+(\.\d+)?(e[+-]?\d+)?", "#", reason)


def _column(
    family: str, length: int, rng: np.random.Generator, turbulent: bool = False
) -> list[str]:
    """Names of a family in random order, each about equally often.

    Without transported turbulence those that need it are left out; with it, a turbulence must be.
    """
    laws: dict[str, Any] = {n: make(family, n) for n in names(family) if n not in LEFT_OUT}
    known = [n for n, law in laws.items() if turbulent or not getattr(law, "needs_k", False)]
    if family == "turbulence":
        known = [name for name in known if laws[name].transported]
    drawn = [known[i % len(known)] for i in range(length)]
    return [drawn[i] for i in rng.permutation(length)]


def law_sets(number: int = SETS, seed: int = SEED, turbulent: bool = False) -> list[dict[str, Any]]:
    """Sets of laws as case values; every law stands in at least two of 26."""
    rng = np.random.default_rng(seed)
    columns = {key: _column(family, number, rng) for key, family in FAMILIES.items()}
    _part_unbounded(columns["closures.radial"], columns["closures.friction"])
    algebraic = rng.permutation(number) < ALGEBRAIC_SHARE * number
    feeding = rng.permutation(number) < FEEDING_SHARE * number
    if not turbulent:
        # eddies neither carry nor spread the grains
        columns |= {key: ["none"] * number for key in ("closures.dispersed", "closures.dispersion")}
    if turbulent:
        columns |= {key: _column(f, number, rng, True) for key, f in TURBULENCE.items()}
        # a turbulence with a wall law needs one
        columns["walls.gas"] = ["log-law"] * number
    sets: list[dict[str, Any]] = [
        {key: column[i] for key, column in columns.items()} for i in range(number)
    ]
    for laws, local, feeds in zip(sets, algebraic, feeding, strict=True):
        laws["closures.theta"] = "algebraic" if local else "transport"
        laws["closures.friction_feeds_theta"] = bool(feeds)
    return sets


def _part_unbounded(radial: list[str], friction: list[str]) -> None:
    """Swap radial laws so that g0 is unbounded at packing wherever there is no friction.

    With neither, nothing holds a settled bed up and there is no steady state.
    """
    bounded = "carnahan-starling"
    for i, law in enumerate(friction):
        if law == "none" and radial[i] == bounded:
            free = (k for k, other in enumerate(friction) if other != "none")
            j = next(k for k in free if radial[k] != bounded)
            radial[i], radial[j] = radial[j], radial[i]


def _numbers(rng: np.random.Generator) -> dict[str, float]:
    """Numbers of one case, each within its range."""
    drawn: dict[str, float] = {}
    for key, (low, high, logarithmic) in RANGES.items():
        if key == "solids.diameter":
            high = min(high, LARGEST_GRAIN * drawn["geometry.diameter"])
        scale = (math.log, math.exp) if logarithmic else (float, float)
        drawn[key] = scale[1](rng.uniform(scale[0](low), scale[0](high)))
    share, angle = rng.uniform(), rng.uniform(0, 90)
    if share < LEVEL_PIPES + UPRIGHT_PIPES:
        angle = 0.0 if share < LEVEL_PIPES else 90.0
    return drawn | {"geometry.inclination_deg": angle}


def _constant_drag(numbers: dict[str, float], factor: float) -> dict[str, Any]:
    """The constant law with `factor` times Ergun's viscous part and Stokes's drag, beta/alpha_s.

    150 a mu/[(1 - a) d^2] + 18 mu/d^2 [kg/m3/s]
    """
    alpha, diameter = numbers["operation.solids_fraction"], numbers["solids.diameter"]
    size = (150 * alpha / (1 - alpha) + 18) * VISCOSITY / diameter**2
    return {"model": "constant", "value": factor * size}


def nested(values: dict[str, Any]) -> dict[str, Any]:
    """Tables from dotted keys."""
    tables: dict[str, Any] = {}
    for key, value in values.items():
        table, _, name = key.partition(".")
        tables.setdefault(table, {})[name] = value
    return tables


def cases(
    number: int = CASES, sets: int = SETS, seed: int = SEED, turbulent: bool = False
) -> list[Case]:
    """The random cases, grouped by their laws; the first of a set are the same for any number."""
    rng, drag = np.random.default_rng([seed, 1]), np.random.default_rng([seed, 2])
    laws = law_sets(SETS, seed, turbulent)[:sets]
    drawn = [[_numbers(rng) for _ in range(-(-CASES // SETS))] for _ in laws]
    found = []
    for i, chosen in enumerate(laws):
        for numbers in drawn[i][: number // sets + (i < number % sets)]:
            values = chosen | numbers | {"gas.viscosity": VISCOSITY, "numerics.level": 1}
            if chosen["closures.drag"] == "constant":
                low, high = map(math.log, CONSTANT_DRAG)
                factor = math.exp(drag.uniform(low, high))
                values["closures.drag"] = _constant_drag(numbers, factor)
            if chosen["closures.friction"] in PLASTIC:
                values["solids.friction_limit"] = PACKED_FRACTION
            found.append(Case.from_dict(nested(values)))
    return found


def solve(case: Case, number: int = 0) -> Outcome:
    """Solve one case on its two meshes; an answer that breaks a balance does not count."""
    recorder, began = case.scene.recorder(), time.process_time()
    gradient, error_estimate, mesh_terms, reason = math.nan, math.nan, MeshTerms(), ""
    try:
        answer = case.scene.solve(recorder)
        gradient = answer.quantities["pressure_gradient"]
        mesh_terms = recorder.section.mesh_terms
        if answer.errors["pressure_gradient"] is not None:
            error_estimate = answer.errors["pressure_gradient"]
        answer.close()
        reason = doubtful(case.scene, answer.quantities, answer.errors)
    except SolverError as error:
        reason = str(error)
    except (ArithmeticError, RuntimeError, ValueError) as error:
        reason = f"not a SolverError but {type(error).__name__}: {error}"
    cpu, spent = time.process_time() - began, recorder.factorisations
    return Outcome(number, reason, spent, cpu, gradient, error_estimate, mesh_terms)


def describe(case: Case) -> str:
    """A case in two lines."""
    found = {key: case[key] for key in (*RANGES, "geometry.inclination_deg")}
    laws = [case[f"{key}.model"] for key in FAMILIES] + [case["closures.theta"]]
    laws += ["friction feeds theta"] * case["closures.friction_feeds_theta"]
    numbers = ", ".join(f"{key} = {value:.4g}" for key, value in found.items())
    return f"  {', '.join(laws)}\n  {numbers}"


def solve_all(chosen: Iterable[Case], total: int) -> Iterator[Outcome]:
    """Solve cases one after another and print how each of them ended."""
    for number, case in enumerate(chosen, start=1):
        outcome = solve(case, number)
        ended = f"G {outcome.gradient:.5g} Pa/m" if outcome.converged else "FAILED"
        terms = outcome.mesh_terms
        if outcome.converged:
            ended += f" +- {outcome.error:.2g}"
        if terms.raised:
            ended += f", mesh terms x{terms.strength:g}, rate x{terms.rate:.3g}"
        _tell(
            f"{number:4d}/{total}  {ended:<20} {outcome.factorisations:5d} factorisations "
            f"{outcome.cpu_seconds:6.1f} CPU s"
        )
        if not outcome.converged:
            _tell(f"  {outcome.reason}\n{describe(case)}")
        yield outcome


def summary(outcomes: list[Outcome]) -> str:
    """Share that converged, what it took, and a table of the causes of the rest."""
    done = [o for o in outcomes if o.converged]
    lines = [
        f"stress: {len(done)} of {len(outcomes)} cases converged "
        f"({100 * len(done) / len(outcomes):.1f} %), {sum(o.cpu_seconds for o in outcomes):.0f} "
        "CPU s with the compilation of forms"
    ]
    raised = sum(o.mesh_terms.raised for o in done)
    if raised:
        lines.append(f"{raised} of them with raised terms of the mesh")
    if done:
        middle, high = np.percentile([o.factorisations for o in done], [50, 95])
        lines.append(f"factorisations: median {middle:.0f}, 95 % below {high:.0f}")
    causes = Counter(o.cause for o in outcomes if not o.converged)
    lines += [f"{count:4d}  {cause}" for cause, count in causes.most_common()]
    return "\n".join(lines)


def run(number: int = CASES, sets: int = SETS, turbulent: bool = False) -> str:
    """Solve the random cases, print each, and return the summary."""
    chosen = cases(number, sets, turbulent=turbulent)
    return summary(list(solve_all(chosen, len(chosen))))


def run_quick() -> str:
    """Three cases of one set of laws."""
    return run(3, 1)


def run_turbulent() -> str:
    """The random cases with turbulence that is transported, in the gas and in the solids."""
    return run(turbulent=True)


def _tell(text: str) -> None:
    if MPI.COMM_WORLD.rank == 0:
        print(text, flush=True)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""What Ding et al. (2024) found, each finding judged by the numbers of the study."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

FRICTIONS = ("dartevelle", "srivastava-sundaresan", "berzi")
CASES = (1, 2, 3, 4, 5)
SLOW, FAST = (1, 2, 3), (4, 5)  # Q_s up to 0.8 m3/h, and above
REPRODUCED, IN_PART, NOT = "reproduced", "in part", "not reproduced"
UNKNOWN = "not known: a run failed, or the model does not have it"

# experiment [Pa] of the one case whose drop is printed, and the range of the paper's errors
EXPERIMENT, SCATTER = {3: 4.26e3}, (-0.0491, 0.0760)
# "friction only in the bed", "almost never exceeds 0.5": largest share that passes
FEW = 0.02
# z/D from which the paper calls the flow developed
DEVELOPED = 120.0

# quantities by law of friction and number of the case; a run that failed is not there
Answers = Mapping[tuple[str, int], Mapping[str, float]]


@dataclass(frozen=True)
class Finding:
    """One finding of the paper.

    verdict : REPRODUCED, IN_PART, NOT or UNKNOWN
    evidence : the numbers behind it
    figure : file that shows it, without its suffix
    """

    statement: str
    verdict: str
    evidence: str
    figure: str


def judged(statement: str, figure: str, checks: Mapping[str, bool]) -> Finding:
    """A finding that consists of several statements; those that fail are told."""
    failed = [name for name, passed in checks.items() if not passed]
    if not checks:
        return Finding(statement, UNKNOWN, "", figure)
    verdict = REPRODUCED if not failed else IN_PART if len(failed) < len(checks) else NOT
    parts = [f"{len(checks) - len(failed)} of {len(checks)} hold"]
    if failed:
        parts.append("not so: " + "; ".join(failed))
    return Finding(statement, verdict, "; ".join(parts), figure)


def findings(answers: Answers) -> list[Finding]:
    """All findings about the developed sections of one feed."""
    return [
        _fall_and_rise(answers),
        _experiment(answers),
        _drop_order(answers),
        _order(answers, "bed_alpha_s", "solids fraction of the bed", lowest=True),
        _order(answers, "bed_Theta", "granular temperature in the bed", lowest=False),
        _order(answers, "bed_u_s", "solids velocity in the bed", lowest=True),
        _order(answers, "bed_u_g", "gas velocity in the bed", lowest=True),
        _order(answers, "bed_k", "gas turbulence in the bed", lowest=True),
        _order(answers, "bed_k_s", "solids turbulence in the bed", lowest=True),
        _only_in_the_bed(answers),
        _falling(answers, "friction_pressure", "frictional stress falls with Q_s", "figure_8"),
        _falling(answers, "bed_fraction", "the bed shrinks with Q_s", "figure_5"),
        _loose(answers),
        _alike_above(answers),
    ]


def developed(lengths: Mapping[str, float]) -> Finding:
    """The flow is developed beyond 120 D; `lengths` is z/D from which each quantity stays."""
    statement = f"the flow is developed beyond {DEVELOPED:g} D"
    checks = {f"{n} within 1 % from {z:.0f} D": z <= DEVELOPED for n, z in lengths.items()}
    found = judged(statement, "figure_4", checks)
    told = ", ".join(f"{n} from {z:.0f} D" for n, z in lengths.items())
    return Finding(statement, found.verdict, f"within 1 % of the outlet: {told}", "figure_4")


# -- one finding each --------------------------------------------------------------------------


def _row(answers: Answers, friction: str, name: str) -> list[float] | None:
    """A quantity over all cases; None where one failed."""
    if any((friction, case) not in answers for case in CASES):
        return None
    return [answers[friction, case][name] for case in CASES]


def _rows(answers: Answers, name: str) -> Iterator[tuple[str, list[float]]]:
    for friction in FRICTIONS:
        if (row := _row(answers, friction, name)) is not None:
            yield friction, row


def _shown(values: Sequence[float], digits: int = 3) -> str:
    return ", ".join(f"{v:.{digits}g}" for v in values)


def _fall_and_rise(answers: Answers) -> Finding:
    checks = {}
    for friction, drops in _rows(answers, "pressure_drop"):
        least = drops.index(min(drops))
        falls = all(a > b for a, b in itertools.pairwise(drops[: least + 1]))
        rises = all(a < b for a, b in itertools.pairwise(drops[least:]))
        inside = 0 < least < len(drops) - 1
        checks[f"{friction} {_shown([d / 1e3 for d in drops])} kPa"] = falls and rises and inside
    return judged("the pressure drop falls, then rises with Q_s", "figure_3", checks)


def _experiment(answers: Answers) -> Finding:
    low, high = SCATTER
    checks = {}
    for (friction, case), found in answers.items():
        if case in EXPERIMENT:
            off = found["pressure_drop"] / EXPERIMENT[case] - 1
            checks[f"{friction} {100 * off:+.1f} %"] = low <= off <= high
    statement = f"the pressure drop is {100 * low:+.2f} to {100 * high:+.2f} % off the experiment"
    return judged(f"{statement} (case 3)", "figure_3", checks)


def _compared(answers: Answers, name: str, case: int) -> dict[str, float] | None:
    """A quantity of all laws in one case; None where one failed or has no such quantity."""
    if any(name not in answers.get((friction, case), ()) for friction in FRICTIONS):
        return None
    return {friction: answers[friction, case][name] for friction in FRICTIONS}


def _drop_order(answers: Answers) -> Finding:
    checks = {}
    for case in CASES:
        if (drops := _compared(answers, "pressure_drop", case)) is None:
            continue
        told = f"case {case} {_shown([d / 1e3 for d in drops.values()], 4)} kPa"
        most, least = max(drops, key=drops.__getitem__), min(drops, key=drops.__getitem__)
        if case in SLOW:
            checks[f"{told}: Dartevelle highest"] = most == "dartevelle"
            checks[f"{told}: Berzi lowest"] = least == "berzi"
        else:
            checks[f"{told}: Berzi highest"] = most == "berzi"
    statement = "Dartevelle gives the highest and Berzi the lowest drop up to Q_s = 0.8 m3/h, above"
    return judged(f"{statement} it Berzi the highest", "figure_3", checks)


def _order(answers: Answers, name: str, words: str, lowest: bool) -> Finding:
    """Dartevelle has the lowest (or highest) value of the laws in the bed, Berzi the opposite."""
    first, last = ("lowest", "highest") if lowest else ("highest", "lowest")
    pick: tuple[Callable, Callable] = (min, max) if lowest else (max, min)
    checks = {}
    for case in SLOW:
        if (values := _compared(answers, name, case)) is None:
            continue
        told = f"case {case} {_shown(list(values.values()))}"
        checks[f"{told}: Dartevelle {first}"] = pick[0](values, key=values.get) == "dartevelle"
        checks[f"{told}: Berzi {last}"] = pick[1](values, key=values.get) == "berzi"
    return judged(f"{words}: {first} with Dartevelle, {last} with Berzi", "figure_10", checks)


def _only_in_the_bed(answers: Answers) -> Finding:
    checks = {}
    for (friction, case), found in answers.items():
        outside, above = found["friction_outside"], found["friction_above"]
        told = f"{friction}, case {case}"
        checks[f"{told}: {100 * outside:.2g} % outside the bed"] = outside <= FEW
        checks[f"{told}: {100 * above:.2g} % above the axis"] = above <= FEW
    return judged("friction is only in the bed at the bottom", "figure_8", checks)


def _falling(answers: Answers, name: str, statement: str, figure: str) -> Finding:
    checks = {
        f"{friction} {_shown(row)}": all(a > b for a, b in itertools.pairwise(row))
        for friction, row in _rows(answers, name)
    }
    return judged(statement, figure, checks)


def _loose(answers: Answers) -> Finding:
    checks = {
        f"{friction}, case {case}: {100 * found['overpacked']:.2g} % of the section": (
            found["overpacked"] <= FEW
        )
        for (friction, case), found in answers.items()
    }
    return judged("the solids fraction almost never exceeds 0.5", "figure_6", checks)


def _alike_above(answers: Answers) -> Finding:
    """The laws differ by less in the suspension than in the bed."""
    checks = {}
    for case in CASES:
        spreads = []
        for layer in ("top", "bed"):
            values = _compared(answers, f"{layer}_u_s", case)
            if values is not None:
                spreads.append(max(values.values()) / min(values.values()) - 1)
        if spreads:
            told = " and ".join(f"{100 * s:.2g} %" for s in spreads)
            checks[f"case {case}: u_s spreads by {told}"] = spreads[0] < spreads[1]
    return judged("the law of friction matters in the bed, not above it", "figure_10", checks)

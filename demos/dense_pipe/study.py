# SPDX-License-Identifier: LGPL-3.0-or-later
"""Everything that Ding et al. (2024) show of the dense pipe, in one command.

    python demos/dense_pipe/study.py [--out DIR] [--level N] [--set KEY=VALUE]...

solves cases 1 to 5 of table 1 with three laws of friction and two feeds of solids, each row of
cases going on from the one before, then the meshes of table 5 and one developing line. Tables,
figures and study.html, with every number beside the paper's, go to DIR. It runs under mpirun too.
"""

from __future__ import annotations

import argparse
import csv
import io
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import study_figures as figures
from matplotlib.figure import Figure
from mpi4py import MPI
from numpy.typing import NDArray
from study_findings import CASES, EXPERIMENT, FRICTIONS, Finding, developed, findings

from fem_tfm.bench.error import PUBLISHED, measure
from fem_tfm.case import Case
from fem_tfm.closures import make
from fem_tfm.errors import FemTfmError, SolverError
from fem_tfm.models.two_fluid.section import TwoFluidSection
from fem_tfm.output.fields import snapshot
from fem_tfm.output.files import on_root, replaced, write_text
from fem_tfm.output.pictures import SectionView, vertical_profile
from fem_tfm.output.report import document, image, items, section, table
from fem_tfm.output.result import QUANTITIES
from fem_tfm.output.summary import difference, number
from fem_tfm.scenes.developing import LineRecorder
from fem_tfm.scenes.recorder import Setting, results_directory
from fem_tfm.scenes.scene import Answer
from fem_tfm.study.sensitivity import Sensitivity, sensitivities
from fem_tfm.study.sweep import Plan, Point, solve

CASE = Path(__file__).with_name("study.toml")
COMM = MPI.COMM_WORLD


@dataclass(frozen=True)
class Row:
    """One case of table 1: Q_s [m3/h], U_g [m/s], M_s [kg/s], alpha_s [-], u_s [m/s]."""

    supplementary: float
    speed: float
    mass_flow: float
    fraction: float
    velocity: float


TABLE_1 = {
    1: Row(0.40, 4.71, 0.213, 0.318, 4.43),
    2: Row(0.60, 5.62, 0.206, 0.286, 5.30),
    3: Row(0.80, 6.43, 0.194, 0.245, 6.09),
    4: Row(1.00, 7.24, 0.181, 0.199, 6.79),
    5: Row(1.20, 8.10, 0.168, 0.184, 7.72),
}
GAS = [row.supplementary for row in TABLE_1.values()]
# the two feeds of table 1, which disagree with each other
VOLUME, MASS = "alpha u_s", "M_s"
FEEDS = (VOLUME, MASS)
# what is drawn section by section, and the case that the paper takes as typical
DRAWN, TYPICAL, BEST = MASS, 3, "berzi"
# on level 1 the line ends at 26 D: k runs away at the top of the wall
COARSEST_LINE = 2
# layers along the height in which the laws are compared, y/D from the bottom
BED, TOP = (0.0, 0.2), (0.7, 1.0)
STATIONS = (20.0, 60.0, 100.0, 120.0, 150.0, 180.0, 220.0)
# numbers of the sensitivity table: what they are, and the range of a share
PARAMETERS = {
    "solids.diameter": "grain diameter d",
    "solids.density": "grain density rho_s",
    "closures.drag.C": "drag C of the middle zone",
    "closures.friction.stiffness": "stiffness k_n/d of Berzi",
    "walls.solids.friction_coefficient": "wall friction mu_w",
    "solids.restitution": "restitution e",
    "walls.distance": "distance of the wall law",
    "closures.dispersion.sigma": "Schmidt number of the dispersion",
    "closures.dispersed.normal_stress": "share of the eddies' normal stress",
    "walls.solids.sliding_heat": "share of the sliding work that heats the grains",
}
SHARES = {
    "closures.dispersed.normal_stress": (0.0, 1.0),
    "walls.solids.sliding_heat": (0.0, 1.0),
}
# other choices that the paper leaves open, each in place of the one of study.toml
ALTERNATIVES: dict[str, dict[str, Any]] = {
    "none": {},
    "log law of the velocity at the wall": {"walls.gas": "log-law"},
    "no turbulent dispersion": {"closures.dispersion": "none"},
    "Simonin's dispersion": {"closures.dispersion": "simonin"},
    "dispersion by both phases' eddies": {"closures.dispersion": "drift"},
    "no normal stress of the eddies": {"closures.dispersed": "k-epsilon"},
    "drag that fades within a grain of the wall": {"walls.grain_gap": 1.0},
    "sliding does not heat the grains": {"walls.solids.sliding_heat": 0.0},
    "turbulence of the gas alone": {"closures.turbulence": "realizable",
                                    "closures.dispersed": "none"},
    "mixing length": {"closures.turbulence": "mixing-length", "closures.dispersed": "none",
                      "closures.dispersion": "none", "walls.gas": "log-law"},
    "grains of 0.1 mm": {"solids.diameter": 1e-4},
    "wall law at half the distance": {"walls.distance": 1.6e-4},
    "wall law at twice the distance": {"walls.distance": 6.4e-4},
    "grains of 1400 kg/m3": {"solids.density": 1400.0},
    "no friction": {"closures.friction": "none"},
}  # fmt: skip


@dataclass
class Run:
    """A point of the sweep with what is drawn of it; view, fields and profile are on rank 0."""

    point: Point
    view: SectionView | None = None
    fields: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    profile: dict[str, NDArray[np.float64]] = field(default_factory=dict)


@dataclass(frozen=True)
class Mesh:
    """A row of table 5: cells, pressure drop [Pa] and CPU time [s] of the solve."""

    level: int
    cells: int
    drop: float
    cpu_seconds: float


@dataclass
class Line:
    """The developing line: profiles by z/D, and z/D from which each quantity stays; or a reason.

    gradient, section : dp/dz at the outlet, and of the developed section on the same mesh [Pa/m]
    """

    profiles: dict[float, dict[str, NDArray[np.float64]]] = field(default_factory=dict)
    lengths: dict[str, float] = field(default_factory=dict)
    gradient: float = float("nan")
    section: float = float("nan")
    cpu_seconds: float = 0.0
    reason: str = ""


@dataclass
class Study:
    """All that was solved."""

    case: Case
    answers: dict[tuple[str, str, int], Run] = field(default_factory=dict)
    meshes: list[Mesh] = field(default_factory=list)
    sensitivities: list[Sensitivity] = field(default_factory=list)
    alternatives: dict[str, list[Point]] = field(default_factory=dict)
    line: Line = field(default_factory=Line)

    def solved(self, feed: str) -> dict[tuple[str, int], dict[str, float]]:
        """Quantities of one feed by law of friction and case."""
        found = {(law, k): a for (f, law, k), a in self.answers.items() if f == feed}
        return {key: a.point.quantities for key, a in found.items() if a.point.quantities}

    def of(self, name: str) -> dict[tuple[str, int], Any]:
        """An attribute of the answers that are drawn."""
        return {
            (law, k): getattr(a, name)
            for (feed, law, k), a in self.answers.items()
            if feed == DRAWN and a.view is not None
        }


# -- solving -----------------------------------------------------------------------------------


def values(case: int, feed: str, law: str | None = None) -> dict[str, Any]:
    """Values of one run that differ from study.toml."""
    row = TABLE_1[case]
    given: dict[str, Any] = {"operation.gas_superficial_velocity": row.speed}
    if feed == MASS:
        given["operation.solids_mass_flow"] = row.mass_flow
    else:
        given["operation.solids_fraction"] = row.fraction
        given["operation.solids_velocity"] = row.velocity
    return given if law is None else {"closures.friction": law, **given}


def route(law: str, cases: Sequence[int] = CASES) -> list[tuple[str, int]]:
    """Feeds and cases of one law, so that neighbours in the row are neighbours in the numbers."""
    return [(VOLUME, k) for k in cases] + [(MASS, k) for k in reversed(cases)]


def solve_rows(
    study: Study,
    laws: Iterable[str] = FRICTIONS,
    cases: Sequence[int] = CASES,
    tell: Callable[[str], None] = print,
) -> None:
    """Solve all cases with the laws of friction; a run that fails is kept as failed."""
    for law in laws:
        names = [(feed, law, k) for feed, k in route(law, cases)]
        points = [Point(i, values(k, feed, law)) for i, (feed, _, k) in enumerate(names)]
        study.answers |= {n: Run(p) for n, p in zip(names, points, strict=True)}

        def read(case: Case, point: Point, answer: Answer, names: Any = names) -> None:
            name = names[point.number]
            look(study.answers[name], answer.state.solution.section)
            if name == (MASS, BEST, TYPICAL):
                known = [key for key in PARAMETERS if isinstance(case[key], float)]
                study.sensitivities = sensitivities(case, answer, known)

        for point in solve(Plan(study.case), points, read):
            feed, _, k = names[point.number]
            drop = point.quantities.get("pressure_drop")
            ended = point.reason if drop is None else f"{drop / 1e3:.3f} kPa, {point.start}"
            tell(f"{law}, {feed}, case {k}: {ended}, {point.cpu_seconds:.1f} CPU s")


def look(answer: Run, solved: TwoFluidSection) -> None:
    """Add to a run its fields, its profile and the numbers read off them (collective)."""
    functions = {**solved.fields(), **solved.friction()}
    functions["Theta"] = functions.pop("theta")
    moment = snapshot(solved.mesh.mesh, functions)
    limit = solved.setup.model.solids.friction_limit
    if COMM.rank == 0:
        kind, symmetry = moment.kind, solved.mesh.section.symmetry
        answer.view = SectionView.of_cells(moment.points, moment.cells, kind, symmetry)
        answer.fields = moment.nodal
        answer.profile = vertical_profile(answer.view, moment.nodal)
        answer.point.quantities |= layers(answer.profile)
        answer.point.quantities |= shares(answer.view, answer.fields, limit)


def layers(profile: Mapping[str, NDArray[np.float64]]) -> dict[str, float]:
    """Means over the bed and the top of the vertical diameter."""
    height = profile["y/D"] - profile["y/D"][0]
    found = {}
    for layer, (low, high) in {"bed": BED, "top": TOP}.items():
        at = np.linspace(low, high, 201)
        for name in ("alpha_s", "u_s", "u_g", "Theta", "k", "k_s"):
            if name in profile:
                values = np.interp(at, height, profile[name])
                found[f"{layer}_{name}"] = float(values.mean())
    return found


def shares(
    view: SectionView, fields: Mapping[str, NDArray[np.float64]], limit: float
) -> dict[str, float]:
    """Mean frictional pressure [Pa], its shares outside the bed and above the axis, loose packing.

    Integrals are sums over the triangles of the view.
    """
    corners = view.points[view.triangles]
    a, b = (corners[:, i, :2] - corners[:, 0, :2] for i in (1, 2))
    area = abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2
    alpha, p_f = (fields[n][view.triangles].mean(axis=1) for n in ("alpha_s", "p_f"))
    force = area * p_f
    return {
        "friction_pressure": float(force.sum() / area.sum()),
        "friction_outside": float(force[alpha < limit].sum() / force.sum()),
        "friction_above": float(force[corners[:, :, 1].mean(axis=1) > 0].sum() / force.sum()),
        "overpacked": float(area[alpha > 0.5].sum() / area.sum()),
    }


def solve_meshes(study: Study, levels: Iterable[int]) -> None:
    """Solve the typical case on several meshes, each from a cold start on the coarsest."""
    base = study.case.with_values(values(TYPICAL, MASS, BEST))
    for level in levels:
        try:
            found = measure(base, "triangle", level)
        except SolverError:
            continue
        drop = found.gradient * base["geometry.length"]
        cpu = COMM.allreduce(found.cpu_seconds)
        study.meshes.append(Mesh(level, found.number, drop, cpu))


def solve_alternatives(
    study: Study,
    level: int,
    chosen: Iterable[str] = ALTERNATIVES,
    tell: Callable[[str], None] = print,
) -> None:
    """Solve all cases with other closures, one change at a time."""
    base = study.case.with_values({"closures.friction": BEST, "numerics.level": level})
    for name in chosen:
        points = [Point(k, values(k, MASS) | ALTERNATIVES[name]) for k in reversed(CASES)]
        solved = sorted(solve(Plan(base), points), key=lambda p: p.number)
        study.alternatives[name] = solved
        tell(", ".join(alternative_rows(study)[-1]))


class Stations(LineRecorder):
    """Keeps the profiles of the stations next to those that figure 4 shows."""

    profiles: dict[float, dict[str, NDArray[np.float64]]]

    def station(self, line: Any, stop: Any) -> None:
        """Keep the station if it is the first one at or beyond a place of the figure."""
        super().station(line, stop)
        z = line.place.z / self.scene.geometry.hydraulic_diameter
        if sum(z >= s for s in STATIONS) <= len(self.profiles):
            return
        fields = {n: f for n, f in line.station.fields().items() if n in ("u_g", "u_s", "alpha_s")}
        mesh, self.profiles[z] = line.station.mesh, {}
        moment = snapshot(mesh.mesh, fields)
        if COMM.rank == 0:
            symmetry = mesh.section.symmetry
            view = SectionView.of_cells(moment.points, moment.cells, moment.kind, symmetry)
            self.profiles[z] = vertical_profile(view, moment.nodal)


def solve_line(study: Study, level: int) -> None:
    """March the typical case from its inlet to its outlet."""
    changes = values(TYPICAL, VOLUME, BEST) | {"solution": "developing", "numerics.level": level}
    case, cpu, line = study.case.with_values(changes), time.process_time(), Line()
    stations = Stations(case.scene, Setting())
    stations.profiles = line.profiles
    try:
        answer = case.scene.solve(stations)
        rows = answer.state.line.rows
        line.lengths = settled(rows, case.scene.geometry.hydraulic_diameter)
        line.gradient = rows[-1]["pressure_gradient"]
        answer.close()
    except SolverError as error:
        line.reason = str(error)
    line.cpu_seconds = COMM.allreduce(time.process_time() - cpu)
    for point in solve(Plan(case.with_values({"solution": "developed"})), [Point(0, {})]):
        line.section = point.quantities.get("pressure_gradient", line.section)
    study.line = line


def settled(rows: Sequence[Mapping[str, float]], width: float) -> dict[str, float]:
    """z/D of the last station at which each quantity is 1 % off its value at the outlet."""
    found = {}
    for name in ("pressure_gradient", "holdup", "gas_velocity", "solids_velocity"):
        last = rows[-1][name]
        off = [row["z"] for row in rows if not abs(row[name] - last) <= 0.01 * abs(last)]
        found[name.replace("_", " ")] = (off[-1] if off else 0.0) / width
    return found


# -- tables ------------------------------------------------------------------------------------


def run_rows(study: Study) -> list[list[str]]:
    """One row a run, with the paper's numbers where it prints them."""
    told = []
    for (feed, law, k), answer in study.answers.items():
        found, row = answer.point.quantities, TABLE_1[k]
        if not found:
            told.append([feed, law, str(k), "failed", *[""] * 9])
            continue
        drop, paper = found["pressure_drop"], EXPERIMENT.get(k)
        error = answer.point.errors["pressure_drop"]
        told.append(
            [
                feed, law, str(k), number(drop / 1e3), number(error and error / 1e3, 2),
                number(paper / 1e3) if paper else "", difference(drop, paper) if paper else "",
                number(found["holdup"], 3), number(row.fraction, 3),
                number(found["solids_mass_flow"], 3), number(row.mass_flow, 3),
                number(found["bed_fraction"], 3), f"{answer.point.cpu_seconds:.1f}",
            ]
        )  # fmt: skip
    return told


RUN_HEAD = (
    "feed", "friction", "case", "dp [kPa]", "change of mesh [kPa]", "experiment [kPa]",
    "difference", "hold-up", "alpha_s of table 1", "M_s [kg/s]", "M_s of table 1", "bed fraction",
    "CPU [s]",
)  # fmt: skip
MESH_HEAD = ("mesh", "cells", "dp [kPa]", "to the finest", "CPU [s]")


def mesh_rows(study: Study) -> list[list[str]]:
    """Our meshes of the section and the paper's of the pipe, each against its own finest."""
    told = []
    for mesh in study.meshes:
        off = difference(mesh.drop, study.meshes[-1].drop)
        drop, cpu = number(mesh.drop / 1e3), f"{mesh.cpu_seconds:.1f}"
        told.append([f"level {mesh.level}, section", str(mesh.cells), drop, off, cpu])
    finest = list(PUBLISHED.values())[-1][1]
    for name, (cells, drop) in PUBLISHED.items():
        off = difference(drop, finest)
        told.append([f"paper's {name}, pipe", str(cells), f"{drop:.2f}", off, "not printed"])
    told.append(["experiment", "", number(EXPERIMENT[TYPICAL] / 1e3), "", ""])
    return told


SENSITIVITY_HEAD = ("number", "value", "dlnG/dlnp", "+10 % in p", "over its range")


def sensitivity_rows(found: Iterable[Sensitivity]) -> list[list[str]]:
    """Derivatives of the pressure gradient, to first order."""
    told = []
    for one in found:
        span = SHARES.get(one.key)
        over = f"{100 * one.change(*span):+.1f} %" if span else ""
        each = ["", ""] if span else [f"{one.relative:+.3f}", f"{10 * one.relative:+.2f} %"]
        told.append([f"{PARAMETERS[one.key]} ({one.key})", f"{one.value:g}", *each, over])
    return told


ALTERNATIVE_HEAD = (
    "one change", *(f"dp of case {k} [kPa]" for k in CASES), f"case {TYPICAL}, off the experiment",
    f"hold-up, case {TYPICAL}", "CPU [s]",
)  # fmt: skip


def alternative_rows(study: Study) -> list[list[str]]:
    """Pressure drops of the set itself, and with one other choice each."""
    told = []
    for name, points in study.alternatives.items():
        drops = [p.quantities.get("pressure_drop") for p in points]
        row = [name, *(number(d / 1e3) if d else "failed" for d in drops)]
        typical = points[CASES.index(TYPICAL)].quantities
        if typical:
            off = difference(typical["pressure_drop"], EXPERIMENT[TYPICAL])
            row += [off, number(typical["holdup"], 3)]
        else:
            row += ["", ""]
        told.append([*row, f"{sum(p.cpu_seconds for p in points):.1f}"])
    return told


def curves(case: Case) -> tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]:
    """Figure 7: frictional pressure of each law [Pa] over the solids fraction, without strain."""
    solids, alpha = case.scene.model.solids, np.linspace(0.40, 0.52, 121)
    rest = np.zeros_like(alpha)
    stress = {
        law: make("friction", law).stress(alpha, rest, rest, rest, solids) for law in FRICTIONS
    }
    return alpha, {law: found.pressure for law, found in stress.items()}


def profile_rows(study: Study) -> list[list[str]]:
    """The numbers of figures 5, 6, 8, 9 and 10 along the vertical diameter."""
    profiles = study.of("profile")
    names = ["y/D", *(n for n in figures.LABELS if all(n in p for p in profiles.values()))]
    told = [["friction", "case", *names]]
    for (law, k), profile in profiles.items():
        columns = [profile[name] for name in names]
        told += [[law, k, *(f"{v:.7g}" for v in row)] for row in zip(*columns, strict=True)]
    return told


def tables(study: Study) -> dict[str, list[Sequence[Any]]]:
    """Every table as rows with a head, by the name of its file."""
    alpha, pressure = curves(study.case)
    axis = [["z/D", "y/D", "u_g [m/s]", "u_s [m/s]", "alpha_s"]]
    for z, profile in study.line.profiles.items():
        columns = [profile[name] for name in ("y/D", "u_g", "u_s", "alpha_s")]
        axis += [[f"{z:.1f}", *(f"{v:.7g}" for v in row)] for row in zip(*columns, strict=True)]
    return {
        "runs": [RUN_HEAD, *run_rows(study)],
        "quantities": list(quantity_rows(study)),
        "table_5": [MESH_HEAD, *mesh_rows(study)],
        "figure_3": [figure_3_head(), *figure_3_rows(study)],
        "figure_4": axis,
        "figures_5_6_8_9_10": profile_rows(study),
        "figure_7": [["alpha_s", *pressure], *zip(alpha, *pressure.values(), strict=True)],
        "alternatives": [ALTERNATIVE_HEAD, *alternative_rows(study)],
        "sensitivity": [SENSITIVITY_HEAD, *sensitivity_rows(study.sensitivities)],
    }


def quantity_rows(study: Study) -> Iterable[list[str]]:
    """Every quantity of every run."""
    names = next((list(a.point.quantities) for a in study.answers.values() if a.view), [])
    yield ["feed", "friction", "case", *(f"{n} [{QUANTITIES[n]}]" if n in QUANTITIES else n
                                         for n in names)]  # fmt: skip
    for key, answer in study.answers.items():
        found = answer.point.quantities
        yield [*map(str, key), *(f"{found[n]:.7g}" if n in found else "" for n in names)]


def figure_3_head() -> list[str]:
    """Heads of the pressure drops in kPa."""
    return ["Q_s [m3/h]", "experiment", *(f"{law}, {feed}" for feed in FEEDS for law in FRICTIONS)]


def figure_3_rows(study: Study) -> list[list[str]]:
    """Pressure drops [kPa] by case; experiments where they are printed."""
    told = []
    for k, gas in zip(CASES, GAS, strict=True):
        row = [f"{gas:.2f}", number(EXPERIMENT[k] / 1e3) if k in EXPERIMENT else ""]
        for feed in FEEDS:
            for law in FRICTIONS:
                found = study.solved(feed).get((law, k))
                row.append(number(found["pressure_drop"] / 1e3) if found else "")
        told.append(row)
    return told


# -- the report --------------------------------------------------------------------------------


def pictures(study: Study) -> dict[str, tuple[str, Figure]]:
    """Title and figure by the name of the file."""
    drops = {
        feed: {
            law: {k: q["pressure_drop"] for (n, k), q in study.solved(feed).items() if n == law}
            for law in FRICTIONS
        }
        for feed in FEEDS
    }
    profiles, views, fields = (study.of(name) for name in ("profile", "view", "fields"))
    typical = {law: p for (law, k), p in profiles.items() if k == TYPICAL}
    drawn = {
        "figure_3": ("pressure drop over supplementary gas", figures.drops(GAS, drops)),
        "figure_5": ("solids fraction over the section", _map(views, fields, "alpha_s")),
        "figure_6": ("solids fraction along the height", figures.heights(profiles, GAS)),
        "figure_7": (
            "frictional pressure of the three laws",
            figures.pressures(*curves(study.case)),
        ),
        "figure_8": ("frictional pressure over the section", _map(views, fields, "p_f")),
        "figure_9": ("frictional shear stress over the section", _map(views, fields, "tau_f")),
        "figure_10": (f"case {TYPICAL} along the height", figures.laws(typical)),
    }
    if study.line.profiles:
        drawn["figure_4"] = ("development along the pipe", figures.stations(study.line.profiles))
    return dict(sorted(drawn.items(), key=lambda entry: int(entry[0].split("_")[1])))


def _map(views: Mapping[Any, Any], fields: Mapping[Any, Any], name: str) -> Figure:
    label = figures.LABELS[name]
    return figures.maps({key: (views[key], fields[key][name]) for key in views}, label)


def all_findings(study: Study) -> dict[str, list[Finding]]:
    """Findings by feed, and that of the developing line."""
    found = {f"feed {feed}": findings(study.solved(feed)) for feed in FEEDS}
    if study.line.lengths:
        found["developing line"] = [developed(study.line.lengths)]
    return found


def cost(study: Study) -> list[str]:
    """CPU time of the parts [s], without the compilation of forms."""
    told = []
    for feed in FEEDS:
        points = [a.point for (f, _, _), a in study.answers.items() if f == feed]
        seconds, failed = sum(p.cpu_seconds for p in points), sum(not p.quantities for p in points)
        told.append(
            f"{len(points)} developed runs, feed {feed}: {seconds:.0f} CPU s, {failed} failed"
        )
    told.append(f"table 5: {sum(m.cpu_seconds for m in study.meshes):.0f} CPU s")
    line = study.line
    if not line.profiles and not line.reason:
        return told
    ended = line.reason or (
        f"{line.gradient:.1f} Pa/m at the outlet, {line.section:.1f} in the developed section"
    )
    return [*told, f"developing line of 2.4 m: {line.cpu_seconds:.0f} CPU s, {ended}"]


def report(study: Study, drawn: Mapping[str, tuple[str, bytes]]) -> str:
    """The page: pressure drops, findings, figures, tables, sensitivity and cost."""
    parts = [f"<h1>{study.case.scene.title}</h1>"]
    parts += section("Pressure drop [kPa]", table(figure_3_head(), figure_3_rows(study)))
    for feed, found in all_findings(study).items():
        rows = [[f.statement, f.verdict, f.figure.replace("_", " "), f.evidence] for f in found]
        head = ("finding of the paper", "here", "shown by", "numbers")
        parts += section(f"Findings, {feed}", texts(head, rows))
    for name, (title, data) in drawn.items():
        head = f"{name.replace('_', ' ').capitalize()}: {title}"
        parts += section(head, [image(data, title)])
    parts += section("Table 5: meshes", table(MESH_HEAD, mesh_rows(study)))
    parts += section("All runs", table(RUN_HEAD, run_rows(study)))
    failed = [f"{', '.join(map(str, key))}: {a.point.reason}"
              for key, a in study.answers.items() if not a.point.quantities]  # fmt: skip
    parts += section("Failed runs", items(failed))
    rows = sensitivity_rows(study.sensitivities)
    head = f"Sensitivity of dp at case {TYPICAL}, {BEST}, feed {MASS}"
    parts += section(head, table(SENSITIVITY_HEAD, rows) if rows else [])
    rows = alternative_rows(study)
    head = f"Choices that the paper leaves open, {BEST}, feed {MASS}"
    parts += section(head, table(ALTERNATIVE_HEAD, rows) if rows else [])
    parts += section("Cost", items(cost(study)))
    parts += section("Inputs that the source does not print", items(study.case.scene.inferred))
    parts += section("Parameter set", [f"<pre>{study.case.dump()}</pre>"])
    return document(study.case.scene.title, parts)


def texts(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """A table whose columns are all texts."""
    return [line.replace(' class="n"', "") for line in table(head, rows)]


def write(study: Study, out: Path) -> None:
    """Tables, figures and the report."""
    for name, rows in tables(study).items():
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(rows)
        write_text(out / f"{name}.csv", text.getvalue())
    drawn = {}
    for name, (title, figure) in pictures(study).items():
        with replaced(out / f"{name}.png") as path:
            figure.savefig(path, dpi=130, format="png")
        drawn[name] = title, (out / f"{name}.png").read_bytes()
    write_text(out / "study.html", report(study, drawn))


# -- the command -------------------------------------------------------------------------------


def say(text: str) -> None:
    """Print on rank 0 at once."""
    if COMM.rank == 0:
        print(text, flush=True)


def run(out: Path, level: int | None = None, changes: Iterable[str] = ()) -> Study:
    """Solve everything and write it to `out`.

    level : of the finest mesh of the runs, by default that of the case; table 5 goes two further
    changes : to study.toml, as texts "key=value"
    """
    base = Case.load(CASE, changes)
    if level is not None:
        base = base.with_values({"numerics.level": level})
    study, level = Study(base), base["numerics.level"]
    solve_rows(study, tell=say)
    solve_meshes(study, range(1, level + 3))
    say(f"meshes: {', '.join(f'{m.drop / 1e3:.3f}' for m in study.meshes)} kPa")
    solve_line(study, max(level - 1, COARSEST_LINE))
    for text in cost(study):
        say(text)
    # the last part is the longest, and the report is of use before it
    on_root(COMM, lambda: write(study, out))
    solve_alternatives(study, level, tell=say)
    on_root(COMM, lambda: write(study, out))
    say(f"report in {out / 'study.html'}")
    return study


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line and run the study; status 2 for bad input."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", default="results/dense_pipe_study", help="directory [%(default)s]")
    parser.add_argument("--level", type=int, help="finest mesh level of the runs [study.toml]")
    parser.add_argument("--set", metavar="KEY=VALUE", action="append", default=[],
                        help="change the parameter set, such as solids.diameter=1e-4")  # fmt: skip
    parser.add_argument("--overwrite", action="store_true", help="replace results that are there")
    options = parser.parse_args(arguments)
    try:
        out = results_directory(options.out, options.overwrite)
        run(out, options.level, options.set)
    except FemTfmError as error:
        say(f"study: {error}")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Turbulent gas in a straight duct or pipe by Reynolds stresses: what only this model tells."""

from __future__ import annotations

from functools import cached_property, partial
from pathlib import Path
from typing import Any

from fem_tfm.correlations import (
    gnielinski,
    jones_friction,
    smooth_friction,
)
from fem_tfm.errors import SolverError
from fem_tfm.geometry.section import RectangularSection, Section
from fem_tfm.models import transfer
from fem_tfm.models.reynolds_stress import initial
from fem_tfm.models.reynolds_stress.forms import GasNumbers
from fem_tfm.models.reynolds_stress.heat import GasHeat
from fem_tfm.models.reynolds_stress.quantities import (
    balances,
    points,
    profiles,
    quantities,
    secondary,
    smallest_stress,
)
from fem_tfm.models.reynolds_stress.section import ReynoldsStressSection, Setup
from fem_tfm.models.section import between
from fem_tfm.output.duct_pictures import duct_picture, lines_picture
from fem_tfm.output.fields import snapshot
from fem_tfm.output.files import on_root
from fem_tfm.output.pictures import SectionView
from fem_tfm.output.profiles import write_profiles
from fem_tfm.output.result import Reference, Result
from fem_tfm.scenes.judged.gas import TURBULENT, y_plus
from fem_tfm.scenes.judged.memory import check_memory, section_cells
from fem_tfm.scenes.physics import (
    SECTION_COLUMNS,
    SECTION_FILES,
    SectionPhysics,
    residence_control,
)
from fem_tfm.solvers import nested

# of keys whose default depends on the model
DEFAULTS = {"numerics.cells": "quadrilateral", "numerics.wall_grading": 0.0625}
# coarsest mesh of the nested iteration, core cell over the hydraulic diameter
COARSEST = 0.31
# the EVSS viscosity, the condition on eps at the plane, and the compressibility times U D
STABILISATION, WALL_PENALTY, PRESSURE_SHIFT = 0.09, 200.0, 1e-6
# first step of pseudo-time in units of D/U
FIRST_STEP, GROWTH = 3.0, 3.0
# a state that misses a balance by more is no answer
BALANCE_ERROR = 1e-6
FILES = (*SECTION_FILES, "profiles.png")
COLUMNS = {**SECTION_COLUMNS, "secondary_velocity_max": "", "smallest_stress": ""}
WARNED = ("update", "pressure_gradient", "secondary_velocity_max", "smallest_stress")
# measured on the demo: unknowns of Q2/Q1 quadrilaterals, memory and CPU time of a cold run
UNKNOWNS_PER_CELL, EDDY_UNKNOWNS_PER_CELL = 61, 23
BASE_MEMORY, MEMORY_PER_UNKNOWN, TIME_PER_UNKNOWN, COMPILE_TIME = 170, 0.016, 2.0e-4, 25


def setup_of(scene: Any) -> Setup:
    """Numbers of the section that a scene describes, with the constants that laws leave open."""
    speed, width = scene.feed.gas_velocity, scene.geometry.hydraulic_diameter
    gas = scene.model.gas
    numbers = GasNumbers(
        viscosity=gas.viscosity / gas.density,
        stabilisation=STABILISATION,
        wall_penalty=WALL_PENALTY,
        pressure_shift=PRESSURE_SHIFT / (speed * width),
        wall_offset=scene.wall_offset,
    )
    law, function = scene.model.resolved()
    return Setup(law, function, numbers, speed, scene.numerics.quadrature_degree)


SCHEME = nested.Scheme(
    section=ReynoldsStressSection,
    cold=initial.cold,
    warm=transfer.warm,
    follow=transfer.follow,
    control=partial(residence_control, first=FIRST_STEP, growth=GROWTH),
    between=between,
)


class DuctGas(SectionPhysics):
    """What a scene of the Reynolds-stress model tells of its section.

    The section begins at the distance of the wall functions.
    """

    offsets = True
    headline = "friction_factor"
    scheme = SCHEME
    columns = COLUMNS
    warned = WARNED
    files = FILES
    first_step, coarsest = FIRST_STEP, COARSEST
    solved_words = "developed section of a duct's gas by Reynolds stresses: steady, d/dz = 0"

    def setup(self) -> Setup:
        """Numbers of the section."""
        return setup_of(self.scene)

    def signs(self, section: ReynoldsStressSection) -> dict[str, float]:
        """The early warning: gradient [Pa/m], secondary flow and realisability."""
        return {
            "pressure_gradient": self.scene.model.gas.density * section.pressure_gradient,
            "secondary_velocity_max": secondary(section),
            "smallest_stress": smallest_stress(section),
        }

    def told(self, solution: nested.Solution) -> dict[str, Any]:
        """What an answer is made of: quantities, errors, balances, references and the heat.

        Raises
        ------
        SolverError
            a stress is not realisable or a balance is broken.
        """
        balances, found, heat = checked_balances(solution.section), [], None
        density, length = self.scene.model.gas.density, self.scene.geometry.length
        for level in solution.levels[-2:]:
            heat, more = developed_heat(self.scene, level.section)
            found.append(quantities(level.section, density, length) | more)
        told, errors = nested.with_changes(found)
        if heat is not None:
            balances["heat"] = heat.balance()
        return {
            "quantities": told,
            "errors": errors,
            "balances": balances,
            "references": self.references(),
            "heat": heat,
        }

    def references(self) -> dict[str, list[Reference]]:
        """Published values that belong to the Reynolds number and the section."""
        return references(self.scene, self.section)

    def fields(self, section: ReynoldsStressSection, told: Any = None) -> dict[str, Any]:
        """Fields for output, with those of the heat."""
        heat = told["heat"] if told else None
        return section.fields() | (heat.fields() if heat is not None else {})

    def write(
        self, section: ReynoldsStressSection, result: Result, out: Path | None, told: Any
    ) -> None:
        """Profiles along lines, for the result and the files, and the pictures."""
        heat = told["heat"] if told else None
        write_section(self.scene, section, result, out, heat)

    # -- words ---------------------------------------------------------------------------------

    def skipped(self) -> list[str]:
        """Parts of the section and laws that the scene does without."""
        law, left_out = self.scene.model.stress, []
        if self.section.symmetry != "none":
            mirrored = {"half": "half", "quarter": "three quarters"}[self.section.symmetry]
            left_out.append(f"{mirrored} of the section: mirror images of the part solved")
        left_out.append("weight: the gas has one density")
        if not law.transported:
            left_out.append(f"transport of each stress: closures.reynolds_stress = {law.name}")
        if self.scene.model.heat is None:
            left_out.append("temperature and heat fluxes: no table [heat]")
        return left_out

    def advice(self) -> list[str]:
        """What a user probably did not mean, one sentence each."""
        return advice(self.scene)

    def given(self) -> str:
        """What is given and what is found, in words."""
        return f"{self.entering()}; found: pressure gradient"

    def entering(self) -> str:
        """What enters a line, in words."""
        return f"bulk velocity {self.scene.feed.gas_velocity:g} m/s, Re {self.scene.reynolds:.4g}"

    @cached_property
    def size(self) -> tuple[int, int]:
        """Cells of the finest mesh, and about how many unknowns."""
        cells = self.meshes()[-1]().num_cells
        return cells, self.unknowns(cells)

    def examine(self) -> None:
        """Refuse a mesh beyond the machine; raises InputError."""
        unknowns = self.unknowns(section_cells(self.section, self.resolution))
        check_memory(self.cost(unknowns)["memory"], self.scene.resolution)

    def unknowns(self, cells: float) -> int:
        """About how many unknowns a mesh has."""
        transported = self.scene.model.stress.transported
        return round(cells * (UNKNOWNS_PER_CELL if transported else EDDY_UNKNOWNS_PER_CELL))

    def cost(self, unknowns: int) -> dict[str, float]:
        """About the memory [MB] and the CPU time [s] of solving and of compiling the forms."""
        return {
            "memory": BASE_MEMORY + MEMORY_PER_UNKNOWN * unknowns,
            "solve": TIME_PER_UNKNOWN * unknowns + 1,
            "compile": COMPILE_TIME,
        }


def check_realisable(found: ReynoldsStressSection) -> float:
    """`smallest_stress` of an answer.

    Raises
    ------
    SolverError
        a principal stress is negative, so that the state is no answer.
    """
    smallest = smallest_stress(found)
    if not smallest > 0:
        raise SolverError(f"a principal Reynolds stress is {smallest:.2g} k, which cannot be")
    return smallest


def checked_balances(found: ReynoldsStressSection) -> dict[str, float]:
    """The balances of an answer.

    Raises
    ------
    SolverError
        one of them is broken, or a stress is not realisable, so that the state is no answer.
    """
    check_realisable(found)
    kept = balances(found)
    for name in kept:
        if not kept[name] <= BALANCE_ERROR:
            raise SolverError(f"the balance of {name} is broken by {kept[name]:.1e}")
    return kept


def references(scene: Any, section: Section) -> dict[str, list[Reference]]:
    """Published values that belong to a scene's Reynolds number and section."""
    reynolds, heat = scene.reynolds, scene.model.heat
    if reynolds < TURBULENT:
        return {}
    if isinstance(section, RectangularSection):
        friction = jones_friction(reynolds, section.width, section.height)
        source = "smooth rectangular duct, Jones (1976), J. Fluids Eng. 98"
    else:
        friction, source = smooth_friction(reynolds), "smooth pipe, Prandtl and von Karman"
    known = {"friction_factor": [Reference(friction, source)]}
    if isinstance(section, RectangularSection) and section.width == section.height:
        known["secondary_velocity_max"] = [
            Reference(0.019, "DNS at Re 4410, Gavrilakis (1992), J. Fluid Mech. 244"),
            Reference(0.015, "middle of 1 to 2 %, Pirozzoli et al. (2018), J. Fluid Mech. 840"),
        ]
    if heat is not None:
        value = gnielinski(reynolds, heat.prandtl)
        known["nusselt"] = [Reference(value, "Gnielinski (1976), Int. Chem. Eng. 16")]
    return known


# wall functions need a log layer, and the demo's model was measured up to this aspect ratio
LARGEST_ASPECT, LOG_LAYER = 4.0, (30.0, 300.0)


def advice(scene: Any) -> list[str]:
    """What a user probably did not mean, one sentence each."""
    said, (width, height) = [], scene.geometry.size
    if max(width, height) > LARGEST_ASPECT * min(width, height):
        said.append(f"sections with sides above {LARGEST_ASPECT:g} to 1 have not been tried")
    if scene.reynolds < TURBULENT:
        return said
    height, (low, high) = y_plus(scene), LOG_LAYER
    outside = not low <= height <= high
    if outside or scene.wall_offset > 0.1 * scene.geometry.hydraulic_diameter:
        said.append(
            f"walls.distance = {scene.wall_offset:.3g} m is y+ = {height:.0f}; wall functions hold"
            f" from {low:g} to {high:g} and below a tenth of the hydraulic diameter"
        )
    return said


def heat_of(scene: Any, found: ReynoldsStressSection) -> GasHeat:
    """Temperature with the laws of a scene on a section that is solved, not solved itself yet."""
    model = scene.model
    return GasHeat(found, model.heat_flux, model.thermal_wall, model.heat.prandtl)


def developed_heat(
    scene: Any, found: ReynoldsStressSection
) -> tuple[GasHeat | None, dict[str, float]]:
    """Developed temperature of a section and its quantities; None where no heat is asked for."""
    if scene.model.heat is None:
        return None, {}
    heat, given = heat_of(scene, found), scene.model.heat
    if given.wall == "flux":
        heat.constant_flux()
        # the solution cools by 1 K/m
        capacity = scene.model.gas.density * given.heat_capacity
        heat.scale = given.wall_flux / (capacity * heat.flux())
    else:
        heat.constant_temperature()
        heat.scale = 1 / heat.bulk()
    told = {"nusselt": heat.nusselt()}
    if (prandtl := heat.profiles(points(found)).get("bisector Pr_t")) is not None:
        told |= {"turbulent_prandtl_axis": float(prandtl[1])}
        told |= {"turbulent_prandtl_wall": float(prandtl[-1])}
    return heat, told


def write_section(
    scene: Any,
    found: ReynoldsStressSection,
    result: Result,
    out: Path | None,
    heat: GasHeat | None = None,
) -> None:
    """Profiles along lines, for the result and the files, and pictures of one section."""
    mesh, fields, lines = found.mesh.mesh, found.fields(), profiles(found)
    if heat is not None:
        fields |= heat.fields()
        lines |= heat.profiles(points(found))
    moment = snapshot(mesh, fields)
    result.sections["lines"] = lines

    def draw() -> None:
        assert out is not None
        symmetry = found.mesh.section.symmetry
        view = SectionView.of_cells(moment.points, moment.cells, moment.kind, symmetry)
        write_profiles(out / "profiles.csv", lines, {"s": "-"})
        if scene.output.pictures:
            duct_picture(out / "section.png", view, moment.nodal, scene.title)
            lines_picture(out / "profiles.png", lines, scene.title)

    if out is not None:
        on_root(mesh.comm, draw)

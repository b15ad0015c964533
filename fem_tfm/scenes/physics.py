# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a model tells of the section of a scene; what all models have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

from mpi4py import MPI

from fem_tfm.geometry.mesh import Mesh, section_mesh
from fem_tfm.geometry.resolution import Resolution
from fem_tfm.geometry.section import Section
from fem_tfm.output.result import Reference, Result
from fem_tfm.solvers.nested import Scheme, Solution
from fem_tfm.solvers.pseudo_time import PseudoTimeControl

# pseudo-time in units of the residence time D/U
SMALLEST_STEP, LARGEST_STEP = 1e-5, 1e7
# what every section leaves, and columns of its monitor.csv
SECTION_FILES = (
    "result.json", "report.html", "monitor.csv", "run.log", "profiles.csv", "section.png",
    "split.png", "fields.xdmf", "fields.h5",
)  # fmt: skip
SECTION_COLUMNS = {
    "step": "",
    "level": "",
    "dt": "s",
    "iterations": "",
    "update": "",
    "pressure_gradient": "Pa/m",
}


def residence_control(
    section: Any, tolerance: float, max_steps: int, first: float, growth: float
) -> PseudoTimeControl:
    """Pseudo-time steps scaled by the residence time D/U; `first` in its units."""
    unit = section.mesh.section.hydraulic_diameter / section.setup.gas_velocity
    return PseudoTimeControl(
        first=first * unit,
        smallest=SMALLEST_STEP * unit,
        largest=LARGEST_STEP * unit,
        growth=growth,
        tolerance=tolerance,
        max_steps=max_steps,
    )


class Physics:
    """What only the model of a scene tells.

    Attributes
    ----------
    section : the part of the section that is solved
    resolution : of the mesh
    """

    offsets: ClassVar[bool] = False

    def __init__(self, scene: Any) -> None:
        self.scene = scene
        offset = scene.wall_offset if self.offsets else 0.0
        self.section: Section = scene.geometry.section(scene.model.symmetry, offset)
        self.resolution: Resolution = scene.resolution


class SectionPhysics(Physics, ABC):
    """What a model tells of the sections that it solves.

    headline : the quantity that the last line of a log tells
    scheme : how its sections are made, started and stepped
    columns, warned : of monitor.csv, and those that a line of progress shows
    files : that a run may leave
    first_step : of pseudo-time, in units of the residence time
    coarsest : mesh of the nested iteration, core cell over the hydraulic diameter
    solved_words : what is solved
    """

    headline: ClassVar[str]
    scheme: ClassVar[Scheme]
    columns: ClassVar[Mapping[str, str]]
    warned: ClassVar[Sequence[str]]
    files: ClassVar[Sequence[str]]
    first_step: ClassVar[float]
    coarsest: ClassVar[float]
    solved_words: ClassVar[str]

    @abstractmethod
    def setup(self) -> Any:
        """Numbers of the section."""

    def meshes(self, comm: MPI.Comm = MPI.COMM_WORLD) -> list[Callable[[], Mesh]]:
        """Makers of the meshes of the nested iteration, coarse to fine."""
        return [
            partial(section_mesh, self.section, one, comm)
            for one in self.resolution.nested(self.section, self.coarsest)
        ]

    @abstractmethod
    def signs(self, section: Any) -> dict[str, float]:
        """The early warning of a run, with the pressure gradient [Pa/m]."""

    @abstractmethod
    def told(self, solution: Solution) -> dict[str, Any]:
        """What an answer is made of; raises SolverError for a state that is none."""

    def references(self) -> dict[str, list[Reference]]:
        """Published values that belong to the model."""
        return {}

    def fields(self, section: Any, told: Any = None) -> dict[str, Any]:
        """Fields for output."""
        found: dict[str, Any] = section.fields()
        return found

    @abstractmethod
    def write(self, section: Any, result: Result, out: Path | None, told: Any) -> None:
        """Profiles and pictures of a section."""

    @abstractmethod
    def skipped(self) -> list[str]:
        """Parts of the section and laws that the scene does without."""

    def skipped_of_axis(self) -> list[str]:
        """What is left out along the axis."""
        return []

    @abstractmethod
    def advice(self) -> list[str]:
        """What a user probably did not mean, one sentence each."""

    @abstractmethod
    def given(self) -> str:
        """What is given and what is found, in words."""

    @abstractmethod
    def entering(self) -> str:
        """What enters a line, in words."""

    @abstractmethod
    def examine(self) -> None:
        """Refuse what cannot be solved, without solving it; raises InputError."""

    @property
    @abstractmethod
    def size(self) -> tuple[int, int]:
        """Cells of the finest mesh, and about how many unknowns."""

    @abstractmethod
    def cost(self, unknowns: int) -> dict[str, float]:
        """About the memory [MB] and the CPU time [s] of solving and of compiling the forms."""

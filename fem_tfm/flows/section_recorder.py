# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a run of nested sections tells and keeps: progress, monitor.csv, checkpoint."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from fem_tfm.case import Case
from fem_tfm.flows import developed
from fem_tfm.flows.recorder import Recorder
from fem_tfm.output import checkpoint

if TYPE_CHECKING:
    from fem_tfm.progress import Progress


class SectionRecorder(Recorder, developed.Observer, ABC):
    """What a run tells and keeps while it works: progress, monitor.csv, checkpoint.

    Parameters
    ----------
    case : what is solved
    out : directory of the results, or None to keep nothing
    progress : where to tell
    resume : go on with an older monitor.csv

    A flow gives `columns` of monitor.csv with their units, the names in `warned` of the signs that
    a line of progress shows, `signs` and `multipliers`.
    """

    columns: ClassVar[Mapping[str, str]]
    warned: ClassVar[Sequence[str]]

    def __init__(self, case: Case, out: Path | None, progress: Progress, resume: bool) -> None:
        super().__init__(case, out, progress, resume, self.columns)
        self.level = self.steps = 0
        self._begun: tuple[Any, int, int] | None = None

    def compiling(self, what: str) -> None:
        """Tell which form is prepared, on the first mesh: later ones find it in the cache."""
        if what == "residual":
            self.lap("setup" if self._begun is None else "solve")
        if self._begun is None:
            self.progress.stage(f"forms: {what} (compiled once for each choice of closures)")

    def begin(self, section: Any, level: int, levels: int) -> None:
        """A mesh is ready."""
        self.lap("compile")
        self._begun = section, level, levels
        cells = section.mesh.num_cells
        text = f"mesh {level + 1} of {levels}: {cells} cells, {section.dofs} unknowns"
        self.progress.stage(text)
        self.log(text)

    def step(self, row: dict[str, float]) -> None:
        """A row of the monitor and the early-warning line."""
        # only now does the new mesh hold a state worth keeping
        self.section, self.level, levels = self._begun
        self.steps += 1
        values = {name: row[name] for name in ("dt", "iterations", "update")}
        values |= {"step": self.steps, "level": self.level + 1}
        values |= self.signs(self.section)
        if self.monitor is not None:
            self.monitor.write(values)
        warning = ", ".join(f"{n} {values[n]:.4g}" for n in self.warned if n in values)
        self.progress.update(self._fraction(row["dt"], levels), warning)
        self.log(f"step {self.steps}: dt {row['dt']:.3g} s, {warning}")

    def retry(self, dt: float, reason: str) -> None:
        """A line of the log for a step taken back."""
        self.log(f"taken back: {reason}; dt {dt:.3g} s")

    def _fraction(self, dt: float, levels: int) -> float:
        """Share of the work done, from the decades of dt that are behind on this mesh."""
        unit = self.case.geometry.hydraulic_diameter / self.case.operation.gas_superficial_velocity
        first, last = (math.log(c * unit) for c in (developed.FIRST_STEP, developed.LARGEST_STEP))
        share = min(max((math.log(dt) - first) / (last - first), 0.0), 1.0)
        return (self.level + 0.9 * share) / levels

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
        numbers |= {n: float(c.value) for n, c in self.multipliers(section).items()}
        fields = {name: section.unknown(name) for name in section.names}
        checkpoint.save(self.out, self.comm, fields, numbers)

    def restart(self) -> tuple[int, Callable[[Any], None]]:
        """Mesh to go on with and how to put the stored state on it."""
        numbers = checkpoint.numbers(self.out)
        self.steps = int(numbers["steps"])

        def restore(section: Any) -> None:
            fields = {name: section.unknown(name) for name in section.names}
            checkpoint.load(self.out, self.comm, fields)
            for name, function in fields.items():
                section.set_unknown(name, function)
            for name, constant in self.multipliers(section).items():
                constant.value = numbers[name]

        return int(numbers["level"]), restore

    @abstractmethod
    def signs(self, section: Any) -> dict[str, float]:
        """What shows that a state goes astray."""

    @abstractmethod
    def multipliers(self, section: Any) -> dict[str, Any]:
        """Constants that belong to the state."""

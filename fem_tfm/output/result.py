# SPDX-License-Identifier: LGPL-3.0-or-later
"""The result of a run: numbers with their errors and references, and what they cost."""

from __future__ import annotations

import difflib
import json
import math
import os
import platform
import resource
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fem_tfm.output.files import write_text

if TYPE_CHECKING:
    from fem_tfm.output.fields import Snapshot
    from fem_tfm.output.particles.tracked import Tracked

STATUSES = ("converged", "finished", "failed", "interrupted")

FILE = "result.json"
# units of the quantities that scenes tell
QUANTITIES = {
    "pressure_gradient": "Pa/m",
    "pressure_drop": "Pa",
    "drop_gas_friction": "Pa",
    "drop_solids_friction": "Pa",
    "drop_lift": "Pa",
    "drop_acceleration": "Pa",
    "drop_omitted_pressure": "Pa",
    "solids_mass_flow": "kg/s",
    "gas_mass_flow": "kg/s",
    "holdup": "-",
    "max_solids_fraction": "-",
    "bed_fraction": "-",
    "slip_velocity": "m/s",
    "friction_factor": "-",
    "secondary_velocity_max": "-",
    "secondary_velocity_diagonal": "-",
    "centre_to_bulk": "-",
    "axis_energy": "-",
    "corner_wall_shear": "-",
    "smallest_stress": "-",
    "wall_distance_plus": "-",
    "overshoot": "-",
    "overshoot_position": "m",
    "overshoot_diameters": "-",
    "development_length": "m",
    "nusselt": "-",
    "turbulent_prandtl_axis": "-",
    "turbulent_prandtl_wall": "-",
    "outlet_temperature": "K",
    "bed_height": "m",
    "entrance_pressure_drop": "Pa",
    "friction_drop": "Pa",
    "particle_drop": "Pa",
    "flux_drop": "Pa",
    "wear": "kg/s",
    "wear_largest": "kg/m2/s",
    "wear_position": "m",
    "impact_rate": "1/s",
    "impact_speed": "m/s",
    "impact_angle": "deg",
    "bend_drop": "Pa",
    "slug_velocity": "m/s",
    "slug_length": "m",
    "slug_porosity": "-",
    "least_porosity": "-",
    "grain_velocity": "m/s",
    "top_grain_velocity": "m/s",
    "slug_grains": "-",
    "grains_in_tube": "-",
    "slug_rate": "1/s",
}
# of those that each material of a cloud has, named `quantity_material`
PER_MATERIAL = {
    "particle_exit_velocity": "m/s",
    "particle_residence_time": "s",
    "particle_deposition": "-",
    "particle_collision_frequency": "1/s",
}


def unit_of(name: str) -> str | None:
    """Unit of a quantity, None where there is no such quantity."""
    known = (unit for stem, unit in PER_MATERIAL.items() if name.startswith(f"{stem}_"))
    return QUANTITIES.get(name) or next(known, None)


@dataclass(frozen=True)
class Reference:
    """A published or measured value of a quantity, in the quantity's unit, and where it is from."""

    value: float
    source: str = ""


@dataclass(frozen=True)
class Quantity:
    """One number of a result.

    value, unit : the number and its SI unit
    error_estimate : estimated discretisation error in the same unit, None if unknown
    reference, source : the first reference, None if there is none
    references : all references; give either these or `reference` and `source`
    """

    value: float
    unit: str
    error_estimate: float | None = None
    reference: float | None = None
    source: str | None = None
    references: tuple[Reference, ...] = ()

    def __post_init__(self) -> None:
        given = [r if isinstance(r, Reference) else Reference(**r) for r in self.references]
        if not given and self.reference is not None:
            given = [Reference(self.reference, self.source or "")]
        object.__setattr__(self, "references", tuple(given))
        if given:
            object.__setattr__(self, "reference", given[0].value)
            object.__setattr__(self, "source", given[0].source)

    def as_dict(self) -> dict[str, Any]:
        """Keys as in result.json; "references" only where there are several."""
        names = ("value", "unit", "error_estimate", "reference", "source")
        entry: dict[str, Any] = {name: getattr(self, name) for name in names}
        if len(self.references) > 1:
            entry["references"] = [{"value": r.value, "source": r.source} for r in self.references]
        return entry


@dataclass(frozen=True)
class InputRange:
    """What an input that the source does not print moves the pressure gradient by.

    key : of the case
    low, high : between which values it lies
    down, up : relative changes of the gradient, to first order [-]
    reason : where the range is from
    """

    key: str
    low: float
    high: float
    down: float
    up: float
    reason: str

    def __str__(self) -> str:
        """In words: "solids.diameter from 0.00014 to 0.00019: -2.2 to +3.3 % (eq. (22))"."""
        # adding zero turns -0.0 into 0.0
        down, up = (f"{round(100 * change, 1) + 0.0:+.1f}" for change in (self.down, self.up))
        return f"{self.key} from {self.low:g} to {self.high:g}: {down} to {up} % ({self.reason})"


# quantities that the inputs move as they move the pressure gradient
WITH_GRADIENT = ("pressure_gradient", "pressure_drop")


@dataclass
class Result:
    """What a run found, and what it cost.

    Parameters
    ----------
    status : "converged", "finished", "failed" or "interrupted"; a failed result carries no
        quantities and no balances, whatever it is given
    flow, solution : kind of scene, and "developed", "developing" or "unsteady"
    title : of the case
    cells, dofs, ranks : size of the finest problem and number of processes
    seconds : wall time by stage ("setup", "compile", "solve", "output") [s]
    cpu_seconds : CPU time summed over ranks [s]
    peak_memory_mb : largest resident memory summed over ranks [MB]
    quantities : by name; ``result["pressure_gradient"]`` is the value
    balances : relative error of each balance [-]
    skipped : what the scene did not need, and why
    notes : what the answer says of itself: terms of the mesh that were raised, finer meshes
    inferred : inputs that the source does not print
    inputs : what some of them move the pressure gradient by
    estimates : what published correlations give for the same line, in words
    versions : of the programs used
    unestimated : why the errors of the quantities are not known, an empty text where they are
    warnings : what was probably not meant, and what the answer does not hold for
    reason : why it failed or stopped
    directory : where its files are; not written
    sections : arrays for scripts, such as profiles by name; not written
    fields : values of each field on `points` (n, 3) [m]: nodes, or centres of cells; on rank 0, not
        written
    tracked : what became of the particles, None without any; not written

    Raises
    ------
    ValueError
        for a status or solution that does not exist.
    """

    status: str
    flow: str
    solution: str
    title: str = ""
    cells: int = 0
    dofs: int = 0
    ranks: int = 1
    seconds: dict[str, float] = field(default_factory=dict)
    cpu_seconds: float = math.nan
    peak_memory_mb: float = math.nan
    quantities: dict[str, Quantity] = field(default_factory=dict)
    balances: dict[str, float] = field(default_factory=dict)
    skipped: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    inferred: list[str] = field(default_factory=list)
    inputs: list[InputRange] = field(default_factory=list)
    estimates: list[str] = field(default_factory=list)
    unestimated: str = ""
    versions: dict[str, str] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    reason: str = ""
    directory: Path | None = None
    sections: dict[str, Any] = field(default_factory=dict, repr=False)
    fields: dict[str, NDArray[np.float64]] = field(default_factory=dict, repr=False)
    points: NDArray[np.float64] | None = field(default=None, repr=False)
    tracked: Tracked | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        for name, allowed in (("status", STATUSES),):
            if getattr(self, name) not in allowed:
                raise ValueError(f"{name} {getattr(self, name)!r} is none of {', '.join(allowed)}")
        if self.status == "failed":
            self.quantities, self.balances = {}, {}

    def __getitem__(self, name: str) -> float:
        """Value of a quantity [its SI unit]; KeyError names the nearest ones."""
        if name not in self.quantities:
            raise KeyError(self._absent(name))
        return self.quantities[name].value

    def __contains__(self, name: object) -> bool:
        return name in self.quantities

    def input_range(self, name: str) -> tuple[float, float] | None:
        """Between which values the inputs that are not printed put a quantity, None if unknown.

        Their changes, to first order, are added as independent: roots of the sums of squares.
        """
        if name not in self.quantities or name not in WITH_GRADIENT or not self.inputs:
            return None
        down = math.hypot(*(min(one.down, 0.0) for one in self.inputs))
        up = math.hypot(*(max(one.up, 0.0) for one in self.inputs))
        value = self[name]
        return value - abs(value) * down, value + abs(value) * up

    def take(self, moment: Snapshot) -> None:
        """Keep the values of the fields of a moment on their points."""
        self.points = moment.points
        if moment.cellwise and not moment.nodal and len(moment.cells):
            self.points = moment.points[moment.cells].mean(axis=1)
        self.fields = {**moment.cellwise, **moment.nodal}

    def _absent(self, name: str) -> str:
        if not self.quantities:
            why = f": {self.reason}" if self.reason else ""
            return f"no quantity {name!r}, for the run {self.status} without any{why}"
        near = difflib.get_close_matches(name, self.quantities, n=3, cutoff=0.4)
        there_are = ", ".join(self.quantities)
        hint = f"did you mean {', '.join(near)}?" if near else f"there are {there_are}"
        return f"no quantity {name!r}; {hint}"

    def as_dict(self) -> dict[str, Any]:
        """Plain content of result.json: strict JSON types, null for what is not finite."""
        hidden = ("quantities", "directory", "sections", "fields", "points", "tracked")
        content = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in hidden}
        content["quantities"] = {name: q.as_dict() for name, q in self.quantities.items()}
        content["inputs"] = [asdict(one) for one in self.inputs]
        plain: dict[str, Any] = _strict(content)
        return plain

    def write(self, directory: str | Path) -> Path:
        """Write `directory`/result.json in one atomic step (on rank 0 only) and return its path."""
        path = Path(directory) / FILE
        write_text(path, json.dumps(self.as_dict(), indent=2, allow_nan=False) + "\n")
        self.directory = Path(directory)
        return path

    @classmethod
    def read(cls, path: str | Path) -> Result:
        """Read a result from its directory or file; numbers that were not finite become nan."""
        path = Path(path)
        path = path / FILE if path.is_dir() else path
        content = json.loads(path.read_text(encoding="utf-8"))
        known = {f.name for f in fields(cls)}
        content = {key: value for key, value in content.items() if key in known}
        content["quantities"] = {
            name: Quantity(**{**entry, "value": _number(entry["value"])})
            for name, entry in content["quantities"].items()
        }
        content["inputs"] = [InputRange(**one) for one in content.get("inputs", ())]
        for table in ("balances", "seconds"):
            content[table] = {name: _number(value) for name, value in content[table].items()}
        for name in ("cpu_seconds", "peak_memory_mb"):
            content[name] = _number(content[name])
        return cls(**content, directory=path.parent)


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def _strict(value: Any) -> Any:
    """Plain JSON types: numpy numbers become Python's, and what is not finite becomes None."""
    if isinstance(value, Mapping):
        return {str(key): _strict(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_strict(entry) for entry in value]
    if hasattr(value, "item"):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def versions() -> dict[str, str]:
    """Versions of what this process has loaded, from Python to PETSc and MPI."""
    found = {"python": platform.python_version()}
    for name in ("fem_tfm", "dolfinx", "basix", "ffcx", "ufl", "gmsh", "numpy"):
        version = getattr(sys.modules.get(name), "__version__", None)
        if version:
            found[name] = str(version)
    if petsc := sys.modules.get("petsc4py.PETSc"):
        found["petsc"] = ".".join(map(str, petsc.Sys.getVersion()))
    if mpi := sys.modules.get("mpi4py.MPI"):
        found["mpi"] = " ".join(mpi.Get_library_version().split("\n")[0].split()).strip("\0")
    return found


def peak_memory_mb(comm: Any = None) -> float:
    """Largest resident memory so far [MB], summed over the ranks of `comm` (collective)."""
    # the kernel counts in kilobytes, macOS in bytes
    unit = 1.0 if sys.platform == "darwin" else 1024.0
    own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6
    return own if comm is None else comm.allreduce(own)


def cpu_seconds(comm: Any = None) -> float:
    """CPU time so far [s] with that of ended children (the form compiler's), summed over ranks."""
    used = os.times()
    own = used.user + used.system + used.children_user + used.children_system
    return own if comm is None else comm.allreduce(own)

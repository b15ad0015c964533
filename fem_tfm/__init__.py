# SPDX-License-Identifier: LGPL-3.0-or-later
"""fem_tfm: gas-solid flow in pneumatic conveying by finite elements.

In Python::

    import fem_tfm as ft

    pipe = ft.Pipe(diameter=0.010, length=2.4)
    coal = ft.Solids(density=1700, diameter=1.6e-4)
    model = ft.TwoFluid(ft.Gas(density=33.5, viscosity=1.8e-5), coal, friction=ft.laws.Dartevelle())
    answer = ft.Developed(model, pipe, ft.Feed(6.43, solids_mass_flow=0.194)).run()
    answer["pressure_gradient"], answer.fields["alpha_s"]

    ft.load("demos/dense_pipe/case3.toml").run()     # TOML builds the same objects
"""

from __future__ import annotations

import importlib
import importlib.util
from typing import TYPE_CHECKING, Any

# the wheel of DOLFINx must load MPI and PETSc in its own order; other installations lack it
if importlib.util.find_spec("dolfinx_solver") is not None:
    import dolfinx_solver  # noqa: F401

if TYPE_CHECKING:
    from fem_tfm import laws
    from fem_tfm.case import Case, load
    from fem_tfm.cloud import Cloud, Material
    from fem_tfm.errors import InputError, SolverError
    from fem_tfm.geometry.resolution import Resolution
    from fem_tfm.geometry.shapes import Bend, Duct, Pipe
    from fem_tfm.materials import Gas, Solids
    from fem_tfm.models.reynolds_stress.model import Heat, ReynoldsStress
    from fem_tfm.models.slug.gas import TubeGas
    from fem_tfm.models.slug.grains import Grain
    from fem_tfm.models.slug.model import DiscreteElements
    from fem_tfm.models.slug.tube import Conveying
    from fem_tfm.models.two_fluid.model import SectionTerms, TwoFluid
    from fem_tfm.operation import Feed, Initial, Inlet
    from fem_tfm.output.particles.tracked import Tracked
    from fem_tfm.output.result import Result
    from fem_tfm.scenes.developed import Developed
    from fem_tfm.scenes.developing import Developing
    from fem_tfm.scenes.slug.scene import Averages, Slug, TubeNumerics, TubeStart
    from fem_tfm.scenes.statement import (
        MarchNumerics,
        Output,
        Reference,
        SteadyNumerics,
        TimeNumerics,
    )
    from fem_tfm.scenes.unsteady import Unsteady

__version__ = "0.1.0"
# public names and the modules that hold them; a name is loaded when it is first used
_HOMES = {
    "Averages": "scenes.slug.scene",
    "Bend": "geometry.shapes",
    "Case": "case",
    "Cloud": "cloud",
    "Conveying": "models.slug.tube",
    "Developed": "scenes.developed",
    "Developing": "scenes.developing",
    "DiscreteElements": "models.slug.model",
    "Duct": "geometry.shapes",
    "Feed": "operation",
    "Gas": "materials",
    "Grain": "models.slug.grains",
    "Heat": "models.reynolds_stress.model",
    "Initial": "operation",
    "Inlet": "operation",
    "InputError": "errors",
    "MarchNumerics": "scenes.statement",
    "Material": "cloud",
    "Output": "scenes.statement",
    "Pipe": "geometry.shapes",
    "Reference": "scenes.statement",
    "SectionTerms": "models.two_fluid.model",
    "Resolution": "geometry.resolution",
    "Result": "output.result",
    "ReynoldsStress": "models.reynolds_stress.model",
    "Slug": "scenes.slug.scene",
    "Solids": "materials",
    "SolverError": "errors",
    "SteadyNumerics": "scenes.statement",
    "TimeNumerics": "scenes.statement",
    "Tracked": "output.particles.tracked",
    "TubeGas": "models.slug.gas",
    "TubeNumerics": "scenes.slug.scene",
    "TubeStart": "scenes.slug.scene",
    "TwoFluid": "models.two_fluid.model",
    "Unsteady": "scenes.unsteady",
    "load": "case",
}
__all__ = [
    "Averages",
    "Bend",
    "Case",
    "Cloud",
    "Conveying",
    "Developed",
    "Developing",
    "DiscreteElements",
    "Duct",
    "Feed",
    "Gas",
    "Grain",
    "Heat",
    "Initial",
    "Inlet",
    "InputError",
    "MarchNumerics",
    "Material",
    "Output",
    "Pipe",
    "Reference",
    "Resolution",
    "Result",
    "ReynoldsStress",
    "SectionTerms",
    "Slug",
    "Solids",
    "SolverError",
    "SteadyNumerics",
    "TimeNumerics",
    "Tracked",
    "TubeGas",
    "TubeNumerics",
    "TubeStart",
    "TwoFluid",
    "Unsteady",
    "__version__",
    "laws",
    "load",
]


def __getattr__(name: str) -> Any:
    """Load a public name when it is first used, so that what is not needed costs nothing."""
    if name == "laws":
        return importlib.import_module("fem_tfm.laws")
    if name in _HOMES:
        if name.startswith("Develop") or name in ("Slug", "Unsteady"):
            # a scene must know all kinds, to say which one reads a key
            importlib.import_module("fem_tfm.scenes")
        return getattr(importlib.import_module(f"fem_tfm.{_HOMES[name]}"), name)
    from fem_tfm.errors import nearest

    near = nearest(name, __all__)
    hint = f"; did you mean {near!r}?" if near and not name.startswith("_") else ""
    raise AttributeError(f"module 'fem_tfm' has no attribute {name!r}{hint}")


def __dir__() -> list[str]:
    return __all__

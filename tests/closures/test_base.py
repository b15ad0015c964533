# SPDX-License-Identifier: LGPL-3.0-or-later
"""Registry, parameters, and the errors a user meets in a case file."""

import importlib
import math
import os
import shutil
import subprocess
import sys
from dataclasses import FrozenInstanceError, dataclass, fields
from pathlib import Path

import pytest
import ufl

import fem_tfm.closures as closures
from fem_tfm.closures import base
from fem_tfm.closures.base import Closure, parameter, register
from fem_tfm.errors import InputError

LAWS = [(f, n) for f in closures.families() for n in closures.names(f)]

EXPECTED = {
    "drag": "beetstra clift-gauvin constant di-felice ergun gibilaro gidaspow huilin-gidaspow "
    "koch-hill schiller-naumann syamlal-obrien tenneti three-zone wen-yu",
    "friction": "berzi dartevelle johnson-jackson mu-i none pu schaeffer srivastava-sundaresan "
    "syamlal",
    "gas-wall": "free-slip log-law log-law-k low-reynolds no-slip",
    "granular": "garzo-dufty gidaspow hrenya-sinclair lun syamlal-obrien",
    "radial": "carnahan-starling lun-savage ma-ahmadi savage sinclair-jackson",
    "solids-wall": "coulomb free-slip johnson-jackson no-slip rough schneiderbauer",
    "turbulence": "laminar mixing-length k-epsilon realizable",
    "dispersed": "none simonin k-epsilon",
    "dispersion": "none burns simonin",
    "slip-production": "none koch",
    "free-path": "none agrawal",
    "particle-dispersion": "none langevin eddies",
    "impact": "elastic restitution stick",
}


@pytest.fixture
def registry(monkeypatch):
    """A copy of the registry that a test may spoil."""
    copy = {family: dict(laws) for family, laws in base._REGISTRY.items()}
    monkeypatch.setattr(base, "_REGISTRY", copy)
    return copy


@pytest.mark.parametrize("family", EXPECTED)
def test_every_promised_law_is_there(family):
    assert set(EXPECTED[family].split()) <= set(closures.names(family))


@pytest.mark.parametrize(("family", "name"), LAWS)
def test_every_law_is_made_documented_and_frozen(family, name):
    law = closures.make(family, name)
    assert (law.family, law.name) == (family, name)
    assert law.source and law.validity
    with pytest.raises(FrozenInstanceError):
        law.anything = 1.0
    for field in fields(law):
        assert field.metadata["doc"] and field.metadata["unit"], field.name


@pytest.mark.parametrize(("family", "name"), LAWS)
def test_bound_wraps_every_number(family, name):
    law = closures.make(family, name)
    bound = law.bound(ufl.as_ufl)
    assert type(bound) is type(law)
    for field in fields(law):
        value = getattr(bound, field.name)
        assert isinstance(value, ufl.core.expr.Expr)
        assert float(value) == getattr(law, field.name)


def test_catalogue_lists_formula_source_and_ranges():
    entry = {e["name"]: e for e in closures.catalogue("drag")}["three-zone"]
    assert entry["title"] == "Three-zone drag of dense-phase conveying."
    assert "150 a^2 mu_g" in entry["formula"]
    assert "Source:" not in entry["formula"]
    assert entry["symbols"].startswith("a = alpha_s solids fraction")
    assert entry["symbols"].endswith("beta [kg/m3/s].")
    assert entry["source"].endswith("Powder Technol. 129, 139-152.")
    assert entry["validity"].startswith("all fractions")
    assert entry["parameters"][0] == {
        "name": "C",
        "default": 1.0,
        "unit": "-",
        "doc": "factor of the intermediate zone",
        "range": "a number above 0",
    }


def test_catalogue_of_everything_counts_every_law():
    entries = closures.catalogue()
    assert [(e["family"], e["name"]) for e in entries] == LAWS
    assert all(e["formula"] and e["symbols"] for e in entries)


def test_make_from_a_table_and_from_a_law():
    law = closures.make("friction", {"model": "dartevelle", "coefficient": 500})
    assert law.coefficient == 500.0 and type(law.coefficient) is float
    assert closures.make("friction", law) is law


BAD = [
    ("drag", "wenyu", None, "closures.drag", "wen-yu"),
    ("drag", {"model": "wenyu"}, None, "closures.drag.model", "wen-yu"),
    ("drag", {"width": 0.1}, None, "closures.drag.model", None),
    ("drag", 3, None, "closures.drag", None),
    ("drag", True, None, "closures.drag", None),
    ("drag", {"model": "three-zone", "widht": 0.1}, None, "closures.drag.widht", "width"),
    ("drag", {"model": "wen-yu", "C": 1.0}, None, "closures.drag.C", None),
    ("drag", {"model": "three-zone", "C": 0.0}, None, "closures.drag.C", None),
    ("drag", {"model": "three-zone", "C": "1"}, None, "closures.drag.C", None),
    ("drag", {"model": "three-zone", "C": True}, None, "closures.drag.C", None),
    ("drag", {"model": "three-zone", "C": math.nan}, None, "closures.drag.C", None),
    ("drag", {"model": "three-zone", "C": math.inf}, None, "closures.drag.C", None),
    (
        "solids-wall",
        {"model": "schneiderbauer", "restitution": 1.2},
        "walls.solids",
        "walls.solids.restitution",
        None,
    ),
    ("solids-wall", "coloumb", "walls.solids", "walls.solids", "coulomb"),
]


@pytest.mark.parametrize(("family", "spec", "key", "at", "hint"), BAD)
def test_bad_input_names_the_key_and_the_nearest(family, spec, key, at, hint):
    with pytest.raises(InputError) as error:
        closures.make(family, spec, key)
    assert error.value.key == at
    assert error.value.suggestion == hint
    assert at in str(error.value)


def test_unknown_model_lists_the_valid_ones():
    with pytest.raises(InputError, match=r"one of .*beetstra.*wen-yu"):
        closures.make("drag", "nonsense")


def test_unknown_parameter_lists_the_valid_ones():
    with pytest.raises(InputError, match="one of C, width"):
        closures.make("drag", {"model": "three-zone", "factor": 1.0})


def test_out_of_range_says_the_range():
    with pytest.raises(InputError, match=r"expected a number at least 0 and at most 1"):
        closures.make("solids-wall", {"model": "schneiderbauer", "restitution": -0.1})


def test_a_law_of_another_family_is_refused():
    with pytest.raises(InputError, match="a law of the family friction"):
        closures.make("friction", closures.make("drag", "ergun"))


def test_unknown_family():
    with pytest.raises(InputError) as error:
        closures.names("drug")
    assert error.value.suggestion == "drag"


def test_switches_are_kept_and_checked(registry):
    @register("drag", "switched")
    @dataclass(frozen=True)
    class Switched(Closure):
        """A law with a switch.

        Validity: tests.
        Source: tests.
        """

        flag: bool = parameter(False, "-", "a switch")
        size: float = parameter(2.0, "m", "a size", ge=1)

    law = closures.make("drag", {"model": "switched", "flag": True})
    assert law.bound(ufl.as_ufl).flag is True
    with pytest.raises(InputError, match="true or false"):
        closures.make("drag", {"model": "switched", "flag": 1})
    ranges = [p["range"] for p in closures.catalogue("drag")[-5]["parameters"]]
    assert closures.catalogue("drag")[-5]["name"] == "switched"
    assert ranges == ["true or false", "a number at least 1 [m]"]


def test_register_refuses_a_law_without_a_source(registry):
    with pytest.raises(TypeError, match="lacks Validity: or Source:"):

        @register("drag", "undocumented")
        @dataclass(frozen=True)
        class Undocumented(Closure):
            """A law from nowhere."""

    assert "undocumented" not in closures.names("drag")


def test_register_refuses_a_taken_name_and_a_foreign_class(registry):
    class Foreign:
        """Not a closure."""

    with pytest.raises(TypeError, match="must derive from Closure"):
        register("drag", "foreign")(Foreign)

    @dataclass(frozen=True)
    class Second(Closure):
        """A second Ergun.

        Validity: tests.
        Source: tests.
        """

    with pytest.raises(TypeError, match="already Ergun"):
        register("drag", "ergun")(Second)


def example_of_the_recipe() -> str:
    """The file that docs/adding_a_closure.md tells to write."""
    text = Path(__file__).parents[2].joinpath("docs/adding_a_closure.md").read_text("utf-8")
    return text.partition("```python\n")[2].partition("```")[0]


@pytest.mark.parametrize("folder", ["", "walls"])
def test_the_file_of_the_recipe_registers_itself_without_dolfinx(tmp_path, folder):
    package = Path(importlib.import_module("fem_tfm.closures").__file__).parent
    copy = tmp_path / "fem_tfm"
    shutil.copytree(package, copy / "closures", ignore=shutil.ignore_patterns("__pycache__"))
    (copy / "__init__.py").touch()
    for name in ("errors.py", "materials.py", "parameters.py"):
        shutil.copy(package.parent / name, copy / name)
    (copy / "closures" / folder / "my_drag.py").write_text(example_of_the_recipe())
    program = (
        "import sys; sys.modules.update(dolfinx=None, petsc4py=None, mpi4py=None)\n"
        # the finder of an editable installation comes before the path
        "sys.meta_path[:] = [f for f in sys.meta_path if 'ScikitBuild' not in type(f).__name__]\n"
        "import fem_tfm.closures as c\n"
        "law = c.make('drag', {'model': 'my-drag', 'n': 2})\n"
        "(told,) = (e for e in c.catalogue('drag') if e['name'] == 'my-drag')\n"
        "print(c.__file__, law.n, all(told.values()))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    path, exponent, complete = done.stdout.split()
    assert Path(path).is_relative_to(tmp_path)
    assert (float(exponent), complete) == (2.0, "True")

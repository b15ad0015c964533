# SPDX-License-Identifier: LGPL-3.0-or-later
"""The packaging agrees with the files: every room is installed, every import required."""

from __future__ import annotations

import ast
import itertools
import re
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path
from typing import Any

import pytest

# loaded from the wheel of DOLFINx where that is installed, and from elsewhere otherwise
BUNDLED = {"dolfinx", "dolfinx_solver", "petsc4py"}
# used by tests only where it happens to be installed
OPTIONAL = {"vtk", "pyvista"}


@pytest.fixture(scope="module")
def project() -> dict[str, Any]:
    """The contents of pyproject.toml."""
    return tomllib.loads((Path(__file__).parent.parent / "pyproject.toml").read_text())


def imported(folder: Path) -> set[str]:
    """Top-level names of all modules that the files of a folder import."""
    found = set()
    for path in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                found.add(node.module.partition(".")[0])
    return found - set(sys.stdlib_module_names) - {"fem_tfm", "tests"}


def named(requirements: list[str]) -> set[str]:
    """Names of the distributions that are required."""
    return {re.split(r"[<>=~!]", requirement)[0].strip().lower() for requirement in requirements}


def owners() -> dict[str, set[str]]:
    """Distributions that each module comes from, by their normalised names."""
    return {
        module: {re.sub(r"[-_.]+", "-", name).lower() for name in names}
        for module, names in packages_distributions().items()
    }


def test_every_room_is_installed(root: Path, project: dict[str, Any]) -> None:
    assert project["tool"]["scikit-build"]["wheel"]["packages"] == ["fem_tfm"]
    # the Gmsh scripts are installed by CMake
    assert "install(DIRECTORY meshes/" in (root / "CMakeLists.txt").read_text(encoding="utf-8")


def test_every_import_is_required(root: Path, project: dict[str, Any]) -> None:
    required, known = named(project["project"]["dependencies"]), owners()
    for module in imported(root / "fem_tfm") - BUNDLED:
        assert required & known.get(module, set()), module


def test_every_import_of_the_tests_is_required(root: Path, project: dict[str, Any]) -> None:
    extra = project["project"]["optional-dependencies"]["dev"]
    required, known = named(project["project"]["dependencies"]) | named(extra), owners()
    local = {p.stem for p in (root / "tests").rglob("*.py")}
    for module in imported(root / "tests") - BUNDLED - OPTIONAL - local:
        assert required & known.get(module, set()), module


def test_the_library_asks_for_ranges_and_the_checkout_for_exact_versions(
    root: Path, project: dict[str, Any]
) -> None:
    extras = list(itertools.chain(*project["project"]["optional-dependencies"].values()))
    required = project["project"]["dependencies"] + extras + project["build-system"]["requires"]
    assert not [requirement for requirement in required if "==" in requirement]
    lines = (root / ".ci/constraints.txt").read_text(encoding="utf-8").splitlines()
    pinned = [line for line in lines if line and not line.startswith("#")]
    assert all(re.fullmatch(r"[A-Za-z0-9-]+==[0-9][0-9a-z.]*", line) for line in pinned)
    assert named(required) <= named(pinned)


def test_nothing_ties_the_checkout_to_a_machine(root: Path) -> None:
    names = ("pyproject.toml", "Makefile", ".ci/run", ".ci/setup", ".ci/find-python")
    for name in (*names, ".ci/constraints.txt"):
        text = (root / name).read_text()
        assert "://" not in text, name
        assert not re.search(r"(index|registry)[-_]url|find-links", text), name

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gmsh: its failures, its signals, and the Gmsh of a user."""

from __future__ import annotations

import builtins
import signal
from pathlib import Path
from typing import Any

import pytest
from measures import (
    DUCT,
    PIPE,
    section,
)

from fem_tfm.errors import SolverError
from fem_tfm.geometry import gmsh as gmsh_module


@pytest.mark.mpi
def test_failure_of_gmsh_is_raised_on_every_rank(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gmsh_module, "script", lambda name: Path("/no/such/script.geo"))
    with pytest.raises(SolverError, match="no mesh"):
        section(PIPE, 1)


def test_missing_system_library_is_one_clear_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    original = builtins.__import__

    def refuse(name: str, *args: Any, **kwargs: Any) -> Any:
        if name == "gmsh":
            raise OSError("libGLU.so.1: cannot open shared object file")
        return original(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", refuse)
    with pytest.raises(SolverError, match=r"libGLU\.so\.1.*libglu1-mesa"):
        section(PIPE, 1)


def test_interrupts_still_reach_python() -> None:
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    section(PIPE, 1)
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before


def test_gmsh_of_the_user_is_left_alone() -> None:
    import gmsh

    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("of the user")
        order = gmsh.option.getNumber("Mesh.ElementOrder")
        counts = [section(PIPE, level).num_cells for level in (1, 2)]
        counts += [section(DUCT, level).num_cells for level in (1, 1)]
        assert counts == [80, 180, counts[2], counts[2]]
        assert gmsh.model.getCurrent() == "of the user"
        assert gmsh.option.getNumber("Mesh.ElementOrder") == order
        assert gmsh.isInitialized()
    finally:
        gmsh.finalize()


@pytest.mark.parametrize("name", ["pipe", "duct"])
def test_scripts_open_in_gmsh_as_they_are(name: str, root: Path) -> None:
    import gmsh

    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(root / "meshes" / f"{name}.geo"))
        gmsh.model.mesh.generate(2)
        kinds, tags, _ = gmsh.model.mesh.getElements(2)
        assert list(kinds) == [9] and len(tags[0]) > 100
        names = {gmsh.model.getPhysicalName(*group) for group in gmsh.model.getPhysicalGroups()}
        assert names == {"fluid", "wall", "symmetry"}
    finally:
        gmsh.finalize()

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled forms: the name in the cache, values of constants, several forms at once."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import dolfinx_solver  # noqa: F401
import numpy as np
import pytest
import ufl
from dolfinx import fem, jit
from dolfinx.mesh import create_unit_square
from mpi4py import MPI

from fem_tfm import fenics
from fem_tfm.fenics import compile_expression, compile_form, compile_forms, renumbered

BOUNDARIES = (7, 97, 997, 9998, 10**9)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache of forms, the same on all ranks."""
    folder = MPI.COMM_WORLD.bcast(tmp_path)
    values = jit.DOLFINX_DEFAULT_JIT_OPTIONS
    monkeypatch.setitem(values, "cache_dir", (folder, values["cache_dir"][1]))
    return folder


@pytest.fixture
def counted_from(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Let UFL count constants on from a number, as if so many had been made before."""

    def begin(number: int) -> None:
        monkeypatch.setattr(ufl.Constant, "_counter", itertools.count(number))

    return begin


@pytest.fixture(scope="module")
def space() -> Iterator[fem.FunctionSpace]:
    """Linear functions on a square."""
    yield fem.functionspace(create_unit_square(MPI.COMM_WORLD, 2, 2), ("Lagrange", 1))


def terms(space: fem.FunctionSpace) -> tuple[Any, Any, list[fem.Constant]]:
    """Residual and Jacobian in which five constants meet in products and sums."""
    u, v = fem.Function(space), ufl.TestFunction(space)
    u.x.array[:] = 0.5
    numbers = [fem.Constant(space.mesh, float(k)) for k in range(2, 7)]
    a, b, c, d, e = numbers
    flow = ufl.exp(-d * u) * (c * a + b * e) * u + a * b * ufl.sqrt(c + e * u**2)
    residual = flow * v * ufl.dx + d * a * ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx
    return residual, ufl.derivative(residual, u), numbers


def names(forms: list[fem.Form]) -> list[str]:
    """Names under which forms lie in the cache."""
    return [form.module.__name__ for form in forms]


def test_the_name_does_not_depend_on_how_many_constants_were_made(
    space: fem.FunctionSpace, counted_from: Any
) -> None:
    found = set()
    for number in (0, *BOUNDARIES):
        counted_from(number)
        found.add(tuple(names(compile_forms(terms(space)[:2]))))
    assert len(found) == 1


def test_the_form_itself_would_get_other_names(space: fem.FunctionSpace, counted_from: Any) -> None:
    signatures = set()
    for number in (0, *BOUNDARIES):
        counted_from(number)
        signatures.add(terms(space)[0].signature())
    assert len(signatures) > 1


def test_neither_the_counter_nor_the_given_form_is_touched(
    space: fem.FunctionSpace, counted_from: Any
) -> None:
    counted_from(97)
    residual, _, numbers = terms(space)
    before = residual.signature(), residual.constants()
    assert renumbered([residual])[0].constants() != residual.constants()
    compile_form(residual)
    assert (residual.signature(), residual.constants()) == before
    assert [c.count() for c in numbers] == list(range(97, 102))
    assert next(ufl.Constant._counter) == 102


@pytest.mark.parametrize("number", BOUNDARIES)
def test_each_constant_keeps_its_value(
    space: fem.FunctionSpace, counted_from: Any, number: int
) -> None:
    counted_from(number)
    residual, jacobian, numbers = terms(space)
    compiled, derived = compile_forms([residual, jacobian])
    for values in ([2, 3, 4, 5, 6], [0.3, -1.2, 2.5, 0.7, 1.9]):
        for constant, value in zip(numbers, values, strict=True):
            constant.value = value
        wanted = fem.assemble_vector(fem.form(residual)).array
        np.testing.assert_allclose(fem.assemble_vector(compiled).array, wanted, rtol=1e-13)
        wanted = fem.assemble_matrix(fem.form(jacobian)).data
        np.testing.assert_allclose(fem.assemble_matrix(derived).data, wanted, rtol=1e-13)


def test_an_expression_keeps_its_name_and_value(
    space: fem.FunctionSpace, counted_from: Any
) -> None:
    points = space.element.interpolation_points
    for number in BOUNDARIES:
        counted_from(number)
        a, b = (fem.Constant(space.mesh, value) for value in (3.0, 5.0))
        x = ufl.SpatialCoordinate(space.mesh)
        function = fem.Function(space)
        function.interpolate(compile_expression(a * (b - x[0]), points))
        np.testing.assert_allclose(
            function.x.array, 3 * (5 - space.tabulate_dof_coordinates()[:, 0])
        )


@pytest.mark.mpi
def test_forms_are_compiled_side_by_side_and_come_back_in_order(
    space: fem.FunctionSpace, cache: Path
) -> None:
    residual, jacobian, numbers = terms(space)
    constraint = numbers[0] * numbers[1] * ufl.dx
    given = [constraint, residual, jacobian, residual]
    compiled = compile_forms(given)
    assert [form.rank for form in compiled] == [0, 1, 2, 1]
    assert len(list(cache.glob("*.c"))) == len(list(cache.glob("*.c.cached"))) == 3
    assert names(compiled) == names([compile_form(form) for form in given])
    assert names(compiled)[1] == names(compiled)[3]
    total = space.mesh.comm.allreduce(fem.assemble_scalar(compiled[0]))
    assert total == pytest.approx(6.0)


def test_fenicsx_finds_in_the_cache_what_was_compiled_here(
    space: fem.FunctionSpace, cache: Path
) -> None:
    compiled = compile_forms([terms(space)[0]])
    assert list(cache.glob("*.c"))
    assert compiled[0].code == (None, None)  # FFCx has written nothing


def test_a_form_whose_run_was_killed_is_compiled_anew(
    space: fem.FunctionSpace, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    form = 3 * ufl.dx(space.mesh)
    compile_form(form)
    (ready,) = cache.glob("*.c.cached")
    source = ready.with_suffix("")
    for path in (ready, *cache.glob("*.so")):
        path.unlink()
    # a claim that may still lead to a library is waited for
    monkeypatch.setattr(fenics, "ABANDONED", 0.5)
    source.touch()
    began = time.monotonic()
    assert fem.assemble_scalar(compile_form(form)) == pytest.approx(3.0)
    assert time.monotonic() - began > 0.3 and ready.exists()
    ready.unlink()
    os.utime(source, (0, 0))
    fenics.check_cache(space.mesh.comm)
    assert not source.exists()


def test_a_compiler_that_fails_here_is_left_to_fenicsx(
    space: fem.FunctionSpace, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LDSHARED", "false")
    form = 2 * ufl.dx(space.mesh)
    with pytest.raises(Exception, match=r"Error|failed"):
        compile_form(form)
    assert not list(cache.glob("*.c"))
    monkeypatch.delenv("LDSHARED")
    assert fem.assemble_scalar(compile_form(form)) == pytest.approx(2.0)


INTERRUPTED = """
import subprocess
import dolfinx_solver, ufl
from dolfinx.mesh import create_unit_square
from mpi4py import MPI
from fem_tfm.fenics import compile_form

wait = subprocess.Popen.wait

def interrupt(*args):
    subprocess.Popen.wait = wait
    raise KeyboardInterrupt

subprocess.Popen.wait = interrupt
try:
    compile_form(3 * ufl.dx(create_unit_square(MPI.COMM_SELF, 1, 1)))
except KeyboardInterrupt:
    print("interrupted")
"""


def test_an_interrupted_compilation_leaves_no_claim(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED],
        env=os.environ | {"XDG_CACHE_HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == "interrupted"
    assert not list(tmp_path.rglob("*.c"))

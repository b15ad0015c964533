# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compilation of UFL forms: the compiler's options, the cache, several forms side by side.

FFCx writes C code in Python and then runs the C compiler. Here the C compiler of one form runs
while FFCx writes the code of the next.
"""

from __future__ import annotations

import importlib.machinery
import os
import shlex
import subprocess
import sysconfig
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cffi
import ffcx
import ffcx.codegeneration.jit as ffcx_jit
import ffcx.compiler
import ffcx.naming
import numpy as np
import ufl
from cffi.recompiler import recompile
from dolfinx import default_scalar_type, fem, jit
from ufl.algorithms.analysis import extract_constants
from ufl.algorithms.map_integrands import map_integrands
from ufl.corealg.map_dag import map_expr_dag
from ufl.corealg.multifunction import MultiFunction

from fem_tfm.errors import InputError, SolverError

# measured on the dense section: -O1 compiles in 2/3 of the time of -O2 and runs as fast; Python's
# own flags bring -g, which takes 87 % of the C compiler's time unless -g0 follows; a second run
# that needs the same form waits for the first, which takes longer than FFCx's default of 10 s
JIT_OPTIONS: dict[str, Any] = {
    "cffi_extra_compile_args": ["-O1", "-g0", "-march=native"],
    "timeout": 300,
}


# a form whose code was written so long ago and that has no library has lost its compiler [s]
ABANDONED = 180.0


class _Replaced(MultiFunction):
    """Puts other constants into an expression and leaves derivatives unevaluated."""

    expr = MultiFunction.reuse_if_untouched

    def __init__(self, others: dict[ufl.Constant, ufl.Constant]) -> None:
        super().__init__()
        self._others = others

    def constant(self, o: ufl.Constant) -> ufl.Constant:
        return self._others[o]


def renumbered(forms: Sequence[Any]) -> list[Any]:
    """The same forms, or expressions, on constants whose numbers all have the same length.

    UFL orders the factors of a product by their texts, and the text of a constant holds its running
    number: "99" stands behind "100". The order, and with it the name under which the form is
    cached, would depend on how many constants were made before. Where the numbers differ in length,
    the k-th of n constants gets the number 10^m + k, 10^m > n, here. The order of the constants
    stays; the constants of the given forms and UFL's counter are not touched, and a value that is
    set later reaches both. What forms have in common, as a residual and its derivative have, is
    walked through once.
    """
    constants = sorted({c for f in forms for c in extract_constants(f)}, key=ufl.Constant.count)
    if len({len(str(constant.count())) for constant in constants}) <= 1:
        return list(forms)
    others, first = {}, 10 ** len(str(len(constants)))
    for number, constant in enumerate(constants, first):
        other = ufl.Constant(constant.ufl_domain(), constant.ufl_shape, count=number)
        other._cpp_object = constant._cpp_object  # DOLFINx finds the value here
        others[constant] = other
    replaced = _Replaced(others)
    seen: dict[Any, Any] = {}
    made: dict[Any, Any] = {}
    return [
        map_integrands(lambda e: map_expr_dag(replaced, e, vcache=seen, rcache=made), form)
        for form in forms
    ]


def compile_forms(forms: Sequence[Any]) -> list[fem.Form]:
    """Compile UFL forms side by side, or take them from the cache.

    Collective on the communicator of the forms' mesh: its rank 0 compiles, the others load. The
    code of forms of high rank is written first, since their C code takes longest.

    Returns the compiled forms in the order given.

    Raises
    ------
    SolverError
        another run has been compiling the same form for too long, or was killed while it did.
    """
    forms = renumbered(forms)
    if forms and forms[0].ufl_domain().ufl_cargo().comm.rank == 0:
        _fill_cache(sorted(forms, key=lambda form: -len(form.arguments())))
    try:
        return [fem.form(form, jit_options=JIT_OPTIONS) for form in forms]
    except TimeoutError as error:
        raise SolverError(f"a form could not be compiled: {error}") from error


def check_cache(comm: Any) -> None:
    """Refuse a place for compiled forms that cannot be written (collective).

    Raises InputError on all ranks.
    """
    failure: InputError | None = None
    if comm.rank == 0:
        place = Path(jit.get_options(JIT_OPTIONS)["cache_dir"])
        try:
            place.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=place):
                pass
            # of runs that were killed; those of expressions FFCx would wait for in vain
            for source in place.glob("*.c"):
                if not source.with_suffix(".c.cached").exists() and _age(source) > ABANDONED:
                    source.unlink(missing_ok=True)
        except OSError as error:
            words = f"a directory for compiled forms that can be written ({error.strerror})"
            failure = InputError("XDG_CACHE_HOME", str(place), words)
    if failure := comm.bcast(failure):
        raise failure


def compile_form(form: Any) -> fem.Form:
    """Compile a UFL form, or take it from the cache; see `compile_forms`."""
    return compile_forms([form])[0]


def compile_expression(expression: Any, points: np.ndarray) -> fem.Expression:
    """Compile a UFL expression at points of the reference cell, or take it from the cache."""
    (expression,) = renumbered([ufl.as_ufl(expression)])
    return fem.Expression(expression, points, jit_options=JIT_OPTIONS)


@dataclass(frozen=True)
class _Job:
    """A C compiler at work.

    source : C file in the cache; FFCx takes its presence as a claim, and source + ".cached" as the
        sign that the library is complete
    """

    source: Path
    compiler: subprocess.Popen[bytes]

    def finish(self) -> None:
        """Wait for the library and announce it; withdraw the claim if there is none."""
        if self.compiler.wait() == 0:
            self.source.with_suffix(".c.cached").touch()
        else:
            self.source.unlink(missing_ok=True)

    def cancel(self) -> None:
        """Stop the compiler and withdraw the claim, for which another run would wait in vain."""
        self.compiler.kill()
        self.compiler.wait()
        self.source.unlink(missing_ok=True)


def _fill_cache(forms: Sequence[Any]) -> None:
    """Compile what the cache lacks. What fails here is left to `fem.form`, which tells why.

    A form that another run has claimed is waited for. One whose run was killed is taken over.
    """
    jobs: list[_Job] = []
    claims = {_claim(form): form for form in forms}
    try:
        for claim, form in claims.items():
            _start(form, claim, jobs)
        _finish(jobs)
        for claim, form in claims.items():
            if _lost(claim[0]):
                claim[0].unlink(missing_ok=True)
                _start(form, claim, jobs)
        _finish(jobs)
    finally:
        for job in jobs:
            job.cancel()


def _finish(jobs: list[_Job]) -> None:
    while jobs:
        jobs[0].finish()
        jobs.pop(0)


def _lost(source: Path) -> bool:
    """Whether a claim in the cache leads to nothing; waits for one that still may."""
    ready = source.with_suffix(".c.cached")
    while source.exists() and not ready.exists():
        if _age(source) > ABANDONED:
            return True
        time.sleep(0.2)
    return False


def _age(source: Path) -> float:
    """Time since a file was written [s], 0 where there is none."""
    try:
        return time.time() - source.stat().st_mtime
    except FileNotFoundError:
        return 0.0


def _claim(form: Any) -> tuple[Path, str]:
    """C file of a form in the cache, and the name of its module."""
    options = ffcx.get_options({"scalar_type": default_scalar_type})
    settings = jit.get_options(JIT_OPTIONS)
    arguments = settings["cffi_extra_compile_args"]
    tag = ffcx_jit._compute_option_signature(options)
    tag += ffcx_jit._compilation_signature(arguments, settings["cffi_debug"])
    module = "libffcx_forms_" + ffcx.naming.compute_signature([form], tag)
    source = settings["cache_dir"] / f"{module}.c"
    return source, module


def _start(form: Any, claim: tuple[Path, str], jobs: list[_Job]) -> None:
    """Write the C code of a form and start its compiler, unless the cache has or awaits it."""
    source, module = claim
    source.parent.mkdir(parents=True, exist_ok=True)
    try:
        source.touch(exist_ok=False)
    except FileExistsError:
        return
    options = ffcx.get_options({"scalar_type": default_scalar_type})
    arguments = jit.get_options(JIT_OPTIONS)["cffi_extra_compile_args"]
    try:
        code, _ = ffcx.compiler.compile_ufl_objects([form], namespace=module, options=options)
        _write(source, module, ffcx.naming.form_name(form, 0, module), code[1])
        jobs.append(_Job(source, _compiler(source, arguments)))
    except Exception:
        source.unlink(missing_ok=True)
    except BaseException:
        source.unlink(missing_ok=True)
        raise


def _write(source: Path, module: str, name: str, code: str) -> None:
    """Write the C source of the Python module that holds one compiled form."""
    builder = cffi.FFI()
    scalar = np.dtype(default_scalar_type).name
    builder.cdef(
        ffcx_jit.UFC_HEADER_DECL.format(scalar)
        + ffcx_jit.UFC_INTEGRAL_DECL
        + ffcx_jit.UFC_FORM_DECL
        + f"extern ufcx_form {name};\n"
    )
    how = {"call_c_compiler": False, "uses_ffiplatform": False, "compiler_verbose": 0}
    recompile(builder, module, code, c_file=str(source), **how)


def _compiler(source: Path, arguments: Sequence[str]) -> subprocess.Popen[bytes]:
    """Start the compiler of Python's own extensions on a source of the cache."""
    link, flags, shared = (
        shlex.split(os.environ.get(name) or sysconfig.get_config_var(name) or "")
        for name in ("LDSHARED", "CFLAGS", "CCSHARED")
    )
    folders = (sysconfig.get_path("include"), ffcx.codegeneration.get_include_path())
    library = source.with_name(source.stem + importlib.machinery.EXTENSION_SUFFIXES[0])
    command = [*link, *flags, *shared, "-std=c17", *(f"-I{folder}" for folder in folders)]
    command += [*arguments, str(source), "-o", str(library), "-lm"]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

# SPDX-License-Identifier: LGPL-3.0-or-later
"""The command `fem-tfm`: one function per verb, one place where errors become exit statuses.

0 done; 2 bad input (nothing written); 3 the solver gave up; 130 interrupted. Only rank 0 talks, and
every rank ends with the same status. The verbs import what they need, so that --help is quick.
"""

from __future__ import annotations

import argparse
import inspect
import itertools
import shutil
import sys
import textwrap
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import MISSING
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import tomli_w
from mpi4py import MPI

import fem_tfm
from fem_tfm import signals
from fem_tfm.errors import FemTfmError, InputError, SolverError, nearest

if TYPE_CHECKING:
    from fem_tfm.case import Case

DONE, CRASHED, BAD_INPUT, NOT_SOLVED, INTERRUPTED = 0, 1, 2, 3, 130

DESCRIPTION = """\
Solve gas-solid flow in pipes by the two-fluid model on finite elements.

A case is a TOML file in SI units; start from demos/dense_pipe/case3.toml:

    fem-tfm check demos/dense_pipe/case3.toml
    fem-tfm run   demos/dense_pipe/case3.toml
    fem-tfm run   demos/dense_pipe/case3.toml --set solids.diameter=2e-4 --out results/coarse
"""

EPILOG = """\
Every verb has its own help (fem-tfm run --help) and works under mpirun -n N.
Exit status: 0 done, 2 bad input (nothing written), 3 the solver gave up, 130 interrupted.
"""


class _Parser(argparse.ArgumentParser):
    """An argument parser that leaves exit statuses and ranks to `main`."""

    def error(self, message: str) -> NoReturn:
        raise _UsageError(f"{message}; see {self.prog} --help")

    def _print_message(self, message: str, file: Any = None) -> None:
        if MPI.COMM_WORLD.rank == 0:
            super()._print_message(message, file)


class _UsageError(FemTfmError):
    """The command line itself could not be read."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit status."""
    comm = MPI.COMM_WORLD
    signals.install()
    try:
        options = _parser().parse_args(arguments)
        return options.verb(options) or DONE
    except SystemExit as stop:
        # argparse ends --help and --version this way
        return int(stop.code or 0)
    except (InputError, _UsageError) as error:
        return _fail(error, BAD_INPUT)
    except SolverError as error:
        return _fail(error, NOT_SOLVED)
    except KeyboardInterrupt:
        _fail("interrupted", INTERRUPTED)
        return _leave(comm, INTERRUPTED)
    except BrokenPipeError:
        # the reader of our output has seen enough, as in `fem-tfm models | head`
        sys.stdout = None
        return DONE
    except Exception:
        traceback.print_exc()
        return _leave(comm, CRASHED)


def _fail(error: object, status: int) -> int:
    """Say on rank 0 what went wrong, in one sentence."""
    if MPI.COMM_WORLD.rank == 0:
        print(f"fem-tfm: {error}", file=sys.stderr, flush=True)
    return status


def _leave(comm: MPI.Comm, status: int) -> int:
    """End all ranks: one that failed alone would leave the others waiting for ever."""
    if comm.size > 1:
        sys.stdout.flush()
        comm.Abort(status)
    return status


def _say(*texts: object) -> None:
    """Print on rank 0, each text on a line of its own; None says nothing."""
    said = [text for text in texts if text is not None]
    if said and MPI.COMM_WORLD.rank == 0:
        print(*said, sep="\n", flush=True)


def run(options: argparse.Namespace) -> None:
    """Solve a case, write the results and print them."""
    case, out = _load(options), options.out or _results(options.case)
    result = case.scene.run(
        out, overwrite=options.overwrite, resume=options.resume, quiet=options.quiet
    )
    if not options.quiet and MPI.COMM_WORLD.rank == 0:
        from fem_tfm.output.summary import print_summary

        print_summary(result)


def check(options: argparse.Namespace) -> None:
    """Tell what would be solved, what follows from the case, and what it would take."""
    scene = _load(options).scene
    scene.examine()
    _say(*_listing(scene.describe()))


def mesh(options: argparse.Namespace) -> None:
    """Write the mesh of a case for other programs."""
    case = _load(options)
    if Path(options.out).exists() and not options.overwrite:
        raise InputError("--out", options.out, "a new file, or --overwrite")

    from fem_tfm.geometry.files import write_mesh

    write_mesh(case.scene.mesh_model(), options.out, MPI.COMM_WORLD)
    _say(f"mesh written to {options.out}")


def report(options: argparse.Namespace) -> None:
    """Write report.html, one page with the answer, the pictures and the case of a run.

    It works on a run that is still at work, and on one that failed.
    """
    from fem_tfm.output.report import FILE, write_report

    failure: InputError | None = None
    if MPI.COMM_WORLD.rank == 0:
        try:
            write_report(options.directory)
        except InputError as error:
            failure = error
    if failure := MPI.COMM_WORLD.bcast(failure):
        raise failure
    _say(f"report written to {Path(options.directory) / FILE}")


def sweep(options: argparse.Namespace) -> int:
    """Solve a case for every combination of the varied values; one table and one plot.

    A point that fails has its reason in the table, the others go on, and the status is 3. Every
    point is written as it ends; --resume solves those that an earlier sweep has not.
    """
    from fem_tfm.case.edit import each_once, parse_override
    from fem_tfm.scenes.recorder import results_directory
    from fem_tfm.study import sweep as study

    case, vary = _load(options), each_once("--vary", map(parse_variation, options.vary))
    for key, _ in map(parse_override, options.set):
        if key in vary:
            raise InputError("--set", key, "a key that --vary does not give")
    place = options.out or f"{_results(options.case)}-sweep"
    out = results_directory(place, options.overwrite, options.resume)
    assert out is not None
    found = study.run(case, vary, out, options.jobs, options.resume, options.keep)
    _say(found)
    return NOT_SOLVED if found.failed else DONE


def bench(options: argparse.Namespace) -> None:
    """Run the benchmarks: run time against error."""
    from fem_tfm import bench as benchmarks

    _say(benchmarks.run(options.name, options.out, options.scenes))


def models(options: argparse.Namespace) -> None:
    """List the closures: name, formula, source, validity and parameters."""
    from fem_tfm.closures import catalogue

    for family, laws in itertools.groupby(catalogue(options.family), itemgetter("family")):
        _say(f"[{family}]\n")
        for law in laws:
            _say(*_law(law, with_formula=options.family is not None))


def keys(options: argparse.Namespace) -> None:
    """List the keys of a case file: unit, default, meaning and the scenes that read them."""
    from fem_tfm.scenes.kinds import in_order, known_keys, known_tables
    from fem_tfm.scenes.reading import CHOOSING

    asked, known = options.table, [*CHOOSING, *known_keys()]
    chosen = [name for name in known if asked is None or f"{name}.".startswith(f"{asked}.")]
    if not chosen:
        tables = [*known_tables(), *(name for name in known if "." not in name)]
        words = f"a key, or one of {', '.join(in_order(tables))}"
        raise InputError("TABLE", asked, words, nearest(asked, [*tables, *known]))
    for name in in_order(chosen):
        _say(*_key(name))


def parse_variation(text: str) -> tuple[str, list[Any]]:
    """Split "key=a,b,c" as given to --vary; the values are read as those of --set."""
    from fem_tfm.case.edit import parse_value

    key, _, listed = text.partition("=")
    values = parse_value(f"[{listed}]")
    if not isinstance(values, list):
        values = [parse_value(part.strip()) for part in listed.split(",")]
    if not key.strip() or not values or "" in values:
        allowed = "key=a,b,c, such as operation.gas_superficial_velocity=5,6,7"
        raise InputError("--vary", text, allowed)
    return key.strip(), values


def _load(options: argparse.Namespace) -> Case:
    """The case of a verb; PETSc is loaded here, after the signals are installed."""
    from fem_tfm.case import Case

    return Case.load(options.case, options.set)


def _results(case: str) -> Path:
    """Where the results of a case file go by default."""
    return Path("results") / Path(case).stem


def _listing(rows: Mapping[str, Any], indent: str = "") -> Iterator[str]:
    """Names beside values, lists and tables below their name."""
    for name, value in rows.items():
        label = f"{indent}{name.replace('_', ' ')}"
        if isinstance(value, Mapping):
            yield label
            yield from _listing(value, indent + "  ")
        elif isinstance(value, list | tuple):
            yield label if value else f"{label:<24} none"
            yield from (_wrapped(str(item), f"{indent}  - ") for item in value)
        else:
            text = f"{value:.4g}" if isinstance(value, float) else str(value)
            yield _wrapped(text, f"{label:<24} ")


def _law(entry: Mapping[str, Any], with_formula: bool) -> Iterator[str]:
    """One closure of the catalogue, with its formula where a single family is asked for."""
    yield f"{entry['name']}: {entry['title']}"
    if with_formula:
        yield textwrap.indent(entry["formula"], "    ")
    yield _wrapped(entry["source"], "    source: ")
    yield _wrapped(entry["validity"], "    valid: ")
    for p in entry["parameters"]:
        yield _wrapped(f"{p['doc']}; {p['range']}", f"    {p['name']} = {_toml(p['default'])}: ")
    yield ""


def _key(name: str) -> Iterator[str]:
    """One key of a case file."""
    from fem_tfm.scenes.kinds import known_keys, readers, readers_in_words
    from fem_tfm.scenes.reading import CHOOSING, choices

    if name in CHOOSING:
        default, doc = CHOOSING[name]
        yield f"{name} = {_toml(default)}"
        yield _wrapped(f"{doc}; one of {', '.join(choices(name))}", "    ")
        yield "    read by every scene\n"
        return
    key = known_keys()[name]
    given = " or ".join(_toml(value) for value in key.defaults if value not in (None, MISSING))
    unit = f" [{key.unit}]" if key.unit else ""
    must = ", must be given" if key.default is MISSING else ""
    yield f"{name}{unit}{must}" + (f" = {given}" if given else "")
    yield _wrapped(f"{key.doc}; {key.allowed}", "    ")
    yield _wrapped(readers_in_words(readers(name)), "    read by ")
    yield ""


def _toml(value: Any) -> str:
    """A value as it stands in a case file."""
    return tomli_w.dumps({"value": value}).partition("=")[2].strip()


def _wrapped(text: str, label: str) -> str:
    """A text after its label, broken to the width of the terminal under the text's begin."""
    width = max(40, shutil.get_terminal_size().columns)
    hanging = " " * min(len(label), 8)
    # a command is not broken at its hyphens
    return textwrap.fill(
        text, width, initial_indent=label, subsequent_indent=hanging, break_on_hyphens=False
    )


def _parser() -> argparse.ArgumentParser:
    raw = argparse.RawDescriptionHelpFormatter
    parser = _Parser("fem-tfm", description=DESCRIPTION, epilog=EPILOG, formatter_class=raw)
    parser.add_argument("--version", action="version", version=f"fem-tfm {fem_tfm.__version__}")
    verbs = parser.add_subparsers(metavar="VERB", required=True, parser_class=_Parser)

    solve = _verb(verbs, run)
    _case_options(solve)
    solve.add_argument("--out", metavar="DIR", help="results directory [results/CASE]")
    solve.add_argument("--overwrite", action="store_true", help="replace results that are there")
    solve.add_argument("--resume", action="store_true", help="go on where a run was stopped")
    solve.add_argument("--quiet", action="store_true", help="print nothing but warnings and errors")

    _case_options(_verb(verbs, check))

    grid = _verb(verbs, mesh)
    _case_options(grid)
    grid.add_argument("--out", metavar="FILE", required=True, help="a .msh, .xdmf or .vtu file")
    grid.add_argument("--overwrite", action="store_true", help="replace the file if it is there")

    told = _verb(verbs, report)
    told.add_argument("directory", metavar="DIR", help="the results directory of a run")

    laws = _verb(verbs, models)
    laws.add_argument("family", metavar="FAMILY", nargs="?", help="drag, friction, ... [all]")

    listed = _verb(verbs, keys)
    listed.add_argument("table", metavar="TABLE", nargs="?", help="a table or one key [all]")

    study = _verb(verbs, sweep)
    _case_options(study)
    study.add_argument(
        "--vary",
        metavar="KEY=A,B,C",
        action="append",
        required=True,
        help="values of one key; with several --vary every combination is solved",
    )
    study.add_argument("--jobs", metavar="N", type=_positive, default=1, help="runs at once [1]")
    study.add_argument("--out", metavar="DIR", help="results directory [results/CASE-sweep]")
    study.add_argument("--overwrite", action="store_true", help="replace results that are there")
    study.add_argument("--resume", action="store_true", help="solve the points that are missing")
    study.add_argument("--keep", action="store_true", help="keep a results directory a point")

    timing = _verb(verbs, bench)
    timing.add_argument("name", metavar="NAME", nargs="?", help="one benchmark [all]")
    timing.add_argument(
        "--out", metavar="DIR", default="results/bench", help="where pictures go [%(default)s]"
    )
    timing.add_argument(
        "--scenes", metavar="N[-M]", help="numbers of the random unsteady scenes [1-200]"
    )
    return parser


def _verb(verbs: Any, action: Callable[[argparse.Namespace], Any]) -> argparse.ArgumentParser:
    """Add a verb named after its function and described by its docstring."""
    text = inspect.cleandoc(action.__doc__ or action.__name__)
    parser = verbs.add_parser(action.__name__, help=text.partition("\n")[0], description=text)
    parser.set_defaults(verb=action)
    return parser


def _case_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("case", metavar="CASE.toml", help="the case file")
    parser.add_argument(
        "--set",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="change one key of the case, such as solids.diameter=2e-4; may be repeated",
    )


def _positive(text: str) -> int:
    """Read a whole number of at least 1."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"expected a whole number of at least 1, not {text!r}")
    return int(text)

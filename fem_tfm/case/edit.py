# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nested tables of a case: read from a file, changed by dotted keys."""

from __future__ import annotations

import codecs
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from fem_tfm.errors import InputError, nearest
from fem_tfm.operation import FEEDS
from fem_tfm.scenes.kinds import known_keys, known_tables
from fem_tfm.scenes.reading import AUTO, CHOOSING, SOLUTION, one_of, unknown_key

# ways to give one thing, each a key with its companions: a changed key replaces the other ways
INSTEAD: dict[str, dict[str, tuple[str, ...]]] = {
    "operation": {**dict.fromkeys(FEEDS, ()), "solids_fraction": ("solids_velocity",)},
    "geometry": {"diameter": (), "width": ("height",)},
    "gas": {"density": (), "species": ("pressure",), "gas_constant": ("pressure",)},
}


# tables of the flow itself: what is published of it belongs to their values alone
OF_THE_FLOW = ("geometry", "gas", "solids", "operation", "inlet", "initial", "heat")


def drop_references(values: dict[str, Any], changes: Mapping[str, Any]) -> None:
    """Take back the published values where a change makes the flow another one."""
    if "reference" in changes or "reference" not in values:
        return
    for key, value in changes.items():
        table, *names = key.split(".")
        held: Any = values.get(table)
        for name in names:
            held = held.get(name) if isinstance(held, Mapping) else None
        if table in OF_THE_FLOW and held != value:
            del values["reference"]
            return


def drop_ranges(values: dict[str, Any], changes: Mapping[str, Any]) -> None:
    """Take back the ranges of changed numbers, which are known then, and all in another solution.

    The place of a law holds its numbers: another law drops the ranges of all of them.
    """
    ranges = values.get("uncertain")
    if "uncertain" in changes or not isinstance(ranges, list | tuple):
        return
    kept = []
    for one in ranges:
        key = one.get("key") if isinstance(one, Mapping) else None
        changed = any(key == name or str(key).startswith(f"{name}.") for name in changes)
        if not changed:
            kept.append(one)
    values["uncertain"] = kept
    if not kept or changes.get("solution", SOLUTION) not in (SOLUTION, AUTO):
        del values["uncertain"]


def parse_override(text: str) -> tuple[str, Any]:
    """Split "key=value"; the value is read as TOML, or else taken as a string."""
    key, equals, value = text.partition("=")
    if not (equals and key.strip() and value.strip()):
        raise InputError("--set", text, "key=value, such as solids.diameter=1e-4")
    return key.strip(), parse_value(value.strip())


def each_once(option: str, pairs: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    """Keys and values of a repeated option; raises InputError for a key that is given twice."""
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise InputError(option, key, "each key once")
        found[key] = value
    return found


def parse_value(text: str) -> Any:
    """Read one TOML value; numbers may also be written as .5 or 5., all else is a text."""
    try:
        values = tomllib.loads(f"value = {text}")
    except tomllib.TOMLDecodeError:
        return float(text) if re.fullmatch(r"[+-]?(\d+\.|\.\d+)(e[+-]?\d+)?", text, re.I) else text
    return values["value"] if len(values) == 1 else text


def read(path: Path) -> dict[str, Any]:
    """Read a TOML file; a byte-order mark is allowed.

    Raises InputError for what is no file, cannot be read, or holds no case.
    """
    # a pipe would let the reader wait for ever
    if path.exists() and not path.is_file():
        kind = "a directory" if path.is_dir() else "a pipe or a device"
        raise InputError("case file", str(path), f"a regular file, and this is {kind}")
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (FileNotFoundError, NotADirectoryError):
        beside = [p.name for p in path.parent.glob("*.toml")]
        allowed = "the name of an existing case file"
        raise InputError("case file", str(path), allowed, nearest(path.name, beside)) from None
    except OSError as error:
        allowed = f"a readable file ({error.strerror})"
        raise InputError("case file", str(path), allowed) from None
    except UnicodeDecodeError:
        words = f"text in UTF-8, and this is {_encoding(path)}; save it again as UTF-8"
        raise InputError("case file", str(path), words) from None
    except ValueError as error:
        raise InputError("case file", str(path), f"valid TOML in UTF-8 ({error})") from None
    if not values:
        words = "a case with at least the tables [geometry], [gas] and [operation]; it is empty"
        raise InputError("case file", str(path), words)
    return values


def _encoding(path: Path) -> str:
    """What the bytes of a file that is no UTF-8 look like, in words."""
    begin = path.read_bytes()[:2]
    return "UTF-16" if begin in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE) else "not (Latin-1?)"


def _listed(values: Any, steps: Sequence[str]) -> Sequence[Any] | None:
    """The array of tables that stands at a path, None where something else does."""
    for step in steps:
        values = values.get(step) if isinstance(values, Mapping) else None
    is_list = isinstance(values, list | tuple) and any(isinstance(t, Mapping) for t in values)
    return values if is_list else None


def _change_one(values: dict[str, Any], key: str, value: Any) -> bool:
    """Set a key of one table of an array of tables, as in particles.materials.ash.diameter."""
    *path, part, name = key.split(".")
    if (listed := _listed(values, [*path, part])) is not None:
        names = [str(t.get("name", n)) for n, t in enumerate(listed)]
        where = ".".join([*path, part])
        allowed = f"{where}.NAME.{name} with a NAME of {', '.join(names)}"
        raise InputError(key, value, allowed, f"{where}.{names[0]}.{name}")
    if not path or (listed := _listed(values, path)) is None:
        return False
    number = one_of(listed, part, ".".join(path))
    changed = {k: v for k, v in listed[number].items() if k != name}
    if value is not None:
        changed[name] = value
    for step in path[:-1]:
        values[step] = dict(values[step])
        values = values[step]
    values[path[-1]] = [changed if n == number else t for n, t in enumerate(listed)]
    return True


def change(values: dict[str, Any], key: str, value: Any) -> None:
    """Set a dotted key in nested tables; a closure keeps its name when a parameter is set."""
    *tables, name = key.split(".")
    if tables and _change_one(values, key, value):
        return
    law, laws = ".".join(tables), law_defaults()
    if key not in (*known_keys(), *known_tables(), *CHOOSING) and law not in laws:
        raise unknown_key(key, value)
    if law in laws and name == "model":
        # another law has other parameters, so those given are dropped
        *tables, name = tables
        value = {"model": value}
    table = values
    for depth, part in enumerate(tables, start=1):
        table[part] = _as_table(table.get(part), ".".join(tables[:depth]))
        table = table[part]
    table[name] = value


def give_way(values: dict[str, Any], changes: Mapping[str, Any]) -> None:
    """Take back the keys of a table that a changed one replaces, unless they are changed too.

    Companions go with the way that they belong to: a velocity of the grains beside their fraction,
    not one that stands on its own.
    """
    for table, ways in INSTEAD.items():
        held = values.get(table)
        changed = {name for name in ways if f"{table}.{name}" in changes}
        if not changed or not isinstance(held, Mapping):
            continue
        replaced = [name for name in ways if name in held and name not in changed]
        gone = {*replaced, *(companion for name in replaced for companion in ways[name])}
        kept = {companion for name in changed for companion in ways[name]}
        values[table] = {k: v for k, v in held.items() if k not in gone - kept}


def _as_table(value: Any, key: str) -> dict[str, Any]:
    """Return what stands at `key` as a table of its own: a law's name becomes its model."""
    laws = law_defaults()
    if value is None or isinstance(value, str):
        model = value or laws.get(key)
        return {"model": model} if key in laws else {}
    if not isinstance(value, Mapping):
        raise InputError(key, value, "a table")
    return dict(value)


def law_defaults() -> dict[str, str]:
    """Keys that hold a law, and the name of the law that stands there by default."""
    return {name: key.default for name, key in known_keys().items() if key.is_law}

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scenes from nested tables and back: every key of a case file is a field of an object.

The classes declare their keys; here they are collected for each kind of scene, tables become
objects, and objects become tables with every default.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, Field, dataclass, fields
from typing import Any, get_args, get_origin

from fem_tfm.closures.base import Closure
from fem_tfm.errors import InputError, nearest
from fem_tfm.parameters import Parameters, allowed, checked, in_words, key_of, kind_of
from fem_tfm.scenes.kinds import KINDS, Kind

FLOW, SOLUTION = "dense", "developed"
# keys that choose classes: they belong to no field
CHOOSING = ("flow", "solution", "geometry.shape")


@dataclass(frozen=True)
class Key:
    """A key of a case file: the class and field that hold it."""

    name: str
    cls: type[Parameters]
    field: Field[Any]

    @property
    def unit(self) -> str:
        """Its unit, empty for a number without one."""
        return str(self.field.metadata.get("unit", "")).strip("-")

    @property
    def meaning(self) -> str:
        """What it may hold, in words."""
        return allowed(self.cls, self.field)

    @property
    def default(self) -> Any:
        """Its default; MISSING where it must be given."""
        if self.field.default_factory is not MISSING:
            return self.field.default_factory()
        return self.field.default

    @property
    def is_law(self) -> bool:
        """Whether it holds a law."""
        kind = kind_of(self.cls, self.field)
        return isinstance(kind, type) and issubclass(kind, Closure)


# -- keys ------------------------------------------------------------------------------------------


def _parts(kind: Any) -> list[type[Parameters]]:
    """Classes of objects that a field may hold; laws are values, not parts."""
    found = [kind, *get_args(kind)] if get_origin(kind) is not tuple else []
    return [
        c
        for c in found
        if isinstance(c, type) and issubclass(c, Parameters) and not issubclass(c, Closure)
    ]


def _classes(cls: type[Parameters], f: Field[Any], kind: Kind) -> list[type[Parameters]]:
    """Classes of objects that a field of a kind of scene may hold."""
    if cls is kind.scene and f.name == "model":
        return [kind.model]
    if cls is kind.scene and f.name == "geometry":
        return list(kind.shapes)
    return _parts(kind_of(cls, f))


def _walk(cls: type[Parameters], kind: Kind) -> Iterator[Key]:
    for f in fields(cls):  # type: ignore[arg-type]
        parts = _classes(cls, f, kind)
        for part in parts:
            yield from _walk(part, kind)
        if not parts:
            yield Key(key_of(cls, f), cls, f)


@functools.cache
def keys(kind: Kind) -> dict[str, Key]:
    """Keys that a kind of scene reads."""
    return {key.name: key for key in _walk(kind.scene, kind) if key.name not in kind.unread}


def known_keys() -> dict[str, Key]:
    """Every key that some kind of scene reads."""
    return {name: key for kind in reversed(KINDS) for name, key in keys(kind).items()}


def readers(key: str) -> list[Kind]:
    """Kinds of scenes that read a key."""
    return [kind for kind in KINDS if key in keys(kind)]


def tables_known() -> list[str]:
    """Names of the tables and of the keys outside of them, in the order of a case file."""
    found = dict.fromkeys(["title", "flow", "solution", "inferred"])
    return list(found | dict.fromkeys(name.partition(".")[0] for name in known_keys()))


def unread_words(key: str, kind: Kind) -> str:
    """What is allowed where a key is not read: the scenes that read it."""
    others = [str(one) for one in readers(key) if one is not kind]
    reads = "read" if len(others) > 1 else "reads"
    told = f"; {' or '.join(others)} {reads} it" if others else ""
    return f"no such key for {kind}{told}"


# -- from tables -----------------------------------------------------------------------------------


def kind_for(values: Mapping[str, Any]) -> Kind:
    """The kind of scene that tables choose by flow and solution; raises InputError."""
    flow, solution = values.get("flow", FLOW), values.get("solution", SOLUTION)
    solution = SOLUTION if solution == "auto" else solution
    flows = list(dict.fromkeys(kind.flow for kind in KINDS))
    if flow not in flows:
        words = in_words(str, doc="kind of flow").replace("a text", "one of " + ", ".join(flows))
        raise InputError("flow", flow, words, nearest(flow, flows))
    solutions = list(dict.fromkeys(kind.scene.solution for kind in KINDS))
    if solution not in solutions:
        words = "one of auto, " + ", ".join(solutions) + " (how the axis is treated)"
        raise InputError("solution", solution, words, nearest(solution, solutions))
    for kind in KINDS:
        if (kind.flow, kind.scene.solution) == (flow, solution):
            return kind
    fitting = [repr(kind.flow) for kind in KINDS if kind.scene.solution == solution]
    raise InputError("solution", solution, f"flow {' or '.join(fitting)} beside it")


def scene_from(values: Mapping[str, Any]) -> Any:
    """The scene that nested tables describe.

    Raises
    ------
    InputError
        a key is unknown or not read by this scene, or a value does not fit.
    """
    given = dict(_flat(values))
    unknown = [name for name in given if not _is_known(name)]
    if unknown:
        raise unknown_key(unknown[0], given[unknown[0]])
    kind = kind_for(values)
    read = keys(kind)
    tables = {name.rpartition(".")[0] for name in read}
    for name, value in given.items():
        if name in CHOOSING or name in tables or name in read or name.startswith("geometry."):
            continue
        raise InputError(name, value, unread_words(name, kind))
    return _build(kind.scene, values, kind)


def _is_known(name: str) -> bool:
    known = known_keys()
    tables = {key.rpartition(".")[0] for key in known}
    return name in CHOOSING or name in known or name in tables


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted keys and their values; the table of a law is its value."""
    tables = {name.rpartition(".")[0] for name in known_keys()}
    for name, value in values.items():
        key = f"{prefix}{name}"
        if isinstance(value, Mapping) and (key in tables or not _is_known(key)):
            if not value and key not in tables:
                yield key, value
            yield from _flat(value, f"{key}.")
        elif key in tables and value is not None and key not in known_keys():
            raise InputError(key, value, "a table" + _table_words(key))
        elif value is not None:
            yield key, value


def _table_words(table: str) -> str:
    """Meaning of a table, in brackets."""
    for kind in KINDS:
        for f in fields(kind.scene):
            parts = _classes(kind.scene, f, kind)
            if any(part.table == table for part in parts):
                return f" ({f.metadata['doc']})"
            for part in parts:
                for inner in fields(part):  # type: ignore[arg-type]
                    if key_of(part, inner) == table and inner.metadata.get("doc"):
                        return f" ({inner.metadata['doc']})"
    return ""


def _build(cls: Any, values: Mapping[str, Any], kind: Kind) -> Any:
    """An object of a class from tables."""
    made: dict[str, Any] = {}
    for f in fields(cls):
        parts = _classes(cls, f, kind)
        if parts:
            table = f.metadata.get("key") or parts[0].table
            table = parts[0].table or table
            absent = values.get(table.partition(".")[0]) is None
            if absent and f.default is None:
                continue
            if absent and f.default is MISSING and f.default_factory is MISSING and parts[0].table:
                raise InputError(table, None, "a table" + _table_words(table))
            made[f.name] = _part(parts[0], values, kind)
            continue
        key = key_of(cls, f)
        value = _value(values, key)
        if value is not None:
            made[f.name] = _listed(cls, f, key, value)
        elif f.default is MISSING and f.default_factory is MISSING:
            raise InputError(key, None, allowed(cls, f))
    return cls(**made)


def _part(cls: Any, values: Mapping[str, Any], kind: Kind) -> Any:
    """An object that a scene or another object holds."""
    if hasattr(cls, "from_table"):
        return cls.from_table(values.get(cls.table) or {})
    return _build(cls, values, kind)


def _value(values: Mapping[str, Any], key: str) -> Any:
    found: Any = values
    for part in key.split("."):
        found = found.get(part) if isinstance(found, Mapping) else None
    return found


def _listed(cls: type[Parameters], f: Field[Any], key: str, value: Any) -> Any:
    """A value; a list of tables becomes a tuple of objects."""
    inner = get_args(kind_of(cls, f))
    if not (inner and isinstance(inner[0], type) and issubclass(inner[0], Parameters)):
        return value
    if not isinstance(value, list | tuple) or not all(isinstance(v, Mapping) for v in value):
        raise InputError(key, value, f"a list of tables ({f.metadata['doc']})")
    one = inner[0]
    made = []
    for number, table in enumerate(value):
        known = [entry.name for entry in fields(one)]  # type: ignore[arg-type]
        for name in table:
            if name not in known:
                words = f"one of the keys {', '.join(known)}"
                raise InputError(
                    f"{key}[{number}].{name}", table[name], words, nearest(name, known)
                )
        for entry in fields(one):  # type: ignore[arg-type]
            if entry.name not in table:
                raise InputError(f"{key}[{number}].{entry.name}", None, allowed(one, entry))
            checked(one, entry, table[entry.name])
        made.append(one(**table))
    return tuple(made)


def unknown_key(key: str, value: Any) -> InputError:
    """Name the keys of the table, and the nearest of them or where else a key of that name is."""
    table, _, name = key.rpartition(".")
    known = [*CHOOSING, *known_keys()]
    beside = [k for k in known if k.rpartition(".")[0] == table] if table else tables_known()
    namesakes = [k for k in known if k.endswith(f".{name}")]
    near = nearest(key, namesakes) or (namesakes or [None])[0]
    if near is None:
        leaves = {k.rpartition(".")[2]: k for k in beside}
        near = leaves.get(nearest(name, leaves) or "") or nearest(key, [*known, *tables_known()])
    listed = ", ".join(k.rpartition(".")[2] for k in beside) or ", ".join(tables_known())
    return InputError(key, value, f"one of the keys {listed}", near)


# -- to tables -------------------------------------------------------------------------------------


def tables_of(scene: Any) -> dict[str, Any]:
    """Nested tables with every default, from which `scene_from` makes the same scene."""
    kind = scene.kind
    found: dict[str, Any] = {"title": "", "flow": kind.flow, "solution": scene.solution}
    _put(scene, found, kind)
    return found


def _put(part: Parameters, found: dict[str, Any], kind: Kind) -> None:
    table_of = getattr(part, "to_table", None)
    if table_of is not None:
        inner = {k: v for k, v in table_of().items() if f"{part.table}.{k}" not in kind.unread}
        found[part.table] = _plain(inner)
        return
    for f in fields(part):  # type: ignore[arg-type]
        value, key = getattr(part, f.name), key_of(type(part), f)
        if isinstance(value, Parameters) and not isinstance(value, Closure):
            _put(value, found, kind)
        elif value is not None and key not in kind.unread and not _parts(kind_of(type(part), f)):
            *outer, name = key.split(".")
            table = found
            for one in outer:
                table = table.setdefault(one, {})
            table[name] = _plain(value)


def _plain(value: Any) -> Any:
    """A value as TOML holds it; a law as a table."""
    if isinstance(value, Closure):
        return {"model": value.name} | {f.name: getattr(value, f.name) for f in fields(value)}
    if isinstance(value, Parameters):
        return {f.name: getattr(value, f.name) for f in fields(value)}  # type: ignore[arg-type]
    if isinstance(value, Mapping):
        return {k: _plain(v) for k, v in value.items() if v is not None}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return value

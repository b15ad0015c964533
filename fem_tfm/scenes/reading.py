# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scenes from nested tables and back: tables become objects, objects become tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, fields
from typing import Any, get_args, get_origin

from fem_tfm.closures.base import Closure
from fem_tfm.errors import InputError, nearest
from fem_tfm.geometry.shapes import SHAPES, Pipe
from fem_tfm.parameters import Parameters, allowed, key_of, kind_of
from fem_tfm.scenes.kinds import (
    KINDS,
    Kind,
    check_shape,
    in_order,
    keys,
    known_keys,
    known_tables,
    parts_of,
    reads,
    unread_words,
)

# keys that choose classes and belong to no field, with their defaults and meanings
FLOW, SOLUTION, AUTO = "dense", "developed", "auto"
CHOOSING = {
    "flow": (FLOW, "kind of flow"),
    "solution": (AUTO, "how the axis is treated; auto is developed"),
    "geometry.shape": (Pipe.shape, "shape of the line"),
}
# what users call a key, where it looks more like another one
OTHER_NAMES = {
    "gas_velocity": "gas_superficial_velocity",
    "gas_mass_flow": "gas_superficial_velocity",
    "velocity": "gas_superficial_velocity",
    "radius": "diameter",
    "particle_diameter": "diameter",
    "loading": "solids_mass_flow",
}


# -- from tables -----------------------------------------------------------------------------------


def scene_from(values: Mapping[str, Any]) -> Any:
    """The scene that nested tables describe.

    Raises
    ------
    InputError
        a key is unknown or not read by this scene, or a value does not fit.
    """
    given = dict(_flat(values))
    for name, value in given.items():
        if name in known_tables():
            if not isinstance(value, Mapping):
                raise InputError(name, value, _a_table(name))
        elif name not in known_keys() and name not in CHOOSING:
            raise unknown_key(name, value)
    kind = kind_for(values)
    if (shape := given.get("geometry.shape")) in list(SHAPES):
        check_shape(str(shape), kind)
    for name, value in given.items():
        if name not in CHOOSING and not reads(kind, name):
            raise InputError(name, value, unread_words(name, kind))
    return _build(kind.scene, values, kind)


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted keys and their values; an empty table, an unknown one and that of a law are values."""
    for name, value in values.items():
        key = f"{prefix}{name}"
        if isinstance(value, Mapping) and value and key in known_tables():
            yield from _flat(value, f"{key}.")
        elif value is not None:
            yield key, value


def kind_for(values: Mapping[str, Any]) -> Kind:
    """The kind of scene that tables choose by flow and solution; raises InputError."""
    flow, solution = values.get("flow", FLOW), values.get("solution", AUTO)
    flows = choices("flow")
    if flow not in flows:
        words = f"one of {', '.join(flows)} ({CHOOSING['flow'][1]})"
        raise InputError("flow", flow, words, nearest(flow, flows))
    fitting = {kind.solution: kind for kind in KINDS if kind.flow == flow}
    auto = fitting.get(SOLUTION) or next(iter(fitting.values()))
    if solution == AUTO:
        return auto
    if isinstance(solution, str) and solution in fitting:
        return fitting[solution]
    meaning = f"how the axis is treated; auto is {auto.solution}"
    words = f"one of {', '.join([AUTO, *fitting])} ({meaning}) for flow = {flow!r}"
    if others := [repr(kind.flow) for kind in KINDS if kind.solution == solution]:
        words += f", or flow {' or '.join(others)} beside it"
    raise InputError("solution", solution, words, nearest(solution, [AUTO, *fitting]))


def choices(key: str) -> list[str]:
    """What a key that chooses classes may hold."""
    if key == "geometry.shape":
        return list(dict.fromkeys(cls.shape for kind in KINDS for cls in kind.shapes))
    named = [kind.flow if key == "flow" else kind.solution for kind in KINDS]
    return list(dict.fromkeys(named if key == "flow" else [AUTO, *named]))


def _build(cls: Any, values: Mapping[str, Any], kind: Kind) -> Any:
    """An object of a class from tables."""
    made: dict[str, Any] = {}
    for f in fields(cls):
        parts = parts_of(cls, f, kind)
        value = _part(f, parts[0], values, kind) if parts else _value(cls, f, values, kind)
        if value is not None:
            made[f.name] = value
    return cls(**made)


def _part(f: Field[Any], part: Any, values: Mapping[str, Any], kind: Kind) -> Any:
    """The object that a field holds, None where its table may be left out and is."""
    if part.table and part.table not in values:
        if f.default is None:
            return None
        # without its table an object that must be given is missed as a whole
        if f.metadata.get("key") and _must_be_given(f):
            raise InputError(part.table, None, _a_table(part.table))
    if hasattr(part, "from_table"):
        return part.from_table(values.get(part.table) or {})
    return _build(part, values, kind)


def _value(cls: Any, f: Field[Any], values: Mapping[str, Any], kind: Kind) -> Any:
    """The value of a field, None where it is left out; of a list of tables a tuple of objects."""
    key, found = key_of(cls, f), values
    for name in key.split("."):
        found = found.get(name) if isinstance(found, Mapping) else None  # type: ignore[assignment]
    if found is None and _must_be_given(f):
        raise InputError(key, None, allowed(cls, f))
    held = kind_of(cls, f)
    listed = get_args(held) if get_origin(held) is tuple else ()
    if found is None or not (listed and isinstance(listed[0], type)):
        return found
    if not issubclass(listed[0], Parameters):
        return found
    if not isinstance(found, list | tuple) or not all(isinstance(v, Mapping) for v in found):
        raise InputError(key, found, f"a list of tables ({f.metadata['doc']})")
    return tuple(_entry(listed[0], key, n, table, kind) for n, table in enumerate(found))


def _must_be_given(f: Field[Any]) -> bool:
    return f.default is MISSING and f.default_factory is MISSING


def _entry(cls: Any, key: str, number: int, table: Mapping[str, Any], kind: Kind) -> Any:
    """An object from one table of a list; messages tell its number."""
    known = [entry.name for entry in fields(cls)]
    for name in table:
        if name not in known:
            words = f"one of the keys {', '.join(known)}"
            where = f"{key}[{number}].{name}"
            raise InputError(where, table[name], words, nearest(name, known))
    try:
        return _build(cls, {cls.table: table}, kind)
    except InputError as error:
        where = error.key.replace(cls.table, f"{key}[{number}]", 1)
        raise InputError(where, error.value, error.allowed, error.suggestion) from None


def _a_table(name: str) -> str:
    """What is allowed where a table belongs."""
    meaning = known_tables()[name]
    return f"a table ({meaning})" if meaning else "a table"


def unknown_key(key: str, value: Any) -> InputError:
    """Name the keys of the table, and the nearest of them or where else a key of that name is."""
    table, _, name = key.rpartition(".")
    known = [*CHOOSING, *known_keys()]
    outside = in_order({k.partition(".")[0] for k in known})
    beside = [k for k in known if k.rpartition(".")[0] == table] if table else outside
    namesakes = [k for k in known if k.endswith(f".{name}")]
    if f"{table}.{OTHER_NAMES.get(name)}" in known:
        namesakes = [f"{table}.{OTHER_NAMES[name]}"]
    near = nearest(key, namesakes) or next(iter(namesakes), None)
    if near is None:
        leaves = {k.rpartition(".")[2]: k for k in beside}
        near = leaves.get(nearest(name, leaves) or "") or nearest(key, [*known, *outside])
    listed = ", ".join(k.rpartition(".")[2] for k in beside or outside)
    return InputError(key, value, f"one of the keys {listed}", near)


# -- to tables -------------------------------------------------------------------------------------


def tables_of(scene: Any) -> dict[str, Any]:
    """Nested tables with every default, from which `scene_from` makes the same scene."""
    kind = scene.kind
    found: dict[str, Any] = {"flow": kind.flow, "solution": kind.solution}
    _put(scene, found, kind)
    return {name: found[name] for name in in_order(found)}


def _put(part: Parameters, found: dict[str, Any], kind: Kind) -> None:
    """Add what an object and those that it holds state."""
    if hasattr(part, "to_table"):
        table = {k: v for k, v in part.to_table().items() if f"{part.table}.{k}" not in kind.unread}
        found[part.table] = _plain(table)
        return
    for f in fields(part):
        value, key = getattr(part, f.name), key_of(type(part), f)
        if isinstance(value, Parameters) and not isinstance(value, Closure):
            _put(value, found, kind)
        elif key in keys(kind) and value is not None:
            *outer, name = key.split(".")
            table = found
            for one in outer:
                table = table.setdefault(one, {})
            table[name] = _plain(value)


def _plain(value: Any) -> Any:
    """A value as TOML holds it; a law and an entry of a list as a table."""
    if isinstance(value, Parameters):
        name = {"model": value.name} if isinstance(value, Closure) else {}
        given = {f.name: _plain(getattr(value, f.name)) for f in fields(value)}
        return name | {key: part for key, part in given.items() if part is not None}
    if isinstance(value, Mapping):
        return {k: _plain(v) for k, v in value.items() if v is not None}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return value


# -- one value -------------------------------------------------------------------------------------


def value_at(tables: Any, key: str) -> Any:
    """The value at a dotted key of nested tables; None where there is none.

    A table of an array of tables goes by its name or its number, as in particles.materials.ash.

    Raises
    ------
    InputError
        there is no such table in an array.
    """
    found = tables
    for part in key.split("."):
        if isinstance(found, list | tuple) and found and isinstance(found[0], Mapping):
            found = found[one_of(found, part, key)]
        else:
            found = found.get(part) if isinstance(found, Mapping) else None
    return found


def put_at(tables: Any, key: str, value: Any) -> None:
    """Put a value at a dotted key of nested tables, in place; tables go as for `value_at`.

    Raises
    ------
    InputError
        there is no such table.
    """
    *outer, name = key.split(".")
    table = value_at(tables, ".".join(outer)) if outer else tables
    if not isinstance(table, dict):
        raise InputError(key, value, "a key of a table of the case")
    table[name] = value


def one_of(listed: Sequence[Any], part: str, key: str) -> int:
    """Number of a table in an array of tables, by its name or by its number from 0 on.

    Raises
    ------
    InputError
        there is no such table.
    """
    names = [str(t.get("name", n)) if isinstance(t, Mapping) else "" for n, t in enumerate(listed)]
    if part in names:
        return names.index(part)
    if part.isdecimal() and int(part) < len(listed):
        return int(part)
    allowed = f"one of {', '.join(names)}, or a number from 0 to {len(listed) - 1}"
    raise InputError(key, part, allowed, nearest(part, names))

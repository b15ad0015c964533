# SPDX-License-Identifier: LGPL-3.0-or-later
"""The kinds of scenes that there are, and the keys of a case file that each of them reads.

A key is a field of an object that the scene holds: the classes declare the keys, and here they are
collected for each kind.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields
from typing import Any, get_args, get_origin

from fem_tfm.closures.base import Closure, every_law, names
from fem_tfm.errors import InputError
from fem_tfm.geometry.shapes import Shape
from fem_tfm.parameters import Parameters, in_words, key_of, kind_of

# tables and keys outside of tables in the order of a case file; others come behind them
ORDER = (
    "title", "flow", "solution", "inferred", "uncertain", "geometry", "gas", "solids", "operation",
    "inlet", "initial", "closures", "walls", "heat", "particles", "numerics", "output", "reference",
)  # fmt: skip
# meanings of tables that several objects share
SHARED = {
    "closures": "laws of the model",
    "walls": "laws at the wall",
    "numerics": "mesh and solver",
}


@dataclass(frozen=True, eq=False)
class Kind:
    """One kind of scene: a way to solve, and a model that it can solve.

    flow : name of the model in a case file, "dense" or "duct"
    scene, model : classes
    shapes : classes of lines
    physics : what only this model tells, made from a scene
    defaults : of keys whose default depends on the kind
    unread : keys that the classes hold and this kind does not read
    """

    flow: str
    scene: type[Any]
    model: type[Any]
    shapes: tuple[type[Shape], ...]
    physics: type[Any]
    defaults: Mapping[str, Any] = field(default_factory=dict)
    unread: tuple[str, ...] = ()

    @property
    def solution(self) -> str:
        """Name of the way to solve in a case file."""
        return str(self.scene.solution)

    def __str__(self) -> str:
        return f"flow = {self.flow!r} with solution = {self.solution!r}"


KINDS: list[Kind] = []


def register(kind: Kind) -> None:
    """Make a kind of scene known to case files and to Python."""
    KINDS.append(kind)
    _forget()


def unregister(kind: Kind) -> None:
    """Take a kind of scene back."""
    KINDS.remove(kind)
    _forget()


def _forget() -> None:
    """Collect the keys anew when they are next asked for."""
    known_keys.cache_clear()
    known_tables.cache_clear()


# -- keys ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Key:
    """A key of a case file: the class and the field that hold it."""

    name: str
    cls: type[Parameters]
    field: Field[Any]

    @property
    def unit(self) -> str:
        """Its unit, empty for a number without one."""
        return str(self.field.metadata.get("unit", "")).strip("-")

    @property
    def doc(self) -> str:
        """Its meaning."""
        return str(self.field.metadata.get("doc", ""))

    @property
    def default(self) -> Any:
        """Its default, MISSING where it must be given, None where it follows from other keys."""
        return self.field.default

    @property
    def defaults(self) -> list[Any]:
        """Its defaults in the kinds of scenes that read it, each once."""
        found = [kind.defaults.get(self.name, self.default) for kind in readers(self.name)]
        return [value for n, value in enumerate(found) if value not in found[:n]]

    @property
    def is_law(self) -> bool:
        """Whether it holds a law."""
        return self._law is not None

    @property
    def _law(self) -> type[Closure] | None:
        """Interface of the law that it holds, perhaps besides None."""
        held = kind_of(self.cls, self.field)
        kinds = (held,) if isinstance(held, type) else get_args(held)
        laws = (k for k in kinds if isinstance(k, type) and issubclass(k, Closure))
        return next(laws, None)

    @property
    def allowed(self) -> str:
        """What it may hold, in words without unit and meaning."""
        if (kind := self._law) is not None:
            family = next(law.family for law in every_law() if issubclass(law, kind))
            told = f"their parameters, {self.name}.NAME: fem-tfm models {family}"
            return f"one of {', '.join(names(family))} ({told})"
        kind, limits = kind_of(self.cls, self.field), self.field.metadata.get("limits", {})
        entry = next(iter(get_args(kind)), None) if get_origin(kind) is tuple else None
        if isinstance(entry, type) and issubclass(entry, Parameters):
            told = ", ".join(_entry_in_words(f) for f in fields(entry))
            return f"a list of tables with the keys {told}"
        return in_words(kind, limits)


def _entry_in_words(f: Field[Any]) -> str:
    """A key of a table in a list: "diameter [m]", and its default."""
    unit = str(f.metadata.get("unit", "")).strip("-")
    must = f.default is MISSING and f.default_factory is MISSING
    default = "" if must or f.default is None else f" = {f.default}"
    return f"{f.name}{f' [{unit}]' if unit else ''}{default}"


def parts_of(cls: type[Parameters], f: Field[Any], kind: Kind) -> list[type[Parameters]]:
    """Classes of objects that a field of a kind of scene may hold; a law is a value, no object."""
    if cls is kind.scene and f.name == "model":
        return [kind.model]
    if cls is kind.scene and f.name == "geometry":
        return list(kind.shapes)
    held = kind_of(cls, f)
    return [
        c
        for c in ([held, *get_args(held)] if get_origin(held) is not tuple else [])
        if isinstance(c, type) and issubclass(c, Parameters) and not issubclass(c, Closure)
    ]


def _walk(cls: type[Parameters], kind: Kind) -> Iterator[tuple[Key, list[type[Parameters]]]]:
    """Every field of a class and of the objects that it holds, with the classes of those."""
    for f in fields(cls):
        parts = parts_of(cls, f, kind)
        yield Key(key_of(cls, f), cls, f), parts
        for part in parts:
            yield from _walk(part, kind)


@functools.cache
def keys(kind: Kind) -> dict[str, Key]:
    """Keys that a kind of scene reads."""
    found = _walk(kind.scene, kind)
    return {key.name: key for key, parts in found if not parts and key.name not in kind.unread}


@functools.cache
def known_keys() -> dict[str, Key]:
    """Every key that some kind of scene reads, in the order of a case file."""
    found = {name: key for kind in reversed(KINDS) for name, key in keys(kind).items()}
    return {name: found[name] for name in in_order(found)}


@functools.cache
def known_tables() -> dict[str, str]:
    """Tables of a case file and their meaning."""
    found = {name.rpartition(".")[0]: "" for name in known_keys() if "." in name} | SHARED
    for kind in KINDS:
        for key, parts in _walk(kind.scene, kind):
            for part in parts:
                if part.table:
                    found[part.table] = found[part.table] or key.doc
    return found


def in_order(found: Iterable[str]) -> list[str]:
    """Names of keys or tables as they follow each other in a case file."""
    place = {name: number for number, name in enumerate(ORDER)}
    return sorted(found, key=lambda name: place.get(name.partition(".")[0], len(ORDER)))


# -- who reads what --------------------------------------------------------------------------------


def reads(kind: Kind, name: str) -> bool:
    """Whether a kind of scene reads a key, or some key of a table."""
    return name in keys(kind) or any(key.startswith(f"{name}.") for key in keys(kind))


def readers(name: str) -> list[Kind]:
    """Kinds of scenes that read a key, or some key of a table."""
    return [kind for kind in KINDS if reads(kind, name)]


def readers_in_words(kinds: Sequence[Kind]) -> str:
    """Kinds of scenes as a phrase: "flow = 'dense' with solution = 'developing' or 'unsteady'"."""
    if len(kinds) == len(KINDS):
        return "every scene"
    solutions: dict[str, list[str]] = {}
    for kind in kinds:
        solutions.setdefault(kind.flow, []).append(repr(kind.solution))
    return ", or ".join(
        f"flow = {flow!r} with solution = {' or '.join(named)}" for flow, named in solutions.items()
    )


def unread_words(name: str, kind: Kind) -> str:
    """What is allowed where a key or table is not read: the scenes that read it."""
    others = readers_in_words([one for one in readers(name) if one is not kind])
    what = "table" if name in known_tables() else "key"
    return f"no such {what} for {kind}" + (f"; {others} reads it" if others else "")


def check_shape(shape: str, kind: Kind) -> None:
    """Refuse a shape that a kind of scene cannot solve."""
    known = [cls.shape for cls in kind.shapes]
    if shape not in known:
        words = f"one of {', '.join(known)} for {kind}"
        others = [one for one in KINDS if shape in {cls.shape for cls in one.shapes}]
        near = [f"solution = {one.solution!r}" for one in others if one.flow == kind.flow]
        if others:
            words += f", or {' or '.join(near) or readers_in_words(others)} beside it"
        raise InputError("geometry.shape", shape, words)

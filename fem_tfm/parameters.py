# SPDX-License-Identifier: LGPL-3.0-or-later
"""Frozen dataclasses whose fields know their unit, meaning, range and key in a case file.

Every object that a user builds (a pipe, a gas, a law, a scene) derives from `Parameters`. Its
fields are made by `parameter`; a value of the wrong kind or outside its range raises `InputError`
with the key, the value, what is allowed and the nearest name. A case file is read by the same
declarations, so that a key is declared once.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import math
import numbers
import types
from collections.abc import Callable, Iterable, Mapping
from typing import Any, ClassVar, Literal, Self, Union, get_args, get_origin, get_type_hints

from ufl.core.expr import Expr

from fem_tfm.errors import InputError, nearest

LIMITS = {"gt": "above", "ge": "at least", "lt": "below", "le": "at most"}
KINDS = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}


def parameter(
    default: Any = dataclasses.MISSING,
    unit: str = "-",
    doc: str = "",
    *,
    key: str = "",
    factory: Any = dataclasses.MISSING,
    convert: Callable[[Any, str], Any] | None = None,
    gt: float | None = None,
    ge: float | None = None,
    lt: float | None = None,
    le: float | None = None,
) -> Any:
    """Field of a `Parameters` class.

    unit, doc : unit and meaning
    key : dotted key in a case file, default `table`.`name of the field`
    factory : makes the default
    convert : turns what is given into the value, told the key; raises InputError
    gt, ge, lt, le : range of a number
    """
    given = {"gt": gt, "ge": ge, "lt": lt, "le": le}
    metadata = {
        "unit": unit,
        "doc": doc,
        "key": key,
        "convert": convert,
        "limits": {name: value for name, value in given.items() if value is not None},
    }
    if factory is not dataclasses.MISSING:
        return dataclasses.field(default_factory=factory, metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


@dataclasses.dataclass(frozen=True)
class Parameters:
    """Base of everything that a user states: checked values, which can be bound to UFL.

    table : table of the case file that holds the fields, "" where a field names its own key
    """

    table: ClassVar[str] = ""

    def __post_init__(self) -> None:
        """Check every value and store numbers as floats, lists as tuples.

        Raises
        ------
        InputError
            a value is of the wrong kind, not finite, or out of range
        """
        for field in dataclasses.fields(self):
            value = checked(type(self), field, getattr(self, field.name))
            object.__setattr__(self, field.name, value)

    def bound(self, wrap: Callable[[float], Any]) -> Self:
        """The same object with every number replaced by wrap(number).

        With `wrap` making a UFL constant, a changed parameter recompiles no form.
        """
        values = {
            f.name: wrap(getattr(self, f.name))
            for f in dataclasses.fields(self)
            if isinstance(getattr(self, f.name), float)
        }
        return dataclasses.replace(self, **values)


def key_of(cls: type[Parameters], field: dataclasses.Field[Any]) -> str:
    """Dotted key of a field in a case file."""
    return field.metadata.get("key") or (f"{cls.table}.{field.name}" if cls.table else field.name)


def kind_of(cls: type[Parameters], field: dataclasses.Field[Any]) -> Any:
    """Type of a field, resolved."""
    # mypy does not see that a class is hashable
    return _hints(cls)[field.name]  # type: ignore[arg-type]


@functools.cache
def _hints(cls: type[Parameters]) -> dict[str, Any]:
    return get_type_hints(cls)


def checked(cls: type[Parameters], field: dataclasses.Field[Any], value: Any) -> Any:
    """The value of a field, fitted to its kind and range.

    Raises
    ------
    InputError
        it does not fit.
    """
    key, convert = key_of(cls, field), field.metadata.get("convert")
    if convert is not None:
        value = convert(value, key)
    kind = kind_of(cls, field)
    try:
        fitted = _fitted(kind, value)
    except _Misfit as misfit:
        where, found = key + misfit.place, misfit.value
        words, near = allowed(cls, field), nearest(found, choices(kind))
        if near == found:
            # the name is right and stands alone where a list is asked for
            words, near = f'{words}; write {where} = ["{found}"]', None
        raise InputError(where, found, words, near) from None
    if isinstance(fitted, float | int) and not _inside(fitted, field.metadata.get("limits", {})):
        raise InputError(key, value, allowed(cls, field))
    return fitted


class _Misfit(Exception):
    """A value is not of the kind asked for; place is that of an entry in a list, "[2]"."""

    def __init__(self, value: Any, place: str = "") -> None:
        super().__init__(value, place)
        self.value, self.place = value, place


def _fitted(kind: Any, value: Any) -> Any:
    """A value as the kind has it; raises _Misfit."""
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        return _first_fit(inner, value)
    if origin is Literal:
        if any(type(value) is type(name) and value == name for name in inner):
            return value
    elif origin is tuple:
        return _fitted_tuple(inner, value)
    elif kind is float:
        if isinstance(value, Expr):
            return value
        if isinstance(value, numbers.Real) and not isinstance(value, bool):
            return float(value)
    elif kind is int:
        if isinstance(value, numbers.Integral) and not isinstance(value, bool):
            return int(value)
    elif kind is Any or isinstance(value, origin or kind):
        return value
    raise _Misfit(value)


def _first_fit(kinds: Iterable[Any], value: Any) -> Any:
    for kind in kinds:
        try:
            return _fitted(kind, value)
        except _Misfit:
            continue
    raise _Misfit(value)


def _fitted_tuple(inner: tuple[Any, ...], value: Any) -> tuple[Any, ...]:
    if not isinstance(value, list | tuple):
        raise _Misfit(value)
    if len(inner) == 2 and inner[1] is Ellipsis:
        inner = (inner[0],) * len(value)
    if len(value) != len(inner):
        raise _Misfit(value)
    return tuple(_entry(kind, value[n], n) for n, kind in enumerate(inner))


def _entry(kind: Any, value: Any, number: int) -> Any:
    """An entry of a list as the kind has it; raises _Misfit with its place."""
    try:
        return _fitted(kind, value)
    except _Misfit as misfit:
        raise _Misfit(misfit.value, f"[{number}]{misfit.place}") from None


def _inside(value: float, limits: Mapping[str, float]) -> bool:
    """Whether a value is finite and respects its limits."""
    test = {
        "gt": value > limits.get("gt", -math.inf),
        "ge": value >= limits.get("ge", -math.inf),
        "lt": value < limits.get("lt", math.inf),
        "le": value <= limits.get("le", math.inf),
    }
    return math.isfinite(value) and all(test.values())


def choices(kind: Any) -> list[str]:
    """Names that a value may have, if its values are names."""
    if get_origin(kind) is Literal:
        return [name for name in get_args(kind) if isinstance(name, str)]
    return [name for inner in get_args(kind) for name in choices(inner)]


def allowed(cls: type[Parameters], field: dataclasses.Field[Any]) -> str:
    """What a field may hold in words: kind, range, unit, meaning."""
    return in_words(
        kind_of(cls, field),
        field.metadata.get("limits", {}),
        field.metadata.get("unit", ""),
        field.metadata.get("doc", ""),
    )


def in_words(
    kind: Any,
    limits: Mapping[str, float] = types.MappingProxyType({}),
    unit: str = "",
    doc: str = "",
) -> str:
    """A kind with its range, unit and meaning, such as "a number above 0 [m] (diameter)"."""
    bounds = " and ".join(f"{LIMITS[name]} {bound:g}" for name, bound in limits.items())
    parts = [
        _kind_in_words(kind),
        bounds,
        f"[{unit}]" if unit.strip("-") else "",
        f"({doc})" if doc else "",
    ]
    return " ".join(part for part in parts if part)


def _kind_in_words(kind: Any) -> str:
    names, several = choices(kind), _holds(kind, tuple)
    if names:
        return ("a list of names out of " if several else "one of ") + ", ".join(names)
    named = [f"a {name}" for c in (kind, *get_args(kind)) for name in _class_names(c)]
    if several and named:
        return f"a list, each {' or '.join(named)}"
    if several:
        return f"a {_list_in_words(kind)}"
    found = next((text for base, text in KINDS.items() if _holds(kind, base)), None)
    if found is not None:
        return found
    return " or ".join(named) or "a value"


def _list_in_words(kind: Any, name: str = "list") -> str:
    """A list of numbers or texts with its length, such as "list of lists of 3 numbers"."""
    inner = get_args(kind)
    if get_origin(kind) is tuple:
        count = "" if Ellipsis in inner else f"{len(inner)} "
        return f"{name} of {count}{_list_in_words(inner[0], 'lists')}"
    listed = next((k for k in inner if _holds(k, tuple)), None)
    if listed is not None:
        return _list_in_words(listed, name)
    return "numbers" if kind is float else "texts"


def _class_names(cls: Any) -> list[str]:
    """Names of a class that a user states and of its subclasses, without abstract ones."""
    if not (isinstance(cls, type) and issubclass(cls, Parameters)):
        return []
    own = [] if inspect.isabstract(cls) else [cls.__name__]
    return own + [name for inner in cls.__subclasses__() for name in _class_names(inner)]


def _holds(kind: Any, base: type) -> bool:
    """Whether a type is, lists or may be `base`."""
    return base in (kind, get_origin(kind)) or any(_holds(inner, base) for inner in get_args(kind))

# SPDX-License-Identifier: LGPL-3.0-or-later
"""Base class and registry of the closure laws.

A law is one frozen dataclass: its parameters are fields made by `parameter`, its docstring carries
the title, the formula and the lines "Validity: ..." and "Source: ...". `@register(family, name)`
makes it known to the case file, to `make` and to the list of models. A field holds a number, or a
UFL constant after `bound`; hence a formula never branches in Python on the value of a number.
"""

from __future__ import annotations

import abc
import dataclasses
import inspect
import re
import sys
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

from fem_tfm.errors import InputError, nearest
from fem_tfm.parameters import Parameters, in_words, kind_of, parameter

_REGISTRY: dict[str, dict[str, type[Closure]]] = {}


def allowed_range(cls: type[Parameters], field: dataclasses.Field[Any]) -> str:
    """Range of a parameter as a phrase: "a number above 0 and at most 1 [m]"."""
    limits, unit = field.metadata.get("limits", {}), field.metadata.get("unit", "")
    return in_words(kind_of(cls, field), limits, unit)


@dataclasses.dataclass(frozen=True)
class Closure(Parameters, abc.ABC):
    """Base of every closure law: a frozen dataclass of parameters with formulas as methods.

    family, name : where the law is registered
    source, validity : lines of the docstring, read by `register`
    """

    family: ClassVar[str] = ""
    name: ClassVar[str] = ""
    source: ClassVar[str] = ""
    validity: ClassVar[str] = ""


def _paragraph(text: str, label: str) -> str:
    """Paragraph of a docstring that begins with "label:", on one line; empty if absent."""
    found = re.search(rf"^{label}:\s*(.+?)(?=^\w+:|^\s*$|\Z)", text, re.MULTILINE | re.DOTALL)
    return " ".join(found.group(1).split()) if found else ""


def register(family: str, name: str) -> Callable[[type[Closure]], type[Closure]]:
    """Class decorator that adds a law to the registry; put it above @dataclass(frozen=True).

    Raises
    ------
    TypeError
        the law is not a Closure, its name is taken, or its docstring lacks Validity or Source
    """

    def add(cls: type[Closure]) -> type[Closure]:
        laws = _REGISTRY.setdefault(family, {})
        if not issubclass(cls, Closure):
            raise TypeError(f"{cls.__qualname__} must derive from Closure")
        if name in laws and laws[name].__qualname__ != cls.__qualname__:
            raise TypeError(f"{family} {name!r} is already {laws[name].__qualname__}")
        text = inspect.cleandoc(cls.__doc__ or "")
        cls.family, cls.name = family, name
        cls.validity, cls.source = _paragraph(text, "Validity"), _paragraph(text, "Source")
        # python -OO strips docstrings; the laws must work all the same
        if sys.flags.optimize < 2 and not (cls.validity and cls.source):
            raise TypeError(f"the docstring of {cls.__qualname__} lacks Validity: or Source:")
        laws[name] = cls
        return cls

    return add


def families() -> list[str]:
    """Names of the families, sorted."""
    return sorted(_REGISTRY)


def every_law() -> list[type[Closure]]:
    """Classes of all laws, by family and name."""
    return [_laws(family)[name] for family in families() for name in names(family)]


def names(family: str) -> list[str]:
    """Names of the laws of a family, sorted.

    Raises
    ------
    InputError
        there is no such family
    """
    return sorted(_laws(family))


def _laws(family: str) -> dict[str, type[Closure]]:
    if family not in _REGISTRY:
        # the name of a law leads to its family
        of = next((name for name, laws in _REGISTRY.items() if family in laws), None)
        near = of or nearest(family, _REGISTRY)
        raise InputError("family", family, _one_of(_REGISTRY), near)
    return _REGISTRY[family]


def _one_of(valid: Mapping[str, Any] | list[str]) -> str:
    return "one of " + ", ".join(sorted(valid))


def make(family: str, spec: str | Mapping[str, Any] | Closure, key: str | None = None) -> Closure:
    """Law of a family from a case-file value: a name, or a table {model = name, parameter = ...}.

    A law made in Python passes through. `key` is the dotted name of the value in error messages,
    "closures.<family>" if absent.

    Raises
    ------
    InputError
        unknown model or parameter, or a value out of range
    """
    key = key or f"closures.{family}"
    laws = _laws(family)
    if isinstance(spec, Closure):
        if spec.family != family:
            raise InputError(key, spec, f"a law of the family {family}")
        return spec
    name, values = _split(laws, spec, key)
    cls = laws[name]
    valid = [f.name for f in dataclasses.fields(cls)]
    for unknown in (v for v in values if v not in valid):
        allowed = _one_of(valid) if valid else f"no parameter, since {name} has none"
        raise InputError(f"{key}.{unknown}", values[unknown], allowed, nearest(unknown, valid))
    try:
        return cls(**values)
    except InputError as error:
        raise InputError(f"{key}.{error.key}", error.value, error.allowed) from None


def _split(
    laws: dict[str, type[Closure]], spec: str | Mapping[str, Any], key: str
) -> tuple[str, dict[str, Any]]:
    """Name and parameters of a case-file value."""
    if isinstance(spec, Mapping):
        values = {str(k): v for k, v in spec.items()}
        name, key = values.pop("model", None), f"{key}.model"
    else:
        name, values = spec, {}
    if not isinstance(name, str):
        raise InputError(key, name, _one_of(laws))
    if name not in laws:
        raise InputError(key, name, _one_of(laws), nearest(name, laws))
    return name, values


def catalogue(family: str | None = None) -> list[dict[str, Any]]:
    """Every law, or those of one family, as plain dictionaries for listing.

    Keys: family, name, title, formula, symbols (those that the laws of a module share), source,
    validity, parameters (a list of dictionaries with name, default, unit, doc, range).
    """
    chosen = families() if family is None else [family]
    return [_entry(_laws(f)[n]) for f in chosen for n in names(f)]


def _entry(cls: type[Closure]) -> dict[str, Any]:
    text = inspect.cleandoc(cls.__doc__ or cls.__name__)
    title, _, body = text.partition("\n")
    formula = re.split(r"^(?:Validity|Source):", body, maxsplit=1, flags=re.MULTILINE)[0]
    return {
        "family": cls.family,
        "name": cls.name,
        "title": title.strip(),
        "formula": inspect.cleandoc(formula).strip(),
        "symbols": _paragraph(inspect.getdoc(sys.modules[cls.__module__]) or "", "Symbols"),
        "source": cls.source,
        "validity": cls.validity,
        "parameters": [
            {
                "name": f.name,
                "default": f.default,
                "unit": f.metadata.get("unit", "-"),
                "doc": f.metadata.get("doc", ""),
                "range": allowed_range(cls, f),
            }
            for f in dataclasses.fields(cls)
        ],
    }


def law(family: str, default: str, doc: str, key: str) -> Any:
    """Field of a `Parameters` class that holds a law of a family.

    It takes a law, its name, or a table { model = name, parameter = value }.
    """

    def convert(spec: Any, where: str) -> Closure:
        return make(family, spec, where)

    return parameter(default, doc=doc, key=key, convert=convert)


def optional_law(family: str) -> Callable[[Any, str], Closure | None]:
    """`convert` of a field that holds a law of a family, or None."""
    return lambda spec, where: None if spec is None else make(family, spec, where)


def wall_distance_field() -> Any:
    """Field of a model: distance from the wall at which its wall laws act [m]."""
    doc = "distance of the wall law, default that of the flow"
    return parameter(None, "m", doc, key="walls.distance", gt=0, le=10)

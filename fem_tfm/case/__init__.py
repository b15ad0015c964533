# SPDX-License-Identifier: LGPL-3.0-or-later
"""The case: a scene as a TOML file or a dictionary of the same shape, in SI units.

Every key is a field of an object that the scene is made of; `scenes.kinds` collects them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import fem_tfm.scenes  # noqa: F401  (the scenes register themselves)
from fem_tfm.case.edit import (
    change,
    drop_ranges,
    drop_references,
    each_once,
    give_way,
    parse_override,
    read,
)
from fem_tfm.scenes.kinds import known_keys
from fem_tfm.scenes.reading import scene_from, tables_of, value_at
from fem_tfm.scenes.recorder import case_text
from fem_tfm.scenes.scene import Scene

__all__ = ["Case", "known_keys", "load"]


class Case:
    """One problem: nested tables, and the scene that they describe.

    `Case.load(path)`, `Case.from_dict(tables)` or `Case(geometry={...}, ...)`.

    Raises InputError for an unknown key, a key that the scene does not read, a value of the wrong
    type or outside its range, and for values that contradict each other.
    """

    def __init__(self, **values: Any) -> None:
        self._given = _plain(values)
        self.scene: Scene[Any, Any] = scene_from(self._given)

    @classmethod
    def load(cls, path: str | Path, overrides: Iterable[str] = ()) -> Case:
        """Read a TOML file; `overrides` are texts "key=value" as given to --set.

        Published values of the file are dropped where an override makes the flow another one, and
        the range of a number that is overridden.
        """
        values = read(Path(path))
        changes = each_once("--set", map(parse_override, overrides))
        drop_references(values, changes)
        drop_ranges(values, changes)
        give_way(values, changes)
        for key, value in changes.items():
            change(values, key, value)
        return cls.from_dict(values)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Case:
        """Build a case from nested tables."""
        return cls(**values)

    def with_values(self, changes: Mapping[str, Any]) -> Case:
        """Return a case with dotted keys changed; None takes a key back to its default.

        References go where the flow becomes another one.
        """
        values = self.given
        drop_references(values, changes)
        drop_ranges(values, changes)
        give_way(values, changes)
        for key, value in changes.items():
            change(values, key, value)
        return Case.from_dict(values)

    @property
    def given(self) -> dict[str, Any]:
        """A copy of the nested tables as they were given."""
        return _copied(self._given)

    @cached_property
    def tables(self) -> dict[str, Any]:
        """Nested tables with every default."""
        return tables_of(self.scene)

    def __getitem__(self, key: str) -> Any:
        """Value at a dotted key, given or default; None where there is none."""
        return value_at(self.tables, key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Case) and self.scene == other.scene

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"Case({self.scene!r})"

    def dump(self) -> str:
        """Return the case as TOML with every default written out."""
        return case_text(self.scene)


def load(path: str | Path, overrides: Iterable[str] = ()) -> Scene[Any, Any]:
    """The scene of a case file; `overrides` are texts "key=value" as given to --set."""
    return Case.load(path, overrides).scene


def _plain(value: Any) -> Any:
    """Nested values without numpy scalars and tuples; a table of its own at every level."""
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items() if v is not None}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return value.item() if hasattr(value, "item") and not hasattr(value, "__len__") else value


def _copied(values: Mapping[str, Any]) -> dict[str, Any]:
    return {k: _copied(v) if isinstance(v, Mapping) else v for k, v in values.items()}

# SPDX-License-Identifier: LGPL-3.0-or-later
"""The kinds of scenes that there are: ways to solve, and the models that each can solve."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from fem_tfm.geometry.shapes import Shape


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

    def __str__(self) -> str:
        return f"flow = {self.flow!r} with solution = {self.scene.solution!r}"


KINDS: list[Kind] = []


def register(kind: Kind) -> None:
    """Make a kind of scene known to case files and to Python."""
    KINDS.append(kind)

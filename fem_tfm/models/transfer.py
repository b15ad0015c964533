# SPDX-License-Identifier: LGPL-3.0-or-later
"""Unknowns carried from one section to another mesh of the same problem."""

from __future__ import annotations

import numpy as np
from dolfinx import fem

from fem_tfm.interpolation import Transfer
from fem_tfm.models.section import Section


def warm(section: Section, source: Section) -> None:
    """Start from the answer of another mesh of the same problem, with its multipliers."""
    for transfer in transfers(source, section):
        transfer.carry(source.now.x.array, section.now.x.array)
    _take_multipliers(section, source)


def follow(section: Section, source: Section, before: np.ndarray) -> None:
    """Add to a section's state how the state of a coarser one has changed since `before`.

    The difference of two meshes hardly depends on the numbers of the problem, so that this start is
    far closer than either mesh's own state.
    """
    after, state = source.now.x.array.copy(), section.now.x.array.copy()
    for transfer in transfers(source, section):
        transfer.carry(after - before, section.now.x.array)
    section.now.x.array[:] += state
    _take_multipliers(section, source)


def _take_multipliers(section: Section, source: Section) -> None:
    for border, given in zip(section.newton.borders, source.newton.borders, strict=True):
        border.multiplier.value = float(given.multiplier.value)
    section.fulfil()


class UnknownTransfer:
    """Carries one unknown from a section to another mesh; what the meshes fix is found once."""

    def __init__(
        self, source: Section, target: Section, i: int, known: dict[bytes, Transfer]
    ) -> None:
        given, self._from = source.space.sub(i).collapse()
        found, self._to = target.space.sub(i).collapse()
        self._from, self._to = np.asarray(self._from).ravel(), np.asarray(self._to).ravel()
        self._given, self._found = fem.Function(given), fem.Function(found)
        self._transfer = Transfer(given, found, known)

    def carry(self, source: np.ndarray, target: np.ndarray) -> None:
        """From all unknowns of the source to those of the target."""
        self._given.x.array[:] = source[self._from]
        self._transfer.carry(self._given, self._found)
        target[self._to] = self._found.x.array


def transfers(source: Section, target: Section) -> list[UnknownTransfer]:
    """One for each unknown, kept with the target; those of equal elements share what they find."""
    if source not in target.carriers:
        known: dict[bytes, Transfer] = {}
        numbers = range(len(target.names))
        target.carriers[source] = [UnknownTransfer(source, target, i, known) for i in numbers]
    return target.carriers[source]

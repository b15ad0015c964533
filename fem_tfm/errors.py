# SPDX-License-Identifier: LGPL-3.0-or-later
"""The two ways a run can fail: bad input, and a solver that gave up."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class FemTfmError(Exception):
    """Base of every error that fem_tfm raises on purpose."""


class InputError(FemTfmError, ValueError):
    """Bad input: one sentence with the key, the value received, what is allowed and a near name.

    `key` is the dotted name in the case file ("solids.diameter"), `value` what was received (None
    where nothing was), `allowed` a phrase ("a number above 0 m"), `suggestion` the nearest valid
    name if the key or value looks misspelt. The command line ends with status 2 on it.
    """

    def __init__(
        self, key: str, value: object, allowed: str, suggestion: str | None = None
    ) -> None:
        super().__init__(key, value, allowed, suggestion)
        self.key = key
        self.value = value
        self.allowed = allowed
        self.suggestion = suggestion

    def __str__(self) -> str:
        received = "is not given" if self.value is None else f"= {_short(self.value)} is refused"
        hint = f" (did you mean {self.suggestion!r}?)" if self.suggestion else ""
        return f"{self.key} {received}: expected {self.allowed}{hint}"


class SolverError(FemTfmError, RuntimeError):
    """The solver gave up; the last good state is kept. The command line ends with status 3."""


class TimeIsUp(FemTfmError, RuntimeError):
    """A run has used the time that it was given; its last state is kept.

    It is no SolverError, which tells that another way may be tried.
    """


def nearest(name: object, valid: Iterable[str]) -> str | None:
    """Return the valid name that looks most like `name`; None if none is near or it is no text."""
    if not isinstance(name, str):
        return None
    names = {candidate.lower(): candidate for candidate in valid}
    found = difflib.get_close_matches(name.lower(), list(names), n=1, cutoff=0.6)
    return names[found[0]] if found else None


def _short(value: object) -> str:
    """Return `value` as it would be typed in a case file, cut to 60 characters."""
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."

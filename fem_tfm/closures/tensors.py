# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tensor algebra that works alike on UFL expressions and numpy arrays of shape (3, 3).

A law of the Reynolds stresses is written once with these and used in forms, in the closed numbers
of the log layer and in tests.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import ufl

from fem_tfm.closures.ops import is_expr

type Tensor = Any
"""A UFL expression or a numpy array of shape (3, 3), or (3,) for a vector."""


def dot(a: Tensor, b: Tensor) -> Tensor:
    """Product summed over the last index of a and the first of b."""
    return ufl.dot(a, b) if is_expr(a, b) else np.dot(a, b)


def outer(a: Tensor, b: Tensor) -> Tensor:
    """Product a_i b_j of two vectors."""
    return ufl.outer(a, b) if is_expr(a, b) else np.outer(a, b)


def transpose(a: Tensor) -> Tensor:
    """a_ji."""
    return ufl.transpose(a) if is_expr(a) else np.transpose(a)


def trace(a: Tensor) -> Any:
    """a_kk."""
    return ufl.tr(a) if is_expr(a) else np.trace(a)


def identity(like: Tensor) -> Tensor:
    """delta_ij of the kind of `like`."""
    return ufl.Identity(3) if is_expr(like) else np.eye(3)


def symmetric(a: Tensor) -> Tensor:
    """(a_ij + a_ji)/2."""
    return (a + transpose(a)) / 2


def deviator(a: Tensor) -> Tensor:
    """a_ij - a_kk delta_ij/3."""
    return a - trace(a) / 3 * identity(a)

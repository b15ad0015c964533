# SPDX-License-Identifier: LGPL-3.0-or-later
"""The axial derivative, the only thing that differs between the treatments of the axis.

Weak forms are written once, for vectors with three components (x, y across, z along the axis), in
terms of the gradients given here. A section that does not change along the axis has d/dz = 0; one
that develops takes d/dz from the sections upstream, so that it can be solved station by station.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import ufl
from ufl.core.expr import Expr


class Axis(Protocol):
    """Supplies gradients of three-component fields on whatever mesh carries them.

    `gradient` and `jacobian` are those within the section, which test functions need; `change` is
    the rest, d/dz of whatever the state carries.
    """

    def gradient(self, f: Expr) -> Expr:
        """Gradient of a scalar, a vector of length 3 [unit of f per m]."""
        ...

    def jacobian(self, u: Expr) -> Expr:
        """Gradient L_ij = du_i/dx_j of a vector of length 3, shape (3, 3) [1/s for a velocity]."""
        ...

    def change(self, quantity: Callable[[Any], Expr], state: Any) -> Expr:
        """d/dz of a quantity of the state, in the shape of the quantity [its unit per m]."""
        ...


class SectionAxis:
    """Gradients within a section, the part that all treatments of the axis share."""

    def gradient(self, f: Expr) -> Expr:
        """(df/dx, df/dy, 0)."""
        return ufl.as_vector((f.dx(0), f.dx(1), 0.0))

    def jacobian(self, u: Expr) -> Expr:
        """Rows (du_i/dx, du_i/dy, 0)."""
        return ufl.as_matrix([[u[i].dx(0), u[i].dx(1), 0.0] for i in range(3)])


class DevelopedAxis(SectionAxis):
    """Fully developed flow: nothing but the pressure changes along z, so d/dz = 0."""

    def change(self, quantity: Callable[[Any], Expr], state: Any) -> Expr:
        """Zero."""
        return ufl.zero(quantity(state).ufl_shape)


class DevelopingAxis(SectionAxis):
    """Flow marched downstream: d/dz by a backward formula over the sections upstream.

        dQ/dz = w_0 Q(state) + sum_k w_k Q(upstream_k)

    The weights add up to zero, so that a flux differenced in this way is conserved from station to
    station. Derivatives of stresses along z are left out: nothing acts upstream.

    weights : w_k, the first that of the present section [1/m]
    upstream : states of the sections before, nearest first
    """

    def __init__(self, weights: Sequence[Any], upstream: Sequence[Any]) -> None:
        self.weights = tuple(weights)
        self.upstream = tuple(upstream)

    def change(self, quantity: Callable[[Any], Expr], state: Any) -> Expr:
        """The backward formula."""
        stations = (state, *self.upstream)
        terms = (w * quantity(s) for w, s in zip(self.weights, stations, strict=True))
        return sum(terms, ufl.zero(quantity(state).ufl_shape))

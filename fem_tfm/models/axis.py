# SPDX-License-Identifier: LGPL-3.0-or-later
"""The axial derivative, the only thing that differs between the treatments of the axis.

Weak forms are written once, for vectors with three components (x, y across, z along the axis), in
terms of the gradients given here. A section that does not change along the axis has d/dz = 0.
"""

from __future__ import annotations

from typing import Protocol

import ufl
from ufl.core.expr import Expr


class Axis(Protocol):
    """Supplies gradients of three-component fields on whatever mesh carries them."""

    def gradient(self, f: Expr) -> Expr:
        """Gradient of a scalar, a vector of length 3 [unit of f per m]."""
        ...

    def jacobian(self, u: Expr) -> Expr:
        """Gradient L_ij = du_i/dx_j of a vector of length 3, shape (3, 3) [1/s for a velocity]."""
        ...


class DevelopedAxis:
    """Fully developed flow: nothing but the pressure changes along z, so d/dz = 0."""

    def gradient(self, f: Expr) -> Expr:
        """(df/dx, df/dy, 0)."""
        return ufl.as_vector((f.dx(0), f.dx(1), 0.0))

    def jacobian(self, u: Expr) -> Expr:
        """Rows (du_i/dx, du_i/dy, 0)."""
        return ufl.as_matrix([[u[i].dx(0), u[i].dx(1), 0.0] for i in range(3)])

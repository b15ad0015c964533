# SPDX-License-Identifier: LGPL-3.0-or-later
"""Two-fluid model of gas and solids on finite elements."""

from fem_tfm.models.pointwise import ClosureSet
from fem_tfm.models.two_fluid.forms import Domain, Solid, Stabilisation, State, TwoFluidForms

__all__ = ["ClosureSet", "Domain", "Solid", "Stabilisation", "State", "TwoFluidForms"]

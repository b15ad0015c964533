# SPDX-License-Identifier: LGPL-3.0-or-later
"""Drag of a suspension whose clusters the equations do not resolve.

Symbols: a = alpha_s solids fraction, beta drag coefficient [kg/m3/s], Fi = g L/v_t^2 filter size L
over the length on which a grain reaches its terminal velocity v_t.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from fem_tfm.closures.base import parameter, register
from fem_tfm.closures.drag import WenYu
from fem_tfm.closures.ops import Value, exp, maximum, where_greater
from fem_tfm.materials import Fluid, Solids

# where one branch of the fit hands over to the next
_THIN, _DILUTE, _MODERATE = 0.0012, 0.014, 0.25
_TINY_FRACTION = 1e-8


@register("drag", "igci")
@dataclass(frozen=True)
class FilteredDrag(WenYu):
    """Wen-Yu drag of grains that move in clusters (Igci).

        beta = beta_WenYu (1 - share h)
        h = 2.7 a^0.234                                   a < 0.0012
            0.963 - 0.019 a^-0.455                        a < 0.014
            0.868 exp(-0.38 a) - 0.176 exp(-119.2 a)      a < 0.25
            0.852 exp(-0.268 a) - 4.59e-5 exp(19.75 a)    beyond, and not below 0

    A steady section averages over clusters of all sizes: share = Fi^1.6/(Fi^1.6 + 0.4) is near 1
    where the line is wide against v_t^2/g.

    Validity: fine grains (group A) in risers and wide lines, Fi > 4.
    Source: Igci, Pannala, Benyahia and Sundaresan (2012), Ind. Eng. Chem. Res. 51, 2094-2103.
    """

    filtered: ClassVar[bool] = True
    share: float = parameter(1.0, "-", "share of the clusters that are not resolved", ge=0, le=1)

    def clustering(self, alpha_s: Value) -> Value:
        """h [-]."""
        a = maximum(alpha_s, _TINY_FRACTION)
        thin = 2.7 * a**0.234
        dilute = 0.963 - 0.019 * a**-0.455
        moderate = 0.868 * exp(-0.38 * a) - 0.176 * exp(-119.2 * a)
        dense = maximum(0.852 * exp(-0.268 * a) - 4.59e-5 * exp(19.75 * a), 0.0)
        found = where_greater(a, _MODERATE, dense, moderate)
        found = where_greater(a, _DILUTE, found, dilute)
        return where_greater(a, _THIN, found, thin)

    def specific(self, alpha_s: Value, slip: Value, gas: Fluid, solids: Solids) -> Value:
        """beta/alpha_s [kg/m3/s]."""
        uniform = super().specific(alpha_s, slip, gas, solids)
        return uniform * (1 - self.share * self.clustering(alpha_s))

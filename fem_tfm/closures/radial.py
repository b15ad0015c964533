# SPDX-License-Identifier: LGPL-3.0-or-later
"""Radial distribution function at contact, g0 [-].

g0 multiplies the collision rate: about one in a dilute gas of grains, without bound at packing.
Symbols: a = alpha_s solids fraction, a_max packing limit, gap = 1 - a/a_max. Near packing the gap
has few digits where it is found from a; who knows it better gives it.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

from fem_tfm.closures.base import Closure, register
from fem_tfm.closures.ops import Value, safe_pow
from fem_tfm.materials import Solids

_TINY_FRACTION = 1e-6


class Radial(Closure):
    """Interface of a radial distribution function."""

    def g0(self, alpha_s: Value, solids: Solids, gap: Value | None = None) -> Value:
        """Radial distribution at contact [-].

        gap : 1 - alpha_s/packing_limit [-], found from alpha_s where it is not given
        """
        known = 1 - alpha_s / solids.packing_limit if gap is None else gap
        return self._g0(alpha_s, known, solids)

    @abstractmethod
    def _g0(self, alpha_s: Value, gap: Value, solids: Solids) -> Value:
        """g0 of alpha_s and its gap to packing [-]."""


@register("radial", "savage")
@dataclass(frozen=True)
class Savage(Radial):
    """Savage radial distribution.

        g0 = (1 - 7a/16)/(1 - a/a_max)^2

    Validity: 0 <= a < a_max.
    Source: Savage (1988), as eq. (12) of Ding et al. (2024), Appl. Sci. 14, 2031.
    """

    def _g0(self, alpha_s: Value, gap: Value, solids: Solids) -> Value:
        return (1 - 7 * alpha_s / 16) / gap**2


@register("radial", "lun-savage")
@dataclass(frozen=True)
class LunSavage(Radial):
    """Lun-Savage radial distribution.

        g0 = (1 - a/a_max)^(-2.5 a_max)

    Validity: 0 <= a < a_max.
    Source: Lun and Savage (1986), Acta Mech. 63, 15-44.
    """

    def _g0(self, alpha_s: Value, gap: Value, solids: Solids) -> Value:
        return gap ** (-2.5 * solids.packing_limit)


@register("radial", "sinclair-jackson")
@dataclass(frozen=True)
class SinclairJackson(Radial):
    """Sinclair-Jackson radial distribution.

        g0 = 1/[1 - (a/a_max)^(1/3)]

    The cube root is regularised below a/a_max = 1e-6, where its slope has no bound.

    Validity: 0 <= a < a_max; larger than the other laws in dilute flow.
    Source: Sinclair and Jackson (1989), AIChE J. 35, 1473-1486, after Bagnold (1954).
    """

    def _g0(self, alpha_s: Value, gap: Value, solids: Solids) -> Value:
        share = alpha_s / solids.packing_limit
        r = safe_pow(share, 1 / 3, _TINY_FRACTION)
        # 1/(1 - r), where nothing that is nearly 1 is subtracted from 1
        return (1 + r + r * r) / (gap * (1 + share - r * r * r))


@register("radial", "carnahan-starling")
@dataclass(frozen=True)
class CarnahanStarling(Radial):
    """Carnahan-Starling radial distribution of hard spheres.

        g0 = (1 - a/2)/(1 - a)^3

    Validity: a < 0.5; it stays finite at packing, so friction must keep the grains apart.
    Source: Carnahan and Starling (1969), J. Chem. Phys. 51, 635-636.
    """

    def _g0(self, alpha_s: Value, gap: Value, solids: Solids) -> Value:
        return (1 - alpha_s / 2) / (1 - alpha_s) ** 3


@register("radial", "ma-ahmadi")
@dataclass(frozen=True)
class MaAhmadi(Radial):
    """Ma-Ahmadi radial distribution, fitted to molecular dynamics.

        g0 = (1 + 2.5 a + 4.5904 a^2 + 4.515439 a^3)/[1 - (a/a_max)^3]^0.67802

    Validity: 0 <= a < a_max; fitted with a_max = 0.64356.
    Source: Ma and Ahmadi (1986), J. Chem. Phys. 84, 3449-3450.
    """

    def _g0(self, alpha_s: Value, gap: Value, solids: Solids) -> Value:
        a = alpha_s
        virial = 1 + a * (2.5 + a * (4.5904 + a * 4.515439))
        # 1 - (1 - gap)^3
        return virial / (gap * (3 - gap * (3 - gap))) ** 0.67802

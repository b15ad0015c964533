# SPDX-License-Identifier: LGPL-3.0-or-later
"""One section of a developing flow, solved from the sections upstream of it."""

from __future__ import annotations

from dolfinx import fem

from fem_tfm.flows.section import Section
from fem_tfm.models.axis import Axis, DevelopingAxis
from fem_tfm.solvers.newton import Border


class Station(Section):
    """A section with the flux differences to the stations before it.

    What enters leaves: the forms of continuity give each phase the flux of the station before for
    any G. A wrong G would show as a mean of the pressure in the section, so G is the one for which
    that mean is zero. `old` and `older` hold the two stations before, `weights` the backward
    difference.
    """

    def _axis(self) -> Axis:
        self.older = fem.Function(self.space)
        self.weights = [self._constant(0.0) for _ in range(3)]
        return DevelopingAxis(self.weights, [self.state(self.old), self.state(self.older)])

    def _borders(self) -> list[Border]:
        mean = self.state(self.now).p * self.domain.dx
        return [self._drive_border(mean, *self._targets())]

    def _targets(self) -> list[float]:
        return [0.0]

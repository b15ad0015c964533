# SPDX-License-Identifier: LGPL-3.0-or-later
"""The split of the pressure drop of an unsteady line: friction, lift, and what accelerates.

    friction = -sum over the wall of (traction.e) S/A
    lift     = -sum over the cells of (alpha_s rho_s + alpha_g rho_g) (g.e) V/A

e is the axis of the line and A the area of its section. The rest of the drop accelerates both
phases: in time, from the inlet to the outlet, and around a bend.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fem_tfm.models.finite_volume.cells.line import LineMesh
from fem_tfm.models.finite_volume.cells.mesh import Array
from fem_tfm.models.finite_volume.state import State
from fem_tfm.models.pointwise import tangential
from fem_tfm.models.two_fluid.split import ACCELERATION, GAS, LIFT, SOLIDS


class DropSplit:
    """Parts of a pressure drop.

    Parameters
    ----------
    line : mesh
    gravity : acceleration (3,) [m/s2]
    """

    def __init__(self, line: LineMesh, gravity: Array) -> None:
        self.line = line
        cells, mesh = line.cells, line.mesh
        self._along_wall = mesh.axis(cells.face_centre[line.wall])
        self._lifted = -(mesh.axis(cells.centre[line.own]) @ gravity) * line.volume
        assert mesh.length is not None
        self._area = cells.total(line.volume) / mesh.length

    def parts(
        self, state: State, friction: Mapping[str, Array], density: Array, drop: float
    ) -> dict[str, float]:
        """Friction of each phase, lift and acceleration [Pa] (collective).

        friction : tangential force over velocity on the wall's faces, by phase [kg/s]
        density : of both phases together in the owned cells [kg/m3]
        drop : of the pressure [Pa]
        """
        cells, wall = self.line.cells, self.line.wall
        edge, normal, found = cells.first[wall], self.line.normal[wall], {}
        velocities = {"gas": (GAS, state.u_g), "solids": (SOLIDS, state.u_s)}
        for phase, coefficient in friction.items():
            name, velocity = velocities[phase]
            along = tangential(velocity[edge], normal)
            force = coefficient * np.einsum("ni,ni->n", along, self._along_wall)
            found[name] = cells.total(force) / self._area
        found = {name: found[name] for name in (GAS, SOLIDS) if name in found}
        found[LIFT] = cells.total(density * self._lifted) / self._area
        return found | {ACCELERATION: drop - sum(found.values())}
